//! What a person reads at the end of a run, and the exit code.

use std::fmt::Write;
use std::path::Path;

use foveate_dataflow::error::Blame;
use foveate_dataflow::graph::Graph;
use foveate_dataflow::run::Outcome;

use crate::exit;

/// Figures, gaps and failures shown at most; the rest is in the files.
const SHOWN: usize = 40;

/// The end of a run in words.
pub fn describe(graph: &Graph, outcome: &Outcome, folder: &Path) -> String {
    let mut text = String::new();
    let mut line = |it: &str| {
        text.push_str(it);
        text.push('\n');
    };
    let (session, wall) = (outcome.ended.as_s(), outcome.wall.as_secs_f64());
    let ended = if outcome.interrupted { "stopped by you after" } else { "done:" };
    line(&format!("{ended} {session:.2} s of motion in {wall:.2} s ({:.1}× real time)", session / wall.max(1e-9)));
    // What is said of each camera, and the same figure of a second node, is for the file.
    let is_of_one = |name: &str| {
        let last = name.rsplit('.').next().unwrap_or(name);
        name.contains('[') || graph.calibration.index_of(last).is_some()
    };
    let figures: Vec<_> = outcome.report.figures.iter().filter(|(name, _)| !is_of_one(name)).collect();
    let width = figures.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
    for (name, value) in figures.iter().take(SHOWN) {
        line(&format!("  {name:width$}  {}", short(**value)));
    }
    if figures.len() > SHOWN {
        line(&format!("  … and {} more in summary.json", figures.len() - SHOWN));
    }
    for remark in &outcome.report.remarks {
        line(&format!("note: {remark}"));
    }
    for gap in outcome.gaps.iter().take(SHOWN) {
        line(&format!("gap: {} at {}{}: {}", gap.instance, gap.time, times(gap.count), gap.reason));
    }
    if outcome.gaps.len() > SHOWN {
        line(&format!("gap: {} more kinds in events.csv", outcome.gaps.len() - SHOWN));
    }
    for fault in outcome.faults.iter().take(SHOWN) {
        let (place, count) = (&fault.instance, times(fault.count));
        line(&format!("fault: {place} at {}{count}: {} ({})", fault.time, fault.message, fault.action));
    }
    for unmet in outcome.unmet.iter().take(SHOWN) {
        let must = if unmet.must { " (must)" } else { "" };
        line(&format!("requirement not met{must}: {}: {}", unmet.edge, unmet.what));
    }
    if outcome.unmet.len() > SHOWN {
        line(&format!("requirement not met: {} more in events.csv", outcome.unmet.len() - SHOWN));
    }
    let pictures: Vec<_> = outcome.report.files.iter().map(|it| it.display().to_string()).collect();
    let _ = writeln!(text, "results: {}/", folder.display());
    if !pictures.is_empty() {
        let _ = writeln!(text, "  {}", pictures.join("  "));
    }
    text
}

fn times(count: u64) -> String {
    if count == 1 { String::new() } else { format!(" ({count} times)") }
}

fn short(value: f64) -> String {
    if value.fract() == 0.0 && value.abs() < 1e9 { format!("{value}") } else { format!("{value:.4}") }
}

/// The exit code that the run earned.
pub fn exit_code(outcome: &Outcome) -> u8 {
    match outcome.blame() {
        Some(Blame::Program) => exit::PROGRAM,
        Some(Blame::Input) => exit::INPUT,
        None if outcome.unmet.iter().any(|it| it.must) => exit::UNMET,
        None => exit::DONE,
    }
}
