//! An older calibration and new sightings: who moved, and where everybody stands now.

use foveate_estimation::{Loss, Random};
use foveate_geometry::{AlignmentRules, Camera, CameraStatus, Freedom, ResectionRules, align, resect};
use nalgebra::{Isometry3, Point3, Similarity3, Translation3, UnitQuaternion, Vector3};

use super::cleaning::Cleaning;
use super::moments::Moment;
use super::settle::Room;
use super::{RoomFault, RoomRules, SolvedRoom, Sought, culprits, prepared, take_over};
use crate::axes::transformed;
use crate::cause::{Cause, Culprit};
use crate::recording::Recording;
use crate::solved::{FixedFreedoms, Solved};

/// A camera that does not stand where it stood.
#[derive(Debug, Clone, PartialEq)]
pub struct Moved {
    /// Which.
    pub camera: usize,
    /// Distance of its centre from where it was [m, or the unit of the older calibration].
    pub distance: f64,
    /// Angle between how it looked and looks [rad].
    pub angle_rad: f64,
    /// How far off its sightings are under the older calibration, median [px].
    pub before_px: f64,
}

/// Sightings this many times as far off as right ones may be still speak of an older calibration that needs no more than adjusting.
const OLD_LIMIT: f64 = 4.0;
/// A camera stands where it stood when so large a part of its sightings agree with the others' [–].
const AGREES: f64 = 0.5;
/// A camera moved when its sightings were this many times as far off as right ones are, under the older calibration.
const MOVED_SIGMAS: f64 = 4.0;
/// Right sightings are never taken for better than that [px].
const LEAST_MOVED_PX: f64 = 0.25;
/// Moments by which pairs of cameras are compared.
const WITNESSES: usize = 300;
/// Sightings that it takes to speak of a camera.
const LEAST_SIGHTINGS: usize = 10;

/// Adjusts the calibration that `recording.cameras` hold to what the recording shows. Scale, axes and origin stay those of the cameras
/// that did not move; `fixed` is what fixes them.
///
/// # Errors
/// See [`RoomFault`].
pub fn recalibrate(
    recording: &Recording,
    sought: Sought<'_>,
    fixed: &FixedFreedoms,
    rules: &RoomRules,
) -> Result<SolvedRoom, RoomFault> {
    let (recording, cleaning, moments) = prepared(recording, sought)?;
    for it in &recording.cameras {
        it.camera.check().map_err(|fault| RoomFault::Unusable(format!("{}: {fault}", it.name)))?;
    }
    let given: Vec<Camera> = recording.cameras.iter().map(|it| it.camera.clone()).collect();
    let adjusted = |moments: Vec<Moment>, out: &[usize]| adjusted(&recording, moments, out, &cleaning, rules);
    let (room, mut status) = adjusted(moments.clone(), &[])?;
    let again = |out: &[usize], repair: Option<culprits::Repair>| {
        let moments = repair.map_or_else(|| moments.clone(), |it| it.done_to(&moments));
        adjusted(moments, out).ok().map(|it| it.0)
    };
    let found = culprits::find(&recording, &moments, Some(room), &again);
    let Some(found) = found else { unreachable!("a room that stands stays one") };
    take_over(&mut status, &found);
    let room = found.room;
    let stayed = who_stayed(&room, &given, room.pixel_sigma().unwrap_or(rules.sigma_px));
    let mut culprits = found.culprits;
    let (solved, sigma_px) = room.into_solved(&recording, &status, Vec::new());
    let mut solved = transformed(&solved, &stayed.given_from_found, fixed.clone());
    let mut moved = Vec::new();
    for (camera, it) in solved.cameras.iter().enumerate().filter(|it| it.1.status == CameraStatus::Calibrated) {
        if !stayed.cameras.contains(&camera) {
            let (old, new) = (&given[camera].camera_from_world, &it.camera.camera_from_world);
            moved.push(Moved {
                camera,
                distance: (given[camera].centre() - it.camera.centre()).norm(),
                angle_rad: old.rotation.angle_to(&new.rotation),
                before_px: stayed.errors_px[camera],
            });
        }
    }
    culprits.extend(explained(&moved, &given, &solved));
    solved.culprits = culprits;
    Ok(SolvedRoom { solved, cleaning, held: vec![Vec::new(); given.len()], moved, sigma_px })
}

/// The room of the older calibration adjusted to `moments`, without the cameras in `out`; and what became of each camera.
fn adjusted<'a>(
    recording: &Recording,
    moments: Vec<Moment>,
    out: &[usize],
    cleaning: &[Cleaning],
    rules: &'a RoomRules,
) -> Result<(Room<'a>, Vec<CameraStatus>), RoomFault> {
    let given: Vec<Camera> = recording.cameras.iter().map(|it| it.camera.clone()).collect();
    let mut room = Room::new(recording, moments, rules);
    room.cameras = given.iter().cloned().map(Some).collect();
    let mut status = vec![CameraStatus::Calibrated; given.len()];
    for (camera, note) in cleaning.iter().enumerate() {
        if note.with_spots < LEAST_SIGHTINGS || out.contains(&camera) {
            room.cameras[camera] = None;
            status[camera] = CameraStatus::TooFewSightings { frames: note.with_spots, needed: LEAST_SIGHTINGS };
        }
    }
    let seeing = room.cameras.iter().flatten().count();
    drop_strangers(&mut room, rules);
    let agreeing = room.cameras.iter().flatten().count();
    if agreeing < 2 || 2 * agreeing <= seeing {
        return Err(RoomFault::NotThisRoom { agreeing, cameras: seeing });
    }
    let optics = room.freed.clone();
    room.freed.fill(Freedom::POSE);
    room.adjust(Loss::CAUCHY, false);
    place_anew(&mut room, &given, &mut status, rules);
    room.freed = optics;
    room.settle(&[2.0, 1.0, 1.0]);
    Ok((room, status))
}

/// A camera stands where another pose has it when it is turned by less [rad]…
const SAME_TURN: f64 = 0.05;
/// … and off by a smaller part of the room's size [–].
const SAME_CENTRE: f64 = 0.05;

/// What those that do not stand where they stood have in common with where cameras stood: two that changed places are two names exchanged,
/// one that rolled by half is upside down. A camera of which neither is so was moved.
fn explained(moved: &[Moved], given: &[Camera], solved: &Solved) -> Vec<Culprit> {
    let n = given.len() as f64;
    let middle = given.iter().fold(Vector3::zeros(), |sum, it| sum + it.centre().coords / n);
    let size = (given.iter().map(|it| (it.centre().coords - middle).norm_squared()).sum::<f64>() / n).sqrt();
    let is_same = |a: &Isometry3<f64>, b: &Isometry3<f64>| {
        let centre = |it: &Isometry3<f64>| it.inverse().translation.vector;
        a.rotation.angle_to(&b.rotation) < SAME_TURN && (centre(a) - centre(b)).norm() < SAME_CENTRE * size
    };
    let old = |camera: usize| given[camera].camera_from_world;
    let new = |camera: usize| solved.cameras[camera].camera.camera_from_world;
    let half_turn = Isometry3::from_parts(
        Translation3::identity(),
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI),
    );
    let cause = |it: &Moved| {
        let others = moved.iter().map(|it| it.camera).filter(|other| *other != it.camera);
        let with = others
            .into_iter()
            .find(|other| is_same(&new(it.camera), &old(*other)) && is_same(&new(*other), &old(it.camera)));
        match with {
            Some(with) => Cause::Swapped { with, since_s: None },
            None if is_same(&new(it.camera), &(half_turn * old(it.camera))) => Cause::UpsideDown,
            None => Cause::Moved { at_s: None, shift_px: it.before_px, turn: it.angle_rad, distance: it.distance },
        }
    };
    moved.iter().map(|it| Culprit { camera: it.camera, cause: cause(it), shares: [0.0, 1.0] }).collect()
}

/// Takes the pose from one camera after the other that agrees least with the rest, until all that remain agree.
fn drop_strangers(room: &mut Room<'_>, rules: &RoomRules) {
    loop {
        room.intersect(OLD_LIMIT * rules.inlier_px);
        let mut counts = vec![(0_usize, 0_usize); room.cameras.len()];
        for moment in room.moments.iter().filter(|it| it.sights.len() >= 2) {
            let known = moment.sights.iter().filter(|it| it.chosen.is_some() && room.cameras[it.camera].is_some());
            if known.clone().count() >= 2 {
                known.for_each(|it| {
                    counts[it.camera].0 += usize::from(it.right);
                    counts[it.camera].1 += 1;
                });
            }
        }
        let share = |it: usize| counts[it].0 as f64 / counts[it].1.max(1) as f64;
        let known = (0..counts.len()).filter(|it| room.cameras[*it].is_some());
        match known.min_by(|a, b| share(*a).total_cmp(&share(*b))) {
            Some(worst) if share(worst) < AGREES => room.cameras[worst] = None,
            _ => return,
        }
    }
}

/// Places cameras without a pose by the points of the others.
fn place_anew(room: &mut Room<'_>, given: &[Camera], status: &mut [CameraStatus], rules: &RoomRules) {
    let random = Random::new(rules.seed).fork("recalibration");
    for camera in 0..given.len() {
        if room.cameras[camera].is_some() || status[camera] != CameraStatus::Calibrated {
            continue;
        }
        let mut pairs: (Vec<Point3<f64>>, Vec<_>) = Default::default();
        for (moment, known) in room.moments.iter().zip(&room.known).filter(|it| !it.1.held_out) {
            let own = moment.sights.iter().find(|it| it.camera == camera);
            let pixel = own.and_then(|it| Some(it.spots[it.chosen?]));
            pairs.extend(known.point.zip(pixel));
        }
        let resection =
            ResectionRules { sigma_px: rules.sigma_px, inlier_px: 2.0 * rules.inlier_px, ..ResectionRules::default() };
        let mut draws = random.fork(&camera.to_string());
        let found = resect(&given[camera], &pairs.0, &pairs.1, &resection, |n| draws.below(n));
        let n_right = found.as_ref().map_or(0, |it| it.right.iter().filter(|it| **it).count());
        match found {
            Ok(found) if 3 * n_right >= pairs.0.len() && n_right >= LEAST_SIGHTINGS => {
                room.cameras[camera] =
                    Some(Camera { camera_from_world: found.camera_from_world, ..given[camera].clone() });
            }
            _ => {
                let common = |other: usize| {
                    let both = room.moments.iter().filter(|it| {
                        let sees = |camera: usize| it.sights.iter().any(|it| it.camera == camera);
                        sees(camera) && sees(other)
                    });
                    both.count()
                };
                let others = (0..given.len()).filter(|it| *it != camera && room.cameras[*it].is_some());
                let best = others.map(|it| (common(it), it)).max().unwrap_or_default();
                status[camera] = CameraStatus::Inconsistent { best: best.1, common: best.0, right: n_right };
            }
        }
    }
}

/// Who stands where the older calibration has it, and what follows for all.
struct Stayed {
    cameras: Vec<usize>,
    given_from_found: Similarity3<f64>,
    /// By camera: how far off its right sightings are under the older calibration, median [px].
    errors_px: Vec<f64>,
}

/// The largest set of cameras under whose older poses the points are seen where they were seen. Each pair of cameras proposes how the
/// room that was found lies in the older one, so that one camera that moved, or several, do not pull at it.
fn who_stayed(room: &Room<'_>, given: &[Camera], sigma_px: f64) -> Stayed {
    let members: Vec<usize> = (0..given.len()).filter(|it| room.cameras[*it].is_some()).collect();
    let found: Vec<Camera> =
        room.cameras.iter().zip(given).map(|(it, given)| it.clone().unwrap_or_else(|| given.clone())).collect();
    let limit = MOVED_SIGMAS * sigma_px.max(LEAST_MOVED_PX);
    let under = |reference: &[usize], every: usize| {
        let given_from_found = onto(&found, given, reference);
        let errors_px = errors_of_older(room, given, &given_from_found, every);
        let cameras = members.iter().copied().filter(|it| errors_px[*it] <= limit).collect();
        Stayed { cameras, given_from_found, errors_px }
    };
    let every = room.moments.len().div_ceil(WITNESSES).max(1);
    let sum = |it: &Stayed| it.cameras.iter().map(|camera| it.errors_px[*camera]).sum::<f64>();
    let better = |one: &Stayed, other: &Stayed| {
        (one.cameras.len(), -sum(one)).partial_cmp(&(other.cameras.len(), -sum(other)))
            == Some(std::cmp::Ordering::Greater)
    };
    // All of them first: where nobody moved, no pair does better.
    let mut best = under(&members, every);
    'pairs: for (index, first) in members.iter().enumerate() {
        for second in &members[index + 1..] {
            if best.cameras.len() == members.len() {
                break 'pairs;
            }
            let proposed = under(&[*first, *second], every);
            if better(&proposed, &best) {
                best = proposed;
            }
        }
    }
    // Those who agree say it together, and better.
    let reference = if best.cameras.len() >= 2 { best.cameras } else { members.clone() };
    under(&reference, 1)
}

/// By camera: how far its right sightings were from the points under the older calibration, median [px].
fn errors_of_older(room: &Room<'_>, given: &[Camera], given_from_found: &Similarity3<f64>, every: usize) -> Vec<f64> {
    let mut errors = vec![Vec::new(); given.len()];
    for (moment, known) in room.moments.iter().zip(&room.known).step_by(every) {
        let Some(point) = known.point.map(|it| given_from_found * it) else { continue };
        for sight in moment.sights.iter().filter(|it| it.right) {
            let seen = given[sight.camera].project(&point).zip(sight.chosen.map(|it| sight.spots[it]));
            errors[sight.camera].extend(seen.map(|(seen, pixel)| (seen - pixel).norm()));
        }
    }
    errors.iter().map(|it| foveate_estimation::statistics::median(it).unwrap_or(0.0)).collect()
}

/// The similarity that takes the `reference` cameras from where they are found to where they were; of two cameras the
/// directions count besides the centres.
fn onto(found: &[Camera], given: &[Camera], reference: &[usize]) -> Similarity3<f64> {
    // Three points that move with a camera: its centre, and one before and one above it, as far away as the cameras are from each other.
    let spread = |cameras: &[Camera]| -> f64 {
        let middle = reference.iter().fold(Vector3::zeros(), |sum, it| sum + cameras[*it].centre().coords);
        let middle = middle / reference.len() as f64;
        reference.iter().map(|it| (cameras[*it].centre().coords - middle).norm()).fold(0.0, f64::max)
    };
    let points = |cameras: &[Camera]| -> Vec<Point3<f64>> {
        let reach = spread(cameras);
        let of_camera = |it: &usize| {
            let camera = &cameras[*it];
            let turn = camera.camera_from_world.rotation.inverse();
            let centre = camera.centre();
            [centre, centre + turn * Vector3::z() * reach, centre + turn * Vector3::y() * reach]
        };
        reference.iter().flat_map(of_camera).collect()
    };
    let rules = AlignmentRules { scale: true, robust: false };
    align(&points(found), &points(given), rules).map_or_else(|_| Similarity3::identity(), |it| it.b_from_a)
}
