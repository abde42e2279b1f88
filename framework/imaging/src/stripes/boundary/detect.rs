//! Edges of light along the rows of a picture, between pixels.
//!
//! Rows are smoothed with those beside them; where the slope of the gray levels is steepest there is an edge, placed by a Gaussian through the slopes of three pixels: that is what the slope of a blurred
//! step is. On a surface whose own colour A changes, the steepest place of a step of blur σ is off by 2 σ² A′ / A, towards the brighter side, whether light begins or ends there:
//! the second derivative of A Φ(x / σ) is 0 there to first order in A′. σ is that of the Gaussian, A′ is taken from the lit side, and this is taken off.
//!
//! An edge of light has little light on its dark side; edges of the surface's own colour mostly have more, and are left out where they do.
//!
//! Edges of wide stripes, and faint ones, which so few pixels do not show, are found beside (`wide`).

use super::wide::Wide;
use crate::{ImageView, ImagingError};

/// What is an edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetectOptions {
    /// Least difference of both sides [gray levels].
    pub min_step: f32,
    /// Least (bright − dark) / (bright + dark), with `black` off both [–].
    pub min_contrast: f32,
    /// What the camera shows of no light [gray levels].
    pub black: f32,
    /// An edge whose bright side has this level or more is left out: it is saturated and its place unknown [gray levels].
    pub saturated: u8,
    /// Of the camera's gray levels, standard deviation [gray levels].
    pub noise: f32,
    /// Pixels from an edge to where its sides are looked at: less than half a stripe [px].
    pub beside: usize,
    /// Threads.
    pub threads: usize,
}

impl Default for DetectOptions {
    fn default() -> Self {
        Self { min_step: 6.0, min_contrast: 0.2, black: 0.0, saturated: 250, noise: 1.5, beside: 3, threads: 1 }
    }
}

/// Where light begins or ends along a row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge {
    /// Column [px].
    pub x: f32,
    /// Whether it is brighter on its right.
    pub is_rising: bool,
    /// Standard deviation of the column [px].
    pub sigma: f32,
}

/// The edges of a picture.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Edges {
    /// By row, ascending by column.
    pub rows: Vec<Vec<Edge>>,
    /// Edges left out because their bright side is saturated.
    pub n_saturated: usize,
}

impl Edges {
    /// Number of edges.
    pub fn len(&self) -> usize {
        self.rows.iter().map(Vec::len).sum()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.rows.iter().all(Vec::is_empty)
    }
}

/// No edge is taken to be placed better than this: the slope between pixels is not quite a Gaussian [px].
const BEST_SIGMA: f32 = 0.05;
/// Of g(x + 1) − g(x − 1), for noise of 1 in each pixel: the norm of its weights, along and across the rows.
const SLOPE_NOISE: f32 = 3.24;
/// g of a step of 1 that is as blurred as that of a lens and of pixels, at least.
const SLOPE_OF_STEP: f32 = 1.2;

/// From where a lit side is looked at to where its shade is [px].
const PLATEAU: usize = 2;
/// From there to the next edge, at least: as far as that is blurred [px].
const CLEAR: f32 = 2.0;
/// Shades change by no more than this a pixel, or they are edges [1/px].
const MOST_SHADE: f32 = 0.12;
/// How far an edge may be off whose surface's shade is not known: 2 σ² for a blur of σ = 1.3 px and a shade of 3 % a pixel [px].
const UNSURE: f32 = 0.1;

/// Finds the edges of a picture.
///
/// # Errors
/// Options out of their ranges.
pub fn detect(picture: &ImageView<'_>, options: &DetectOptions) -> Result<Edges, ImagingError> {
    let good = |it: f32| it.is_finite() && it >= 0.0;
    ImagingError::unless(good(options.min_step), "min_step", "0 or more", f64::from(options.min_step))?;
    let contrast = f64::from(options.min_contrast);
    ImagingError::unless((0.0..=1.0).contains(&contrast), "min_contrast", "0 to 1", contrast)?;
    ImagingError::unless(good(options.noise), "noise", "0 or more", f64::from(options.noise))?;
    ImagingError::unless((1..=64).contains(&options.beside), "beside", "1 to 64", options.beside as f64)?;
    let (width, height) = picture.size();
    let mut rows: Vec<Vec<Edge>> = vec![Vec::new(); height];
    let per_thread = height.div_ceil(options.threads.max(1)).max(1);
    let n_saturated = std::thread::scope(|scope| {
        let run = |first: usize, rows: &mut [Vec<Edge>]| {
            let mut work = Work { smooth: vec![0; width], slope: vec![0; width], shift: Vec::new(), blur: Vec::new() };
            let mut wide = Wide::new(width);
            let of_row = |(y, edges): (usize, &mut Vec<Edge>)| {
                let n = work.row(picture, y, options, edges);
                wide.row(picture, y, options, edges, &work.blur);
                n
            };
            (first..).zip(rows).map(of_row).sum::<usize>()
        };
        let mut parts = rows.chunks_mut(per_thread).enumerate();
        let own = parts.next();
        let others: Vec<_> = parts.map(|(part, rows)| scope.spawn(move || run(part * per_thread, rows))).collect();
        let own = own.map_or(0, |(_, rows)| run(0, rows));
        own + others.into_iter().map(|it| it.join().unwrap_or_default()).sum::<usize>()
    });
    Ok(Edges { rows, n_saturated })
}

struct Work {
    /// Four times the smoothed row.
    smooth: Vec<i16>,
    slope: Vec<i16>,
    /// By edge: how far its surface's own shade moves the steepest place [px].
    shift: Vec<f32>,
    /// By edge: its blur [px].
    blur: Vec<f32>,
}

impl Work {
    /// Edges of a row; how many were saturated.
    fn row(&mut self, picture: &ImageView<'_>, y: usize, options: &DetectOptions, edges: &mut Vec<Edge>) -> usize {
        let (width, height) = picture.size();
        let beside = options.beside;
        let margin = (beside + PLATEAU).max(3);
        self.shift.clear();
        self.blur.clear();
        if width < 2 * margin + 1 {
            return 0;
        }
        let [above, row, below] = [y.saturating_sub(1), y, (y + 1).min(height - 1)].map(|it| picture.row(it));
        for (to, ((a, b), c)) in self.smooth.iter_mut().zip(above.iter().zip(row).zip(below)) {
            *to = i16::from(*a) + 2 * i16::from(*b) + i16::from(*c);
        }
        let n = width - 4;
        let s = &self.smooth[..width];
        for (to, window) in self.slope[2..2 + n].iter_mut().zip(s.windows(5)) {
            *to = 2 * (window[3] - window[1]) + window[4] - window[0];
        }
        let least = (4.0 * SLOPE_OF_STEP * options.min_step * 0.5) as i16;
        let mut n_saturated = 0;
        for x in margin..width - margin {
            let g = self.slope[x];
            if g.abs() < least {
                continue;
            }
            let sign = g.signum();
            let at = |off: isize| sign * self.slope[x.wrapping_add_signed(off)];
            let peak = at(0);
            if !(peak > at(-1) && peak >= at(1) && peak > at(-2) && peak >= at(2)) {
                continue;
            }
            // Stripes may be narrower than `beside`: the extremes on the way count.
            let (before, after) = (&s[x - beside..x], &s[x + 1..x + beside + 1]);
            let (dark, bright) = if sign > 0 { (before, after) } else { (after, before) };
            let (Some(dark), Some(bright)) = (dark.iter().min(), bright.iter().max()) else { continue };
            let [dark, bright] = [dark, bright].map(|it| f32::from(*it) / 4.0 - options.black);
            let step = bright - dark;
            if step < options.min_step || step < options.min_contrast * (bright + dark) {
                continue;
            }
            let side = if sign > 0 { x + 1..x + beside + 1 } else { x - beside..x };
            if row[side].iter().any(|it| *it >= options.saturated) {
                n_saturated += 1;
                continue;
            }
            let [left, middle, right] = [at(-1), peak, at(1)].map(|it| f32::from(it.max(1)).ln());
            let bend = 2.0 * middle - left - right;
            if bend <= 0.0 {
                continue;
            }
            let part = (0.5 * (right - left) / bend).clamp(-1.0, 1.0);
            let curve = f32::from(2 * peak) - f32::from(at(-1)) - f32::from(at(1));
            // x + shade · 2 σ² is the steepest place where the bright side has a shade of its own.
            let outer = if sign > 0 { s[x + beside + PLATEAU] } else { s[x - beside - PLATEAU] };
            let inner = if sign > 0 { s[x + beside] } else { s[x - beside] };
            let rise = f32::from(sign) * f32::from(outer - inner) / (4.0 * PLATEAU as f32);
            self.blur.push(bend.recip().sqrt());
            self.shift.push(2.0 / bend * (rise / bright).clamp(-MOST_SHADE, MOST_SHADE));
            let sigma = 4.0 * 0.5 * SLOPE_NOISE * options.noise / curve.max(1.0);
            edges.push(Edge { x: x as f32 + part, is_rising: sign > 0, sigma: sigma.hypot(BEST_SIGMA) });
        }
        // The shade was that of one stripe only where the next edge is beyond.
        let least = (beside + PLATEAU) as f32 + CLEAR;
        for at in 0..edges.len() {
            let other = if edges[at].is_rising { edges.get(at + 1) } else { at.checked_sub(1).map(|it| &edges[it]) };
            let is_clear = other.is_none_or(|it| (it.x - edges[at].x).abs() >= least);
            let shift = self.shift[at];
            // What is taken off is no better known than this; what is not taken off is not known at all.
            let (by, unsure) = if is_clear { (shift, 0.3 * shift) } else { (0.0, UNSURE) };
            let edge = &mut edges[at];
            edge.x -= by;
            edge.sigma = edge.sigma.hypot(unsure);
        }
        n_saturated
    }
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;

    use super::*;

    /// Mean of a step at `edge` under a Gaussian blur, over each pixel.
    fn picture(edge: f64, blur: f64, dark: f64, bright: f64, slant: f64, seed: u64) -> Vec<u8> {
        let mut random = Random::new(seed);
        let mut pixels = Vec::new();
        for y in 0..9 {
            for x in 0..40 {
                let mut sum = 0.0;
                for sample in 0..64 {
                    let at =
                        f64::from(x) + (f64::from(sample) + 0.5) / 64.0 - 0.5 - edge - slant * (f64::from(y) - 4.0);
                    sum += 1.0 / (1.0 + (-1.702 * at / blur).exp());
                }
                let gray = dark + (bright - dark) * sum / 64.0 + random.normal();
                pixels.push(gray.round().clamp(0.0, 255.0) as u8);
            }
        }
        pixels
    }

    fn found(pixels: &[u8]) -> Vec<Edge> {
        let view = ImageView::new(pixels, 40, 9).unwrap();
        detect(&view, &DetectOptions::default()).unwrap().rows.swap_remove(4)
    }

    #[test]
    fn edges_are_placed_to_a_part_of_a_pixel_and_as_well_as_they_say() {
        let (mut squares, mut normalised, mut n) = (0.0, 0.0, 0.0);
        for seed in 0..400 {
            let edge = 15.0 + 0.01 * f64::from(seed as u32 % 100) * 7.0;
            let (dark, bright) = if seed % 2 == 0 { (12.0, 110.0) } else { (110.0, 12.0) };
            let edges = found(&picture(edge, 0.9, dark, bright, 0.3, seed));
            assert_eq!(edges.len(), 1, "seed {seed}");
            let error = f64::from(edges[0].x) - edge;
            assert_eq!(edges[0].is_rising, seed % 2 == 0);
            squares += error * error;
            normalised += (error / f64::from(edges[0].sigma)).powi(2);
            n += 1.0;
        }
        let (rms, normalised) = ((squares / n).sqrt(), (normalised / n).sqrt());
        assert!(rms < 0.06, "{rms}");
        assert!((0.3..1.3).contains(&normalised), "{normalised}");
    }

    #[test]
    fn colours_noise_and_saturated_light_make_no_edges() {
        assert!(found(&picture(20.0, 0.9, 80.0, 110.0, 0.0, 1)).is_empty(), "an edge of colour");
        assert!(found(&picture(20.0, 0.9, 20.0, 24.0, 0.0, 2)).is_empty(), "noise");
        let bright = picture(20.0, 0.9, 20.0, 300.0, 0.0, 3);
        let edges = detect(&ImageView::new(&bright, 40, 9).unwrap(), &DetectOptions::default()).unwrap();
        assert!(edges.is_empty() && edges.n_saturated == 9);
    }

    #[test]
    fn the_number_of_threads_changes_nothing_and_small_pictures_have_no_edges() {
        let pixels = picture(20.3, 1.1, 15.0, 90.0, 0.2, 5);
        let view = ImageView::new(&pixels, 40, 9).unwrap();
        let of = |threads| detect(&view, &DetectOptions { threads, ..DetectOptions::default() }).unwrap();
        assert_eq!(of(1), of(4));
        assert!(detect(&ImageView::new(&[9; 6], 3, 2).unwrap(), &DetectOptions::default()).unwrap().is_empty());
        assert!(detect(&ImageView::new(&[], 0, 0).unwrap(), &DetectOptions::default()).unwrap().is_empty());
    }
}
