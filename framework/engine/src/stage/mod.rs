//! The nodes that one worker runs: a message is carried through all of them before the next one is looked at.

mod finisher;
mod passing;
pub(crate) mod recorded;
mod recovery;

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use foveate_messages::{SourceId, Time};

use self::finisher::{FINISH_PATIENCE, Finisher, Job};
use crate::Options;
use crate::budget;
use crate::controls::{Change, Controls};
use crate::faults::FaultLog;
use crate::gates::Gates;
use crate::inbox::{DeliveryOutcome, Inbox};
use crate::ledger::Ledger;
use crate::look::Look;
use crate::slot::{EdgeEnd, Route, Slot, enter, in_words};
use crate::tap::{Activation, Event, Lane, Tap};
use foveate_node::error::NodeError;
use foveate_node::given::Table;
use foveate_node::guard::guarded;
use foveate_node::io::{Delivery, Io, Outbox, Packet};
use foveate_node::node::Due;
use foveate_node::registry::ErasedNode;
use foveate_node::report::Report;
use foveate_rig::graph::Graph;
use foveate_rig::live;

/// What a worker must do when it has put a message on another one's queue.
pub(crate) trait Remote {
    /// About to send along `edge`.
    fn sending(&mut self, edge: usize);
    /// Sent: wake the receiver.
    fn sent(&mut self, edge: usize);
    /// A message on `edge` is not on its way any more: it was dropped, or delivered on this worker.
    fn taken_back(&mut self, edge: usize);
}

/// For runs on one thread.
pub(crate) struct Alone;

impl Remote for Alone {
    fn sending(&mut self, _edge: usize) {}
    fn sent(&mut self, _edge: usize) {}
    fn taken_back(&mut self, _edge: usize) {}
}

/// Whether the costs of activations that the rig names are played out on the clock of the run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Costs {
    Simulated,
    Ignored,
}

/// What leaves a stage along an edge.
pub(crate) enum Outgoing {
    Message(usize, Packet),
    Gap(usize, SourceId),
}

/// The nodes that one worker runs. Indices are the graph's: what other workers run is `None` here.
pub(crate) struct Stage {
    graph: Arc<Graph>,
    /// Which scales are suspended; shared by all workers.
    pub(crate) gates: Arc<Gates>,
    out_dir: Option<PathBuf>,
    pub(crate) slots: Vec<Option<Slot>>,
    pub(crate) ends: Vec<Option<EdgeEnd>>,
    ready: Vec<u64>,
    /// How many bits of `ready` are set.
    n_ready: usize,
    /// Live runs: when the session began; every activation then looks at the clock.
    pub(crate) started: Option<Instant>,
    /// Capture time of what the current activation is about.
    seen: Time,
    /// Nodes that are busy, by when they are done.
    busy: BinaryHeap<Reverse<(Time, usize)>>,
    delivery: Delivery,
    outbox: Outbox,
    pub(crate) faults: FaultLog,
    /// What leaves for other stages of the same logical clock.
    pub(crate) outgoing: Vec<Outgoing>,
    /// Nodes that cannot pass on what they gave out.
    blocked: Vec<usize>,
    /// The data is over: queues have no bounds any more.
    is_flushing: bool,
    /// For who looks on from outside: the number of the present activation (upper half; more with each part that it says is done) and of its node (lower half), 0 between two of them.
    pub(crate) at: Arc<AtomicU64>,
    n_activations: u64,
    /// Messages that queues between threads dropped, to be entered in the ledgers of their edges.
    pub(crate) queue_drops: Vec<QueueDrops>,
    /// Where what happens here is recorded.
    tap: Option<Lane>,
    /// Where viewers look at what happens here.
    look: Option<Look>,
    /// What activates the present node.
    how: Activation,
}

/// What became of the messages of a queue between threads.
#[derive(Clone, Copy)]
pub(crate) struct QueueDrops {
    pub edge: usize,
    /// Messages that were sent along the edge.
    pub sent: u64,
    /// Those of them that were lost.
    pub dropped: u64,
}

impl Stage {
    /// Makes every node and connects all edges on one worker.
    ///
    /// # Errors
    /// The first instance that refuses, with its reason.
    pub(crate) fn build(graph: Arc<Graph>, out_dir: Option<PathBuf>, costs: Costs) -> Result<Stage, NodeError> {
        let node = |index| Slot::make(&graph, index, out_dir.clone());
        Stage::build_with(Arc::clone(&graph), out_dir.clone(), costs, &node)
    }

    /// As [`Stage::build`], of the nodes that `node` makes.
    ///
    /// # Errors
    /// What `node` refuses.
    pub(crate) fn build_with(
        graph: Arc<Graph>,
        out_dir: Option<PathBuf>,
        costs: Costs,
        node: &dyn Fn(usize) -> Result<Box<dyn ErasedNode>, NodeError>,
    ) -> Result<Stage, NodeError> {
        let gates = Arc::new(Gates::new(&graph));
        let mut stage = Stage::empty(Arc::clone(&graph), Arc::clone(&gates), out_dir.clone());
        for index in 0..graph.instances.len() {
            let slot = Slot::new(&graph, &gates, index, node(index)?, costs);
            for (port, edges) in slot.input_edges.iter().enumerate() {
                for (source, &edge) in edges.iter().enumerate() {
                    let from = graph.edges[edge].from.0;
                    let ledger = Ledger::behind(gates.of_scale(graph.instances[from].scale));
                    stage.ends[edge] = Some(EdgeEnd { to: (index, port), source, n_given: 0, ledger });
                }
            }
            stage.slots[index] = Some(slot);
        }
        budget::prepare(&graph, &mut stage.slots, &mut stage.ends);
        Ok(stage)
    }

    /// A stage without nodes over the same graph, to move slots into.
    pub(crate) fn empty_like(&self) -> Stage {
        Stage {
            tap: self.tap.as_ref().map(Lane::another),
            look: self.look.clone(),
            ..Stage::empty(Arc::clone(&self.graph), Arc::clone(&self.gates), self.out_dir.clone())
        }
    }

    /// Lets recorder and viewers see what happens here, and in stages that are made like this one.
    pub(crate) fn seen_by(mut self, options: &Options) -> Stage {
        self.tap = options.tap.as_ref().map(Tap::lane);
        self.look.clone_from(&options.look);
        self
    }

    /// Changes settings of node `index` between two activations.
    ///
    /// # Errors
    /// Why it goes on with those that it has.
    pub(crate) fn change(&mut self, index: usize, values: &Table, now: Time) -> Result<(), String> {
        let graph = Arc::clone(&self.graph);
        let instance = &graph.instances[index];
        let Some(slot) = &mut self.slots[index] else { return Err("it does not run here".to_owned()) };
        let Some(node) = &mut slot.node else { return Err("it has stopped".to_owned()) };
        let present = slot.settings.as_ref().unwrap_or(&instance.settings);
        let changed = live::changed(instance, &**present, values).map_err(|it| in_words(&it))?;
        match guarded(|| node.change(changed.as_any())) {
            Ok(taken) => taken.map_err(|it| in_words(&it))?,
            Err(said) => {
                self.fail(index, now, now, NodeError::program(&said), true);
                return Err(said);
            }
        }
        slot.settings = Some(Arc::from(changed));
        self.note(now, || Event::Changed { instance: index, values: values.clone() });
        Ok(())
    }

    /// Makes the changes that people want of the nodes here.
    pub(crate) fn make_changes(&mut self, controls: &Controls, now: Time) {
        for Change { instance, values, done } in controls.take(|it| self.slots[it].is_some()) {
            done(self.change(instance, &values, now));
        }
    }

    /// Records what has happened.
    #[inline]
    pub(crate) fn note(&self, now: Time, event: impl FnOnce() -> Event) {
        if let Some(tap) = &self.tap {
            tap.push(now, event());
        }
    }

    /// Without nodes.
    fn empty(graph: Arc<Graph>, gates: Arc<Gates>, out_dir: Option<PathBuf>) -> Stage {
        let (n_instances, n_edges) = (graph.instances.len(), graph.edges.len());
        Stage {
            faults: FaultLog::reporting_to(graph.host.clone()),
            graph,
            gates,
            out_dir,
            slots: (0..n_instances).map(|_| None).collect(),
            ends: (0..n_edges).map(|_| None).collect(),
            ready: vec![0; n_instances.div_ceil(64)],
            n_ready: 0,
            started: None,
            seen: Time::ZERO,
            busy: BinaryHeap::new(),
            delivery: Delivery::default(),
            outbox: Outbox::default(),
            queue_drops: Vec::new(),
            outgoing: Vec::new(),
            blocked: Vec::new(),
            is_flushing: false,
            at: Arc::default(),
            n_activations: 0,
            tap: None,
            look: None,
            how: Activation::default(),
        }
    }

    /// When source `index` is due; a stopped or foreign node never is.
    pub(crate) fn due(&mut self, index: usize, now: Time) -> Due {
        let Some(slot) = &mut self.slots[index] else { return Due::Never };
        let Some(node) = &mut slot.node else { return slot.restart_at.map_or(Due::Never, Due::At) };
        self.n_activations += 1;
        self.at.store((self.n_activations << 32) | index as u64, Ordering::Relaxed);
        match guarded(|| node.due()) {
            Ok(due) => due,
            Err(said) => {
                self.fail(index, now, now, NodeError::program(said), true);
                let slot = self.slots[index].as_ref();
                slot.map_or(Due::Never, |it| {
                    if it.node.is_some() { Due::Waiting } else { it.restart_at.map_or(Due::Never, Due::At) }
                })
            }
        }
    }

    /// Lets source `index` take its activation, and carries what it gave through the stage.
    pub(crate) fn activate_source(&mut self, index: usize, now: Time, remote: &mut dyn Remote) {
        self.delivery.port = usize::MAX;
        self.delivery.packets.clear();
        if self.slots[index].as_ref().is_some_and(|it| it.node.is_none()) {
            return self.revive(index, now);
        }
        self.how = Activation::Due;
        self.activate(index, now, remote);
        self.run_ready(now, remote);
    }

    /// Nothing is at work.
    pub(crate) fn rest(&self) {
        self.at.store(0, Ordering::Relaxed);
    }

    /// Moves the nodes of another stage over the same graph, and the ends of their edges, back into this one.
    pub(crate) fn absorb(&mut self, stage: &mut Stage) {
        for (place, slot) in self.slots.iter_mut().zip(&mut stage.slots) {
            let Some(mut slot) = slot.take() else { continue };
            for route in slot.routes_mut() {
                match *route {
                    Route::Remote { edge, dropped, sent, .. } => {
                        self.queue_drops.push(QueueDrops { edge, sent, dropped });
                        *route = Route::Here(edge);
                    }
                    Route::Beyond(edge) => *route = Route::Here(edge),
                    Route::Here(_) | Route::Gate(_) => {}
                }
            }
            *place = Some(slot);
        }
        for (place, end) in self.ends.iter_mut().zip(&mut stage.ends) {
            if let Some(end) = end.take() {
                *place = Some(end);
            }
        }
        self.faults.absorb(std::mem::take(&mut stage.faults));
        self.blocked.append(&mut stage.blocked);
        self.settle_queue_drops();
    }

    /// When the first of the busy nodes is done, and which it is.
    pub(crate) fn next_done(&self) -> Option<(Time, usize)> {
        self.busy.peek().map(|it| it.0)
    }

    /// The first of the busy nodes is done: what it gave goes on its way, and it may take what came meanwhile.
    pub(crate) fn end_work(&mut self, remote: &mut dyn Remote) {
        let Some(Reverse((now, index))) = self.busy.pop() else { return };
        let Some(slot) = &mut self.slots[index] else { return };
        let Some(work) = &mut slot.work else { return };
        work.end(&mut self.outbox);
        if slot.inboxes.iter().any(Inbox::may_trigger) {
            self.set_ready(index);
        }
        self.route(index, now, remote);
        self.run_ready(now, remote);
    }

    /// Runs nodes, first in schedule order first, until nothing is left to do.
    pub(crate) fn run_ready(&mut self, now: Time, remote: &mut dyn Remote) {
        let mut word = 0;
        while word < self.ready.len() {
            if self.ready[word] == 0 {
                word += 1;
                continue;
            }
            let index = word * 64 + self.ready[word].trailing_zeros() as usize;
            let now = self.clock(now);
            if self.take_next(index, now, false) {
                self.how = Activation::Message;
                self.activate(index, now, remote);
                word = 0; // a feedback edge may have made an earlier one ready
            }
        }
    }

    /// Enters the drops of queues in the ledgers of those edges whose consumer is here; the others are kept for later.
    fn settle_queue_drops(&mut self) {
        let (ends, tap) = (&mut self.ends, &self.tap);
        self.queue_drops.retain(|&QueueDrops { edge, sent, dropped }| match &mut ends[edge] {
            Some(end) => {
                let first = std::mem::replace(&mut end.n_given, sent);
                if let Some(tap) = tap.as_ref().filter(|_| sent > first) {
                    tap.push(Time::ZERO, Event::Lost { edge, first, count: sent - first });
                }
                end.ledger.dropped += dropped;
                // The consumer saw each of them as a number left out: the same loss, counted once.
                end.ledger.gaps = end.ledger.gaps.saturating_sub(dropped);
                false
            }
            None => true,
        });
    }

    /// At the end of the data: delivers what busy nodes hold back and sets that wait for sources which will not come; nothing
    /// costs any time any more.
    pub(crate) fn flush(&mut self, now: Time) {
        self.is_flushing = true;
        self.unblock(now, &mut Alone);
        self.run_ready(now, &mut Alone);
        while !self.busy.is_empty() {
            self.end_work(&mut Alone);
        }
        self.note(now, || Event::Ending);
        self.end_stopped(now);
        for index in 0..self.slots.len() {
            while self.slots[index].as_ref().is_some_and(Slot::is_open) && self.take_next(index, now, true) {
                self.how = Activation::Flush;
                self.activate(index, now, &mut Alone);
                self.run_ready(now, &mut Alone);
            }
        }
    }

    /// Nothing costs any time any more, and what has stopped takes nothing more.
    pub(crate) fn end_stopped(&mut self, now: Time) {
        for slot in self.slots.iter_mut().flatten() {
            slot.work = None;
            if slot.node.is_none() {
                slot.close(&mut self.ends, now);
            }
        }
    }

    /// Lets every node finish, in schedule order; failures are logged, the others still finish. One that does not come back is left behind.
    pub(crate) fn finish(&mut self, now: Time, report: &mut Report) {
        let mut finisher = Finisher::new(FINISH_PATIENCE);
        for index in 0..self.slots.len() {
            let Some(slot) = &mut self.slots[index] else { continue };
            let Some(node) = slot.node.take() else { continue };
            let Some((node, own, result)) = finisher.run(node, Job::Finish) else {
                self.left_behind(index, now, "while finishing");
                continue;
            };
            slot.node = node;
            if let Some(tap) = &self.tap {
                let error = match &result {
                    Ok(result) => result.as_ref().err().cloned(),
                    Err(said) => Some(NodeError::program(said)),
                };
                tap.push(now, Event::Finished { instance: index, report: Box::new(own.clone()), error });
            }
            let path = &self.graph.instances[index].path;
            let node_type = &self.graph.instances[index].node_type;
            let undeclared = report.absorb(path, node_type.figures, own);
            if !undeclared.is_empty() {
                let (names, name) = (undeclared.join("`, `"), node_type.name);
                report.remark(format!(
                    "{path} reports `{names}`, which its type `{name}` does not declare: unit and meaning are not known"
                ));
            }
            match result {
                Ok(Ok(())) => {}
                Ok(Err(error)) => self.faults.failure(path, now, &error, "while finishing"),
                Err(said) => self.faults.failure(path, now, &NodeError::program(said), "while finishing"),
            }
        }
        for index in 0..self.slots.len() {
            let Some(node) = self.slots[index].as_mut().and_then(|it| it.node.take()) else { continue };
            match finisher.run(node, Job::Drop) {
                Some((_, _, Err(said))) => {
                    let path = &self.graph.instances[index].path;
                    self.faults.failure(path, now, &NodeError::program(said), "while it was dropped");
                }
                Some(_) => {}
                None => self.left_behind(index, now, "while it was dropped"),
            }
        }
        for (edge, end) in self.graph.edges.iter().zip(&mut self.ends) {
            if let Some(said) = end.as_mut().and_then(|it| it.ledger.quality_fault.take()) {
                let error = NodeError::program(format_args!("the quality of a message on {} {said}", edge.name));
                self.faults.failure(&self.graph.instances[edge.from.0].path, now, &error, "left out");
            }
        }
    }

    fn left_behind(&mut self, index: usize, now: Time, when: &'static str) {
        let seconds = FINISH_PATIENCE.as_secs_f64();
        let error =
            NodeError::program(format_args!("has not come back for {seconds:.0} s: the others finish without it"));
        self.faults.failure(&self.graph.instances[index].path, now, &error, when);
    }

    /// Puts what the next activation of `index` is about into `self.delivery`, and notes whether it may have another one after that.
    fn take_next(&mut self, index: usize, now: Time, flush: bool) -> bool {
        let Some(slot) = &mut self.slots[index] else { return false };
        self.delivery.packets.clear();
        if slot.is_blocked() || slot.node.is_none() {
            self.clear_ready(index);
            return false;
        }
        let mut taken = false;
        for (port, inbox) in slot.inboxes.iter_mut().enumerate() {
            let (edges, ends) = (&slot.input_edges[port], &mut self.ends);
            let mut on_outcome =
                |source: usize, outcome: DeliveryOutcome<'_>| enter(&mut ends[edges[source]], now, outcome);
            let packets = &mut self.delivery.packets;
            taken = if flush { inbox.flush(packets, &mut on_outcome) } else { inbox.next(packets, &mut on_outcome) };
            if taken {
                self.delivery.port = port;
                break;
            }
        }
        if !slot.inboxes.iter().any(Inbox::may_trigger) {
            self.clear_ready(index);
        }
        taken
    }

    fn set_ready(&mut self, index: usize) {
        let (word, bit) = (&mut self.ready[index / 64], 1 << (index % 64));
        self.n_ready += usize::from(*word & bit == 0);
        *word |= bit;
    }

    fn clear_ready(&mut self, index: usize) {
        let (word, bit) = (&mut self.ready[index / 64], 1 << (index % 64));
        self.n_ready -= usize::from(*word & bit != 0);
        *word &= !bit;
    }

    /// The session clock of a live run; the logical one stands still.
    fn clock(&self, logical: Time) -> Time {
        self.started.map_or(logical, |it| Time(it.elapsed().as_nanos() as i64))
    }

    /// One activation of node `index` with `self.delivery`, then its messages on their way. As long as an activation gives one message to
    /// one node of this worker and nothing else waits, the activation of that node follows at once.
    fn activate(&mut self, index: usize, now: Time, remote: &mut dyn Remote) {
        let (mut at, mut now) = (index, now);
        loop {
            // One guard for the whole chain: it costs as much as a short activation.
            let chain = guarded(|| {
                loop {
                    self.process(at, now);
                    now = self.clock(now);
                    match self.pass_on(at, now) {
                        Some(next) => at = next,
                        None => return,
                    }
                }
            });
            let Err(said) = chain else { break };
            self.fail(at, self.seen, now, NodeError::program(said), true);
            match self.pass_on(at, now) {
                Some(next) => at = next,
                None => break,
            }
        }
        if let Some(work) = self.slots[at].as_mut().and_then(|slot| slot.work.as_mut()) {
            self.busy.push(Reverse((work.begin(now, &mut self.outbox), at)));
            return self.clear_ready(at);
        }
        self.route(at, now, remote);
    }

    fn process(&mut self, index: usize, now: Time) {
        self.n_activations += 1;
        self.at.store((self.n_activations << 32) | index as u64, Ordering::Relaxed);
        let Some(slot) = &mut self.slots[index] else { return };
        let Some(node) = &mut slot.node else { return };
        if let Some(tap) = &self.tap {
            let how = std::mem::take(&mut self.how);
            tap.push(now, Event::Activated { instance: index, how });
        }
        // The node takes the message out; a failure is reported with the message's own time.
        self.seen = self.delivery.packets.first().map_or(now, |packet| packet.stamp.time);
        let mut io = Io::new(
            now,
            SourceId(index as u32),
            &mut self.delivery,
            &slot.latest,
            &mut self.outbox,
            &mut slot.sequences,
        )
        .with_progress(&self.at);
        match node.process(&mut io) {
            Ok(()) => slot.restarts = 0,
            Err(error) => self.fail(index, self.seen, now, error, false),
        }
    }
}
