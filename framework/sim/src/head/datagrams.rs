//! A head that is reached over UDP: VISCA over IP as Sony's manuals describe it (SRG-300H).
//!
//! Each datagram has a header of eight bytes: kind, length, sequence number; a reply carries the number of what it answers, and goes to its
//! sender. A number that is not above the last one of the same controller is refused, so that a datagram that was sent twice is done once.
//!
//! | a datagram | is answered |
//! |---|---|
//! | of an unknown kind, whose length is not as stated, or empty | control error `0F 02` |
//! | with a number that is not above the last one | control error `0F 01` |
//! | with more than 16 bytes of message | message length error, `90 60 01 FF` |
//! | whose message has no header or no end | syntax error, `90 60 02 FF` |
//! | for another address than 1 | with nothing: it is another head's |
//! | of less than eight bytes, or that reports an error | with nothing |

use std::collections::VecDeque;
use std::net::SocketAddr;

use foveate_messages::Time;
use foveate_node::ConfigError;

use super::device::{Head, Tag};
use super::settings::HeadSettings;

const COMMAND: u16 = 0x0100;
const INQUIRY: u16 = 0x0110;
const REPLY: u16 = 0x0111;
const SETTING: u16 = 0x0120;
const CONTROL: u16 = 0x0200;
const CONTROL_REPLY: u16 = 0x0201;
const RESET: u8 = 0x01;
/// First byte of a report of an error.
const ERROR: u8 = 0x0F;
const BAD_SEQUENCE: [u8; 2] = [ERROR, 0x01];
const BAD_MESSAGE: [u8; 2] = [ERROR, 0x02];
/// Controllers whose last number is remembered.
const CONTROLLERS: usize = 64;

/// A head on the network.
#[derive(Debug, Clone)]
pub struct NetworkHead {
    head: Head,
    /// The last number of each controller, the most recent controller at the end.
    last: VecDeque<(Option<SocketAddr>, u32)>,
    replies: VecDeque<(Option<SocketAddr>, Vec<u8>)>,
}

impl NetworkHead {
    /// A head that was switched on a while ago.
    ///
    /// # Errors
    /// Settings out of their ranges.
    pub fn new(settings: &HeadSettings, seed: u64) -> Result<NetworkHead, ConfigError> {
        let mut head = Head::new(settings, seed)?;
        head.fix_address();
        Ok(NetworkHead { head, last: VecDeque::new(), replies: VecDeque::new() })
    }

    /// The head itself.
    pub fn head(&self) -> &Head {
        &self.head
    }

    /// A datagram of the only controller comes at `now`, which is not before any time given earlier.
    pub fn receive(&mut self, now: Time, datagram: &[u8]) {
        self.hear(now, None, datagram);
    }

    /// A datagram of `controller`, one of several, comes at `now`, which is not before any time given earlier.
    pub fn receive_from(&mut self, now: Time, controller: SocketAddr, datagram: &[u8]) {
        self.hear(now, Some(controller), datagram);
    }

    fn hear(&mut self, now: Time, controller: Option<SocketAddr>, datagram: &[u8]) {
        self.advance(now);
        let &[a, b, c, d, e, f, g, h, ref payload @ ..] = datagram else { return };
        let (kind, sequence) = (u16::from_be_bytes([a, b]), u32::from_be_bytes([e, f, g, h]));
        let tag = Tag { controller, sequence };
        let is_known = matches!(kind, COMMAND | INQUIRY | SETTING | CONTROL);
        if !is_known || payload.is_empty() || usize::from(u16::from_be_bytes([c, d])) != payload.len() {
            return self.reply(CONTROL, tag, &BAD_MESSAGE);
        }
        match (kind, payload[0]) {
            (CONTROL, RESET) if payload.len() == 1 => {
                // A client may ask from one port and command from another: both begin anew.
                let host = |it: Option<SocketAddr>| it.map(|it| it.ip());
                self.last.retain(|it| host(it.0) != host(controller));
                self.reply(CONTROL_REPLY, tag, &[RESET]);
            }
            // Errors are not answered with errors: two heads would never end.
            (CONTROL, ERROR) => {}
            (CONTROL, _) => self.reply(CONTROL, tag, &BAD_MESSAGE),
            _ if !self.is_next(tag) => self.reply(CONTROL, tag, &BAD_SEQUENCE),
            (_, 0x81..=0x88) => self.head.receive_whole(tag, payload),
            _ => self.head.refuse_syntax(tag),
        }
    }

    /// Whether this number is above the last one of its controller, whose last one it then is.
    fn is_next(&mut self, tag: Tag) -> bool {
        let known = self.last.iter().position(|it| it.0 == tag.controller);
        // Numbers go round: above is what is less than half the circle ahead.
        let is_above = |last: u32| (1..1 << 31).contains(&tag.sequence.wrapping_sub(last));
        if known.is_some_and(|index| !is_above(self.last[index].1)) {
            return false;
        }
        match known {
            Some(index) => drop(self.last.remove(index)),
            None if self.last.len() == CONTROLLERS => drop(self.last.pop_front()),
            None => {}
        }
        self.last.push_back((tag.controller, tag.sequence));
        true
    }

    /// The next datagram that the head has sent by `now`.
    pub fn send(&mut self, now: Time) -> Option<Vec<u8>> {
        self.send_to(now).map(|it| it.1)
    }

    /// The next datagram that the head has sent by `now`, and to which of several controllers; `None` for the only one.
    pub fn send_to(&mut self, now: Time) -> Option<(Option<SocketAddr>, Vec<u8>)> {
        self.advance(now);
        self.replies.pop_front()
    }

    fn advance(&mut self, to: Time) {
        self.head.advance(to);
        while let Some(sent) = self.head.send() {
            self.reply(REPLY, sent.tag, &sent.bytes);
        }
    }

    fn reply(&mut self, kind: u16, tag: Tag, payload: &[u8]) {
        let length = payload.len() as u16;
        let header = [&kind.to_be_bytes()[..], &length.to_be_bytes(), &tag.sequence.to_be_bytes()].concat();
        self.replies.push_back((tag.controller, [&header, payload].concat()));
    }
}
