//! Settings of the allocator, with the reasons for their defaults.

use foveate::estimation::allocation::Worth;
use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Settings of [`AllocatorNode`](super::AllocatorNode). Values and costs are relative to a target that is seen perfectly.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AllocatorSettings {
    /// The cameras whose heads are allocated, by name; `*` and `?` match any letters [–].
    pub cameras: String,
    /// Most heads for one target [–].
    #[schemars(range(min = 2, max = 6))]
    pub heads_per_target: u32,
    /// Identities of the allowed targets; empty: all [–].
    pub only: Vec<u32>,
    /// Most targets: those that have lived longest; 0: all [–].
    #[schemars(range(min = 0, max = 1000))]
    pub most_targets: u32,
    /// Value of a single head at a target: it shows the target, but not its depth [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub one_worth: f64,
    /// Value that a second head from a perpendicular direction adds, as a part of the missing value; the rest is for further ones [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub pair_worth: f64,
    /// Angle between lines of sight, up to its supplement, with the full value of a pair; outside, the value is proportional to the
    /// sine [deg].
    #[schemars(range(min = 1.0, max = 90.0))]
    pub best_angle_deg: f64,
    /// Cost of turning a head, per second of motion [1/s].
    #[schemars(range(min = 0.0, max = 100.0))]
    pub slew_cost_per_s: f64,
    /// Cost of moving a head from one target to another: an exchange has to gain more [–].
    #[schemars(range(min = 0.0, max = 100.0))]
    pub switch_cost: f64,
    /// Time for which another assignment has to be better before it is adopted; unavailable heads are replaced at once [ms].
    #[schemars(range(min = 0.0, max = 60000.0))]
    pub settle_ms: f64,
    /// Time for which a target that is not listed any more keeps its heads [ms].
    #[schemars(range(min = 0.0, max = 60000.0))]
    pub keep_ms: f64,
    /// Most assignments per second [Hz].
    #[schemars(range(min = 0.1, max = 100.0))]
    pub rate_hz: f64,
    /// Pan speed of the heads [deg/s].
    #[schemars(range(min = 0.1, max = 10000.0))]
    pub pan_deg_s: f64,
    /// Tilt speed of the heads [deg/s].
    #[schemars(range(min = 0.1, max = 10000.0))]
    pub tilt_deg_s: f64,
    /// Delay from an assignment to the start of the motion; with the speeds it gives the arrival time of a head [ms].
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub latency_ms: f64,
}

impl Default for AllocatorSettings {
    /// Speeds and latency of the paper's heads; an exchange has to gain the cost of a second of slewing.
    fn default() -> Self {
        let Worth { one, pair, best_angle } = Worth::default();
        Self {
            cameras: "ptz-*".to_owned(),
            heads_per_target: 4,
            only: Vec::new(),
            most_targets: 0,
            one_worth: one,
            pair_worth: pair,
            best_angle_deg: best_angle.to_degrees().round(),
            slew_cost_per_s: 0.05,
            switch_cost: 0.05,
            settle_ms: 500.0,
            keep_ms: 1000.0,
            rate_hz: 5.0,
            pan_deg_s: 80.0,
            tilt_deg_s: 50.0,
            latency_ms: 300.0,
        }
    }
}

impl AllocatorSettings {
    /// Checks the range of each setting.
    ///
    /// # Errors
    /// The first setting out of its range, what was found, and the range.
    pub fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("heads_per_target", self.heads_per_target, 2..=6)?;
        ConfigError::unless_in("most_targets", self.most_targets, 0..=1000)?;
        ConfigError::unless_in("one_worth", self.one_worth, 0.0..=1.0)?;
        ConfigError::unless_in("pair_worth", self.pair_worth, 0.0..=1.0)?;
        ConfigError::unless_in("best_angle_deg", self.best_angle_deg, 1.0..=90.0)?;
        ConfigError::unless_in("slew_cost_per_s", self.slew_cost_per_s, 0.0..=100.0)?;
        ConfigError::unless_in("switch_cost", self.switch_cost, 0.0..=100.0)?;
        ConfigError::unless_in("settle_ms", self.settle_ms, 0.0..=60_000.0)?;
        ConfigError::unless_in("keep_ms", self.keep_ms, 0.0..=60_000.0)?;
        ConfigError::unless_in("rate_hz", self.rate_hz, 0.1..=100.0)?;
        ConfigError::unless_in("pan_deg_s", self.pan_deg_s, 0.1..=10_000.0)?;
        ConfigError::unless_in("tilt_deg_s", self.tilt_deg_s, 0.1..=10_000.0)?;
        ConfigError::unless_in("latency_ms", self.latency_ms, 0.0..=10_000.0)
    }

    pub(super) fn worth(&self) -> Worth {
        Worth { one: self.one_worth, pair: self.pair_worth, best_angle: self.best_angle_deg.to_radians() }
    }
}
