//! Settings of the selection of cameras, with the reasons for their defaults.

use foveate::prelude::ConfigError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Settings of [`CamerasNode`](super::CamerasNode). Costs are relative to the value of a target that is seen perfectly.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CamerasSettings {
    /// Candidate cameras by name; `*` and `?` match any letters [–].
    pub cameras: String,
    /// Fewest cameras for a target, where as many can see it [–].
    #[schemars(range(min = 2, max = 64))]
    pub least: u32,
    /// Most cameras for a target; at least `least` [–].
    #[schemars(range(min = 2, max = 64))]
    pub most: u32,
    /// Most choices per second [Hz].
    #[schemars(range(min = 0.1, max = 100.0))]
    pub rate_hz: f64,
    /// Angle between lines of sight, up to its supplement, with the full value of a pair [deg].
    #[schemars(range(min = 1.0, max = 90.0))]
    pub best_angle_deg: f64,
    /// Cost of a camera that no other target uses [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub camera_cost: f64,
    /// Cost of a camera that was not chosen last: the smallest gain for a change [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub change_cost: f64,
    /// Cost of seeing the target at zero resolution, relative to the camera with most pixels per metre; proportional between [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub coarse_cost: f64,
    /// Cost of seeing a target at the edge of the picture, which it may leave soon; proportional within `rim_px` [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub rim_cost: f64,
    /// Width of the rim [px].
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub rim_px: f64,
    /// Cost of a camera that has not seen the target for `hidden_ms`, which may be occluded [–].
    #[schemars(range(min = 0.0, max = 10.0))]
    pub hidden_cost: f64,
    /// Time without an observation that counts as occlusion; longer than the interval between pictures of an unchosen camera (`look_every` of `select.gate`) [ms].
    #[schemars(range(min = 1.0, max = 60000.0))]
    pub hidden_ms: f64,
}

impl Default for CamerasSettings {
    /// For cameras of 60 Hz and 640 columns.
    fn default() -> Self {
        Self {
            cameras: "*".to_owned(),
            least: 3,
            most: 4,
            rate_hz: 10.0,
            best_angle_deg: 60.0,
            camera_cost: 0.03,
            change_cost: 0.03,
            coarse_cost: 0.1,
            rim_cost: 0.2,
            rim_px: 30.0,
            hidden_cost: 0.4,
            hidden_ms: 400.0,
        }
    }
}

impl CamerasSettings {
    /// Checks the range of each setting.
    ///
    /// # Errors
    /// The first setting out of its range, what was found, and the range.
    pub fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("least", self.least, 2..=64)?;
        ConfigError::unless_in("most", self.most, self.least..=64)?;
        ConfigError::unless_in("rate_hz", self.rate_hz, 0.1..=100.0)?;
        ConfigError::unless_in("best_angle_deg", self.best_angle_deg, 1.0..=90.0)?;
        ConfigError::unless_in("camera_cost", self.camera_cost, 0.0..=1.0)?;
        ConfigError::unless_in("change_cost", self.change_cost, 0.0..=1.0)?;
        ConfigError::unless_in("coarse_cost", self.coarse_cost, 0.0..=1.0)?;
        ConfigError::unless_in("rim_cost", self.rim_cost, 0.0..=1.0)?;
        ConfigError::unless_in("rim_px", self.rim_px, 0.0..=10_000.0)?;
        ConfigError::unless_in("hidden_cost", self.hidden_cost, 0.0..=10.0)?;
        ConfigError::unless_in("hidden_ms", self.hidden_ms, 1.0..=60_000.0)
    }
}
