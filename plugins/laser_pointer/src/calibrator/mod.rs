//! `laser_pointer.calibrator`: maps cameras to a wall by dots that the wall shows.

mod dots;
#[cfg(test)]
mod tests;

use std::path::PathBuf;

use foveate::estimation::statistics::median;
use foveate::prelude::*;
use nalgebra::Point2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use dots::{CameraResult, DotCalibration, Frame, ShownDot, WallSize, calibrate};

/// A run with fewer dots was cut short: that is told, and no failure.
const LEAST_DOTS: usize = 40;

ports! {
    FEATURES: In<Features> = each("features").many();
    SHOWN: In<Targets> = each("shown");
}

figures! {
    "wall_calibration.cameras": count, high, "Cameras that were mapped to the wall";
    "wall_calibration.cameras_failed": count, low, "Cameras without a map: the remarks say why";
    "wall_calibration.dots": count, neither, "Dots that were shown";
    "wall_calibration.dots_seen.*": count, high, "Dots that this camera saw at one place";
    "wall_calibration.dots_hidden.*": count, low, "Dots within this camera's picture that another camera saw and this one did not";
    "wall_calibration.held_out_px.*": px, low, "Error of this camera's map at every fourth dot, fitted without them; root mean square, in pixels of the wall";
    "wall_calibration.held_out_median_px": px, low, "The median of these over the cameras";
    "wall_calibration.dark_displays": count, low, "Displays none of whose dots any camera saw";
}

/// Settings of [`Calibrator`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CalibratorSettings {
    /// Width and height of what the wall can show, bezels between displays included, as measured [m]
    pub size_m: [f64; 2],
    /// Side of a pixel of the wall [mm]
    #[schemars(range(min = 0.05, max = 20.0))]
    pub pixel_mm: f64,
    /// Displays along rows and columns [–]
    #[serde(default = "default_tiles")]
    pub tiles: [u32; 2],
    /// So long after it was asked for a dot is certain to be seen, and the one before it to be gone; more than the display's latency and two of its pictures [ms]
    #[schemars(range(min = 0.0, max = 10000.0))]
    #[serde(default = "default_settle_ms")]
    pub settle_ms: f64,
    /// Largest error at dots that were held out, root mean square; a camera with more gets no map [px of the wall]
    #[schemars(range(min = 0.01, max = 1000.0))]
    #[serde(default = "default_limit_px")]
    pub limit_px: f64,
    /// Name of the file with the maps that is written into the results folder [–]
    #[serde(default = "default_file")]
    pub file: String,
}

fn default_tiles() -> [u32; 2] {
    [1, 1]
}

fn default_settle_ms() -> f64 {
    60.0
}

fn default_limit_px() -> f64 {
    1.0
}

fn default_file() -> String {
    "wall.map.toml".to_owned()
}

/// Spots of each camera and what the wall was told to show in, one dot at a time; a file with the maps in the results folder, with what they are worth. Cameras that cannot
/// be mapped, displays that stay dark and dots that are hidden are named; the other cameras get their maps.
pub struct Calibrator {
    settings: CalibratorSettings,
    names: Vec<String>,
    sizes: Vec<[u32; 2]>,
    dots: Vec<ShownDot>,
    /// Times at which more dots than one were asked for.
    crowded: u64,
    frames: Vec<Vec<Frame>>,
    out_dir: Option<PathBuf>,
}

impl Node for Calibrator {
    const TYPE: &'static str = "laser_pointer.calibrator";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Maps cameras to a wall by dots that the wall shows, and says how good the maps are";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = CalibratorSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: CalibratorSettings, setup: &Setup) -> Result<Self, ConfigError> {
        for axis in 0..2 {
            ConfigError::unless_in("size_m", settings.size_m[axis], 0.01..=1000.0)?;
            ConfigError::unless_in("tiles", settings.tiles[axis], 1..=100)?;
        }
        ConfigError::unless_in("pixel_mm", settings.pixel_mm, 0.05..=20.0)?;
        ConfigError::unless_in("settle_ms", settings.settle_ms, 0.0..=10_000.0)?;
        ConfigError::unless_in("limit_px", settings.limit_px, 0.01..=1000.0)?;
        setup.claim_named_file("file", &settings.file)?;
        let cameras = &setup.calibration.cameras;
        Ok(Self {
            settings,
            names: cameras.iter().map(|it| it.name.clone()).collect(),
            sizes: cameras.iter().map(|it| it.camera.image_size).collect(),
            dots: Vec::new(),
            crowded: 0,
            frames: vec![Vec::new(); cameras.len()],
            out_dir: setup.out_dir.clone().filter(|_| setup.purpose == Purpose::Run),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(shown) = io.take(&SHOWN) {
            self.show(shown.time(), &shown.value.list);
        }
        while let Some(features) = io.take(&FEATURES) {
            let Some(frames) = self.frames.get_mut(usize::from(features.value.camera.0)) else { continue };
            let spots = features.value.list.iter().map(|it| (it.centre, it.covariance.trace() / 2.0, it.peak));
            frames.push(Frame { time: features.time(), spots: spots.collect() });
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        for frames in &mut self.frames {
            frames.sort_by_key(|it| it.time);
        }
        let CalibratorSettings { size_m, pixel_mm, tiles, settle_ms, limit_px, .. } = self.settings;
        let wall = WallSize { size_m, pixel_m: pixel_mm * 1e-3, tiles };
        let settle = Interval::from_ms(settle_ms);
        let found = calibrate(&wall, &self.sizes, &self.dots, &self.frames, settle, limit_px);
        self.tell(&found, report);
        let map = found.map(&wall, &self.names);
        if map.cameras.is_empty() {
            let n = self.dots.len();
            let message = format!("no camera could be mapped to the wall by its {n} dots");
            if n >= LEAST_DOTS {
                return Err(NodeError::input(message));
            }
            report.remark(format!("{message}: the run was over before there were {LEAST_DOTS}"));
            return Ok(());
        }
        let Some(folder) = &self.out_dir else { return Ok(()) };
        let path = folder.join(&self.settings.file);
        std::fs::write(&path, map.to_toml()).map_err(|error| {
            NodeError::input(format_args!(
                "{}: could not be saved ({error}), expected a folder that can be written",
                path.display()
            ))
        })?;
        report.file(&self.settings.file);
        Ok(())
    }
}

impl Calibrator {
    /// Takes in what the wall is told to show from `time` on.
    fn show(&mut self, time: Time, list: &[Target]) {
        self.crowded += u64::from(list.len() > 1);
        let [dot] = list else { return };
        match self.dots.last_mut() {
            Some(last) if last.number == dot.id.0 => last.until = time,
            _ => {
                let point = Point2::new(dot.position.x, dot.position.y);
                self.dots.push(ShownDot { number: dot.id.0, point, from: time, until: time });
            }
        }
    }

    fn tell(&self, found: &DotCalibration, report: &mut Report) {
        let (mut errors, mut failed) = (Vec::new(), 0);
        for ((name, camera), hidden) in self.names.iter().zip(&found.cameras).zip(&found.hidden) {
            report.figure(format!("wall_calibration.dots_seen.{name}"), camera.n_dots as f64);
            report.figure(format!("wall_calibration.dots_hidden.{name}"), *hidden as f64);
            match &camera.map {
                Ok(map) => {
                    errors.push(map.held_out_px);
                    report.figure(format!("wall_calibration.held_out_px.{name}"), map.held_out_px);
                }
                Err(why) => {
                    failed += 1;
                    report.remark(format!("camera `{name}` has no map: {why}"));
                }
            }
            if *hidden > 0 {
                report.remark(format!(
                    "camera `{name}` did not see {hidden} dots that lie in its picture and that other cameras saw: something stands in its way"
                ));
            }
            if camera.n_doubtful > 0 {
                report.remark(format!(
                    "camera `{name}` saw {} dots together with other lights, or moving: they were left out; is the wall dark but for the dots?",
                    camera.n_doubtful
                ));
            }
        }
        for ([column, row], n) in &found.dark {
            report.remark(format!(
                "display {} of row {} showed none of its {n} dots to any camera: it is off, or no camera sees it",
                column + 1,
                row + 1
            ));
        }
        if self.crowded > 0 {
            report.remark(format!(
                "more dots than one were asked for at {} moments: these were left out, expected one at a time",
                self.crowded
            ));
        }
        report.figure("wall_calibration.cameras", errors.len() as f64);
        report.figure("wall_calibration.cameras_failed", f64::from(failed));
        report.figure("wall_calibration.dots", self.dots.len() as f64);
        report.figure("wall_calibration.dark_displays", found.dark.len() as f64);
        if let Some(median) = median(&errors) {
            report.figure("wall_calibration.held_out_median_px", median);
        }
    }
}
