//! The node: writes the targets of a run as a BVH file.

use std::collections::BTreeMap;

use foveate::prelude::*;
use foveate::scene::LengthUnit;
use foveate::scene::skeleton::z_up_from_y_up;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::body::{Places, SITES, body};
use super::guess::guess;
use super::proportions::{All, Limits, PART_FACTOR, SIDE_FACTOR, STRETCH, objections};
use crate::gather::{Common, Gather, TARGETS, Table, default_gap_ms};
use crate::whole_file::WholeFile;

const SPACES: In<ScaleSpace> = In::latest(1, "spaces").many().optional();

/// Number of the target at each site; all are needed, each different. Default: the order of the simulated
/// lab's truth; a tracker numbers targets in the order of their initiation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BodyTargets {
    /// On top of the head [–]
    pub head: u32,
    /// At the waist, the root of the skeleton [–]
    pub waist: u32,
    /// [–]
    pub left_shoulder: u32,
    /// [–]
    pub right_shoulder: u32,
    /// [–]
    pub left_elbow: u32,
    /// [–]
    pub right_elbow: u32,
    /// [–]
    pub left_wrist: u32,
    /// [–]
    pub right_wrist: u32,
}

impl Default for BodyTargets {
    fn default() -> Self {
        Self {
            head: 0,
            waist: 1,
            left_shoulder: 2,
            right_shoulder: 3,
            left_elbow: 4,
            right_elbow: 5,
            left_wrist: 6,
            right_wrist: 7,
        }
    }
}

impl BodyTargets {
    /// In the order of [`SITES`].
    fn numbers(&self) -> [u32; 8] {
        let Self { head, waist, left_shoulder, right_shoulder, left_elbow, right_elbow, left_wrist, right_wrist } =
            *self;
        [head, waist, left_shoulder, right_shoulder, left_elbow, right_elbow, left_wrist, right_wrist]
    }
}

/// Unit of length of a file, which the format cannot state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Unit {
    /// A centimetre, as in most animation programs.
    #[default]
    Cm,
    /// A metre.
    M,
}

/// Settings of [`ExportBvh`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ExportBvhSettings {
    /// Name of the file in the results folder [–]
    #[serde(default = "default_file")]
    pub file: String,
    /// Frame rate; 0: 60 [Hz]
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 100000.0))]
    pub rate_hz: f64,
    /// Longest gap that is interpolated; in a longer one the joint keeps its last pose [ms]
    #[serde(default = "default_gap_ms")]
    #[schemars(range(min = 0.0, max = 60000.0))]
    pub gap_ms: f64,
    /// The numbers of the targets on head, waist, shoulders, elbows and wrists [–]
    #[serde(default)]
    pub joints: BodyTargets,
    /// Unit of lengths in the file: `cm` or `m` [–]
    #[serde(default)]
    pub unit: Unit,
    /// No file is written where a part of the body differs by more than this factor from the length that fits the other parts [–]
    #[serde(default = "default_part_factor")]
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub part_factor: f64,
    /// Nor where a part differs from that of the other side by more than this factor [–]
    #[serde(default = "default_side_factor")]
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub side_factor: f64,
    /// Nor where the length of a part changes by more than this share of it, from the 10th to the 90th of a hundred frames [%]
    #[serde(default = "default_stretch_percent")]
    #[schemars(range(min = 0.0, max = 100000.0))]
    pub stretch_percent: f64,
}

/// Heads of children of two years are a third larger relative to the body, and targets on the skin are off by some centimetres.
fn default_part_factor() -> f64 {
    PART_FACTOR
}

/// People differ by 5 %; targets of the two sides may be placed differently.
fn default_side_factor() -> f64 {
    SIDE_FACTOR
}

/// The distance from waist to shoulder changes most, when people bend, in the recordings that this was tuned on.
fn default_stretch_percent() -> f64 {
    100.0 * STRETCH
}

fn default_file() -> String {
    "motion.bvh".to_owned()
}

/// Writes a body's targets into a BVH file at the end of the run.
pub struct ExportBvh {
    pub(super) gather: Option<Gather>,
    file: WholeFile,
    settings: ExportBvhSettings,
    /// Metres in one of the calibration's units; `None`: unknown.
    unit_m: Option<f64>,
}

impl ExportBvh {
    /// From the first frame in which any of the targets is seen to the last, y up, and the number of the first one.
    fn frames(&self, table: &Table) -> (usize, Vec<Places>) {
        let numbers = self.settings.joints.numbers();
        let site = |target: TargetId| numbers.iter().position(|it| *it == target.0);
        let columns = || table.points.iter().filter_map(|it| Some((site(it.target?)?, &it.samples)));
        let all = || columns().flat_map(|it| it.1).map(|it| it.0);
        let (Some(first), Some(last)) = (all().min(), all().max()) else { return (0, Vec::new()) };
        let y_up_from_z_up = z_up_from_y_up().inverse();
        let mut frames = vec![Places::default(); last - first + 1];
        for (site, samples) in columns() {
            for (frame, sample) in samples {
                frames[frame - first][site] = Some(y_up_from_z_up * sample.position);
            }
        }
        (first, frames)
    }
}

impl ExportBvh {
    /// Positions of all targets, y up, and their numbers.
    fn all(table: &Table) -> (Vec<All>, Vec<u32>) {
        let columns: Vec<_> = table.points.iter().filter_map(|it| Some((it.target?.0, &it.samples))).collect();
        let y_up_from_z_up = z_up_from_y_up().inverse();
        let mut frames = vec![vec![None; columns.len()]; table.n_frames];
        for (place, (_, samples)) in columns.iter().enumerate() {
            for (frame, sample) in *samples {
                frames[*frame][place] = Some(y_up_from_z_up * sample.position);
            }
        }
        (frames, columns.into_iter().map(|it| it.0).collect())
    }

    fn limits(&self) -> Limits {
        let ExportBvhSettings { part_factor, side_factor, stretch_percent, .. } = self.settings;
        let stretch = stretch_percent / 100.0;
        Limits { factor: part_factor, side_factor, stretch, unit_m: self.unit_m, checks_standing: true }
    }

    /// A proposed map, in the form of the rig's setting.
    fn advice(&self, table: &Table) -> String {
        let (frames, numbers) = Self::all(table);
        let mapped = self.settings.joints.numbers();
        let is_left = |target: usize| {
            let site = mapped.iter().position(|it| *it == numbers[target]).filter(|it| *it >= 2)?;
            Some(site % 2 == 0)
        };
        let found = guess(&frames, self.unit_m, is_left).and_then(|guess| {
            let targets = guess.targets.map(|it| numbers[it]);
            let places: Vec<Places> = frames.iter().map(|frame| guess.targets.map(|it| frame[it])).collect();
            let is_body = body(&places, table.rate_hz, 1.0).is_ok();
            (is_body && objections(&places, &called(&targets), &self.limits()).is_empty())
                .then_some((targets, guess.knows_sides))
        });
        let Some((targets, knows_sides)) = found else {
            let list: Vec<String> = numbers.iter().map(u32::to_string).collect();
            return format!(
                "`joints` names the targets on {}; no eight of the {} targets that were seen ({}) can be a body",
                SITES.join(", "),
                numbers.len(),
                list.join(", ")
            );
        };
        if targets == mapped {
            return "no other map of `joints` fits better; if the map is right, raise `part_factor`, `side_factor` or `stretch_percent`".to_owned();
        }
        let list: Vec<String> = SITES.iter().zip(targets).map(|(site, it)| format!("{site} = {it}")).collect();
        let sides =
            if knows_sides { "" } else { " (left and right may be exchanged: the movements do not distinguish them)" };
        format!("by distances and movements the best match is{sides}: joints = {{ {} }}", list.join(", "))
    }
}

/// Each site as the setting that names its target.
fn called(targets: &[u32; 8]) -> impl Fn(usize) -> String + use<> {
    let targets = *targets;
    move |site| format!("`joints.{}` = {}", SITES[site], targets[site])
}

figures! {
        "bvh.frames": count, neither, "Frames written; 0: no file is written";
        "bvh.frames_held": count, low, "Frames written in which unseen joints keep a pose";
    "bvh.start_s": s, neither, "Session time of the first frame";
}

impl Node for ExportBvh {
    const TYPE: &'static str = "export.bvh";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Writes the body that wears eight lights as an animated skeleton (BVH)";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = ExportBvhSettings;

    fn ports() -> Ports {
        Ports::new().input(&TARGETS).input(&SPACES)
    }

    fn new(settings: ExportBvhSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let ExportBvhSettings { file, rate_hz, gap_ms, joints, .. } = &settings;
        let labels = &BTreeMap::new();
        let gather = Gather::new(&Common { file, rate_hz: *rate_hz, gap_ms: *gap_ms, labels }, setup)?;
        let mut taken = BTreeMap::new();
        for (name, number) in SITES.into_iter().zip(joints.numbers()) {
            if let Some(other) = taken.insert(number, name) {
                let message =
                    format!("found target {number} for both `{other}` and `{name}`, expected another for each");
                return Err(ConfigError::at("joints", message));
            }
        }
        ConfigError::unless_in("part_factor", settings.part_factor, 1.0..=1e3)?;
        ConfigError::unless_in("side_factor", settings.side_factor, 1.0..=1e3)?;
        ConfigError::unless_in("stretch_percent", settings.stretch_percent, 0.0..=1e5)?;
        let unit_m = (setup.calibration.length_unit == LengthUnit::Metre).then_some(1.0);
        Ok(Self { gather: Some(gather), file: WholeFile::new(setup, file), settings, unit_m })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(gather) = &mut self.gather {
            gather.take_targets(io, &SPACES);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let Some(gather) = self.gather.take() else { return Ok(()) };
        let name = &self.settings.file;
        let table = gather.finish(name, report);
        let (first, frames) = self.frames(&table);
        let per_length = match self.settings.unit {
            Unit::Cm => 100.0,
            Unit::M => 1.0,
        };
        let written = body(&frames, table.rate_hz, per_length).and_then(|body| {
            let against = objections(&frames, &called(&self.settings.joints.numbers()), &self.limits());
            if against.is_empty() {
                Ok(body)
            } else {
                Err(format!("the targets cannot be a body: {}", against.join("; ")))
            }
        });
        let body = match written {
            Ok(body) => body,
            Err(why) => {
                report.figure("bvh.frames", 0.0);
                report.remark(format!("{name} is not written: {why}; {}", self.advice(&table)));
                return Ok(());
            }
        };
        report.figure("bvh.frames", frames.len() as f64);
        report.figure("bvh.frames_held", body.n_held as f64);
        report.figure("bvh.start_s", table.time_s(first));
        if body.n_held > 0 {
            let list: Vec<_> = body.held.iter().map(|(joint, n)| format!("{joint} in {n}")).collect();
            let (n, all, list) = (body.n_held, frames.len(), list.join(", "));
            report.remark(format!("{name}: in {n} of {all} frames unseen joints keep a pose: {list}"));
        }
        if !body.absent.is_empty() {
            report.remark(format!("{name} lacks {}: their targets were never seen together", body.absent.join(", ")));
        }
        if !self.file.is_wanted() {
            return Ok(());
        }
        self.file.write(body.motion.to_bvh().as_bytes(), report)
    }
}
