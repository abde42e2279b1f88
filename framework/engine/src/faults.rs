//! What went wrong during a run, counted and with its first words kept.

use std::collections::BTreeMap;

use foveate_messages::Time;

use foveate_node::Host;
use foveate_node::error::{Blame, NodeError};
use foveate_node::io::Gap;

/// A failure of one node, with all its repetitions.
#[derive(Debug, Clone, PartialEq)]
pub struct FaultRecord {
    /// The node instance.
    pub instance: String,
    /// Whether the rig or the program is at fault.
    pub blame: Blame,
    /// What happened.
    pub message: String,
    /// What was done about it.
    pub action: &'static str,
    /// Capture time of the message that the node first failed on.
    pub time: Time,
    /// How often.
    pub count: u64,
}

/// Missing data of one node, with all its repetitions.
#[derive(Debug, Clone, PartialEq)]
pub struct GapRecord {
    /// The node instance that declared it.
    pub instance: String,
    /// Why.
    pub reason: String,
    /// When it should have been seen, first.
    pub time: Time,
    /// How often.
    pub count: u64,
}

/// Kept in full for this many different texts a node; more are counted under one heading.
const KEPT: usize = 50;
const MORE: &str = "more, with other texts";

/// Collects failures and gaps; bounded however long the run.
#[derive(Debug, Default)]
pub(crate) struct FaultLog {
    /// Reports each failure when it occurs for the first time.
    host: Host,
    faults: BTreeMap<String, Vec<FaultRecord>>,
    gaps: BTreeMap<String, Vec<GapRecord>>,
}

impl FaultLog {
    pub(crate) fn reporting_to(host: Host) -> FaultLog {
        FaultLog { host, ..FaultLog::default() }
    }

    pub(crate) fn failure(&mut self, instance: &str, time: Time, error: &NodeError, action: &'static str) {
        if !self.faults.contains_key(instance) {
            self.faults.insert(instance.to_owned(), Vec::new());
        }
        let Some(records) = self.faults.get_mut(instance) else { return };
        let message = if records.len() < KEPT { error.message.as_str() } else { MORE };
        match records.iter_mut().find(|it| it.message == message && it.action == action) {
            Some(record) => record.count += 1,
            None => {
                self.host.warn(instance, message);
                records.push(FaultRecord {
                    instance: instance.to_owned(),
                    blame: error.blame,
                    message: message.to_owned(),
                    action,
                    time,
                    count: 1,
                });
            }
        }
    }

    pub(crate) fn gap(&mut self, instance: &str, gap: &Gap) {
        if !self.gaps.contains_key(instance) {
            self.gaps.insert(instance.to_owned(), Vec::new());
        }
        let Some(records) = self.gaps.get_mut(instance) else { return };
        let reason = if records.len() < KEPT { gap.reason.as_str() } else { MORE };
        match records.iter_mut().find(|it| it.reason == reason) {
            Some(record) => record.count += 1,
            None => records.push(GapRecord {
                instance: instance.to_owned(),
                reason: reason.to_owned(),
                time: gap.time,
                count: 1,
            }),
        }
    }

    /// Takes over what another worker logged.
    pub(crate) fn absorb(&mut self, other: FaultLog) {
        for (instance, records) in other.faults {
            self.faults.entry(instance).or_default().extend(records);
        }
        for (instance, records) in other.gaps {
            self.gaps.entry(instance).or_default().extend(records);
        }
    }

    /// All records, by instance.
    pub(crate) fn into_records(self) -> (Vec<FaultRecord>, Vec<GapRecord>) {
        (self.faults.into_values().flatten().collect(), self.gaps.into_values().flatten().collect())
    }
}
