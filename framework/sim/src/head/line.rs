//! The serial line to a head: every byte takes its time, and may get lost, be changed, or come from nowhere.

use std::collections::VecDeque;

use foveate_estimation::random::Random;
use foveate_messages::{Interval, Time};
use foveate_node::ConfigError;

use super::device::{Head, Tag};
use super::settings::{HeadSettings, LineSettings};

/// One way of the line: bytes and when their last bit arrives.
#[derive(Debug, Clone)]
struct Way {
    settings: LineSettings,
    random: Random,
    bytes: VecDeque<(Time, u8)>,
    free: Time,
}

impl Way {
    fn new(settings: &LineSettings, random: Random) -> Way {
        Way { settings: settings.clone(), random, bytes: VecDeque::new(), free: Time::ZERO }
    }

    /// Sends a byte, at the earliest at `now`, behind those that are still on their way.
    fn push(&mut self, now: Time, byte: u8) {
        // Start bit, eight data bits, stop bit.
        let byte_time = Interval::from_s(10.0 / self.settings.baud);
        let arrives = self.free.max(now) + byte_time;
        self.free = arrives;
        if self.random.uniform() >= self.settings.lost {
            let turned = if self.random.uniform() < self.settings.flipped { 1 << self.random.below(8) } else { 0 };
            self.bytes.push_back((arrives, byte ^ turned));
        }
        if self.random.uniform() < self.settings.inserted {
            self.bytes.push_back((arrives, self.random.below(256) as u8));
        }
    }

    /// The next byte that has arrived by `now`.
    fn pop(&mut self, now: Time) -> Option<(Time, u8)> {
        if self.bytes.front().is_some_and(|it| it.0 <= now) { self.bytes.pop_front() } else { None }
    }
}

/// A head at the end of a serial line.
#[derive(Debug, Clone)]
pub struct SerialHead {
    head: Head,
    to_head: Way,
    from_head: Way,
    plugged: bool,
}

impl SerialHead {
    /// A head that was switched on a while ago.
    ///
    /// # Errors
    /// Settings out of their ranges.
    pub fn new(head: &HeadSettings, line: &LineSettings, seed: u64) -> Result<SerialHead, ConfigError> {
        line.check()?;
        let random = Random::new(seed);
        Ok(SerialHead {
            head: Head::new(head, seed)?,
            to_head: Way::new(line, random.fork("to the head")),
            from_head: Way::new(line, random.fork("from the head")),
            plugged: true,
        })
    }

    /// The head itself.
    pub fn head(&self) -> &Head {
        &self.head
    }

    /// The head itself, to switch it off and on.
    pub fn head_mut(&mut self) -> &mut Head {
        &mut self.head
    }

    /// Whether the line is in.
    pub fn is_plugged(&self) -> bool {
        self.plugged
    }

    /// Number of bytes that are on their way, both ways.
    pub fn n_bytes(&self) -> usize {
        self.to_head.bytes.len() + self.from_head.bytes.len()
    }

    /// Pulls the line out, or puts it back in; bytes on their way are lost.
    pub fn set_plugged(&mut self, plugged: bool) {
        self.plugged = plugged;
        self.to_head.bytes.clear();
        self.from_head.bytes.clear();
    }

    /// Share of bytes that get lost, are changed, or come from nowhere, from now on.
    ///
    /// # Errors
    /// Settings out of their ranges.
    pub fn set_line(&mut self, line: &LineSettings) -> Result<(), ConfigError> {
        line.check()?;
        self.to_head.settings = line.clone();
        self.from_head.settings = line.clone();
        Ok(())
    }

    /// The controller writes at `now`, which is not before any time given earlier.
    pub fn write(&mut self, now: Time, bytes: &[u8]) {
        self.advance(now);
        if self.plugged {
            bytes.iter().for_each(|&byte| self.to_head.push(now, byte));
        }
    }

    /// The bytes that have reached the controller by `now`, since it read last.
    pub fn read(&mut self, now: Time) -> Vec<u8> {
        self.advance(now);
        std::iter::from_fn(|| self.from_head.pop(now).map(|it| it.1)).collect()
    }

    /// Lives until `to`, which is not before any time given earlier.
    pub fn advance(&mut self, to: Time) {
        while let Some((at, byte)) = self.to_head.pop(to) {
            self.head.advance(at);
            self.head.receive(Tag::default(), byte);
        }
        self.head.advance(to);
        while let Some(sent) = self.head.send() {
            if self.plugged {
                sent.bytes.iter().for_each(|&byte| self.from_head.push(sent.at, byte));
            }
        }
    }
}
