//! Optics beyond the focal length: freed once the poses are found, and held again where the observations do not determine them.
//!
//! A smaller reprojection error with a further parameter proves nothing. So a prior of any lens enters the adjustment,
//! which keeps a poorly determined optic plausible and no more certain than that ([`crate::bundle::OpticsPrior`]); and
//! observations that were held out must be predicted at least as well.

use foveate_estimation::Loss;

use super::rounds::{LATE_ROUNDS, Room};
use super::status::{HeldReason, OpticHeld};
use crate::bundle::{Freedom, Optic, UnobservableParameters};

/// One right observation in so many of a camera is held out.
const HELD_OUT_EVERY: usize = 5;
/// A camera's observations that are held out say nothing when there are fewer.
const LEAST_KEPT: usize = 8;
/// Optics that are not needed cost some hold-out error, which is no reason to refuse them.
const MAX_HOLD_OUT_LOSS: f64 = 1.05;

/// Factors of the focal lengths and summands of k1 that are free, in the order in which they are tried.
pub(super) fn guesses(free: &[Freedom]) -> Vec<[f64; 2]> {
    let focal: &[f64] = if free.iter().any(|it| it.focal) { &[1.0, 0.8, 1.25] } else { &[1.0] };
    let k1: &[f64] = if free.iter().any(|it| it.k1) { &[0.0, -0.2] } else { &[0.0] };
    k1.iter().flat_map(|k1| focal.iter().map(|focal| [*focal, *k1])).collect()
}

/// What is adjusted while the room comes to stand: without it too few observations fit.
pub(super) fn from_the_start(free: &Freedom) -> Freedom {
    Freedom { focal: free.focal, k1: free.k1, ..Freedom::POSE }
}

/// Frees the optics of a room that stands as far as its observations hold them; by camera, those that stay as given.
pub(super) fn free_what_holds(room: &mut Room<'_>) -> Option<Vec<Vec<OpticHeld>>> {
    let mut held = vec![Vec::new(); room.cameras.len()];
    let asked = |it: &Freedom| Optic::ALL[1..].iter().any(|optic| it.frees(*optic));
    if !room.members().iter().any(|it| asked(&room.tracks.free[*it])) {
        return Some(held);
    }
    let mut free = room.clone();
    free.freed = room.tracks.free.to_vec();
    loop {
        let adjusted = free.adjust(Loss::HUBER, true)?;
        // What pixels hold too little is kept within reason by what is known of any lens, and is no more certain than that.
        let refused = match adjusted.covariance {
            Some(Ok(_)) => Vec::new(),
            Some(Err(open)) => left_open(&free, &open),
            None => Vec::new(),
        };
        if refused.is_empty() {
            break;
        }
        for (camera, it) in refused {
            hold(&mut free, camera, it, &mut held);
        }
    }
    let worse = predicted_worse(&free)?;
    for (camera, reason) in worse {
        for optic in Optic::ALL[1..].iter().filter(|it| free.freed[camera].frees(**it)) {
            held[camera].push(OpticHeld { optic: *optic, reason });
        }
        give_back(&mut free, camera);
    }
    free.adjust_in_rounds(&LATE_ROUNDS)?;
    *room = free;
    Some(held)
}

fn hold(room: &mut Room<'_>, camera: usize, it: OpticHeld, held: &mut [Vec<OpticHeld>]) {
    room.freed[camera] = room.freed[camera].without(it.optic);
    held[camera].push(it);
    restore(room, camera);
}

/// Holds all optics of a camera but its focal length.
fn give_back(room: &mut Room<'_>, camera: usize) {
    room.freed[camera] = Freedom { focal: room.freed[camera].focal, ..Freedom::POSE };
    restore(room, camera);
}

/// Puts what is held of a camera's optics back to what was given.
fn restore(room: &mut Room<'_>, camera: usize) {
    let (freed, given) = (room.freed[camera], &room.tracks.given[camera]);
    let Some(found) = &mut room.cameras[camera] else { return };
    if !freed.aspect {
        found.intrinsics.focal[1] = found.intrinsics.focal[0] * given.intrinsics.focal[1] / given.intrinsics.focal[0];
    }
    if !freed.principal {
        found.intrinsics.principal = given.intrinsics.principal;
    }
    let (own, given) = (&mut found.distortion, &given.distortion);
    for (free, own, given) in [
        (freed.k1, &mut own.k1, given.k1),
        (freed.k2, &mut own.k2, given.k2),
        (freed.k3, &mut own.k3, given.k3),
        (freed.decentering, &mut own.p1, given.p1),
        (freed.decentering, &mut own.p2, given.p2),
    ] {
        if !free {
            *own = given;
        }
    }
}

/// Of each camera with parameters that are open, the optic to hold: an open one, or else the one that is missed least.
fn left_open(room: &Room<'_>, open: &UnobservableParameters) -> Vec<(usize, OpticHeld)> {
    let members = room.members();
    let least = |camera: usize| Optic::ALL[1..].iter().rev().find(|it| room.freed[camera].frees(**it)).copied();
    let mut refused: Vec<(usize, OpticHeld)> = Vec::new();
    for (slot, name) in &open.parameters {
        let camera = members[*slot];
        let named = Optic::named(name).filter(|it| *it != Optic::Focal);
        if refused.iter().all(|it| it.0 != camera)
            && let Some(optic) = named.or_else(|| least(camera))
        {
            refused.push((camera, OpticHeld { optic, reason: HeldReason::Open }));
        }
    }
    if refused.is_empty() {
        // The fault lies with cameras that have nothing more to hold: hold something of the others.
        let more = members.iter().filter_map(|it| Some((*it, least(*it)?)));
        refused.extend(more.map(|(camera, optic)| (camera, OpticHeld { optic, reason: HeldReason::Open })));
    }
    refused
}

/// Cameras whose freed optics predict observations that were held out worse than the given optics do.
fn predicted_worse(room: &Room<'_>) -> Option<Vec<(usize, HeldReason)>> {
    let mut freed = room.clone();
    let mut kept: Vec<usize> = Vec::new();
    let mut turn = vec![0; room.cameras.len()];
    for observations in &room.tracks.of_frame {
        let right: Vec<usize> = observations.iter().copied().filter(|it| room.right[*it]).collect();
        if right.len() < 3 {
            continue; // two observations of a point must remain
        }
        // Cameras take turns, so that a frame loses one observation and each camera its part.
        for index in &right {
            let camera = room.tracks.observations[*index].camera;
            turn[camera] += 1;
            if turn[camera] >= HELD_OUT_EVERY {
                turn[camera] = 0;
                kept.push(*index);
                freed.right[*index] = false;
                break;
            }
        }
    }
    let mut held = freed.clone();
    for camera in room.members() {
        give_back(&mut held, camera);
    }
    freed.adjust(Loss::HUBER, false)?;
    held.adjust(Loss::HUBER, false)?;
    let rms = |room: &Room<'_>, camera: usize| {
        let own = kept.iter().map(|it| &room.tracks.observations[*it]).filter(|it| it.camera == camera);
        let errors: Vec<f64> = own
            .filter_map(|it| Some((room.cameras[camera].as_ref()?, room.points[it.frame]?, it.pixel)))
            .map(|(found, point, pixel)| found.project(&point).map_or(f64::INFINITY, |it| (it - pixel).norm()))
            .map(|it| it.min(4.0 * room.options.inlier_px))
            .collect();
        let squares: f64 = errors.iter().map(|it| it * it).sum();
        (errors.len() >= LEAST_KEPT).then(|| (squares / errors.len() as f64).sqrt())
    };
    let worse = |camera: usize| {
        let [held_px, freed_px] = [rms(&held, camera)?, rms(&freed, camera)?];
        (freed_px > MAX_HOLD_OUT_LOSS * held_px).then_some((camera, HeldReason::HoldOut { held_px, freed_px }))
    };
    Some(room.members().into_iter().filter_map(worse).collect())
}
