//! Calibration of unsynchronised cameras from a path that another system measured: RTK, a total station, a tracker.
//!
//! 1. [`table`] reads the path; [`MeasuredPath`] is the path between its rows.
//! 2. For each camera alone, every offset that its clock can have against the path's is searched, with all poses that three observations
//!    give (RANSAC). Windows of the recording keep drifting clocks apart.
//! 3. The best of them are refined over the whole recording: pose, optics as far as they are free, offset and rate of the clock, under Cauchy's
//!    loss. Blocks of observations are held out.
//! 4. A camera is accepted when enough of its observations agree, no other offset and no reversed pose fits nearly as well, held-out observations
//!    fit, and its pose is well determined. Any other camera is refused with the reason, and gets no pose.
//!
//! The session's time is the path's, from the first that any camera or the path has: see [`PathNetwork::session_from_s`].

mod camera;
mod measured;
mod refine;
mod refusal;
mod search;
pub mod table;
mod track;
mod verdict;

use foveate_estimation::statistics::{Summary, percentile};
use foveate_geometry::CameraStatus;
use foveate_geometry::bundle::CameraCovariance;
use foveate_scene::uncertainty::Fixed;
use nalgebra::{Matrix6, Point3, Translation3};

use self::camera::Found;
pub use self::measured::{MeasuredPath, MeasuredPathError};
pub use self::refusal::Refusal;
use self::track::Seen;
pub use self::verdict::{Finding, PathVerdict};
use crate::network::{Cleaning, cleaned};
use crate::recording::Recording;
use crate::solved::{ClockFit, FixedFreedoms, ObservationRole, Solved, SolvedCamera, SolvedObservation, SolvedPoint};

/// Options of [`calibrate`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathOptions {
    /// An observation agrees with the path when at most this far off, or three standard deviations of what agrees where that is more [px].
    pub inlier_px: f64,
    /// But never further off than this, as an angle: the sum of marking by hand, an antenna beside the marked centre, and the lens [rad].
    pub agree_rad: f64,
    /// Observations that fall on the path, at least [–].
    pub min_observations: usize,
    /// A camera with a smaller share of observations that agree is refused [–].
    pub least_share: f64,
    /// One with a smaller share is usable at best [–].
    pub good_share: f64,
    /// Whether free focal lengths are unknown: many are then tried.
    pub focal_unknown: bool,
    /// Of the random draws.
    pub seed: u64,
}

impl Default for PathOptions {
    fn default() -> Self {
        Self {
            inlier_px: 3.0,
            agree_rad: 5e-3,
            min_observations: 40,
            least_share: 0.5,
            good_share: 0.75,
            focal_unknown: false,
            seed: 1,
        }
    }
}

/// Cameras calibrated from a path.
#[derive(Debug, Clone, PartialEq)]
pub struct PathNetwork {
    /// Cameras, the path where each saw it, residuals; in the world and the metres of the path. Cameras that were refused are not calibrated.
    pub solved: Solved,
    /// By camera: figures, or why it is not calibrated.
    pub cameras: Vec<Result<PathCamera, Refusal>>,
    /// By camera: what was set aside beforehand.
    pub cleaning: Vec<Cleaning>,
    /// The path's time at which the session begins [s]: the first time of the path and of the pictures of any camera.
    pub session_from_s: f64,
    /// The first row of the path, in the session's time [s].
    pub path_start_s: f64,
    /// Whether all cameras fit the path with two of its axes swapped.
    pub other_hand: bool,
}

/// Details of a camera that was calibrated.
#[derive(Debug, Clone, PartialEq)]
pub struct PathCamera {
    /// Observations that agree with the path [–].
    pub right: usize,
    /// Of so many that fall on it, thinned where the point stood still [–].
    pub of: usize,
    /// How far off a right one may be [px].
    pub limit_px: f64,
    /// Median and 90 % of those that were used [px].
    pub used_px: [f64; 2],
    /// And of those held out [px].
    pub held_out_px: [f64; 2],
    /// Path time = `offset_s` + (1 + `drift`) · camera time [s].
    pub offset_s: f64,
    /// Drift of the clock, see `offset_s` [–]; 0 where it is not significant.
    pub drift: f64,
    /// Standard deviation of the offset in the middle of what the camera saw [s].
    pub offset_sigma_s: f64,
    /// How far the clock is from steady in parts of the recording, at most, with its standard deviation [s].
    pub wander: Option<[f64; 2]>,
    /// The next best offset that was found, path time less camera time [s], and the share that agrees with it [–].
    pub rival: Option<(f64, f64)>,
    /// Standard deviation of the centre along its weakest direction [m].
    pub centre_sigma_m: f64,
    /// And of the orientation [rad].
    pub turn_sigma: f64,
    /// Median distance of what it saw [m].
    pub depth_m: f64,
    /// Optics that were to be found but stay as given, by name.
    pub held: Vec<String>,
}

impl PathCamera {
    /// Share of the observations that agree [–].
    pub fn share(&self) -> f64 {
        self.right as f64 / self.of.max(1) as f64
    }
}

/// Calibrates each camera of `recording` against `path` [m]: pose, free optics, and offset and drift of its clock. Each camera is accepted or refused
/// with a reason of its own.
pub fn calibrate(recording: &Recording, path: &MeasuredPath, options: &PathOptions) -> PathNetwork {
    let (recording, cleaning) = cleaned(recording);
    let middle = path.middle();
    let centred = path.seen_from(&middle);
    let found: Vec<Result<Found, Refusal>> =
        (0..recording.cameras.len()).map(|it| camera::solve(&recording, it, &centred, options)).collect();
    let refused_as_mirrored = found.iter().filter(|it| matches!(it, Err(Refusal::Mirrored { .. }))).count();
    let other_hand = refused_as_mirrored > 0 && found.iter().all(Result::is_err);
    let first_of = |camera: usize| recording.camera_frames.iter().find(|it| it.camera == camera).map(|it| it.time_s);
    let starts =
        found.iter().enumerate().filter_map(|(index, it)| Some(it.as_ref().ok()?.state.path_time(first_of(index)?)));
    let [path_from_s, _] = path.span_s();
    let session_from_s = starts.fold(path_from_s, f64::min);
    let scale = Fixed { by: "the measured path".to_owned(), sigma: None };
    let mut solved = Solved {
        fixed: FixedFreedoms { scale: Some(scale.clone()), gravity: Some(scale.clone()), origin: Some(scale) },
        ..Solved::default()
    };
    for (index, (guess, it)) in recording.cameras.iter().zip(&found).enumerate() {
        let camera = match it {
            Ok(it) => {
                observe(&mut solved, index, it, &centred, &middle, session_from_s);
                solved_camera(&guess.name, it, &middle, session_from_s)
            }
            Err(refusal) => {
                let (best, common, right) = match refusal {
                    Refusal::Disagrees { right, of, .. } => (index, *of, *right),
                    _ => (index, 0, 0),
                };
                let status = match refusal {
                    Refusal::TooFew { seen, needed } | Refusal::NoOverlap { seen, needed } => {
                        CameraStatus::TooFewObservations { frames: *seen, needed: *needed }
                    }
                    Refusal::Still { spread_px } => CameraStatus::LightStill { spread_px: *spread_px },
                    Refusal::ClockAmbiguous { .. } => CameraStatus::ClockOpen { best: None },
                    Refusal::OpticOpen { sigma, .. } => CameraStatus::FocalOpen { sigma: *sigma },
                    _ => CameraStatus::Inconsistent { best, common, right },
                };
                SolvedCamera {
                    name: guess.name.clone(),
                    camera: guess.camera.clone(),
                    status,
                    freed: guess.free,
                    prior: None,
                    covariance: None,
                    clock: None,
                }
            }
        };
        solved.cameras.push(camera);
    }
    let cameras = found.into_iter().map(|it| it.map(|it| figures(&it, &centred))).collect();
    PathNetwork { solved, cameras, cleaning, session_from_s, path_start_s: path_from_s - session_from_s, other_hand }
}

/// Root of the largest variance.
fn worst_sigma(covariance: &nalgebra::Matrix3<f64>) -> f64 {
    covariance.symmetric_eigenvalues().max().max(0.0).sqrt()
}

fn figures(found: &Found, path: &MeasuredPath) -> PathCamera {
    let of = |seen: &[Seen]| {
        let errors: Vec<f64> = found.state.errors(path, seen).map(|it| it.min(1e9)).collect();
        [percentile(&errors, 50.0), percentile(&errors, 90.0)].map(|it| it.unwrap_or(f64::NAN))
    };
    PathCamera {
        right: found.right,
        of: found.of,
        limit_px: found.limit_px,
        used_px: of(&found.used),
        held_out_px: of(&found.held_out),
        offset_s: found.state.path_time(0.0),
        drift: found.state.rate - 1.0,
        offset_sigma_s: found.quality.clock_s,
        wander: found.wander,
        rival: found.rival,
        centre_sigma_m: worst_sigma(&found.quality.centre),
        turn_sigma: worst_sigma(&found.quality.pose.fixed_view::<3, 3>(0, 0).into_owned()),
        depth_m: found.depth_m,
        held: found.held.iter().map(ToString::to_string).collect(),
    }
}

/// The camera in the path's own world, whose origin is not at `middle`.
fn solved_camera(name: &str, found: &Found, middle: &Point3<f64>, session_from_s: f64) -> SolvedCamera {
    let mut camera = found.state.camera.clone();
    camera.camera_from_world *= Translation3::from(-middle.coords);
    // exp(δ) about the middle c is exp(δ') about the origin with v' = v + c × ω.
    let mut to_origin = Matrix6::identity();
    to_origin.fixed_view_mut::<3, 3>(3, 0).copy_from(&middle.coords.cross_matrix());
    let pose = to_origin * found.quality.pose * to_origin.transpose();
    let covariance = CameraCovariance {
        pose: (pose + pose.transpose()) / 2.0,
        centre: found.quality.centre,
        optics: found.quality.optics,
    };
    let clock = ClockFit {
        offset_s: found.state.path_time(0.0) - session_from_s,
        drift: found.state.rate - 1.0,
        sigma_s: found.quality.clock_s,
        pairs: 0,
    };
    SolvedCamera {
        name: name.to_owned(),
        camera,
        status: CameraStatus::Calibrated,
        freed: found.free,
        prior: Some(found.prior.clone()),
        covariance: Some(covariance),
        clock: Some(clock),
    }
}

/// Adds what a camera saw, each observation with a point of its own: clocks differ.
fn observe(
    solved: &mut Solved,
    camera: usize,
    found: &Found,
    path: &MeasuredPath,
    middle: &Point3<f64>,
    session_from_s: f64,
) {
    let roles = [(&found.used, ObservationRole::Used), (&found.held_out, ObservationRole::HeldOut)];
    for (seen, role) in roles {
        for it in seen {
            let time_s = found.state.path_time(it.time_s);
            let residual = found.state.residual(path, it);
            let is_right = residual.is_some_and(|it| it.norm() <= found.limit_px);
            let (frame, point) = (solved.points.len(), solved.points.len());
            let position = path.at(time_s).0 + middle.coords;
            solved.points.push(SolvedPoint { frame, time_s: time_s - session_from_s, label: 0, position });
            let role = if is_right { role } else { ObservationRole::Rejected };
            solved.observations.push(SolvedObservation {
                camera,
                frame,
                point: Some(point),
                pixel: it.pixel,
                residual,
                role,
            });
        }
    }
}

/// Error of an older calibration of `camera` at its best clock: median residual over the observations that the new one accepts [px].
pub fn error_of_older(network: &PathNetwork, camera: usize, older: &foveate_geometry::Camera) -> Option<f64> {
    let own =
        network.solved.observations.iter().filter(|it| it.camera == camera && it.role != ObservationRole::Rejected);
    let errors: Vec<f64> = own
        .filter_map(|it| Some((older.project(&network.solved.points[it.point?].position)? - it.pixel).norm()))
        .collect();
    Summary::of(&errors).map(|it| it.median)
}

#[cfg(test)]
mod tests;
