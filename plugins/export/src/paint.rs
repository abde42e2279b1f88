//! Marks on a copy of a camera's picture.

use foveate::prelude::*;

/// A picture to draw on: RGB, enlarged.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Canvas {
    pub(crate) width: u32,
    pub(crate) height: u32,
    /// Three bytes a pixel.
    pub(crate) pixels: Vec<u8>,
    zoom: u32,
}

impl Canvas {
    /// A copy of `image` in which each pixel is `zoom` × `zoom` pixels, and gray levels are multiplied by `gain`.
    pub(crate) fn of(image: &Image, zoom: u32, gain: f64) -> Self {
        let (width, height) = (image.width * zoom, image.height * zoom);
        let mut pixels = Vec::with_capacity(width as usize * height as usize * 3);
        let channels = image.format.channels();
        let lifted: Vec<u8> = (0..=255_u8).map(|it| (f64::from(it) * gain).round().min(255.0) as u8).collect();
        for row in image.pixels.chunks_exact((image.width as usize * channels).max(1)) {
            let start = pixels.len();
            for pixel in row.chunks_exact(channels) {
                let of = |channel: usize| lifted[usize::from(pixel[channel.min(channels - 1)])];
                (0..zoom).for_each(|_| pixels.extend([of(0), of(1), of(2)]));
            }
            let line = start..pixels.len();
            (1..zoom).for_each(|_| pixels.extend_from_within(line.clone()));
        }
        Self { width, height, pixels, zoom }
    }

    /// Where the point (x, y) of the camera's picture, (0, 0) the centre of its first pixel, lies on this canvas.
    fn place(&self, x: f64, y: f64) -> (f64, f64) {
        let zoom = f64::from(self.zoom);
        ((x + 0.5) * zoom - 0.5, (y + 0.5) * zoom - 0.5)
    }

    /// A ring around (x, y) of the camera's picture: `radius` in its pixels, one and a half pixels of the canvas wide, with
    /// soft edges.
    pub(crate) fn ring(&mut self, x: f64, y: f64, radius: f64, colour: [u8; 3]) {
        const HALF_WIDTH: f64 = 0.75;
        let (cx, cy) = self.place(x, y);
        let radius = radius * f64::from(self.zoom);
        let reach = radius + HALF_WIDTH + 1.0;
        let bounds = |centre: f64, size: u32| {
            let low = (centre - reach).floor().clamp(0.0, f64::from(size)) as u32;
            let high = (centre + reach).ceil().clamp(-1.0, f64::from(size) - 1.0) as i64 + 1;
            low..high.max(0) as u32
        };
        for row in bounds(cy, self.height) {
            for column in bounds(cx, self.width) {
                let distance = (f64::from(column) - cx).hypot(f64::from(row) - cy);
                let cover = (HALF_WIDTH + 0.5 - (distance - radius).abs()).clamp(0.0, 1.0);
                self.blend(column, row, colour, cover);
            }
        }
    }

    fn blend(&mut self, column: u32, row: u32, colour: [u8; 3], cover: f64) {
        let start = (row as usize * self.width as usize + column as usize) * 3;
        for (pixel, colour) in self.pixels[start..start + 3].iter_mut().zip(colour) {
            *pixel = (f64::from(*pixel) * (1.0 - cover) + f64::from(colour) * cover).round() as u8;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gray(width: u32, height: u32, level: u8) -> Image {
        let pixels = vec![level; (width * height) as usize];
        Image { width, height, pixels, ..Image::default() }
    }

    #[test]
    fn enlarged_pixels_keep_their_places_and_are_lifted() {
        let mut image = gray(3, 2, 10);
        image.pixels[4] = 90;
        let canvas = Canvas::of(&image, 2, 3.0);
        assert_eq!((canvas.width, canvas.height, canvas.pixels.len()), (6, 4, 72));
        for row in 0..4 {
            for column in 0..6 {
                let expected = if row / 2 == 1 && column / 2 == 1 { 255 } else { 30 };
                assert_eq!(canvas.pixels[(row * 6 + column) * 3], expected, "{column}, {row}");
            }
        }
    }

    #[test]
    fn ring_lies_around_its_point_and_leaves_the_middle_free() {
        for zoom in [1, 3] {
            let mut canvas = Canvas::of(&gray(21, 21, 0), zoom, 1.0);
            canvas.ring(10.0, 10.0, 6.0, [255, 0, 255]);
            let (mut sum, mut moment) = (0.0, (0.0, 0.0));
            for (index, pixel) in canvas.pixels.chunks(3).enumerate() {
                let (column, row) = (index % canvas.width as usize, index / canvas.width as usize);
                sum += f64::from(pixel[0]);
                moment.0 += column as f64 * f64::from(pixel[0]);
                moment.1 += row as f64 * f64::from(pixel[0]);
                assert_eq!(pixel[1], 0);
            }
            let middle = (f64::from(canvas.width) - 1.0) / 2.0;
            assert!((moment.0 / sum - middle).abs() < 1e-9 && (moment.1 / sum - middle).abs() < 1e-9);
            let centre = (canvas.height as usize / 2 * canvas.width as usize + canvas.width as usize / 2) * 3;
            assert_eq!(canvas.pixels[centre], 0);
        }
    }

    #[test]
    fn rings_at_and_beyond_the_edge_are_cut_off() {
        let mut canvas = Canvas::of(&gray(8, 8, 0), 1, 1.0);
        for (x, y) in [(-3.0, 4.0), (7.5, 7.5), (-500.0, 0.0), (0.0, 1e9)] {
            canvas.ring(x, y, 5.0, [255; 3]);
        }
        assert_eq!(canvas.pixels.len(), 8 * 8 * 3);
    }
}
