//! Words on the terminal: standard output that may be a closed pipe, and colour where somebody sees it.

use std::io::{IsTerminal, Write};

/// Writes `text` to standard output. A reader that has gone away (`| head`) is no error.
pub fn say(text: &str) {
    let mut out = std::io::stdout().lock();
    drop(out.write_all(text.as_bytes()).and_then(|()| out.flush()));
}

/// Whether standard error is a terminal that wants colour.
pub fn wants_color() -> bool {
    std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|it| it.is_empty())
}
