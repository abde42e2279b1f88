//! The time line of one simulated camera: when it captures, how its clock stamps that, when the result arrives, and what is lost.
//!
//! Field k is seen at `phase + k / rate + exposure / 2` on the session's clock, stamped by the camera's own [`Clock`], and delivered
//! after its latency. All that is random about a field is drawn by its number, so a time line does not depend on what
//! was asked of it before; [`Timing::next`] gives the fields in the order in which they are delivered.

mod clock;
mod settings;

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use foveate_estimation::random::Random;
use foveate_messages::{Interval, Time};

pub use clock::Clock;
pub use settings::TimingSettings;

use crate::chance::stream;

/// Numbers of the time lines of random events of one camera; that of lost fields is 0.
const JITTER: u64 = 1;
const HICCUPS: u64 = 2;
const FAILURES: u64 = 3;

/// One field on its way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Arrival {
    /// Its number, counted from 0 in the order of capture.
    pub frame: u64,
    /// When the world was truly seen, on the session's clock.
    pub capture: Time,
    /// The same by the camera's clock: what the field is stamped with.
    pub stamp: Time,
    /// When it arrives, on the session's clock.
    pub delivery: Time,
    /// Whether it arrives at all.
    pub outcome: DeliveryOutcome,
}

/// Outcome of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeliveryOutcome {
    /// It arrives.
    Arrives,
    /// It gets lost on the way.
    Lost,
    /// The camera had failed when it should have been taken.
    Failed,
}

/// The fields of one camera in the order of their delivery, without end.
#[derive(Debug, Clone)]
pub struct Timing {
    settings: TimingSettings,
    clock: Clock,
    phase_s: f64,
    /// From the start of a period to the middle of the exposure [s].
    into_s: f64,
    lottery: u64,
    /// Taken and not yet delivered, by delivery and number.
    under_way: BinaryHeap<Reverse<(Time, u64)>>,
    /// Number of the next field that is not under way.
    frame: u64,
}

impl Timing {
    /// The time line of the camera that `random` belongs to; its exposure lasts `exposure_ms` from the start of each period.
    /// Settings out of range are taken as they are.
    pub fn new(settings: &TimingSettings, exposure_ms: f64, random: &Random) -> Self {
        let period = 1.0 / settings.rate_hz;
        Self {
            clock: Clock::new(settings, random),
            phase_s: if settings.synchronised { 0.0 } else { random.fork("phase").uniform() * period },
            into_s: exposure_ms * 0.5e-3,
            lottery: random.fork("lost fields").next_u64(),
            under_way: BinaryHeap::new(),
            frame: 0,
            settings: settings.clone(),
        }
    }

    /// The camera's clock.
    pub fn clock(&self) -> &Clock {
        &self.clock
    }

    /// When the next field to be delivered arrives.
    pub fn next_delivery(&mut self) -> Time {
        // A field is delivered no earlier than its capture and the least latency.
        loop {
            let soonest = self.capture(self.frame) + Interval::from_ms(self.settings.latency_ms);
            match self.under_way.peek() {
                Some(Reverse((delivery, _))) if *delivery <= soonest => return *delivery,
                _ => {
                    self.under_way.push(Reverse((self.delivery(self.frame), self.frame)));
                    self.frame += 1;
                }
            }
        }
    }

    /// The next field in the order of delivery; of two at one time the one seen earlier.
    #[expect(clippy::should_implement_trait, reason = "it never ends, so there is no Option to give")]
    pub fn next(&mut self) -> Arrival {
        self.next_delivery();
        let Some(Reverse((delivery, frame))) = self.under_way.pop() else {
            unreachable!("`next_delivery` leaves a field under way");
        };
        let capture = self.capture(frame);
        let outcome = if self.has_failed(capture.as_s()) {
            DeliveryOutcome::Failed
        } else if stream(self.lottery, 0, frame as i64).uniform() < self.settings.lost {
            DeliveryOutcome::Lost
        } else {
            DeliveryOutcome::Arrives
        };
        Arrival { frame, capture, stamp: self.clock.reads(capture), delivery, outcome }
    }

    /// The middle of the exposure of field `frame`.
    fn capture(&self, frame: u64) -> Time {
        Time::from_s(self.phase_s + frame as f64 / self.settings.rate_hz + self.into_s)
    }

    fn delivery(&self, frame: u64) -> Time {
        let TimingSettings { latency_ms, latency_jitter_ms, hiccup_hz, hiccup_ms, .. } = self.settings;
        let capture = self.capture(frame);
        let mut delay_ms = latency_ms;
        if latency_jitter_ms > 0.0 {
            let share = 1.0 - stream(self.lottery, JITTER, frame as i64).uniform(); // above 0, up to 1
            delay_ms -= latency_jitter_ms * share.ln();
        }
        if hiccup_hz > 0.0 {
            let until = capture.as_s();
            let from = until - 1.0 / self.settings.rate_hz;
            // One event in each slot of 1 / rate, at a random time within it; it hits the first field after it.
            let slots = (from * hiccup_hz).floor() as i64..=(until * hiccup_hz).floor() as i64;
            let mut events = slots.map(|it| self.event(HICCUPS, it, 1.0 / hiccup_hz));
            if events.any(|event| from < event && event <= until) {
                delay_ms += hiccup_ms;
            }
        }
        capture + Interval::from_ms(delay_ms)
    }

    /// Whether the camera has failed at `time_s`.
    fn has_failed(&self, time_s: f64) -> bool {
        let TimingSettings { fails_at_s, fails_for_s, failure_every_s, failure_lasts_s, .. } = self.settings;
        let lasting = if fails_for_s > 0.0 { fails_for_s } else { f64::INFINITY };
        if fails_at_s.is_some_and(|start| (start..start + lasting).contains(&time_s)) {
            return true;
        }
        if failure_every_s <= 0.0 {
            return false;
        }
        let slot = (time_s / failure_every_s).floor() as i64;
        (slot - 1..=slot).any(|slot| {
            let start = self.event(FAILURES, slot, failure_every_s);
            (start..start + failure_lasts_s).contains(&time_s)
        })
    }

    /// When the one event of slot number `slot` happens [s]; slots last `length_s`.
    fn event(&self, what: u64, slot: i64, length_s: f64) -> f64 {
        (slot as f64 + stream(self.lottery, what, slot).uniform()) * length_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arrivals(change: impl Fn(&mut TimingSettings), camera: &str, count: usize) -> Vec<Arrival> {
        let mut settings = TimingSettings::default();
        change(&mut settings);
        settings.check().unwrap();
        let mut timing = Timing::new(&settings, 4.0, &Random::new(1).fork(camera));
        (0..count)
            .map(|_| {
                let due = timing.next_delivery();
                let arrival = timing.next();
                assert_eq!(due, arrival.delivery);
                arrival
            })
            .collect()
    }

    #[test]
    fn plain_camera_delivers_in_order_by_the_right_clock() {
        let found = arrivals(|_| (), "a", 600);
        for (i, it) in found.iter().enumerate() {
            assert_eq!((it.frame, it.outcome, it.stamp), (i as u64, DeliveryOutcome::Arrives, it.capture));
            assert_eq!(it.delivery - it.capture, Interval::from_ms(10.0));
        }
    }

    #[test]
    fn every_field_comes_once_in_the_order_of_delivery_however_late() {
        let n = 6000;
        let late = |it: &mut TimingSettings| {
            (it.latency_jitter_ms, it.hiccup_hz, it.hiccup_ms) = (9.0, 0.5, 300.0);
        };
        let found = arrivals(late, "a", n);
        assert!(found.windows(2).all(|pair| pair[0].delivery <= pair[1].delivery));
        let mut frames: Vec<u64> = found.iter().map(|it| it.frame).collect();
        let overtaken = frames.windows(2).filter(|pair| pair[1] < pair[0]).count();
        assert!((n / 20..n / 2).contains(&overtaken), "{overtaken} fields come after a later one");
        frames.sort_unstable();
        // The last few fields may still be under way.
        assert!(frames[..n - 60].iter().enumerate().all(|(i, it)| i as u64 == *it));
        let delays: Vec<f64> = found.iter().map(|it| (it.delivery - it.capture).as_ms()).collect();
        let held = delays.iter().filter(|it| **it > 250.0).count();
        assert!((45..=51).contains(&held), "{held} of {n} fields held up, expected one in two seconds");
        let rest: Vec<f64> = delays.into_iter().filter(|it| *it < 250.0).collect();
        let mean = rest.iter().sum::<f64>() / rest.len() as f64;
        assert!((mean - 19.0).abs() < 0.5 && rest.iter().all(|it| *it >= 10.0), "mean delay {mean} ms");
    }

    #[test]
    fn stamps_are_by_the_cameras_clock_and_deliveries_by_the_sessions() {
        let wrong = |it: &mut TimingSettings| (it.clock_offset_ms, it.clock_drift_ppm) = (-8.0, 100.0);
        let (found, plain) = (arrivals(wrong, "a", 6000), arrivals(|_| (), "a", 6000));
        for (it, plain) in found.iter().zip(&plain) {
            assert_eq!((it.capture, it.delivery), (plain.capture, plain.delivery));
            let ahead = (it.stamp - it.capture).as_ms();
            let expected = -8.0 + 0.1 * it.capture.as_s();
            assert!((ahead - expected).abs() < 2e-6, "{ahead} ms instead of {expected}");
        }
    }

    #[test]
    fn each_camera_draws_a_clock_of_its_own_within_the_spread() {
        let settings = TimingSettings {
            clock_offset_ms: 2.0,
            clock_offset_spread_ms: 8.0,
            clock_drift_spread_ppm: 50.0,
            ..TimingSettings::default()
        };
        let clocks: Vec<Clock> =
            (0..200).map(|i| Clock::new(&settings, &Random::new(1).fork(&format!("camera {i}")))).collect();
        let offsets: Vec<f64> = clocks.iter().map(|it| it.offset_s * 1e3).collect();
        let (least, most) = offsets.iter().fold((f64::MAX, f64::MIN), |(a, b), &it| (a.min(it), b.max(it)));
        assert!((-6.0..-5.5).contains(&least) && (9.5..10.0).contains(&most), "{least} to {most} ms");
        assert!(clocks.iter().all(|it| it.drift.abs() <= 50e-6));
        assert!(clocks.iter().any(|it| it.drift > 40e-6) && clocks.iter().any(|it| it.drift < -40e-6));
        assert!(Clock::new(&TimingSettings::default(), &Random::new(1)).is_right());
    }

    #[test]
    fn camera_that_fails_recovers_unless_it_fails_for_good() {
        let failed = |fails_for_s: f64| -> Vec<f64> {
            let fails = |it: &mut TimingSettings| (it.fails_at_s, it.fails_for_s) = (Some(3.0), fails_for_s);
            let found = arrivals(fails, "a", 600);
            found.iter().filter(|it| it.outcome == DeliveryOutcome::Failed).map(|it| it.capture.as_s()).collect()
        };
        let for_a_while = failed(2.0);
        assert_eq!(for_a_while.len(), 120);
        assert!(for_a_while.iter().all(|it| (3.0..5.0).contains(it)));
        assert!((419..=421).contains(&failed(0.0).len()));
    }

    #[test]
    fn random_failures_come_as_often_and_last_as_long_as_said() {
        let fails = |it: &mut TimingSettings| (it.failure_every_s, it.failure_lasts_s) = (20.0, 3.0);
        let n = 60 * 2000;
        let found = arrivals(fails, "a", n);
        let failed = |it: &Arrival| it.outcome == DeliveryOutcome::Failed;
        let starts = found.windows(2).filter(|it| !failed(&it[0]) && failed(&it[1])).count();
        let share = found.iter().filter(|it| failed(it)).count() as f64 / n as f64;
        // Two failures that run into each other count as one.
        assert!((85..=100).contains(&starts), "{starts} failures in 2000 s");
        assert!((0.13..=0.15).contains(&share), "{share}");
        let other = arrivals(fails, "b", n);
        assert!(found.iter().zip(&other).any(|(a, b)| failed(a) != failed(b)), "all cameras fail at once");
    }

    #[test]
    fn failures_longer_than_their_distance_are_refused() {
        let settings = TimingSettings { failure_every_s: 2.0, failure_lasts_s: 2.0, ..TimingSettings::default() };
        assert!(settings.check().is_err_and(|it| it.setting.as_deref() == Some("failure_lasts_s")));
        let settings = TimingSettings { fails_at_s: Some(f64::NAN), ..TimingSettings::default() };
        assert!(settings.check().is_err_and(|it| it.setting.as_deref() == Some("fails_at_s")));
    }
}
