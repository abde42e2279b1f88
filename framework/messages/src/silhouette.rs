//! Which pixels of a picture show a body.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::wire::portable;
use crate::{CameraId, Message, Quality, Space, Window, Wire};

/// The state of a whole silhouette.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SilhouetteStatus {
    /// Some of the picture is body.
    #[default]
    Seen,
    /// None of it is.
    Empty,
    /// Too much of it is marked as body: the background model was wrong, such as when a lamp went on. To be left out.
    Full,
    /// The background is still being learnt: the pixels say nothing.
    Learning,
    /// Nearly all edges of the background are displaced: the camera was moved. To be left out.
    Moved,
}

impl SilhouetteStatus {
    /// Whether its pixels can be used.
    pub fn is_usable(self) -> bool {
        matches!(self, SilhouetteStatus::Seen | SilhouetteStatus::Empty)
    }
}

/// How sure it is of each pixel of a camera's picture, or of a part of it, that it shows a body and not the background.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Silhouette {
    /// The camera that saw it.
    pub camera: CameraId,
    /// Columns [px].
    pub width: u32,
    /// Rows [px].
    pub height: u32,
    /// Which part of the camera's picture it is of.
    pub window: Window,
    /// The state of the whole silhouette.
    pub status: SilhouetteStatus,
    /// Pixels of at least [`Silhouette::BODY`] [px].
    pub n_body: u32,
    /// One byte a pixel, row by row: 0 surely background, 255 surely body.
    #[serde(skip)]
    pub confidence: Vec<u8>,
}

impl Silhouette {
    /// From this confidence on a pixel is body.
    pub const BODY: u8 = 128;

    /// Whether the pixel in column `x` of row `y` is body; `false` outside.
    pub fn is_body(&self, x: usize, y: usize) -> bool {
        x < self.width as usize && self.confidence.get(y * self.width as usize + x).is_some_and(|it| *it >= Self::BODY)
    }
}

impl Message for Silhouette {
    const NAME: &'static str = "silhouette";
    const SPACE: Space = Space::PIXELS;
    const WIRE: Wire = portable!(Silhouette);

    fn quality(&self) -> Quality {
        Quality { count: Some(self.n_body), sigma: None }
    }

    fn bulk(&self) -> &[u8] {
        &self.confidence
    }

    fn set_bulk(&mut self, bytes: Vec<u8>) {
        self.confidence = bytes;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_is_body_from_one_half_on_and_never_outside() {
        let confidence = vec![0, 127, 128, 255, 200, 0];
        let silhouette = Silhouette { width: 3, height: 2, confidence, ..Silhouette::default() };
        let body: Vec<bool> =
            (0..3).flat_map(|y| (0..4).map(move |x| (x, y))).map(|(x, y)| silhouette.is_body(x, y)).collect();
        assert_eq!(body, [false, false, true, false, true, true, false, false, false, false, false, false]);
        assert!(SilhouetteStatus::Empty.is_usable() && !SilhouetteStatus::Full.is_usable());
    }
}
