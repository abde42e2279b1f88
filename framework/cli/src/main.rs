//! Entry point of the `foveate` program.

use std::panic;
use std::process::ExitCode;

use clap::Parser;
use foveate_cli::commands::Cli;
use foveate_cli::{exit, output};

fn main() -> ExitCode {
    // A panic inside a node is caught, reported with the node's name and dealt with as the rig says; the default hook
    // would print it a second time in the middle of the progress line.
    panic::set_hook(Box::new(|_| {}));
    let cli = Cli::parse();
    match panic::catch_unwind(|| cli.run()) {
        Ok(exit::DONE) if output::failed() => ExitCode::from(exit::INPUT),
        Ok(code) => ExitCode::from(code),
        Err(payload) => {
            let text = payload.downcast_ref::<&str>().copied();
            let text = text.or_else(|| payload.downcast_ref::<String>().map(String::as_str)).unwrap_or("no text");
            output::tell(format_args!(
                "error: foveate itself failed: {text}\nThis is a defect of the program, not of your rig; please report it with the rig file.\n"
            ));
            ExitCode::from(exit::PROGRAM)
        }
    }
}
