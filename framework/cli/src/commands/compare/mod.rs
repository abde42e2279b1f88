//! `foveate compare`: how far apart two motion files are, or two shapes, and how the figures of two runs differ.

mod picture;
mod runs;
mod surfaces;

use std::path::PathBuf;

use clap::ValueEnum;
use foveate_motion::Motion;
use foveate_motion::compare::{CompareOptions, Comparison, Distances, Pairing, compare};
use foveate_motion::forms::{MOTION_FORMS, ReadOptions};
use serde_json::{Value, json};

use super::complain;
use super::convert::length;
use super::motion_files::{describe, kind_of, load, nearly_table, seconds_of_gap, write_whole};
use crate::exit;
use crate::outcome::harmless;
use crate::output::say;

/// `foveate compare`
#[derive(Debug, clap::Args)]
pub struct CompareArgs {
    /// A motion file: C3D, TRC, BVH, targets.csv, marks.csv, NPZ; a cloud or surface: PLY; or a results folder
    #[arg(value_hint = clap::ValueHint::FilePath)]
    a: PathBuf,
    /// Another, of any of these forms; a reference for a PLY is a PLY, and a results folder is compared with another one
    #[arg(value_hint = clap::ValueHint::FilePath)]
    b: PathBuf,
    /// How points are paired [default: by name, or by distance where no name is in both]
    #[arg(long = "match", value_enum)]
    pairing: Option<PairingArg>,
    /// Lay B onto A by the rotation and translation that fit best; of PLY files A onto B, from anywhere
    #[arg(long)]
    align: bool,
    /// Of PLY files: as `--align`, with a scale, which is reported
    #[arg(long)]
    scale: bool,
    /// Of PLY files: pairs farther apart than this are counted and left out [mm]
    #[arg(long, value_name = "MM", value_parser = millimetres)]
    farthest: Option<f64>,
    /// Of PLY files: B is covered where A is so near [mm] [default: twice the distance between points of A]
    #[arg(long, value_name = "MM", value_parser = millimetres)]
    coverage_within: Option<f64>,
    /// Of PLY files: write comparison.json, distances.svg and distances.ply (distances as colours) into this folder
    #[arg(long, value_name = "DIR", value_hint = clap::ValueHint::DirPath)]
    out: Option<PathBuf>,
    /// Look for a shift in time, at most this large, by cross-correlation of speeds [s]
    #[arg(long, value_name = "SECONDS", value_parser = seconds_of_gap)]
    shift: Option<f64>,
    /// Length of a unit of A, in place of the file's own [m]
    #[arg(long, value_name = "METRES", value_parser = length)]
    metres_per_unit_a: Option<f64>,
    /// Length of a unit of B, in place of the file's own [m]
    #[arg(long, value_name = "METRES", value_parser = length)]
    metres_per_unit_b: Option<f64>,
    /// End with exit code 3 unless 95 % of all samples (of PLY files, of the points of A that lie over B, which must be half of them) are at most this far apart [mm]
    #[arg(long, value_name = "MM", value_parser = millimetres)]
    within: Option<f64>,
    /// Write all figures to this file, too; `-`: to standard output, instead of the table
    #[arg(long, value_name = "FILE", value_hint = clap::ValueHint::FilePath)]
    json: Option<PathBuf>,
    /// Show figures of all points together only
    #[arg(long)]
    summary: bool,
}

/// How points are paired.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PairingArg {
    /// Equal names, whatever their capitals, blanks and signs
    Names,
    /// The assignment of least mean distance
    Nearest,
}

/// A distance on the command line.
fn millimetres(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|it| it.is_finite() && *it >= 0.0);
    number.ok_or_else(|| format!("found {text}, expected a distance of 0 or more [mm]"))
}

pub(super) fn run(args: &CompareArgs) -> u8 {
    match told(args) {
        Ok(code) => code,
        Err(sentence) => complain(&sentence),
    }
}

fn told(args: &CompareArgs) -> Result<u8, String> {
    if [&args.a, &args.b].iter().any(|it| runs::is_run(it)) {
        return runs::run(args);
    }
    match [&args.a, &args.b].map(|it| surfaces::is_ply(it)) {
        [true, true] => return surfaces::run(args),
        [false, false] => {}
        [a_is_ply, _] => {
            let (shape, other) = if a_is_ply { (&args.a, &args.b) } else { (&args.b, &args.a) };
            if let Err(fault) = std::fs::metadata(other) {
                return Err(format!("cannot read `{}`: {fault}", other.display()));
            }
            let [shape, other] = [shape, other].map(|it| it.display());
            return Err(format!("`{shape}` is a PLY file and `{other}` none, expected two of a kind"));
        }
    }
    for (is_set, flag) in [
        (args.scale, "--scale"),
        (args.farthest.is_some(), "--farthest"),
        (args.coverage_within.is_some(), "--coverage-within"),
        (args.out.is_some(), "--out"),
    ] {
        if is_set {
            return Err(format!("`{flag}` is for two PLY files, which `{}` is not", args.a.display()));
        }
    }
    let mut lines = Vec::new();
    let mut notes = Vec::new();
    let mut open = |name: &str, path: &PathBuf, metres_per_unit: Option<f64>| -> Result<(Motion, Value), String> {
        let form = kind_of(path).map_err(|it| format!("`{}` cannot be read: {it}", path.display()))?;
        let none = || format!("`{}` is no motion file, expected {MOTION_FORMS}; or two PLY files", path.display());
        let form = form.ok_or_else(|| nearly_table(path).unwrap_or_else(none))?;
        let read = load(path, form, &ReadOptions { metres_per_unit, up: None })?;
        lines.push(format!("{name}: {}", describe(path, &form.to_string(), &read.motion)));
        notes.extend(read.remarks.iter().map(|it| format!("{name}: {it}")));
        let about = json!({
            "file": path.display().to_string(), "form": form.to_string(), "points": read.motion.labels.len(),
            "frames": read.motion.n_frames(), "rate_hz": read.motion.rate_hz,
        });
        Ok((read.motion, about))
    };
    let (a, about_a) = open("A", &args.a, args.metres_per_unit_a)?;
    let (b, about_b) = open("B", &args.b, args.metres_per_unit_b)?;
    let pairing = args.pairing.map(|it| match it {
        PairingArg::Names => Pairing::Names,
        PairingArg::Nearest => Pairing::Nearest,
    });
    let options = CompareOptions { pairing, align: args.align, most_shift_s: args.shift.unwrap_or(0.0) };
    let found = compare(&a, &b, &options).map_err(|it| harmless(&it))?;
    notes.extend(found.remarks.iter().cloned());
    if args.pairing.is_none() && found.pairing == Pairing::Names {
        let nearest = compare(&a, &b, &CompareOptions { pairing: Some(Pairing::Nearest), ..options });
        if let Some(median) = nearest.ok().map(|it| it.all.median).filter(|it| 2.0 * it < found.all.median) {
            notes.push(format!(
                "by place (`--match nearest`) the median is {:.3} mm: equal names need not mean the same point, since trackers number targets as they come",
                1e3 * median
            ));
        }
    }
    let is_met = args.within.is_none_or(|it| found.all.p95 * 1e3 <= it);
    let figures = figures(&found, [about_a, about_b], &notes);
    let to_stdout = args.json.as_ref().is_some_and(|it| it.as_os_str() == "-");
    match &args.json {
        Some(_) if to_stdout => say(&format!("{figures:#}\n")),
        Some(path) => write_whole(path, format!("{figures:#}\n").as_bytes(), true)?,
        None => {}
    }
    if !to_stdout {
        say(&harmless_lines(&words(&found, args, &lines, &notes)));
    }
    if !is_met {
        eprintln!(
            "not met: 95 % of all samples are within {:.3} mm, expected {} mm",
            found.all.p95 * 1e3,
            args.within.unwrap_or(f64::NAN)
        );
    }
    Ok(if is_met { exit::DONE } else { exit::UNMET })
}

/// As [`harmless`], but for the ends of lines.
fn harmless_lines(text: &str) -> String {
    text.split('\n').map(harmless).collect::<Vec<_>>().join("\n")
}

/// The table that people read.
fn words(found: &Comparison, args: &CompareArgs, files: &[String], notes: &[String]) -> String {
    let mut text: String = files.iter().map(|it| format!("{it}\n")).collect();
    text.extend(notes.iter().map(|it| format!("note: {it}\n")));
    let how = match found.pairing {
        Pairing::Names => "by name",
        Pairing::Nearest => "by place",
    };
    let percent = |n: usize| 100.0 * n as f64 / found.n_common.max(1) as f64;
    text += &format!(
        "{} points paired {how}; {} of {} common frames compared ({:.0} %)\n",
        found.points.len(),
        found.n_frames,
        found.n_common,
        percent(found.n_frames)
    );
    if args.shift.is_some() {
        text += &format!("shift: {:+.6} s added to B's times\n", found.shift_s);
    }
    if let Some(a_from_b) = &found.a_from_b {
        let (axis, t) = (a_from_b.rotation.scaled_axis().map(f64::to_degrees), a_from_b.translation.vector * 1e3);
        text +=
            &format!("aligned: B turned by {:.3}° and moved by ({:.3}, {:.3}, {:.3}) mm\n", axis.norm(), t.x, t.y, t.z);
    }
    let name = |it: &Distances| match it.name_a == it.name_b {
        true => it.name_a.clone(),
        false => format!("{} = {}", it.name_a, it.name_b),
    };
    let shown: &[Distances] = if args.summary { &[] } else { &found.points };
    let width = shown.iter().map(|it| name(it).chars().count()).max().unwrap_or(0).max(5);
    text += &format!(
        "{:width$}  {:>8}  {:>10}  {:>10}  {:>10}  {:>9}  {:>9}\n",
        "point", "samples", "median mm", "p95 mm", "max mm", "only in A", "only in B"
    );
    let row = |name: &str, it: &Distances| {
        let [median, p95, max] = [it.median, it.p95, it.max]
            .map(|it| if it.is_finite() { format!("{:.3}", it * 1e3) } else { "–".to_owned() });
        format!(
            "{name:width$}  {:>8}  {median:>10}  {p95:>10}  {max:>10}  {:>9}  {:>9}\n",
            it.n, it.n_only[0], it.n_only[1]
        )
    };
    text.extend(shown.iter().map(|it| row(&name(it), it)));
    text += &row("all", &found.all);
    for (file, only) in ["A", "B"].iter().zip(&found.only).filter(|it| !it.1.is_empty()) {
        text += &format!("only in {file}: {}\n", only.join(", "));
    }
    text
}

fn figures(found: &Comparison, about: [Value; 2], notes: &[String]) -> Value {
    // What is no number is null.
    let of = |it: &Distances| {
        json!({
            "samples": it.n, "median_mm": it.median * 1e3, "p95_mm": it.p95 * 1e3, "max_mm": it.max * 1e3,
            "only_in_a": it.n_only[0], "only_in_b": it.n_only[1],
        })
    };
    let point = |it: &Distances| {
        let mut figures = of(it);
        figures["a"] = json!(it.name_a);
        figures["b"] = json!(it.name_b);
        figures
    };
    let [a, b] = about;
    let moved = found.a_from_b.map(|it| {
        let q = it.rotation.coords;
        json!({ "rotation_xyzw": [q.x, q.y, q.z, q.w], "translation_m": [it.translation.x, it.translation.y, it.translation.z] })
    });
    json!({
        "a": a,
        "b": b,
        "pairing": if found.pairing == Pairing::Names { "names" } else { "nearest" },
        "frames_compared": found.n_frames,
        "frames_common": found.n_common,
        "shift_s": found.shift_s,
        "a_from_b": moved,
        "all": of(&found.all),
        "points": found.points.iter().map(point).collect::<Vec<_>>(),
        "only_in_a": found.only[0],
        "only_in_b": found.only[1],
        "notes": notes,
    })
}
