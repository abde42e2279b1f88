//! What a person reads at the end of a run, and the exit code.

mod figures;

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use foveate_engine::{FaultRecord, GapRecord, Outcome, Unmet};
use foveate_node::Report;
use foveate_node::error::Blame;
use foveate_rig::graph::Graph;

use crate::exit;

/// Failures shown at most; the rest is in the files.
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
    let (table, n_left_out) = figures::table(graph, outcome);
    table.iter().for_each(|it| line(it));
    if n_left_out > 0 {
        line(&format!("  … and {n_left_out} more in summary.json; `foveate figures NAME` explains one"));
    }
    for (remark, others) in
        alike(&outcome.report.remarks, |it| kind(|word| graph.calibration.index_of(word).is_some(), it))
    {
        line(&format!("note: {remark}{}", and_more(others)));
    }
    lost(outcome, ", in events.csv").iter().for_each(|it| line(it));
    for (unmet, others) in unmet_by_node(outcome).iter().take(SHOWN) {
        let must = if unmet.must { " (must)" } else { "" };
        let more = if *others == 0 { String::new() } else { format!("; and {others} like it, in events.csv") };
        line(&format!("requirement not met{must}: {}: {}{more}", unmet.edge, unmet.what));
    }
    files(&mut text, &outcome.report, folder);
    text
}

/// Where the results are, which picture to open first, and the other files.
fn files(text: &mut String, report: &Report, folder: &Path) {
    let is_picture = |it: &&PathBuf| it.extension().is_some_and(|it| it == "svg" || it == "png" || it == "html");
    // Those that had to go elsewhere are all named.
    let (elsewhere, files): (Vec<_>, Vec<_>) = report.files.iter().partition(|it| it.is_absolute());
    let (mut pictures, others): (Vec<&PathBuf>, Vec<_>) = files.into_iter().partition(is_picture);
    pictures.sort_by_key(|it| report.open_first.as_ref() != Some(*it));
    let list = |names: &[&PathBuf]| {
        let mut shown: Vec<_> = names.iter().take(FILES_SHOWN).map(|it| it.display().to_string()).collect();
        if names.len() > FILES_SHOWN {
            shown.push(format!("… and {} more", names.len() - FILES_SHOWN));
        }
        shown.join("  ")
    };
    if let Some((first, rest)) = pictures.split_first() {
        let _ = writeln!(
            text,
            "open {} in a browser{}",
            folder.join(first).display(),
            if rest.is_empty() { "" } else { "; then:" }
        );
        if !rest.is_empty() {
            let _ = writeln!(text, "  {}", list(rest));
        }
    }
    let _ = writeln!(text, "results: {}/", folder.display());
    let _ = writeln!(text, "  summary.json  {}", list(&others));
    for it in elsewhere {
        let _ = writeln!(text, "saved elsewhere: {}", it.display());
    }
}

/// What went wrong, a line each, for who wants to read nothing else: failures of nodes, and promises marked `must` that were not kept.
pub fn failures(outcome: &Outcome) -> Vec<String> {
    let faults = outcome.faults.iter().map(|it| {
        let (place, count) = (&it.instance, times(it.count));
        format!("error: {place} at {}{count}: {} ({})", it.time, it.message, it.action)
    });
    let unmet = unmet_by_node(outcome).into_iter().filter(|it| it.0.must);
    let unmet = unmet.map(|(it, others)| {
        let more = if others == 0 { String::new() } else { format!("; and {others} like it") };
        format!("error: requirement not met (must): {}: {}{more}", it.edge, it.what)
    });
    faults.chain(unmet).map(|it| harmless(&it)).collect()
}

/// Gaps and failures, a line each; `elsewhere` says where those are that are too many.
pub fn lost(outcome: &Outcome, elsewhere: &str) -> Vec<String> {
    let mut lines = Vec::new();
    // The same words of several nodes, and of several files, are one line.
    let of_kind = |it: &GapRecord| {
        let is_camera =
            |word: &str| it.instance.split_once('[').is_some_and(|rest| rest.1.starts_with(&format!("{word}]")));
        (without_cameras(&it.instance), kind(is_camera, &it.reason))
    };
    let mut shown: BTreeMap<String, usize> = BTreeMap::new();
    let faults = &outcome.faults[..outcome.faults.len().min(SHOWN)];
    for (gap, others) in alike(&outcome.gaps, of_kind) {
        if others == 0 && faults.iter().any(|it| says(it, gap)) {
            continue;
        }
        let of_node = shown.entry(without_cameras(&gap.instance)).or_default();
        *of_node += 1;
        if *of_node <= GAPS_SHOWN {
            let more = if others == 0 { String::new() } else { format!(" (and {others} more like it{elsewhere})") };
            lines.push(format!("gap: {} at {}{}: {}{more}", gap.instance, gap.time, times(gap.count), gap.reason));
        }
    }
    let hidden = shown.iter().filter(|it| *it.1 > GAPS_SHOWN);
    lines.extend(hidden.map(|(node, kinds)| format!("gap: {node}: {} more kinds{elsewhere}", kinds - GAPS_SHOWN)));
    for fault in outcome.faults.iter().take(SHOWN) {
        let (place, count) = (&fault.instance, times(fault.count));
        lines.push(format!("fault: {place} at {}{count}: {} ({})", fault.time, fault.message, fault.action));
    }
    lines
}

/// Whether a fault tells what a gap of its node would: then it is not said twice.
fn says(fault: &FaultRecord, gap: &GapRecord) -> bool {
    fault.instance == gap.instance && !gap.reason.is_empty() && fault.message.contains(&gap.reason)
}

/// The first of each kind, in their order, and how many more there are of it.
fn alike<T, K: Ord>(list: &[T], kind: impl Fn(&T) -> K) -> Vec<(&T, usize)> {
    let mut place: BTreeMap<K, usize> = BTreeMap::new();
    let mut first: Vec<(&T, usize)> = Vec::new();
    for it in list {
        match place.entry(kind(it)) {
            Entry::Occupied(known) => first[*known.get()].1 += 1,
            Entry::Vacant(new) => {
                new.insert(first.len());
                first.push((it, 0));
            }
        }
    }
    first
}

/// A note or a reason without what differs from camera to camera: its name, and numbers.
fn kind(is_camera: impl Fn(&str) -> bool, remark: &str) -> String {
    let is_word = |it: char| it.is_alphanumeric() || matches!(it, '-' | '_' | '.');
    let mut text = String::new();
    let mut word = String::new();
    for c in remark.chars().chain([' ']) {
        if is_word(c) {
            word.push(c);
            continue;
        }
        if is_camera(word.trim_end_matches('.')) {
            text.push('*');
        } else {
            text.extend(word.chars().map(|it| if it.is_ascii_digit() { '#' } else { it }));
        }
        word.clear();
        text.push(c);
    }
    while text.contains("##") || text.contains("#.#") {
        text = text.replace("#.#", "#").replace("##", "#");
    }
    text
}

fn and_more(others: usize) -> String {
    if others == 0 { String::new() } else { format!(" (and {others} more like it, in events.csv)") }
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
    use foveate_node::Time;

    use super::*;

    #[test]
    fn what_differs_in_the_camera_is_said_once() {
        let list = ["a 1", "b", "a 2", "a 3"];
        assert_eq!(alike(&list, |it| it.chars().next()), [(&"a 1", 2), (&"b", 0)]);
        assert_eq!(and_more(0), "");
    }

    #[test]
    fn a_gap_whose_reason_a_fault_of_its_node_names_is_said_once() {
        let gap = |instance: &str, reason: &str| GapRecord {
            instance: instance.to_owned(),
            reason: reason.to_owned(),
            time: Time::ZERO,
            count: 1,
        };
        let fault = FaultRecord {
            instance: "room.decoded[camera]".to_owned(),
            blame: Blame::Input,
            message: "none of 1 sets could be decoded: scan: too dark".to_owned(),
            action: "while finishing",
            time: Time::ZERO,
            count: 1,
        };
        assert!(says(&fault, &gap("room.decoded[camera]", "scan: too dark")));
        assert!(!says(&fault, &gap("room.decoded[camera]", "scan: too bright")));
        assert!(!says(&fault, &gap("room.decoded[other]", "scan: too dark")));
        assert!(!says(&fault, &gap("room.decoded[camera]", "")));
    }

    #[test]
    fn words_that_differ_in_camera_and_number_are_of_one_kind() {
        let of = |camera: &str, text: &str| kind(|it| it == camera, text);
        let [a, b] = [of("c1", "`d/c1/00000.png` is 20 x 15 px"), of("c2", "`d/c2/00031.png` is 200 x 150 px")];
        assert_eq!(a, b);
        assert_ne!(a, of("c1", "`d/c1/00000.png` is no picture"));
    }

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
