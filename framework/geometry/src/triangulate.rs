//! Triangulation: a point from several lines of sight, refined on the pixels.
//!
//! [`triangulate_rays`] gives the point with the least sum of squared distances to all lines: in closed form, without
//! weights. [`refine`] starts there and minimises Σ rᵢᵀ Wᵢ rᵢ over the point, rᵢ the reprojection error of camera i
//! and Wᵢ the inverse of its covariance, by Levenberg–Marquardt: the maximum-likelihood point under Gaussian pixel
//! noise. Its covariance is (Σ Jᵢᵀ Wᵢ Jᵢ)⁻¹, Jᵢ the derivative of pixel i by the point. Neither allocates.
//!
//! ```
//! use foveate_geometry::{Camera, PixelNoise, refine, triangulate_rays};
//! use nalgebra::{Point3, Vector2};
//!
//! let light = Point3::new(0.2, 0.4, 1.1);
//! let cameras = [[3.0, 0.0, 2.0], [0.0, 3.0, 2.0], [-2.0, -2.0, 2.5]]
//!     .map(|centre| Camera::look_at(Point3::from(centre), Point3::new(0.0, 0.0, 1.0), [640, 480], 500.0));
//! // Each camera measures the light half a pixel off.
//! let pixels = cameras.each_ref().map(|it| it.project(&light).unwrap() + Vector2::new(0.3, -0.4));
//! let rays = [0, 1, 2].map(|index| cameras[index].ray(&pixels[index]).unwrap());
//!
//! let start = triangulate_rays(&rays).unwrap();
//! let found = refine(&cameras.each_ref(), &pixels, PixelNoise::Sigma(0.5), start)?;
//! assert!((found.position - light).norm() < 0.003, "half a pixel is 3 mm at 3 m");
//! assert!(found.residuals_rms_px < 0.5 && found.covariance.trace().sqrt() < 0.005);
//! # Ok::<(), foveate_geometry::TriangulationError>(())
//! ```

use foveate_estimation::least_squares::{
    Damping, DriverOptions, SmallEquations, SmallProblem, SmallSolution, Stop, solve_small,
};
use nalgebra::{Matrix2, Matrix3, Point2, Point3, Vector3};

use crate::camera::Camera;
use crate::ray::Ray;

/// Pixel noise of a triangulation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PixelNoise<'a> {
    /// One standard deviation for both coordinates of all pixels [px].
    Sigma(f64),
    /// A covariance for each pixel [px²].
    Covariances(&'a [Matrix2<f64>]),
}

/// A triangulated point with covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Triangulation {
    /// Position in the world [m].
    pub position: Point3<f64>,
    /// Covariance of the position, if the stated noise is right [m²].
    pub covariance: Matrix3<f64>,
    /// Root mean square reprojection error [px].
    pub residuals_rms_px: f64,
    /// Iterations, rejected steps included.
    pub iterations: u32,
}

/// Why [`refine`] has no result.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum TriangulationError {
    /// Lists of different lengths.
    #[error("{cameras} cameras, {pixels} pixels and {covariances} covariances, expected as many of each")]
    LengthsDiffer {
        /// Number of cameras.
        cameras: usize,
        /// Number of pixels.
        pixels: usize,
        /// Number of covariances; with a single sigma, that of the pixels.
        covariances: usize,
    },
    /// Fewer than two cameras.
    #[error("{count} cameras do not determine a point, expected at least 2")]
    TooFew {
        /// Number of cameras.
        count: usize,
    },
    /// Noise that is not a positive definite covariance.
    #[error("the noise of pixel {index} is not a positive definite covariance")]
    BadNoise {
        /// Index of the pixel.
        index: usize,
    },
    /// The starting point is not visible, or the pixel is not finite.
    #[error("camera {index} does not see the starting point, or its pixel is not finite")]
    NotVisible {
        /// Index of the camera.
        index: usize,
    },
    /// All lines of sight are nearly parallel: the depth is unobservable.
    #[error("the lines of sight are nearly parallel: the best known direction is {ratio:.1e} times the worst")]
    Degenerate {
        /// Standard deviation along the best known over that along the worst known direction.
        ratio: f64,
    },
    /// No convergence, usually since the pixels belong to different points.
    #[error("no convergence after {iterations} iterations")]
    NoConvergence {
        /// Iterations.
        iterations: u32,
    },
}

/// Information matrices whose least eigenvalue is below this share of the largest are singular: lines of sight within
/// about 3e-6 rad of each other.
const SINGULAR: f64 = 1e-12;
/// Depths of distant points are badly conditioned and hardly curved: little damping, that falls fast. Half of 1e-6 squared standard deviations is
/// little beside any cost.
const OPTIONS: DriverOptions = DriverOptions {
    damping: Damping { initial: 1e-6, least: 1e-12, fastest_decrease: 0.1 },
    max_iterations: 60,
    relative_gain: 1e-14,
    absolute_gain: 0.5e-20,
};

/// The point with the least sum of squared distances to the lines of `rays`; it may lie behind an origin. `None` for
/// fewer than two rays, for (nearly) parallel ones, or when a number is not finite.
pub fn triangulate_rays(rays: &[Ray]) -> Option<Point3<f64>> {
    let near = rays.first().filter(|_| rays.len() >= 2)?.origin; // origins relative to this keep their digits
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for ray in rays {
        let direction = ray.direction.into_inner();
        let off_the_line = Matrix3::identity() - direction * direction.transpose();
        normal += off_the_line;
        right += off_the_line * (ray.origin - near);
    }
    // The largest eigenvalue is at most the count and the middle one at least a third of it, so that the determinant
    // over count³ is, up to a factor of three, the least eigenvalue over the count.
    let solid = normal.determinant() > SINGULAR * (rays.len() as f64).powi(3);
    let point = near + normal.try_inverse().filter(|_| solid)? * right;
    point.iter().all(|it| it.is_finite()).then_some(point)
}

/// Triangulates the point with the least reprojection error to `pixels`, weighted by `noise`, from `start`.
///
/// # Errors
/// See [`TriangulationError`].
pub fn refine(
    cameras: &[&Camera],
    pixels: &[Point2<f64>],
    noise: PixelNoise<'_>,
    start: Point3<f64>,
) -> Result<Triangulation, TriangulationError> {
    let uniform = match noise {
        PixelNoise::Sigma(sigma) => Matrix2::identity() / (sigma * sigma),
        PixelNoise::Covariances(_) => Matrix2::zeros(),
    };
    let problem = Problem { cameras, pixels, noise, uniform };
    problem.check()?;
    let Ok(SmallSolution { parameters: position, equations, outcome }) = solve_small(&problem, start, &OPTIONS) else {
        let unseen = problem.linearised(&start, &mut SmallEquations::zeros()).err();
        return Err(TriangulationError::NotVisible { index: unseen.unwrap_or(0) });
    };
    let covariance = invert_information(&equations.information)?;
    let iterations = outcome.iterations;
    if outcome.stop == Stop::IterationLimit {
        return Err(TriangulationError::NoConvergence { iterations });
    }
    let squares: f64 = problem.pixel_errors(&position).sum();
    let residuals_rms_px = (squares / pixels.len() as f64).sqrt();
    Ok(Triangulation { position, covariance, residuals_rms_px, iterations })
}

struct Problem<'a> {
    cameras: &'a [&'a Camera],
    pixels: &'a [Point2<f64>],
    noise: PixelNoise<'a>,
    /// Inverse covariance of all pixels, where they have one sigma [px⁻²].
    uniform: Matrix2<f64>,
}

impl Problem<'_> {
    fn check(&self) -> Result<(), TriangulationError> {
        let (cameras, pixels) = (self.cameras.len(), self.pixels.len());
        let covariances = match self.noise {
            PixelNoise::Sigma(_) => pixels,
            PixelNoise::Covariances(list) => list.len(),
        };
        if cameras != pixels || pixels != covariances {
            return Err(TriangulationError::LengthsDiffer { cameras, pixels, covariances });
        }
        if cameras < 2 {
            return Err(TriangulationError::TooFew { count: cameras });
        }
        match (0..cameras).find(|&index| self.weight(index).is_none()) {
            Some(index) => Err(TriangulationError::BadNoise { index }),
            None => Ok(()),
        }
    }

    /// Inverse covariance of a pixel [px⁻²].
    fn weight(&self, index: usize) -> Option<Matrix2<f64>> {
        match self.noise {
            PixelNoise::Sigma(sigma) => (sigma > 0.0 && sigma.is_finite()).then_some(self.uniform),
            PixelNoise::Covariances(list) => {
                let covariance = list[index];
                let positive = covariance[(0, 0)] > 0.0 && covariance.determinant() > 0.0;
                covariance.try_inverse().filter(|it| positive && it.iter().all(|value| value.is_finite()))
            }
        }
    }

    /// At `position`; the error is the first camera that does not see it, or whose pixel is not finite.
    fn linearised(&self, position: &Point3<f64>, sum: &mut SmallEquations<3>) -> Result<(), usize> {
        for (index, (camera, pixel)) in self.cameras.iter().zip(self.pixels).enumerate() {
            let (seen, jacobian) = camera.project_with_jacobian(position).ok_or(index)?;
            let weight = self.weight(index).ok_or(index)?;
            let residual = seen - pixel;
            let weighted = jacobian.transpose() * weight;
            sum.information += weighted * jacobian;
            sum.gradient += weighted * residual;
            sum.cost += 0.5 * residual.dot(&(weight * residual));
            if !sum.cost.is_finite() {
                return Err(index);
            }
        }
        Ok(())
    }

    fn pixel_errors(&self, position: &Point3<f64>) -> impl Iterator<Item = f64> {
        let each = self.cameras.iter().zip(self.pixels);
        each.filter_map(move |(camera, pixel)| camera.project(position).map(|seen| (pixel - seen).norm_squared()))
    }
}

impl SmallProblem<3> for Problem<'_> {
    type Parameters = Point3<f64>;

    fn moved(&self, from: &Point3<f64>, step: &Vector3<f64>) -> Point3<f64> {
        from + step
    }

    fn linearise(&self, at: &Point3<f64>, equations: &mut SmallEquations<3>) -> Option<()> {
        self.linearised(at, equations).ok()
    }
}

fn invert_information(information: &Matrix3<f64>) -> Result<Matrix3<f64>, TriangulationError> {
    let eigenvalues = information.symmetric_eigenvalues();
    let ratio = eigenvalues.min().max(0.0) / eigenvalues.max();
    let inverse = information.try_inverse().filter(|_| ratio > SINGULAR);
    inverse.ok_or(TriangulationError::Degenerate { ratio: ratio.sqrt() })
}

#[cfg(test)]
mod tests {
    use nalgebra::{Unit, Vector2};
    use proptest::prelude::*;

    use super::*;
    use crate::camera::Distortion;

    /// `count` distorted cameras on a ring of 3 m around the origin, at different heights.
    fn ring(count: usize) -> Vec<Camera> {
        let camera = |index: usize| {
            let angle = 2.0 * std::f64::consts::PI * index as f64 / count as f64 + 0.1;
            let centre = Point3::new(3.0 * angle.cos(), 3.0 * angle.sin(), 0.5 + 0.3 * (index % 3) as f64);
            let mut camera = Camera::look_at(centre, Point3::origin(), [640, 480], 500.0);
            camera.distortion = Distortion { k1: -0.2, k2: 0.05, p1: 0.001, p2: -0.002, k3: 0.0 };
            camera
        };
        (0..count).map(camera).collect()
    }

    fn seen_by(cameras: &[Camera], point: &Point3<f64>) -> Vec<Point2<f64>> {
        cameras.iter().map(|camera| camera.project(point).unwrap()).collect()
    }

    fn rays_of(cameras: &[Camera], pixels: &[Point2<f64>]) -> Vec<Ray> {
        cameras.iter().zip(pixels).map(|(camera, pixel)| camera.ray(pixel).unwrap()).collect()
    }

    /// Refines from the rays' point, the way callers do.
    fn refined(
        cameras: &[Camera],
        pixels: &[Point2<f64>],
        noise: PixelNoise<'_>,
    ) -> Result<Triangulation, TriangulationError> {
        let start = triangulate_rays(&rays_of(cameras, pixels)).unwrap_or_else(Point3::origin);
        refine(&cameras.iter().collect::<Vec<_>>(), pixels, noise, start)
    }

    proptest! {
        #[test]
        fn exact_pixels_give_the_point_back(
            point in prop::array::uniform3(-0.8..0.8), count in 2usize..9, shift in prop::array::uniform3(-0.5..0.5),
        ) {
            let (cameras, point) = (ring(count), Point3::from(point));
            let pixels = seen_by(&cameras, &point);
            let rays = rays_of(&cameras, &pixels);
            prop_assume!(count > 2 || rays[0].direction.cross(&rays[1].direction).norm() > 0.02);
            prop_assert!((triangulate_rays(&rays).unwrap() - point).norm() < 1e-7);
            let list: Vec<&Camera> = cameras.iter().collect();
            let found = refine(&list, &pixels, PixelNoise::Sigma(0.1), point + Vector3::from(shift)).unwrap();
            prop_assert!((found.position - point).norm() < 1e-6, "{:?}", found);
            prop_assert!(found.residuals_rms_px < 1e-4 && found.iterations < 30, "{:?}", found);
        }
    }

    /// A number in 0..1 from a counter; enough of a random number for noise here.
    fn hashed(counter: &mut u64) -> f64 {
        *counter = counter.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*counter >> 11) as f64 / (1u64 << 53) as f64
    }

    #[test]
    fn the_error_is_what_the_covariance_says() {
        let cameras = ring(5);
        let sigma = 0.3;
        let mut counter = 1;
        let (mut distances, mut squares) = (0.0, 0.0);
        let runs = 2000;
        for _ in 0..runs {
            let point = Point3::from([(); 3].map(|()| hashed(&mut counter) - 0.5));
            let mut pixels = seen_by(&cameras, &point);
            for pixel in &mut pixels {
                // The sum of twelve uniform numbers less six has variance one.
                let mut gauss = || (0..12).map(|_| hashed(&mut counter)).sum::<f64>() - 6.0;
                *pixel += Vector2::new(gauss(), gauss()) * sigma;
            }
            let found = refined(&cameras, &pixels, PixelNoise::Sigma(sigma)).unwrap();
            let error = found.position - point;
            distances += error.dot(&(found.covariance.try_inverse().unwrap() * error));
            squares += found.residuals_rms_px.powi(2);
        }
        // χ² with 3 degrees of freedom: mean 3, standard error √(6/2000) = 0.055. Residuals: 2·5 − 3 degrees of freedom.
        let (mean, residual) = (distances / f64::from(runs), squares / f64::from(runs));
        assert!((mean - 3.0).abs() < 0.22, "{mean}");
        assert!((residual / (sigma * sigma * 7.0 / 5.0) - 1.0).abs() < 0.05, "{residual}");
    }

    #[test]
    fn a_pixel_of_large_covariance_counts_little() {
        let cameras = ring(4);
        let point = Point3::new(0.1, -0.2, 0.3);
        let mut pixels = seen_by(&cameras, &point);
        pixels[2].x += 20.0;
        let mut covariances = [Matrix2::identity() * 0.01; 4];
        let error = |covariances: &[Matrix2<f64>]| {
            (refined(&cameras, &pixels, PixelNoise::Covariances(covariances)).unwrap().position - point).norm()
        };
        assert!(error(&covariances) > 0.01);
        // Only the direction of the error is uncertain: the other one still counts.
        covariances[2] = Matrix2::new(1e6, 0.0, 0.0, 0.01);
        assert!(error(&covariances) < 1e-5);
        covariances[2] = Matrix2::identity() * 1e6;
        assert!(error(&covariances) < 1e-5);
    }

    #[test]
    fn rays_that_fix_no_point_are_refused() {
        let ray = |origin: [f64; 3], direction: [f64; 3]| Ray {
            origin: origin.into(),
            direction: Unit::new_normalize(direction.into()),
        };
        let a = ray([0.0; 3], [0.0, 1.0, 0.0]);
        assert_eq!([triangulate_rays(&[]), triangulate_rays(&[a])], [None; 2]);
        for other in [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 1.0, 1e-7]] {
            assert_eq!(triangulate_rays(&[a, ray([1.0, 0.0, 0.0], other), a, a]), None, "{other:?}");
        }
        assert_eq!(triangulate_rays(&[a, ray([f64::NAN, 0.0, 0.0], [1.0, 0.0, 0.0])]), None);
        let far = ray([1e6, 1e6, 0.0], [1.0, 0.0, 0.0]);
        let near_far = triangulate_rays(&[ray([1e6, 0.0, 0.0], [0.0, 1.0, 0.0]), far]).unwrap();
        assert!((near_far - Point3::new(1e6, 1e6, 0.0)).norm() < 1e-6);
    }

    #[test]
    fn each_way_to_have_no_answer_is_told_apart() {
        let cameras = ring(3);
        let list: Vec<&Camera> = cameras.iter().collect();
        let point = Point3::new(0.1, 0.2, 0.3);
        let pixels = seen_by(&cameras, &point);
        let fault = |cameras: &[&Camera], pixels: &[Point2<f64>], noise: PixelNoise<'_>, start: Point3<f64>| {
            refine(cameras, pixels, noise, start).unwrap_err()
        };
        let fine = PixelNoise::Sigma(0.1);
        assert_eq!(
            fault(&list, &pixels[..2], fine, point),
            TriangulationError::LengthsDiffer { cameras: 3, pixels: 2, covariances: 2 }
        );
        assert_eq!(
            fault(&list, &pixels, PixelNoise::Covariances(&[]), point),
            TriangulationError::LengthsDiffer { cameras: 3, pixels: 3, covariances: 0 }
        );
        assert_eq!(fault(&list[..1], &pixels[..1], fine, point), TriangulationError::TooFew { count: 1 });
        for sigma in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let noise = PixelNoise::Sigma(sigma);
            assert_eq!(fault(&list, &pixels, noise, point), TriangulationError::BadNoise { index: 0 });
        }
        let one = Matrix2::identity();
        let bad = [one, one, Matrix2::new(1.0, 2.0, 2.0, 1.0)];
        assert_eq!(
            fault(&list, &pixels, PixelNoise::Covariances(&bad), point),
            TriangulationError::BadNoise { index: 2 }
        );
        let behind = cameras[1].centre() + (cameras[1].centre() - point);
        assert!(matches!(fault(&list, &pixels, fine, behind), TriangulationError::NotVisible { .. }));
        let mut broken = pixels.clone();
        broken[1].y = f64::NAN;
        assert_eq!(fault(&list, &broken, fine, point), TriangulationError::NotVisible { index: 1 });
        // The same camera twice knows no depth.
        let twice = fault(&[list[0], list[0]], &[pixels[0], pixels[0]], fine, point);
        assert!(matches!(twice, TriangulationError::Degenerate { ratio } if ratio < 1e-5), "{twice}");
    }
}
