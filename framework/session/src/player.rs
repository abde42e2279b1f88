//! The events of a session in the order in which they happened, with the messages that a replay needs.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, BinaryHeap, HashMap, VecDeque};
use std::sync::Arc;

use foveate_engine::tap::{Entry, Event};
use foveate_engine::{Feed, Source};
use foveate_node::port::MessageType;
use foveate_rig::graph::Graph;
use mcap::records::Channel;

use crate::names::{self, topic};
use crate::session::Session;
use crate::viewer::Schema;
use crate::wanted::is_picture;
use crate::{body, order, picture};

/// No edge carries more messages: a million a second for nine years.
const MOST_MESSAGES: u64 = 1 << 48;

/// Reads the events of a session.
pub struct Player {
    session: Session,
    graph: Arc<Graph>,
    chunk: usize,
    order_channel: u16,
    /// Channels whose messages a replay needs: instance and port.
    needed: BTreeMap<u16, (usize, usize)>,
    /// Of those, ports of pictures: the name of the schema that they are written in.
    pictures: HashMap<(usize, usize), String>,
    /// Ports of nodes that are not made whose messages go to nodes that are.
    feeding: BTreeSet<(usize, usize)>,
    /// By channel: messages that were read.
    n_read: BTreeMap<u16, u64>,
    bodies: HashMap<(usize, usize), VecDeque<Vec<u8>>>,
    early: BinaryHeap<Reverse<Early>>,
    next: u64,
}

/// An event that was read before its turn.
struct Early(Entry);

impl PartialEq for Early {
    fn eq(&self, other: &Early) -> bool {
        self.0.order == other.0.order
    }
}

impl Eq for Early {}

impl PartialOrd for Early {
    fn partial_cmp(&self, other: &Early) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Early {
    fn cmp(&self, other: &Early) -> std::cmp::Ordering {
        self.0.order.cmp(&other.0.order)
    }
}

impl Player {
    /// Plays a session for nodes of `graph` that are taken from it.
    ///
    /// # Errors
    /// A sentence: it holds no order of delivery, or messages of another layout than this program's.
    pub fn new(session: Session, graph: Arc<Graph>, sources: &[Source]) -> Result<Player, String> {
        let order_channel = session.channel(names::ORDER).map(|it| it.id);
        let order_channel = order_channel
            .ok_or_else(|| format!("`{}` holds no order of delivery (`{}`)", session.path.display(), names::ORDER))?;
        let (mut needed, mut feeding) = (BTreeMap::new(), BTreeSet::new());
        let mut pictures = HashMap::new();
        for (index, instance) in graph.instances.iter().enumerate() {
            for (port, output) in instance.node_type.ports.outputs.iter().enumerate() {
                let mut along = graph.edges.iter().filter(|it| it.from == (index, port));
                let is_used = along.clone().next().is_some();
                let feeds = along.any(|it| sources[it.to.0] == Source::Node);
                if sources[index] == Source::Node || !is_used {
                    continue;
                }
                if feeds {
                    feeding.insert((index, port));
                } else if is_picture(&graph, index, port) {
                    // Between two nodes that are not made, ledgers still want to know what a message says of its quality; pictures say nothing.
                    continue;
                }
                let Some(channel) = session.channel(&topic(&instance.path, output.name)) else { continue };
                compatible(&session, channel, &output.message)?;
                if channel.message_encoding == Schema::ENCODING {
                    let schema = session.summary.schemas.get(&channel.schema_id);
                    pictures.insert((index, port), schema.map_or_else(String::new, |it| it.0.name.clone()));
                }
                needed.insert(channel.id, (index, port));
            }
        }
        Ok(Player {
            session,
            graph,
            chunk: 0,
            order_channel,
            needed,
            pictures,
            feeding,
            n_read: BTreeMap::new(),
            bodies: HashMap::new(),
            early: BinaryHeap::new(),
            next: 0,
        })
    }

    /// Reads one chunk; `false` after the last one.
    fn read_on(&mut self) -> Result<bool, String> {
        if self.chunk == self.session.summary.chunks.len() {
            return Ok(false);
        }
        let (order_channel, needed) = (self.order_channel, &self.needed);
        // All of a chunk or nothing of it.
        let (mut bodies, mut early, mut n_read) = (Vec::new(), Vec::new(), BTreeMap::<u16, u64>::new());
        self.session.messages(self.chunk, |channel, _, bytes| {
            *n_read.entry(channel).or_default() += 1;
            if channel == order_channel {
                early.extend(order::decode(bytes)?.into_iter().map(|it| Reverse(Early(it))));
            } else if let Some(port) = needed.get(&channel) {
                bodies.push((*port, bytes.to_vec()));
            }
            Ok(())
        })?;
        self.early.extend(early);
        for (port, bytes) in bodies {
            self.bodies.entry(port).or_default().push_back(bytes);
        }
        for (channel, count) in n_read {
            *self.n_read.entry(channel).or_default() += count;
        }
        self.chunk += 1;
        Ok(true)
    }

    /// At the end of the file: that nothing is missing which should be there.
    fn check_end(&self) -> Result<(), String> {
        let Session { path, summary, end, is_gapless, .. } = &self.session;
        let shown = path.display();
        for (channel, it) in &summary.channels {
            let count = |counts: &BTreeMap<u16, u64>| counts.get(channel).copied().unwrap_or(0);
            let (found, expected) = (count(&self.n_read), count(&summary.counts));
            if found != expected {
                return Err(format!(
                    "`{shown}` holds {found} messages of {}, expected {expected} by its summary",
                    it.topic
                ));
            }
        }
        // After a kill some lanes may be further than others: what is behind a gap is not known to be whole. The recorder says where it lost the order itself.
        let is_lost = end.as_ref().is_some_and(|it| it.get("is_order_lost").is_some_and(|it| it == "true"));
        let is_cut_off = *is_gapless && end.is_none();
        if self.early.is_empty() || is_cut_off || is_lost {
            return Ok(());
        }
        Err(format!(
            "`{shown}` lacks event {} of its order of delivery: {} later ones cannot be played",
            self.next,
            self.early.len()
        ))
    }

    /// Fills in the message of an event, and refuses numbers that the graph does not have.
    fn complete(&mut self, entry: &mut Entry) -> Result<(), String> {
        let (n_instances, n_edges) = (self.graph.instances.len(), self.graph.edges.len());
        let wrong = |what: &str| format!("`{}` names {what} that its rig does not have", self.session.path.display());
        match &mut entry.event {
            Event::Activated { instance, .. }
            | Event::Failed { instance, .. }
            | Event::Changed { instance, .. }
            | Event::Finished { instance, .. } => {
                if *instance >= n_instances {
                    return Err(wrong("a node"));
                }
            }
            Event::GapEntered { edge } | Event::Delivered { edge, .. } | Event::Lost { edge, .. }
                if *edge >= n_edges =>
            {
                return Err(wrong("an edge"));
            }
            Event::Lost { first, count, .. } if first.checked_add(*count).is_none_or(|it| it > MOST_MESSAGES) => {
                return Err(format!("`{}` counts {count} lost messages after {first}", self.session.path.display()));
            }
            Event::Gap { instance, port, .. } | Event::Emitted { instance, port, .. } => {
                let outputs = self.graph.instances.get(*instance).map(|it| it.node_type.ports.outputs.len());
                if outputs.is_none_or(|it| *port >= it) {
                    return Err(wrong("an output"));
                }
            }
            Event::GapEntered { .. } | Event::Delivered { .. } | Event::Lost { .. } => {}
            Event::Ending | Event::Ended { .. } => {}
        }
        if let Event::Emitted { instance, port, is_kept, packet, .. } = &mut entry.event {
            let feeds = self.feeding.contains(&(*instance, *port));
            let is_there = *is_kept && self.needed.values().any(|it| *it == (*instance, *port));
            if !feeds && !is_there {
                return Ok(());
            }
            let output = &self.graph.instances[*instance].node_type.ports.outputs[*port];
            let place = || format!("`{}` of {} at {}", output.name, self.graph.instances[*instance].path, entry.now);
            if !*is_kept {
                return Err(format!("{} was left out of the recording, and nodes need it", place()));
            }
            let bytes = self.bodies.get_mut(&(*instance, *port)).and_then(VecDeque::pop_front);
            let bytes = bytes.ok_or_else(|| format!("{} is not in the recording", place()))?;
            let schema = self.pictures.get(&(*instance, *port));
            let read = match schema {
                Some(schema) => picture::decode(schema, &bytes),
                None => body::decode(&output.message, &bytes),
            };
            let read = read.map_err(|what| format!("{}: {what}", place()))?;
            *packet = Some(read);
        }
        Ok(())
    }
}

/// Whether the messages of a channel are those that a port has.
///
/// # Errors
/// A sentence with both sides.
pub(crate) fn compatible(session: &Session, channel: &Channel, message: &MessageType) -> Result<(), String> {
    let layout = message.wire.codec().map_or_else(String::new, |it| format!("{:016x}", it.layout()));
    let fact = |key: &str| channel.metadata.get(key).map_or("", String::as_str);
    let here = (message.name, message.version.to_string(), layout);
    if (fact("message"), fact("version"), fact("layout")) == (here.0, &here.1, &here.2) {
        return Ok(());
    }
    Err(format!(
        "`{}`: {} was recorded as `{}` version {} (layout {}), and this program has `{}` version {} (layout {})",
        session.path.display(),
        channel.topic,
        fact("message"),
        fact("version"),
        fact("layout"),
        here.0,
        here.1,
        here.2
    ))
}

impl Feed for Player {
    fn next(&mut self) -> Result<Option<Entry>, String> {
        loop {
            if let Some(Reverse(first)) = self.early.peek()
                && first.0.order <= self.next
            {
                let Some(Reverse(Early(mut entry))) = self.early.pop() else { continue };
                if entry.order < self.next {
                    return Err(format!("`{}` holds event {} twice", self.session.path.display(), entry.order));
                }
                self.next += 1;
                self.complete(&mut entry)?;
                return Ok(Some(entry));
            }
            if !self.read_on()? {
                return self.check_end().map(|()| None);
            }
        }
    }

    fn was_live(&self) -> bool {
        self.session.fact("mode") == "live"
    }
}
