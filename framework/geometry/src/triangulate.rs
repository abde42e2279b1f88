//! A point from several lines of sight, and its refinement on the pixels themselves.
//!
//! [`triangulate_rays`] gives the point whose squared distances to all lines have the least sum: in closed form, but
//! blind to how well each camera sees. [`refine`] starts from there and minimises Σ rᵢᵀ Wᵢ rᵢ over the point, rᵢ being
//! the pixel error of camera i and Wᵢ the inverse of its covariance, by Levenberg–Marquardt: the maximum-likelihood
//! point under Gaussian pixel noise. Its covariance is (Σ Jᵢᵀ Wᵢ Jᵢ)⁻¹, Jᵢ the derivative of pixel i by the point.
//!
//! Neither allocates.

use nalgebra::{Matrix2, Matrix3, Point2, Point3, Vector3};

use crate::camera::Camera;
use crate::ray::Ray;

/// How well the pixels of a triangulation are known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PixelNoise<'a> {
    /// One standard deviation for both directions of all pixels [px].
    Sigma(f64),
    /// One covariance a pixel [px²].
    Covariances(&'a [Matrix2<f64>]),
}

/// What [`refine`] found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Triangulation {
    /// In the world [m].
    pub position: Point3<f64>,
    /// Of the position, if the noise is what was stated [m²].
    pub covariance: Matrix3<f64>,
    /// Root of the mean over the cameras of the squared pixel distance [px].
    pub residuals_rms_px: f64,
    /// Steps tried, rejected ones included.
    pub iterations: u32,
}

/// Why [`refine`] has no answer.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum TriangulationFault {
    /// Lists of different lengths.
    #[error("{cameras} cameras, {pixels} pixels and {covariances} covariances, expected as many of each")]
    LengthsDiffer {
        /// How many cameras.
        cameras: usize,
        /// How many pixels.
        pixels: usize,
        /// How many covariances; with a single sigma, as many as pixels.
        covariances: usize,
    },
    /// Fewer than two cameras.
    #[error("{count} cameras do not fix a point, expected at least 2")]
    TooFew {
        /// How many.
        count: usize,
    },
    /// The noise of a pixel is not that of anything.
    #[error("the noise of pixel {index} is not a positive definite covariance")]
    BadNoise {
        /// Which.
        index: usize,
    },
    /// The starting point cannot be seen, or the pixel is not a number.
    #[error("camera {index} does not see the starting point, or its pixel is not finite")]
    NotVisible {
        /// Which.
        index: usize,
    },
    /// All lines of sight are nearly parallel: the depth is not known.
    #[error("the lines of sight are nearly parallel: the best known direction is {ratio:.1e} times the worst")]
    Degenerate {
        /// Standard deviation along the best known over that along the worst known direction.
        ratio: f64,
    },
    /// No minimum within the allowed steps, usually since the pixels do not belong together.
    #[error("no minimum after {iterations} steps")]
    NoConvergence {
        /// Steps tried.
        iterations: u32,
    },
}

/// Information matrices whose least eigenvalue is below this share of the largest are singular: lines of sight within
/// about 3e-6 rad of each other.
const SINGULAR: f64 = 1e-12;
const MAX_ITERATIONS: u32 = 60;

/// The point with the least sum of squared distances to the lines of `rays`, from which it may lie behind the origin.
/// `None` for fewer than two rays, for (nearly) parallel ones, or when a number is not finite.
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

/// Finds the point whose projections come closest to `pixels`, weighted by `noise`, starting at `start`.
pub fn refine(
    cameras: &[&Camera],
    pixels: &[Point2<f64>],
    noise: PixelNoise<'_>,
    start: Point3<f64>,
) -> Result<Triangulation, TriangulationFault> {
    let problem = Problem { cameras, pixels, noise };
    problem.check()?;
    let mut position = start;
    let mut here = problem.normal_equations(&position).map_err(|index| TriangulationFault::NotVisible { index })?;
    let mut damping = 1e-6;
    for iterations in 1..=MAX_ITERATIONS {
        let mut damped = here.information;
        damped.set_diagonal(&(here.information.diagonal() * (1.0 + damping)));
        let step = damped.cholesky().map(|it| it.solve(&here.gradient)).unwrap_or_else(Vector3::zeros);
        let candidate = position + step;
        let there = problem.normal_equations(&candidate).ok().filter(|it| it.cost <= here.cost);
        // The gain that the linear model promises, relative to the cost and to one squared standard deviation.
        let done = step.dot(&here.gradient) <= 1e-14 * (here.cost + 1e-6);
        if let Some(there) = there {
            (position, here) = (candidate, there);
            damping = (damping * 0.1).max(1e-12);
        } else {
            damping = (damping * 10.0).max(1e-6);
        }
        if done {
            let squares: f64 = problem.pixel_errors(&position).sum();
            return Ok(Triangulation {
                position,
                covariance: invert_information(&here.information)?,
                residuals_rms_px: (squares / pixels.len() as f64).sqrt(),
                iterations,
            });
        }
    }
    invert_information(&here.information)?;
    Err(TriangulationFault::NoConvergence { iterations: MAX_ITERATIONS })
}

struct Problem<'a> {
    cameras: &'a [&'a Camera],
    pixels: &'a [Point2<f64>],
    noise: PixelNoise<'a>,
}

struct NormalEquations {
    information: Matrix3<f64>,
    gradient: Vector3<f64>,
    cost: f64,
}

impl Problem<'_> {
    fn check(&self) -> Result<(), TriangulationFault> {
        let (cameras, pixels) = (self.cameras.len(), self.pixels.len());
        let covariances = match self.noise {
            PixelNoise::Sigma(_) => pixels,
            PixelNoise::Covariances(list) => list.len(),
        };
        if cameras != pixels || pixels != covariances {
            return Err(TriangulationFault::LengthsDiffer { cameras, pixels, covariances });
        }
        if cameras < 2 {
            return Err(TriangulationFault::TooFew { count: cameras });
        }
        match (0..cameras).find(|&index| self.weight(index).is_none()) {
            Some(index) => Err(TriangulationFault::BadNoise { index }),
            None => Ok(()),
        }
    }

    /// Inverse covariance of a pixel [px⁻²].
    fn weight(&self, index: usize) -> Option<Matrix2<f64>> {
        match self.noise {
            PixelNoise::Sigma(sigma) => {
                (sigma > 0.0 && sigma.is_finite()).then(|| Matrix2::identity() / (sigma * sigma))
            }
            PixelNoise::Covariances(list) => {
                let covariance = list[index];
                let positive = covariance[(0, 0)] > 0.0 && covariance.determinant() > 0.0;
                covariance.try_inverse().filter(|it| positive && it.iter().all(|value| value.is_finite()))
            }
        }
    }

    /// At `position`; the error is the first camera that does not see it, or whose pixel is not finite.
    fn normal_equations(&self, position: &Point3<f64>) -> Result<NormalEquations, usize> {
        let mut sum = NormalEquations { information: Matrix3::zeros(), gradient: Vector3::zeros(), cost: 0.0 };
        for (index, (camera, pixel)) in self.cameras.iter().zip(self.pixels).enumerate() {
            let (seen, jacobian) = camera.project_with_jacobian(position).ok_or(index)?;
            let weight = self.weight(index).ok_or(index)?;
            let residual = pixel - seen;
            let weighted = jacobian.transpose() * weight;
            sum.information += weighted * jacobian;
            sum.gradient += weighted * residual;
            sum.cost += residual.dot(&(weight * residual));
            if !sum.cost.is_finite() {
                return Err(index);
            }
        }
        Ok(sum)
    }

    fn pixel_errors(&self, position: &Point3<f64>) -> impl Iterator<Item = f64> {
        let each = self.cameras.iter().zip(self.pixels);
        each.filter_map(move |(camera, pixel)| camera.project(position).map(|seen| (pixel - seen).norm_squared()))
    }
}

fn invert_information(information: &Matrix3<f64>) -> Result<Matrix3<f64>, TriangulationFault> {
    let eigenvalues = information.symmetric_eigenvalues();
    let ratio = eigenvalues.min().max(0.0) / eigenvalues.max();
    let inverse = information.try_inverse().filter(|_| ratio > SINGULAR);
    inverse.ok_or(TriangulationFault::Degenerate { ratio: ratio.sqrt() })
}
