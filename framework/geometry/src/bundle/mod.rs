//! Bundle adjustment: the cameras and points that minimise the reprojection error of all observations.
//!
//! [`adjust`] minimises ½ Σ ρ(|seen − measured|²/σ²) over poses, optics and points by Levenberg–Marquardt. Points are
//! eliminated from the normal equations (Schur complement), so that the reduced system has 6 to 15 unknowns for each camera and none for a
//! point. Source: B. Triggs, P. McLauchlan, R. Hartley, A. Fitzgibbon, "Bundle adjustment: a modern synthesis", 2000, §6 and §9.
//!
//! | here | source | meaning |
//! |---|---|---|
//! | `of_camera`, `of_point` | U, V | blocks of JᵀWJ on the diagonal |
//! | `between` | W | block of a camera and a point |
//! | `reduced` | U − W V⁻¹ Wᵀ | information of the cameras with the points eliminated |
//!
//! Pixels determine the scene only up to a similarity. Steps never move along these seven directions (inner
//! constraints), and the [`Gauge`] chooses how the covariance is stated; cameras whose pose is held fix as many of the
//! seven as they can. Known lengths between points, such as a wand's, also fix the scale; priors of the optics
//! constrain what the pixels say little about ([`adjust_knowing`]). [`adjust_with_clocks`] also adjusts each camera's
//! clock, from the velocities of the pixels. Internally the scene is moved to its centroid and scaled to size 1, so
//! that coordinates of millions of metres keep their precision.
//!
//! ```
//! use foveate_estimation::Random;
//! use foveate_geometry::{AlignmentOptions, BundleOptions, Camera, Freedom, Observation, adjust, camera_errors};
//! use nalgebra::{Point3, Vector3};
//!
//! let mut random = Random::new(1);
//! let mut draw = |size: f64| Vector3::from_fn(|_, _| random.uniform_in(-size, size));
//! let centre = Point3::new(0.0, 0.0, 1.0);
//! let truth = [[3.0, 0.0, 2.0], [0.0, 3.0, 2.5], [-3.0, 0.0, 1.5], [0.0, -3.0, 2.0]]
//!     .map(|it| Camera::look_at(Point3::from(it), centre, [640, 480], 500.0));
//! let points: Vec<_> = (0..50).map(|_| centre + draw(0.8)).collect();
//! let mut observations = Vec::new();
//! for (camera, it) in truth.iter().enumerate() {
//!     for (point, position) in points.iter().enumerate() {
//!         let noise = draw(0.5).xy(); // half a pixel at most
//!         observations.push(Observation { camera, point, pixel: it.project(position).unwrap() + noise, sigma_px: 0.3 });
//!     }
//! }
//! // Start with every camera and every point several centimetres off.
//! let start = truth.clone().map(|mut it| {
//!     it.camera_from_world.translation.vector += draw(0.05);
//!     it
//! });
//! let start_points: Vec<_> = points.iter().map(|it| it + draw(0.05)).collect();
//! let found = adjust(&start, &[Freedom::POSE; 4], &start_points, &observations, &BundleOptions::default()).unwrap();
//! assert!(found.converged() && found.rms_px < 0.5);
//! // Pixels leave place, rotation and scale of the whole open: compare after the best similarity.
//! let errors = camera_errors(&found.cameras, &truth, AlignmentOptions { scale: true, robust: false }).unwrap();
//! assert!(errors.centres.iter().all(|it| *it < 0.003), "3 mm at 3 m are half a pixel: {:?}", errors.centres);
//! ```

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

/// One observation of a point by a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Index of the camera.
    pub camera: usize,
    /// Index of the point.
    pub point: usize,
    /// Measured pixel, raw [px].
    pub pixel: Point2<f64>,
    /// Standard deviation of either coordinate [px].
    pub sigma_px: f64,
}

/// A known distance between two points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownLength {
    /// Indices of the points; each point may be in one length only.
    pub points: [usize; 2],
    /// Distance [m].
    pub length: f64,
    /// Standard deviation of the distance, independent of that of other lengths [m].
    pub sigma: f64,
}

/// What is known besides the pixels.
#[derive(Debug, Clone, Copy, Default)]
pub struct Known<'a> {
    /// Known distances between points.
    pub lengths: &'a [KnownLength],
    /// Priors of the optics by camera, or empty; without effect on held parameters.
    pub optics: &'a [OpticsPrior],
    /// Stretch of time of each point, counted from 0, or empty; both points of a length share one. With stretches,
    /// covariances come from the residuals: errors within a stretch may be correlated, and each lens may have a smooth
    /// error beyond the model. Without, each pixel's error is assumed independent and as large as its σ.
    pub stretches: &'a [usize],
}

/// Gauge of the covariance: how origin, axes and scale are fixed, which pixels alone do not determine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Gauge {
    /// Free network: all cameras share the gauge, the scene as a whole stays where it was, and the covariance is the smallest of all gauges.
    Inner,
    /// The centres of all cameras share the gauge, their rotations do not count: as errors after the best similarity between found and true centres.
    Centres,
    /// The pose of `reference` and its distance to the centre of `other` are kept without error. With known lengths,
    /// the distance is adjusted and the covariance is that of [`Gauge::Inner`].
    Cameras {
        /// The camera whose pose is kept.
        reference: usize,
        /// The camera whose distance is kept.
        other: usize,
    },
}

/// Options of [`adjust`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BundleOptions {
    /// Robust loss of a pixel error, in its standard deviations.
    pub loss: Loss,
    /// Gauge of the covariance; without effect when held cameras fix everything.
    pub gauge: Gauge,
    /// Most iterations [–].
    pub max_iterations: u32,
    /// Convergence: stop when the predicted reduction of the next step is below this part of the cost [–].
    pub relative_gain: f64,
    /// Whether to compute covariances; with hundreds of cameras they take longer than the rest.
    pub covariance: bool,
}

impl Default for BundleOptions {
    fn default() -> Self {
        Self { loss: Loss::Squared, gauge: Gauge::Inner, max_iterations: 100, relative_gain: 1e-6, covariance: false }
    }
}

/// The adjusted scene with residuals and covariances.
#[derive(Debug, Clone, PartialEq)]
pub struct Adjusted {
    /// The cameras, in the order given.
    pub cameras: Vec<Camera>,
    /// The points, in the order given; those with fewer than two usable observations keep their start.
    pub points: Vec<Point3<f64>>,
    /// By observation: seen − measured; `None` when the camera cannot see the point [px].
    pub residuals: Vec<Option<Vector2<f64>>>,
    /// Root mean square length of the residuals in use [px].
    pub rms_px: f64,
    /// Indices of observations that were not used: their camera does not see the point at the start, or no other camera observes it.
    pub left_out: Vec<usize>,
    /// ½ Σ ρ at the start and after each accepted step.
    pub costs: Vec<f64>,
    /// Why the search ended.
    pub stop: Stop,
    /// Iterations, rejected steps included.
    pub iterations: u32,
    /// By camera, if requested.
    pub covariance: Option<Result<Vec<CameraCovariance>, UnobservableParameters>>,
}

impl Adjusted {
    /// Whether a minimum was reached.
    pub fn converged(&self) -> bool {
        self.stop != Stop::IterationLimit
    }
}

/// Covariance of a camera in the chosen gauge, if the σ of the pixels are right; 0 for held parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraCovariance {
    /// Covariance of `camera_from_world`, in the order and the update of `docs/notation.md`.
    pub pose: Matrix6<f64>,
    /// Covariance of the centre in the world [m²].
    pub centre: Matrix3<f64>,
    /// Standard deviations of the optics.
    pub optics: OpticsSigma,
}

/// Parameters that the pixels do not determine, beside the gauge.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("unobservable from the pixels: {}", parameters.iter().map(|(camera, name)| format!("{name} of camera {camera}")).collect::<Vec<_>>().join(", "))]
pub struct UnobservableParameters {
    /// Camera and name of the parameter; each is undetermined given the parameters before it.
    pub parameters: Vec<(usize, &'static str)>,
}

/// Why there is no adjustment.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BundleError {
    /// Lists of different lengths.
    #[error("{cameras} cameras and {freedoms} freedoms, expected as many of each")]
    LengthsDiffer {
        /// Number of cameras.
        cameras: usize,
        /// Number of freedoms.
        freedoms: usize,
    },
    /// A camera that cannot be used.
    #[error("camera {camera}: {fault}")]
    BadCamera {
        /// Index of the camera.
        camera: usize,
        /// The fault of the camera.
        fault: CameraError,
    },
    /// A point with a number that is NaN or infinite.
    #[error("point {point} is not finite")]
    BadPoint {
        /// Index of the point.
        point: usize,
    },
    /// An observation of an unknown camera or point, or with a pixel or σ that cannot be used.
    #[error(
        "observation {observation} is of camera {camera}, point {point}, pixel {pixel}, sigma {sigma_px} px; expected a camera below \
         {cameras}, a point below {points}, finite numbers and a sigma above 0 px"
    )]
    BadObservation {
        /// Index of the observation.
        observation: usize,
        /// Its camera.
        camera: usize,
        /// Its point.
        point: usize,
        /// Its pixel [px].
        pixel: Point2<f64>,
        /// Its sigma [px].
        sigma_px: f64,
        /// Number of cameras.
        cameras: usize,
        /// Number of points.
        points: usize,
    },
    /// No point is observed by two cameras.
    #[error("no point is seen by two cameras ({observations} observations)")]
    NothingShared {
        /// Number of observations.
        observations: usize,
    },
    /// Timing that cannot be used.
    #[error("clocks: {found}, expected {expected}")]
    BadTiming {
        /// What was found.
        found: String,
        /// What was expected.
        expected: &'static str,
    },
    /// Cameras of a gauge that do not exist, are the same, or stand in the same place.
    #[error("the gauge names cameras {reference} and {other}, expected two of {cameras} in different places")]
    BadGauge {
        /// The camera whose pose is kept.
        reference: usize,
        /// The camera whose distance is kept.
        other: usize,
        /// Number of cameras.
        cameras: usize,
    },
    /// A known length with an impossible value, or of a point that has one already.
    #[error(
        "length {index} is {length} with sigma {sigma} between points {} and {}, expected numbers above 0 and two of {count} points \
         that no other length has", points[0], points[1]
    )]
    BadLength {
        /// Index of the length.
        index: usize,
        /// Indices of its points.
        points: [usize; 2],
        /// Its value [m].
        length: f64,
        /// Its standard deviation [m].
        sigma: f64,
        /// Number of points.
        count: usize,
    },
    /// Priors that do not match the cameras, or have a σ that is not above 0.
    #[error("known optics: {found}, expected {expected}")]
    BadPrior {
        /// What was found.
        found: String,
        /// What was expected.
        expected: &'static str,
    },
    /// Stretches of time that do not match the points.
    #[error("stretches of time: {found}, expected {expected}")]
    BadStretches {
        /// What was found.
        found: String,
        /// What was expected.
        expected: &'static str,
    },
    /// An option out of range.
    #[error("{option} is {found}, expected a finite number above 0")]
    BadOption {
        /// Which option.
        option: &'static str,
        /// Value that was found.
        found: f64,
    },
}

/// Adjusts the free parameters of `cameras` (by `freedoms`) and all `points` to `observations`.
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

/// As [`adjust`], with prior knowledge. A known length is one more residual under the same loss; the start must have
/// nearly the right scale. Lengths of points that fewer than two cameras see are ignored. Priors of the optics are
/// residuals without loss.
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
        return Err(BundleError::BadPrior {
            found: format!("{count} of {cameras} cameras"),
            expected: "none, or one for each camera",
        });
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
        return Err(BundleError::BadOption { option: "scale of the loss", found });
    }
    if !(options.relative_gain.is_finite() && options.relative_gain > 0.0) {
        return Err(BundleError::BadOption { option: "relative_gain", found: options.relative_gain });
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
