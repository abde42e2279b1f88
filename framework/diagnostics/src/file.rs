//! Opens files that people name.

use std::fs::File;
use std::io;
use std::path::Path;

/// Opens a file for reading. Folders, pipes and devices are refused: opening a named pipe would wait for its writer.
///
/// # Errors
/// That of the system; what was found in place of a file.
pub fn open(path: &Path) -> io::Result<File> {
    let kind = std::fs::metadata(path)?.file_type();
    // These are open already: a pipe there has a program at its other end.
    let is_open = ["/dev/stdin", "/dev/fd", "/proc/self/fd"].iter().any(|it| path.starts_with(it));
    if kind.is_file() || is_open && !kind.is_dir() {
        return File::open(path);
    }
    let found = if kind.is_dir() { "a folder" } else { "a pipe or device" };
    Err(io::Error::new(io::ErrorKind::InvalidInput, format!("found {found}, expected a file")))
}

/// The text of a file, as [`open`].
///
/// # Errors
/// As [`open`]; a text that is not UTF-8.
pub fn read_text(path: &Path) -> io::Result<String> {
    open(path).and_then(io::read_to_string)
}
