//! Background subtraction in gray pictures of natural scenes [Davis 2002 §3.3, last paragraph].
//!
//! Each pixel has a mean m and a variance v. With the picture's gain g, d = I − min(g m, 255); the pixel is foreground
//! when d² > k² v, and *surely* so when d² exceeds a second, higher bound. Background pixels teach: m += d / (g n) and
//! v += (d² − v) / n, n being `adapt_frames`. The state of a pixel is that of C. R. Wren et al., "Pfinder", TPAMI 19(7), 1997. What
//! is added:
//!
//! - *Light.* g is the picture's brightness over the learnt one, from the median of the ratios of some 4,000 pixels: an
//!   exposure that changes, or a lamp that is switched, moves all pixels alike and is no foreground. m stays in the light
//!   in which it was learnt. A picture without a common ratio keeps the last g.
//! - *Shadows* [Mikić 2001, after T. Horprasert et al. 1999]: a shadow takes the same part of the light from neighbours,
//!   whatever their texture. A foreground pixel that is darker, by no more than `shadow_ratio`, and whose 3 × 3
//!   neighbourhood has one ratio, is taken for shadow. A uniform thing before a uniform wall that is darker by as little
//!   looks the same to a gray camera, and is lost.
//! - *Stationary foreground.* Nothing is learnt from foreground. A pixel that has been foreground with the same value for
//!   `absorb_frames` pictures in a row is learnt again: that is how a chair that was moved becomes background.
//! - *Learning.* The start is a robust mean over samples of `learn_frames` pictures (`learning`), so that a person who
//!   passes leaves no trace, or a picture of the empty room.
//! - *Specks.* A pixel changes sides when the majority of its 3 × 3 neighbourhood is on the other one.

pub(crate) mod learning;
pub(crate) mod light;
pub(crate) mod majority;

use learning::Learning;
use light::Light;

use crate::{ImageView, ImagingError, Verdict};

/// Settings of [`Foreground`].
#[derive(Debug, Clone, PartialEq)]
pub struct ForegroundConfig {
    /// Pictures that the background is learnt from, at least 1.
    pub learn_frames: u32,
    /// A pixel is foreground when further from its mean than this many standard deviations, above 0.
    pub threshold_sigma: f32,
    /// It is surely foreground from here on, at least `threshold_sigma`.
    pub sure_sigma: f32,
    /// No standard deviation is taken to be lower than this [gray level], above 0.
    pub noise_floor: f32,
    /// Pictures in which mean and variance of a background pixel follow a change by 63 %, at least 1.
    pub adapt_frames: f32,
    /// Pictures after which a foreground pixel that keeps its value is background; 0: never.
    pub absorb_frames: u32,
    /// The part of the light that a shadow leaves, at least, 0..=1; 1: shadows are foreground.
    pub shadow_ratio: f32,
    /// A picture with a larger part of its unmasked pixels in the foreground is not to be trusted, 0..=1;
    /// `learn_frames` of them in a row, and the background is learnt again.
    pub relearn_fraction: f64,
}

impl Default for ForegroundConfig {
    /// 30 pictures to learn from, 4 and 8 σ, a floor of 2 gray levels, 200 pictures to adapt, 900 to absorb, shadows that
    /// leave 60 % of the light, learnt again when more than half of the picture is foreground.
    fn default() -> Self {
        Self {
            learn_frames: 30,
            threshold_sigma: 4.0,
            sure_sigma: 8.0,
            noise_floor: 2.0,
            adapt_frames: 200.0,
            absorb_frames: 900,
            shadow_ratio: 0.6,
            relearn_fraction: 0.5,
        }
    }
}

impl ForegroundConfig {
    /// [`ImagingError::Setting`] that names the first setting out of its range.
    pub fn check(&self) -> Result<(), ImagingError> {
        let unless = |good, name, expected, found: f32| ImagingError::unless(good, name, expected, found.into());
        ImagingError::unless(self.learn_frames >= 1, "learn_frames", "at least 1", self.learn_frames.into())?;
        let finite = |it: f32| it > 0.0 && it.is_finite();
        unless(finite(self.threshold_sigma), "threshold_sigma", "above 0", self.threshold_sigma)?;
        let sure = self.sure_sigma >= self.threshold_sigma;
        unless(sure, "sure_sigma", "at least threshold_sigma", self.sure_sigma)?;
        unless(finite(self.noise_floor), "noise_floor", "above 0 gray levels", self.noise_floor)?;
        unless(self.adapt_frames >= 1.0, "adapt_frames", "at least 1", self.adapt_frames)?;
        unless((0.0..=1.0).contains(&self.shadow_ratio), "shadow_ratio", "0 to 1", self.shadow_ratio)?;
        let share = self.relearn_fraction;
        ImagingError::unless((0.0..=1.0).contains(&share), "relearn_fraction", "0 to 1", share)
    }
}

/// Background model of one camera, and the foreground mask of its last picture.
#[derive(Debug, Clone)]
pub struct Foreground {
    config: ForegroundConfig,
    width: usize,
    height: usize,
    /// 255: may be foreground; 0: masked.
    open: Vec<u8>,
    n_open: usize,
    /// `None`: learnt.
    learning: Option<Learning>,
    mean: Vec<f32>,
    variance: Vec<f32>,
    gain: f32,
    /// Pixel by pixel, before and after the specks are gone: 0 background, 1 foreground, 2 surely.
    raw: Vec<u8>,
    mask: Vec<u8>,
    majority: majority::Majority,
    /// Value, first and last picture of each pixel's present time in the foreground.
    stay: Vec<Stay>,
    n_pictures: u32,
    n_flooded: u32,
    light: Light,
}

#[derive(Debug, Clone, Copy, Default)]
struct Stay {
    value: f32,
    first: u32,
    last: u32,
}

/// Pixels that the gain is taken from, about.
const GAIN_SAMPLES: usize = 4096;

impl Foreground {
    /// A model for pictures of this size [px], about to learn; nothing is masked.
    pub fn new(config: ForegroundConfig, width: usize, height: usize) -> Result<Self, ImagingError> {
        config.check()?;
        let n = width * height;
        Ok(Self {
            learning: Some(Learning::new(config.learn_frames, n)),
            config,
            width,
            height,
            open: vec![255; n],
            n_open: n,
            mean: vec![0.0; n],
            variance: vec![0.0; n],
            gain: 1.0,
            raw: vec![0; n],
            mask: vec![0; n],
            majority: majority::Majority::default(),
            stay: vec![Stay::default(); n],
            n_pictures: 0,
            n_flooded: 0,
            light: Light::default(),
        })
    }

    /// Changes the two thresholds that can be adjusted while the system runs [standard deviations]; `sure` is at least `threshold`.
    pub fn set_thresholds(&mut self, threshold: f32, sure: f32) {
        (self.config.threshold_sigma, self.config.sure_sigma) = (threshold, sure);
    }

    /// Masked pixels (`width × height`, row by row) are never foreground.
    pub fn set_mask(&mut self, masked: &[bool]) -> Result<(), ImagingError> {
        let expected = self.width * self.height;
        if masked.len() != expected {
            return Err(ImagingError::WrongLength { what: "mask", expected, found: masked.len() });
        }
        for (open, &masked) in self.open.iter_mut().zip(masked) {
            *open = if masked { 0 } else { 255 };
        }
        self.n_open = masked.iter().filter(|&&it| !it).count();
        Ok(())
    }

    /// Starts from a picture of the empty scene instead of learning: its values are the means, and three times the noise
    /// floor the standard deviation, until more is learnt.
    pub fn set_background(&mut self, image: &ImageView) -> Result<(), ImagingError> {
        self.fits(image)?;
        let start = (3.0 * self.config.noise_floor).powi(2);
        self.variance.fill(start);
        for (mean, &pixel) in self.mean.iter_mut().zip(image.pixels()) {
            *mean = pixel.into();
        }
        self.learning = None;
        Ok(())
    }

    /// Adds to each pixel's variance the effect of a background displaced by `jitter_px` [px, one standard deviation] on the slope there.
    pub fn allow_jitter(&mut self, jitter_px: f32) {
        let (width, height) = (self.width, self.height);
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            let at = |x: usize, y: usize| self.mean[y * width + x];
            let across = at((x + 1).min(width - 1), y) - at(x.saturating_sub(1), y);
            let down = at(x, (y + 1).min(height - 1)) - at(x, y.saturating_sub(1));
            self.variance[y * width + x] += (0.5 * jitter_px).powi(2) * (across * across + down * down);
        }
    }

    /// Ends learning with the pictures of the empty scene so far. `false`: there was none, and learning goes on.
    pub fn end_learning(&mut self) -> bool {
        if self.learning.as_mut().is_some_and(Learning::end)
            && let Some(learning) = self.learning.take()
        {
            learning.finish(self.config.noise_floor, &mut self.mean, &mut self.variance);
            self.gain = 1.0;
        }
        self.learning.is_none()
    }

    /// Whether the background is known.
    pub fn has_learnt(&self) -> bool {
        self.learning.is_none()
    }

    /// The foreground of the last picture, row by row: 0 background, 1 foreground, 2 surely.
    pub fn mask(&self) -> &[u8] {
        &self.mask
    }

    /// Columns and rows [px].
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Brightness of the last picture over that of the learnt scene.
    pub fn gain(&self) -> f32 {
        self.gain
    }

    /// Mean and standard deviation of the pixel at `index` in the learnt light [gray level]; zeros before they are learnt.
    pub fn pixel(&self, index: usize) -> (f32, f32) {
        (self.mean[index], self.variance[index].sqrt())
    }

    /// Segments a picture into foreground and background, and learns from it.
    ///
    /// [`Verdict::Learning`]: there is no foreground yet. [`Verdict::Flooded`]: more than `relearn_fraction` of the picture is
    /// foreground, so the mask is unreliable. [`ImagingError::WrongSize`] leaves everything as it was.
    pub fn update(&mut self, image: &ImageView) -> Result<Verdict, ImagingError> {
        self.fits(image)?;
        if let Some(learning) = &mut self.learning {
            self.mask.fill(0);
            if learning.add(image.pixels()) {
                learning.finish(self.config.noise_floor, &mut self.mean, &mut self.variance);
                self.learning = None;
                self.gain = 1.0;
            }
            return Ok(Verdict::Learning);
        }
        self.n_pictures = self.n_pictures.wrapping_add(1);
        self.find_gain(image.pixels());
        self.split(image.pixels());
        self.visit_foreground(image.pixels());
        let lit = self.majority.filter(&self.raw, &self.open, self.width, self.height, &mut self.mask);
        if lit as f64 <= self.config.relearn_fraction * self.n_open as f64 {
            self.n_flooded = 0;
            return Ok(Verdict::Trusted);
        }
        self.n_flooded += 1;
        if self.n_flooded >= self.config.learn_frames {
            self.n_flooded = 0;
            self.learning = Some(Learning::new(self.config.learn_frames, self.mean.len()));
        }
        Ok(Verdict::Flooded)
    }

    fn fits(&self, image: &ImageView) -> Result<(), ImagingError> {
        let (expected, found) = (self.size(), image.size());
        if expected == found { Ok(()) } else { Err(ImagingError::WrongSize { what: "picture", expected, found }) }
    }

    /// The gain on which most of the picture agrees; stays where it agrees on none.
    fn find_gain(&mut self, pixels: &[u8]) {
        // Odd, so that it does not fall on few columns of the usual widths.
        let step = (pixels.len() / GAIN_SAMPLES) | 1;
        let (mean, open) = (&self.mean, &self.open);
        let samples =
            (0..pixels.len()).step_by(step).filter(|&i| open[i] != 0).map(|i| (f32::from(pixels[i]), mean[i]));
        if let Some(gain) = self.light.ratio(samples) {
            self.gain = gain;
        }
    }

    /// Compares each pixel with its mean and lets the background learn.
    fn split(&mut self, pixels: &[u8]) {
        let ForegroundConfig { threshold_sigma, sure_sigma, noise_floor, adapt_frames, .. } = self.config;
        let (weak, sure, floor) =
            (threshold_sigma * threshold_sigma, sure_sigma * sure_sigma, noise_floor * noise_floor);
        let (gain, rate) = (self.gain, 1.0 / adapt_frames);
        let mean_rate = rate / gain;
        let n = pixels.len();
        // Slices of one length, so that the loop has no bounds to check and becomes vector code.
        let (mean, variance) = (&mut self.mean[..n], &mut self.variance[..n]);
        let (raw, open) = (&mut self.raw[..n], &self.open[..n]);
        for i in 0..n {
            let d = f32::from(pixels[i]) - (gain * mean[i]).min(255.0);
            let (square, v) = (d * d, variance[i]);
            let outside = square > weak * v;
            raw[i] = (u8::from(outside) + u8::from(square > sure * v)) & open[i];
            let follows = if outside { 0.0 } else { 1.0 };
            mean[i] += follows * mean_rate * d;
            variance[i] = (v + follows * rate * (square - v)).max(floor);
        }
    }

    /// Takes shadows out of the foreground, and learns again what has been in it, unchanged, for long.
    fn visit_foreground(&mut self, pixels: &[u8]) {
        const BLOCK: usize = 32;
        for start in (0..pixels.len()).step_by(BLOCK) {
            let end = (start + BLOCK).min(pixels.len());
            if self.raw[start..end].iter().fold(0, |any, &it| any | it) == 0 {
                continue;
            }
            for i in start..end {
                if self.raw[i] != 0 {
                    self.stay(i, pixels[i].into());
                    if self.is_shadow(i, pixels) {
                        self.raw[i] = 0;
                    }
                }
            }
        }
    }

    fn stay(&mut self, i: usize, pixel: f32) {
        let now = self.n_pictures;
        let value = pixel / self.gain;
        let stay = &mut self.stay[i];
        let near = (self.config.threshold_sigma * 2.0 * self.config.noise_floor).max(1.0);
        if stay.last.wrapping_add(1) != now || (value - stay.value).abs() > near {
            *stay = Stay { value, first: now, last: now };
        }
        stay.last = now;
        stay.value += (value - stay.value) / 16.0;
        if self.config.absorb_frames > 0 && now.wrapping_sub(stay.first) >= self.config.absorb_frames {
            self.mean[i] = stay.value;
            self.variance[i] = (2.0 * self.config.noise_floor).powi(2);
        }
    }

    /// Whether the neighbourhood of a foreground pixel has lost one part of its light.
    fn is_shadow(&self, i: usize, pixels: &[u8]) -> bool {
        let floor = self.config.shadow_ratio;
        let ratio = |at: usize| f32::from(pixels[at]) / (self.gain * self.mean[at]).clamp(1.0, 255.0);
        if !(floor..1.0).contains(&ratio(i)) {
            return false;
        }
        let (x, y) = (i % self.width, i / self.width);
        let (mut n, mut sum, mut square, mut noise) = (0.0, 0.0, 0.0, 0.0);
        for row in y.saturating_sub(1)..(y + 2).min(self.height) {
            for column in x.saturating_sub(1)..(x + 2).min(self.width) {
                let at = row * self.width + column;
                let (ratio, mean) = (ratio(at), (self.gain * self.mean[at]).max(1.0));
                n += 1.0;
                sum += ratio;
                square += ratio * ratio;
                noise += self.variance[at] / (mean * mean);
            }
        }
        let mean: f32 = sum / n;
        let spread = (square / n - mean * mean).max(0.0);
        // Twice the variance that the noise gives, and 2 % for the soft edge of a shadow.
        mean >= floor && mean < 1.0 && spread <= 2.0 * noise / n + 0.02 * 0.02
    }
}
