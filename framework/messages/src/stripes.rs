//! Structured light: the pictures of one set of patterns, and where in the projector each pixel is lit from.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::wire::portable;
use crate::{CameraId, Message, Quality, Space, Wire};

/// All pictures that one camera took of one set of patterns, of one size, a byte a pixel.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub struct PatternPictures {
    /// The camera that saw them.
    pub camera: CameraId,
    /// Name of the set, such as its folder.
    pub name: String,
    /// Columns [px].
    pub width: u32,
    /// Rows [px].
    pub height: u32,
    /// Name of each picture, in the order of the set.
    pub names: Vec<String>,
    /// Places of pictures that could not be read, ascending; their pixels are 0.
    #[serde(default)]
    pub unreadable: Vec<u32>,
    /// The text of a file beside them that says which patterns they show; empty without one.
    pub manifest: String,
    /// The pictures one after the other, each `width × height` bytes, row by row.
    #[serde(skip)]
    pub pixels: Vec<u8>,
}

impl PatternPictures {
    /// The pixels of picture `index`.
    pub fn picture(&self, index: usize) -> Option<&[u8]> {
        let n = self.width as usize * self.height as usize;
        self.pixels.get(index * n..(index + 1) * n)
    }
}

impl Message for PatternPictures {
    const NAME: &'static str = "pattern_pictures";
    const SPACE: Space = Space::PIXELS;
    const WIRE: Wire = portable!(PatternPictures);

    fn quality(&self) -> Quality {
        Quality { count: Some(self.names.len() as u32), sigma: None }
    }

    fn bulk(&self) -> &[u8] {
        &self.pixels
    }

    fn set_bulk(&mut self, bytes: Vec<u8>) {
        self.pixels = bytes;
    }
}

/// The projector coordinates of one camera pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProjectorSample {
    /// Projector column and row; (0, 0) is the centre of its top-left pixel; NaN where one is not known [px].
    pub coordinate: [f32; 2],
    /// Their standard deviations, NaN likewise [px].
    pub sigma: [f32; 2],
}

impl ProjectorSample {
    /// Nothing is known.
    pub const NONE: ProjectorSample = ProjectorSample { coordinate: [f32::NAN; 2], sigma: [f32::NAN; 2] };
    const BYTES: usize = 16;
}

/// Where in the projector each pixel of a camera is lit from.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub struct ProjectorMap {
    /// The camera.
    pub camera: CameraId,
    /// Name of the set of patterns.
    pub name: String,
    /// Columns and rows of the projector [px].
    pub projector_size: [u32; 2],
    /// Columns of the camera [px].
    pub width: u32,
    /// Rows of the camera [px].
    pub height: u32,
    /// Pixels with at least one known coordinate.
    pub n_known: u32,
    /// Sixteen bytes a pixel, row by row: see [`ProjectorMap::get`].
    #[serde(skip)]
    pub samples: Vec<u8>,
}

impl ProjectorMap {
    /// Adds the next pixel, row by row.
    pub fn push(&mut self, sample: ProjectorSample) {
        let ProjectorSample { coordinate: [u, v], sigma: [a, b] } = sample;
        self.n_known += u32::from(u.is_finite() || v.is_finite());
        self.samples.extend([u, v, a, b].iter().flat_map(|it| it.to_le_bytes()));
    }

    /// Projector coordinates of the pixel in column `x` of row `y`; none outside the picture.
    pub fn get(&self, x: usize, y: usize) -> ProjectorSample {
        let (width, height) = (self.width as usize, self.height as usize);
        if x >= width || y >= height {
            return ProjectorSample::NONE;
        }
        let start = (y * width + x) * ProjectorSample::BYTES;
        let number = |at: usize| {
            let bytes = self.samples.get(start + 4 * at..start + 4 * at + 4).and_then(|it| it.try_into().ok());
            bytes.map_or(f32::NAN, f32::from_le_bytes)
        };
        ProjectorSample { coordinate: [number(0), number(1)], sigma: [number(2), number(3)] }
    }
}

impl Message for ProjectorMap {
    const NAME: &'static str = "projector_map";
    const SPACE: Space = Space::PIXELS;
    const WIRE: Wire = portable!(ProjectorMap);

    fn quality(&self) -> Quality {
        Quality { count: Some(self.n_known), sigma: None }
    }

    fn bulk(&self) -> &[u8] {
        &self.samples
    }

    fn set_bulk(&mut self, bytes: Vec<u8>) {
        self.samples = bytes;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_are_where_they_were_pushed() {
        let mut map = ProjectorMap { width: 2, height: 2, ..ProjectorMap::default() };
        for at in 0..4 {
            let known = ProjectorSample { coordinate: [at as f32, f32::NAN], sigma: [0.1, f32::NAN] };
            map.push(if at == 2 { ProjectorSample::NONE } else { known });
        }
        assert_eq!((map.get(1, 1).coordinate[0], map.get(1, 0).sigma[0]), (3.0, 0.1));
        assert!(map.get(0, 1).coordinate[0].is_nan() && map.get(2, 0).coordinate[0].is_nan());
        assert_eq!(map.quality().count, Some(3));
    }

    #[test]
    fn pictures_of_a_set_lie_one_after_the_other() {
        let pixels = (0..12).collect();
        let set = PatternPictures { width: 2, height: 3, pixels, ..PatternPictures::default() };
        assert_eq!(set.picture(1), Some(&[6, 7, 8, 9, 10, 11][..]));
        assert_eq!(set.picture(2), None);
    }
}
