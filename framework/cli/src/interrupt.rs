//! Ctrl-C: the first ends a run in good order, the second ends the program; of work that cannot be ended early, the first does.

use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

/// Exit code of a program that SIGINT ended, as shells report it.
const INTERRUPTED: i32 = 130;

static LAST_WORDS: OnceLock<String> = OnceLock::new();

/// From now on Ctrl-C ends the program at once, with `words` on standard error, where [`stops`] was called before.
pub fn ends(words: String) {
    LAST_WORDS.get_or_init(|| words);
}

/// From now on Ctrl-C sets `stop`.
///
/// # Errors
/// A sentence when the system does not allow it.
pub fn stops(stop: &Arc<AtomicBool>) -> Result<(), String> {
    let stop = Arc::clone(stop);
    let handler = ctrlc::set_handler(move || {
        if let Some(words) = LAST_WORDS.get() {
            // Beside the ^C that a terminal shows, and the line before it.
            let start = if std::io::stderr().is_terminal() { "\n" } else { "" };
            eprintln!("{start}{words}");
            std::process::exit(INTERRUPTED);
        }
        if stop.swap(true, Ordering::Relaxed) {
            std::process::exit(INTERRUPTED);
        }
    });
    handler.map_err(|error| format!("Ctrl-C cannot be caught: {error}"))
}
