//! A session that several nodes speak out of, each message at the time at which it was given out then.
//!
//! It is read once for all of them, a chunk at a time, as far as the run has come. A node that has nothing up to there asks for another activation a little
//! before that time: what threads wrote side by side stands in the file nearly in the order of time.

use std::collections::{BTreeMap, HashMap, VecDeque};

use foveate_engine::tap::Event;
use foveate_messages::{Image, Interval, Stamp, Time};
use foveate_node::error::NodeError;
use foveate_node::io::{Gap, Packet};
use foveate_node::node::Due;
use foveate_node::port::MessageType;

use crate::names;
use crate::player::compatible;
use crate::session::Session;
use crate::viewer::Schema;
use crate::{body, order, picture};

/// A message stands at most so much before one of an earlier time: lanes of cameras run ahead of each other by a frame.
const LONGEST_LEAD: Interval = Interval(2_000_000_000);

/// What a node gives out.
pub enum Item {
    /// A message of this channel, not decoded yet.
    Message(u16, Vec<u8>),
    /// A gap at an output port.
    Gap(usize, Gap),
}

/// A port that is played.
struct Played {
    line: usize,
    port: usize,
    message: MessageType,
    /// Of pictures: the name of the schema that they are written in.
    schema: Option<String>,
}

/// A session, as far as it was read.
pub struct Reading {
    session: Session,
    chunk: usize,
    /// By channel.
    played: BTreeMap<u16, Played>,
    order: Option<u16>,
    /// By instance and port of the session: line and port here.
    here: HashMap<(usize, usize), (usize, usize)>,
    /// By line: what was read and not given out yet.
    items: Vec<VecDeque<(Time, Item)>>,
    /// By line: until when it is known to have nothing.
    asked: Vec<Time>,
    /// How far it was read.
    horizon: Time,
    failure: Option<String>,
}

impl Reading {
    /// At the beginning of a session.
    pub fn new(session: Session) -> Reading {
        Reading {
            chunk: 0,
            order: session.channel(names::ORDER).map(|it| it.id),
            session,
            played: BTreeMap::new(),
            here: HashMap::new(),
            items: Vec::new(),
            asked: Vec::new(),
            horizon: Time::ZERO,
            failure: None,
        }
    }

    /// The session.
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// A line for one node.
    pub fn line(&mut self) -> usize {
        self.items.push(VecDeque::new());
        self.asked.push(Time::ZERO);
        self.items.len() - 1
    }

    /// Plays the channel of `topic`, if there is one, as output `port` of that line; `then` are instance and port that it had.
    ///
    /// # Errors
    /// A sentence: its messages have another layout than this program's.
    pub fn play(
        &mut self,
        line: usize,
        port: usize,
        topic: &str,
        message: MessageType,
        then: Option<(usize, usize)>,
    ) -> Result<(), String> {
        if let Some(then) = then {
            self.here.insert(then, (line, port));
        }
        let Some(channel) = self.session.channel(topic) else { return Ok(()) };
        compatible(&self.session, channel, &message)?;
        let is_picture = channel.message_encoding == Schema::ENCODING;
        let schema = self.session.summary.schemas.get(&channel.schema_id).filter(|_| is_picture);
        let schema = schema.map(|it| it.0.name.clone());
        self.played.insert(channel.id, Played { line, port, message, schema });
        Ok(())
    }

    /// When the next item of a line is due, or when the caller has to ask again.
    pub fn due(&mut self, line: usize) -> Due {
        loop {
            if let Some((now, _)) = self.items[line].front() {
                return Due::At(*now);
            }
            let surely = self.horizon - LONGEST_LEAD;
            if surely > self.asked[line] {
                self.asked[line] = surely;
                return Due::At(surely);
            }
            if !self.read_on() {
                // Who finds that the session cannot be read on says so.
                return if self.failure.is_some() { Due::At(self.horizon) } else { Due::Never };
            }
        }
    }

    /// The next item of a line that is due by `now`.
    pub fn take(&mut self, line: usize, now: Time) -> Option<(Time, Item)> {
        self.items[line].front().filter(|it| it.0 <= now)?;
        self.items[line].pop_front()
    }

    /// Reads a message: its port, and the message.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn decode(&self, channel: u16, bytes: &[u8]) -> Result<(usize, Packet), String> {
        let it = self.played.get(&channel).ok_or("a channel that is not played")?;
        let packet = match &it.schema {
            Some(schema) => picture::decode(schema, bytes),
            None => body::decode(&it.message, bytes),
        };
        Ok((it.port, packet?))
    }

    /// Reads a picture.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn decode_picture(&self, channel: u16, bytes: &[u8]) -> Result<(Stamp, Image), String> {
        let schema = self.played.get(&channel).and_then(|it| it.schema.as_ref()).ok_or("a channel without pictures")?;
        picture::read(schema, bytes)
    }

    /// That the session could not be read on, once.
    ///
    /// # Errors
    /// Where, and why.
    pub fn failure(&mut self) -> Result<(), NodeError> {
        self.failure.take().map_or(Ok(()), |what| Err(NodeError::input(what)))
    }

    fn read_on(&mut self) -> bool {
        if self.chunk == self.session.summary.chunks.len() || self.failure.is_some() {
            return false;
        }
        let (played, order_channel, here, items) = (&self.played, self.order, &self.here, &mut self.items);
        let horizon = &mut self.horizon;
        let read = self.session.messages(self.chunk, |channel, log_ns, bytes| {
            let now = Time(i64::try_from(log_ns).unwrap_or(i64::MAX));
            if let Some(it) = played.get(&channel) {
                *horizon = (*horizon).max(now);
                items[it.line].push_back((now, Item::Message(channel, bytes.to_vec())));
            } else if order_channel == Some(channel) {
                *horizon = (*horizon).max(now);
                for entry in order::decode(bytes)? {
                    if let Event::Gap { instance, port, gap } = entry.event
                        && let Some(&(line, port)) = here.get(&(instance, port))
                    {
                        items[line].push_back((entry.now, Item::Gap(port, gap)));
                    }
                }
            }
            Ok(())
        });
        self.chunk += 1;
        self.failure = read.err();
        true
    }
}
