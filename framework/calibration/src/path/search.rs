//! Searches pose and clock offset of a camera when neither is known: over all possible offsets of a recording.
//!
//! For offsets a step apart, poses of three observations each, drawn at random, are tried on the others (RANSAC, in the ideal picture of
//! focal length 1, where a trial costs little). The step is such that the point hardly moves in it. Clocks that run up to
//! [`FASTEST_DRIFT`] apart stay within a step over a window of the camera's recording; several windows are searched, and what is found
//! in one is judged on all of it.

use foveate_estimation::Random;
use foveate_geometry::Camera;
use foveate_geometry::resection::three_points;
use nalgebra::{Isometry3, Point3, Unit, Vector2};

use super::measured::MeasuredPath;
use super::track::{Seen, Track, spread};

/// Clocks that are further apart are not found [–]: nominal rates of 30 for 29.97 Hz are 1e-3.
pub(super) const FASTEST_DRIFT: f64 = 2e-3;
/// A right observation is at most this part of the spread of all of them off, while clocks are known to a step [–].
const NEAR: f64 = 0.05;
/// And at most so much, with a wide lens [–].
const NEAR_AT_MOST: f64 = 0.02;
/// Observations of a window that are looked at [–].
const SAMPLES: usize = 90;
/// Fewer tell nothing [–].
const LEAST_SAMPLES: usize = 15;
/// Windows of a recording, at most [–].
const MOST_WINDOWS: usize = 24;
/// Offsets of a window, at most [–].
const MOST_STEPS: usize = 20_000;
/// Triples for each offset: with half of the observations wrong, two in 100 offsets go without a right one, and windows are several [–].
const TRIALS: usize = 30;
/// For offsets that were found to be good [–].
const MORE_TRIALS: usize = 300;
/// Offsets that are looked at again, for each window [–].
const KEPT: usize = 8;

/// A pose and a clock that may be the camera's.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Candidate {
    /// With the pose, and with the focal length that was tried.
    pub camera: Camera,
    /// The middle of its window, by the camera's clock [s].
    pub middle_s: f64,
    /// What the path's clock shows then, to a step [s].
    pub path_s: f64,
    /// The window it was found in, by the camera's clock [s].
    pub window_s: [f64; 2],
    /// Observations that agree, each counted the less the further it is off.
    pub gain: f64,
    /// Limit of a right observation then [–].
    pub near: f64,
    /// The step between offsets [s].
    pub step_s: f64,
}

/// Candidates of all windows, the best first; each offset once.
pub(super) fn search(track: &Track, path: &MeasuredPath, camera: &Camera, random: &mut Random) -> Vec<Candidate> {
    let focal = 0.5 * (camera.intrinsics.focal[0] + camera.intrinsics.focal[1]);
    let [from_s, until_s] = track.span_s();
    let near = (NEAR * spread(&track.thinned([from_s, until_s], 4 * SAMPLES))).min(NEAR_AT_MOST);
    if track.seen.len() < LEAST_SAMPLES || near.is_nan() || near <= 0.0 || track.speed_px_s <= 0.0 {
        return Vec::new();
    }
    let [path_from_s, path_until_s] = path.span_s();
    let path_length_s = path_until_s - path_from_s;
    let mut step_s = near * focal / track.speed_px_s;
    let window_s = (step_s / FASTEST_DRIFT).min(path_length_s).min(until_s - from_s);
    step_s = step_s.max((path_length_s + window_s) / MOST_STEPS as f64);
    // Each reaches into its neighbour, so that no part of the path falls between two.
    let wanted = if until_s - from_s <= window_s { 1.0 } else { 2.0 * (until_s - from_s) / window_s };
    let windows = (wanted.ceil() as usize).clamp(1, MOST_WINDOWS);
    let mut found: Vec<Candidate> = Vec::new();
    for window in 0..windows {
        let share = if windows == 1 { 0.5 } else { window as f64 / (windows - 1) as f64 };
        let middle_s = from_s + 0.5 * window_s + share * (until_s - from_s - window_s);
        let span_s = [middle_s - 0.5 * window_s, middle_s + 0.5 * window_s];
        let seen = track.thinned(span_s, SAMPLES);
        let offsets = Offsets { seen: &seen, path, middle_s, near: near.min(NEAR * spread(&seen)), step_s };
        found.extend(offsets.search(camera, span_s, random));
    }
    found.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    found
}

/// One window against the path.
struct Offsets<'a> {
    seen: &'a [Seen],
    path: &'a MeasuredPath,
    middle_s: f64,
    near: f64,
    step_s: f64,
}

impl Offsets<'_> {
    fn search(&self, camera: &Camera, window_s: [f64; 2], random: &mut Random) -> Vec<Candidate> {
        if self.seen.len() < LEAST_SAMPLES || self.near <= 0.0 {
            return Vec::new();
        }
        let [path_from_s, path_until_s] = self.path.span_s();
        let half_s = 0.5 * (window_s[1] - window_s[0]);
        let (first, last) = (path_from_s - 0.7 * half_s, path_until_s + 0.7 * half_s);
        let steps = ((last - first) / self.step_s).ceil() as usize;
        let path_at = |step: usize| first + step as f64 * self.step_s;
        let gains: Vec<f64> =
            (0..=steps).map(|it| self.best_pose(path_at(it), TRIALS, random).map_or(0.0, |it| it.0)).collect();
        // The best of their neighbourhood, the best ones first.
        let is_peak = |at: &usize| {
            let around = at.saturating_sub(1)..=(at + 1).min(steps);
            gains[*at] > 0.0 && around.into_iter().all(|it| gains[it] < gains[*at] || it == *at)
        };
        let mut peaks: Vec<usize> = (0..=steps).filter(is_peak).collect();
        peaks.sort_by(|a, b| gains[*b].total_cmp(&gains[*a]));
        let candidates = peaks.into_iter().take(KEPT).filter_map(|at| {
            let (gain, path_s, pose) = [-0.5, 0.0, 0.5]
                .into_iter()
                .filter_map(|shift| {
                    let path_s = path_at(at) + shift * self.step_s;
                    self.best_pose(path_s, MORE_TRIALS, random).map(|(gain, pose)| (gain, path_s, pose))
                })
                .max_by(|a, b| a.0.total_cmp(&b.0))?;
            Some(Candidate {
                camera: Camera { camera_from_world: pose, ..camera.clone() },
                middle_s: self.middle_s,
                path_s,
                window_s,
                gain,
                near: self.near,
                step_s: self.step_s,
            })
        });
        candidates.collect()
    }

    /// The best of the poses of `trials` triples if the path's clock shows `path_s` in the middle of the window.
    fn best_pose(&self, path_s: f64, trials: usize, random: &mut Random) -> Option<(f64, Isometry3<f64>)> {
        let at = |it: &Seen| {
            let time_s = it.time_s - self.middle_s + path_s;
            self.path.covers(time_s).then(|| (self.path.at(time_s).0, it.ideal))
        };
        let pairs: Vec<(Point3<f64>, Vector2<f64>)> = self.seen.iter().filter_map(at).collect();
        if pairs.len() < LEAST_SAMPLES {
            return None;
        }
        let mut best: Option<(f64, Isometry3<f64>)> = None;
        for _ in 0..trials {
            let drawn = [(); 3].map(|()| &pairs[random.below(pairs.len() as u32) as usize]);
            let directions = drawn.map(|it| Unit::new_normalize(it.1.push(1.0)));
            for pose in three_points::poses(&drawn.map(|it| it.0), &directions) {
                let least = best.as_ref().map_or(0.0, |it| it.0);
                if let Some(gain) = self.gain(&pose, &pairs, least) {
                    best = Some((gain, pose));
                }
            }
        }
        best
    }

    /// Σ (1 − e²/near²) of the observations that are nearer than that; `None` where it does not come above `least`.
    fn gain(&self, pose: &Isometry3<f64>, pairs: &[(Point3<f64>, Vector2<f64>)], least: f64) -> Option<f64> {
        let (rotation, shift) = (pose.rotation.to_rotation_matrix(), pose.translation.vector);
        let per_square = 1.0 / (self.near * self.near);
        let (mut gain, mut left) = (0.0, pairs.len() as f64);
        for (point, ideal) in pairs {
            left -= 1.0;
            let in_camera = rotation * point.coords + shift;
            if in_camera.z > 0.0 {
                let error = in_camera.xy() / in_camera.z - ideal;
                gain += (1.0 - error.norm_squared() * per_square).max(0.0);
            }
            if gain + left <= least {
                return None;
            }
        }
        (gain > least).then_some(gain)
    }
}
