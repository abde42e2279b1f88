//! Calibration of unsynchronised cameras from nothing.

use foveate_geometry::CameraStatus;
use foveate_geometry::bundle::Freedom;

use super::moments::of_frames;
use super::settle::Room;
use super::{NetworkError, NetworkOptions, SolvedNetwork, cleaning, culprits, require_company, take_over};
use crate::cause::{CameraFault, Cause};
use crate::clocks::{ClockError, ClockOptions, ClockStatus, FrameOptions, Synchronised, frames, synchronise};
use crate::recording::Recording;
use crate::solved::Step;

/// A calibrated network of unsynchronised cameras, and their clocks.
#[derive(Debug, Clone, PartialEq)]
pub struct SynchronisedNetwork {
    /// Its cameras carry their clocks.
    pub network: SolvedNetwork,
    /// By camera: the status of its clock.
    pub clocks: Vec<ClockStatus>,
    /// The camera whose clock is the room's.
    pub reference: usize,
}

/// Why unsynchronised cameras could not be calibrated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NotSynchronised {
    /// The network cannot be calibrated, whatever the clocks.
    #[error(transparent)]
    Room(#[from] NetworkError),
    /// The clocks cannot be found.
    #[error(transparent)]
    Clocks(#[from] ClockError),
}

/// Pictures of so many cameras at most are turned on trial, for each takes as long as the whole room [–].
const TURNED: usize = 3;

/// Finds clocks and poses together. Cameras whose clock is not determined are not calibrated; [`SynchronisedNetwork::clocks`] says why.
///
/// # Errors
/// See [`NotSynchronised`].
pub fn unsynchronised_from_nothing(
    recording: &Recording,
    clock_options: &ClockOptions,
    options: &NetworkOptions,
) -> Result<SynchronisedNetwork, NotSynchronised> {
    let (recording, cleaning) = cleaning::cleaned(recording);
    require_company(&recording, &cleaning)?;
    let Synchronised { clocks, status: of_clocks, reference, cameras, rms_px, .. } =
        synchronise(&recording, clock_options)?;
    let all =
        frames(&recording, &clocks, &FrameOptions { max_gap_s: clock_options.max_gap_s, ..FrameOptions::default() });
    let used = all.observations.len();
    let moments = of_frames(&all);
    let mut network = Room::new(&recording, moments.clone(), options);
    let mut status = Vec::with_capacity(cameras.len());
    for (camera, (found, of_clock)) in cameras.into_iter().zip(&of_clocks).enumerate() {
        let is_found = matches!(of_clock, ClockStatus::Reference | ClockStatus::Found { .. });
        let (pose, why) = (is_found.then_some(found), why_left_out(of_clock));
        network.cameras[camera] = pose;
        status.push(why);
    }
    network.freed = recording.cameras.iter().map(|it| Freedom { pose: true, ..it.free }).collect();
    network.steps.push(Step { stage: "from nothing, with clocks", rms_px, used });
    network.settle(&[1.5, 1.0, 1.0]);
    let mirrored = mirrored(&recording, &status, clock_options);
    // Without a clock nothing can be solved anew: cameras are left out of the room as it stands.
    let found = culprits::find(&recording, &moments, Some(network), &|_, _| None);
    let Some(found) = found else { unreachable!("a room that stands stays one") };
    take_over(&mut status, &found);
    let (mut solved, sigma_px) = found.network.into_solved(&recording, &status, Vec::new());
    solved.camera_faults = found.culprits;
    solved.camera_faults.extend(mirrored);
    for (camera, clock) in solved.cameras.iter_mut().zip(clocks) {
        camera.clock = clock;
    }
    let held = vec![Vec::new(); solved.cameras.len()];
    Ok(SynchronisedNetwork {
        network: SolvedNetwork { solved, cleaning, held, moved: Vec::new(), sigma_px },
        clocks: of_clocks,
        reference,
    })
}

/// The status of a camera whose clock came to this.
pub(super) fn why_left_out(of_clock: &ClockStatus) -> CameraStatus {
    match of_clock {
        ClockStatus::Reference | ClockStatus::Found { .. } => CameraStatus::Calibrated,
        ClockStatus::NoPose { status } => status.clone(),
        ClockStatus::Undetermined { other, .. } => CameraStatus::ClockOpen { best: Some(*other) },
        ClockStatus::Separate { group } => CameraStatus::Separate { group: group.clone() },
        ClockStatus::TooFewViews { moments, needed } => {
            CameraStatus::TooFewObservations { frames: *moments, needed: *needed }
        }
        ClockStatus::LightStill { spread_px } => CameraStatus::LightStill { spread_px: *spread_px },
        // The pose is good, the clock is not: a camera that would spoil every moving target.
        ClockStatus::Uncertain { .. } | ClockStatus::BeyondLimit { .. } => CameraStatus::ClockOpen { best: None },
    }
}

/// Of the cameras that fit nowhere those whose clock is found once their picture is turned left to right.
fn mirrored(recording: &Recording, status: &[CameraStatus], options: &ClockOptions) -> Vec<CameraFault> {
    let fits_nowhere = |it: &usize| {
        matches!(
            status[*it],
            CameraStatus::Inconsistent { .. } | CameraStatus::ClockOpen { .. } | CameraStatus::Separate { .. }
        )
    };
    let is_found = |camera: &usize| {
        let mut turned = recording.clone();
        let width = f64::from(turned.cameras[*camera].camera.image_size[0]);
        for camera_frame in turned.camera_frames.iter_mut().filter(|it| it.camera == *camera) {
            camera_frame.spots.iter_mut().for_each(|it| it.pixel.x = width - 1.0 - it.pixel.x);
        }
        let found = synchronise(&turned, options);
        found.is_ok_and(|it| matches!(it.status[*camera], ClockStatus::Found { .. } | ClockStatus::Reference))
    };
    let candidates = (0..status.len()).filter(fits_nowhere).take(TURNED);
    let found: Vec<usize> = candidates.filter(is_found).collect();
    found.into_iter().map(|camera| CameraFault { camera, cause: Cause::Mirrored, shares: [0.0, 1.0] }).collect()
}
