//! `export.marks`: the table of painted marks, one line for each mark and time.
//!
//! Columns: `time_s,mark,x_m,y_m,z_m`, the upper triangle of the position's covariance `cxx_m2,cxy_m2,cxz_m2,cyy_m2,cyz_m2,czz_m2`, `cameras` (names joined by
//! `+`: those whose features were used), `provenance` (`measured`, `predicted`, `filled`): all in the marks' own space, a head's or a knee's; then
//! `world_x_m` to `world_czz_m2`, the same in the world, with the uncertainty of that space's pose.

use std::collections::BTreeSet;
use std::sync::Arc;

use foveate::prelude::*;
use foveate::scene::{LengthUnit, UncertainPose};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::csv::{camera_names, check_file_name, field, fixed};
use crate::in_order::InOrder;
use crate::row_file::RowFile;
use crate::targets::write_point;

ports! {
    MARKS: In<Marks> = each("marks");
}

figures! {
    "marks": count, neither, "Different marks written";
        "marks.samples": count, neither, "Rows written, one per mark and time";
        "marks.samples_filled": count, neither, "Rows of marks that a model filled in";
}

const HEADER: &str = "time_s,mark,x_m,y_m,z_m,cxx_m2,cxy_m2,cxz_m2,cyy_m2,cyz_m2,czz_m2,cameras,provenance,\
     world_x_m,world_y_m,world_z_m,world_cxx_m2,world_cxy_m2,world_cxz_m2,world_cyy_m2,world_cyz_m2,world_czz_m2";

/// Settings of [`ExportMarks`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ExportMarksSettings {
    /// Name of the table in the results folder [–]
    #[serde(default = "default_file")]
    pub file: String,
}

fn default_file() -> String {
    "marks.csv".to_owned()
}

/// Painted marks into a CSV file. Of several messages of one time, the last is written.
pub struct ExportMarks {
    file: RowFile,
    order: InOrder<Arc<Marks>>,
    file_name: String,
    cameras: Vec<String>,
    unit_is_known: bool,
    text: String,
    samples: u64,
    filled: u64,
    seen: BTreeSet<u32>,
}

impl ExportMarks {
    fn write(&mut self, marks: &Marks) {
        let world_from_marks = UncertainPose { transform: marks.world_from_marks, covariance: marks.covariance };
        for mark in &marks.list {
            let text = &mut self.text;
            fixed(text, marks.time.as_s(), 6);
            text.push(',');
            text.push_str(&mark.label.to_string());
            write_point(text, &mark.position, &mark.covariance);
            text.push(',');
            let name = |it: CameraId| self.cameras.get(usize::from(it.0)).cloned().unwrap_or_else(|| it.0.to_string());
            text.push_str(&field(&mark.cameras.iter().map(name).collect::<Vec<_>>().join("+")));
            text.push(',');
            text.push_str(mark.provenance.name());
            let (position, covariance) = world_from_marks.transform_point(&mark.position, &mark.covariance);
            write_point(text, &position, &covariance);
            text.push('\n');
            self.samples += 1;
            self.filled += u64::from(mark.provenance == Provenance::Filled);
            self.seen.insert(mark.label);
        }
        self.file.push(&self.text);
        self.text.clear();
    }
}

impl Node for ExportMarks {
    const TYPE: &'static str = "export.marks";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str =
        "Writes painted marks to a CSV table: scale and world coordinates, covariance, cameras";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = ExportMarksSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: ExportMarksSettings, setup: &Setup) -> Result<Self, ConfigError> {
        check_file_name("file", &settings.file)?;
        setup.claim_file(Some("file"), &settings.file)?;
        Ok(Self {
            file: RowFile::new(setup, &settings.file, HEADER),
            order: InOrder::default(),
            file_name: settings.file,
            cameras: camera_names(setup),
            unit_is_known: setup.calibration.length_unit == LengthUnit::Metre,
            text: String::new(),
            samples: 0,
            filled: 0,
            seen: BTreeSet::new(),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let mut ready = Vec::new();
        while let Some(message) = io.take(&MARKS) {
            self.order.push(message.value.time, message.value, &mut |it| ready.push(it));
        }
        ready.iter().for_each(|it| self.write(it));
        self.file.flush_when_due(io.now());
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let mut ready = Vec::new();
        self.order.finish(&mut |it| ready.push(it));
        ready.iter().for_each(|it| self.write(it));
        if self.order.late() > 0 {
            let (name, n_late) = (&self.file_name, self.order.late());
            report.remark(format!("{name}: {n_late} messages came after a later one; their rows are out of order"));
        }
        report.figure("marks", self.seen.len() as f64);
        report.figure("marks.samples", self.samples as f64);
        report.figure("marks.samples_filled", self.filled as f64);
        if !self.unit_is_known && self.samples > 0 {
            let name = &self.file_name;
            report.remark(format!(
                "the lengths in {name} are in the calibration's own unit, whose length in metres is unknown"
            ));
        }
        self.file.finish(report)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, Vector3};

    use super::*;

    #[test]
    fn node_keeps_its_promises() {
        foveate_testkit::check_node::<ExportMarks>("");
    }

    #[test]
    fn marks_stand_in_their_own_space_and_in_the_world() {
        let folder = tempfile::tempdir().unwrap();
        let calibration = Arc::new(foveate_testkit::scene::ring_calibration(3));
        let setup = Setup { out_dir: Some(folder.path().to_owned()), calibration, ..Setup::for_tests() };
        let mut node = ExportMarks::new(toml::from_str("").unwrap(), &setup).unwrap();
        let mark = |label, provenance, cameras: &[u16]| Mark {
            label,
            position: Point3::new(0.1, 0.0, 0.0),
            covariance: Matrix3::from_diagonal(&Vector3::new(1e-6, 4e-6, 1e-6)),
            cameras: cameras.iter().map(|&it| CameraId(it)).collect(),
            provenance,
        };
        // The whole is known to 1 mm along its x axis.
        let mut covariance = Matrix6::zeros();
        covariance[(3, 3)] = 1e-6;
        node.write(&Marks {
            time: Time::from_s(0.25),
            world_from_marks: Isometry3::new(Vector3::z(), Vector3::z() * std::f64::consts::FRAC_PI_2),
            covariance,
            list: vec![mark(3, Provenance::Measured, &[0, 2]), mark(9, Provenance::Filled, &[])],
            fit: None,
        });
        let mut report = Report::default();
        node.finish(&mut report).unwrap();
        let text = std::fs::read_to_string(folder.path().join("marks.csv")).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0].split(',').count(), 22);
        let own =
            "0.100000,0.000000,0.000000,1.000000e-06,0.000000e+00,0.000000e+00,4.000000e-06,0.000000e+00,1.000000e-06";
        assert!(
            lines[1].starts_with(&format!("0.250000,3,{own},ring-1+ring-3,measured,0.000000,0.100000,1.000000,")),
            "{}",
            lines[1]
        );
        assert!(
            lines[2].starts_with(&format!("0.250000,9,{own},,filled,0.000000,0.100000,1.000000,4.000000e-06,")),
            "{}",
            lines[2]
        );
        let variance_along = |field: usize| lines[1].split(',').nth(field).unwrap().parse::<f64>().unwrap();
        assert!((variance_along(19) - 2e-6).abs() < 1e-12, "{}", lines[1]);
        assert_eq!((report.figures["marks"], report.figures["marks.samples_filled"]), (2.0, 1.0));
    }
}
