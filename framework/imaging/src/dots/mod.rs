//! Small dark dots on a brighter surface, each with a sub-pixel centre and its covariance: painted marks [Davis 2002 §5.1, Fig. 55].
//!
//! A dot is a place that is darker than what lies around it on nearly all sides. What the surface would look like without the dot is a plane, fitted to a ring
//! around it (a neighbour on the ring is left out); the dot's darkness is 1 − I / plane, which does not change with the light. Its centre is the
//! darkness-weighted mean over a disc that is moved along until it lies in the middle.
//!
//! The covariance is that of a weighted mean under noise as found on the ring: σ² Σ (xᵢ − c)(xᵢ − c)ᵀ wᵢ² / (Σ wᵢ qᵢ)², and a floor for what the shape of a real
//! dot does.

use nalgebra::{Matrix2, Matrix3, Point2, Vector2, Vector3};

use crate::{ImageView, ImagingError};

/// Limits on what counts as a dot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DotLimits {
    /// The radius of a dot, 1 to 20; dots of half to twice that are found [px].
    pub radius_px: f64,
    /// How much darker than its surroundings a dot is in its middle, at least, 0.02 to 1 [–].
    pub min_contrast: f64,
    /// Darker than its surroundings by at least this [gray level].
    pub min_depth: f64,
    /// The longer axis over the shorter one, at most, from 1: dots seen from the side are ellipses, hairs and folds are longer [–].
    pub max_elongation: f64,
}

impl Default for DotLimits {
    /// Dots of 4 to 5 px that a lens and a sensor have blurred.
    fn default() -> Self {
        Self { radius_px: 2.0, min_contrast: 0.12, min_depth: 8.0, max_elongation: 3.0 }
    }
}

/// A detected dot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dot {
    /// Its middle [px].
    pub centre: Point2<f64>,
    /// Covariance of the middle [px²].
    pub covariance: Matrix2<f64>,
    /// How much darker than its surroundings it is, at its darkest, 0 to 1 [–].
    pub contrast: f64,
    /// Pixels that are more than half as dark [px²].
    pub area: u32,
}

/// Dot detector; its buffers are reused from picture to picture.
#[derive(Debug, Clone)]
pub struct DotFinder {
    limits: DotLimits,
    /// Sums over 3 × 3 pixels; and the level that a pixel in the middle of a dot must stay below, seen from its surroundings.
    sums: Vec<u16>,
    below: Vec<u16>,
    rows: [Vec<u16>; 3],
    /// From the middle of a dot to the samples of its surroundings [px].
    around: [[f64; 2]; N_RING],
}

/// No centre is known better than this: dots are painted by hand [px].
const FLOOR_PX: f64 = 0.02;
/// Samples of the ring.
const N_RING: usize = 24;

impl DotFinder {
    /// A detector of dots within `limits`.
    ///
    /// # Errors
    /// [`ImagingError::Setting`] names the first limit out of its range.
    pub fn new(limits: DotLimits) -> Result<Self, ImagingError> {
        let DotLimits { radius_px, min_contrast, min_depth, max_elongation } = limits;
        ImagingError::unless((1.0..=20.0).contains(&radius_px), "radius_px", "1 to 20", radius_px)?;
        ImagingError::unless((0.02..=1.0).contains(&min_contrast), "min_contrast", "0.02 to 1", min_contrast)?;
        ImagingError::unless((0.0..=255.0).contains(&min_depth), "min_depth", "0 to 255", min_depth)?;
        ImagingError::unless((1.0..=100.0).contains(&max_elongation), "max_elongation", "1 to 100", max_elongation)?;
        let mut this =
            Self { limits, sums: Vec::new(), below: Vec::new(), rows: Default::default(), around: [[0.0; 2]; N_RING] };
        let ring = this.ring();
        for (k, place) in this.around.iter_mut().enumerate() {
            let (sin, cos) = (std::f64::consts::TAU * k as f64 / N_RING as f64).sin_cos();
            *place = [ring * cos, ring * sin];
        }
        Ok(this)
    }

    /// Limits on what counts as a dot.
    pub fn limits(&self) -> &DotLimits {
        &self.limits
    }

    /// How far from the middle the surroundings are looked at [px].
    fn ring(&self) -> f64 {
        1.9 * self.limits.radius_px + 1.2
    }

    /// All dots of a picture, in scan order of their darkest pixels; `dots` is emptied first. Those nearer to the border than the ring around them are left out.
    pub fn find(&mut self, view: &ImageView<'_>, dots: &mut Vec<Dot>) {
        dots.clear();
        let (width, height) = view.size();
        let far = self.ring().ceil() as usize + 1;
        if width <= 2 * far || height <= 2 * far {
            return;
        }
        self.blur(view);
        let side = self.ring() / f64::sqrt(2.0);
        let around = [[self.ring(), 0.0], [side, side], [0.0, self.ring()], [-side, side]].map(|[x, y]| {
            let at = |sign: f64| ((sign * y).round() * width as f64 + (sign * x).round()) as isize;
            [at(1.0), at(-1.0)]
        });
        let mut dark_sides = std::mem::take(&mut self.rows[0]);
        for y in far..height - far {
            let row = y * width + far..(y + 1) * width - far;
            let middle = &self.sums[row.clone()];
            dark_sides.clear();
            dark_sides.resize(middle.len(), 0);
            for offset in around.as_flattened() {
                let there = &self.below[row.start.wrapping_add_signed(*offset)..][..middle.len()];
                for ((count, here), there) in dark_sides.iter_mut().zip(middle).zip(there) {
                    *count += u16::from(here < there);
                }
            }
            for (x, _) in dark_sides.iter().enumerate().filter(|it| *it.1 >= 6) {
                let x = x + far;
                if !self.is_darkest(x, y, width) {
                    continue;
                }
                let seed = Point2::new(x as f64, y as f64);
                let Some(dot) = self.measure(view, seed, self.limits.radius_px + 1.0) else { continue };
                let apart = self.limits.radius_px;
                if dots.iter().rev().all(|it| (it.centre - dot.centre).norm() >= apart) {
                    dots.push(dot);
                }
            }
        }
        self.rows[0] = dark_sides;
    }

    /// Fills `sums` and `below`; the outermost pixels have no sums.
    fn blur(&mut self, view: &ImageView<'_>) {
        let (width, height) = view.size();
        let [_, first, second] = &mut self.rows;
        for part in [&mut self.sums, &mut self.below] {
            part.clear();
            part.resize(width * height, 0);
        }
        second.resize(width, 0);
        first.resize(width, 0);
        // In 256ths, and nine pixels at a time.
        let keep = ((1.0 - self.limits.min_contrast) * 256.0) as u32;
        let depth = (9.0 * self.limits.min_depth) as u16;
        for y in 1..height - 1 {
            let (up, at, down) = (view.row(y - 1), view.row(y), view.row(y + 1));
            for (out, ((a, b), c)) in first.iter_mut().zip(up.iter().zip(at).zip(down)) {
                *out = u16::from(*a) + u16::from(*b) + u16::from(*c);
            }
            let row = y * width + 1..(y + 1) * width - 1;
            let (sums, below) = (&mut self.sums[row.clone()], &mut self.below[row]);
            for (out, ((a, b), c)) in sums.iter_mut().zip(first.iter().zip(&first[1..]).zip(&first[2..])) {
                *out = a + b + c;
            }
            for (out, sum) in below.iter_mut().zip(&*sums) {
                *out = ((u32::from(*sum) * keep) >> 8).min(u32::from(sum.saturating_sub(depth))) as u16;
            }
        }
    }

    /// No pixel within two is darker; of equals, the first.
    fn is_darkest(&self, x: usize, y: usize, width: usize) -> bool {
        let here = self.sums[y * width + x];
        (y - 2..=y + 2).all(|v| {
            let row = &self.sums[v * width + x - 2..=v * width + x + 2];
            let is_before = |u: usize| (v, u) < (y, 2);
            row.iter().enumerate().all(|(u, it)| *it > here || (*it == here && !is_before(u)))
        })
    }

    /// The dot near `seed`, whose middle is within `reach_px` of it. `None` where nothing there looks like one, and too near to the border.
    pub fn measure(&self, view: &ImageView<'_>, seed: Point2<f64>, reach_px: f64) -> Option<Dot> {
        let (disc, ring) = (1.5 * self.limits.radius_px + 0.7, self.ring());
        let margin = ring + 1.0;
        let (width, height) = (view.width() as f64, view.height() as f64);
        let is_inside = |p: &Point2<f64>| {
            p.x >= margin && p.y >= margin && p.x <= width - 1.0 - margin && p.y <= height - 1.0 - margin
        };
        let mut centre = seed;
        let (mut last, mut pixels) = (f64::INFINITY, Vec::with_capacity(128));
        for _ in 0..8 {
            // Written so that NaN is refused.
            if !(is_inside(&centre) && (centre - seed).norm() <= reach_px) {
                return None;
            }
            let surface = Surface::around(view, &centre, &self.around)?;
            let moments = Moments::of(view, &centre, disc, &surface, &mut pixels);
            if moments.weight <= 0.0 {
                return None;
            }
            let step = moments.first / moments.weight;
            if step.norm() < 0.005 || (step.norm() >= last && last < 0.05) {
                return self.judge(centre, disc, &surface, &moments);
            }
            last = step.norm();
            centre += step;
        }
        None
    }

    fn judge(&self, centre: Point2<f64>, disc: f64, surface: &Surface, moments: &Moments) -> Option<Dot> {
        let depth = moments.darkest * surface.at(&centre);
        let spread = moments.second / moments.weight;
        let eigenvalues = spread.symmetric_eigenvalues();
        let (long, short) = (eigenvalues.max().max(0.0).sqrt(), eigenvalues.min().max(0.0).sqrt());
        // A disc of radius r has the deviation r / 2 along each axis; where everything is equally dark, it is that of the disc measured in.
        let is_dot = moments.darkest >= self.limits.min_contrast
            && depth >= self.limits.min_depth.max(3.0 * surface.noise)
            && long <= self.limits.max_elongation * short
            && long < 0.475 * disc
            && moments.area > 0;
        is_dot.then(|| {
            let variance = (surface.noise / surface.at(&centre)).powi(2) / moments.weight.powi(2);
            let covariance = moments.noise * variance + Matrix2::identity() * FLOOR_PX.powi(2);
            Dot { centre, covariance, contrast: moments.darkest.min(1.0), area: moments.area }
        })
    }
}

/// What the surface looks like around a dot: a plane of gray levels.
struct Surface {
    /// Level at `about`, and its change along x and y.
    plane: Vector3<f64>,
    about: Point2<f64>,
    /// Standard deviation of a pixel from it [gray level].
    noise: f64,
}

impl Surface {
    /// Fitted to a ring. `None` where that is black.
    fn around(view: &ImageView<'_>, about: &Point2<f64>, ring: &[[f64; 2]; N_RING]) -> Option<Self> {
        let mut grays = [0_u8; N_RING];
        let mut offsets = [Vector2::zeros(); N_RING];
        for ((gray, offset), place) in grays.iter_mut().zip(&mut offsets).zip(ring) {
            // Whole pixels: their noise is that of the picture.
            let (x, y) = (nearest(about.x + place[0]), nearest(about.y + place[1]));
            *offset = Vector2::new(x as f64 - about.x, y as f64 - about.y);
            *gray = view.get(x, y)?;
        }
        let levels = grays.map(f64::from);
        grays.sort_unstable();
        let sorted = grays.map(f64::from);
        // Neighbours on the ring are dark: what is far below its upper half is not the surface.
        let (upper, middle) = (sorted[3 * N_RING / 4], sorted[N_RING / 2]);
        let mut plane = Vector3::new(upper.min(middle + 6.0), 0.0, 0.0);
        let mut limit = (2.0 * (upper - middle)).max(12.0).max(0.15 * upper);
        let mut noise = 0.0;
        for _ in 0..2 {
            let (mut normal, mut right, mut n, mut squares) = (Matrix3::zeros(), Vector3::zeros(), 0.0, 0.0);
            for (level, offset) in levels.iter().zip(&offsets) {
                let row = Vector3::new(1.0, offset.x, offset.y);
                if (level - plane.dot(&row)).abs() <= limit {
                    normal += row * row.transpose();
                    right += row * *level;
                    squares += level * level;
                    n += 1.0;
                }
            }
            if n < N_RING as f64 / 2.0 {
                return None;
            }
            plane = normal.cholesky()?.solve(&right);
            noise = ((squares - plane.dot(&right)).max(0.0) / (n - 3.0)).sqrt();
            limit = (3.0 * noise).max(4.0);
        }
        (plane[0] >= 1.0).then_some(Self { plane, about: *about, noise: noise.max(0.5) })
    }

    fn at(&self, place: &Point2<f64>) -> f64 {
        let offset = place - self.about;
        (self.plane[0] + self.plane[1] * offset.x + self.plane[2] * offset.y).max(1.0)
    }
}

/// ⌊x + ½⌋ of a number from 0, as [`f64::round`] has it.
#[inline]
fn nearest(x: f64) -> usize {
    let whole = x as usize;
    whole + usize::from(x - whole as f64 >= 0.5)
}

/// A pixel of a disc.
struct DiscPixel {
    /// From the middle of the disc [px].
    offset: Vector2<f64>,
    /// How much of it counts, up to 1.
    part: f64,
    /// 1 − its level over the surface's [–].
    dark: f64,
}

/// Sums over a disc, about its middle.
struct Moments {
    weight: f64,
    first: Vector2<f64>,
    second: Matrix2<f64>,
    /// Σ (x − c)(x − c)ᵀ over the pixels that count, each by the square of its part of the disc.
    noise: Matrix2<f64>,
    darkest: f64,
    area: u32,
}

impl Moments {
    /// `pixels` is emptied first.
    fn of(
        view: &ImageView<'_>,
        centre: &Point2<f64>,
        disc: f64,
        surface: &Surface,
        pixels: &mut Vec<DiscPixel>,
    ) -> Self {
        let mut moments = Self {
            weight: 0.0,
            first: Vector2::zeros(),
            second: Matrix2::zeros(),
            noise: Matrix2::zeros(),
            darkest: 0.0,
            area: 0,
        };
        let range = |at: f64| (at - disc - 1.0).ceil().max(0.0) as usize..=(at + disc + 1.0).floor().max(0.0) as usize;
        pixels.clear();
        for y in range(centre.y) {
            for x in range(centre.x) {
                let place = Point2::new(x as f64, y as f64);
                let offset = place - centre;
                let away = offset.norm();
                let part = (disc + 0.5 - away).clamp(0.0, 1.0);
                if part == 0.0 {
                    continue;
                }
                let level = view.get(x, y).map_or(0.0, f64::from);
                let dark = 1.0 - level / surface.at(&place);
                if away <= 0.7 * disc {
                    moments.darkest = moments.darkest.max(dark);
                }
                pixels.push(DiscPixel { offset, part, dark });
            }
        }
        // What is hardly dark is noise, and would pull the centre to the middle of the disc.
        let foot = (2.0 * surface.noise / surface.at(centre)).min(0.3 * moments.darkest);
        for &DiscPixel { offset, part, dark } in pixels.iter().filter(|it| it.dark > foot) {
            let weight = part * (dark - foot);
            moments.weight += weight;
            moments.first += offset * weight;
            moments.second += offset * offset.transpose() * weight;
            moments.noise += offset * offset.transpose() * (part * part);
            if 2.0 * dark > moments.darkest {
                moments.area += 1;
            }
        }
        moments
    }
}

#[cfg(test)]
mod tests;
