//! Ctrl-C: the first ends a run in good order, the second ends the program.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Exit code of a program that SIGINT ended, as shells report it.
const INTERRUPTED: i32 = 130;

/// From now on Ctrl-C sets `stop`.
///
/// # Errors
/// A sentence when the system does not allow it.
pub fn stops(stop: &Arc<AtomicBool>) -> Result<(), String> {
    let stop = Arc::clone(stop);
    let handler = ctrlc::set_handler(move || {
        if stop.swap(true, Ordering::Relaxed) {
            std::process::exit(INTERRUPTED);
        }
    });
    handler.map_err(|error| format!("Ctrl-C cannot be caught: {error}"))
}
