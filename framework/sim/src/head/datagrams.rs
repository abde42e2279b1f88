//! A head that is reached over UDP: VISCA over IP as Sony's manuals describe it (SRG-300H).
//!
//! Each datagram has a header of eight bytes: kind, length, sequence number; a reply carries the number of what it answers. A number that is
//! not above the last one is refused, so that a datagram that was sent twice is done once.

use std::collections::VecDeque;

use foveate_dataflow::ConfigError;
use foveate_messages::Time;

use super::device::Head;
use super::settings::HeadSettings;

const COMMAND: u16 = 0x0100;
const INQUIRY: u16 = 0x0110;
const REPLY: u16 = 0x0111;
const SETTING: u16 = 0x0120;
const CONTROL: u16 = 0x0200;
const CONTROL_REPLY: u16 = 0x0201;
const RESET: u8 = 0x01;
const BAD_SEQUENCE: [u8; 2] = [0x0F, 0x01];
const BAD_KIND: [u8; 2] = [0x0F, 0x02];

/// A head on the network.
#[derive(Debug, Clone)]
pub struct NetworkHead {
    head: Head,
    last: Option<u32>,
    replies: VecDeque<Vec<u8>>,
}

impl NetworkHead {
    /// A head that was switched on a while ago.
    ///
    /// # Errors
    /// Settings out of their ranges.
    pub fn new(settings: &HeadSettings, seed: u64) -> Result<NetworkHead, ConfigError> {
        Ok(NetworkHead { head: Head::new(settings, seed)?, last: None, replies: VecDeque::new() })
    }

    /// The head itself.
    pub fn head(&self) -> &Head {
        &self.head
    }

    /// A datagram comes at `now`, which is not before any time given earlier.
    pub fn receive(&mut self, now: Time, datagram: &[u8]) {
        self.advance(now);
        let &[a, b, c, d, e, f, g, h, ref payload @ ..] = datagram else { return };
        let (kind, sequence) = (u16::from_be_bytes([a, b]), u32::from_be_bytes([e, f, g, h]));
        if usize::from(u16::from_be_bytes([c, d])) != payload.len() || !(1..=16).contains(&payload.len()) {
            return;
        }
        match kind {
            CONTROL if payload == [RESET] => {
                self.last = None;
                self.reply(CONTROL_REPLY, sequence, &[RESET]);
            }
            COMMAND | INQUIRY | SETTING => {
                // Numbers go round: above is what is less than half the circle ahead.
                let is_above = self.last.is_none_or(|last| (1..1 << 31).contains(&sequence.wrapping_sub(last)));
                if !is_above {
                    return self.reply(CONTROL, sequence, &BAD_SEQUENCE);
                }
                self.last = Some(sequence);
                payload.iter().for_each(|&byte| self.head.receive(sequence, byte));
            }
            _ => self.reply(CONTROL, sequence, &BAD_KIND),
        }
    }

    /// The next datagram that the head has sent by `now`.
    pub fn send(&mut self, now: Time) -> Option<Vec<u8>> {
        self.advance(now);
        self.replies.pop_front()
    }

    fn advance(&mut self, to: Time) {
        self.head.advance(to);
        while let Some(sent) = self.head.send() {
            self.reply(REPLY, sent.tag, &sent.bytes);
        }
    }

    fn reply(&mut self, kind: u16, sequence: u32, payload: &[u8]) {
        let length = payload.len() as u16;
        let header = [&kind.to_be_bytes()[..], &length.to_be_bytes(), &sequence.to_be_bytes()].concat();
        self.replies.push_back([&header, payload].concat());
    }
}
