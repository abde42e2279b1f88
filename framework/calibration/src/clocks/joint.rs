//! Joint estimation of clocks, poses and path: frames by the clocks so far, a network from them, its adjustment with clocks free, then frames again.

use foveate_estimation::Loss;
use foveate_geometry::bundle::{
    AdjustedWithClocks, BundleOptions, ClockFreedom, ClockGauge, Freedom, Observation, Timing, adjust_with_clocks,
};
use foveate_geometry::self_calibration::{
    CameraStatus, SelfCalibration, SelfCalibrationError, SelfCalibrationOptions, self_calibrate,
};
use foveate_geometry::{Camera, Ray, triangulate_rays};
use nalgebra::{Point3, Vector2};

use super::frames::{Clock, FrameOptions, Frames, at_moments, moments};
use super::track::Track;
use super::{ClockError, ClockOptions};
use crate::recording::Recording;
use crate::stretches::stretches;

/// Rounds of solving the network again, at most.
const ROOMS: usize = 4;
/// Adjustments of one room at most.
const ROUNDS: usize = 12;
/// Clocks that moved further since the room was made may have cost it observations [s].
const ANEW_S: f64 = 2e-3;
/// Least observations of a clock.
const LEAST: usize = 20;

/// A clock after all cameras were taken together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Refined {
    pub clock: Clock,
    /// Of what it shows in the middle of the recording, as residuals tell [s].
    pub sigma_s: f64,
    /// Observations that hold it.
    pub views: usize,
}

/// The outcome.
pub(super) struct Joint {
    /// By camera; `None` where there is no pose.
    pub clocks: Vec<Option<Refined>>,
    pub status: Vec<CameraStatus>,
    pub cameras: Vec<Camera>,
    /// Root of the mean squared length of the residuals in use [px].
    pub rms_px: f64,
    /// What the last round still moved a clock by [s].
    pub last_move_s: f64,
}

/// A room under way.
struct Room<'a> {
    recording: &'a Recording,
    smooth: &'a [Track],
    options: &'a ClockOptions,
    reference: usize,
    clocks: Vec<Option<Clock>>,
    cameras: Vec<Camera>,
    freedoms: Vec<Freedom>,
    points: Vec<Option<Point3<f64>>>,
    frames: Frames,
}

pub(super) fn refine(
    recording: &Recording,
    smooth: &[Track],
    start: Vec<Option<Clock>>,
    reference: usize,
    options: &ClockOptions,
) -> Result<Joint, ClockError> {
    let mut network = Room {
        recording,
        smooth,
        options,
        reference,
        clocks: start,
        cameras: recording.cameras.iter().map(|it| it.camera.clone()).collect(),
        freedoms: Vec::new(),
        points: Vec::new(),
        frames: Frames::default(),
    };
    let mut round = 0;
    loop {
        round += 1;
        let made = network.make()?;
        let before = network.clocks.clone();
        let (found, last_move_s) = network.settle(&made.status)?;
        let middle = network.middle_s();
        let moved = network.moved(&before, middle);
        if moved < ANEW_S || round == ROOMS {
            return Ok(network.finish(made.status, &found, last_move_s));
        }
    }
}

impl Room<'_> {
    fn frame_options(&self) -> FrameOptions {
        // Only the camera that sets the moments is taken as it is: what the others show has to move with their clocks.
        FrameOptions { coincide_s: 1e-9, max_gap_s: self.options.max_gap_s, max_frames: self.options.max_frames }
    }

    /// Frames under the clocks so far, and a room from them alone.
    fn make(&mut self) -> Result<SelfCalibration, ClockError> {
        let options = self.frame_options();
        let times = moments(self.smooth, &self.clocks, options.max_frames);
        self.frames = at_moments(self.smooth, self.smooth, &self.clocks, times, &options);
        let guesses = &self.recording.cameras;
        let given: Vec<Camera> = guesses.iter().map(|it| it.camera.clone()).collect();
        let self_options = SelfCalibrationOptions {
            sigma_px: self.options.sigma_px,
            // Clocks that are still a little off cost observations, those of fast motion first.
            inlier_px: 1.5 * self.options.inlier_px,
            seed: self.options.seed,
            ..SelfCalibrationOptions::default()
        };
        let free: Vec<Freedom> = guesses.iter().map(|it| it.free).collect();
        let made =
            self_calibrate(&given, &free, &self.frames.observations, &self_options).map_err(|fault| match fault {
                SelfCalibrationError::NothingCalibrated { status } => ClockError::NoRoom { status },
                other => unreachable!("cameras and rules were checked: {other}"),
            })?;
        // Optics that the frames do not hold stay as given.
        self.freedoms = made.freed.iter().map(|it| Freedom { pose: true, ..*it }).collect();
        self.cameras.clone_from(&made.cameras);
        self.points.clone_from(&made.points);
        self.points.resize(self.frames.times_s.len(), None);
        Ok(made)
    }

    fn middle_s(&self) -> f64 {
        let times = &self.frames.times_s;
        0.5 * (times.first().copied().unwrap_or(0.0) + times.last().copied().unwrap_or(0.0))
    }

    /// The furthest that a clock moved, in the middle or at an end of the recording [s].
    fn moved(&self, before: &[Option<Clock>], middle: f64) -> f64 {
        let half = self.frames.times_s.last().map_or(0.0, |it| it - middle);
        let mut furthest = 0.0_f64;
        for (now, before) in self.clocks.iter().zip(before) {
            let (Some(now), Some(before)) = (now, before) else { continue };
            for at in [middle - half, middle, middle + half] {
                furthest = furthest.max((now.own_s(at) - before.own_s(at)).abs());
            }
        }
        furthest
    }

    /// Adjusts, moves the clocks and interpolates pixels again until nothing moves; how far the last round moved a clock.
    fn settle(&mut self, status: &[CameraStatus]) -> Result<(Adjustment, f64), ClockError> {
        let mut previous = f64::INFINITY;
        for round in 0.. {
            let last = round + 1 == ROUNDS || previous < self.options.settled_s;
            let before = self.clocks.clone();
            let found = self.adjust(status, last)?;
            let middle = self.middle_s();
            for (camera, shift) in found.found.clocks.iter().enumerate() {
                let Some(clock) = &mut self.clocks[camera] else { continue };
                // own = (room − o)/r + s + d (room − m)
                let per = 1.0 / clock.rate + shift.drift;
                let at_zero = -clock.offset_s / clock.rate + shift.offset_s - shift.drift * middle;
                *clock = Clock { offset_s: -at_zero / per, rate: 1.0 / per };
            }
            previous = self.moved(&before, middle);
            if last {
                return Ok((found, previous));
            }
            let times = std::mem::take(&mut self.frames.times_s);
            self.frames = at_moments(self.smooth, self.smooth, &self.clocks, times, &self.frame_options());
        }
        unreachable!("the last round returns")
    }

    /// All observations that fit, and points where there were none.
    fn adjust(&mut self, status: &[CameraStatus], covariance: bool) -> Result<Adjustment, ClockError> {
        let posed = |camera: usize| matches!(status[camera], CameraStatus::Calibrated);
        let limit = self.options.inlier_px;
        let mut of_frame: Vec<Vec<usize>> = vec![Vec::new(); self.frames.times_s.len()];
        for (index, it) in self.frames.observations.iter().enumerate() {
            if posed(it.camera) && self.frames.velocities[index].is_some() {
                of_frame[it.frame].push(index);
            }
        }
        let middle = self.middle_s();
        let (mut points, mut frames) = (Vec::new(), Vec::new());
        let (mut observations, mut velocities, mut times_s) = (Vec::new(), Vec::new(), Vec::new());
        for (frame, of_frame) in of_frame.iter().enumerate() {
            let error = |index: &usize, point: &Point3<f64>| {
                let it = &self.frames.observations[*index];
                self.cameras[it.camera].project(point).map_or(f64::INFINITY, |seen| (seen - it.pixel).norm())
            };
            let fitting = |point: &Point3<f64>| -> Vec<usize> {
                of_frame.iter().copied().filter(|it| error(it, point) <= limit).collect()
            };
            let known = self.points[frame].or_else(|| {
                let ray = |it: &usize| {
                    let it = &self.frames.observations[*it];
                    self.cameras[it.camera].ray(&it.pixel)
                };
                triangulate_rays(&of_frame.iter().filter_map(ray).collect::<Vec<Ray>>())
            });
            let Some(point) = known else { continue };
            let chosen = fitting(&point);
            if chosen.len() < 2 || 2 * chosen.len() <= of_frame.len() {
                self.points[frame] = None;
                continue;
            }
            for index in chosen {
                let it = &self.frames.observations[index];
                let sigma_px = self.frames.sigmas_px[index];
                observations.push(Observation { camera: it.camera, point: points.len(), pixel: it.pixel, sigma_px });
                velocities.push(self.frames.velocities[index].unwrap_or_else(Vector2::zeros));
                times_s.push(self.frames.times_s[frame] - middle);
            }
            points.push(point);
            frames.push(frame);
        }
        let free: Vec<ClockFreedom> = (0..self.cameras.len())
            .map(|it| {
                let offset = it != self.reference && posed(it);
                ClockFreedom { offset, drift: offset && self.options.max_drift > 0.0 }
            })
            .collect();
        // A reference that has no pose holds no gauge: the others are then stated against their mean.
        let gauge = if posed(self.reference) { ClockGauge::Camera(self.reference) } else { ClockGauge::Mean };
        let timing = Timing { velocities: &velocities, times_s: &times_s, free: &free, gauge };
        let options = BundleOptions { loss: Loss::HUBER, covariance, max_iterations: 40, ..BundleOptions::default() };
        let stretches = stretches(&frames);
        let found =
            adjust_with_clocks(&self.cameras, &self.freedoms, &points, &observations, &timing, &stretches, &options)
                .map_err(|fault| ClockError::NotAdjusted { fault: fault.to_string() })?;
        self.cameras.clone_from(&found.adjusted.cameras);
        for (frame, point) in frames.iter().zip(&found.adjusted.points) {
            self.points[*frame] = Some(*point);
        }
        let mut views = vec![0; self.cameras.len()];
        observations.iter().for_each(|it| views[it.camera] += 1);
        Ok(Adjustment { found, views })
    }

    /// By what noise in a camera's velocities makes its clock look better known than it is: Σ v²/Σ v·v', with v' so much later that
    /// it comes from other samples, while the light still moves much as before.
    fn of_noisy_velocities(&self, camera: usize) -> f64 {
        let Some(clock) = self.clocks[camera] else { return 1.0 };
        let track = &self.smooth[camera];
        let (mut squares, mut products) = (0.0, 0.0);
        for time in &self.frames.times_s {
            let at = |later: f64| track.at(clock.own_s(*time) + later * track.period_s, self.options.max_gap_s);
            if let Some((now, then)) = at(0.0).zip(at(4.0)) {
                squares += now.velocity.norm_squared();
                products += now.velocity.dot(&then.velocity);
            }
        }
        if products > 0.0 { (squares / products).max(1.0) } else { f64::INFINITY }
    }

    fn finish(self, status: Vec<CameraStatus>, last: &Adjustment, last_move_s: f64) -> Joint {
        let clocks = self.clocks.iter().enumerate().map(|(camera, clock)| {
            let views = last.views[camera];
            let posed = status[camera] == CameraStatus::Calibrated && views >= LEAST;
            let stated = last.found.clocks[camera].offset_sigma_s;
            let sigma_s = match camera == self.reference {
                true => 0.0,
                false => stated * self.of_noisy_velocities(camera),
            };
            clock.filter(|_| posed).map(|clock| Refined { clock, sigma_s, views })
        });
        let why = |(camera, it): (usize, &CameraStatus)| match last.views[camera] {
            frames if *it == CameraStatus::Calibrated && frames < LEAST => {
                CameraStatus::TooFewObservations { frames, needed: LEAST }
            }
            _ => it.clone(),
        };
        Joint {
            clocks: clocks.collect(),
            status: status.iter().enumerate().map(why).collect(),
            cameras: self.cameras,
            rms_px: last.found.adjusted.rms_px,
            last_move_s,
        }
    }
}

/// One adjustment.
struct Adjustment {
    found: AdjustedWithClocks,
    /// By camera: observations in use.
    views: Vec<usize>,
}
