//! Marks on a copy of a picture, as PNG.

/// A picture to draw on: RGB, enlarged.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Canvas {
    /// Width [px].
    pub width: u32,
    /// Height [px].
    pub height: u32,
    /// Three bytes a pixel, row by row.
    pub pixels: Vec<u8>,
    zoom: u32,
}
impl Canvas {
    /// A copy of a picture of that width [px] with `channels` bytes per pixel (1: gray, 3: RGB). Each pixel becomes
    /// `zoom` × `zoom` pixels, and levels are multiplied by `gain`. An incomplete last row is left out.
    pub fn of(pixels: &[u8], width: u32, channels: usize, zoom: u32, gain: f64) -> Self {
        let row_length = (width as usize * channels).max(1);
        let height = (pixels.len() / row_length) as u32;
        let mut copy = Vec::with_capacity(pixels.len() * 3 / channels.max(1) * (zoom * zoom) as usize);
        let lifted: Vec<u8> = (0..=255_u8).map(|it| (f64::from(it) * gain).round().min(255.0) as u8).collect();
        for row in pixels.chunks_exact(row_length) {
            let start = copy.len();
            for pixel in row.chunks_exact(channels.max(1)) {
                let of = |channel: usize| lifted[usize::from(pixel[channel.min(channels - 1)])];
                (0..zoom).for_each(|_| copy.extend([of(0), of(1), of(2)]));
            }
            let line = start..copy.len();
            (1..zoom).for_each(|_| copy.extend_from_within(line.clone()));
        }
        Self { width: width * zoom, height: height * zoom, pixels: copy, zoom }
    }

    /// The picture as a PNG file, or why it cannot be encoded.
    pub fn png(&self) -> Result<Vec<u8>, String> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width, self.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::Fast);
        encoder.set_filter(png::Filter::Adaptive);
        let written = encoder.write_header().and_then(|mut it| it.write_image_data(&self.pixels));
        written.map(|()| bytes).map_err(|error| error.to_string())
    }

    /// Where the point (x, y) of the camera's picture, (0, 0) the centre of its first pixel, lies on this canvas.
    fn place(&self, x: f64, y: f64) -> (f64, f64) {
        let zoom = f64::from(self.zoom);
        ((x + 0.5) * zoom - 0.5, (y + 0.5) * zoom - 0.5)
    }

    /// Draws a ring around (x, y) of the camera's picture: `radius` in its pixels, one and a half pixels of the canvas wide, antialiased.
    pub fn ring(&mut self, x: f64, y: f64, radius: f64, colour: [u8; 3]) {
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

    /// Draws a line between two points (x, y) of the camera's picture, `width` of its pixels wide, antialiased, with round ends.
    pub fn line(&mut self, from: [f64; 2], to: [f64; 2], width: f64, colour: [u8; 3]) {
        let ([ax, ay], [bx, by]) =
            (<[f64; 2]>::from(self.place(from[0], from[1])), <[f64; 2]>::from(self.place(to[0], to[1])));
        let half = width * f64::from(self.zoom) / 2.0;
        let bounds = |a: f64, b: f64, size: u32| {
            let most = f64::from(size);
            (a.min(b) - half - 1.0).floor().clamp(0.0, most) as u32
                ..((a.max(b) + half + 1.0).ceil() + 1.0).clamp(0.0, most) as u32
        };
        let (dx, dy) = (bx - ax, by - ay);
        let long = (dx * dx + dy * dy).max(1e-12);
        for row in bounds(ay, by, self.height) {
            for column in bounds(ax, bx, self.width) {
                let (x, y) = (f64::from(column) - ax, f64::from(row) - ay);
                let share = ((x * dx + y * dy) / long).clamp(0.0, 1.0);
                let distance = (x - share * dx).hypot(y - share * dy);
                self.blend(column, row, colour, (half + 0.5 - distance).clamp(0.0, 1.0));
            }
        }
    }

    /// Blends `colour` into the pixel of the camera's picture in column `x` of row `y`, with opacity `cover`. Nothing outside the picture.
    pub fn tint(&mut self, x: u32, y: u32, colour: [u8; 3], cover: f64) {
        for row in y * self.zoom..((y + 1) * self.zoom).min(self.height) {
            for column in x * self.zoom..((x + 1) * self.zoom).min(self.width) {
                self.blend(column, row, colour, cover);
            }
        }
    }

    /// Colours those pixels of `region` (by column and row) that have a neighbour across a side outside of it.
    pub fn outline(&mut self, region: impl Fn(u32, u32) -> bool, colour: [u8; 3]) {
        let [width, height] = [self.width, self.height].map(|it| it / self.zoom.max(1));
        let inside = |x: Option<u32>, y: Option<u32>| match (x, y) {
            (Some(x), Some(y)) => x < width && y < height && region(x, y),
            _ => false,
        };
        for y in 0..height {
            for x in 0..width {
                let around = [
                    (x.checked_sub(1), Some(y)),
                    (Some(x + 1), Some(y)),
                    (Some(x), y.checked_sub(1)),
                    (Some(x), Some(y + 1)),
                ];
                if region(x, y) && !around.into_iter().all(|(x, y)| inside(x, y)) {
                    self.tint(x, y, colour, 1.0);
                }
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

    #[test]
    fn a_line_covers_what_lies_between_its_ends_and_nothing_outside() {
        let mut canvas = Canvas::of(&[0; 20 * 10], 20, 1, 1, 1.0);
        canvas.line([3.0, 5.0], [12.0, 5.0], 2.0, [0, 200, 0]);
        let green = |x: usize, y: usize| canvas.pixels[(y * 20 + x) * 3 + 1];
        assert_eq!([green(3, 5), green(8, 5), green(12, 5)], [200; 3]);
        assert_eq!([green(8, 8), green(8, 2), green(16, 5), green(0, 5)], [0; 4]);
        canvas.line([f64::NAN, 5.0], [4.0, 5.0], 2.0, [200; 3]);
        canvas.line([-1e7, -4.0], [-50.0, 1e7], 2.0, [200; 3]);
    }

    #[test]
    fn enlarged_pixels_keep_their_places_and_are_lifted() {
        let canvas = Canvas::of(&[10, 10, 10, 10, 90, 10], 3, 1, 2, 3.0);
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
            let mut canvas = Canvas::of(&[0; 21 * 21], 21, 1, zoom, 1.0);
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
        let mut canvas = Canvas::of(&[0; 8 * 8], 8, 1, 1, 1.0);
        for (x, y) in [(-3.0, 4.0), (7.5, 7.5), (-500.0, 0.0), (0.0, 1e9)] {
            canvas.ring(x, y, 5.0, [255; 3]);
        }
        assert_eq!(canvas.pixels.len(), 8 * 8 * 3);
    }

    #[test]
    fn png_holds_the_pixels_and_colours_stay() {
        let canvas = Canvas::of(&[1, 2, 3, 40, 50, 60], 2, 3, 1, 2.0);
        assert_eq!(canvas.pixels, [2, 4, 6, 80, 100, 120]);
        let bytes = canvas.png().unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; 6];
        reader.next_frame(&mut pixels).unwrap();
        assert_eq!(pixels, canvas.pixels);
        assert!(Canvas::of(&[], 0, 1, 1, 1.0).png().is_err(), "a picture without pixels");
    }
}
