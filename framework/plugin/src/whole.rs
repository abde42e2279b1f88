//! Whether a library is whole: the system maps a file that was cut off without a word, and ends the program when it touches what is not there.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use foveate_node::LibraryError;

/// Bytes of the header of a 64-bit ELF file, and of one entry of its table of segments.
const HEADER: usize = 64;
const SEGMENT: usize = 56;
/// What stands at its start: the mark of the format, 64 bits, the low byte first.
const START: [u8; 6] = [0x7f, b'E', b'L', b'F', 2, 1];

/// Refuses what is no ordinary file (a pipe would be waited for), and an ELF file that is shorter than its own tables say.
///
/// # Errors
/// What was found and expected.
pub(crate) fn check(path: &Path) -> Result<(), LibraryError> {
    let unreadable = |error: std::io::Error| LibraryError::new(format_args!("this cannot be read: {error}"));
    let about = std::fs::metadata(path).map_err(unreadable)?;
    if !about.is_file() {
        return Err(LibraryError::new("found no ordinary file, expected a shared library"));
    }
    let mut bytes = Vec::new();
    // The table of segments stands behind the header; a page holds more of them than linkers write.
    File::open(path).and_then(|file| file.take(4096).read_to_end(&mut bytes)).map_err(unreadable)?;
    match needed(&bytes) {
        Some(needed) if about.len() < needed => Err(LibraryError::new(format_args!(
            "found {} bytes, expected {needed}: the library is cut off, as by a copy that did not come to its end",
            about.len()
        ))),
        // Files of other systems, and what is no library at all, are left to who opens them.
        Some(_) | None => Ok(()),
    }
}

/// How long an ELF file that begins so has to be; `None` for other files.
fn needed(bytes: &[u8]) -> Option<u64> {
    if !bytes.starts_with(&START) {
        return None;
    }
    if bytes.len() < HEADER {
        return Some(HEADER as u64);
    }
    let short = |at: usize| Some(u64::from(u16::from_le_bytes(bytes.get(at..at.checked_add(2)?)?.try_into().ok()?)));
    let long = |at: usize| Some(u64::from_le_bytes(bytes.get(at..at.checked_add(8)?)?.try_into().ok()?));
    let (segments, n_segments) = (long(32)?, short(56)?);
    let mut needed = long(40)?.saturating_add(short(58)? * short(60)?);
    needed = needed.max(segments.saturating_add(n_segments * SEGMENT as u64));
    for index in 0..n_segments as usize {
        let at = usize::try_from(segments).ok()?.saturating_add(index * SEGMENT);
        let (Some(offset), Some(length)) = (long(at.saturating_add(8)), long(at.saturating_add(32))) else { break };
        needed = needed.max(offset.saturating_add(length));
    }
    Some(needed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(all(target_os = "linux", target_pointer_width = "64", target_endian = "little"))]
    fn a_file_that_is_cut_off_anywhere_is_refused_and_a_whole_one_is_not() {
        let whole = std::fs::read("/proc/self/exe").unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("library.so");
        let cut = |length: usize| {
            std::fs::write(&path, &whole[..length]).unwrap();
            check(&path)
        };
        assert!(cut(whole.len()).is_ok());
        for length in [6, 40, 64, 500, 5000, 100_000, whole.len() / 2, whole.len() - 1] {
            assert!(cut(length).unwrap_err().to_string().contains("cut off"), "{length} of {}", whole.len());
        }
        std::fs::write(&path, "no library").unwrap();
        assert!(check(&path).is_ok(), "left to who opens it");
        assert!(check(folder.path()).unwrap_err().to_string().contains("no ordinary file"));
        assert_eq!(needed(&[&START[..], &[0xff; 60]].concat()), Some(u64::MAX));
    }
}
