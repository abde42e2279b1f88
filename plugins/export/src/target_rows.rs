//! From targets to rows: one for each sample, or one for each tick of a regular clock.
//!
//! On a clock, with a target's samples of times t ≤ T < u around tick T, dt = T − t and w = dt / (u − t):
//!
//! | here | formula | unit |
//! |---|---|---|
//! | position, where u − t is no more than `carried_at_most` | (1 − w) p + w q, as in all other exports | m |
//! | covariance | (1 − w) P + w Q | m² |
//! | position, where no sample follows, or too late | p + v dt, for as long as `carried_at_most` | m |
//! | covariance | Ppp + (Ppv + Ppvᵀ) dt + Pvv dt² | m² |
//! | provenance | measured, where an observation lies at most `measured_within` before T | – |
//! | cameras | all cameras that observed it within `measured_within` before T | – |
//!
//! A target that is missing in a later message is extrapolated no further than to the time of that message. No process noise is added over dt.

use std::collections::{BTreeMap, VecDeque};

use foveate::prelude::*;
use nalgebra::{Matrix3, Point3};

use crate::time_base::{ON_TICK, TimeBase};

/// A position and its covariance.
pub(crate) type Place = (Point3<f64>, Matrix3<f64>);

/// One line of the table.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Row {
    pub(crate) time: Time,
    pub(crate) id: TargetId,
    /// [m]
    pub(crate) position: Point3<f64>,
    /// Covariance of the position [m²].
    pub(crate) covariance: Matrix3<f64>,
    /// The same in the world; `None`: not requested, or unknown.
    pub(crate) world: Option<Place>,
    pub(crate) cameras: CameraSet,
    pub(crate) provenance: Provenance,
}

impl Row {
    /// A sample as it is.
    pub(crate) fn of(time: Time, target: &Target) -> Self {
        Self {
            time,
            id: target.id,
            position: target.position,
            covariance: target.covariance.fixed_view::<3, 3>(0, 0).into_owned(),
            world: None,
            cameras: target.cameras.clone(),
            provenance: target.provenance,
        }
    }

    /// A sample extrapolated by its velocity.
    fn carried(time: Time, from: Time, target: &Target) -> Self {
        let dt = (time - from).as_s();
        let of_position = target.covariance.fixed_view::<3, 3>(0, 0);
        let with_velocity = target.covariance.fixed_view::<3, 3>(0, 3);
        let of_velocity = target.covariance.fixed_view::<3, 3>(3, 3);
        let covariance = of_position + (with_velocity + with_velocity.transpose()) * dt + of_velocity * (dt * dt);
        Self { position: target.position_after(time - from), covariance, ..Self::of(time, target) }
    }

    fn place(&self) -> Place {
        (self.position, self.covariance)
    }
}

/// Interpolation between two places at `share`.
fn between(a: Place, b: Place, share: f64) -> Place {
    (a.0 + (b.0 - a.0) * share, a.1 * (1.0 - share) + b.1 * share)
}

/// Transforms a place at a time to the world.
pub(crate) type ToWorld<'a> = &'a dyn Fn(Time, &Place) -> Option<Place>;

/// A sample of one target.
#[derive(Debug)]
struct Timed {
    time: Time,
    target: Target,
    world: Option<Place>,
    /// Time of the first later message without the target.
    gone: Option<Time>,
}

/// One target, from its last sample before the next tick on.
#[derive(Debug, Default)]
struct Live {
    samples: VecDeque<Timed>,
    observations: VecDeque<(Time, CameraSet)>,
}

/// A regular clock.
#[derive(Debug)]
pub(crate) struct Clock {
    base: TimeBase,
    /// Largest age of an observation for a measured row.
    measured_within: Interval,
    /// Largest age of a sample that still gives a row, and largest gap that is interpolated.
    carried_at_most: Interval,
    next_tick: Option<i64>,
    /// Time of the last message.
    reached: Time,
    has_ended: bool,
    live: BTreeMap<TargetId, Live>,
}

impl Clock {
    pub(crate) fn new(rate_hz: f64, measured_within: Interval, carried_at_most: Interval) -> Self {
        Self {
            base: TimeBase { start: Time::ZERO, rate_hz },
            measured_within,
            carried_at_most,
            next_tick: None,
            reached: Time::ZERO,
            has_ended: false,
            live: BTreeMap::new(),
        }
    }

    /// Takes in the last message of a time; calls `give` with the rows of the ticks that are now decided.
    pub(crate) fn push(&mut self, message: &Targets, to_world: ToWorld, give: &mut impl FnMut(Row)) {
        let time = message.time;
        match self.next_tick {
            Some(_) if time <= self.reached => return,
            Some(_) => {}
            None => self.next_tick = Some(self.base.first_from(time)),
        }
        self.reached = time;
        for target in &message.list {
            let live = self.live.entry(target.id).or_default();
            if target.provenance == Provenance::Measured {
                live.observations.push_back((time, target.cameras.clone()));
            }
            let world = to_world(time, &Row::of(time, target).place());
            live.samples.push_back(Timed { time, target: target.clone(), world, gone: None });
        }
        for live in self.live.values_mut() {
            if let Some(last) = live.samples.back_mut().filter(|it| it.time < time) {
                last.gone.get_or_insert(time);
            }
        }
        self.tick(to_world, give);
    }

    /// The rows of the last ticks, up to the last message.
    pub(crate) fn finish(&mut self, to_world: ToWorld, give: &mut impl FnMut(Row)) {
        self.has_ended = true;
        self.tick(to_world, give);
    }

    /// All ticks up to the last message that no later message can change.
    fn tick(&mut self, to_world: ToWorld, give: &mut impl FnMut(Row)) {
        let Some(mut tick) = self.next_tick else { return };
        loop {
            let time = self.base.at(tick);
            if time > self.reached + ON_TICK || !self.live.values().all(|it| self.is_decided(it, time)) {
                break;
            }
            let mut is_any = false;
            for live in self.live.values() {
                if let Some(row) = self.row(time, live, to_world) {
                    is_any = true;
                    give(row);
                }
            }
            let (horizon, oldest) = (time - self.measured_within, time - self.carried_at_most);
            self.live.retain(|_, it| {
                it.observations.retain(|seen| seen.0 >= horizon);
                while it.samples.get(1).is_some_and(|next| next.time <= time) {
                    it.samples.pop_front();
                }
                it.samples.back().is_some_and(|last| last.time >= oldest || last.time > time)
            });
            tick += 1;
            if !is_any {
                // Nothing is known of the ticks from here to the next sample.
                let next =
                    self.live.values().flat_map(|it| &it.samples).map(|it| it.time).filter(|it| *it > time).min();
                tick = tick.max(self.base.first_from(next.unwrap_or(self.reached)));
            }
        }
        self.next_tick = Some(tick);
    }

    fn is_decided(&self, live: &Live, time: Time) -> bool {
        let last = live.samples.back().map(|it| it.time);
        self.has_ended || last.is_none_or(|it| it >= time - ON_TICK || self.reached - it > self.carried_at_most)
    }

    fn row(&self, time: Time, live: &Live, to_world: ToWorld) -> Option<Row> {
        let next = live.samples.partition_point(|it| it.time <= time + ON_TICK);
        let last = live.samples.get(next.checked_sub(1)?)?;
        let next = live.samples.get(next).filter(|it| it.time - last.time <= self.carried_at_most);
        let since = time - last.time;
        let mut row = Row::of(time, &last.target);
        match next {
            _ if since <= ON_TICK => row.world = last.world,
            Some(next) => {
                let share = since.as_s() / (next.time - last.time).as_s();
                (row.position, row.covariance) = between(row.place(), Row::of(time, &next.target).place(), share);
                row.world = last.world.zip(next.world).map(|(a, b)| between(a, b, share));
                if next.target.provenance == Provenance::Filled {
                    row.provenance = Provenance::Filled;
                }
            }
            None if since > self.carried_at_most || last.gone.is_some_and(|it| it <= time) => return None,
            None => {
                row = Row::carried(time, last.time, &last.target);
                row.world = to_world(time, &row.place());
            }
        }
        row.cameras.clear();
        let is_recent = |it: &&(Time, CameraSet)| it.0 <= time + ON_TICK && time - it.0 <= self.measured_within;
        let mut is_measured = false;
        for (_, cameras) in live.observations.iter().filter(is_recent) {
            is_measured = true;
            cameras.iter().for_each(|camera| row.cameras.insert(camera));
        }
        row.provenance = match (row.provenance, is_measured) {
            (Provenance::Filled, _) => Provenance::Filled,
            (_, true) => Provenance::Measured,
            (_, false) => Provenance::Predicted,
        };
        Some(row)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use nalgebra::{Matrix6, Vector3};

    use super::*;

    pub(crate) fn target(id: u32, position: [f64; 3], provenance: Provenance) -> Target {
        let cameras =
            if provenance == Provenance::Measured { [CameraId(1)].into_iter().collect() } else { CameraSet::default() };
        Target {
            id: TargetId(id),
            position: position.into(),
            velocity: Vector3::new(1.0, 0.0, 0.0),
            covariance: Matrix6::identity() * 1e-4,
            cameras,
            provenance,
        }
    }

    fn ms(milliseconds: f64) -> Time {
        Time::ZERO + Interval::from_ms(milliseconds)
    }

    /// Rows of a 100 Hz clock as (ms, x in mm, how).
    fn ticks(messages: &[(f64, Provenance)]) -> Vec<(f64, f64, Provenance)> {
        let mut clock = Clock::new(100.0, Interval::from_ms(20.0), Interval::from_ms(100.0));
        let mut rows = Vec::new();
        for &(time, provenance) in messages {
            let message = Targets { time: ms(time), list: vec![target(1, [time * 1e-3, 0.0, 0.0], provenance)] };
            clock.push(&message, &|_, _| None, &mut |row| rows.push(row));
        }
        clock.finish(&|_, _| None, &mut |row| rows.push(row));
        let round = |value: f64| (value * 1e6).round() / 1e6;
        rows.iter().map(|it| (round(it.time.as_s() * 1e3), round(it.position.x * 1e3), it.provenance)).collect()
    }

    #[test]
    fn ticks_carry_the_last_sample_by_its_velocity() {
        use Provenance::{Measured, Predicted};
        // At 40 ms the last observation (13 ms) is older than 20 ms.
        let rows = ticks(&[(7.0, Measured), (13.0, Measured), (35.0, Predicted), (40.0, Predicted), (41.0, Measured)]);
        let expected = [(10.0, Measured), (20.0, Measured), (30.0, Measured), (40.0, Predicted)];
        assert_eq!(rows, expected.map(|(time, provenance)| (time, time, provenance)));
    }

    #[test]
    fn sample_at_the_tick_itself_counts_also_at_the_ends() {
        let rows = ticks(&[(10.0, Provenance::Measured), (20.0, Provenance::Measured)]);
        assert_eq!(rows.iter().map(|it| it.0).collect::<Vec<_>>(), [10.0, 20.0]);
    }

    #[test]
    fn long_silence_gives_no_rows_and_costs_no_time() {
        let month = 30.0 * 86_400.0 * 1e3;
        let rows = ticks(&[(10.0, Provenance::Measured), (month, Provenance::Measured)]);
        let times: Vec<f64> = rows.iter().map(|it| it.0).collect();
        assert_eq!(times.len(), 12, "{times:?}");
        assert_eq!((times[0], times[10], times[11]), (10.0, 110.0, month));
    }

    #[test]
    fn cameras_of_the_window_are_joined_and_the_covariance_grows() {
        let mut clock = Clock::new(100.0, Interval::from_ms(20.0), Interval::from_ms(100.0));
        let mut rows = Vec::new();
        for (time, camera) in [(1.0, 4), (4.0, 2), (8.0, 7)] {
            let mut seen = target(1, [0.0; 3], Provenance::Measured);
            seen.cameras = [CameraId(camera)].into_iter().collect();
            clock.push(&Targets { time: ms(time), list: vec![seen] }, &|_, _| None, &mut |row| rows.push(row));
        }
        clock.push(&Targets { time: ms(50.0), list: Vec::new() }, &|_, _| None, &mut |row| rows.push(row));
        clock.finish(&|_, _| None, &mut |row| rows.push(row));
        assert_eq!(rows.len(), 4, "ticks of 10, 20, 30 and 40 ms");
        assert_eq!(rows[0].cameras, [2, 4, 7].map(CameraId).into_iter().collect());
        assert_eq!(rows[1].cameras, [2, 4, 7].map(CameraId).into_iter().collect());
        assert!(rows[2].cameras.is_empty() && rows[2].provenance == Provenance::Predicted);
        let dt = 0.002;
        assert!((rows[0].covariance - Matrix3::identity() * 1e-4 * (1.0 + dt * dt)).norm() < 1e-18);
    }

    #[test]
    fn rows_between_samples_lie_between_them_and_in_the_world_too() {
        let mut clock = Clock::new(100.0, Interval::from_ms(20.0), Interval::from_ms(100.0));
        let mut rows = Vec::new();
        // A space that falls faster and faster: between samples only its places at their times count.
        let to_world = |time: Time, place: &Place| Some((place.0 + Vector3::z() * -5.0 * time.as_s().powi(2), place.1));
        for (time, x, id) in [(5.0, 0.0, 1), (25.0, 0.2, 1), (30.0, 7.0, 2), (45.0, 0.0, 1)] {
            let message = Targets { time: ms(time), list: vec![target(id, [x, 0.0, 0.0], Provenance::Measured)] };
            clock.push(&message, &to_world, &mut |row| rows.push(row));
        }
        clock.finish(&to_world, &mut |row| rows.push(row));
        let of_one: Vec<&Row> = rows.iter().filter(|it| it.id.0 == 1).collect();
        let found: Vec<f64> = of_one.iter().map(|it| (it.position.x * 1e6).round() / 1e6).collect();
        assert_eq!(found, [0.05, 0.15, 0.15, 0.05], "the message without it does not part its samples");
        let z = |ms: f64| -5.0 * (ms * 1e-3).powi(2);
        let expected = z(5.0) * 0.75 + z(25.0) * 0.25;
        assert!((of_one[0].world.unwrap().0.z - expected).abs() < 1e-12);
        let of_other: Vec<Time> = rows.iter().filter(|it| it.id.0 == 2).map(|it| it.time).collect();
        assert_eq!(of_other, [ms(30.0), ms(40.0)], "gone at 45 ms");
    }

    #[test]
    fn correlation_with_velocity_enters_the_carried_covariance() {
        let mut seen = target(1, [0.0; 3], Provenance::Measured);
        seen.covariance[(0, 3)] = 5e-5;
        seen.covariance[(3, 0)] = 5e-5;
        let row = Row::carried(ms(100.0), ms(0.0), &seen);
        assert!((row.covariance[(0, 0)] - (1e-4 + 2.0 * 5e-5 * 0.1 + 1e-4 * 0.01)).abs() < 1e-15);
    }
}
