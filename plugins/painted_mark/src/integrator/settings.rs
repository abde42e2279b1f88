//! Settings of the integrator of painted marks, with the reasons for their defaults.

use foveate::prelude::ConfigError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Pictures used for the marks of one moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Views {
    /// All of them.
    #[default]
    All,
    /// Those of the two best cameras at that time, as in [Davis 2002 §5.2].
    BestPair,
}

/// Settings of [`Integrator`](super::Integrator).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct IntegratorSettings {
    /// Prefix of the figures' names, as in `paper.marks.known`, to distinguish several integrators of one rig; empty: none [–].
    pub label: String,
    /// Pictures used for the marks of one moment: `all`, or those of the `best_pair` [–].
    pub views: Views,
    /// Whether the errors of the heads' poses are estimated together with the marks; otherwise the poses are used as stated [–].
    pub pose_errors: bool,
    /// Additional uncertainty of poses: rotation about the camera's centre, standard deviation [mrad].
    #[schemars(range(min = 0.001, max = 100.0))]
    pub rotation_floor_mrad: f64,
    /// Additional uncertainty of poses: shift, standard deviation [mm].
    #[schemars(range(min = 0.001, max = 100.0))]
    pub translation_floor_mm: f64,
    /// Additional uncertainty of the marks' pixels: a painted dot on curved skin is no perfect disc [px].
    #[schemars(range(min = 0.001, max = 10.0))]
    pub pixel_floor_px: f64,
    /// Largest distance of a mark in a picture from its prediction [standard deviations].
    #[schemars(range(min = 2.0, max = 100.0))]
    pub outlier_sigmas: f64,
    /// Largest pose errors before they are estimated, in pixels of the picture; with `pose_errors` [px].
    #[schemars(range(min = 0.5, max = 100.0))]
    pub start_px: f64,
    /// Fewest cameras that agree on an unlabelled mark; 2 where there are no more [–].
    #[schemars(range(min = 2, max = 16))]
    #[schemars(extend("x-formerly" = "birth_views"))]
    pub initiation_views: u32,
    /// Consecutive pictures in which they have to, before the mark is confirmed [–].
    #[schemars(range(min = 1, max = 1000))]
    #[schemars(extend("x-formerly" = "birth_frames"))]
    pub initiation_frames: u32,
    /// Smallest distance between marks [mm].
    #[schemars(range(min = 0.5, max = 1000.0))]
    pub spacing_mm: f64,
    /// Largest distance of marks from the point that the cameras look at; 0: the radius of the scale, or 0.25 m without one [m].
    #[schemars(range(min = 0.0, max = 100.0))]
    pub radius_m: f64,
    /// With `best_pair`: smallest relative advantage of another pair for a change [–].
    #[schemars(range(min = 0.0, max = 10.0))]
    pub pair_gain: f64,
    /// With `best_pair`: time over which the step from one pair to the next is spread; 0: no smoothing [ms].
    #[schemars(range(min = 0.0, max = 60000.0))]
    pub blend_ms: f64,
}

impl Default for IntegratorSettings {
    /// For dots of 3 to 5 px, 12 px apart, in the pictures of heads that are calibrated to a tenth of a degree.
    fn default() -> Self {
        Self {
            label: String::new(),
            views: Views::All,
            pose_errors: true,
            rotation_floor_mrad: 0.1,
            translation_floor_mm: 0.2,
            pixel_floor_px: 0.08,
            outlier_sigmas: 6.0,
            start_px: 30.0,
            initiation_views: 3,
            initiation_frames: 5,
            spacing_mm: 6.0,
            radius_m: 0.0,
            pair_gain: 0.15,
            blend_ms: 500.0,
        }
    }
}

impl IntegratorSettings {
    pub(super) fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("rotation_floor_mrad", self.rotation_floor_mrad, 0.001..=100.0)?;
        ConfigError::unless_in("translation_floor_mm", self.translation_floor_mm, 0.001..=100.0)?;
        ConfigError::unless_in("pixel_floor_px", self.pixel_floor_px, 0.001..=10.0)?;
        ConfigError::unless_in("outlier_sigmas", self.outlier_sigmas, 2.0..=100.0)?;
        ConfigError::unless_in("start_px", self.start_px, 0.5..=100.0)?;
        ConfigError::unless_in("initiation_views", self.initiation_views, 2..=16)?;
        ConfigError::unless_in("initiation_frames", self.initiation_frames, 1..=1000)?;
        ConfigError::unless_in("spacing_mm", self.spacing_mm, 0.5..=1000.0)?;
        ConfigError::unless_in("radius_m", self.radius_m, 0.0..=100.0)?;
        ConfigError::unless_in("pair_gain", self.pair_gain, 0.0..=10.0)?;
        ConfigError::unless_in("blend_ms", self.blend_ms, 0.0..=60000.0)
    }
}
