//! Entry point of the `foveate` program.

use std::process::ExitCode;

fn main() -> ExitCode {
    foveate_cli::run(foveate_cli::registry())
}
