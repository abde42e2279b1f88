//! Dots that a wall shows, one at a time, as targets of the room: a target's dot is identified by the time at which it was seen.

use foveate::prelude::*;
use nalgebra::{Matrix3, Point2, Point3, Vector3};

use super::pose::Touch;

/// Errors of a tracker are correlated: this many samples of a dot count as one.
const CORRELATED: f64 = 10.0;
/// Fewest samples of a dot.
const LEAST_SAMPLES: usize = 5;

/// Dots, in the order in which they were requested.
#[derive(Debug, Default)]
pub(super) struct Dots {
    all: Vec<Dot>,
    /// Identity of the target that is shown now; `None` without one, or with several.
    now: Option<TargetId>,
}

#[derive(Debug)]
struct Dot {
    on_wall: Point2<f64>,
    from: Time,
    /// When it was last requested.
    until: Time,
    samples: Vec<(Point3<f64>, Matrix3<f64>)>,
    /// Some message had more lights than one.
    is_crowded: bool,
}

impl Dots {
    /// What the wall is requested to show from `time` on.
    pub(super) fn show(&mut self, time: Time, list: &[Target]) {
        let [it] = list else {
            self.now = None;
            return;
        };
        match self.all.last_mut().filter(|_| self.now == Some(it.id)) {
            Some(last) => last.until = time,
            None => self.all.push(Dot {
                on_wall: it.position.xy(),
                from: time,
                until: time,
                samples: Vec::new(),
                is_crowded: false,
            }),
        }
        self.now = Some(it.id);
    }

    /// What the room saw at the targets' time, which counts once a dot has been requested for `settle`.
    pub(super) fn see(&mut self, targets: &Targets, settle: Interval) {
        let time = targets.time;
        let own = self.all.iter_mut().rev().find(|it| time >= it.from);
        let Some(dot) = own.filter(|it| time >= it.from + settle && time <= it.until) else { return };
        let mut measured = targets.list.iter().filter(|it| it.provenance == Provenance::Measured);
        let Some(it) = measured.next() else { return };
        dot.is_crowded |= measured.next().is_some();
        dot.samples.push((it.position, it.covariance.fixed_view::<3, 3>(0, 0).into_owned()));
    }

    /// Where all dots were requested [m].
    pub(super) fn shown(&self) -> impl Iterator<Item = Point2<f64>> + '_ {
        self.all.iter().map(|it| it.on_wall)
    }

    /// The dots that were seen as one light each, within `still` of their mean [m].
    pub(super) fn places(&self, still: f64) -> Vec<Touch> {
        self.all.iter().filter_map(|it| it.touch(still)).collect()
    }
}

impl Dot {
    fn touch(&self, still: f64) -> Option<Touch> {
        let n = self.samples.len();
        if n < LEAST_SAMPLES || self.is_crowded {
            return None;
        }
        let sum: Vector3<f64> = self.samples.iter().map(|it| it.0.coords).sum();
        let in_room = Point3::from(sum / n as f64);
        if self.samples.iter().any(|it| (it.0 - in_room).norm() > still) {
            return None;
        }
        let covariance = self.samples.iter().map(|it| it.1).sum::<Matrix3<f64>>() / n as f64;
        // Of zero where a tracker states none.
        let covariance = covariance / (n as f64 / CORRELATED).max(1.0) + Matrix3::identity() * 1e-10;
        Some(Touch { on_wall: self.on_wall, in_room, covariance })
    }
}
