//! The hue of a bright spot in a colour picture.
//!
//! The middle of a laser's spot is full in all three planes, white whatever its colour. Its flanks are not: there the light that is added to what is around keeps the colour of the
//! source. So the light of all pixels on and beside the spot that are full in no plane is summed, less what the surroundings read, and the hue is that of the sum. The surroundings of a pixel
//! are what a ring about the spot reads in its direction from the middle: where a coloured window ends beneath a spot, each side is compared with its own. Each pixel counts by its light,
//! so that flanks, which are bright, count more than what contents differ by.
//!
//! Hue and chroma are those of the hexagon of colours: for red above green above blue, chroma is R − B and the hue 60° (G − B) / (R − B).

use crate::ImagingError;

/// A pixel that reads this or more in one plane is full: how much light fell on it is not known [gray level].
const FULL: u8 = 245;
/// Flanks reach so far beyond the lit pixels [px].
const FLANK: usize = 3;
/// A pixel with less light than this tells nothing [gray level].
const LEAST_LIGHT: f32 = 15.0;
/// A spot of fewer such pixels has no hue.
const LEAST_PIXELS: u32 = 4;

/// Hue of a bright spot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hue {
    /// 0 red, 120 green, 240 blue [deg].
    pub deg: f64,
    /// Chroma over brightness, from 0 for white to 1 for light of one plane alone.
    pub saturation: f64,
    /// Standard deviation of the hue, from the noise of the pixels [deg].
    pub sigma_deg: f64,
}

/// A picture of three bytes a pixel: red, green, blue.
#[derive(Debug, Clone, Copy)]
pub struct RgbView<'a> {
    pixels: &'a [[u8; 3]],
    width: usize,
    height: usize,
}

impl<'a> RgbView<'a> {
    /// A view of `bytes`.
    ///
    /// # Errors
    /// [`ImagingError::WrongLength`] where these are not three for each pixel.
    pub fn new(bytes: &'a [u8], width: usize, height: usize) -> Result<RgbView<'a>, ImagingError> {
        let (pixels, rest) = bytes.as_chunks::<3>();
        if !rest.is_empty() || pixels.len() != width * height {
            let expected = 3 * width * height;
            return Err(ImagingError::WrongLength { what: "RGB picture", expected, found: bytes.len() });
        }
        Ok(RgbView { pixels, width, height })
    }

    /// The hue of the spot whose lit pixels lie in `bounds` (first and last column and row), with pixel noise `pixel_sigma` [gray level]. `None` where the
    /// hue cannot be determined: too few unsaturated pixels, or no more chroma than noise has.
    pub fn hue(&self, bounds: [u32; 4], pixel_sigma: f64) -> Option<Hue> {
        let inner = self.grown(bounds, FLANK);
        let (mut sum, mut n, mut squares) = ([0.0_f32; 3], 0, 0.0_f32);
        for row in inner[1]..inner[3] {
            for column in inner[0]..inner[2] {
                let pixel = self.pixels[row * self.width + column];
                if pixel.iter().any(|it| *it >= FULL) {
                    continue;
                }
                let Some(around) = self.around(bounds, [column, row]) else { continue };
                let light: [f32; 3] = std::array::from_fn(|plane| f32::from(pixel[plane]) - around[plane]);
                let weight = light.into_iter().fold(0.0, f32::max);
                if weight < LEAST_LIGHT {
                    continue;
                }
                sum = std::array::from_fn(|plane| sum[plane] + weight * light[plane]);
                squares += weight * weight;
                n += 1;
            }
        }
        if n < LEAST_PIXELS {
            return None;
        }
        let [red, green, blue] = sum.map(f64::from);
        let (least, most) = (red.min(green).min(blue), red.max(green).max(blue));
        let chroma = most - least;
        // Of each pixel and of its ring, which some share; in two planes.
        let noise = 2.0 * pixel_sigma * f64::from(squares).sqrt();
        if chroma <= 3.0 * noise || most <= 0.0 {
            return None;
        }
        let sixth = if most == red {
            (green - blue) / chroma
        } else if most == green {
            2.0 + (blue - red) / chroma
        } else {
            4.0 + (red - green) / chroma
        };
        Some(Hue {
            deg: (60.0 * sixth).rem_euclid(360.0),
            saturation: (chroma / most).min(1.0),
            sigma_deg: 60.0 * noise / chroma,
        })
    }

    /// `bounds` as ranges, `by` wider on each side within the picture: first column and row, and those after the last.
    fn grown(&self, bounds: [u32; 4], by: usize) -> [usize; 4] {
        let [x0, y0, x1, y1] = bounds.map(|it| it as usize);
        let after = |last: usize, size: usize| (last + 1 + by).min(size);
        [x0.saturating_sub(by), y0.saturating_sub(by), after(x1, self.width), after(y1, self.height)]
    }

    /// What the ring reads in the direction of pixel `at` from the spot's middle: by plane the mean of up to three by three pixels; `None` where the picture ends before the ring.
    fn around(&self, bounds: [u32; 4], at: [usize; 2]) -> Option<[f32; 3]> {
        let middle = |axis: usize| (bounds[axis] as f32 + bounds[axis + 2] as f32) / 2.0;
        let reach = |axis: usize| (bounds[axis + 2] as f32 - bounds[axis] as f32) / 2.0 + FLANK as f32 + 2.0;
        let off = [0, 1].map(|axis| at[axis] as f32 - middle(axis));
        let stretch = [0, 1].map(|axis| reach(axis) / off[axis].abs().max(1e-3));
        let stretch = stretch[0].min(stretch[1]);
        let [x, y] = [0, 1].map(|axis| (middle(axis) + off[axis] * stretch).round());
        let is_within = x >= 1.0 && y >= 1.0 && x + 1.0 < self.width as f32 && y + 1.0 < self.height as f32;
        if !is_within {
            return None;
        }
        let (x, y) = (x as usize, y as usize);
        let mut sum = [0.0_f32; 3];
        for row in y - 1..=y + 1 {
            for pixel in &self.pixels[row * self.width + x - 1..=row * self.width + x + 1] {
                sum = std::array::from_fn(|plane| sum[plane] + f32::from(pixel[plane]));
            }
        }
        Some(sum.map(|it| it / 9.0))
    }
}

/// From `b` to `a` the shorter way around, −180 to 180 [deg].
pub fn hue_between(a: f64, b: f64) -> f64 {
    (a - b + 180.0).rem_euclid(360.0) - 180.0
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;

    use super::*;

    const SIZE: usize = 40;

    /// A Gaussian spot of `light` in its middle over what `ground` says, with noise; its picture and its lit pixels' bounds.
    fn picture(
        light: [f64; 3],
        sigma: f64,
        ground: impl Fn(usize, usize) -> [f64; 3],
        seed: u64,
    ) -> (Vec<u8>, [u32; 4]) {
        let mut random = Random::new(seed);
        let (x, y) = (19.0 + random.uniform(), 20.0 + random.uniform());
        let mut bounds = [u32::MAX, u32::MAX, 0, 0];
        let mut bytes = Vec::new();
        for row in 0..SIZE {
            for column in 0..SIZE {
                let square = (column as f64 - x).powi(2) + (row as f64 - y).powi(2);
                let under = ground(column, row);
                let pixel = [0, 1, 2].map(|plane| {
                    let value = under[plane] + light[plane] * (-square / (2.0 * sigma * sigma)).exp();
                    (value + 2.0 * random.normal()).round().clamp(0.0, 255.0) as u8
                });
                if pixel.iter().any(|it| *it > 150) {
                    let [x0, y0, x1, y1] = bounds;
                    let (column, row) = (column as u32, row as u32);
                    bounds = [x0.min(column), y0.min(row), x1.max(column), y1.max(row)];
                }
                bytes.extend(pixel);
            }
        }
        (bytes, bounds)
    }

    fn hue(picture: &(Vec<u8>, [u32; 4])) -> Option<Hue> {
        RgbView::new(&picture.0, SIZE, SIZE).unwrap().hue(picture.1, 2.0)
    }

    /// Lasers of 650, 532, 450 and 589 nm as a camera may see them, and their hues.
    const LASERS: [([f64; 3], f64); 4] =
        [([1.0, 0.08, 0.03], 3.1), ([0.18, 1.0, 0.2], 121.5), ([0.04, 0.16, 1.0], 232.5), ([1.0, 0.75, 0.06], 44.0)];

    #[test]
    fn a_spot_that_is_white_in_its_middle_has_the_hue_of_its_source() {
        for (colour, expected) in LASERS {
            for peak in [220.0, 400.0, 2000.0, 8000.0] {
                for seed in 0..20 {
                    let found = hue(&picture(colour.map(|it| it * peak), 1.1, |_, _| [8.0; 3], seed)).unwrap();
                    let off = hue_between(found.deg, expected).abs();
                    assert!(off < 12.0, "{off}° at {peak}: {found:?}");
                    assert!(off < 5.0 * found.sigma_deg + 4.0, "{off}°, stated {found:?}");
                }
            }
        }
    }

    #[test]
    fn surroundings_that_are_lit_striped_or_coloured_do_not_change_the_hue() {
        let stripes = |_: usize, row: usize| if (row / 3).is_multiple_of(2) { [20.0; 3] } else { [110.0; 3] };
        let blue = |_: usize, _: usize| [20.0, 40.0, 120.0];
        for (colour, expected) in LASERS {
            for seed in 0..20 {
                let striped = hue(&picture(colour.map(|it| it * 2000.0), 1.3, stripes, seed)).unwrap();
                assert!(hue_between(striped.deg, expected).abs() < 20.0, "{striped:?} for {expected}°");
                // A window ends beneath the spot.
                let edge = |column: usize, _: usize| if column < 19 { [8.0; 3] } else { [110.0, 30.0, 20.0] };
                let at_edge = hue(&picture(colour.map(|it| it * 2000.0), 1.3, edge, seed)).unwrap();
                assert!(hue_between(at_edge.deg, expected).abs() < 20.0, "{at_edge:?} for {expected}°");
                let on_blue = hue(&picture(colour.map(|it| it * 2000.0), 1.3, blue, seed)).unwrap();
                assert!(hue_between(on_blue.deg, expected).abs() < 15.0, "{on_blue:?} for {expected}°");
            }
        }
    }

    #[test]
    fn white_light_and_a_spot_without_flanks_have_no_hue() {
        for seed in 0..20 {
            let white = hue(&picture([2000.0; 3], 1.1, |_, _| [8.0; 3], seed));
            assert!(white.is_none_or(|it| it.saturation < 0.15), "{white:?}");
        }
        let full = (vec![255; 3 * SIZE * SIZE], [10, 10, 20, 20]);
        assert_eq!(hue(&full), None);
        assert!(RgbView::new(&full.0[1..], SIZE, SIZE).is_err());
        // Where all is spot there is no ring.
        let dark = (vec![8; 3 * SIZE * SIZE], [0, 0, SIZE as u32 - 1, SIZE as u32 - 1]);
        assert_eq!(hue(&dark), None);
    }

    #[test]
    fn hues_differ_the_shorter_way_around() {
        assert_eq!(hue_between(10.0, 350.0), 20.0);
        assert_eq!(hue_between(350.0, 10.0), -20.0);
    }
}
