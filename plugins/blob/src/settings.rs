//! Settings of the blob detector, with the reasons for their defaults.

use std::collections::BTreeMap;

use foveate::node::detector::{Polygon, check_masks};
use foveate::prelude::ConfigError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Settings of [`Detector`](crate::detector::Detector). Colour pictures are reduced to their brightness.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BlobSettings {
    /// A picture of the empty scene, used instead of learning; its top-left pixel is that of the camera's
    /// pictures; `{camera}` is the camera's name, `${NAME}` an environment variable; empty: none [–].
    pub background: String,
    /// Pictures that the background is learnt from. A person who leaves within half of them leaves no trace [frames].
    #[schemars(range(min = 1, max = 10000))]
    pub learn_frames: u32,
    /// A pixel is foreground when further from the mean of its background than this many of its standard deviations [–].
    #[schemars(range(min = 0.1, max = 1000.0), extend("live" = true))]
    pub threshold_sigma: f32,
    /// A blob needs a pixel this far from its background, unless a target is expected there; at least `threshold_sigma` [–].
    #[schemars(range(min = 0.1, max = 1000.0), extend("live" = true))]
    pub sure_sigma: f32,
    /// Lower bound of a pixel's standard deviation: covers compression and flicker [gray level].
    #[schemars(range(min = 0.1, max = 255.0))]
    pub noise_floor: f32,
    /// Pictures in which the background adapts to 63 % of a slow change of the light [frames].
    #[schemars(range(min = 1.0, max = 1000000.0))]
    pub adapt_frames: f32,
    /// Pictures after which an object that does not move becomes background; 0: never [frames].
    #[schemars(range(min = 0, max = 1000000))]
    pub absorb_frames: u32,
    /// A shadow leaves at least this part of the light; 1: shadows are foreground. Objects that are evenly darker than what is
    /// behind them, by no more than this, are lost [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub shadow_ratio: f32,
    /// A picture with a larger part in the foreground is a gap; after `learn_frames` of them the background is learnt again [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub relearn_fraction: f64,
    /// Smallest blob kept [px²].
    #[schemars(range(min = 1, max = 1000000000), extend("live" = true))]
    pub min_area_px: u32,
    /// Largest blob kept [px²].
    #[schemars(range(min = 1, max = 1000000000), extend("live" = true))]
    pub max_area_px: u32,
    /// Pieces of foreground at most this far apart, in rows and in columns, are one blob [px].
    #[schemars(range(min = 0, max = 10000), extend("live" = true))]
    pub merge_px: u32,
    /// Blobs of one picture, at most; the largest are kept [–].
    #[schemars(range(min = 1, max = 10000), extend("live" = true))]
    pub max_features: u32,
    /// Which point of a blob is reported. Heads and feet are the same points from all sides, the middle is only nearly so [–].
    pub point: ReportedPoint,
    /// Standard deviation of the distance between that point and the one that other cameras see of the same body, in standard
    /// deviations of the blob's own pixels along each axis. Added to the covariance [–].
    #[schemars(range(min = 0.0, max = 10.0))]
    pub shape_error: f64,
    /// The picture is reduced by this factor first: faster by its square, coarser by the factor itself [–].
    #[schemars(range(min = 1, max = 16))]
    pub shrink: u32,
    /// Regions in which nothing is detected, such as windows: a list of polygons, each a list of corners (x, y) [px].
    #[schemars(extend("live" = true))]
    pub masks: Vec<Polygon>,
    /// Regions of single cameras, by their names: `{ wide-3 = [[[0, 0], [9, 0], [0, 9]]] }` [px].
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    #[schemars(extend("default" = {}, "live" = true))]
    pub camera_masks: BTreeMap<String, Vec<Polygon>>,
}

/// Which point of a blob is reported.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ReportedPoint {
    /// The mean of the blob's pixels.
    Centroid,
    /// The upper end: up in the world, or in the picture without a calibration.
    Top,
    /// The lower end.
    Bottom,
}

impl Default for BlobSettings {
    /// For people 2 m to 6 m from a camera of 640 × 480 px and 30 Hz; a still object becomes background after half a minute.
    fn default() -> Self {
        Self {
            background: String::new(),
            learn_frames: 30,
            threshold_sigma: 4.0,
            sure_sigma: 8.0,
            noise_floor: 2.0,
            adapt_frames: 200.0,
            absorb_frames: 900,
            shadow_ratio: 0.6,
            relearn_fraction: 0.5,
            min_area_px: 400,
            max_area_px: 200_000,
            merge_px: 8,
            max_features: 64,
            point: ReportedPoint::Centroid,
            shape_error: 0.1,
            shrink: 1,
            masks: Vec::new(),
            camera_masks: BTreeMap::new(),
        }
    }
}

impl BlobSettings {
    /// Checks the range of each setting.
    ///
    /// # Errors
    /// The first setting out of its range, what was found, and the range.
    pub fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("learn_frames", self.learn_frames, 1..=10_000)?;
        ConfigError::unless_in("threshold_sigma", self.threshold_sigma, 0.1..=1000.0)?;
        ConfigError::unless_in("sure_sigma", self.sure_sigma, self.threshold_sigma..=1000.0)?;
        ConfigError::unless_in("noise_floor", self.noise_floor, 0.1..=255.0)?;
        ConfigError::unless_in("adapt_frames", self.adapt_frames, 1.0..=1e6)?;
        ConfigError::unless_in("absorb_frames", self.absorb_frames, 0..=1_000_000)?;
        ConfigError::unless_in("shadow_ratio", self.shadow_ratio, 0.0..=1.0)?;
        ConfigError::unless_in("relearn_fraction", self.relearn_fraction, 0.0..=1.0)?;
        ConfigError::unless_in("min_area_px", self.min_area_px, 1..=1_000_000_000)?;
        ConfigError::unless_in("max_area_px", self.max_area_px, self.min_area_px..=1_000_000_000)?;
        ConfigError::unless_in("merge_px", self.merge_px, 0..=10_000)?;
        ConfigError::unless_in("max_features", self.max_features, 1..=10_000)?;
        ConfigError::unless_in("shape_error", self.shape_error, 0.0..=10.0)?;
        ConfigError::unless_in("shrink", self.shrink, 1..=16)?;
        check_masks(&self.masks, &self.camera_masks)
    }
}
