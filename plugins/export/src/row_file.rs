//! A file of rows whose writing loses no row.
//!
//! Rows wait in memory until they are written. Where writing fails (a full disk, a folder without permission) they keep
//! waiting and each flush tries again; at the end, or when they become too many, the whole table moves to the system's folder
//! for temporary files.

use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use foveate::prelude::*;

use crate::csv::file_part;
use crate::pace::Pace;
use crate::whole_file::Faults;

/// Rows that may wait in memory before the table moves elsewhere [bytes].
const WAITING_LIMIT: usize = 64 << 20;
/// Attempted numbers for one name in the folder for temporary files.
const REFUGE_TRIES: u32 = 1000;

/// A file of rows.
#[derive(Debug)]
pub(crate) struct RowFile {
    /// `None`: the run keeps no results.
    path: Option<PathBuf>,
    file: Option<File>,
    waiting: Vec<u8>,
    /// Bytes that have reached `file`.
    written: u64,
    fault: Option<String>,
    refuge: Option<PathBuf>,
    /// Folder for the table where its own cannot be written.
    refuge_dir: PathBuf,
    refuge_name: String,
    pace: Pace,
}

impl RowFile {
    /// The file `name` of `setup`'s results folder, beginning with `header`; nothing is touched before the first flush.
    pub(crate) fn new(setup: &Setup, name: &str, header: &str) -> Self {
        Self {
            path: setup.out_dir.as_ref().map(|folder| folder.join(name)),
            file: None,
            waiting: format!("{header}\n").into_bytes(),
            written: 0,
            fault: None,
            refuge: None,
            refuge_dir: std::env::temp_dir(),
            refuge_name: refuge_name(&setup.instance, name),
            pace: Pace::new(setup),
        }
    }

    /// Adds rows, each with its line end.
    pub(crate) fn push(&mut self, rows: &str) {
        if self.path.is_some() {
            self.waiting.extend_from_slice(rows.as_bytes());
        }
    }

    /// Writes what waits when a second has passed, or when it is much.
    pub(crate) fn flush_when_due(&mut self, now: Time) {
        let is_much = self.waiting.len() >= 1 << 16 && self.fault.is_none();
        if self.pace.is_due(now) || is_much {
            self.flush();
        }
    }

    fn flush(&mut self) {
        let Some(path) = &self.path else { return self.waiting.clear() };
        let result = write_out(&mut self.file, path, &mut self.waiting, &mut self.written);
        let Err(error) = result else { return };
        let fault = self.fault.get_or_insert_with(|| error.to_string());
        self.pace.warn(path, fault);
        if self.waiting.len() > WAITING_LIMIT && self.refuge.is_none() {
            // When this fails too the rows stay in memory.
            self.take_refuge().ok();
        }
    }

    /// Moves the whole table to the folder for temporary files and continues there.
    fn take_refuge(&mut self) -> Result<(), String> {
        let Some(from) = self.path.clone() else { return Ok(()) };
        let (to, mut file) = create_new(&self.refuge_dir, &self.refuge_name)?;
        let complain = |error: io::Error| format!("`{}`: {error}", to.display());
        let mut copied = 0;
        if self.written > 0 {
            let mut original = File::open(&from).map_err(complain)?.take(self.written);
            copied = io::copy(&mut original, &mut file).map_err(complain)?;
        }
        file.write_all(&self.waiting).map_err(complain)?;
        file.sync_all().map_err(complain)?;
        self.written = copied + self.waiting.len() as u64;
        self.waiting.clear();
        self.file = Some(file);
        self.refuge = Some(to);
        Ok(())
    }

    /// Writes all that waits, and names the file in the report.
    ///
    /// # Errors
    /// The file could not be written: why, and where the rows are.
    pub(crate) fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let Some(wanted) = self.path.clone() else { return Ok(()) };
        self.flush();
        let mut is_whole = self.waiting.is_empty() && self.refuge.is_none();
        if let (true, Some(Err(error))) = (is_whole, self.file.as_ref().map(File::sync_all))
            // A pipe or a device has nothing to be synchronised.
            && !matches!(error.kind(), ErrorKind::InvalidInput | ErrorKind::Unsupported)
        {
            self.fault.get_or_insert_with(|| error.to_string());
            is_whole = false;
        }
        let why = self.fault.clone().unwrap_or_default();
        if is_whole {
            if self.fault.is_some() {
                report.remark(format!(
                    "`{}` could not be written for a while ({why}); it is complete now",
                    wanted.display()
                ));
            }
            report.file(wanted.file_name().map_or_else(|| wanted.clone(), PathBuf::from));
            return Ok(());
        }
        let moved = if self.refuge.is_some() { Ok(()) } else { self.take_refuge() };
        let start = format!("`{}` could not be written: {why}", wanted.display());
        if let (Some(refuge), true) = (&self.refuge, self.waiting.is_empty()) {
            report.file(refuge.clone());
            return Err(NodeError::input(format!("{start}; all its rows are in `{}`", refuge.display())));
        }
        let and = moved.err().map_or(String::new(), |error| format!(", and neither could {error}"));
        let count = self.waiting.iter().filter(|&&it| it == b'\n').count();
        Err(NodeError::input(format!("{start}{and}; its last {count} rows are lost")))
    }
}

/// Writes as many rows of `waiting` as go, and takes them off it. What a full disk takes of a row is taken back.
fn write_out(file: &mut Option<File>, path: &Path, waiting: &mut Vec<u8>, written: &mut u64) -> io::Result<()> {
    let open = match file {
        Some(open) => open,
        None => file.insert(File::create(path)?),
    };
    let mut done = 0;
    let result = loop {
        match open.write(&waiting[done..]) {
            _ if done == waiting.len() => break Ok(()),
            Ok(0) => break Err(io::Error::from(ErrorKind::WriteZero)),
            Ok(length) => done += length,
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => break Err(error),
        }
    };
    let whole = waiting[..done].iter().rposition(|it| *it == b'\n').map_or(0, |it| it + 1);
    *written += whole as u64;
    if whole < done {
        // A pipe or a device takes nothing back; what goes there is read as it comes.
        match open.set_len(*written).and_then(|()| open.seek(SeekFrom::Start(*written))) {
            Ok(_) => done = whole,
            Err(_) => *written += (done - whole) as u64,
        }
    }
    waiting.drain(..done);
    result
}

/// What a file of a node is called in the folder for temporary files; its ending stays.
pub(crate) fn refuge_name(instance: &str, name: &str) -> String {
    format!("foveate-{}-{name}", file_part(instance))
}

/// A file that was not there before, `name` with a number in front where it is taken.
pub(crate) fn create_new(folder: &Path, name: &str) -> Result<(PathBuf, File), String> {
    for number in 0..REFUGE_TRIES {
        let path = folder.join(if number == 0 { name.to_owned() } else { format!("{number}-{name}") });
        match OpenOptions::new().write(true).create_new(true).open(&path) {
            Ok(file) => return Ok((path, file)),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            Err(error) => return Err(format!("`{}`: {error}", path.display())),
        }
    }
    Err(format!("`{}`: {REFUGE_TRIES} files of that name exist", folder.join(name).display()))
}

/// Writes each picture, by its name after `prefix`, as [`write_whole`] does; tries all of them even if one fails.
///
/// # Errors
/// A sentence for each that could not be written.
pub(crate) fn write_pictures(
    folder: &Path,
    prefix: &str,
    pictures: &[(&str, String)],
    report: &mut Report,
) -> Result<(), NodeError> {
    let mut faults = Faults::default();
    for (name, text) in pictures {
        let written = write_whole(Some(folder), &format!("{prefix}{name}"), text.as_bytes(), report);
        faults.note(written.map_err(NodeError::input));
    }
    faults.end()
}

/// Writes a small file completely or not at all, and names it in the report; does nothing where the run keeps no results.
///
/// # Errors
/// The file and the reason.
pub(crate) fn write_whole(folder: Option<&Path>, name: &str, bytes: &[u8], report: &mut Report) -> Result<(), String> {
    let Some(folder) = folder else { return Ok(()) };
    let path = folder.join(name);
    fs::write(&path, bytes).map_err(|error| {
        fs::remove_file(&path).ok();
        format!("`{}` could not be written: {error}", path.display())
    })?;
    report.file(name);
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};
    use std::time::Duration;

    use foveate::node::Host;

    use super::*;

    fn setup_in(folder: &Path) -> Setup {
        Setup { out_dir: Some(folder.to_owned()), instance: "room.table".to_owned(), ..Setup::for_tests() }
    }

    fn second(seconds: i64) -> Time {
        Time(seconds * 1_000_000_000)
    }

    #[test]
    fn rows_are_on_the_disk_after_a_second_of_session_time() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = RowFile::new(&setup_in(folder.path()), "t.csv", "a,b");
        file.flush_when_due(second(0));
        file.push("1,2\n");
        file.flush_when_due(Time(999_999_999));
        assert!(!folder.path().join("t.csv").exists());
        file.flush_when_due(second(1));
        assert_eq!(fs::read_to_string(folder.path().join("t.csv")).unwrap(), "a,b\n1,2\n");
        file.push("3,4\n");
        let mut report = Report::default();
        file.finish(&mut report).unwrap();
        assert_eq!(fs::read_to_string(folder.path().join("t.csv")).unwrap(), "a,b\n1,2\n3,4\n");
        assert_eq!(report.files, [PathBuf::from("t.csv")]);
    }

    #[test]
    fn rows_are_on_the_disk_after_a_second_of_the_run_and_trouble_is_known_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let warned = Arc::new(Mutex::new(Vec::new()));
        let list = Arc::clone(&warned);
        let host = Host::new(move |instance, words| list.lock().unwrap().push(format!("{instance}: {words}")));
        let setup = |path: &Path| Setup { host: host.clone(), ..setup_in(path) };
        let mut file = RowFile::new(&setup(folder.path()), "t.csv", "a,b");
        file.push("1,2\n");
        file.flush_when_due(second(0));
        assert!(!folder.path().join("t.csv").exists());
        host.tick(Duration::from_millis(1000));
        file.flush_when_due(second(0));
        assert_eq!(fs::read_to_string(folder.path().join("t.csv")).unwrap(), "a,b\n1,2\n");
        assert!(warned.lock().unwrap().is_empty());
        let mut file = RowFile::new(&setup(&folder.path().join("gone")), "t.csv", "a");
        for seconds in 2..5 {
            host.tick(Duration::from_secs(seconds));
            file.flush_when_due(second(0));
            let warned = warned.lock().unwrap();
            assert!(warned.len() == 1 && warned[0].starts_with("room.table: `"), "{warned:?}");
        }
    }

    #[test]
    fn nothing_is_written_without_a_folder() {
        let mut file = RowFile::new(&Setup::for_tests(), "t.csv", "a,b");
        file.push("1,2\n");
        file.flush_when_due(second(9));
        let mut report = Report::default();
        assert_eq!(file.finish(&mut report), Ok(()));
        assert_eq!(report, Report::default());
    }

    #[test]
    fn full_device_keeps_all_rows_and_says_where() {
        if !fs::metadata("/dev/full").is_ok_and(|it| !it.is_file()) {
            println!("skipped: this system has no device /dev/full");
            return;
        }
        let elsewhere = tempfile::tempdir().unwrap();
        let mut file = RowFile::new(&setup_in(Path::new("/dev")), "full", "a,b");
        file.refuge_dir = elsewhere.path().to_owned();
        for row in 0..5 {
            file.push(&format!("{row}\n"));
            file.flush_when_due(second(2 * row));
        }
        let complaint = file.finish(&mut Report::default()).unwrap_err().message;
        assert!(complaint.contains("/dev/full") && complaint.contains("No space left"), "{complaint}");
        let saved = elsewhere.path().join("foveate-room.table-full");
        assert!(complaint.contains(saved.to_str().unwrap()), "{complaint}");
        assert_eq!(fs::read_to_string(saved).unwrap(), "a,b\n0\n1\n2\n3\n4\n");
    }

    #[test]
    fn folder_that_vanished_keeps_all_rows() {
        let folder = tempfile::tempdir().unwrap();
        let elsewhere = tempfile::tempdir().unwrap();
        let gone = folder.path().join("gone");
        let mut file = RowFile::new(&setup_in(&gone), "t.csv", "a");
        file.refuge_dir = elsewhere.path().to_owned();
        fs::write(elsewhere.path().join("foveate-room.table-t.csv"), "another run's").unwrap();
        file.push("1\n");
        let complaint = file.finish(&mut Report::default()).unwrap_err().message;
        let saved = elsewhere.path().join("1-foveate-room.table-t.csv");
        assert!(complaint.contains(saved.to_str().unwrap()), "{complaint}");
        assert_eq!(fs::read_to_string(saved).unwrap(), "a\n1\n");
    }

    #[test]
    fn folder_that_appears_later_gets_all_rows() {
        let folder = tempfile::tempdir().unwrap();
        let late = folder.path().join("late");
        let mut file = RowFile::new(&setup_in(&late), "t.csv", "a");
        file.flush_when_due(second(0));
        file.push("1\n");
        file.flush_when_due(second(1));
        fs::create_dir(&late).unwrap();
        file.push("2\n");
        let mut report = Report::default();
        file.finish(&mut report).unwrap();
        assert_eq!(fs::read_to_string(late.join("t.csv")).unwrap(), "a\n1\n2\n");
        assert!(report.remarks[0].contains("for a while"), "{:?}", report.remarks);
    }

    #[test]
    fn rows_are_lost_only_when_both_places_fail_and_then_it_is_said() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = RowFile::new(&setup_in(&folder.path().join("gone")), "t.csv", "a");
        file.refuge_dir = folder.path().join("gone too");
        file.push("1\n2\n");
        let complaint = file.finish(&mut Report::default()).unwrap_err().message;
        assert!(complaint.contains("3 rows are lost") && complaint.contains("gone too"), "{complaint}");
    }
}
