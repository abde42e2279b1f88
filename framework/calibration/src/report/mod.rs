//! One HTML page with pictures of a solved camera network: no other file, no internet access, light and dark, readable in print.
//!
//! [`html`] draws only what a [`Solved`] contains; the same input gives the same bytes. Plots are SVG; the room is drawn
//! once as SVG, for print and where scripts are off, and again on a canvas that can be rotated. What is too much to draw is
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

/// The contents of the page.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReportInput<'a> {
    /// Heading of the page.
    pub title: &'a str,
    /// The verdict of the checks; `None` without checks.
    pub verdict: Option<Verdict<'a>>,
    /// The room.
    pub solved: &'a Solved,
    /// Unit of its lengths: `m`, or another word when its scale is not known.
    pub unit: &'a str,
    /// Convergence from a poor start, the paper's scheme beside bundle adjustment.
    pub convergence: Option<&'a Convergence>,
    /// How the calibration was made.
    pub provenance: Option<&'a Provenance>,
    /// Sentences about what was rejected beyond single observations, and why.
    pub rejected: &'a [String],
}

/// The verdict of the checks, for the page.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verdict<'a> {
    /// The grade.
    pub grade: Grade,
    /// Why, and what to do.
    pub sentences: &'a [String],
    /// Findings beyond those.
    pub more: usize,
}

/// Whether a calibration can be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Grade {
    /// Usable without reservations.
    Good,
    /// Usable with the reservations that the sentences state.
    Usable,
    /// Not usable: capture again, as the sentences say.
    Redo,
}

/// Renders the page.
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
