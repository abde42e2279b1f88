//! Signals that end the program (INT, TERM, HUP): the first ends a run in good order, the second ends the program; of work that cannot be ended
//! early, the first does.

use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Duration;

use serde_json::{Map, Value};

use crate::results;

/// A signal that came, by its name and the exit code of a program that it ended, as shells report it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Signal {
    /// As `SIGINT`.
    pub name: &'static str,
    /// 128 and its number.
    pub code: u8,
}

const INT: Signal = Signal { name: "SIGINT", code: 130 };
#[cfg(unix)]
const TERM: Signal = Signal { name: "SIGTERM", code: 143 };
#[cfg(unix)]
const HUP: Signal = Signal { name: "SIGHUP", code: 129 };

static LAST_WORDS: Mutex<Option<String>> = Mutex::new(None);
static CAUGHT: OnceLock<Signal> = OnceLock::new();
static STOP: Mutex<Option<Arc<AtomicBool>>> = Mutex::new(None);
static IS_LISTENING: OnceLock<Result<(), String>> = OnceLock::new();

/// From now on a signal ends the program at once, with `words` on standard error, where [`stops`] was called before.
pub fn ends(words: String) {
    *LAST_WORDS.lock().unwrap_or_else(PoisonError::into_inner) = Some(words);
}

/// From now on a signal sets `stop`; one that came before sets it now.
///
/// # Errors
/// A sentence when the system does not allow it.
pub fn stops(stop: &Arc<AtomicBool>) -> Result<(), String> {
    *LAST_WORDS.lock().unwrap_or_else(PoisonError::into_inner) = None;
    *STOP.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::clone(stop));
    if CAUGHT.get().is_some() {
        stop.store(true, Ordering::Relaxed);
    }
    let listening = IS_LISTENING.get_or_init(|| listen().map_err(|error| format!("signals cannot be caught: {error}")));
    listening.clone()
}

/// The signal that ended the run, if one came.
pub fn caught() -> Option<Signal> {
    CAUGHT.get().copied()
}

/// The figures of a summary with what became of the run: `interrupted`, and by which signal.
pub fn told(mut figures: Map<String, Value>, interrupted: bool) -> Map<String, Value> {
    figures.insert("interrupted".to_owned(), interrupted.into());
    if let Some(signal) = caught().filter(|_| interrupted) {
        figures.insert("interrupted_by".to_owned(), signal.name.into());
    }
    figures
}

/// Waits until `stop` is set.
pub fn wait(stop: &AtomicBool) {
    while !stop.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// What each signal does.
fn come(signal: Signal) {
    if let Some(words) = &*LAST_WORDS.lock().unwrap_or_else(PoisonError::into_inner) {
        // Beside the ^C that a terminal shows, and the line before it.
        let start = if std::io::stderr().is_terminal() { "\n" } else { "" };
        eprintln!("{start}{words}");
        leave(signal);
    }
    if CAUGHT.set(signal).is_err() {
        leave(signal);
    }
    if let Some(stop) = &*STOP.lock().unwrap_or_else(PoisonError::into_inner) {
        stop.store(true, Ordering::Relaxed);
    }
}

fn leave(signal: Signal) -> ! {
    results::abandon(signal);
    std::process::exit(signal.code.into())
}

#[cfg(unix)]
fn listen() -> std::io::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

    let mut wanted = vec![SIGINT, SIGTERM];
    // `nohup` has said that a closed terminal is no reason to end.
    if !is_ignored(SIGHUP) {
        wanted.push(SIGHUP);
    }
    let mut signals = signal_hook::iterator::Signals::new(wanted)?;
    let serve = move || {
        for number in signals.forever() {
            come(match number {
                SIGTERM => TERM,
                SIGHUP => HUP,
                _ => INT,
            });
        }
    };
    std::thread::Builder::new().name("signals".to_owned()).spawn(serve).map(drop)
}

/// Whether the program was started with this signal ignored; no where the system does not tell.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|it| it.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|it| u64::from_str_radix(it.trim(), 16).ok()).unwrap_or(0);
    mask >> (signal - 1) & 1 == 1
}

#[cfg(not(unix))]
fn listen() -> Result<(), ctrlc::Error> {
    ctrlc::set_handler(|| come(INT))
}
