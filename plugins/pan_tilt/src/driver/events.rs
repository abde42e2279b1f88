//! What a driver reports.

use foveate::prelude::{Interval, Time};

use crate::visca::{Answer, Command, Refusal};

/// Numbers the commands of one driver, from 1 in the order in which they were given.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CommandId(pub u64);

/// How things are between driver and head.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Link {
    /// The port is not open, and why; it is tried again.
    Closed(String),
    /// The port is open, the head has not answered yet.
    Greeting,
    /// The head answers.
    Ready,
    /// Nothing comes back. It is greeted again and again.
    Silent,
    /// Bytes come back that mean nothing: another speed of the line, another device. It is greeted again and again.
    Garbled,
    /// The line has fewer heads than the address says.
    NoSuchHead {
        /// That is what the line has.
        heads: u8,
    },
}

/// Something that happened, and when.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Event {
    /// When the driver learnt it.
    pub at: Time,
    /// What.
    pub what: What,
}

impl Event {
    /// The same on a clock that is ahead by `offset`.
    pub fn later_by(self, offset: Interval) -> Event {
        let what = match self.what {
            What::Answered { answer, asked_at } => What::Answered { answer, asked_at: asked_at + offset },
            What::Acknowledged { id, sent_at } => What::Acknowledged { id, sent_at: sent_at + offset },
            other => other,
        };
        Event { at: self.at + offset, what }
    }
}

/// What happened.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum What {
    /// Another state of the link.
    Link(Link),
    /// A command went to the line: its first bit goes now. A command that is sent again is reported again.
    Sent {
        /// Which.
        id: CommandId,
        /// What it says.
        command: Command,
    },
    /// The head has taken a command.
    Acknowledged {
        /// Which.
        id: CommandId,
        /// When it was sent.
        sent_at: Time,
    },
    /// The head has done a command, or took the next one in its place.
    Completed {
        /// Which.
        id: CommandId,
    },
    /// A command was never sent: a newer one took its place.
    Replaced {
        /// Which.
        id: CommandId,
    },
    /// A command will not be done.
    Failed {
        /// Which.
        id: CommandId,
        /// Why.
        why: Failure,
    },
    /// The head answered an inquiry. It looked at its own state after the inquiry had reached it and before the first byte of the answer.
    Answered {
        /// What it said.
        answer: Answer,
        /// When the first bit of the inquiry went.
        asked_at: Time,
    },
}

/// Why a command will not be done.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Failure {
    /// The head said no.
    #[error("{0}")]
    Refused(Refusal),
    /// It was sent, nothing came back, and doing it twice would not be the same as once.
    #[error("no answer came, and it may not be sent twice")]
    Unanswered,
    /// It set the head going, and the line broke: whoever gave it has to give it again.
    #[error("the line broke while the head was moving")]
    Interrupted,
    /// It was sent again and again, and the head stands elsewhere.
    #[error("the head stands still elsewhere, at {0} and {1} units, though it was told again")]
    NotReached(i32, i32),
}

/// What a driver has counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Commands given.
    pub given: u64,
    /// Command packets sent, those sent again too.
    pub sent: u64,
    /// Commands that a newer one replaced before they were sent.
    pub replaced: u64,
    /// Messages without an answer in time.
    pub unanswered: u64,
    /// Messages that the head had no room for.
    pub buffer_full: u64,
    /// Commands given again since the head stood elsewhere.
    pub corrected: u64,
    /// Replies and datagrams that fit nothing.
    pub stray: u64,
    /// Bytes that belonged to no packet.
    pub garbage_bytes: u64,
    /// Events that nobody fetched in time.
    pub lost_events: u64,
}
