//! A file that is complete at any time while it grows: a head that is rewritten, and rows after it.
//!
//! Rows wait in memory until they are written; then the head is rewritten to match. Where writing fails (a full disk, a folder without
//! permission) they keep waiting and each flush tries again; at the end, or when they become too many, the file moves to the system's folder
//! for temporary files. A change of all rows makes a second file from the first one, row by row, which replaces it when it is complete.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufReader, BufWriter, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use foveate::prelude::*;

use crate::pace::Pace;
use crate::row_file::{create_new, refuge_name};

/// Rows that may wait in memory before the file moves elsewhere [bytes].
const WAITING_LIMIT: usize = 32 << 20;
/// Rows are written when they exceed this [bytes].
const MUCH: usize = 1 << 20;

/// A file with a head and rows.
#[derive(Debug)]
pub(crate) struct GrowingFile {
    /// `None`: the run keeps no results.
    folder: Option<PathBuf>,
    name: String,
    open: Option<Open>,
    /// Rows that are not in the file yet.
    waiting: Vec<u8>,
    fault: Option<String>,
    /// Folder for the file where its own cannot be written.
    refuge_dir: PathBuf,
    refuge_name: String,
    pace: Pace,
}

/// The file as it is on the disk.
#[derive(Debug)]
struct Open {
    path: PathBuf,
    file: File,
    head_bytes: u64,
    /// Length of everything after the head.
    row_bytes: u64,
    is_refuge: bool,
}

impl GrowingFile {
    /// The file `name` of `setup`'s results folder; nothing is touched before the first flush.
    pub(crate) fn new(setup: &Setup, name: &str) -> Self {
        Self {
            folder: setup.out_dir.clone(),
            name: name.to_owned(),
            open: None,
            waiting: Vec::new(),
            fault: None,
            refuge_dir: std::env::temp_dir(),
            refuge_name: refuge_name(&setup.instance, name),
            pace: Pace::new(setup),
        }
    }

    /// Whether anything is to be written.
    pub(crate) fn is_wanted(&self) -> bool {
        self.folder.is_some()
    }

    /// Buffer for new rows; only whole rows may be added.
    pub(crate) fn rows(&mut self) -> &mut Vec<u8> {
        &mut self.waiting
    }

    /// Whether so much is waiting that it should be written.
    pub(crate) fn is_much(&self) -> bool {
        self.waiting.len() >= MUCH && self.fault.is_none()
    }

    /// Whether a second has passed since the last flush, or much waits.
    pub(crate) fn is_due(&mut self, now: Time) -> bool {
        self.pace.is_due(now) || self.is_much()
    }

    /// Writes the waiting rows, then the head, which must keep its length.
    pub(crate) fn flush(&mut self, head: &[u8]) {
        let Some(path) = self.folder.as_ref().map(|it| it.join(&self.name)) else { return self.waiting.clear() };
        let Err(error) = self.write_out(head) else { return };
        let fault = self.fault.get_or_insert_with(|| error.to_string());
        self.pace.warn(&path, fault);
        if self.waiting.len() > WAITING_LIMIT && !self.is_in_refuge() {
            // When this fails too the rows stay in memory.
            self.take_refuge(head).ok();
        }
    }

    fn is_in_refuge(&self) -> bool {
        self.open.as_ref().is_some_and(|it| it.is_refuge)
    }

    fn write_out(&mut self, head: &[u8]) -> io::Result<()> {
        let Some(folder) = &self.folder else { return Ok(()) };
        let Some(open) = &mut self.open else {
            // It appears with its first rows, in place of an older one.
            let path = folder.join(&self.name);
            let mut file = Partial::create(folder, &self.name)?;
            file.write(head)?;
            file.write(&self.waiting)?;
            let row_bytes = self.waiting.len() as u64;
            let file = file.take_the_place_of(&path)?;
            self.open = Some(Open { path, file, head_bytes: head.len() as u64, row_bytes, is_refuge: false });
            self.waiting.clear();
            return Ok(());
        };
        open.file.seek(SeekFrom::Start(open.head_bytes + open.row_bytes))?;
        if let Err(error) = open.file.write_all(&self.waiting) {
            // What a full disk took of a row is taken back; where that fails the next flush writes over it.
            open.file.set_len(open.head_bytes + open.row_bytes).ok();
            return Err(error);
        }
        open.row_bytes += self.waiting.len() as u64;
        self.waiting.clear();
        open.write_head(head)
    }

    /// Rewrites the file: `head`, then the rows converted by `convert`.
    ///
    /// # Errors
    /// A sentence; the file is as it was.
    pub(crate) fn rewrite(
        &mut self,
        old_head: &[u8],
        head: &[u8],
        convert: impl Fn(&mut dyn Read, &mut dyn Write) -> io::Result<()>,
    ) -> Result<(), String> {
        let Some(folder) = self.folder.clone() else { return Ok(()) };
        if let Err(error) = self.write_out(old_head) {
            self.fault.get_or_insert_with(|| error.to_string());
            self.take_refuge(old_head)?;
        }
        let Some(open) = &mut self.open else { return Ok(()) };
        let (is_refuge, target) = (open.is_refuge, open.path.clone());
        let make = |open: &mut Open, mut file: Partial| -> io::Result<(Partial, u64)> {
            open.file.seek(SeekFrom::Start(open.head_bytes))?;
            file.write(head)?;
            let mut counting = Counting { inner: BufWriter::with_capacity(1 << 18, file.file()), count: 0 };
            convert(&mut BufReader::with_capacity(1 << 18, (&mut open.file).take(open.row_bytes)), &mut counting)?;
            counting.flush()?;
            let count = counting.count;
            drop(counting);
            Ok((file, count))
        };
        let here = if is_refuge { &self.refuge_dir } else { &folder };
        let name = target.file_name().map_or_else(|| self.name.clone(), |it| it.to_string_lossy().into_owned());
        let made = Partial::create(here, &name)
            .and_then(|file| make(open, file))
            .and_then(|(file, count)| Ok((file.take_the_place_of(&target)?, count)));
        let (file, count) = made.map_err(|error| format!("`{}`: {error}", target.display()))?;
        self.open = Some(Open { path: target, file, head_bytes: head.len() as u64, row_bytes: count, is_refuge });
        Ok(())
    }

    /// Moves the whole file to the folder for temporary files and continues there.
    fn take_refuge(&mut self, head: &[u8]) -> Result<(), String> {
        let (path, mut file) = create_new(&self.refuge_dir, &self.refuge_name)?;
        let complain = |error: io::Error| format!("`{}`: {error}", path.display());
        file.write_all(head).map_err(complain)?;
        let mut row_bytes = self.waiting.len() as u64;
        if let Some(open) = &mut self.open {
            open.file.seek(SeekFrom::Start(open.head_bytes)).map_err(complain)?;
            row_bytes += io::copy(&mut (&mut open.file).take(open.row_bytes), &mut file).map_err(complain)?;
        }
        file.write_all(&self.waiting).and_then(|()| file.sync_all()).map_err(complain)?;
        self.waiting.clear();
        // To be read again, should all rows change.
        let file = OpenOptions::new().read(true).write(true).open(&path).map_err(complain)?;
        self.open = Some(Open { path, file, head_bytes: head.len() as u64, row_bytes, is_refuge: true });
        Ok(())
    }

    /// Writes all waiting rows and `end`, and names the file in the report.
    ///
    /// # Errors
    /// The file could not be written: why, and where it is.
    pub(crate) fn finish(&mut self, head: &[u8], end: &[u8], report: &mut Report) -> Result<(), NodeError> {
        let Some(folder) = self.folder.clone() else { return Ok(()) };
        let wanted = folder.join(&self.name);
        self.waiting.extend_from_slice(end);
        let was_written = self.write_out(head).and_then(|()| match &self.open {
            Some(open) => open.file.sync_all(),
            None => Ok(()),
        });
        if let Err(error) = was_written {
            self.fault.get_or_insert_with(|| error.to_string());
            if !self.is_in_refuge() {
                self.take_refuge(head).map_err(|also| {
                    let why = self.fault.clone().unwrap_or_default();
                    let start = format!("`{}` could not be written: {why}, and neither could {also}", wanted.display());
                    let n_lost = self.waiting.len();
                    NodeError::input(match &self.open {
                        Some(_) => format!("{start}; its last {n_lost} bytes are lost"),
                        None => format!("{start}; it is lost"),
                    })
                })?;
            }
        }
        let why = self.fault.clone().unwrap_or_default();
        match &self.open {
            Some(open) if open.is_refuge => {
                report.file(&open.path);
                let path = open.path.display();
                Err(NodeError::input(format!("`{}` could not be written: {why}; it is `{path}`", wanted.display())))
            }
            _ => {
                if self.fault.is_some() {
                    let wanted = wanted.display();
                    report.remark(format!("`{wanted}` could not be written for a while ({why}); it is complete now"));
                }
                report.file(&self.name);
                Ok(())
            }
        }
    }

    /// Bytes of the rows on the disk.
    pub(crate) fn row_bytes(&self) -> u64 {
        self.open.as_ref().map_or(0, |it| it.row_bytes)
    }
}

impl Open {
    fn write_head(&mut self, head: &[u8]) -> io::Result<()> {
        debug_assert_eq!(head.len() as u64, self.head_bytes, "a head that keeps its length");
        self.file.seek(SeekFrom::Start(0))?;
        self.file.write_all(head)
    }
}

/// A file under a temporary name, deleted unless it is taken.
struct Partial {
    path: PathBuf,
    file: Option<File>,
}

impl Partial {
    fn create(folder: &Path, name: &str) -> io::Result<Self> {
        let path = folder.join(format!(".{name}.part"));
        let file = OpenOptions::new().read(true).write(true).create(true).truncate(true).open(&path)?;
        Ok(Self { path, file: Some(file) })
    }

    fn file(&mut self) -> &mut File {
        self.file.as_mut().unwrap_or_else(|| unreachable!("taken by value alone"))
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.file().write_all(bytes)
    }

    fn take_the_place_of(mut self, path: &Path) -> io::Result<File> {
        fs::rename(&self.path, path)?;
        self.file.take().ok_or_else(|| io::Error::from(ErrorKind::NotFound))
    }
}

impl Drop for Partial {
    fn drop(&mut self) {
        if self.file.is_some() {
            fs::remove_file(&self.path).ok();
        }
    }
}

struct Counting<W> {
    inner: W,
    count: u64,
}

impl<W: Write> Write for Counting<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let n = self.inner.write(bytes)?;
        self.count += n as u64;
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file_in(folder: &Path, refuge: &Path) -> GrowingFile {
        let setup = Setup { out_dir: Some(folder.to_owned()), instance: "room.c3d".to_owned(), ..Setup::for_tests() };
        GrowingFile { refuge_dir: refuge.to_owned(), ..GrowingFile::new(&setup, "a.txt") }
    }

    fn text(path: impl AsRef<Path>) -> String {
        fs::read_to_string(path).unwrap()
    }

    #[test]
    fn file_is_whole_after_each_flush_and_alone() {
        let (folder, refuge) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let path = folder.path().join("a.txt");
        fs::write(&path, "an older one, which is longer").unwrap();
        let mut file = file_in(folder.path(), refuge.path());
        for n in 1..=3 {
            file.rows().extend_from_slice(b"row\n");
            file.flush(format!("{n} rows\n").as_bytes());
            assert_eq!(text(&path), format!("{n} rows\n{}", "row\n".repeat(n)));
        }
        let twice = |from: &mut dyn Read, to: &mut dyn Write| {
            let mut all = String::new();
            from.read_to_string(&mut all)?;
            to.write_all(all.replace("row", "wider").as_bytes())
        };
        file.rows().extend_from_slice(b"row\n");
        file.rewrite(b"4 rows\n", b"four rows\n", twice).unwrap();
        file.rows().extend_from_slice(b"wide2\n");
        let mut report = Report::default();
        file.finish(b"five rows\n", b"end", &mut report).unwrap();
        assert_eq!(text(&path), format!("five rows\n{}wide2\nend", "wider\n".repeat(4)));
        assert_eq!(report.files, [PathBuf::from("a.txt")]);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn conversion_that_fails_leaves_the_file_as_it_was() {
        let (folder, refuge) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let mut file = file_in(folder.path(), refuge.path());
        file.rows().extend_from_slice(b"row\n");
        let full = |_: &mut dyn Read, _: &mut dyn Write| Err(io::Error::from(ErrorKind::StorageFull));
        assert!(file.rewrite(b"1\n", b"one\n", full).is_err());
        file.rows().extend_from_slice(b"row\n");
        file.finish(b"2\n", b"", &mut Report::default()).unwrap();
        assert_eq!(text(folder.path().join("a.txt")), "2\nrow\nrow\n");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn folder_that_vanished_loses_nothing() {
        let refuge = tempfile::tempdir().unwrap();
        let mut file = file_in(&refuge.path().join("gone"), refuge.path());
        file.rows().extend_from_slice(b"first\n");
        file.flush(b"1\n");
        file.rows().extend_from_slice(b"second\n");
        let complaint = file.finish(b"2\n", b"", &mut Report::default()).unwrap_err().message;
        let saved = refuge.path().join("foveate-room.c3d-a.txt");
        assert!(complaint.contains(saved.to_str().unwrap()), "{complaint}");
        assert_eq!(text(saved), "2\nfirst\nsecond\n");
        let mut nowhere = file_in(&refuge.path().join("gone"), &refuge.path().join("gone"));
        nowhere.rows().push(b'x');
        assert!(nowhere.finish(b"", b"", &mut Report::default()).unwrap_err().message.contains("it is lost"));
    }

    #[cfg(unix)]
    #[test]
    fn full_disk_keeps_what_stood_there() {
        if !fs::metadata("/dev/full").is_ok_and(|it| !it.is_file()) {
            println!("skipped: this system has no device /dev/full");
            return;
        }
        let (folder, refuge) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        fs::write(folder.path().join("a.txt"), "an older one").unwrap();
        std::os::unix::fs::symlink("/dev/full", folder.path().join(".a.txt.part")).unwrap();
        let mut file = file_in(folder.path(), refuge.path());
        file.rows().extend_from_slice(b"row\n");
        let complaint = file.finish(b"1\n", b"", &mut Report::default()).unwrap_err();
        assert!(complaint.message.contains("No space left"), "{complaint}");
        assert_eq!(text(folder.path().join("a.txt")), "an older one");
        assert_eq!(text(refuge.path().join("foveate-room.c3d-a.txt")), "1\nrow\n");
    }
}
