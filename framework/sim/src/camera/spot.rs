//! A spot of light: a Gaussian, integrated over each pixel.

use super::STEPS;

/// How far from the centre a spot is drawn, in standard deviations: beyond, less than 0.02 % of its peak is left.
const REACH: f64 = 4.2;
/// Pixels along one axis that a spot may cover.
const MAX_EXTENT: usize = 256;

/// A spot of light that would reach `peak` at its middle if pixels were points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Spot {
    /// Along rows and columns [px].
    pub centre: [f64; 2],
    /// Standard deviations along rows and columns [px].
    pub sigma: [f64; 2],
    /// [gray level]
    pub peak: f64,
}

/// One axis of a spot: the first pixel, and the mean of exp(−d²/2σ²) over it and those after it.
struct Profile {
    start: usize,
    length: usize,
    means: [f32; MAX_EXTENT],
}

impl Profile {
    /// `None` when the spot does not reach the image.
    fn new(centre: f64, sigma: f64, size: u32) -> Option<Self> {
        let reach = (REACH * sigma + 0.5).min(MAX_EXTENT as f64 / 2.0 - 1.0);
        let first = (centre - reach).ceil().max(0.0);
        let last = (centre + reach).floor().min(f64::from(size) - 1.0);
        if first > last || !centre.is_finite() {
            return None;
        }
        let (start, length) = (first as usize, (last - first) as usize + 1);
        let mut profile = Self { start, length, means: [0.0; MAX_EXTENT] };
        // ∫ exp(−d²/2σ²) over a pixel is σ √(π/2) times a difference of error functions at its edges.
        let per_sigma = 1.0 / (sigma * std::f64::consts::SQRT_2);
        let scale = sigma * (std::f64::consts::PI / 2.0).sqrt();
        let mut before = error_function((first - 0.5 - centre) * per_sigma);
        for (i, mean) in profile.means[..length].iter_mut().enumerate() {
            let after = error_function((first + i as f64 + 0.5 - centre) * per_sigma);
            *mean = (scale * (after - before)) as f32;
            before = after;
        }
        Some(profile)
    }
}

impl Spot {
    /// Adds it to a canvas of `size` (columns, rows) in steps of a gray level, saturating.
    pub fn add_to(&self, canvas: &mut [i16], size: [u32; 2]) {
        let Some(across) = Profile::new(self.centre[0], self.sigma[0], size[0]) else { return };
        let Some(down) = Profile::new(self.centre[1], self.sigma[1], size[1]) else { return };
        let peak = (self.peak * STEPS) as f32;
        let rows = canvas.chunks_exact_mut(size[0] as usize).skip(down.start);
        for (row, vertical) in rows.zip(&down.means[..down.length]) {
            let pixels = &mut row[across.start..across.start + across.length];
            for (pixel, horizontal) in pixels.iter_mut().zip(&across.means[..across.length]) {
                *pixel = pixel.saturating_add((peak * vertical * horizontal + 0.5) as i16);
            }
        }
    }
}

/// The error function, within 1.5e-7.
///
/// Source: M. Abramowitz and I. Stegun, *Handbook of Mathematical Functions*, 1964, 7.1.26.
fn error_function(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.327_591_1 * x.abs());
    let polynomial =
        t * (0.254_829_592 + t * (-0.284_496_736 + t * (1.421_413_741 + t * (-1.453_152_027 + t * 1.061_405_429))));
    (1.0 - polynomial * (-x * x).exp()).copysign(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [u32; 2] = [40, 30];

    fn drawn(centre: [f64; 2], sigma: [f64; 2]) -> Vec<i16> {
        let mut canvas = vec![0; 1200];
        Spot { centre, sigma, peak: 200.0 }.add_to(&mut canvas, SIZE);
        canvas
    }

    #[test]
    fn pixels_are_means_of_the_gaussian_over_them() {
        let (centre, sigma) = ([17.3, 12.8], [1.2, 0.6]);
        let canvas = drawn(centre, sigma);
        let gaussian = |at: f64, axis: usize| (-0.5 * ((at - centre[axis]) / sigma[axis]).powi(2)).exp();
        let mean = |i: usize, axis: usize| {
            (0..200).map(|k| gaussian(i as f64 - 0.5 + (k as f64 + 0.5) / 200.0, axis)).sum::<f64>() / 200.0
        };
        for (i, &found) in canvas.iter().enumerate() {
            let expected = 200.0 * STEPS * mean(i % 40, 0) * mean(i / 40, 1);
            assert!((f64::from(found) - expected).abs() < 4.0, "pixel {i}: {found}, expected {expected}");
        }
    }

    #[test]
    fn centre_of_mass_is_the_centre() {
        for shift in 0..10 {
            let centre = [15.0 + 0.1 * f64::from(shift), 14.0 - 0.07 * f64::from(shift)];
            let (mut sum, mut moment) = (0.0, [0.0; 2]);
            for (i, &value) in drawn(centre, [1.3, 0.65]).iter().enumerate() {
                sum += f64::from(value);
                moment[0] += f64::from(value) * (i % 40) as f64;
                moment[1] += f64::from(value) * (i / 40) as f64;
            }
            assert!((moment[0] / sum - centre[0]).abs() < 2e-3 && (moment[1] / sum - centre[1]).abs() < 2e-3);
        }
    }

    #[test]
    fn spots_at_and_beyond_the_edge_are_cut_off() {
        assert!(drawn([0.0, 0.0], [2.0, 2.0])[0] > 100 * 64);
        for centre in [[-20.0, 5.0], [5.0, 400.0], [f64::NAN, 5.0], [5.0, f64::INFINITY], [39.0, -1e300]] {
            assert!(drawn(centre, [2.0, 2.0]).iter().all(|&it| it == 0), "{centre:?}");
        }
        assert!(drawn([20.0, 15.0], [500.0, 500.0]).iter().all(|&it| it > 190 * 64));
    }
}
