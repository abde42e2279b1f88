//! Self-calibration: the poses of a room of cameras from one waved light, without a start, up to a similarity.
//!
//! Each frame gives at most one pixel a camera, many give none. The relative poses of pairs of cameras are estimated
//! ([`crate::epipolar`]); the rotations of all pairs are averaged over the view graph, and pairs that contradict it
//! are dropped; with known rotations, the centres of all cameras are the solution of one linear problem over all lines
//! of sight; then points are intersected and everything is bundle-adjusted in rounds with ever stricter inlier limits.
//! Cameras that no pair could place are resected from the points. So a frame seen by 4 of 18 cameras is fully used,
//! where growing a scene from one pair would fail: two cameras share only some two dozen of 600 such frames, of which
//! a third camera sees three.
//!
//! Sources: [Davis 2002 §3.2], the virtual calibration object (which alternates between path and cameras, where this adjusts both);
//! V. M. Govindu, "Lie-algebraic averaging for globally consistent motion estimation", CVPR 2004; the linear problem is that of
//! C. Rother and S. Carlsson, "Linear multi view reconstruction and camera recovery", ICCV 2001, in lines of sight.

mod centres;
mod links;
mod optics;
mod rotations;
mod rounds;
mod status;

use foveate_estimation::Random;
use nalgebra::{Isometry3, Matrix3, Point2, Point3, Vector2, Vector3};

pub use self::links::Link;
pub use self::status::{CameraStatus, HeldReason, OpticHeld, SelfCalibrationError};
use crate::bundle::{CameraCovariance, Freedom};
use crate::camera::Camera;

/// An observation of the light by a camera in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightObservation {
    /// Index of the camera.
    pub camera: usize,
    /// Number of the frame; all cameras see the light at the same position in the same frame.
    pub frame: usize,
    /// Measured pixel, raw [px].
    pub pixel: Point2<f64>,
}

/// Options of [`self_calibrate`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SelfCalibrationOptions {
    /// Pixel noise of inliers, standard deviation of either coordinate [px].
    pub sigma_px: f64,
    /// An observation is an inlier when at most this far from its point's projection [px].
    pub inlier_px: f64,
    /// Least number of inlier frames that link two cameras, at least 6 [–].
    pub min_common: usize,
    /// Number of partners with which each camera is paired: those with which it shares most frames [–].
    pub max_partners: usize,
    /// Largest accepted relative standard deviation of a free focal length [–].
    pub max_focal_sigma: f64,
    /// Seed of the random draws.
    pub seed: u64,
}

impl Default for SelfCalibrationOptions {
    fn default() -> Self {
        Self { sigma_px: 0.5, inlier_px: 3.0, min_common: 10, max_partners: 20, max_focal_sigma: 0.04, seed: 1 }
    }
}

/// The calibrated room with residuals and covariances.
#[derive(Debug, Clone, PartialEq)]
pub struct SelfCalibration {
    /// The cameras, in the order given; those without a pose as they were given. Up to the last adjustment, the origin
    /// is the centroid of the others' centres, the unit of length their root mean square distance from it, the axes
    /// those of the first.
    pub cameras: Vec<Camera>,
    /// Outcome for each camera.
    pub status: Vec<CameraStatus>,
    /// By frame: position of the light, if more than half of its observations, at least two, agree.
    pub points: Vec<Option<Point3<f64>>>,
    /// By camera: the parameters that were estimated; these optics differ from the input.
    pub freed: Vec<Freedom>,
    /// By calibrated camera: the optics that should have been estimated and are kept as given, and why.
    pub held: Vec<Vec<OpticHeld>>,
    /// By observation: residual seen − measured, if camera and point are known [px].
    pub residuals: Vec<Option<Vector2<f64>>>,
    /// By observation: whether it is an inlier.
    pub right: Vec<bool>,
    /// Root mean square length of the inliers' residuals [px].
    pub rms_px: f64,
    /// By camera: covariance, with inner constraints; `None` when not calibrated or unobservable.
    pub covariance: Vec<Option<CameraCovariance>>,
    /// Pairs of cameras with a relative pose.
    pub links: Vec<Link>,
    /// Spread of the points across their flattest plane over that along it; near 0 for a planar path [–].
    pub flatness: f64,
}

/// Calibrates `cameras` (whose poses are not used) from `observations` of one light.
///
/// `free` says which optics of each camera are estimated; their given values are then guesses: focal lengths right to
/// a third or so, the rest as in [`OpticsPrior::of_guess`](crate::bundle::OpticsPrior::of_guess). All other optics are
/// known. A camera whose free focal length is unobservable is refused; its other optics are kept as given when the
/// observations do not determine them ([`SelfCalibration::held`]).
///
/// # Errors
/// See [`SelfCalibrationError`]; cameras that cannot be calibrated beside others that can are reported in the status.
pub fn self_calibrate(
    cameras: &[Camera],
    free: &[Freedom],
    observations: &[LightObservation],
    options: &SelfCalibrationOptions,
) -> Result<SelfCalibration, SelfCalibrationError> {
    check(cameras, free, observations, options)?;
    let free: Vec<Freedom> = free.iter().map(|it| Freedom { pose: true, ..*it }).collect();
    // A guess by which most observations can be explained is near enough for the adjustment to find the rest.
    let mut best: Option<SelfCalibration> = None;
    let mut fault = None;
    for [focal, k1] in optics::guesses(&free) {
        let mut guessed = cameras.to_vec();
        for (camera, free) in guessed.iter_mut().zip(&free) {
            if free.focal {
                camera.intrinsics.focal = camera.intrinsics.focal.map(|it| it * focal);
            }
            if free.k1 {
                camera.distortion.k1 += k1;
            }
        }
        match attempt(cameras, &guessed, &free, observations, options) {
            Ok(found) => {
                let n_right = |it: &SelfCalibration| it.right.iter().filter(|it| **it).count();
                if best.as_ref().is_none_or(|best| n_right(&found) > n_right(best)) {
                    best = Some(found);
                }
            }
            Err(found) => fault = fault.or(Some(found)),
        }
        if best.as_ref().is_some_and(|it| it.stands(observations)) {
            break;
        }
    }
    match (best, fault) {
        (Some(found), _) => Ok(found),
        (None, Some(fault)) => Err(fault),
        (None, None) => unreachable!("each attempt ends in an answer or a fault"),
    }
}

/// A room stands when two thirds of the cameras that see enough, at least three, are calibrated [–]…
const STANDING_CAMERAS: f64 = 0.66;
/// … and so large a part of what these see is right [–].
const STANDING_OBSERVATIONS: f64 = 0.9;

impl SelfCalibration {
    /// Whether no other start is needed: all cameras that see enough are calibrated, or most of them are and agree. What is wrong with the
    /// others is not the start then.
    pub fn stands(&self, observations: &[LightObservation]) -> bool {
        let hears = |it: &CameraStatus| !matches!(it, CameraStatus::TooFewObservations { .. });
        let heard = self.status.iter().filter(|it| hears(it)).count();
        let is_in = |it: usize| self.status[it] == CameraStatus::Calibrated;
        let calibrated = (0..self.status.len()).filter(|it| is_in(*it)).count();
        let of_these = observations.iter().filter(|it| is_in(it.camera)).count() as f64;
        let right = self.right.iter().filter(|it| **it).count() as f64;
        let most = (STANDING_CAMERAS * heard as f64).ceil().max(3.0) as usize;
        calibrated >= heard || (calibrated >= most && right >= STANDING_OBSERVATIONS * of_these)
    }
}

fn check(
    cameras: &[Camera],
    free: &[Freedom],
    observations: &[LightObservation],
    options: &SelfCalibrationOptions,
) -> Result<(), SelfCalibrationError> {
    if cameras.len() < 2 {
        return Err(SelfCalibrationError::TooFewCameras { count: cameras.len() });
    }
    if cameras.len() != free.len() {
        return Err(SelfCalibrationError::LengthsDiffer { cameras: cameras.len(), freedoms: free.len() });
    }
    for (option, found) in [
        ("sigma_px", options.sigma_px),
        ("inlier_px", options.inlier_px),
        ("max_partners", options.max_partners as f64),
        ("max_focal_sigma", options.max_focal_sigma),
    ] {
        if !(found.is_finite() && found > 0.0) {
            return Err(SelfCalibrationError::BadOption { option, found });
        }
    }
    for (index, camera) in cameras.iter().enumerate() {
        camera.check().map_err(|fault| SelfCalibrationError::BadCamera { camera: index, fault })?;
    }
    for (index, &LightObservation { camera, pixel, .. }) in observations.iter().enumerate() {
        if camera >= cameras.len() || !pixel.coords.norm().is_finite() {
            return Err(SelfCalibrationError::BadObservation {
                observation: index,
                camera,
                pixel,
                cameras: cameras.len(),
            });
        }
    }
    let mut keys: Vec<(usize, usize)> = observations.iter().map(|it| (it.camera, it.frame)).collect();
    keys.sort_unstable();
    if let Some(twice) = keys.windows(2).find(|it| it[0] == it[1]) {
        return Err(SelfCalibrationError::SeenTwice { camera: twice[0].0, frame: twice[0].1 });
    }
    Ok(())
}

/// Everything under one guess of what is free of the optics.
fn attempt(
    given: &[Camera],
    cameras: &[Camera],
    free: &[Freedom],
    observations: &[LightObservation],
    options: &SelfCalibrationOptions,
) -> Result<SelfCalibration, SelfCalibrationError> {
    let random = Random::new(options.seed).fork("self_calibration");
    let tracks = links::Tracks::new(given, cameras, free, observations);
    let oriented = links::orient(&tracks, options, &random);
    let graph = rotations::average(cameras.len(), &oriented.links);
    let mut status = oriented.status;
    for (camera, status) in status.iter_mut().enumerate() {
        let group: Vec<usize> = (0..cameras.len()).filter(|it| graph.group[*it] == graph.group[camera]).collect();
        if *status != CameraStatus::Calibrated || graph.group[camera] == graph.largest {
            continue;
        }
        let own = oriented.links.iter().map(|it| &it.link).filter(|it| it.a == camera || it.b == camera);
        *status = match own.max_by_key(|it| it.right) {
            Some(best) if group.len() == 1 => {
                let other = best.a + best.b - camera;
                CameraStatus::Inconsistent { best: other, common: best.common, right: best.right }
            }
            _ => CameraStatus::Separate { group },
        };
    }
    let start = centres::place(&tracks, &oriented.links, &graph);
    let nothing = |status: &[CameraStatus]| SelfCalibrationError::NothingCalibrated { status: status.to_vec() };
    let Some(start) = start else { return Err(nothing(&status)) };
    let found = rounds::run(&tracks, start, &mut status, options, &random);
    let mut found = found.ok_or_else(|| nothing(&status))?;
    if !found.status.contains(&CameraStatus::Calibrated) {
        return Err(nothing(&found.status));
    }
    found.links = oriented.links.into_iter().map(|it| it.link).collect();
    found.links.iter_mut().for_each(|it| it.consistent = graph.consistent.contains(&(it.a, it.b)));
    Ok(found)
}

/// Moves cameras that have a pose, and points, into the space that [`SelfCalibration::cameras`] promises.
fn normalise(cameras: &mut [Option<Camera>], points: &mut [Option<Point3<f64>>]) {
    let known: Vec<&Camera> = cameras.iter().flatten().collect();
    let Some(turn) = known.first().map(|it| it.camera_from_world.rotation) else { return };
    let n = known.len() as f64;
    let centroid = known.iter().fold(Vector3::zeros(), |sum, it| sum + it.centre().coords / n);
    let squares: f64 = known.iter().map(|it| (it.centre().coords - centroid).norm_squared()).sum();
    let size = (squares / n).sqrt();
    // p' = R (p − m)/s
    for camera in cameras.iter_mut().flatten() {
        let pose = camera.camera_from_world;
        let translation = (pose.rotation * centroid + pose.translation.vector) / size;
        camera.camera_from_world = Isometry3::from_parts(translation.into(), pose.rotation * turn.inverse());
    }
    for point in points.iter_mut().flatten() {
        *point = turn * Point3::from((point.coords - centroid) / size);
    }
}

/// Least over largest standard deviation of the points along their axes.
fn flatness(points: &[Option<Point3<f64>>]) -> f64 {
    let known: Vec<&Point3<f64>> = points.iter().flatten().collect();
    let n = known.len() as f64;
    let centroid = known.iter().fold(Vector3::zeros(), |sum, it| sum + it.coords / n);
    let mut scatter = Matrix3::zeros();
    known.iter().for_each(|it| scatter += (it.coords - centroid) * (it.coords - centroid).transpose());
    let axes = scatter.symmetric_eigenvalues();
    (axes.min().max(0.0) / axes.max()).sqrt()
}

#[cfg(test)]
mod tests;
