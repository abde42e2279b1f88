//! `export.features`: 2D detections as a CSV table, in the form that `capture.detections` reads.
//!
//! Columns: `time_s,camera,x_px,y_px,sigma_px,area_px,peak,cxx_px2,cxy_px2,cyy_px2,label`. A picture in which nothing was found is a
//! row that ends after the camera, which distinguishes it from a missing picture. `sigma_px` is the root of the mean variance of both
//! coordinates, for people; the next columns are the whole covariance. `label` is empty where a point has none.

use std::collections::BTreeSet;
use std::fmt::Write;

use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::csv::{check_file_name, field, fixed, scientific};
use crate::row_file::RowFile;

ports! {
    FEATURES: In<Features> = each("features").many();
}

figures! {
    "features": count, neither, "Features written";
        "features.pictures": count, neither, "Messages of features received, including empty ones";
        "features.cameras": count, neither, "Cameras with features";
}

const HEADER: &str = "time_s,camera,x_px,y_px,sigma_px,area_px,peak,cxx_px2,cxy_px2,cyy_px2,label";

/// The smallest value with six decimals [px]; a reader refuses 0.
const SIGMA_FLOOR: f64 = 1e-6;

/// Settings of [`ExportFeatures`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ExportFeaturesSettings {
    /// Name of the table in the results folder [–]
    #[serde(default = "default_file")]
    pub file: String,
}

fn default_file() -> String {
    "features.csv".to_owned()
}

/// Features of any number of cameras into one CSV file, in the order of delivery.
pub struct ExportFeatures {
    file: RowFile,
    cameras: Vec<String>,
    text: String,
    pictures: u64,
    points: u64,
    seen: BTreeSet<CameraId>,
}

impl ExportFeatures {
    fn write(&mut self, time: Time, features: &Features) {
        let known = self.cameras.get(usize::from(features.camera.0)).cloned();
        let camera = known.unwrap_or_else(|| features.camera.0.to_string());
        let start = |text: &mut String| {
            // Nanoseconds, so that times come back as they were.
            fixed(text, time.as_s(), 9);
            write!(text, ",{camera},").ok();
        };
        if features.list.is_empty() {
            start(&mut self.text);
            self.text.push_str(",,,,,,,,\n");
        }
        for feature in &features.list {
            start(&mut self.text);
            fixed(&mut self.text, feature.centre.x, 6);
            self.text.push(',');
            fixed(&mut self.text, feature.centre.y, 6);
            self.text.push(',');
            let variance = (feature.covariance.trace() / 2.0).max(SIGMA_FLOOR * SIGMA_FLOOR);
            fixed(&mut self.text, variance.sqrt(), 6);
            write!(self.text, ",{},{}", feature.area, feature.peak).ok();
            for place in [(0, 0), (0, 1), (1, 1)] {
                self.text.push(',');
                scientific(&mut self.text, feature.covariance[place]);
            }
            self.text.push(',');
            if let Some(label) = feature.label {
                write!(self.text, "{label}").ok();
            }
            self.text.push('\n');
        }
        self.pictures += 1;
        self.points += features.list.len() as u64;
        self.seen.insert(features.camera);
        self.file.push(&self.text);
        self.text.clear();
    }
}

impl Node for ExportFeatures {
    const TYPE: &'static str = "export.features";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Writes 2D detections to a CSV table that `capture.detections` reads";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = ExportFeaturesSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: ExportFeaturesSettings, setup: &Setup) -> Result<Self, ConfigError> {
        check_file_name("file", &settings.file)?;
        setup.claim_file(Some("file"), &settings.file)?;
        Ok(Self {
            file: RowFile::new(setup, &settings.file, HEADER),
            cameras: setup.calibration.cameras.iter().map(|it| field(&it.name).into_owned()).collect(),
            text: String::new(),
            pictures: 0,
            points: 0,
            seen: BTreeSet::new(),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(message) = io.take(&FEATURES) {
            self.write(message.time(), &message.value);
        }
        self.file.flush_when_due(io.now());
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.figure("features", self.points as f64);
        report.figure("features.pictures", self.pictures as f64);
        report.figure("features.cameras", self.seen.len() as f64);
        self.file.finish(report)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use nalgebra::{Matrix2, Point2};

    use super::*;

    #[test]
    fn node_keeps_its_promises() {
        foveate_testkit::check_node::<ExportFeatures>("file = \"points.csv\"");
    }

    #[test]
    fn points_and_empty_pictures_are_rows() {
        let folder = tempfile::tempdir().unwrap();
        let calibration = Arc::new(foveate_testkit::scene::ring_calibration(2));
        let setup = Setup { out_dir: Some(folder.path().to_owned()), calibration, ..Setup::for_tests() };
        let settings = ExportFeaturesSettings { file: default_file() };
        let mut node = ExportFeatures::new(settings, &setup).unwrap();
        let feature = Feature {
            centre: Point2::new(1.25, -0.5),
            covariance: Matrix2::new(0.01, 0.0, 0.0, 0.03),
            area: 12,
            peak: 200,
            label: None,
        };
        let labelled = Feature { label: Some(17), ..feature };
        node.write(Time(16_666_667), &Features { camera: CameraId(1), list: vec![feature, labelled] });
        node.write(Time(20_000_000), &Features { camera: CameraId(0), list: Vec::new() });
        let mut report = Report::default();
        node.finish(&mut report).unwrap();
        let first = "0.016666667,ring-2,1.250000,-0.500000,0.141421,12,200,1.000000e-02,0.000000e+00,3.000000e-02,";
        let expected = format!("{HEADER}\n{first}\n{first}17\n0.020000000,ring-1,,,,,,,,,\n");
        assert_eq!(std::fs::read_to_string(folder.path().join("features.csv")).unwrap(), expected);
        assert_eq!(report.figures["features"], 2.0);
        assert_eq!(report.figures["features.pictures"], 2.0);
    }
}
