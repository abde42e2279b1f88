//! The figures of two runs beside each other.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use super::super::motion_files::write_whole;
use super::CompareArgs;
use crate::exit;
use crate::outcome::harmless;
use crate::output::say;

/// Figures of a run.
struct Figures {
    values: Map<String, Value>,
    about: Map<String, Value>,
}

/// Whether it is a results folder, or the summary of one.
pub(super) fn is_run(path: &Path) -> bool {
    path.is_dir() || path.extension().is_some_and(|it| it == "json")
}

pub(super) fn run(args: &CompareArgs) -> Result<u8, String> {
    let (a, b) = (read(&args.a)?, read(&args.b)?);
    let names: BTreeSet<&String> = a.values.keys().chain(b.values.keys()).collect();
    let mut text = format!("A: {}\nB: {}\n", args.a.display(), args.b.display());
    let (mut rows, mut n_same) = (Vec::new(), 0);
    for name in names {
        let values = [&a, &b].map(|it| it.values.get(name));
        if values[0] == values[1] {
            n_same += 1;
            continue;
        }
        let about = b.about.get(name).or_else(|| a.about.get(name));
        let of = |key: &str| about.and_then(|it| it.get(key)).and_then(Value::as_str).unwrap_or_default();
        let difference = match values.map(|it| it.and_then(Value::as_f64)) {
            [Some(a), Some(b)] => Some(b - a),
            _ => None,
        };
        let verdict = match (of("better"), difference) {
            ("high", Some(it)) | ("low", Some(it)) => match (of("better") == "high") == (it > 0.0) {
                true => "better",
                false => "worse",
            },
            _ => "",
        };
        rows.push(json!({
            "figure": name, "unit": of("unit"), "a": values[0], "b": values[1], "difference": difference, "b_is": verdict,
        }));
    }
    if !rows.is_empty() {
        let shown = |it: &Value| match it {
            Value::Null => "–".to_owned(),
            Value::Number(it) => it.as_f64().map_or_else(|| it.to_string(), figure),
            Value::String(it) => harmless(it),
            other => other.to_string(),
        };
        text += &format!("\n{:<44} {:>12} {:>12} {:>12}  unit\n", "figure", "A", "B", "B - A");
        for row in &rows {
            let field = |key: &str| shown(&row[key]);
            let unit = [field("unit"), field("b_is")].join(" ");
            let line = format!(
                "{:<44} {:>12} {:>12} {:>12}  {}",
                field("figure"),
                field("a"),
                field("b"),
                field("difference"),
                unit
            );
            text += &format!("{}\n", line.trim_end());
        }
    }
    text += &format!("\n{n_same} figures are the same, {} differ\n", rows.len());
    let all = format!("{:#}\n", json!({ "same": n_same, "different": rows }));
    match args.json.as_deref() {
        Some(path) if path.as_os_str() == "-" => say(&all),
        Some(path) => {
            write_whole(path, all.as_bytes(), true)?;
            say(&text);
        }
        None => say(&text),
    }
    Ok(exit::DONE)
}

/// A number with six digits that matter.
fn figure(value: f64) -> String {
    if value.fract() == 0.0 && value.abs() < 1e12 {
        return format!("{value}");
    }
    let digits = (5.0 - value.abs().log10().floor()).clamp(0.0, 12.0) as usize;
    format!("{value:.digits$}")
}

/// The summary of a run without what lies deeper than figures.
fn read(path: &Path) -> Result<Figures, String> {
    let file: PathBuf = if path.is_dir() { path.join("summary.json") } else { path.to_owned() };
    let shown = file.display();
    let text = std::fs::read_to_string(&file).map_err(|error| {
        format!("`{shown}` cannot be read: {error}; expected the results folders of two runs, or their summary.json")
    })?;
    let value: Value = serde_json::from_str(&text).map_err(|error| format!("`{shown}` is no JSON: {error}"))?;
    let Value::Object(mut values) = value else { return Err(format!("`{shown}` is no summary of a run")) };
    let about = values.remove("figures_about").and_then(|it| it.as_object().cloned()).unwrap_or_default();
    values.retain(|_, it| !it.is_object() && !it.is_array());
    Ok(Figures { values, about })
}
