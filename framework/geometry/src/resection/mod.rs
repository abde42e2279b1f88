//! Resection: the pose of a camera with known optics from known points and their pixels.
//!
//! RANSAC over poses of three points each; the best one is refined on the pixels of all points by Levenberg–Marquardt
//! under Cauchy's loss ρ(r) = σ² c² ln(1 + |r|²/(σ c)²), c = 2.385, under which the pull of outliers vanishes. The
//! points are moved to their centroid first, so that coordinates of millions of metres keep their precision.
//!
//! At least four points are needed: three admit up to four poses. Points on a line or in one place do not fix a pose
//! and are refused; points in a plane are fine. More than half of the pairs may be outliers, as long as
//! [`ResectionOptions::trials`] are likely to draw three inliers: 200 trials suffice for 50 %, 2000 for 85 %.
//!
//! ```
//! use foveate_estimation::Random;
//! use foveate_geometry::{Camera, ResectionOptions, resect};
//! use nalgebra::{Point3, Vector2};
//!
//! let camera = Camera::look_at(Point3::new(2.0, -3.0, 1.8), Point3::new(0.0, 0.0, 1.0), [640, 480], 500.0);
//! let mut random = Random::new(1);
//! let mut draw = |size: f64| random.uniform_in(-size, size);
//! let points: Vec<_> = (0..30).map(|_| Point3::new(draw(1.0), draw(1.0), 1.0 + draw(1.0))).collect();
//! let mut pixels: Vec<_> = points.iter().map(|it| camera.project(it).unwrap() + Vector2::new(draw(0.5), draw(0.5))).collect();
//! for pixel in &mut pixels[..10] {
//!     pixel.x += 60.0; // a third of the pairs is wrong
//! }
//! let found = resect(&camera, &points, &pixels, &ResectionOptions::default(), |n| random.below(n))?;
//! assert!(found.right.iter().enumerate().all(|(index, is_right)| *is_right == (index >= 10)));
//! let error = found.camera_from_world * camera.camera_from_world.inverse();
//! assert!(error.rotation.angle() < 1e-3 && error.translation.vector.norm() < 4e-3); // half a pixel is 4 mm at 4 m
//! # Ok::<(), foveate_geometry::ResectionError>(())
//! ```

pub mod three_points;

use foveate_estimation::least_squares::{Damping, DriverOptions, SmallEquations, SmallProblem, solve_small};
use nalgebra::{
    Isometry3, Matrix3, Matrix6, Point2, Point3, Translation3, Unit, UnitQuaternion, Vector2, Vector3, Vector6,
};

use crate::camera::Camera;

/// Options of [`resect`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ResectionOptions {
    /// Pixel noise of inliers, standard deviation of either coordinate [px].
    pub sigma_px: f64,
    /// A pair is an inlier when its pixel is at most this far off [px].
    pub inlier_px: f64,
    /// RANSAC trials at most; fewer when enough pairs agree early [–].
    pub trials: u32,
}

impl Default for ResectionOptions {
    fn default() -> Self {
        Self { sigma_px: 0.5, inlier_px: 3.0, trials: 500 }
    }
}

/// The pose of a camera with its inliers.
#[derive(Debug, Clone, PartialEq)]
pub struct Resection {
    /// The pose: maps points in the world to points in the camera.
    pub camera_from_world: Isometry3<f64>,
    /// Covariance of the pose, in the order and the update of `docs/notation.md`, if `sigma_px` is right.
    pub covariance: Matrix6<f64>,
    /// By pair: whether it is an inlier.
    pub right: Vec<bool>,
    /// Root mean square reprojection error of the inliers [px].
    pub residuals_rms_px: f64,
    /// Mean robust cost of all pairs, those behind the camera at 100 `inlier_px` [px²]: to compare poses of the same set of pairs.
    pub loss_px2: f64,
}

/// Why there is no pose.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ResectionError {
    /// Lists of different lengths.
    #[error("{points} points and {pixels} pixels, expected as many of each")]
    LengthsDiffer {
        /// Number of points.
        points: usize,
        /// Number of pixels.
        pixels: usize,
    },
    /// Too few pairs: three points admit up to four poses.
    #[error("{count} usable pairs of point and pixel do not fix a pose, expected at least 4")]
    TooFew {
        /// Pairs with finite numbers and a line of sight.
        count: usize,
    },
    /// An option out of range.
    #[error("{option} is {found}, expected more than 0")]
    BadOption {
        /// Which option.
        option: &'static str,
        /// Value that was found.
        found: f64,
    },
    /// All points on a line, or in one place.
    #[error("the points lie on a line: their spread across it is {ratio:.1e} of that along it")]
    Collinear {
        /// Standard deviation across over along the line.
        ratio: f64,
    },
    /// No pose has four inliers or more.
    #[error("no pose found in {trials} trials explains more than {agreeing} of {count} pairs")]
    NoConsensus {
        /// RANSAC trials.
        trials: u32,
        /// Inliers of the best pose.
        agreeing: usize,
        /// Number of pairs.
        count: usize,
    },
    /// The inliers do not determine the pose.
    #[error("the {count} right pairs do not fix the pose: the best known direction is {ratio:.1e} times the worst")]
    Degenerate {
        /// Number of inliers.
        count: usize,
        /// Standard deviation along the best known over that along the worst known direction, with lengths in units of the points' spread.
        ratio: f64,
    },
}

/// Points whose spread across their line is below this part of that along it are on it.
const COLLINEAR: f64 = 1e-4;
/// Standard deviations further apart than this leave a pose open.
const SINGULAR: f64 = 1e-6;
/// Cauchy's loss at this many standard deviations is 95 % as efficient as least squares where nothing is wrong.
const CAUCHY: f64 = 2.385;
const OPTIONS: DriverOptions = DriverOptions {
    damping: Damping { initial: 1e-4, least: 1e-12, fastest_decrease: 0.1 },
    max_iterations: 60,
    relative_gain: 1e-12,
    absolute_gain: 0.5e-21,
};
/// Chance at which three right pairs must have been drawn before the search ends early.
const CONFIDENCE: f64 = 0.9999;

/// Robust pose of `camera` (whose own pose is not used) from `points_in_world` and their raw `pixels`. `below(n)`
/// draws a random whole number from 0 to n − 1: the same numbers give the same pose.
///
/// # Errors
/// See [`ResectionError`].
pub fn resect(
    camera: &Camera,
    points_in_world: &[Point3<f64>],
    pixels: &[Point2<f64>],
    options: &ResectionOptions,
    mut below: impl FnMut(u32) -> u32,
) -> Result<Resection, ResectionError> {
    let problem = Problem::new(camera, points_in_world, pixels, options)?;
    let n = problem.pairs.len() as u32;
    let mut best: Option<(f64, Isometry3<f64>)> = None;
    let mut needed = f64::from(options.trials);
    let mut trials = 0;
    while trials < options.trials && f64::from(trials) < needed {
        trials += 1;
        let drawn = [(); 3].map(|()| below(n).min(n - 1) as usize);
        if drawn[0] == drawn[1] || drawn[0] == drawn[2] || drawn[1] == drawn[2] {
            continue;
        }
        let points = drawn.map(|it| problem.pairs[it].point);
        let directions = drawn.map(|it| problem.pairs[it].direction);
        for pose in three_points::poses(&points, &directions) {
            let loss = problem.truncated_loss(&pose);
            if best.as_ref().is_none_or(|it| loss < it.0) {
                best = Some((loss, pose));
                let share = problem.n_right(&pose) as f64 / f64::from(n);
                needed = (1.0 - CONFIDENCE).ln() / (1.0 - share.powi(3)).max(f64::MIN_POSITIVE).ln();
                needed = if needed.is_finite() { needed.max(20.0) } else { f64::from(options.trials) };
            }
        }
    }
    let agreeing = best.as_ref().map_or(0, |(_, pose)| problem.n_right(pose));
    let Some((_, start)) = best.filter(|_| agreeing >= 4) else {
        return Err(ResectionError::NoConsensus { trials, agreeing, count: n as usize });
    };
    problem.finish(problem.refine(start))
}

/// Refines the pose of `camera` on the pixels, without RANSAC: for a pose that is nearly right.
///
/// # Errors
/// See [`ResectionError`].
pub fn refine_pose(
    camera: &Camera,
    points_in_world: &[Point3<f64>],
    pixels: &[Point2<f64>],
    options: &ResectionOptions,
) -> Result<Resection, ResectionError> {
    let problem = Problem::new(camera, points_in_world, pixels, options)?;
    let start = camera.camera_from_world * Translation3::from(problem.centroid);
    problem.finish(problem.refine(start))
}

/// A point, relative to the centroid of all, and where it is seen.
struct Pair {
    point: Point3<f64>,
    pixel: Point2<f64>,
    direction: Unit<Vector3<f64>>,
}

struct Problem<'a> {
    camera: &'a Camera,
    options: &'a ResectionOptions,
    pairs: Vec<Pair>,
    /// By pair given: its place in `pairs`.
    places: Vec<Option<usize>>,
    centroid: Vector3<f64>,
    /// Root mean square distance of the points from their centroid [m].
    spread: f64,
}

impl<'a> Problem<'a> {
    fn new(
        camera: &'a Camera,
        points: &[Point3<f64>],
        pixels: &[Point2<f64>],
        options: &'a ResectionOptions,
    ) -> Result<Self, ResectionError> {
        if points.len() != pixels.len() {
            return Err(ResectionError::LengthsDiffer { points: points.len(), pixels: pixels.len() });
        }
        for (option, found) in [("sigma_px", options.sigma_px), ("inlier_px", options.inlier_px)] {
            if !(found.is_finite() && found > 0.0) {
                return Err(ResectionError::BadOption { option, found });
            }
        }
        let mut pairs = Vec::with_capacity(points.len());
        let mut places = Vec::with_capacity(points.len());
        for (point, pixel) in points.iter().zip(pixels) {
            let direction = camera.normalise(pixel).filter(|_| point.coords.norm().is_finite());
            places.push(direction.map(|_| pairs.len()));
            pairs.extend(direction.map(|it| Pair {
                point: *point,
                pixel: *pixel,
                direction: Unit::new_normalize(it.push(1.0)),
            }));
        }
        if pairs.len() < 4 {
            return Err(ResectionError::TooFew { count: pairs.len() });
        }
        let n = pairs.len() as f64;
        let centroid = pairs.iter().fold(Vector3::zeros(), |sum, it| sum + it.point.coords) / n;
        let mut scatter = Matrix3::zeros();
        for pair in &mut pairs {
            pair.point -= centroid;
            scatter += pair.point.coords * pair.point.coords.transpose() / n;
        }
        let mut axes: [f64; 3] = scatter.symmetric_eigenvalues().map(|it| it.max(0.0).sqrt()).into();
        axes.sort_by(f64::total_cmp);
        let ratio = axes[1] / axes[2];
        if ratio.is_nan() || ratio < COLLINEAR {
            return Err(ResectionError::Collinear { ratio: if ratio.is_nan() { 0.0 } else { ratio } });
        }
        Ok(Self { camera, options, pairs, places, centroid, spread: scatter.trace().sqrt() })
    }

    fn posed(&self, pose: &Isometry3<f64>) -> Camera {
        Camera { camera_from_world: *pose, ..self.camera.clone() }
    }

    fn squared_errors(&self, pose: &Isometry3<f64>) -> impl Iterator<Item = f64> {
        let camera = self.posed(pose);
        let squared = move |pair: &Pair| Some((camera.project(&pair.point)? - pair.pixel).norm_squared());
        self.pairs.iter().map(move |pair| squared(pair).unwrap_or(f64::INFINITY))
    }

    /// Squared errors, none counted for more than the limit of a right pair [px²].
    fn truncated_loss(&self, pose: &Isometry3<f64>) -> f64 {
        let limit = self.options.inlier_px.powi(2);
        self.squared_errors(pose).map(|it| it.min(limit)).sum()
    }

    fn n_right(&self, pose: &Isometry3<f64>) -> usize {
        let limit = self.options.inlier_px.powi(2);
        self.squared_errors(pose).filter(|it| *it <= limit).count()
    }

    /// Under Cauchy's loss, in pixels rather than standard deviations.
    fn normal(&self, pose: &Isometry3<f64>) -> SmallEquations<6> {
        let camera = self.posed(pose);
        let scale = (CAUCHY * self.options.sigma_px).powi(2);
        let unseen = scale * (100.0 * self.options.inlier_px).powi(2).ln_1p();
        let mut sum = SmallEquations::zeros();
        for pair in &self.pairs {
            let Some((seen, by_point)) = camera.project_with_jacobian(&pair.point) else {
                sum.cost += 0.5 * unseen;
                continue;
            };
            let error: Vector2<f64> = seen - pair.pixel;
            let relative = error.norm_squared() / scale;
            sum.cost += 0.5 * scale * relative.ln_1p();
            let weight = 1.0 / (1.0 + relative);
            // T exp(δ) p = T (p + ω × p + v): by ω the point moves by −[p]ₓ, by v by 1.
            let by_rotation = by_point * -pair.point.coords.cross_matrix();
            let mut jacobian = nalgebra::Matrix2x6::zeros();
            jacobian.fixed_columns_mut::<3>(0).copy_from(&by_rotation);
            jacobian.fixed_columns_mut::<3>(3).copy_from(&by_point);
            let weighted = jacobian.transpose() * weight;
            sum.information += weighted * jacobian;
            sum.gradient += weighted * error;
        }
        sum
    }

    /// Goes to the minimum near `start`; the pose is that of the centred points.
    fn refine(&self, start: Isometry3<f64>) -> Isometry3<f64> {
        solve_small(self, start, &OPTIONS).map_or(start, |it| it.parameters)
    }

    /// Counts the right pairs of `pose`, and states how well they hold it.
    fn finish(&self, pose: Isometry3<f64>) -> Result<Resection, ResectionError> {
        let limit = self.options.inlier_px.powi(2);
        let errors: Vec<f64> = self.squared_errors(&pose).collect();
        let count = errors.iter().filter(|it| **it <= limit).count();
        if count < 4 {
            return Err(ResectionError::NoConsensus { trials: 0, agreeing: count, count: errors.len() });
        }
        let normal = self.normal(&pose);
        // Rotations about the centroid and shifts in units of the spread compare with one another.
        let units = Matrix6::from_diagonal(&Vector6::new(1.0, 1.0, 1.0, self.spread, self.spread, self.spread));
        let comparable = units * normal.information * units;
        let eigenvalues = comparable.symmetric_eigenvalues();
        let ratio = (eigenvalues.min().max(0.0) / eigenvalues.max()).sqrt();
        let fault = ResectionError::Degenerate { count, ratio };
        if ratio.is_nan() || ratio < SINGULAR {
            return Err(fault);
        }
        let of_centred = normal.information.try_inverse().ok_or(fault)? * self.options.sigma_px.powi(2);
        // exp(δ) about the centroid c is exp(δ') about the origin with v' = v + c × ω.
        let mut moved_to_origin = Matrix6::identity();
        moved_to_origin.fixed_view_mut::<3, 3>(3, 0).copy_from(&self.centroid.cross_matrix());
        let right_sum: f64 = errors.iter().filter(|it| **it <= limit).sum();
        Ok(Resection {
            camera_from_world: pose * Translation3::from(-self.centroid),
            covariance: moved_to_origin * of_centred * moved_to_origin.transpose(),
            right: self.places.iter().map(|place| place.is_some_and(|it| errors[it] <= limit)).collect(),
            residuals_rms_px: (right_sum / count as f64).sqrt(),
            loss_px2: 2.0 * normal.cost / self.pairs.len() as f64,
        })
    }
}

impl SmallProblem<6> for Problem<'_> {
    type Parameters = Isometry3<f64>;

    fn moved(&self, from: &Isometry3<f64>, step: &Vector6<f64>) -> Isometry3<f64> {
        moved(from, step)
    }

    fn linearise(&self, at: &Isometry3<f64>, equations: &mut SmallEquations<6>) -> Option<()> {
        *equations = self.normal(at);
        Some(())
    }
}

impl Resection {
    /// Covariance of the camera's centre in the world [m²]: T exp(δ) has its centre c at c − ω × c − v.
    pub fn centre_covariance(&self) -> Matrix3<f64> {
        let centre = self.camera_from_world.inverse_transform_point(&Point3::origin()).coords;
        let mut by_pose = nalgebra::Matrix3x6::zeros();
        by_pose.fixed_columns_mut::<3>(0).copy_from(&centre.cross_matrix());
        by_pose.fixed_columns_mut::<3>(3).copy_from(&-Matrix3::identity());
        by_pose * self.covariance * by_pose.transpose()
    }
}

/// T ⊕ δ = T exp(δ), to first order in the translation, which is all that a step needs.
fn moved(pose: &Isometry3<f64>, step: &Vector6<f64>) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(0).into_owned());
    let shift = Translation3::from(step.fixed_rows::<3>(3).into_owned());
    pose * Isometry3::from_parts(shift, turn)
}

#[cfg(test)]
mod tests;
