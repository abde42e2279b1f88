//! Session time, and stamps: when a value was captured, by which source, with which sequence number. Reads no clock.

use std::fmt;
use std::ops::{Add, Sub};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A moment on the session clock [ns].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize, JsonSchema)]
pub struct Time(pub i64);

/// A signed duration [ns].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize, JsonSchema)]
pub struct Interval(pub i64);

impl Time {
    /// Start of the session.
    pub const ZERO: Time = Time(0);

    /// Nearest nanosecond to `seconds`; values beyond ±292 years saturate, NaN is 0.
    pub fn from_s(seconds: f64) -> Time {
        Time((seconds * 1e9).round() as i64)
    }

    /// The time in seconds; exact to 1 ns up to 104 days.
    pub fn as_s(self) -> f64 {
        self.0 as f64 * 1e-9
    }
}

impl Interval {
    /// The duration nearest to `seconds`, to the nanosecond; saturates.
    pub fn from_s(seconds: f64) -> Interval {
        Interval((seconds * 1e9).round() as i64)
    }

    /// The duration nearest to `milliseconds`, to the nanosecond; saturates.
    pub fn from_ms(milliseconds: f64) -> Interval {
        Interval((milliseconds * 1e6).round() as i64)
    }

    /// The duration in seconds.
    pub fn as_s(self) -> f64 {
        self.0 as f64 * 1e-9
    }

    /// The duration in milliseconds.
    pub fn as_ms(self) -> f64 {
        self.0 as f64 * 1e-6
    }

    /// The absolute duration.
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

/// Number of the node instance that first put a value into the graph: a camera, a recording, a simulator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize, JsonSchema)]
pub struct SourceId(pub u32);

/// Capture time of a value, its source, and its number among that source's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Stamp {
    /// Capture time: the moment that the value describes.
    pub time: Time,
    /// Source of the value.
    pub source: SourceId,
    /// Counts up by one for each value of a source; a jump is a gap.
    pub sequence: u64,
}

/// A value with its [`Stamp`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamped<T> {
    /// Capture time, source and sequence number.
    pub stamp: Stamp,
    /// The value.
    pub value: T,
}

impl<T> Stamped<T> {
    /// `value` with the time 0, source 0 and sequence number 0, for tests.
    pub fn at_zero(value: T) -> Self {
        Self { stamp: Stamp::default(), value }
    }

    /// Capture time of the value.
    pub fn time(&self) -> Time {
        self.stamp.time
    }
}
