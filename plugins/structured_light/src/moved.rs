//! Detects changes during a static code.
//!
//! Whatever a bit shows, it and its inverse together are as bright as white and black together; so is twice the mean of the steps of a phase shift. Where they are not, something has moved
//! between these pictures, or a lamp has changed.

use foveate::imaging::ImageView;
use foveate::imaging::stripes::code::{Axis, Shown, StripeCode};
use foveate::imaging::stripes::noise::noise;

/// Side of the means, and of a block in means [px].
const BIN: usize = 4;
const BINS: usize = 4;
/// A mean counts where white is brighter than black by this, and no pixel of it is saturated [gray level].
const LIT: f32 = 16.0;
const SATURATED: u8 = 250;
/// A block counts with at least this many means.
const LEAST_BINS: usize = 6;
/// Bit + inverse − white − black of noise σ has a variance of 4 σ² / 16 in means of 4 × 4 px. Over a block of 16 of them its mean square is 3 times that once in 10⁵ blocks (χ²), over
/// one of 6 of them 5 times.
const NOISE_SQUARE: f32 = 5.0 * 4.0 / 16.0;

/// Parts of the picture in which something moved during a set.
pub(crate) struct Blocks {
    /// Left column and top row [px].
    pub moved: Vec<[usize; 2]>,
    /// Blocks that the projector lights.
    pub n_lit: usize,
    /// Pictures that belong together, by their places in the code, each with the number of blocks in which they tell of motion.
    pub by_pictures: Vec<(Vec<usize>, usize)>,
}

impl Blocks {
    /// Of a set whose picture k is `pictures[k]`; nothing has moved in a block where the root mean square of what is compared is at most `max_change` and that part of what white
    /// and black together are [gray level, –], beyond noise.
    pub fn of(code: &StripeCode, pictures: &[ImageView<'_>], [max_change, max_share]: [f32; 2]) -> Blocks {
        let (width, height) = pictures.first().map_or((0, 0), |it| (it.width(), it.height()));
        let picture = |index: usize| pictures.get(index).map(ImageView::pixels).unwrap_or_default();
        let [columns, rows] = [width / BIN, height / BIN];
        let means = |index: usize| -> Vec<f32> {
            let pixels = picture(index);
            let mut sums = vec![0_u32; columns * rows];
            for (y, row) in pixels.chunks_exact(width).take(rows * BIN).enumerate() {
                let sums = &mut sums[y / BIN * columns..][..columns];
                for (sum, pixels) in sums.iter_mut().zip(row.chunks_exact(BIN)) {
                    *sum += pixels.iter().map(|it| u32::from(*it)).sum::<u32>();
                }
            }
            sums.iter().map(|it| *it as f32 / (BIN * BIN) as f32).collect()
        };
        let mut found = Blocks { moved: Vec::new(), n_lit: 0, by_pictures: Vec::new() };
        let (Some(white_at), Some(black_at)) = (code.place(Shown::White), code.place(Shown::Black)) else {
            return found;
        };
        let (white, black) = (means(white_at), means(black_at));
        let bright = picture(white_at);
        let saturated = |bin: usize| {
            let (x, y) = (bin % columns * BIN, bin / columns * BIN);
            (0..BIN).any(|dy| bright[(y + dy) * width + x..][..BIN].iter().any(|it| *it >= SATURATED))
        };
        let counts: Vec<bool> = (0..white.len()).map(|it| white[it] - black[it] >= LIT && !saturated(it)).collect();
        let both: Vec<f32> = white.iter().zip(&black).map(|(a, b)| a + b).collect();
        // The largest mean square of any pair, by block.
        let across = columns.div_ceil(BINS);
        let mut worst = vec![0.0_f32; across * rows.div_ceil(BINS)];
        let sigma = [white_at, black_at].map(|it| pictures.get(it).map_or(0.0, |it| noise(it) as f32));
        let limit = max_change * max_change + NOISE_SQUARE * sigma[0].max(sigma[1]).powi(2);
        let mut by_pictures = Vec::new();
        let mut compare = |sum: &[f32], pictures: Vec<usize>| {
            let mut n_changed = 0;
            let mut squares = vec![(0.0_f32, 0_usize); worst.len()];
            for (at, sum) in sum.iter().enumerate().filter(|it| counts[it.0]) {
                let block = at / columns / BINS * across + at % columns / BINS;
                let off = ((sum - both[at]).abs() - max_share * both[at]).max(0.0);
                squares[block].0 += off * off;
                squares[block].1 += 1;
            }
            for (worst, (square, n)) in worst.iter_mut().zip(squares) {
                if n >= LEAST_BINS {
                    n_changed += usize::from(square / n as f32 > limit);
                    // A block that counts is never 0: it tells those from the others.
                    *worst = worst.max((square / n as f32).max(f32::MIN_POSITIVE));
                }
            }
            by_pictures.push((pictures, n_changed));
        };
        for axis in Axis::BOTH.into_iter().filter(|it| code.has(*it)) {
            for plane in 0..code.bits[axis.index()] {
                let place = |inverse: bool| code.place(Shown::Bit { axis, plane, inverse });
                if let (Some(bit), Some(inverse)) = (place(false), place(true)) {
                    let sum: Vec<f32> = means(bit).iter().zip(means(inverse)).map(|(a, b)| a + b).collect();
                    compare(&sum, vec![bit, inverse]);
                }
            }
            let steps: Vec<usize> =
                (0..code.steps).filter_map(|step| code.place(Shown::Phase { axis, step })).collect();
            if steps.is_empty() {
                continue;
            }
            let mut sum = vec![0.0; both.len()];
            for step in &steps {
                sum.iter_mut().zip(means(*step)).for_each(|(sum, it)| *sum += it * 2.0 / steps.len() as f32);
            }
            // A projector of another gamma makes the mean of a sine wave another part of its light, the same everywhere.
            let part = |it: usize| (0.5 * sum[it] - black[it]) / (white[it] - black[it]);
            let mut parts: Vec<f32> = (0..sum.len()).filter(|it| counts[*it]).map(part).collect();
            parts.sort_by(f32::total_cmp);
            if let Some(part) = parts.get(parts.len() / 2) {
                let less = 1.0 - 2.0 * part;
                sum.iter_mut()
                    .zip(white.iter().zip(&black))
                    .for_each(|(sum, (white, black))| *sum += less * (white - black));
                compare(&sum, steps);
            }
        }
        by_pictures.retain(|it| it.1 > 0);
        found.by_pictures = by_pictures;
        for (block, worst) in worst.into_iter().enumerate().filter(|it| it.1 > 0.0) {
            found.n_lit += 1;
            if worst > limit {
                found.moved.push([block % across, block / across].map(|it| it * BINS * BIN));
            }
        }
        found
    }

    /// Calls `each` with the pixels of every row of every block in which something moved: row, first column, column after the last.
    pub fn each_row(&self, [width, height]: [usize; 2], mut each: impl FnMut(usize, usize, usize)) {
        for [left, top] in &self.moved {
            for row in *top..(top + BINS * BIN).min(height) {
                each(row, *left, (left + BINS * BIN).min(width));
            }
        }
    }

    /// The pictures that tell most of it, by their places in the code: those of pairs with at least half as many blocks as the worst.
    pub fn pictures(&self) -> Vec<usize> {
        let most = self.by_pictures.iter().map(|it| it.1).max().unwrap_or(0);
        let mut list: Vec<usize> =
            self.by_pictures.iter().filter(|it| 2 * it.1 >= most).flat_map(|it| it.0.iter().copied()).collect();
        list.sort_unstable();
        list
    }

    /// Blocks in which something moved over those that the projector lights.
    pub fn share(&self) -> f64 {
        self.moved.len() as f64 / self.n_lit.max(1) as f64
    }
}
