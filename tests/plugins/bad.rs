//! Nodes that do all that a node must not.

use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const TARGETS: In<Targets> = In::each(0, "targets");
const OUT: Out<Targets> = Out::new(0, "targets");

/// What is to go wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum What {
    /// Nothing.
    Nothing,
    /// `new` panics when it is to run.
    New,
    /// `new` panics when it is checked.
    Check,
    /// `process` panics.
    Process,
    /// `finish` panics.
    Finish,
    /// `drop` panics.
    Drop,
    /// `process` does not come back.
    Endless,
    /// `process` gives out without an end.
    Flood,
    /// `plan` panics.
    Plan,
    /// `process` writes where nothing is.
    Crash,
}

/// Settings of [`Bad`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct BadSettings {
    /// What is to go wrong [–].
    pub what: What,
    /// Must be even, which no schema says [–].
    pub even: u8,
}

impl Default for BadSettings {
    fn default() -> Self {
        Self { what: What::Nothing, even: 2 }
    }
}

/// Goes wrong as told.
pub struct Bad(What);

impl Node for Bad {
    const TYPE: &'static str = "bad.node";
    const ROLE: Role = Role::ModelFilter;
    const SUMMARY: &'static str = "Goes wrong";
    type Settings = BadSettings;

    fn ports() -> Ports {
        Ports::new().input(&TARGETS).output(&OUT)
    }

    fn new(settings: BadSettings, setup: &Setup) -> Result<Self, ConfigError> {
        if settings.even % 2 == 1 {
            return Err(ConfigError::at("even", format_args!("found {}, expected an even number", settings.even)));
        }
        match (settings.what, setup.purpose) {
            (What::New, Purpose::Run) | (What::Check, Purpose::Check) => panic!("bad at its making"),
            _ => Ok(Self(settings.what)),
        }
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(targets) = io.take(&TARGETS) else { return Ok(()) };
        match self.0 {
            What::Process => panic!("bad at its work"),
            What::Endless => loop {
                std::hint::spin_loop();
            },
            // SAFETY: none.
            What::Crash => unsafe { std::ptr::without_provenance_mut::<u8>(8).write_volatile(0) },
            What::Flood => loop {
                io.emit(&OUT, targets.stamp, targets.value.clone());
            },
            _ => io.emit(&OUT, targets.stamp, targets.value),
        }
        Ok(())
    }

    fn finish(&mut self, _report: &mut Report) -> Result<(), NodeError> {
        assert!(self.0 != What::Finish, "bad at its end");
        Ok(())
    }

    fn plan(settings: &BadSettings) -> Plan {
        assert!(settings.what != What::Plan, "bad at its plan");
        Plan::default()
    }
}

impl Drop for Bad {
    fn drop(&mut self) {
        assert!(self.0 != What::Drop, "bad at its drop");
    }
}
