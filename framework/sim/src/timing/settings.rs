//! What a simulated camera's clock, way of delivery and health are like; part of the settings of every simulated camera.

use foveate_node::{ConfigError, Plan};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Capture times, clock, delivery and failures of a camera. By default the clock is
/// right, every field takes the same time, and nothing fails.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct TimingSettings {
    /// Fields a second [Hz].
    #[schemars(range(min = 0.1, max = 1000.0))]
    pub rate_hz: f64,
    /// All cameras capture at the same moments; otherwise each has a random offset within the period, drawn once [–].
    pub synchronised: bool,
    /// From the middle of the exposure to the delivery of the field, at least; no less than half the exposure and half the readout of a rolling shutter [ms].
    #[schemars(range(min = 0.0, max = 10_000.0))]
    pub latency_ms: f64,
    /// Mean of an additional random delay of each field, exponentially distributed, so that fields may overtake each other [ms].
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub latency_jitter_ms: f64,
    /// How often a single field is delayed, so that later ones overtake it; 0: never [Hz].
    #[schemars(range(min = 0.0, max = 100.0))]
    pub hiccup_hz: f64,
    /// Delay of such a field [ms].
    #[schemars(range(min = 0.0, max = 10_000.0))]
    pub hiccup_ms: f64,
    /// Share of the fields that get lost on the way and show as gaps, drawn for each field [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub lost: f64,
    /// How far the camera's clock is ahead of the session's at its start: stamps are by the camera's clock, while pictures are
    /// taken and delivered by the session's [ms].
    #[schemars(range(min = -10_000.0, max = 10_000.0))]
    pub clock_offset_ms: f64,
    /// The offset of each camera is drawn once, evenly from this much below `clock_offset_ms` to this much above [ms].
    #[schemars(range(min = 0.0, max = 10_000.0))]
    pub clock_offset_spread_ms: f64,
    /// Drift of the camera's clock: a millisecond in a thousand seconds is 1 ppm [ppm].
    #[schemars(range(min = -10_000.0, max = 10_000.0))]
    pub clock_drift_ppm: f64,
    /// The drift of each camera is drawn once, evenly from this much below `clock_drift_ppm` to this much above [ppm].
    #[schemars(range(min = 0.0, max = 10_000.0))]
    pub clock_drift_spread_ppm: f64,
    /// When the camera fails, on the session clock; what it should have seen then shows as gaps. Left out: it does not [s].
    #[schemars(range(min = 0.0, max = 1e9))]
    pub fails_at_s: Option<f64>,
    /// For how long it fails; 0: for good [s].
    #[schemars(range(min = 0.0, max = 1e9))]
    pub fails_for_s: f64,
    /// Mean time between two failures at random moments, of each camera by itself; 0: there are none [s].
    #[schemars(range(min = 0.0, max = 1e9))]
    pub failure_every_s: f64,
    /// How long each of these lasts; less than `failure_every_s` [s].
    #[schemars(range(min = 0.0, max = 1e9))]
    pub failure_lasts_s: f64,
}

impl Default for TimingSettings {
    fn default() -> Self {
        Self {
            rate_hz: 60.0,
            synchronised: false,
            latency_ms: 10.0,
            latency_jitter_ms: 0.0,
            hiccup_hz: 0.0,
            hiccup_ms: 200.0,
            lost: 0.0,
            clock_offset_ms: 0.0,
            clock_offset_spread_ms: 0.0,
            clock_drift_ppm: 0.0,
            clock_drift_spread_ppm: 0.0,
            fails_at_s: None,
            fails_for_s: 0.0,
            failure_every_s: 0.0,
            failure_lasts_s: 1.0,
        }
    }
}

impl TimingSettings {
    /// The camera's plan: what is known before it runs.
    pub(crate) fn plan(&self) -> Plan {
        Plan { rate_hz: Some(self.rate_hz), latency_s: self.latency_ms * 1e-3, ..Plan::default() }
    }

    /// Refuses light that is gathered or read out for longer than a field lasts, or that arrives before all of it is there [ms].
    ///
    /// # Errors
    /// The setting of a camera, `exposure_ms`, `sensor.readout_ms` or `latency_ms`.
    pub(crate) fn check_light(&self, exposure_ms: f64, readout_ms: f64) -> Result<(), ConfigError> {
        let period = 1000.0 / self.rate_hz;
        for (name, value) in [("exposure_ms", exposure_ms), ("sensor.readout_ms", readout_ms)] {
            if value > period {
                let message = format!("found {value}, expected at most {period:.2}, the time between two fields");
                return Err(ConfigError::at(name, message));
            }
        }
        let gathered = 0.5 * (exposure_ms + readout_ms);
        if self.latency_ms < gathered {
            let of = if readout_ms > 0.0 {
                "half of `exposure_ms` and `sensor.readout_ms`"
            } else {
                "half of `exposure_ms`"
            };
            let found = self.latency_ms;
            let message = format!("found {found}, expected at least {gathered}, {of}: light is gathered until then");
            return Err(ConfigError::at("latency_ms", message));
        }
        Ok(())
    }

    /// Refuses what is out of range or contradicts itself.
    ///
    /// # Errors
    /// The first such setting.
    pub fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("rate_hz", self.rate_hz, 0.1..=1000.0)?;
        ConfigError::unless_in("latency_ms", self.latency_ms, 0.0..=10_000.0)?;
        ConfigError::unless_in("latency_jitter_ms", self.latency_jitter_ms, 0.0..=1000.0)?;
        ConfigError::unless_in("hiccup_hz", self.hiccup_hz, 0.0..=100.0)?;
        ConfigError::unless_in("hiccup_ms", self.hiccup_ms, 0.0..=10_000.0)?;
        ConfigError::unless_in("lost", self.lost, 0.0..=1.0)?;
        ConfigError::unless_in("clock_offset_ms", self.clock_offset_ms, -10_000.0..=10_000.0)?;
        ConfigError::unless_in("clock_offset_spread_ms", self.clock_offset_spread_ms, 0.0..=10_000.0)?;
        ConfigError::unless_in("clock_drift_ppm", self.clock_drift_ppm, -10_000.0..=10_000.0)?;
        ConfigError::unless_in("clock_drift_spread_ppm", self.clock_drift_spread_ppm, 0.0..=10_000.0)?;
        ConfigError::unless_in("fails_at_s", self.fails_at_s.unwrap_or(0.0), 0.0..=1e9)?;
        ConfigError::unless_in("fails_for_s", self.fails_for_s, 0.0..=1e9)?;
        ConfigError::unless_in("failure_every_s", self.failure_every_s, 0.0..=1e9)?;
        ConfigError::unless_in("failure_lasts_s", self.failure_lasts_s, 0.0..=1e9)?;
        if self.failure_every_s > 0.0 && self.failure_lasts_s >= self.failure_every_s {
            let (lasts, every) = (self.failure_lasts_s, self.failure_every_s);
            let message = format!("found {lasts}, expected less than the {every} s of `failure_every_s`");
            return Err(ConfigError::at("failure_lasts_s", message));
        }
        Ok(())
    }
}
