//! The `foveate` program: the only room that knows all the others and the built-in plugins.

/// As that of the standard library, but for a standard error that is gone (a closed terminal, a pipe that nobody reads): no reason to fail.
macro_rules! eprintln {
    ($($words:tt)*) => { $crate::output::tell(format_args!("{}\n", format_args!($($words)*))) };
}
/// See `eprintln` here.
macro_rules! eprint {
    ($($words:tt)*) => { $crate::output::tell(format_args!($($words)*)) };
}

pub mod calibrate;
pub mod commands;
mod interrupt;
pub mod outcome;
pub mod output;
pub mod progress;
pub mod results;

use foveate_node::Registry;

/// Every node type that this program is built with: each plugin is named here once.
pub fn registry() -> Registry {
    let mut registry = Registry::new();
    foveate_sim::register(&mut registry);
    foveate_capture::register(&mut registry);
    foveate_led::register(&mut registry);
    foveate_pan_tilt::register(&mut registry);
    foveate_blob::register(&mut registry);
    foveate_board::register(&mut registry);
    foveate_select::register(&mut registry);
    foveate_painted_mark::register(&mut registry);
    foveate_export::register(&mut registry);
    registry
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
