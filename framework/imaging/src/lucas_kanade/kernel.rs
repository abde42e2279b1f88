//! The inner loops of Lucas–Kanade on one level: rows of a fixed length, so that they become vector instructions.

use nalgebra::{Matrix2, Point2, Vector2};

use super::lanes::{self, Lanes};
use crate::ImageView;

/// Rows are read this much wider than they need to be, on all sides together: the search moves that far before it reads again.
const SLACK: usize = 8;
/// Pixels by which a region reaches beyond its window at the start, on each side.
const REACH: isize = 3;
/// Rows are padded to a multiple of this.
const CHUNK: usize = 8;

/// Part of a picture as numbers, around the place where a patch is searched.
#[derive(Debug, Clone, Default)]
pub(super) struct Region {
    pixels: Vec<f32>,
    /// Column and row of the picture that its first pixel is.
    corner: [isize; 2],
    /// Columns and rows; 0: forgotten.
    stride: usize,
    rows: usize,
}

impl Region {
    pub(super) fn forget(&mut self) {
        self.stride = 0;
    }

    /// Reads the pixels from `corner` on; beyond the border, the outermost ones.
    fn read(&mut self, view: &ImageView<'_>, corner: [isize; 2], stride: usize, rows: usize) {
        let (width, height) = (view.width() as isize, view.height() as isize);
        (self.corner, self.stride, self.rows) = (corner, stride, rows);
        self.pixels.resize(stride * rows, 0.0);
        let is_inside = corner[0] >= 0 && corner[0] + stride as isize <= width;
        for (out, y) in self.pixels.chunks_exact_mut(stride).zip(corner[1]..) {
            let row = view.row(y.clamp(0, height - 1) as usize);
            if is_inside {
                let row = &row[corner[0] as usize..][..stride];
                out.iter_mut().zip(row).for_each(|(out, it)| *out = f32::from(*it));
            } else {
                for (out, x) in out.iter_mut().zip(corner[0]..) {
                    *out = f32::from(row[x.clamp(0, width - 1) as usize]);
                }
            }
        }
    }

    /// Sees to it that a window of `rows` rows of `stride` with its top left at `corner` is in it, and the pixels beside them that
    /// interpolation asks for; returns where in it that is.
    fn reach(&mut self, view: &ImageView<'_>, corner: [isize; 2], stride: usize, rows: usize) -> usize {
        let place = |region: &Self| {
            let [x, y] = [corner[0] - region.corner[0], corner[1] - region.corner[1]];
            let fits = x >= 0 && y >= 0 && x + (stride as isize) < region.stride as isize;
            (fits && y + (rows as isize) < region.rows as isize).then(|| y as usize * region.stride + x as usize)
        };
        if self.stride == stride + SLACK
            && let Some(place) = place(self)
        {
            return place;
        }
        let start = [corner[0] - REACH, corner[1] - REACH];
        self.read(view, start, stride + SLACK, rows + 1 + 2 * REACH as usize);
        place(self).unwrap_or_else(|| unreachable!("it was just read around it"))
    }
}

/// What one patch and the picture beneath it have in common.
pub(super) struct Fit {
    pub covariance: Matrix2<f64>,
    pub correlation: f64,
    pub residual: f64,
}

/// A patch on one level. Rows are padded to a whole number of lanes, with gradients of zero.
#[derive(Debug, Clone, Default)]
pub(super) struct Patch {
    values: Vec<f32>,
    gx: Vec<f32>,
    gy: Vec<f32>,
    window: usize,
    stride: usize,
    tensor: Matrix2<f64>,
    inverse: Matrix2<f64>,
    /// Sum of the squares of the weights that it was interpolated with [–].
    smoothing: f64,
}

/// Columns that a row of `window` pixels is padded to.
fn padded(window: usize) -> usize {
    window.div_ceil(CHUNK) * CHUNK
}

/// The pixel at or before `at`, and the rest.
fn split(at: f64) -> (isize, f32) {
    let whole = at.floor();
    (whole as isize, (at - whole) as f32)
}

/// Weights of the four pixels about a place: here, right, below, right below.
fn bilinear(fx: f32, fy: f32) -> [f32; 4] {
    [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy]
}

/// What interpolation leaves of the variance of noise [–].
fn squares_of(weights: [f32; 4]) -> f64 {
    weights.iter().map(|it| f64::from(it * it)).sum()
}

impl Patch {
    /// The patch of `window` × `window` pixels about `centre`. `view` has pixels.
    pub(super) fn learn(&mut self, view: &ImageView<'_>, centre: Point2<f64>, window: usize, region: &mut Region) {
        match padded(window) {
            8 => self.learn_padded::<8, 12, 16>(view, centre, window, region),
            16 => self.learn_padded::<16, 20, 24>(view, centre, window, region),
            24 => self.learn_padded::<24, 28, 32>(view, centre, window, region),
            _ => self.learn_padded::<32, 36, 40>(view, centre, window, region),
        }
    }

    /// The same with rows of S columns; W = S + 4, with the rim that the gradient asks for; R = S + [`SLACK`].
    fn learn_padded<const S: usize, const W: usize, const R: usize>(
        &mut self,
        view: &ImageView<'_>,
        centre: Point2<f64>,
        window: usize,
        region: &mut Region,
    ) {
        let half = (window / 2) as isize;
        (self.window, self.stride) = (window, S);
        for part in [&mut self.values, &mut self.gx, &mut self.gy] {
            part.resize(S * window, 0.0);
        }
        let ((x, fx), (y, fy)) = (split(centre.x), split(centre.y));
        region.read(view, [x - half - 1, y - half - 1], R, window + 3);
        let w = bilinear(fx, fy);
        self.smoothing = squares_of(w);
        let w = w.map(Lanes::all);
        let pixels = region.pixels.as_chunks::<R>().0;
        let [mut above, mut here, mut below] = [[0.0f32; W]; 3];
        let rows = |r: usize| {
            let (a, b) = (&pixels[r], &pixels[r + 1]);
            [shifted(a, 0), shifted(a, 1), shifted(b, 0), shifted(b, 1)]
        };
        sample_row(rows(0), w, &mut above);
        sample_row(rows(1), w, &mut here);
        let [mut smooth, mut slope] = [[0.0f32; W]; 2];
        let (values, gx, gy) =
            (self.values.as_chunks_mut::<S>().0, self.gx.as_chunks_mut::<S>().0, self.gy.as_chunks_mut::<S>().0);
        for (r, ((values, gx), gy)) in values.iter_mut().zip(&mut *gx).zip(&mut *gy).enumerate() {
            sample_row(rows(r + 2), w, &mut below);
            values.copy_from_slice(&here[1..=S]);
            down([&above, &here, &below], &mut smooth, &mut slope);
            let slopes = [shifted(&slope, 0), shifted(&slope, 1), shifted(&slope, 2)];
            along([shifted(&smooth, 0), shifted(&smooth, 2)], slopes, gx, gy);
            gx[window..].fill(0.0);
            gy[window..].fill(0.0);
            (above, here) = (here, below);
        }
        let [x, y, xx, xy, yy] = gradient_moments(gx, gy);
        let n = (window * window) as f64;
        let (mean_x, mean_y) = ((x / n) as f32, (y / n) as f32);
        for (gx, gy) in gx.iter_mut().zip(gy) {
            gx[..window].iter_mut().for_each(|it| *it -= mean_x);
            gy[..window].iter_mut().for_each(|it| *it -= mean_y);
        }
        self.tensor = Matrix2::new(xx - x * x / n, xy - x * y / n, xy - x * y / n, yy - y * y / n);
        self.inverse = self.tensor.try_inverse().unwrap_or_else(Matrix2::zeros);
    }

    /// The root of the smaller eigenvalue of the tensor, per pixel [gray level/px].
    pub(super) fn texture(&self) -> f64 {
        let (half, det) = (self.tensor.trace() / 2.0, self.tensor.determinant());
        let least = half - (half * half - det).max(0.0).sqrt();
        // An exactly singular tensor may come out a little positive, and has no inverse.
        if self.inverse.iter().all(|it| *it == 0.0) {
            return 0.0;
        }
        (least.max(0.0) / (self.window * self.window) as f64).sqrt()
    }

    /// The way from `at` to where the patch fits better, at most half a window [px].
    pub(super) fn step(&self, view: &ImageView<'_>, at: Point2<f64>, region: &mut Region) -> Vector2<f64> {
        let sums = match self.stride {
            8 => self.mismatch::<8>(view, at, region),
            16 => self.mismatch::<16>(view, at, region),
            24 => self.mismatch::<24>(view, at, region),
            _ => self.mismatch::<32>(view, at, region),
        };
        let step = -(self.inverse * Vector2::from(sums));
        let limit = self.window as f64 / 2.0;
        step.cap_magnitude(limit)
    }

    /// Σ (J − I) ∇I, with S = `stride`.
    fn mismatch<const S: usize>(&self, view: &ImageView<'_>, at: Point2<f64>, region: &mut Region) -> [f64; 2] {
        let half = (self.window / 2) as isize;
        let ((x, fx), (y, fy)) = (split(at.x), split(at.y));
        let place = region.reach(view, [x - half, y - half], S, self.window);
        let w = bilinear(fx, fy).map(Lanes::all);
        // Twice, so that one sum need not wait for the other.
        let mut sums = [[Lanes::default(); 2]; 2];
        let (values, gx, gy) = (self.values.as_chunks::<S>().0, self.gx.as_chunks::<S>().0, self.gy.as_chunks::<S>().0);
        for ((r, values), (gx, gy)) in values.iter().enumerate().zip(gx.iter().zip(gy)) {
            let rows = quad::<S>(&region.pixels[place + r * (S + SLACK)..]);
            for k in (0..S).step_by(lanes::N) {
                let difference = sample(rows, w, k) - Lanes::load(values, k);
                let [x, y] = &mut sums[k / lanes::N % 2];
                *x += difference * Lanes::load(gx, k);
                *y += difference * Lanes::load(gy, k);
            }
        }
        let [[x, y], [x1, y1]] = sums;
        [(x + x1).sum(), (y + y1).sum()]
    }

    /// How well the patch fits at `at`.
    pub(super) fn fit(&self, view: &ImageView<'_>, at: Point2<f64>, region: &mut Region) -> Fit {
        let [i, j, ii, jj, ij] = match self.stride {
            8 => self.moments::<8>(view, at, region),
            16 => self.moments::<16>(view, at, region),
            24 => self.moments::<24>(view, at, region),
            _ => self.moments::<32>(view, at, region),
        };
        let n = (self.window * self.window) as f64;
        let (vi, vj, cov) = (ii - i * i / n, jj - j * j / n, ij - i * j / n);
        let squares = (vi + vj - 2.0 * cov).max(0.0);
        let there = squares_of(bilinear(split(at.x).1, split(at.y).1));
        // Two for the place, one for the brightness; no pixel is known better than its rounding, in either picture.
        let variance = (squares / (n - 3.0) * 2.0 / (self.smoothing + there)).max(1.0 / 6.0);
        let product = (vi * vj).max(0.0).sqrt();
        Fit {
            covariance: self.inverse * variance,
            correlation: if product > 0.0 { (cov / product).clamp(-1.0, 1.0) } else { 0.0 },
            residual: (squares / n).sqrt(),
        }
    }

    /// Σ I, Σ J, Σ I², Σ J², Σ I J over the window, both about the patch's first value so that the squares keep their digits.
    fn moments<const S: usize>(&self, view: &ImageView<'_>, at: Point2<f64>, region: &mut Region) -> [f64; 5] {
        let half = (self.window / 2) as isize;
        let ((x, fx), (y, fy)) = (split(at.x), split(at.y));
        let place = region.reach(view, [x - half, y - half], S, self.window);
        let w = bilinear(fx, fy).map(Lanes::all);
        let about = Lanes::all(self.values[0]);
        let mut mask = [0.0f32; S];
        mask[..self.window].fill(1.0);
        let mut sums = [Lanes::default(); 5];
        for (r, values) in self.values.as_chunks::<S>().0.iter().enumerate() {
            let rows = quad::<S>(&region.pixels[place + r * (S + SLACK)..]);
            for k in (0..S).step_by(lanes::N) {
                let mask = Lanes::load(&mask, k);
                let i = mask * (Lanes::load(values, k) - about);
                let j = mask * (sample(rows, w, k) - about);
                sums[0] += i;
                sums[1] += j;
                sums[2] += i * i;
                sums[3] += j * j;
                sums[4] += i * j;
            }
        }
        sums.map(Lanes::sum)
    }
}

/// A row of what lies between the pixels of four.
#[inline(never)]
fn sample_row<const W: usize>(rows: [&[f32; W]; 4], w: [Lanes; 4], out: &mut [f32; W]) {
    for k in (0..W).step_by(lanes::N) {
        sample(rows, w, k).store(out, k);
    }
}

/// Scharr's operator, (3 10 3)/16 one way and (−1 0 1)/2 the other: here down the columns.
#[inline(never)]
fn down<const W: usize>(rows: [&[f32; W]; 3], smooth: &mut [f32; W], slope: &mut [f32; W]) {
    let (side, middle) = (Lanes::all(3.0 / 32.0), Lanes::all(10.0 / 32.0));
    for k in (0..W).step_by(lanes::N) {
        let (a, b, c) = (Lanes::load(rows[0], k), Lanes::load(rows[1], k), Lanes::load(rows[2], k));
        (side * (a + c) + middle * b).store(smooth, k);
        (c - a).store(slope, k);
    }
}

/// The same along the rows: each is given from its first pixel and from later ones.
#[inline(never)]
fn along<const S: usize>(smooth: [&[f32; S]; 2], slope: [&[f32; S]; 3], gx: &mut [f32; S], gy: &mut [f32; S]) {
    let (side, middle) = (Lanes::all(3.0 / 32.0), Lanes::all(10.0 / 32.0));
    for k in (0..S).step_by(lanes::N) {
        (Lanes::load(smooth[1], k) - Lanes::load(smooth[0], k)).store(gx, k);
        let (a, b, c) = (Lanes::load(slope[0], k), Lanes::load(slope[1], k), Lanes::load(slope[2], k));
        (side * (a + c) + middle * b).store(gy, k);
    }
}

/// Σ gx, Σ gy, Σ gx², Σ gx gy, Σ gy².
#[inline(never)]
fn gradient_moments<const S: usize>(gx: &[[f32; S]], gy: &[[f32; S]]) -> [f64; 5] {
    let [mut sum_x, mut sum_y, mut xx, mut xy, mut yy] = [Lanes::default(); 5];
    for (gx, gy) in gx.iter().zip(gy) {
        for k in (0..S).step_by(lanes::N) {
            let (x, y) = (Lanes::load(gx, k), Lanes::load(gy, k));
            sum_x += x;
            sum_y += y;
            xx += x * x;
            xy += x * y;
            yy += y * y;
        }
    }
    [sum_x, sum_y, xx, xy, yy].map(Lanes::sum)
}

/// What lies between the pixels of four rows, from column `k` on.
#[inline(always)]
fn sample<const S: usize>([a, a1, b, b1]: [&[f32; S]; 4], w: [Lanes; 4], k: usize) -> Lanes {
    let (a, a1) = (Lanes::load(a, k), Lanes::load(a1, k));
    let (b, b1) = (Lanes::load(b, k), Lanes::load(b1, k));
    (w[0] * a + w[1] * a1) + (w[2] * b + w[3] * b1)
}

/// Rows of `S` pixels here, one to the right, one below, and both.
#[inline]
fn quad<const S: usize>(pixels: &[f32]) -> [&[f32; S]; 4] {
    [shifted(pixels, 0), shifted(pixels, 1), shifted(pixels, S + SLACK), shifted(pixels, S + SLACK + 1)]
}

/// `S` pixels from `start` on.
#[inline]
fn shifted<const S: usize>(pixels: &[f32], start: usize) -> &[f32; S] {
    match pixels[start..].first_chunk::<S>() {
        Some(row) => row,
        None => unreachable!("a region holds its window and one pixel more"),
    }
}
