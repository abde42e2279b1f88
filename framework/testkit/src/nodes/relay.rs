//! Passes numbers on, adding the newest one of an optional feedback input.

use foveate_node::{ConfigError, Io, Node, NodeError, Ports, Role, Setup, ports};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Number;

/// Settings of [`Relay`].
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RelaySettings {
    /// Added to each number [–].
    pub add: i64,
}

ports! {
    NUMBERS: In<Number> = each("numbers");
    FEEDBACK: In<Number> = latest("feedback").optional();
    RELAYED: Out<Number> = "numbers";
}

/// Gives number + `add` + the newest number at `feedback` (0 where nothing came yet), under the stamp of the number.
pub struct Relay {
    add: i64,
}

impl Node for Relay {
    const TYPE: &'static str = "testkit.relay";
    const ROLE: Role = Role::ModelFilter;
    const SUMMARY: &'static str = "Passes numbers on.";
    type Settings = RelaySettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: RelaySettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self { add: settings.add })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(number) = io.take(&NUMBERS) else { return Ok(()) };
        let feedback = io.latest(&FEEDBACK).map_or(0, |it| it.value.0);
        io.emit(&RELAYED, number.stamp, Number(number.value.0.wrapping_add(self.add).wrapping_add(feedback)));
        Ok(())
    }
}
