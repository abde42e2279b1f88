//! `export.pictures`: figures of a run: the path of each target over time, and the cameras that saw it.
//!
//! | file | what it shows |
//! |---|---|
//! | `path_top.svg` | paths from above, to scale, with cameras, their views, and the working volume |
//! | `path_side.svg` | the same from two sides |
//! | `position_time.svg` | x, y and z over time with ±2σ; stretches without an observation are dashed, holes are open |
//! | `cameras_time.svg` | how many cameras saw each target, over time |
//!
//! Ground truth, where it is connected, is drawn gray behind the paths. Long runs are thinned, so that memory and files stay small.

use std::sync::Arc;

use foveate::prelude::*;
use foveate::scene::{Calibration, LengthUnit};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::figures::{Subject, cameras, space, time};
use crate::in_order::InOrder;
use crate::row_file::write_pictures;
use crate::track_history::History;

ports! {
    TARGETS: In<Targets> = each("targets");
    TRUTH: In<Targets> = each("truth").optional();
}

/// Settings of [`ExportPictures`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ExportPicturesSettings {
    /// Prefix of the file names, for a second node of this type in one rig [–]
    #[serde(default)]
    pub prefix: String,
    /// A sample is drawn as measured when an observation of its target is at most this old, as predicted otherwise [ms]
    #[serde(default = "default_measured_within_ms")]
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub measured_within_ms: f64,
}

fn default_measured_within_ms() -> f64 {
    100.0
}

/// Targets, and ground truth where it is connected, into four SVG files.
pub struct ExportPictures {
    targets: Paths,
    truth: Paths,
    settings: ExportPicturesSettings,
    name: String,
    calibration: Arc<Calibration>,
    volume_m: Option<[[f64; 3]; 2]>,
    out_dir: Option<std::path::PathBuf>,
}

/// One input.
struct Paths {
    order: InOrder<Arc<Targets>>,
    history: History,
}

impl Paths {
    fn new(measured_within_ms: f64) -> Self {
        Self { order: InOrder::default(), history: History::new(Interval::from_ms(measured_within_ms)) }
    }

    fn push(&mut self, message: Arc<Targets>) {
        let history = &mut self.history;
        self.order.push(message.time, message, &mut |it| history.push(&it));
    }

    fn finish(&mut self) {
        let history = &mut self.history;
        self.order.finish(&mut |it| history.push(&it));
    }
}

impl ExportPictures {
    fn draw(&self) -> [(&'static str, String); 4] {
        let unit = match self.calibration.length_unit {
            LengthUnit::Metre => "m",
            LengthUnit::Unknown => "units",
        };
        let subject = Subject {
            name: &self.name,
            unit,
            cameras: self.calibration.cameras.iter().map(|it| (it.name.as_str(), &it.camera)).collect(),
            volume: self.volume_m,
            tracks: Vec::new(),
            others: Vec::new(),
            n_left_out: 0,
            truth: Vec::new(),
        }
        .with_tracks(&self.targets.history, &self.truth.history);
        let span = self.targets.history.span().unwrap_or((0.0, 1.0));
        [
            ("path_top.svg", space::top(&subject)),
            ("path_side.svg", space::side(&subject)),
            ("position_time.svg", time::position(&subject, span)),
            ("cameras_time.svg", cameras::cameras(&subject, span)),
        ]
    }
}

impl Node for ExportPictures {
    const TYPE: &'static str = "export.pictures";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Draws the paths of targets, and how many cameras saw them over time (SVG)";
    type Settings = ExportPicturesSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: ExportPicturesSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("measured_within_ms", settings.measured_within_ms, 0.0..=10_000.0)?;
        if crate::csv::file_part(&settings.prefix) != settings.prefix {
            let fault = format!("found `{}`, expected letters, digits, `-`, `_` and `.`", settings.prefix);
            return Err(ConfigError::at("prefix", fault));
        }
        setup.claim_file(Some("prefix"), &format!("{}path_top.svg", settings.prefix))?;
        Ok(Self {
            targets: Paths::new(settings.measured_within_ms),
            truth: Paths::new(settings.measured_within_ms),
            settings,
            name: setup.scale.clone(),
            calibration: Arc::clone(&setup.calibration),
            volume_m: setup.volume_m,
            out_dir: setup.out_dir.clone(),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(message) = io.take(&TARGETS) {
            self.targets.push(message.value);
        }
        while let Some(message) = io.take(&TRUTH) {
            self.truth.push(message.value);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        self.targets.finish();
        self.truth.finish();
        match &self.out_dir {
            None => Ok(()),
            Some(folder) => write_pictures(folder, &self.settings.prefix, &self.draw(), report),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use nalgebra::Vector3;

    use super::*;
    use crate::target_rows::tests::target;

    fn node(folder: &std::path::Path, n_cameras: usize) -> ExportPictures {
        let calibration = Arc::new(foveate_testkit::scene::ring_calibration(n_cameras));
        let setup = Setup {
            out_dir: Some(folder.to_owned()),
            calibration,
            scale: "room".to_owned(),
            volume_m: Some([[-1.75, -1.75, 0.0], [1.75, 1.75, 2.0]]),
            ..Setup::for_tests()
        };
        let settings =
            ExportPicturesSettings { prefix: String::new(), measured_within_ms: default_measured_within_ms() };
        ExportPictures::new(settings, &setup).unwrap()
    }

    /// `n` targets that circle, seen by cameras in turn, each lost for a while.
    fn circling(n: u32, step: u32, rate_hz: f64, truth: bool) -> Targets {
        let time_s = f64::from(step) / rate_hz;
        let list = (0..n).filter_map(|id| {
            let phase = 0.7 * time_s + f64::from(id);
            let since_loss = (time_s + f64::from(id) * 1.7) % 10.0;
            if since_loss > 9.0 && !truth {
                return None;
            }
            let lost = since_loss > 8.0 && !truth;
            let radius = 0.4 + 0.1 * f64::from(id);
            let noise = if truth { 0.0 } else { 0.01 * f64::from(step * 7919 % 101) / 101.0 };
            let position = [radius * phase.cos() + noise, radius * phase.sin(), 1.0 + 0.2 * (2.0 * phase).sin()];
            let mut target = target(id, position, if lost { Provenance::Predicted } else { Provenance::Measured });
            let sigma = if lost { 0.01 + 0.15 * (since_loss - 8.0) } else { 0.01 };
            target.covariance.fixed_view_mut::<3, 3>(0, 0).set_diagonal(&Vector3::repeat(sigma * sigma));
            if !lost {
                let few = 1 + (step / 40 + id) % 5;
                target.cameras = (0..few).map(|it| CameraId(((step + it) % 6) as u16)).collect();
            }
            Some(target)
        });
        Targets { time: Time::from_s(time_s), list: list.collect() }
    }

    /// Files by name with their sizes; every one must be well formed as far as brackets go.
    #[track_caller]
    fn finish(node: &mut ExportPictures, folder: &std::path::Path) -> Vec<(PathBuf, usize)> {
        let mut report = Report::default();
        node.finish(&mut report).unwrap();
        let size = |name: &PathBuf| {
            let text = std::fs::read_to_string(folder.join(name)).unwrap();
            assert_eq!(text.matches('<').count(), text.matches('>').count());
            assert!(text.starts_with("<svg") && text.ends_with("</svg>\n"));
            assert!(!text.contains("NaN") && !text.contains("inf"), "{}", name.display());
            text.len()
        };
        report.files.iter().map(|it| (it.clone(), size(it))).collect()
    }

    #[test]
    fn node_keeps_its_promises() {
        foveate_testkit::check_node::<ExportPictures>("prefix = \"second-\"");
    }

    #[test]
    fn long_run_of_many_targets_makes_small_files() {
        let folder = tempfile::tempdir().unwrap();
        let mut node = node(folder.path(), 6);
        for step in 0..40_000 {
            node.targets.push(Arc::new(circling(12, step, 100.0, false)));
            node.truth.push(Arc::new(circling(12, step, 100.0, true)));
        }
        let files = finish(&mut node, folder.path());
        assert_eq!(files.len(), 4);
        for (name, size) in files {
            assert!(size < 1_000_000, "{} has {size} bytes", name.display());
        }
    }

    #[test]
    fn run_without_targets_or_cameras_still_makes_pictures() {
        let folder = tempfile::tempdir().unwrap();
        let mut node = node(folder.path(), 1);
        node.calibration = Setup::for_tests().calibration;
        node.volume_m = None;
        assert_eq!(finish(&mut node, folder.path()).len(), 4);
    }

    #[test]
    fn same_data_same_bytes() {
        let draw = || {
            let folder = tempfile::tempdir().unwrap();
            let mut node = node(folder.path(), 4);
            (0..500).for_each(|step| node.targets.push(Arc::new(circling(3, step, 60.0, false))));
            node.draw()
        };
        assert_eq!(draw(), draw());
    }

    #[test]
    fn folder_that_cannot_be_written_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let mut node = node(&folder.path().join("gone"), 2);
        let complaint = node.finish(&mut Report::default()).unwrap_err().message;
        assert!(complaint.contains("path_top.svg") && complaint.contains("cameras_time.svg"), "{complaint}");
    }
}
