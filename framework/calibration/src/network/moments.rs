//! Observations by light and by moment.

use foveate_geometry::LightObservation;
use nalgebra::Point2;

use super::cleaning::the_light;
use crate::clocks::{FrameOptions, Frames, frames};
use crate::recording::{CameraFrame, Recording};
use crate::solved::ClockFit;
use crate::wand::WandObservation;

/// What one camera saw of a light at one moment.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct View {
    pub camera: usize,
    /// The spots, one of which may be the light.
    pub spots: Vec<Point2<f64>>,
    /// The one taken for the light.
    pub chosen: Option<usize>,
    /// Whether that is right, as things stand.
    pub right: bool,
}

/// What was seen of one light at one moment.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Moment {
    /// Its number; the ends of a wand share it.
    pub frame: usize,
    pub time_s: f64,
    /// Which light.
    pub label: u32,
    /// Each camera once at most.
    pub views: Vec<View>,
}

/// Pictures are of one moment when their times differ by less than this part of the shortest period of any camera [–].
const SAME_MOMENT: f64 = 0.1;

/// Moments of a recording of one light by cameras that share a clock. Where their pictures are not taken together, where the light was
/// between two pictures of a camera counts as seen.
pub(super) fn of_light(recording: &Recording) -> Vec<Moment> {
    if are_triggered_together(recording) {
        return of_pictures(recording);
    }
    let same = ClockFit { offset_s: 0.0, drift: 0.0, sigma_s: 0.0, pairs: 0 };
    of_frames(&frames(recording, &vec![Some(same); recording.cameras.len()], &FrameOptions::default()))
}

/// Whether cameras take their pictures together: of those that others take within half a period of its own, most of each camera's are of the same
/// moment, as far as it has as many as [`FEW_PICTURES`]. By chance a fifth would be. Looks are in order.
pub(super) fn are_triggered_together(recording: &Recording) -> bool {
    let (camera_frames, tolerance) = (&recording.camera_frames, tolerance_s(recording));
    let half_period = 1.05 * 0.5 * shortest_period(recording);
    let mut counts = vec![(0_usize, 0_usize); recording.cameras.len()];
    for (index, camera_frame) in camera_frames.iter().enumerate() {
        let after = camera_frames[index + 1..].iter().take_while(|it| it.time_s - camera_frame.time_s <= half_period);
        for other in after.filter(|it| it.camera != camera_frame.camera) {
            for camera in [camera_frame.camera, other.camera] {
                counts[camera].0 += usize::from(other.time_s - camera_frame.time_s <= tolerance);
                counts[camera].1 += 1;
            }
        }
    }
    let all = counts.iter().fold((0, 0), |sum, it| (sum.0 + it.0, sum.1 + it.1));
    // Pairs with a camera that is off count for the others too, so one that is off alone never shares a moment.
    2 * all.0 >= all.1 && counts.iter().all(|it| it.1 < FEW_PICTURES || 10 * it.0 >= 3 * it.1)
}

/// Fewer pictures beside others' do not tell of a camera whether it is triggered together with them [–].
const FEW_PICTURES: usize = 20;

/// Moments at which pictures were taken together; looks are in order. Pictures without spots are left out.
pub(super) fn of_pictures(recording: &Recording) -> Vec<Moment> {
    let tolerance = tolerance_s(recording);
    let mut starts_s: Vec<f64> = Vec::new();
    let mut moments: Vec<Moment> = Vec::new();
    for camera_frame in recording.camera_frames.iter().filter(|it| !it.spots.is_empty()) {
        let light = the_light(&camera_frame.spots);
        let chosen = light.and_then(|light| camera_frame.spots.iter().position(|it| std::ptr::eq(it, light)));
        let spots = camera_frame.spots.iter().map(|it| it.pixel).collect();
        let view = View { camera: camera_frame.camera, spots, chosen, right: false };
        let joins = |moment: &&mut Moment| {
            camera_frame.time_s - starts_s[moment.frame] <= tolerance
                && moment.views.iter().all(|it| it.camera != camera_frame.camera)
        };
        match moments.last_mut().filter(joins) {
            Some(moment) => {
                let n = moment.views.len() as f64;
                moment.time_s = (moment.time_s * n + camera_frame.time_s) / (n + 1.0);
                moment.views.push(view);
            }
            None => {
                moments.push(Moment { frame: moments.len(), time_s: camera_frame.time_s, label: 0, views: vec![view] });
                starts_s.push(camera_frame.time_s);
            }
        }
    }
    moments
}

/// Pictures of one moment are at most this far apart [s].
pub(super) fn tolerance_s(recording: &Recording) -> f64 {
    let period_s = shortest_period(recording);
    // Two stamps of one moment that lie on either side of where they are rounded.
    let rounding_s = 1.001 * stamp_step_s(recording);
    let tolerance_s = if rounding_s <= MOST_ROUNDING * period_s { rounding_s } else { 0.0 };
    (SAME_MOMENT * period_s).max(tolerance_s)
}

/// Stamps rounded to a larger part of the period do not say which pictures are of one moment [–].
const MOST_ROUNDING: f64 = 0.2;

/// What stamps are rounded to: milliseconds, or nothing that is known [s].
fn stamp_step_s(recording: &Recording) -> f64 {
    const STEP_S: f64 = 1e-3;
    // Times of day in seconds have seven digits after the point.
    let is_rounded = |it: &CameraFrame| (it.time_s / STEP_S - (it.time_s / STEP_S).round()).abs() < 1e-3;
    if recording.camera_frames.iter().all(is_rounded) { STEP_S } else { 0.0 }
}

/// The least of the cameras' periods [s]; 0 when no camera looked twice. Cameras may have left pictures without a light unsaid, so that most of
/// their gaps are several periods: a tenth of them is not.
fn shortest_period(recording: &Recording) -> f64 {
    let periods = (0..recording.cameras.len()).filter_map(|camera| {
        let own = recording.camera_frames.iter().filter(|it| it.camera == camera);
        let times: Vec<f64> = own.map(|it: &CameraFrame| it.time_s).collect();
        let mut gaps: Vec<f64> = times.windows(2).map(|it| it[1] - it[0]).filter(|it| *it > 0.0).collect();
        gaps.sort_by(f64::total_cmp);
        gaps.get(gaps.len() / 10).copied()
    });
    let shortest = periods.fold(f64::INFINITY, f64::min);
    if shortest.is_finite() { shortest } else { 0.0 }
}

/// A spot that is certainly meant.
fn certain(camera: usize, pixel: Point2<f64>) -> View {
    View { camera, spots: vec![pixel], chosen: Some(0), right: false }
}

/// Moments of the ends of a wand: a light each.
pub(super) fn of_wand(observations: &[WandObservation]) -> Vec<Moment> {
    let mut sorted: Vec<&WandObservation> = observations.iter().collect();
    sorted.sort_by_key(|it| (it.frame, it.end, it.camera));
    let of_one = sorted.chunk_by(|a, b| (a.frame, a.end) == (b.frame, b.end));
    let moment = |seen: &[&WandObservation]| Moment {
        frame: seen[0].frame,
        time_s: seen.iter().map(|it| it.time_s).sum::<f64>() / seen.len() as f64,
        label: seen[0].end,
        views: seen.iter().map(|it| certain(it.camera, it.pixel)).collect(),
    };
    of_one.map(moment).collect()
}

/// Moments of one light by cameras whose clocks were found.
pub(super) fn of_frames(frames: &Frames) -> Vec<Moment> {
    let of_one = frames.observations.chunk_by(|a, b| a.frame == b.frame);
    let moment = |seen: &[LightObservation]| Moment {
        frame: seen[0].frame,
        time_s: frames.times_s[seen[0].frame],
        label: 0,
        views: seen.iter().map(|it| certain(it.camera, it.pixel)).collect(),
    };
    of_one.map(moment).collect()
}
