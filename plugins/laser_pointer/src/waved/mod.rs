//! `laser_pointer.wave_calibrator`: maps cameras to a wall from a pointer that is held at its corners and waved over it, without prior maps.

mod rests;
mod solve;
#[cfg(test)]
mod tests;
mod touched;

use std::path::PathBuf;

use foveate::estimation::statistics::median;
use foveate::geometry::plane_map::network::LEAST_PLACES;
use foveate::prelude::*;
use foveate::scene::{WallCamera, WallMap};
use foveate_calibration::recording::{CameraFrame, CameraGuess, Recording, Spot};
use nalgebra::Point2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use solve::{Touches, Waved, solve, worst_sigma};
use touched::wrong;

/// A shorter run was interrupted, which is a remark and no failure [s].
const LEAST_S: f64 = 10.0;
/// Places may be this far outside of the displayed area, on the wall's frame [m].
const BESIDE_M: f64 = 0.1;
/// A camera that shares less of its picture with others is extrapolated over the rest, which is reported [–].
const LITTLE_SHARED: f64 = 0.3;

ports! {
    FEATURES: In<Features> = each("features").many();
}

figures! {
    "wave_calibration.cameras": count, high, "Cameras that were mapped to the wall" => "cameras mapped to the wall";
    "wave_calibration.cameras_failed": count, low, "Cameras without a map: the remarks say why";
    "wave_calibration.shared_moments": count, high, "Moments at which two or more mapped cameras saw the waved pointer";
    "wave_calibration.held_out_px.*": px, low, "Distance between the pointer's place by this camera and by the others, as the error of one camera, at held-out moments (every fourth); root mean square, in pixels of the wall; errors common to all cameras are not included";
    "wave_calibration.held_out_median_px": px, low, "The median of these over the cameras" => "error of the maps at what was held out, median camera";
    "wave_calibration.touch_px": px, low, "Distance of touched places from their place by maps that were fitted without each; root mean square, in pixels of the wall; with five places or more";
    "wave_calibration.worst_sigma_px.*": px, low, "Largest standard deviation of a place on the wall over this camera's picture, by the map's covariance, in pixels of the wall";
    "wave_calibration.outliers.*": count, low, "Observations of this camera that fit badly: reflections and other lights";
}

/// Settings of [`WaveCalibrator`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WaveCalibratorSettings {
    /// Width and height of the displayed area, bezels between displays included, as measured [m]
    pub size_m: [f64; 2],
    /// Side of a pixel of the wall [mm]
    #[schemars(range(min = 0.05, max = 20.0))]
    pub pixel_mm: f64,
    /// Places of the wall at which the pointer is held before it is waved, in this order; four or more. Left out: the corners of `size_m`, clockwise from the upper left [m]
    #[serde(default)]
    pub touch_m: Vec<[f64; 2]>,
    /// Accuracy of holding it there, standard deviation along each axis [mm]
    #[schemars(range(min = 0.01, max = 100.0))]
    #[serde(default = "default_touch_mm")]
    pub touch_mm: f64,
    /// Largest distance of a place from its position by maps of the other places; a place beyond that is refused [σ]
    #[schemars(range(min = 1.0, max = 1000.0))]
    #[serde(default = "default_touch_sigmas")]
    pub touch_sigmas: f64,
    /// How long it is held at each, at least; a waved pointer does not rest that long [s]
    #[schemars(range(min = 0.2, max = 60.0))]
    #[serde(default = "default_hold_s")]
    pub hold_s: f64,
    /// Largest error at held-out moments, root mean square, and largest standard deviation of a place by the map; a camera with larger ones gets no map [px of the wall]
    #[schemars(range(min = 0.01, max = 1000.0))]
    #[serde(default = "default_limit_px")]
    pub limit_px: f64,
    /// Largest brightness of the wall itself in the cameras' pictures, for the tracker: it cannot be measured here [gray level]
    #[schemars(range(min = 1.0, max = 255.0))]
    pub brightest: f64,
    /// Name of the file with the maps in the results folder [–]
    #[serde(default = "default_file")]
    pub file: String,
}

fn default_touch_mm() -> f64 {
    1.0
}

fn default_touch_sigmas() -> f64 {
    6.0
}

fn default_hold_s() -> f64 {
    0.8
}

fn default_limit_px() -> f64 {
    5.0
}

fn default_file() -> String {
    "wall.map.toml".to_owned()
}

/// Spots of each camera in; a file with the maps and their errors in the results folder. One pointer is held at a few known places of the wall and then waved
/// all over it, above all where views overlap. Cameras that cannot be connected to the others are named; the others get their maps.
pub struct WaveCalibrator {
    settings: WaveCalibratorSettings,
    recording: Recording,
    out_dir: Option<PathBuf>,
}

impl Node for WaveCalibrator {
    const TYPE: &'static str = "laser_pointer.wave_calibrator";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str =
        "Maps cameras to a wall from a pointer held at its corners and waved where views overlap";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = WaveCalibratorSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: WaveCalibratorSettings, setup: &Setup) -> Result<Self, ConfigError> {
        for side in settings.size_m {
            ConfigError::unless_in("size_m", side, 0.01..=1000.0)?;
        }
        ConfigError::unless_in("pixel_mm", settings.pixel_mm, 0.05..=20.0)?;
        ConfigError::unless_in("touch_mm", settings.touch_mm, 0.01..=100.0)?;
        ConfigError::unless_in("touch_sigmas", settings.touch_sigmas, 1.0..=1000.0)?;
        ConfigError::unless_in("hold_s", settings.hold_s, 0.2..=60.0)?;
        ConfigError::unless_in("limit_px", settings.limit_px, 0.01..=1000.0)?;
        ConfigError::unless_in("brightest", settings.brightest, 1.0..=255.0)?;
        let n = settings.touch_m.len();
        if n > 0 && n < LEAST_PLACES {
            let message = format!("found {n} places, expected at least {LEAST_PLACES}, or none for the corners");
            return Err(ConfigError::at("touch_m", message));
        }
        for (place, at) in settings.touch_m.iter().enumerate() {
            if !(0..2).all(|axis| (-BESIDE_M..=settings.size_m[axis] + BESIDE_M).contains(&at[axis])) {
                let [width, height] = settings.size_m;
                let message = format!(
                    "found ({}, {}) m, expected a place of the wall, which is {width} m by {height} m (`size_m`)",
                    at[0], at[1]
                );
                return Err(ConfigError::at(&format!("touch_m[{place}]"), message));
            }
        }
        setup.claim_named_file("file", &settings.file)?;
        let cameras = setup.calibration.cameras.iter().map(|it| CameraGuess {
            name: it.name.clone(),
            camera: it.camera.clone(),
            free: foveate::geometry::bundle::Freedom::default(),
        });
        Ok(Self {
            recording: Recording { cameras: cameras.collect(), camera_frames: Vec::new() },
            settings,
            out_dir: setup.out_dir.clone().filter(|_| setup.purpose == Purpose::Run),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(features) = io.take(&FEATURES) {
            let camera = usize::from(features.value.camera.0);
            if camera >= self.recording.cameras.len() {
                continue;
            }
            let spots = features.value.list.iter().map(|it| Spot {
                pixel: it.centre,
                sigma_px: (it.covariance.trace() / 2.0).sqrt().max(1e-3),
                // Of full spots the larger one is the pointer: the other is its reflection.
                peak: f64::from(it.peak) + f64::from(it.area) * 1e-3,
                label: None,
            });
            let time_s = features.time().as_s();
            self.recording.camera_frames.push(CameraFrame { camera, time_s, spots: spots.collect() });
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let frames = &mut self.recording.camera_frames;
        frames.sort_by(|a, b| a.time_s.total_cmp(&b.time_s).then(a.camera.cmp(&b.camera)));
        let lasted_s = frames.last().map_or(0.0, |it| it.time_s) - frames.first().map_or(0.0, |it| it.time_s);
        let WaveCalibratorSettings { size_m, pixel_mm, touch_mm, hold_s, .. } = self.settings;
        let mut places: Vec<Point2<f64>> = self.settings.touch_m.iter().map(|it| Point2::from(*it)).collect();
        if places.is_empty() {
            let [width, height] = size_m;
            places = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]].map(Point2::from).into();
        }
        let touches = Touches { places, sigma: touch_mm * 1e-3, hold_s };
        let found = match solve(&self.recording, &touches) {
            Ok(found) => found,
            Err(why) if lasted_s >= LEAST_S => {
                return Err(NodeError::input(format_args!("no camera could be mapped to the wall: {why}")));
            }
            Err(why) => {
                report.remark(format!(
                    "no camera could be mapped to the wall, the run ended after {lasted_s:.1} s: {why}"
                ));
                return Ok(());
            }
        };
        let cameras = self.judged(&found, report);
        if found.touched.is_empty() {
            report.remark("with four touched places none can be checked against the others, and a wrong one is not detected; six identify it (`touch_m`)");
        }
        if let Some(why) = wrong(&found.touched, self.settings.touch_sigmas) {
            return Err(NodeError::input(format_args!("no map is written: {why}")));
        }
        if cameras.is_empty() {
            return Err(NodeError::input(
                "no camera could be mapped to the wall: the remarks give the reason for each",
            ));
        }
        let map = WallMap { size_m, pixel_m: pixel_mm * 1e-3, cameras: cameras.into_iter().collect() };
        let Some(folder) = &self.out_dir else { return Ok(()) };
        report.save(folder, &self.settings.file, map.to_toml())
    }
}

impl WaveCalibrator {
    /// Figures and remarks, and the accepted maps by their cameras' names.
    fn judged(&self, found: &Waved, report: &mut Report) -> Vec<(String, WallCamera)> {
        let WaveCalibratorSettings { size_m, pixel_mm, limit_px, brightest, .. } = self.settings;
        let pixel_m = pixel_mm * 1e-3;
        let (mut good, mut errors) = (Vec::new(), Vec::new());
        for (number, guess) in self.recording.cameras.iter().enumerate() {
            let name = &guess.name;
            let why = match &found.network.maps[number] {
                Err(why) => why.to_string(),
                Ok(map) => {
                    let held_out_px = found.held_out_m[number].map_or(f64::NAN, |it| it / pixel_m);
                    let sigma_px = worst_sigma(map, size_m) / pixel_m;
                    report.figure(format!("wave_calibration.held_out_px.{name}"), held_out_px);
                    report.figure(format!("wave_calibration.worst_sigma_px.{name}"), sigma_px);
                    report.figure(format!("wave_calibration.outliers.{name}"), found.network.outliers[number] as f64);
                    let part = found.shared_part[number];
                    if part.iter().any(|it| *it < LITTLE_SHARED) {
                        report.remark(format!(
                            "camera `{name}` shares {:.0} % of its picture's width and {:.0} % of its height with others: over the rest its map is extrapolated",
                            100.0 * part[0],
                            100.0 * part[1]
                        ));
                    }
                    if held_out_px <= limit_px && sigma_px <= limit_px {
                        errors.push(held_out_px);
                        let held_out_px = held_out_px.max(1e-6);
                        good.push((name.clone(), WallCamera { map: map.clone(), held_out_px, brightest }));
                        continue;
                    }
                    format!(
                        "at held-out moments it is off by {held_out_px:.2} px of the wall, and its places are uncertain by up to {sigma_px:.2}, expected at most {limit_px} of both: is the wall flat, was one pointer alone on it, and was it waved where views overlap?"
                    )
                }
            };
            report.remark(format!("camera `{name}` has no map: {why}"));
        }
        let n = self.recording.cameras.len();
        report.figure("wave_calibration.cameras", good.len() as f64);
        report.figure("wave_calibration.cameras_failed", (n - good.len()) as f64);
        report.figure("wave_calibration.shared_moments", found.n_shared as f64);
        if let Some(median) = median(&errors) {
            report.figure("wave_calibration.held_out_median_px", median);
        }
        if !found.touched.is_empty() {
            let mean = found.touched.iter().map(|it| it.miss * it.miss).sum::<f64>() / found.touched.len() as f64;
            report.figure("wave_calibration.touch_px", mean.sqrt() / pixel_m);
        }
        if found.n_wild > 0 {
            report.remark(format!(
                "at {} held-out moments the cameras' places of the pointer are more than 5 cm apart: reflections, or a second pointer",
                found.n_wild
            ));
        }
        good
    }
}
