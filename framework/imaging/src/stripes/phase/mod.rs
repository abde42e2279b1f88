//! Phase shift: the projector coordinate of each camera pixel from sine waves that were shifted in equal steps.
//!
//! Step k of n shows A + B cos(φ − 2π k / n) to a pixel, φ being 2π times its place in periods. The sums of the steps with the sine and cosine of
//! 2π k / n give φ and B; the stripe of the Gray code says which period it is, half a period at a time, so that a stripe that is one off at a boundary does no harm.
//!
//! An uncalibrated projector does not show exact sine waves: a power of the light adds harmonics, whose phase is that of the wave, so that one number a harmonic says what the curve is
//! like everywhere. Those up to n / 2 are seen in the steps and taken off; harmonics n − 1 and n + 1 move the phase itself by ε sin(n φ). Where many periods are seen, all phases are as
//! frequent as each other: the mean of cos(n φ) over all pixels is J₁(n ε), which tells ε, and phases are put right by it.
//!
//! A pixel is left out where a step is saturated, where the wave is too weak, where the steps are not on the wave (something moved, or light that came over other
//! surfaces), and where phase and stripe contradict each other. Two surfaces that one pixel sees make a wave again, of a phase between theirs: a pixel is left out too where light ends beside it,
//! and where neighbours on no side go on in it.
//!
//! Source: V. Srinivasan, H. Liu, M. Halioua, "Automated phase-measuring profilometry of 3-D diffuse objects", Applied Optics 23(18), 1984. Response curve from the
//! distribution of phases: H. Guo, H. He, M. Chen, "Gamma correction for digital fringe projection profilometry", Applied Optics 43(14), 2004.

use nalgebra::{Matrix2, Vector2};

use super::code::{Axis, Shown, StripeCode};
use super::edges::{Coordinates, defocus};
use super::gray::{Decoded, NONE, same_size};
use super::wave_steps::{covariance, exchanged};
use crate::{ImageView, ImagingError};

/// Thresholds that a pixel must pass to have a phase.
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
pub(super) const SATURATED: u8 = 254;
/// How far phase and stripe may be apart, of the most that they can be before a period would be wrong [–].
const AGREED: f64 = 0.9;
/// Pixels that tell what the wave is like, at least, and at most.
pub(super) const LEAST: usize = 500;
pub(super) const MOST: usize = 200_000;
/// The mean of cos(n φ) says something where it is above this …
const UNEVEN: f64 = 0.01;
/// … and so many times above that of other multiples of φ, which no curve moves: where few periods are seen, phases are not evenly spread.
const CLEARLY: f64 = 3.0;
/// The mean of phases about the middles of their stripes is 0.64 long, and near 0 where steps stand in no way that stripes agree on.
const AGREEING: f64 = 0.45;
/// Where the first step stands is found to within this part of a period [–].
const NEAR_USUAL: f64 = 0.035;
/// Places on both sides of the end of a stripe are nearer than so many stripes, in the median: of steps that run the other way two apart [–].
const NO_JUMP: f64 = 1.0;
/// Ends of stripes that are looked at, at most, and at least where something else than what is stated shall be believed.
const ENDS: usize = 20_000;
const LEAST_ENDS: usize = 200;
/// Steps begin elsewhere than is stated where ends of stripes are off by more than this [px] and so many standard deviations: other programs count pixels from their middles, which is half a pixel.
const LEAST_OFF: f64 = 0.15;
const CERTAIN: f64 = 6.0;
/// J₁ rises until here [rad].
const TOP_OF_J1: f64 = 1.8;
/// Times the place of a pixel is put right by the wave's own error there.
const ROUNDS: usize = 8;

/// How the phase steps of an axis relate to its Gray code.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Steps {
    /// As [`Shown::Phase`] says.
    #[default]
    AsStated,
    /// With another direction or start, on which all stripes agree: coordinates are corrected for it.
    Otherwise {
        /// Whether each step is behind the one before rather than ahead.
        is_reversed: bool,
        /// By so much of a period the first one is ahead [–].
        ahead: f64,
    },
    /// Stripes agree on no direction and start: there are no coordinates.
    NoWay,
}

/// Beside a pixel light ends where white − black is less than this part of its own [–].
const NO_LIGHT: f64 = 0.25;
/// Neighbours go on in a pixel that is no farther from the line through them than this, times their slope where it is above 1 [projector px], and this many standard deviations.
const GOES_ON: f64 = 0.3;
const SIGMAS: f64 = 3.0;

/// Projector coordinates from phases, and how well the phase steps fit.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Phases {
    /// The projector coordinate of each camera pixel.
    pub coordinates: Coordinates,
    /// By axis.
    pub steps: [Steps; 2],
    /// By axis: two steps that are exchanged, and were taken the other way about.
    pub exchanged: [Option<[u32; 2]>; 2],
    /// Part of the pixels whose steps are as strong as they should be but not on one wave [–].
    pub off_wave: f64,
}

/// The projector coordinate of each camera pixel by its phase, in the period that its stripe says. `worked_out` are steps that were reconstructed from the others and add no information.
///
/// # Errors
/// A code without phase steps, or a set of pictures that is not as `code` says.
pub fn coordinates(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    decoded: &Decoded,
    worked_out: &[Shown],
    options: &PhaseOptions,
) -> Result<Phases, ImagingError> {
    code.check()?;
    same_size(code, pictures)?;
    ImagingError::unless(code.steps > 0, "steps", "3 to 32", 0.0)?;
    let n = decoded.size[0] * decoded.size[1];
    let mut found = Coordinates { size: decoded.size, ..Coordinates::default() };
    let (mut ways, mut exchanged) = ([Steps::AsStated; 2], [None; 2]);
    let (mut strong, mut off) = (0_usize, 0_usize);
    for axis in Axis::BOTH {
        let stripes = &decoded.stripes[axis.index()];
        if stripes.len() != n {
            continue;
        }
        let place = |step: u32| code.place(Shown::Phase { axis, step }).map(|it| pictures[it].pixels());
        let steps: Vec<&[u8]> = (0..code.steps).filter_map(place).collect();
        let seen = |steps: &[&[u8]], is_in_order: bool| {
            let wave = Wave { begins_anywhere: is_in_order, ..Wave::new(code, axis, worked_out, options) };
            wave.seen(steps, stripes, decoded.size[0])
        };
        let Ordered { wave, steps, exchanged: pair } = in_order(steps, stripes, seen);
        (ways[axis.index()], exchanged[axis.index()]) = (wave.steps, pair);
        let (mut values, mut sigmas) = (vec![f32::NAN; n], vec![f32::NAN; n]);
        for (at, stripe) in stripes.iter().enumerate().filter(|it| *it.1 != NONE) {
            let Some(sine) = wave.sine(&steps, at) else { continue };
            strong += 1;
            if !wave.is_on_it(&sine, &steps, at) {
                off += 1;
                continue;
            }
            if wave.steps == Steps::NoWay {
                continue;
            }
            if let Some((value, sigma)) = wave.place(&sine, *stripe) {
                (values[at], sigmas[at]) = (value as f32, sigma as f32);
            }
        }
        for at in mixed(&values, &sigmas, decoded) {
            (values[at], sigmas[at]) = (f32::NAN, f32::NAN);
        }
        let defocus = defocus(code, pictures, decoded, axis, options.noise)?;
        found.blur = found.blur.max(defocus.sigma);
        defocus.settle(&mut values, &mut sigmas, &decoded.contrast, decoded.size, true);
        (found.values[axis.index()], found.sigmas[axis.index()]) = (values, sigmas);
    }
    Ok(Phases { coordinates: found, steps: ways, exchanged, off_wave: off as f64 / strong.max(1) as f64 })
}

/// Steps in the order in which they are a wave.
struct Ordered<'a, 's> {
    /// What they have of it.
    wave: Wave<'a>,
    steps: Vec<&'s [u8]>,
    /// Which two were exchanged.
    exchanged: Option<[u32; 2]>,
}

fn in_order<'a, 's>(
    steps: Vec<&'s [u8]>,
    stripes: &[u16],
    seen: impl Fn(&[&'s [u8]], bool) -> Wave<'a>,
) -> Ordered<'a, 's> {
    let mut found: Option<Ordered<'a, 's>> = None;
    for pair in exchanged(&steps, stripes) {
        let mut steps = steps.clone();
        steps.swap(pair[0], pair[1]);
        let wave = seen(&steps, false);
        // Of four steps two ways make a wave: the one that is as stated is meant.
        let is_stated = wave.steps == Steps::AsStated;
        if is_stated || wave.steps != Steps::NoWay && found.is_none() {
            found = Some(Ordered { wave, steps, exchanged: Some(pair.map(|it| it as u32)) });
        }
        if is_stated {
            break;
        }
    }
    found.unwrap_or_else(|| Ordered { wave: seen(&steps, true), steps, exchanged: None })
}

/// Pixels that may see two surfaces, or the end of the light.
fn mixed(values: &[f32], sigmas: &[f32], decoded: &Decoded) -> Vec<usize> {
    let [width, height] = decoded.size;
    let known = |at: usize| Some((f64::from(values[at]), f64::from(sigmas[at]))).filter(|it| it.0.is_finite());
    let is_mixed = |at: usize, (value, sigma): (f64, f64)| {
        let contrast = f64::from(decoded.contrast[at]);
        [(at % width, width, 1), (at / width, height, width)].into_iter().any(|(place, n, by)| {
            let mut goes_on = [false; 2];
            for is_ahead in [false, true] {
                let left = if is_ahead { n - 1 - place } else { place };
                let beside = |times: usize| if is_ahead { at + times * by } else { at - times * by };
                if left > 0 && f64::from(decoded.contrast[beside(1)]) < NO_LIGHT * contrast {
                    return true;
                }
                let two = if left > 1 { known(beside(1)).zip(known(beside(2))) } else { None };
                let Some(((near, of_near), (far, of_far))) = two else { continue };
                let most = GOES_ON * (near - far).abs().max(1.0) + SIGMAS * sigma.hypot(2.0 * of_near).hypot(of_far);
                goes_on[usize::from((2.0 * near - far - value).abs() <= most)] = true;
            }
            goes_on == [true, false]
        })
    };
    (0..values.len()).filter(|at| known(*at).is_some_and(|it| is_mixed(*at, it))).collect()
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
    /// Of cosine and sine of a pixel's wave, for noise of variance 1 [–].
    covariance: Matrix2<f64>,
    period: f64,
    half: f64,
    first: f64,
    offset: f64,
    /// Of harmonics 2 to n / 2, over the amplitude of the first [–].
    harmonics: Vec<f64>,
    /// Phases are off by this times sin(n φ) [rad].
    error: f64,
    steps: Steps,
    /// Whether it may begin at any place, and not where waves do as a rule alone: steps that are exchanged would seem to.
    begins_anywhere: bool,
}

impl<'a> Wave<'a> {
    fn new(code: &StripeCode, axis: Axis, worked_out: &[Shown], options: &'a PhaseOptions) -> Wave<'a> {
        let taken = |it: &u32| !worked_out.contains(&Shown::Phase { axis, step: *it });
        let there: Vec<usize> = (0..code.steps).filter(taken).map(|it| it as usize).collect();
        let turn = |step: u32| std::f64::consts::TAU * f64::from(step) / f64::from(code.steps);
        let (offset, stripe) = (code.offset[axis.index()], code.stripe[axis.index()]);
        Wave {
            options,
            covariance: covariance(&there, code.steps as usize)
                .unwrap_or_else(|| Matrix2::identity() * (2.0 / f64::from(code.steps))),
            turns: (0..code.steps).map(|it| [turn(it).cos(), turn(it).sin()]).collect(),
            period: f64::from(code.period),
            half: f64::from(stripe),
            first: f64::from(offset / stripe),
            offset: f64::from(offset),
            harmonics: Vec::new(),
            error: 0.0,
            steps: Steps::AsStated,
            begins_anywhere: false,
        }
    }

    /// With what the pixels themselves tell of its form.
    fn seen(mut self, steps: &[&[u8]], stripes: &[u16], width: usize) -> Wave<'a> {
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
        let is_on = |it: &&(usize, Sine)| self.is_on_it(&it.1, steps, it.0);
        let on_it: Vec<(u16, f64)> = some.iter().filter(is_on).map(|it| (stripes[it.0], it.1.phase())).collect();
        // Phases of pixels that are on the wave, as often as each other.
        let on: Vec<f64> = on_it.iter().map(|it| it.1).collect();
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
        if on.len() >= LEAST {
            let pixel = |at: usize| Some((*stripes.get(at)?, self.sine(steps, at)?.phase()));
            let is_end = |a: usize, b: usize| {
                stripes.get(b).is_some_and(|it| *it != NONE && stripes[a] != NONE && stripes[a].abs_diff(*it) == 1)
            };
            let all = known.iter().flat_map(|at| [1, width].map(|by| (*at, at + by))).filter(|it| is_end(it.0, it.1));
            let all: Vec<(usize, usize)> = all.collect();
            let some = all.iter().step_by(all.len().div_ceil(ENDS).max(1));
            let ends: Vec<_> = some.filter_map(|(a, b)| Some([pixel(*a)?, pixel(*b)?])).collect();
            self.steps = self.steps_by(&on_it, &ends);
        }
        self
    }

    /// How phases stand to the middles of their stripes: these are half a period wide, so that phases are all within a quarter of a period around them, and the mean of both as unit vectors is
    /// 2 / π long, whichever way steps run. Of the two ways, the right one goes on where one stripe ends and the next begins; the other one jumps there by a period.
    fn steps_by(&self, seen: &[(u16, f64)], ends: &[[(u16, f64); 2]]) -> Steps {
        let ways = [false, true].map(|is_reversed| {
            let sign = if is_reversed { -1.0 } else { 1.0 };
            let [cosine, sine] = seen.iter().fold([0.0; 2], |sum, (stripe, phase)| {
                let middle = self.middle(*stripe) / self.period * std::f64::consts::TAU;
                let (s, c) = (middle - sign * self.right(*phase)).sin_cos();
                [sum[0] + c, sum[1] + s]
            });
            let length = cosine.hypot(sine) / seen.len() as f64;
            let ahead = sine.atan2(cosine) / std::f64::consts::TAU;
            let nearest = self.usual(ahead);
            let is_usual = (nearest - ahead).abs() <= NEAR_USUAL;
            let anywhere = self.begins_anywhere && !is_reversed;
            let begin = if anywhere && !is_usual { ahead } else { nearest };
            let way = match !is_reversed && begin.rem_euclid(1.0) == 0.0 {
                true => Steps::AsStated,
                false => Steps::Otherwise { is_reversed, ahead: begin },
            };
            // What is stated is believed of few periods too, over which phases are not evenly spread.
            let is_known = match way {
                Steps::AsStated => true,
                _ => length >= AGREEING && (is_usual || anywhere) && ends.len() >= LEAST_ENDS,
            };
            let way = match self.off(way, ends) {
                Some(off) if is_known => Steps::Otherwise { is_reversed, ahead: begin - off / self.period },
                _ => way,
            };
            let mut jumps: Vec<f64> =
                ends.iter().map(|it| (self.at(way, it[0]) - self.at(way, it[1])).abs() / self.half).collect();
            jumps.sort_by(f64::total_cmp);
            let jump = jumps.get(jumps.len() / 2).copied().unwrap_or(0.0);
            if is_known && jump < NO_JUMP { way } else { Steps::NoWay }
        });
        ways.into_iter().find(|it| *it != Steps::NoWay).unwrap_or(Steps::NoWay)
    }

    /// The nearest place at which waves begin as a rule: where a cosine, a sine or one of the steps does, in periods.
    fn usual(&self, ahead: f64) -> f64 {
        let usual = [4.0, self.turns.len() as f64].map(|it| (ahead * it).round() / it);
        if (usual[0] - ahead).abs() <= (usual[1] - ahead).abs() { usual[0] } else { usual[1] }
    }

    /// How far places are off where one stripe ends and the next begins [px]: two neighbours lie on both sides of it, so that their mean is there in the mean. `None` where that is little, or not certain.
    ///
    /// A camera that is not linear moves the ends of bright stripes outwards, to both sides in turn: ends before and behind stripes of an even number count alike.
    fn off(&self, way: Steps, ends: &[[(u16, f64); 2]]) -> Option<f64> {
        let mut of_kind: [Vec<f64>; 2] = Default::default();
        for [a, b] in ends {
            let end = self.middle(a.0.max(b.0)) - 0.5 * self.half;
            of_kind[usize::from(a.0.max(b.0) % 2)].push(0.5 * (self.at(way, *a) + self.at(way, *b)) - end);
        }
        let (mut off, mut variance) = (0.0, 0.0);
        for list in &mut of_kind {
            if list.len() < LEAST_ENDS / 2 {
                return None;
            }
            list.sort_by(f64::total_cmp);
            let at = |share: f64| list[(share * (list.len() - 1) as f64) as usize];
            // Of a median, by quartiles: 1.25 of a mean's.
            let sigma = 1.25 * (at(0.75) - at(0.25)) / 1.35 / (list.len() as f64).sqrt();
            off += 0.5 * at(0.5);
            variance += 0.25 * sigma * sigma;
        }
        (off.abs() > LEAST_OFF.max(CERTAIN * variance.sqrt())).then_some(off)
    }

    /// Where a pixel of a stripe and a phase is, from the code's beginning [px].
    fn at(&self, way: Steps, (stripe, phase): (u16, f64)) -> f64 {
        let phase = self.right(phase) / std::f64::consts::TAU;
        let turns = match way {
            Steps::Otherwise { is_reversed: true, ahead } => ahead - phase,
            Steps::Otherwise { is_reversed: false, ahead } => ahead + phase,
            Steps::AsStated | Steps::NoWay => phase,
        };
        let part = turns * self.period;
        part + ((self.middle(stripe) - part) / self.period).round() * self.period
    }

    /// Where the middle of a stripe is, from the code's beginning [px].
    fn middle(&self, stripe: u16) -> f64 {
        (f64::from(stripe) + self.first + 0.5) * self.half
    }

    /// A phase as it would be without what the wave's form does to it.
    fn right(&self, seen: f64) -> f64 {
        let n = self.turns.len() as f64;
        let rounds = if self.error == 0.0 { 0 } else { ROUNDS };
        (0..rounds).fold(seen, |it, _| seen + self.error * (n * it).sin())
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
        let place = self.at(self.steps, (stripe, sine.phase()));
        let middle = self.middle(stripe);
        // dφ = (cos φ d sine − sin φ d cosine) / amplitude.
        let across = Vector2::new(-sine.sine, sine.cosine) / sine.amplitude;
        let noise = self.options.noise * across.dot(&(self.covariance * across)).sqrt();
        let sigma = self.period / std::f64::consts::TAU * noise / sine.amplitude;
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
mod tests;
