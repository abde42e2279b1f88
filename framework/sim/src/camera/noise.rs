//! Noise, and the step from light to bytes.
//!
//! Drawing a normal number for each pixel would take longer than all the rest. Instead each row of each field is the sum of two
//! stretches, at random places, of two tables of normal numbers: 2²⁸ different rows, so that a pixel's noise in one field says
//! nothing about its noise in the next. The sum of two table entries is normal far into the tails (the largest of a table of
//! 2¹⁴ lies near 4 σ, that of the sums near 5.5 σ). Within one field a table entry serves about ten times.

use foveate_estimation::random::Random;

use super::STEPS;
use crate::chance::stream;

const TABLE_SIZE: usize = 1 << 14;

/// The noise of one camera.
pub(super) struct Noise {
    seed: u64,
    /// Longer than `TABLE_SIZE` by a row, so that a stretch may start anywhere; empty without noise.
    tables: [Vec<i16>; 2],
}

impl Noise {
    /// For rows of `width` pixels and noise of `sigma` [gray level].
    pub fn new(width: usize, sigma: f64, random: &Random) -> Self {
        let scale = sigma * STEPS / std::f64::consts::SQRT_2;
        let length = if sigma > 0.0 { TABLE_SIZE + width } else { 0 };
        let tables = [0, 1].map(|number| {
            let mut random = random.fork(&format!("table {number}"));
            (0..length).map(|_| (random.normal() * scale).round() as i16).collect()
        });
        Self { seed: random.fork("rows").next_u64(), tables }
    }

    /// Adds the noise of this channel of field `frame`, rounds, saturates.
    pub fn digitise(&self, canvas: &[i16], width: usize, frame: u64, channel: u64, pixels: &mut [u8]) {
        let rows = canvas.chunks_exact(width).zip(pixels.chunks_exact_mut(width));
        if self.tables[0].is_empty() {
            for (lights, bytes) in rows {
                bytes.iter_mut().zip(lights).for_each(|(byte, light)| *byte = to_byte(*light));
            }
            return;
        }
        let mut random = stream(self.seed, channel, frame as i64);
        for (lights, bytes) in rows {
            let bits = random.next_u64() as usize;
            let places = [bits % TABLE_SIZE, (bits >> 32) % TABLE_SIZE];
            let one = &self.tables[0][places[0]..places[0] + width];
            let other = &self.tables[1][places[1]..places[1] + width];
            for (((byte, light), a), b) in bytes.iter_mut().zip(lights).zip(one).zip(other) {
                *byte = to_byte(light.saturating_add(*a).saturating_add(*b));
            }
        }
    }
}

/// Steps to gray levels, rounded, from 0 to 255.
#[inline]
fn to_byte(steps: i16) -> u8 {
    (steps.saturating_add(32) >> 6).clamp(0, 255) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 640;
    const HEIGHT: usize = 240;

    fn fields(sigma: f64, level: i16, count: u64) -> Vec<Vec<f64>> {
        let noise = Noise::new(WIDTH, sigma, &Random::new(1));
        let canvas = vec![level * 64; WIDTH * HEIGHT];
        (0..count)
            .map(|frame| {
                let mut pixels = vec![0; WIDTH * HEIGHT];
                noise.digitise(&canvas, WIDTH, frame, 0, &mut pixels);
                pixels.into_iter().map(|it| f64::from(it) - f64::from(level)).collect()
            })
            .collect()
    }

    fn correlation(a: &[f64], b: &[f64]) -> f64 {
        let product: f64 = a.iter().zip(b).map(|(x, y)| x * y).sum();
        let [aa, bb] = [a, b].map(|it| it.iter().map(|x| x * x).sum::<f64>());
        product / (aa * bb).sqrt()
    }

    #[test]
    fn moments_and_tails_are_those_of_a_normal_distribution() {
        let sigma = 6.0;
        let values: Vec<f64> = fields(sigma, 128, 8).concat();
        let moment = |power: i32| values.iter().map(|x| (x / sigma).powi(power)).sum::<f64>() / values.len() as f64;
        // The tables hold 2 × 16,384 numbers: that, not the number of pixels, sets the accuracy.
        assert!(moment(1).abs() < 0.03, "mean {}", moment(1));
        assert!((moment(2) - 1.0).abs() < 0.03, "variance {}", moment(2));
        assert!(moment(3).abs() < 0.06 && (moment(4) - 3.0).abs() < 0.2, "{} {}", moment(3), moment(4));
        for (limit, expected) in [(2.0, 0.0455), (3.0, 0.0027)] {
            let beyond = values.iter().filter(|x| x.abs() > limit * sigma).count() as f64 / values.len() as f64;
            // Half a gray level of rounding shifts the limit by 1/12 σ.
            assert!((0.6..1.4).contains(&(beyond / expected)), "{beyond} beyond {limit} σ instead of {expected}");
        }
    }

    #[test]
    fn fields_rows_and_pixels_are_uncorrelated() {
        let fields = fields(8.0, 128, 6);
        let bound = 4.0 / ((WIDTH * HEIGHT) as f64).sqrt();
        for i in 1..fields.len() {
            let found = correlation(&fields[i - 1], &fields[i]);
            assert!(found.abs() < bound, "fields {i} and before: {found}");
        }
        for shift in [1, 2, WIDTH, 3 * WIDTH, 7 * WIDTH + 5] {
            let found = correlation(&fields[0][shift..], &fields[0][..WIDTH * HEIGHT - shift]);
            assert!(found.abs() < 2.0 * bound, "shift {shift}: {found}");
        }
    }

    #[test]
    fn one_pixel_over_time_is_normal_too() {
        let fields = fields(8.0, 128, 400);
        for pixel in [0, 641, 77_777] {
            let values: Vec<f64> = fields.iter().map(|it| it[pixel]).collect();
            let variance = values.iter().map(|x| x * x).sum::<f64>() / 400.0;
            // Four standard errors of a variance over 400 values: 4 √(2/400) = 0.28.
            assert!((variance / 64.0 - 1.0).abs() < 0.28, "{variance}");
            let next = correlation(&values[1..], &values[..399]);
            assert!(next.abs() < 0.2, "{next}");
        }
    }

    #[test]
    fn without_noise_light_is_rounded() {
        let noise = Noise::new(3, 0.0, &Random::new(1));
        let mut pixels = [0; 6];
        noise.digitise(&[31, 32, 64 * 255, i16::MAX, -50, i16::MIN], 3, 0, 0, &mut pixels);
        assert_eq!(pixels, [0, 1, 255, 255, 0, 0]);
    }
}
