//! Events of a driver.

use foveate::prelude::{Interval, Time};

use crate::visca::{Answer, Command, Refusal};

/// Numbers the commands of one driver, from 1 in the order in which they were given.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CommandId(pub u64);

/// State of the link between driver and head.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Link {
    /// The port is not open, with the reason; it is tried again.
    Closed(String),
    /// The port is open, the head has not answered yet.
    Greeting,
    /// The head responds.
    Ready,
    /// No answer. The head is greeted repeatedly.
    Silent,
    /// Garbled bytes: a wrong baud rate, or another device. The head is greeted repeatedly.
    Garbled,
    /// The line has fewer heads than the address.
    NoSuchHead {
        /// Number of heads on the line.
        heads: u8,
    },
}

/// An event with its time.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Event {
    /// When the driver received it.
    pub at: Time,
    /// The event.
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

/// Kinds of events.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum What {
    /// Another state of the link.
    Link(Link),
    /// A command is being sent: its first bit leaves now. A repeated command is reported again.
    Sent {
        /// The command's number.
        id: CommandId,
        /// The command.
        command: Command,
    },
    /// The head has accepted a command.
    Acknowledged {
        /// The command's number.
        id: CommandId,
        /// Time of sending.
        sent_at: Time,
    },
    /// The head has completed a command, or replaced it by the next one.
    Completed {
        /// The command's number.
        id: CommandId,
    },
    /// A command was never sent, because a newer one replaced it.
    Replaced {
        /// The command's number.
        id: CommandId,
    },
    /// A command failed.
    Failed {
        /// The command's number.
        id: CommandId,
        /// The reason.
        why: Failure,
    },
    /// The head answered an inquiry. The state is of a time between the inquiry's arrival and the first byte of the answer.
    Answered {
        /// The answer.
        answer: Answer,
        /// Time of the inquiry's first bit.
        asked_at: Time,
    },
}

/// Why a command failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Failure {
    /// The head refused it.
    #[error("{0}")]
    Refused(Refusal),
    /// There was no answer, and repeating it would have another effect.
    #[error("no answer came, and it may not be sent twice")]
    Unanswered,
    /// It started a motion, and the line broke: it has to be given again.
    #[error("the line broke while the head was moving")]
    Interrupted,
    /// It was repeated, and the head still stopped elsewhere.
    #[error("the head stopped elsewhere, at {0} and {1} units, although the command was repeated")]
    NotReached(i32, i32),
}

/// Counts of a driver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Commands given.
    pub given: u64,
    /// Command packets sent, repeated ones included.
    pub sent: u64,
    /// Commands replaced by a newer one before they were sent.
    pub replaced: u64,
    /// Messages without an answer in time.
    pub unanswered: u64,
    /// Messages refused because the head's buffer was full.
    pub buffer_full: u64,
    /// Commands repeated because the head stopped elsewhere.
    pub corrected: u64,
    /// Replies and datagrams that match no message.
    pub stray: u64,
    /// Bytes that belonged to no packet.
    pub garbage_bytes: u64,
    /// Events dropped because they were not fetched in time.
    pub lost_events: u64,
}
