//! VISCA over IP: the eight bytes before each packet in its UDP datagram, and the messages about the numbering itself.
//!
//! | bytes | meaning |
//! |---|---|
//! | 0, 1 | kind |
//! | 2, 3 | length of what follows the header, 1 to 16 |
//! | 4 … 7 | sequence number of the controller; a reply carries that of what it answers |

use super::packet::LONGEST;
use super::{Packet, Request};

/// The port that heads listen on.
pub const PORT: u16 = 52_381;
/// Length of the header [bytes].
pub const HEADER: usize = 8;

/// Content of a datagram.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "the names say it")]
pub enum Kind {
    Command = 0x0100,
    Inquiry = 0x0110,
    Reply = 0x0111,
    DeviceSetting = 0x0120,
    Control = 0x0200,
    ControlReply = 0x0201,
}

impl Kind {
    /// The kind of a request's datagram.
    pub fn of(request: &Request) -> Kind {
        match request {
            Request::Inquiry(_) => Kind::Inquiry,
            Request::AddressSet | Request::ClearAll => Kind::DeviceSetting,
            Request::Clear | Request::Cancel { .. } | Request::Command(_) => Kind::Command,
        }
    }
}

/// A decoded datagram.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Datagram<'a> {
    /// What it carries.
    pub kind: Kind,
    /// The controller's number.
    pub sequence: u32,
    /// A packet, or one of [`RESET`], [`SEQUENCE_ERROR`], [`KIND_ERROR`].
    pub payload: &'a [u8],
}

/// Control: count from 0 again. The reply carries the same byte.
pub const RESET: &[u8] = &[0x01];
/// From the head: the number was used before, or is not the next one.
pub const SEQUENCE_ERROR: &[u8] = &[0x0F, 0x01];
/// From the head: that kind of message is unknown.
pub const KIND_ERROR: &[u8] = &[0x0F, 0x02];

/// Why bytes are no datagram of VISCA over IP.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NoDatagram {
    /// Shorter than header and one byte, or longer than header and a packet.
    #[error("{0} bytes, expected 9 to 24")]
    Length(usize),
    /// The length in the header is not that of the rest.
    #[error("the header promises {promised} bytes, {found} follow")]
    Promise {
        /// What the header says.
        promised: usize,
        /// What is there.
        found: usize,
    },
    /// An unknown kind.
    #[error("kind {0:#06x} is not known")]
    Kind(u16),
}

impl<'a> Datagram<'a> {
    /// Decodes a datagram.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn decode(bytes: &'a [u8]) -> Result<Datagram<'a>, NoDatagram> {
        if !(HEADER + 1..=HEADER + LONGEST).contains(&bytes.len()) {
            return Err(NoDatagram::Length(bytes.len()));
        }
        let (header, payload) = bytes.split_at(HEADER);
        let word = |at: usize| u16::from_be_bytes([header[at], header[at + 1]]);
        let promised = usize::from(word(2));
        if promised != payload.len() {
            return Err(NoDatagram::Promise { promised, found: payload.len() });
        }
        let kinds = [Kind::Command, Kind::Inquiry, Kind::Reply, Kind::DeviceSetting, Kind::Control, Kind::ControlReply];
        let kind = kinds.into_iter().find(|&it| it as u16 == word(0)).ok_or(NoDatagram::Kind(word(0)))?;
        let sequence = u32::from_be_bytes([header[4], header[5], header[6], header[7]]);
        Ok(Datagram { kind, sequence, payload })
    }

    /// The bytes of the datagram.
    pub fn encode(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(HEADER + self.payload.len());
        bytes.extend((self.kind as u16).to_be_bytes());
        bytes.extend((self.payload.len() as u16).to_be_bytes());
        bytes.extend(self.sequence.to_be_bytes());
        bytes.extend(self.payload);
        bytes
    }

    /// The packet in it.
    pub fn packet(&self) -> Option<Packet> {
        Packet::from_bytes(self.payload)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_datagram_is_laid_out_as_the_manual_says() {
        let home = [0x81, 0x01, 0x06, 0x04, 0xFF];
        let bytes = Datagram { kind: Kind::Command, sequence: 0x0102_0304, payload: &home }.encode();
        assert_eq!(bytes, [0x01, 0x00, 0x00, 0x05, 1, 2, 3, 4, 0x81, 0x01, 0x06, 0x04, 0xFF]);
        assert_eq!(Datagram::decode(&bytes).map(|it| it.payload), Ok(&home[..]));
    }

    #[test]
    fn what_is_no_datagram_is_told_apart() {
        assert_eq!(Datagram::decode(&[0; 8]), Err(NoDatagram::Length(8)));
        assert_eq!(Datagram::decode(&[0; 25]), Err(NoDatagram::Length(25)));
        let promise = [1, 0, 0, 2, 0, 0, 0, 0, 0xFF];
        assert_eq!(Datagram::decode(&promise), Err(NoDatagram::Promise { promised: 2, found: 1 }));
        assert_eq!(Datagram::decode(&[3, 0, 0, 1, 0, 0, 0, 0, 0xFF]), Err(NoDatagram::Kind(0x0300)));
    }

    proptest! {
        #[test]
        fn any_bytes_are_taken(bytes in prop::collection::vec(any::<u8>(), 0..40)) {
            if let Ok(datagram) = Datagram::decode(&bytes) {
                prop_assert_eq!(datagram.encode(), bytes);
            }
        }
    }
}
