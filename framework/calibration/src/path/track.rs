//! Observations of the point by one camera, thinned: a point that stands still for minutes gives one observation.

use foveate_estimation::statistics::median;
use foveate_geometry::Camera;
use nalgebra::{Point2, Vector2};

use crate::network::the_light;
use crate::recording::{CameraFrame, Recording};

/// Steps of the point in the picture that are longer than this many usual ones count as so many: a wrong spot is no motion [–].
const LONGEST_STEP: f64 = 5.0;
/// Spots further apart in time than this say nothing of how the point moves [s].
const LONGEST_PAUSE_S: f64 = 0.5;

/// An observation: when by the camera's clock, and where.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Seen {
    pub time_s: f64,
    pub pixel: Point2<f64>,
    /// Where an ideal camera of focal length 1 would see it.
    pub ideal: Vector2<f64>,
    /// How far the point had moved in the picture until then [px], steps of wrong spots cut.
    pub moved_px: f64,
}

/// Observations of a camera in the order of time.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Track {
    pub seen: Vec<Seen>,
    /// Pictures in which it is ambiguous which spot is the point.
    pub ambiguous: usize,
    /// Median speed of the point in the picture, where it moves [px/s].
    pub speed_px_s: f64,
}

impl Track {
    /// Of a camera, whose optics are those of `camera`. Spots where the lens has no picture are left out.
    pub fn new(recording: &Recording, camera: usize, optics: &Camera) -> Track {
        let camera_frames = recording.camera_frames.iter().filter(|it| it.camera == camera);
        let ambiguous = camera_frames.clone().filter(|it| it.spots.len() > 1 && the_light(&it.spots).is_none()).count();
        let seen = camera_frames.filter_map(|camera_frame: &CameraFrame| {
            let pixel = the_light(&camera_frame.spots)?.pixel;
            Some(Seen { time_s: camera_frame.time_s, pixel, ideal: optics.normalise(&pixel)?, moved_px: 0.0 })
        });
        let mut track = Track { seen: seen.collect(), ambiguous, speed_px_s: 0.0 };
        track.measure();
        track
    }

    /// How far the point has moved by each observation, and how fast it is where it moves.
    fn measure(&mut self) {
        let steps: Vec<(f64, f64)> =
            self.seen.windows(2).map(|it| ((it[1].pixel - it[0].pixel).norm(), it[1].time_s - it[0].time_s)).collect();
        let moving: Vec<f64> = steps.iter().map(|it| it.0).filter(|it| *it > 0.0).collect();
        let cap = LONGEST_STEP * median(&moving).unwrap_or(0.0);
        let mut moved_px = 0.0;
        let (mut speeds, mut half) = (Vec::new(), 0.0);
        for (index, (length, pause_s)) in steps.iter().enumerate() {
            moved_px += length.min(cap);
            self.seen[index + 1].moved_px = moved_px;
            if *pause_s <= LONGEST_PAUSE_S {
                speeds.push((length.min(cap) / pause_s, length.min(cap)));
                half += 0.5 * length.min(cap);
            }
        }
        // Half of the way is gone at less than this speed.
        speeds.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (speed, length) in speeds {
            half -= length;
            self.speed_px_s = speed;
            if half <= 0.0 {
                break;
            }
        }
    }

    /// First and last time [s].
    pub fn span_s(&self) -> [f64; 2] {
        [self.seen.first(), self.seen.last()].map(|it| it.map_or(0.0, |it| it.time_s))
    }

    /// At most `count` observations from one time to another, as far apart along the way of the point as can be.
    pub fn thinned(&self, span_s: [f64; 2], count: usize) -> Vec<Seen> {
        let inside = |it: &&Seen| (span_s[0]..=span_s[1]).contains(&it.time_s);
        let (Some(first), Some(last)) = (self.seen.iter().find(inside), self.seen.iter().rfind(inside)) else {
            return Vec::new();
        };
        let step = ((last.moved_px - first.moved_px) / count.max(1) as f64).max(1e-9);
        let mut kept: Vec<Seen> = Vec::with_capacity(count);
        let mut next = first.moved_px;
        for it in self.seen.iter().filter(inside) {
            if it.moved_px >= next {
                kept.push(*it);
                next = it.moved_px + step;
            }
        }
        kept
    }
}

/// Root mean square distance from the middle, in the ideal picture [–]; wrong spots far off count little.
pub(super) fn spread(seen: &[Seen]) -> f64 {
    let of = |axis: usize| median(&seen.iter().map(|it| it.ideal[axis]).collect::<Vec<_>>()).unwrap_or(0.0);
    let middle = Vector2::new(of(0), of(1));
    sigma_of_middle(&seen.iter().map(|it| (it.ideal - middle).norm()).collect::<Vec<_>>())
}

fn sigma_of_middle(lengths: &[f64]) -> f64 {
    median(lengths).unwrap_or(0.0) * 1.2
}
