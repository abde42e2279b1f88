//! OpenCV's FileStorage, as far as calibrations use it: top-level scalars, lists and matrices, in YAML or XML.
//!
//! OpenCV's YAML opens with `%YAML:1.0` up to version 4, which is no YAML directive, so that parsers of YAML refuse it; what it writes
//! besides is regular enough to be read line by line. Nested maps are passed over.

use std::path::Path;

use crate::calibration::CalibrationFault;

/// A file's top-level entries.
#[derive(Debug, Default)]
pub(crate) struct Storage {
    pub entries: Vec<Entry>,
}

/// One of them.
#[derive(Debug)]
pub(crate) struct Entry {
    pub key: String,
    /// Line and column of the key, from 1.
    pub place: (usize, usize),
    pub value: Value,
}

#[derive(Debug)]
pub(crate) enum Value {
    Scalar(String),
    List(Vec<String>),
    /// The numbers as they stand there, row by row.
    Matrix {
        rows: String,
        columns: String,
        numbers: Vec<String>,
    },
}

impl Storage {
    /// The first entry with one of these names; case counts.
    pub fn get(&self, names: &[&str]) -> Option<&Entry> {
        names.iter().find_map(|name| self.entries.iter().find(|it| it.key == *name))
    }
}

/// Reads OpenCV's YAML.
pub(crate) fn from_yaml(text: &str, path: &Path) -> Result<Storage, CalibrationFault> {
    let mut storage = Storage::default();
    let fault = |line: usize, found: String, expected: &str| {
        let fault = CalibrationFault::of_file(path, found, expected);
        CalibrationFault { place: Some((line + 1, 1)), ..fault }
    };
    let mut lines = text.lines().enumerate().peekable();
    while let Some((number, line)) = lines.next() {
        let passed_over = line.trim().is_empty() || line.starts_with(['#', '%', ' ', '\t', '-', '.', '\u{feff}']);
        if passed_over {
            continue;
        }
        let Some((key, rest)) = line.split_once(':') else {
            let shown: String = line.chars().take(40).collect();
            return Err(fault(number, format!("a line {shown:?}"), "`key: value`"));
        };
        let mut rest = rest.trim().to_owned();
        let is_matrix = rest.starts_with("!!opencv-matrix");
        let is_open = |it: &str| it.contains('[') && !it.contains(']');
        // What belongs to the key is indented; a list may go on without that, until its bracket closes.
        while let Some((_, next)) =
            lines.next_if(|(_, next)| next.starts_with([' ', '\t']) || is_open(&rest) && !next.contains(':'))
        {
            rest.push('\n');
            rest += next.trim();
        }
        if is_open(&rest) {
            return Err(fault(number, format!("{key} without its closing bracket"), "`]` before the end of the file"));
        }
        let value = if is_matrix {
            let of = |name: &str| {
                let line = rest.lines().find_map(|line| line.strip_prefix(name)?.trim_start().strip_prefix(':'));
                line.map_or(String::new(), |it| it.trim().to_owned())
            };
            let numbers = rest.find("data").map_or(Vec::new(), |at| list(&rest[at..]));
            Value::Matrix { rows: of("rows"), columns: of("cols"), numbers }
        } else if rest.starts_with('[') {
            Value::List(list(&rest))
        } else {
            Value::Scalar(unquoted(rest.lines().next().unwrap_or_default()))
        };
        storage.entries.push(Entry { key: unquoted(key.trim()), place: (number + 1, 1), value });
    }
    Ok(storage)
}

/// What stands between the brackets, parted by commas.
fn list(text: &str) -> Vec<String> {
    let inner = text.split_once('[').and_then(|(_, rest)| rest.split_once(']')).map_or("", |(inner, _)| inner);
    inner.split(',').map(|it| unquoted(it.trim())).filter(|it| !it.is_empty()).collect()
}

fn unquoted(text: &str) -> String {
    match text.strip_prefix('"').and_then(|it| it.strip_suffix('"')) {
        Some(inner) => inner.replace("\\\"", "\"").replace("\\\\", "\\"),
        None => text.to_owned(),
    }
}

/// Reads OpenCV's XML, whose root is `opencv_storage`.
pub(crate) fn from_xml(document: &roxmltree::Document<'_>) -> Storage {
    let mut storage = Storage::default();
    for node in document.root_element().children().filter(|it| it.is_element()) {
        let text = |node: roxmltree::Node<'_, '_>| node.text().unwrap_or_default().trim().to_owned();
        let of = |name: &str| node.children().find(|it| it.has_tag_name(name)).map_or(String::new(), text);
        let value = match node.attribute("type_id") {
            Some("opencv-matrix") => Value::Matrix {
                rows: of("rows"),
                columns: of("cols"),
                numbers: of("data").split_whitespace().map(str::to_owned).collect(),
            },
            _ if node.children().any(|it| it.is_element()) => continue,
            _ => match text(node) {
                it if it.split_whitespace().count() > 1 && !it.starts_with('"') => {
                    Value::List(it.split_whitespace().map(str::to_owned).collect())
                }
                it => Value::Scalar(unquoted(&it)),
            },
        };
        let at = document.text_pos_at(node.range().start);
        let (key, place) = (node.tag_name().name().to_owned(), (at.row as usize, at.col as usize));
        storage.entries.push(Entry { key, place, value });
    }
    storage
}
