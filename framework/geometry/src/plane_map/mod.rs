//! From a plane to the pixels of one camera and back: a homography, then the lens, with covariance.
//!
//! Source: R. Hartley and A. Zisserman, *Multiple View Geometry in Computer Vision*, 2nd edition, 2004: the homography of a plane (§2.3), its direct linear
//! transform with normalised points (algorithm 4.2), its covariance carried to mapped points (§5.2.6). The lens is [`Distortion`], about the middle of the
//! picture; what the true principal point is off is taken up by the homography and the decentering terms.
//!
//! | here | meaning | unit |
//! |---|---|---|
//! | `point` | on the plane | m |
//! | `ideal` | H applied to the point: where a pinhole images it | half the picture's width |
//! | `distorted` | what the lens makes of it | half the picture's width |
//! | pixel | middle of the picture + half its width · `distorted` | px |
//!
//! A plane that bends is imaged as if each of its points were shifted: at `shifted` = point + [`Mesh::shift`], where the flat map would see what the camera sees.
//!
//! A pose and a focal length need not be told apart for that, so a camera that looks straight at the plane is no special case, unlike for a [`Camera`](crate::Camera).

mod mesh;
pub mod network;

use foveate_estimation::least_squares::{Equations, Loss, Options, Problem, solve};
use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Point2, SMatrix, SVector, Vector2, Vector3};

use self::mesh::Shifted;
use crate::Distortion;

pub use self::mesh::Mesh;

/// Numbers that a fit finds: eight of the homography, then k₁, k₂, k₃, p₁, p₂.
pub const UNKNOWNS: usize = 13;
/// Points that a fit needs: with fewer the lens is told by the prior alone.
pub const LEAST_POINTS: usize = 8;
/// Points that a fit needs where the plane bends: twice as many as shifts along both axes that no penalty holds.
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

/// How a camera images a plane.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneMap {
    /// Columns, rows [px].
    pub image_size: [u32; 2],
    /// H: takes (x, y, 1) on the plane [m] to ideal coordinates; its last entry is 1.
    pub ideal_from_plane: Matrix3<f64>,
    /// The lens, for ideal coordinates.
    pub distortion: Distortion,
    /// Of H row by row without its last entry, then k₁, k₂, k₃, p₁, p₂.
    pub covariance: SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    /// How the plane bends; `None` where it is flat.
    pub mesh: Option<Mesh>,
}

/// A point of known place, and where it was seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanePoint {
    /// On the plane [m].
    pub point: Point2<f64>,
    /// Raw pixel.
    pub pixel: Point2<f64>,
    /// Standard deviation of the pixel, along each axis [px].
    pub sigma: f64,
}

/// Why points do not give a map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlaneMapError {
    /// Too few.
    #[error("{count} points, expected at least {least}")]
    TooFew {
        /// How many there are.
        count: usize,
        /// How many it takes.
        least: usize,
    },
    /// All near one line.
    #[error(
        "{count} points on a line (spread across it {ratio:.3} of that along it), expected at least {LEAST_SPREAD}"
    )]
    OnALine {
        /// How many there are.
        count: usize,
        /// Spread across the line relative to that along it.
        ratio: f64,
    },
    /// No map images the points as they were seen.
    #[error("no homography with a lens fits the points: {0}")]
    NoFit(String),
}

/// A place on the plane, with the covariance of where it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// On the plane [m].
    pub point: Point2<f64>,
    /// From the pixel's covariance and the map's [m²].
    pub covariance: Matrix2<f64>,
    /// Metres on the plane that a pixel takes up there, along each axis of the picture [m/px].
    pub plane_by_pixel: Matrix2<f64>,
}

impl PlaneMap {
    /// Finds the map from points of known place.
    ///
    /// # Errors
    /// Too few points, points on a line, points that no map explains.
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
                .ok_or_else(|| PlaneMapError::NoFit("the direct linear transform has no answer".into()))?,
            distortion: Distortion::default(),
            covariance: SMatrix::zeros(),
            mesh: None,
        };
        let plain = Options { loss: Loss::Cauchy { scale: LOSS_SIGMAS }, ..Options::default() };
        let solution =
            solve(&Fit { points }, start, &plain).map_err(|error| PlaneMapError::NoFit(error.to_string()))?;
        let covariance = solution.covariance.map_err(|error| PlaneMapError::NoFit(format!("{error:?}")))?;
        let mut map = solution.parameters;
        // Residuals larger than their standard deviations say that either these or the model are too good.
        let factor = solution.variance_factor.max(1.0);
        map.covariance = SMatrix::from_fn(|row, column| covariance[(row, column)] * factor);
        Ok(map)
    }

    /// Finds the map of a plane that bends, over the rectangle of `size_m` from its origin: a flat map, and the smoothest shifts that explain the rest.
    ///
    /// All that is not known about the map is in the covariance of the shifts; that of the flat map is 0.
    ///
    /// # Errors
    /// As of [`Self::fit`]; points beside the rectangle; a plane that turns its back on the camera.
    pub fn fit_bent(image_size: [u32; 2], points: &[PlanePoint], size_m: [f64; 2]) -> Result<PlaneMap, PlaneMapError> {
        let count = points.len();
        if count < LEAST_BENT_POINTS {
            return Err(PlaneMapError::TooFew { count, least: LEAST_BENT_POINTS });
        }
        let no_fit = |why: &str| PlaneMapError::NoFit(why.to_owned());
        if let Some(it) = points.iter().find(|it| (0..2).any(|axis| !(0.0..=size_m[axis]).contains(&it.point[axis]))) {
            return Err(PlaneMapError::NoFit(format!(
                "found a point at {}, expected all on the {} m by {} m that bend",
                it.point, size_m[0], size_m[1]
            )));
        }
        // The flat map is to go through the middle of all points, not through those that happen to lie on a plane: each is as uncertain as the plane is off.
        let pixels_from_plane = PlaneMap::homography(image_size, points)
            .ok_or_else(|| no_fit("the direct linear transform has no answer"))?;
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
        let samples = samples.ok_or_else(|| no_fit("a point was seen where the flat map sees no plane"))?;
        let mesh = Mesh::fit(size_m, &samples).ok_or_else(|| no_fit("the points fix no shifts"))?;
        if points.iter().any(|it| (Matrix2::identity() + mesh.shift(&it.point).1).determinant() <= 0.0) {
            return Err(no_fit("the plane bends so much that the camera sees the back of it"));
        }
        map.mesh = Some(mesh);
        Ok(map)
    }

    /// The homography from the plane to raw pixels, without a lens, under which most points are where they were seen; `None` where the points fix none.
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

    /// The pixel at which a point of the plane is seen, which may lie outside the picture. `None` behind the camera and beyond what the lens images.
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

    /// The point of the plane seen at `pixel` [m]. `None` beyond what the lens images, at and above the plane's horizon, and where a bend hides the plane.
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

    /// As [`Self::point`], with covariance: that of the pixel [px²] and that of the map.
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
mod tests {
    use foveate_estimation::Random;
    use foveate_laws::check_jacobian;

    use super::*;
    use crate::{Camera, Intrinsics};

    const SIZE: [u32; 2] = [640, 480];

    /// A camera two metres before a wall that it sees at a slant, through a lens whose principal point is off.
    fn camera(k1: f64) -> Camera {
        let eye = nalgebra::Point3::new(0.9, 1.4, -2.2);
        let rotation =
            nalgebra::Rotation3::face_towards(&(nalgebra::Point3::new(1.0, 0.6, 0.0) - eye), &-nalgebra::Vector3::y());
        let rotation = nalgebra::Rotation3::from_axis_angle(&nalgebra::Vector3::z_axis(), std::f64::consts::PI)
            * rotation.inverse();
        Camera {
            image_size: SIZE,
            intrinsics: Intrinsics { focal: [900.0, 905.0], principal: [323.0, 236.0], skew: 0.2 },
            distortion: Distortion { k1, k2: 0.05, p1: 3e-4, p2: -2e-4, k3: 0.0 },
            camera_from_world: nalgebra::Isometry3::from_parts(
                nalgebra::Translation3::from(-(rotation * eye.coords)),
                rotation.into(),
            ),
        }
    }

    fn points(camera: &Camera, noise: f64, seed: u64) -> Vec<PlanePoint> {
        let mut random = Random::new(seed);
        let grid = (0..30)
            .flat_map(|column| (0..20).map(move |row| Point2::new(f64::from(column) * 0.09, f64::from(row) * 0.09)));
        grid.filter_map(|point| {
            let pixel = camera.sees(&nalgebra::Point3::new(point.x, point.y, 0.0))?;
            let pixel = pixel + Vector2::new(random.normal(), random.normal()) * noise;
            Some(PlanePoint { point, pixel, sigma: noise.max(0.01) })
        })
        .collect()
    }

    #[test]
    fn camera_over_a_plane_is_found_to_three_hundredths_of_a_pixel() {
        for k1 in [-0.2, 0.0, 0.1] {
            let camera = camera(k1);
            let seen = points(&camera, 0.0, 1);
            assert!(seen.len() > 60, "{}", seen.len());
            let map = PlaneMap::fit(SIZE, &seen).unwrap();
            for it in points(&camera, 0.0, 2) {
                let off = (map.pixel(&it.point).unwrap() - it.pixel).norm();
                assert!(off < 0.03, "k1 {k1}: {off} px at {}", it.pixel);
                let back = map.point(&it.pixel).unwrap();
                assert!((back - it.point).norm() < 9e-5, "{back} {}", it.point);
            }
        }
    }

    #[test]
    fn errors_on_the_plane_are_as_large_as_the_covariance_says() {
        let camera = camera(-0.1);
        let (noise, mut normalised, mut n) = (0.2, 0.0, 0.0);
        for seed in 1..=40 {
            let map = PlaneMap::fit(SIZE, &points(&camera, noise, seed)).unwrap();
            let mut random = Random::new(seed + 1000);
            for it in points(&camera, 0.0, 1).iter().step_by(7) {
                let pixel = it.pixel + Vector2::new(random.normal(), random.normal()) * noise;
                let placed = map.place(&pixel, &(Matrix2::identity() * noise * noise)).unwrap();
                let off = placed.point - it.point;
                normalised += off.dot(&(placed.covariance.try_inverse().unwrap() * off));
                n += 2.0;
            }
        }
        let mean: f64 = normalised / n;
        assert!((0.85..1.2).contains(&mean), "normalised error squared {mean}, expected 1");
    }

    #[test]
    fn derivatives_are_those_of_the_map() {
        let map = PlaneMap::fit(SIZE, &points(&camera(-0.2), 0.1, 1)).unwrap();
        let point = Point2::new(0.7, 0.4);
        let pixel =
            |map: &PlaneMap, x: &[f64]| <[f64; 2]>::from(map.pixel(&Point2::new(x[0], x[1])).unwrap().coords).to_vec();
        let by_point = map.pixel_with_jacobian(&point).unwrap().1;
        check_jacobian(|x| pixel(&map, x), &DMatrix::from_fn(2, 2, |r, c| by_point[(r, c)]), &[0.7, 0.4], 1e-5);
        let by_unknowns = map.pixel_by_unknowns(&point).unwrap();
        let jacobian = DMatrix::from_fn(2, UNKNOWNS, |r, c| by_unknowns[(r, c)]);
        check_jacobian(|step| pixel(&map.moved(step), &[0.7, 0.4]), &jacobian, &[0.0; UNKNOWNS], 1e-4);
    }

    /// A wall of 2.6 m by 1.7 m along an arc whose ends come nearer, with swells of a centimetre, at even places, through the lens of `camera`.
    fn bent(point: &Point2<f64>, radius: f64) -> nalgebra::Point3<f64> {
        let angle = (point.x - WALL[0] / 2.0) / radius;
        let swell = 0.01 * (2.5 * point.x + 0.4).sin() * (3.0 * point.y).cos();
        let out = radius * (1.0 - angle.cos()) + swell;
        nalgebra::Point3::new(WALL[0] / 2.0 + radius * angle.sin(), point.y, -out)
    }

    const WALL: [f64; 2] = [2.6, 1.7];

    /// Dots of a grid of `step`, as a camera sees them on a wall that bends.
    fn bent_points(camera: &Camera, radius: f64, step: f64, noise: f64, seed: u64) -> Vec<PlanePoint> {
        let mut random = Random::new(seed);
        let n = WALL.map(|it| (it / step) as u32);
        let grid =
            (0..=n[0]).flat_map(|column| (0..=n[1]).map(move |row| [column, row].map(|it| f64::from(it) * step)));
        grid.filter_map(|point| {
            let pixel = camera.sees(&bent(&point.into(), radius))?;
            let pixel = pixel + Vector2::new(random.normal(), random.normal()) * noise;
            Some(PlanePoint { point: point.into(), pixel, sigma: noise.max(0.01) })
        })
        .collect()
    }

    /// Median and 95th percentile of the error of a map at points between those it was fitted to [m].
    fn errors(map: &PlaneMap, camera: &Camera, radius: f64) -> (f64, f64) {
        let all = bent_points(camera, radius, 0.037, 0.0, 1);
        let offs: Vec<f64> =
            all.iter().map(|it| map.point(&it.pixel).map_or(f64::INFINITY, |at| (at - it.point).norm())).collect();
        let of = |it: f64| foveate_estimation::statistics::percentile(&offs, it).unwrap();
        (of(50.0), of(95.0))
    }

    #[test]
    fn wall_that_bends_is_found_to_tenths_of_a_millimetre_where_a_flat_map_is_off_by_ten_times_that() {
        for radius in [2.0, 4.0, -3.0] {
            let camera = camera(-0.1);
            let seen = bent_points(&camera, radius, 0.09, 0.05, 3);
            let flat = PlaneMap::fit(SIZE, &seen).unwrap();
            let map = PlaneMap::fit_bent(SIZE, &seen, WALL).unwrap();
            let (found, expected) = (errors(&map, &camera, radius), errors(&flat, &camera, radius));
            assert!(found.0 < 1.5e-4 && found.1 < 4e-4, "radius {radius}, {} dots: {found:?} m", seen.len());
            assert!(expected.1 > 10.0 * found.1, "flat {expected:?} m, bent {found:?} m");
            for it in &seen {
                let there = map.pixel(&map.point(&it.pixel).unwrap()).unwrap();
                assert!((there - it.pixel).norm() < 1e-5, "{there} {}", it.pixel);
            }
        }
    }

    #[test]
    fn flat_wall_loses_little_by_a_map_that_could_bend() {
        let (mut flat, mut could) = (0.0, 0.0);
        for seed in 1..=10 {
            let camera = camera(-0.1);
            let seen = bent_points(&camera, 1e9, 0.09, 0.05, seed);
            let seen: Vec<PlanePoint> = seen
                .into_iter()
                .filter_map(|it| {
                    let pixel = camera.sees(&nalgebra::Point3::new(it.point.x, it.point.y, 0.0))?;
                    let mut random = Random::new(seed * 1000 + (it.point.x * 977.0 + it.point.y * 7919.0) as u64);
                    Some(PlanePoint { pixel: pixel + Vector2::new(random.normal(), random.normal()) * 0.05, ..it })
                })
                .collect();
            let rms = |map: &PlaneMap| -> f64 {
                let all = points(&camera, 0.0, 1);
                let offs = all.iter().filter_map(|it| Some((map.point(&it.pixel)? - it.point).norm_squared()));
                let offs: Vec<f64> = offs.collect();
                (offs.iter().sum::<f64>() / offs.len() as f64).sqrt()
            };
            flat += rms(&PlaneMap::fit(SIZE, &seen).unwrap());
            could += rms(&PlaneMap::fit_bent(SIZE, &seen, WALL).unwrap());
        }
        assert!(could < 1.5 * flat, "flat {flat}, with shifts {could}");
    }

    #[test]
    fn errors_on_a_wall_that_bends_are_as_large_as_the_covariance_says() {
        let camera = camera(-0.1);
        let (noise, mut normalised, mut n) = (0.2, 0.0, 0.0);
        for seed in 1..=20 {
            let map = PlaneMap::fit_bent(SIZE, &bent_points(&camera, 3.0, 0.11, noise, seed), WALL).unwrap();
            let mut random = Random::new(seed + 1000);
            for it in bent_points(&camera, 3.0, 0.09, 0.0, 1).iter().step_by(7) {
                let pixel = it.pixel + Vector2::new(random.normal(), random.normal()) * noise;
                let placed = map.place(&pixel, &(Matrix2::identity() * noise * noise)).unwrap();
                let off = placed.point - it.point;
                normalised += off.dot(&(placed.covariance.try_inverse().unwrap() * off));
                n += 2.0;
            }
        }
        let mean: f64 = normalised / n;
        assert!((0.7..1.4).contains(&mean), "normalised error squared {mean}, expected 1");
    }

    #[test]
    fn where_a_wall_that_bends_showed_no_dots_its_map_says_that_it_does_not_know() {
        let camera = camera(-0.1);
        let all = bent_points(&camera, 3.0, 0.09, 0.1, 1);
        // The corner that is missing.
        let is_there = |it: &&PlanePoint| it.point.x > 0.7 || it.point.y > 0.6;
        let (seen, missing): (Vec<&PlanePoint>, Vec<&PlanePoint>) = all.iter().partition(is_there);
        assert!(missing.len() > 8, "{}", missing.len());
        let seen: Vec<PlanePoint> = seen.into_iter().copied().collect();
        let map = PlaneMap::fit_bent(SIZE, &seen, WALL).unwrap();
        let place = |it: &PlanePoint| map.place(&it.pixel, &(Matrix2::identity() * 0.01)).unwrap();
        let sigma = |it: &PlanePoint| place(it).covariance.trace().sqrt();
        let known = foveate_estimation::statistics::median(&seen.iter().map(sigma).collect::<Vec<_>>()).unwrap();
        let mut normalised = 0.0;
        for it in &missing {
            let off = place(it).point - it.point;
            normalised += off.dot(&(place(it).covariance.try_inverse().unwrap() * off));
        }
        let farthest = missing.iter().max_by(|a, b| sigma(a).total_cmp(&sigma(b))).unwrap();
        assert!(sigma(farthest) > 10.0 * known, "{} m where nothing was seen, {known} m elsewhere", sigma(farthest));
        let mean = normalised / (2 * missing.len()) as f64;
        assert!(mean < 4.0, "normalised error squared {mean} where nothing was seen");
    }

    #[test]
    fn dots_seen_wrongly_do_not_bend_a_wall_that_bends() {
        let camera = camera(-0.1);
        let mut seen = bent_points(&camera, 3.0, 0.09, 0.05, 1);
        for it in seen.iter_mut().step_by(9) {
            it.pixel.x += 60.0;
        }
        let map = PlaneMap::fit_bent(SIZE, &seen, WALL).unwrap();
        let found = errors(&map, &camera, 3.0);
        assert!(found.0 < 2e-4 && found.1 < 1e-3, "{found:?} m");
    }

    #[test]
    fn derivatives_are_those_of_the_map_where_it_bends() {
        let map = PlaneMap::fit_bent(SIZE, &bent_points(&camera(-0.2), 3.0, 0.09, 0.1, 1), WALL).unwrap();
        // Within, and beyond the edge, where shifts go on in a straight line.
        for at in [[0.7, 0.4], [1.3, -0.1]] {
            let by_point = map.pixel_with_jacobian(&at.into()).unwrap().1;
            let pixel = |x: &[f64]| <[f64; 2]>::from(map.pixel(&Point2::new(x[0], x[1])).unwrap().coords).to_vec();
            check_jacobian(pixel, &DMatrix::from_fn(2, 2, |r, c| by_point[(r, c)]), &at, 1e-5);
        }
    }

    #[test]
    fn points_seen_wrongly_do_not_bend_the_map() {
        let camera = camera(-0.1);
        let mut seen = points(&camera, 0.05, 1);
        for it in seen.iter_mut().step_by(9) {
            it.pixel.x += 60.0;
        }
        let map = PlaneMap::fit(SIZE, &seen).unwrap();
        for it in points(&camera, 0.0, 1) {
            assert!((map.pixel(&it.point).unwrap() - it.pixel).norm() < 0.15, "{}", it.pixel);
        }
    }

    #[test]
    fn too_few_points_and_points_on_a_line_are_refused_by_name() {
        let all = points(&camera(0.0), 0.0, 1);
        assert_eq!(PlaneMap::fit(SIZE, &all[..7]), Err(PlaneMapError::TooFew { count: 7, least: LEAST_POINTS }));
        let few = PlaneMap::fit_bent(SIZE, &all[..20], [4.0; 2]);
        assert_eq!(few, Err(PlaneMapError::TooFew { count: 20, least: LEAST_BENT_POINTS }));
        let beside = PlaneMap::fit_bent(SIZE, &all, [1.0, 0.5]).unwrap_err().to_string();
        assert!(beside.contains("expected all on the 1 m by 0.5 m"), "{beside}");
        let line: Vec<PlanePoint> = all.iter().copied().filter(|it| (it.point.y - 0.45).abs() < 1e-9).collect();
        assert!(matches!(PlaneMap::fit(SIZE, &line), Err(PlaneMapError::OnALine { .. })), "{}", line.len());
        let one = vec![all[0]; 20];
        assert!(matches!(PlaneMap::fit(SIZE, &one), Err(PlaneMapError::OnALine { count: 20, ratio: 0.0 })));
    }

    #[test]
    fn nothing_is_imaged_behind_the_camera_or_above_the_horizon() {
        let mut camera = camera(0.0);
        let eye = nalgebra::Point3::new(0.0, 0.0, -0.5);
        // Nearly along the wall: it sees the horizon.
        camera.camera_from_world = {
            let z = nalgebra::Vector3::new(1.0, 0.0, 0.15).normalize();
            let y = nalgebra::Vector3::y();
            let x = y.cross(&z);
            let rotation = nalgebra::Rotation3::from_matrix_unchecked(Matrix3::from_rows(&[
                x.transpose(),
                y.transpose(),
                z.transpose(),
            ]));
            nalgebra::Isometry3::from_parts(nalgebra::Translation3::from(-(rotation * eye.coords)), rotation.into())
        };
        let grid = (0..40).flat_map(|column| {
            (-20..20).map(move |row| Point2::new(0.5 + 0.1 * f64::from(column), 0.1 * f64::from(row)))
        });
        let seen: Vec<PlanePoint> = grid
            .filter_map(|point| {
                let pixel = camera.sees(&nalgebra::Point3::new(point.x, point.y, 0.0))?;
                Some(PlanePoint { point, pixel, sigma: 0.01 })
            })
            .collect();
        let map = PlaneMap::fit(SIZE, &seen).unwrap();
        assert_eq!(map.pixel(&Point2::new(-3.0, 0.0)), None, "behind the camera");
        let sky =
            (0..640).map(|column| Point2::new(f64::from(column), 240.0)).filter(|it| map.point(it).is_none()).count();
        assert!((50..600).contains(&sky), "{sky} columns show no wall");
    }
}
