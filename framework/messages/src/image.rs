//! One picture of one camera.

use crate::{CameraId, Message, SpaceKind};

/// How the bytes of an [`Image`] are to be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PixelFormat {
    /// One byte a pixel.
    #[default]
    Gray8,
    /// Red, green, blue: three bytes a pixel.
    Rgb8,
}

impl PixelFormat {
    /// Bytes a pixel.
    pub const fn channels(self) -> usize {
        match self {
            PixelFormat::Gray8 => 1,
            PixelFormat::Rgb8 => 3,
        }
    }
}

/// One picture. Rows lie one after the other from the top, without padding.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Image {
    /// The camera that saw it.
    pub camera: CameraId,
    /// Columns [px].
    pub width: u32,
    /// Rows [px].
    pub height: u32,
    /// How to read `pixels`.
    pub format: PixelFormat,
    /// `width × height × format.channels()` bytes.
    pub pixels: Vec<u8>,
}

impl Message for Image {
    const NAME: &'static str = "image";
    const SPACE: SpaceKind = SpaceKind::CameraPixels;
}
