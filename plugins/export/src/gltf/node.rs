//! `export.gltf`: targets, marks and cameras as an animated scene in glTF, in one binary file for Blender and others.
//!
//! | in the file | what |
//! |---|---|
//! | a ball for each target | moves; shrinks to nothing while it is missing |
//! | `face` | a mesh over the marks with one joint per mark, in the space of the head, which is the node `marks` |
//! | a camera for each of the calibration | static, or moving where `poses` gives its pose |
//!
//! Marks too few for a triangle are balls, too. glTF cannot hold provenance or uncertainty: see the other exports.

use std::collections::BTreeMap;
use std::sync::Arc;

use foveate::prelude::*;
use foveate::scene::Calibration;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::scene::{Look, scene};
use crate::gather::{Common, Gather, POSES, default_gap_ms, ports};
use crate::whole_file::WholeFile;

/// Settings of [`ExportGltf`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ExportGltfSettings {
    /// Name of the file in the results folder [–]
    #[serde(default = "default_file")]
    pub file: String,
    /// Frame rate; 0: that of the marks where they are connected, 60 otherwise [Hz]
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 100000.0))]
    pub rate_hz: f64,
    /// Longest gap between two samples of a point that is interpolated; in a longer one the point is missing [ms]
    #[serde(default = "default_gap_ms")]
    #[schemars(range(min = 0.0, max = 60000.0))]
    pub gap_ms: f64,
    /// Names in the file in place of `target-N`, `PARENT-target-N` (PARENT: the parent scale's name) and `mark-N` [–]
    #[serde(default)]
    pub labels: BTreeMap<String, String>,
    /// Radius of the balls [mm]
    #[serde(default = "default_radius_mm")]
    #[schemars(range(min = 0.001, max = 10000.0))]
    pub radius_mm: f64,
    /// Whether the cameras of the calibration are in the scene [–]
    #[serde(default = "default_cameras")]
    pub cameras: bool,
}

fn default_file() -> String {
    "motion.glb".to_owned()
}

fn default_radius_mm() -> f64 {
    15.0
}

fn default_cameras() -> bool {
    true
}

/// Targets, marks and cameras into a GLB file, at the end of the run.
pub struct ExportGltf {
    pub(super) gather: Option<Gather>,
    file: WholeFile,
    settings: ExportGltfSettings,
    calibration: Arc<Calibration>,
}

figures! {
    "gltf.points": count, neither, "Targets and marks in the file";
    "gltf.frames": count, neither, "Frames in the file, including those without any point";
}

impl Node for ExportGltf {
    const TYPE: &'static str = "export.gltf";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Writes targets, marks (as a mesh) and cameras as an animated glTF scene (GLB)";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = ExportGltfSettings;

    fn ports() -> Ports {
        ports().input(&POSES)
    }

    fn new(settings: ExportGltfSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let ExportGltfSettings { file, rate_hz, gap_ms, labels, .. } = &settings;
        let gather = Gather::new(&Common { file, rate_hz: *rate_hz, gap_ms: *gap_ms, labels }, setup)?;
        ConfigError::unless_in("radius_mm", settings.radius_mm, 0.001..=10_000.0)?;
        Ok(Self {
            gather: Some(gather),
            file: WholeFile::new(setup, &settings.file),
            calibration: Arc::clone(&setup.calibration),
            settings,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(gather) = &mut self.gather {
            gather.take(io);
            gather.take_poses(io);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let Some(gather) = self.gather.take() else { return Ok(()) };
        let table = gather.finish(&self.settings.file, report);
        report.figure("gltf.points", table.points.len() as f64);
        report.figure("gltf.frames", table.n_frames as f64);
        if !self.file.is_wanted() {
            return Ok(());
        }
        let cameras = self.settings.cameras.then_some(&*self.calibration);
        let look = Look { radius: self.settings.radius_mm * 1e-3, cameras };
        match scene(&table, &look) {
            Ok(bytes) => self.file.write(&bytes, report),
            Err(length) => {
                let name = &self.settings.file;
                Err(NodeError::input(format!(
                    "{name}: {length} bytes, expected at most 4 GiB, the limit of a GLB file"
                )))
            }
        }
    }
}
