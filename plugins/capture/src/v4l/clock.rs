//! From the clock of the driver to the session clock, and what the stamps say about themselves.

use foveate::prelude::*;

/// A stamp earlier than its arrival by more than this is of another clock [ns].
const OLDEST: i64 = 10_000_000_000;
/// A stamp may be this much after its arrival: some drivers hand a picture over before the end of the frame that they stamp [ns].
const NEWEST: i64 = 1_000_000_000;

/// Maps the driver's clock to the session's.
///
/// The distance between the two is fixed once, at the first picture: session time of that turn less the device clock read in that turn. All cameras
/// of a host are stamped by one clock (CLOCK_MONOTONIC) and the session's is the same one, so their distances agree to the microseconds that
/// lie between the two readings, and nothing drifts.
#[derive(Debug, Default)]
pub(crate) struct SessionClock {
    session_from_device: Option<i64>,
}

impl SessionClock {
    pub(crate) fn is_fixed(&self) -> bool {
        self.session_from_device.is_some()
    }

    /// Fixes the distance, if it is not yet.
    pub(crate) fn fix(&mut self, session: Time, device: i64) {
        self.session_from_device.get_or_insert(session.0.saturating_sub(device));
    }

    /// Session time of a moment on the device clock; the start of the session as long as nothing is fixed.
    pub(crate) fn session(&self, device: i64) -> Time {
        self.session_from_device.map_or(Time::ZERO, |it| Time(it.saturating_add(device)))
    }
}

/// The stamp of the driver where it can be one of a picture that arrived at `arrival`, else `arrival` [ns].
pub(crate) fn plausible(stamp: Option<i64>, arrival: i64) -> Option<i64> {
    stamp.filter(|&it| (arrival.saturating_sub(OLDEST)..=arrival.saturating_add(NEWEST)).contains(&it))
}

/// Latency from stamp to arrival and its trend, rate of the frames: sums only, nothing is kept.
#[derive(Debug, Default)]
pub(crate) struct Statistics {
    n: u64,
    first: i64,
    last: i64,
    worst: f64,
    /// Of time since the first frame t [s] and latency [s].
    sum_t: f64,
    sum_latency: f64,
    sum_tt: f64,
    sum_t_latency: f64,
}

impl Statistics {
    /// A frame stamped and arrived at these moments [ns].
    pub(crate) fn add(&mut self, stamp: i64, arrival: i64) {
        if self.n == 0 {
            self.first = stamp;
        }
        self.n += 1;
        self.last = stamp;
        let t = Interval(stamp - self.first).as_s();
        let latency = Interval(arrival - stamp).as_s();
        self.worst = if self.n == 1 { latency } else { self.worst.max(latency) };
        self.sum_t += t;
        self.sum_latency += latency;
        self.sum_tt += t * t;
        self.sum_t_latency += t * latency;
    }

    /// Frames.
    pub(crate) fn count(&self) -> u64 {
        self.n
    }

    /// Mean and largest latency [ms]; NaN without a frame.
    pub(crate) fn latency_ms(&self) -> (f64, f64) {
        if self.n == 0 { (f64::NAN, f64::NAN) } else { (self.sum_latency / self.n as f64 * 1e3, self.worst * 1e3) }
    }

    /// Slope of the latency over time: how much slower the clock of the stamps runs than this host's [ppm]; NaN for fewer than three frames.
    pub(crate) fn drift_ppm(&self) -> f64 {
        let n = self.n as f64;
        let spread = self.sum_tt - self.sum_t * self.sum_t / n;
        if self.n < 3 || spread <= 0.0 {
            return f64::NAN;
        }
        (self.sum_t_latency - self.sum_t * self.sum_latency / n) / spread * 1e6
    }

    /// Frames that came in a second between the first and the last [Hz]; NaN for fewer than two.
    pub(crate) fn rate_hz(&self) -> f64 {
        if self.n < 2 || self.last <= self.first {
            return f64::NAN;
        }
        (self.n - 1) as f64 / Interval(self.last - self.first).as_s()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distance_is_fixed_by_the_first_picture_alone() {
        let mut clock = SessionClock::default();
        assert_eq!(clock.session(77), Time::ZERO);
        clock.fix(Time(5_000), 1_000_005_000);
        clock.fix(Time(9_000), 1_000_005_000);
        assert_eq!(clock.session(1_000_002_000), Time(2_000));
        assert_eq!(clock.session(999_999_000), Time(-1_000), "seen before the session began");
    }

    #[test]
    fn stamps_of_another_clock_are_noticed() {
        let arrival = 3_600_000_000_000;
        assert_eq!(plausible(Some(arrival - 40_000_000), arrival), Some(arrival - 40_000_000));
        assert_eq!(plausible(Some(arrival + 40_000_000), arrival), Some(arrival + 40_000_000));
        assert_eq!(plausible(Some(1_700_000_000_000_000_000), arrival), None, "a wall clock");
        assert_eq!(plausible(Some(0), arrival), None);
        assert_eq!(plausible(None, arrival), None);
    }

    #[test]
    fn latency_and_drift_of_a_slow_clock_are_found() {
        let mut statistics = Statistics::default();
        assert!(statistics.drift_ppm().is_nan() && statistics.rate_hz().is_nan() && statistics.latency_ms().0.is_nan());
        for frame in 0..1000_i64 {
            let stamp = frame * 20_000_000;
            // 20 ms, and 50 ns more each second of 20 ms frames: 50 ppm.
            statistics.add(stamp, stamp + 20_000_000 + frame * 1000);
        }
        assert!((statistics.drift_ppm() - 50.0).abs() < 0.01, "{}", statistics.drift_ppm());
        assert!((statistics.rate_hz() - 50.0).abs() < 1e-9);
        let (mean, worst) = statistics.latency_ms();
        assert!((mean - 20.4995).abs() < 1e-6 && (worst - 20.999).abs() < 1e-6, "{mean} {worst}");
    }
}
