//! `pan_tilt.calibrator`: calibrates the axes of heads from a light that the room tracks and their cameras see [Davis 2002 §4.2, (4)].
//!
//! During the run it stores its inputs; at the end it combines light, picture and setting ([`foveate_calibration::head`]), solves for pose
//! and axes of each head, compares the paper's three models, and writes a calibration that can replace the one
//! it started with. The positions of cameras on heads need not be known, but their optics must be. One light is waved: times at which there are
//! several in the room or in a picture are not used.

mod settings;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use foveate::geometry::pan_tilt::AxisUnits;
use foveate::prelude::*;
use foveate::scene::Calibration;
use foveate_calibration::head::{
    Comparison, Gathered, HeadRecording, LightSample, LitFrame, PositionReport, calibrated_head, compare, picture,
};

pub use settings::{CalibratorSettings, Carrier, Optics, Units};

ports! {
    TARGETS: In<Targets> = each("targets");
    FEATURES: In<Features> = each("features").many();
    REPORT: In<HeadReport> = each("report").many();
}

figures! {
        "head_calibration.heads": count, high, "Heads calibrated" => "heads calibrated";
        "head_calibration.light_samples": count, neither, "Times at which exactly one light was measured in the room";
    "head_calibration.*.camera_frames": count, neither, "Pictures of that head's camera with one light";
        "head_calibration.*.several_lights": count, low, "Pictures not used for more than one light";
        "head_calibration.*.moving": count, low, "Pictures with one light not used because the head moved or had not settled";
        "head_calibration.*.without_light": count, low, "Pictures with one light not used because the light's position in the room was unknown at that time";
        "head_calibration.*.observations": count, high, "Pictures used for the calibration";
    "head_calibration.*.settings": count, high, "Different settings of pan and tilt among them";
    "head_calibration.*.{home,aligned,free}_px.median": px, low, "Error of the model with the home position alone, with aligned and with free axes, over all observations";
    "head_calibration.*.{home,aligned,free}_px.rms": px, low, "The same over the observations that the last model accepts";
        "head_calibration.*.holdout_px.{median,rms}": px, low, "Error at held-out settings" => "error at settings that were held out";
        "head_calibration.*.wrong": count, low, "Observations left out as gross errors";
    "head_calibration.*.noise_factor": ratio, neither, "Errors of accepted observations over their stated standard deviations; 1 is ideal";
    "head_calibration.*.{pan,tilt}_direction_sigma_deg": deg, low, "Standard deviation of the direction of the axis";
    "head_calibration.*.{pan,tilt}_place_sigma_mm": mm, low, "Standard deviation of the place of the axis";
    "head_calibration.*.camera_sigma_mm": mm, low, "Standard deviation of the camera's centre, along its worst direction";
    "head_calibration.*.{pan,tilt}_unit_sigma": ratio, low, "Standard deviation of the device's unit of angle over that unit";
        "head_calibration.*.focal_px": px, neither, "Focal length along rows, where it was estimated";
    "head_calibration.*.focal_sigma": ratio, low, "Standard deviation of the focal length over it, where it was estimated";
        "head_calibration.*.{pan,tilt}_range_deg": deg, high, "Range of the settings of the observations";
}

/// Smallest interval between samples of the light [s].
const LIGHT_STEP_S: f64 = 0.008;
/// Most stored messages of one kind; more than two hours of pictures.
const MOST_KEPT: usize = 1 << 19;

/// Stores messages of heads, their cameras and the light; calibrates the axes at the end.
pub struct Calibrator {
    settings: CalibratorSettings,
    calibration: Arc<Calibration>,
    light: Vec<LightSample>,
    heads: BTreeMap<CameraId, Heard>,
    counts: Counts,
    out: Option<PathBuf>,
}

/// Messages of one head.
#[derive(Default)]
struct Heard {
    recording: HeadRecording,
    next_event: u64,
    /// Pictures with more than one light.
    several: u64,
}

#[derive(Default)]
struct Counts {
    /// Times without a measured light in the room.
    dark: u64,
    /// Times with several lights.
    several: u64,
    left_out: u64,
}

impl Node for Calibrator {
    const TYPE: &'static str = "pan_tilt.calibrator";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Calibrates the axes of pan-tilt heads from a tracked light that their cameras see";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = CalibratorSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: CalibratorSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        if setup.calibration.cameras.is_empty() {
            return Err(ConfigError::node(
                "found no cameras, expected a calibration with the optics of cameras on heads",
            ));
        }
        setup.claim_named_file("file", &settings.file)?;
        setup.claim_named_file("picture", &settings.picture)?;
        Ok(Self {
            calibration: Arc::clone(&setup.calibration),
            light: Vec::new(),
            heads: BTreeMap::new(),
            counts: Counts::default(),
            out: setup.out_dir.clone(),
            settings,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(targets) = io.take(&TARGETS) {
            self.add_targets(&targets.value);
        } else if let Some(features) = io.take(&FEATURES) {
            self.add_features(features.time(), &features.value);
        } else if let Some(report) = io.take(&REPORT) {
            self.add_report(&report.value);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        self.light.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        let light = std::mem::take(&mut self.light);
        report.figure("head_calibration.light_samples", light.len() as f64);
        if self.counts.several > 0 {
            let n = self.counts.several;
            report.remark(format!(
                "at {n} times there were several lights in the room, which are not used: wave a single light"
            ));
        }
        if self.counts.left_out > 0 {
            report.remark(format!(
                "the capture is too long: {} observations at its end are left out",
                self.counts.left_out
            ));
        }
        let mut calibration = (*self.calibration).clone();
        let mut found = Vec::new();
        let heads = std::mem::take(&mut self.heads);
        // A camera that sees the light and is on no head is not meant.
        for (camera, mut messages) in heads.into_iter().filter(|it| !it.1.recording.positions.is_empty()) {
            let Some(named) = self.calibration.cameras.get(usize::from(camera.0)) else { continue };
            let name = named.name.as_str();
            messages.recording.light.clone_from(&light);
            messages.recording.positions.sort_by(|a, b| a.earliest_s.total_cmp(&b.earliest_s));
            messages.recording.camera_frames.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
            let gathered = messages.recording.gather(&self.settings.gathering());
            self.tell_gathered(name, &gathered, messages.several, report);
            match self.solve(name, &gathered, &mut calibration) {
                Ok(comparison) => {
                    tell_found(name, &comparison, report);
                    self.write(&self.settings.picture.replace("{camera}", name), &drawn(name, &comparison), report)?;
                    found.push(name.to_owned());
                }
                Err(why) => report.remark(format!("the head of {name} is not calibrated: {why}")),
            }
        }
        report.figure("head_calibration.heads", found.len() as f64);
        if !found.is_empty() {
            calibration.origin =
                format!("{}; heads found by pan_tilt.calibrator: {}", calibration.origin, found.join(", "));
            self.write(&self.settings.file, &calibration.to_toml(), report)?;
        }
        Ok(())
    }
}

impl Calibrator {
    fn add_targets(&mut self, targets: &Targets) {
        let measured: Vec<&Target> = targets.list.iter().filter(|it| it.provenance == Provenance::Measured).collect();
        let [one] = measured[..] else {
            let count = if measured.is_empty() { &mut self.counts.dark } else { &mut self.counts.several };
            *count += 1;
            return;
        };
        let time_s = targets.time.as_s();
        let track = one.id.0;
        let is_new = |it: &LightSample| it.track != track || (time_s - it.time_s).abs() >= LIGHT_STEP_S;
        if self.light.last().is_none_or(is_new) {
            let (position, velocity, covariance) = (one.position, one.velocity, one.covariance);
            keep(&mut self.light, LightSample { time_s, track, position, velocity, covariance }, &mut self.counts);
        }
    }

    fn add_features(&mut self, time: Time, features: &Features) {
        let messages = self.heads.entry(features.camera).or_default();
        match features.list[..] {
            [one] => {
                let sigma_px = (0.5 * one.covariance.trace()).max(0.0).sqrt();
                if sigma_px.is_finite() && sigma_px > 0.0 {
                    let camera_frame = LitFrame { time_s: time.as_s(), pixel: one.centre, sigma_px };
                    keep(&mut messages.recording.camera_frames, camera_frame, &mut self.counts);
                }
            }
            [] => {}
            _ => messages.several += 1,
        }
    }

    fn add_report(&mut self, report: &HeadReport) {
        let messages = self.heads.entry(report.camera).or_default();
        for (_, event) in report.since(&mut messages.next_event) {
            if let HeadEvent::Position(HeadPosition { earliest, latest, angles }) = event {
                let position = PositionReport { earliest_s: earliest.as_s(), latest_s: latest.as_s(), angles: *angles };
                keep(&mut messages.recording.positions, position, &mut self.counts);
            }
        }
    }

    fn tell_gathered(&self, name: &str, gathered: &Gathered, several: u64, report: &mut Report) {
        let figures = [
            ("camera_frames", gathered.camera_frames as f64),
            ("several_lights", several as f64),
            ("moving", gathered.moving as f64),
            ("without_light", gathered.without_light as f64),
            ("observations", gathered.observations.len() as f64),
            ("settings", gathered.settings as f64),
        ];
        figures
            .into_iter()
            .for_each(|(figure, value)| report.figure(format!("head_calibration.{name}.{figure}"), value));
    }

    /// Writes the result into `calibration`.
    fn solve(&self, name: &str, gathered: &Gathered, calibration: &mut Calibration) -> Result<Comparison, String> {
        let Some(optics) = self.calibration.camera(name) else {
            return Err("found no optics of its camera, expected a calibration with them".to_owned());
        };
        if gathered.observations.is_empty() {
            let Gathered { camera_frames, moving, without_light, .. } = gathered;
            return Err(format!(
                "found {camera_frames} pictures with one light, {moving} of them while the head moved or had not settled and {without_light} at times at \
                 which the light's position in the room was unknown; expected pictures at rest with a known light"
            ));
        }
        let angles_in = self.angles_in(name)?;
        // What reports say are angles by the calibration's units.
        let stated = self.calibration.head(name).map(|it| it.model);
        let stated = stated.as_ref().map(|it| (it, [AxisUnits::RADIANS; 2]));
        let found = compare(optics, stated, &gathered.observations, &self.settings.solving());
        let found = found.map_err(|it| it.to_string())?;
        calibrated_head(calibration, name, &found.calibration, angles_in)
            .ok_or("found no such camera in the calibration")?;
        Ok(found)
    }

    /// Units that `pan_tilt.head` used for its angles: by the calibration, or by the data sheet where that states none.
    fn angles_in(&self, name: &str) -> Result<[AxisUnits; 2], String> {
        let stated = self.calibration.heads.0.get(name).map(|it| it.units);
        let by_sheet = self
            .settings
            .units_per_deg
            .map(|it| it.map(|units| AxisUnits { rad_per_unit: 1f64.to_radians() / units, at_rest: 0.0 }));
        match (stated.filter(|it| *it != [AxisUnits::DEGREES; 2]), by_sheet) {
            (Some(units), _) | (None, Some(units)) => Ok(units),
            // Left unsaid as it was.
            (None, None) if self.settings.units == Units::Known => Ok([AxisUnits::DEGREES; 2]),
            (None, None) => Err(format!(
                "its units are to be estimated, but neither `units_per_deg` nor `[head.{name}]` gives an initial value"
            )),
        }
    }

    fn write(&self, file: &str, text: &str, report: &mut Report) -> Result<(), NodeError> {
        let Some(folder) = &self.out else { return Ok(()) };
        std::fs::write(folder.join(file), text)
            .map_err(|error| NodeError::input(format_args!("`{file}` cannot be written: {error}")))?;
        report.file(file);
        Ok(())
    }
}

fn keep<T>(list: &mut Vec<T>, item: T, counts: &mut Counts) {
    if list.len() < MOST_KEPT {
        list.push(item);
    } else {
        counts.left_out += 1;
    }
}

fn drawn(name: &str, comparison: &Comparison) -> String {
    let n = comparison.calibration.residuals.len();
    picture(comparison, &format!("The head of {name}: errors of {n} observations under three models"))
}

fn tell_found(name: &str, comparison: &Comparison, report: &mut Report) {
    let found = &comparison.calibration;
    let mut figure = |what: &str, value: f64| report.figure(format!("head_calibration.{name}.{what}"), value);
    for (model, (_, fit)) in ["home", "aligned", "free"].into_iter().zip(comparison.models()) {
        figure(&format!("{model}_px.median"), fit.map_or(f64::NAN, |it| it.median_px));
        figure(&format!("{model}_px.rms"), fit.map_or(f64::NAN, |it| it.rms_px));
    }
    figure("wrong", found.right.iter().filter(|it| !**it).count() as f64);
    figure("noise_factor", found.noise_factor);
    figure("holdout_px.median", found.holdout.map_or(f64::NAN, |it| it.median_px));
    figure("holdout_px.rms", found.holdout.map_or(f64::NAN, |it| it.rms_px));
    for (axis, sigma) in [("pan", found.covariance.pan()), ("tilt", found.covariance.tilt())] {
        figure(&format!("{axis}_direction_sigma_deg"), sigma.direction.to_degrees());
        figure(&format!("{axis}_place_sigma_mm"), 1e3 * sigma.place);
    }
    let centre = found.covariance.centre(&found.head).symmetric_eigenvalues().max().max(0.0).sqrt();
    figure("camera_sigma_mm", 1e3 * centre);
    for (axis, sigma) in ["pan", "tilt"].into_iter().zip(found.covariance.units()) {
        figure(&format!("{axis}_unit_sigma"), sigma);
    }
    if found.focal_sigma > 0.0 {
        figure("focal_px", found.head.at_rest.intrinsics.focal[0]);
        figure("focal_sigma", found.focal_sigma);
    }
    for (axis, range) in ["pan", "tilt"].into_iter().zip(found.ranges) {
        figure(&format!("{axis}_range_deg"), range.to_degrees());
    }
}
