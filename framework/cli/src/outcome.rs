//! What a person reads at the end of a run, and the exit code.

use std::fmt::Write;
use std::path::Path;

use foveate_dataflow::error::Blame;
use foveate_dataflow::graph::Graph;
use foveate_dataflow::run::{Outcome, Unmet};

use crate::exit;

/// Figures, gaps and failures shown at most; the rest is in the files.
const SHOWN: usize = 40;
/// Kinds of gaps shown of each node at most.
const GAPS_SHOWN: usize = 3;
/// Files named at most.
const FILES_SHOWN: usize = 8;

/// The end of a run in words.
pub fn describe(graph: &Graph, outcome: &Outcome, folder: &Path) -> String {
    let mut text = String::new();
    let mut line = |it: &str| {
        text += &harmless(it);
        text.push('\n');
    };
    let (session, wall) = (outcome.ended.as_s(), outcome.wall.as_secs_f64());
    let ended = if outcome.interrupted { "stopped by you after" } else { "done:" };
    line(&format!("{ended} {session:.2} s of motion in {wall:.2} s ({:.1}× real time)", session / wall.max(1e-9)));
    // What is said of each camera, the same figure of a second node, and a node's own bookkeeping are for the file.
    let is_for_the_file = |name: &str| {
        let last = name.rsplit('.').next().unwrap_or(name);
        let kept_by_a_node = graph.instances.iter().any(|it| {
            let short = it.node_type.name.rsplit('.').next().unwrap_or(it.node_type.name);
            name.strip_prefix(short).is_some_and(|rest| rest.starts_with('.'))
        });
        name.contains('[') || kept_by_a_node || graph.calibration.index_of(last).is_some()
    };
    let mut figures: Vec<_> = outcome.report.figures.iter().filter(|(name, _)| !is_for_the_file(name)).collect();
    // What is of the whole run comes before what is of one camera or head.
    figures.sort_by_key(|(name, _)| name.split('.').any(|it| graph.calibration.index_of(it).is_some()));
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
    lost(outcome, ", in events.csv").iter().for_each(|it| line(it));
    for (unmet, others) in unmet_by_node(outcome).iter().take(SHOWN) {
        let must = if unmet.must { " (must)" } else { "" };
        let more = if *others == 0 { String::new() } else { format!("; and {others} like it, in events.csv") };
        line(&format!("requirement not met{must}: {}: {}{more}", unmet.edge, unmet.what));
    }
    let _ = writeln!(text, "results: {}/", folder.display());
    let files = &outcome.report.files;
    let mut names: Vec<_> = files.iter().take(FILES_SHOWN).map(|it| it.display().to_string()).collect();
    if files.len() > FILES_SHOWN {
        names.push(format!("… and {} more", files.len() - FILES_SHOWN));
    }
    let _ = writeln!(text, "  summary.json  {}", names.join("  "));
    text
}

/// Gaps and failures, a line each; `elsewhere` says where those are that are too many.
pub fn lost(outcome: &Outcome, elsewhere: &str) -> Vec<String> {
    let mut lines = Vec::new();
    for gaps in outcome.gaps.chunk_by(|a, b| a.instance == b.instance) {
        for gap in gaps.iter().take(GAPS_SHOWN) {
            lines.push(format!("gap: {} at {}{}: {}", gap.instance, gap.time, times(gap.count), gap.reason));
        }
        if gaps.len() > GAPS_SHOWN {
            let count: u64 = gaps[GAPS_SHOWN..].iter().map(|it| it.count).sum();
            lines.push(format!("gap: {}: {count} more{elsewhere}", gaps[0].instance));
        }
    }
    for fault in outcome.faults.iter().take(SHOWN) {
        let (place, count) = (&fault.instance, times(fault.count));
        lines.push(format!("fault: {place} at {}{count}: {} ({})", fault.time, fault.message, fault.action));
    }
    lines
}

/// Words out of a broken file must not steer the terminal.
pub fn harmless(words: &str) -> String {
    words.chars().map(|c| if c.is_control() { '\u{fffd}' } else { c }).collect()
}

/// The first unmet requirement of each kind of edge, and how many more there are that differ in the camera and in the number
/// measured.
fn unmet_by_node(outcome: &Outcome) -> Vec<(&Unmet, usize)> {
    let kind = |it: &Unmet| (without_cameras(&it.edge), it.what.split(' ').next().map(str::to_owned));
    let mut kinds: Vec<(&Unmet, usize)> = Vec::new();
    for unmet in &outcome.unmet {
        match kinds.iter_mut().find(|(first, _)| kind(first) == kind(unmet)) {
            Some((_, others)) => *others += 1,
            None => kinds.push((unmet, 0)),
        }
    }
    kinds
}

/// `room.leds[wide-1].features` without what stands in brackets.
fn without_cameras(edge: &str) -> String {
    let parts = edge.split('[').enumerate();
    parts.map(|(index, part)| if index == 0 { part } else { part.split_once(']').map_or(part, |it| it.1) }).collect()
}

fn times(count: u64) -> String {
    if count == 1 { String::new() } else { format!(" ({count} times)") }
}

fn short(value: f64) -> String {
    if !value.is_finite() {
        "–".to_owned()
    } else if value.fract() == 0.0 && value.abs() < 1e9 {
        format!("{value}")
    } else {
        format!("{value:.4}")
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_that_differ_in_the_camera_are_of_one_kind() {
        assert_eq!(
            without_cameras("room.leds[wide-1].features -> room.targets.features"),
            "room.leds.features -> room.targets.features"
        );
        assert_eq!(without_cameras("a[x].b -> c[y].d"), "a.b -> c.d");
        assert_eq!(without_cameras("no camera"), "no camera");
    }
}
