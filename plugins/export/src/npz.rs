//! `export.npy`: targets and marks as arrays for NumPy, on one time base, with covariance, cameras and provenance of each sample.
//!
//! | array | shape | what |
//! |---|---|---|
//! | `rate_hz`, `times_s` | –, n | frames a second; session time of each frame |
//! | `labels` | p | the points |
//! | `positions_m` | n × p × 3 | in the world; NaN where missing |
//! | `covariances_m2` | n × p × 3 × 3 | of the positions |
//! | `provenance` | n × p | index into `provenance_names`: missing, measured, filled |
//! | `cameras` | n × p × ⌈c / 8⌉ | bits: `numpy.unpackbits(cameras, axis=2, count=len(camera_names), bitorder="little")` |
//! | `camera_names` | c | by number |
//!
//! With marks also, in the marks' own space (a head's): `mark_labels` (m), `marks_own_m` (n × m × 3), `marks_own_covariances_m2`
//! (n × m × 3 × 3) and `world_from_marks` (n × 4 × 4).

use std::collections::BTreeMap;

use foveate::motion::npz::{Archive, TooLong};
use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::csv::camera_names;
use crate::gather::{Column, Common, Gather, Table, default_gap_ms, ports};
use crate::time_base::{Sample, TRIANGLE};
use crate::whole_file::WholeFile;

/// Settings of [`ExportNpy`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ExportNpySettings {
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
}

fn default_file() -> String {
    "motion.npz".to_owned()
}

/// Targets and marks into an archive of NumPy arrays, at the end of the run.
pub struct ExportNpy {
    gather: Option<Gather>,
    file: WholeFile,
    settings: ExportNpySettings,
    cameras: Vec<String>,
}

/// The whole covariance of a sample, by rows.
fn covariance(sample: &Sample) -> [f32; 9] {
    let mut whole = [0.0; 9];
    for ((row, column), value) in TRIANGLE.into_iter().zip(sample.covariance) {
        whole[row * 3 + column] = value;
        whole[column * 3 + row] = value;
    }
    whole
}

fn archive(table: &Table, cameras: &[String]) -> Result<Vec<u8>, TooLong> {
    let (n, p) = (table.n_frames, table.points.len());
    let mut to = Archive::default();
    to.floats("rate_hz", &[], &[table.rate_hz])?;
    to.floats("times_s", &[n], &(0..n).map(|it| table.time_s(it)).collect::<Vec<_>>())?;
    to.texts("labels", &table.points.iter().map(|it| it.label.as_str()).collect::<Vec<_>>())?;
    to.floats("positions_m", &[n, p, 3], &positions(&table.points, n))?;
    to.short_floats("covariances_m2", &[n, p, 3, 3], &covariances(&table.points, n))?;
    to.texts("provenance_names", &["missing", Provenance::Measured.name(), Provenance::Filled.name()])?;
    to.bytes("provenance", &[n, p], &Table::dense(&table.points, n, 0, |it| if it.is_filled { 2 } else { 1 }))?;
    let names: Vec<&str> = cameras.iter().map(String::as_str).collect();
    to.texts("camera_names", &names)?;
    let n_bytes = cameras.len().div_ceil(8);
    let mut bits = vec![0_u8; n * p * n_bytes];
    for (place, column) in table.points.iter().enumerate() {
        for (frame, sample) in &column.samples {
            let of_sample = &mut bits[(frame * p + place) * n_bytes..][..n_bytes];
            for camera in sample.cameras.iter().map(|it| usize::from(it.0)).filter(|it| *it < cameras.len()) {
                of_sample[camera / 8] |= 1 << (camera % 8);
            }
        }
    }
    to.bytes("cameras", &[n, p, n_bytes], &bits)?;
    if !table.own_marks.is_empty() {
        let m = table.own_marks.len();
        to.texts("mark_labels", &table.own_marks.iter().map(|it| it.label.as_str()).collect::<Vec<_>>())?;
        to.floats("marks_own_m", &[n, m, 3], &positions(&table.own_marks, n))?;
        to.short_floats("marks_own_covariances_m2", &[n, m, 3, 3], &covariances(&table.own_marks, n))?;
        let mut poses = vec![[f64::NAN; 16]; n];
        for (frame, pose) in &table.marks_from {
            // Stored by columns.
            poses[*frame].copy_from_slice(pose.to_homogeneous().transpose().as_slice());
        }
        to.floats("world_from_marks", &[n, 4, 4], poses.as_flattened())?;
    }
    Ok(to.finish())
}

fn positions(columns: &[Column], n_frames: usize) -> Vec<f64> {
    let dense = Table::dense(columns, n_frames, [f64::NAN; 3], |it| it.position.into());
    dense.into_iter().flatten().collect()
}

fn covariances(columns: &[Column], n_frames: usize) -> Vec<f32> {
    Table::dense(columns, n_frames, [f32::NAN; 9], covariance).into_iter().flatten().collect()
}

figures! {
    "npy.points": count, neither, "Targets and marks in the file";
    "npy.frames": count, neither, "Frames in the file, including those without any point";
}

impl Node for ExportNpy {
    const TYPE: &'static str = "export.npy";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Writes targets and marks as NumPy arrays: times, positions, covariances, cameras";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = ExportNpySettings;

    fn ports() -> Ports {
        ports()
    }

    fn new(settings: ExportNpySettings, setup: &Setup) -> Result<Self, ConfigError> {
        let ExportNpySettings { file, rate_hz, gap_ms, labels } = &settings;
        let gather = Gather::new(&Common { file, rate_hz: *rate_hz, gap_ms: *gap_ms, labels }, setup)?;
        Ok(Self {
            gather: Some(gather),
            file: WholeFile::new(setup, &settings.file),
            cameras: camera_names(setup),
            settings,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(gather) = &mut self.gather {
            gather.take(io);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let Some(gather) = self.gather.take() else { return Ok(()) };
        let table = gather.finish(&self.settings.file, report);
        report.figure("npy.points", table.points.len() as f64);
        report.figure("npy.frames", table.n_frames as f64);
        if !self.file.is_wanted() {
            return Ok(());
        }
        match archive(&table, &self.cameras) {
            Ok(bytes) => self.file.write(&bytes, report),
            Err(TooLong) => {
                let (frames, points) = (table.n_frames, table.points.len());
                Err(NodeError::input(format!(
                    "{}: {frames} frames of {points} points exceed 4 GiB, the limit of such a file",
                    self.settings.file
                )))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::process::Command;
    use std::sync::Arc;

    use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, Vector3};

    use super::*;
    use crate::target_rows::tests::target;

    #[test]
    fn node_keeps_its_promises() {
        foveate_testkit::check_node::<ExportNpy>("");
    }

    const CHECK: &str = r#"
import sys, numpy
file = numpy.load(sys.argv[1])
names = list(file["camera_names"])
seen = numpy.unpackbits(file["cameras"], axis=2, count=len(names), bitorder="little")
assert file["positions_m"].shape == (5, 2, 3), file["positions_m"].shape
assert list(file["labels"]) == ["waist", "mark-7"], file["labels"]
assert numpy.allclose(file["positions_m"][1], [[1, 2, 3], [0.1, 0.0, 1.0]]), file["positions_m"][1]
assert numpy.isnan(file["positions_m"][2:4, 0]).all() and numpy.isnan(file["covariances_m2"][2:4, 0]).all()
assert [str(file["provenance_names"][it]) for it in file["provenance"][:, 0]] == ["measured", "measured", "missing", "missing", "measured"]
assert [str(file["provenance_names"][it]) for it in file["provenance"][:, 1]] == ["missing", "filled", "missing", "missing", "missing"]
assert [names[it] for it in seen[1, 0].nonzero()[0]] == ["ring-2"], seen[1, 0]
assert [names[it] for it in seen[1, 1].nonzero()[0]] == ["ring-9"], seen[1, 1]
assert numpy.allclose(file["times_s"], [0.5, 0.6, 0.7, 0.8, 0.9]) and file["rate_hz"] == 10
assert numpy.allclose(file["covariances_m2"][1, 1], numpy.diag([4e-6, 1e-6, 1e-6])), file["covariances_m2"][1, 1]
assert numpy.allclose(file["marks_own_m"][1, 0], [0, -0.1, 0]) and numpy.isnan(file["marks_own_m"][0]).all()
assert numpy.allclose(file["marks_own_covariances_m2"][1, 0], numpy.diag([1e-6, 4e-6, 1e-6]))
point = file["world_from_marks"][1] @ [0, -0.1, 0, 1]
assert numpy.allclose(point, [0.1, 0, 1, 1]), point
print("whole")
"#;

    #[test]
    fn numpy_reads_all_that_is_known() {
        let Some(python) = std::env::var_os("FOVEATE_PEER_PYTHON") else {
            println!("skipped: numpy_reads_all_that_is_known needs FOVEATE_PEER_PYTHON, a python with ezc3d and numpy");
            return;
        };
        let folder = tempfile::tempdir().unwrap();
        let setup = Setup {
            out_dir: Some(folder.path().to_owned()),
            calibration: Arc::new(foveate_testkit::scene::ring_calibration(9)),
            ..Setup::for_tests()
        };
        let settings = "rate_hz = 10.0\ngap_ms = 150.0\nlabels = { target-3 = \"waist\" }";
        let mut node = ExportNpy::new(toml::from_str(settings).unwrap(), &setup).unwrap();
        let gather = node.gather.as_mut().unwrap();
        for time in [0.5, 0.6, 0.9] {
            let list = vec![target(3, [1.0, 2.0, 3.0], Provenance::Measured)];
            gather.push_targets(Arc::new(Targets { time: Time::from_s(time), list }), false);
        }
        let mark = Mark {
            label: 7,
            position: Point3::new(0.0, -0.1, 0.0),
            covariance: Matrix3::from_diagonal(&Vector3::new(1e-6, 4e-6, 1e-6)),
            cameras: [CameraId(8)].into_iter().collect(),
            provenance: Provenance::Filled,
        };
        let quarter = Vector3::z() * std::f64::consts::FRAC_PI_2;
        gather.push_marks(Arc::new(Marks {
            time: Time::from_s(0.6),
            world_from_marks: Isometry3::new(Vector3::z(), quarter),
            covariance: Matrix6::zeros(),
            list: vec![mark],
            fit: None,
        }));
        node.finish(&mut Report::default()).unwrap();
        let output = Command::new(python).arg("-c").arg(CHECK).arg(folder.path().join("motion.npz")).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
}
