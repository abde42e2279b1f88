//! A results folder as one self-contained HTML page.
//!
//! The page reads the files that `foveate run` writes and the pictures of the nodes. Nothing in it comes from the network, it needs no script, and the same folder
//! gives the same bytes. A file that is missing or damaged is named in its section.
//!
//! | module | what it gives |
//! |---|---|
//! | `folder` | the files of the folder, parsed |
//! | `page` | escaped HTML, tables, the frame of the page |
//! | `words` | numbers, sizes and counts for people |
//! | `pictures` | pictures as data URIs, within limits |
//! | `rig`, `recovered`, `uncertainty`, `shortfalls`, `calibration`, `again` | the sections, in this order |

mod again;
mod calibration;
mod events;
mod figures;
mod folder;
mod page;
mod pictures;
mod recovered;
mod rig;
mod shortfalls;
mod uncertainty;
mod words;

#[cfg(test)]
mod tests;

use std::path::Path;

use crate::folder::{Folder, Session};
use crate::page::Page;
use crate::pictures::Budget;

/// Name of the page in a results folder, unless another is given. The page does not list a file of this name.
pub const FILE_NAME: &str = "report.html";

/// The page of a results folder; `version` is the one of the program that writes it.
///
/// # Errors
/// A sentence when the folder cannot be read or is no results folder: it has no `summary.json`, no `ledger.csv` and no `events.csv`.
pub fn of_folder(folder: &Path, version: &str) -> Result<String, String> {
    Ok(write(&Folder::read(folder)?, version))
}

/// The page of a session: of the results `folder` of its replay, and of the `files` that travel in it. `name` is what the session is called.
///
/// # Errors
/// As [`of_folder`].
pub fn of_session(name: &str, folder: &Path, files: &Path, version: &str) -> Result<String, String> {
    let mut folder = Folder::read(folder)?;
    folder.session = Some(Session { name: name.to_owned(), files: files.to_owned() });
    Ok(write(&folder, version))
}

fn write(folder: &Folder, version: &str) -> String {
    let mut page = Page::new(&rig::title(folder), &rig::facts(folder));
    let mut budget = Budget::default();
    rig::write(&mut page, folder, &mut budget);
    recovered::write(&mut page, folder, &mut budget);
    uncertainty::write(&mut page, folder);
    shortfalls::write(&mut page, folder);
    calibration::write(&mut page, folder);
    again::write(&mut page, folder, version);
    page.finish()
}
