//! Settings of `voxel_body.silhouette`, with the reasons for their defaults.

use foveate::imaging::{BlobLimits, ForegroundConfig, SegmenterConfig};
use foveate::prelude::ConfigError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Settings of [`SilhouetteNode`](crate::silhouette::SilhouetteNode).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SilhouetteSettings {
    /// A picture of the scene without anybody, of the size of the camera's pictures; `{camera}` is the camera's name, `${NAME}` an environment variable;
    /// empty: none. With pictures at the port `background` it is not used [–]
    pub background: String,
    /// Pictures that the background is learnt from: of those at the port `background`, or of the camera's own where that is open and there is no picture of the empty scene. Who moves on within
    /// half of them leaves no trace. With `pose`: nobody may be there, and the head has to look wherever it will look later, so that it takes some seconds [frames]
    #[schemars(range(min = 1, max = 10000))]
    pub learn_frames: u32,
    /// The part of the background that its own noise leaves within the limits; the rest goes with the specks [–]
    #[schemars(range(min = 0.5, max = 0.99999))]
    pub detection_rate: f32,
    /// The part of the light that a shadow leaves, at least; 1: shadows are body. Things of the colour of what is behind them, and darker by no more than this, are lost [–]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub shadow_ratio: f32,
    /// How much brighter a highlight or a reflection may be; 1: they are body [–]
    #[schemars(range(min = 1.0, max = 10.0))]
    pub highlight_ratio: f32,
    /// Whether a shadow or highlight must leave the texture of its background, over windows of 6 px: clothes as dark as a shadow are body then, if they look otherwise. For backgrounds learnt by the camera as it stands: where it has moved by a part of a pixel since, or exposes otherwise, all of the picture looks otherwise. If not, what single pixels say has to do [–]
    pub by_texture: bool,
    /// No pixel's standard deviation is taken to be lower than this: covers compression and flicker [gray level]
    #[schemars(range(min = 0.1, max = 255.0))]
    pub noise_floor: f32,
    /// How far an edge of the background may have moved by trembling or compression, one standard deviation [px]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub jitter_px: f32,
    /// Pictures in which the background follows a slow change of the light by 63 % [frames]
    #[schemars(range(min = 1.0, max = 1000000.0))]
    pub adapt_frames: f32,
    /// Pictures after which something that came, and does not move at all, is background; 0: never, so that who sits still stays. A blob in which a target is predicted is
    /// never absorbed [frames]
    #[schemars(range(min = 0, max = 1000000))]
    pub absorb_frames: u32,
    /// A silhouette that fills a larger part of the picture is `full`; `learn_frames` of them, and the background is learnt again [–]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub relearn_fraction: f64,
    /// The camera was moved when a larger part of the edges of its background is not where it was, in every quarter of the picture [–]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub moved_fraction: f64,
    /// Smallest piece of body that is kept [px²]
    #[schemars(range(min = 1, max = 1000000000))]
    pub min_area_px: u32,
    /// Gaps between body and body that are narrower than twice this are body: seams and edges of what is behind, which a close view loses as strips across limbs; 0: none [px]
    #[schemars(range(min = 0, max = 1000))]
    pub close_px: u32,
    /// Layers of pixels at the rim that are background if they have more of its colour than of the body's: a lens blurs rims, and silhouettes are a pixel too wide at each side without. For backgrounds without texture, which is taken for body otherwise; 0: none [px]
    #[schemars(range(min = 0, max = 10))]
    pub rim_px: u32,
    /// Holes in the body up to this size are body [px²]
    #[schemars(range(min = 0, max = 1000000000))]
    pub max_hole_px: u32,
    /// Pieces no further apart than this, in rows and in columns, are one blob, and kept together [px]
    #[schemars(range(min = 0, max = 10000))]
    pub merge_px: u32,
    /// Blobs of one picture, at most: the largest [–]
    #[schemars(range(min = 1, max = 10000))]
    pub max_features: u32,
    /// How far a blob's middle may be from the one that other cameras see of the same body, one standard deviation, in standard deviations of its pixels along each axis [–]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub shape_error: f64,
    /// With `pose`: how far the background is, roughly. It moves against what is nearer and farther when the head turns; views a few degrees apart are kept, so that twice or half of it does little [m]
    #[schemars(range(min = 0.1, max = 100000.0))]
    pub background_m: f64,
    /// Regions in which nothing is looked for, such as windows: a list of polygons, each a list of corners (x, y) [px]
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
    /// Names the first setting that is out of its range.
    ///
    /// # Errors
    /// The setting, what was found, and the range.
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
                "found `{}`, expected none: one picture is no background of a camera that turns; it learns from pictures with poses",
                self.background
            );
            return Err(ConfigError::at("background", text));
        }
        if !self.masks.is_empty() {
            let n = self.masks.len();
            let text = format!("found {n} masks, expected none: of a camera that turns no pixel stays where it is");
            return Err(ConfigError::at("masks", text));
        }
        if self.absorb_frames > 0 {
            let text =
                format!("found {}, expected 0: of a camera that turns no pixel stays where it is", self.absorb_frames);
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
