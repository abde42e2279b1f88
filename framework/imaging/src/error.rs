//! Errors of this crate's functions about their arguments.

use std::fmt;

/// Why a picture, a table or a setting is refused.
#[derive(Debug, Clone, PartialEq)]
pub enum ImagingError {
    /// A buffer has another number of elements than its size requires.
    WrongLength {
        /// Which buffer.
        what: &'static str,
        /// Elements that its size asks for.
        expected: usize,
        /// Elements that it has.
        found: usize,
    },
    /// Two pictures or tables that are compared pixel by pixel have different sizes.
    WrongSize {
        /// Which of them.
        what: &'static str,
        /// (width, height) that was expected [px].
        expected: (usize, usize),
        /// (width, height) that came [px].
        found: (usize, usize),
    },
    /// A setting lies outside its range.
    Setting {
        /// Name of the camera.
        name: &'static str,
        /// What it has to be.
        expected: &'static str,
        /// What it is.
        found: f64,
    },
}

impl ImagingError {
    /// `Err` with the name of the setting unless `good`.
    pub(crate) fn unless(good: bool, name: &'static str, expected: &'static str, found: f64) -> Result<(), Self> {
        if good { Ok(()) } else { Err(ImagingError::Setting { name, expected, found }) }
    }
}

impl fmt::Display for ImagingError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ImagingError::WrongLength { what, expected, found } => {
                write!(f, "{what} holds {found} elements where its size asks for {expected}")
            }
            ImagingError::WrongSize { what, expected, found } => {
                write!(f, "{what} is {}x{} px where {}x{} px are expected", found.0, found.1, expected.0, expected.1)
            }
            ImagingError::Setting { name, expected, found } => write!(f, "{name} is {found}; expected {expected}"),
        }
    }
}

impl std::error::Error for ImagingError {}
