//! The folder of one run: made and locked for it, and removed again where it stays empty.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read, Write};
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};

use serde_json::json;

use super::write_whole;
use crate::interrupt::{self, Signal};

/// Held while a run writes into the folder. The system releases it when the run ends in whatever way, so that a file left behind blocks no later run.
const LOCK: &str = ".foveate.lock";

/// What the signals' thread has to clean up.
static CURRENT: Mutex<Option<Traces>> = Mutex::new(None);

/// A results folder that no other run writes into. It goes away with this, where it was made for it and is still empty.
#[derive(Debug)]
pub struct ResultsFolder {
    path: PathBuf,
    /// Left out where the file system has no locks.
    _lock: Option<File>,
    /// Folders that were made, the innermost first.
    made: Vec<PathBuf>,
}

#[derive(Debug, Clone)]
struct Traces {
    path: PathBuf,
    made: Vec<PathBuf>,
}

/// Makes the folder for a run's results: `wanted`, or the first free `results/<rig>-<n>`.
///
/// # Errors
/// A sentence with the path and the reason: it cannot be made, or another run writes into it.
pub fn make_folder(wanted: Option<&Path>, rig: &str) -> Result<ResultsFolder, String> {
    let complain =
        |path: &Path, error: io::Error| format!("the results folder `{}` cannot be made: {error}", path.display());
    if let Some(path) = wanted {
        let made = missing(path);
        fs::create_dir_all(path).map_err(|error| complain(path, error))?;
        return ResultsFolder::take(path.to_owned(), made, rig);
    }
    let parent = Path::new("results");
    let mut made = missing(parent);
    fs::create_dir_all(parent).map_err(|error| complain(parent, error))?;
    for number in 1_u32.. {
        let path = parent.join(format!("{rig}-{number}"));
        match fs::create_dir(&path) {
            Ok(()) => {
                made.insert(0, path.clone());
                return ResultsFolder::take(path, made, rig);
            }
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(complain(&path, error)),
        }
    }
    unreachable!("four billion result folders")
}

/// The folders on the way to `path` that are not there yet, the innermost first.
fn missing(path: &Path) -> Vec<PathBuf> {
    let on_the_way = path.ancestors().filter(|it| !it.as_os_str().is_empty());
    on_the_way.take_while(|it| !it.exists()).map(Path::to_owned).collect()
}

impl ResultsFolder {
    fn take(path: PathBuf, made: Vec<PathBuf>, rig: &str) -> Result<ResultsFolder, String> {
        match lock(&path, rig) {
            Ok(lock) => {
                let traces = Traces { path: path.clone(), made: made.clone() };
                *CURRENT.lock().unwrap_or_else(PoisonError::into_inner) = Some(traces);
                Ok(ResultsFolder { path, _lock: lock, made })
            }
            Err(sentence) => {
                remove_empty(&made);
                Err(sentence)
            }
        }
    }

    /// Takes back these files of a run that could not begin, where the folder was made for it and holds nothing else.
    pub fn take_back(&self, files: &[&str]) {
        let Ok(entries) = fs::read_dir(&self.path) else { return };
        let is_ours = |name: &str| name == LOCK || files.contains(&name);
        let mut names = entries.map(|it| it.ok().and_then(|it| it.file_name().into_string().ok()));
        if !self.made.is_empty() && names.all(|it| it.is_some_and(|it| is_ours(&it))) {
            // What cannot be removed stays.
            files.iter().for_each(|it| drop(fs::remove_file(self.path.join(it))));
        }
    }
}

impl Deref for ResultsFolder {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.path
    }
}

impl AsRef<Path> for ResultsFolder {
    fn as_ref(&self) -> &Path {
        &self.path
    }
}

impl Drop for ResultsFolder {
    fn drop(&mut self) {
        // Removed while it is held; who has opened it meanwhile finds out, see `lock`.
        drop(fs::remove_file(self.path.join(LOCK)));
        remove_empty(&self.made);
        if let Some(signal) = interrupt::caught() {
            say_interrupted(&self.path, signal);
        }
        *CURRENT.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }
}

/// Before the program is ended by a second signal, or in the middle of work that a signal cannot end in good order: the folder of this run says so, or is
/// gone where it is empty.
pub fn abandon(signal: Signal) {
    let Some(traces) = CURRENT.lock().unwrap_or_else(PoisonError::into_inner).take() else { return };
    drop(fs::remove_file(traces.path.join(LOCK)));
    remove_empty(&traces.made);
    say_interrupted(&traces.path, signal);
}

/// A folder in which a run left something, but no summary of it, says that it was interrupted.
fn say_interrupted(folder: &Path, signal: Signal) {
    let summary = folder.join("summary.json");
    if folder.exists() && !summary.exists() {
        let text = format!("{:#}\n", json!({ "interrupted": true, "interrupted_by": signal.name }));
        drop(write_whole(&summary, text.as_bytes()));
    }
}

/// Removes folders from the innermost on, as far as they are empty.
fn remove_empty(made: &[PathBuf]) {
    // The first that is not empty keeps those around it.
    let _ = made.iter().try_for_each(fs::remove_dir);
}

/// Takes the lock of `folder`; `None` where the file system has none.
fn lock(folder: &Path, rig: &str) -> Result<Option<File>, String> {
    let path = folder.join(LOCK);
    loop {
        let opened = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path);
        let mut file = opened
            .map_err(|error| format!("the results folder `{}` cannot be written to: {error}", folder.display()))?;
        match file.try_lock() {
            Ok(()) => {
                // The one before has removed its file between our opening and our locking: another one may be there already.
                if !is_at(&file, &path) {
                    continue;
                }
                let words = format!("{}\n{}\n{rig}\n", std::process::id(), now_s());
                // Who it is is a kindness to the next one; the lock itself holds without it.
                drop(file.set_len(0).and_then(|()| file.write_all(words.as_bytes())));
                return Ok(Some(file));
            }
            Err(TryLockError::WouldBlock) => {
                let mut words = String::new();
                drop(file.read_to_string(&mut words));
                return Err(format!(
                    "another run writes into the results folder `{}`{}; expected a folder of its own: wait for that run, or name another one with --out",
                    folder.display(),
                    holder(&words, now_s())
                ));
            }
            Err(TryLockError::Error(_)) => return Ok(None),
        }
    }
}

#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;

    let place = |it: io::Result<fs::Metadata>| it.map(|it| (it.dev(), it.ino())).ok();
    let place_of_file = place(file.metadata());
    place_of_file.is_some() && place_of_file == place(fs::metadata(path))
}

#[cfg(not(unix))]
fn is_at(_file: &File, _path: &Path) -> bool {
    // A file that is open cannot be removed there.
    true
}

fn now_s() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |it| it.as_secs())
}

/// The holder of a lock, from its content: `: rig room, process 17, since 09:20:00 UTC (70 s ago)`.
fn holder(words: &str, now_s: u64) -> String {
    let mut lines = words.lines();
    let mut number = || lines.next().and_then(|it| it.parse::<u64>().ok());
    let (Some(process), Some(since)) = (number(), number()) else { return String::new() };
    let rig = lines.next().unwrap_or("?");
    let clock = format!("{:02}:{:02}:{:02} UTC", since / 3600 % 24, since / 60 % 60, since % 60);
    let ago = match now_s.saturating_sub(since) {
        seconds @ 0..120 => format!("{seconds} s"),
        seconds @ 120..7200 => format!("{} min", seconds / 60),
        seconds @ 7200..172_800 => format!("{} h", seconds / 3600),
        seconds => format!("{} days", seconds / 86_400),
    };
    format!(": rig `{rig}`, process {process}, since {clock} ({ago} ago)")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_asked_for_by_name_may_exist_but_is_never_shared() {
        let home = tempfile::tempdir().unwrap();
        let wanted = home.path().join("a/b");
        let first = make_folder(Some(&wanted), "room").unwrap();
        assert_eq!(&*first, wanted);
        let refusal = make_folder(Some(&wanted), "hall").unwrap_err();
        let expected = format!("rig `room`, process {}, since ", std::process::id());
        assert!(refusal.contains(&expected) && refusal.contains("a/b"), "{refusal}");
        fs::write(first.join("targets.csv"), "").unwrap();
        drop(first);
        assert!(wanted.join("targets.csv").exists() && !wanted.join(LOCK).exists());
        drop(make_folder(Some(&wanted), "hall").unwrap());
        assert!(wanted.exists(), "it is not empty");
    }

    #[test]
    fn a_lock_file_that_a_killed_run_left_behind_blocks_nobody() {
        let home = tempfile::tempdir().unwrap();
        fs::write(home.path().join(LOCK), "1\n1\nroom\n").unwrap();
        let folder = make_folder(Some(home.path()), "room").unwrap();
        let mine = fs::read_to_string(folder.join(LOCK)).unwrap();
        assert!(mine.starts_with(&format!("{}\n", std::process::id())), "{mine}");
    }

    #[test]
    fn what_was_made_and_stayed_empty_is_gone_and_nothing_else_is() {
        let home = tempfile::tempdir().unwrap();
        let there = home.path().join("there");
        fs::create_dir(&there).unwrap();
        drop(make_folder(Some(&there.join("x/y")), "room").unwrap());
        assert!(there.exists() && !there.join("x").exists());
        drop(make_folder(Some(&there), "room").unwrap());
        assert!(there.exists(), "it was there before");

        let begun = make_folder(Some(&there.join("z")), "room").unwrap();
        fs::write(begun.join("graph.svg"), "").unwrap();
        fs::write(begun.join("targets.csv"), "").unwrap();
        begun.take_back(&["graph.svg"]);
        assert!(begun.join("graph.svg").exists(), "beside results it stays");
        fs::remove_file(begun.join("targets.csv")).unwrap();
        begun.take_back(&["graph.svg"]);
        drop(begun);
        assert!(!there.join("z").exists());
    }

    #[test]
    fn who_holds_a_lock_is_told_with_time_and_age() {
        let since = 9 * 3600 + 20 * 60 + 5;
        assert_eq!(
            holder(&format!("17\n{since}\nroom\n"), since + 70),
            ": rig `room`, process 17, since 09:20:05 UTC (70 s ago)"
        );
        assert!(holder(&format!("17\n{since}\nroom\n"), since + 3 * 86_400).ends_with("(3 days ago)"));
        assert_eq!(holder("", 0), "", "it has not said yet");
        assert_eq!(holder("a\nb\nc", 0), "");
    }
}
