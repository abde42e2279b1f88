//! A wand waved before cameras that share no clock.
//!
//! Both ends are paths of one clock each camera: the path of one end, and after it that of the other, is what clocks are found from. Where
//! a detector does not tell the ends apart, each camera's are followed from picture to picture (`following`); the middle between them, which
//! is nearly that of the wand, gives clocks that are good enough for [`crate::wand::label`] to say which are the same, and these give the clocks.

mod following;

use std::collections::BTreeMap;

use self::following::follow;
use super::{
    NotSynchronised, OneClock, RoomFault, RoomRules, Sought, SynchronisedRoom, cleaning, from_nothing, require_company,
};
use crate::clocks::{ClockFault, ClockRules, FrameRules, Synchronised, in_turn, on_one_clock, synchronise};
use crate::recording::{CameraGuess, Look, Recording, Spot};
use crate::solved::ClockFit;
use crate::wand::{self, LabelFault, LabelRules};

/// Clocks to begin with are good enough to tell the ends apart when they are known to this, standard deviation [s].
const START_SIGMA_S: f64 = 20e-3;
/// The longest picture of a wand beside the median one: of all directions alike the median shows 0.87 of its length, and distances vary [–].
const LONGEST: f64 = 1.4;
/// Stretches of a camera's path of which a smaller part is of one end are of neither [–].
const SAME_END: f64 = 0.8;

/// Finds clocks and poses together from a wand with two lights; cameras whose clock is not determined are not calibrated. Clocks of constant
/// offset only: [`ClockRules::max_drift`] is taken as 0.
///
/// # Errors
/// See [`NotSynchronised`].
pub fn unsynchronised_wand(
    recording: &Recording,
    clock_rules: &ClockRules,
    rules: &RoomRules,
) -> Result<SynchronisedRoom, NotSynchronised> {
    let (recording, cleaning) = cleaning::cleaned(recording);
    require_company(&recording, &cleaning)?;
    let shared = wand_on_one_clock(&recording, clock_rules)?.if_several()?;
    let mut room = from_nothing(&shared.recording, Sought::Wand, rules)?;
    room.cleaning = cleaning;
    Ok(shared.of_room(room))
}

/// The recording of a wand at moments that all cameras share; labels 0 and 1 of its ends are kept where there are such.
///
/// # Errors
/// See [`NotSynchronised`].
pub fn wand_on_one_clock(recording: &Recording, rules: &ClockRules) -> Result<OneClock, NotSynchronised> {
    let rules = ClockRules { max_drift: 0.0, ..*rules };
    let spots = || recording.looks.iter().flat_map(|it| &it.spots);
    let n_labelled = spots().filter(|it| matches!(it.label, Some(0 | 1))).count();
    if 2 * n_labelled <= spots().count() {
        return without_labels(recording, &rules);
    }
    let labelled = by_ends(recording, recording, &rules);
    match &labelled {
        Ok(it) if it.n_clocks() == recording.cameras.len() => labelled,
        // A camera may have its labels the wrong way round.
        _ => match without_labels(&stripped(recording), &rules) {
            Ok(other) if labelled.as_ref().is_ok_and(|it| it.n_clocks() >= other.n_clocks()) => labelled,
            Ok(other) => Ok(other),
            Err(_) => labelled,
        },
    }
}

/// Clocks by the ends as `of_ends` labels them, and `paths` resampled with these.
fn by_ends(of_ends: &Recording, paths: &Recording, rules: &ClockRules) -> Result<OneClock, NotSynchronised> {
    let found = synchronise(&in_turn(of_ends, &[0, 1], rules.max_offset_s), rules)?;
    let recording = resampled(paths, &found.clocks, rules);
    let Synchronised { clocks, status, reference, .. } = found;
    Ok(OneClock { recording, clocks, status, reference })
}

fn without_labels(recording: &Recording, rules: &ClockRules) -> Result<OneClock, NotSynchronised> {
    let followed = follow(recording, rules.max_gap_s);
    let beside_px = beside_middle_px(&followed);
    let rough = ClockRules {
        sigma_px: rules.sigma_px.hypot(0.5 * beside_px),
        inlier_px: rules.inlier_px + beside_px,
        max_sigma_s: rules.max_sigma_s.max(START_SIGMA_S),
        ..*rules
    };
    let start = synchronise(&middles(&followed), &rough)?;
    if start.clocks.iter().flatten().count() < 2 {
        return Err(ClockFault::NothingFound { status: start.status }.into());
    }
    let together = resampled(&followed, &start.clocks, rules);
    let ends = with_ends(&followed, &together, rules)?;
    let mut found = by_ends(&ends, &followed, rules)?;
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

fn resampled(recording: &Recording, clocks: &[Option<ClockFit>], rules: &ClockRules) -> Recording {
    on_one_clock(recording, clocks, &FrameRules { max_gap_s: rules.max_gap_s, ..FrameRules::default() })
}

/// The middle between the two spots of each picture that shows both ends.
fn middles(followed: &Recording) -> Recording {
    let look = |it: &Look| {
        let spots = match it.spots[..] {
            [a, b] => vec![Spot { pixel: nalgebra::center(&a.pixel, &b.pixel), label: None, ..a }],
            _ => Vec::new(),
        };
        Look { camera: it.camera, time_s: it.time_s, spots }
    };
    Recording { cameras: followed.cameras.clone(), looks: followed.looks.iter().map(look).collect() }
}

/// How far the middle between the pictures of two ends may be from the picture of their middle, since one end is nearer to the camera:
/// at most f · l² / 8 z² of a wand of length l at the distance z, whose picture is at most f · l / z long [px].
fn beside_middle_px(followed: &Recording) -> f64 {
    let of_camera = |(camera, guess): (usize, &CameraGuess)| {
        let own = followed.looks.iter().filter(|it| it.camera == camera);
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
    recording.looks.iter_mut().flat_map(|it| &mut it.spots).for_each(|it| it.label = None);
    recording
}

/// `followed` with labels 0 and 1 of the ends, as `together` shows them: the same paths under clocks that are nearly right.
fn with_ends(followed: &Recording, together: &Recording, rules: &ClockRules) -> Result<Recording, RoomFault> {
    let frames = wand::frames_by_time(together, 1e-6);
    let defaults = LabelRules::default();
    // Clocks that are still a little off move the ends along their paths.
    let label_rules = LabelRules {
        sigma_px: 2.0 * defaults.sigma_px,
        inlier_px: 2.0 * defaults.inlier_px,
        seed: rules.seed,
        ..defaults
    };
    let labelled = wand::label(&stripped(together), &frames, &label_rules).map_err(|fault| match fault {
        LabelFault::NothingOriented { best, frames, needed } => {
            RoomFault::NoWand { best: best.map(|it| followed.cameras[it].name.clone()), frames, needed }
        }
        other => RoomFault::Unusable(other.to_string()),
    })?;
    let mut votes: BTreeMap<(usize, u32), [usize; 2]> = BTreeMap::new();
    for (before, after) in together.looks.iter().zip(&labelled.recording.looks) {
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
    for look in &mut recording.looks {
        look.spots.iter_mut().for_each(|it| it.label = it.label.and_then(|path| end_of(look.camera, path)));
        look.spots.retain(|it| it.label.is_some());
    }
    Ok(recording)
}
