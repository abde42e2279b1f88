//! Which pictures show the board, and in which frames.

use std::collections::BTreeMap;

use nalgebra::{Point2, Point3, Vector2};

use super::groups::CameraFrame;
use super::optics::View;
use super::pattern::Board;
use super::plane;
use super::types::{BoardError, BoardOptions};
use crate::recording::Recording;

/// A view whose marks lie off their homography by more than this part of its size is of another board.
const MISFIT: f64 = 0.05;

pub(super) fn check(recording: &Recording, options: &BoardOptions) -> Result<(), BoardError> {
    let above = [
        ("inlier_px", options.inlier_px),
        ("max_focal_sigma", options.max_focal_sigma),
        ("max_corner_px", options.max_corner_px),
    ];
    if let Some((option, found)) = above.into_iter().find(|it| !(it.1.is_finite() && it.1 > 0.0)) {
        return Err(BoardError::BadOption { option, found, expected: "a finite number above 0" });
    }
    let least = [
        ("frame_tolerance_s", options.frame_tolerance_s, 0.0),
        ("min_tilt_rad", options.min_tilt_rad, 0.0),
        ("min_views", options.min_views as f64, 1.0),
        ("min_marks", options.min_marks as f64, 4.0),
    ];
    if let Some((option, found, _)) = least.into_iter().find(|it| !(it.1.is_finite() && it.1 >= it.2)) {
        return Err(BoardError::BadOption { option, found, expected: "at least 0, 1 view and 4 marks" });
    }
    for guess in &recording.cameras {
        guess.camera.check().map_err(|fault| BoardError::BadCamera { camera: guess.name.clone(), fault })?;
    }
    let cameras = recording.cameras.len();
    match recording.camera_frames.iter().enumerate().find(|(_, it)| it.camera >= cameras) {
        Some((camera_frame, it)) => Err(BoardError::NoSuchCamera { camera_frame, camera: it.camera, cameras }),
        None => Ok(()),
    }
}

/// Where it is on the board [m], where it was seen [px], and to how much [px].
type Mark = (Point3<f64>, Point2<f64>, f64);

pub(super) type Gathered = (Vec<CameraFrame>, Vec<View>, usize, usize);

/// The looks that show the board, by frame, with their homographies; unusable spots; views of another board.
pub(super) fn gather(recording: &Recording, board: &Board, options: &BoardOptions) -> Result<Gathered, BoardError> {
    let frames = frames(recording, options.frame_tolerance_s);
    let (mut camera_frames, mut views, mut unusable, mut misfit) = (Vec::new(), Vec::new(), 0, 0);
    for (camera_frame, frame) in recording.camera_frames.iter().zip(frames) {
        let mut marks: BTreeMap<u32, Vec<Mark>> = BTreeMap::new();
        for spot in &camera_frame.spots {
            let fine = spot.pixel.coords.norm().is_finite() && spot.sigma_px.is_finite() && spot.sigma_px > 0.0;
            match spot.label.and_then(|id| Some((id, board.place(id)?))).filter(|_| fine) {
                Some((id, place)) => marks.entry(id).or_default().push((place, spot.pixel, spot.sigma_px)),
                None => unusable += 1,
            }
        }
        // One number twice: nothing tells which is right.
        unusable += marks.values().filter(|it| it.len() > 1).map(Vec::len).sum::<usize>();
        marks.retain(|_, it| it.len() == 1);
        if marks.len() < options.min_marks {
            continue;
        }
        let ids: Vec<u32> = marks.keys().copied().collect();
        let (mut places, mut pixels, mut sigmas) = (Vec::new(), Vec::new(), Vec::new());
        for (place, pixel, sigma) in marks.into_values().flatten() {
            places.push(place);
            pixels.push(pixel);
            sigmas.push(sigma);
        }
        let flat: Vec<Vector2<f64>> = pixels.iter().map(|it| it.coords).collect();
        // Marks on a line make no view, but are no misfit either.
        let Some(homography) = plane::homography(&places, &flat) else { continue };
        if homography.median > MISFIT * homography.extent {
            misfit += 1;
            continue;
        }
        views.push(View { places: places.clone(), pixels: pixels.clone(), sigmas: sigmas.clone(), homography });
        camera_frames.push(CameraFrame {
            camera: camera_frame.camera,
            frame,
            ids,
            places,
            pixels,
            sigmas,
            poses: Vec::new(),
            turn: 0,
        });
    }
    if misfit > views.len() {
        return Err(BoardError::OtherBoard { misfit, views: misfit + views.len(), board: board.name.clone() });
    }
    if views.is_empty() {
        let (camera_frames, needed) = (recording.camera_frames.len(), options.min_marks);
        return Err(BoardError::NoBoardSeen { camera_frames, needed, board: board.name.clone(), unusable });
    }
    Ok((camera_frames, views, unusable, misfit))
}

/// What is known of each usable view, for tests of the optics alone.
#[cfg(test)]
pub(super) fn views_of(recording: &Recording, board: &Board, options: &BoardOptions) -> Vec<View> {
    gather(recording, board, options).map(|it| it.1).unwrap_or_default()
}

/// By look: its frame. A frame begins with a camera frame that is later than `tolerance` after the first of the frame before, or of a camera that
/// this has already.
pub(super) fn frames(recording: &Recording, tolerance: f64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..recording.camera_frames.len()).collect();
    order.sort_by(|a, b| recording.camera_frames[*a].time_s.total_cmp(&recording.camera_frames[*b].time_s));
    let (mut of_frame, mut frame, mut began) = (vec![0; order.len()], 0, f64::NEG_INFINITY);
    let mut cameras: Vec<usize> = Vec::new();
    for at in order {
        let camera_frame = &recording.camera_frames[at];
        if camera_frame.time_s > began + tolerance || cameras.contains(&camera_frame.camera) {
            frame += usize::from(began.is_finite());
            began = camera_frame.time_s;
            cameras.clear();
        }
        cameras.push(camera_frame.camera);
        of_frame[at] = frame;
    }
    of_frame
}
