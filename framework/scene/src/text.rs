//! Texts of files: read as a whole, with places in them, and written as TOML.

use std::io::Read as _;
use std::path::Path;

use foveate_diagnostics::file;

use crate::error::CalibrationDiagnostic;

/// Larger files are no calibration; this stops a reader that was given the wrong one, or a device, early [bytes].
const MAX_FILE_SIZE: u64 = 16 << 20;

/// A TOML basic string on one line, which may stand as a key too.
pub(crate) fn quoted(text: &str) -> String {
    let mut quoted = String::from("\"");
    for it in text.chars() {
        match it {
            '"' | '\\' => quoted.extend(['\\', it]),
            it if it.is_control() => quoted.extend(format!("\\u{:04X}", u32::from(it)).chars()),
            it => quoted.push(it),
        }
    }
    quoted.push('"');
    quoted
}

/// Reads a text file of at most 16 MiB.
pub(crate) fn read_text(path: &Path) -> Result<String, CalibrationDiagnostic> {
    let unreadable =
        |error: std::io::Error| CalibrationDiagnostic::of_file(path, format!("cannot be read ({error})"), "a file");
    let mut bytes = Vec::new();
    file::open(path).and_then(|file| file.take(MAX_FILE_SIZE + 1).read_to_end(&mut bytes)).map_err(unreadable)?;
    if bytes.len() as u64 > MAX_FILE_SIZE {
        return Err(CalibrationDiagnostic::of_file(path, "has more than 16 MiB", "a calibration of at most 16 MiB"));
    }
    String::from_utf8(bytes).map_err(|error| {
        let before = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        let place = Some(place_of(&String::from_utf8_lossy(before), before.len()));
        let fault = CalibrationDiagnostic::of_file(path, "a byte that is not UTF-8", "a text file in UTF-8");
        CalibrationDiagnostic { place, ..fault }
    })
}

/// Line and column, both from 1, of the byte `offset` in `text`.
pub(crate) fn place_of(text: &str, offset: usize) -> (usize, usize) {
    let before = text.get(..offset).unwrap_or(text);
    let line_start = before.rfind('\n').map_or(0, |it| it + 1);
    (before.matches('\n').count() + 1, before[line_start..].chars().count() + 1)
}

/// A camera's name as a TOML key.
pub(crate) fn key(name: &str) -> String {
    let plain = !name.is_empty() && name.chars().all(|it| it.is_ascii_alphanumeric() || "-_".contains(it));
    if plain { name.to_owned() } else { quoted(name) }
}
