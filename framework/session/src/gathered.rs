//! A file that is gathered in memory and written at each flush, on Linux past the system's cache where the writer has the time.
//!
//! Pictures fill that cache with what is not read again. 122 MB/s onto ext4 take 24 to 35 % of a core through the cache, and 1 to 2 % straight to the disk (the time
//! of the system in `cargo bench -p foveate-session -- live raw`). But the disk is slower than the cache, which takes up what comes in bursts. The last part of a
//! block goes through the cache, so that the file ends where the content does.

use std::fs::{File, OpenOptions};
use std::io::{Cursor, ErrorKind, Result, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Size of a page and of the largest usual block of a disk: direct writes begin and end at its multiples, in the file and in memory [bytes].
const BLOCK: usize = 4096;

/// A new file. What is not flushed is in memory alone, and may be written over there.
pub struct Gathered {
    file: File,
    /// The same file, past the cache.
    direct: Option<File>,
    /// Whether the writer has the time to go past the cache.
    is_at_leisure: Arc<AtomicBool>,
    /// From `start` on: what stands in the file from `at` on.
    bytes: Cursor<Vec<u8>>,
    /// Where in memory a block begins.
    start: usize,
    /// Where in the file that block begins.
    at: u64,
    /// Where the file ended after the last two flushes, the later one first.
    ends: [u64; 2],
    /// A flush failed: nothing is written behind the end that is left.
    has_failed: bool,
}

impl Gathered {
    /// The empty file `file`, which lies at `path`.
    pub fn new(file: File, path: &Path, is_at_leisure: Arc<AtomicBool>) -> Gathered {
        Gathered {
            file,
            direct: open_direct(path),
            is_at_leisure,
            bytes: Cursor::default(),
            start: 0,
            at: 0,
            ends: [0; 2],
            has_failed: false,
        }
    }

    /// Moves what was gathered to where a block begins in memory.
    fn align(&mut self) {
        let place = self.bytes.position() as usize - self.start;
        let bytes = self.bytes.get_mut();
        bytes.reserve(BLOCK);
        let start = bytes.as_ptr().align_offset(BLOCK);
        if start != self.start {
            let end = bytes.len() - self.start + start;
            bytes.resize(end.max(bytes.len()), 0);
            bytes.copy_within(self.start..self.start + end - start, start);
            bytes.truncate(end);
            self.start = start;
        }
        self.bytes.set_position((self.start + place) as u64);
    }
}

impl Write for Gathered {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        self.bytes.write(bytes)
    }

    fn flush(&mut self) -> Result<()> {
        if self.has_failed {
            return Err(ErrorKind::StorageFull.into());
        }
        let flushed = self.flush_all();
        self.has_failed = flushed.is_err();
        match flushed {
            Ok(()) => self.ends = [self.at + (self.bytes.get_ref().len() - self.start) as u64, self.ends[0]],
            // On a full disk others need room: the last chunk goes with the one that is not whole.
            Err(_) => drop(self.file.set_len(self.ends[1])),
        }
        flushed
    }
}

impl Gathered {
    fn flush_all(&mut self) -> Result<()> {
        self.align();
        let gathered = &self.bytes.get_ref()[self.start..];
        let mut n_direct = 0;
        let direct = self.direct.as_mut().filter(|_| self.is_at_leisure.load(Ordering::Relaxed));
        if let Some(direct) = direct {
            let whole = gathered.len() / BLOCK * BLOCK;
            direct.seek(SeekFrom::Start(self.at))?;
            match direct.write_all(&gathered[..whole]) {
                Ok(()) => n_direct = whole,
                // A file system that wants other blocks.
                Err(error) if error.kind() == ErrorKind::InvalidInput => self.direct = None,
                Err(error) => return Err(error),
            }
        }
        self.file.seek(SeekFrom::Start(self.at + n_direct as u64))?;
        self.file.write_all(&gathered[n_direct..])?;
        // The last block is written again with what follows.
        let n_done = gathered.len() / BLOCK * BLOCK;
        self.at += n_done as u64;
        self.bytes.get_mut().drain(self.start..self.start + n_done);
        self.bytes.set_position(self.bytes.position() - n_done as u64);
        Ok(())
    }
}

impl Seek for Gathered {
    /// Not to before what was flushed.
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        let start = self.start as u64;
        let to = match to {
            SeekFrom::Start(place) => {
                SeekFrom::Start(place.checked_sub(self.at).ok_or(ErrorKind::InvalidInput)? + start)
            }
            other => other,
        };
        Ok(self.bytes.seek(to)? - start + self.at)
    }
}

#[cfg(target_os = "linux")]
fn open_direct(path: &Path) -> Option<File> {
    use std::os::unix::fs::OpenOptionsExt;
    OpenOptions::new().write(true).custom_flags(libc::O_DIRECT).open(path).ok()
}

#[cfg(not(target_os = "linux"))]
fn open_direct(_: &Path) -> Option<File> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_holds_what_was_flushed_and_written_over() {
        let folder = tempfile::tempdir().unwrap();
        for is_direct in [true, false] {
            let path = folder.path().join(is_direct.to_string());
            let mut gathered = Gathered::new(File::create(&path).unwrap(), &path, Arc::new(AtomicBool::new(is_direct)));
            let mut expected = Cursor::new(Vec::new());
            for n in [1, BLOCK - 1, BLOCK, 3 * BLOCK + 7, 5, 40 * BLOCK, 0, 300_001] {
                let bytes: Vec<u8> = (0..n).map(|it| (it * 7 + n) as u8).collect();
                for it in [&mut gathered as &mut dyn WriteSeek, &mut expected] {
                    let place = it.stream_position().unwrap();
                    it.write_all(b"a head").unwrap();
                    it.write_all(&bytes).unwrap();
                    it.seek(SeekFrom::Start(place)).unwrap();
                    it.write_all(b"over").unwrap();
                    it.seek(SeekFrom::End(0)).unwrap();
                    it.flush().unwrap();
                }
                assert_eq!(gathered.stream_position().unwrap(), expected.position());
                assert!(std::fs::read(&path).unwrap() == *expected.get_ref(), "{n} {is_direct}");
            }
        }
    }

    trait WriteSeek: Write + Seek {}
    impl<T: Write + Seek> WriteSeek for T {}
}
