//! A board shown to cameras that share no clock.
//!
//! The paths of its outermost marks and of the one in its middle give the clocks; of a board that looks the same when it is turned, that of
//! its middle, which every picture tells whichever way round it was read. Each mark is then followed between the pictures of a camera,
//! to moments that all share.

use std::collections::{BTreeMap, BTreeSet};

use foveate_geometry::bundle::Freedom;
use nalgebra::{Point2, Point3, Vector2};

use super::optics::{self, View};
use super::pattern::Board;
use super::plane;
use super::types::{BoardError, BoardOptions};
use super::views::{check, frames, gather};
use crate::clocks::{ClockError, ClockOptions, FrameOptions, in_turn, on_one_clock, synchronise};
use crate::network::OneClock;
use crate::recording::{CameraFrame, Recording, Spot};

/// Marks around its middle that tell where that is; over more of them distortion bends the board [–].
const AROUND: usize = 16;
/// The label of the middle of a board that may have been read either way round.
const MIDDLE: u32 = 0;

/// Why the clocks of unsynchronised cameras that saw a board could not be found.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BoardClocksError {
    /// The board cannot be calibrated with, whatever the clocks.
    #[error(transparent)]
    Board(#[from] BoardError),
    /// The clocks cannot be found.
    #[error(transparent)]
    Clocks(#[from] ClockError),
}

/// The recording of a moving board at moments that all cameras share. Clocks of constant offset only: [`ClockOptions::max_drift`] is taken as 0.
///
/// # Errors
/// See [`BoardClocksError`].
pub fn board_on_one_clock(
    recording: &Recording,
    board: &Board,
    options: &BoardOptions,
    clock_options: &ClockOptions,
) -> Result<OneClock, BoardClocksError> {
    check(recording, options)?;
    let clock_options = ClockOptions { max_drift: 0.0, ..*clock_options };
    let found = synchronise(&paths(recording, board, options, &clock_options)?, &clock_options)?;
    let frame_options = FrameOptions { max_gap_s: clock_options.max_gap_s, ..FrameOptions::default() };
    let recording = on_one_clock(recording, &found.clocks, &frame_options);
    let shared = OneClock { recording, clocks: found.clocks, status: found.status, reference: found.reference };
    Ok(shared.if_several()?)
}

/// The paths that the clocks are found from as that of one light, by cameras with the optics that their own views tell.
fn paths(
    recording: &Recording,
    board: &Board,
    options: &BoardOptions,
    clock_options: &ClockOptions,
) -> Result<Recording, BoardError> {
    let (camera_frames, views, ..) = gather(recording, board, options)?;
    let mut cameras = recording.cameras.clone();
    for (camera, guess) in cameras.iter_mut().enumerate() {
        let own: Vec<&View> =
            camera_frames.iter().zip(&views).filter(|it| it.0.camera == camera).map(|it| it.1).collect();
        let fit = optics::fit(&guess.camera, guess.free, &own, options);
        // A focal length that its views do not hold may still be found with the others.
        guess.free = Freedom { focal: guess.free.focal && !fit.freed.focal, ..Freedom::POSE };
        guess.camera = fit.camera;
    }
    let corners =
        board.marks().fold([f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY], |it, mark| {
            [it[0].min(mark.1.x), it[1].max(mark.1.x), it[2].min(mark.1.y), it[3].max(mark.1.y)]
        });
    let middle = Point3::new(0.5 * (corners[0] + corners[1]), 0.5 * (corners[2] + corners[3]), 0.0);
    let is_turned = board.turns().len() > 1;
    let ends = [0, 1].map(|x| [2, 3].map(|y| board.nearest(&Point3::new(corners[x], corners[y], 0.0))));
    let marks: BTreeSet<u32> = ends.into_iter().flatten().chain([board.nearest(&middle)]).collect();
    let labels: Vec<u32> = if is_turned { vec![MIDDLE] } else { marks.into_iter().collect() };
    let mut seen: BTreeMap<(usize, usize), Vec<Spot>> = BTreeMap::new();
    for (camera_frame, view) in camera_frames.iter().zip(&views) {
        let spot = |(id, at): (&u32, usize)| Spot {
            pixel: camera_frame.pixels[at],
            sigma_px: camera_frame.sigmas[at],
            peak: 1.0,
            label: Some(*id),
        };
        let spots = match is_turned {
            true => picture_of(&middle, view).into_iter().collect(),
            false => camera_frame.ids.iter().zip(0..).filter(|it| labels.contains(it.0)).map(spot).collect(),
        };
        seen.insert((camera_frame.frame, camera_frame.camera), spots);
    }
    let of_frame = frames(recording, options.frame_tolerance_s);
    let camera_frame = |(it, frame): (&CameraFrame, usize)| {
        let spots = seen.remove(&(frame, it.camera)).unwrap_or_default();
        CameraFrame { camera: it.camera, time_s: it.time_s, spots }
    };
    let recording =
        Recording { cameras, camera_frames: recording.camera_frames.iter().zip(of_frame).map(camera_frame).collect() };
    Ok(in_turn(&recording, &labels, clock_options.max_offset_s))
}

/// Where the `middle` of the board is in a view, by the marks next to it; `None` where it is beyond the marks that are seen.
fn picture_of(middle: &Point3<f64>, view: &View) -> Option<Spot> {
    let beyond = |of: fn(&Point3<f64>) -> f64| {
        let least = view.places.iter().map(of).fold(f64::INFINITY, f64::min);
        let most = view.places.iter().map(of).fold(f64::NEG_INFINITY, f64::max);
        !(least..=most).contains(&of(middle))
    };
    if beyond(|it| it.x) || beyond(|it| it.y) {
        return None;
    }
    let mut order: Vec<usize> = (0..view.places.len()).collect();
    let off = |it: &usize| (view.places[*it] - middle).norm();
    order.sort_by(|a, b| off(a).total_cmp(&off(b)));
    order.truncate(AROUND);
    let places: Vec<Point3<f64>> = order.iter().map(|it| view.places[*it]).collect();
    let pixels: Vec<Vector2<f64>> = order.iter().map(|it| view.pixels[*it].coords).collect();
    let local = plane::homography(&places, &pixels).map_or(view.homography.image_from_plane, |it| it.image_from_plane);
    let seen = local * Vector2::new(middle.x, middle.y).push(1.0);
    let sigma_px = order.iter().map(|it| view.sigmas[*it]).fold(0.0, f64::max);
    let pixel = Point2::new(seen.x / seen.z, seen.y / seen.z);
    pixel.coords.norm().is_finite().then_some(Spot { pixel, sigma_px, peak: 1.0, label: Some(MIDDLE) })
}
