//! Calibration of unsynchronised cameras from a waved wand.
//!
//! Clocks are found from the path of one end and, appended to it, that of the other. Where
//! a detector does not distinguish the ends, each camera's are tracked from picture to picture (`following`); the middle between them, which
//! is nearly that of the wand, gives clocks that are good enough for [`crate::wand::label`] to match the ends, and these give the clocks.

mod following;

use std::collections::BTreeMap;

use self::following::follow;
use super::{
    CalibrationTarget, NetworkError, NetworkOptions, NotSynchronised, OneClock, SynchronisedNetwork, cleaning,
    from_nothing, require_company,
};
use crate::clocks::{ClockError, ClockOptions, FrameOptions, Synchronised, in_turn, on_one_clock, synchronise};
use crate::recording::{CameraFrame, CameraGuess, Recording, Spot};
use crate::solved::ClockFit;
use crate::wand::{self, LabelError, LabelOptions};

/// Clocks to begin with are good enough to tell the ends apart when they are known to this, standard deviation [s].
const START_SIGMA_S: f64 = 20e-3;
/// The longest picture of a wand beside the median one: of all directions alike the median shows 0.87 of its length, and distances vary [–].
const LONGEST: f64 = 1.4;
/// Stretches of a camera's path of which a smaller part is of one end are of neither [–].
const SAME_END: f64 = 0.8;

/// Finds clocks and poses together from a wand with two lights; cameras whose clock is not determined are not calibrated. Clocks of constant
/// offset only: [`ClockOptions::max_drift`] is taken as 0.
///
/// # Errors
/// See [`NotSynchronised`].
pub fn unsynchronised_wand(
    recording: &Recording,
    clock_options: &ClockOptions,
    options: &NetworkOptions,
) -> Result<SynchronisedNetwork, NotSynchronised> {
    let (recording, cleaning) = cleaning::cleaned(recording);
    require_company(&recording, &cleaning)?;
    let shared = wand_on_one_clock(&recording, clock_options)?.if_several()?;
    let mut network = from_nothing(&shared.recording, CalibrationTarget::Wand, options)?;
    network.cleaning = cleaning;
    Ok(shared.of_room(network))
}

/// The recording of a wand at moments that all cameras share; labels 0 and 1 of its ends are kept where there are such.
///
/// # Errors
/// See [`NotSynchronised`].
pub fn wand_on_one_clock(recording: &Recording, options: &ClockOptions) -> Result<OneClock, NotSynchronised> {
    let options = ClockOptions { max_drift: 0.0, ..*options };
    let spots = || recording.camera_frames.iter().flat_map(|it| &it.spots);
    let n_labelled = spots().filter(|it| matches!(it.label, Some(0 | 1))).count();
    if 2 * n_labelled <= spots().count() {
        return without_labels(recording, &options);
    }
    let labelled = by_ends(recording, recording, &options);
    match &labelled {
        Ok(it) if it.n_clocks() == recording.cameras.len() => labelled,
        // A camera may have its labels the wrong way round.
        _ => match without_labels(&stripped(recording), &options) {
            Ok(other) if labelled.as_ref().is_ok_and(|it| it.n_clocks() >= other.n_clocks()) => labelled,
            Ok(other) => Ok(other),
            Err(_) => labelled,
        },
    }
}

/// Clocks by the ends as `of_ends` labels them, and `paths` resampled with these.
fn by_ends(of_ends: &Recording, paths: &Recording, options: &ClockOptions) -> Result<OneClock, NotSynchronised> {
    let found = synchronise(&in_turn(of_ends, &[0, 1], options.max_offset_s), options)?;
    let recording = resampled(paths, &found.clocks, options);
    let Synchronised { clocks, status, reference, .. } = found;
    Ok(OneClock { recording, clocks, status, reference })
}

fn without_labels(recording: &Recording, options: &ClockOptions) -> Result<OneClock, NotSynchronised> {
    let followed = follow(recording, options.max_gap_s);
    let beside_px = beside_middle_px(&followed);
    let rough = ClockOptions {
        sigma_px: options.sigma_px.hypot(0.5 * beside_px),
        inlier_px: options.inlier_px + beside_px,
        max_sigma_s: options.max_sigma_s.max(START_SIGMA_S),
        ..*options
    };
    let start = synchronise(&middles(&followed), &rough)?;
    if start.clocks.iter().flatten().count() < 2 {
        return Err(ClockError::NothingFound { status: start.status }.into());
    }
    let together = resampled(&followed, &start.clocks, options);
    let ends = with_ends(&followed, &together, options)?;
    let mut found = by_ends(&ends, &followed, options)?;
    for (camera, status) in start.status.into_iter().enumerate().filter(|it| start.clocks[it.0].is_none()) {
        if found.clocks[camera].is_none() {
            // Its ends could not be told for want of a clock.
            found.status[camera] = status;
        }
    }
    // Which stretch of a camera's path a spot is of means nothing in another.
    found.recording = stripped(&found.recording);
    Ok(found)
}

fn resampled(recording: &Recording, clocks: &[Option<ClockFit>], options: &ClockOptions) -> Recording {
    on_one_clock(recording, clocks, &FrameOptions { max_gap_s: options.max_gap_s, ..FrameOptions::default() })
}

/// The middle between the two spots of each picture that shows both ends.
fn middles(followed: &Recording) -> Recording {
    let camera_frame = |it: &CameraFrame| {
        let spots = match it.spots[..] {
            [a, b] => vec![Spot { pixel: nalgebra::center(&a.pixel, &b.pixel), label: None, ..a }],
            _ => Vec::new(),
        };
        CameraFrame { camera: it.camera, time_s: it.time_s, spots }
    };
    Recording {
        cameras: followed.cameras.clone(),
        camera_frames: followed.camera_frames.iter().map(camera_frame).collect(),
    }
}

/// How far the middle between the pictures of two ends may be from the picture of their middle, since one end is nearer to the camera:
/// at most f · l² / 8 z² of a wand of length l at the distance z, whose picture is at most f · l / z long [px].
fn beside_middle_px(followed: &Recording) -> f64 {
    let of_camera = |(camera, guess): (usize, &CameraGuess)| {
        let own = followed.camera_frames.iter().filter(|it| it.camera == camera);
        let mut long: Vec<f64> =
            own.filter_map(|it| Some((it.spots.first()?.pixel - it.spots.get(1)?.pixel).norm())).collect();
        long.sort_by(f64::total_cmp);
        // The median, for an end and a lamp may lie much farther apart; a wand that points anywhere has a longest picture little above it.
        let longest = LONGEST * long.get(long.len() / 2).copied().unwrap_or(0.0);
        longest.powi(2) / (8.0 * guess.camera.intrinsics.focal[0])
    };
    followed.cameras.iter().enumerate().map(of_camera).fold(0.0, f64::max)
}

fn stripped(recording: &Recording) -> Recording {
    let mut recording = recording.clone();
    recording.camera_frames.iter_mut().flat_map(|it| &mut it.spots).for_each(|it| it.label = None);
    recording
}

/// `followed` with labels 0 and 1 of the ends, as `together` shows them: the same paths under clocks that are nearly right.
fn with_ends(followed: &Recording, together: &Recording, options: &ClockOptions) -> Result<Recording, NetworkError> {
    let frames = wand::frames_by_time(together, 1e-6);
    let defaults = LabelOptions::default();
    // Clocks that are still a little off move the ends along their paths.
    let label_options = LabelOptions {
        sigma_px: 2.0 * defaults.sigma_px,
        inlier_px: 2.0 * defaults.inlier_px,
        seed: options.seed,
        ..defaults
    };
    let labelled = wand::label(&stripped(together), &frames, &label_options).map_err(|fault| match fault {
        LabelError::NothingOriented { best, frames, needed } => {
            NetworkError::NoWand { best: best.map(|it| followed.cameras[it].name.clone()), frames, needed }
        }
        other => NetworkError::Unusable(other.to_string()),
    })?;
    let mut votes: BTreeMap<(usize, u32), [usize; 2]> = BTreeMap::new();
    for (before, after) in together.camera_frames.iter().zip(&labelled.recording.camera_frames) {
        for spot in &after.spots {
            let path = before.spots.iter().find(|it| it.pixel == spot.pixel).and_then(|it| it.label);
            if let (Some(path), Some(end @ (0 | 1))) = (path, spot.label) {
                votes.entry((before.camera, path)).or_default()[end as usize] += 1;
            }
        }
    }
    let end_of = |camera: usize, path: u32| {
        let votes = votes.get(&(camera, path))?;
        let end = u32::from(votes[1] > votes[0]);
        (votes[end as usize] as f64 >= SAME_END * (votes[0] + votes[1]) as f64).then_some(end)
    };
    let mut recording = followed.clone();
    for camera_frame in &mut recording.camera_frames {
        camera_frame
            .spots
            .iter_mut()
            .for_each(|it| it.label = it.label.and_then(|path| end_of(camera_frame.camera, path)));
        camera_frame.spots.retain(|it| it.label.is_some());
    }
    Ok(recording)
}
