//! Bodies with later measurements: a fixed-lag smoother over the steps of their filters.

use std::collections::VecDeque;

use foveate::geometry::body::{Step, TrackedBody, smooth};
use foveate::prelude::*;

use super::message::skeleton_of;

/// One moment that still waits for what comes after it.
struct Moment {
    stamp: Stamp,
    time: Time,
    bodies: Vec<TrackedBody>,
    cameras: CameraSet,
}

/// Keeps moments until what came `lag` after them is known.
pub(super) struct Smoother {
    lag: Interval,
    waiting: VecDeque<Moment>,
}

impl Smoother {
    /// With this lag.
    pub fn new(lag: Interval) -> Self {
        Self { lag, waiting: VecDeque::new() }
    }

    /// Takes a moment, and gives those that are older than the lag, smoothed.
    pub fn push(
        &mut self,
        stamp: Stamp,
        time: Time,
        bodies: &[TrackedBody],
        cameras: &CameraSet,
    ) -> Vec<(Stamp, Skeletons)> {
        self.waiting.push_back(Moment { stamp, time, bodies: bodies.to_vec(), cameras: cameras.clone() });
        let mut ready = Vec::new();
        while self.waiting.front().is_some_and(|it| time - it.time >= self.lag) {
            ready.extend(self.oldest());
            self.waiting.pop_front();
        }
        ready
    }

    fn oldest(&self) -> Option<(Stamp, Skeletons)> {
        let first = self.waiting.front()?;
        let better = |body: &TrackedBody| {
            // The steps of this body from here on, as long as it is followed.
            let own = |it: &Moment| it.bodies.iter().find(|other| other.id == body.id).cloned();
            let followed: Vec<TrackedBody> = self.waiting.iter().map_while(own).collect();
            let steps: Vec<Step> = followed.iter().map_while(|it| it.tracker.last_step().cloned()).collect();
            let filter = smooth(&steps).into_iter().next()?;
            Some(TrackedBody { tracker: body.tracker.with_filter(filter), ..body.clone() })
        };
        let bodies = first.bodies.iter().map(|it| better(it).unwrap_or_else(|| it.clone()));
        let list = bodies.map(|it| skeleton_of(&it, &first.cameras)).collect();
        Some((first.stamp, Skeletons { time: first.time, list, unmodelled: Vec::new() }))
    }
}
