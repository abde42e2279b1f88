//! What was measured, beside the commit that it was measured at: `tests/results/measured.json`.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde::{Deserialize, Serialize};

/// All runs by name.
pub type Measured = BTreeMap<String, Measurement>;

/// What one run gave.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Measurement {
    /// Short hash of the commit; `+` behind it where files were changed since.
    pub commit: String,
    /// How long the commands took [s].
    pub seconds: f64,
    /// By what the row says, in the row's unit.
    pub values: BTreeMap<String, Reading>,
}

/// A figure over the seeds of a run, or of its only one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Reading {
    /// Median over the seeds.
    pub median: f64,
    /// Worst seed, where there were several.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub worst: Option<f64>,
    /// The peer's, from the same run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub peer: Option<f64>,
}

/// Reads `path`; nothing was measured where it is missing.
///
/// # Errors
/// The file and why it cannot be read.
pub fn read(path: &Path) -> Result<Measured, String> {
    if !path.exists() {
        return Ok(Measured::new());
    }
    let text = fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))?;
    serde_json::from_str(&text).map_err(|error| format!("{}: {error}", path.display()))
}

/// Writes `path` in the order of the names.
///
/// # Errors
/// The file and why it cannot be written.
pub fn write(path: &Path, measured: &Measured) -> Result<(), String> {
    let text = serde_json::to_string_pretty(measured).map_err(|error| error.to_string())?;
    fs::write(path, text + "\n").map_err(|error| format!("{}: {error}", path.display()))
}
