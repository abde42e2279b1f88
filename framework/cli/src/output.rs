//! Output on the terminal: standard output that may be a closed pipe, and colour where standard error is a terminal.

use std::io::{ErrorKind, IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};

static FAILED: AtomicBool = AtomicBool::new(false);

/// Writes `text` to standard output. A reader that has gone away (`| head`) is no error; another fault, such as a full disk, is
/// reported once, and [`failed`] knows.
pub fn say(text: &str) {
    write(text.as_bytes());
}

/// As [`say`], what is no text.
pub fn write(bytes: &[u8]) {
    let mut out = std::io::stdout().lock();
    let written = out.write_all(bytes).and_then(|()| out.flush());
    if let Err(error) = written
        && error.kind() != ErrorKind::BrokenPipe
        && !FAILED.swap(true, Ordering::Relaxed)
    {
        eprintln!("error: standard output cannot be written: {error}");
    }
}

/// Writes to standard error; does nothing where that is gone.
pub fn tell(words: std::fmt::Arguments<'_>) {
    drop(std::io::stderr().lock().write_fmt(words));
}

/// Whether output on standard output was lost.
pub fn failed() -> bool {
    FAILED.load(Ordering::Relaxed)
}

/// Whether standard error is a terminal that wants colour.
pub fn wants_color() -> bool {
    std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|it| it.is_empty())
}
