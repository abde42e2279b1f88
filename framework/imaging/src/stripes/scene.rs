//! Pictures of a scene for tests, by another model than that of what is tested: light is integrated over each camera pixel on a surface with
//! texture, the projector has a gamma and is out of focus, the camera has noise and eight bits.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use foveate_estimation::random::Random;

use super::code::{Shown, StripeCode};
use super::pattern::picture;

/// What the camera looks at.
#[derive(Debug, Clone)]
pub(super) struct Scene {
    pub size: [usize; 2],
    /// Projector coordinate of a place in the picture.
    pub projector: fn(f64, f64) -> [f64; 2],
    /// Part of the projector's light that comes back [–].
    pub albedo: fn(f64, f64) -> f64,
    /// Whether the projector's light does not reach a place.
    pub shadow: fn(f64, f64) -> bool,
    /// Light of all of the projector's picture that reaches a place over other surfaces, over its direct light at albedo 1 [–].
    pub global: fn(f64, f64) -> f64,
    /// Of the projector's picture, standard deviation [projector px].
    pub defocus: f64,
    /// The projector's response: light = level^power, both 0 to 1 [–].
    pub power: f64,
    /// Of the camera [gray levels].
    pub noise: f64,
    /// Light of the room and of the projector's black [gray levels].
    pub ambient: f64,
    /// Of the projector's light on white [gray levels].
    pub gain: f64,
    /// Of the camera's picture, standard deviation [px].
    pub blur: f64,
    /// The camera's response: gray = 255 (light / 255)^(1 / gamma) [–].
    pub gamma: f64,
    pub seed: u64,
}

/// A slanted wall with a step in it, a texture, a shadow beside the step.
pub(super) fn wall(seed: u64) -> Scene {
    Scene {
        size: [160, 120],
        projector: |x, y| {
            let step = if x > 90.0 { 17.0 } else { 0.0 };
            [20.0 + 0.61 * x + 0.04 * y + step, 12.0 + 0.58 * y - 0.03 * x]
        },
        albedo: |x, y| 0.35 + 0.3 * ((x / 7.0).sin() * (y / 9.0).cos() + 1.0),
        shadow: |x, _| (86.0..=90.0).contains(&x),
        global: |_, _| 0.03,
        defocus: 0.45,
        power: 1.0,
        noise: 1.0,
        ambient: 14.0,
        gain: 180.0,
        blur: 0.0,
        gamma: 1.0,
        seed,
    }
}

/// The Gray code of most tests, of a small projector.
pub(super) fn wall_code() -> StripeCode {
    StripeCode::gray([160, 120])
}

/// All pictures of [`wall`] for it; they are rendered once for all tests.
pub(super) fn wall_set(seed: u64) -> Vec<Vec<u8>> {
    static SETS: Mutex<BTreeMap<u64, Vec<Vec<u8>>>> = Mutex::new(BTreeMap::new());
    let mut sets = SETS.lock().unwrap_or_else(PoisonError::into_inner);
    sets.entry(seed).or_insert_with(|| wall(seed).pictures(&wall_code())).clone()
}

/// What one of the lines of sight of a pixel meets.
struct Sample {
    albedo: f64,
    global: f64,
    /// The projector's pixel that lights it.
    lit_by: Option<usize>,
}

/// Lines of sight along each side of a pixel.
const SAMPLES: usize = 5;

impl Scene {
    /// All pictures of a set.
    pub(super) fn pictures(&self, code: &StripeCode) -> Vec<Vec<u8>> {
        let (shown, samples) = (code.pictures(), self.samples(code));
        let picture_of = |(at, it): (usize, &Shown)| self.seen(code, &samples, &picture(code, *it, 1.0), at as u64);
        shown.iter().enumerate().map(picture_of).collect()
    }

    /// Picture number `at` of a set alone.
    pub(super) fn picture(&self, code: &StripeCode, at: usize) -> Vec<u8> {
        self.seen(code, &self.samples(code), &picture(code, code.pictures()[at], 1.0), at as u64)
    }

    /// Pixel by pixel.
    fn samples(&self, code: &StripeCode) -> Vec<Sample> {
        let [columns, rows] = code.projector.map(|it| it as usize);
        let [width, height] = self.size;
        let offset = |it: usize| (it as f64 + 0.5) / SAMPLES as f64 - 0.5;
        let places = (0..width * height * SAMPLES * SAMPLES).map(|it| {
            let (pixel, sample) = (it / (SAMPLES * SAMPLES), it % (SAMPLES * SAMPLES));
            let (x, y) = (pixel % width, pixel / width);
            (x as f64 + offset(sample % SAMPLES), y as f64 + offset(sample / SAMPLES))
        });
        let sample = |(x, y): (f64, f64)| {
            let [u, v] = (self.projector)(x, y);
            let (column, row) = ((u + 0.5).floor(), (v + 0.5).floor());
            let inside = column >= 0.0 && row >= 0.0 && column < columns as f64 && row < rows as f64;
            let is_lit = inside && !(self.shadow)(x, y);
            let lit_by = is_lit.then(|| row as usize * columns + column as usize);
            Sample { albedo: (self.albedo)(x, y), global: (self.global)(x, y), lit_by }
        };
        places.map(sample).collect()
    }

    fn seen(&self, code: &StripeCode, samples: &[Sample], shown: &[u8], number: u64) -> Vec<u8> {
        let mut chance = Random::new(self.seed.wrapping_mul(1000) + number);
        let [columns, rows] = code.projector.map(|it| it as usize);
        let blurred = blurred(shown, columns, rows, self.defocus, self.power);
        let mean = shown.iter().map(|it| f64::from(*it)).sum::<f64>() / (255.0 * shown.len() as f64);
        let light = |it: &Sample| {
            let direct = it.lit_by.map_or(0.0, |at| blurred[at]);
            self.ambient * it.albedo + self.gain * it.albedo * (direct + it.global * mean)
        };
        let [width, height] = self.size;
        let n = SAMPLES * SAMPLES;
        let lights: Vec<f64> = samples.chunks(n).map(|it| it.iter().map(light).sum::<f64>() / n as f64).collect();
        let lights = if self.blur > 0.0 {
            smoothed(&lights, width, height, self.blur, (3.0 * self.blur).ceil() as usize)
        } else {
            lights
        };
        let gray = |light: &f64| {
            let gray = 255.0 * (light.min(255.0) / 255.0).powf(1.0 / self.gamma) + self.noise * chance.normal();
            gray.round().clamp(0.0, 255.0) as u8
        };
        lights.iter().map(gray).collect()
    }
}

/// A projector's picture out of focus, 0 to 1; each of its pixels is an even square.
fn blurred(shown: &[u8], columns: usize, rows: usize, sigma: f64, power: f64) -> Vec<f64> {
    let light: Vec<f64> = shown.iter().map(|it| (f64::from(*it) / 255.0).powf(power)).collect();
    smoothed(&light, columns, rows, sigma, 3)
}

/// By a Gaussian that ends `reach` pixels from its middle; beyond the ends it is as at the ends.
fn smoothed(light: &[f64], columns: usize, rows: usize, sigma: f64, reach: usize) -> Vec<f64> {
    let tap = |it: usize| (-0.5 * ((it as f64 - reach as f64) / sigma.max(0.05)).powi(2)).exp();
    let kernel: Vec<f64> = (0..=2 * reach).map(tap).collect();
    let sum: f64 = kernel.iter().sum();
    let along = |from: &[f64], step: usize, n: usize, at: usize, place: usize| -> f64 {
        let tap = |(k, weight): (usize, &f64)| {
            let other = (place + k).saturating_sub(reach).min(n - 1);
            weight / sum * from[at + other * step - place * step]
        };
        kernel.iter().enumerate().map(tap).sum()
    };
    let across: Vec<f64> = (0..light.len()).map(|at| along(light, 1, columns, at, at % columns)).collect();
    (0..light.len()).map(|at| along(&across, columns, rows, at, at / columns)).collect()
}
