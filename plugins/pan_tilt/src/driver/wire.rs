//! Packets on a serial line, and in numbered datagrams.

use crate::visca::ip::{self, Datagram, Kind};
use crate::visca::{Address, Format, Framer, OutOfRange, Reply, Request};

/// Kind of the line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Medium {
    /// A stream of bytes in which each head has an address.
    Serial,
    /// UDP datagrams with a header each; one head.
    Ip,
}

/// Bytes that are sent together: a whole packet, or a whole datagram.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frame(pub Vec<u8>);

/// A received message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Received {
    /// Over IP: the number of the message that it answers.
    pub sequence: Option<u32>,
    pub what: Voice,
}

/// Kinds of received messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Voice {
    Reply(Reply),
    /// The sequence numbers restart.
    Reset,
    /// The number was used before: its message has been executed.
    SequenceError,
}

/// Writes requests and reads replies.
#[derive(Debug, Clone)]
pub(super) struct Wire {
    medium: Medium,
    address: Address,
    format: Format,
    framer: Framer,
    sequence: u32,
    stray: u64,
    garbage: u64,
}

impl Wire {
    pub(super) fn new(medium: Medium, address: Address, format: Format) -> Wire {
        let address = if medium == Medium::Ip { Address::FIRST } else { address };
        Wire { medium, address, format, framer: Framer::default(), sequence: 0, stray: 0, garbage: 0 }
    }

    pub(super) fn medium(&self) -> Medium {
        self.medium
    }

    /// The frame of a request, with its own sequence number.
    pub(super) fn write(&mut self, request: &Request) -> Result<(Frame, Option<u32>), OutOfRange> {
        let packet = request.encode(self.address, self.format)?;
        Ok(match self.medium {
            Medium::Serial => (Frame(packet.bytes().to_vec()), None),
            Medium::Ip => {
                let sequence = self.sequence;
                self.sequence = sequence.wrapping_add(1);
                let datagram = Datagram { kind: Kind::of(request), sequence, payload: packet.bytes() };
                (Frame(datagram.encode()), Some(sequence))
            }
        })
    }

    /// The frame that restarts the sequence numbers: the next request has number 0.
    pub(super) fn write_reset(&mut self) -> Frame {
        self.sequence = 0;
        Frame(Datagram { kind: Kind::Control, sequence: 0, payload: ip::RESET }.encode())
    }

    /// The messages in bytes that came together.
    pub(super) fn read(&mut self, bytes: &[u8], into: &mut Vec<Received>) {
        match self.medium {
            Medium::Serial => {
                for &byte in bytes {
                    let Some(packet) = self.framer.push(byte) else { continue };
                    match Reply::decode(&packet, self.address.number()) {
                        Some(reply) => into.push(Received { sequence: None, what: Voice::Reply(reply) }),
                        None => self.stray += 1,
                    }
                }
            }
            Medium::Ip => match Datagram::decode(bytes) {
                Ok(datagram) => match voice(&datagram, self.address) {
                    Some(what) => into.push(Received { sequence: Some(datagram.sequence), what }),
                    None => self.stray += 1,
                },
                Err(_) => self.garbage += bytes.len() as u64,
            },
        }
    }

    /// Counts a received message that matches nothing.
    pub(super) fn count_stray(&mut self) {
        self.stray += 1;
    }

    /// Discards an incomplete packet, as after the line was cut.
    pub(super) fn cut(&mut self) {
        self.framer.discard();
    }

    /// Packets that match nothing, bytes in no packet.
    pub(super) fn counts(&self) -> (u64, u64) {
        (self.stray, self.garbage + self.framer.discarded())
    }
}

fn voice(datagram: &Datagram<'_>, address: Address) -> Option<Voice> {
    match datagram.kind {
        Kind::Reply => Reply::decode(&datagram.packet()?, address.number()).map(Voice::Reply),
        Kind::ControlReply if datagram.payload == ip::RESET => Some(Voice::Reset),
        // Manuals show errors as control messages, some heads send them as replies to such.
        Kind::Control | Kind::ControlReply if datagram.payload == ip::SEQUENCE_ERROR => Some(Voice::SequenceError),
        _ => None,
    }
}
