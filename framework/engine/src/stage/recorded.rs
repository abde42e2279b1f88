//! Stages that follow a recording: nothing runs by itself, and each step comes from outside.

use std::collections::VecDeque;

use foveate_messages::{SourceId, Time};
use foveate_node::error::NodeError;
use foveate_node::guard::guarded;
use foveate_node::io::{Gap, Packet};

use super::Stage;
use crate::slot::Route;
use crate::tap::{Activation, Fate};

/// What a node has given out and the recording has not mentioned yet.
#[derive(Default)]
pub(crate) struct Given {
    pub packets: VecDeque<(usize, Packet)>,
    pub gaps: VecDeque<(usize, Gap)>,
}

impl Stage {
    /// Activates node `index` as it was then, with what its ports hold now; what it gives out is added to `given`. `false`: there is nothing to activate it.
    pub(crate) fn repeat(&mut self, index: usize, how: Activation, now: Time, given: &mut Given) -> bool {
        match how {
            Activation::Due => {
                self.delivery.port = usize::MAX;
                self.delivery.packets.clear();
            }
            Activation::Message | Activation::Flush => {
                if !self.take_next(index, now, how == Activation::Flush) {
                    return false;
                }
            }
        }
        if let Err(said) = guarded(|| self.process(index, now)) {
            self.fail(index, self.seen, now, NodeError::program(said), true);
        }
        self.delivery.packets.clear();
        given.packets.extend(self.outbox.packets.drain(..));
        given.gaps.extend(self.outbox.gaps.drain(..));
        self.rest();
        true
    }

    /// A message leaves output `port` of node `index` at session time `now`, along some edges; one of an anchor turns the gates of its scale.
    pub(crate) fn leave(
        &mut self,
        (index, port): (usize, usize),
        packet: &Packet,
        now: Time,
        mut along: impl FnMut(usize),
    ) {
        if let Some(look) = &self.look {
            look.see(index, port, packet);
        }
        let Some(slot) = &mut self.slots[index] else { return };
        slot.give(port, packet.stamp, now);
        for route in slot.routes.get(port).into_iter().flatten() {
            match route {
                Route::Gate(scale) => self.gates.hear(*scale, packet),
                Route::Here(edge) | Route::Beyond(edge) | Route::Remote { edge, .. } => along(*edge),
            }
        }
    }

    /// A message meets the fate that it met then; `false` where its consumer has stopped only now, or only then.
    pub(crate) fn meet(&mut self, edge: usize, packet: Packet, fate: Fate, now: Time) -> bool {
        let Some(consumer) = self.ends[edge].as_ref().map(|it| it.to.0) else { return false };
        let has_node = |stage: &Stage| stage.slots[consumer].as_ref().is_some_and(|it| it.node.is_some());
        if !has_node(self) {
            self.revive(consumer, now);
        }
        let is_same = has_node(self) == (fate != Fate::Stopped);
        self.put(edge, packet, now, fate);
        is_same
    }

    /// A node that is not made failed then, and the rig let it stop.
    pub(crate) fn stop(&mut self, index: usize, now: Time) {
        if let Some(slot) = &mut self.slots[index] {
            slot.node = None;
            slot.close(&mut self.ends, now);
        }
    }

    /// Messages of an edge were lost in a queue then.
    pub(crate) fn lose(&mut self, lost: &[u64]) {
        for (end, &count) in self.ends.iter_mut().zip(lost).filter(|it| *it.1 > 0) {
            let Some(end) = end else { continue };
            end.ledger.dropped += count;
            end.ledger.gaps = end.ledger.gaps.saturating_sub(count);
        }
    }

    /// As the recording says: a gap that was entered in the ledger of an edge.
    pub(crate) fn repeat_gap(&mut self, edge: usize, now: Time) {
        let from = self.graph.edges[edge].from.0;
        self.enter_gap(edge, SourceId(from as u32), now);
    }
}
