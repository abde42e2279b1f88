//! What a run reports: figures under dotted names, and files.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::NodeError;
use crate::figure::{self, FigureSpec, Figures};

/// Collects the figures and files of one run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Report {
    /// Figures by dotted name with the unit in it (`reprojection_px.median`); NaN where there was nothing to measure.
    pub figures: BTreeMap<String, f64>,
    /// By figure: the full name of the node that reported it, in the report of a whole run; figures of the run itself have none.
    pub origins: BTreeMap<String, String>,
    /// By figure: how it was declared, in the report of a whole run; figures that were not declared are missing.
    pub about: BTreeMap<String, &'static FigureSpec>,
    /// Files and pictures written, relative to the results folder where they lie in it.
    pub files: Vec<PathBuf>,
    /// The one of these that a person should open first; of several nodes that name one, the last in the order of scales decides.
    pub open_first: Option<PathBuf>,
    /// Sentences for the person who ran it.
    pub remarks: Vec<String>,
}

impl Report {
    /// Sets a figure; a later value of the same name replaces the earlier one.
    pub fn figure(&mut self, name: impl Into<String>, value: f64) {
        self.figures.insert(name.into(), value);
    }

    /// Sets a figure of those `declared`; see [`Report::figure`].
    pub fn declared_figure(&mut self, declared: Figures, name: impl Into<String>, value: f64) {
        let name = name.into();
        if let Some(spec) = figure::find(declared, &name) {
            self.about.insert(name.clone(), spec);
        }
        self.figure(name, value);
    }

    /// Takes over the report of node `instance`, whose type declares `declared`; the names of the figures that are not among these. A figure whose name is
    /// taken already is kept as `name[instance]`; one that was declared takes its name from one that was not.
    pub fn absorb(&mut self, instance: &str, declared: Figures, other: Report) -> Vec<String> {
        let mut undeclared = Vec::new();
        for (name, value) in other.figures {
            let spec = figure::find(declared, &name);
            if spec.is_none() {
                undeclared.push(name.clone());
            }
            // A name belongs to who declared it: one that did not is set apart, whoever came first.
            if spec.is_some() && self.figures.contains_key(&name) && !self.about.contains_key(&name) {
                self.set_apart(&name);
            }
            let name = if self.figures.contains_key(&name) { format!("{name}[{instance}]") } else { name };
            self.origins.insert(name.clone(), instance.to_owned());
            if let Some(spec) = spec {
                self.about.insert(name.clone(), spec);
            }
            self.figures.insert(name, value);
        }
        self.files.extend(other.files);
        self.open_first = other.open_first.or(self.open_first.take());
        other.remarks.into_iter().for_each(|it| self.remark(it));
        undeclared
    }

    /// Renames the figure `name`, which its node did not declare, to one with that node's instance.
    fn set_apart(&mut self, name: &str) {
        let (Some(value), Some(origin)) = (self.figures.remove(name), self.origins.remove(name)) else { return };
        self.remark(format!("{origin} reports `{name}`, which another node declares: it is `{name}[{origin}]`"));
        let apart = format!("{name}[{origin}]");
        self.origins.insert(apart.clone(), origin);
        self.figures.insert(apart, value);
    }

    /// Notes a file that was written.
    pub fn file(&mut self, path: impl Into<PathBuf>) {
        self.files.push(path.into());
    }

    /// Saves `content` as `name` in the results folder `folder`, and notes the file.
    ///
    /// # Errors
    /// When it cannot be saved: the file, and why.
    pub fn save(&mut self, folder: &Path, name: &str, content: impl AsRef<[u8]>) -> Result<(), NodeError> {
        let path = folder.join(name);
        std::fs::write(&path, content).map_err(|error| {
            NodeError::input(format_args!(
                "{}: could not be saved ({error}), expected a folder that can be written",
                path.display()
            ))
        })?;
        self.file(name);
        Ok(())
    }

    /// Adds a sentence, unless it is there already.
    pub fn remark(&mut self, text: impl Into<String>) {
        let text = text.into();
        if !self.remarks.contains(&text) {
            self.remarks.push(text);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    crate::figures! {
        const DECLARED;
        "error_mm": mm, low, "The error";
    }

    #[test]
    fn a_file_that_cannot_be_saved_is_named_and_not_noted() {
        let folder = std::env::temp_dir().join(format!("foveate-report-{}", std::process::id()));
        let mut report = Report::default();
        let fault = report.save(&folder, "map.toml", "a = 1").unwrap_err().to_string();
        assert!(fault.contains("map.toml: could not be saved (") && report.files.is_empty(), "{fault}");
        std::fs::create_dir(&folder).unwrap();
        report.save(&folder, "map.toml", "a = 1").unwrap();
        assert_eq!(report.files, [PathBuf::from("map.toml")]);
        assert_eq!(std::fs::read_to_string(folder.join("map.toml")).unwrap(), "a = 1");
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_name_belongs_to_who_declared_it_whoever_came_first() {
        let given = |value: f64| {
            let mut report = Report::default();
            report.figure("error_mm", value);
            report
        };
        for is_declared_first in [true, false] {
            let mut whole = Report::default();
            let mut nodes = [("room.score", DECLARED, 2.0), ("room.liar", &[][..], 0.0)];
            if !is_declared_first {
                nodes.reverse();
            }
            for (instance, declared, value) in nodes {
                whole.absorb(instance, declared, given(value));
            }
            assert_eq!((whole.figures["error_mm"], whole.figures["error_mm[room.liar]"]), (2.0, 0.0));
            assert_eq!((whole.origins["error_mm"].as_str(), whole.about.len()), ("room.score", 1));
        }
    }
}
