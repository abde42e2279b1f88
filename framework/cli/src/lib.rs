//! The `foveate` program: the only room that knows all the others and the built-in plugins.

/// As that of the standard library, but does not fail where standard error is gone (a closed terminal or pipe).
macro_rules! eprintln {
    ($($words:tt)*) => { $crate::output::tell(format_args!("{}\n", format_args!($($words)*))) };
}
/// See `eprintln` here.
macro_rules! eprint {
    ($($words:tt)*) => { $crate::output::tell(format_args!($($words)*)) };
}

pub mod calibrate;
pub mod commands;
pub mod evaluation;
mod interrupt;
pub mod outcome;
pub mod output;
pub mod progress;
pub mod results;
mod status;
mod terminal;

use std::panic;
use std::process::ExitCode;

use clap::Parser;
use foveate_node::Registry;

/// The node types of the built-in plugins: each plugin is named here once.
pub fn registry() -> Registry {
    let mut registry = Registry::new();
    #[cfg(target_os = "linux")]
    foveate_plugin::process::register(&mut registry);
    foveate_sim::register(&mut registry);
    foveate_capture::register(&mut registry);
    foveate_session::source::register(&mut registry);
    foveate_led::register(&mut registry);
    foveate_pan_tilt::register(&mut registry);
    foveate_blob::register(&mut registry);
    foveate_board::register(&mut registry);
    foveate_select::register(&mut registry);
    foveate_laser_pointer::register(&mut registry);
    foveate_display::register(&mut registry);
    foveate_structured_light::register(&mut registry);
    foveate_surface::register(&mut registry);
    foveate_painted_mark::register(&mut registry);
    foveate_voxel_body::register(&mut registry);
    foveate_export::register(&mut registry);
    registry
}

/// The whole `foveate` program with the node types of `registry`: reads the command line, runs the command, returns the exit code.
///
/// So an author's own program has all commands for nodes that are linked into it:
///
/// ```no_run
/// fn main() -> std::process::ExitCode {
///     let mut registry = foveate_cli::registry();
///     // my_plugin::register(&mut registry);
///     foveate_cli::run(registry)
/// }
/// ```
pub fn run(mut registry: Registry) -> ExitCode {
    // A panic inside a node is caught, reported with the node's name and dealt with as the rig says; the default hook
    // would print it a second time in the middle of the progress line.
    panic::set_hook(Box::new(|_| {}));
    registry.open_libraries_with(foveate_plugin::open::open);
    let cli = commands::Cli::parse();
    match panic::catch_unwind(panic::AssertUnwindSafe(|| cli.run(registry))) {
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

/// Exit codes, as documented in `foveate --help`.
pub mod exit {
    /// Done.
    pub const DONE: u8 = 0;
    /// The rig or its input is at fault.
    pub const INPUT: u8 = 2;
    /// A requirement marked `must` was not met.
    pub const UNMET: u8 = 3;
    /// A calibration is to be done again.
    pub const REDO: u8 = 3;
    /// This program is at fault.
    pub const PROGRAM: u8 = 70;
    // A run that a signal ended: 128 and the signal's number, see `interrupt`.
}
