//! `export.relief`: a point cloud as a picture of the bare surface, shaded as under a lamp beside the viewer.
//!
//! Each point is drawn at the camera's pixel that saw it, as bright as its normal is turned to the lamp: what is seen is the shape alone, without the surface's own colours.
//! The lamp stands above and to the left of who looks along the mean normal.

use std::fs;
use std::path::PathBuf;

use foveate::plot::canvas::Canvas;
use foveate::prelude::*;
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::csv::file_part;
use crate::row_file::write_whole;

ports! {
    CLOUD: In<PointCloud> = each("cloud");
}

figures! {
    "relief.pictures.*": count, high, "Clouds of the camera that were drawn";
}

/// The folder within the results.
const FOLDER: &str = "relief";
/// Where there is no point [gray level of red, green, blue].
const NOTHING: [u8; 3] = [38, 44, 58];
/// Points whose neighbours do not tell their normal.
const NO_NORMAL: [u8; 3] = [120, 90, 60];
/// Light of a surface that is turned away from the lamp, and of one that faces it [gray level].
const SHADES: [f32; 2] = [24.0, 250.0];

/// Settings of [`ExportRelief`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ExportReliefSettings {
    /// One cloud of the camera in so many is drawn [–]
    #[schemars(range(min = 1, max = 1000000))]
    pub every_n: u64,
    /// Pictures drawn at most [–]
    #[schemars(range(min = 1, max = 10000))]
    pub max_pictures: u64,
    /// How many pixels wide and high each pixel becomes [–]
    #[schemars(range(min = 1, max = 8))]
    pub zoom: u32,
}

impl Default for ExportReliefSettings {
    fn default() -> Self {
        Self { every_n: 1, max_pictures: 20, zoom: 1 }
    }
}

/// Clouds into `relief/<camera>_<number>.png`.
pub struct ExportRelief {
    settings: ExportReliefSettings,
    name: String,
    out_dir: Option<PathBuf>,
    n_seen: u64,
    n_drawn: u64,
    report: Report,
    fault: Option<String>,
}

impl Node for ExportRelief {
    const TYPE: &'static str = "export.relief";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Writes point clouds as pictures of the shaded surface, as PNG";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = ExportReliefSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: ExportReliefSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("every_n", settings.every_n, 1..=1_000_000)?;
        ConfigError::unless_in("max_pictures", settings.max_pictures, 1..=10_000)?;
        ConfigError::unless_in("zoom", settings.zoom, 1..=8)?;
        let name = file_part(setup.camera_name().unwrap_or(&setup.instance));
        setup.claim_file(None, &format!("{FOLDER}/{name}_*.png"))?;
        Ok(Self {
            settings,
            name,
            out_dir: setup.out_dir.clone(),
            n_seen: 0,
            n_drawn: 0,
            report: Report::default(),
            fault: None,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(cloud) = io.take(&CLOUD) {
            let is_wanted = self.n_seen.is_multiple_of(self.settings.every_n) && !cloud.value.is_empty();
            self.n_seen += 1;
            if is_wanted && self.n_drawn < self.settings.max_pictures {
                self.write(&cloud.value);
            }
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.figure(format!("relief.pictures.{}", self.name), self.n_drawn as f64);
        report.files.append(&mut self.report.files);
        self.fault.take().map_or(Ok(()), |fault| Err(NodeError::input(fault)))
    }
}

impl ExportRelief {
    fn write(&mut self, cloud: &PointCloud) {
        let name = format!("{FOLDER}/{}_{:06}.png", self.name, self.n_drawn);
        self.n_drawn += 1;
        let Some(out_dir) = &self.out_dir else { return };
        let folder = out_dir.join(FOLDER);
        let written = Canvas::of(&shaded(cloud), cloud.camera_size[0], 3, self.settings.zoom, 1.0)
            .png()
            .map_err(|error| format!("`{name}` cannot be encoded: {error}"))
            .and_then(|bytes| match fs::create_dir_all(&folder) {
                Ok(()) => write_whole(Some(out_dir), &name, &bytes, &mut self.report),
                Err(error) => Err(format!("`{}`: {error}", folder.display())),
            });
        if let Err(fault) = written {
            self.fault.get_or_insert(fault);
        }
    }
}

/// Red, green, blue of each pixel, row by row.
fn shaded(cloud: &PointCloud) -> Vec<u8> {
    let [width, height] = cloud.camera_size.map(|it| it as usize);
    let mut pixels = NOTHING.repeat(width * height);
    let sum: Vector3<f32> = cloud.iter().map(|it| it.normal).sum();
    let ahead = sum.try_normalize(1e-6).unwrap_or_else(Vector3::y);
    let left = ahead.cross(&Vector3::z()).try_normalize(1e-6).unwrap_or_else(Vector3::x);
    let lamp = (ahead + left * 0.6 + Vector3::z() * 0.6).normalize();
    for point in cloud.iter() {
        let [x, y] = point.pixel.map(usize::from);
        let Some(pixel) = (x < width && y < height).then(|| &mut pixels[3 * (y * width + x)..][..3]) else { continue };
        if point.normal == Vector3::zeros() {
            pixel.copy_from_slice(&NO_NORMAL);
        } else {
            let share = point.normal.dot(&lamp).max(0.0);
            pixel.fill((SHADES[0] + (SHADES[1] - SHADES[0]) * share) as u8);
        }
    }
    pixels
}

#[cfg(test)]
mod tests {
    use foveate_testkit::check_node;
    use nalgebra::{Matrix3, Point3};

    use super::*;

    /// A ball as who looks along −y sees it.
    fn ball() -> PointCloud {
        let mut cloud = PointCloud { camera_size: [41, 41], ..PointCloud::default() };
        for (row, column) in (0..41_u16).flat_map(|row| (0..41_u16).map(move |column| (row, column))) {
            let (right, up) = ((f32::from(column) - 20.0) / 20.0, (20.0 - f32::from(row)) / 20.0);
            let square = 1.0 - right * right - up * up;
            if square > 0.0 {
                // Looking along −y with z upwards, −x is to the right.
                let normal = Vector3::new(-right, square.sqrt(), up);
                cloud.push(&CloudPoint {
                    position: Point3::from(normal),
                    covariance: Matrix3::identity(),
                    normal,
                    confidence: 1.0,
                    pixel: [column, row],
                    colour: [9; 3],
                });
            }
        }
        cloud
    }

    #[test]
    fn node_keeps_the_law() {
        check_node::<ExportRelief>("");
        check_node::<ExportRelief>("every_n = 3\nzoom = 2");
    }

    #[test]
    fn a_ball_is_brightest_above_and_to_the_left() {
        let pixels = shaded(&ball());
        let at = |column: usize, row: usize| pixels[3 * (row * 41 + column)];
        assert!(at(12, 14) > 225, "{}", at(12, 14));
        assert!(at(12, 14) > at(30, 14) + 60 && at(12, 14) > at(12, 30) + 60);
        assert!(at(32, 34) < 80 && pixels[..3] == NOTHING);
    }

    #[test]
    fn clouds_become_pictures_that_can_be_read() {
        let folder = tempfile::tempdir().unwrap();
        let setup = Setup { out_dir: Some(folder.path().to_owned()), ..Setup::for_tests() };
        let settings = ExportReliefSettings { zoom: 2, ..ExportReliefSettings::default() };
        let mut node = ExportRelief::new(settings, &setup).unwrap();
        node.write(&ball());
        let mut report = Report::default();
        node.finish(&mut report).unwrap();
        assert_eq!(report.files.len(), 1);
        let picture = image::open(folder.path().join(&report.files[0])).unwrap();
        assert_eq!((picture.width(), picture.height()), (82, 82));
    }
}
