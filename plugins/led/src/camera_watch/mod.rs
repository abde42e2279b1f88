//! `led.camera_watch`: detects during ordinary tracking that a camera was bumped, from its features and those of the others.
//!
//! Each light that a camera sees is triangulated from what the *other* cameras saw of it just before and after ([`watch`]); the residual in the picture is explained by
//! a small rotation of the camera, half a second at a time, and a lasting rotation is distinguished from the camera's history
//! ([`turns`]). A bumped camera is no longer used for triangulation. Ambiguous cases are reported as well: of two cameras that contradict
//! only each other, either may have been bumped.

pub mod turns;
pub mod watch;

#[cfg(test)]
mod tests;

use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::Arc;

use foveate::diagnostics::fields::number;
use foveate::prelude::*;
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use turns::TurnOptions;
pub use watch::{Bump, Watch, WatchOptions};

ports! {
    FEATURES: In<Features> = each("features").many();
    TARGETS: In<Targets> = each("targets");
}

figures! {
        "camera_watch.bumped": count, low, "Cameras found to be rotated" => "cameras found to be turned";
        "camera_watch.undecided": count, low, "Times that one of several cameras was rotated, without knowing which";
    "camera_watch.observations": count, high, "Observations that could be compared with the lines of sight of other cameras, over all cameras";
        "camera_watch.bumped_at_s.*": s, neither, "Session time of the camera's first bump";
        "camera_watch.told_at_s.*": s, neither, "Session time at which that bump was certain";
        "camera_watch.turn_mrad.*": mrad, neither, "Rotation of the camera by its first bump";
        "camera_watch.shift_px.*": px, neither, "Shift of lights in its picture by that bump, root mean square";
}

/// Settings of [`CameraWatch`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CameraWatchSettings {
    /// Time over which observations are combined into one rotation of the camera [s]
    #[schemars(range(min = 0.1, max = 60.0))]
    pub bin_s: f64,
    /// Number of such rotations that together must differ from those before; more find smaller bumps, later [–]
    #[schemars(range(min = 1, max = 100))]
    pub bins: u32,
    /// Fewest observations of a rotation [–]
    #[schemars(range(min = 4, max = 10000))]
    #[schemars(extend("x-formerly" = "min_sightings"))]
    pub min_observations: u32,
    /// Smallest rotation that is reported: the calibration itself is no more accurate [mrad]
    #[schemars(range(min = 0.01, max = 100.0))]
    pub least_mrad: f64,
    /// Smallest shift of lights in the picture that is reported, root mean square: the error of detectors [px]
    #[schemars(range(min = 0.01, max = 100.0))]
    pub least_px: f64,
    /// Standard deviation of the calibrated orientation, used until the camera has a history [mrad]
    #[schemars(range(min = 0.001, max = 100.0))]
    pub calibration_mrad: f64,
    /// Smallest reported rotation in standard deviations [–]
    #[schemars(range(min = 3.0, max = 100.0))]
    pub sigmas: f64,
    /// Largest distance of a light in the picture from its prediction, if no other is as near; bumps are found up to this [mrad]
    #[schemars(range(min = 1.0, max = 500.0))]
    pub gate_mrad: f64,
    /// Longest time between two pictures of another camera between which a light is triangulated; slower cameras are watched, but not used for the others [ms]
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub max_age_ms: f64,
    /// File of the rotations of each camera in the results folder [–]
    pub file: String,
}

impl Default for CameraWatchSettings {
    fn default() -> Self {
        Self {
            bin_s: 0.5,
            bins: 3,
            min_observations: 12,
            least_mrad: 0.3,
            least_px: 0.25,
            calibration_mrad: 0.5,
            sigmas: 6.0,
            gate_mrad: 40.0,
            max_age_ms: 40.0,
            file: "cameras_watched.csv".to_owned(),
        }
    }
}

impl CameraWatchSettings {
    /// The settings as options of a [`Watch`].
    pub fn options(&self) -> WatchOptions {
        WatchOptions {
            turns: TurnOptions {
                bin: Interval::from_s(self.bin_s),
                bins: self.bins as usize,
                min_observations: self.min_observations as usize,
                least: self.least_mrad * 1e-3,
                least_px: self.least_px,
                calibration: self.calibration_mrad * 1e-3,
                sigmas: self.sigmas,
            },
            gate: self.gate_mrad * 1e-3,
            max_age: Interval::from_ms(self.max_age_ms),
        }
    }
}

/// Compares each camera with the others on the same lights, and reports the one that no longer fits.
pub struct CameraWatch {
    watch: Watch,
    names: Vec<String>,
    out: Option<PathBuf>,
    file: String,
}

impl Node for CameraWatch {
    const TYPE: &'static str = "led.camera_watch";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Detects during ordinary tracking that a camera was bumped, and by how much";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = CameraWatchSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: CameraWatchSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let check = ConfigError::unless_in::<f64>;
        check("bin_s", settings.bin_s, 0.1..=60.0)?;
        ConfigError::unless_in("bins", settings.bins, 1..=100)?;
        ConfigError::unless_in("min_observations", settings.min_observations, 4..=10_000)?;
        check("least_mrad", settings.least_mrad, 0.01..=100.0)?;
        check("least_px", settings.least_px, 0.01..=100.0)?;
        check("calibration_mrad", settings.calibration_mrad, 0.001..=100.0)?;
        check("sigmas", settings.sigmas, 3.0..=100.0)?;
        check("gate_mrad", settings.gate_mrad, 1.0..=500.0)?;
        check("max_age_ms", settings.max_age_ms, 1.0..=1000.0)?;
        setup.claim_named_file("file", &settings.file)?;
        let cameras = &setup.calibration.cameras;
        if cameras.len() < 3 {
            let n = cameras.len();
            return Err(ConfigError::node(format_args!(
                "found {n} cameras in the calibration, expected at least 3: each camera is checked by two others"
            )));
        }
        Ok(Self {
            watch: Watch::new(settings.options(), cameras.iter().map(|it| it.camera.clone()).collect()),
            names: cameras.iter().map(|it| it.name.clone()).collect(),
            out: setup.out_dir.clone(),
            file: settings.file,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(features) = io.take(&FEATURES) {
            self.watch.add_features(features.time(), Arc::clone(&features.value));
        } else if let Some(targets) = io.take(&TARGETS) {
            self.watch.add_targets(Arc::clone(&targets.value));
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        self.watch.finish();
        let bumps = self.watch.bumps();
        report.figure("camera_watch.bumped", bumps.iter().filter(|it| it.cameras.len() == 1).count() as f64);
        report.figure("camera_watch.undecided", bumps.iter().filter(|it| it.cameras.len() > 1).count() as f64);
        for bump in bumps {
            report.remark(self.sentence(bump));
            // Of a camera that was bumped more than once, the figures are those of the first time.
            let is_first = |camera: usize| bumps.iter().find(|it| it.cameras == [camera]) == Some(bump);
            if let [camera] = bump.cameras[..]
                && is_first(camera)
            {
                let name = &self.names[camera];
                report.figure(format!("camera_watch.bumped_at_s.{name}"), bump.at.as_s());
                report.figure(format!("camera_watch.told_at_s.{name}"), bump.detected_at.as_s());
                report.figure(format!("camera_watch.turn_mrad.{name}"), bump.turn.norm() * 1e3);
                report.figure(format!("camera_watch.shift_px.{name}"), bump.shift_px);
            }
        }
        let counts = self.watch.observations();
        report.figure("camera_watch.observations", counts.iter().sum::<u64>() as f64);
        let blind: Vec<&str> =
            counts.iter().zip(&self.names).filter(|it| *it.0 == 0).map(|(_, name)| name.as_str()).collect();
        if !blind.is_empty() && blind.len() < self.names.len() {
            report.remark(format!("{} cannot be checked: no light in view was seen by two others", blind.join(", ")));
        }
        if let Some(folder) = &self.out {
            std::fs::write(folder.join(&self.file), self.table())
                .map_err(|error| NodeError::input(format_args!("`{}` cannot be written: {error}", self.file)))?;
            report.file(&self.file);
        }
        Ok(())
    }
}

impl CameraWatch {
    fn sentence(&self, bump: &Bump) -> String {
        let at_s = bump.at.as_s();
        let names: Vec<&str> = bump.cameras.iter().map(|it| self.names[*it].as_str()).collect();
        match names[..] {
            [name] => {
                let [tilt, pan, roll] = of_camera_mrad(&bump.turn);
                format!(
                    "camera {name} was bumped at {at_s:.1} s: {:.1} mrad (pan {pan:+.1}, tilt {tilt:+.1}, roll {roll:+.1}), {:.1} px; recalibrate",
                    bump.turn.norm() * 1e3,
                    bump.shift_px
                )
            }
            _ if names.len() > 3 && 2 * names.len() > self.names.len() => {
                format!(
                    "since {at_s:.1} s most cameras contradict each other, none more than the rest: check the clocks, or recalibrate"
                )
            }
            _ => format!(
                "one of {} was bumped at {at_s:.1} s; which one is ambiguous from their common view; recalibrate",
                names.join(", ")
            ),
        }
    }

    /// One row for each camera and rotation.
    fn table(&self) -> String {
        let mut text = "time_s,camera,tilt_mrad,pan_mrad,roll_mrad,sigma_mrad,observations,sigmas\n".to_owned();
        for row in self.watch.rows() {
            let [tilt, pan, roll] = of_camera_mrad(&row.turn).map(|it| number(it, 4));
            // Writing to a String cannot fail.
            let _ = writeln!(
                text,
                "{:.3},{},{tilt},{pan},{roll},{},{},{}",
                row.at.as_s(),
                self.names[row.camera],
                number(row.sigma * 1e3, 4),
                row.observations,
                number(row.sigmas, 2)
            );
        }
        text
    }
}

/// Tilt upward, pan to the right and roll clockwise of a camera whose view of the world rotates by `turn`: the camera rotated the opposite way [mrad].
fn of_camera_mrad(turn: &Vector3<f64>) -> [f64; 3] {
    [turn.x, turn.y, turn.z].map(|it| -1e3 * it)
}
