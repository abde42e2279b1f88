//! How messages travel: delivered on this worker, sent to another one, or kept where their consumer has no room for them.

use std::collections::VecDeque;

use crossbeam::channel::TrySendError;
use foveate_messages::{SourceId, Time};
use foveate_node::io::Packet;
use foveate_rig::graph::WhenFull;

use super::{Alone, Outgoing, Remote, Stage};
use crate::inbox::{Inbox, Put};
use crate::slot::{EdgeEnd, Parked, Route, Slot};
use crate::tap::{Activation, Event, Fate};

impl Stage {
    /// Whether the consumer of `edge` cannot take another message now, and its queue makes the producer wait.
    pub(crate) fn is_full(&self, edge: usize) -> bool {
        let queue = self.graph.edges[edge].queue;
        let Some(end) = self.ends[edge].as_ref().filter(|_| queue.when_full == WhenFull::Wait) else { return false };
        let consumer = self.slots[end.to.0].as_ref().filter(|it| it.is_blocked() && !self.is_flushing);
        consumer.is_some_and(|it| it.inboxes[end.to.1].waiting(end.source) >= queue.capacity)
    }

    /// Hands a message to the consumer of `edge`.
    pub(crate) fn deliver(&mut self, edge: usize, packet: Packet, now: Time) {
        self.deliver_numbered(edge, None, packet, now);
    }

    /// The same of a message out of a queue between threads, where others may have been lost; `number` counts those that were given out along the edge.
    pub(crate) fn deliver_numbered(&mut self, edge: usize, number: Option<u64>, packet: Packet, now: Time) {
        let Some(EdgeEnd { to: (consumer, port), n_given, .. }) = self.ends[edge] else { return };
        if self.slots[consumer].as_ref().is_some_and(|it| it.node.is_none()) {
            self.revive(consumer, now);
        }
        let Some(slot) = &self.slots[consumer] else { return };
        let is_blocked = slot.is_blocked() && !self.is_flushing;
        let is_sampled = matches!(slot.inboxes[port], Inbox::Latest);
        let fate = if slot.node.is_none() {
            Fate::Stopped
        } else if !is_sampled && !slot.is_open() {
            Fate::Suspended
        } else if is_blocked || slot.work.as_ref().is_some_and(|it| it.is_busy()) {
            Fate::PutBounded
        } else {
            Fate::Put
        };
        let number = number.unwrap_or(n_given);
        if let Some(end) = &mut self.ends[edge] {
            end.n_given = end.n_given.max(number + 1);
        }
        self.note(now, || Event::Delivered { edge, number, fate });
        self.put(edge, packet, now, fate);
    }

    /// Message `number` of an edge has come out of its queue: those before it that have not come are lost.
    pub(crate) fn come(&mut self, edge: usize, number: u64, now: Time) {
        let Some(end) = &mut self.ends[edge] else { return };
        let first = std::mem::replace(&mut end.n_given, number + 1);
        if number > first {
            self.note(now, || Event::Lost { edge, first, count: number - first });
        }
    }

    /// A message meets its fate at the consumer of `edge`.
    pub(crate) fn put(&mut self, edge: usize, packet: Packet, now: Time, fate: Fate) {
        let Some(end) = &mut self.ends[edge] else { return };
        let (consumer, port) = end.to;
        let Some(slot) = &mut self.slots[consumer] else { return };
        match fate {
            Fate::Stopped => {
                end.ledger.dropped += 1;
                return;
            }
            Fate::Suspended => return end.ledger.suspend(packet.stamp, now),
            Fate::Put | Fate::PutBounded => end.ledger.arrive(packet.stamp),
        }
        if matches!(slot.inboxes[port], Inbox::Latest) {
            end.ledger.take(packet.stamp, now, || packet.payload.quality());
            slot.latest[port][end.source] = Some(packet);
            return;
        }
        let is_busy = fate == Fate::PutBounded;
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

    /// Takes in what another stage of the same logical clock gave out, and carries it on.
    pub(crate) fn take_in(&mut self, outgoing: Outgoing, now: Time) {
        match outgoing {
            Outgoing::Message(edge, packet) => {
                self.deliver(edge, packet, now);
                self.run_ready(now, &mut Alone);
            }
            Outgoing::Gap(edge, source) => {
                self.enter_gap(edge, source, now);
            }
        }
    }

    /// Enters a declared gap in the ledger of an edge whose consumer is here.
    pub(crate) fn enter_gap(&mut self, edge: usize, source: SourceId, now: Time) {
        if let Some(end) = &mut self.ends[edge] {
            end.ledger.declare_gap(source);
            self.note(now, || Event::GapEntered { edge });
        }
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
    pub(crate) fn unblock(&mut self, now: Time, remote: &mut dyn Remote) {
        for index in std::mem::take(&mut self.blocked) {
            let Some(slot) = &mut self.slots[index] else { continue };
            let (parked, mut routes) = (std::mem::take(&mut slot.parked), std::mem::take(&mut slot.routes));
            let mut still: VecDeque<Parked> = VecDeque::new();
            for it in parked {
                // What was given out first on an edge stays first there.
                let is_held = still.iter().any(|other| (other.port, other.route) == (it.port, it.route));
                let Parked { port, route, packet } = it;
                let refused =
                    if is_held { Err(packet) } else { self.send(&mut routes[port][route], packet, now, remote, true) };
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

    /// If the activation of `index` gave one message, to one idle node of this worker that would be next anyway: hands it over and
    /// returns that node. Nearly every activation of a chain.
    pub(super) fn pass_on(&mut self, index: usize, now: Time) -> Option<usize> {
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
        if let Some(tap) = &self.tap {
            tap.emitted(index, *output, packet, now);
            tap.push(now, Event::Delivered { edge, number: end.n_given, fate: Fate::Put });
            self.how = Activation::Message;
        }
        if let Some(look) = &self.look {
            look.see(index, *output, packet);
        }
        end.n_given += 1;
        if slot.given.is_some()
            && let Some(slot) = &mut self.slots[index]
        {
            slot.give(*output, packet.stamp, now);
        }
        end.ledger.deliver(packet.stamp, now, || packet.payload.quality());
        let (_, packet) = self.outbox.packets.pop()?;
        self.delivery.port = port;
        self.delivery.packets.clear();
        self.delivery.packets.push(packet);
        Some(consumer)
    }

    pub(super) fn route(&mut self, index: usize, now: Time, remote: &mut dyn Remote) {
        if self.outbox.packets.is_empty() && self.outbox.gaps.is_empty() {
            return;
        }
        let mut outbox = std::mem::take(&mut self.outbox);
        let Some(slot) = &mut self.slots[index] else { return };
        if slot.given.is_some() {
            outbox.packets.iter().for_each(|(port, packet)| slot.give(*port, packet.stamp, now));
        }
        let mut routes = std::mem::take(&mut slot.routes);
        for (port, gap) in outbox.gaps.drain(..) {
            self.note(now, || Event::Gap { instance: index, port, gap: gap.clone() });
            for route in &routes[port] {
                let edge = match route {
                    Route::Here(edge) | Route::Remote { edge, .. } => *edge,
                    Route::Gate(_) => continue,
                    Route::Beyond(edge) => {
                        self.outgoing.push(Outgoing::Gap(*edge, SourceId(index as u32)));
                        continue;
                    }
                };
                // A gap on an edge to another worker shows there as a number left out.
                self.enter_gap(edge, SourceId(index as u32), now);
            }
            self.faults.gap(&self.graph.instances[index].path, &gap);
        }
        let mut parked: Vec<Parked> = Vec::new();
        for (port, packet) in outbox.packets.drain(..) {
            if let Some(tap) = &self.tap {
                tap.emitted(index, port, &packet, now);
            }
            if let Some(look) = &self.look {
                look.see(index, port, &packet);
            }
            let n_routes = routes[port].len();
            let mut packet = Some(packet);
            for (route, way) in routes[port].iter_mut().enumerate() {
                let Some(packet) = (if route + 1 == n_routes { packet.take() } else { packet.clone() }) else { break };
                let is_held = !parked.is_empty() && parked.iter().any(|it| (it.port, it.route) == (port, route));
                let refused = if is_held {
                    remote.sending(usize::MAX);
                    Err(packet)
                } else {
                    self.send(way, packet, now, remote, false)
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
        remote: &mut dyn Remote,
        is_counted: bool,
    ) -> Result<(), Packet> {
        let (edge, sender, receiver, when_full, dropped, sent) = match route {
            Route::Here(edge) => {
                if self.is_full(*edge) {
                    if !is_counted {
                        remote.sending(*edge);
                    }
                    return Err(packet);
                }
                self.deliver(*edge, packet, now);
                if is_counted {
                    remote.taken_back(*edge);
                }
                return Ok(());
            }
            Route::Beyond(edge) => {
                self.outgoing.push(Outgoing::Message(*edge, packet));
                return Ok(());
            }
            Route::Gate(scale) => {
                self.gates.hear(*scale, &packet);
                return Ok(());
            }
            Route::Remote { edge, sender, receiver, when_full, dropped, sent } => {
                (*edge, sender, receiver, *when_full, dropped, sent)
            }
        };
        let mut packet = packet;
        if !is_counted {
            remote.sending(edge);
        }
        let number = *sent;
        *sent += 1;
        loop {
            packet = match sender.try_send((number, packet)) {
                Ok(()) => {
                    remote.sent(edge);
                    return Ok(());
                }
                Err(TrySendError::Disconnected(_)) => {
                    *dropped += 1;
                    remote.taken_back(edge);
                    return Ok(());
                }
                Err(TrySendError::Full((_, packet))) => packet,
            };
            match when_full {
                WhenFull::DropNewest => {
                    *dropped += 1;
                    remote.taken_back(edge);
                    return Ok(());
                }
                WhenFull::DropOldest => {
                    if receiver.try_recv().is_ok() {
                        *dropped += 1;
                        remote.taken_back(edge);
                    }
                }
                WhenFull::Wait => {
                    *sent -= 1;
                    return Err(packet);
                }
            }
        }
    }
}
