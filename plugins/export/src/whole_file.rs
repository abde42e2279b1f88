//! A file that is written at the end of a run, completely or not at all; a full disk loses nothing.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use foveate::prelude::*;

use crate::row_file::{create_new, refuge_name};

/// Destination of a results file.
#[derive(Debug, Clone)]
pub(crate) struct WholeFile {
    /// `None`: the run keeps no results.
    folder: Option<PathBuf>,
    pub(crate) name: String,
    /// Folder for the file where its own cannot be written.
    refuge_dir: PathBuf,
    instance: String,
}

impl WholeFile {
    /// The file `name` of `setup`'s results folder; nothing is touched yet.
    pub(crate) fn new(setup: &Setup, name: &str) -> Self {
        Self {
            folder: setup.out_dir.clone(),
            name: name.to_owned(),
            refuge_dir: std::env::temp_dir(),
            instance: setup.instance.clone(),
        }
    }

    /// Another file of the same folder.
    pub(crate) fn named(&self, name: String) -> Self {
        Self { name, ..self.clone() }
    }

    /// Whether anything is to be written.
    pub(crate) fn is_wanted(&self) -> bool {
        self.folder.is_some()
    }

    /// Writes it under a temporary name, and renames it when it is complete; where that fails, writes it into the system's folder for temporary files.
    ///
    /// # Errors
    /// The file could not be written: why, and where it is.
    pub(crate) fn write(&self, bytes: &[u8], report: &mut Report) -> Result<(), NodeError> {
        let Some(folder) = &self.folder else { return Ok(()) };
        let wanted = folder.join(&self.name);
        let partial = folder.join(format!(".{}.part", self.name));
        let result = write_all(&partial, bytes).and_then(|()| fs::rename(&partial, &wanted));
        let Err(why) = result else {
            report.file(&self.name);
            return Ok(());
        };
        fs::remove_file(&partial).ok();
        let start = format!("`{}` could not be written: {why}", wanted.display());
        match self.take_refuge(bytes) {
            Ok(refuge) => {
                report.file(&refuge);
                Err(NodeError::input(format!("{start}; it is `{}`", refuge.display())))
            }
            Err(also) => Err(NodeError::input(format!("{start}, and neither could {also}; it is lost"))),
        }
    }

    fn take_refuge(&self, bytes: &[u8]) -> Result<PathBuf, String> {
        let (path, mut file) = create_new(&self.refuge_dir, &refuge_name(&self.instance, &self.name))?;
        let written = file.write_all(bytes).and_then(|()| file.sync_all());
        written.map(|()| path.clone()).map_err(|error| {
            fs::remove_file(&path).ok();
            format!("`{}`: {error}", path.display())
        })
    }
}

/// What went wrong with several files, each of which is tried.
#[derive(Default)]
pub(crate) struct Faults(Vec<String>);

impl Faults {
    /// Keeps the words of what could not be written.
    pub(crate) fn note(&mut self, written: Result<(), NodeError>) {
        self.0.extend(written.err().map(|it| it.message));
    }

    /// # Errors
    /// All of it.
    pub(crate) fn end(self) -> Result<(), NodeError> {
        if self.0.is_empty() { Ok(()) } else { Err(NodeError::input(self.0.join("; "))) }
    }
}

fn write_all(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = File::create(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file_in(folder: &Path, refuge: &Path) -> WholeFile {
        let setup = Setup { out_dir: Some(folder.to_owned()), instance: "room.c3d".to_owned(), ..Setup::for_tests() };
        WholeFile { refuge_dir: refuge.to_owned(), ..WholeFile::new(&setup, "a.c3d") }
    }

    #[test]
    fn file_appears_whole_and_alone() {
        let (folder, refuge) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        fs::write(folder.path().join("a.c3d"), "an older one").unwrap();
        let mut report = Report::default();
        file_in(folder.path(), refuge.path()).write(b"whole", &mut report).unwrap();
        let names: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|it| it.unwrap().file_name()).collect();
        assert_eq!(names, ["a.c3d"]);
        assert_eq!(fs::read(folder.path().join("a.c3d")).unwrap(), b"whole");
        assert_eq!(report.files, [PathBuf::from("a.c3d")]);
    }

    #[test]
    fn folder_that_vanished_loses_nothing() {
        let refuge = tempfile::tempdir().unwrap();
        let file = file_in(&refuge.path().join("gone"), refuge.path());
        let complaint = file.write(b"whole", &mut Report::default()).unwrap_err().message;
        let saved = refuge.path().join("foveate-room.c3d-a.c3d");
        assert!(complaint.contains(saved.to_str().unwrap()), "{complaint}");
        assert_eq!(fs::read(saved).unwrap(), b"whole");
        // Another one of the node keeps its own ending.
        file.named("a-1.bvh".to_owned()).write(b"another", &mut Report::default()).unwrap_err();
        assert_eq!(fs::read(refuge.path().join("foveate-room.c3d-a-1.bvh")).unwrap(), b"another");
        let nowhere = file_in(&refuge.path().join("gone"), &refuge.path().join("gone"));
        assert!(nowhere.write(b"whole", &mut Report::default()).unwrap_err().message.contains("it is lost"));
    }

    #[cfg(unix)]
    #[test]
    fn full_disk_keeps_what_stood_there() {
        if !fs::metadata("/dev/full").is_ok_and(|it| !it.is_file()) {
            println!("skipped: this system has no device /dev/full");
            return;
        }
        let (folder, refuge) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        fs::write(folder.path().join("a.c3d"), "an older one").unwrap();
        std::os::unix::fs::symlink("/dev/full", folder.path().join(".a.c3d.part")).unwrap();
        let complaint = file_in(folder.path(), refuge.path()).write(b"whole", &mut Report::default()).unwrap_err();
        assert!(complaint.message.contains("No space left"), "{complaint}");
        assert_eq!(fs::read_to_string(folder.path().join("a.c3d")).unwrap(), "an older one");
        assert_eq!(fs::read(refuge.path().join("foveate-room.c3d-a.c3d")).unwrap(), b"whole");
        assert!(!folder.path().join(".a.c3d.part").exists());
    }
}
