//! Map between a plane and the image of one camera: a homography, then the lens, with covariance.
//!
//! Source: R. Hartley and A. Zisserman, *Multiple View Geometry in Computer Vision*, 2nd edition, 2004: the homography of a plane (§2.3), its direct linear
//! transform with normalised points (algorithm 4.2), its covariance carried to mapped points (§5.2.6). The lens is
//! [`Distortion`], about the middle of the
//! picture; an offset of the true principal point is absorbed by the homography and the decentering terms.
//!
//! | here | meaning | unit |
//! |---|---|---|
//! | `point` | on the plane | m |
//! | `ideal` | H applied to the point: its pinhole image | half the picture's width |
//! | `distorted` | `ideal` after the lens | half the picture's width |
//! | pixel | middle of the picture + half its width · `distorted` | px |
//!
//! A plane that bends is imaged as if each of its points were shifted: `shifted` = point + [`Mesh::shift`] is where the flat map sees the point.
//!
//! Pose and focal length need not be separable for this, so a camera that looks straight at the plane is no special
//! case, unlike for a [`Camera`](crate::Camera).

mod mesh;
pub mod network;

use foveate_estimation::least_squares::{Equations, Loss, Options, Problem, solve};
use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Point2, SMatrix, SVector, Vector2, Vector3};

use self::mesh::Shifted;
use crate::Distortion;

pub use self::mesh::Mesh;

/// Number of parameters of a fit: eight of the homography, then k₁, k₂, k₃, p₁, p₂.
pub const UNKNOWNS: usize = 13;
/// Least number of points for a fit: with fewer, the prior alone determines the lens.
pub const LEAST_POINTS: usize = 8;
/// Least number of points for a fit with a bent plane: twice the number of shifts along both axes that no penalty constrains.
pub const LEAST_BENT_POINTS: usize = 24;
/// Half of the homography's unknowns need points off one line: least spread across the longest direction, relative to that along it.
const LEAST_SPREAD: f64 = 0.05;
/// What lenses do, standard deviation of each term: radial and decentering, at half the width from the middle, relative. From plain to fish-eye lenses
/// it holds; with many points it does not count.
const PRIOR_RADIAL: f64 = 0.3;
const PRIOR_DECENTERING: f64 = 0.03;
/// Rounds of the first homography, each weighing points by how well they fitted before.
const ROUNDS: usize = 8;
/// A residual beyond this counts less and less [standard deviations].
const LOSS_SIGMAS: f64 = 3.0;

/// Map between a plane and the raw pixels of one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneMap {
    /// Columns, rows [px].
    pub image_size: [u32; 2],
    /// H: maps (x, y, 1) on the plane [m] to ideal coordinates; its last entry is 1.
    pub ideal_from_plane: Matrix3<f64>,
    /// Lens distortion, for ideal coordinates.
    pub distortion: Distortion,
    /// Covariance of H row by row without its last entry, then k₁, k₂, k₃, p₁, p₂.
    pub covariance: SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    /// The bend of the plane; `None` where it is flat.
    pub mesh: Option<Mesh>,
}

/// Why there is no fit, in words for who placed the points.
const NO_START: &str = "too many of them lie on one line or at one place, or most are not at their stated places";
const NO_ADJUSTMENT: &str = "some pixels match no view of the plane; are the places of the points right?";
const LEFT_OPEN: &str = "a part of the view has too few of them; they should cover the whole picture";

/// A known point of the plane and its pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanePoint {
    /// Position on the plane [m].
    pub point: Point2<f64>,
    /// Measured pixel, raw [px].
    pub pixel: Point2<f64>,
    /// Standard deviation of the pixel, along each axis [px].
    pub sigma: f64,
}

/// Why points do not give a map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlaneMapError {
    /// Too few points.
    #[error("{count} points, expected at least {least}")]
    TooFew {
        /// Number of points.
        count: usize,
        /// Number that is needed.
        least: usize,
    },
    /// All points lie near one line.
    #[error(
        "{count} points on a line (spread across it {ratio:.3} of that along it), expected at least {LEAST_SPREAD}"
    )]
    OnALine {
        /// Number of points.
        count: usize,
        /// Spread across the line relative to that along it.
        ratio: f64,
    },
    /// No map explains the pixels of the points.
    #[error("no flat plane seen through a lens explains the pixels of the points: {0}")]
    NoFit(String),
}

/// A position on the plane with covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// Position on the plane [m].
    pub point: Point2<f64>,
    /// Covariance of the position, from the pixel's and the map's [m²].
    pub covariance: Matrix2<f64>,
    /// Derivative of the position with respect to the pixel [m/px].
    pub plane_by_pixel: Matrix2<f64>,
}

impl PlaneMap {
    /// Fits the map of a flat plane to known points.
    ///
    /// # Errors
    /// Too few points, points on a line, or points that no map explains.
    pub fn fit(image_size: [u32; 2], points: &[PlanePoint]) -> Result<PlaneMap, PlaneMapError> {
        let count = points.len();
        if count < LEAST_POINTS {
            return Err(PlaneMapError::TooFew { count, least: LEAST_POINTS });
        }
        let [places, pixels]: [Vec<Point2<f64>>; 2] =
            [points.iter().map(|it| it.point).collect(), points.iter().map(|it| it.pixel).collect()];
        for places in [places, pixels] {
            let ratio = spread(&places);
            if ratio < LEAST_SPREAD {
                return Err(PlaneMapError::OnALine { count, ratio });
            }
        }
        let start = PlaneMap {
            image_size,
            ideal_from_plane: first_homography(image_size, points)
                .ok_or_else(|| PlaneMapError::NoFit(NO_START.into()))?,
            distortion: Distortion::default(),
            covariance: SMatrix::zeros(),
            mesh: None,
        };
        let plain = Options { loss: Loss::Cauchy { scale: LOSS_SIGMAS }, ..Options::default() };
        let solution = solve(&Fit { points }, start, &plain).map_err(|_| PlaneMapError::NoFit(NO_ADJUSTMENT.into()))?;
        let covariance = solution.covariance.map_err(|_| PlaneMapError::NoFit(LEFT_OPEN.into()))?;
        let mut map = solution.parameters;
        // Residuals larger than their standard deviations say that either these or the model are too good.
        let factor = solution.variance_factor.max(1.0);
        map.covariance = SMatrix::from_fn(|row, column| covariance[(row, column)] * factor);
        Ok(map)
    }

    /// Fits the map of a plane that bends, over the rectangle of `size_m` from its origin: a flat map, and the
    /// smoothest shifts that explain the rest.
    ///
    /// The whole uncertainty of the map is in the covariance of the shifts; that of the flat map is 0.
    ///
    /// # Errors
    /// As for [`Self::fit`]; also points beside the rectangle, and a plane so bent that the camera sees its back.
    pub fn fit_bent(image_size: [u32; 2], points: &[PlanePoint], size_m: [f64; 2]) -> Result<PlaneMap, PlaneMapError> {
        let count = points.len();
        if count < LEAST_BENT_POINTS {
            return Err(PlaneMapError::TooFew { count, least: LEAST_BENT_POINTS });
        }
        let no_fit = |why: &str| PlaneMapError::NoFit(why.to_owned());
        if let Some(it) = points.iter().find(|it| (0..2).any(|axis| !(0.0..=size_m[axis]).contains(&it.point[axis]))) {
            return Err(PlaneMapError::NoFit(format!(
                "found a point at {}, expected all points within the rectangle of {} m by {} m",
                it.point, size_m[0], size_m[1]
            )));
        }
        // The flat map is to go through the middle of all points, not through those that happen to lie on a plane: each is as uncertain as the plane is off.
        let pixels_from_plane = PlaneMap::homography(image_size, points).ok_or_else(|| no_fit(NO_START))?;
        let off = |it: &PlanePoint| {
            let at = pixels_from_plane * it.point.coords.push(1.0);
            (at.xy() / at.z - it.pixel.coords).norm()
        };
        let offs: Vec<f64> = points.iter().map(off).collect();
        let bend = foveate_estimation::statistics::median(&offs).unwrap_or(0.0);
        let loose: Vec<PlanePoint> = points.iter().map(|it| PlanePoint { sigma: it.sigma.max(bend), ..*it }).collect();
        let mut map = PlaneMap::fit(image_size, &loose)?;
        map.covariance = SMatrix::zeros();
        let samples = points.iter().map(|it| {
            let shifted = map.point(&it.pixel)?;
            let plane_by_pixel = map.pixel_with_jacobian(&shifted)?.1.try_inverse()?;
            let sigma = it.sigma * plane_by_pixel.norm() / std::f64::consts::SQRT_2;
            Some(Shifted { point: it.point, shift: shifted - it.point, sigma })
        });
        let samples: Option<Vec<Shifted>> = samples.collect();
        let samples = samples.ok_or_else(|| no_fit("a pixel matches no point of the flat map"))?;
        let mesh = Mesh::fit(size_m, &samples).ok_or_else(|| no_fit("the points do not determine the shifts"))?;
        if points.iter().any(|it| (Matrix2::identity() + mesh.shift(&it.point).1).determinant() <= 0.0) {
            return Err(no_fit("the plane bends so much that the camera sees the back of it"));
        }
        map.mesh = Some(mesh);
        Ok(map)
    }

    /// Robust homography from the plane to raw pixels, without a lens; `None` where the points determine none.
    pub fn homography(image_size: [u32; 2], points: &[PlanePoint]) -> Option<Matrix3<f64>> {
        let [width, height] = image_size.map(f64::from);
        let pixels_from_ideal = Matrix3::new(
            width / 2.0,
            0.0,
            (width - 1.0) / 2.0, //
            0.0,
            width / 2.0,
            (height - 1.0) / 2.0, //
            0.0,
            0.0,
            1.0,
        );
        Some(pixels_from_ideal * first_homography(image_size, points)?)
    }

    /// Projects a point of the plane to its raw pixel, which may lie outside the picture. `None` behind the camera and beyond the domain of the lens.
    pub fn pixel(&self, point: &Point2<f64>) -> Option<Point2<f64>> {
        let (ideal, _) = self.ideal(&self.shifted(point).0)?;
        Some(self.in_pixels(&self.distortion.distort(&ideal)?))
    }

    /// As [`Self::pixel`], with the derivative of the pixel by the point [px/m].
    pub fn pixel_with_jacobian(&self, point: &Point2<f64>) -> Option<(Point2<f64>, Matrix2<f64>)> {
        let (shifted, shifted_by_point) = self.shifted(point);
        let (pixel, by_shifted) = self.flat_pixel(&shifted)?;
        Some((pixel, by_shifted * shifted_by_point))
    }

    /// The point of the plane seen at `pixel` [m]. `None` beyond the domain of the lens, at and above the plane's
    /// horizon, and where a bend hides the plane.
    pub fn point(&self, pixel: &Point2<f64>) -> Option<Point2<f64>> {
        let distorted = (pixel - self.middle()) / self.half_width();
        let ideal = self.distortion.undistort(&distorted)?;
        let on_plane = self.ideal_from_plane.try_inverse()? * ideal.push(1.0);
        // H of it is the ideal point times 1 / z: in front of the camera when that is positive.
        if on_plane.z <= 0.0 {
            return None;
        }
        let shifted = Point2::new(on_plane.x / on_plane.z, on_plane.y / on_plane.z);
        self.mesh.as_ref().map_or(Some(shifted), |it| it.unshifted(&shifted))
    }

    /// As [`Self::point`], with covariance from that of the pixel [px²] and of the map.
    pub fn place(&self, pixel: &Point2<f64>, pixel_covariance: &Matrix2<f64>) -> Option<Placed> {
        let point = self.point(pixel)?;
        let (_, by_point) = self.pixel_with_jacobian(&point)?;
        let plane_by_pixel = by_point.try_inverse()?;
        let shifted = self.shifted(&point).0;
        let by_unknowns = self.pixel_by_unknowns(&shifted)?;
        let mut of_map = by_unknowns * self.covariance * by_unknowns.transpose();
        if let Some(mesh) = &self.mesh {
            let by_shifted = self.flat_pixel(&shifted)?.1;
            of_map += by_shifted * mesh.covariance(&point) * by_shifted.transpose();
        }
        let covariance = plane_by_pixel * (pixel_covariance + of_map) * plane_by_pixel.transpose();
        Some(Placed { point, covariance, plane_by_pixel })
    }

    /// Whether a point of the plane is imaged at least `margin` inside the picture [px].
    pub fn sees(&self, point: &Point2<f64>, margin: f64) -> bool {
        let [width, height] = self.image_size.map(f64::from);
        self.pixel(point).is_some_and(|it| {
            (margin - 0.5..width - 0.5 - margin).contains(&it.x)
                && (margin - 0.5..height - 0.5 - margin).contains(&it.y)
        })
    }

    fn half_width(&self) -> f64 {
        f64::from(self.image_size[0]) / 2.0
    }

    fn middle(&self) -> Point2<f64> {
        let [width, height] = self.image_size.map(f64::from);
        Point2::new((width - 1.0) / 2.0, (height - 1.0) / 2.0)
    }

    fn in_pixels(&self, distorted: &Vector2<f64>) -> Point2<f64> {
        self.middle() + distorted * self.half_width()
    }

    /// Where the flat map sees what is seen of a point [m], and its derivative by the point.
    fn shifted(&self, point: &Point2<f64>) -> (Point2<f64>, Matrix2<f64>) {
        let Some(mesh) = &self.mesh else { return (*point, Matrix2::identity()) };
        let (shift, by_point) = mesh.shift(point);
        (point + shift, Matrix2::identity() + by_point)
    }

    /// The pixel of a shifted point, and its derivative by that [px/m].
    fn flat_pixel(&self, shifted: &Point2<f64>) -> Option<(Point2<f64>, Matrix2<f64>)> {
        let (ideal, ideal_by_point) = self.ideal(shifted)?;
        let (distorted, by_ideal) = self.distortion.distort_with_jacobian(&ideal)?;
        Some((self.in_pixels(&distorted), by_ideal * ideal_by_point * self.half_width()))
    }

    /// Ideal coordinates and their derivative by the shifted point.
    fn ideal(&self, point: &Point2<f64>) -> Option<(Vector2<f64>, Matrix2<f64>)> {
        let h = &self.ideal_from_plane;
        let at = h * Vector3::new(point.x, point.y, 1.0);
        let (x, y, z) = (at.x, at.y, at.z);
        if z <= 0.0 {
            return None;
        }
        let ideal = Vector2::new(x / z, y / z);
        let by_point = Matrix2::from_fn(|row, column| (h[(row, column)] - ideal[row] * h[(2, column)]) / z);
        Some((ideal, by_point))
    }

    /// Derivative of the pixel of a shifted point by the unknowns [px].
    fn pixel_by_unknowns(&self, point: &Point2<f64>) -> Option<SMatrix<f64, 2, UNKNOWNS>> {
        let (ideal, _) = self.ideal(point)?;
        let (_, by_ideal) = self.distortion.distort_with_jacobian(&ideal)?;
        let at = Vector3::new(point.x, point.y, 1.0);
        let z = self.ideal_from_plane.row(2).transpose().dot(&at);
        let mut ideal_by_h = SMatrix::<f64, 2, 8>::zeros();
        for column in 0..3 {
            ideal_by_h[(0, column)] = at[column] / z;
            ideal_by_h[(1, column + 3)] = at[column] / z;
        }
        for column in 0..2 {
            ideal_by_h[(0, column + 6)] = -ideal.x * at[column] / z;
            ideal_by_h[(1, column + 6)] = -ideal.y * at[column] / z;
        }
        let mut all = SMatrix::<f64, 2, UNKNOWNS>::zeros();
        all.fixed_view_mut::<2, 8>(0, 0).copy_from(&(by_ideal * ideal_by_h));
        let (x, y, s) = (ideal.x, ideal.y, ideal.norm_squared());
        for (column, power) in [(8, s), (9, s * s), (10, s * s * s)] {
            all.fixed_view_mut::<2, 1>(0, column).copy_from(&(ideal * power));
        }
        all.fixed_view_mut::<2, 1>(0, 11).copy_from(&Vector2::new(2.0 * x * y, s + 2.0 * y * y));
        all.fixed_view_mut::<2, 1>(0, 12).copy_from(&Vector2::new(s + 2.0 * x * x, 2.0 * x * y));
        Some(all * self.half_width())
    }

    fn moved(&self, step: &[f64]) -> PlaneMap {
        let mut moved = self.clone();
        for (place, by) in step[..8].iter().enumerate() {
            moved.ideal_from_plane[(place / 3, place % 3)] += by;
        }
        let lens = &mut moved.distortion;
        for (term, by) in
            [&mut lens.k1, &mut lens.k2, &mut lens.k3, &mut lens.p1, &mut lens.p2].into_iter().zip(&step[8..])
        {
            *term += by;
        }
        moved
    }
}

struct Fit<'a> {
    points: &'a [PlanePoint],
}

impl Problem for Fit<'_> {
    type Parameters = PlaneMap;

    fn dimension(&self) -> usize {
        UNKNOWNS
    }

    fn moved(&self, from: &PlaneMap, step: &DVector<f64>) -> PlaneMap {
        from.moved(step.as_slice())
    }

    fn linearise(&self, at: &PlaneMap, equations: &mut Equations) -> Option<()> {
        let columns: [usize; UNKNOWNS] = std::array::from_fn(|it| it);
        for it in self.points {
            let off = at.pixel(&it.point)? - it.pixel;
            let jacobian = at.pixel_by_unknowns(&it.point)?;
            equations.add(&columns, &(off / it.sigma), &(jacobian / it.sigma));
        }
        let Distortion { k1, k2, k3, p1, p2 } = at.distortion;
        for (column, term) in [k1, k2, k3, p1, p2].into_iter().enumerate() {
            let sigma = if column < 3 { PRIOR_RADIAL } else { PRIOR_DECENTERING };
            equations.add(
                &[8 + column],
                &SVector::<f64, 1>::new(term / sigma),
                &SMatrix::<f64, 1, 1>::new(1.0 / sigma),
            );
        }
        Some(())
    }
}

/// Spread of points across the direction of their largest spread, relative to that; 0 when all are one.
fn spread(points: &[Point2<f64>]) -> f64 {
    let middle = points.iter().fold(Vector2::zeros(), |sum, it| sum + it.coords) / points.len() as f64;
    let scatter = points.iter().fold(Matrix2::zeros(), |sum, it| {
        let off = it.coords - middle;
        sum + off * off.transpose()
    });
    let values = scatter.symmetric_eigenvalues();
    if values.max() > 0.0 { (values.min().max(0.0) / values.max()).sqrt() } else { 0.0 }
}

/// Takes points to a mean of 0 and a mean distance of √2 from it (Hartley and Zisserman, §4.4.4).
fn normaliser(points: impl Iterator<Item = Vector2<f64>> + Clone) -> Matrix3<f64> {
    let n = points.clone().count() as f64;
    let middle = points.clone().sum::<Vector2<f64>>() / n;
    let distance = points.map(|it| (it - middle).norm()).sum::<f64>() / n;
    let scale = std::f64::consts::SQRT_2 / distance;
    Matrix3::new(scale, 0.0, -scale * middle.x, 0.0, scale, -scale * middle.y, 0.0, 0.0, 1.0)
}

/// The homography to half widths under which most points are where they were seen, without a lens.
fn first_homography(image_size: [u32; 2], points: &[PlanePoint]) -> Option<Matrix3<f64>> {
    let half = f64::from(image_size[0]) / 2.0;
    let middle = Vector2::new(f64::from(image_size[0]) - 1.0, f64::from(image_size[1]) - 1.0) / 2.0;
    let seen: Vec<Vector2<f64>> = points.iter().map(|it| (it.pixel.coords - middle) / half).collect();
    let [a, b] = [normaliser(points.iter().map(|it| it.point.coords)), normaliser(seen.iter().copied())];
    let mut weights = vec![1.0; points.len()];
    let mut best: Option<(f64, Matrix3<f64>)> = None;
    for _ in 0..ROUNDS {
        let mut normal = DMatrix::<f64>::zeros(9, 9);
        for ((it, seen), weight) in points.iter().zip(&seen).zip(&weights) {
            let p = a * it.point.coords.push(1.0);
            let q = b * seen.push(1.0);
            for row in [
                [0.0, 0.0, 0.0, -p.x, -p.y, -1.0, q.y * p.x, q.y * p.y, q.y],
                [p.x, p.y, 1.0, 0.0, 0.0, 0.0, -q.x * p.x, -q.x * p.y, -q.x],
            ] {
                let row = SVector::<f64, 9>::from(row);
                normal += row * row.transpose() * *weight;
            }
        }
        let eigen = normal.symmetric_eigen();
        let least = eigen.eigenvalues.imin();
        let h = Matrix3::from_row_slice(eigen.eigenvectors.column(least).as_slice());
        let h = b.try_inverse()? * h * a;
        let off = |it: &PlanePoint, seen: &Vector2<f64>| {
            let at = h * it.point.coords.push(1.0);
            (Vector2::new(at.x / at.z, at.y / at.z) - seen).norm()
        };
        let offs: Vec<f64> = points.iter().zip(&seen).map(|(it, seen)| off(it, seen)).collect();
        let median = foveate_estimation::statistics::median(&offs)?;
        if best.is_none_or(|(least, _)| median < least) {
            // In front of the camera is where the points were seen.
            let front = points.iter().filter(|it| (h * it.point.coords.push(1.0)).z * h[(2, 2)] > 0.0).count();
            if 2 * front < points.len() || h[(2, 2)].abs() < 1e-12 * h.norm() {
                return None;
            }
            best = Some((median, h / h[(2, 2)]));
        }
        let width = median.max(1e-9);
        weights.iter_mut().zip(&offs).for_each(|(weight, off)| *weight = 1.0 / (1.0 + (off / (3.0 * width)).powi(2)));
    }
    best.map(|(_, h)| h)
}

#[cfg(test)]
mod tests;
