//! One HTML page with pictures of a solved room: no other file, no network, light and dark, readable in print.
//!
//! [`html`] draws what a [`Solved`] says and nothing more; the same input gives the same bytes. Plots are SVG; the room is drawn
//! once as SVG, for print and where scripts are off, and again on a canvas that can be turned. What is too much to draw is
//! thinned evenly, and the page says so.

mod coverage;
mod depths;
mod figures;
mod graph;
mod network;
mod page;
mod residuals;
mod steps;
mod summary;

use foveate_scene::Provenance;

use crate::convergence::Convergence;
use crate::solved::Solved;

/// What goes on the page.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReportInput<'a> {
    /// Over the page.
    pub title: &'a str,
    /// What the checks say; `None` when there were none.
    pub verdict: Option<Verdict<'a>>,
    /// The room.
    pub solved: &'a Solved,
    /// Unit of its lengths: `m`, or another word when its scale is not known.
    pub unit: &'a str,
    /// From a poor start, the paper's scheme beside ours.
    pub convergence: Option<&'a Convergence>,
    /// How the calibration was made.
    pub provenance: Option<&'a Provenance>,
    /// What was rejected beyond single observations, and why, in sentences.
    pub rejected: &'a [String],
}

/// What the checks say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verdict<'a> {
    /// In a word.
    pub grade: Grade,
    /// Why, and what to do.
    pub sentences: &'a [String],
    /// Findings beyond those.
    pub more: usize,
}

/// Whether to work with a calibration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Grade {
    /// Nothing speaks against it.
    Good,
    /// It will do, with what the sentences say in mind.
    Usable,
    /// Capture again, as the sentences say.
    Redo,
}

/// The page.
pub fn html(report: &ReportInput<'_>) -> String {
    let figures = figures::Figures::of(report.solved);
    let mut page = page::Page::new(report.title);
    summary::head(&mut page, report, &figures);
    summary::cameras(&mut page, report, &figures);
    network::section(&mut page, report);
    residuals::section(&mut page, report, &figures);
    coverage::section(&mut page, report, &figures);
    depths::section(&mut page, report, &figures);
    steps::section(&mut page, report);
    graph::section(&mut page, report, &figures);
    summary::clocks(&mut page, report);
    summary::rejected(&mut page, report, &figures);
    summary::provenance(&mut page, report);
    page.finish()
}
