//! `surface.calibrator`: calibrates cameras, each from one picture or more of a cylinder with numbered columns of rectangles, all in the cylinder's space.
//!
//! The target's axis is the world's z, upwards, its first column lies on +x, the next ones in the direction of positive angles; heights are measured from the
//! target's own edge as `lowest_mm` says. Each camera by itself: direct linear transformation, then optics and lens. Rectangles of incomplete
//! columns are then labelled by their projections, and the camera is solved once more.

use std::collections::BTreeMap;

use foveate::geometry::known_points::direct_linear_transformation;
use foveate::geometry::{Camera, CameraFit, Freedom, KnownPoint, camera_from_points};
use foveate::prelude::*;
use foveate::scene::{Calibration, LengthUnit, NamedCamera};
use nalgebra::{Point2, Point3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

ports! {
    pub(crate) fn declared_ports;
    FEATURES: In<Features> = each("features").many();
}

figures! {
        "calibration.rms_px.*": px, low, "Root mean square reprojection error of the camera's rectangles, without those left out" => "rectangles off the calibration";
        "calibration.held_out_px.*": px, low, "The same for every fifth rectangle, under a calibration from the others, root mean square over all five rounds" => "rectangles held out";
    "calibration.linear_px.*": px, neither, "Root mean square distance under the direct linear transformation, without lens distortion, for comparison";
        "calibration.rectangles.*": count, high, "Rectangles used for the camera's calibration";
        "calibration.left_out.*": count, low, "Labelled rectangles left out as too far off";
        "calibration.focal_sigma.*": share, low, "Standard deviation of the camera's common focal length, relative";
}

/// Settings of [`TargetCalibrator`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct CalibratorSettings {
    /// Rectangles in a column, as in `surface.target` [–]
    #[schemars(range(min = 4, max = 100))]
    pub rows: usize,
    /// Columns all around [–]
    #[schemars(range(min = 3, max = 200))]
    pub columns: usize,
    /// Radius of the cylinder, paper included [mm]
    #[schemars(range(min = 1.0, max = 100000.0))]
    pub radius_mm: f64,
    /// From column to column along the surface [mm]
    #[schemars(range(min = 0.1, max = 10000.0))]
    pub column_mm: f64,
    /// From row to row [mm]
    #[schemars(range(min = 0.1, max = 10000.0))]
    pub row_mm: f64,
    /// Height of the lowest row [mm]
    #[schemars(range(min = -100000.0, max = 100000.0))]
    pub lowest_mm: f64,
    /// Whether decentring of the lens is estimated: two more parameters, which need a target that fills the picture [–]
    pub decentering: bool,
    /// Name of the calibration file in the results folder [–]
    pub file: String,
}

impl Default for CalibratorSettings {
    /// The target of the MultiDIC toolbox.
    fn default() -> Self {
        Self {
            rows: 20,
            columns: 14,
            radius_mm: 57.0,
            column_mm: 12.0,
            row_mm: 12.0,
            lowest_mm: 10.0,
            decentering: true,
            file: "target.calibration.toml".to_owned(),
        }
    }
}

impl CalibratorSettings {
    /// Where a rectangle lies, row 0 the highest [m].
    pub fn place(&self, label: u32) -> Option<Point3<f64>> {
        let (column, row) = (label as usize / self.rows, label as usize % self.rows);
        if column >= self.columns {
            return None;
        }
        let angle = self.column_mm / self.radius_mm * column as f64;
        let radius = self.radius_mm * 1e-3;
        let height = (self.lowest_mm + self.row_mm * (self.rows - 1 - row) as f64) * 1e-3;
        Some(Point3::new(radius * angle.cos(), radius * angle.sin(), height))
    }
}

/// Rectangles of all cameras in, a calibration in the results folder.
pub struct TargetCalibrator {
    settings: CalibratorSettings,
    cameras: Vec<(String, [u32; 2])>,
    /// By camera and label: sums of where it was seen, and how often.
    seen: BTreeMap<(u16, u32), (Point2<f64>, u32)>,
    unnamed: BTreeMap<u16, Vec<Point2<f64>>>,
    out_dir: Option<std::path::PathBuf>,
}

/// A rectangle without a name is the one that is seen this near to it, in steps of the rows.
const NEAR: f64 = 0.2;
/// Rectangles are found to a fraction of a pixel: farther off than this in the mean, the sizes of the target are others [px].
const MOST_RMS_PX: f64 = 1.5;
/// Two cameras nearer to each other than this part of their distance from the target took one picture [–].
const ONE_PLACE: f64 = 1e-3;
/// Turns of holding out.
const TURNS: usize = 5;

impl Node for TargetCalibrator {
    const TYPE: &'static str = "surface.calibrator";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Calibrates cameras around a cylinder with numbered columns of rectangles";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = CalibratorSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: CalibratorSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("rows", settings.rows, 4..=100)?;
        ConfigError::unless_in("columns", settings.columns, 3..=200)?;
        ConfigError::unless_in("radius_mm", settings.radius_mm, 1.0..=1e5)?;
        ConfigError::unless_in("column_mm", settings.column_mm, 0.1..=1e4)?;
        ConfigError::unless_in("row_mm", settings.row_mm, 0.1..=1e4)?;
        ConfigError::unless_in("lowest_mm", settings.lowest_mm, -1e5..=1e5)?;
        let around_mm = settings.columns as f64 * settings.column_mm;
        if around_mm > std::f64::consts::TAU * settings.radius_mm {
            return Err(ConfigError::at(
                "column_mm",
                format_args!(
                    "found {} columns over {around_mm} mm, expected them to fit around a cylinder of {:.1} mm",
                    settings.columns,
                    std::f64::consts::TAU * settings.radius_mm
                ),
            ));
        }
        setup.claim_named_file("file", &settings.file)?;
        let cameras = setup.calibration.cameras.iter().map(|it| (it.name.clone(), it.camera.image_size)).collect();
        let (seen, unnamed) = (BTreeMap::new(), BTreeMap::new());
        Ok(Self { settings, cameras, seen, unnamed, out_dir: setup.out_dir.clone() })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(features) = io.take(&FEATURES) else { return Ok(()) };
        let camera = features.value.camera.0;
        for feature in &features.value.list {
            match feature.label {
                Some(label) => {
                    let (sum, count) = self.seen.entry((camera, label)).or_insert((Point2::origin(), 0));
                    *sum += feature.centre.coords;
                    *count += 1;
                }
                None => self.unnamed.entry(camera).or_default().push(feature.centre),
            }
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let mut cameras = Vec::new();
        let mut faults = Vec::new();
        for (id, (name, image_size)) in self.cameras.iter().enumerate() {
            match self.solve(id as u16, *image_size, report, name) {
                Ok(camera) => cameras.push(NamedCamera { name: name.clone(), camera }),
                Err(fault) => faults.push(format!("`{name}` is not calibrated: {fault}")),
            }
        }
        if cameras.is_empty() {
            return Err(NodeError::input(faults.join("; ")));
        }
        faults.into_iter().for_each(|it| report.remark(it));
        for (at, a) in cameras.iter().enumerate() {
            for b in &cameras[at + 1..] {
                let (here, apart) = (a.camera.centre(), (a.camera.centre() - b.camera.centre()).norm());
                if apart < ONE_PLACE * here.coords.norm() {
                    report.remark(format!(
                        "`{}` and `{}` stand {:.2} mm apart, expected cameras at two places: is it one camera's picture twice?",
                        a.name,
                        b.name,
                        1e3 * apart
                    ));
                }
            }
        }
        let origin = format!(
            "surface.calibrator: cameras around a cylinder of {} mm with {} columns of known places",
            self.settings.radius_mm, self.settings.columns
        );
        let calibration = Calibration::new(cameras, LengthUnit::Metre, origin);
        let calibration = calibration.map_err(|it| NodeError::input(it.to_string()))?;
        if let Some(folder) = &self.out_dir {
            let saved = report.save(folder, &self.settings.file, calibration.to_toml());
            saved.map_err(|it| NodeError::input(it.to_string()))?;
        }
        Ok(())
    }
}

impl TargetCalibrator {
    fn solve(&self, id: u16, image_size: [u32; 2], report: &mut Report, name: &str) -> Result<Camera, String> {
        let free = Freedom {
            aspect: true,
            principal: true,
            k1: true,
            k2: true,
            decentering: self.settings.decentering,
            ..Freedom::POSE
        };
        let mut pairs: Vec<KnownPoint> = Vec::new();
        for ((_, label), (sum, count)) in self.seen.range((id, 0)..=(id, u32::MAX)) {
            if let Some(place) = self.settings.place(*label) {
                pairs.push(KnownPoint { place, pixel: sum / f64::from(*count) });
            }
        }
        let first = camera_from_points(image_size, &pairs, free).map_err(|it| it.to_string())?;
        let named = self.name_others(id, &first.camera, &pairs);
        pairs.extend(named);
        let CameraFit { camera, used, rms_px, focal_sigma } =
            camera_from_points(image_size, &pairs, free).map_err(|it| it.to_string())?;
        let kept: Vec<KnownPoint> = pairs.iter().zip(&used).filter(|it| *it.1).map(|it| *it.0).collect();
        report.figure(format!("calibration.rms_px.{name}"), rms_px);
        if rms_px > MOST_RMS_PX {
            report.remark(format!(
                "`{name}`: the reprojection error of the rectangles is {rms_px:.2} px, root mean square, expected less than {MOST_RMS_PX} px: do `radius_mm`, `column_mm` and `row_mm` ({}, {}, {}) match the target?",
                self.settings.radius_mm, self.settings.column_mm, self.settings.row_mm
            ));
        }
        report.figure(format!("calibration.rectangles.{name}"), kept.len() as f64);
        report.figure(format!("calibration.left_out.{name}"), (pairs.len() - kept.len()) as f64);
        report.figure(format!("calibration.focal_sigma.{name}"), focal_sigma);
        if let Ok(linear) = direct_linear_transformation(image_size, &kept) {
            report.figure(format!("calibration.linear_px.{name}"), rms(kept.iter().filter_map(|it| off(&linear, it))));
        }
        let mut held_out = Vec::new();
        for turn in 0..TURNS {
            let part =
                |out: bool| kept.iter().enumerate().filter(move |it| (it.0 % TURNS == turn) == out).map(|it| *it.1);
            if let Ok(fit) = camera_from_points(image_size, &part(false).collect::<Vec<_>>(), free) {
                held_out.extend(part(true).filter_map(|it| off(&fit.camera, &it)));
            }
        }
        report.figure(format!("calibration.held_out_px.{name}"), rms(held_out.into_iter()));
        Ok(camera)
    }

    /// Rectangles without a name that lie where the camera sees one that it has not yet.
    fn name_others(&self, id: u16, camera: &Camera, known: &[KnownPoint]) -> Vec<KnownPoint> {
        let Some(others) = self.unnamed.get(&id) else { return Vec::new() };
        let axis = Point3::new(0.0, 0.0, camera.centre().z);
        let mut named = Vec::new();
        for label in 0..(self.settings.rows * self.settings.columns) as u32 {
            let Some(place) = self.settings.place(label) else { continue };
            // From the front only.
            let outwards = Point3::new(place.x, place.y, axis.z) - axis;
            let is_seen = outwards.dot(&(camera.centre() - place)) > 0.0;
            let above = Point3::new(place.x, place.y, place.z + self.settings.row_mm * 1e-3);
            let Some((pixel, next)) = camera.sees(&place).zip(camera.project(&above)).filter(|_| is_seen) else {
                continue;
            };
            if known.iter().any(|it| it.place == place) {
                continue;
            }
            let step = (next - pixel).norm();
            let nearest = others.iter().min_by(|a, b| (*a - pixel).norm().total_cmp(&(*b - pixel).norm()));
            if let Some(nearest) = nearest.filter(|it| (*it - pixel).norm() < NEAR * step) {
                named.push(KnownPoint { place, pixel: *nearest });
            }
        }
        named
    }
}

fn off(camera: &Camera, pair: &KnownPoint) -> Option<f64> {
    Some((camera.project(&pair.place)? - pair.pixel).norm())
}

fn rms(distances: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = distances.fold((0.0, 0.0), |(sum, count), it| (sum + it * it, count + 1.0));
    (sum / count).sqrt()
}
