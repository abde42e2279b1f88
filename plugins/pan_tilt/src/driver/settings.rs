//! Settings of the driver.

use foveate::prelude::{ConfigError, Interval};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::visca::Address;

/// Settings of a [`Driver`](super::Driver).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct DriverSettings {
    /// Address of the head on its serial line, from 1 next to the controller to 7; over IP it is 1 [–].
    #[schemars(range(min = 1, max = 7))]
    pub address: u8,
    /// Time-out of an answer. At 9600 baud the longest message and its answer take 33 ms, and a head processes
    /// one message per field [ms].
    #[schemars(range(min = 1.0, max = 10_000.0))]
    pub reply_timeout_ms: f64,
    /// Over IP: number of repetitions of an unanswered message under its sequence number [–].
    #[schemars(range(min = 0, max = 100))]
    pub resends: u32,
    /// Consecutive unanswered messages after which the head is silent and is greeted again [–].
    #[schemars(range(min = 1, max = 1000))]
    pub silent_after: u32,
    /// Pause before a silent head or a closed port is tried again; doubles with each failure [ms].
    #[schemars(range(min = 1.0, max = 60_000.0))]
    pub retry_ms: f64,
    /// Largest such pause [ms].
    #[schemars(range(min = 1.0, max = 600_000.0))]
    pub retry_max_ms: f64,
    /// Interval of position inquiries; an answer takes about 30 ms of a line of 9600 baud; 0: never [ms].
    #[schemars(range(min = 0.0, max = 60_000.0))]
    pub position_every_ms: f64,
    /// Interval of zoom inquiries; 0: never, but five times a second for a head whose calibration has a zoom table [ms].
    #[schemars(range(min = 0.0, max = 60_000.0))]
    pub zoom_every_ms: f64,
    /// Time that a command waits for a socket before the driver cancels the commands before it [ms].
    #[schemars(range(min = 1.0, max = 60_000.0))]
    pub cancel_after_ms: f64,
    /// Pause after a full buffer until the next command [ms].
    #[schemars(range(min = 1.0, max = 10_000.0))]
    pub full_wait_ms: f64,
    /// Time after a command when a head that stopped elsewhere gets it again: it was corrupted on the line, or lost. More
    /// than the head's own latency [ms].
    #[schemars(range(min = 1.0, max = 60_000.0))]
    pub settle_ms: f64,
    /// Tolerance of the commanded position [units].
    #[schemars(range(min = 0, max = 1000))]
    pub tolerance_units: u16,
    /// Number of such repetitions before the failure is reported [–].
    #[schemars(range(min = 0, max = 1000))]
    pub corrections: u32,
}

impl Default for DriverSettings {
    fn default() -> Self {
        Self {
            address: 1,
            reply_timeout_ms: 150.0,
            resends: 2,
            silent_after: 5,
            retry_ms: 250.0,
            retry_max_ms: 4000.0,
            position_every_ms: 100.0,
            zoom_every_ms: 0.0,
            cancel_after_ms: 250.0,
            full_wait_ms: 20.0,
            settle_ms: 700.0,
            tolerance_units: 1,
            corrections: 10,
        }
    }
}

impl DriverSettings {
    /// Refuses settings out of range.
    ///
    /// # Errors
    /// The first such setting.
    pub fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("address", self.address, 1..=7)?;
        ConfigError::unless_in("reply_timeout_ms", self.reply_timeout_ms, 1.0..=10_000.0)?;
        ConfigError::unless_in("resends", self.resends, 0..=100)?;
        ConfigError::unless_in("silent_after", self.silent_after, 1..=1000)?;
        ConfigError::unless_in("retry_ms", self.retry_ms, 1.0..=60_000.0)?;
        ConfigError::unless_in("retry_max_ms", self.retry_max_ms, self.retry_ms..=600_000.0)?;
        ConfigError::unless_in("position_every_ms", self.position_every_ms, 0.0..=60_000.0)?;
        ConfigError::unless_in("zoom_every_ms", self.zoom_every_ms, 0.0..=60_000.0)?;
        ConfigError::unless_in("cancel_after_ms", self.cancel_after_ms, 1.0..=60_000.0)?;
        ConfigError::unless_in("full_wait_ms", self.full_wait_ms, 1.0..=10_000.0)?;
        ConfigError::unless_in("settle_ms", self.settle_ms, 1.0..=60_000.0)?;
        ConfigError::unless_in("tolerance_units", self.tolerance_units, 0..=1000)?;
        ConfigError::unless_in("corrections", self.corrections, 0..=1000)
    }

    /// The head's address.
    pub(super) fn address(&self) -> Address {
        Address::new(self.address).unwrap_or(Address::FIRST)
    }

    /// Pause after this many consecutive failures, 1 for the first.
    pub(super) fn back_off(&self, failures: u32) -> Interval {
        let doubled = self.retry_ms * 2f64.powi(failures.saturating_sub(1).min(30) as i32);
        Interval::from_ms(doubled.min(self.retry_max_ms))
    }
}
