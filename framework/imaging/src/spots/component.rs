//! One group of connected lit pixels: which they are, their shape, their centre and its covariance.

use nalgebra::{Matrix2, Point2, Vector2};

use super::{Centroid, Measure, Spot};

/// The picture and its thresholds, of the same size.
#[derive(Clone, Copy)]
pub(super) struct Frame<'a> {
    pub pixels: &'a [u8],
    pub thresholds: &'a [u8],
    pub width: usize,
    pub height: usize,
}

impl Frame<'_> {
    fn lit(&self, index: usize) -> bool {
        self.pixels[index] > self.thresholds[index]
    }
}

/// Neighbouring lit pixels of one row: columns `x0..x1` of row `y`.
#[derive(Clone, Copy)]
struct Run {
    y: usize,
    x0: usize,
    x1: usize,
}

/// Area moments of a group, relative to the pixel where it was met.
#[derive(Clone, Copy)]
pub(super) struct Shape {
    pub area: u64,
    /// First and last column and row.
    pub bounds: [usize; 4],
    /// First pixel in scan order: (row, column).
    pub first: (usize, usize),
    pub peak: u8,
    /// Mean position of the lit pixels [px].
    pub mean: Point2<f64>,
    pub elongation: f64,
}

/// Buffers for taking one group after the other out of a picture.
#[derive(Default)]
pub(super) struct Component {
    /// Number of the last group that took a pixel; groups are numbered on and on over all pictures.
    marks: Vec<u32>,
    last_mark: u32,
    /// Groups of this picture are numbered from here.
    first_mark: u32,
    runs: Vec<Run>,
}

impl Component {
    /// Forgets the groups of the last picture without touching the memory that remembers them.
    pub fn begin(&mut self, n_pixels: usize) {
        // A picture uses up two numbers for each group at most, so a quarter of them always suffices.
        if self.marks.len() != n_pixels || self.last_mark > u32::MAX / 4 * 3 {
            self.marks.clear();
            self.marks.resize(n_pixels, 0);
            self.last_mark = 0;
        }
        self.first_mark = self.last_mark + 1;
    }

    /// Whether the lit pixel belongs to a group of this picture that has been taken already.
    pub fn taken(&self, index: usize) -> bool {
        self.marks[index] >= self.first_mark
    }

    /// Takes all lit pixels connected to the lit pixel (x, y), over sides and corners.
    pub fn take(&mut self, frame: &Frame, x: usize, y: usize) -> Shape {
        self.last_mark += 1;
        self.runs.clear();
        self.take_run(frame, x, y);
        let mut next = 0;
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
        self.shape(frame, x, y)
    }

    /// Takes the lit pixels to both sides of the lit pixel (x, y); returns the column after the last.
    fn take_run(&mut self, frame: &Frame, x: usize, y: usize) -> usize {
        let row = y * frame.width..(y + 1) * frame.width;
        let (pixels, thresholds) = (&frame.pixels[row.clone()], &frame.thresholds[row.clone()]);
        let (mut x0, mut x1) = (x, x + 1);
        while x0 > 0 && pixels[x0 - 1] > thresholds[x0 - 1] {
            x0 -= 1;
        }
        while x1 < frame.width && pixels[x1] > thresholds[x1] {
            x1 += 1;
        }
        self.marks[row.start + x0..row.start + x1].fill(self.last_mark);
        self.runs.push(Run { y, x0, x1 });
        x1
    }

    /// Area moments of the runs taken last, met at (x, y).
    fn shape(&self, frame: &Frame, x: usize, y: usize) -> Shape {
        let (mut area, mut sum_x, mut sum_y, mut sum_xx, mut sum_xy, mut sum_yy) = (0i64, 0i64, 0i64, 0i64, 0i64, 0i64);
        let (mut bounds, mut first, mut peak) = ([x, y, x, y], (y, x), 0);
        for run in &self.runs {
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
        let (half_sum, half_gap) = ((var_x + var_y) / 2.0, ((var_x - var_y) / 2.0).hypot(cov_xy));
        Shape {
            area: area as u64,
            bounds,
            first,
            peak,
            mean: Point2::new(x as f64 + mean.x, y as f64 + mean.y),
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

    /// Centre, covariance and sum of the weights over the taken pixels and all their neighbours.
    fn weighted(&mut self, frame: &Frame, shape: &Shape, how: &Measure) -> (Point2<f64>, Matrix2<f64>, f64) {
        let mut light = Sums::default();
        let mut noisy = Sums::default();
        // Relative to the first column and row, so that the sums stay small and whole.
        let (origin_x, origin_y) = (shape.bounds[0] as i64, shape.bounds[1] as i64);
        self.last_mark += 1; // the neighbours overlap: each pixel counts once
        for run in &self.runs {
            for y in run.y.saturating_sub(1)..(run.y + 2).min(frame.height) {
                for x in run.x0.saturating_sub(1)..(run.x1 + 1).min(frame.width) {
                    let index = y * frame.width + x;
                    if self.marks[index] == self.last_mark {
                        continue;
                    }
                    self.marks[index] = self.last_mark;
                    let (pixel, threshold) = (frame.pixels[index], frame.thresholds[index]);
                    let weight = pixel.saturating_sub(threshold.saturating_sub(how.foot));
                    if weight > 0 && threshold < 255 {
                        let (dx, dy) = (x as i64 - origin_x, y as i64 - origin_y);
                        light.add(i64::from(weight), dx, dy);
                        if pixel < 255 {
                            noisy.add(1, dx, dy);
                        }
                    }
                }
            }
        }
        let weight = light.n as f64;
        let centre = Vector2::new(light.x as f64 / weight, light.y as f64 / weight);
        let spread = noisy.second_moment_about(centre);
        let noise = (how.pixel_sigma * how.pixel_sigma + 1.0 / 12.0) / (weight * weight);
        let covariance = spread * noise + Matrix2::identity() * how.floor_px * how.floor_px;
        (Point2::new(origin_x as f64 + centre.x, origin_y as f64 + centre.y), covariance, weight)
    }
}

/// Nearest whole pixel to the mean of the lit pixels, its covariance, and the area.
fn rounded(shape: &Shape) -> (Point2<f64>, Matrix2<f64>, f64) {
    let centre = shape.mean.map(f64::round);
    // Rounding: 1/12. The unrounded mean jumps with each of the rim pixels, about √area of them, of which … (below)
    let covariance = Matrix2::identity() * (1.0 / 12.0 + RIM_VARIANCE);
    (centre, covariance, shape.area as f64)
}

/// Variance of the mean of the lit pixels, one axis, measured on Gaussian spots [px²].
const RIM_VARIANCE: f64 = 0.0067;

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
    fn add(&mut self, weight: i64, x: i64, y: i64) {
        self.n += weight;
        self.x += weight * x;
        self.y += weight * y;
        self.xx += weight * x * x;
        self.xy += weight * x * y;
        self.yy += weight * y * y;
    }

    /// Σ w (x − c)(x − c)ᵀ.
    fn second_moment_about(&self, c: Vector2<f64>) -> Matrix2<f64> {
        let [n, x, y] = [self.n, self.x, self.y].map(|it| it as f64);
        let xx = self.xx as f64 - 2.0 * c.x * x + n * c.x * c.x;
        let xy = self.xy as f64 - c.x * y - c.y * x + n * c.x * c.y;
        let yy = self.yy as f64 - 2.0 * c.y * y + n * c.y * c.y;
        Matrix2::new(xx.max(0.0), xy, xy, yy.max(0.0))
    }
}
