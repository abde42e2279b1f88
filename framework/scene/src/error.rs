//! What is wrong with a calibration: every fault with its file and place, what was found and what was expected.

use std::fmt;
use std::path::{Path, PathBuf};

/// Everything that is wrong with a calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibrationError {
    /// In the order of the file; at least one.
    pub faults: Vec<CalibrationDiagnostic>,
}

/// One thing that is wrong with a calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibrationDiagnostic {
    /// The file; empty when there is none.
    pub file: PathBuf,
    /// Line and column in `file`, both from 1, the column in characters.
    pub place: Option<(usize, usize)>,
    /// The camera concerned.
    pub camera: Option<String>,
    /// What is there.
    pub found: String,
    /// What should be there.
    pub expected: String,
}

impl fmt::Display for CalibrationDiagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.file.as_os_str().is_empty() {
            write!(f, "{}", self.file.display())?;
            if let Some((line, column)) = self.place {
                write!(f, ":{line}:{column}")?;
            }
            f.write_str(": ")?;
        }
        if let Some(camera) = &self.camera {
            write!(f, "camera {camera:?}: ")?;
        }
        write!(f, "{}, expected {}", self.found, self.expected)
    }
}

impl fmt::Display for CalibrationError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lines: Vec<String> = self.faults.iter().map(CalibrationDiagnostic::to_string).collect();
        f.write_str(&lines.join("\n"))
    }
}

impl std::error::Error for CalibrationError {}

impl From<CalibrationDiagnostic> for CalibrationError {
    fn from(fault: CalibrationDiagnostic) -> Self {
        CalibrationError { faults: vec![fault] }
    }
}

impl CalibrationError {
    /// The same with `file` in every fault that names none.
    pub(crate) fn in_file(mut self, file: &Path) -> Self {
        self.faults.iter_mut().filter(|it| it.file.as_os_str().is_empty()).for_each(|it| it.file = file.to_owned());
        self
    }
}

impl CalibrationDiagnostic {
    /// A fault of `file` as a whole.
    pub(crate) fn of_file(file: &Path, found: impl Into<String>, expected: impl Into<String>) -> Self {
        let (found, expected) = (found.into(), expected.into());
        CalibrationDiagnostic { file: file.to_owned(), place: None, camera: None, found, expected }
    }
}

/// Faults in the order of places in the file; those without a place first.
pub(crate) fn sort_by_place(faults: &mut [CalibrationDiagnostic]) {
    faults.sort_by(|a, b| a.file.cmp(&b.file).then_with(|| a.place.cmp(&b.place)));
}
