//! A calibration in the console: coverage as it grows, what to do next, the verdict.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use foveate_calibration::coverage::Coverage;
use foveate_console::{Console, Mode, Opening};
use foveate_engine::{Options, Progress};
use foveate_node::Pages;
use foveate_rig::graph::Graph;
use foveate_web::{Listen, Server};
use serde_json::{Map, Value, json};

use super::boards::of_board;
use crate::commands::page_server;
use crate::interrupt;

/// The view that shows it.
const SHEET: &str = "calibrating";
/// Judging what is missing takes long enough not to do it at each progress.
const PERIOD: Duration = Duration::from_millis(500);

/// A console that shows a calibration, from the capture to the verdict.
pub struct Shown {
    server: Arc<Server>,
    console: OnceLock<Console>,
    sheet: Mutex<Sheet>,
}

#[derive(Default)]
struct Sheet {
    value: Map<String, Value>,
    last: Option<Instant>,
}

impl Shown {
    /// Served at `listen`.
    pub fn new(listen: Option<Listen>, is_quiet: bool) -> Shown {
        let server = Arc::new(page_server(listen, is_quiet));
        Shown { server, console: OnceLock::new(), sheet: Mutex::default() }
    }

    /// The pages of the rig that captures.
    pub fn pages(&self) -> Pages {
        Pages::served_by(Arc::<Server>::clone(&self.server))
    }

    /// Opens the console on the rig that captures, which then runs with the options that are given back.
    ///
    /// # Errors
    /// A sentence: no address to serve at.
    pub fn open(&self, graph: &Arc<Graph>, is_live: bool, options: Options) -> Result<Options, String> {
        let mode = if is_live { Mode::Live } else { Mode::Simulated };
        let (graph, stop) = (Arc::clone(graph), Arc::clone(&options.stop));
        let out_dir: Option<PathBuf> = options.out_dir.clone();
        let console = Console::open(Opening { graph, rig: None, mode, stop, out_dir, again: None, record: None })?;
        let options = Options { look: Some(console.look()), controls: console.controls(), paced: !is_live, ..options };
        let _ = self.console.set(console); // it is opened once
        Ok(options)
    }

    /// The capture has come so far.
    pub fn advance(&self, progress: &Progress, coverage: impl FnOnce() -> Coverage, is_board: bool) {
        let Some(console) = self.console.get() else { return };
        console.advance(progress);
        let mut sheet = self.sheet.lock().unwrap_or_else(PoisonError::into_inner);
        if sheet.last.is_some_and(|it| it.elapsed() < PERIOD) {
            return;
        }
        sheet.last = Some(Instant::now());
        sheet.value = of_coverage(&coverage(), is_board);
        sheet.value.insert("phase".to_owned(), "capturing".into());
        console.show(SHEET, &Value::Object(sheet.value.clone()));
    }

    /// The capture is over, and `phase` has begun.
    pub fn begin(&self, phase: &str) {
        self.change(|sheet| {
            sheet.insert("phase".to_owned(), phase.into());
        });
    }

    /// How it has ended: good, usable or redo, and why; or that it failed, and on what.
    pub fn conclude(&self, level: &str, text: &str) {
        self.change(|sheet| {
            sheet.insert("phase".to_owned(), "done".into());
            sheet.insert("verdict".to_owned(), json!({ "level": level, "text": text }));
        });
        self.console.get().into_iter().for_each(Console::finish);
    }

    fn change(&self, change: impl FnOnce(&mut Map<String, Value>)) {
        let Some(console) = self.console.get() else { return };
        let mut sheet = self.sheet.lock().unwrap_or_else(PoisonError::into_inner);
        change(&mut sheet.value);
        console.show(SHEET, &Value::Object(sheet.value.clone()));
    }

    /// Stays until a signal comes, if there is anything to stay for.
    pub fn stay(&self) {
        let stop = Arc::<AtomicBool>::default();
        if self.console.get().is_none() || interrupt::stops(&stop).is_err() {
            return;
        }
        eprintln!("the console is still served; Ctrl-C ends");
        interrupt::wait(&stop);
    }
}

fn of_coverage(coverage: &Coverage, is_board: bool) -> Map<String, Value> {
    let (n, options, guidance) = (coverage.n_cameras(), coverage.options(), coverage.state());
    let camera = |it: usize| {
        json!({
            "name": coverage.name(it), "frames": coverage.frames(it), "share": coverage.share(it), "cells": coverage.cells(it),
            "done": coverage.is_done(it), "partners": coverage.partners(it), "depth_m": coverage.depth_m(it),
        })
    };
    let common = |a: usize| (0..n).map(move |b| if a == b { 0 } else { coverage.common(a, b) }).collect::<Vec<u32>>();
    let words = |it: String| if is_board { of_board(&it) } else { it };
    let missing = guidance.missing.iter().map(|it| json!({ "words": words(it.to_string()), "needed": it.needed() }));
    let value = json!({
        "columns": options.grid[0], "rows": options.grid[1], "full_cell": options.full_cell, "min_frames": options.min_frames,
        "min_common": options.min_common, "min_share": options.min_cells, "board": is_board,
        "cameras": (0..n).map(camera).collect::<Vec<_>>(), "common": (0..n).map(common).collect::<Vec<_>>(),
        "enough": guidance.enough, "missing": missing.collect::<Vec<_>>(), "volume_share": coverage.volume_share(), "verdict": null,
    });
    let Value::Object(map) = value else { unreachable!("an object was written") };
    map
}
