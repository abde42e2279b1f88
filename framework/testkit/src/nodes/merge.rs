//! Nodes that take from many sources: the newest of one of them, or one of each at the same capture time.

use foveate_node::{ConfigError, In, Io, Node, NodeError, Out, Ports, Role, Setup};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Number;

/// Settings of [`Newest`] and [`Join`]: none.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct MergeSettings {}

const NEWEST: In<Number> = In::newest_of_each(0, "numbers").many();
const JOINED: In<Number> = In::synced(0, "numbers", 1).many();
const PASSED: Out<Number> = Out::new(0, "numbers");

/// Passes on the newest number of a source picked at random.
pub struct Newest;

impl Node for Newest {
    const TYPE: &'static str = "testkit.newest";
    const ROLE: Role = Role::Integrator;
    const SUMMARY: &'static str = "Passes on the newest number of a source picked at random.";
    type Settings = MergeSettings;

    fn ports() -> Ports {
        Ports::new().input(&NEWEST).output(&PASSED)
    }

    fn new(_settings: MergeSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self)
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(number) = io.take(&NEWEST) {
            io.emit(&PASSED, number.stamp, number.value);
        }
        Ok(())
    }
}

/// Gives the sum of the numbers whose capture times differ by at most 1 ms, one of each source.
pub struct Join;

impl Node for Join {
    const TYPE: &'static str = "testkit.join";
    const ROLE: Role = Role::Integrator;
    const SUMMARY: &'static str = "Sums up numbers of the same capture time.";
    type Settings = MergeSettings;

    fn ports() -> Ports {
        Ports::new().input(&JOINED).output(&PASSED)
    }

    fn new(_settings: MergeSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self)
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let mut time = None;
        let mut sum = 0_i64;
        for number in io.take_set(&JOINED) {
            time = time.max(Some(number.time()));
            sum = sum.wrapping_add(number.value.0);
        }
        if let Some(time) = time {
            io.emit_at(&PASSED, time, Number(sum));
        }
        Ok(())
    }
}
