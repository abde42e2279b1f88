//! From labelled observations of a wand to a solved camera network of arbitrary scale, and from solved cameras to places of the wand.

use std::collections::BTreeMap;

use foveate_geometry::bundle::Freedom;
use foveate_geometry::bundle::OpticsPrior;
use foveate_geometry::self_calibration::{
    LightObservation, SelfCalibrationError, SelfCalibrationOptions, self_calibrate,
};
use foveate_geometry::{Camera, CameraStatus, PixelNoise, Ray, refine, triangulate_rays};
use nalgebra::{Point2, Point3};

use crate::recording::{CameraGuess, Recording};
use crate::solved::{ObservationRole, Solved, SolvedCamera, SolvedObservation, SolvedPoint, Step};

/// An observation of one end of the wand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WandObservation {
    /// Index of the camera.
    pub camera: usize,
    /// Which frame.
    pub frame: usize,
    /// Time [s].
    pub time_s: f64,
    /// Which end.
    pub end: u32,
    /// Where, raw [px].
    pub pixel: Point2<f64>,
}

/// The labelled spots of a recording; `moment_of_frame` gives the frame of each picture, if any. If a picture shows a label twice,
/// the brightest spot counts.
pub fn observations(recording: &Recording, moment_of_frame: &[Option<usize>]) -> Vec<WandObservation> {
    let mut found = BTreeMap::new();
    for (camera_frame, frame) in recording.camera_frames.iter().zip(moment_of_frame) {
        let Some(frame) = *frame else { continue };
        for spot in &camera_frame.spots {
            let Some(end) = spot.label.filter(|_| spot.pixel.coords.norm().is_finite()) else { continue };
            let (camera, time_s, pixel) = (camera_frame.camera, camera_frame.time_s, spot.pixel);
            let new = (spot.peak, WandObservation { camera, frame, time_s, end, pixel });
            let kept = found.entry((frame, end, camera)).or_insert(new);
            if spot.peak > kept.0 {
                *kept = new;
            }
        }
    }
    found.into_values().map(|it| it.1).collect()
}

/// Calibrates `cameras` from nothing: each end of the wand in each frame is a point of its own.
///
/// # Errors
/// See [`SelfCalibrationError`].
pub fn solve(
    cameras: &[CameraGuess],
    observations: &[WandObservation],
    options: &SelfCalibrationOptions,
) -> Result<Solved, SelfCalibrationError> {
    let mut number_of = BTreeMap::new();
    for it in observations {
        let next = number_of.len();
        number_of.entry((it.frame, it.end)).or_insert(next);
    }
    let as_points = |it: &WandObservation| LightObservation {
        camera: it.camera,
        frame: number_of[&(it.frame, it.end)],
        pixel: it.pixel,
    };
    let given: Vec<Camera> = cameras.iter().map(|it| it.camera.clone()).collect();
    let each: Vec<LightObservation> = observations.iter().map(as_points).collect();
    let free: Vec<Freedom> = cameras.iter().map(|it| it.free).collect();
    let found = self_calibrate(&given, &free, &each, options)?;
    let mut covariance = found.covariance;
    let of_camera = |(index, guess): (usize, &CameraGuess)| SolvedCamera {
        name: guess.name.clone(),
        camera: found.cameras[index].clone(),
        status: found.status[index].clone(),
        freed: found.freed[index],
        prior: Some(OpticsPrior::of_guess(&guess.camera)),
        covariance: covariance[index].take(),
        clock: None,
    };
    let cameras = cameras.iter().enumerate().map(of_camera).collect();
    let (points, place_of) = points_of(observations, |frame, end| found.points[number_of[&(frame, end)]]);
    let of_observation = |(index, it): (usize, &WandObservation)| {
        let solved = found.residuals[index].is_some();
        let role = match (found.right[index], solved) {
            (true, _) => ObservationRole::Used,
            (false, true) => ObservationRole::Rejected,
            (false, false) => ObservationRole::Unsolved,
        };
        SolvedObservation {
            camera: it.camera,
            frame: it.frame,
            point: place_of.get(&(it.frame, it.end)).copied(),
            pixel: it.pixel,
            residual: found.residuals[index],
            role,
        }
    };
    let used = found.right.iter().filter(|it| **it).count();
    Ok(Solved {
        cameras,
        points,
        observations: observations.iter().enumerate().map(of_observation).collect(),
        steps: vec![Step { stage: "from nothing", rms_px: found.rms_px, used }],
        links: found.links,
        ..Solved::default()
    })
}

/// Where cameras that are known see a point best; `None` where their rays fix none.
pub(super) fn intersected(seen: &[(&Camera, Point2<f64>)]) -> Option<Point3<f64>> {
    let (own, pixels): (Vec<&Camera>, Vec<Point2<f64>>) = seen.iter().copied().unzip();
    let rays: Vec<Ray> = own.iter().zip(&pixels).map(|(camera, it)| camera.ray(it)).collect::<Option<_>>()?;
    let start = triangulate_rays(&rays)?;
    Some(refine(&own, &pixels, PixelNoise::Sigma(1.0), start).ok()?.position)
}

/// Intersects the wand with solved cameras in frames that were not used for them: all observations count as held out.
pub fn intersect(cameras: &[SolvedCamera], observations: &[WandObservation]) -> Solved {
    let mut of_point: BTreeMap<(usize, u32), Vec<&WandObservation>> = BTreeMap::new();
    for it in observations {
        if cameras.get(it.camera).is_some_and(|camera| camera.status == CameraStatus::Calibrated) {
            of_point.entry((it.frame, it.end)).or_default().push(it);
        }
    }
    let place = |frame, end| {
        let seen = of_point.get(&(frame, end))?;
        let seen: Vec<(&Camera, Point2<f64>)> = seen.iter().map(|it| (&cameras[it.camera].camera, it.pixel)).collect();
        intersected(&seen)
    };
    let (points, place_of) = points_of(observations, place);
    let of_observation = |it: &WandObservation| {
        let point = place_of.get(&(it.frame, it.end)).copied();
        let camera = cameras.get(it.camera).filter(|it| it.status == CameraStatus::Calibrated);
        let seen = camera.zip(point).and_then(|(camera, at)| camera.camera.project(&points[at].position));
        let role = if seen.is_some() { ObservationRole::HeldOut } else { ObservationRole::Unsolved };
        let residual = seen.map(|seen| seen - it.pixel);
        SolvedObservation { camera: it.camera, frame: it.frame, point, pixel: it.pixel, residual, role }
    };
    let observations = observations.iter().map(of_observation).collect();
    Solved { cameras: cameras.to_vec(), points, observations, ..Solved::default() }
}

/// Points in the order of frames and ends, and the place of each in that list.
fn points_of(
    observations: &[WandObservation],
    place: impl Fn(usize, u32) -> Option<Point3<f64>>,
) -> (Vec<SolvedPoint>, BTreeMap<(usize, u32), usize>) {
    let times: BTreeMap<(usize, u32), f64> = observations.iter().map(|it| ((it.frame, it.end), it.time_s)).collect();
    let (mut points, mut place_of) = (Vec::new(), BTreeMap::new());
    for ((frame, label), time_s) in times {
        if let Some(position) = place(frame, label) {
            place_of.insert((frame, label), points.len());
            points.push(SolvedPoint { frame, time_s, label, position });
        }
    }
    (points, place_of)
}
