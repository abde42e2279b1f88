//! The light of one picture of stripes, across the stripes: what its pixels emit, blurred by the lens.

use foveate_imaging::stripes::{Axis, Shown, StripeCode, pattern};

use super::ProjectorSettings;

/// Places to a projector pixel at which light is tabulated.
const FINE: usize = 4;
/// The least blur in the table [px]; each row of it has more by [`RATIO`].
const LEAST_PX: f32 = 0.2;
const RATIO: f32 = 1.3;
/// Rows of the table: up to a blur of some ten pixels.
const LEVELS: usize = 16;
/// A Gaussian is cut off after so many standard deviations.
const REACH: f64 = 4.0;

/// Light relative to white, by the coordinate across the stripes and by blur.
#[derive(Debug)]
pub(crate) struct Profile {
    /// Which coordinate of the projector it depends on.
    axis: usize,
    /// For each blur, at (i + ½) / [`FINE`] − ½ [px].
    levels: Vec<Vec<f32>>,
}

impl Profile {
    pub fn new(code: &StripeCode, shown: Shown, settings: &ProjectorSettings) -> Profile {
        let axis = match shown {
            Shown::Bit { axis, .. } | Shown::Phase { axis, .. } | Shown::Boundary { axis, .. } => axis,
            Shown::White | Shown::Black => Axis::Columns,
        };
        let [columns, rows] = code.projector.map(|it| it as usize);
        let picture = pattern::picture(code, shown, settings.assumed_gamma);
        let across: Vec<u8> = match axis {
            Axis::Columns => picture[..columns].to_vec(),
            Axis::Rows => (0..rows).map(|row| picture[row * columns]).collect(),
        };
        let black = 1.0 / settings.contrast;
        let emitted = |level: u8| black + (1.0 - black) * (f64::from(level) / 255.0).powf(settings.gamma);
        let light: Vec<f64> = across.iter().map(|it| emitted(*it)).collect();
        let levels = (0..LEVELS).map(|level| blurred(&light, f64::from(LEAST_PX * RATIO.powi(level as i32))));
        Profile { axis: axis.index(), levels: levels.collect() }
    }

    /// At these projector coordinates, under a blur of this [`level`].
    #[inline]
    pub fn at(&self, at: [f32; 2], level: f32) -> f32 {
        let below = (level as usize).min(LEVELS - 2);
        let share = level - below as f32;
        let place = (at[self.axis] + 0.5) * FINE as f32 - 0.5;
        let of = |level: usize| {
            let table = &self.levels[level];
            let place = place.clamp(0.0, (table.len() - 1) as f32);
            let first = (place as usize).min(table.len() - 2);
            table[first] + (table[first + 1] - table[first]) * (place - first as f32)
        };
        let (a, b) = (of(below), of(below + 1));
        a + (b - a) * share
    }
}

/// Where a blur lies between the rows of a table.
pub(super) fn level(sigma_px: f32) -> f32 {
    ((sigma_px / LEAST_PX).ln() / RATIO.ln()).clamp(0.0, (LEVELS - 1) as f32)
}

/// Pixels as wide as they are, each of even light, under a Gaussian; the last pixel goes on beyond the edge.
fn blurred(light: &[f64], sigma: f64) -> Vec<f32> {
    let step = 1.0 / FINE as f64;
    let half = (REACH * sigma / step).ceil() as isize;
    let weights: Vec<f64> = (-half..=half).map(|it| (-0.5 * (it as f64 * step / sigma).powi(2)).exp()).collect();
    let sum: f64 = weights.iter().sum();
    let last = (light.len() * FINE) as isize - 1;
    let at = |place: isize| light[place.clamp(0, last) as usize / FINE];
    let mean = |place: isize| {
        let near = (-half..=half).zip(&weights);
        (near.map(|(off, weight)| weight * at(place + off)).sum::<f64>() / sum) as f32
    };
    (0..=last).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn profile(shown: Shown, change: impl Fn(&mut ProjectorSettings)) -> Profile {
        let mut settings = ProjectorSettings { contrast: 100.0, ..ProjectorSettings::default() };
        change(&mut settings);
        Profile::new(&settings.stripe_code([64, 48]).unwrap(), shown, &settings)
    }

    /// Φ(x), by the integral.
    fn normal(x: f64) -> f64 {
        let n = 4000;
        let at = |i: i32| -8.0 + (x + 8.0) * (f64::from(i) + 0.5) / f64::from(n);
        let density = |t: f64| (-0.5 * t * t).exp() / std::f64::consts::TAU.sqrt();
        (0..n).map(|i| density(at(i))).sum::<f64>() * (x + 8.0) / f64::from(n)
    }

    #[test]
    fn an_edge_is_as_soft_as_the_blur_and_stands_where_its_pixels_meet() {
        let coarsest = profile(Shown::Bit { axis: Axis::Columns, plane: 0, inverse: false }, |_| ());
        for sigma in [0.4, 0.9, 2.2] {
            // Bit 0 of 8 stripes of 8 px is dark for columns 0 to 31.
            for off in [-3.0, -1.0, -0.3, 0.0, 0.2, 0.8, 2.5] {
                let found = coarsest.at([31.5 + off, 0.0], level(sigma));
                let expected = 0.01 + 0.99 * normal(f64::from(off) / f64::from(sigma));
                assert!((f64::from(found) - expected).abs() < 0.03, "{found} {expected} at {off}, blur {sigma}");
            }
        }
    }

    #[test]
    fn sine_waves_are_sine_waves_in_light_where_gamma_is_as_assumed() {
        let wave = |gamma: f64| {
            let shown = Shown::Phase { axis: Axis::Rows, step: 0 };
            let profile = profile(shown, |it| it.gamma = gamma);
            let light: Vec<f64> = (8..40).map(|it| f64::from(profile.at([5.0, it as f32], 0.0))).collect();
            let power = |cycles: f64| {
                let turn = |i: usize| std::f64::consts::TAU * cycles * i as f64 / 32.0;
                let sum =
                    |part: fn(f64) -> f64| light.iter().enumerate().map(|(i, it)| it * part(turn(i))).sum::<f64>();
                sum(f64::cos).hypot(sum(f64::sin))
            };
            power(4.0) / power(2.0)
        };
        // Half a gray level of rounding; 2.0 in place of 2.2 makes a second harmonic of some hundredths.
        assert!(wave(2.2) < 0.003, "{}", wave(2.2));
        assert!(wave(1.8) > 0.03, "{}", wave(1.8));
    }

    #[test]
    fn black_is_as_bright_as_the_contrast_says() {
        let [white, black] = [Shown::White, Shown::Black].map(|it| profile(it, |_| ()).at([20.0, 20.0], 3.0));
        assert!((white - 1.0).abs() < 1e-5 && (black - 0.01).abs() < 1e-5, "{white} {black}");
    }
}
