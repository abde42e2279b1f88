//! From targets to rows: one for each sample, or one for each tick of a regular clock.
//!
//! On a clock, a target's row at tick T comes from its last sample, of time t ≤ T, with dt = T − t:
//!
//! | here | formula | unit |
//! |---|---|---|
//! | position | p + v dt | m |
//! | covariance | Ppp + (Ppv + Ppvᵀ) dt + Pvv dt² | m² |
//! | how | measured, where an observation lies at most `measured_within` before T | – |
//! | cameras | all that observed it within `measured_within` before T | – |
//!
//! No noise of the motion is added over dt: the clock's step is meant to be short.

use std::collections::{BTreeMap, VecDeque};

use foveate::prelude::*;
use nalgebra::{Matrix3, Point3};

/// One line of the table.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Row {
    pub(crate) time: Time,
    pub(crate) id: TargetId,
    /// [m]
    pub(crate) position: Point3<f64>,
    /// Of the position [m²].
    pub(crate) covariance: Matrix3<f64>,
    pub(crate) cameras: CameraSet,
    pub(crate) how: How,
}

impl Row {
    /// A sample as it is.
    pub(crate) fn of(time: Time, target: &Target) -> Self {
        Self {
            time,
            id: target.id,
            position: target.position,
            covariance: target.covariance.fixed_view::<3, 3>(0, 0).into_owned(),
            cameras: target.cameras.clone(),
            how: target.how,
        }
    }

    /// A sample carried on by its velocity.
    fn carried(time: Time, from: Time, target: &Target) -> Self {
        let dt = (time - from).as_s();
        let of_position = target.covariance.fixed_view::<3, 3>(0, 0);
        let with_velocity = target.covariance.fixed_view::<3, 3>(0, 3);
        let of_velocity = target.covariance.fixed_view::<3, 3>(3, 3);
        let covariance = of_position + (with_velocity + with_velocity.transpose()) * dt + of_velocity * (dt * dt);
        Self { position: target.position_after(time - from), covariance, ..Self::of(time, target) }
    }
}

/// A regular clock.
#[derive(Debug)]
pub(crate) struct Clock {
    rate_hz: f64,
    /// How old an observation may be that makes a row a measured one.
    measured_within: Interval,
    /// How old a sample may be that still gives a row.
    carried_at_most: Interval,
    next_tick: Option<i64>,
    /// The last message.
    time: Time,
    samples: Vec<Target>,
    observations: BTreeMap<TargetId, VecDeque<(Time, CameraSet)>>,
}

impl Clock {
    pub(crate) fn new(rate_hz: f64, measured_within: Interval, carried_at_most: Interval) -> Self {
        Self {
            rate_hz,
            measured_within,
            carried_at_most,
            next_tick: None,
            time: Time::ZERO,
            samples: Vec::new(),
            observations: BTreeMap::new(),
        }
    }

    /// Takes in the last message of a time; calls `give` with the rows of the ticks before it.
    pub(crate) fn push(&mut self, message: &Targets, give: &mut impl FnMut(Row)) {
        match self.next_tick {
            Some(_) if message.time < self.time => return,
            Some(_) => self.tick_until(message.time, false, give),
            None => self.next_tick = Some(self.first_tick(message.time)),
        }
        self.time = message.time;
        self.samples.clone_from(&message.list);
        let horizon = message.time - self.measured_within;
        for target in &message.list {
            if target.how == How::Measured {
                let seen = self.observations.entry(target.id).or_default();
                // The ticks to come are not before this message.
                while seen.front().is_some_and(|(time, _)| *time < horizon) {
                    seen.pop_front();
                }
                seen.push_back((message.time, target.cameras.clone()));
            }
        }
        let list = &message.list;
        self.observations.retain(|id, _| list.binary_search_by_key(id, |it| it.id).is_ok());
    }

    /// The rows of the last ticks, up to the last message.
    pub(crate) fn finish(&mut self, give: &mut impl FnMut(Row)) {
        if self.next_tick.is_some() {
            self.tick_until(self.time, true, give);
        }
    }

    /// The first tick that is not before `time`, whichever way its time was rounded.
    fn first_tick(&self, time: Time) -> i64 {
        let mut tick = (time.as_s() * self.rate_hz).floor() as i64;
        while self.at(tick) < time {
            tick += 1;
        }
        tick
    }

    fn at(&self, tick: i64) -> Time {
        Time::from_s(tick as f64 / self.rate_hz)
    }

    fn tick_until(&mut self, end: Time, inclusive: bool, give: &mut impl FnMut(Row)) {
        let Some(mut tick) = self.next_tick else { return };
        let last_carried = self.time + self.carried_at_most;
        loop {
            let time = self.at(tick);
            if time > end || (time == end && !inclusive) {
                break;
            }
            if time > last_carried {
                // Nothing is known of the ticks from here to `end`.
                tick = tick.max(self.first_tick(end));
                if inclusive && self.at(tick) == end {
                    tick += 1;
                }
                break;
            }
            for target in &self.samples {
                give(self.row(time, target));
            }
            tick += 1;
        }
        self.next_tick = Some(tick);
    }

    fn row(&self, time: Time, target: &Target) -> Row {
        let mut row = Row::carried(time, self.time, target);
        row.cameras.clear();
        let recent = self.observations.get(&target.id).into_iter().flatten();
        let mut is_measured = false;
        for (_, cameras) in recent.filter(|(seen, _)| time - *seen <= self.measured_within) {
            is_measured = true;
            cameras.iter().for_each(|camera| row.cameras.insert(camera));
        }
        row.how = match (target.how, is_measured) {
            (How::Filled, _) => How::Filled,
            (_, true) => How::Measured,
            (_, false) => How::Predicted,
        };
        row
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use nalgebra::{Matrix6, Vector3};

    use super::*;

    pub(crate) fn target(id: u32, position: [f64; 3], how: How) -> Target {
        let cameras = if how == How::Measured { [CameraId(1)].into_iter().collect() } else { CameraSet::default() };
        Target {
            id: TargetId(id),
            position: position.into(),
            velocity: Vector3::new(1.0, 0.0, 0.0),
            covariance: Matrix6::identity() * 1e-4,
            cameras,
            how,
        }
    }

    fn ms(milliseconds: f64) -> Time {
        Time::ZERO + Interval::from_ms(milliseconds)
    }

    /// Rows of a 100 Hz clock as (ms, x in mm, how).
    fn ticks(messages: &[(f64, How)]) -> Vec<(f64, f64, How)> {
        let mut clock = Clock::new(100.0, Interval::from_ms(20.0), Interval::from_ms(100.0));
        let mut rows = Vec::new();
        for &(time, how) in messages {
            let message = Targets { time: ms(time), list: vec![target(1, [time * 1e-3, 0.0, 0.0], how)] };
            clock.push(&message, &mut |row| rows.push(row));
        }
        clock.finish(&mut |row| rows.push(row));
        let round = |value: f64| (value * 1e6).round() / 1e6;
        rows.iter().map(|it| (round(it.time.as_s() * 1e3), round(it.position.x * 1e3), it.how)).collect()
    }

    #[test]
    fn ticks_carry_the_last_sample_by_its_velocity() {
        use How::{Measured, Predicted};
        // At 40 ms the last observation (13 ms) is older than 20 ms.
        let rows = ticks(&[(7.0, Measured), (13.0, Measured), (35.0, Predicted), (40.0, Predicted), (41.0, Measured)]);
        let expected = [(10.0, Measured), (20.0, Measured), (30.0, Measured), (40.0, Predicted)];
        assert_eq!(rows, expected.map(|(time, how)| (time, time, how)));
    }

    #[test]
    fn sample_at_the_tick_itself_counts_also_at_the_ends() {
        let rows = ticks(&[(10.0, How::Measured), (20.0, How::Measured)]);
        assert_eq!(rows.iter().map(|it| it.0).collect::<Vec<_>>(), [10.0, 20.0]);
    }

    #[test]
    fn long_silence_gives_no_rows_and_costs_no_time() {
        let month = 30.0 * 86_400.0 * 1e3;
        let rows = ticks(&[(10.0, How::Measured), (month, How::Measured)]);
        let times: Vec<f64> = rows.iter().map(|it| it.0).collect();
        assert_eq!(times.len(), 12, "{times:?}");
        assert_eq!((times[0], times[10], times[11]), (10.0, 110.0, month));
    }

    #[test]
    fn cameras_of_the_window_are_joined_and_the_covariance_grows() {
        let mut clock = Clock::new(100.0, Interval::from_ms(20.0), Interval::from_ms(100.0));
        let mut rows = Vec::new();
        for (time, camera) in [(1.0, 4), (4.0, 2), (8.0, 7)] {
            let mut seen = target(1, [0.0; 3], How::Measured);
            seen.cameras = [CameraId(camera)].into_iter().collect();
            clock.push(&Targets { time: ms(time), list: vec![seen] }, &mut |row| rows.push(row));
        }
        clock.push(&Targets { time: ms(50.0), list: Vec::new() }, &mut |row| rows.push(row));
        clock.finish(&mut |row| rows.push(row));
        assert_eq!(rows.len(), 4, "ticks of 10, 20, 30 and 40 ms");
        assert_eq!(rows[0].cameras, [2, 4, 7].map(CameraId).into_iter().collect());
        assert_eq!(rows[1].cameras, [2, 4, 7].map(CameraId).into_iter().collect());
        assert!(rows[2].cameras.is_empty() && rows[2].how == How::Predicted);
        let dt = 0.002;
        assert!((rows[0].covariance - Matrix3::identity() * 1e-4 * (1.0 + dt * dt)).norm() < 1e-18);
    }

    #[test]
    fn correlation_with_velocity_enters_the_carried_covariance() {
        let mut seen = target(1, [0.0; 3], How::Measured);
        seen.covariance[(0, 3)] = 5e-5;
        seen.covariance[(3, 0)] = 5e-5;
        let row = Row::carried(ms(100.0), ms(0.0), &seen);
        assert!((row.covariance[(0, 0)] - (1e-4 + 2.0 * 5e-5 * 0.1 + 1e-4 * 0.01)).abs() < 1e-15);
    }
}
