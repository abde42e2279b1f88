//! Normals from neighbouring points, and whether a point is on a surface.

use nalgebra::{Matrix3, Vector3};

use super::TriangulatorSettings;
use super::sights::{Seen, Sights};

/// The points of a camera's pixels.
pub(super) struct Grid<'a> {
    pub found: &'a [Seen],
    pub width: usize,
    pub height: usize,
    pub sights: &'a Sights<'a>,
    pub settings: &'a TriangulatorSettings,
}

/// What its neighbours say of a point.
pub(super) struct Around {
    /// In the world, towards the camera; zero where they do not tell it.
    pub normal: Vector3<f64>,
    pub confidence: f64,
}

impl Grid<'_> {
    pub fn around(&self, x: usize, y: usize, point: &Seen) -> Around {
        let reach = self.settings.reach;
        let step = self.settings.step as f32 * point.depth;
        let variance = point.sigma * point.sigma;
        let mut plane = Plane::default();
        for row in y.saturating_sub(reach)..(y + reach + 1).min(self.height) {
            let columns = x.saturating_sub(reach)..(x + reach + 1).min(self.width);
            let others = &self.found[row * self.width..][columns.clone()];
            let rows_away = row.abs_diff(y);
            let mut line = Line::default();
            for (column, other) in columns.zip(others) {
                let away = rows_away.max(column.abs_diff(x)) as f32;
                let beyond = (other.depth - point.depth).abs() - step * away;
                if beyond <= 0.0 || beyond * beyond <= 9.0 * (variance + other.sigma * other.sigma) {
                    line.add(column as i32 - x as i32, f64::from(other.inverse_z - point.inverse_z));
                }
            }
            plane.add(row as i32 - y as i32, &line);
        }
        let confidence = f64::from(plane.n - 1) / ((2 * reach + 1).pow(2) - 1) as f64;
        let normal = self.normal(x, y, f64::from(point.inverse_z), &plane).unwrap_or_else(Vector3::zeros);
        Around { normal, confidence }
    }

    /// From offsets in pixels and in inverse depth.
    fn normal(&self, x: usize, y: usize, inverse: f64, plane: &Plane) -> Option<Vector3<f64>> {
        let fit = plane.fit()?;
        let ideal = self.sights.ideal(x, y)?;
        let [fx, fy] = self.sights.camera.intrinsics.focal;
        // n·(x, y, 1) / d = 1/z on the plane n·p = d; n points away from the camera.
        let (a, b, c) = (inverse + fit[0], fit[1] * fx, fit[2] * fy);
        let away = Vector3::new(b, c, a - b * ideal.x - c * ideal.y);
        let towards = -(self.sights.world_from_camera * away);
        (plane.n >= 4).then(|| towards.try_normalize(1e-12)).flatten()
    }
}

/// Sums over points of a row: their number, columns and squares of these, and what they lie at.
#[derive(Default)]
struct Line {
    n: i32,
    x: i32,
    xx: i32,
    off: f64,
    off_x: f64,
}

impl Line {
    #[inline]
    fn add(&mut self, x: i32, off: f64) {
        self.n += 1;
        self.x += x;
        self.xx += x * x;
        self.off += off;
        self.off_x += off * f64::from(x);
    }
}

/// Sums of a plane through points: their number, offsets, products of these, and what they lie at.
#[derive(Default)]
struct Plane {
    n: i32,
    sum: [i32; 2],
    products: [i32; 3],
    side: [f64; 3],
}

impl Plane {
    #[inline]
    fn add(&mut self, y: i32, line: &Line) {
        self.n += line.n;
        self.sum = [self.sum[0] + line.x, self.sum[1] + y * line.n];
        self.products = [self.products[0] + line.xx, self.products[1] + y * line.x, self.products[2] + y * y * line.n];
        self.side = [self.side[0] + line.off, self.side[1] + line.off_x, self.side[2] + f64::from(y) * line.off];
    }

    /// Where it lies in the middle, and its slopes.
    fn fit(&self) -> Option<Vector3<f64>> {
        let ([x, y], [xx, xy, yy]) = (self.sum.map(f64::from), self.products.map(f64::from));
        let normal = Matrix3::new(f64::from(self.n), x, y, x, xx, xy, y, xy, yy);
        Some(normal.try_inverse()? * Vector3::from(self.side))
    }
}
