//! One picture of one camera.

use nalgebra::Point2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::wire::portable;
use crate::{CameraId, Message, Space, Wire};

/// How the bytes of an [`Image`] are to be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
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

/// Which part of its camera's picture an [`Image`] shows, and how much smaller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Window {
    /// Columns of the camera's picture to the left of it [px].
    pub left: u32,
    /// Rows of the camera's picture above it [px].
    pub top: u32,
    /// How many of the camera's pixels each of its pixels is wide and high; at least 1.
    pub shrink: u32,
}

impl Default for Window {
    /// The whole picture as it is.
    fn default() -> Self {
        Self { left: 0, top: 0, shrink: 1 }
    }
}

impl Window {
    /// Whether an image of `size` (columns, rows) with this window lies on its camera's picture of `whole` and has pixels at all.
    pub fn fits(&self, size: [u32; 2], whole: [u32; 2]) -> bool {
        let fits = |start: u32, size: u32, whole: u32| {
            size > 0 && u64::from(start) + u64::from(size) * u64::from(self.shrink) <= u64::from(whole)
        };
        self.shrink > 0 && fits(self.left, size[0], whole[0]) && fits(self.top, size[1], whole[1])
    }

    /// Where in the camera's whole picture `pixel` of the image lies [px].
    pub fn in_camera(&self, pixel: &Point2<f64>) -> Point2<f64> {
        // The outer edge of the first pixel is half a pixel before its centre.
        let shrink = f64::from(self.shrink);
        let place = |start: u32, at: f64| f64::from(start) + (at + 0.5) * shrink - 0.5;
        Point2::new(place(self.left, pixel.x), place(self.top, pixel.y))
    }

    /// Where in the image `pixel` of the camera's whole picture lies, on it or not [px].
    pub fn in_image(&self, pixel: &Point2<f64>) -> Point2<f64> {
        let shrink = f64::from(self.shrink);
        let place = |start: u32, at: f64| (at - f64::from(start) + 0.5) / shrink - 0.5;
        Point2::new(place(self.left, pixel.x), place(self.top, pixel.y))
    }
}

/// One picture, or a part of one. Rows lie one after the other from the top, without padding.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
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
    #[serde(skip)]
    pub pixels: Vec<u8>,
    /// Which part of the camera's picture this is: what is found in it is given out in pixels of the whole.
    pub window: Window,
}

impl Message for Image {
    const NAME: &'static str = "image";
    const VERSION: u32 = 2;
    const SPACE: Space = Space::PIXELS;
    const WIRE: Wire = portable!(Image);

    fn bulk(&self) -> &[u8] {
        &self.pixels
    }

    fn set_bulk(&mut self, bytes: Vec<u8>) {
        self.pixels = bytes;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_of_a_part_is_the_same_place_in_the_whole_and_back() {
        let window = Window { left: 100, top: 40, shrink: 4 };
        // The first pixel covers those from 100 to 103.
        assert_eq!(window.in_camera(&Point2::new(0.0, 0.0)), Point2::new(101.5, 41.5));
        assert_eq!(window.in_camera(&Point2::new(-0.5, 2.0)), Point2::new(99.5, 49.5));
        let pixel = Point2::new(7.25, -3.0);
        assert_eq!(window.in_image(&window.in_camera(&pixel)), pixel);
        assert_eq!(Window::default().in_camera(&pixel), pixel);
    }

    #[test]
    fn a_part_fits_up_to_the_last_pixel() {
        let window = Window { left: 100, top: 0, shrink: 4 };
        assert!(window.fits([10, 20], [140, 80]));
        assert!(!window.fits([10, 20], [139, 80]) && !window.fits([10, 21], [140, 80]));
        assert!(!window.fits([0, 20], [140, 80]) && !Window { shrink: 0, ..window }.fits([1, 1], [140, 80]));
        assert!(!Window { left: u32::MAX, ..window }.fits([u32::MAX, 1], [140, 80]));
    }
}
