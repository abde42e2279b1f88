//! Tables that nodes save beside their figures.

use std::path::Path;

use foveate_node::{NodeError, Report};

/// Saves a heading and rows as `file` in `folder`, and tells the report of it.
pub(super) fn save_table(
    folder: &Path,
    file: &str,
    heading: &str,
    rows: &[String],
    report: &mut Report,
) -> Result<(), NodeError> {
    let lines = std::iter::once(heading).chain(rows.iter().map(String::as_str));
    report.save(folder, file, lines.flat_map(|it| [it, "\n"]).collect::<String>())
}
