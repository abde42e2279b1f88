//! A picture of one byte a pixel, borrowed.

use crate::ImagingError;

/// One byte a pixel, row by row from the top, without padding. May be empty (0 px wide or high).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImageView<'a> {
    pixels: &'a [u8],
    width: usize,
    height: usize,
}

impl<'a> ImageView<'a> {
    /// The picture in `pixels`; [`ImagingError::WrongLength`] unless there are `width × height` of them.
    pub fn new(pixels: &'a [u8], width: usize, height: usize) -> Result<Self, ImagingError> {
        let expected = width.saturating_mul(height);
        if pixels.len() != expected {
            return Err(ImagingError::WrongLength { what: "picture", expected, found: pixels.len() });
        }
        Ok(Self { pixels, width, height })
    }

    /// All pixels, row by row [gray level, 0..=255].
    pub fn pixels(&self) -> &'a [u8] {
        self.pixels
    }

    /// Columns [px].
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows [px].
    pub fn height(&self) -> usize {
        self.height
    }

    /// (width, height) [px].
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Row `y`, `width` pixels; panics below the last row.
    pub fn row(&self, y: usize) -> &'a [u8] {
        &self.pixels[y * self.width..(y + 1) * self.width]
    }

    /// The pixel in column `x` of row `y`, nothing outside the picture.
    pub fn get(&self, x: usize, y: usize) -> Option<u8> {
        (x < self.width && y < self.height).then(|| self.pixels[y * self.width + x])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_buffer_of_the_wrong_length_is_refused() {
        let refused = ImageView::new(&[0; 5], 2, 3);
        assert_eq!(refused, Err(ImagingError::WrongLength { what: "picture", expected: 6, found: 5 }));
        assert!(ImageView::new(&[], usize::MAX, 2).is_err());
    }

    #[test]
    fn rows_and_pixels_lie_where_they_should() {
        let view = ImageView::new(&[1, 2, 3, 4, 5, 6], 3, 2).unwrap();
        assert_eq!(view.row(1), &[4, 5, 6]);
        assert_eq!((view.get(2, 0), view.get(3, 0), view.get(0, 2)), (Some(3), None, None));
    }

    #[test]
    fn an_empty_picture_is_a_picture() {
        assert_eq!(ImageView::new(&[], 0, 7).unwrap().get(0, 0), None);
    }
}
