//! The nodes that one worker runs: a message is carried through all of them before the next one is looked at.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use crossbeam::channel::TrySendError;
use foveate_messages::{Interval, SourceId, Time};

use crate::faults::FaultLog;
use crate::gates::Gates;
use crate::inbox::{Fate, Inbox, Put};
use crate::ledger::Ledger;
use crate::slot::{EdgeEnd, Parked, Route, Slot, enter, in_words};
use foveate_node::error::{Blame, NodeError};
use foveate_node::guard::guarded;
use foveate_node::io::{Delivery, Io, Outbox, Packet};
use foveate_node::node::Due;
use foveate_node::report::Report;
use foveate_node::setup::Purpose;
use foveate_rig::graph::{Graph, OnError, WhenFull};

/// What a worker must do when it has put a message on another one's queue.
pub(crate) trait Away {
    /// About to send along `edge`.
    fn sending(&mut self, edge: usize);
    /// Sent: wake the receiver.
    fn sent(&mut self, edge: usize);
    /// A message on `edge` is not on its way any more: it was dropped, or delivered on this worker.
    fn taken_back(&mut self, edge: usize);
}

/// A node that fails is made anew at most so often without an activation that went well in between.
const MOST_RESTARTS: u32 = 5;
/// The first restart comes at once, the second after this time; each further one takes twice as long.
const FIRST_PAUSE: Interval = Interval(100_000_000);

/// For runs on one thread.
pub(crate) struct Alone;

impl Away for Alone {
    fn sending(&mut self, _edge: usize) {}
    fn sent(&mut self, _edge: usize) {}
    fn taken_back(&mut self, _edge: usize) {}
}

/// Whether the costs of turns that the rig names are played out on the clock of the run.
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
    /// Live runs: when the session began; every turn then looks at the clock.
    pub(crate) started: Option<Instant>,
    /// Capture time of what the current turn is about.
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
    /// For who looks on from outside: the number of the present activation (upper half) and of its node (lower half), 0 between two of them.
    pub(crate) at: Arc<AtomicU64>,
    n_activations: u64,
    /// Messages that queues between threads dropped, to be entered in the ledgers of their edges.
    pub(crate) queue_drops: Vec<(usize, u64)>,
}

impl Stage {
    /// Makes every node and connects all edges on one worker.
    ///
    /// # Errors
    /// The first instance that refuses, with its reason.
    pub(crate) fn build(graph: Arc<Graph>, out_dir: Option<PathBuf>, costs: Costs) -> Result<Stage, NodeError> {
        let gates = Arc::new(Gates::new(&graph));
        let mut slots = Vec::with_capacity(graph.instances.len());
        for index in 0..graph.instances.len() {
            slots.push(Some(Slot::build(&graph, &gates, index, out_dir.clone(), costs)?));
        }
        let mut ends: Vec<Option<EdgeEnd>> = (0..graph.edges.len()).map(|_| None).collect();
        for (consumer, slot) in slots.iter().enumerate() {
            let inputs = slot.iter().flat_map(|slot| slot.input_edges.iter().enumerate());
            for (port, edges) in inputs {
                for (source, &edge) in edges.iter().enumerate() {
                    let from = graph.edges[edge].from.0;
                    let ledger = Ledger::behind(gates.of_scale(graph.instances[from].scale));
                    ends[edge] = Some(EdgeEnd { to: (consumer, port), source, ledger });
                }
            }
        }
        let ready = vec![0; slots.len().div_ceil(64)];
        Ok(Stage {
            graph,
            gates,
            out_dir,
            slots,
            ends,
            ready,
            n_ready: 0,
            started: None,
            seen: Time::ZERO,
            busy: BinaryHeap::new(),
            delivery: Delivery::default(),
            outbox: Outbox::default(),
            faults: FaultLog::default(),
            queue_drops: Vec::new(),
            outgoing: Vec::new(),
            blocked: Vec::new(),
            is_flushing: false,
            at: Arc::default(),
            n_activations: 0,
        })
    }

    /// A stage without nodes over the same graph, to move slots into.
    pub(crate) fn empty_like(&self) -> Stage {
        Stage {
            graph: Arc::clone(&self.graph),
            gates: Arc::clone(&self.gates),
            out_dir: self.out_dir.clone(),
            slots: self.slots.iter().map(|_| None).collect(),
            ends: self.ends.iter().map(|_| None).collect(),
            ready: vec![0; self.ready.len()],
            n_ready: 0,
            started: None,
            seen: Time::ZERO,
            busy: BinaryHeap::new(),
            delivery: Delivery::default(),
            outbox: Outbox::default(),
            faults: FaultLog::default(),
            queue_drops: Vec::new(),
            outgoing: Vec::new(),
            blocked: Vec::new(),
            is_flushing: false,
            at: Arc::default(),
            n_activations: 0,
        }
    }

    /// When source `index` is due; a stopped or foreign node never is.
    pub(crate) fn due(&mut self, index: usize, now: Time) -> Due {
        let Some(slot) = &mut self.slots[index] else { return Due::Never };
        let Some(node) = &mut slot.node else { return slot.restart_at.map_or(Due::Never, Due::At) };
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

    /// Lets source `index` take its turn, and carries what it gave through the stage.
    pub(crate) fn turn_source(&mut self, index: usize, now: Time, away: &mut dyn Away) {
        self.delivery.port = usize::MAX;
        self.delivery.packets.clear();
        if self.slots[index].as_ref().is_some_and(|it| it.node.is_none()) {
            return self.revive(index, now);
        }
        self.activate(index, now, away);
        self.run_ready(now, away);
    }

    /// Whether the consumer of `edge` cannot take another message now, and its queue makes the producer wait.
    pub(crate) fn is_full(&self, edge: usize) -> bool {
        let queue = self.graph.edges[edge].queue;
        let Some(end) = self.ends[edge].as_ref().filter(|_| queue.when_full == WhenFull::Wait) else { return false };
        let consumer = self.slots[end.to.0].as_ref().filter(|it| it.is_blocked() && !self.is_flushing);
        consumer.is_some_and(|it| it.inboxes[end.to.1].waiting(end.source) >= queue.capacity)
    }

    /// Hands a message to the consumer of `edge`.
    pub(crate) fn deliver(&mut self, edge: usize, packet: Packet, now: Time) {
        let Some(end) = &self.ends[edge] else { return };
        let (consumer, port) = end.to;
        if self.slots[consumer].as_ref().is_some_and(|it| it.node.is_none()) {
            self.revive(consumer, now);
        }
        let (Some(end), Some(slot)) = (&mut self.ends[edge], &mut self.slots[consumer]) else { return };
        if slot.node.is_none() {
            end.ledger.dropped += 1;
            return;
        }
        let is_sampled = matches!(slot.inboxes[port], Inbox::Latest);
        if !is_sampled && !slot.is_open() {
            return end.ledger.suspend(packet.stamp, now);
        }
        end.ledger.arrive(packet.stamp);
        if is_sampled {
            end.ledger.take(packet.stamp, now, || packet.payload.quality());
            slot.latest[port][end.source] = Some(packet);
            return;
        }
        let is_blocked = slot.is_blocked() && !self.is_flushing;
        let is_busy = is_blocked || slot.work.as_ref().is_some_and(|it| it.is_busy());
        let put = if is_busy {
            slot.inboxes[port].put_bounded(end.source, packet, self.graph.edges[edge].queue)
        } else {
            slot.inboxes[port].put(end.source, packet)
        };
        match put {
            Put::Triggers if !is_busy => self.set_ready(consumer),
            Put::Triggers | Put::Waits => {}
            Put::Replaces | Put::Refused => end.ledger.dropped += 1,
        }
    }

    /// Capture time of what the last activation was about.
    pub(crate) fn latest(&self) -> Time {
        self.seen
    }

    /// Nothing is at work.
    pub(crate) fn rest(&self) {
        self.at.store(0, Ordering::Relaxed);
    }

    /// Takes in what another stage of the same logical clock gave out, and carries it on.
    pub(crate) fn take_in(&mut self, outgoing: Outgoing, now: Time) {
        match outgoing {
            Outgoing::Message(edge, packet) => {
                self.deliver(edge, packet, now);
                self.run_ready(now, &mut Alone);
            }
            Outgoing::Gap(edge, source) => {
                if let Some(end) = &mut self.ends[edge] {
                    end.ledger.declare_gap(source);
                }
            }
        }
    }

    /// Moves the nodes of another stage over the same graph, and the ends of their edges, back into this one.
    pub(crate) fn absorb(&mut self, stage: &mut Stage) {
        for (place, slot) in self.slots.iter_mut().zip(&mut stage.slots) {
            let Some(mut slot) = slot.take() else { continue };
            for route in slot.routes_mut() {
                match *route {
                    Route::Away { edge, dropped, .. } => {
                        self.queue_drops.push((edge, dropped));
                        *route = Route::Here(edge);
                    }
                    Route::Beyond(edge) => *route = Route::Here(edge),
                    Route::Here(_) | Route::Told(_) => {}
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

    /// Whether any node cannot pass on what it gave out.
    pub(crate) fn is_any_blocked(&self) -> bool {
        !self.blocked.is_empty()
    }

    /// Whether consumers hold node `index` up.
    pub(crate) fn is_blocked(&self, index: usize) -> bool {
        self.slots[index].as_ref().is_some_and(Slot::is_blocked)
    }

    /// Tries again to pass on what waits at nodes that are held up.
    pub(crate) fn unblock(&mut self, now: Time, away: &mut dyn Away) {
        for index in std::mem::take(&mut self.blocked) {
            let Some(slot) = &mut self.slots[index] else { continue };
            let (parked, mut routes) = (std::mem::take(&mut slot.parked), std::mem::take(&mut slot.routes));
            let mut still: VecDeque<Parked> = VecDeque::new();
            for it in parked {
                // What was given out first on an edge stays first there.
                let is_held = still.iter().any(|other| (other.port, other.route) == (it.port, it.route));
                let Parked { port, route, packet } = it;
                let refused =
                    if is_held { Err(packet) } else { self.send(&mut routes[port][route], packet, now, away, true) };
                still.extend(refused.err().map(|packet| Parked { port, route, packet }));
            }
            let is_free = still.is_empty();
            let Some(slot) = &mut self.slots[index] else { continue };
            (slot.parked, slot.routes) = (still, routes);
            if !is_free {
                self.blocked.push(index);
            } else if slot.inboxes.iter().any(Inbox::may_trigger) {
                self.set_ready(index);
            }
        }
    }

    /// When the first of the busy nodes is done, and which it is.
    pub(crate) fn next_done(&self) -> Option<(Time, usize)> {
        self.busy.peek().map(|it| it.0)
    }

    /// The first of the busy nodes is done: what it gave goes on its way, and it may take what came meanwhile.
    pub(crate) fn end_work(&mut self, away: &mut dyn Away) {
        let Some(Reverse((now, index))) = self.busy.pop() else { return };
        let Some(slot) = &mut self.slots[index] else { return };
        let Some(work) = &mut slot.work else { return };
        work.end(&mut self.outbox);
        if slot.inboxes.iter().any(Inbox::may_trigger) {
            self.set_ready(index);
        }
        self.route(index, now, away);
        self.run_ready(now, away);
    }

    /// Runs nodes, first in schedule order first, until nothing is left to do.
    pub(crate) fn run_ready(&mut self, now: Time, away: &mut dyn Away) {
        let mut word = 0;
        while word < self.ready.len() {
            if self.ready[word] == 0 {
                word += 1;
                continue;
            }
            let index = word * 64 + self.ready[word].trailing_zeros() as usize;
            let now = self.clock(now);
            if self.take_next(index, now, false) {
                self.activate(index, now, away);
                word = 0; // a feedback edge may have made an earlier one ready
            }
        }
    }

    /// Enters the drops of queues in the ledgers of those edges whose consumer is here; the others are kept for later.
    fn settle_queue_drops(&mut self) {
        let ends = &mut self.ends;
        self.queue_drops.retain(|&(edge, dropped)| match &mut ends[edge] {
            Some(end) => {
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
        for slot in self.slots.iter_mut().flatten() {
            slot.work = None;
            if slot.node.is_none() {
                slot.close(&mut self.ends, now);
            }
        }
        for index in 0..self.slots.len() {
            while self.slots[index].as_ref().is_some_and(Slot::is_open) && self.take_next(index, now, true) {
                self.activate(index, now, &mut Alone);
                self.run_ready(now, &mut Alone);
            }
        }
    }

    /// Lets every node finish, in schedule order; failures are logged, the others still finish.
    pub(crate) fn finish(&mut self, now: Time, report: &mut Report) {
        for index in 0..self.slots.len() {
            let Some(node) = self.slots[index].as_mut().and_then(|slot| slot.node.as_mut()) else { continue };
            let mut own = Report::default();
            let result = guarded(|| node.finish(&mut own));
            let path = &self.graph.instances[index].path;
            report.absorb(path, own);
            match result {
                Ok(Ok(())) => {}
                Ok(Err(error)) => self.faults.failure(path, now, &error, "while finishing"),
                Err(said) => self.faults.failure(path, now, &NodeError::program(said), "while finishing"),
            }
        }
        for index in 0..self.slots.len() {
            if let Some(Err(said)) = self.slots[index].as_mut().map(Slot::drop_node) {
                let path = &self.graph.instances[index].path;
                self.faults.failure(path, now, &NodeError::program(said), "while it was let go");
            }
        }
        for (edge, end) in self.graph.edges.iter().zip(&mut self.ends) {
            if let Some(said) = end.as_mut().and_then(|it| it.ledger.quality_fault.take()) {
                let error = NodeError::program(format_args!("the quality of a message on {} {said}", edge.name));
                self.faults.failure(&self.graph.instances[edge.from.0].path, now, &error, "left out");
            }
        }
    }

    /// Puts what the next turn of `index` is about into `self.delivery`, and notes whether it may have another one after that.
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
            let mut told = |source: usize, fate: Fate<'_>| enter(&mut ends[edges[source]], now, fate);
            let packets = &mut self.delivery.packets;
            taken = if flush { inbox.flush(packets, &mut told) } else { inbox.next(packets, &mut told) };
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

    /// One turn of node `index` with `self.delivery`, then its messages on their way. As long as a turn gives one message to
    /// one node of this worker and nothing else waits, the turn of that node follows at once.
    fn activate(&mut self, index: usize, now: Time, away: &mut dyn Away) {
        let (mut at, mut now) = (index, now);
        loop {
            // One guard for the whole chain: it costs as much as a short turn.
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
        self.route(at, now, away);
    }

    fn process(&mut self, index: usize, now: Time) {
        self.n_activations += 1;
        self.at.store((self.n_activations << 32) | index as u64, Ordering::Relaxed);
        let Some(slot) = &mut self.slots[index] else { return };
        let Some(node) = &mut slot.node else { return };
        // The node takes the message out; a failure is reported with the message's own time.
        self.seen = self.delivery.packets.first().map_or(now, |packet| packet.stamp.time);
        let mut io = Io::new(
            now,
            SourceId(index as u32),
            &mut self.delivery,
            &slot.latest,
            &mut self.outbox,
            &mut slot.sequences,
        );
        match node.process(&mut io) {
            Ok(()) => slot.restarts = 0,
            Err(error) => self.fail(index, self.seen, now, error, false),
        }
    }

    /// If the turn of `index` gave one message, to one idle node of this worker that would be next anyway: hands it over and
    /// says to whom. Nearly every turn of a chain.
    fn pass_on(&mut self, index: usize, now: Time) -> Option<usize> {
        let [(output, packet)] = &self.outbox.packets[..] else { return None };
        if self.n_ready > 0 || !self.outbox.gaps.is_empty() {
            return None;
        }
        let slot = self.slots[index].as_ref()?;
        let [Route::Here(edge)] = slot.routes[*output][..] else { return None };
        let end = self.ends[edge].as_mut()?;
        let (consumer, port) = end.to;
        let next = self.slots[consumer].as_ref()?;
        let is_free =
            next.node.is_some() && !next.is_blocked() && slot.work.is_none() && (next.is_plain || next.may_follow());
        if !is_free || !matches!(&next.inboxes[port], Inbox::Each(queue) if queue.is_empty()) {
            return None;
        }
        end.ledger.deliver(packet.stamp, now, || packet.payload.quality());
        let (_, packet) = self.outbox.packets.pop()?;
        self.delivery.port = port;
        self.delivery.packets.clear();
        self.delivery.packets.push(packet);
        Some(consumer)
    }

    fn route(&mut self, index: usize, now: Time, away: &mut dyn Away) {
        if self.outbox.packets.is_empty() && self.outbox.gaps.is_empty() {
            return;
        }
        let mut outbox = std::mem::take(&mut self.outbox);
        let Some(slot) = &mut self.slots[index] else { return };
        let mut routes = std::mem::take(&mut slot.routes);
        for (port, gap) in outbox.gaps.drain(..) {
            for route in &routes[port] {
                let edge = match route {
                    Route::Here(edge) | Route::Away { edge, .. } => *edge,
                    Route::Told(_) => continue,
                    Route::Beyond(edge) => {
                        self.outgoing.push(Outgoing::Gap(*edge, SourceId(index as u32)));
                        continue;
                    }
                };
                // A gap on an edge to another worker shows there as a number left out.
                if let Some(end) = &mut self.ends[edge] {
                    end.ledger.declare_gap(SourceId(index as u32));
                }
            }
            self.faults.gap(&self.graph.instances[index].path, &gap);
        }
        let mut parked: Vec<Parked> = Vec::new();
        for (port, packet) in outbox.packets.drain(..) {
            let n_routes = routes[port].len();
            let mut packet = Some(packet);
            for (route, way) in routes[port].iter_mut().enumerate() {
                let Some(packet) = (if route + 1 == n_routes { packet.take() } else { packet.clone() }) else { break };
                let is_held = !parked.is_empty() && parked.iter().any(|it| (it.port, it.route) == (port, route));
                let refused = if is_held {
                    away.sending(usize::MAX);
                    Err(packet)
                } else {
                    self.send(way, packet, now, away, false)
                };
                parked.extend(refused.err().map(|packet| Parked { port, route, packet }));
            }
        }
        if let Some(slot) = &mut self.slots[index] {
            slot.routes = routes;
            if !parked.is_empty() {
                slot.parked.extend(parked);
                self.blocked.push(index);
                self.clear_ready(index);
            }
        }
        self.outbox = outbox;
    }

    /// Sends a message on its way; gives it back where its queue is full and makes producers wait. `is_counted`: it was on its way before.
    fn send(
        &mut self,
        route: &mut Route,
        packet: Packet,
        now: Time,
        away: &mut dyn Away,
        is_counted: bool,
    ) -> Result<(), Packet> {
        let (edge, sender, receiver, when_full, dropped) = match route {
            Route::Here(edge) => {
                if self.is_full(*edge) {
                    if !is_counted {
                        away.sending(*edge);
                    }
                    return Err(packet);
                }
                self.deliver(*edge, packet, now);
                if is_counted {
                    away.taken_back(*edge);
                }
                return Ok(());
            }
            Route::Beyond(edge) => {
                self.outgoing.push(Outgoing::Message(*edge, packet));
                return Ok(());
            }
            Route::Told(scale) => {
                self.gates.hear(*scale, &packet);
                return Ok(());
            }
            Route::Away { edge, sender, receiver, when_full, dropped } => {
                (*edge, sender, receiver, *when_full, dropped)
            }
        };
        let mut packet = packet;
        if !is_counted {
            away.sending(edge);
        }
        loop {
            packet = match sender.try_send(packet) {
                Ok(()) => {
                    away.sent(edge);
                    return Ok(());
                }
                Err(TrySendError::Disconnected(_)) => {
                    *dropped += 1;
                    away.taken_back(edge);
                    return Ok(());
                }
                Err(TrySendError::Full(packet)) => packet,
            };
            match when_full {
                WhenFull::DropNewest => {
                    *dropped += 1;
                    away.taken_back(edge);
                    return Ok(());
                }
                WhenFull::DropOldest => {
                    if receiver.try_recv().is_ok() {
                        *dropped += 1;
                        away.taken_back(edge);
                    }
                }
                WhenFull::Wait => return Err(packet),
            }
        }
    }

    /// Applies the rig's `on_error` to a failure of node `index` at session time `now`, on a message captured at `seen`.
    fn fail(&mut self, index: usize, seen: Time, now: Time, error: NodeError, panicked: bool) {
        let graph = Arc::clone(&self.graph);
        let instance = &graph.instances[index];
        let Some(slot) = &mut self.slots[index] else { return };
        let is_worn_out = slot.restarts >= MOST_RESTARTS;
        let action = match instance.on_error {
            OnError::Stop => "stopped",
            OnError::Skip if !panicked => "message skipped",
            OnError::Skip | OnError::Restart if is_worn_out => "stopped after five restarts in vain",
            OnError::Skip | OnError::Restart => "restarted",
        };
        self.faults.failure(&instance.path, seen, &error, action);
        if action == "message skipped" {
            return;
        }
        // Before another one is made: two of them cannot hold one device.
        if let Err(said) = slot.drop_node() {
            self.faults.failure(&instance.path, seen, &NodeError::program(said), "while it was let go");
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

    /// Makes a node anew whose time has come; one that cannot be made is tried again later.
    fn revive(&mut self, index: usize, now: Time) {
        let graph = Arc::clone(&self.graph);
        let instance = &graph.instances[index];
        let Some(slot) = &mut self.slots[index] else { return };
        if slot.restart_at.is_none_or(|it| now < it) {
            return;
        }
        slot.restart_at = None;
        let setup = graph.setup(index, self.out_dir.clone(), Purpose::Run);
        let error = match guarded(|| instance.settings.build(&setup)) {
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
