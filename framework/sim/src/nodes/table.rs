//! Files that nodes save beside their figures.

use std::fs::File;
use std::io::{BufWriter, Write};
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
    told(write_rows(&folder.join(file), heading, rows), folder, file, report)
}

/// Saves `text` as `file` in `folder`, and tells the report of it.
pub(super) fn save_text(folder: &Path, file: &str, text: &str, report: &mut Report) -> Result<(), NodeError> {
    told(std::fs::write(folder.join(file), text), folder, file, report)
}

fn told(saved: std::io::Result<()>, folder: &Path, file: &str, report: &mut Report) -> Result<(), NodeError> {
    saved.map_err(|error| {
        NodeError::input(format_args!(
            "{}: `{file}` could not be saved ({error}), expected a folder that can be written",
            folder.display()
        ))
    })?;
    report.file(file);
    Ok(())
}

fn write_rows(path: &Path, heading: &str, rows: &[String]) -> std::io::Result<()> {
    let mut file = BufWriter::new(File::create(path)?);
    writeln!(file, "{heading}")?;
    for row in rows {
        writeln!(file, "{row}")?;
    }
    file.flush()
}
