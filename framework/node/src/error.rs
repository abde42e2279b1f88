//! Errors of nodes: in settings before a run, in input during one.

use std::fmt::Display;
use std::ops::RangeInclusive;

/// A setting that a node cannot work with; the rig loader points at its line.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{message}")]
pub struct ConfigError {
    /// The setting's name, dotted where it is nested (`window.size_px`); `None`: the node as a whole.
    pub setting: Option<String>,
    /// What was found and what is expected.
    pub message: String,
}

impl ConfigError {
    /// Points at one setting.
    pub fn at(setting: &str, message: impl Display) -> Self {
        Self { setting: Some(setting.to_owned()), message: message.to_string() }
    }

    /// Points at the node: what it needs is not a setting (a camera, a folder for results).
    pub fn node(message: impl Display) -> Self {
        Self { setting: None, message: message.to_string() }
    }

    /// Refuses a `value` outside `range`; NaN is outside every range.
    pub fn unless_in<T: PartialOrd + Display>(setting: &str, value: T, range: RangeInclusive<T>) -> Result<(), Self> {
        if range.contains(&value) {
            return Ok(());
        }
        let (least, most) = (range.start(), range.end());
        Err(match least <= most {
            true => Self::at(setting, format_args!("found {value}, expected {least} to {most}")),
            false => Self::at(
                setting,
                format_args!(
                    "found {value}, and other settings leave no value: expected at least {least} and at most {most}"
                ),
            ),
        })
    }
}

/// Why a node could not process a message.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct NodeError {
    /// Whether the rig or the program is at fault: decides the exit code.
    pub blame: Blame,
    /// Where, what was found and what was expected.
    pub message: String,
}

/// What is at fault in a failure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Blame {
    /// The rig, its files or its devices.
    Input,
    /// This program.
    Program,
}

impl NodeError {
    /// A file, device or message is invalid.
    pub fn input(message: impl Display) -> Self {
        Self { blame: Blame::Input, message: message.to_string() }
    }

    /// An internal error.
    pub fn program(message: impl Display) -> Self {
        Self { blame: Blame::Program, message: message.to_string() }
    }
}
