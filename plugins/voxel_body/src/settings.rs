//! Settings of `voxel_body.silhouette`, with the reasons for their defaults.

use foveate::imaging::{BlobLimits, ForegroundConfig, SegmenterConfig};
use foveate::prelude::ConfigError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Settings of [`SilhouetteNode`](crate::silhouette::SilhouetteNode).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SilhouetteSettings {
    /// A picture of the empty scene, of the size of the camera's pictures; `{camera}` is the camera's name, `${NAME}` an environment variable;
    /// empty: none. With pictures at the port `background` it is not used [–]
    pub background: String,
    /// Pictures that the background is learnt from: those at the port `background`, or the camera's own where that is not connected and there is no picture of the empty scene. A person who leaves within
    /// half of them leaves no trace. With `pose`: the scene must be empty, and the head has to cover all later directions, which takes some seconds [frames]
    #[schemars(range(min = 1, max = 10000))]
    pub learn_frames: u32,
    /// The part of the background that its own noise leaves within the limits; the rest is removed as specks [–]
    #[schemars(range(min = 0.5, max = 0.99999))]
    pub detection_rate: f32,
    /// Smallest part of the light that a shadow leaves; 1: shadows are body. Objects of the background's colour that are darker by no more than this are lost [–]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub shadow_ratio: f32,
    /// Largest brightening of a highlight or a reflection; 1: they are body [–]
    #[schemars(range(min = 1.0, max = 10.0))]
    pub highlight_ratio: f32,
    /// Whether a shadow or highlight must keep the texture of its background, over windows of 6 px: clothes as dark as a shadow are then body, if their texture differs. Only for an unmoved camera with fixed exposure: a shift by a part of a pixel changes all textures. Otherwise single pixels decide [–]
    pub by_texture: bool,
    /// Lower bound of a pixel's standard deviation: covers compression and flicker [gray level]
    #[schemars(range(min = 0.1, max = 255.0))]
    pub noise_floor: f32,
    /// Motion of the background's edges by vibration or compression, standard deviation [px]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub jitter_px: f32,
    /// Pictures in which the background adapts to 63 % of a slow change of the light [frames]
    #[schemars(range(min = 1.0, max = 1000000.0))]
    pub adapt_frames: f32,
    /// Pictures after which an object that does not move becomes background; 0: never, so that a sitting person stays. A blob in which a target is predicted is
    /// never absorbed [frames]
    #[schemars(range(min = 0, max = 1000000))]
    pub absorb_frames: u32,
    /// A silhouette that fills a larger part of the picture is `full`; after `learn_frames` of them the background is learnt again [–]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub relearn_fraction: f64,
    /// The camera was moved when a larger part of the background's edges has moved, in every quarter of the picture [–]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub moved_fraction: f64,
    /// Smallest piece of body that is kept [px²]
    #[schemars(range(min = 1, max = 1000000000))]
    pub min_area_px: u32,
    /// Gaps in the body narrower than twice this are body: seams and edges of the background, which a close view loses as strips across limbs; 0: none [px]
    #[schemars(range(min = 0, max = 1000))]
    pub close_px: u32,
    /// Layers of rim pixels that become background if their colour is nearer to it than to the body's: blur makes silhouettes a pixel too wide at each side otherwise. For backgrounds without texture, which would be taken for body; 0: none [px]
    #[schemars(range(min = 0, max = 10))]
    pub rim_px: u32,
    /// Holes in the body up to this size are body [px²]
    #[schemars(range(min = 0, max = 1000000000))]
    pub max_hole_px: u32,
    /// Pieces at most this far apart, in rows and in columns, are one blob, and kept together [px]
    #[schemars(range(min = 0, max = 10000))]
    pub merge_px: u32,
    /// Blobs of one picture, at most; the largest are kept [–]
    #[schemars(range(min = 1, max = 10000))]
    pub max_features: u32,
    /// Standard deviation of the distance between a blob's middle and that of other cameras for the same body, in standard deviations of its pixels along each axis [–]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub shape_error: f64,
    /// With `pose`: approximate distance of the background, for its parallax when the head turns; views a few degrees apart are kept, so that a factor of two matters little [m]
    #[schemars(range(min = 0.1, max = 100000.0))]
    pub background_m: f64,
    /// Regions in which nothing is detected, such as windows: a list of polygons, each a list of corners (x, y) [px]
    pub masks: Vec<Vec<[f64; 2]>>,
}

impl Default for SilhouetteSettings {
    /// As [`SegmenterConfig`], but for shadows: what one view loses is lost, what one view has too much the others cut away. Pieces from 150 px² on (a person's head at 6 m and 640 × 480 px), holes to 150 px².
    fn default() -> Self {
        let it = SegmenterConfig::default();
        Self {
            background: String::new(),
            learn_frames: it.learn_frames,
            detection_rate: it.detection_rate,
            shadow_ratio: 0.6,
            highlight_ratio: it.highlight_ratio,
            by_texture: it.by_texture,
            noise_floor: it.noise_floor,
            jitter_px: it.jitter_px,
            adapt_frames: it.adapt_frames,
            absorb_frames: it.absorb_frames,
            relearn_fraction: it.relearn_fraction,
            moved_fraction: 0.5,
            min_area_px: 150,
            close_px: 0,
            rim_px: 0,
            max_hole_px: 150,
            merge_px: 4,
            max_features: 64,
            shape_error: 0.1,
            background_m: 4.0,
            masks: Vec::new(),
        }
    }
}

impl SilhouetteSettings {
    /// Checks the range of each setting.
    ///
    /// # Errors
    /// The first setting out of its range, what was found, and the range.
    pub fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("learn_frames", self.learn_frames, 1..=10_000)?;
        ConfigError::unless_in("detection_rate", self.detection_rate, 0.5..=0.99999)?;
        ConfigError::unless_in("shadow_ratio", self.shadow_ratio, 0.0..=1.0)?;
        ConfigError::unless_in("highlight_ratio", self.highlight_ratio, 1.0..=10.0)?;
        ConfigError::unless_in("noise_floor", self.noise_floor, 0.1..=255.0)?;
        ConfigError::unless_in("jitter_px", self.jitter_px, 0.0..=10.0)?;
        ConfigError::unless_in("adapt_frames", self.adapt_frames, 1.0..=1e6)?;
        ConfigError::unless_in("absorb_frames", self.absorb_frames, 0..=1_000_000)?;
        ConfigError::unless_in("relearn_fraction", self.relearn_fraction, 0.0..=1.0)?;
        ConfigError::unless_in("moved_fraction", self.moved_fraction, 0.0..=1.0)?;
        ConfigError::unless_in("min_area_px", self.min_area_px, 1..=1_000_000_000)?;
        ConfigError::unless_in("close_px", self.close_px, 0..=1000)?;
        ConfigError::unless_in("rim_px", self.rim_px, 0..=10)?;
        ConfigError::unless_in("max_hole_px", self.max_hole_px, 0..=1_000_000_000)?;
        ConfigError::unless_in("merge_px", self.merge_px, 0..=10_000)?;
        ConfigError::unless_in("max_features", self.max_features, 1..=10_000)?;
        ConfigError::unless_in("shape_error", self.shape_error, 0.0..=10.0)?;
        ConfigError::unless_in("background_m", self.background_m, 0.1..=1e5)?;
        for (place, polygon) in self.masks.iter().enumerate() {
            let is_one = polygon.len() >= 3 && polygon.iter().flatten().all(|it| it.is_finite());
            if !is_one {
                let text = format_args!("found {polygon:?}, expected at least 3 corners of finite numbers");
                return Err(ConfigError::at(&format!("masks[{place}]"), text));
            }
        }
        Ok(())
    }

    /// What a camera that turns has no use for.
    pub(crate) fn check_on_head(&self) -> Result<(), ConfigError> {
        if !self.background.is_empty() {
            let text = format!(
                "found `{}`, expected none: one picture is no background for a camera that turns; it learns from pictures with poses",
                self.background
            );
            return Err(ConfigError::at("background", text));
        }
        if !self.masks.is_empty() {
            let n = self.masks.len();
            let text = format!("found {n} masks, expected none: for a camera that turns no pixel is fixed");
            return Err(ConfigError::at("masks", text));
        }
        if self.absorb_frames > 0 {
            let text = format!("found {}, expected 0: for a camera that turns no pixel is fixed", self.absorb_frames);
            return Err(ConfigError::at("absorb_frames", text));
        }
        Ok(())
    }

    pub(crate) fn segmenter(&self) -> SegmenterConfig {
        SegmenterConfig {
            learn_frames: self.learn_frames,
            detection_rate: self.detection_rate,
            shadow_ratio: self.shadow_ratio,
            highlight_ratio: self.highlight_ratio,
            by_texture: self.by_texture,
            noise_floor: self.noise_floor,
            jitter_px: self.jitter_px,
            adapt_frames: self.adapt_frames,
            absorb_frames: self.absorb_frames,
            relearn_fraction: self.relearn_fraction,
        }
    }

    /// Of gray pictures.
    pub(crate) fn foreground(&self) -> ForegroundConfig {
        ForegroundConfig {
            learn_frames: self.learn_frames,
            noise_floor: self.noise_floor,
            adapt_frames: self.adapt_frames,
            absorb_frames: self.absorb_frames,
            shadow_ratio: self.shadow_ratio,
            relearn_fraction: self.relearn_fraction,
            ..ForegroundConfig::default()
        }
    }

    pub(crate) fn limits(&self) -> BlobLimits {
        BlobLimits {
            min_area: self.min_area_px.into(),
            max_area: u64::MAX,
            merge_px: self.merge_px,
            max_blobs: self.max_features as usize,
        }
    }
}
