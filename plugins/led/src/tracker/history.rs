//! The recent updates of a target's filter, for out-of-sequence updates.
//!
//! [Davis 2002 §3.5] applies slightly late observations as though they were of the filter's time. With a short history the filter is
//! rolled back to the observation's own time instead, and all later updates are applied again.

use std::collections::VecDeque;

use foveate::estimation::motion::Filter;
use foveate::geometry::Camera;
use foveate::messages::{CameraId, Interval, Time};
use nalgebra::{Matrix2, Point2};

/// One observation and the filter after it.
#[derive(Debug, Clone)]
pub(super) struct Step {
    pub time: Time,
    /// `None` for the beginning of the history.
    pub seen: Option<Seen>,
    pub filter: Filter,
}

/// An observation.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    pub camera: CameraId,
    /// [px]
    pub pixel: Point2<f64>,
    /// Of the pixel, the camera's own error included [px²].
    pub noise: Matrix2<f64>,
}

/// The steps of one target, by time.
#[derive(Debug, Clone, Default)]
pub(super) struct History {
    steps: VecDeque<Step>,
}

impl History {
    /// Forgets everything: earlier observations cannot be inserted any more.
    pub fn clear(&mut self) {
        self.steps.clear();
    }

    /// Adds the newest step and forgets what is not needed to go back by `reach`.
    pub fn push(&mut self, step: Step, reach: Interval) {
        let oldest = step.time - reach;
        self.steps.push_back(step);
        while self.steps.len() > 1 && self.steps[1].time <= oldest {
            self.steps.pop_front();
        }
    }

    /// The filter as it was known at `time`; `None` before the history begins.
    pub fn filter_at(&self, time: Time, noise_scale: f64) -> Option<Filter> {
        let place = self.steps.partition_point(|step| step.time <= time).checked_sub(1)?;
        let mut filter = self.steps[place].filter.clone();
        filter.predict_scaled((time - self.steps[place].time).as_s(), noise_scale);
        Some(filter)
    }

    /// Inserts a step and applies all later ones again; returns the filter as of `now`.
    pub fn insert(&mut self, step: Step, cameras: &[Camera], noise_scale: f64, now: Time) -> Filter {
        let mut filter = step.filter.clone();
        let mut time = step.time;
        let place = self.steps.partition_point(|it| it.time <= time);
        self.steps.insert(place, step);
        for later in self.steps.range_mut(place + 1..) {
            filter.predict_scaled((later.time - time).as_s(), noise_scale);
            time = later.time;
            if let Some(Seen { camera, pixel, noise }) = later.seen
                && let Some((expected, jacobian)) =
                    cameras[usize::from(camera.0)].project_with_jacobian(&filter.position())
            {
                filter.update_pixel(pixel - expected, &jacobian, &noise);
            }
            later.filter.clone_from(&filter);
        }
        filter.predict_scaled((now - time).as_s(), noise_scale);
        filter
    }
}
