//! Phase shift: the projector coordinate of each camera pixel from sine waves that were shifted in equal steps.
//!
//! Step k of n shows A + B cos(φ − 2π k / n) to a pixel, φ being 2π times its place in periods. The sums of the steps with the sine and cosine of
//! 2π k / n give φ and B; the stripe of the Gray code says which period it is, half a period at a time, so that a stripe that is one off at a boundary does no harm.
//!
//! A pixel is left out where a step is saturated, where the wave is too weak, where the steps are not on one wave (something moved, or light that came over other
//! surfaces), and where phase and stripe contradict each other.
//!
//! Source: V. Srinivasan, H. Liu, M. Halioua, "Automated phase-measuring profilometry of 3-D diffuse objects", Applied Optics 23(18), 1984.

use super::code::{Axis, Shown, StripeCode};
use super::edges::Coordinates;
use super::gray::{Decoded, NONE, same_size};
use crate::{ImageView, ImagingError};

/// What makes a phase.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhaseOptions {
    /// Amplitude of the wave, at least [gray levels].
    pub min_amplitude: f64,
    /// Of a camera's gray levels, standard deviation [gray levels].
    pub noise: f64,
    /// Steps may be this far off the wave, root mean square, over its amplitude [–].
    pub max_misfit: f64,
}

impl Default for PhaseOptions {
    fn default() -> Self {
        Self { min_amplitude: 4.0, noise: 1.5, max_misfit: 0.15 }
    }
}

/// A gray level that is saturated.
const SATURATED: u8 = 254;
/// How far phase and stripe may be apart, of the most that they can be before a period would be wrong [–].
const AGREED: f64 = 0.9;

/// The projector coordinate of each camera pixel by its phase, in the period that its stripe says.
///
/// # Errors
/// A code without phase steps, or a set of pictures that is not as `code` says.
pub fn coordinates(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    decoded: &Decoded,
    options: &PhaseOptions,
) -> Result<Coordinates, ImagingError> {
    code.check()?;
    same_size(code, pictures)?;
    ImagingError::unless(code.steps > 0, "steps", "3 to 32", 0.0)?;
    let n = decoded.size[0] * decoded.size[1];
    let mut found = Coordinates { size: decoded.size, ..Coordinates::default() };
    for axis in Axis::BOTH {
        let stripes = &decoded.stripes[axis.index()];
        if stripes.len() != n {
            continue;
        }
        let place = |step: u32| code.place(Shown::Phase { axis, step }).map(|it| pictures[it].pixels());
        let steps: Vec<&[u8]> = (0..code.steps).filter_map(place).collect();
        let wave = Wave::new(code, axis, options);
        let (mut values, mut sigmas) = (vec![f32::NAN; n], vec![f32::NAN; n]);
        for (at, stripe) in stripes.iter().enumerate().filter(|it| *it.1 != NONE) {
            if let Some((value, sigma)) = wave.place(&steps, at, *stripe) {
                (values[at], sigmas[at]) = (value as f32, sigma as f32);
            }
        }
        (found.values[axis.index()], found.sigmas[axis.index()]) = (values, sigmas);
    }
    Ok(found)
}

struct Wave<'a> {
    options: &'a PhaseOptions,
    /// Cosine and sine of each step.
    turns: Vec<[f64; 2]>,
    period: f64,
    half: f64,
    first: f64,
    offset: f64,
}

impl<'a> Wave<'a> {
    fn new(code: &StripeCode, axis: Axis, options: &'a PhaseOptions) -> Wave<'a> {
        let turn = |step: u32| std::f64::consts::TAU * f64::from(step) / f64::from(code.steps);
        let (offset, stripe) = (code.offset[axis.index()], code.stripe[axis.index()]);
        Wave {
            options,
            turns: (0..code.steps).map(|it| [turn(it).cos(), turn(it).sin()]).collect(),
            period: f64::from(code.period),
            half: f64::from(stripe),
            first: f64::from(offset / stripe),
            offset: f64::from(offset),
        }
    }

    /// Coordinate and standard deviation of pixel `at`.
    fn place(&self, steps: &[&[u8]], at: usize, stripe: u16) -> Option<(f64, f64)> {
        let n = steps.len() as f64;
        let (mut mean, mut cosine, mut sine) = (0.0, 0.0, 0.0);
        for (step, [c, s]) in steps.iter().zip(&self.turns) {
            if step[at] >= SATURATED {
                return None;
            }
            let level = f64::from(step[at]);
            mean += level / n;
            cosine += level * c * 2.0 / n;
            sine += level * s * 2.0 / n;
        }
        let amplitude = cosine.hypot(sine);
        let misfit = steps
            .iter()
            .zip(&self.turns)
            .map(|(step, [c, s])| (f64::from(step[at]) - mean - cosine * c - sine * s).powi(2));
        let misfit = (misfit.sum::<f64>() / n).sqrt();
        let allowed = (3.0 * self.options.noise).max(self.options.max_misfit * amplitude);
        if amplitude < self.options.min_amplitude || misfit > allowed {
            return None;
        }
        let part = sine.atan2(cosine) / std::f64::consts::TAU * self.period;
        let middle = (f64::from(stripe) + self.first + 0.5) * self.half;
        let place = part + ((middle - part) / self.period).round() * self.period;
        let sigma = self.period / std::f64::consts::TAU * self.options.noise * (2.0 / n).sqrt() / amplitude;
        ((place - middle).abs() <= AGREED * self.half).then_some((place - 0.5 - self.offset, sigma))
    }
}

#[cfg(test)]
mod tests {
    use super::super::gray::{DecodeOptions, decode};
    use super::super::scene::{Scene, wall};
    use super::*;

    /// Share of the pixels with a coordinate, root mean square error, worst error outside the step.
    fn judge(scene: &Scene, code: &StripeCode, spoil: impl Fn(&mut Vec<Vec<u8>>)) -> [f64; 3] {
        let mut pictures = scene.pictures(code);
        spoil(&mut pictures);
        let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
        let decoded = decode(code, &views, &Axis::BOTH, &DecodeOptions::default()).unwrap();
        let found = coordinates(code, &views, &decoded, &PhaseOptions::default()).unwrap();
        let errors: Vec<f64> = (0..19_200)
            .filter(|at| found.values[0][*at].is_finite() && !(84..93).contains(&(at % 160)))
            .map(|at| {
                let truth = (scene.projector)((at % 160) as f64, (at / 160) as f64)[0];
                (f64::from(found.values[0][at]) - truth).abs()
            })
            .collect();
        let n = errors.len() as f64;
        let rms = (errors.iter().map(|it| it * it).sum::<f64>() / n).sqrt();
        [n / 19_200.0, rms, errors.iter().copied().fold(0.0, f64::max)]
    }

    #[test]
    fn phase_places_each_pixel_by_itself() {
        for (steps, period) in [(3, 16), (4, 16), (8, 8)] {
            for seed in 1..=3 {
                let code = StripeCode::phase([160, 120], steps, period);
                let [share, rms, worst] = judge(&wall(seed), &code, |_| ());
                // The scene's projector pixels are even squares: its waves are stairs, which stay within half a pixel.
                assert!(share > 0.9 && rms < 0.16 && worst < 0.5, "{steps} steps: {share} {rms} {worst}");
            }
        }
    }

    #[test]
    fn saturated_steps_and_steps_off_the_wave_are_left_out() {
        let code = StripeCode::phase([160, 120], 4, 16);
        let [share, ..] = judge(&Scene { gain: 700.0, ..wall(1) }, &code, |_| ());
        assert!(share < 0.3, "{share}");
        let moved = |pictures: &mut Vec<Vec<u8>>| {
            let step = code.place(Shown::Phase { axis: Axis::Columns, step: 2 }).unwrap();
            pictures[step].rotate_right(6);
        };
        let [share, ..] = judge(&wall(1), &code, moved);
        assert!(share < 0.35, "{share}");
    }
}
