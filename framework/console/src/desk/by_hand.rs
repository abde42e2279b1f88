//! Marks corrected by hand, and what is done about them beside the console's thread.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::time::Instant;

use foveate_node::given::Table;
use foveate_node::guard::guarded;
use foveate_node::page::Client;
use foveate_session::glance::Glance;
use serde_json::{Value, json};

use super::Desk;
use crate::console::Again;
use crate::hello::Index;
use crate::marks::{self, Row, Rows};
use crate::source::Source;
use crate::state::lock;

/// Corrections by hand, and what is done about them beside the console's thread.
pub(super) struct Marks {
    pub rows: Rows,
    /// Where the rows are written.
    pub file: Option<PathBuf>,
    pub again: Option<Arc<Again>>,
    /// What a thread is at.
    pub work: Option<Receiver<Done>>,
    /// What the page shows of it.
    pub sheet: Value,
}

/// What a thread has done.
pub(super) enum Done {
    Problems(usize, Vec<Value>),
    Again(Result<Box<Glance>, String>),
}

impl Desk {
    /// Corrects marks of a node by hand; in a run the answer follows when its tracker has taken the rows.
    pub(super) fn correct(
        &mut self,
        client: Client,
        node: usize,
        rows: &[Value],
        number: Option<i64>,
    ) -> Result<Option<String>, String> {
        let n_cameras = self.graph.calibration.cameras.len();
        let mut new = self.marks.rows.clone();
        for it in rows {
            let (row, is_removed) = Row::read(node, it, n_cameras)?;
            new.put(row, is_removed);
        }
        if let Source::Run(_) = self.source {
            self.set(client, node, new.setting(node), number)?;
            self.keep_rows(new)?;
            return Ok(None);
        }
        let words = self.keep_rows(new)?;
        Ok(Some(words))
    }

    fn keep_rows(&mut self, rows: Rows) -> Result<String, String> {
        self.marks.rows = rows;
        self.show_marks();
        let Some(file) = &self.marks.file else { return Ok(String::new()) };
        self.marks.rows.write(file)?;
        Ok(format!("written to {}", file.display()))
    }

    /// Tracks a session again with the rows, beside the console's thread.
    pub(super) fn again(&mut self) -> Result<String, String> {
        let again = self.marks.again.clone().ok_or("only a session can be tracked again")?;
        if self.marks.work.is_some() {
            return Err("it is at work already".to_owned());
        }
        let nodes = self.marks.rows.nodes();
        if nodes.is_empty() {
            return Err("there are no corrections".to_owned());
        }
        let settings: Vec<(String, Table)> =
            nodes.iter().map(|it| (self.index.nodes[*it].0.clone(), self.marks.rows.setting(*it))).collect();
        self.begin(move || {
            let made = guarded(|| again(&settings)).unwrap_or_else(Err);
            Done::Again(made.map(Box::new))
        })?;
        self.marks.sheet["again"] = json!({ "state": "running", "words": "tracking again" });
        self.show_marks();
        Ok("tracking again".to_owned())
    }

    pub(super) fn problems(&mut self, node: usize) -> Result<String, String> {
        let Source::Session(playing) = &self.source else {
            return Err("only a session can be searched; record the run, and look at the session".to_owned());
        };
        if self.marks.work.is_some() {
            return Err("it is at work already".to_owned());
        }
        let (mut glance, graph) = (playing.glance().again(&self.graph)?, Arc::clone(&self.graph));
        self.begin(move || {
            let index = Index::of(&graph);
            let found = guarded(|| marks::problems(&mut glance, &graph, &index, node));
            Done::Problems(node, found.unwrap_or_default())
        })?;
        self.marks.sheet["searching"] = true.into();
        self.show_marks();
        Ok("searching".to_owned())
    }

    fn begin(&mut self, work: impl FnOnce() -> Done + Send + 'static) -> Result<(), String> {
        let (done, answer) = channel();
        let thread = std::thread::Builder::new().name("console marks".to_owned()).spawn(move || {
            drop(done.send(work()));
        });
        thread.map_err(|error| format!("there is no thread for it: {error}"))?;
        self.marks.work = Some(answer);
        Ok(())
    }

    /// Takes what a thread has done, if it has.
    pub(super) fn take_work(&mut self) {
        let Some(done) = self.marks.work.as_ref().and_then(|it| it.try_recv().ok()) else { return };
        self.marks.work = None;
        let n_rows = self.marks.rows.list.len();
        match done {
            Done::Problems(node, found) => {
                self.marks.sheet["node"] = node.into();
                self.marks.sheet["problems"] = found.into();
                self.marks.sheet["searching"] = false.into();
            }
            Done::Again(Ok(glance)) => {
                if let Source::Session(playing) = &mut self.source {
                    playing.replace(*glance);
                }
                let words = format!(
                    "tracked again with {}",
                    if n_rows == 1 { "1 row".to_owned() } else { format!("{n_rows} rows") }
                );
                self.marks.sheet["again"] = json!({ "state": "done", "words": words });
            }
            Done::Again(Err(what)) => self.marks.sheet["again"] = json!({ "state": "failed", "words": what }),
        }
        self.show_marks();
    }

    fn show_marks(&mut self) {
        let file = self.marks.file.as_ref().map(|it| it.display().to_string());
        (self.marks.sheet["file"], self.marks.sheet["rows"]) = (json!(file), self.marks.rows.in_json());
        if self.marks.sheet["again"].is_null() {
            self.marks.sheet["again"] = json!({ "state": "idle", "words": "" });
        }
        lock(&self.state).show("marks", &self.marks.sheet);
        self.next_state = Instant::now();
    }
}
