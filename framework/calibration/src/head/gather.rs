//! Joins light, picture and head position into the observations from which a head is calibrated.

use foveate_geometry::pan_tilt::HeadObservation;
use nalgebra::{Matrix3, Matrix6, Point2, Point3, Vector3};

use super::rest::{PositionReport, rest_period_at, rest_periods};

/// A sample of the tracked light at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightSample {
    /// Time [s].
    pub time_s: f64,
    /// Number of the track: nothing is interpolated between tracks.
    pub track: u32,
    /// Its place [m].
    pub position: Point3<f64>,
    /// How it moves [m/s].
    pub velocity: Vector3<f64>,
    /// Of (position, velocity) [m², m²/s, m²/s²].
    pub covariance: Matrix6<f64>,
}

/// A picture of the camera on the head with exactly one light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LitFrame {
    /// When the picture was taken [s].
    pub time_s: f64,
    /// Where it is, raw [px].
    pub pixel: Point2<f64>,
    /// Standard deviation of either coordinate [px].
    pub sigma_px: f64,
}

/// The recorded data, each list in the order of its times.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct HeadRecording {
    /// Reported positions of the head.
    pub positions: Vec<PositionReport>,
    /// Pictures with one light.
    pub camera_frames: Vec<LitFrame>,
    /// The light in the room.
    pub light: Vec<LightSample>,
}

/// Options of [`HeadRecording::gather`]: what counts as an observation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GatherOptions {
    /// Reports of the head this close are of one place [rad].
    pub tolerance: f64,
    /// How long after it stopped what it carries still swings [s].
    pub settle_s: f64,
    /// Samples of the light about a picture are at most this far apart [s].
    pub most_apart_s: f64,
    /// A light counts again at one setting when it moved by this much in the picture [px].
    pub step_px: f64,
    /// At most so many count at one setting, the first and last among them [–].
    pub most_a_setting: usize,
}

impl Default for GatherOptions {
    fn default() -> Self {
        Self { tolerance: 1.5e-3, settle_s: 0.4, most_apart_s: 0.05, step_px: 12.0, most_a_setting: 40 }
    }
}

/// The observations, and how many pictures were used or left out.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Gathered {
    /// The observations from which a head is calibrated; settings as the head reported them [rad].
    pub observations: Vec<HeadObservation>,
    /// Different settings among them.
    pub settings: usize,
    /// Pictures with one light.
    pub camera_frames: usize,
    /// Pictures taken while the head moved, or before it had settled.
    pub moving: usize,
    /// Pictures at a time when the light's place is not known.
    pub without_light: usize,
}

impl HeadRecording {
    /// The usable observations of the recording.
    pub fn gather(&self, options: &GatherOptions) -> Gathered {
        let mut gathered = Gathered { camera_frames: self.camera_frames.len(), ..Gathered::default() };
        let stands = rest_periods(&self.positions, options.tolerance, options.settle_s);
        // By setting, in the order of first coming there.
        let mut by_setting: Vec<([f64; 2], Vec<HeadObservation>)> = Vec::new();
        for camera_frame in &self.camera_frames {
            let Some(stand) = rest_period_at(&stands, camera_frame.time_s) else {
                gathered.moving += 1;
                continue;
            };
            let Some((point, covariance)) = self.light_at(camera_frame.time_s, options.most_apart_s) else {
                gathered.without_light += 1;
                continue;
            };
            let near = |it: &[f64; 2]| {
                (it[0] - stand.angles[0]).abs().max((it[1] - stand.angles[1]).abs()) <= options.tolerance
            };
            let place = by_setting.iter().position(|it| near(&it.0)).unwrap_or_else(|| {
                by_setting.push((stand.angles, Vec::new()));
                by_setting.len() - 1
            });
            let (angles, list) = &mut by_setting[place];
            if list.last().is_some_and(|it| (it.pixel - camera_frame.pixel).norm() < options.step_px) {
                continue;
            }
            list.push(HeadObservation {
                pan: angles[0],
                tilt: angles[1],
                point_in_world: point,
                point_covariance: covariance,
                pixel: camera_frame.pixel,
                sigma_px: camera_frame.sigma_px,
            });
        }
        gathered.settings = by_setting.len();
        for (_, list) in by_setting {
            gathered.observations.extend(thinned(list, options.most_a_setting));
        }
        gathered
    }

    /// Where the light was at `time_s`, between two samples of one track: by the cubic through both with their velocities. Its covariance is the mean
    /// of both by nearness, as if they erred alike.
    fn light_at(&self, time_s: f64, most_apart_s: f64) -> Option<(Point3<f64>, Matrix3<f64>)> {
        let next = self.light.partition_point(|it| it.time_s < time_s);
        let after = self.light.get(next)?;
        let position_covariance = |it: &LightSample| it.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        if after.time_s == time_s {
            return Some((after.position, position_covariance(after)));
        }
        let before = &self.light[next.checked_sub(1)?];
        let width = after.time_s - before.time_s;
        if before.track != after.track || width > most_apart_s {
            return None;
        }
        let t = (time_s - before.time_s) / width;
        let s = 1.0 - t;
        let [from, to] = [before.position.coords, after.position.coords];
        let [leaving, arriving] = [before.velocity * width, after.velocity * width];
        let place =
            from * (s * s * (1.0 + 2.0 * t)) + to * (t * t * (1.0 + 2.0 * s)) + (leaving * s - arriving * t) * (s * t);
        Some((Point3::from(place), position_covariance(before) * s + position_covariance(after) * t))
    }
}

/// At most `most` of them, evenly.
fn thinned(list: Vec<HeadObservation>, most: usize) -> Vec<HeadObservation> {
    let n = list.len();
    if n <= most || most < 2 {
        return list;
    }
    (0..most).map(|it| list[it * (n - 1) / (most - 1)].clone()).collect()
}
