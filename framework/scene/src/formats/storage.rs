//! OpenCV's FileStorage, as far as calibrations use it: top-level scalars, lists and matrices, in YAML, XML or JSON.
//!
//! OpenCV 5 writes what has one dimension, or more than two, as `opencv-nd-matrix` with a list of sizes: one size is a row here, and sizes beyond
//! the first multiply the columns, as channels do.
//!
//! OpenCV's YAML opens with `%YAML:1.0` up to version 4, which is no YAML directive, so that parsers of YAML refuse it; what it writes
//! besides is regular enough to be read line by line. Nested maps are passed over.

use std::path::Path;

use crate::error::CalibrationDiagnostic;

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
pub(crate) fn from_yaml(text: &str, path: &Path) -> Result<Storage, CalibrationDiagnostic> {
    let mut storage = Storage::default();
    let fault = |line: usize, found: String, expected: &str| {
        let fault = CalibrationDiagnostic::of_file(path, found, expected);
        CalibrationDiagnostic { place: Some((line + 1, 1)), ..fault }
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
        let is_nd = rest.starts_with("!!opencv-nd-matrix");
        let is_matrix = is_nd || rest.starts_with("!!opencv-matrix");
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
            let sizes = if is_nd { list(&of("sizes")) } else { vec![of("rows"), of("cols")] };
            matrix(&sizes, &unquoted(&of("dt")), numbers)
        } else if rest.starts_with('[') {
            Value::List(list(&rest))
        } else {
            Value::Scalar(unquoted(rest.lines().next().unwrap_or_default()))
        };
        storage.entries.push(Entry { key: unquoted(key.trim()), place: (number + 1, 1), value });
    }
    Ok(storage)
}

/// A matrix of these sizes, whose elements are as `kind` says: a letter for the type, perhaps with a number of channels before it.
fn matrix(sizes: &[String], kind: &str, numbers: Vec<String>) -> Value {
    let channels = kind.trim_end_matches(|it: char| it.is_ascii_alphabetic()).parse::<usize>().unwrap_or(1);
    let (rows, others) = match sizes {
        // One dimension: a row.
        [only] => ("1".to_owned(), std::slice::from_ref(only)),
        [rows, others @ ..] => (rows.clone(), others),
        [] => return Value::Matrix { rows: String::new(), columns: String::new(), numbers },
    };
    let mut columns = others.iter().map(|it| it.parse::<usize>().ok()).chain([Some(channels)]);
    // What is no number stays as it stands there, for the message.
    let product = columns.try_fold(1_usize, |product, it| product.checked_mul(it?));
    Value::Matrix { rows, columns: product.map_or_else(|| others.join(" x "), |it| it.to_string()), numbers }
}

/// Reads OpenCV's JSON: what the YAML says, as objects with a `type_id`.
pub(crate) fn from_json(text: &str, path: &Path) -> Result<Storage, CalibrationDiagnostic> {
    let document: serde_json::Value = serde_json::from_str(text).map_err(|error| {
        let fault =
            CalibrationDiagnostic::of_file(path, format!("this is not JSON ({error})"), "a JSON file of OpenCV");
        CalibrationDiagnostic { place: Some((error.line(), error.column())), ..fault }
    })?;
    let Some(object) = document.as_object() else {
        return Err(CalibrationDiagnostic::of_file(
            path,
            "JSON that is no object",
            "OpenCV's, which has names of matrices",
        ));
    };
    let word = |it: &serde_json::Value| it.as_str().map_or_else(|| it.to_string(), str::to_owned);
    let words = |it: Option<&serde_json::Value>| -> Vec<String> {
        it.and_then(serde_json::Value::as_array).map_or(Vec::new(), |list| list.iter().map(word).collect())
    };
    let mut storage = Storage::default();
    for (key, value) in object {
        let value = match value {
            serde_json::Value::Array(_) => Value::List(words(Some(value))),
            serde_json::Value::Object(fields) => {
                let of = |name: &str| fields.get(name).map_or(String::new(), word);
                let sizes = match of("type_id").as_str() {
                    "opencv-matrix" => vec![of("rows"), of("cols")],
                    "opencv-nd-matrix" => words(fields.get("sizes")),
                    _ => continue,
                };
                matrix(&sizes, &of("dt"), words(fields.get("data")))
            }
            other => Value::Scalar(word(other)),
        };
        // Where the name stands first.
        let quoted = format!("\"{key}\"");
        let line = text.lines().position(|it| it.contains(&quoted)).map_or(1, |it| it + 1);
        storage.entries.push(Entry { key: key.clone(), place: (line, 1), value });
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
            Some(kind @ ("opencv-matrix" | "opencv-nd-matrix")) => {
                let sizes = match kind {
                    "opencv-matrix" => vec![of("rows"), of("cols")],
                    _ => of("sizes").split_whitespace().map(str::to_owned).collect(),
                };
                matrix(&sizes, &unquoted(&of("dt")), of("data").split_whitespace().map(str::to_owned).collect())
            }
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
