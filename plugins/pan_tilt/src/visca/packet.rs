//! One VISCA packet, and packets found in a stream of bytes.

use std::fmt;

use super::VISCA_END;

/// Header, message and terminator together, at most [bytes].
pub const LONGEST: usize = 16;

/// A whole packet: a header of 0x80 or above, 1 to 14 bytes of message, the terminator 0xFF.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Packet {
    bytes: [u8; LONGEST],
    length: usize,
}

impl Packet {
    /// The packet in `bytes`; `None` unless they are one packet and nothing else.
    pub fn from_bytes(bytes: &[u8]) -> Option<Packet> {
        let (&header, rest) = bytes.split_first()?;
        let (&end, message) = rest.split_last()?;
        let is_packet = (0x80..VISCA_END).contains(&header) && end == VISCA_END && !message.contains(&VISCA_END);
        if !is_packet || message.is_empty() || bytes.len() > LONGEST {
            return None;
        }
        let mut packet = Packet { bytes: [0; LONGEST], length: bytes.len() };
        packet.bytes[..bytes.len()].copy_from_slice(bytes);
        Some(packet)
    }

    /// All bytes, as they go over the line.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }

    /// The first byte: sender and receiver.
    pub fn header(&self) -> u8 {
        self.bytes[0]
    }

    /// What lies between header and terminator.
    pub fn message(&self) -> &[u8] {
        &self.bytes[1..self.length - 1]
    }
}

impl fmt::Debug for Packet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, byte) in self.bytes().iter().enumerate() {
            write!(f, "{}{byte:02X}", if index == 0 { "" } else { " " })?;
        }
        Ok(())
    }
}

/// Finds the packets of a head in a stream with other bytes.
///
/// After its header, a head's reply contains no byte of 0x80 or above except the terminator. Such a byte therefore begins a new
/// packet: after a lost terminator only the packet that lost it is lost.
#[derive(Debug, Clone, Default)]
pub struct Framer {
    begun: Vec<u8>,
    discarded: u64,
}

impl Framer {
    /// Takes the next byte of the stream; gives the packet that ends with it.
    pub fn push(&mut self, byte: u8) -> Option<Packet> {
        match byte {
            VISCA_END => {
                self.begun.push(byte);
                let packet = Packet::from_bytes(&self.begun);
                if packet.is_none() {
                    self.discarded += self.begun.len() as u64;
                }
                self.begun.clear();
                packet
            }
            0x80.. => {
                self.discard();
                self.begun.push(byte);
                None
            }
            _ if self.begun.is_empty() => {
                self.discarded += 1;
                None
            }
            _ => {
                self.begun.push(byte);
                if self.begun.len() == LONGEST {
                    self.discard();
                }
                None
            }
        }
    }

    /// Discards an incomplete packet, as after the line was cut.
    pub fn discard(&mut self) {
        self.discarded += self.begun.len() as u64;
        self.begun.clear();
    }

    /// Bytes so far that belonged to no packet.
    pub fn discarded(&self) -> u64 {
        self.discarded
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The packets in `stream` and the number of bytes in none.
    fn found(stream: &[u8]) -> (Vec<Vec<u8>>, u64) {
        let mut framer = Framer::default();
        let packets = stream.iter().filter_map(|&byte| framer.push(byte)).map(|it| it.bytes().to_vec()).collect();
        framer.discard();
        (packets, framer.discarded())
    }

    #[test]
    fn packets_are_found_between_garbage() {
        let ack = vec![0x90, 0x41, 0xFF];
        assert_eq!(found(&[0x90, 0x41, 0xFF]), (vec![ack.clone()], 0));
        assert_eq!(found(&[0x03, 0xFF, 0x90, 0x41, 0xFF, 0x12]), (vec![ack.clone()], 3));
        assert_eq!(found(&[0x90, 0x90, 0x41, 0xFF]), (vec![ack.clone()], 1));
        assert_eq!(found(&[0x90, 0xFF, 0x90, 0x41, 0xFF]), (vec![ack], 2));
    }

    #[test]
    fn a_lost_terminator_costs_one_packet() {
        let second = vec![0x90, 0x51, 0xFF];
        assert_eq!(found(&[0x90, 0x41, 0x90, 0x51, 0xFF]), (vec![second], 2));
    }

    #[test]
    fn a_packet_without_end_is_dropped_and_the_next_found() {
        let mut stream = vec![0x90];
        stream.extend([0x01; 40]);
        stream.extend([0xFF, 0x90, 0x41, 0xFF]);
        assert_eq!(found(&stream), (vec![vec![0x90, 0x41, 0xFF]], 42));
        let longest: Vec<u8> = [vec![0x90], vec![0x01; 14], vec![0xFF]].concat();
        assert_eq!(found(&longest), (vec![longest.clone()], 0));
    }

    proptest! {
        #[test]
        fn any_stream_gives_packets_only_and_loses_no_byte(stream in prop::collection::vec(any::<u8>(), 0..400)) {
            let (packets, discarded) = found(&stream);
            prop_assert!(packets.iter().all(|it| Packet::from_bytes(it).is_some()));
            prop_assert_eq!(packets.iter().map(Vec::len).sum::<usize>() as u64 + discarded, stream.len() as u64);
        }

        #[test]
        fn the_second_packet_after_any_garbage_is_found(
            garbage in prop::collection::vec(any::<u8>(), 0..60),
            message in prop::collection::vec(0u8..0x80, 1..=14),
        ) {
            let packet = [&[0x90], &message[..], &[0xFF]].concat();
            let (packets, _) = found(&[&garbage[..], &packet[..]].concat());
            prop_assert_eq!(packets.last(), Some(&packet));
        }
    }
}
