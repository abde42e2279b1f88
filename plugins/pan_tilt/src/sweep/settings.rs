//! Settings of the motion of a head for its calibration.

use foveate::prelude::ConfigError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Settings of [`SweepNode`](super::SweepNode).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SweepSettings {
    /// Pan settings, with tilt at rest, each -360 to 360 [°]
    pub pan_deg: Vec<f64>,
    /// Tilt settings, with pan at rest, each -180 to 180 [°]
    pub tilt_deg: Vec<f64>,
    /// Pan and tilt, both off rest: without such settings the order of the axes is unobservable [°]
    pub both_deg: Vec<[f64; 2]>,
    /// Speed between settings [°/s]
    #[schemars(range(min = 0.1, max = 1000.0))]
    pub speed_deg_per_s: f64,
    /// Largest distance of a head that has arrived at a setting; more than one of its units [°]
    #[schemars(range(min = 0.001, max = 10.0))]
    pub tolerance_deg: f64,
    /// Settling time of the camera after a motion [ms]
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub settle_ms: f64,
    /// Motion of the light in the picture after which it counts again [px]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub step_px: f64,
    /// Sufficient number of observations at a setting … [–]
    #[schemars(range(min = 1, max = 100000))]
    #[schemars(extend("x-formerly" = "sightings"))]
    pub observations: u32,
    /// … in this many ninths of the picture [–]
    #[schemars(range(min = 1, max = 9))]
    pub cells: u32,
    /// Time limit at each setting [s]
    #[schemars(range(min = 0.1, max = 3600.0))]
    pub longest_s: f64,
    /// File of the observations at each setting in the results folder; `{camera}` is the camera's name [–]
    pub file: String,
    /// File of the live advice in the results folder: where the head is and where to hold the light, a line per change, to be
    /// followed with `tail -f`; `{camera}` is the camera's name [–]
    pub advice: String,
}

impl Default for SweepSettings {
    /// The settings of [Davis 2002 §4.2], and eight with both angles off rest.
    fn default() -> Self {
        Self {
            pan_deg: (-5..=5).map(|it| f64::from(10 * it)).collect(),
            tilt_deg: (-4..=3).filter(|it| *it != 0).map(|it| f64::from(5 * it)).collect(),
            both_deg: vec![
                [40.0, 10.0],
                [20.0, 10.0],
                [-20.0, 10.0],
                [-40.0, 10.0],
                [-40.0, -15.0],
                [-20.0, -15.0],
                [20.0, -15.0],
                [40.0, -15.0],
            ],
            speed_deg_per_s: 60.0,
            tolerance_deg: 0.25,
            settle_ms: 500.0,
            step_px: 12.0,
            observations: 24,
            cells: 5,
            longest_s: 10.0,
            file: "sweep.{camera}.csv".to_owned(),
            advice: "sweep.{camera}.txt".to_owned(),
        }
    }
}

impl SweepSettings {
    /// Refuses settings out of range.
    ///
    /// # Errors
    /// The first such setting.
    pub fn check(&self) -> Result<(), ConfigError> {
        let check = ConfigError::unless_in::<f64>;
        self.pan_deg.iter().try_for_each(|it| check("pan_deg", *it, -360.0..=360.0))?;
        self.tilt_deg.iter().try_for_each(|it| check("tilt_deg", *it, -180.0..=180.0))?;
        for [pan, tilt] in &self.both_deg {
            check("both_deg", *pan, -360.0..=360.0)?;
            check("both_deg", *tilt, -180.0..=180.0)?;
        }
        check("speed_deg_per_s", self.speed_deg_per_s, 0.1..=1000.0)?;
        check("tolerance_deg", self.tolerance_deg, 0.001..=10.0)?;
        check("settle_ms", self.settle_ms, 0.0..=10_000.0)?;
        check("step_px", self.step_px, 0.0..=1000.0)?;
        ConfigError::unless_in("observations", self.observations, 1..=100_000)?;
        ConfigError::unless_in("cells", self.cells, 1..=9)?;
        check("longest_s", self.longest_s, 0.1..=3600.0)
    }

    /// Pan and tilt of all settings, in order [rad].
    pub fn places(&self) -> Vec<[f64; 2]> {
        let pans = self.pan_deg.iter().map(|it| [*it, 0.0]);
        let tilts = self.tilt_deg.iter().map(|it| [0.0, *it]);
        pans.chain(tilts).chain(self.both_deg.iter().copied()).map(|it| it.map(f64::to_radians)).collect()
    }
}
