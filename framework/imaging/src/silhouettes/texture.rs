//! Whether windows of a picture are the background in another light: by their texture, and by their colour.
//!
//! A shadow changes the light of what it falls on; it leaves its texture and its colour. One pixel says little of either, a window much. Over a window of n pixels, with values I and means E
//! of channel c and their standard deviation σ:
//!
//! | here | meaning | unit |
//! |---|---|---|
//! | `alpha` | α, Σ I E/σ² / Σ E²/σ² over all channels: the light that the window has kept | – |
//! | a_c | the same of channel c alone, held within a tenth of α: light in a shadow comes from elsewhere, and has another colour | – |
//! | `fit` | Σ (I − a_c E)²/σ² / (3 n − 1): about 1 where nothing but noise is off | – |
//!
//! A pixel has the fit of the best of the windows that hold it (M. Nagao, T. Matsuyama, "Edge preserving smoothing", CGIP 9(4), 1979), so that outlines stay where they are. That the ratio of picture and
//! background hardly varies over a window tells shadows as in J. C. S. Jacques Jr., C. R. Jung, S. R. Musse, "Background subtraction and shadow detection in grayscale video sequences", SIBGRAPI 2005; here colour counts, too, and what a ratio may vary by
//! follows from the noise.
//!
//! Where light changes within a square, on the rim of a shadow, no window that holds it fits: it is background if windows to both sides fit, and its own light lies between theirs.
//!
//! Windows are 6 × 6 pixels large, two apart: sums of 2 × 2 pixels are made once.

use std::ops::Range;

use super::light::Gains;
use super::model::{BLOCK, CHANNELS, Model, SATURATED};

/// Edge of the squares that windows are made of [px], and of windows in squares.
const SQUARE: usize = 2;
const WINDOW: usize = 3;
/// Squares that a window, and the best one of a square, reach to.
const REACH: usize = WINDOW / 2;
/// Sums kept of each square: I E/σ² and E²/σ² of each channel, I²/σ² of all.
const SUMS: usize = 2 * CHANNELS + 1;
/// How much a channel's light may be off that of all [–].
const TINT: f32 = 0.1;
/// Lights of two windows that differ by more than this are those of two sides of a shadow's rim [–].
const RIM: f32 = 0.1;
/// From so far between what is usual and the limit on it is asked whether a square lies on one [–].
const RIM_FROM: f32 = 0.5;
/// Squares between a square on a rim and the middle of a window beside it: a window that does not hold it.
const BESIDE_RIM: usize = REACH + 1;
/// Less than this is not put down: it teaches as plain background does.
const NOTICED: f32 = 0.25;
/// Rows of a cell, which is a block wide: where windows are looked at, and where not [px].
const ROWS: usize = 16;
/// Pixels of a cell that are off, at least, for it to be looked at: noise alone makes one, here and there.
const ENOUGH: u16 = 3;
/// 3 n − 1 of a window.
const FREE: f32 = (CHANNELS * SQUARE * SQUARE * WINDOW * WINDOW - 1) as f32;
/// Steps of the histogram of fits.
const STEP: f32 = 1.0 / 128.0;
const STEPS: usize = 128 * 16;
/// The limit of the empty scene is no less than so many times the median; and no more, for what passes while learning.
const HELD: [f32; 2] = [1.2, 3.0];
/// How many times that is the limit beside a body, which throws light about and makes a coder ring: chosen on seeds 2 to 4 of `graphs/voxel_pictures.toml`, where 2 to 5 hardly differ.
const BESIDE: f32 = 3.0;
/// Of Gaussian noise: the median of the best fit, and what 99.99 % lie below; with one picture as background nothing else is known.
const GAUSSIAN: [f32; 2] = [0.85, 1.3];

/// Fits of one background's pictures; keeps its memory.
#[derive(Debug, Clone)]
pub(super) struct Texture {
    /// The median of the background's fits, and their limit.
    usual: f32,
    limit: f32,
    /// Cells along a row of the picture; of each, how many pixels in it are off by more than noise, and how many are body.
    columns: usize,
    n_off: Vec<u16>,
    n_body: Vec<u16>,
    is_near: Vec<bool>,
    /// One row of the picture: the gain of each byte, products of each byte over two rows.
    gains: Vec<f32>,
    products: [Vec<f32>; 3],
    /// Of a strip of squares: the sums, those over three rows, fit and light of windows, the least fits of three rows, the best ones.
    sums: [Vec<f32>; SUMS],
    tall: [Vec<f32>; SUMS],
    fits: Vec<f32>,
    alphas: Vec<f32>,
    least: Vec<f32>,
    best: Vec<f32>,
}

/// Squares, columns and rows, of the picture.
#[derive(Debug, Clone, PartialEq)]
struct Strip {
    columns: Range<usize>,
    rows: Range<usize>,
}

impl Strip {
    /// With `by` more to all sides, as far as there are any.
    fn grown(&self, by: usize, [columns, rows]: [usize; 2]) -> Strip {
        let grown = |of: &Range<usize>, n: usize| of.start.saturating_sub(by)..(of.end + by).min(n);
        Strip { columns: grown(&self.columns, columns), rows: grown(&self.rows, rows) }
    }
}

impl Texture {
    /// For pictures of this size.
    pub fn new(width: usize, height: usize) -> Texture {
        let n = width.div_ceil(BLOCK) * height.div_ceil(ROWS);
        Texture {
            usual: GAUSSIAN[0],
            limit: BESIDE * GAUSSIAN[1],
            columns: width.div_ceil(BLOCK),
            n_off: vec![0; n],
            n_body: vec![0; n],
            is_near: vec![false; n],
            gains: Vec::new(),
            products: Default::default(),
            sums: Default::default(),
            tall: Default::default(),
            fits: Vec::new(),
            alphas: Vec::new(),
            least: Vec::new(),
            best: Vec::new(),
        }
    }

    /// The limit below which `rate` of the background's pixels lie, from pictures of it that `model` was learnt from.
    pub fn learn(&mut self, pictures: &[Vec<u8>], model: &Model, rate: f32) {
        let known: Vec<[f32; 2]> =
            pictures.iter().map(|it| self.fits_of(it, model, |_, _| [1.0; CHANNELS], rate)).collect();
        // The samples lie closer to a mean that is theirs than other pictures will.
        let n = pictures.len() as f32;
        let unseen = if n > 1.0 { (n + 1.0) / (n - 1.0) } else { 1.0 };
        self.take(&known, unseen);
    }

    /// The fit of the median square of a picture, and that below which `rate` of them lie.
    pub fn fits_of(
        &mut self,
        picture: &[u8],
        model: &Model,
        light: impl Fn(usize, usize) -> Gains,
        rate: f32,
    ) -> [f32; 2] {
        let size = squares(model);
        let all = Strip { columns: 0..size[0], rows: 0..size[1] };
        self.measure(picture, model, light, &all);
        let mut counts = vec![0u32; STEPS];
        for it in &self.best {
            counts[((it / STEP) as usize).min(STEPS - 1)] += 1;
        }
        [0.5, rate].map(|rate| {
            let n = (rate * self.best.len() as f32).ceil().max(1.0) as u32;
            let mut below = 0;
            let at = counts.iter().position(|it| {
                below += it;
                below >= n
            });
            (at.unwrap_or(STEPS - 1) + 1) as f32 * STEP
        })
    }

    /// What is usual, and its limit, from [`Self::fits_of`] several pictures; others fit `unseen` times as badly.
    pub fn take(&mut self, known: &[[f32; 2]], unseen: f32) {
        let middle = |axis: usize| {
            let mut of: Vec<f32> = known.iter().map(|it| it[axis]).collect();
            of.sort_by(f32::total_cmp);
            of.get(of.len() / 2).copied().unwrap_or(GAUSSIAN[axis])
        };
        self.usual = middle(0) * unseen;
        self.limit = BESIDE * (middle(1) * unseen).clamp(HELD[0] * self.usual, HELD[1] * self.usual);
    }

    /// Nothing is known of the background's noise.
    pub fn reset(&mut self) {
        [self.usual, self.limit] = [GAUSSIAN[0], BESIDE * GAUSSIAN[1]];
    }

    /// Begins a picture: nothing is off.
    pub fn begin(&mut self) {
        self.n_off.fill(0);
        self.n_body.fill(0);
    }

    /// In a block of pixels that begins at `x`, `y` so many are off by more than noise, and so many are body.
    pub fn doubt(&mut self, x: usize, y: usize, n_off: u16, n_body: u16) {
        let at = y / ROWS * self.columns + x / BLOCK;
        self.n_off[at] += n_off;
        self.n_body[at] += n_body;
    }

    /// Calls `put` with a row, columns and f² for all pixels near those that are off whose texture or colour is further from the background's than usual; f is 1 on the limit.
    pub fn look(
        &mut self,
        rgb: &[u8],
        model: &Model,
        light: impl Fn(usize, usize) -> Gains,
        mut put: impl FnMut(usize, Range<usize>, f32),
    ) {
        let size = squares(model);
        if size[0] < WINDOW || size[1] < WINDOW {
            return;
        }
        self.spread();
        for row in 0..model.height.div_ceil(ROWS) {
            let mut column = 0;
            while column < self.columns {
                let first = column;
                while column < self.columns && self.is_near[row * self.columns + column] {
                    column += 1;
                }
                if column == first {
                    column += 1;
                    continue;
                }
                let per_row = ROWS / SQUARE;
                let per_block = BLOCK / SQUARE;
                let strip = Strip {
                    columns: first * per_block..(column * per_block).min(size[0]),
                    rows: row * per_row..((row + 1) * per_row).min(size[1]),
                };
                self.measure(rgb, model, &light, &strip);
                let per_fit = 1.0 / (self.limit - self.usual);
                for (y, fits) in strip.rows.clone().zip(self.best.chunks_exact(strip.columns.len())) {
                    for (x, fit) in strip.columns.clone().zip(fits) {
                        let off = (fit - self.usual) * per_fit;
                        if off > NOTICED {
                            let columns = SQUARE * x..(SQUARE * (x + 1)).min(model.width);
                            for y in SQUARE * y..(SQUARE * (y + 1)).min(model.height) {
                                put(y, columns.clone(), off * off);
                            }
                        }
                    }
                }
            }
        }
    }

    /// Cells with pixels that are off, or next to such, and not body all over.
    fn spread(&mut self) {
        let Self { columns, n_off, is_near, n_body, .. } = self;
        let columns = *columns;
        let rows = n_off.len() / columns;
        for row in 0..rows {
            for column in 0..columns {
                let at = row * columns + column;
                let around = |y: usize| {
                    (column.saturating_sub(1)..(column + 2).min(columns)).any(|x| n_off[y * columns + x] >= ENOUGH)
                };
                is_near[at] =
                    usize::from(n_body[at]) < BLOCK * ROWS && (row.saturating_sub(1)..(row + 2).min(rows)).any(around);
            }
        }
    }

    /// Fills `best` with the best fit of each square of a strip.
    fn measure(&mut self, rgb: &[u8], model: &Model, light: impl Fn(usize, usize) -> Gains, strip: &Strip) {
        let size = squares(model);
        let windows = strip.grown(BESIDE_RIM, size);
        let wide = windows.grown(REACH, size);
        self.add_up(rgb, model, light, &wide);
        let n = wide.columns.len();
        self.fits.clear();
        self.fits.resize(n * windows.rows.len(), f32::INFINITY);
        self.alphas.clear();
        self.alphas.resize(n * windows.rows.len(), 1.0);
        for (at, row) in windows.rows.clone().enumerate() {
            if row < REACH || row + REACH >= size[1] {
                continue;
            }
            let first = (row - REACH - wide.rows.start) * n;
            for (tall, sums) in self.tall.iter_mut().zip(&self.sums) {
                tall.clear();
                let rows = sums[first..].iter().zip(&sums[first + n..]).zip(&sums[first + 2 * n..]);
                tall.extend(rows.take(n).map(|((a, b), c)| a + b + c));
            }
            let of_row = at * n..(at + 1) * n;
            fit_row(&self.tall, &mut self.fits[of_row.clone()], &mut self.alphas[of_row]);
        }
        self.best.clear();
        let (skipped_columns, skipped_rows) =
            (strip.columns.start - wide.columns.start, strip.rows.start - windows.rows.start);
        let doubtful = self.usual + RIM_FROM * (self.limit - self.usual);
        for row in 0..strip.rows.len() {
            let middle = row + skipped_rows;
            let rows = middle.saturating_sub(REACH)..(middle + REACH + 1).min(windows.rows.len());
            // Beyond the strip on both sides there is nothing that fits.
            self.least.clear();
            self.least.resize(n + 2 * REACH, f32::INFINITY);
            for row in rows {
                let fits = &self.fits[row * n..(row + 1) * n];
                let least = &mut self.least[REACH..REACH + n];
                least.iter_mut().zip(fits).for_each(|(least, fit)| *least = if *fit < *least { *fit } else { *least });
            }
            let least = &self.least[skipped_columns..];
            let best = least.iter().zip(&least[1..]).zip(&least[2..]).take(strip.columns.len());
            let start = self.best.len();
            self.best.extend(best.map(|((a, b), c)| a.min(*b).min(*c)));
            for column in 0..strip.columns.len() {
                let best = self.best[start + column];
                if best > doubtful {
                    let middle = [column + skipped_columns, middle];
                    let on_rim = self.on_rim(middle, n, row + strip.rows.start - wide.rows.start);
                    self.best[start + column] = best.min(on_rim);
                }
            }
        }
    }

    /// The light of a square.
    fn alpha(&self, at: usize) -> f32 {
        let sum = |first: usize| (first..first + CHANNELS).map(|it| self.sums[it][at]).sum::<f32>();
        sum(0) / sum(CHANNELS).max(NOTHING)
    }

    /// The fit of a square on a rim, `middle` column and row among windows of `n` a row, `row` among the sums: the worse one of two windows near it that fit best, a darker and a brighter one.
    fn on_rim(&self, [column, middle]: [usize; 2], n: usize, row: usize) -> f32 {
        let alpha = self.alpha(row * n + column);
        let (mut darker, mut brighter) = ((f32::INFINITY, alpha), (f32::INFINITY, alpha));
        let near = |at: usize, n: usize| at.saturating_sub(BESIDE_RIM)..(at + BESIDE_RIM + 1).min(n);
        for row in near(middle, self.fits.len() / n) {
            for at in near(column, n).map(|it| row * n + it) {
                let (fit, light) = (self.fits[at], self.alphas[at]);
                if light <= alpha && fit < darker.0 {
                    darker = (fit, light);
                }
                if light >= alpha && fit < brighter.0 {
                    brighter = (fit, light);
                }
            }
        }
        if brighter.1 - darker.1 > RIM { darker.0.max(brighter.0) } else { f32::INFINITY }
    }

    /// The sums of each square of a strip.
    fn add_up(&mut self, rgb: &[u8], model: &Model, light: impl Fn(usize, usize) -> Gains, strip: &Strip) {
        let Self { sums, products, gains, .. } = self;
        sums.iter_mut().for_each(Vec::clear);
        let columns = SQUARE * strip.columns.start..(SQUARE * strip.columns.end).min(model.width);
        for row in strip.rows.clone() {
            products.iter_mut().for_each(|it| {
                it.clear();
                // An odd picture's last square is half as wide.
                it.resize(strip.columns.len() * SQUARE * CHANNELS, 0.0);
            });
            gains.resize(columns.len().next_multiple_of(BLOCK) * CHANNELS, 1.0);
            for (block, gains) in gains.chunks_exact_mut(BLOCK * CHANNELS).enumerate() {
                let middle = (columns.start + block * BLOCK + BLOCK / 2).min(model.width - 1);
                let gain = light(middle, SQUARE * row);
                gains.chunks_exact_mut(CHANNELS).for_each(|it| it.copy_from_slice(&gain));
            }
            for y in SQUARE * row..(SQUARE * (row + 1)).min(model.height) {
                let first = (y * model.width + columns.start) * CHANNELS;
                let bytes = first..first + columns.len() * CHANNELS;
                let known = model.mean[bytes.clone()].iter().zip(&model.variance[bytes.clone()]).zip(&*gains);
                let [both, means, values] = &mut *products;
                let sums = both.iter_mut().zip(means).zip(values);
                for ((value, ((mean, variance), gain)), ((both, means), values)) in
                    rgb[bytes].iter().zip(known).zip(sums)
                {
                    let (value, mean) = (f32::from(*value), mean * gain);
                    let weight = if value < SATURATED { 1.0 / variance } else { 0.0 };
                    let weighted = weight * mean;
                    *both += weighted * value;
                    *means += weighted * mean;
                    *values += weight * value * value;
                }
            }
            let [both, means, values] = &*products;
            for at in (0..strip.columns.len()).map(|it| it * SQUARE * CHANNELS) {
                for c in 0..CHANNELS {
                    sums[c].push(both[at + c] + both[at + CHANNELS + c]);
                    sums[CHANNELS + c].push(means[at + c] + means[at + CHANNELS + c]);
                }
                sums[2 * CHANNELS].push(values[at..at + SQUARE * CHANNELS].iter().sum());
            }
        }
    }
}

/// Less than this is a sum of nothing.
const NOTHING: f32 = 1e-6;

/// Fit and light of each window whose middle lies in a row, from sums over its rows; those that reach beyond the row stay as they are.
fn fit_row(tall: &[Vec<f32>; SUMS], fits: &mut [f32], alphas: &mut [f32]) {
    let n = fits.len();
    if n < WINDOW {
        return;
    }
    let [r, g, b, rr, gg, bb, all] = tall.each_ref().map(|it| &it[..n]);
    let alphas = &mut alphas[..n];
    for at in 0..n - 2 * REACH {
        let sum = |of: &[f32]| of[at] + of[at + 1] + of[at + 2];
        let (both, means) = ([sum(r), sum(g), sum(b)], [sum(rr), sum(gg), sum(bb)]);
        let total = means[0] + means[1] + means[2];
        let alpha = (both[0] + both[1] + both[2]) / if total > NOTHING { total } else { NOTHING };
        let (least, most) = (alpha * (1.0 - TINT), alpha * (1.0 + TINT));
        let mut off = sum(all);
        for c in 0..CHANNELS {
            let own = both[c] / if means[c] > NOTHING { means[c] } else { NOTHING };
            let own = if own > least { own } else { least };
            let own = if own < most { own } else { most };
            off += own * (own * means[c] - 2.0 * both[c]);
        }
        fits[at + REACH] = if off > 0.0 { off / FREE } else { 0.0 };
        alphas[at + REACH] = alpha;
    }
}

/// Squares along both axes of the picture.
fn squares(model: &Model) -> [usize; 2] {
    [model.width.div_ceil(SQUARE), model.height.div_ceil(SQUARE)]
}
