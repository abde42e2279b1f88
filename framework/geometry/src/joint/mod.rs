//! Joint triangulation: many points together with small errors of the poses that they are seen from.
//!
//! The pose of a camera on a moving head is known to a tenth of a degree at best. Points from different pairs of such
//! cameras then do not fit together [Davis 2002 §5.2], where all points are therefore taken from one pair. Here the
//! pose errors are estimated together with the points: the points are many, rigid or not, and seen by several cameras
//! at one moment, which constrains the few pose errors well.
//!
//! | here | meaning | unit |
//! |---|---|---|
//! | `step` (ε) | error of a camera's pose: a turn about its own centre, and a shift, both in world axes: `camera_from_world` ∘ T(c) exp(ε) T(−c) | rad, m |
//! | `prior` (Λ) | inverse of the prior covariance of ε | |
//! | residual of an observation | pixel − π(camera ⊕ ε, point), whitened by its covariance | – |
//!
//! Minimises Σ ρ(‖rᵢ‖²) + Σ εᵀ Λ ε by Gauss–Newton steps; points are eliminated (Schur complement), so that a step
//! solves for 6 unknowns a camera. ρ is Huber's loss, its bend at a multiple of the residuals' own spread while they
//! shrink. Then the worst observation of a point is left out where three or more cameras agree without it; a point
//! seen by two cameras that do not agree is left out whole.

mod solve;
#[cfg(test)]
mod tests;

use foveate_estimation::statistics::{SIGMA_PER_MAD, median};
use nalgebra::{DMatrix, Isometry3, Matrix2, Matrix3, Matrix6, Point2, Point3, Translation3, UnitQuaternion, Vector6};

use crate::camera::Camera;
use crate::triangulate::triangulate_rays;
use solve::{Equations, rigid_parts};

/// A camera picture with an uncertain pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Viewpoint {
    /// The camera at its assumed pose.
    pub camera: Camera,
    /// Covariance of δ in `camera_from_world` ∘ exp(δ), (rotation, translation) [rad², rad m, m²]; may be singular.
    pub covariance: Matrix6<f64>,
}

/// An observation of one point in one picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointObservation {
    /// Index of the viewpoint.
    pub viewpoint: usize,
    /// Index of the point.
    pub point: usize,
    /// Measured pixel, raw [px].
    pub pixel: Point2<f64>,
    /// Covariance of the pixel [px²].
    pub covariance: Matrix2<f64>,
}

/// Options of [`triangulate_jointly`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointOptions {
    /// Whether to estimate pose errors; otherwise only the points.
    pub estimate_poses: bool,
    /// Added to each viewpoint's covariance: standard deviation of a rotation about the camera's centre [rad].
    pub rotation_floor: f64,
    /// Added to each viewpoint's covariance: standard deviation of a shift [m].
    pub translation_floor: f64,
    /// Added to the covariances of the observations: standard deviation of both coordinates [px].
    pub pixel_floor: f64,
    /// An observation farther off than this is an outlier [σ].
    pub outlier_sigmas: f64,
}

impl Default for JointOptions {
    fn default() -> Self {
        Self {
            estimate_poses: true,
            rotation_floor: 1e-4,
            translation_floor: 2e-4,
            pixel_floor: 0.05,
            outlier_sigmas: 5.0,
        }
    }
}

/// A triangulated point with covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointPoint {
    /// Position in the world [m].
    pub position: Point3<f64>,
    /// Covariance of the position, without the error that all points have in common [m²].
    pub covariance: Matrix3<f64>,
}

/// Points and poses found by [`triangulate_jointly`].
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// By index of the point; `None` for points that fewer than two cameras see, or see in agreement.
    pub points: Vec<Option<JointPoint>>,
    /// The viewpoints' cameras at their estimated poses.
    pub cameras: Vec<Camera>,
    /// Mean of the points in the world [m].
    pub middle: Point3<f64>,
    /// Covariance of the common error of all points: δ of all points as a whole about [`Self::middle`], in world axes,
    /// (rotation, translation) [rad², rad m, m²].
    pub covariance: Matrix6<f64>,
    /// By observation: residual in standard deviations; `None` where it was not used: its point is not there, or it was left out.
    pub residuals: Vec<Option<f64>>,
    /// By observation: whether it disagrees with the other observations of its point.
    pub disputed: Vec<bool>,
}

/// Why there is no solution.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum JointError {
    /// An index of a viewpoint or a point that does not exist.
    #[error(
        "observation {index} names viewpoint {viewpoint} and point {point}, expected less than {viewpoints} and {points}"
    )]
    NoSuch {
        /// Index of the observation.
        index: usize,
        /// Its viewpoint.
        viewpoint: usize,
        /// Number of viewpoints.
        viewpoints: usize,
        /// Its point.
        point: usize,
        /// Number of points.
        points: usize,
    },
    /// A pixel that is not finite, or a covariance that is not positive definite.
    #[error(
        "observation {index} has a pixel or covariance that cannot be used, expected a finite pixel and a positive definite covariance"
    )]
    BadObservation {
        /// Index of the observation.
        index: usize,
    },
    /// A viewpoint's covariance that is not positive semidefinite.
    #[error("the covariance of viewpoint {index} is not positive semidefinite")]
    BadViewpoint {
        /// Index of the viewpoint.
        index: usize,
    },
    /// No point is seen by two cameras.
    #[error("no point is seen by two cameras")]
    NothingSeenTwice,
}

/// Steps from one start; three or four suffice.
const MOST_STEPS: usize = 12;
/// A step below this share of the prior's standard deviations ends the search.
const SMALL_STEP: f64 = 1e-4;
/// Huber's bend [standard deviations].
const BEND: f64 = 2.5;
/// How often observations are left out and the rest is solved again.
const MOST_ROUNDS: usize = 4;
/// Two lines of sight closer to parallel than this fix no depth: least over largest eigenvalue of a point's information.
const FLATTEST: f64 = 1e-7;

/// Triangulates the points, and estimates the poses that they were seen from. Each viewpoint observes a point at most once.
///
/// # Errors
/// See [`JointError`].
pub fn triangulate_jointly(
    viewpoints: &[Viewpoint],
    n_points: usize,
    observations: &[JointObservation],
    options: &JointOptions,
) -> Result<Joint, JointError> {
    let mut search = Search::new(viewpoints, n_points, observations, options)?;
    if search.positions.iter().all(Option::is_none) {
        return Err(JointError::NothingSeenTwice);
    }
    for round in 1..=MOST_ROUNDS {
        search.settle();
        if round == MOST_ROUNDS || !search.leave_out() {
            break;
        }
    }
    Ok(search.result())
}

/// The cameras, points and observations of a search under way.
struct Search<'a> {
    observations: &'a [JointObservation],
    options: &'a JointOptions,
    cameras: Vec<Camera>,
    centres: Vec<Point3<f64>>,
    /// By viewpoint: inverse covariance of ε, and how far ε is from what was believed.
    priors: Vec<Matrix6<f64>>,
    offsets: Vec<Vector6<f64>>,
    positions: Vec<Option<Point3<f64>>>,
    /// By observation: Cholesky factor W of its information, WᵀW.
    whitening: Vec<Matrix2<f64>>,
    in_use: Vec<bool>,
    disputed: Vec<bool>,
}

impl<'a> Search<'a> {
    fn new(
        viewpoints: &[Viewpoint],
        n_points: usize,
        observations: &'a [JointObservation],
        options: &'a JointOptions,
    ) -> Result<Self, JointError> {
        let floor = Matrix2::identity() * options.pixel_floor.powi(2);
        let mut whitening = Vec::with_capacity(observations.len());
        for (index, observation) in observations.iter().enumerate() {
            let JointObservation { viewpoint, point, pixel, covariance } = *observation;
            if viewpoint >= viewpoints.len() || point >= n_points {
                let (viewpoints, points) = (viewpoints.len(), n_points);
                return Err(JointError::NoSuch { index, viewpoint, viewpoints, point, points });
            }
            let information = (covariance + floor).try_inverse().filter(|_| pixel.coords.norm().is_finite());
            let factor = information.and_then(|it| it.cholesky()).ok_or(JointError::BadObservation { index })?;
            whitening.push(factor.l().transpose());
        }
        let cameras: Vec<Camera> = viewpoints.iter().map(|it| it.camera.clone()).collect();
        let centres: Vec<Point3<f64>> = cameras.iter().map(Camera::centre).collect();
        let prior = |(index, it): (usize, &Viewpoint)| {
            prior(&it.covariance, &centres[index], options).ok_or(JointError::BadViewpoint { index })
        };
        let priors = viewpoints.iter().enumerate().map(prior).collect::<Result<_, _>>()?;
        let mut search = Self {
            observations,
            options,
            priors,
            offsets: vec![Vector6::zeros(); viewpoints.len()],
            positions: vec![None; n_points],
            whitening,
            in_use: vec![true; observations.len()],
            disputed: vec![false; observations.len()],
            cameras,
            centres,
        };
        search.start();
        Ok(search)
    }

    /// Points that two lines of sight or more pass closest to.
    fn start(&mut self) {
        let mut rays = vec![Vec::new(); self.positions.len()];
        for observation in self.observations {
            rays[observation.point].extend(self.cameras[observation.viewpoint].ray(&observation.pixel));
        }
        for (position, rays) in self.positions.iter_mut().zip(&rays) {
            *position = triangulate_rays(rays);
        }
    }

    /// Whitened residual of an observation.
    fn residual(&self, index: usize) -> Option<f64> {
        let observation = &self.observations[index];
        let position = self.positions[observation.point].filter(|_| self.in_use[index])?;
        let expected = self.cameras[observation.viewpoint].project(&position)?;
        Some((self.whitening[index] * (observation.pixel - expected)).norm())
    }

    /// Goes to the minimum. Points that cannot be seen from where they come to lie are dropped.
    fn settle(&mut self) {
        for _ in 0..MOST_STEPS {
            let residuals: Vec<f64> = (0..self.observations.len()).filter_map(|it| self.residual(it)).collect();
            // A norm of two normal numbers has its median at 1.18 standard deviations.
            let spread = (median(&residuals).unwrap_or(1.0) * SIGMA_PER_MAD / 1.7462).max(1.0);
            let equations = Equations::of(self, BEND * spread);
            let Some((steps, moves)) = equations.solve(self) else { break };
            let mut largest: f64 = 0.0;
            for (viewpoint, step) in steps.iter().enumerate() {
                largest = largest.max((step.transpose() * self.priors[viewpoint] * step).x.sqrt());
                self.turn(viewpoint, step);
            }
            for (position, (moved, information)) in self.positions.iter_mut().zip(&moves) {
                *position = position.as_ref().filter(|_| moved.norm().is_finite()).map(|it| it + moved);
                largest = largest.max((moved.transpose() * information * moved).x.sqrt());
            }
            if largest < SMALL_STEP {
                break;
            }
        }
    }

    /// Takes a step of one camera's pose.
    fn turn(&mut self, viewpoint: usize, step: &Vector6<f64>) {
        let centre = self.centres[viewpoint].coords;
        let about = Isometry3::from_parts(
            Translation3::from(step.fixed_rows::<3>(3).into_owned()),
            UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(0).into_owned()),
        );
        let change = Translation3::from(centre) * about * Translation3::from(-centre);
        self.cameras[viewpoint].camera_from_world *= change;
        self.offsets[viewpoint] += step;
    }

    /// Leaves out observations that do not agree with the rest; whether there were any.
    fn leave_out(&mut self) -> bool {
        let mut of_point: Vec<Vec<(usize, f64)>> = vec![Vec::new(); self.positions.len()];
        for index in 0..self.observations.len() {
            if let Some(residual) = self.residual(index) {
                of_point[self.observations[index].point].push((index, residual));
            }
        }
        let mut changed = false;
        for (point, observations) in of_point.iter().enumerate() {
            let Some(worst) = observations.iter().max_by(|a, b| a.1.total_cmp(&b.1)) else { continue };
            if worst.1 <= self.options.outlier_sigmas {
                continue;
            }
            changed = true;
            let odd = if observations.len() > 2 { self.odd_one_out(point, observations) } else { None };
            let left_out: Vec<usize> = match odd {
                Some(odd) => vec![odd],
                // Two observations, or several of which no subset agrees: which one is right is unknown.
                None => observations.iter().map(|it| it.0).collect(),
            };
            for index in left_out {
                (self.in_use[index], self.disputed[index]) = (false, true);
            }
            if odd.is_none() {
                self.positions[point] = None;
            }
        }
        changed
    }

    /// The observation without which the others of a point agree; the point moves to where they meet.
    fn odd_one_out(&mut self, point: usize, observations: &[(usize, f64)]) -> Option<usize> {
        let without = |odd: usize| {
            let others: Vec<usize> = observations.iter().map(|it| it.0).filter(|it| *it != odd).collect();
            let ray =
                |index: &usize| self.cameras[self.observations[*index].viewpoint].ray(&self.observations[*index].pixel);
            let meet = triangulate_rays(&others.iter().filter_map(ray).collect::<Vec<_>>())?;
            let worst = others.iter().try_fold(0.0_f64, |worst, index| {
                let observation = &self.observations[*index];
                let expected = self.cameras[observation.viewpoint].project(&meet)?;
                Some(worst.max((self.whitening[*index] * (observation.pixel - expected)).norm()))
            })?;
            Some((odd, meet, worst))
        };
        let best = observations.iter().filter_map(|it| without(it.0)).min_by(|a, b| a.2.total_cmp(&b.2))?;
        let (odd, meet, worst) = best;
        // Of three, any two meet somewhere: one of them is an outlier only with a far larger residual.
        let agrees = worst <= self.options.outlier_sigmas;
        if agrees {
            self.positions[point] = Some(meet);
        }
        agrees.then_some(odd)
    }

    fn result(self) -> Joint {
        let equations = Equations::of(&self, f64::INFINITY);
        let residuals: Vec<Option<f64>> = (0..self.observations.len()).map(|it| self.residual(it)).collect();
        let known: Vec<Point3<f64>> = self.positions.iter().flatten().copied().collect();
        let sum = known.iter().fold(nalgebra::Vector3::zeros(), |sum, it| sum + it.coords);
        let middle = Point3::from(sum / known.len().max(1) as f64);
        let poses = equations.poses_covariance(&self).unwrap_or_else(|| DMatrix::zeros(0, 0));
        let parts = rigid_parts(&self, &equations, &poses, &middle);
        let points = self.positions.iter().zip(&parts.points).map(|(position, covariance)| {
            let covariance = (*covariance)?;
            position.map(|position| JointPoint { position, covariance })
        });
        Joint {
            points: points.collect(),
            middle,
            covariance: parts.whole,
            residuals,
            disputed: self.disputed,
            cameras: self.cameras,
        }
    }
}

/// Inverse covariance of ε; `None` where it is not one.
fn prior(covariance: &Matrix6<f64>, centre: &Point3<f64>, options: &JointOptions) -> Option<Matrix6<f64>> {
    // δ of a turn ω about the centre c and a shift v: (ω, v − ω × c), so that ε = (ω, δ_v + ω × c) = (ω, δ_v − c × ω).
    let mut to_centre = Matrix6::identity();
    to_centre.fixed_view_mut::<3, 3>(3, 0).copy_from(&-centre.coords.cross_matrix());
    let mut at_centre = to_centre * covariance * to_centre.transpose();
    for axis in 0..3 {
        at_centre[(axis, axis)] += options.rotation_floor.powi(2);
        at_centre[(axis + 3, axis + 3)] += options.translation_floor.powi(2);
    }
    Some(at_centre.cholesky()?.inverse()).filter(|it| it.iter().all(|it| it.is_finite()))
}
