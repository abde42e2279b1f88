//! Where a point was in the last seconds.

use std::collections::VecDeque;

use nalgebra::{Point3, Vector3};

/// Samples nearer than this to the last one that was kept are not kept [s].
const STEP_S: f64 = 1.0 / 60.0;
/// As many are kept: twelve seconds.
const KEPT: usize = 720;

/// The point at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sample {
    pub time_s: f64,
    pub position: Point3<f64>,
    pub velocity: Vector3<f64>,
}

#[derive(Debug, Clone, Default)]
pub(super) struct History {
    kept: VecDeque<Sample>,
    newest: Option<Sample>,
}

impl History {
    /// Takes in a sample that is newer than all before; whether it was kept.
    pub fn push(&mut self, time_s: f64, position: Point3<f64>, velocity: Vector3<f64>) -> bool {
        let sample = Sample { time_s, position, velocity };
        self.newest = Some(sample);
        let is_due = self.kept.back().is_none_or(|it| time_s - it.time_s >= 0.99 * STEP_S);
        if is_due {
            if self.kept.len() == KEPT {
                self.kept.pop_front();
            }
            self.kept.push_back(sample);
        }
        is_due
    }

    pub fn last(&self) -> Option<&Sample> {
        self.newest.as_ref()
    }

    /// Of the oldest sample [s].
    pub fn first_s(&self) -> Option<f64> {
        self.kept.front().map(|it| it.time_s)
    }

    /// Where the point was, between two samples on the cubic that has their positions and velocities; `None` before the first.
    pub fn at(&self, time_s: f64) -> Option<Point3<f64>> {
        let newest = self.newest.as_ref()?;
        if time_s >= newest.time_s {
            return (time_s == newest.time_s).then_some(newest.position);
        }
        let place = self.kept.partition_point(|it| it.time_s <= time_s);
        let before = self.kept.get(place.checked_sub(1)?)?;
        let after = self.kept.get(place).unwrap_or(newest);
        let gap = after.time_s - before.time_s;
        if gap <= 0.0 {
            return Some(before.position);
        }
        let part = (time_s - before.time_s) / gap;
        let (square, cube) = (part * part, part * part * part);
        let coords = before.position.coords * (2.0 * cube - 3.0 * square + 1.0)
            + after.position.coords * (3.0 * square - 2.0 * cube)
            + before.velocity * (gap * (cube - 2.0 * square + part))
            + after.velocity * (gap * (cube - square));
        Some(Point3::from(coords))
    }

    /// How fast it was, in a straight line between the samples; `None` before the first.
    pub fn velocity_at(&self, time_s: f64) -> Option<Vector3<f64>> {
        let newest = self.newest.as_ref()?;
        let place = self.kept.partition_point(|it| it.time_s <= time_s);
        let before = self.kept.get(place.checked_sub(1)?)?;
        let after = self.kept.get(place).unwrap_or(newest);
        let gap = after.time_s - before.time_s;
        let part = if gap > 0.0 { ((time_s - before.time_s) / gap).clamp(0.0, 1.0) } else { 0.0 };
        Some(before.velocity + (after.velocity - before.velocity) * part)
    }
}
