//! The results folder: summary, ledger, the resolved rig.

mod folder;

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use foveate_diagnostics::fields::{self, quoted};
use foveate_engine::Outcome;
use foveate_node::figure::find;
use foveate_rig::graph::Graph;
use serde_json::{Map, Value, json};

pub use self::folder::{ResultsFolder, abandon, make_folder};
use crate::interrupt;

foveate_node::figures! {
    pub const OF_THE_RUN;
    "session_s": s, neither, "Session time at the end of the run";
    "messages.delivered": count, neither, "Messages delivered, over all edges";
    "messages.dropped": count, low, "Messages dropped because their consumers did not keep up, over all edges";
    "messages.suspended": count, neither, "Messages that a scale without its target did not get, over all edges";
    "messages.late": count, low, "Messages captured before one that was delivered earlier, over all edges";
    "gaps": count, low, "Messages that nodes declared missing";
    "faults": count, low, "Failures of nodes";
    "requirements_unmet": count, low, "Requirements that were not met, one for each edge and promise";
    "real_time_factor": ratio, high, "With report_speed: session time over wall time";
}

/// What is written before anything runs.
pub const BEFORE_THE_RUN: [&str; 2] = ["rig.resolved.toml", "graph.svg"];

/// Writes `rig.resolved.toml` and `graph.svg`, before anything runs.
///
/// # Errors
/// A sentence with the path and the reason.
pub fn write_rig(folder: &Path, graph: &Graph) -> Result<(), String> {
    write_whole(&folder.join(BEFORE_THE_RUN[0]), graph.resolved.as_bytes())?;
    write_whole(&folder.join(BEFORE_THE_RUN[1]), graph.to_svg().as_bytes())
}

/// Writes `summary.json`, `ledger.csv`, `events.csv` and `timing.json`. Tries all of them even if one fails.
///
/// # Errors
/// A sentence for each file that could not be written.
pub fn write_outcome(folder: &Path, graph: &Graph, outcome: &Outcome) -> Result<(), Vec<String>> {
    let files = [
        ("summary.json", summary(outcome, graph.report_speed)),
        ("ledger.csv", ledger(graph, outcome)),
        ("events.csv", events(outcome)),
        ("timing.json", timing(outcome)),
    ];
    let complaints: Vec<String> =
        files.iter().filter_map(|(name, text)| write_whole(&folder.join(name), text.as_bytes()).err()).collect();
    if complaints.is_empty() { Ok(()) } else { Err(complaints) }
}

/// Figures under dotted names: the nodes' own, and what the ledgers add up to; `figures_about` says of each its unit and what is better. The same bytes
/// for the same run, but for `real_time_factor` where the rig asks for it with `report_speed`.
pub fn summary(outcome: &Outcome, report_speed: bool) -> String {
    let mut figures: Map<String, Value> = Map::new();
    let sum = |of: fn(&foveate_engine::ledger::Ledger) -> u64| outcome.ledgers.iter().map(of).sum::<u64>();
    figures.insert("session_s".into(), number(outcome.ended.as_s()));
    figures.insert("messages.delivered".into(), json!(sum(|it| it.delivered)));
    figures.insert("messages.dropped".into(), json!(sum(|it| it.dropped)));
    if !outcome.suspensions.is_empty() {
        figures.insert("messages.suspended".into(), json!(sum(|it| it.suspended)));
    }
    figures.insert("messages.late".into(), json!(sum(|it| it.late)));
    figures.insert("gaps".into(), json!(outcome.gaps.iter().map(|it| it.count).sum::<u64>()));
    figures.insert("faults".into(), json!(outcome.faults.iter().map(|it| it.count).sum::<u64>()));
    figures.insert("requirements_unmet".into(), json!(outcome.unmet.len()));
    for (name, &value) in &outcome.report.figures {
        figures.insert(name.clone(), number(value));
    }
    if report_speed {
        figures.insert("real_time_factor".into(), number(real_time_factor(outcome)));
    }
    let mut sorted: Vec<_> = interrupt::told(figures, outcome.interrupted).into_iter().collect();
    sorted.sort_by(|a, b| a.0.cmp(&b.0));
    let about = about(outcome, sorted.iter().map(|it| it.0.as_str()));
    let text = format!("{:#}", Value::Object(sorted.into_iter().collect()));
    let head = text.strip_suffix("\n}").unwrap_or(&text);
    format!("{head},\n  \"figures_about\": {{{about}\n  }}\n}}\n")
}

/// One line for each of the figures that was declared.
fn about<'a>(outcome: &Outcome, names: impl Iterator<Item = &'a str>) -> String {
    let line = |name: &str| {
        let spec = outcome.report.about.get(name).copied().or_else(|| find(OF_THE_RUN, name))?;
        let (name, unit) = (Value::from(name), Value::from(spec.unit));
        Some(format!("\n    {name}: {{ \"unit\": {unit}, \"better\": \"{}\" }}", spec.better.name()))
    };
    names.filter_map(line).collect::<Vec<_>>().join(",")
}

/// A JSON number; whole ones without a point, what is not finite as `null`.
pub fn number(value: f64) -> Value {
    if value.fract() == 0.0 && value.abs() < 9e15 { json!(value as i64) } else { json!(value) }
}

fn pretty(value: &Value) -> String {
    format!("{value:#}\n")
}

/// One line an edge.
fn ledger(graph: &Graph, outcome: &Outcome) -> String {
    let mut text =
        "edge,delivered,rate_hz,age_p50_ms,age_p99_ms,age_max_ms,gaps,dropped,suspended,late,loss,sigma,requirement\n"
            .to_owned();
    let optional = |value: Option<f64>, scale: f64| fields::number(scale * value.unwrap_or(f64::NAN), 4).to_string();
    for (edge, ledger) in graph.edges.iter().zip(&outcome.ledgers) {
        let verdict = match &edge.require {
            None => "",
            Some(promise) if ledger.unmet(promise).is_empty() => "met",
            Some(_) => "unmet",
        };
        let ages = [ledger.age_s(0.5), ledger.age_s(0.99), ledger.age_max_s()].map(|age| optional(age, 1e3)).join(",");
        text += &format!(
            "{},{},{},{ages},{},{},{},{},{:.6},{},{verdict}\n",
            edge.name,
            ledger.delivered,
            optional(ledger.rate_hz(), 1.0),
            ledger.gaps,
            ledger.dropped,
            ledger.suspended,
            ledger.late,
            ledger.loss(),
            optional(ledger.sigma(), 1.0),
        );
    }
    text
}

/// One line for each kind of failure and gap, for each time that a scale was suspended or resumed, and for each requirement that was not met.
fn events(outcome: &Outcome) -> String {
    let mut text = "what,where,first_time_s,count,action,message\n".to_owned();
    for it in &outcome.faults {
        text += &format!(
            "fault,{},{:.6},{},{},{}\n",
            it.instance,
            it.time.as_s(),
            it.count,
            it.action,
            quoted(&it.message)
        );
    }
    for it in &outcome.gaps {
        text += &format!("gap,{},{:.6},{},,{}\n", it.instance, it.time.as_s(), it.count, quoted(&it.reason));
    }
    for it in &outcome.suspensions {
        for spell in &it.spells {
            text += &format!("suspended,{},{:.6},1,,{}\n", it.scale, spell.from.as_s(), quoted(&spell.why));
            if let Some(until) = spell.until {
                text += &format!(
                    "resumed,{},{:.6},1,,{}\n",
                    it.scale,
                    until.as_s(),
                    quoted("it and the scales around it have their targets")
                );
            }
        }
        let more = it.count - it.spells.len() as u64;
        if more > 0 {
            text += &format!("suspended,{},,{more},,{}\n", it.scale, quoted("more, not listed one by one"));
        }
    }
    for it in &outcome.report.remarks {
        text += &format!("note,,,,,{}\n", quoted(it));
    }
    for it in &outcome.unmet {
        text += &format!("unmet,{},,,{},{}\n", quoted(&it.edge), if it.must { "must" } else { "" }, quoted(&it.what));
    }
    text
}

/// What differs from run to run, kept out of the summary.
fn timing(outcome: &Outcome) -> String {
    let factor = real_time_factor(outcome);
    pretty(
        &json!({ "wall_s": outcome.wall.as_secs_f64(), "real_time_factor": factor, "interrupted": outcome.interrupted }),
    )
}

/// Session time over wall time.
fn real_time_factor(outcome: &Outcome) -> f64 {
    outcome.ended.as_s() / outcome.wall.as_secs_f64()
}

/// Writes a file so that it is there whole or not at all. What is no ordinary file (a device, a pipe) is written to, not replaced.
///
/// # Errors
/// A sentence with the path and the reason.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), String> {
    if fs::metadata(path).is_ok_and(|it| !it.is_file()) {
        return fs::write(path, bytes).map_err(|error| format!("`{}` cannot be written: {error}", path.display()));
    }
    let mut partial = path.as_os_str().to_owned();
    partial.push(".partial");
    let partial = PathBuf::from(partial);
    let written = fs::File::create(&partial).and_then(|mut file| {
        file.write_all(bytes)?;
        file.flush()
    });
    written.and_then(|()| fs::rename(&partial, path)).map_err(|error| {
        drop(fs::remove_file(&partial));
        format!("`{}` cannot be written: {error}", path.display())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_finite_is_null_and_whole_numbers_have_no_point() {
        assert_eq!(number(f64::NAN), Value::Null);
        assert_eq!(number(8.0).to_string(), "8");
        assert_eq!(number(0.25).to_string(), "0.25");
    }

    #[test]
    fn device_is_written_to_and_not_replaced() {
        let device = Path::new("/dev/null");
        if fs::metadata(device).is_ok_and(|it| !it.is_file()) {
            assert_eq!(write_whole(device, b"gone"), Ok(()));
            assert!(!fs::metadata(device).unwrap().is_file());
        }
        assert!(write_whole(&std::env::temp_dir(), b"x").is_err_and(|it| it.contains("cannot be written")));
    }

    #[test]
    fn file_that_cannot_be_written_is_named_and_leaves_nothing_behind() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("missing/summary.json");
        assert!(write_whole(&path, b"{}").is_err_and(|it| it.contains("missing/summary.json")));
        assert_eq!(fs::read_dir(home.path()).unwrap().count(), 0);
    }
}
