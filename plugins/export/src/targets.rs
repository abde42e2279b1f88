//! `export.targets`: the table of targets, one line for each target and time.
//!
//! Columns: `time_s,target,x_m,y_m,z_m`, the upper triangle of the position's covariance `cxx_m2,cxy_m2,cxz_m2,cyy_m2,cyz_m2,czz_m2`,
//! `cameras` (names joined by `+`: those whose observations were used) and `provenance` (`measured`, `predicted`, `filled`). All in the scale's own
//! space; for a moving scale with its anchors at `spaces`, `world_x_m` to `world_czz_m2` follow, the same in the world, empty where the
//! pose is unknown.

use std::collections::BTreeMap;
use std::sync::Arc;

use foveate::node::scale::Spaces;
use foveate::prelude::*;
use foveate::scene::LengthUnit;
use nalgebra::{Matrix3, Point3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::csv::{camera_names, check_file_name, field, fixed, scientific};
use crate::in_order::InOrder;
use crate::row_file::RowFile;
use crate::target_rows::{Clock, Place, Row};

ports! {
    TARGETS: In<Targets> = each("targets");
    SPACES: In<ScaleSpace> = latest("spaces").many().optional();
}

figures! {
    "targets": count, neither, "Different targets written";
        "samples": count, neither, "Rows written, one per target and time";
        "samples_predicted": count, low, "Rows of extrapolated targets";
        "samples_filled": count, neither, "Rows of targets that a model filled in";
    "path_length_m": m, neither, "Total length of all targets' paths, row by row; missing where the calibration's unit is unknown";
    "duration_s": s, neither, "From the earliest to the latest row";
}

const HEADER: &str = "time_s,target,x_m,y_m,z_m,cxx_m2,cxy_m2,cxz_m2,cyy_m2,cyz_m2,czz_m2,cameras,provenance";

/// Added to [`HEADER`] where the scale moves and its anchors are connected.
const WORLD_HEADER: &str =
    ",world_x_m,world_y_m,world_z_m,world_cxx_m2,world_cxy_m2,world_cxz_m2,world_cyy_m2,world_cyz_m2,world_czz_m2";
/// Its columns, left empty.
const NO_WORLD: &str = ",,,,,,,,,";

/// Settings of [`ExportTargets`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ExportTargetsSettings {
    /// Name of the table in the results folder [–]
    #[serde(default = "default_file")]
    pub file: String,
    /// Rate of rows on a regular clock, interpolated between samples and extrapolated by velocity after the last one; 0: a row for each time
    /// of the samples [Hz]
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 100000.0))]
    pub rate_hz: f64,
    /// With `rate_hz`: a row counts as measured when an observation is at most this old, as predicted otherwise [ms]
    #[serde(default = "default_measured_within_ms")]
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub measured_within_ms: f64,
    /// With `rate_hz`: longest extrapolation of a sample, and longest gap that is interpolated; without newer samples
    /// the rows stop [ms]
    #[serde(default = "default_carried_at_most_ms")]
    #[schemars(range(min = 0.0, max = 60000.0))]
    pub carried_at_most_ms: f64,
}

fn default_file() -> String {
    "targets.csv".to_owned()
}

fn default_measured_within_ms() -> f64 {
    20.0
}

fn default_carried_at_most_ms() -> f64 {
    500.0
}

/// Targets into a CSV file. Of several messages of one time, the last is written.
pub struct ExportTargets {
    file: RowFile,
    order: InOrder<Arc<Targets>>,
    clock: Option<Clock>,
    table: Table,
    text: String,
    file_name: String,
    unit_is_known: bool,
}

/// Totals of the rows.
#[derive(Debug, Default)]
struct Table {
    cameras: Vec<String>,
    /// Pose of the scale's space over time, where it moves.
    spaces: Option<Spaces>,
    samples: u64,
    predicted: u64,
    filled: u64,
    /// Last position of each target [m].
    places: BTreeMap<TargetId, Point3<f64>>,
    path_length: f64,
    span: Option<(Time, Time)>,
}

impl Table {
    fn write(&mut self, row: &Row, text: &mut String) {
        fixed(text, row.time.as_s(), 6);
        text.push(',');
        text.push_str(&row.id.0.to_string());
        write_point(text, &row.position, &row.covariance);
        text.push(',');
        let names: Vec<String> = row.cameras.iter().map(|it| self.camera(it)).collect();
        text.push_str(&field(&names.join("+")));
        text.push(',');
        text.push_str(row.provenance.name());
        match (&self.spaces, row.world) {
            (Some(_), Some((position, covariance))) => write_point(text, &position, &covariance),
            (Some(_), None) => text.push_str(NO_WORLD),
            (None, _) => {}
        }
        text.push('\n');
        self.count(row);
    }

    fn camera(&self, camera: CameraId) -> String {
        self.cameras.get(usize::from(camera.0)).cloned().unwrap_or_else(|| camera.0.to_string())
    }

    fn count(&mut self, row: &Row) {
        self.samples += 1;
        self.predicted += u64::from(row.provenance == Provenance::Predicted);
        self.filled += u64::from(row.provenance == Provenance::Filled);
        if let Some(before) = self.places.insert(row.id, row.position) {
            self.path_length += (row.position - before).norm();
        }
        let (first, last) = self.span.unwrap_or((row.time, row.time));
        self.span = Some((first.min(row.time), last.max(row.time)));
    }
}

/// Position and upper triangle of its covariance, each with a comma before it.
pub(crate) fn write_point(text: &mut String, position: &Point3<f64>, covariance: &Matrix3<f64>) {
    for coordinate in position.iter() {
        text.push(',');
        fixed(text, *coordinate, 6);
    }
    for (row, column) in [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)] {
        text.push(',');
        scientific(text, covariance[(row, column)]);
    }
}

impl ExportTargets {
    fn push(&mut self, message: Arc<Targets>) {
        let mut ready = Vec::new();
        self.order.push(message.time, message, &mut |it| ready.push(it));
        ready.iter().for_each(|it| self.write(it));
    }

    fn write(&mut self, message: &Targets) {
        let Self { clock, table, text, .. } = self;
        let spaces = table.spaces.take();
        let to_world = |time, place: &Place| to_world(spaces.as_ref(), time, place);
        let mut rows = Vec::new();
        match clock {
            Some(clock) => clock.push(message, &to_world, &mut |row| rows.push(row)),
            None => rows.extend(message.list.iter().map(|it| {
                let row = Row::of(message.time, it);
                let world = to_world(row.time, &(row.position, row.covariance));
                Row { world, ..row }
            })),
        }
        table.spaces = spaces;
        rows.iter().for_each(|row| table.write(row, text));
        self.file.push(&self.text);
        self.text.clear();
    }
}

/// `None`: the scale's space is the world, or its pose at that time is unknown.
fn to_world(spaces: Option<&Spaces>, time: Time, (position, covariance): &Place) -> Option<Place> {
    Some(spaces?.world_from_own(time).ok()?.transform_point(position, covariance))
}

impl Node for ExportTargets {
    const TYPE: &'static str = "export.targets";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Writes targets to a CSV table: time, position, covariance, cameras, provenance";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = ExportTargetsSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: ExportTargetsSettings, setup: &Setup) -> Result<Self, ConfigError> {
        check_file_name("file", &settings.file)?;
        setup.claim_file(Some("file"), &settings.file)?;
        ConfigError::unless_in("rate_hz", settings.rate_hz, 0.0..=100_000.0)?;
        ConfigError::unless_in("measured_within_ms", settings.measured_within_ms, 0.0..=10_000.0)?;
        ConfigError::unless_in("carried_at_most_ms", settings.carried_at_most_ms, 0.0..=60_000.0)?;
        let [measured_within, carried_at_most] =
            [settings.measured_within_ms, settings.carried_at_most_ms].map(Interval::from_ms);
        let clock = (settings.rate_hz > 0.0).then(|| Clock::new(settings.rate_hz, measured_within, carried_at_most));
        let has_spaces = setup.is_connected(&SPACES);
        let spaces = has_spaces.then(|| Spaces::new(&setup.scales)).filter(Spaces::is_moving);
        let header = if spaces.is_some() { format!("{HEADER}{WORLD_HEADER}") } else { HEADER.to_owned() };
        Ok(Self {
            file: RowFile::new(setup, &settings.file, &header),
            order: InOrder::default(),
            clock,
            table: Table { cameras: camera_names(setup), spaces, ..Table::default() },
            text: String::new(),
            file_name: settings.file,
            unit_is_known: setup.calibration.length_unit == LengthUnit::Metre,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(spaces) = &mut self.table.spaces {
            io.latest_of_each(&SPACES).for_each(|it| spaces.learn(it.value));
        }
        while let Some(message) = io.take(&TARGETS) {
            self.push(message.value);
        }
        self.file.flush_when_due(io.now());
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let mut ready = Vec::new();
        self.order.finish(&mut |it| ready.push(it));
        ready.iter().for_each(|it| self.write(it));
        let mut rows = Vec::new();
        if let Some(clock) = &mut self.clock {
            let spaces = self.table.spaces.as_ref();
            clock.finish(&|time, place| to_world(spaces, time, place), &mut |row| rows.push(row));
        }
        rows.iter().for_each(|row| self.table.write(row, &mut self.text));
        self.file.push(&self.text);
        let table = &self.table;
        report.figure("targets", table.places.len() as f64);
        report.figure("samples", table.samples as f64);
        report.figure("samples_predicted", table.predicted as f64);
        report.figure("samples_filled", table.filled as f64);
        report.figure("path_length_m", if self.unit_is_known { table.path_length } else { f64::NAN });
        report.figure("duration_s", table.span.map_or(0.0, |(first, last)| (last - first).0 as f64 / 1e9));
        let name = &self.file_name;
        if !self.unit_is_known && table.samples > 0 {
            report.remark(format!(
                "the lengths in {name} are in the calibration's own unit, whose length in metres is unknown"
            ));
        }
        if self.order.late() > 0 {
            let n_late = self.order.late();
            report.remark(format!("{name}: {n_late} messages came after a later one; their rows are out of order"));
        }
        self.file.finish(report)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::target_rows::tests::target;

    fn settings(rate_hz: f64) -> ExportTargetsSettings {
        ExportTargetsSettings { file: default_file(), rate_hz, measured_within_ms: 20.0, carried_at_most_ms: 500.0 }
    }

    fn setup(folder: &std::path::Path) -> Setup {
        let calibration = Arc::new(foveate_testkit::scene::ring_calibration(3));
        Setup { out_dir: Some(folder.to_owned()), calibration, ..Setup::for_tests() }
    }

    /// The table and the report after `messages`.
    #[track_caller]
    fn export(settings: ExportTargetsSettings, messages: Vec<Targets>) -> (String, Report) {
        let folder = tempfile::tempdir().unwrap();
        let mut node = ExportTargets::new(settings, &setup(folder.path())).unwrap();
        for message in messages {
            node.push(Arc::new(message));
        }
        let mut report = Report::default();
        node.finish(&mut report).unwrap();
        (std::fs::read_to_string(folder.path().join("targets.csv")).unwrap(), report)
    }

    #[test]
    fn node_keeps_its_promises() {
        foveate_testkit::check_node::<ExportTargets>("rate_hz = 60.0");
    }

    #[test]
    fn last_message_of_a_time_is_written_with_all_that_is_known() {
        let at = |ms: f64, list: Vec<Target>| Targets { time: Time::ZERO + Interval::from_ms(ms), list };
        let mut seen_by_two = target(4, [1.0, -2.0, 0.5], Provenance::Measured);
        seen_by_two.cameras = [CameraId(0), CameraId(2)].into_iter().collect();
        let messages = vec![
            at(10.0, vec![target(4, [9.0, 9.0, 9.0], Provenance::Measured)]),
            at(10.0, vec![seen_by_two]),
            at(
                20.0,
                vec![
                    target(4, [1.0, -2.0, 1.5], Provenance::Predicted),
                    target(5, [0.0, 0.0, -1e-9], Provenance::Filled),
                ],
            ),
        ];
        let (text, report) = export(settings(0.0), messages);
        let covariance = "1.000000e-04,0.000000e+00,0.000000e+00,1.000000e-04,0.000000e+00,1.000000e-04";
        let expected = format!(
            "{HEADER}\n\
             0.010000,4,1.000000,-2.000000,0.500000,{covariance},ring-1+ring-3,measured\n\
             0.020000,4,1.000000,-2.000000,1.500000,{covariance},,predicted\n\
             0.020000,5,0.000000,0.000000,0.000000,{covariance},,filled\n"
        );
        assert_eq!(text, expected);
        let figure = |name: &str| report.figures[name];
        assert_eq!([figure("targets"), figure("samples"), figure("samples_predicted")], [2.0, 3.0, 1.0]);
        assert!((figure("path_length_m") - 1.0).abs() < 1e-12);
        assert!((figure("duration_s") - 0.01).abs() < 1e-12);
    }

    #[test]
    fn clock_gives_rows_at_its_own_times() {
        let messages = (0..=20).map(|step| {
            let time = f64::from(step) * 0.005;
            Targets { time: Time::from_s(time), list: vec![target(1, [time, 0.0, 0.0], Provenance::Measured)] }
        });
        let (text, report) = export(settings(30.0), messages.collect());
        let times: Vec<&str> = text.lines().skip(1).filter_map(|line| line.split(',').next()).collect();
        assert_eq!(times, ["0.000000", "0.033333", "0.066667", "0.100000"]);
        assert!(text.lines().skip(1).all(|line| line.split(',').next() == line.split(',').nth(2)), "{text}");
        assert_eq!(report.figures["samples"], 4.0);
    }

    #[test]
    fn run_without_targets_leaves_a_table_without_rows() {
        let (text, report) = export(settings(0.0), Vec::new());
        assert_eq!(text, format!("{HEADER}\n"));
        assert_eq!(report.figures["targets"], 0.0);
    }

    #[test]
    fn settings_that_cannot_be_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let refused = |settings| ExportTargets::new(settings, &setup(folder.path())).map(|_| ()).unwrap_err().setting;
        let away = ExportTargetsSettings { file: "../x.csv".to_owned(), ..settings(0.0) };
        assert_eq!(refused(away).as_deref(), Some("file"));
        assert_eq!(refused(settings(-1.0)).as_deref(), Some("rate_hz"));
        assert_eq!(refused(settings(f64::NAN)).as_deref(), Some("rate_hz"));
    }
}
