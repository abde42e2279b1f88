//! A camera's own clock: wrong by an offset, and running a little fast or slow.

use foveate_estimation::random::Random;
use foveate_messages::{Interval, Time};

use super::TimingSettings;

/// Reads t + offset + drift × t at session time t.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clock {
    /// How far it is ahead at the start of the session [s].
    pub offset_s: f64,
    /// Drift: seconds gained in a second [s].
    pub drift: f64,
}

impl Clock {
    /// The clock of the camera that `random` belongs to.
    pub fn new(settings: &TimingSettings, random: &Random) -> Self {
        let mut random = random.fork("clock");
        let mut around = |middle: f64, spread: f64| middle + spread * random.uniform_in(-1.0, 1.0);
        let offset_ms = around(settings.clock_offset_ms, settings.clock_offset_spread_ms);
        let drift_ppm = around(settings.clock_drift_ppm, settings.clock_drift_spread_ppm);
        Self { offset_s: offset_ms * 1e-3, drift: drift_ppm * 1e-6 }
    }

    /// How far it is ahead at session time `time`.
    pub fn ahead(&self, time: Time) -> Interval {
        Interval::from_s(self.offset_s + self.drift * time.as_s())
    }

    /// What it shows at session time `time`.
    pub fn reads(&self, time: Time) -> Time {
        time + self.ahead(time)
    }

    /// Whether it always shows the session's time.
    pub fn is_right(&self) -> bool {
        self.offset_s == 0.0 && self.drift == 0.0
    }
}
