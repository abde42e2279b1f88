//! What is known of each pixel of the background, and the limits that its own pictures imply.

use std::ops::Range;

use super::segmenter::SegmenterConfig;
use crate::foreground::learning::Learning;

/// Channels of a pixel.
pub(super) const CHANNELS: usize = 3;

/// The learnt background. All lists are red, green, blue, pixel by pixel.
#[derive(Debug, Clone)]
pub(super) struct Model {
    pub width: usize,
    pub height: usize,
    pub mean: Vec<f32>,
    pub variance: Vec<f32>,
    /// The least that the variance may be: noise floor and slope.
    least: Vec<f32>,
    /// Of the quick test: the mean, rounded, and by how much a gray level off it counts: `unit` / σ.
    centre: Vec<u8>,
    scale: Vec<u8>,
    unit: f32,
    /// The most that the sum of a pixel's squares may be there.
    most: u16,
    /// Of chromaticity and of brightness [σ].
    pub limits: [f32; 2],
}

/// Pixels that are decided together.
pub(super) const BLOCK: usize = 8;

/// Sixteenths in which the quick test counts standard deviations; fewer where the noise floor is below two gray levels.
const UNIT: f32 = 480.0;

/// Where a pixel begins among the bytes of a block.
const FIRST_CHANNEL: [u16; BLOCK * CHANNELS] = {
    let mut is_first = [0; BLOCK * CHANNELS];
    let mut at = 0;
    while at < BLOCK * CHANNELS {
        is_first[at] = u16::MAX;
        at += CHANNELS;
    }
    is_first
};

/// What the quick test says of one row, kept for its memory.
#[derive(Debug, Clone, Default)]
pub(super) struct Quick {
    /// Of each byte, how far it is off its mean, and two more.
    squares: Vec<u16>,
    /// By block.
    pub doubtful: Vec<bool>,
}

/// Steps of the histograms that limits are taken from [σ].
const STEP: f32 = 1.0 / 64.0;
const STEPS: usize = 64 * 64;
/// From here on a channel is saturated [gray level].
pub(super) const SATURATED: f32 = 254.5;
/// A slope that makes an edge [gray level/px], and so many pixels of them tell something.
const STEEP: f32 = 12.0;
const EDGES: usize = 200;
/// How much more than what its median implies a limit may be: noise of coders has longer tails than a normal distribution.
const MOST: f32 = 2.0;
/// The median of a Rayleigh and of a half-normal distribution [σ].
const MEDIANS: [f32; 2] = [1.177_41, 0.674_49];

impl Model {
    pub fn new(width: usize, height: usize) -> Model {
        let n = width * height * CHANNELS;
        Model {
            width,
            height,
            mean: vec![0.0; n],
            variance: vec![0.0; n],
            least: vec![0.0; n],
            centre: vec![0; n],
            scale: vec![0; n],
            unit: UNIT,
            most: 0,
            limits: [0.0; 2],
        }
    }

    /// From pictures of the background.
    pub fn learn(&mut self, learning: &Learning, config: &SegmenterConfig) {
        learning.finish(config.noise_floor, &mut self.mean, &mut self.variance);
        self.set_least(config);
        let n = learning.samples().len() as f32;
        // The samples lie closer to a mean that is theirs than other pictures will.
        let unseen = if n > 1.0 { ((n + 1.0) / (n - 1.0)).sqrt() } else { 1.0 };
        let mut limits: Vec<[f32; 2]> =
            learning.samples().iter().map(|it| self.limits_of(it, config.detection_rate)).collect();
        for axis in 0..2 {
            limits.sort_by(|a, b| a[axis].total_cmp(&b[axis]));
            self.limits[axis] = limits[limits.len() / 2][axis] * unseen;
        }
        self.hold_limits(config);
    }

    /// From one picture, of which nothing else is known; limits as for Gaussian noise.
    pub fn take(&mut self, pixels: &[u8], config: &SegmenterConfig) {
        for (mean, &pixel) in self.mean.iter_mut().zip(pixels) {
            *mean = pixel.into();
        }
        let start = 2.0 * config.noise_floor * config.noise_floor;
        self.variance.fill(start);
        self.set_least(config);
        self.limits = gaussian(config.detection_rate);
        self.hold_limits(config);
    }

    fn hold_limits(&mut self, config: &SegmenterConfig) {
        let gaussian = gaussian(config.detection_rate);
        // Noise below the floor would make limits of less than the floor's.
        for (limit, gaussian) in self.limits.iter_mut().zip(gaussian) {
            *limit = limit.max(gaussian);
        }
        // σ is no lower than the floor.
        self.unit = UNIT.min(255.0 * config.noise_floor);
        let reach = self.limits[0].min(self.limits[1]);
        // What rounding of means may hide (half a level in each channel), and that of the products.
        let rounding = 3f32.sqrt();
        let most = (reach - 0.5 * rounding / config.noise_floor) * self.unit / 16.0 - rounding;
        // One square that is as large as they become is too much.
        self.most = most.max(0.0).powi(2).min(65_024.0) as u16;
        self.set_quick(0..self.width * self.height);
    }

    /// The part of the variance that the noise floor and a tremble of the camera over the slope of the picture imply.
    fn set_least(&mut self, config: &SegmenterConfig) {
        let (width, height) = (self.width, self.height);
        let (floor, jitter) = (config.noise_floor * config.noise_floor, config.jitter_px * config.jitter_px);
        for y in 0..height {
            let rows = [y.saturating_sub(1), (y + 1).min(height - 1)].map(|it| it * width);
            for x in 0..width {
                let columns = [x.saturating_sub(1), (x + 1).min(width - 1)];
                for channel in 0..CHANNELS {
                    let at = |pixel: usize| self.mean[pixel * CHANNELS + channel];
                    let across = 0.5 * (at(y * width + columns[1]) - at(y * width + columns[0]));
                    let down = 0.5 * (at(rows[1] + x) - at(rows[0] + x));
                    let i = (y * width + x) * CHANNELS + channel;
                    self.least[i] = floor + jitter * (across * across + down * down);
                }
            }
        }
        for (variance, least) in self.variance.iter_mut().zip(&self.least) {
            *variance = variance.max(*least);
        }
    }

    /// How far the edges of a picture of the background, in `gains` of its light, are beside where they are known, where it is `open`: as one standard deviation, by that which 19 of 20 are below [px]. `None` where there are too few.
    pub fn edges_off(&self, pixels: &[u8], gains: [f32; CHANNELS], open: &[u8]) -> Option<f32> {
        let (width, height) = (self.width, self.height);
        let mut off = Vec::new();
        for y in 1..height.saturating_sub(1) {
            for x in 1..width.saturating_sub(1) {
                let i = y * width + x;
                let green = |pixel: usize| self.mean[pixel * CHANNELS + 1];
                let slope = 0.5 * (green(i + 1) - green(i - 1)).hypot(green(i + width) - green(i - width));
                if slope > STEEP && open[i] != 0 {
                    off.push((f32::from(pixels[i * CHANNELS + 1]) / gains[1].max(0.05) - green(i)).abs() / slope);
                }
            }
        }
        if off.len() < EDGES {
            return None;
        }
        let at = off.len() * 19 / 20;
        Some(*off.select_nth_unstable_by(at, f32::total_cmp).1 / 1.96)
    }

    /// Below which distances `rate` of a picture's pixels lie: held within one and [`MOST`] times what their median implies.
    fn limits_of(&self, pixels: &[u8], rate: f32) -> [f32; 2] {
        let mut counts = [vec![0u32; STEPS], vec![0u32; STEPS]];
        for i in 0..self.width * self.height {
            let at = i * CHANNELS;
            let value: [f32; 3] = std::array::from_fn(|c| pixels[at + c].into());
            let mean: [f32; 3] = std::array::from_fn(|c| self.mean[at + c]);
            let weight: [f32; 3] = std::array::from_fn(|c| 1.0 / self.variance[at + c]);
            let (alpha, square, chroma) = distances(value, mean, weight);
            let bright = (alpha - 1.0).abs() * square.sqrt();
            for (counts, distance) in counts.iter_mut().zip([chroma.sqrt(), bright]) {
                counts[((distance / STEP) as usize).min(STEPS - 1)] += 1;
            }
        }
        let gaussian = gaussian(rate);
        std::array::from_fn(|axis| {
            let quantile = |rate: f32| {
                let n = (rate * (self.width * self.height) as f32).ceil().max(1.0) as u32;
                let mut below = 0;
                let at = counts[axis].iter().position(|it| {
                    below += it;
                    below >= n
                });
                (at.unwrap_or(STEPS - 1) + 1) as f32 * STEP
            };
            let implied = quantile(0.5) / MEDIANS[axis] * gaussian[axis];
            quantile(rate).clamp(implied, MOST * implied)
        })
    }

    /// What the quick test knows of some pixels.
    pub fn set_quick(&mut self, pixels: Range<usize>) {
        let bytes = pixels.start * CHANNELS..pixels.end * CHANNELS;
        let known = self.mean[bytes.clone()].iter().zip(&self.variance[bytes.clone()]);
        let quick = self.centre[bytes.clone()].iter_mut().zip(&mut self.scale[bytes]);
        for ((mean, variance), (centre, scale)) in known.zip(quick) {
            *centre = (mean + 0.5) as u8;
            // Rounded up; `as` takes no number above 255.
            *scale = (self.unit / variance.sqrt() + 0.999) as u8;
        }
    }

    /// The quick test of one row in the learnt light: of each block of [`BLOCK`] pixels, whether one of them may be no background. What it lets pass lies within a ball that both limits hold.
    pub fn examine(&self, row: &[u8], y: usize, quick: &mut Quick) {
        let bytes = y * self.width * CHANNELS..(y + 1) * self.width * CHANNELS;
        quick.squares.resize(self.width.next_multiple_of(BLOCK) * CHANNELS + 2, 0);
        let known = self.centre[bytes.clone()].iter().zip(&self.scale[bytes]);
        for ((square, value), (centre, scale)) in quick.squares.iter_mut().zip(row).zip(known) {
            let off = ((u16::from(value.abs_diff(*centre)) * u16::from(*scale)) >> 4).min(255);
            *square = off * off;
        }
        quick.doubtful.clear();
        for first in (0..self.width * CHANNELS).step_by(BLOCK * CHANNELS) {
            let Some(block) = quick.squares[first..].first_chunk::<{ BLOCK * CHANNELS + 2 }>() else { break };
            let mut above = 0;
            for (i, is_first) in FIRST_CHANNEL.iter().enumerate() {
                let sum = block[i].saturating_add(block[i + 1]).saturating_add(block[i + 2]);
                above |= sum.saturating_sub(self.most) & is_first;
            }
            quick.doubtful.push(above != 0);
        }
    }

    /// Mean and variance of `pixels` move by `shares` (0 to 1) towards `values`, which are in the learnt light; both byte by byte. A saturated channel teaches that it is so.
    pub fn follow(&mut self, pixels: Range<usize>, values: &[f32], shares: &[f32]) {
        let bytes = pixels.start * CHANNELS..pixels.end * CHANNELS;
        let known = self.mean[bytes.clone()].iter_mut().zip(&mut self.variance[bytes.clone()]);
        let seen = values.iter().zip(shares).zip(&self.least[bytes]);
        for ((mean, variance), ((value, share), least)) in known.zip(seen) {
            let off = value - *mean;
            *mean += share * off;
            *variance = (*variance + share * (off * off - *variance)).max(*least);
        }
    }

    /// Another thing has become background.
    pub fn replace(&mut self, i: usize, value: f32) {
        self.mean[i] = value;
        self.variance[i] = (2.0 * self.variance[i]).max(2.0 * self.least[i]);
    }
}

/// The limits of Gaussian noise below which `rate` of it lies: of two degrees of freedom, of one [σ].
fn gaussian(rate: f32) -> [f32; 2] {
    let beyond = 1.0 - f64::from(rate);
    let chroma = (-2.0 * beyond.ln()).sqrt();
    // Of one degree of freedom there is no closed form: by halving.
    let (mut low, mut high) = (0.0f64, 10.0f64);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if two_sided(middle) > beyond { low = middle } else { high = middle }
    }
    [chroma as f32, low as f32]
}

/// How much of a normal distribution lies beyond ±x σ, erfc(x/√2), to 2e-7: M. Abramowitz, I. Stegun, *Handbook of Mathematical Functions*, 1964, 7.1.26.
fn two_sided(x: f64) -> f64 {
    let z = x / 2f64.sqrt();
    let t = 1.0 / (1.0 + 0.327_591_1 * z);
    let series =
        t * (0.254_829_592 + t * (-0.284_496_736 + t * (1.421_413_741 + t * (-1.453_152_027 + t * 1.061_405_429))));
    series * (-z * z).exp()
}

/// α, Σ E²/σ² and the squared chromatic distance of a pixel; `weight` is 1/σ².
#[inline(always)]
pub(super) fn distances(value: [f32; 3], mean: [f32; 3], weight: [f32; 3]) -> (f32, f32, f32) {
    // Of all channels, and of those that are not saturated.
    let (mut product, mut square, mut honest_product, mut honest_square) = (0.0, 0.0, 0.0, 0.0);
    for c in 0..3 {
        let (p, s) = (value[c] * mean[c] * weight[c], mean[c] * mean[c] * weight[c]);
        let is_honest = if value[c] < SATURATED { 1.0 } else { 0.0 };
        product += p;
        square += s;
        honest_product += is_honest * p;
        honest_square += is_honest * s;
    }
    // A black pixel has no chromaticity: all of its distance counts.
    let square = if square > 1e-6 { square } else { 1e-6 };
    let by_honest = honest_product / if honest_square > 1e-6 { honest_square } else { 1e-6 };
    // Those that are not tell the light, if in it the others would be saturated.
    let mut fits = if honest_square > 1e-6 { 1.0 } else { 0.0 };
    for c in 0..3 {
        fits *= if value[c] < SATURATED || by_honest * mean[c] >= SATURATED { 1.0 } else { 0.0 };
    }
    let alpha = if fits > 0.5 { by_honest } else { product / square };
    let mut chroma = 0.0;
    for c in 0..3 {
        let off = value[c] - alpha * mean[c];
        // A saturated channel may be brighter than it says.
        let off = if value[c] >= SATURATED && off < 0.0 { 0.0 } else { off };
        chroma += off * off * weight[c];
    }
    (alpha, square, chroma)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaussian_limits_are_those_of_tables() {
        let [chroma, bright] = gaussian(0.999);
        assert!((chroma - 3.7169).abs() < 1e-3 && (bright - 3.2905).abs() < 2e-3, "{chroma} {bright}");
        let [chroma, bright] = gaussian(0.95);
        assert!((chroma - 2.4477).abs() < 1e-3 && (bright - 1.9600).abs() < 1e-3, "{chroma} {bright}");
    }

    #[test]
    fn quick_test_lets_nothing_pass_that_is_beyond_a_limit_and_nearly_all_noise() {
        use foveate_estimation::random::Random;
        for (seed, noise_floor) in [(1, 0.4), (2, 2.0), (3, 6.0)] {
            let mut random = Random::new(seed);
            let config = SegmenterConfig { noise_floor, jitter_px: 0.0, ..SegmenterConfig::default() };
            let (width, height) = (BLOCK, 4000);
            let picture: Vec<u8> =
                (0..width * height * CHANNELS).map(|_| random.uniform_in(20.0, 235.0) as u8).collect();
            let mut model = Model::new(width, height);
            model.take(&picture, &config);
            let n = width * height * CHANNELS;
            for i in 0..n {
                model.mean[i] += random.uniform_in(-0.5, 0.5) as f32;
                model.variance[i] *= random.uniform_in(0.5, 4.0) as f32;
            }
            model.set_quick(0..width * height);
            let (mut quick, mut n_passed) = (Quick::default(), 0);
            for y in 0..height {
                let at = y * width * CHANNELS;
                let scale = if y % 2 == 0 { 0.7 } else { random.uniform_in(0.7, 4.0) };
                let value = |i: usize, noise: f64| (f64::from(model.mean[i]) + noise).round().clamp(0.0, 254.0) as u8;
                let row: Vec<u8> = (at..at + width * CHANNELS)
                    .map(|i| value(i, scale * f64::from(model.variance[i].sqrt()) * random.normal()))
                    .collect();
                model.examine(&row, y, &mut quick);
                assert_eq!(quick.doubtful.len(), 1);
                if quick.doubtful[0] {
                    continue;
                }
                n_passed += usize::from(y % 2 == 0);
                for x in 0..width {
                    let of = |list: &[f32]| -> [f32; 3] { std::array::from_fn(|c| list[at + x * CHANNELS + c]) };
                    let value = std::array::from_fn(|c| f32::from(row[x * CHANNELS + c]));
                    let (alpha, square, chroma) =
                        distances(value, of(&model.mean), of(&model.variance).map(f32::recip));
                    assert!(chroma.sqrt() <= model.limits[0], "{chroma}");
                    assert!((alpha - 1.0).abs() * square.sqrt() <= model.limits[1], "{alpha}");
                }
            }
            // Of noise as it is expected, where gray levels are fine beside it.
            assert!(noise_floor < 1.0 || n_passed > height / 2 * 9 / 10, "{noise_floor}: {n_passed}");
        }
    }

    #[test]
    fn a_shadow_changes_alpha_and_a_colour_chroma() {
        let (mean, weight) = ([100.0, 50.0, 20.0], [0.25; 3]);
        let (alpha, _, chroma) = distances([60.0, 30.0, 12.0], mean, weight);
        assert!((alpha - 0.6).abs() < 1e-6 && chroma < 1e-6, "{alpha} {chroma}");
        // Along a direction square to the mean nothing changes α.
        let (alpha, _, chroma) = distances([100.0 - 10.0, 50.0 + 20.0, 20.0], mean, weight);
        assert!((alpha - 1.0).abs() < 1e-6 && (chroma - 500.0 * 0.25).abs() < 1e-3, "{alpha} {chroma}");
        // A highlight that saturates red: it would be 300.
        let (_, _, chroma) = distances([255.0, 150.0, 60.0], mean, weight);
        let (_, _, honest) = distances([250.0, 150.0, 60.0], mean, weight);
        assert!(chroma < 0.1 * honest, "{chroma} {honest}");
    }
}
