//! From a recording of one waved light to a solved room: from nothing, or from an older calibration.
//!
//! 1. What cannot be a waved light is set aside ([`Cleaning`]): numbers that are none, lamps, frames that were written twice.
//! 2. Pictures are grouped by moments. One moment in ten is held out.
//! 3. From nothing, [`foveate_geometry::self_calibrate`] finds poses and, as far as the observations hold them, optics; from an older
//!    calibration, cameras that moved are found and placed anew ([`recalibrate`]).
//! 4. The room is settled: pictures with several spots are decided by where the others see the light, points intersected, all
//!    adjusted together, observations judged anew.
//! 5. Each observation's residual is told, those of the moments that were held out apart.

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
use crate::cause::Culprit;
use crate::recording::{CameraGuess, Recording};
use crate::solved::{ObservationRole, Solved, Step};
use crate::wand::{self, LabelError, WandObservation};

/// How to go about it.
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
    /// Whether focal lengths may be far from those given: many are tried then.
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

/// A solved room and how it came about.
#[derive(Debug, Clone, PartialEq)]
pub struct SolvedNetwork {
    /// Cameras, path, residuals.
    pub solved: Solved,
    /// By camera: what was set aside before.
    pub cleaning: Vec<Cleaning>,
    /// By camera: optics that were to be found and stay as given, and why.
    pub held: Vec<Vec<OpticHeld>>,
    /// Cameras that do not stand where the older calibration has them.
    pub moved: Vec<Moved>,
    /// Of either coordinate of a right pixel, standard deviation, as the residuals have it [px].
    pub sigma_px: f64,
}

impl SolvedNetwork {
    /// What was seen of a wand's ends in one role, for [`crate::wand::intersect`].
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

/// Why a room cannot be solved.
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
        /// Which.
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
        "{agreeing} of {cameras} cameras agree with the older calibration on where what they saw was, expected at least 2 and more than half; \
         calibrate from nothing (`--from-nothing`, and `--distance A:B=LENGTH` for the scale)"
    )]
    NotThisRoom {
        /// That agree.
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
        /// How many are needed.
        needed: usize,
    },
    /// A camera or a rule that cannot be used.
    #[error("{0}")]
    Unusable(String),
}

/// Factors of a focal length of which nothing is known, in the order in which they are tried.
const FOCAL_FACTORS: [f64; 4] = [1.0, 1.6, 0.6, 2.5];
/// A start by which so large a part of the observations fits is not improved upon once another one has come to the same [–].
const FITS: f64 = 0.9;
/// Starts whose costs differ by less than this part have come to the same [–].
const SAME: f64 = 0.01;

/// What was waved.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Sought<'a> {
    /// One light.
    #[default]
    Light,
    /// Two lights on a stick, told apart by their labels or, without, by [`crate::wand::label`].
    Wand,
    /// Several points with labels, such as the joints of a person who walks about: each a point of its own in each frame.
    Labels {
        /// Pairs of labels that whoever set them may have taken for each other, such as the left and the right knee.
        mirrored: &'a [[u32; 2]],
    },
}

/// Solves the room of `recording`, by cameras that share a clock, without any pose to begin with. The result is up to a similarity,
/// as [`SelfCalibration::cameras`] says.
///
/// # Errors
/// See [`NetworkError`]; cameras that cannot be calibrated beside others that can are told in their status.
pub fn from_nothing(
    recording: &Recording,
    sought: Sought<'_>,
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
    solved.culprits = found.culprits;
    Ok(SolvedNetwork { solved, cleaning, held, moved: Vec::new(), sigma_px })
}

/// What became of each camera after the search for culprits.
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
fn left_out(culprit: &Culprit, moments: &[Moment]) -> CameraStatus {
    let common = moments.iter().filter(|it| it.views.iter().any(|it| it.camera == culprit.camera)).count();
    let right = (culprit.shares[0] * common as f64).round() as usize;
    CameraStatus::Inconsistent { best: culprit.camera, common, right }
}

/// What is left of a recording after cleaning, and its moments.
fn prepared(
    recording: &Recording,
    sought: Sought<'_>,
) -> Result<(Recording, Vec<Cleaning>, Vec<Moment>), NetworkError> {
    let (recording, cleaning) = match sought {
        // A joint of somebody who sits is no lamp.
        Sought::Labels { .. } => cleaning::usable(recording),
        Sought::Light | Sought::Wand => cleaning::cleaned(recording),
    };
    require_company(&recording, &cleaning)?;
    let moments = match sought {
        Sought::Light => moments::of_light(&recording),
        Sought::Labels { mirrored } => labels::moments(&recording, mirrored),
        Sought::Wand => {
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

/// `status` with the names of the cameras it speaks of.
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
