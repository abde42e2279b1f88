//! When and by whom a value was seen: session time, source, sequence number. Reads no clock.

use std::fmt;
use std::ops::{Add, Sub};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A moment on the session clock [ns].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize, JsonSchema)]
pub struct Time(pub i64);

/// The signed distance between two moments [ns].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize, JsonSchema)]
pub struct Interval(pub i64);

impl Time {
    /// The start of the session.
    pub const ZERO: Time = Time(0);

    /// Nearest nanosecond to `seconds`; values beyond ±292 years saturate, NaN is 0.
    pub fn from_s(seconds: f64) -> Time {
        Time((seconds * 1e9).round() as i64)
    }

    /// In seconds; exact to 1 ns up to 104 days.
    pub fn as_s(self) -> f64 {
        self.0 as f64 * 1e-9
    }
}

impl Interval {
    /// Nearest nanosecond to `seconds`.
    pub fn from_s(seconds: f64) -> Interval {
        Interval((seconds * 1e9).round() as i64)
    }

    /// Nearest nanosecond to `milliseconds`.
    pub fn from_ms(milliseconds: f64) -> Interval {
        Interval((milliseconds * 1e6).round() as i64)
    }

    /// In seconds.
    pub fn as_s(self) -> f64 {
        self.0 as f64 * 1e-9
    }

    /// In milliseconds.
    pub fn as_ms(self) -> f64 {
        self.0 as f64 * 1e-6
    }

    /// Without its sign.
    pub fn abs(self) -> Interval {
        Interval(self.0.saturating_abs())
    }
}

impl Sub for Time {
    type Output = Interval;
    fn sub(self, earlier: Time) -> Interval {
        Interval(self.0.saturating_sub(earlier.0))
    }
}

impl Add<Interval> for Time {
    type Output = Time;
    fn add(self, interval: Interval) -> Time {
        Time(self.0.saturating_add(interval.0))
    }
}

impl Sub<Interval> for Time {
    type Output = Time;
    fn sub(self, interval: Interval) -> Time {
        Time(self.0.saturating_sub(interval.0))
    }
}

impl fmt::Display for Time {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.6} s", self.as_s())
    }
}

/// The node instance that first put a value into the graph: a camera, a recording, a simulator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize, JsonSchema)]
pub struct SourceId(pub u32);

/// When the world was seen, by which source, and its number among that source's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Stamp {
    /// Capture time: when the world was as the value says.
    pub time: Time,
    /// Who saw it.
    pub source: SourceId,
    /// Counts up by one for each value of a source; a jump is a gap.
    pub sequence: u64,
}

/// A value and its [`Stamp`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamped<T> {
    /// When and by whom.
    pub stamp: Stamp,
    /// What.
    pub value: T,
}

impl<T> Stamped<T> {
    /// `value` as seen at the start of the session by source 0, for tests.
    pub fn at_zero(value: T) -> Self {
        Self { stamp: Stamp::default(), value }
    }

    /// Capture time.
    pub fn time(&self) -> Time {
        self.stamp.time
    }
}
