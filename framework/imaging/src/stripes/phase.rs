//! Phase shift: the projector coordinate of each camera pixel from sine waves that were shifted in equal steps.
//!
//! Step k of n shows A + B cos(φ − 2π k / n) to a pixel, φ being 2π times its place in periods. The sums of the steps with the sine and cosine of
//! 2π k / n give φ and B; the stripe of the Gray code says which period it is, half a period at a time, so that a stripe that is one off at a boundary does no harm.
//!
//! A projector that nobody measured makes other waves than sines: a power of the light adds harmonics, whose phase is that of the wave, so that one number a harmonic says what the curve is
//! like everywhere. Those up to n / 2 are seen in the steps and taken off; harmonics n − 1 and n + 1 move the phase itself by ε sin(n φ). Where many periods are seen, all phases are as
//! frequent as each other: the mean of cos(n φ) over all pixels is J₁(n ε), which tells ε, and phases are put right by it.
//!
//! A pixel is left out where a step is saturated, where the wave is too weak, where the steps are not on the wave (something moved, or light that came over other
//! surfaces), and where phase and stripe contradict each other.
//!
//! Source: V. Srinivasan, H. Liu, M. Halioua, "Automated phase-measuring profilometry of 3-D diffuse objects", Applied Optics 23(18), 1984. A curve that is told by how
//! often phases come: H. Guo, H. He, M. Chen, "Gamma correction for digital fringe projection profilometry", Applied Optics 43(14), 2004.

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
/// Pixels that tell what the wave is like, at least, and at most.
const LEAST: usize = 500;
const MOST: usize = 200_000;
/// The mean of cos(n φ) says something where it is above this …
const UNEVEN: f64 = 0.01;
/// … and so many times above that of other multiples of φ, which no curve moves: where few periods are seen, phases are not evenly spread.
const CLEARLY: f64 = 3.0;
/// J₁ rises until here [rad].
const TOP_OF_J1: f64 = 1.8;
/// Times the place of a pixel is put right by the wave's own error there.
const ROUNDS: usize = 8;

/// The projector coordinate of each camera pixel by its phase, in the period that its stripe says; and the part of the pixels whose steps are as strong as they should be but
/// not on one wave [–].
///
/// # Errors
/// A code without phase steps, or a set of pictures that is not as `code` says.
pub fn coordinates(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    decoded: &Decoded,
    options: &PhaseOptions,
) -> Result<(Coordinates, f64), ImagingError> {
    code.check()?;
    same_size(code, pictures)?;
    ImagingError::unless(code.steps > 0, "steps", "3 to 32", 0.0)?;
    let n = decoded.size[0] * decoded.size[1];
    let mut found = Coordinates { size: decoded.size, ..Coordinates::default() };
    let (mut strong, mut off) = (0_usize, 0_usize);
    for axis in Axis::BOTH {
        let stripes = &decoded.stripes[axis.index()];
        if stripes.len() != n {
            continue;
        }
        let place = |step: u32| code.place(Shown::Phase { axis, step }).map(|it| pictures[it].pixels());
        let steps: Vec<&[u8]> = (0..code.steps).filter_map(place).collect();
        let wave = Wave::new(code, axis, options).seen(&steps, stripes);
        let (mut values, mut sigmas) = (vec![f32::NAN; n], vec![f32::NAN; n]);
        for (at, stripe) in stripes.iter().enumerate().filter(|it| *it.1 != NONE) {
            let Some(sine) = wave.sine(&steps, at) else { continue };
            strong += 1;
            if !wave.is_on_it(&sine, &steps, at) {
                off += 1;
                continue;
            }
            if let Some((value, sigma)) = wave.place(&sine, *stripe) {
                (values[at], sigmas[at]) = (value as f32, sigma as f32);
            }
        }
        (found.values[axis.index()], found.sigmas[axis.index()]) = (values, sigmas);
    }
    Ok((found, off as f64 / strong.max(1) as f64))
}

/// What the steps of a pixel have of the wave: A + B cos(φ − 2π k / n).
struct Sine {
    mean: f64,
    /// B cos φ, B sin φ.
    cosine: f64,
    sine: f64,
    amplitude: f64,
}

struct Wave<'a> {
    options: &'a PhaseOptions,
    /// Cosine and sine of each step.
    turns: Vec<[f64; 2]>,
    period: f64,
    half: f64,
    first: f64,
    offset: f64,
    /// Of harmonics 2 to n / 2, over the amplitude of the first [–].
    harmonics: Vec<f64>,
    /// Phases are off by this times sin(n φ) [rad].
    error: f64,
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
            harmonics: Vec::new(),
            error: 0.0,
        }
    }

    /// With what the pixels themselves tell of its form.
    fn seen(mut self, steps: &[&[u8]], stripes: &[u16]) -> Wave<'a> {
        let known: Vec<usize> = (0..stripes.len()).filter(|it| stripes[*it] != NONE).collect();
        let some: Vec<(usize, Sine)> = known
            .iter()
            .step_by(known.len().div_ceil(MOST).max(1))
            .filter_map(|at| Some((*at, self.sine(steps, *at)?)))
            .collect();
        if some.len() < LEAST {
            return self;
        }
        let n = self.turns.len();
        for order in 2..=n / 2 {
            let (mut product, mut square) = (0.0, 0.0);
            for (at, sine) in &some {
                for (step, turn) in steps.iter().zip(&self.turns) {
                    let part = sine.along(turn);
                    let form = sine.amplitude * chebyshev(order, part);
                    product += form * (f64::from(step[*at]) - sine.mean - sine.amplitude * part);
                    square += form * form;
                }
            }
            self.harmonics.push(product / square.max(1e-9));
        }
        // Phases of pixels that are on the wave, as often as each other.
        let on: Vec<f64> = some.iter().filter(|it| self.is_on_it(&it.1, steps, it.0)).map(|it| it.1.phase()).collect();
        let mean = |order: usize| {
            let [cosine, sine] = on.iter().fold([0.0; 2], |sum, phase| {
                let (s, c) = (order as f64 * phase).sin_cos();
                [sum[0] + c, sum[1] + s]
            });
            [cosine / on.len().max(1) as f64, sine / on.len().max(1) as f64]
        };
        let [cosine, sine] = mean(n);
        let by_chance = [n - 1, n + 1].into_iter().map(|it| mean(it)[0].hypot(mean(it)[1]));
        let by_chance = by_chance.fold(sine.abs(), f64::max);
        if on.len() >= LEAST && cosine.abs() > UNEVEN.max(CLEARLY * by_chance) {
            self.error = inverse_j1(cosine) / n as f64;
        }
        self
    }

    /// What the steps of pixel `at` have of the wave; `None` where one is saturated, or the wave is too weak.
    fn sine(&self, steps: &[&[u8]], at: usize) -> Option<Sine> {
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
        (amplitude >= self.options.min_amplitude).then_some(Sine { mean, cosine, sine, amplitude })
    }

    fn is_on_it(&self, sine: &Sine, steps: &[&[u8]], at: usize) -> bool {
        let misfit = steps.iter().zip(&self.turns).map(|(step, turn)| {
            let part = sine.along(turn);
            let form: f64 = self.harmonics.iter().zip(2..).map(|(weight, order)| weight * chebyshev(order, part)).sum();
            (f64::from(step[at]) - sine.mean - sine.amplitude * (part + form)).powi(2)
        });
        let misfit = (misfit.sum::<f64>() / steps.len() as f64).sqrt();
        misfit <= (3.0 * self.options.noise).max(self.options.max_misfit * sine.amplitude)
    }

    /// Coordinate and standard deviation of a pixel.
    fn place(&self, sine: &Sine, stripe: u16) -> Option<(f64, f64)> {
        let n = self.turns.len() as f64;
        let seen = sine.phase();
        let right = |phase: f64| seen + self.error * (n * phase).sin();
        let phase = if self.error == 0.0 { seen } else { (0..ROUNDS).fold(seen, |it, _| right(it)) };
        let part = phase / std::f64::consts::TAU * self.period;
        let middle = (f64::from(stripe) + self.first + 0.5) * self.half;
        let place = part + ((middle - part) / self.period).round() * self.period;
        let sigma = self.period / std::f64::consts::TAU * self.options.noise * (2.0 / n).sqrt() / sine.amplitude;
        ((place - middle).abs() <= AGREED * self.half).then_some((place - 0.5 - self.offset, sigma))
    }
}

impl Sine {
    fn phase(&self) -> f64 {
        self.sine.atan2(self.cosine)
    }

    /// cos(φ − 2π k / n) of a step.
    fn along(&self, [c, s]: &[f64; 2]) -> f64 {
        (self.cosine * c + self.sine * s) / self.amplitude
    }
}

/// cos(k x) of cos(x).
fn chebyshev(order: usize, cosine: f64) -> f64 {
    let (mut before, mut this) = (1.0, cosine);
    for _ in 1..order {
        (before, this) = (this, 2.0 * cosine * this - before);
    }
    this
}

/// Where J₁, the Bessel function of the first kind, has this value, before its top.
fn inverse_j1(value: f64) -> f64 {
    let j1 = |x: f64| {
        // Its power series, of which so many terms are exact below 2.
        let half = x / 2.0;
        let mut term = half;
        let mut sum = term;
        for k in 1..12 {
            term *= -half * half / (f64::from(k) * f64::from(k + 1));
            sum += term;
        }
        sum
    };
    let (mut low, mut high) = (0.0, TOP_OF_J1);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        *if j1(middle) < value.abs() { &mut low } else { &mut high } = middle;
    }
    low.copysign(value)
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
        let (found, _) = coordinates(code, &views, &decoded, &PhaseOptions::default()).unwrap();
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
    fn waves_of_a_projector_that_nobody_measured_are_told_by_themselves() {
        for (steps, period) in [(3, 8), (5, 8)] {
            for power in [0.5, 2.2] {
                let code = StripeCode::phase([160, 120], steps, period);
                let [share, rms, worst] = judge(&Scene { power, ..wall(7) }, &code, |_| ());
                assert!(share > 0.85 && rms < 0.2, "{steps} steps, power {power}: {share} {rms} {worst}");
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
