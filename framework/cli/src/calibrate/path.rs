//! `foveate calibrate RIG --path FILE`: cameras from a path in space that another system measured, each with a clock of its own.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use foveate_calibration::checks::Level;
use foveate_calibration::comparison::compare;
use foveate_calibration::network::Origin;
use foveate_calibration::path::table::{self, TableOptions};
use foveate_calibration::path::{self, MeasuredPath, PathCamera, PathNetwork, PathOptions, PathVerdict};
use foveate_calibration::recording::Recording;
use foveate_calibration::report::{self, Grade, ReportInput};
use foveate_scene::{Calibration, CameraClock, Clocks, Draft};
use serde_json::{Map, Value, json};

use super::capture;
use crate::output::say;
use crate::{exit, results};

/// Command-line arguments about a measured path.
#[derive(Debug, Clone, PartialEq, Default, clap::Args)]
#[command(next_help_heading = "Measured path")]
pub struct PathArgs {
    /// The point's path in space as another system measured it (RTK, total station): CSV or text with time, x, y, z, or lat, lon, height
    #[arg(
        long,
        value_name = "FILE",
        value_hint = clap::ValueHint::FilePath,
        conflicts_with_all = ["wand_mm", "unsynchronised", "alternating", "distance", "floor_stops", "l_frame", "falling", "plumb", "upright", "chessboard", "charuco", "square_mm", "board_floor"]
    )]
    pub path: Option<PathBuf>,
    /// Rows a second, where the file has no times
    #[arg(long, value_name = "HZ", requires = "path", value_parser = rate_hz)]
    pub path_rate: Option<f64>,
    /// Unit of its x, y, z, where the names of the columns state none
    #[arg(long, value_name = "UNIT", requires = "path", default_value = "m", value_parser = ["m", "mm", "cm", "ft"])]
    pub path_unit: Option<String>,
    /// Use its rows from one of its times to another [s]; what lies outside is left for measuring how good the result is
    #[arg(long, value_name = "FROM..UNTIL", requires = "path", value_parser = span)]
    pub path_span: Option<(f64, f64)>,
}

/// Rows a second on the command line.
fn rate_hz(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|it| *it > 0.0 && *it <= 1e6);
    number.ok_or_else(|| format!("found {text}, expected rows a second, a number above 0, to 1000000 [Hz]"))
}

fn span(text: &str) -> Result<(f64, f64), String> {
    let numbers =
        text.split_once("..").and_then(|(from, until)| Some((from.trim().parse().ok()?, until.trim().parse().ok()?)));
    let ordered = numbers.filter(|(from, until): &(f64, f64)| from < until && from.is_finite() && until.is_finite());
    ordered.ok_or_else(|| format!("found {text}, expected FROM..UNTIL in seconds of the path's time, as 12.5..290"))
}

/// The requested path, read before anything is captured.
#[derive(Debug)]
pub struct Asked {
    path: MeasuredPath,
    file: PathBuf,
    notes: Vec<String>,
}

impl PathArgs {
    /// The path, if one is requested.
    ///
    /// # Errors
    /// Sentences for the person.
    pub fn read(&self) -> Result<Option<Asked>, String> {
        let Some(file) = &self.path else { return Ok(None) };
        let fault = |it: &dyn std::fmt::Display| format!("error: the path {}: {it}", file.display());
        let text = foveate_diagnostics::file::read_text(file).map_err(|it| fault(&format!("cannot be read: {it}")))?;
        let metres_per_unit = match self.path_unit.as_deref() {
            Some("mm") => 1e-3,
            Some("cm") => 1e-2,
            Some("ft") => 0.3048,
            _ => 1.0,
        };
        let options = TableOptions { rate_hz: self.path_rate, metres_per_unit };
        let table = table::parse(&text, &options).map_err(|it| fault(&it))?;
        let whole = MeasuredPath::new(&table.rows).map_err(|it| fault(&it))?;
        let path = match self.path_span {
            None => whole,
            Some((from_s, until_s)) => whole.between(from_s, until_s).map_err(|it| {
                let [first, last] = whole.span_s();
                fault(&format!("from {from_s} s to {until_s} s of {first} to {last} s, {it}"))
            })?,
        };
        Ok(Some(Asked { path, file: file.clone(), notes: table.notes }))
    }
}

/// The calibration with clocks that show the sources' own times: offsets and rates of the file are what is to be found.
pub fn without_offsets(draft: &Draft) -> Draft {
    let own = |it: &CameraClock| CameraClock { frame_rate_hz: it.frame_rate_hz, ..CameraClock::default() };
    let clocks = Clocks(draft.calibration.clocks.0.iter().map(|(name, it)| (name.clone(), own(it))).collect());
    Draft { calibration: Calibration { clocks, ..draft.calibration.clone() }, unknown: draft.unknown.clone() }
}

/// What is needed besides the path to finish a calibration.
pub struct Ending<'a> {
    /// The rig.
    pub rig: &'a Path,
    /// The file of the rig's calibration, and what it holds.
    pub older: (&'a Path, &'a Draft),
    /// For the results.
    pub folder: &'a Path,
    /// Another calibration to compare with, and its path.
    pub other: Option<(&'a Calibration, &'a Path)>,
    /// Whether to replace the older calibration.
    pub write: bool,
    /// Whether to draw a page.
    pub report: bool,
}

/// Calibrates.
pub fn solve(asked: &Asked, recording: &Recording, solver_options: &PathOptions) -> PathNetwork {
    path::calibrate(recording, &asked.path, solver_options)
}

/// Writes the results and says how they are; gives the exit code.
///
/// # Errors
/// Sentences for the person.
pub fn conclude(
    network: &PathNetwork,
    asked: &Asked,
    solver_options: &PathOptions,
    ending: &Ending<'_>,
) -> Result<u8, String> {
    let verdict = network.verdict(solver_options);
    let origin = Origin {
        method: format!("foveate calibrate {}: a measured path", env!("CARGO_PKG_VERSION")),
        date: None,
        sources: vec![ending.rig.display().to_string(), asked.file.display().to_string()],
        note: format!("calibrated with {} from {}", ending.rig.display(), asked.file.display()),
    };
    let write = |name: &str, text: &str| {
        results::write_whole(&ending.folder.join(name), text.as_bytes()).map_err(|it| format!("error: {it}"))
    };
    let n_found = network.cameras.iter().filter(|it| it.is_ok()).count();
    let mut files = vec!["summary.json", "verdict.txt", capture::OBSERVATIONS];
    let mut calibration = None;
    if n_found > 0 {
        let mut found = network.solved.to_calibration(origin).map_err(|error| format!("error: {error}"))?;
        keep_frame_rates(&mut found, &ending.older.1.calibration);
        write("calibration.toml", &found.to_toml())?;
        files.insert(0, "calibration.toml");
        calibration = Some(found);
    }
    let beside = ending.other.map(|(other, path)| (compare(&network.solved, other), path.display().to_string()));
    let mut figures = figures(network);
    if let Some((Ok(beside), _)) = &beside {
        figures.extend(beside.figures());
    }
    write("summary.json", &format!("{:#}\n", summary(&figures, &verdict)))?;
    let judged = judged(&verdict);
    write("verdict.txt", &judged)?;
    if let (true, Some(calibration)) = (ending.report, &calibration) {
        write("report.html", &page(network, &verdict, calibration, ending.rig))?;
        files.push("report.html");
    }
    say(&described(network, asked));
    match &beside {
        Some((Ok(it), path)) => say(&format!("\n{}", it.describe(path))),
        Some((Err(reason), path)) => say(&format!("\n{path} cannot be compared: {reason}\n")),
        None => {}
    }
    say(&format!("\n{judged}\n"));
    if ending.write {
        say(&replaced(network, &verdict, calibration.as_ref(), ending)?);
    }
    say(&format!("results: {}/\n  {}\n", ending.folder.display(), files.join("  ")));
    Ok(if verdict.level == Level::Redo { exit::UNMET } else { exit::DONE })
}

/// Clocks that were found keep the frame rate that the older calibration states.
fn keep_frame_rates(calibration: &mut Calibration, older: &Calibration) {
    for (name, clock) in &mut calibration.clocks.0 {
        clock.frame_rate_hz = older.clocks.0.get(name).and_then(|it| it.frame_rate_hz);
    }
}

/// Figures by dotted name.
fn figures(network: &PathNetwork) -> BTreeMap<String, f64> {
    let mut figures = BTreeMap::new();
    figures.insert("cameras".to_owned(), network.cameras.len() as f64);
    figures.insert("cameras_calibrated".to_owned(), network.cameras.iter().filter(|it| it.is_ok()).count() as f64);
    figures.insert("path.start_s".to_owned(), network.path_start_s);
    figures.insert("path.session_from_s".to_owned(), network.session_from_s);
    for (camera, outcome) in network.solved.cameras.iter().zip(&network.cameras) {
        let Ok(it) = outcome else { continue };
        let mut put = |name: &str, value: f64| figures.insert(format!("{name}[{}]", camera.name), value);
        put("path.agreement", it.share());
        put("path.observations", it.of as f64);
        put("path.limit_px", it.limit_px);
        put("reprojection_px.median", it.used_px[0]);
        put("reprojection_px.p90", it.used_px[1]);
        put("holdout_px.median", it.held_out_px[0]);
        put("holdout_px.p90", it.held_out_px[1]);
        put("clock_offset_s", it.offset_s);
        put("clock_sigma_ms", 1e3 * it.offset_sigma_s);
        put("clock_drift", it.drift);
        put("clock_wander_ms", it.wander.map_or(f64::NAN, |it| 1e3 * it[0].abs()));
        put("path.next_best_agreement", it.rival.map_or(0.0, |it| it.1));
        put("centre_sigma_mm", 1e3 * it.centre_sigma_m);
        put("turn_sigma_mrad", 1e3 * it.turn_sigma);
        put("distance_m", it.depth_m);
    }
    figures
}

fn summary(figures: &BTreeMap<String, f64>, verdict: &PathVerdict) -> Value {
    let mut all: Map<String, Value> =
        figures.iter().map(|(name, value)| (name.clone(), results::number(*value))).collect();
    all.insert("verdict".to_owned(), json!(verdict.level.to_string()));
    let diagnoses = verdict.findings.iter().map(|it| {
        json!({
            "camera": it.camera,
            "cause": it.cause,
            "size": results::number(it.size),
            "unit": it.unit,
            "since_s": Value::Null,
            "level": it.level.to_string(),
        })
    });
    all.insert("diagnoses".to_owned(), diagnoses.collect());
    Value::Object(all)
}

fn judged(verdict: &PathVerdict) -> String {
    let mut text = format!("verdict: {}\n", verdict.level);
    for (index, sentence) in verdict.sentences.iter().enumerate() {
        let _ = writeln!(text, "  {}. {sentence}", index + 1);
    }
    text
}

fn described(network: &PathNetwork, asked: &Asked) -> String {
    let n_found = network.cameras.iter().filter(|it| it.is_ok()).count();
    let [from_s, until_s] = asked.path.span_s();
    let mut text = format!(
        "calibrated {n_found} of {} cameras from {}: {} rows of {:.2} Hz, from {from_s:.2} to {until_s:.2} s\n",
        network.cameras.len(),
        asked.file.display(),
        asked.path.len(),
        asked.path.rate_hz()
    );
    asked.notes.iter().for_each(|it| {
        let _ = writeln!(text, "note: {it}");
    });
    let width = network.solved.cameras.iter().map(|it| it.name.chars().count()).max().unwrap_or(0).max(6);
    let _ = writeln!(
        text,
        "\n  {:width$}  agree             median     p90  held out   clock (path − camera)    drift   centre ±   turn ±      next best offset",
        "camera"
    );
    for (camera, outcome) in network.solved.cameras.iter().zip(&network.cameras) {
        match outcome {
            Ok(it) => text += &line(&camera.name, it, width),
            Err(refusal) => {
                let _ = writeln!(text, "  {:width$}  not calibrated: {refusal}", camera.name);
            }
        }
    }
    if n_found > 0 {
        let _ = writeln!(
            text,
            "\nthe session begins when the path's clock shows {:.3} s; the first used row of the path is at {:.3} s of the session",
            network.session_from_s, network.path_start_s
        );
    }
    for (camera, it) in network.cameras.iter().zip(&network.solved.cameras) {
        if let Ok(found) = camera
            && !found.held.is_empty()
        {
            let _ = writeln!(
                text,
                "optics of {}: {} cannot be determined and stays as given",
                it.name,
                found.held.join(", ")
            );
        }
    }
    text
}

fn line(name: &str, it: &PathCamera, width: usize) -> String {
    let rival =
        it.rival.map_or("none".to_owned(), |(offset_s, share)| format!("{:.0} % at {offset_s:+.2} s", 100.0 * share));
    format!(
        "  {name:width$}  {:5.1} % of {:5}  {:6.2}  {:6.2}  {:8.2} px  {:+10.4} s ± {:6.1} ms  {:+5.0} ppm  {:6.3} m  {:5.2} mrad  {rival}\n",
        100.0 * it.share(),
        it.of,
        it.used_px[0],
        it.used_px[1],
        it.held_out_px[0],
        it.offset_s,
        1e3 * it.offset_sigma_s,
        1e6 * it.drift,
        it.centre_sigma_m,
        1e3 * it.turn_sigma
    )
}

fn page(network: &PathNetwork, verdict: &PathVerdict, calibration: &Calibration, rig: &Path) -> String {
    let grade = match verdict.level {
        Level::Good => Grade::Good,
        Level::Usable => Grade::Usable,
        Level::Redo => Grade::Redo,
    };
    let named = network.solved.cameras.iter().zip(&network.cameras);
    let rejected: Vec<String> =
        named.filter_map(|(camera, it)| Some(format!("left out: {}: {}", camera.name, it.as_ref().err()?))).collect();
    report::html(&ReportInput {
        title: &format!("Calibration of {}", rig.display()),
        verdict: Some(report::Verdict { grade, sentences: &verdict.sentences, more: 0 }),
        solved: &network.solved,
        unit: "m",
        convergence: None,
        provenance: calibration.provenance.as_ref(),
        rejected: &rejected,
    })
}

/// Puts the calibration in place of the older one, which is kept beside it, unless something would be lost or become worse.
fn replaced(
    network: &PathNetwork,
    verdict: &PathVerdict,
    calibration: Option<&Calibration>,
    ending: &Ending<'_>,
) -> Result<String, String> {
    let (older, draft) = ending.older;
    let stays = |why: String| Ok(format!("{} stays as it is: {why}\n", older.display()));
    let Some(calibration) = calibration.filter(|_| verdict.level != Level::Redo) else {
        return stays("the verdict is \"redo\"".to_owned());
    };
    let lost: Vec<&str> = draft
        .calibration
        .cameras
        .iter()
        .map(|it| it.name.as_str())
        .filter(|it| calibration.camera(it).is_none())
        .chain(draft.calibration.heads.0.keys().map(String::as_str))
        .collect();
    if !lost.is_empty() {
        return stays(format!("{} would be lost; the others are in the results' calibration.toml", lost.join(", ")));
    }
    for (index, camera) in network.solved.cameras.iter().enumerate() {
        let has_pose = draft.unknown.get(&camera.name).is_none_or(|it| !it.pose);
        let own = network.cameras[index].as_ref().map_or(f64::INFINITY, |it| it.used_px[0].max(it.held_out_px[0]));
        let of_older = draft.calibration.camera(&camera.name).filter(|_| has_pose);
        if let Some(of_older) = of_older.and_then(|it| path::error_of_older(network, index, it))
            && 1.1 * of_older < own
        {
            return stays(format!("for {} it is {of_older:.2} px off, the new one {own:.2} px", camera.name));
        }
    }
    let backups = (1..)
        .map(|it| older.with_extension(if it == 1 { "before.toml".to_owned() } else { format!("before-{it}.toml") }));
    let Some(kept) = backups.into_iter().find(|it| !it.exists()) else { unreachable!("there are numbers enough") };
    std::fs::copy(older, &kept).map_err(|error| format!("error: {} cannot be kept: {error}", older.display()))?;
    results::write_whole(older, calibration.to_toml().as_bytes()).map_err(|it| format!("error: {it}"))?;
    Ok(format!("{} is replaced; the one before is {}\n", older.display(), kept.display()))
}
