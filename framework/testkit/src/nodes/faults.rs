//! Nodes that go wrong on demand: an error, a panic, a thread kept busy.

use std::time::{Duration, Instant};

use foveate_node::{ConfigError, Io, Node, NodeError, Ports, Role, Setup, ports};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Number;

/// Settings of [`Fail`] and [`Panic`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct FaultSettings {
    /// The number at which it happens [–].
    pub at: i64,
    /// Whether making the node is refused as well [–].
    pub refuse: bool,
}

impl Default for FaultSettings {
    fn default() -> Self {
        Self { at: 3, refuse: false }
    }
}

impl FaultSettings {
    fn check(&self) -> Result<(), ConfigError> {
        if self.refuse { Err(ConfigError::at("refuse", "found true, which asks for this refusal")) } else { Ok(()) }
    }
}

/// Settings of [`Slow`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SlowSettings {
    /// How long each number keeps the thread busy, in the time of the wall clock [ms].
    #[schemars(range(min = 0.0, max = 10_000.0))]
    pub busy_ms: f64,
}

impl Default for SlowSettings {
    fn default() -> Self {
        Self { busy_ms: 1.0 }
    }
}

ports! {
    NUMBERS: In<Number> = each("numbers");
    PASSED: Out<Number> = "numbers";
}

/// Passes on what triggered this turn, unless `intercept` fails.
fn pass(io: &mut Io<'_>, intercept: impl FnOnce(i64) -> Result<(), NodeError>) -> Result<(), NodeError> {
    let Some(number) = io.take(&NUMBERS) else { return Ok(()) };
    intercept(number.value.0)?;
    io.emit(&PASSED, number.stamp, number.value);
    Ok(())
}

fn ports() -> Ports {
    declared_ports()
}

/// Gives a [`NodeError`] at one number.
pub struct Fail(FaultSettings);

impl Node for Fail {
    const TYPE: &'static str = "testkit.fail";
    const ROLE: Role = Role::ModelFilter;
    const SUMMARY: &'static str = "Fails at one number.";
    type Settings = FaultSettings;

    fn ports() -> Ports {
        ports()
    }

    fn new(settings: FaultSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        Ok(Self(settings))
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let at = self.0.at;
        pass(io, |number| {
            if number == at {
                return Err(NodeError::input(format_args!("found {number}, at which the settings ask for a failure")));
            }
            Ok(())
        })
    }
}

/// Panics at one number.
pub struct Panic(FaultSettings);

impl Node for Panic {
    const TYPE: &'static str = "testkit.panic";
    const ROLE: Role = Role::ModelFilter;
    const SUMMARY: &'static str = "Panics at one number.";
    type Settings = FaultSettings;

    fn ports() -> Ports {
        ports()
    }

    fn new(settings: FaultSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        Ok(Self(settings))
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let at = self.0.at;
        pass(io, |number| {
            assert!(number != at, "found {number}, at which the settings ask for a panic");
            Ok(())
        })
    }
}

/// Keeps its thread busy for each number.
pub struct Slow {
    busy: Duration,
}

impl Node for Slow {
    const TYPE: &'static str = "testkit.slow";
    const ROLE: Role = Role::ModelFilter;
    const SUMMARY: &'static str = "Keeps its thread busy for each number.";
    type Settings = SlowSettings;

    fn ports() -> Ports {
        ports()
    }

    fn new(settings: SlowSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("busy_ms", settings.busy_ms, 0.0..=10_000.0)?;
        Ok(Self { busy: Duration::from_secs_f64(settings.busy_ms * 1e-3) })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let end = Instant::now() + self.busy;
        pass(io, |_| {
            while Instant::now() < end {
                std::hint::spin_loop();
            }
            Ok(())
        })
    }
}
