//! Where a point was in the last seconds.

use std::collections::VecDeque;

use nalgebra::{Point3, Vector3};

/// Samples nearer than this to the last one that was kept are not kept [s].
const STEP_S: f64 = 1.0 / 60.0;
/// As many are kept: twelve seconds.
const KEPT: usize = 720;

/// Samples on either side of the one that is expected that are looked at first.
const LOOK_AROUND: usize = 3;

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

    /// How many samples are kept of times up to `time_s`.
    fn count_until(&self, time_s: f64) -> usize {
        let is_until = |it: &Sample| it.time_s <= time_s;
        let (Some(first), Some(last)) = (self.kept.front(), self.kept.back()) else { return 0 };
        // Samples lie about evenly in time: most times a look around the place where it should be is enough.
        let n = self.kept.len();
        let share = (time_s - first.time_s) / (last.time_s - first.time_s);
        let guess = ((share * (n - 1) as f64) as usize).min(n); // 0 for NaN
        let (low, high) = (guess.saturating_sub(LOOK_AROUND), (guess + LOOK_AROUND).min(n));
        let is_there = (low == 0 || is_until(&self.kept[low - 1])) && (high == n || !is_until(&self.kept[high]));
        match is_there {
            true => low + self.kept.range(low..high).take_while(|it| is_until(it)).count(),
            false => self.kept.partition_point(is_until),
        }
    }

    /// Where the point was, between two samples on the cubic that has their positions and velocities; `None` before the first.
    pub fn at(&self, time_s: f64) -> Option<Point3<f64>> {
        let newest = self.newest.as_ref()?;
        if time_s >= newest.time_s {
            return (time_s == newest.time_s).then_some(newest.position);
        }
        let place = self.count_until(time_s);
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
        let place = self.count_until(time_s);
        let before = self.kept.get(place.checked_sub(1)?)?;
        let after = self.kept.get(place).unwrap_or(newest);
        let gap = after.time_s - before.time_s;
        let part = if gap > 0.0 { ((time_s - before.time_s) / gap).clamp(0.0, 1.0) } else { 0.0 };
        Some(before.velocity + (after.velocity - before.velocity) * part)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn samples_are_counted_however_they_lie_in_time() {
        let mut random = Random::new(6);
        for jitter in [0.0, 0.3, 1.0] {
            for n in [0, 1, 2, 3, 700, 2000] {
                let (mut history, mut time_s) = (History::default(), 100.0);
                for _ in 0..n {
                    let stays_away = if random.uniform() < 0.1 * jitter { 0.4 } else { 0.0 };
                    time_s += STEP_S * (1.0 + jitter * random.uniform()) + stays_away;
                    history.push(time_s, Point3::origin(), Vector3::zeros());
                }
                let times: Vec<f64> = history.kept.iter().map(|it| it.time_s).collect();
                let drawn: Vec<f64> = (0..3000).map(|_| random.uniform_in(99.0, time_s + 1.0)).collect();
                for time_s in times.iter().chain(&drawn).chain(&[f64::NAN, f64::INFINITY, f64::NEG_INFINITY]) {
                    let expected = times.iter().filter(|it| *it <= time_s).count();
                    assert_eq!(history.count_until(*time_s), expected, "{time_s} among {n} of jitter {jitter}");
                }
            }
        }
    }
}
