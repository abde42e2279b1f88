//! Keeps the numbers of a run where a test can look at them.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use foveate_node::{
    ConfigError, Figures, Io, Node, NodeError, Ports, Purpose, Report, Role, Setup, Stamp, Time, figures, ports,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Number;

/// Settings of [`Collect`].
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct CollectSettings {
    /// The name under which [`collected`] finds them; give each test its own [–].
    pub into: String,
}

/// One number as [`Collect`] got it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Collected {
    /// When it was delivered.
    pub now: Time,
    /// Its stamp.
    pub stamp: Stamp,
    /// The number.
    pub number: i64,
}

static SHELVES: Mutex<BTreeMap<String, Vec<Collected>>> = Mutex::new(BTreeMap::new());

/// A test that panicked while it held the lock leaves nothing half done.
fn shelves() -> MutexGuard<'static, BTreeMap<String, Vec<Collected>>> {
    SHELVES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Takes away all that was collected under `name` since the last call, in order of delivery.
pub fn collected(name: &str) -> Vec<Collected> {
    shelves().remove(name).unwrap_or_default()
}

ports! {
    NUMBERS: In<Number> = each("numbers").many();
}

figures! {
    "collected": count, neither, "Numbers that came in";
}

/// Keeps all it gets for [`collected`].
pub struct Collect {
    into: String,
    count: u64,
}

impl Node for Collect {
    const TYPE: &'static str = "testkit.collect";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Keeps numbers where a test can look at them.";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = CollectSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: CollectSettings, setup: &Setup) -> Result<Self, ConfigError> {
        if setup.purpose == Purpose::Run {
            shelves().entry(settings.into.clone()).or_default();
        }
        Ok(Self { into: settings.into, count: 0 })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let now = io.now();
        while let Some(number) = io.take(&NUMBERS) {
            self.count += 1;
            let kept = Collected { now, stamp: number.stamp, number: number.value.0 };
            match shelves().get_mut(&self.into) {
                Some(shelf) => shelf.push(kept),
                None => drop(shelves().insert(self.into.clone(), vec![kept])),
            }
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.figure("collected", self.count as f64);
        Ok(())
    }
}
