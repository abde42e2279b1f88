//! Processing of replies.

use foveate::prelude::{Interval, Time};

use super::pending::{self, Part, PendingCommand};
use super::wire::{Received, Voice};
use super::{Asked, Awaited, Driver, Failure, Link, Medium, Occupant, Phase, What};
use crate::visca::{Answer, Inquiry, Packet, Refusal, Reply};

/// After this many refusals as unknown, a command is considered wrong rather than garbled on the line.
const MISREADINGS: u32 = 3;

impl Driver {
    pub(super) fn take_message(&mut self, now: Time, received: Received) {
        let asked = self.awaited.as_ref().map(|it| (it.sent_at, it.resends));
        let fits = match received.what {
            Voice::Reset => self.take_step(now, Asked::Reset),
            Voice::SequenceError => self.take_sequence_error(now, received.sequence),
            Voice::Reply(Reply::AddressSet { heads }) => self.take_address_set(now, heads),
            Voice::Reply(Reply::ClearedAll) => false,
            Voice::Reply(Reply::NetworkChange) => {
                self.greet(now);
                true
            }
            Voice::Reply(Reply::Acknowledged { socket }) => self.take_acknowledged(now, received.sequence, socket),
            Voice::Reply(Reply::Completed { socket: 0 }) => self.take_step(now, Asked::Clear),
            Voice::Reply(Reply::Completed { socket }) => self.take_completed(now, received.sequence, socket),
            Voice::Reply(Reply::Answer(packet)) => self.take_answer(now, received.sequence, &packet),
            Voice::Reply(Reply::Refused { socket, refusal }) => {
                self.take_refused(now, received.sequence, socket, refusal)
            }
        };
        if fits {
            (self.misses, self.has_noise) = (0, false);
            // What was sent twice may have been answered the first time.
            if let (Some((sent_at, 0)), None) = (asked, &self.awaited) {
                self.measure(now - sent_at);
            }
        } else {
            self.wire.count_stray();
        }
    }

    /// Whether a reply with this number answers the pending message; on a serial line any may.
    fn is_awaited(&self, sequence: Option<u32>) -> Option<&Awaited> {
        self.awaited.as_ref().filter(|it| it.sequence == sequence)
    }

    /// A step of the greeting is done.
    fn take_step(&mut self, now: Time, step: Asked) -> bool {
        if self.awaited.as_ref().is_none_or(|it| it.asked != step) {
            return false;
        }
        self.awaited = None;
        self.step_on(now, step);
        true
    }

    fn step_on(&mut self, now: Time, done: Asked) {
        match done {
            Asked::AddressSet | Asked::Reset => self.phase = Phase::Greeting(Asked::Clear),
            Asked::Clear => self.phase = Phase::Greeting(Asked::Inquiry(Inquiry::Version)),
            _ => self.be_ready(now),
        }
    }

    fn take_address_set(&mut self, now: Time, heads: u8) -> bool {
        if self.awaited.as_ref().is_none_or(|it| it.asked != Asked::AddressSet) {
            return false;
        }
        self.awaited = None;
        if self.settings.address > heads {
            self.pause_as(now, Link::NoSuchHead { heads });
        } else {
            self.step_on(now, Asked::AddressSet);
        }
        true
    }

    fn take_sequence_error(&mut self, now: Time, sequence: Option<u32>) -> bool {
        let Some(awaited) = self.is_awaited(sequence).cloned() else { return false };
        if awaited.resends == 0 {
            // It was never there before: somebody else has counted on, or the head has begun anew.
            self.greet(now);
            return true;
        }
        // The head has it; the answer was lost. A step of the greeting or an inquiry is asked again under a new number.
        self.awaited = None;
        if let Asked::Command(pending) = awaited.asked {
            self.blocked_since = None;
            self.report(now, What::Acknowledged { id: pending.id, sent_at: awaited.sent_at });
        }
        true
    }

    fn take_acknowledged(&mut self, now: Time, sequence: Option<u32>, socket: u8) -> bool {
        let Some(index) = index(socket) else { return false };
        if let Some(&Awaited { asked: Asked::Command(pending), sent_at, .. }) = self.is_awaited(sequence) {
            self.awaited = None;
            self.blocked_since = None;
            // Who was there is done, and its completion was lost.
            self.vacate(now, index);
            self.sockets[index] = Some(Occupant { pending: Some(pending), sequence });
            self.report(now, What::Acknowledged { id: pending.id, sent_at });
            return true;
        }
        if self.wire.medium() == Medium::Serial {
            // Too late: the command was given up, but the socket is taken.
            self.vacate(now, index);
            self.sockets[index] = Some(Occupant { pending: None, sequence });
        }
        false
    }

    fn take_completed(&mut self, now: Time, sequence: Option<u32>, socket: u8) -> bool {
        if sequence.is_some()
            && let Some(&Awaited { asked: Asked::Command(pending), sent_at, .. }) = self.is_awaited(sequence)
        {
            // Its acknowledgement was lost or overtaken.
            self.awaited = None;
            self.blocked_since = None;
            self.report(now, What::Acknowledged { id: pending.id, sent_at });
            self.report(now, What::Completed { id: pending.id });
            return true;
        }
        let Some(index) = index(socket) else { return false };
        let is_there = self.sockets[index].is_some_and(|it| it.sequence == sequence);
        if is_there {
            self.vacate(now, index);
        }
        is_there
    }

    /// A socket is free: its command is done.
    fn vacate(&mut self, now: Time, index: usize) {
        if let Some(Occupant { pending: Some(pending), .. }) = self.sockets[index].take() {
            self.report(now, What::Completed { id: pending.id });
        }
    }

    fn take_answer(&mut self, now: Time, sequence: Option<u32>, packet: &Packet) -> bool {
        let Some(&Awaited { asked: Asked::Inquiry(inquiry), sent_at, .. }) = self.is_awaited(sequence) else {
            return false;
        };
        let Some(answer) = inquiry.read(packet, self.profile.format()) else { return false };
        self.awaited = None;
        self.report(now, What::Answered { answer, asked_at: sent_at });
        if matches!(self.phase, Phase::Greeting(_)) {
            self.step_on(now, Asked::Inquiry(inquiry));
        }
        match answer {
            Answer::Position { pan, tilt } => self.compare(now, sent_at, Part::Motors, [pan, tilt]),
            Answer::Zoom(units) => self.compare(now, sent_at, Part::Zoom, [i32::from(units), 0]),
            _ => {}
        }
        true
    }

    /// Compares a part's reported position: if it stopped elsewhere, the command is repeated.
    fn compare(&mut self, now: Time, asked_at: Time, part: Part, seen: [i32; 2]) {
        let tolerance = i32::from(self.settings.tolerance_units);
        let (settle, most) = (Interval::from_ms(self.settings.settle_ms), self.settings.corrections);
        let is_waiting = self.pending.get(part).is_some()
            || matches!(self.awaited, Some(Awaited { asked: Asked::Command(pending), .. }) if Part::of(&pending.command) == part);
        let goal = self.goals.get(part);
        let Some(watch) = self.watch(part) else { return };
        let is_still = watch.seen.replace(seen) == Some(seen);
        let Some(goal) = goal else { return };
        let Some(destination) = pending::destination(&goal.command) else { return };
        if seen.iter().zip(destination).all(|(seen, wanted)| (seen - wanted).abs() <= tolerance) {
            watch.corrections = 0;
            return;
        }
        if is_waiting || !is_still || asked_at - watch.sent_at < settle {
            return;
        }
        if watch.corrections < most {
            watch.corrections += 1;
            self.counts.corrected += 1;
            self.pending.put(PendingCommand { since: now, ..goal });
        } else {
            self.goals.take(part);
            self.report(now, What::Failed { id: goal.id, why: Failure::NotReached(seen[0], seen[1]) });
        }
    }

    fn take_refused(&mut self, now: Time, sequence: Option<u32>, socket: u8, refusal: Refusal) -> bool {
        if matches!(refusal, Refusal::Cancelled | Refusal::NoSocket) {
            return self.take_cancelled(now, sequence, socket, refusal);
        }
        // A command in a socket may fail later than it was taken.
        if let Some(index) = index(socket)
            && self.sockets[index].is_some_and(|it| it.sequence == sequence)
        {
            if let Some(Occupant { pending: Some(pending), .. }) = self.sockets[index].take() {
                self.refused(now, pending, refusal);
            }
            return true;
        }
        let Some(asked) = self.is_awaited(sequence).map(|it| it.asked) else { return false };
        self.awaited = None;
        match asked {
            Asked::Command(pending) => self.refused(now, pending, refusal),
            // Heads that do not tell their version are heads all the same.
            Asked::Inquiry(Inquiry::Version) if matches!(self.phase, Phase::Greeting(_)) => {
                if refusal == Refusal::BufferFull {
                    self.pause(now);
                } else {
                    self.be_ready(now);
                }
            }
            Asked::Reset | Asked::AddressSet | Asked::Clear => self.pause(now),
            Asked::Cancel { .. } | Asked::Inquiry(_) => {}
        }
        true
    }

    fn refused(&mut self, now: Time, pending: PendingCommand, refusal: Refusal) {
        let part = Part::of(&pending.command);
        let is_newest = self.goals.get(part).is_some_and(|it| it.id == pending.id);
        match refusal {
            Refusal::BufferFull => {
                self.counts.buffer_full += 1;
                self.hold_until = now + Interval::from_ms(self.settings.full_wait_ms);
                self.blocked_since.get_or_insert(now);
                // It was not taken: even what must not be done twice may be sent again.
                if self.pending.get(part).is_none() {
                    self.pending.put(pending);
                }
                return;
            }
            Refusal::Syntax | Refusal::Length => {
                let times = if self.misread.0 == pending.id { self.misread.1 + 1 } else { 1 };
                self.misread = (pending.id, times);
                if times < MISREADINGS {
                    if self.pending.get(part).is_none() {
                        self.pending.put(pending);
                    }
                    return;
                }
            }
            // It may be able to later, as after it was switched on: it gets the command again when it is seen elsewhere.
            Refusal::NotExecutable if is_newest && self.is_watched(&pending) => return,
            _ => {}
        }
        if is_newest {
            self.goals.take(part);
        }
        self.report(now, What::Failed { id: pending.id, why: Failure::Refused(refusal) });
    }

    /// Whether inquiries will show that a command was not executed.
    fn is_watched(&self, pending: &PendingCommand) -> bool {
        let every_ms = match Part::of(&pending.command) {
            Part::Motors => self.settings.position_every_ms,
            Part::Zoom => self.settings.zoom_every_ms,
            _ => 0.0,
        };
        every_ms > 0.0 && pending::destination(&pending.command).is_some()
    }

    fn take_cancelled(&mut self, now: Time, sequence: Option<u32>, socket: u8, refusal: Refusal) -> bool {
        let is_answer =
            matches!(self.awaited, Some(Awaited { asked: Asked::Cancel { socket: it }, .. }) if it == socket);
        if is_answer {
            self.awaited = None;
        }
        let Some(index) = index(socket) else { return is_answer };
        let is_there = self.sockets[index].is_some_and(|it| is_answer || it.sequence == sequence);
        if is_there {
            if refusal == Refusal::NoSocket {
                self.vacate(now, index);
            } else if let Some(Occupant { pending: Some(pending), .. }) = self.sockets[index].take() {
                self.report(now, What::Failed { id: pending.id, why: Failure::Refused(refusal) });
            }
        }
        is_answer || is_there
    }
}

/// Index of a socket; heads have two.
fn index(socket: u8) -> Option<usize> {
    (1..=2).contains(&socket).then(|| usize::from(socket) - 1)
}
