//! Bundle adjustment with the cameras' clocks as further unknowns.
//!
//! A pixel that moves by `velocity` [px/s] was taken at a time that differs a little from that of its point. If that
//! camera sees the light `shift_s` later, its pixel is measured + velocity · shift to first order, so that the
//! residual is seen − (measured + velocity · (offset + drift · time)). Where shifts are not small, callers interpolate
//! the pixels again at the new times and adjust again. A delay common to all cameras moves all points along their
//! paths and is unobservable: one camera keeps its clock.

use nalgebra::{DMatrix, Point3, Vector2};

use super::search::{self, FoundClocks};
use super::{Adjusted, BundleError, BundleOptions, Freedom, Known, Observation, check, check_stretches};
use crate::camera::Camera;

/// Which parameters of a camera's clock are adjusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ClockFreedom {
    /// A constant shift.
    pub offset: bool,
    /// A shift that grows with time.
    pub drift: bool,
}

impl ClockFreedom {
    /// The clock is held.
    pub const NONE: ClockFreedom = ClockFreedom { offset: false, drift: false };
    /// An offset only.
    pub const OFFSET: ClockFreedom = ClockFreedom { offset: true, drift: false };
    /// Offset and drift.
    pub const BOTH: ClockFreedom = ClockFreedom { offset: true, drift: true };
}

/// The clock that the others refer to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClockGauge {
    /// The clock of one camera, which is held and has no error.
    Camera(usize),
    /// The mean of all free clocks, whose shifts then add up to 0. Points stay in the time of the first free camera's
    /// clock; the difference is along their paths.
    Mean,
}

/// Times and velocities of the pixels, and which clocks are free.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timing<'a> {
    /// By observation: velocity of the pixel in the image [px/s].
    pub velocities: &'a [Vector2<f64>],
    /// By observation: its time, by which drifts are multiplied; best near 0 in the middle of the recording [s].
    pub times_s: &'a [f64],
    /// By camera: which clock parameters are free.
    pub free: &'a [ClockFreedom],
    /// The clock that the others refer to.
    pub gauge: ClockGauge,
}

impl Timing<'_> {
    /// No clock is adjusted.
    pub(super) const NONE: Timing<'static> =
        Timing { velocities: &[], times_s: &[], free: &[], gauge: ClockGauge::Mean };

    /// Velocity [px/s] and time [s] of an observation, where clocks are adjusted.
    pub(super) fn motion(&self, observation: usize) -> Option<(Vector2<f64>, f64)> {
        Some((*self.velocities.get(observation)?, *self.times_s.get(observation)?))
    }

    /// Whether offset and drift of a camera are free.
    pub(super) fn free(&self, camera: usize) -> [bool; 2] {
        self.free.get(camera).map_or([false; 2], |it| [it.offset, it.drift])
    }

    fn check(&self, n_cameras: usize, n_observations: usize) -> Result<(), BundleError> {
        let fault = |found: String, expected: &'static str| Err(BundleError::BadTiming { found, expected });
        let lengths = [self.free.len(), self.velocities.len(), self.times_s.len()];
        if lengths != [n_cameras, n_observations, n_observations] {
            let found = format!(
                "{} freedoms of {n_cameras} cameras, {} velocities and {} times of {n_observations} observations",
                lengths[0], lengths[1], lengths[2]
            );
            return fault(found, "one for each");
        }
        let finite = |it: usize| self.velocities[it].norm().is_finite() && self.times_s[it].is_finite();
        if let Some(bad) = (0..n_observations).find(|it| !finite(*it)) {
            let found =
                format!("velocity {} and time {} of observation {bad}", self.velocities[bad], self.times_s[bad]);
            return fault(found, "finite numbers");
        }
        if let ClockGauge::Camera(camera) = self.gauge
            && self.free.get(camera) != Some(&ClockFreedom::NONE)
        {
            let found = format!("the clock of reference camera {camera} of {n_cameras} is free or missing");
            return fault(found, "a camera whose clock is not free");
        }
        Ok(())
    }
}

/// Adjusted clock of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ClockShift {
    /// Offset at time 0: the camera's pixels are to be read this much later in its time [s].
    pub offset_s: f64,
    /// Drift: additional offset for each second [–].
    pub drift: f64,
    /// Standard deviation of `offset_s`, if the σ of the pixels are right; 0 for a clock that is held, infinite when a
    /// parameter is unobservable, NaN when no covariance was requested [s].
    pub offset_sigma_s: f64,
    /// Standard deviation of `drift`, likewise [–].
    pub drift_sigma: f64,
}

/// The scene and clocks found by [`adjust_with_clocks`].
#[derive(Debug, Clone, PartialEq)]
pub struct AdjustedWithClocks {
    /// The adjusted scene; residuals are those after the shift.
    pub adjusted: Adjusted,
    /// Clock of each camera.
    pub clocks: Vec<ClockShift>,
}

/// As [`super::adjust`], and also adjusts clocks; `stretches` as in [`Known::stretches`].
///
/// # Errors
/// See [`BundleError`].
pub fn adjust_with_clocks(
    cameras: &[Camera],
    freedoms: &[Freedom],
    points: &[Point3<f64>],
    observations: &[Observation],
    timing: &Timing<'_>,
    stretches: &[usize],
    options: &BundleOptions,
) -> Result<AdjustedWithClocks, BundleError> {
    let known = Known { stretches, ..Known::default() };
    check(cameras, freedoms.len(), points, observations, options)?;
    check_stretches(points.len(), &known)?;
    timing.check(cameras.len(), observations.len())?;
    // In the mean's gauge the first free clock is held, and the shifts are moved to their mean afterwards.
    let mut free = timing.free.to_vec();
    let held = match timing.gauge {
        ClockGauge::Mean => [free.iter().position(|it| it.offset), free.iter().position(|it| it.drift)],
        ClockGauge::Camera(_) => [None; 2],
    };
    if let Some(first) = held[0] {
        free[first].offset = false;
    }
    if let Some(first) = held[1] {
        free[first].drift = false;
    }
    let rest = Timing { free: &free, ..*timing };
    let (adjusted, found) = match freedoms.iter().map(Freedom::width).max().unwrap_or(0) {
        0..=7 => search::run::<9, true>(cameras, freedoms, points, observations, &known, rest, options),
        _ => search::run::<17, true>(cameras, freedoms, points, observations, &known, rest, options),
    }?;
    let [offsets, drifts] = [0, 1].map(|kind| {
        let with_row = (0..free.len()).filter(|it| found.rows[*it][kind].is_some());
        let members: Vec<usize> = held[kind].map_or_else(Vec::new, |first| with_row.chain([first]).collect());
        stated(&found, kind, &members, options.covariance)
    });
    let clocks = offsets.into_iter().zip(drifts).map(|((offset_s, offset_sigma_s), (drift, drift_sigma))| ClockShift {
        offset_s,
        drift,
        offset_sigma_s,
        drift_sigma,
    });
    Ok(AdjustedWithClocks { adjusted, clocks: clocks.collect() })
}

/// Value and standard deviation by camera of offsets (`kind` 0) or drifts (1), against the mean of `members` where there are any.
fn stated(found: &FoundClocks, kind: usize, members: &[usize], wanted: bool) -> Vec<(f64, f64)> {
    let n = found.clocks.len();
    let values: Vec<f64> = found.clocks.iter().map(|it| it[kind]).collect();
    let mut shifts = DMatrix::<f64>::identity(n, n);
    for row in members {
        for column in members {
            shifts[(*row, *column)] -= 1.0 / members.len() as f64;
        }
    }
    let row = |camera: usize| found.rows[camera][kind];
    let covariance = found.covariance.as_ref().map(|whole| {
        let own = DMatrix::from_fn(n, n, |a, b| row(a).zip(row(b)).map_or(0.0, |it| whole[it]));
        &shifts * own * shifts.transpose()
    });
    let free = |camera: usize| row(camera).is_some() || members.contains(&camera);
    (0..n)
        .map(|camera| {
            let value = (0..n).map(|other| shifts[(camera, other)] * values[other]).sum();
            let sigma = match &covariance {
                _ if !free(camera) => 0.0,
                Some(covariance) => covariance[(camera, camera)].max(0.0).sqrt(),
                None if wanted => f64::INFINITY,
                None => f64::NAN,
            };
            (value, sigma)
        })
        .collect()
}

#[cfg(test)]
mod tests;
