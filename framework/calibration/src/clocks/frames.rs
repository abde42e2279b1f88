//! Common moments of cameras with clocks of their own, and each camera's observation at them.

use foveate_geometry::self_calibration::LightObservation;
use nalgebra::Vector2;

use super::track::{Track, brightest};
use crate::recording::Recording;
use crate::solved::ClockFit;

/// Options of [`frames`]: how common moments are chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameOptions {
    /// A picture taken this close to the moment is taken as it is, without interpolation [s].
    pub coincide_s: f64,
    /// Between observations further apart, where the light was is not known; one and a half periods of a camera that is slower than this [s].
    pub max_gap_s: f64,
    /// Of more moments than this, some are left out at equal steps [–].
    pub max_frames: usize,
}

impl Default for FrameOptions {
    fn default() -> Self {
        Self { coincide_s: 0.5e-3, max_gap_s: 0.1, max_frames: usize::MAX }
    }
}

/// Common moments in the network's time, and the observations of one light at them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Frames {
    /// By frame, ascending: the room's time [s].
    pub times_s: Vec<f64>,
    /// In the order of frames and within a frame of cameras: at most one a camera.
    pub observations: Vec<LightObservation>,
    /// By observation: how fast the pixel moves [px/s]; `None` where its neighbours lie on no smooth path, which none but a picture
    /// that was taken as it is can be.
    pub velocities: Vec<Option<Vector2<f64>>>,
    /// By observation: the standard deviation of either coordinate, enlarged for observations that several frames share [px].
    pub sigmas_px: Vec<f64>,
    /// By observation: the picture's place in the recording; `None` for a place between pictures.
    pub camera_frames: Vec<Option<usize>>,
}

/// Frames of a recording under known clocks; cameras without one (`None`) are left out. With clocks that agree, moments are those of the pictures
/// and nothing is interpolated, or left out for not being smooth. Of several spots in a picture the brightest is taken.
pub fn frames(recording: &Recording, clocks: &[Option<ClockFit>], options: &FrameOptions) -> Frames {
    let all = brightest(recording);
    let smooth: Vec<Track> = all.iter().map(|it| it.smooth(options.max_gap_s)).collect();
    let clocks: Vec<Option<Clock>> = clocks.iter().map(|it| it.as_ref().map(Clock::of)).collect();
    let times_s = moments(&all, &clocks, options.max_frames);
    at_moments(&all, &smooth, &clocks, times_s, options)
}

/// Room time = `offset_s` + `rate` · camera time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Clock {
    pub offset_s: f64,
    pub rate: f64,
}

impl Clock {
    pub(super) const SAME: Clock = Clock { offset_s: 0.0, rate: 1.0 };

    pub(super) fn of(fit: &ClockFit) -> Clock {
        Clock { offset_s: fit.offset_s, rate: 1.0 + fit.drift }
    }

    pub(super) fn room_s(&self, own_s: f64) -> f64 {
        self.offset_s + self.rate * own_s
    }

    pub(super) fn own_s(&self, room_s: f64) -> f64 {
        (room_s - self.offset_s) / self.rate
    }
}

/// Moments of the pictures of the camera with most of them, then those of the next in its gaps, and so on.
pub(super) fn moments(tracks: &[Track], clocks: &[Option<Clock>], max_frames: usize) -> Vec<f64> {
    let mut order: Vec<usize> = (0..tracks.len()).filter(|it| clocks.get(*it).copied().flatten().is_some()).collect();
    order.sort_by_key(|it| (std::cmp::Reverse(tracks[*it].samples.len()), *it));
    let mut times: Vec<f64> = Vec::new();
    for camera in order {
        let Some(clock) = clocks[camera] else { continue };
        // Between two moments, no picture is further than half a period from the nearer one.
        let apart = 0.75 * tracks[camera].period_s;
        let alone = |time: &f64| {
            let next = times.partition_point(|it| it < time);
            let near = |it: Option<&f64>| it.is_some_and(|it| (it - time).abs() < apart);
            !near(times.get(next)) && !near(next.checked_sub(1).and_then(|it| times.get(it)))
        };
        let own = tracks[camera].samples.iter().map(|it| clock.room_s(it.time_s));
        let new: Vec<f64> = own.filter(alone).collect();
        times.extend(new);
        times.sort_by(f64::total_cmp);
    }
    let n = times.len();
    if n > max_frames.max(1) {
        let kept = max_frames.max(1);
        times = (0..kept).map(|it| times[it * n / kept]).collect();
    }
    times
}

/// What was seen at `times_s`, which are ascending.
pub(super) fn at_moments(
    all: &[Track],
    smooth: &[Track],
    clocks: &[Option<Clock>],
    times_s: Vec<f64>,
    options: &FrameOptions,
) -> Frames {
    let mut steps: Vec<f64> = times_s.windows(2).map(|it| it[1] - it[0]).collect();
    steps.sort_by(f64::total_cmp);
    let step = steps.get(steps.len() / 2).copied().unwrap_or(f64::INFINITY);
    let mut frames = Frames::default();
    for (frame, time) in times_s.iter().enumerate() {
        for (camera, clock) in clocks.iter().enumerate() {
            let Some(clock) = clock else { continue };
            let own = clock.own_s(*time);
            let between = || smooth[camera].at(own, options.max_gap_s);
            let samples = &all[camera].samples;
            let next = samples.partition_point(|it| it.time_s < own);
            let beside = [next.checked_sub(1), Some(next)].into_iter().flatten().filter_map(|it| samples.get(it));
            let nearest = beside.min_by(|a, b| (a.time_s - own).abs().total_cmp(&(b.time_s - own).abs()));
            let (pixel, velocity, sigma_px, camera_frame) = match nearest {
                Some(it) if (it.time_s - own).abs() <= options.coincide_s => {
                    let kept =
                        smooth[camera].samples.binary_search_by(|other| other.time_s.total_cmp(&it.time_s)).is_ok();
                    (it.pixel, between().filter(|_| kept).map(|it| it.velocity), it.sigma_px, Some(it.camera_frame))
                }
                _ => match between() {
                    // Frames denser than pictures share them: together they must not weigh more than the pictures do.
                    Some(it) => {
                        // Between samples noise is less, but neighbouring frames share it: over all frames each sample counts once.
                        let sigma = it.sigma_px.max(samples[next.min(samples.len() - 1)].sigma_px);
                        (it.pixel, Some(it.velocity), sigma * (all[camera].period_s / step).max(1.0).sqrt(), None)
                    }
                    None => continue,
                },
            };
            frames.observations.push(LightObservation { camera, frame, pixel });
            frames.velocities.push(velocity);
            frames.sigmas_px.push(sigma_px);
            frames.camera_frames.push(camera_frame);
        }
    }
    frames.times_s = times_s;
    frames
}
