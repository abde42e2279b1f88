//! Recovery from failures of a node: stop, skip or restart, as the rig says.

use std::sync::Arc;

use foveate_messages::{Interval, Time};
use foveate_node::error::{Blame, NodeError};
use foveate_node::guard::guarded;
use foveate_node::setup::Purpose;
use foveate_rig::graph::OnError;

use super::Stage;
use crate::inbox::Inbox;
use crate::slot::in_words;
use crate::tap::Event;

/// Restarts of a failing node, at most, without a successful activation in between.
const MOST_RESTARTS: u32 = 5;
/// The first restart comes at once, the second after this time; each further one takes twice as long.
const FIRST_PAUSE: Interval = Interval(100_000_000);

impl Stage {
    /// Applies the rig's `on_error` to a failure of node `index` at session time `now`, on a message captured at `seen`.
    pub(super) fn fail(&mut self, index: usize, seen: Time, now: Time, error: NodeError, panicked: bool) {
        let graph = Arc::clone(&self.graph);
        let instance = &graph.instances[index];
        let Some(slot) = &mut self.slots[index] else { return };
        let is_worn_out = slot.restarts >= MOST_RESTARTS;
        let action = match instance.on_error {
            OnError::Stop => "stopped",
            OnError::Skip if !panicked => "message skipped",
            OnError::Skip | OnError::Restart if is_worn_out => "stopped after five failed restarts",
            OnError::Skip | OnError::Restart => "restarted",
        };
        self.faults.failure(&instance.path, seen, &error, action);
        if let Some(tap) = &self.tap {
            tap.push(now, Event::Failed { instance: index, seen, error, action });
        }
        if action == "message skipped" {
            return;
        }
        // Before another one is made: two of them cannot hold one device.
        if let Err(said) = slot.drop_node() {
            self.faults.failure(&instance.path, seen, &NodeError::program(said), "while it was dropped");
        }
        if action != "restarted" {
            return slot.close(&mut self.ends, seen);
        }
        let pause = match slot.restarts {
            0 => Interval(0),
            before => Interval(FIRST_PAUSE.0 << (before - 1)),
        };
        slot.restarts += 1;
        slot.restart_at = Some(now + pause);
        self.revive(index, now);
    }

    /// Restarts a node whose time has come; one that cannot be made is tried again later.
    pub(super) fn revive(&mut self, index: usize, now: Time) {
        let graph = Arc::clone(&self.graph);
        let instance = &graph.instances[index];
        let Some(slot) = &mut self.slots[index] else { return };
        if slot.restart_at.is_none_or(|it| now < it) {
            return;
        }
        slot.restart_at = None;
        let setup = graph.setup(index, self.out_dir.clone(), Purpose::Run);
        let settings = slot.settings.as_ref().unwrap_or(&instance.settings);
        let error = match guarded(|| settings.build(&setup)) {
            Ok(Ok(node)) => {
                slot.node = Some(node);
                if slot.inboxes.iter().any(Inbox::may_trigger) {
                    self.set_ready(index);
                }
                return;
            }
            Ok(Err(refusal)) => {
                NodeError { blame: Blame::Input, message: format!("cannot be restarted: {}", in_words(&refusal)) }
            }
            Err(said) => NodeError::program(format_args!("cannot be restarted: {said}")),
        };
        self.fail(index, now, now, error, true);
    }
}
