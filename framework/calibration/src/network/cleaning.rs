//! Cleans a recording before anything is computed: what is set aside, and why.

use std::collections::{BTreeMap, BTreeSet};

use crate::recording::{CameraFrame, Recording, Spot};

/// A place in the picture is a lamp when so large a part of a camera's pictures have a spot there [–].
const LAMP_SHARE: f64 = 0.2;
/// Pictures with the spot there that it takes at least.
const LAMP_LOOKS: usize = 20;
/// Spots elsewhere that a camera must have for any of its places to be a lamp: a light that never moves is no lamp, but no use either.
const MOVING_SPOTS: usize = 20;
/// Width of such a place [px].
const PLACE_PX: f64 = 4.0;
/// The brightest of several spots is the light when the next one is darker by this factor [–].
const OUTSHINES: f64 = 1.5;

/// What was set aside from one camera.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Cleaning {
    /// Pictures.
    pub camera_frames: usize,
    /// Pictures with a spot.
    pub with_spots: usize,
    /// Spots with a coordinate that is not finite, or outside the picture.
    pub unusable: usize,
    /// Spots identical to another one of the same picture: rows that were written twice.
    pub written_twice: usize,
    /// Pictures at the time of an earlier one.
    pub repeated_times: usize,
    /// Pictures identical to the one before while other cameras see the light move: a repeated frame.
    pub repeated_pictures: usize,
    /// Places of lights that do not move [px].
    pub lamps: Vec<[f64; 2]>,
    /// Pictures with several spots of similar brightness; used once the cameras are known.
    pub ambiguous: usize,
}

/// A recording with what was set aside taken out, and a word on each camera.
pub(crate) fn cleaned(recording: &Recording) -> (Recording, Vec<Cleaning>) {
    let (Recording { cameras, mut camera_frames }, mut notes) = usable(recording);
    drop_lamps(&mut camera_frames, &mut notes);
    drop_repeated_pictures(&mut camera_frames, &mut notes);
    count(&camera_frames, &mut notes);
    (Recording { cameras, camera_frames }, notes)
}

/// How many pictures are left with a spot.
fn count(camera_frames: &[CameraFrame], notes: &mut [Cleaning]) {
    notes.iter_mut().for_each(|it| (it.with_spots, it.ambiguous) = (0, 0));
    for camera_frame in camera_frames {
        let note = &mut notes[camera_frame.camera];
        note.with_spots += usize::from(!camera_frame.spots.is_empty());
        note.ambiguous += usize::from(camera_frame.spots.len() > 1 && the_light(&camera_frame.spots).is_none());
    }
}

/// As [`cleaned`], without a look at what stands still: times in order, and spots that can be.
pub(super) fn usable(recording: &Recording) -> (Recording, Vec<Cleaning>) {
    let mut notes = vec![Cleaning::default(); recording.cameras.len()];
    let mut camera_frames: Vec<CameraFrame> =
        recording.camera_frames.iter().filter(|it| it.camera < notes.len()).cloned().collect();
    camera_frames.sort_by(|a, b| a.time_s.total_cmp(&b.time_s).then(a.camera.cmp(&b.camera)));
    let mut last_time = vec![f64::NEG_INFINITY; notes.len()];
    camera_frames.retain(|camera_frame| {
        let note = &mut notes[camera_frame.camera];
        let fresh = camera_frame.time_s.is_finite() && camera_frame.time_s > last_time[camera_frame.camera];
        note.camera_frames += 1;
        note.repeated_times += usize::from(!fresh);
        if fresh {
            last_time[camera_frame.camera] = camera_frame.time_s;
        }
        fresh
    });
    for camera_frame in &mut camera_frames {
        let before = camera_frame.spots.len();
        let camera = &recording.cameras[camera_frame.camera].camera;
        camera_frame.spots.retain(|it| is_usable(it) && camera.has_pixel(&it.pixel));
        notes[camera_frame.camera].unusable += before - camera_frame.spots.len();
        let before = camera_frame.spots.len();
        keep_distinct(&mut camera_frame.spots);
        notes[camera_frame.camera].written_twice += before - camera_frame.spots.len();
    }
    count(&camera_frames, &mut notes);
    (Recording { cameras: recording.cameras.clone(), camera_frames }, notes)
}

fn is_usable(spot: &Spot) -> bool {
    spot.pixel.coords.norm().is_finite() && spot.sigma_px.is_finite() && spot.sigma_px > 0.0
}

/// Takes out spots that equal an earlier one in every number.
pub fn keep_distinct(spots: &mut Vec<Spot>) {
    let numbers = |it: &Spot| ([it.pixel.x, it.pixel.y, it.sigma_px, it.peak].map(f64::to_bits), it.label);
    let mut known = BTreeSet::new();
    spots.retain(|it| known.insert(numbers(it)));
}

/// The spot that is the light, if one picture suffices to identify it.
pub(crate) fn the_light(spots: &[Spot]) -> Option<&Spot> {
    let brightest = spots.iter().max_by(|a, b| a.peak.total_cmp(&b.peak))?;
    let is_plain = spots.iter().all(|it| std::ptr::eq(it, brightest) || it.peak * OUTSHINES < brightest.peak);
    is_plain.then_some(brightest)
}

fn place(spot: &Spot) -> (i64, i64) {
    ((spot.pixel.x / PLACE_PX).floor() as i64, (spot.pixel.y / PLACE_PX).floor() as i64)
}

fn touches(a: &(i64, i64), b: &(i64, i64)) -> bool {
    (a.0 - b.0).abs() <= 1 && (a.1 - b.1).abs() <= 1
}

/// Takes out spots that stay where they are in much of a camera's pictures.
fn drop_lamps(camera_frames: &mut [CameraFrame], notes: &mut [Cleaning]) {
    for (camera, note) in notes.iter_mut().enumerate() {
        let mut counts: BTreeMap<(i64, i64), usize> = BTreeMap::new();
        let (mut n_frames, mut n_spots) = (0, 0);
        for camera_frame in camera_frames.iter().filter(|it| it.camera == camera) {
            n_frames += usize::from(!camera_frame.spots.is_empty());
            n_spots += camera_frame.spots.len();
            camera_frame.spots.iter().for_each(|it| *counts.entry(place(it)).or_default() += 1);
        }
        let least = LAMP_LOOKS.max((LAMP_SHARE * n_frames as f64).ceil() as usize);
        let around = |of: &(i64, i64)| -> usize { counts.iter().filter(|it| touches(it.0, of)).map(|it| it.1).sum() };
        // The fullest of the places that a lamp wanders over stands for it.
        let fullest =
            |of: &(i64, i64)| counts.iter().filter(|it| touches(it.0, of)).all(|it| (*it.1, it.0) <= (counts[of], of));
        let candidates = counts.iter().filter(|it| 9 * it.1 >= least);
        let lamps: Vec<(i64, i64)> =
            candidates.map(|it| *it.0).filter(|it| around(it) >= least && fullest(it)).collect();
        // The spot of a lamp wanders over the border of its place.
        let near = |spot: &Spot| {
            let here = place(spot);
            lamps.iter().any(|it| touches(it, &here))
        };
        let of_lamps: usize = camera_frames
            .iter()
            .filter(|it| it.camera == camera)
            .flat_map(|it| &it.spots)
            .filter(|it| near(it))
            .count();
        if lamps.is_empty() || n_spots - of_lamps < MOVING_SPOTS {
            continue;
        }
        camera_frames
            .iter_mut()
            .filter(|it| it.camera == camera)
            .for_each(|camera_frame| camera_frame.spots.retain(|it| !near(it)));
        note.lamps = lamps.iter().map(|it| [(it.0 as f64 + 0.5) * PLACE_PX, (it.1 as f64 + 0.5) * PLACE_PX]).collect();
    }
}

/// A light that moves by so much between two pictures of a camera moves [px].
const MOVES_PX: f64 = 3.0;

/// Takes out pictures that repeat the one before to the last digit while the light moves on in that camera: a frame that was
/// written twice shows the light where it no longer is.
fn drop_repeated_pictures(camera_frames: &mut [CameraFrame], notes: &mut [Cleaning]) {
    for (camera, note) in notes.iter_mut().enumerate() {
        let own: Vec<usize> = (0..camera_frames.len())
            .filter(|it| camera_frames[*it].camera == camera && camera_frames[*it].spots.len() == 1)
            .collect();
        let pixel = |camera_frames: &[CameraFrame], it: usize| camera_frames[it].spots[0].pixel;
        let mut repeats = Vec::new();
        for three in own.windows(3) {
            let [before, here, after] = [three[0], three[1], three[2]].map(|it| pixel(camera_frames, it));
            if before == here && (after - here).norm() > MOVES_PX {
                repeats.push(three[1]);
            }
        }
        note.repeated_pictures = repeats.len();
        repeats.into_iter().for_each(|it| camera_frames[it].spots.clear());
    }
}
