//! The 2D points found in one picture.

use nalgebra::{Matrix2, Point2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::schema::Numbers;
use crate::wire::portable;
use crate::{CameraId, Message, Quality, Space, Wire};

/// One point found in a picture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Feature {
    /// Where, in raw (distorted) pixels; (0, 0) is the centre of the top-left pixel.
    #[schemars(with = "Numbers<2>")]
    pub centre: Point2<f64>,
    /// How well that is known [px²].
    #[schemars(with = "Numbers<4>")]
    pub covariance: Matrix2<f64>,
    /// Pixels that belong to it [px²]; 0 where the source of the point did not say.
    pub area: u32,
    /// Its brightest pixel [gray level, 0..=255]; 0 where the source of the point did not say.
    pub peak: u8,
    /// Which mark it is, where the detector can tell: the corner of a board, the end of a wand.
    pub label: Option<u32>,
}

/// All points found in one picture. Nothing found: an empty list.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Features {
    /// The camera whose picture it was.
    pub camera: CameraId,
    /// In scan order: by row, then by column; those with labels in the order of these.
    pub list: Vec<Feature>,
}

impl Message for Features {
    const NAME: &'static str = "features";
    const VERSION: u32 = 2;
    const SPACE: Space = Space::PIXELS;
    const WIRE: Wire = portable!(Features);

    fn quality(&self) -> Quality {
        let sum: f64 = self.list.iter().map(|it| (it.covariance.trace() / 2.0).sqrt()).sum();
        Quality {
            count: Some(self.list.len() as u32),
            sigma: (!self.list.is_empty()).then(|| sum / self.list.len() as f64),
        }
    }
}
