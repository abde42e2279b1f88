//! `led.clocks`: the offsets between the clocks of unsynchronised cameras, from their views of one moving target.
//!
//! Only the cameras' poses and lines of sight are needed. A search over all offsets and rates for
//! each pair of cameras comes first ([`search`](mod@search)), then all cameras together ([`joint`]).

pub mod bearings;
pub mod joint;
pub mod search;
#[cfg(test)]
mod tests;

use std::path::PathBuf;

use foveate::geometry::Camera;
use foveate::prelude::*;
use foveate::scene::clocks::{CameraClock, Clocks};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use bearings::{Bearing, Bearings};
use joint::{Link, Solution, solve};
use search::{SearchOptions, search};

ports! {
    FEATURES: In<Features> = each("features").many();
}

figures! {
        "clocks.pairs": count, high, "Pairs of cameras whose clocks were linked; pairs that contradict the others are left out";
    "clocks.pairs_contradicting": count, low, "Pairs that contradicted the others and were left out";
    "clocks.miss_mrad.median": mrad, low, "Angle by which lines of sight of two cameras miss one another under the clocks found";
        "clocks.pictures_with_several": count, low, "Pictures left out for more than one point, where the target is ambiguous";
        "clocks.offset_s.*": s, neither, "Reading of the camera's clock when the reference's is 0";
        "clocks.rate.*": ratio, neither, "Rate of the camera's clock relative to the reference's";
    "clocks.sigma_ms.*": ms, low, "Standard deviation of the offset";
    "clocks.sigma_rate.*": ratio, low, "Standard deviation of the rate";
    "clocks.error_ms.*": ms, neither, "With truth: error of the camera's clock in the middle of its bearings, signed; 0 is ideal";
    "clocks.error_max_ms(.*)": ms, low, "With truth: largest error at the first and last bearing, of a camera, and of all" => "clocks off the truth, at most";
}

/// Most bearings of one camera: an hour at 280 Hz. More are left out and counted.
const MAX_BEARINGS: usize = 1_000_000;

/// Settings of [`ClocksNode`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ClocksSettings {
    /// The camera whose clock is the session's. Empty: the first one of the calibration [–]
    pub reference: String,
    /// Largest offset between clocks, in both directions [s]
    #[schemars(range(min = 1.0, max = 3600.0))]
    pub max_offset_s: f64,
    /// Largest difference between their rates [%]
    #[schemars(range(min = 0.0, max = 5.0))]
    pub max_rate_percent: f64,
    /// Step of the offsets that are tried; the target should not rotate any camera's line of sight by more than `tolerance_deg` in it [ms]
    #[schemars(range(min = 1.0, max = 10000.0))]
    pub step_ms: f64,
    /// Largest angle by which lines of sight may miss one another: errors of camera poses, and motion within a step [deg]
    #[schemars(range(min = 0.01, max = 20.0))]
    pub tolerance_deg: f64,
    /// How long two cameras must see the target together [s]
    #[schemars(range(min = 1.0, max = 3600.0))]
    pub min_overlap_s: f64,
    /// The best offset of two cameras must exceed chance by this factor more than any other, or it is rejected [–]
    #[schemars(range(min = 1.0, max = 100.0))]
    pub min_distinction: f64,
    /// Longest gap between bearings that is interpolated; for a slower camera, one and a half of its periods [ms]
    #[schemars(range(min = 1.0, max = 10000.0))]
    pub max_gap_ms: f64,
    /// Fastest rotation of a line of sight from one picture to the next; a faster one is due to a wrong detection and not used [deg/s]
    #[schemars(range(min = 1.0, max = 100000.0))]
    pub max_turn_deg_s: f64,
    /// File of the clocks in the results folder, with sections `[clock.NAME]` [–]
    pub file: String,
    /// A file with true clocks to compare with: figures `clocks.error_ms.NAME`. Empty: none [–]
    pub truth: String,
}

impl Default for ClocksSettings {
    fn default() -> Self {
        Self {
            reference: String::new(),
            max_offset_s: 120.0,
            max_rate_percent: 1.0,
            step_ms: 100.0,
            tolerance_deg: 1.0,
            min_overlap_s: 20.0,
            min_distinction: 1.5,
            max_gap_ms: 300.0,
            max_turn_deg_s: 60.0,
            file: "clocks.toml".to_owned(),
            truth: String::new(),
        }
    }
}

/// Collects each camera's bearings in its own time; finds the clocks when the run ends.
///
/// Pictures without exactly one point are ignored, because the target is ambiguous in them.
pub struct ClocksNode {
    cameras: Vec<(String, Camera)>,
    bearings: Vec<Bearings>,
    reference: usize,
    options: SearchOptions,
    truth: Option<Clocks>,
    /// Frame rates by name, which the file keeps.
    frame_rates: Clocks,
    out: Option<PathBuf>,
    file: String,
    several: u64,
    too_many: u64,
}

impl Node for ClocksNode {
    const TYPE: &'static str = "led.clocks";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Estimates offset and rate of each camera's clock from the path of one target";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = ClocksSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: ClocksSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let check = ConfigError::unless_in::<f64>;
        check("max_offset_s", settings.max_offset_s, 1.0..=3600.0)?;
        check("max_rate_percent", settings.max_rate_percent, 0.0..=5.0)?;
        check("step_ms", settings.step_ms, 1.0..=10_000.0)?;
        check("tolerance_deg", settings.tolerance_deg, 0.01..=20.0)?;
        check("min_overlap_s", settings.min_overlap_s, 1.0..=3600.0)?;
        check("min_distinction", settings.min_distinction, 1.0..=100.0)?;
        check("max_turn_deg_s", settings.max_turn_deg_s, 1.0..=100_000.0)?;
        check("max_gap_ms", settings.max_gap_ms, 1.0..=10_000.0)?;
        setup.claim_named_file("file", &settings.file)?;
        let cameras = &setup.calibration.cameras;
        if cameras.len() < 2 {
            let n = cameras.len();
            return Err(ConfigError::node(format_args!("found {n} cameras in the calibration, expected at least 2")));
        }
        let reference = match settings.reference.as_str() {
            "" => 0,
            name => setup.calibration.index_of(name).ok_or_else(|| {
                ConfigError::at("reference", format_args!("found `{name}`, expected a camera of the calibration"))
            })?,
        };
        let truth = match settings.truth.as_str() {
            "" => None,
            path => {
                let path = setup.path("truth", path)?;
                Some(Clocks::load(&path).map_err(|fault| ConfigError::at("truth", fault))?)
            }
        };
        let max_turn = settings.max_turn_deg_s.to_radians();
        let bearings = cameras.iter().map(|it| Bearings::new(it.camera.centre(), settings.max_gap_ms * 1e-3, max_turn));
        Ok(Self {
            bearings: bearings.collect(),
            cameras: cameras.iter().map(|it| (it.name.clone(), it.camera.clone())).collect(),
            reference,
            options: SearchOptions {
                max_offset_s: settings.max_offset_s,
                max_rate: settings.max_rate_percent * 1e-2,
                step_s: settings.step_ms * 1e-3,
                tolerance_rad: settings.tolerance_deg.to_radians(),
                min_overlap_s: settings.min_overlap_s,
                min_distinction: settings.min_distinction,
            },
            truth,
            frame_rates: setup.calibration.clocks.clone(),
            out: setup.out_dir.clone(),
            file: settings.file,
            several: 0,
            too_many: 0,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(features) = io.take(&FEATURES) else { return Ok(()) };
        let time_s = features.time().as_s();
        let camera = usize::from(features.value.camera.0);
        let (Some(bearings), Some((_, model))) = (self.bearings.get_mut(camera), self.cameras.get(camera)) else {
            return Ok(());
        };
        match features.value.list.as_slice() {
            [] => {}
            [_] if bearings.list().len() >= MAX_BEARINGS => self.too_many += 1,
            [only] => {
                if let Some(ray) = model.ray(&only.centre) {
                    bearings.push(Bearing { time_s, direction: ray.direction.into_inner() });
                }
            }
            _ => self.several += 1,
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        self.bearings.iter_mut().for_each(Bearings::follow_period);
        let mut links = Vec::new();
        for a in 0..self.bearings.len() {
            for b in a + 1..self.bearings.len() {
                match search(&self.bearings[a], &self.bearings[b], &self.options) {
                    Ok(clock) => links.push(Link { a, b, clock }),
                    Err(fault) => {
                        report.remark(format!("clocks of {} and {}: {fault}", self.cameras[a].0, self.cameras[b].0));
                    }
                }
            }
        }
        let solution = solve(&self.bearings, &links, self.reference);
        for &index in &solution.contradicting {
            let Link { a, b, clock } = links[index];
            let (a, b, offset) = (&self.cameras[a].0, &self.cameras[b].0, clock.offset_s);
            report.remark(format!("clocks of {a} and {b}: {offset:.1} s contradicts the other pairs and was left out"));
        }
        report.figure("clocks.pairs", (links.len() - solution.contradicting.len()) as f64);
        report.figure("clocks.pairs_contradicting", solution.contradicting.len() as f64);
        report.figure("clocks.miss_mrad.median", solution.miss_rad * 1e3);
        report.figure("clocks.pictures_with_several", self.several as f64);
        if self.too_many > 0 {
            let n = self.too_many;
            report.remark(format!("{n} bearings were left out: a camera's clock needs no more than {MAX_BEARINGS}"));
        }
        let clocks = self.report_clocks(&solution, report);
        if let Some(folder) = &self.out {
            let text = format!(
                "# The cameras' clocks relative to that of {}.\n{}",
                self.cameras[self.reference].0,
                clocks.to_toml()
            );
            std::fs::write(folder.join(&self.file), text)
                .map_err(|error| NodeError::input(format_args!("`{}` cannot be written: {error}", self.file)))?;
            report.file(&self.file);
        }
        Ok(())
    }
}

impl ClocksNode {
    /// Figures of each camera, and the table for the file.
    fn report_clocks(&self, solution: &Solution, report: &mut Report) -> Clocks {
        let mut clocks = Clocks::default();
        let mut worst = f64::NAN;
        let truth_of = |name: &str| self.truth.as_ref().and_then(|it| it.0.get(name)).copied();
        let true_reference = truth_of(&self.cameras[self.reference].0);
        for (camera, (name, _)) in self.cameras.iter().enumerate() {
            let Some(found) = solution.clocks[camera] else {
                report.remark(format!("the clock of {name} is unknown: it has no link to another camera"));
                continue;
            };
            report.figure(format!("clocks.offset_s.{name}"), found.offset_s);
            report.figure(format!("clocks.rate.{name}"), found.rate);
            report.figure(format!("clocks.sigma_ms.{name}"), found.sigma_s * 1e3);
            report.figure(format!("clocks.sigma_rate.{name}"), found.sigma_rate);
            let clock = CameraClock {
                offset_s: found.offset_s,
                rate: found.rate,
                offset_sigma_s: (found.sigma_s > 0.0).then_some(found.sigma_s),
                frame_rate_hz: self.frame_rates.0.get(name).and_then(|it| it.frame_rate_hz),
            };
            if let (Some(truth), Some(reference), Some((start, end))) =
                (truth_of(name), true_reference, self.bearings[camera].span_s())
            {
                // What the camera's clock shows against what it should, at one moment of the reference's clock.
                let error = |own_s: f64| own_s - truth.camera_s(reference.session_s(clock.session_s(own_s)));
                let (first, middle, last) = (error(start), error(0.5 * (start + end)), error(end));
                let largest = first.abs().max(last.abs());
                report.figure(format!("clocks.error_ms.{name}"), middle * 1e3);
                report.figure(format!("clocks.error_max_ms.{name}"), largest * 1e3);
                worst = worst.max(largest);
            }
            clocks.0.insert(name.clone(), clock);
        }
        if self.truth.is_some() {
            report.figure("clocks.error_max_ms", worst * 1e3);
        }
        clocks
    }
}
