//! One group of connected lit pixels: which they are, their shape, their centre and its covariance.

use std::ops::Range;

use nalgebra::{Matrix2, Point2, Vector2};

use super::{Centroid, Measure, Spot};

/// The picture and its thresholds, of the same size.
#[derive(Clone, Copy)]
pub(crate) struct Frame<'a> {
    pub pixels: &'a [u8],
    pub thresholds: &'a [u8],
    pub width: usize,
    pub height: usize,
    /// Added to each threshold [gray level].
    pub raised: u8,
}

impl Frame<'_> {
    pub fn lit(&self, index: usize) -> bool {
        self.pixels[index] > self.threshold(index)
    }

    /// By how much a pixel exceeds its threshold [gray level].
    pub fn excess(&self, index: usize) -> u8 {
        self.pixels[index].saturating_sub(self.threshold(index))
    }

    fn threshold(&self, index: usize) -> u8 {
        self.thresholds[index].saturating_add(self.raised)
    }
}

/// Neighbouring lit pixels of one row: columns `x0..x1` of row `y`.
#[derive(Clone, Copy)]
pub(crate) struct Run {
    pub y: usize,
    pub x0: usize,
    pub x1: usize,
}

/// Area moments of a group, relative to the pixel where it was met.
#[derive(Clone, Copy)]
pub(crate) struct Shape {
    pub area: u64,
    /// First and last column and row.
    pub bounds: [usize; 4],
    /// First pixel in scan order: (row, column).
    pub first: (usize, usize),
    pub peak: u8,
    /// Mean position of the lit pixels [px].
    pub mean: Point2<f64>,
    /// Second moments of the lit pixels, taken as squares, about their mean, over their number [px²].
    pub moment: Matrix2<f64>,
    pub elongation: f64,
}

/// Buffers for taking one group after the other out of a picture.
#[derive(Default)]
pub(crate) struct Component {
    /// One bit a pixel: belongs to a group of this picture that has been taken. Bits, because these stay in the
    /// nearest cache while pictures pass through it.
    taken: Vec<u64>,
    /// All runs of this picture, in the order in which they were taken.
    runs: Vec<Run>,
    /// Where those of the last group begin; sorted by row, then column, once the group is complete.
    first_run: usize,
    /// Columns of one row, for [`Component::weighted`].
    spans: Vec<(usize, usize)>,
}

impl Component {
    /// Forgets the groups of the last picture, in time proportional to their pixels.
    pub fn begin(&mut self, n_pixels: usize, width: usize) {
        let n_words = n_pixels.div_ceil(64);
        if self.taken.len() == n_words && self.runs.len() < n_words {
            for run in &self.runs {
                let words = (run.y * width + run.x0) / 64..=(run.y * width + run.x1 - 1) / 64;
                self.taken[words].fill(0);
            }
        } else {
            self.taken.clear();
            self.taken.resize(n_words, 0);
        }
        self.runs.clear();
    }

    /// Whether the lit pixel belongs to a group of this picture that has been taken already.
    pub fn taken(&self, index: usize) -> bool {
        self.taken[index / 64] >> (index % 64) & 1 == 1
    }

    /// The same for the 16 pixels from `index` on, the lowest bit for the first.
    pub fn taken_bits(&self, index: usize) -> u16 {
        let (word, shift) = (index / 64, index % 64);
        let next = self.taken.get(word + 1).copied().unwrap_or(0);
        let both = u128::from(self.taken[word]) | u128::from(next) << 64;
        (both >> shift) as u16
    }

    /// Takes all lit pixels connected to the lit pixel (x, y), over sides and corners.
    pub fn take(&mut self, frame: &Frame, x: usize, y: usize) -> Shape {
        self.first_run = self.runs.len();
        let mut next = self.first_run;
        self.take_run(frame, x, y);
        while next < self.runs.len() {
            let Run { y, x0, x1 } = self.runs[next];
            next += 1;
            for row in [y.wrapping_sub(1), y + 1] {
                if row >= frame.height {
                    continue; // the row above the first has wrapped
                }
                let end = (x1 + 1).min(frame.width);
                let mut x = x0.saturating_sub(1);
                while x < end {
                    let index = row * frame.width + x;
                    x = if frame.lit(index) && !self.taken(index) { self.take_run(frame, x, row) } else { x + 1 };
                }
            }
        }
        self.runs[self.first_run..].sort_unstable_by_key(|it| (it.y, it.x0));
        self.shape(frame, x, y)
    }

    /// All runs of this picture; those of the group taken last are the last, sorted by row, then column.
    pub fn runs(&self) -> &[Run] {
        &self.runs
    }

    /// The runs of the group taken last, sorted by row, then column.
    pub fn last_runs(&self) -> &[Run] {
        &self.runs[self.first_run..]
    }

    /// Takes the lit pixels to both sides of the lit pixel (x, y); returns the column after the last.
    fn take_run(&mut self, frame: &Frame, x: usize, y: usize) -> usize {
        let row = y * frame.width..(y + 1) * frame.width;
        let (mut x0, mut x1) = (x, x + 1);
        while x0 > 0 && frame.lit(row.start + x0 - 1) {
            x0 -= 1;
        }
        while x1 < frame.width && frame.lit(row.start + x1) {
            x1 += 1;
        }
        self.mark(row.start + x0, row.start + x1);
        self.runs.push(Run { y, x0, x1 });
        x1
    }

    /// Marks the pixels `start..end` as taken.
    fn mark(&mut self, start: usize, end: usize) {
        for word in start / 64..=(end - 1) / 64 {
            let from = start.saturating_sub(word * 64);
            let to = (end - word * 64).min(64);
            self.taken[word] |= (u64::MAX >> (64 - (to - from))) << from;
        }
    }

    /// Area moments of the runs taken last, met at (x, y).
    fn shape(&self, frame: &Frame, x: usize, y: usize) -> Shape {
        let (mut area, mut sum_x, mut sum_y, mut sum_xx, mut sum_xy, mut sum_yy) = (0i64, 0i64, 0i64, 0i64, 0i64, 0i64);
        let (mut bounds, mut first, mut peak) = ([x, y, x, y], (y, x), 0);
        for run in &self.runs[self.first_run..] {
            let n = (run.x1 - run.x0) as i64;
            let (a, dy) = (run.x0 as i64 - x as i64, run.y as i64 - y as i64);
            // Σ (a + k) and Σ (a + k)² for k in 0..n
            let s1 = n * a + n * (n - 1) / 2;
            let s2 = n * a * a + a * n * (n - 1) + (n - 1) * n * (2 * n - 1) / 6;
            area += n;
            sum_x += s1;
            sum_y += n * dy;
            sum_xx += s2;
            sum_xy += s1 * dy;
            sum_yy += n * dy * dy;
            bounds = [bounds[0].min(run.x0), bounds[1].min(run.y), bounds[2].max(run.x1 - 1), bounds[3].max(run.y)];
            first = first.min((run.y, run.x0));
            let start = run.y * frame.width;
            peak = frame.pixels[start + run.x0..start + run.x1].iter().fold(peak, |peak, &it| peak.max(it));
        }
        let n = area as f64;
        let mean = Vector2::new(sum_x as f64 / n, sum_y as f64 / n);
        let square = 1.0 / 12.0; // second moment of a pixel about its own centre
        let var_x = sum_xx as f64 / n - mean.x * mean.x + square;
        let var_y = sum_yy as f64 / n - mean.y * mean.y + square;
        let cov_xy = sum_xy as f64 / n - mean.x * mean.y;
        let (half_sum, half_gap) = ((var_x + var_y) / 2.0, (((var_x - var_y) / 2.0).powi(2) + cov_xy * cov_xy).sqrt());
        Shape {
            area: area as u64,
            bounds,
            first,
            peak,
            mean: Point2::new(x as f64 + mean.x, y as f64 + mean.y),
            moment: Matrix2::new(var_x, cov_xy, cov_xy, var_y),
            elongation: ((half_sum + half_gap) / (half_sum - half_gap)).max(1.0).sqrt(),
        }
    }

    /// The spot made of the pixels taken last, whose shape is `shape`.
    pub fn measure(&mut self, frame: &Frame, shape: &Shape, how: &Measure) -> Spot {
        let (centre, mut covariance, weight) = match how.centroid {
            Centroid::Weighted => self.weighted(frame, shape, how),
            Centroid::Integer => rounded(shape),
        };
        let [x0, y0, x1, y1] = shape.bounds;
        let cut = [x0 == 0 || x1 + 1 == frame.width, y0 == 0 || y1 + 1 == frame.height];
        for axis in 0..2 {
            if cut[axis] {
                // As much as is seen of the spot may be missing, which moves the centre by half of that.
                let extent = (shape.bounds[axis + 2] - shape.bounds[axis] + 1) as f64;
                covariance[(axis, axis)] += extent * extent / 4.0;
            }
        }
        Spot {
            centre,
            covariance,
            area: u32::try_from(shape.area).unwrap_or(u32::MAX),
            peak: shape.peak,
            bounds: shape.bounds.map(|it| it as u32),
            weight,
            touches_border: cut[0] || cut[1],
            elongation: shape.elongation,
        }
    }

    /// Centre, covariance and sum of the weights over the pixels taken last and all their neighbours.
    fn weighted(&mut self, frame: &Frame, shape: &Shape, how: &Measure) -> (Point2<f64>, Matrix2<f64>, f64) {
        let mut light = Sums::default();
        let mut noisy = Sums::default();
        let mut rim = 0;
        // Relative to the first column and row, so that the sums stay small and whole.
        let (origin_x, origin_y) = (shape.bounds[0] as i64, shape.bounds[1] as i64);
        let runs = &self.runs[self.first_run..];
        let mut near = 0; // the first run that reaches row y, or its neighbour above
        for y in shape.bounds[1].saturating_sub(1)..(shape.bounds[3] + 2).min(frame.height) {
            while near < runs.len() && runs[near].y + 1 < y {
                near += 1;
            }
            self.spans.clear();
            let reaching = runs[near..].iter().take_while(|it| it.y <= y + 1);
            self.spans.extend(reaching.map(|it| (it.x0.saturating_sub(1), (it.x1 + 1).min(frame.width))));
            self.spans.sort_unstable();
            let mut end = 0; // where spans overlap, each pixel counts once
            for &(x0, x1) in &self.spans {
                let x0 = x0.max(end);
                if x0 < x1 {
                    end = x1;
                    let row = y * frame.width + x0..y * frame.width + x1;
                    let (left, below) = (x0 as i64 - origin_x, y as i64 - origin_y);
                    rim += add_span(frame, row, how.foot, (left, below), &mut light, &mut noisy);
                }
            }
        }
        let weight = light.n as f64;
        let centre = Vector2::new(light.x as f64 / weight, light.y as f64 / weight);
        let spread = noisy.second_moment_about(centre);
        let noise = (how.pixel_sigma * how.pixel_sigma + 1.0 / 12.0) / (weight * weight);
        let mut covariance = spread * noise;
        let plateau = if shape.peak == 255 { PLATEAU / shape.area as f64 } else { 0.0 };
        for axis in 0..2 {
            // A rim about as far out as the bounds are has half of its square distance along each axis.
            let reach = (shape.bounds[axis + 2] - shape.bounds[axis] + 2) as f64 / 2.0;
            let flicker = RIM * rim as f64 * reach * reach / 2.0 / (weight * weight);
            covariance[(axis, axis)] += flicker + how.floor_px * how.floor_px + plateau * plateau;
        }
        (Point2::new(origin_x as f64 + centre.x, origin_y as f64 + centre.y), covariance, weight)
    }
}

/// Nearest whole pixel to the mean of the lit pixels, its covariance, and the area.
fn rounded(shape: &Shape) -> (Point2<f64>, Matrix2<f64>, f64) {
    let area = shape.area as f64;
    (shape.mean.map(f64::round), Matrix2::identity() * (1.0 / 12.0 + LIT_MEAN / area), area)
}

// Three constants fitted to rendered Gaussian spots; tests/golden/spot_error.txt shows what becomes of them.

/// Variance of the mean of the lit pixels, one axis, times their number [px⁴].
const LIT_MEAN: f64 = 0.25;
/// Variance of whether a pixel at the rim takes part, by the noise and by where the spot lies among the pixels.
const RIM: f64 = 0.015;
/// Error of the centre of a saturated spot, one axis, times its area [px³]: a plateau hides how its light lies.
const PLATEAU: f64 = 0.25;

/// Weighted moments up to the second, of whole numbers.
#[derive(Default)]
struct Sums {
    n: i64,
    x: i64,
    y: i64,
    xx: i64,
    xy: i64,
    yy: i64,
}

impl Sums {
    /// Σ w (x − c)(x − c)ᵀ.
    fn second_moment_about(&self, c: Vector2<f64>) -> Matrix2<f64> {
        let [n, x, y] = [self.n, self.x, self.y].map(|it| it as f64);
        let xx = self.xx as f64 - 2.0 * c.x * x + n * c.x * c.x;
        let xy = self.xy as f64 - c.x * y - c.y * x + n * c.x * c.y;
        let yy = self.yy as f64 - 2.0 * c.y * y + n * c.y * c.y;
        Matrix2::new(xx.max(0.0), xy, xy, yy.max(0.0))
    }
}

/// Adds the pixels at `row`, whose first lies at `(left, y)`: their weights to `light`, and a weight of 1 to `noisy` for
/// each that has a weight and is not saturated. Returns the sum of the squared weights of those that are not lit.
fn add_span(
    frame: &Frame,
    row: Range<usize>,
    foot: u8,
    (left, y): (i64, i64),
    light: &mut Sums,
    noisy: &mut Sums,
) -> i64 {
    // Columns count from `left` here. Summing sums from the right gives the moments without multiplications, which the
    // compiler would otherwise spread over vectors that have none for 64 bits:
    // s₁ = Σ w (x + 1), s₂ = Σ w (x + 1)(x + 2) / 2.
    let (mut sum, mut sum_1, mut n, mut n_1, mut n_2, mut rim) = (0i64, 0i64, 0i64, 0i64, 0i64, 0i64);
    for (&pixel, &threshold) in frame.pixels[row.clone()].iter().zip(&frame.thresholds[row]).rev() {
        let threshold = threshold.saturating_add(frame.raised);
        let open = threshold < 255; // a pixel that can never be lit has no light
        let weight = if open { pixel.saturating_sub(threshold.saturating_sub(foot)) } else { 0 };
        sum += i64::from(weight);
        sum_1 += sum;
        n += i64::from(weight > 0 && pixel < 255);
        n_1 += n;
        n_2 += n_1;
        rim += if pixel <= threshold { i64::from(weight) * i64::from(weight) } else { 0 };
    }
    let (sum_x, n_x) = (sum_1 - sum, n_1 - n);
    let n_xx = 2 * n_2 - 3 * n_x - 2 * n;
    let shifted = n_x + n * left;
    light.n += sum;
    light.x += sum_x + sum * left;
    light.y += sum * y;
    noisy.n += n;
    noisy.x += shifted;
    noisy.y += n * y;
    noisy.xx += n_xx + (n_x + shifted) * left;
    noisy.xy += shifted * y;
    noisy.yy += n * y * y;
    rim
}
