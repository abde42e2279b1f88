//! `export.tracked`: the table of surface points tracked without markers, one line for each point and time, and one for each end of a trajectory.
//!
//! Columns: `time_s,point,x_m,y_m,z_m`, the upper triangle of the position's covariance `cxx_m2,cxy_m2,cxz_m2,cyy_m2,cyz_m2,czz_m2`, velocity over the last step `vx_m_s,vy_m_s,vz_m_s`, acceleration over
//! the last two `ax_m_s2,ay_m_s2,az_m_s2`, the normal `nx,ny,nz`, `cameras` (names joined by `+`), `provenance`, `n_samples` and `state`. All in the scale's own space. Unknown values are empty: the
//! velocity of a point without a step before, the acceleration without two, the normal where none was measured.
//!
//! | `state` | the line |
//! |---|---|
//! | `new` | the first sample of a point |
//! | `followed` | a later one |
//! | `lost`, `disagreed`, `too_fast`, `too_abrupt`, `not_uniform`, `merged`, `alone`, `crept` | the trajectory ended before this time for that reason ([`TrajectoryEnd`]); the columns from `x_m` to `n_samples` are empty. A lost trajectory may continue later under the same identity |

use std::collections::BTreeSet;
use std::fmt::Write;

use foveate::prelude::*;
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::csv::{camera_names, check_file_name, field, fixed};
use crate::row_file::RowFile;
use crate::targets::write_point;

ports! {
    TRACKED: In<TrackedSurface> = each("tracked");
}

figures! {
    "tracked.points": count, neither, "Different points of the surface written";
        "tracked.samples": count, neither, "Rows with a position, one per point and time";
        "tracked.ends": count, low, "Rows of trajectories that end";
}

const HEADER: &str = "time_s,point,x_m,y_m,z_m,cxx_m2,cxy_m2,cxz_m2,cyy_m2,cyz_m2,czz_m2,vx_m_s,vy_m_s,vz_m_s,ax_m_s2,ay_m_s2,az_m_s2,nx,ny,nz,cameras,provenance,n_samples,state";
/// The columns from `x_m` to `n_samples`, left empty.
const NO_SAMPLE: &str = ",,,,,,,,,,,,,,,,,,,,,";

/// Settings of [`ExportTracked`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ExportTrackedSettings {
    /// Name of the table in the results folder [–]
    pub file: String,
    /// Every n-th moment is written, starting with the first; ends of trajectories are always written. A row has some 250 bytes [–]
    #[schemars(range(min = 1, max = 100000))]
    pub every: u32,
}

impl Default for ExportTrackedSettings {
    fn default() -> Self {
        Self { file: "tracked.csv".to_owned(), every: 1 }
    }
}

/// Tracked points into a CSV file, in the order of delivery.
pub struct ExportTracked {
    file: RowFile,
    every: u64,
    cameras: Vec<String>,
    text: String,
    moments: u64,
    points: BTreeSet<u32>,
    samples: u64,
    ends: u64,
}

/// Three columns, each with a comma before it, which are empty where the vector is zero (not measured).
fn write_known(text: &mut String, vector: &Vector3<f64>) {
    if *vector == Vector3::zeros() {
        return text.push_str(",,,");
    }
    for value in vector.iter() {
        text.push(',');
        fixed(text, *value, 6);
    }
}

impl ExportTracked {
    fn push(&mut self, surface: &TrackedSurface) {
        let is_written = self.moments.is_multiple_of(self.every);
        self.moments += 1;
        let Self { text, .. } = self;
        for (id, end) in &surface.ended {
            fixed(text, surface.time.as_s(), 6);
            write!(text, ",{id}{NO_SAMPLE},{}", end.name()).ok();
            text.push('\n');
            self.ends += 1;
        }
        for point in surface.list.iter().filter(|_| is_written) {
            fixed(text, surface.time.as_s(), 6);
            write!(text, ",{}", point.id).ok();
            write_point(text, &point.position, &point.covariance);
            write_known(text, &point.velocity);
            write_known(text, &point.acceleration);
            write_known(text, &point.normal);
            let camera =
                |it: CameraId| self.cameras.get(usize::from(it.0)).cloned().unwrap_or_else(|| it.0.to_string());
            let names: Vec<String> = point.cameras.iter().map(camera).collect();
            let state = if point.n_samples > 1 { "followed" } else { "new" };
            let (cameras, provenance) = (names.join("+"), point.provenance.name());
            write!(text, ",{},{provenance},{},{state}", field(&cameras), point.n_samples).ok();
            text.push('\n');
            self.samples += 1;
            self.points.insert(point.id);
        }
        self.file.push(&self.text);
        self.text.clear();
    }
}

impl Node for ExportTracked {
    const TYPE: &'static str = "export.tracked";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str =
        "Writes tracked surface points to a CSV table: position, covariance, velocity, acceleration";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = ExportTrackedSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: ExportTrackedSettings, setup: &Setup) -> Result<Self, ConfigError> {
        check_file_name("file", &settings.file)?;
        setup.claim_file(Some("file"), &settings.file)?;
        ConfigError::unless_in("every", settings.every, 1..=100_000)?;
        Ok(Self {
            file: RowFile::new(setup, &settings.file, HEADER),
            every: u64::from(settings.every),
            cameras: camera_names(setup),
            text: String::new(),
            moments: 0,
            points: BTreeSet::new(),
            samples: 0,
            ends: 0,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(message) = io.take(&TRACKED) {
            self.push(&message.value);
        }
        self.file.flush_when_due(io.now());
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.figure("tracked.points", self.points.len() as f64);
        report.figure("tracked.samples", self.samples as f64);
        report.figure("tracked.ends", self.ends as f64);
        self.file.finish(report)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::sync::Arc;

    use nalgebra::{Matrix3, Point3};

    use super::*;

    fn setup(folder: &std::path::Path) -> Setup {
        let calibration = Arc::new(foveate_testkit::scene::ring_calibration(3));
        Setup { out_dir: Some(folder.to_owned()), calibration, ..Setup::for_tests() }
    }

    /// A message of a time, of points with what they have behind them.
    fn surface(time_s: f64, points: &[(u32, u32)], ended: &[(u32, TrajectoryEnd)]) -> TrackedSurface {
        let point = |&(id, n_samples): &(u32, u32)| {
            let step = if n_samples > 1 { Vector3::new(0.5, -0.25, 0.125) } else { Vector3::zeros() };
            TrackedPoint {
                id,
                position: Point3::new(f64::from(id), -2.0, 0.001 * f64::from(n_samples)),
                velocity: step,
                acceleration: if n_samples > 2 { step * 8.0 } else { Vector3::zeros() },
                covariance: Matrix3::new(1.0, 0.5, 0.25, 0.5, 2.0, 0.125, 0.25, 0.125, 3.0) * 1e-8,
                normal: Vector3::new(0.0, 0.6, -0.8),
                cameras: [CameraId(0), CameraId(2)].into_iter().collect(),
                provenance: Provenance::Measured,
                n_samples,
            }
        };
        TrackedSurface { time: Time::from_s(time_s), list: points.iter().map(point).collect(), ended: ended.to_vec() }
    }

    /// Lines of the table by column, and the report, after `messages`.
    #[track_caller]
    fn export(every: u32, messages: &[TrackedSurface]) -> (Vec<BTreeMap<String, String>>, Report) {
        let folder = tempfile::tempdir().unwrap();
        let settings = ExportTrackedSettings { every, ..ExportTrackedSettings::default() };
        let mut node = ExportTracked::new(settings, &setup(folder.path())).unwrap();
        messages.iter().for_each(|it| node.push(it));
        let mut report = Report::default();
        node.finish(&mut report).unwrap();
        let text = std::fs::read_to_string(folder.path().join("tracked.csv")).unwrap();
        let mut lines = text.lines();
        let columns: Vec<&str> = lines.next().unwrap().split(',').collect();
        let row = |line: &str| {
            let values: Vec<&str> = line.split(',').collect();
            assert_eq!(values.len(), columns.len(), "{line}");
            columns.iter().zip(values).map(|(column, value)| ((*column).to_owned(), value.to_owned())).collect()
        };
        (lines.map(row).collect(), report)
    }

    #[test]
    fn node_keeps_its_promises() {
        foveate_testkit::check_node::<ExportTracked>("every = 5");
    }

    #[test]
    fn all_that_a_message_says_is_read_back() {
        let messages = [
            surface(0.1, &[(4, 1)], &[]),
            surface(0.2, &[(4, 2), (9, 1)], &[]),
            surface(0.3, &[(4, 3)], &[(9, TrajectoryEnd::NotUniform)]),
        ];
        let (rows, report) = export(1, &messages);
        let states: Vec<[&str; 4]> =
            rows.iter().map(|it| ["time_s", "point", "n_samples", "state"].map(|column| it[column].as_str())).collect();
        let expected = [
            ["0.100000", "4", "1", "new"],
            ["0.200000", "4", "2", "followed"],
            ["0.200000", "9", "1", "new"],
            ["0.300000", "9", "", "not_uniform"],
            ["0.300000", "4", "3", "followed"],
        ];
        assert_eq!(states, expected);
        let numbers = |row: usize, columns: [&str; 3]| columns.map(|it| rows[row][it].parse::<f64>().unwrap());
        let last = 4;
        assert_eq!(numbers(last, ["x_m", "y_m", "z_m"]), [4.0, -2.0, 0.003]);
        assert_eq!(numbers(last, ["cxx_m2", "cxy_m2", "cxz_m2"]), [1e-8, 5e-9, 2.5e-9]);
        assert_eq!(numbers(last, ["cyy_m2", "cyz_m2", "czz_m2"]), [2e-8, 1.25e-9, 3e-8]);
        assert_eq!(numbers(last, ["vx_m_s", "vy_m_s", "vz_m_s"]), [0.5, -0.25, 0.125]);
        assert_eq!(numbers(last, ["ax_m_s2", "ay_m_s2", "az_m_s2"]), [4.0, -2.0, 1.0]);
        assert_eq!(numbers(last, ["nx", "ny", "nz"]), [0.0, 0.6, -0.8]);
        assert_eq!([&rows[last]["cameras"], &rows[last]["provenance"]], ["ring-1+ring-3", "measured"]);
        // What is not known yet is empty, and no 0.
        assert!(rows[0]["vx_m_s"].is_empty() && rows[1]["ax_m_s2"].is_empty() && !rows[1]["vx_m_s"].is_empty());
        assert!(rows[3]["x_m"].is_empty() && rows[3]["cameras"].is_empty());
        let counted = ["tracked.points", "tracked.samples", "tracked.ends"].map(|it| report.figures[it]);
        assert_eq!(counted, [2.0, 4.0, 1.0]);
    }

    #[test]
    fn of_every_other_moment_ends_are_written_all_the_same() {
        let messages = [
            surface(0.1, &[(4, 1)], &[]),
            surface(0.2, &[(4, 2)], &[(7, TrajectoryEnd::Lost)]),
            surface(0.3, &[(4, 3)], &[]),
        ];
        let (rows, _) = export(2, &messages);
        let found: Vec<[&str; 2]> = rows.iter().map(|it| [it["time_s"].as_str(), it["state"].as_str()]).collect();
        assert_eq!(found, [["0.100000", "new"], ["0.200000", "lost"], ["0.300000", "followed"]]);
    }

    #[test]
    fn settings_that_cannot_be_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let refused = |settings| ExportTracked::new(settings, &setup(folder.path())).map(|_| ()).unwrap_err().setting;
        let away = ExportTrackedSettings { file: "../x.csv".to_owned(), ..ExportTrackedSettings::default() };
        assert_eq!(refused(away).as_deref(), Some("file"));
        let never = ExportTrackedSettings { every: 0, ..ExportTrackedSettings::default() };
        assert_eq!(refused(never).as_deref(), Some("every"));
    }
}
