//! Edges of wide stripes and of faint ones, which a few pixels do not show.
//!
//! Where a surface turns away from the projector its stripes are wide in the camera's picture and their edges as blurred; on what is dark they change the picture by little more than its noise does. There
//! an edge is where the means of [`HALF`] pixels on either side, over five rows, differ most. Only edges that have as much room are looked at.
//!
//! On such a surface light falls off across the edge, which moves its steepest place by pixels. So the edge is fitted as what it is, f(t) = A (1 + a t) (c + Φ((t − x) / σ)): its place, its blur, the brightness of the
//! surface and how that changes, and the light of the room; what the place is known by then allows for all of these.

use nalgebra::{SMatrix, SVector};

use super::detect::{DetectOptions, Edge};
use crate::ImageView;

/// Pixels on either side whose means are compared.
const HALF: usize = 5;
/// From there to where the parabola through the greatest difference is held [px].
const STEP: usize = 2;
/// No other edge is nearer than this, or the sides are not those of one edge [px].
const ROOM: f32 = 2.0 * HALF as f32 + 1.0;
/// Weights of five rows; their sum, and their norm.
const ROWS: [i32; 5] = [1, 4, 6, 4, 1];
const SUM: f32 = 16.0;
const ROWS_NORM: f32 = 8.37;
/// What the means of both sides differ by has 0.33 of a pixel's noise, what narrow edges are found by 0.8: the least step of a wide one is less, but not by as much, so that a picture without light has none [–].
const LESS_NOISE: f32 = 0.7;
/// A narrow edge at the same place is kept where it is less blurred than this [px].
const BLURRED: f32 = 1.8;
/// Pixels on either side to which the edge is fitted, where no other edge is nearer …
const MOST_AROUND: usize = 14;
/// … than this beyond them.
const CLEAR: f32 = 4.0;
/// What is known of A′ / A, of c and of the blur before the edge is seen, standard deviations [1/px, –, part of the blur].
const SHADE: f64 = 0.04;
const ROOM_LIGHT: f64 = 0.2;
const BLUR: f64 = 0.5;
/// Steps of the fit, and one that is its last [px].
const STEPS: usize = 8;
const CLOSE: f64 = 5e-3;
/// Blurs that an edge may have [px].
const BLURS: std::ops::RangeInclusive<f64> = 0.4..=12.0;
/// No edge is taken to be placed better than this part of its blur: over so many pixels light does not fall off evenly. Of the simulated bust, seed 302, at rest and at 5 cm/s: boundaries on stripes 16 to 24 px wide are off by
/// 0.3 px in the middle, at blurs of some 3.5 px [–].
const BEST_SIGMA: f64 = 0.08;
/// An edge that is known worse is none [px].
const MOST_SIGMA: f64 = 1.5;

/// Finds wide edges in rows.
pub(super) struct Wide {
    /// The rows around one, smoothed, times [`SUM`].
    smooth: Vec<i32>,
    /// Sums of it before each pixel.
    sums: Vec<i32>,
    difference: Vec<i32>,
    found: Vec<(usize, Edge)>,
    /// Edges, and where they belong: instead of so many narrow ones from there on.
    fitted: Vec<(usize, usize, Edge)>,
}

/// A fitted edge.
struct Fit {
    x: f64,
    sigma: f64,
    blur: f64,
}

impl Wide {
    pub fn new(width: usize) -> Wide {
        Wide {
            smooth: vec![0; width],
            sums: vec![0; width + 1],
            difference: vec![0; width],
            found: Vec::new(),
            fitted: Vec::new(),
        }
    }

    /// Adds the wide edges of a row to its narrow ones, of which `blurs` says how blurred each is [px].
    pub fn row(
        &mut self,
        picture: &ImageView<'_>,
        y: usize,
        options: &DetectOptions,
        edges: &mut Vec<Edge>,
        blurs: &[f32],
    ) {
        let (width, height) = picture.size();
        let margin = HALF + STEP + 1;
        if width < 2 * margin + 1 {
            return;
        }
        let rows = [0, 1, 2, 3, 4].map(|it| picture.row((y + it).saturating_sub(2).min(height - 1)));
        for (x, to) in self.smooth.iter_mut().enumerate() {
            *to = rows.iter().zip(ROWS).map(|(row, weight)| weight * i32::from(row[x])).sum();
        }
        for x in 0..width {
            self.sums[x + 1] = self.sums[x] + self.smooth[x];
        }
        let s = &self.sums;
        for x in HALF..width - HALF {
            self.difference[x] = (s[x + HALF + 1] - s[x + 1]) - (s[x] - s[x - HALF]);
        }
        let least = (SUM * HALF as f32 * options.min_step * LESS_NOISE * 0.5) as i32;
        self.found.clear();
        for x in margin..width - margin {
            let here = self.difference[x];
            if here.abs() < least {
                continue;
            }
            let at = |off: isize| here.signum() * self.difference[x.wrapping_add_signed(off)];
            let is_peak = (1..=STEP as isize + 1).all(|it| at(0) > at(-it) && at(0) >= at(it));
            if is_peak && let Some(edge) = self.edge(picture, x, y, options) {
                self.found.push((x, edge));
            }
        }
        self.fitted.clear();
        for (at, (x, rough)) in self.found.iter().enumerate() {
            let is_same = |it: &Edge| it.is_rising == rough.is_rising && (it.x - rough.x).abs() <= HALF as f32;
            let first = edges.partition_point(|it| it.x < rough.x - ROOM);
            let n = edges[first..].iter().take_while(|it| it.x < rough.x + ROOM).count();
            let others = [at.checked_sub(1), Some(at + 1)].into_iter().flatten().filter_map(|it| self.found.get(it));
            let has_room = others.into_iter().all(|(_, it)| (it.x - rough.x).abs() >= ROOM);
            let is_sharp = blurs[first..first + n].iter().any(|it| *it < BLURRED);
            if !has_room || is_sharp || !edges[first..first + n].iter().all(is_same) {
                continue;
            }
            let beside = [first.checked_sub(1), Some(first + n)].into_iter().flatten().filter_map(|it| edges.get(it));
            let away = beside.map(|it| (it.x - rough.x).abs()).fold(f32::INFINITY, f32::min);
            let around = ((away - CLEAR) as usize).clamp(HALF + STEP, MOST_AROUND);
            if let Some(fit) = self.fit(*x, *rough, around, options)
                && (n == 0 || fit.blur >= f64::from(BLURRED))
            {
                self.fitted.push((first, n, Edge { x: fit.x as f32, sigma: fit.sigma as f32, ..*rough }));
            }
        }
        for (first, n, edge) in self.fitted.drain(..).rev() {
            edges.splice(first..first + n, [edge]);
        }
    }

    /// The edge at column `x`, if it is one of light, about where it is.
    fn edge(&self, picture: &ImageView<'_>, x: usize, y: usize, options: &DetectOptions) -> Option<Edge> {
        let sign = self.difference[x].signum();
        let is_rising = sign > 0;
        let at = |off: isize| (sign * self.difference[x.wrapping_add_signed(off)]) as f32;
        let mean = |from: usize| (self.sums[from + 3] - self.sums[from]) as f32 / (3.0 * SUM) - options.black;
        let (left, right) = (mean(x - HALF - 1), mean(x + HALF - 1));
        let (dark, bright) = if is_rising { (left, right) } else { (right, left) };
        let step = bright - dark;
        if step < options.min_step * LESS_NOISE || step < options.min_contrast * (bright + dark) {
            return None;
        }
        let row = picture.row(y);
        let side = if is_rising { x + 1..x + HALF + 2 } else { x - HALF - 1..x };
        if row[side].iter().any(|it| *it >= options.saturated) {
            return None;
        }
        let far = STEP as isize;
        let (before, here, after) = (at(-far), at(0), at(far));
        let curve = 2.0 * here - before - after;
        let off = (0.5 * STEP as f32 * (after - before) / curve).clamp(-1.5, 1.5);
        (curve > 0.0).then_some(Edge { x: x as f32 + off, is_rising, sigma: f32::NAN })
    }

    /// The edge that suits `around` pixels on either side of column `x` best.
    fn fit(&self, x: usize, rough: Edge, around: usize, options: &DetectOptions) -> Option<Fit> {
        let (first, last) = (x.saturating_sub(around), (x + around).min(self.smooth.len() - 1));
        let gray = |at: usize| f64::from(self.smooth[at] as f32 / SUM - options.black);
        // Rising to the right; others are fitted in the mirror.
        let (from, sign) = (x as f64, if rough.is_rising { 1.0 } else { -1.0 });
        let ends = [gray(first), gray(last)];
        let (dark, bright) = if rough.is_rising { (ends[0], ends[1]) } else { (ends[1], ends[0]) };
        let level = (bright - dark).max(f64::from(options.min_step * LESS_NOISE));
        let steepest = (first + 1..last).map(|it| sign * 0.5 * (gray(it + 1) - gray(it - 1))).fold(1e-3, f64::max);
        let blur = (0.4 * level / steepest).clamp(1.0, 6.0);
        let room = (dark / level).clamp(0.0, 2.0);
        // Place, blur, A, A a, c.
        let start = SVector::<f64, 5>::from([sign * (f64::from(rough.x) - from), blur, level, 0.0, room]);
        let noise = f64::from(options.noise * ROWS_NORM / SUM).max(0.1);
        let prior = [0.0, 1.0 / (BLUR * blur), 0.0, 1.0 / (SHADE * level), 1.0 / ROOM_LIGHT].map(|it| it * it);
        let mut now = start;
        let mut known = SMatrix::<f64, 5, 5>::zeros();
        let mut square = 0.0;
        for _ in 0..STEPS {
            known = SMatrix::from_diagonal(&SVector::from(prior));
            let mut side = SVector::<f64, 5>::from_fn(|it, _| prior[it] * (start[it] - now[it]));
            square = 0.0;
            for at in first..=last {
                let t = sign * (at as f64 - from);
                let (value, slopes) = model(&now, t);
                let off = (gray(at) - value) / noise;
                let slopes = slopes / noise;
                known += slopes * slopes.transpose();
                side += slopes * off;
                square += off * off;
            }
            let step = known.cholesky()?.solve(&side);
            now += step;
            if !BLURS.contains(&now[1]) || now[0].abs() > around as f64 || now[2] <= 0.0 {
                return None;
            }
            if step[0].abs() < CLOSE {
                break;
            }
        }
        let freedom = (last - first).saturating_sub(4).max(1) as f64;
        let worse = (square / freedom).max(1.0).sqrt();
        let sigma = worse * known.cholesky()?.inverse()[(0, 0)].sqrt();
        let place = from + sign * now[0];
        let is_there = (place - f64::from(rough.x)).abs() <= HALF as f64 && sigma <= MOST_SIGMA;
        is_there.then(|| Fit { x: place, sigma: sigma.hypot(BEST_SIGMA * now[1]), blur: now[1] })
    }
}

/// (A + A a t) (c + Φ((t − x) / σ)), and what it changes by with x, σ, A, A a and c.
fn model(of: &SVector<f64, 5>, t: f64) -> (f64, SVector<f64, 5>) {
    let [x, blur, level, shade, room] = (*of).into();
    let from = (t - x) / blur;
    let (part, density) = normal(from);
    let bright = level + shade * t;
    let light = room + part;
    let by_place = -bright * density / blur;
    (bright * light, SVector::from([by_place, by_place * from, light, light * t, bright]))
}

/// Φ and its slope, by the formula 26.2.17 of Abramowitz and Stegun, to 1e-7.
fn normal(x: f64) -> (f64, f64) {
    let density = (-0.5 * x * x).exp() * 0.398_942_280_401_432_7;
    let t = 1.0 / (1.0 + 0.231_641_9 * x.abs());
    let sum =
        t * (0.319_381_530 + t * (-0.356_563_782 + t * (1.781_477_937 + t * (-1.821_255_978 + t * 1.330_274_429))));
    let beyond = density * sum;
    (if x >= 0.0 { 1.0 - beyond } else { beyond }, density)
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;

    use super::super::detect::detect;
    use super::*;

    const SIZE: [usize; 2] = [64, 9];

    /// Light that ends or begins at a column, on a surface that gets brighter by the part `shade` a pixel, with noise of one gray level.
    struct Step {
        edge: f64,
        blur: f64,
        bright: f64,
        shade: f64,
        is_rising: bool,
    }

    impl Step {
        fn picture(&self, seed: u64) -> Vec<u8> {
            let mut random = Random::new(seed);
            let gray = |x: f64| {
                let off = x - self.edge;
                let lit = normal(if self.is_rising { off } else { -off } / self.blur).0;
                self.bright * (self.shade * off).exp() * (0.06 + lit)
            };
            let pixels = (0..SIZE[0] * SIZE[1]).map(|at| gray((at % SIZE[0]) as f64) + random.normal());
            pixels.map(|it| it.round().clamp(0.0, 255.0) as u8).collect()
        }
    }

    /// Edges of the middle row, those left out that say that they are hardly known.
    fn edges(pixels: &[u8], min_step: f32) -> Vec<Edge> {
        let options = DetectOptions { min_step, noise: 1.0, ..DetectOptions::default() };
        let found = detect(&ImageView::new(pixels, SIZE[0], SIZE[1]).unwrap(), &options).unwrap().rows.swap_remove(4);
        found.into_iter().filter(|it| it.sigma < 2.0).collect()
    }

    /// Signed error towards the bright side, and the error over what it says it is, of 200 edges: mean, root mean square.
    #[track_caller]
    fn errors(blur: f64, bright: f64, shade: f64, min_step: f32) -> (f64, f64) {
        let (mut sum, mut squares, mut n) = (0.0, 0.0, 0.0);
        for seed in 0..200 {
            let is_rising = seed % 2 == 0;
            let edge = 30.0 + 0.01 * (37 * seed % 100) as f64;
            let shade = if is_rising { shade } else { -shade };
            let found = edges(&Step { edge, blur, bright, shade, is_rising }.picture(seed), min_step);
            let [found] = found[..] else { continue };
            assert_eq!(found.is_rising, is_rising, "seed {seed}: {found:?}");
            let off = (f64::from(found.x) - edge) * if is_rising { 1.0 } else { -1.0 };
            sum += off;
            squares += (off / f64::from(found.sigma)).powi(2);
            n += 1.0;
        }
        assert!(n >= 190.0, "{n} of 200");
        (sum / n, (squares / n).sqrt())
    }

    #[test]
    fn wide_edges_are_where_light_ends_also_where_it_falls_off() {
        for shade in [-0.02, 0.0, 0.02] {
            let (off, normalised) = errors(3.5, 70.0, shade, 6.0);
            // The steepest place is 2 · 3.5² · 0.02 = 0.49 px away.
            assert!(off.abs() < 0.25, "{shade}: {off} px");
            assert!((0.2..1.3).contains(&normalised), "{shade}: {normalised}");
        }
    }

    #[test]
    fn faint_edges_are_found_and_noise_makes_none() {
        let (off, normalised) = errors(1.5, 6.0, 0.0, 6.0);
        assert!(off.abs() < 0.15 && (0.3..1.4).contains(&normalised), "{off} {normalised}");
        for seed in 0..200 {
            let none = Step { edge: 30.0, blur: 2.0, bright: 1.0, shade: 0.0, is_rising: true }.picture(seed);
            assert_eq!(edges(&none, 6.0), [], "seed {seed}");
        }
    }

    #[test]
    fn sharp_edges_stay_as_they_are() {
        let picture = Step { edge: 30.3, blur: 0.9, bright: 70.0, shade: 0.0, is_rising: true }.picture(1);
        let found = edges(&picture, 6.0);
        assert!(found.len() == 1 && (found[0].x - 30.3).abs() < 0.1 && found[0].sigma < 0.12, "{found:?}");
    }
}
