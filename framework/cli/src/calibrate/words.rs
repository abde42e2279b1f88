//! Describes a solved camera network in words, for the terminal.

use std::fmt::Write;

use foveate_calibration::clocks::{ClockError, ClockStatus};
use foveate_calibration::network::{
    NotSynchronised, SolvedNetwork, SynchronisedNetwork, in_names, keep_distinct, swapped as swapped_labels,
};
use foveate_calibration::recording::{CameraFrame, Recording};
use foveate_calibration::solved::{FixedFreedoms, ObservationRole, Solved, SolvedCamera};
use foveate_calibration::words::{counted, signed};
use foveate_estimation::statistics::Summary;
use foveate_geometry::{CameraStatus, OpticHeld};
use foveate_scene::Fixed;

use super::figures::{errors, figures};

/// Cameras with more than that are in the files only.
const SHOWN: usize = 64;
/// Labels that show another point are listed one by one up to this many.
const SWAPPED_SHOWN: usize = 8;
/// Optics that stay as given are listed one by one up to this many cameras.
const HELD_SHOWN: usize = 6;

/// The results, camera by camera.
pub fn describe(network: &SolvedNetwork, recording: &Recording) -> String {
    let solved = &network.solved;
    let figure = figures(network);
    let value = |name: &str| figure.get(name).copied().unwrap_or(f64::NAN);
    let mut text = String::new();
    let _ = writeln!(
        text,
        "calibrated {:.0} of {:.0} cameras from {:.0} of {:.0} moments",
        value("cameras_calibrated"),
        value("cameras"),
        value("frames_used"),
        value("frames")
    );
    let held_out = match [value("holdout_px.median"), value("holdout_px.p90")] {
        [median, p90] if median.is_finite() => format!("moments held out {median:.2} px, {p90:.2} px"),
        _ => "no moment was held out".to_owned(),
    };
    let _ = writeln!(
        text,
        "  re-projection {:.2} px median, {:.2} px at 90 %; {held_out}; noise of a coordinate {:.2} px",
        value("reprojection_px.median"),
        value("reprojection_px.p90"),
        network.sigma_px
    );
    let unit = if solved.fixed.scale.is_some() { "mm" } else { "mu" };
    let width = solved.cameras.iter().map(|it| it.name.chars().count()).max().unwrap_or(0).max(6);
    let _ = writeln!(text, "\n  {:width$}  frames  median    p90  held out    focal        centre ±", "camera");
    for (index, camera) in solved.cameras.iter().enumerate().take(SHOWN) {
        if camera.status != CameraStatus::Calibrated {
            let _ = writeln!(text, "  {:width$}  not calibrated: {}", camera.name, in_names(&camera.status, recording));
            continue;
        }
        let of = |role| Summary::of(&errors(solved, role, Some(index)));
        let (used, kept) = (of(ObservationRole::Used), of(ObservationRole::HeldOut));
        let px = |it: Option<f64>| it.map_or("-".to_owned(), |it| format!("{it:.2} px"));
        let _ = writeln!(
            text,
            "  {:width$}  {:6}  {:>7} {:>7}  {:>8}  {:>13}  {}",
            camera.name,
            used.map_or(0, |it| it.count) + kept.map_or(0, |it| it.count),
            px(used.map(|it| it.median)),
            px(used.map(|it| it.p90)),
            px(kept.map(|it| it.median)),
            focal(camera),
            centre_sigma(camera, unit),
        );
    }
    if solved.cameras.len() > SHOWN {
        let _ = writeln!(text, "  … and {} more in summary.json", solved.cameras.len() - SHOWN);
    }
    if solved.fixed.scale.is_none() {
        text += "  (1000 mu are one unit of length: nothing fixes the scale)\n";
    }
    text.push('\n');
    text += &fixed(&solved.fixed);
    for line in left_out(network, recording) {
        text += &line;
        text.push('\n');
    }
    text
}

/// Sentences about what was not used or not found beyond single observations, and about what moved.
pub fn left_out(network: &SolvedNetwork, recording: &Recording) -> Vec<String> {
    let solved = &network.solved;
    let unit = if solved.fixed.scale.is_some() { "mm" } else { "mu" };
    let mut list = Vec::new();
    for camera in solved.cameras.iter().filter(|it| it.status != CameraStatus::Calibrated) {
        list.push(format!("left out: {}: {}", camera.name, in_names(&camera.status, recording)));
    }
    for moved in &network.moved {
        list.push(format!(
            "moved: {} by {:.1} {unit} and {:.1} mrad; under the older calibration it was {:.1} px off",
            solved.cameras[moved.camera].name,
            1e3 * moved.distance,
            1e3 * moved.angle_rad,
            moved.before_px
        ));
    }
    list.extend(held(network));
    list.extend(set_aside(network));
    list
}

/// What those of `cameras` may have been shown whose pictures mostly hold several spots; `None` where there are none of them.
pub fn several_spots(recording: &Recording, cameras: impl Iterator<Item = usize>) -> Option<String> {
    let mut several = cameras.filter_map(|it| Some((it, usual_spots(recording, it).filter(|n| *n > 1)?)));
    let (first, n) = several.next()?;
    let others = match several.count() {
        0 => String::new(),
        1 => " and of 1 more camera".to_owned(),
        others => format!(" and of {others} more cameras"),
    };
    Some(format!(
        "most pictures of {}{others} hold {n} spots: a wand (--wand-mm)? a board (--chessboard, --charuco)? or lamps",
        recording.cameras[first].name
    ))
}

/// How many labels there are.
pub fn n_labels(recording: &Recording) -> usize {
    let labels = recording.camera_frames.iter().flat_map(|it| &it.spots).filter_map(|it| it.label);
    labels.collect::<std::collections::BTreeSet<u32>>().len()
}

/// Observations that show another point than the one whose label they have, camera by camera.
pub fn swapped(recording: &Recording, solved: &Solved, names: &[String]) -> Vec<String> {
    let name = |label: u32| names.get(label as usize).cloned().unwrap_or_else(|| format!("label {label}"));
    let found = swapped_labels(recording, solved);
    let one = |it: &foveate_calibration::network::Swapped| {
        let (labelled, shows) = (name(it.labelled), name(it.shows));
        let camera = &recording.cameras[it.camera].name;
        format!("labels of {camera}: {} of {} of {labelled} show {shows}; they were relabelled", it.count, it.of)
    };
    let mut lines: Vec<String> = found.iter().take(SWAPPED_SHOWN).map(one).collect();
    if found.len() > SWAPPED_SHOWN {
        let rest: usize = found[SWAPPED_SHOWN..].iter().map(|it| it.count).sum();
        lines.push(format!(
            "labels of other points and cameras: {} more show the point of the other side",
            counted(rest, "observation")
        ));
    }
    lines
}

/// How many distinct spots a picture of `camera` holds in the median, of those that hold any.
fn usual_spots(recording: &Recording, camera: usize) -> Option<usize> {
    let of_camera = recording.camera_frames.iter().filter(|it| it.camera == camera && !it.spots.is_empty());
    let count = |camera_frame: &CameraFrame| {
        let mut spots = camera_frame.spots.clone();
        keep_distinct(&mut spots);
        spots.len()
    };
    let mut counts: Vec<usize> = of_camera.map(count).collect();
    counts.sort_unstable();
    counts.get(counts.len() / 2).copied()
}

/// The status of each camera's clock.
pub fn clocks(found: &SynchronisedNetwork, recording: &Recording) -> Vec<String> {
    let cameras = found.network.solved.cameras.iter().zip(&found.clocks);
    let one = |(camera, status): (&SolvedCamera, &ClockStatus)| match (status, camera.clock) {
        (ClockStatus::Found { .. }, Some(clock)) => format!(
            "clock of {}: {} ms to that of {}, ± {:.2} ms; {status}",
            camera.name,
            signed(1e3 * clock.offset_s, 2),
            recording.cameras[found.reference].name,
            1e3 * clock.sigma_s
        ),
        _ => format!("clock of {}: {}", camera.name, clock_in_names(status, recording)),
    };
    cameras.map(one).collect()
}

/// `status` with the names of the cameras it speaks of, and the flag that may help.
fn clock_in_names(status: &ClockStatus, recording: &Recording) -> String {
    status.sentence(|it| recording.name(it)) + further(status)
}

/// What to say where clocks may be further apart than was tried.
fn further(status: &ClockStatus) -> &'static str {
    if status.may_be_further_off() { "; if it is further off than --max-offset, raise that" } else { "" }
}

/// Why a calibration of unsynchronised cameras failed.
pub fn not_synchronised(fault: &NotSynchronised, recording: &Recording) -> String {
    match fault {
        NotSynchronised::Clocks(fault) => no_clocks(fault, recording),
        NotSynchronised::Room(fault) => fault.to_string(),
    }
}

/// Pictures this close together count as taken together [s].
const TOGETHER_S: f64 = 0.5e-3;

/// A remark where less than half of the pictures were taken together with one of another camera.
pub fn never_together(recording: &Recording) -> Option<String> {
    let mut of_frames: Vec<(f64, usize)> =
        recording.camera_frames.iter().filter(|it| !it.spots.is_empty()).map(|it| (it.time_s, it.camera)).collect();
    of_frames.sort_by(|a, b| a.0.total_cmp(&b.0));
    let together = |at: usize| {
        let (time_s, camera) = of_frames[at];
        let is_other = |it: &&(f64, usize)| it.1 != camera;
        let near = |it: &&(f64, usize)| (it.0 - time_s).abs() <= TOGETHER_S;
        of_frames[at + 1..].iter().take_while(near).any(|it| is_other(&it))
            || of_frames[..at].iter().rev().take_while(near).any(|it| is_other(&it))
    };
    let n = (0..of_frames.len()).filter(|it| together(*it)).count();
    let is_alone = of_frames.iter().all(|it| it.1 == of_frames[0].1);
    (2 * n < of_frames.len() && !is_alone).then(|| {
        format!(
            "{n} of {} pictures were taken within 0.5 ms of one of another camera: if the cameras are not synchronised, use --unsynchronised",
            of_frames.len()
        )
    })
}

/// Why no clocks were found.
pub fn no_clocks(fault: &ClockError, recording: &Recording) -> String {
    fault.sentence(|it| recording.name(it), |status| further(status).to_owned())
}

fn focal(camera: &SolvedCamera) -> String {
    let focal = camera.camera.intrinsics.focal[0];
    match &camera.covariance {
        Some(it) if camera.freed.focal => format!("{focal:.1} ± {:.1}", it.optics.focal * focal),
        _ => format!("{focal:.1}"),
    }
}

fn centre_sigma(camera: &SolvedCamera, unit: &str) -> String {
    match &camera.covariance {
        Some(it) => format!("{:.2} {unit}", 1e3 * it.centre.symmetric_eigenvalues().max().max(0.0).sqrt()),
        None => "open".to_owned(),
    }
}

/// What fixes scale, vertical and origin, and what does not.
pub fn fixed(fixed: &FixedFreedoms) -> String {
    let one = |what: &str, it: &Option<Fixed>, unit: &str, factor: f64, how: &str| match it {
        Some(Fixed { by, sigma: Some(sigma) }) => format!("{what}: by {by}, ± {:.2} {unit}\n", factor * sigma),
        Some(Fixed { by, sigma: None }) => format!("{what}: by {by}\n"),
        None => format!("{what}: not fixed ({how})\n"),
    };
    let small = if fixed.scale.is_some() { "mm" } else { "mu" };
    one("scale", &fixed.scale, "%", 100.0, "give --wand-mm or --distance")
        + &one("vertical", &fixed.gravity, "mrad", 1e3, "give --floor-stops, --falling, --plumb or --upright")
        + &one("origin", &fixed.origin, small, 1e3, "give --floor-stops or --l-frame")
}

/// Optics that were to be found and stay as given.
fn held(network: &SolvedNetwork) -> Vec<String> {
    let with = network.held.iter().enumerate().filter(|it| !it.1.is_empty());
    let n = with.clone().count();
    let one = |(camera, list): (usize, &Vec<OpticHeld>)| {
        let reasons: Vec<String> = list.iter().map(OpticHeld::to_string).collect();
        format!("optics of {}: {}", network.solved.cameras[camera].name, reasons.join("; "))
    };
    let mut lines: Vec<String> = with.take(HELD_SHOWN).map(one).collect();
    if n > HELD_SHOWN {
        lines.push(format!("optics of {} stay as given in part", counted(n - HELD_SHOWN, "more camera")));
    }
    lines
}

/// What of the pictures was not used, and why.
fn set_aside(network: &SolvedNetwork) -> Vec<String> {
    let mut lines = Vec::new();
    for (camera, it) in network.solved.cameras.iter().zip(&network.cleaning) {
        let mut parts = Vec::new();
        let mut part = |n: usize, one: &str, what: &str| {
            parts.extend((n > 0).then(|| format!("{} {what}", counted(n, one))));
        };
        part(it.unusable, "spot", "outside the picture or without coordinates");
        part(it.written_twice, "spot", "written twice");
        part(it.repeated_times, "picture", "with a repeated time");
        part(it.repeated_pictures, "picture", "identical to the one before");
        part(it.lamps.len(), "place", "with a light that does not move");
        if !parts.is_empty() {
            let lamps: Vec<String> =
                it.lamps.iter().take(3).map(|it| format!("({:.0}, {:.0})", it[0], it[1])).collect();
            let at = if lamps.is_empty() { String::new() } else { format!(" at {} px", lamps.join(", ")) };
            lines.push(format!("set aside of {}: {}{at}", camera.name, parts.join(", ")));
        }
    }
    lines
}
