//! Counts: 0, 1, 2, … at a rate.

use foveate_node::{
    ConfigError, Due, Figures, Interval, Io, Node, NodeError, Plan, Ports, Report, Role, Setup, Time, figures, ports,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Number;

/// Settings of [`Counter`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct CounterSettings {
    /// How many numbers; after the last one it is never due again [–].
    pub count: u64,
    /// How often [Hz].
    #[schemars(range(min = 0.001, max = 1e6))]
    pub rate_hz: f64,
    /// Capture time of the first number [ms].
    #[schemars(range(min = 0.0, max = 1e6))]
    pub phase_ms: f64,
    /// From capture to delivery [ms].
    #[schemars(range(min = 0.0, max = 1e6))]
    pub latency_ms: f64,
    /// The number whose place is reported as a gap, negative for none [–].
    pub gap_at: i64,
    /// Whether its rate is known beforehand [–].
    pub tells_rate: bool,
}

impl Default for CounterSettings {
    fn default() -> Self {
        Self { count: 10, rate_hz: 100.0, phase_ms: 0.0, latency_ms: 0.0, gap_at: -1, tells_rate: true }
    }
}

ports! {
    NUMBERS: Out<Number> = "numbers";
}

figures! {
    "counted": count, neither, "Numbers given out or declared as a gap";
}

/// Gives `k` at capture time `phase + k / rate`, delivered after the latency.
pub struct Counter {
    settings: CounterSettings,
    next: u64,
}

impl Counter {
    fn capture_time(&self) -> Time {
        Time::from_s(self.settings.phase_ms * 1e-3 + self.next as f64 / self.settings.rate_hz)
    }
}

impl Node for Counter {
    const TYPE: &'static str = "testkit.counter";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Counts at a rate.";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = CounterSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: CounterSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("rate_hz", settings.rate_hz, 0.001..=1e6)?;
        ConfigError::unless_in("phase_ms", settings.phase_ms, 0.0..=1e6)?;
        ConfigError::unless_in("latency_ms", settings.latency_ms, 0.0..=1e6)?;
        Ok(Self { settings, next: 0 })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let (time, number) = (self.capture_time(), self.next as i64);
        self.next += 1;
        if number == self.settings.gap_at {
            io.gap(&NUMBERS, time, "the settings ask for a gap here");
        } else {
            io.emit_at(&NUMBERS, time, Number(number));
        }
        Ok(())
    }

    fn due(&mut self) -> Due {
        if self.next >= self.settings.count {
            return Due::Never;
        }
        Due::At(self.capture_time() + Interval::from_ms(self.settings.latency_ms))
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.figure("counted", self.next as f64);
        Ok(())
    }

    fn plan(settings: &CounterSettings) -> Plan {
        Plan {
            rate_hz: settings.tells_rate.then_some(settings.rate_hz),
            latency_s: settings.latency_ms * 1e-3,
            ..Plan::default()
        }
    }
}
