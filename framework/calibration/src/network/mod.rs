//! From a recording of one waved light to a calibrated camera network: from nothing, or from an older calibration.
//!
//! 1. What cannot be a waved light is set aside ([`Cleaning`]): coordinates that are not finite, lamps, repeated frames.
//! 2. Pictures are grouped by moments. One moment in ten is held out.
//! 3. From nothing, [`foveate_geometry::self_calibrate`] finds poses and, as far as the observations determine them, optics; from an older
//!    calibration, cameras that moved are found and get a new pose ([`recalibrate`]).
//! 4. The network is refined: in pictures with several spots the one that fits the other cameras is chosen, points are intersected, everything is
//!    adjusted together, and outliers are determined again.
//! 5. The residual of each observation is reported, with those of held-out moments apart.

mod cleaning;
mod culprits;
mod labels;
mod moments;
mod one_clock;
mod recalibrate;
mod settle;
mod to_calibration;
mod unsynchronised;
mod unsynchronised_wand;

use foveate_geometry::bundle::Freedom;
use foveate_geometry::self_calibration::{OpticHeld, SelfCalibrationError};
use foveate_geometry::{
    Camera, CameraStatus, LightObservation, SelfCalibration, SelfCalibrationOptions, self_calibrate,
};

pub use self::cleaning::{Cleaning, keep_distinct};
pub(crate) use self::cleaning::{cleaned, the_light};
pub use self::labels::{Swapped, swapped};
use self::moments::Moment;
pub use self::one_clock::OneClock;
pub use self::recalibrate::{Moved, recalibrate};
use self::settle::Room;
pub use self::to_calibration::Origin;
pub use self::unsynchronised::{NotSynchronised, SynchronisedNetwork, unsynchronised_from_nothing};
pub use self::unsynchronised_wand::{unsynchronised_wand, wand_on_one_clock};
use crate::cause::CameraFault;
use crate::recording::{CameraGuess, Recording};
use crate::solved::{ObservationRole, Solved, Step};
use crate::wand::{self, LabelError, WandObservation};

/// Options of [`from_nothing`] and [`recalibrate`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NetworkOptions {
    /// Of either coordinate of a right pixel, standard deviation, to begin with; what the residuals say counts in the end [px].
    pub sigma_px: f64,
    /// An observation is right when at most this far from where its point is seen [px].
    pub inlier_px: f64,
    /// Right pairs of observations that link two cameras, at least 6 [–].
    pub min_common: usize,
    /// A free focal length whose standard deviation is a larger part of it than this is refused [–].
    pub max_focal_sigma: f64,
    /// Whether focal lengths may be far from the given ones: many are then tried.
    pub focal_unknown: bool,
    /// One moment of so many is held out, drawn at random, at least 2; 0 keeps none [–].
    pub hold_out_every: usize,
    /// Of the random draws.
    pub seed: u64,
}

impl Default for NetworkOptions {
    fn default() -> Self {
        let SelfCalibrationOptions { sigma_px, inlier_px, min_common, max_focal_sigma, seed, .. } =
            SelfCalibrationOptions::default();
        Self { sigma_px, inlier_px, min_common, max_focal_sigma, focal_unknown: false, hold_out_every: 10, seed }
    }
}

/// A calibrated camera network, and how it was solved.
#[derive(Debug, Clone, PartialEq)]
pub struct SolvedNetwork {
    /// Cameras, path, residuals.
    pub solved: Solved,
    /// By camera: what was set aside beforehand.
    pub cleaning: Vec<Cleaning>,
    /// By camera: optics that were to be found but stay as given, and why.
    pub held: Vec<Vec<OpticHeld>>,
    /// Cameras that moved since the older calibration.
    pub moved: Vec<Moved>,
    /// Of either coordinate of a right pixel, standard deviation, as the residuals have it [px].
    pub sigma_px: f64,
}

impl SolvedNetwork {
    /// Observations of a wand's ends in one role, for [`crate::wand::intersect`].
    pub fn wand_observations(&self, role: ObservationRole) -> Vec<WandObservation> {
        let of_role = self.solved.observations.iter().filter(|it| it.role == role);
        let with_end = of_role.filter_map(|it| {
            let point = &self.solved.points[it.point?];
            Some(WandObservation {
                camera: it.camera,
                frame: it.frame,
                time_s: point.time_s,
                end: point.label,
                pixel: it.pixel,
            })
        });
        with_end.collect()
    }
}

/// Why a camera network cannot be calibrated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NetworkError {
    /// Nothing was seen.
    #[error("no camera saw anything in {camera_frames} pictures; expected a light in view of two cameras at once")]
    NothingSeen {
        /// Pictures.
        camera_frames: usize,
    },
    /// One camera sees the light, and no second one.
    #[error(
        "{seen} is the only camera that saw the light (in {camera_frames} of its pictures); expected at least two that see it together"
    )]
    OneCamera {
        /// Name of the camera.
        seen: String,
        /// Pictures with it.
        camera_frames: usize,
    },
    /// No two cameras can be calibrated; a line for each.
    #[error("no two cameras could be calibrated:\n{}", reasons.iter().map(|(name, reason)| format!("  {name}: {reason}")).collect::<Vec<_>>().join("\n"))]
    NothingCalibrated {
        /// By camera: name and reason.
        reasons: Vec<(String, String)>,
    },
    /// Too few cameras agree with the older calibration for it to be a start.
    #[error(
        "{agreeing} of {cameras} cameras agree with the older calibration on the places of the light, expected at least 2 and more than half; \
         calibrate from nothing (`--from-nothing`, and `--distance A:B=LENGTH` for the scale)"
    )]
    NotThisRoom {
        /// Number of cameras that agree.
        agreeing: usize,
        /// That saw the light.
        cameras: usize,
    },
    /// No two cameras saw the wand whole together.
    #[error(
        "no two cameras could be oriented by the wand; the best pair, {} and {}, saw both of its lights together in {frames} frames, \
         expected at least {needed}, moved about in all directions", best[0], best[1]
    )]
    NoWand {
        /// The pair.
        best: [String; 2],
        /// Their frames.
        frames: usize,
        /// Number that is needed.
        needed: usize,
    },
    /// A camera or an option that cannot be used.
    #[error("{0}")]
    Unusable(String),
}

/// Factors of a focal length of which nothing is known, in the order in which they are tried.
const FOCAL_FACTORS: [f64; 4] = [1.0, 1.6, 0.6, 2.5];
/// A start by which so large a part of the observations fits is not improved upon once another one has come to the same [–].
const FITS: f64 = 0.9;
/// Starts whose costs differ by less than this part have come to the same [–].
const SAME: f64 = 0.01;

/// The object that was waved.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CalibrationTarget<'a> {
    /// One light.
    #[default]
    Light,
    /// Two lights on a stick, distinguished by their labels or, without labels, by [`crate::wand::label`].
    Wand,
    /// Several labelled points, such as the joints of a walking person: each is a point of its own in each frame.
    Labels {
        /// Pairs of labels that may be swapped, such as the left and the right knee.
        mirrored: &'a [[u32; 2]],
    },
}

/// Calibrates synchronised cameras from a `recording` of a waved light or wand, without initial poses. The result is up to a similarity,
/// as [`SelfCalibration::cameras`] says; [`axes::fix`](crate::axes::fix) makes it metric.
///
/// ```
/// use foveate_calibration::network::{CalibrationTarget, NetworkOptions, from_nothing};
/// use foveate_calibration::recording::{CameraFrame, CameraGuess, Recording, Spot};
/// use foveate_geometry::{AlignmentOptions, Camera, bundle::Freedom, camera_errors};
/// use nalgebra::{Isometry3, Point3, Vector2};
///
/// // Four cameras around a light that is waved for ten seconds; pixels are off by up to 0.3 px.
/// let camera = |at: usize| {
///     let centre = Point3::new(3.2 * (1.5 * at as f64).cos(), 2.8 * (1.5 * at as f64).sin(), 1.8 + 0.3 * at as f64);
///     Camera::look_at(centre, Point3::new(0.0, 0.0, 1.0), [640, 480], 520.0)
/// };
/// let truth: Vec<Camera> = (0..4).map(camera).collect();
/// let camera_frames = (0..1200).map(|index| {
///     let (camera, time_s) = (index % 4, (index / 4) as f64 / 30.0);
///     let light = Point3::new((1.7 * time_s).sin(), (2.3 * time_s + 1.0).sin(), 1.1 + 0.7 * (3.1 * time_s).sin());
///     let noise = 0.3 * Vector2::new((78.2 * index as f64).sin(), (39.4 * index as f64).cos());
///     let pixel = truth[camera].sees(&light).map(|it| it + noise);
///     let spots = pixel.map(|pixel| Spot { pixel, sigma_px: 0.3, peak: 200.0, label: None });
///     CameraFrame { camera, time_s, spots: spots.into_iter().collect() }
/// });
/// let guess = |(at, it): (usize, &Camera)| CameraGuess {
///     name: format!("wide-{at}"),
///     camera: Camera { camera_from_world: Isometry3::identity(), ..it.clone() },
///     free: Freedom::POSE,
/// };
/// let recording =
///     Recording { cameras: truth.iter().enumerate().map(guess).collect(), camera_frames: camera_frames.collect() };
///
/// let network = from_nothing(&recording, CalibrationTarget::Light, &NetworkOptions::default()).expect("four cameras");
/// let found: Vec<Camera> = network.solved.cameras.iter().map(|it| it.camera.clone()).collect();
/// let errors = camera_errors(&found, &truth, AlignmentOptions { scale: true, robust: false }).expect("not in a row");
/// assert!(errors.centres.iter().all(|it| *it < 0.01), "within a centimetre of the truth: {:?}", errors.centres);
/// ```
///
/// # Errors
/// See [`NetworkError`]. Where only some cameras cannot be calibrated, their status gives the reason.
pub fn from_nothing(
    recording: &Recording,
    sought: CalibrationTarget<'_>,
    options: &NetworkOptions,
) -> Result<SolvedNetwork, NetworkError> {
    let (recording, cleaning, moments) = prepared(recording, sought)?;
    let first = search(&recording, &Room::new(&recording, moments.clone(), options).certain(), options);
    let settled = |found: &SelfCalibration, moments: Vec<Moment>| {
        let mut network = Room::new(&recording, moments, options);
        for (camera, (found, status)) in found.cameras.iter().zip(&found.status).enumerate() {
            network.cameras[camera] = (*status == CameraStatus::Calibrated).then(|| found.clone());
        }
        network.freed.clone_from(&found.freed);
        let n_right = found.right.iter().filter(|it| **it).count();
        network.steps.push(Step { stage: "from nothing", rms_px: found.rms_px, used: n_right });
        network.settle(&[1.5, 1.0, 1.0]);
        network
    };
    let again = |out: &[usize], repair: Option<culprits::Repair>| {
        let moments = repair.map_or_else(|| moments.clone(), |it| it.done_to(&moments));
        let mut certain = Room::new(&recording, moments.clone(), options).certain();
        certain.retain(|it| !out.contains(&it.camera));
        Some(settled(&search(&recording, &certain, options).ok()?, moments))
    };
    let network = first.as_ref().ok().map(|it| settled(it, moments.clone()));
    let Some(found) = culprits::find(&recording, &moments, network, &again) else {
        return Err(first.err().unwrap_or_else(|| unreachable!("a room that stands stays one")));
    };
    let uncalibrated = CameraStatus::Inconsistent { best: 0, common: 0, right: 0 };
    let (mut status, held, links) = match first {
        Ok(first) => (first.status, first.held, first.links),
        Err(_) => {
            (vec![uncalibrated; found.network.cameras.len()], vec![Vec::new(); found.network.cameras.len()], Vec::new())
        }
    };
    take_over(&mut status, &found);
    // What was said of optics beside a camera at fault says nothing of the room without it.
    let held = if found.culprits.is_empty() { held } else { vec![Vec::new(); status.len()] };
    let (mut solved, sigma_px) = found.network.into_solved(&recording, &status, links);
    solved.camera_faults = found.culprits;
    Ok(SolvedNetwork { solved, cleaning, held, moved: Vec::new(), sigma_px })
}

/// The status of each camera after the search for faulty cameras.
fn take_over(status: &mut [CameraStatus], found: &culprits::Found<'_>) {
    for (camera, status) in status.iter_mut().enumerate() {
        match found.culprits.iter().find(|it| it.camera == camera) {
            _ if found.network.cameras[camera].is_some() => *status = CameraStatus::Calibrated,
            Some(culprit) => *status = left_out(culprit, &found.network.moments),
            None if *status == CameraStatus::Calibrated => {
                *status = CameraStatus::Inconsistent { best: camera, common: 0, right: 0 };
            }
            None => {}
        }
    }
}

/// The status of a camera that is at fault.
fn left_out(culprit: &CameraFault, moments: &[Moment]) -> CameraStatus {
    let common = moments.iter().filter(|it| it.views.iter().any(|it| it.camera == culprit.camera)).count();
    let right = (culprit.shares[0] * common as f64).round() as usize;
    CameraStatus::Inconsistent { best: culprit.camera, common, right }
}

/// What is left of a recording after cleaning, and its moments.
fn prepared(
    recording: &Recording,
    sought: CalibrationTarget<'_>,
) -> Result<(Recording, Vec<Cleaning>, Vec<Moment>), NetworkError> {
    let (recording, cleaning) = match sought {
        // A joint of somebody who sits is no lamp.
        CalibrationTarget::Labels { .. } => cleaning::usable(recording),
        CalibrationTarget::Light | CalibrationTarget::Wand => cleaning::cleaned(recording),
    };
    require_company(&recording, &cleaning)?;
    let moments = match sought {
        CalibrationTarget::Light => moments::of_light(&recording),
        CalibrationTarget::Labels { mirrored } => labels::moments(&recording, mirrored),
        CalibrationTarget::Wand => {
            let moment_of_frame = wand::frames_by_time(&recording, moments::tolerance_s(&recording));
            let labelled = wand::label(&recording, &moment_of_frame, &wand::LabelOptions::default());
            let labelled = labelled.map_err(|fault| match fault {
                LabelError::NothingOriented { best, frames, needed } => {
                    NetworkError::NoWand { best: best.map(|it| recording.cameras[it].name.clone()), frames, needed }
                }
                other => NetworkError::Unusable(other.to_string()),
            })?;
            moments::of_wand(&wand::observations(&labelled.recording, &moment_of_frame))
        }
    };
    Ok((recording, cleaning, moments))
}

/// Self-calibration, from several focal lengths where nothing is known of them. The adjustment from one of them may end in a minimum of its own where
/// nearly everything fits, some tenths of a pixel off: so the least cost counts, and two starts have to agree on it.
fn search(
    recording: &Recording,
    observations: &[LightObservation],
    options: &NetworkOptions,
) -> Result<SelfCalibration, NetworkError> {
    let free: Vec<Freedom> = recording.cameras.iter().map(|it| it.free).collect();
    let NetworkOptions { sigma_px, inlier_px, min_common, max_focal_sigma, seed, .. } = *options;
    let inner = SelfCalibrationOptions {
        sigma_px,
        inlier_px,
        min_common,
        max_focal_sigma,
        seed,
        ..SelfCalibrationOptions::default()
    };
    let factors = if options.focal_unknown { &FOCAL_FACTORS[..] } else { &FOCAL_FACTORS[..1] };
    let n_right = |it: &SelfCalibration| it.right.iter().filter(|it| **it).count();
    // Squares of what is left, as far as they count at most.
    let cost = |it: &SelfCalibration| {
        let right = n_right(it) as f64;
        right * it.rms_px.powi(2) + (observations.len() as f64 - right) * inlier_px.powi(2)
    };
    let mut best: Option<SelfCalibration> = None;
    let mut fault = None;
    for factor in factors {
        let guess = |it: &CameraGuess| {
            let mut camera = it.camera.clone();
            if it.free.focal {
                camera.intrinsics.focal = camera.intrinsics.focal.map(|it| it * factor);
            }
            camera
        };
        let cameras: Vec<Camera> = recording.cameras.iter().map(guess).collect();
        match self_calibrate(&cameras, &free, observations, &inner) {
            Ok(found) => {
                let of_best = best.as_ref().map_or(f64::INFINITY, &cost);
                let ratio = cost(&found) / of_best;
                let agree = (ratio - 1.0).abs() < SAME;
                let best = if ratio < 1.0 - SAME { best.insert(found) } else { best.get_or_insert(found) };
                if agree && (best.stands(observations) || n_right(best) as f64 > FITS * observations.len() as f64) {
                    break;
                }
            }
            Err(found) => fault = fault.or(Some(found)),
        }
    }
    match (best, fault) {
        (Some(best), _) => Ok(best),
        (None, Some(SelfCalibrationError::NothingCalibrated { status })) => {
            let reasons = recording
                .cameras
                .iter()
                .zip(&status)
                .map(|(camera, it)| (camera.name.clone(), in_names(it, recording)));
            Err(NetworkError::NothingCalibrated { reasons: reasons.collect() })
        }
        (None, Some(other)) => Err(NetworkError::Unusable(other.sentence(|it| recording.name(it)))),
        (None, None) => unreachable!("each attempt ends in an answer or a fault"),
    }
}

/// `status` as a sentence with the names of the cameras concerned.
pub fn in_names(status: &CameraStatus, recording: &Recording) -> String {
    status.sentence(|it| recording.name(it))
}

/// Refuses recordings in which no two cameras can have seen the light together.
fn require_company(recording: &Recording, cleaning: &[Cleaning]) -> Result<(), NetworkError> {
    let seeing: Vec<usize> = (0..cleaning.len()).filter(|it| cleaning[*it].with_spots > 0).collect();
    match seeing[..] {
        [] => Err(NetworkError::NothingSeen { camera_frames: cleaning.iter().map(|it| it.camera_frames).sum() }),
        [only] => {
            let seen = recording.cameras[only].name.clone();
            Err(NetworkError::OneCamera { seen, camera_frames: cleaning[only].with_spots })
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests;
