//! The node: from the targets of a run to the text of a BVH file.

use std::collections::BTreeMap;

use foveate::prelude::*;
use foveate::scene::skeleton::z_up_from_y_up;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::body::{Places, SITES, body};
use crate::gather::{Common, Gather, TARGETS, Table, default_gap_ms};
use crate::whole_file::WholeFile;

const SPACES: In<ScaleSpace> = In::latest(1, "spaces").many().optional();

/// Which target sits on what, by its number; all are needed, each another. Default: the order of the simulated
/// lab's truth; a tracker numbers targets in the order in which it finds them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BodyTargets {
    /// On top of the head [–]
    pub head: u32,
    /// Where the skeleton has its root [–]
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

/// What one is in a file, which cannot say it itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Unit {
    /// A centimetre, as most animation programs take it.
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
    /// Frames a second; 0: 60 [Hz]
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 100000.0))]
    pub rate_hz: f64,
    /// Between two samples of a target that are farther apart it is missing, and the joint holds its last pose [ms]
    #[serde(default = "default_gap_ms")]
    #[schemars(range(min = 0.0, max = 60000.0))]
    pub gap_ms: f64,
    /// The numbers of the targets on head, waist, shoulders, elbows and wrists [–]
    #[serde(default)]
    pub joints: BodyTargets,
    /// Unit of lengths in the file: `cm` or `m` [–]
    #[serde(default)]
    pub unit: Unit,
}

fn default_file() -> String {
    "motion.bvh".to_owned()
}

/// A body's targets into a BVH file, at the end of the run.
pub struct ExportBvh {
    pub(super) gather: Option<Gather>,
    file: WholeFile,
    settings: ExportBvhSettings,
}

impl ExportBvh {
    /// From the first frame in which any of the targets is seen to the last, y up, and the number of that first one.
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

impl Node for ExportBvh {
    const TYPE: &'static str = "export.bvh";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Writes the body that eight targets sit on as a skeleton that moves (BVH)";
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
        Ok(Self { gather: Some(gather), file: WholeFile::new(setup, file), settings })
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
        let body = match body(&frames, table.rate_hz, per_length) {
            Ok(body) => body,
            Err(why) => {
                report.figure("bvh.frames", 0.0);
                report.remark(format!("{name} is not written: {why}"));
                return Ok(());
            }
        };
        report.figure("bvh.frames", frames.len() as f64);
        report.figure("bvh.frames_held", body.n_held as f64);
        report.figure("bvh.start_s", table.time_s(first));
        if body.n_held > 0 {
            let list: Vec<_> = body.held.iter().map(|(joint, n)| format!("{joint} in {n}")).collect();
            let (n, all, list) = (body.n_held, frames.len(), list.join(", "));
            report.remark(format!("{name}: in {n} of {all} frames joints hold a pose since they are not seen: {list}"));
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
