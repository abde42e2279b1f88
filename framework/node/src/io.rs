//! A node's view of one activation: what arrived, what is known, what it emits.

use std::any::Any;
use std::fmt::Display;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use foveate_messages::{Message, Quality, SourceId, Stamp, Stamped, Time};

use crate::guard::guarded;
use crate::port::{In, Out};

/// Messages that a node may emit in one activation: a node that never stops emitting is stopped before it has used up the memory.
pub const MAX_MESSAGES: usize = 1 << 20;

/// A message with its type erased.
pub trait Payload: Any + Send + Sync {
    /// [`Message::quality`].
    ///
    /// # Errors
    /// The text of its panic, which is caught where the message's type comes from: a library's panics can be caught only inside that library.
    fn quality(&self) -> Result<Quality, String>;
    /// [`Message::bulk`].
    ///
    /// # Errors
    /// The text of its panic, as above.
    fn bulk(&self) -> Result<&[u8], String>;
}

impl<T: Message> Payload for T {
    fn quality(&self) -> Result<Quality, String> {
        guarded(|| Message::quality(self))
    }
    fn bulk(&self) -> Result<&[u8], String> {
        guarded(|| Message::bulk(self))
    }
}

/// A stamped message with its type erased; shared, never copied.
#[derive(Clone)]
pub struct Packet {
    /// When it was captured, and its source.
    pub stamp: Stamp,
    /// What.
    pub payload: Arc<dyn Payload>,
}

impl Packet {
    pub(crate) fn into_typed<T: Message>(self, port: &str) -> Stamped<Arc<T>> {
        let any: Arc<dyn Any + Send + Sync> = self.payload;
        match any.downcast::<T>() {
            Ok(value) => Stamped { stamp: self.stamp, value },
            Err(_) => unreachable!("port `{port}` got another type than `{}`: the graph was checked", T::NAME),
        }
    }

    /// The value, if it is of that type.
    pub fn as_typed<T: Message>(&self) -> Option<&T> {
        let any: &dyn Any = &*self.payload;
        any.downcast_ref()
    }

    fn typed<T: Message>(&self, port: &str) -> Stamped<&T> {
        let any: &dyn Any = &*self.payload;
        match any.downcast_ref::<T>() {
            Some(value) => Stamped { stamp: self.stamp, value },
            None => unreachable!("port `{port}` got another type than `{}`: the graph was checked", T::NAME),
        }
    }
}

/// What triggered one activation: the port and its packets.
#[derive(Default)]
pub struct Delivery {
    /// The input port, by its number.
    pub port: usize,
    /// One packet for `each` and `newest of each`, one for each source for `synced`.
    pub packets: Vec<Packet>,
}

/// What a node emitted in one activation.
#[derive(Default)]
pub struct Outbox {
    /// Messages, each with its output port.
    pub packets: Vec<(usize, Packet)>,
    /// Missing data, each with its output port.
    pub gaps: Vec<(usize, Gap)>,
}

/// Data that was expected and is missing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Gap {
    /// When it should have been seen.
    pub time: Time,
    /// Why it is missing.
    pub reason: String,
}

/// A node's view of one activation.
pub struct Io<'a> {
    now: Time,
    delivery: &'a mut Delivery,
    latest: &'a [Vec<Option<Packet>>],
    outbox: &'a mut Outbox,
    source: SourceId,
    sequences: &'a mut [u64],
    progress: Option<&'a AtomicU64>,
}

impl<'a> Io<'a> {
    /// For engines: the activation of node `source` at `now` by `delivery`. `latest` holds, by input port and connected source, the newest
    /// message so far; `sequences`, by output port, how many messages were numbered there.
    pub fn new(
        now: Time,
        source: SourceId,
        delivery: &'a mut Delivery,
        latest: &'a [Vec<Option<Packet>>],
        outbox: &'a mut Outbox,
        sequences: &'a mut [u64],
    ) -> Io<'a> {
        Io { now, delivery, latest, outbox, source, sequences, progress: None }
    }

    /// For engines: a counter outside that changes each time the node reports that it is still at work.
    pub fn with_progress(self, progress: &'a AtomicU64) -> Io<'a> {
        Io { progress: Some(progress), ..self }
    }
}

impl Io<'_> {
    /// The session clock at this activation: the time of delivery, not of capture.
    pub fn now(&self) -> Time {
        self.now
    }

    /// The message that triggered this activation, if it came in at `port` (an `each` or `newest of each` port).
    pub fn take<T: Message>(&mut self, port: &In<T>) -> Option<Stamped<Arc<T>>> {
        if self.delivery.port != port.index {
            return None;
        }
        self.delivery.packets.pop().map(|packet| packet.into_typed(port.name))
    }

    /// The set that triggered this activation, if it was joined at `port` (a `synced` port): at most one message a source, in
    /// the order of the sources.
    pub fn take_set<'s, T: Message>(&'s mut self, port: &In<T>) -> impl Iterator<Item = Stamped<Arc<T>>> + 's {
        let name = port.name;
        let count = if self.delivery.port == port.index { self.delivery.packets.len() } else { 0 };
        self.delivery.packets.drain(..count).map(move |packet| packet.into_typed(name))
    }

    /// The newest message at a `latest` port with one source.
    pub fn latest<T: Message>(&self, port: &In<T>) -> Option<Stamped<&T>> {
        self.latest_of_each(port).next()
    }

    /// The newest message of each source at a `latest` port; sources that gave none yet are left out.
    pub fn latest_of_each<'s, T: Message>(&'s self, port: &In<T>) -> impl Iterator<Item = Stamped<&'s T>> + 's {
        let name = port.name;
        let slots = self.latest.get(port.index).map_or(&[][..], Vec::as_slice);
        slots.iter().flatten().map(move |packet| packet.typed(name))
    }

    /// Emits `value` under the stamp of the message that it was made from.
    ///
    /// # Panics
    /// When the node's `ports` do not declare `port`, or it emitted [`MAX_MESSAGES`] already: a mistake in its source.
    pub fn emit<T: Message>(&mut self, port: &Out<T>, stamp: Stamp, value: impl Into<Arc<T>>) {
        self.check(port);
        let n_given = self.outbox.packets.len();
        assert!(n_given < MAX_MESSAGES, "gave out more than {MAX_MESSAGES} messages in one activation");
        self.outbox.packets.push((port.index, Packet { stamp, payload: value.into() }));
    }

    /// Emits `value` as seen at `time` by this node, numbered by this node: for sources, and for nodes that merge
    /// several streams into one.
    pub fn emit_at<T: Message>(&mut self, port: &Out<T>, time: Time, value: impl Into<Arc<T>>) {
        self.check(port);
        let sequence = self.sequences[port.index];
        self.sequences[port.index] += 1;
        self.emit(port, Stamp { time, source: self.source, sequence }, value);
    }

    /// Like [`Io::emit_at`] with a number of the device's own, so that what the device lost shows as a gap.
    pub fn emit_numbered<T: Message>(&mut self, port: &Out<T>, time: Time, sequence: u64, value: impl Into<Arc<T>>) {
        self.check(port);
        self.sequences[port.index] = sequence + 1;
        self.emit(port, Stamp { time, source: self.source, sequence }, value);
    }

    /// Reports progress within a long activation: a node that reports nothing for a minute is abandoned, and the run ends.
    pub fn still_working(&self) {
        if let Some(progress) = self.progress {
            progress.fetch_add(1 << 32, Ordering::Relaxed);
        }
    }

    /// For recordings: emits at output `port` what was emitted there then.
    pub fn repeat(&mut self, port: usize, packet: Packet) {
        self.outbox.packets.push((port, packet));
    }

    /// For recordings: declares the gap that was declared at output `port` then.
    pub fn repeat_gap(&mut self, port: usize, gap: Gap) {
        self.outbox.gaps.push((port, gap));
    }

    /// Declares a message as missing: the gap is counted on the port's edges and shown. Takes up one sequence number.
    pub fn gap<T: Message>(&mut self, port: &Out<T>, time: Time, reason: impl Display) {
        self.check(port);
        let n_given = self.outbox.gaps.len();
        assert!(n_given < MAX_MESSAGES, "declared more than {MAX_MESSAGES} gaps in one activation");
        self.sequences[port.index] += 1;
        self.outbox.gaps.push((port.index, Gap { time, reason: reason.to_string() }));
    }

    #[inline]
    fn check<T>(&self, port: &Out<T>) {
        let (index, name) = (port.index, port.name);
        assert!(
            index < self.sequences.len(),
            "gave out at port {index} (`{name}`), which the node's `ports` do not declare"
        );
    }
}
