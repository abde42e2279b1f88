//! Settings of `structured_light.boundaries`.

use foveate::imaging::stripes::boundary::FRAMES;
use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Settings of [`super::Boundaries`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct BoundariesSettings {
    /// The projector's name in the calibration [–]
    pub projector: String,
    /// For a recording, that is where nothing is connected to `shown`: the `patterns.toml` that `foveate patterns` wrote, or its folder. The pictures show these four patterns in turn [–]
    pub patterns: Option<String>,
    /// For a recording without `patterns`: width of a stripe [px]
    #[schemars(range(min = 2, max = 1024))]
    pub stripe_px: Option<u32>,
    /// For a recording: whether the stripes encode `columns` or `rows` of the projector; as in `patterns`, or columns, unless set [–]
    pub stripes: Option<String>,
    /// Which of the four patterns the first picture of a recording shows: found from the pictures unless set, and verified with them if set [–]
    #[schemars(range(min = 0, max = 3))]
    pub first_shows: Option<u32>,
    /// Latency of the projector, from the command to show a picture to its light [ms]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub latency_ms: f64,
    /// The camera's exposure: all of it must lie in the time in which one picture is shown [ms]
    #[schemars(range(min = 0.0, max = 100.0))]
    pub exposure_ms: f64,
    /// Nearest and farthest distance of the surface from the camera, where no target gives it [m]
    pub distance_m: [f64; 2],
    /// The surface is no farther than this from the origin of the scale's space, with `spaces` connected, or from the target at `targets` that is nearest to the middle of the picture [m]
    #[schemars(range(min = 0.001, max = 100.0))]
    pub around_m: f64,
    /// Least difference of both sides of an edge of light [gray level]
    #[schemars(range(min = 1.0, max = 255.0))]
    pub min_step: f32,
    /// Least (bright − dark) / (bright + dark) of an edge of light: edges of the surface's own colour mostly have less [–]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub min_contrast: f32,
    /// Level of the camera without light [gray level]
    #[schemars(range(min = 0.0, max = 255.0))]
    pub black: f32,
    /// Noise of the camera, standard deviation [gray level]
    #[schemars(range(min = 0.05, max = 50.0))]
    pub noise: f32,
    /// Pixels along the row, to either side of a boundary, that get the column of the projector; on stripes up to twice as wide as those that face the camera as many more, and where no next boundary is known a quarter of a stripe at most [px]
    #[schemars(range(min = 0.5, max = 8.0))]
    pub beside_px: f32,
    /// Pictures of a head whose angles are less certain than this are tracked but give no map: standard deviation of the larger one in the picture [px]
    #[schemars(range(min = 0.01, max = 1000.0))]
    pub max_pose_px: f64,
    /// Threads over which the rows are spread; the result is the same for any number [–]
    #[schemars(range(min = 1, max = 64))]
    pub threads: usize,
}

impl Default for BoundariesSettings {
    fn default() -> Self {
        Self {
            projector: crate::pattern::default_projector(),
            patterns: None,
            stripe_px: None,
            stripes: None,
            first_shows: None,
            latency_ms: 30.0,
            exposure_ms: 4.0,
            distance_m: [0.3, 20.0],
            around_m: 0.3,
            min_step: 6.0,
            min_contrast: 0.2,
            black: 0.0,
            noise: 1.5,
            beside_px: 2.0,
            // A stripe's edge is known to about a tenth of a pixel; beyond a pixel the error of the pose is most of what a point is off.
            max_pose_px: 1.0,
            threads: 2,
        }
    }
}

impl BoundariesSettings {
    /// Whether all of them are what they may be.
    pub(super) fn check(&self) -> Result<(), ConfigError> {
        if let Some(it) = self.stripe_px {
            ConfigError::unless_in("stripe_px", it, 2..=1024)?;
        }
        if let Some(it) = self.stripes.as_ref().filter(|it| !["columns", "rows"].contains(&it.as_str())) {
            return Err(ConfigError::at("stripes", format!("found `{it}`, expected `columns` or `rows`")));
        }
        if let Some(it) = self.first_shows {
            ConfigError::unless_in("first_shows", it, 0..=FRAMES as u32 - 1)?;
        }
        ConfigError::unless_in("latency_ms", self.latency_ms, 0.0..=1000.0)?;
        ConfigError::unless_in("exposure_ms", self.exposure_ms, 0.0..=100.0)?;
        let [near, far] = self.distance_m;
        ConfigError::unless_in("distance_m", near, 1e-3..=1e4)?;
        ConfigError::unless_in("distance_m", far, near..=1e4)?;
        ConfigError::unless_in("around_m", self.around_m, 1e-3..=100.0)?;
        ConfigError::unless_in("min_step", self.min_step, 1.0..=255.0)?;
        ConfigError::unless_in("min_contrast", self.min_contrast, 0.0..=1.0)?;
        ConfigError::unless_in("black", self.black, 0.0..=255.0)?;
        ConfigError::unless_in("noise", self.noise, 0.05..=50.0)?;
        ConfigError::unless_in("beside_px", self.beside_px, 0.5..=8.0)?;
        ConfigError::unless_in("max_pose_px", self.max_pose_px, 0.01..=1000.0)?;
        ConfigError::unless_in("threads", self.threads, 1..=64)
    }
}
