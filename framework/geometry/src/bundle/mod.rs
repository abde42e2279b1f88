//! Bundle adjustment: the cameras and points under which all pixels together are most likely.
//!
//! [`adjust`] minimises ½ Σ ρ(|seen − measured|²/σ²) over poses, optics and points by Levenberg–Marquardt. Points are
//! eliminated from the normal equations (Schur complement), so that what is solved has 6 to 15 unknowns for each camera and none for a
//! point. Source: B. Triggs, P. McLauchlan, R. Hartley, A. Fitzgibbon, "Bundle adjustment: a modern synthesis", 2000, §6 and §9.
//!
//! | here | there | meaning |
//! |---|---|---|
//! | `of_camera`, `of_point` | U, V | blocks of JᵀWJ on the diagonal |
//! | `between` | W | block of a camera and a point |
//! | `reduced` | U − W V⁻¹ Wᵀ | information of the cameras when points follow |
//!
//! Pixels fix the scene up to a similarity only. Steps never move along these seven directions (inner constraints), and the
//! [`Gauge`] chooses how the covariance is stated; cameras whose pose is held fix as many of the seven as they can.
//! Known lengths between points, such as a wand's, fix the scale as well; known optics keep what pixels say little of within reason
//! ([`adjust_knowing`]).
//! [`adjust_with_clocks`] adjusts each camera's clock besides, from how fast pixels move.
//! Inside, the scene is moved to its centroid and scaled to size 1, so that places of millions of metres keep their digits.

mod columns;
pub mod correlated;
mod covariance;
mod equations;
mod gauge;
mod lengths;
mod search;
mod timing;

use foveate_estimation::Loss;
pub use foveate_estimation::least_squares::Stop;
use nalgebra::{Matrix3, Matrix6, Point2, Point3, Vector2};

pub use self::columns::{CLOCK, Freedom, NAMES, Optic, OpticsPrior, OpticsSigma, moved};
pub use self::equations::Posed;
pub use self::timing::{AdjustedWithClocks, ClockFreedom, ClockGauge, ClockShift, Timing, adjust_with_clocks};
use crate::camera::{Camera, CameraError};

/// A point seen by a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Which camera.
    pub camera: usize,
    /// Which point.
    pub point: usize,
    /// Where it was seen, raw [px].
    pub pixel: Point2<f64>,
    /// Standard deviation of either coordinate [px].
    pub sigma_px: f64,
}

/// Two points whose distance is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownLength {
    /// Which two; no point may be in two lengths.
    pub points: [usize; 2],
    /// Their distance [m].
    pub length: f64,
    /// Its standard deviation, independent of that of other lengths [m].
    pub sigma: f64,
}

/// What is known beside pixels.
#[derive(Debug, Clone, Copy, Default)]
pub struct Known<'a> {
    /// Of points.
    pub lengths: &'a [KnownLength],
    /// By camera, or none at all; of what is held it says nothing.
    pub optics: &'a [OpticsPrior],
    /// By point, or none at all: which stretch of time it is of, counted from 0; both points of a length are of one. Covariances then state what
    /// residuals show: errors within a stretch may hang together, and each lens may have a smooth error that the model does not know. Without,
    /// each pixel's error is taken for independent and as large as its σ.
    pub stretches: &'a [usize],
}

/// How what pixels leave open is settled: where the origin is, how the axes lie, how long a metre is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Gauge {
    /// All cameras share it: the scene stays where it was as a whole, and the covariance is the least that any choice allows.
    Inner,
    /// The centres of all cameras share it, their turns do not count: what the best similarity between found and true centres leaves.
    Centres,
    /// The pose of `reference` and the distance of the centres of `reference` and `other` stay as they were, without error. Where
    /// lengths are known, the distance does not stay, and the covariance is that of [`Gauge::Inner`].
    Cameras {
        /// The camera whose pose stays.
        reference: usize,
        /// The camera whose distance stays.
        other: usize,
    },
}

/// How to go about it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BundleOptions {
    /// What a pixel error costs, in its standard deviations.
    pub loss: Loss,
    /// See [`Gauge`]; of no effect when held cameras fix everything.
    pub gauge: Gauge,
    /// Steps tried at most [–].
    pub max_iterations: u32,
    /// Done when the next step promises less than this part of the cost [–].
    pub relative_gain: f64,
    /// Whether covariances are wanted; with hundreds of cameras they take longer than the rest.
    pub covariance: bool,
}

impl Default for BundleOptions {
    fn default() -> Self {
        Self { loss: Loss::Squared, gauge: Gauge::Inner, max_iterations: 100, relative_gain: 1e-6, covariance: false }
    }
}

/// What [`adjust`] found.
#[derive(Debug, Clone, PartialEq)]
pub struct Adjusted {
    /// The cameras, in the order given.
    pub cameras: Vec<Camera>,
    /// The points, in the order given; those with fewer than two usable observations are where they were.
    pub points: Vec<Point3<f64>>,
    /// By observation: seen − measured; `None` when the camera cannot see the point [px].
    pub residuals: Vec<Option<Vector2<f64>>>,
    /// Root of the mean squared length of the residuals in use [px].
    pub rms_px: f64,
    /// Observations that were left out since their camera did not see the point at the start, or no other camera saw it.
    pub left_out: Vec<usize>,
    /// ½ Σ ρ at the start and after each accepted step.
    pub costs: Vec<f64>,
    /// Why it ended.
    pub stop: Stop,
    /// Steps tried, rejected ones included.
    pub iterations: u32,
    /// By camera, if asked for.
    pub covariance: Option<Result<Vec<CameraCovariance>, UnobservableParameters>>,
}

impl Adjusted {
    /// Whether a minimum was reached.
    pub fn converged(&self) -> bool {
        self.stop != Stop::IterationLimit
    }
}

/// How well a camera is known in the chosen gauge, if pixels are as good as their σ; 0 for what is held.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraCovariance {
    /// Of `camera_from_world`, in the order and the update of `docs/notation.md`.
    pub pose: Matrix6<f64>,
    /// Of the centre in the world [m²].
    pub centre: Matrix3<f64>,
    /// Standard deviations of the optics.
    pub optics: OpticsSigma,
}

/// Parameters that the pixels do not hold, beside the gauge.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the pixels leave open: {}", parameters.iter().map(|(camera, name)| format!("{name} of camera {camera}")).collect::<Vec<_>>().join(", "))]
pub struct UnobservableParameters {
    /// Camera and name of the parameter; each cannot be told from those of cameras before it.
    pub parameters: Vec<(usize, &'static str)>,
}

/// Why there is no answer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BundleError {
    /// Not as many of one as of the other.
    #[error("{cameras} cameras and {freedoms} lists of what is free, expected as many of each")]
    LengthsDiffer {
        /// How many cameras.
        cameras: usize,
        /// How many lists.
        freedoms: usize,
    },
    /// A camera with a number that is none.
    #[error("camera {camera}: {fault}")]
    BadCamera {
        /// Which.
        camera: usize,
        /// What is wrong.
        fault: CameraError,
    },
    /// A point with a number that is none.
    #[error("point {point} is not finite")]
    BadPoint {
        /// Which.
        point: usize,
    },
    /// An observation of nothing, by nobody, or without σ.
    #[error(
        "observation {observation} is of camera {camera}, point {point}, pixel {pixel}, sigma {sigma_px} px; expected a camera below \
         {cameras}, a point below {points}, finite numbers and a sigma above 0 px"
    )]
    BadObservation {
        /// Which.
        observation: usize,
        /// Its camera.
        camera: usize,
        /// Its point.
        point: usize,
        /// Its pixel [px].
        pixel: Point2<f64>,
        /// Its sigma [px].
        sigma_px: f64,
        /// How many cameras there are.
        cameras: usize,
        /// How many points there are.
        points: usize,
    },
    /// Nothing to adjust by.
    #[error("no point is seen by two cameras ({observations} observations)")]
    NothingShared {
        /// How many were given.
        observations: usize,
    },
    /// A clock that cannot be adjusted, or by which nothing can.
    #[error("clocks: {found}, expected {expected}")]
    BadTiming {
        /// What is there.
        found: String,
        /// What should be.
        expected: &'static str,
    },
    /// Cameras of a gauge that do not exist, are the same, or stand in the same place.
    #[error(
        "the gauge wants the distance of cameras {reference} and {other}, expected two of {cameras} in different places"
    )]
    BadGauge {
        /// The camera whose pose stays.
        reference: usize,
        /// The camera whose distance stays.
        other: usize,
        /// How many there are.
        cameras: usize,
    },
    /// A length of nothing, or of a point that has one already.
    #[error(
        "length {index} is {length} with sigma {sigma} between points {} and {}, expected numbers above 0 and two of {count} points \
         that no other length has", points[0], points[1]
    )]
    BadLength {
        /// Which.
        index: usize,
        /// Its points.
        points: [usize; 2],
        /// Its value [m].
        length: f64,
        /// Its standard deviation [m].
        sigma: f64,
        /// How many points there are.
        count: usize,
    },
    /// Optics that are known of too few cameras, or not to any sigma.
    #[error("known optics: {found}, expected {expected}")]
    BadPrior {
        /// What is there.
        found: String,
        /// What should be.
        expected: &'static str,
    },
    /// Stretches of time that are not one for each point.
    #[error("stretches of time: {found}, expected {expected}")]
    BadStretches {
        /// What is there.
        found: String,
        /// What should be.
        expected: &'static str,
    },
    /// A rule that cannot be followed.
    #[error("{rule} is {found}, expected a finite number above 0")]
    BadRule {
        /// Which.
        rule: &'static str,
        /// Its value.
        found: f64,
    },
}

/// Adjusts what `freedoms` leaves free in `cameras`, and all `points`, to `observations`.
///
/// # Errors
/// See [`BundleError`].
pub fn adjust(
    cameras: &[Camera],
    freedoms: &[Freedom],
    points: &[Point3<f64>],
    observations: &[Observation],
    options: &BundleOptions,
) -> Result<Adjusted, BundleError> {
    adjust_knowing(cameras, freedoms, points, observations, &Known::default(), options)
}

/// As [`adjust`], with more that is known. A length counts as one more residual, under the same loss; the start has to be in the unit of
/// the lengths, to within a small part. Lengths of points that fewer than two cameras see do not count. What is known of optics counts as
/// residuals under no loss.
///
/// # Errors
/// See [`BundleError`].
pub fn adjust_knowing(
    cameras: &[Camera],
    freedoms: &[Freedom],
    points: &[Point3<f64>],
    observations: &[Observation],
    known: &Known<'_>,
    options: &BundleOptions,
) -> Result<Adjusted, BundleError> {
    check(cameras, freedoms.len(), points, observations, options)?;
    check_lengths(points.len(), known.lengths)?;
    check_optics(cameras.len(), known.optics)?;
    check_stretches(points.len(), known)?;
    // A width of the camera blocks that holds all that is free, of a few so that each gets code of its own.
    match freedoms.iter().map(Freedom::width).max().unwrap_or(0) {
        0..=6 => search::run::<6, false>(cameras, freedoms, points, observations, known, Timing::NONE, options),
        7 => search::run::<7, false>(cameras, freedoms, points, observations, known, Timing::NONE, options),
        8..=9 => search::run::<9, false>(cameras, freedoms, points, observations, known, Timing::NONE, options),
        _ => search::run::<15, false>(cameras, freedoms, points, observations, known, Timing::NONE, options),
    }
    .map(|it| it.0)
}

fn check_stretches(points: usize, known: &Known<'_>) -> Result<(), BundleError> {
    let stretches = known.stretches;
    let is_one_each = stretches.is_empty() || stretches.len() == points;
    // Numbers as large as that are no count.
    let fine = is_one_each && stretches.iter().all(|it| *it <= points);
    let found = || format!("{} of {points} points, up to number {:?}", stretches.len(), stretches.iter().max());
    let expected = "none, or one for each point, numbered from 0";
    fine.then_some(()).ok_or_else(|| BundleError::BadStretches { found: found(), expected })
}

fn check_optics(cameras: usize, known: &[OpticsPrior]) -> Result<(), BundleError> {
    let count = known.len();
    if count != 0 && count != cameras {
        return Err(BundleError::BadPrior { found: format!("{count} of {cameras} cameras"), expected: "none, or all" });
    }
    for (index, prior) in known.iter().enumerate() {
        prior.camera.check().map_err(|fault| BundleError::BadCamera { camera: index, fault })?;
        if !prior.is_usable() {
            let found = format!("sigmas {:?} of camera {index}", prior.sigma);
            return Err(BundleError::BadPrior { found, expected: "numbers above 0, or infinite ones" });
        }
    }
    Ok(())
}

fn check_lengths(count: usize, lengths: &[KnownLength]) -> Result<(), BundleError> {
    let mut taken = vec![false; if lengths.is_empty() { 0 } else { count }];
    for (index, &KnownLength { points, length, sigma }) in lengths.iter().enumerate() {
        let positive = |it: f64| it.is_finite() && it > 0.0;
        let known = points[0] != points[1] && points.iter().all(|it| *it < count && !taken[*it]);
        if !(known && positive(length) && positive(sigma)) {
            return Err(BundleError::BadLength { index, points, length, sigma, count });
        }
        points.iter().for_each(|it| taken[*it] = true);
    }
    Ok(())
}

pub(crate) fn check(
    cameras: &[Camera],
    freedoms: usize,
    points: &[Point3<f64>],
    observations: &[Observation],
    options: &BundleOptions,
) -> Result<(), BundleError> {
    if cameras.len() != freedoms {
        return Err(BundleError::LengthsDiffer { cameras: cameras.len(), freedoms });
    }
    if let Some(found) = options.loss.bad_scale() {
        return Err(BundleError::BadRule { rule: "the scale of the loss", found });
    }
    if !(options.relative_gain.is_finite() && options.relative_gain > 0.0) {
        return Err(BundleError::BadRule { rule: "relative_gain", found: options.relative_gain });
    }
    for (index, camera) in cameras.iter().enumerate() {
        camera.check().map_err(|fault| BundleError::BadCamera { camera: index, fault })?;
    }
    if let Some(point) = points.iter().position(|it| !it.iter().all(|value| value.is_finite())) {
        return Err(BundleError::BadPoint { point });
    }
    for (index, &Observation { camera, point, pixel, sigma_px }) in observations.iter().enumerate() {
        let known = camera < cameras.len() && point < points.len();
        let usable = pixel.coords.norm().is_finite() && sigma_px.is_finite() && sigma_px > 0.0;
        if !(known && usable) {
            return Err(BundleError::BadObservation {
                observation: index,
                camera,
                point,
                pixel,
                sigma_px,
                cameras: cameras.len(),
                points: points.len(),
            });
        }
    }
    if let Gauge::Cameras { reference, other } = options.gauge {
        let centre = |index: usize| cameras.get(index).map(Camera::centre);
        let apart = centre(reference).zip(centre(other)).is_some_and(|(a, b)| (b - a).norm() > 0.0);
        if !apart {
            return Err(BundleError::BadGauge { reference, other, cameras: cameras.len() });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
