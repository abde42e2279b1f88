//! Saddles of brightness, and the smoothed picture in which they are searched.

use nalgebra::{Point2, Vector2};

use crate::ImageView;

/// A picture of one number a pixel.
#[derive(Debug, Clone)]
pub(super) struct Plane {
    pub width: usize,
    pub height: usize,
    pub values: Vec<f32>,
}

/// Where brightness has a saddle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Saddle {
    pub centre: Point2<f64>,
    /// Root of the product of both curvatures [gray level/px²].
    pub strength: f64,
    /// Along the edges that cross here, of length 1.
    pub edges: [Vector2<f64>; 2],
    /// Through the bright quadrants, of length 1.
    pub bright: Vector2<f64>,
}

/// Saddles that are looked at: the strongest.
const MAX_SADDLES: usize = 3000;
/// Of gradients: wider ones are less noisy, narrower ones stay within small squares [px].
const HALF_STEP: f64 = 0.7;
/// Weaker ones are noise [gray level/px²].
const MIN_STRENGTH: f64 = 0.6;
/// Bright and dark around a saddle differ by this at least: half of the contrast that a board must have; noise that has been smoothed has less [gray level].
const MIN_RANGE: f64 = 4.0;

impl Plane {
    pub(super) fn of(image: &ImageView<'_>) -> Plane {
        let values = image.pixels().iter().map(|it| f32::from(*it)).collect();
        Plane { width: image.width(), height: image.height(), values }
    }

    /// The value at a place between pixels; `None` outside.
    #[inline]
    pub(super) fn at(&self, place: Point2<f64>) -> Option<f64> {
        let (left, top) = (place.x.floor(), place.y.floor());
        if !(left >= 0.0 && top >= 0.0 && left + 1.0 < self.width as f64 && top + 1.0 < self.height as f64) {
            return None;
        }
        let (across, down) = (place.x - left, place.y - top);
        let first = top as usize * self.width + left as usize;
        let value = |at: usize| f64::from(self.values[at]);
        let upper = value(first) * (1.0 - across) + value(first + 1) * across;
        let lower = value(first + self.width) * (1.0 - across) + value(first + self.width + 1) * across;
        Some(upper * (1.0 - down) + lower * down)
    }

    /// By differences over [`HALF_STEP`] to either side; `None` at the rim.
    #[inline]
    pub(super) fn gradient(&self, place: Point2<f64>) -> Option<Vector2<f64>> {
        let (x, y) = (Vector2::x() * HALF_STEP, Vector2::y() * HALF_STEP);
        Some(Vector2::new(self.at(place + x)? - self.at(place - x)?, self.at(place + y)? - self.at(place - y)?))
    }

    /// The same picture with so many times as many columns and rows, by cubic B-splines: smooth enough for curvatures, and not sharper
    /// than the pixels were.
    pub(super) fn resized(&self, size: Vector2<f64>) -> Plane {
        if size == Vector2::new(1.0, 1.0) {
            return self.clone();
        }
        let source = if size.min() < 1.0 { self.blurred() } else { self.clone() };
        let (width, height) = ((self.width as f64 * size.x) as usize, (self.height as f64 * size.y) as usize);
        let across: Vec<_> = (0..width).map(|it| taps(it, size.x, self.width)).collect();
        let mut narrow = Vec::with_capacity(width * self.height);
        for row in source.values.chunks_exact(self.width.max(1)) {
            narrow.extend(across.iter().map(|taps| taps.iter().map(|(at, weight)| row[*at] * weight).sum::<f32>()));
        }
        let mut values = Vec::with_capacity(width * height);
        for taps in (0..height).map(|it| taps(it, size.y, self.height)) {
            values.extend(
                (0..width).map(|x| taps.iter().map(|(at, weight)| narrow[at * width + x] * weight).sum::<f32>()),
            );
        }
        Plane { width, height, values }
    }

    /// Smoothed by a Gaussian of about 1 px.
    pub(super) fn blurred(&self) -> Plane {
        const TAPS: [f32; 7] = [0.0044, 0.054, 0.242, 0.3992, 0.242, 0.054, 0.0044];
        let (width, height) = (self.width, self.height);
        let mut across = self.values.clone();
        if width > 6 {
            for y in 0..height {
                let row = &self.values[y * width..(y + 1) * width];
                for x in 3..width - 3 {
                    across[y * width + x] = (0..7).map(|tap| TAPS[tap] * row[x + tap - 3]).sum();
                }
            }
        }
        let mut values = across.clone();
        if height > 6 {
            for y in 3..height - 3 {
                for x in 0..width {
                    values[y * width + x] = (0..7).map(|tap| TAPS[tap] * across[(y + tap - 3) * width + x]).sum();
                }
            }
        }
        Plane { width, height, values }
    }
}

/// Which pixels of a line of `length` make pixel `at` of one that has `size` times as many, and their weights.
fn taps(at: usize, size: f64, length: usize) -> [(usize, f32); 4] {
    let from = (at as f64 + 0.5) / size - 0.5;
    let first = from.floor();
    let t = from - first;
    let weights = [
        (1.0 - t).powi(3),
        3.0 * t.powi(3) - 6.0 * t * t + 4.0,
        3.0 * (1.0 - t).powi(3) - 6.0 * (1.0 - t).powi(2) + 4.0,
        t.powi(3),
    ];
    std::array::from_fn(|tap| {
        let place = (first + tap as f64 - 1.0).clamp(0.0, length as f64 - 1.0);
        (place as usize, (weights[tap] / 6.0) as f32)
    })
}

/// Where a place of the resized picture is in the one before: pixels are areas, and both pictures cover the same.
pub(super) fn from_resized(place: Point2<f64>, size: Vector2<f64>) -> Point2<f64> {
    Point2::new((place.x + 0.5) / size.x - 0.5, (place.y + 0.5) / size.y - 0.5)
}

/// The saddles of a smoothed picture, the strongest first.
pub(super) fn find(plane: &Plane) -> Vec<Saddle> {
    let (width, height) = (plane.width, plane.height);
    if width < 16 || height < 16 {
        return Vec::new();
    }
    let mut product = vec![0.0_f32; width * height];
    for y in 4..height - 4 {
        for x in 4..width - 4 {
            let (xx, yy, xy) = curvatures(plane, x, y);
            product[y * width + x] = (xy * xy - xx * yy).max(0.0);
        }
    }
    let mut found = Vec::new();
    for y in 6..height - 6 {
        for x in 6..width - 6 {
            let own = product[y * width + x];
            if f64::from(own) < MIN_STRENGTH * MIN_STRENGTH {
                continue;
            }
            let around = (y - 2..=y + 2).flat_map(|it| product[it * width + x - 2..=it * width + x + 2].iter());
            if around.copied().fold(0.0, f32::max) <= own {
                found.extend(refined(plane, x, y));
            }
        }
    }
    found.sort_by(|a, b| b.strength.total_cmp(&a.strength));
    found.truncate(MAX_SADDLES);
    found
}

fn curvatures(plane: &Plane, x: usize, y: usize) -> (f32, f32, f32) {
    let at = |x: usize, y: usize| plane.values[y * plane.width + x];
    let own = at(x, y);
    let xx = at(x + 1, y) - 2.0 * own + at(x - 1, y);
    let yy = at(x, y + 1) - 2.0 * own + at(x, y - 1);
    let xy = (at(x + 1, y + 1) - at(x - 1, y + 1) - at(x + 1, y - 1) + at(x - 1, y - 1)) / 4.0;
    (xx, yy, xy)
}

/// The saddle near a pixel, if brightness around it changes four times between dark and bright.
fn refined(plane: &Plane, x: usize, y: usize) -> Option<Saddle> {
    // Least squares of a quadric over 5 x 5 pixels.
    let (mut sum, mut sx, mut sy, mut sxx, mut syy, mut sxy) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for dy in -2..=2_i64 {
        for dx in -2..=2_i64 {
            let value = f64::from(plane.values[(y as i64 + dy) as usize * plane.width + (x as i64 + dx) as usize]);
            let (u, v) = (dx as f64, dy as f64);
            sum += value;
            sx += u * value;
            sy += v * value;
            sxx += (u * u - 2.0) * value;
            syy += (v * v - 2.0) * value;
            sxy += u * v * value;
        }
    }
    // Σu² = 50, Σ(u² − 2)² = 70, Σu²v² = 100
    let (bx, by, xx, yy, xy) = (sx / 50.0, sy / 50.0, 2.0 * sxx / 70.0, 2.0 * syy / 70.0, sxy / 100.0);
    let determinant = xx * yy - xy * xy;
    if determinant >= 0.0 {
        return None;
    }
    let offset = Vector2::new((xy * by - yy * bx) / determinant, (xy * bx - xx * by) / determinant);
    if offset.amax() > 1.5 {
        return None;
    }
    let centre = Point2::new(x as f64, y as f64) + offset;
    // Eigenvectors of [xx xy; xy yy].
    let (middle, half) = ((xx + yy) / 2.0, ((xx - yy) / 2.0).hypot(xy));
    let (up, down) = (middle + half, middle - half);
    let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
    let bright = Vector2::new(angle.cos(), angle.sin());
    let dark = Vector2::new(-bright.y, bright.x);
    let (a, b) = (bright * (-down).sqrt(), dark * up.sqrt());
    let level = sum / 25.0;
    let ring = |at: usize| {
        let angle = at as f64 * std::f64::consts::TAU / 24.0;
        plane.at(centre + Vector2::new(angle.cos(), angle.sin()) * 2.6)
    };
    let mut values = [0.0; 24];
    for (at, value) in values.iter_mut().enumerate() {
        *value = ring(at)?;
    }
    let (least, most) = values.iter().fold((f64::MAX, f64::MIN), |(a, b), it| (a.min(*it), b.max(*it)));
    let changes = (0..24).filter(|it| (values[*it] > level) != (values[(it + 1) % 24] > level)).count();
    (changes == 4 && most - least >= MIN_RANGE).then(|| Saddle {
        centre,
        strength: (-determinant).sqrt(),
        edges: [(a + b).normalize(), (a - b).normalize()],
        bright,
    })
}
