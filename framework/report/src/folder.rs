//! The files of a results folder, parsed. What cannot be read is a sentence.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use foveate_diagnostics::fields::Splitter;
use serde_json::{Map, Value};

use crate::figures::Context;
use crate::page::MARKER;
use crate::{FILE_NAME, rig, words};

/// What was read, or a sentence that says why it was not.
pub(crate) type Found<T> = Result<T, String>;

/// One of these makes a folder a results folder.
const SIGNS: [&str; 3] = ["summary.json", "ledger.csv", "events.csv"];
/// Files that the page reads for its sections; they are not listed among the results.
const READ: [&str; 6] = ["summary.json", "ledger.csv", "events.csv", "timing.json", "rig.resolved.toml", "graph.svg"];
/// Larger files of text are not parsed; a ledger of 10 000 edges has 1 MB.
const TEXT_BYTES_MAX: u64 = 32_000_000;
/// Folders in folders are searched for pictures to this depth.
const DEPTH_MAX: usize = 4;
/// Files are listed up to this number.
const FILES_MAX: usize = 2000;

/// A table of text: its heads, and its rows, each as long as the heads.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Rows {
    heads: Vec<String>,
    rows: Vec<Vec<String>>,
}

/// One row of a table.
#[derive(Clone, Copy)]
pub(crate) struct Row<'a> {
    heads: &'a [String],
    fields: &'a [String],
}

impl Row<'_> {
    /// The field below a head; empty where there is none.
    pub(crate) fn text(&self, head: &str) -> &str {
        let place = self.heads.iter().position(|it| it == head);
        place.and_then(|it| self.fields.get(it)).map_or("", String::as_str)
    }

    /// The field as a number, if it is one.
    pub(crate) fn number(&self, head: &str) -> Option<f64> {
        self.text(head).parse().ok().filter(|it: &f64| it.is_finite())
    }

    /// The field as a count; 0 where it is none.
    pub(crate) fn count(&self, head: &str) -> f64 {
        self.number(head).unwrap_or(0.0).max(0.0)
    }
}

impl Rows {
    /// Of lines with commas, the first of which is `expected` at its start.
    pub(crate) fn parse(text: &str, expected: &str) -> Found<Self> {
        let mut splitter = Splitter::new(',');
        let mut lines = text.trim_start_matches('\u{feff}').lines().filter(|it| !it.trim().is_empty());
        let mut split = |line: &str| -> Vec<String> { splitter.split(line).iter().map(str::to_owned).collect() };
        let heads = lines.next().map(&mut split).unwrap_or_default();
        if heads.first().is_none_or(|it| it != expected) {
            return Err(format!("is damaged: its first column is not `{expected}`"));
        }
        Ok(Self { heads, rows: lines.map(split).collect() })
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = Row<'_>> {
        self.rows.iter().map(|fields| Row { heads: &self.heads, fields })
    }
}

/// A file of a node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Entry {
    /// Name below the folder, with `/` between its parts.
    pub(crate) name: String,
    pub(crate) path: PathBuf,
    pub(crate) bytes: u64,
}

impl Entry {
    /// The end of the name in small letters, without its dot.
    pub(crate) fn extension(&self) -> String {
        self.path.extension().map_or(String::new(), |it| it.to_string_lossy().to_ascii_lowercase())
    }
}

/// The session whose replay gave the results.
pub(crate) struct Session {
    pub(crate) name: String,
    /// Where the files are that the rig reads.
    pub(crate) files: PathBuf,
}

/// What a results folder holds.
pub(crate) struct Folder {
    pub(crate) path: PathBuf,
    pub(crate) summary: Found<Map<String, Value>>,
    pub(crate) ledger: Found<Rows>,
    pub(crate) events: Found<Rows>,
    pub(crate) timing: Found<Map<String, Value>>,
    pub(crate) rig: Found<toml::Table>,
    /// The text of the rig, which keeps the order of its parts.
    pub(crate) rig_text: String,
    /// Files of nodes, in the order of their names; those of the folder before those of folders in it.
    pub(crate) files: Vec<Entry>,
    /// What was left out of `files`, in sentences.
    pub(crate) unlisted: Vec<String>,
    pub(crate) session: Option<Session>,
}

impl Folder {
    /// Reads all of it.
    ///
    /// # Errors
    /// A sentence when this is no results folder.
    pub(crate) fn read(path: &Path) -> Result<Self, String> {
        if !path.is_dir() {
            return Err(format!("`{}` is no folder, expected one that `foveate run` wrote", path.display()));
        }
        if !SIGNS.iter().any(|it| path.join(it).is_file()) {
            let [first, second, third] = SIGNS;
            return Err(format!(
                "`{}` is no results folder: it has no `{first}`, no `{second}` and no `{third}`, one of which `foveate run` writes",
                path.display()
            ));
        }
        let (mut files, mut unlisted) = (Vec::new(), Vec::new());
        list(path, "", 0, &mut files, &mut unlisted);
        if files.len() > FILES_MAX {
            unlisted.push(format!("{} more files are not listed.", files.len() - FILES_MAX));
            files.truncate(FILES_MAX);
        }
        let table = |name: &str, head: &str| {
            text(&path.join(name)).and_then(|it| Rows::parse(&it, head)).map_err(|it| sentence(name, &it))
        };
        Ok(Self {
            summary: object(&path.join("summary.json")).map_err(|it| sentence("summary.json", &it)),
            ledger: table("ledger.csv", "edge"),
            events: table("events.csv", "what"),
            timing: object(&path.join("timing.json")).map_err(|it| sentence("timing.json", &it)),
            rig: toml_table(&path.join("rig.resolved.toml")).map_err(|it| sentence("rig.resolved.toml", &it)),
            rig_text: text(&path.join("rig.resolved.toml")).unwrap_or_default(),
            files,
            unlisted,
            session: None,
            path: path.to_owned(),
        })
    }

    /// The names of cameras: what stands in brackets in the edges of the ledger.
    pub(crate) fn cameras(&self) -> Vec<String> {
        let edges = self.ledger.iter().flat_map(Rows::iter);
        let mut names: Vec<String> = edges
            .flat_map(|row| {
                let edge = row.text("edge").to_owned();
                edge.split('[')
                    .skip(1)
                    .filter_map(|it| it.split_once(']'))
                    .map(|it| it.0.to_owned())
                    .collect::<Vec<_>>()
            })
            .collect();
        names.sort();
        names.dedup();
        names.sort_by_cached_key(|it| words::natural(it));
        names
    }

    /// What figures are about: cameras, and nodes by the last part of their types. Nodes of `sim` judge others, and are none of these.
    pub(crate) fn context(&self) -> Context {
        let rig = self.rig.as_ref().ok();
        let types = rig.into_iter().flat_map(rig::node_types).filter(|it| !it.starts_with("sim."));
        Context {
            cameras: self.cameras(),
            workers: types.map(|it| it.rsplit('.').next().unwrap_or(it).to_owned()).collect(),
        }
    }

    /// A value of `[rig]`.
    pub(crate) fn of_rig(&self, key: &str) -> Option<&toml::Value> {
        self.rig.as_ref().ok()?.get("rig")?.get(key)
    }

    /// A figure of the summary, if it is a number.
    pub(crate) fn figure(&self, name: &str) -> Option<f64> {
        self.summary.as_ref().ok()?.get(name)?.as_f64()
    }
}

fn sentence(name: &str, what: &str) -> String {
    format!("`{name}` {what}.")
}

/// The text of a file.
///
/// # Errors
/// What is wrong with it, to stand behind its name.
pub(crate) fn text(path: &Path) -> Found<String> {
    let about = fs::metadata(path).map_err(|error| match error.kind() {
        std::io::ErrorKind::NotFound => "is missing".to_owned(),
        _ => format!("cannot be read: {error}"),
    })?;
    if !about.is_file() {
        return Err("is no file".to_owned());
    }
    if about.len() > TEXT_BYTES_MAX {
        return Err(format!("has {}, more than is read", words::size(about.len())));
    }
    let bytes = fs::read(path).map_err(|error| format!("cannot be read: {error}"))?;
    String::from_utf8(bytes).map_err(|_| "is damaged: it is no text in UTF-8".to_owned())
}

fn object(path: &Path) -> Found<Map<String, Value>> {
    match serde_json::from_str(&text(path)?) {
        Ok(Value::Object(object)) => Ok(object),
        Ok(_) => Err("is damaged: it holds no object of figures".to_owned()),
        Err(error) => Err(format!("is damaged: {error}")),
    }
}

/// A file of TOML.
///
/// # Errors
/// What is wrong with it, to stand behind its name.
pub(crate) fn toml_table(path: &Path) -> Found<toml::Table> {
    text(path)?.parse().map_err(|error: toml::de::Error| {
        // The first line of the message alone; the others draw the place.
        format!("is damaged: {}", error.message().lines().next().unwrap_or("it is no TOML"))
    })
}

/// Adds the files of a folder, then those of the folders in it. Links to folders are not followed.
fn list(path: &Path, prefix: &str, depth: usize, files: &mut Vec<Entry>, unlisted: &mut Vec<String>) {
    let Ok(entries) = fs::read_dir(path) else {
        unlisted.push(format!("The folder `{prefix}` cannot be read."));
        return;
    };
    let mut entries: Vec<_> = entries.flatten().collect();
    entries.sort_by_cached_key(|it| (words::natural(&it.file_name().to_string_lossy()), it.file_name()));
    let mut folders = Vec::new();
    for entry in entries {
        let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
        let is_folder = entry.file_type().is_ok_and(|it| it.is_dir());
        let is_own = prefix.is_empty() && (READ.contains(&name.as_str()) || name == FILE_NAME);
        if is_folder && entry.path().join(SIGNS[0]).is_file() {
            unlisted.push(format!("The folder `{name}` holds the results of another run and is left out."));
        } else if is_folder {
            folders.push((entry.path(), format!("{name}/")));
        } else if let Ok(about) = fs::metadata(entry.path())
            && about.is_file()
            && !is_own
            && !name.ends_with(".partial")
            && !is_report(&entry.path())
        {
            files.push(Entry { name, path: entry.path(), bytes: about.len() });
        }
    }
    for (path, prefix) in folders {
        if depth + 1 < DEPTH_MAX {
            list(&path, &prefix, depth + 1, files, unlisted);
        } else {
            unlisted.push(format!("The folder `{prefix}` is too deep to be listed."));
        }
    }
}

/// Whether a file is an earlier page of this crate.
fn is_report(path: &Path) -> bool {
    if path.extension().is_none_or(|it| it != "html") {
        return false;
    }
    let mut start = Vec::new();
    let is_read = File::open(path).is_ok_and(|it| it.take(1000).read_to_end(&mut start).is_ok());
    is_read && String::from_utf8_lossy(&start).contains(MARKER)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_found_by_their_heads() {
        let rows = Rows::parse("edge,gaps,sigma\n\"a, b\",3,\nc\n", "edge").unwrap();
        let rows: Vec<Row<'_>> = rows.iter().collect();
        assert_eq!((rows[0].text("edge"), rows[0].count("gaps"), rows[0].number("sigma")), ("a, b", 3.0, None));
        assert_eq!((rows[1].text("edge"), rows[1].count("gaps"), rows[1].text("none")), ("c", 0.0, ""));
    }

    #[test]
    fn a_table_that_begins_otherwise_is_damaged() {
        assert!(Rows::parse("", "edge").is_err_and(|it| it.contains("`edge`")));
        assert!(Rows::parse("\u{0}\u{1}", "what").is_err_and(|it| it.contains("`what`")));
    }

    #[test]
    fn files_that_cannot_be_read_are_said_with_the_reason() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("a.json");
        assert_eq!(text(&path), Err("is missing".to_owned()));
        assert_eq!(text(home.path()), Err("is no file".to_owned()));
        fs::write(&path, [0xff, 0xfe]).unwrap();
        assert!(text(&path).is_err_and(|it| it.contains("UTF-8")));
        fs::write(&path, "[1]").unwrap();
        assert!(object(&path).is_err_and(|it| it.contains("no object")));
        fs::write(&path, "{").unwrap();
        assert!(object(&path).is_err_and(|it| it.contains("damaged")));
        assert!(toml_table(&path).is_err_and(|it| it.contains("damaged")));
    }
}
