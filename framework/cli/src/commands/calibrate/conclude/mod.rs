//! The end of `foveate calibrate`: files, report, and what happens to the older calibration.

use std::collections::BTreeMap;
use std::path::Path;

use foveate_calibration::checks::{Checks, Level};
use foveate_calibration::comparison::Comparison;
use foveate_calibration::convergence::{ConvergenceOptions, convergence};
use foveate_calibration::network::{Origin, SolvedNetwork};
use foveate_calibration::quality::quality;
use foveate_calibration::recording::Recording;
use foveate_calibration::report::{self, Grade, ReportInput};
use foveate_geometry::Camera;
use foveate_scene::{Calibration, Draft, Head, NamedCamera, natural_order};
use serde_json::{Map, Value};

use super::{CalibrateArgs, INLIER_PX, Optics};
use crate::calibrate::advice;
use crate::calibrate::boards;
use crate::calibrate::capture::{self, Captured};
use crate::calibrate::{figures, words};
use crate::output::say;
use crate::{exit, interrupt, results};

/// Remarks beside the calibration itself.
#[derive(Debug, Default)]
pub(super) struct More {
    pub(super) words: String,
    pub(super) figures: BTreeMap<String, f64>,
    pub(super) is_board: bool,
    pub(super) older: Option<Calibration>,
    /// Whether the older calibration knows where cameras stand.
    pub(super) has_older_poses: bool,
    /// Whether the older calibration was adjusted, so that its world is that of the new one.
    pub(super) is_adjusted: bool,
}

impl More {
    /// The target that was seen, in words: a board, a wand, a light.
    fn told(&self, text: &str) -> String {
        if self.is_board { boards::of_board(text) } else { text.to_owned() }
    }

    pub(super) fn add(&mut self, beside: Result<Comparison, String>, path: &Path) {
        let path = path.display().to_string();
        match beside {
            Ok(beside) => {
                self.words += &format!("\n{}", beside.describe(&path));
                self.figures.extend(beside.figures());
            }
            Err(reason) => self.words += &format!("\n{path} cannot be compared: {reason}\n"),
        }
    }
}

/// Writes all results and reports the verdict.
pub(super) fn conclude(
    args: &CalibrateArgs,
    older: &Path,
    folder: &Path,
    captured: &Captured,
    room: &SolvedNetwork,
    checks: &Checks,
    more: &More,
) -> Result<u8, String> {
    let recording: &Recording = &captured.recording;
    let method = match more.is_board {
        true => "a board",
        false if args.wand_mm.is_some() => "a waved wand",
        false => "one waved light",
    };
    let origin = Origin {
        method: format!("foveate calibrate {}: {method}", env!("CARGO_PKG_VERSION")),
        date: None,
        sources: vec![args.rig.display().to_string()],
        note: format!("calibrated with {}", args.rig.display()),
    };
    let mut calibration = room.solved.to_calibration(origin).map_err(|error| format!("error: {error}"))?;
    let carried = more.older.as_ref().map(|older| {
        // Left out on purpose, in a room whose origin, axes and scale were told: they stand where they stood.
        let is_left_out = args.cameras.is_some() && (args.floor_stops || !args.l_frame.is_empty());
        carry_over(&mut calibration, older, more.is_adjusted || is_left_out)
    });
    let carried = carried.unwrap_or_default();
    let text = calibration.to_toml();
    let write =
        |path: &Path, bytes: &str| results::write_whole(path, bytes.as_bytes()).map_err(|it| format!("error: {it}"));
    write(&folder.join("calibration.toml"), &text)?;
    let mut figures = figures::figures(room);
    figures.extend(more.figures.clone());
    figures.extend(held_out_by_camera(checks));
    let mut figures: Map<String, Value> =
        figures.into_iter().map(|(name, value)| (name, results::number(value))).collect();
    figures.insert("verdict".to_owned(), Value::String(checks.verdict.level.to_string()));
    figures.insert("diagnoses".to_owned(), figures::diagnoses(checks));
    let summary = Value::Object(interrupt::told(figures, interrupt::caught().is_some()));
    write(&folder.join("summary.json"), &format!("{summary:#}\n"))?;
    write(&folder.join("verdict.txt"), &more.told(&checks.to_string()))?;
    let mut files = vec!["calibration.toml", "summary.json", "verdict.txt", capture::OBSERVATIONS];
    if args.report {
        write(&folder.join("report.html"), &more.told(&page(args, room, checks, &calibration, recording)))?;
        files.push("report.html");
    }
    say(&more.told(&words::describe(room, recording)));
    say(&more.words);
    if !carried.kept.is_empty() {
        say(&format!("kept as the older calibration has them: {}\n", carried.kept.join(", ")));
    }
    say(&more.told(&format!("\n{checks}\n")));
    let is_redo = checks.verdict.level == Level::Redo;
    let never_together = is_redo && words::never_together(recording).is_some();
    let asked = advice::Asked { never_together, ..asked(args, more.is_board) };
    for command in advice::commands(&asked, &checks.candidates) {
        say(&format!("{command}\n"));
    }
    if args.write {
        let worse = if more.has_older_poses {
            worse_than_older(room, &calibration, more.older.as_ref(), args.inlier_px)
        } else {
            None
        };
        say(&replace(older, &text, checks, &carried.lost, worse)?);
    }
    say(&format!("results: {}/\n  {}\n", folder.display(), files.join("  ")));
    Ok(if checks.verdict.level == Level::Redo { exit::REDO } else { exit::DONE })
}

/// Medians of the held-out observations of each camera, and the share of its observations that were rejected.
fn held_out_by_camera(checks: &Checks) -> BTreeMap<String, f64> {
    let mut figures = BTreeMap::new();
    for (camera, [_, held_out]) in checks.cameras.iter().zip(&checks.fit.by_camera) {
        let [used, held, rejected] = camera.observations.map(|it| it as f64);
        figures.insert(format!("holdout_px.median[{}]", camera.name), held_out.unwrap_or(f64::NAN));
        figures.insert(format!("rejected_share[{}]", camera.name), rejected / (used + held + rejected).max(1.0));
    }
    figures
}

/// What of `args` any further command has to say again.
fn asked(args: &CalibrateArgs, is_board: bool) -> advice::Asked {
    let option = |name: &str, it: Option<String>| it.map(|it| format!("--{name} {}", quoted(&it)));
    let each = |name: &str, list: &[String]| -> Vec<String> {
        list.iter().map(|it| format!("--{name} {}", quoted(it))).collect()
    };
    let flag = |name: &str, is_set: bool| is_set.then(|| format!("--{name}"));
    let single = [
        option("inlier-px", (args.inlier_px != INLIER_PX).then(|| args.inlier_px.to_string())),
        option("from", args.from.clone()),
        option("cameras", args.cameras.clone()),
        option("wand-mm", args.wand_mm.map(|it| it.to_string())),
        flag("floor-stops", args.floor_stops),
        option("floor-height-mm", args.floor_height_mm.map(|it| it.to_string())),
        option("plumb", args.plumb.clone()),
        flag("upright", args.upright),
    ];
    let mut kept: Vec<String> = single.into_iter().flatten().collect();
    kept.extend(each("distance", &args.distance));
    kept.extend(each("l-frame", &args.l_frame));
    kept.extend(each("falling", &args.falling));
    kept.extend(args.board.options());
    advice::Asked {
        rig: quoted(&args.rig.display().to_string()),
        from_nothing: args.from_nothing,
        unsynchronised: args.unsynchronised,
        max_offset_s: args.max_offset,
        optics: args.optics.map(Optics::name),
        kept,
        is_light: args.wand_mm.is_none() && !is_board,
        never_together: false,
    }
}

/// As a shell takes it for one word.
fn quoted(text: &str) -> String {
    let is_plain = |it: char| it.is_alphanumeric() || "-_./:=,@+%".contains(it);
    if !text.is_empty() && text.chars().all(is_plain) {
        text.to_owned()
    } else {
        format!("'{}'", text.replace('\'', "'\\''"))
    }
}

/// By what `newer` is worse than the older calibration on the same observations.
fn worse_than_older(
    room: &SolvedNetwork,
    newer: &Calibration,
    older: Option<&Calibration>,
    inlier_px: f64,
) -> Option<String> {
    let of = |calibration: Option<&Calibration>| {
        let cameras: Vec<Option<Camera>> =
            room.solved.cameras.iter().map(|it| calibration?.camera(&it.name).cloned()).collect();
        quality(&room.solved, &cameras, inlier_px)
    };
    of(Some(newer)).worse_than(&of(older))
}

fn page(
    args: &CalibrateArgs,
    room: &SolvedNetwork,
    checks: &Checks,
    calibration: &Calibration,
    recording: &Recording,
) -> String {
    let grade = match checks.verdict.level {
        Level::Good => Grade::Good,
        Level::Usable => Grade::Usable,
        Level::Redo => Grade::Redo,
    };
    let rejected: Vec<String> = words::left_out(room, recording);
    let both = if args.alternating { convergence(&room.solved, &ConvergenceOptions::default()) } else { None };
    report::html(&ReportInput {
        title: &format!("Calibration of {}", args.rig.display()),
        verdict: Some(report::Verdict { grade, sentences: &checks.verdict.sentences, more: checks.verdict.more }),
        solved: &room.solved,
        unit: checks.unit,
        convergence: both.as_ref(),
        provenance: calibration.provenance.as_ref(),
        rejected: &rejected,
    })
}

/// Puts the calibration in place of the one that the rig names, which is kept beside it.
fn replace(
    older: &Path,
    text: &str,
    checks: &Checks,
    lost: &[String],
    worse: Option<String>,
) -> Result<String, String> {
    if checks.verdict.level == Level::Redo {
        return Ok(format!("{} stays as it is: the verdict is \"redo\"\n", older.display()));
    }
    if !lost.is_empty() {
        return Ok(format!(
            "{} stays as it is, since {} would be lost: not calibrated; the others stand in the results' calibration.toml\n",
            older.display(),
            lost.join(", ")
        ));
    }
    if let Some(worse) = worse {
        return Ok(format!("{} stays as it is, since the new one is worse: {worse}\n", older.display()));
    }
    let backups = (1..)
        .map(|it| older.with_extension(if it == 1 { "before.toml".to_owned() } else { format!("before-{it}.toml") }));
    let Some(kept) = backups.into_iter().find(|it| !it.exists()) else { unreachable!("there are enough numbers") };
    std::fs::copy(older, &kept).map_err(|error| format!("error: {} cannot be kept: {error}", older.display()))?;
    results::write_whole(older, text.as_bytes()).map_err(|it| format!("error: {it}"))?;
    Ok(format!("{} is replaced; the one before is {}\n", older.display(), kept.display()))
}

/// Refuses `--write` where it would put a file of ours in place of another program's.
pub(super) fn check_writable(older: &Path) -> Result<(), String> {
    match Draft::is_ours(older) {
        true => Ok(()),
        false => Err(format!(
            "error: --write would replace {}, which is not a calibration file of ours; name the results' calibration.toml in the rig instead",
            older.display()
        )),
    }
}

/// Clocks that were not estimated stay as they were, as do the frame rates of those that were, the heads, and where the older calibration was
/// adjusted, or its room is estimated again, cameras that were not found. Names of these, and of what is lost.
fn carry_over(calibration: &mut Calibration, older: &Calibration, is_same_room: bool) -> CarriedOver {
    let missing = older.cameras.iter().filter(|it| calibration.camera(&it.name).is_none());
    let missing: Vec<NamedCamera> = missing.cloned().collect();
    let names = missing.iter().map(|it| it.name.clone()).collect();
    let mut carried = match is_same_room {
        true => CarriedOver { kept: names, lost: Vec::new() },
        false => CarriedOver { kept: Vec::new(), lost: names },
    };
    for camera in missing.into_iter().filter(|_| is_same_room) {
        let uncertainty = older.uncertainties.get(&camera.name).cloned();
        calibration.uncertainties.extend(uncertainty.map(|it| (camera.name.clone(), it)));
        calibration.cameras.push(camera);
    }
    // Cameras are looked up by name in their order.
    calibration.cameras.sort_by(|a, b| natural_order(&a.name, &b.name));
    for (name, clock) in &older.clocks.0 {
        if calibration.camera(name).is_some() {
            let kept = calibration.clocks.0.entry(name.clone()).or_insert_with(|| *clock);
            kept.frame_rate_hz = kept.frame_rate_hz.or(clock.frame_rate_hz);
        }
    }
    for (name, head) in &older.heads.0 {
        // Its axes stand in the space of the camera, wherever that is now, but in the older unit.
        if calibration.length_unit != older.length_unit {
            carried.lost.push(format!("the head of {name} (in another unit of length)"));
        } else if let Some(camera) = calibration.camera(name) {
            // How well it is known was told together with the camera at rest, and goes with that.
            let covariance = head.covariance.clone().filter(|_| older.camera(name) == Some(camera));
            calibration.heads.0.insert(name.clone(), Head { covariance, ..head.clone() });
        }
    }
    carried
}

/// Cameras of the older calibration that were not calibrated.
#[derive(Debug, Default)]
struct CarriedOver {
    /// They stand in the new one as they stood in the older.
    kept: Vec<String>,
    /// They do not stand in the new one.
    lost: Vec<String>,
}

#[cfg(test)]
mod tests;
