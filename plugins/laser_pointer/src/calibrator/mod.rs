//! `laser_pointer.calibrator`: maps cameras to a wall from dots that the wall shows, or by a chessboard.

mod boards;
mod extent;
mod fit;
mod held;
mod shown;
#[cfg(test)]
mod tests;

use std::path::PathBuf;

use foveate::estimation::statistics::median;
use foveate::prelude::*;
use nalgebra::Point2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use boards::BoardSize;
pub use fit::Surface;
pub use held::HeldBoard;
pub use shown::{CameraResult, Frame, Shown, ShownCalibration, ShownOptions, Spot, WallSize, calibrate};

/// A run with fewer dots was interrupted, which is a remark and no failure.
const LEAST_DOTS: usize = 40;
/// The same for places of a board.
const LEAST_BOARDS: usize = 20;

ports! {
    FEATURES: In<Features> = each("features").many();
    SHOWN: In<Targets> = each("shown");
}

figures! {
    "wall_calibration.cameras": count, high, "Cameras that were mapped to the wall" => "cameras mapped to the wall";
    "wall_calibration.cameras_failed": count, low, "Cameras without a map: the remarks say why";
    "wall_calibration.dots": count, neither, "Dots, or places of a board, that were shown";
        "wall_calibration.dots_seen.*": count, high, "Dots, or places of a board, that this camera saw at rest";
    "wall_calibration.dots_hidden.*": count, low, "Dots, or places of a board, in this camera's picture that only another camera saw";
    "wall_calibration.held_out_px.*": px, low, "Error of this camera's map at every fourth dot, fitted without them, or at the corners of a board at places held out in four rounds; root mean square, in pixels of the wall";
    "wall_calibration.held_out_median_px": px, low, "The median of these over the cameras" => "error of the maps at dots held out, median camera";
        "wall_calibration.dark_displays": count, low, "Displays on which no camera saw a dot or a board";
}

/// Settings of [`Calibrator`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CalibratorSettings {
    /// Width and height of the displayed area, bezels between displays included, as measured [m]
    pub size_m: [f64; 2],
    /// Side of a pixel of the wall [mm]
    #[schemars(range(min = 0.05, max = 20.0))]
    pub pixel_mm: f64,
    /// Displays along rows and columns [–]
    #[serde(default = "default_tiles")]
    pub tiles: [u32; 2],
    /// Shape of the wall: `flat`, or `curved` along an arc or wavy, which needs dots, at least 32 of them in each camera's picture [–]
    #[serde(default)]
    pub surface: Surface,
    /// Delay after a request until the dot is certainly seen, and the one before it gone; more than the display's latency and two of its pictures [ms]
    #[schemars(range(min = 0.0, max = 10000.0))]
    #[serde(default = "default_settle_ms")]
    pub settle_ms: f64,
    /// Largest error at held-out dots, root mean square; a camera with a larger error gets no map [px of the wall]
    #[schemars(range(min = 0.01, max = 1000.0))]
    #[serde(default = "default_limit_px")]
    pub limit_px: f64,
    /// Inner corners of a chessboard along its rows and columns, the same as those of `board.detector`: then the wall shows it at one place after another, each of its corners
    /// a target of `shown` whose identity counts row by row. Left out: dots [–]
    #[serde(default)]
    pub board: Option<BoardSize>,
    /// Times and places of a printed board that was held flat on the wall, instead of `shown` [–]
    #[serde(default)]
    pub held: Vec<HeldBoard>,
    /// Largest brightness of the wall itself in the cameras' pictures, for the tracker. Left out: the brightness of the dots, or of the board's white, in each camera [gray level]
    #[serde(default)]
    pub brightest: Option<f64>,
    /// Name of the file with the maps in the results folder [–]
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

/// Spots of each camera and the wall's requested dots or boards in, one at a time; a file with the maps and their errors in the results folder. Cameras that cannot
/// be mapped, dark displays and hidden dots are named; the other cameras get their maps.
pub struct Calibrator {
    settings: CalibratorSettings,
    names: Vec<String>,
    sizes: Vec<[u32; 2]>,
    shown: Vec<Shown>,
    /// The identity and the first place of what was shown last.
    last: Option<(u32, Point2<f64>)>,
    /// Whether the last request was to show something.
    is_showing: bool,
    /// Times with requests of several dots, or of another number of corners than the board's.
    crowded: u64,
    frames: Vec<Vec<Frame>>,
    out_dir: Option<PathBuf>,
}

impl Node for Calibrator {
    const TYPE: &'static str = "laser_pointer.calibrator";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Maps cameras to a wall from dots or a chessboard on it, and rates the maps";
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
        ConfigError::unless_in("brightest", settings.brightest.unwrap_or(255.0), 1.0..=255.0)?;
        for corners in settings.board.into_iter().flatten() {
            ConfigError::unless_in("board", corners, 3..=100)?;
        }
        if let (false, None) = (settings.held.is_empty(), settings.board) {
            return Err(ConfigError::at(
                "held",
                "found places of a board, expected `board` with its number of corners",
            ));
        }
        if settings.surface == Surface::Curved && settings.board.is_some() {
            let message = "found `curved` with a board, expected dots: the orientation of a board can be resolved on a plane only";
            return Err(ConfigError::at("surface", message));
        }
        let mut shown = Vec::new();
        for held in &settings.held {
            shown.push(held.shown(settings.board.unwrap_or_default())?);
        }
        shown.sort_by_key(|it: &Shown| it.from);
        setup.claim_named_file("file", &settings.file)?;
        let cameras = &setup.calibration.cameras;
        Ok(Self {
            settings,
            names: cameras.iter().map(|it| it.name.clone()).collect(),
            sizes: cameras.iter().map(|it| it.camera.image_size).collect(),
            shown,
            last: None,
            is_showing: false,
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
            let spots = features.value.list.iter().map(|it| Spot {
                pixel: it.centre,
                variance: it.covariance.trace() / 2.0,
                peak: it.peak,
                label: it.label,
            });
            let mut spots: Vec<Spot> = spots.collect();
            spots.sort_by_key(|it| it.label);
            frames.push(Frame { time: features.time(), spots });
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        for frames in &mut self.frames {
            frames.sort_by_key(|it| it.time);
        }
        let CalibratorSettings { size_m, pixel_mm, tiles, settle_ms, limit_px, board, surface, .. } = self.settings;
        let wall = WallSize { size_m, pixel_m: pixel_mm * 1e-3, tiles };
        let options = ShownOptions { board, settle: Interval::from_ms(settle_ms), surface, limit_px };
        let things = self.things();
        extent::beyond(&wall, &self.shown, things).map_err(NodeError::input)?;
        let found = calibrate(&wall, &self.sizes, &self.shown, &self.frames, &options);
        // A wall that has shown everything is told to show nothing.
        let is_cut = self.is_showing && self.settings.held.is_empty();
        if is_cut {
            report.remark(format!(
                "the run ended before all {things} were shown, after {} of them: extend it (`duration_s`)",
                self.shown.len()
            ));
        } else if self.settings.held.is_empty() {
            extent::doubts(&wall, &self.shown, things).into_iter().for_each(|it| report.remark(it));
        }
        self.tell(&found, is_cut, report);
        let mut map = found.map(&wall, &self.names);
        if let Some(brightest) = self.settings.brightest {
            map.cameras.values_mut().for_each(|it| it.brightest = brightest);
        }
        if map.cameras.is_empty() {
            let n = self.shown.len();
            let least = if board.is_some() { LEAST_BOARDS } else { LEAST_DOTS };
            let message = format!("no camera could be mapped to the wall from {n} {}", self.things());
            if n >= least {
                return Err(NodeError::input(message));
            }
            report.remark(format!("{message}: the run ended before there were {least}"));
            return Ok(());
        }
        let Some(folder) = &self.out_dir else { return Ok(()) };
        report.save(folder, &self.settings.file, map.to_toml())
    }
}

impl Calibrator {
    /// Takes in what the wall is requested to show from `time` on.
    fn show(&mut self, time: Time, list: &[Target]) {
        let n = self.settings.board.map_or(1, |[columns, rows]| (columns * rows) as usize);
        let mut list: Vec<&Target> = list.iter().collect();
        list.sort_by_key(|it| it.id);
        self.is_showing = !list.is_empty();
        let Some(first) = list.first() else { return };
        if list.len() != n || !self.settings.held.is_empty() {
            self.crowded += 1;
            return;
        }
        let begins = Some((first.id.0, first.position.xy()));
        match self.shown.last_mut().filter(|_| self.last == begins) {
            Some(last) => last.until = time,
            None => {
                let points = list.iter().map(|it| it.position.xy()).collect();
                self.shown.push(Shown { points, from: time, until: time });
            }
        }
        self.last = begins;
    }

    /// Name of the shown objects in messages.
    fn things(&self) -> &'static str {
        if self.settings.board.is_some() { "places of a board" } else { "dots" }
    }

    fn tell(&self, found: &ShownCalibration, is_cut: bool, report: &mut Report) {
        let (mut errors, mut failed) = (Vec::new(), 0);
        let things = self.things();
        for ((name, camera), hidden) in self.names.iter().zip(&found.cameras).zip(&found.hidden) {
            report.figure(format!("wall_calibration.dots_seen.{name}"), camera.n_seen as f64);
            report.figure(format!("wall_calibration.dots_hidden.{name}"), *hidden as f64);
            match &camera.map {
                Ok(map) => {
                    errors.push(map.held_out_px);
                    report.figure(format!("wall_calibration.held_out_px.{name}"), map.held_out_px);
                }
                Err(why) => {
                    failed += 1;
                    // What comes after a colon asks about the room.
                    let so_far = why.split_once(": ").map_or(why.as_str(), |it| it.0);
                    report.remark(match is_cut {
                        true => format!("camera `{name}` has no map from what the wall has shown so far: {so_far}"),
                        false => format!("camera `{name}` has no map: {why}"),
                    });
                }
            }
            if *hidden > 0 {
                report.remark(format!(
                    "camera `{name}` did not see {hidden} {things} in its picture that other cameras saw: something blocks its view"
                ));
            }
            if let Some(stance) = camera.stance {
                report.remark(format!("camera `{name}` sees the wall {stance}"));
            }
            if let (Some(found), Some([columns, rows])) = (camera.other_corners, self.settings.board) {
                report.remark(format!(
                    "camera `{name}` saw boards of {found} corners where one of {columns} x {rows} was shown: do `columns` and `rows` of its detector match `board`?"
                ));
            }
            if camera.n_elsewhere > 0 {
                report.remark(format!(
                    "camera `{name}` saw the board {} times elsewhere than stated: these were left out",
                    camera.n_elsewhere
                ));
            }
            if camera.n_doubtful > 0 && self.settings.board.is_some() {
                report.remark(format!(
                    "camera `{name}` saw the board moving or incomplete at {} places, which were left out; is `settle_ms` long enough?",
                    camera.n_doubtful
                ));
            } else if camera.n_late > camera.n_doubtful / 2 {
                report.remark(format!(
                    "camera `{name}` saw {} dots late, together with or after the one before, which were left out; `settle_ms` is {}, expected more than the display's latency and two of its pictures",
                    camera.n_late, self.settings.settle_ms
                ));
            } else if camera.n_doubtful > 0 {
                report.remark(format!(
                    "camera `{name}` saw {} dots together with other lights, or moving, which were left out; is the wall dark except for the dots?",
                    camera.n_doubtful
                ));
            }
        }
        for ([column, row], n) in &found.dark {
            report.remark(format!(
                "display {} of row {} showed none of its {n} {things} to any camera: it is off, or no camera sees it",
                column + 1,
                row + 1
            ));
        }
        if self.crowded > 0 {
            report.remark(match self.settings.board {
                None => format!(
                    "several dots were requested at {} moments, which were left out, expected one at a time",
                    self.crowded
                ),
                Some(_) if !self.settings.held.is_empty() => format!(
                    "the wall was requested to show something at {} moments while a board was held on it (`held`): these were left out",
                    self.crowded
                ),
                Some([columns, rows]) => format!(
                    "at {} moments the wall was requested to show another number of corners than the {columns} x {rows} of `board`: these were left out",
                    self.crowded
                ),
            });
        }
        report.figure("wall_calibration.cameras", errors.len() as f64);
        report.figure("wall_calibration.cameras_failed", f64::from(failed));
        report.figure("wall_calibration.dots", self.shown.len() as f64);
        report.figure("wall_calibration.dark_displays", found.dark.len() as f64);
        if let Some(median) = median(&errors) {
            report.figure("wall_calibration.held_out_median_px", median);
        }
    }
}
