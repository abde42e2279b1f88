//! Tracks a small patch from one picture to another: pyramidal Lucas–Kanade, with the covariance of the answer.
//!
//! Sources: B. D. Lucas, T. Kanade, "An iterative image registration technique with an application to stereo vision", IJCAI 1981;
//! C. Tomasi, T. Kanade, "Detection and tracking of point features", CMU-CS-91-132, 1991 (the structure tensor); J.-Y. Bouguet,
//! "Pyramidal implementation of the affine Lucas Kanade feature tracker", Intel, 2001 (from coarse to fine). [Davis 2002 §5.1] tracks with it.
//!
//! | here         | there | meaning                                                             | unit          |
//! |--------------|-------|---------------------------------------------------------------------|---------------|
//! | `values`     | I     | the patch, sampled bilinearly about a sub-pixel centre              | gray level    |
//! | `gx`, `gy`   | ∇I    | its gradient, by Scharr's operator, less its mean over the window   | gray level/px |
//! | `tensor`     | G     | Σ ∇I ∇Iᵀ                                                            | (gray level/px)² |
//! | `mismatch`   | b     | Σ (J − I) ∇I                                                        | gray level²/px |
//! | a step       | η     | −G⁻¹ b                                                              | px            |
//!
//! Taking the mean off the gradient solves for a change of brightness along with the motion: a patch that comes under another light by a constant
//! is found at the same place. The covariance is s² G⁻¹ with s² the variance of J − I − mean at the answer, which holds the noise of
//! both pictures and whatever does not fit; interpolation has made that smaller and shared it among neighbours, which is undone.

mod kernel;
mod lanes;
#[cfg(test)]
mod tests;

use nalgebra::{Matrix2, Point2, Vector2};

use crate::{ImagingError, Pyramid};
use kernel::{Patch, Region};

/// How [`LucasKanade`] searches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlowSettings {
    /// Columns and rows of a patch, odd, 5 to 31 [px].
    pub window_px: usize,
    /// Levels of the pyramid that are searched, from the coarsest down, 1 to 8 [–].
    pub levels: usize,
    /// Steps on each level, at most [–].
    pub max_steps: usize,
    /// A level is done when a step is shorter than this [px of the level].
    pub stop_px: f64,
    /// A patch is flat when it has less texture than this along some direction: the root of the smaller eigenvalue of G / n [gray level/px].
    pub min_texture: f64,
}

impl Default for FlowSettings {
    /// As usual for video: what moves by 50 px is reached from the fourth level.
    fn default() -> Self {
        Self { window_px: 21, levels: 4, max_steps: 20, stop_px: 0.01, min_texture: 1.0 }
    }
}

/// Why a patch was not found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lost {
    /// The patch has too little texture in some direction to fix its place.
    Flat,
    /// More than half of the window to one side would lie beyond the border, or the place is not a finite number.
    Outside,
    /// The search did not converge, or moved further than its window is wide.
    Diverged,
}

/// The place of a patch in another picture, and how well it matches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flow {
    /// Its centre, in pixels of the picture searched.
    pub pixel: Point2<f64>,
    /// Covariance of the centre, relative to that of the template [px²].
    pub covariance: Matrix2<f64>,
    /// Normalised correlation of the template and what lies there, −1 to 1: the same under another brightness and contrast [–].
    pub correlation: f64,
    /// Root mean square difference of the two after their means are made equal [gray level].
    pub residual: f64,
}

/// A template: one patch at each level of a pyramid, with its gradients. Its memory is reused.
#[derive(Debug, Clone, Default)]
pub struct Template {
    /// From level 0 up; empty before the first [`LucasKanade::learn`].
    patches: Vec<Patch>,
    centre: Point2<f64>,
}

impl Template {
    /// Its centre in the picture that it was taken from [px].
    pub fn centre(&self) -> Point2<f64> {
        self.centre
    }
}

/// Pyramidal Lucas–Kanade tracker: [`LucasKanade::learn`] takes a template, [`LucasKanade::find`] finds it in another picture. Holds the buffers for both.
///
/// ```
/// use foveate_imaging::{FlowSettings, ImageView, LucasKanade, Pyramid, Template};
/// use nalgebra::{Point2, Vector2};
///
/// // A textured surface before and after a motion by (6.4, -3.7) px.
/// let (size, motion) = ([160, 120], Vector2::new(6.4, -3.7));
/// let pyramid = |moved: Vector2<f64>| {
///     let level = |at: usize| {
///         let [x, y] = [(at % size[0]) as f64 - moved.x, (at / size[0]) as f64 - moved.y];
///         (128.0 + 50.0 * (0.21 * x + 0.05 * y).sin() + 50.0 * (0.17 * y - 0.08 * x).cos()).round() as u8
///     };
///     let pixels: Vec<u8> = (0..size[0] * size[1]).map(level).collect();
///     let mut pyramid = Pyramid::default();
///     pyramid.build(&ImageView::new(&pixels, size[0], size[1]).unwrap(), 4);
///     pyramid
/// };
/// let (before, after) = (pyramid(Vector2::zeros()), pyramid(motion));
///
/// let (mut tracker, mut template) = (LucasKanade::new(FlowSettings::default())?, Template::default());
/// let start = Point2::new(80.0, 60.0);
/// tracker.learn(&before, start, &mut template).expect("the patch has texture");
/// let flow = tracker.find(&template, &after, start).expect("it is found again");
///
/// assert!((flow.pixel - (start + motion)).norm() < 0.02, "{flow:?}");
/// assert!(flow.correlation > 0.99, "{flow:?}");
/// # Ok::<(), foveate_imaging::ImagingError>(())
/// ```
#[derive(Debug, Clone)]
pub struct LucasKanade {
    settings: FlowSettings,
    region: Region,
}

impl LucasKanade {
    /// A tracker with these settings.
    ///
    /// # Errors
    /// [`ImagingError::Setting`] names the first setting out of its range.
    pub fn new(settings: FlowSettings) -> Result<Self, ImagingError> {
        let FlowSettings { window_px, levels, max_steps, stop_px, min_texture } = settings;
        let is_odd = window_px % 2 == 1;
        ImagingError::unless(
            is_odd && (5..=31).contains(&window_px),
            "window_px",
            "odd and 5 to 31",
            window_px as f64,
        )?;
        ImagingError::unless((1..=8).contains(&levels), "levels", "1 to 8", levels as f64)?;
        ImagingError::unless((1..=1000).contains(&max_steps), "max_steps", "1 to 1000", max_steps as f64)?;
        ImagingError::unless((1e-6..=1.0).contains(&stop_px), "stop_px", "1e-6 to 1", stop_px)?;
        ImagingError::unless((0.0..=255.0).contains(&min_texture), "min_texture", "0 to 255", min_texture)?;
        Ok(Self { settings, region: Region::default() })
    }

    /// The options in use.
    pub fn settings(&self) -> &FlowSettings {
        &self.settings
    }

    /// Takes the patch around `centre` [px] at each level of `pyramid` as `template`.
    ///
    /// # Errors
    /// [`Lost::Outside`] and [`Lost::Flat`]; the template is then unusable.
    pub fn learn(&mut self, pyramid: &Pyramid, centre: Point2<f64>, template: &mut Template) -> Result<(), Lost> {
        self.unless_outside(pyramid, &centre)?;
        let n_levels = self.settings.levels.min(pyramid.n_levels());
        template.patches.resize_with(n_levels, Patch::default);
        template.centre = centre;
        for (level, patch) in template.patches.iter_mut().enumerate() {
            let at = centre / f64::from(1u32 << level);
            patch.learn(&pyramid.level(level), at, self.settings.window_px, &mut self.region);
            if level == 0 && patch.texture() < self.settings.min_texture {
                return Err(Lost::Flat);
            }
        }
        Ok(())
    }

    /// Finds `template` in the picture of `pyramid`, starting at `guess` [px].
    ///
    /// # Errors
    /// Why it was not found. An answer may still be another patch that looks alike: check its correlation, or track back.
    pub fn find(&mut self, template: &Template, pyramid: &Pyramid, guess: Point2<f64>) -> Result<Flow, Lost> {
        self.find_from(template, pyramid, guess, self.settings.levels)
    }

    /// As [`Self::find`], from level `levels` − 1 down: 1 searches only the picture itself.
    ///
    /// # Errors
    /// As [`Self::find`].
    pub fn find_from(
        &mut self,
        template: &Template,
        pyramid: &Pyramid,
        guess: Point2<f64>,
        levels: usize,
    ) -> Result<Flow, Lost> {
        let n_levels = template.patches.len().min(pyramid.n_levels()).min(levels.max(1));
        if n_levels == 0 || !self.is_near(pyramid, &guess) {
            return Err(Lost::Outside);
        }
        let mut pixel = guess;
        for level in (0..n_levels).rev() {
            let scale = f64::from(1u32 << level);
            let patch = &template.patches[level];
            // A coarse level without texture tells nothing: the guess goes on as it is.
            if level > 0 && patch.texture() < self.settings.min_texture {
                continue;
            }
            let view = pyramid.level(level);
            let stop_px = if level == 0 { self.settings.stop_px } else { self.settings.stop_px.max(0.1) };
            let from = pixel / scale;
            let mut at = from;
            self.region.forget();
            let mut last = Vector2::zeros();
            let mut is_done = false;
            for _ in 0..self.settings.max_steps {
                let step = patch.step(&view, at, &mut self.region);
                at += step;
                if (at - from).norm() > self.settings.window_px as f64 || !at.x.is_finite() {
                    return Err(Lost::Diverged);
                }
                is_done = step.norm() < stop_px;
                // To and fro between two places: the one between them.
                if !is_done && (step + last).norm() < stop_px {
                    at -= step / 2.0;
                    is_done = true;
                }
                if is_done {
                    break;
                }
                last = step;
            }
            if level == 0 && !is_done {
                return Err(Lost::Diverged);
            }
            pixel = at * scale;
        }
        self.unless_outside(pyramid, &pixel)?;
        let fit = template.patches[0].fit(&pyramid.level(0), pixel, &mut self.region);
        Ok(Flow { pixel, covariance: fit.covariance, correlation: fit.correlation, residual: fit.residual })
    }

    /// Normalised correlation of `template` with what lies about `pixel` [–]; 0 outside.
    pub fn correlation(&mut self, template: &Template, pyramid: &Pyramid, pixel: Point2<f64>) -> f64 {
        if template.patches.is_empty() || self.unless_outside(pyramid, &pixel).is_err() {
            return 0.0;
        }
        self.region.forget();
        template.patches[0].fit(&pyramid.level(0), pixel, &mut self.region).correlation
    }

    /// A guess may be a window beyond the border, in a picture that has room for half a window. NaN is nowhere.
    fn is_near(&self, pyramid: &Pyramid, pixel: &Point2<f64>) -> bool {
        let (width, height) = pyramid.size();
        let window = self.settings.window_px as f64;
        let near = |at: f64, n: usize| n as f64 > window / 2.0 && at >= -window && at <= n as f64 + window;
        near(pixel.x, width) && near(pixel.y, height)
    }

    /// A quarter of the window has to lie on each side of `pixel`.
    fn unless_outside(&self, pyramid: &Pyramid, pixel: &Point2<f64>) -> Result<(), Lost> {
        let (width, height) = pyramid.size();
        let margin = self.settings.window_px as f64 / 4.0;
        let inside = |at: f64, n: usize| at >= margin && at <= n as f64 - 1.0 - margin;
        if inside(pixel.x, width) && inside(pixel.y, height) { Ok(()) } else { Err(Lost::Outside) }
    }
}
