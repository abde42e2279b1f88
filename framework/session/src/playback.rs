//! Nodes whose messages come out of a session, each at the time at which it was given out: the rest of a rig works on them with other settings.
//!
//! The session is read once for all of them, a chunk at a time, as far as the run has come. A node that has nothing up to there asks for another activation
//! at that time.

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::sync::{Arc, Mutex, PoisonError};

use foveate_engine::tap::Event;
use foveate_messages::Time;
use foveate_node::error::{ConfigError, NodeError};
use foveate_node::io::{Gap, Io, Packet};
use foveate_node::node::{Due, Plan, Role};
use foveate_node::port::{MessageType, Ports};
use foveate_node::registry::{ErasedNode, NodeType, Settings};
use foveate_node::report::Report;
use foveate_node::setup::Setup;
use foveate_rig::graph::{Cost, Graph, OnError};

use crate::names::{self, topic};
use crate::player::compatible;
use crate::session::Session;
use crate::viewer::Schema;
use crate::{body, order, picture};

/// What one node gives out.
enum Item {
    Message(usize, Vec<u8>),
    Gap(usize, Gap),
}

/// A port that is played.
struct Played {
    instance: usize,
    port: usize,
    message: MessageType,
    /// Of pictures: the name of the schema that they are written in.
    schema: Option<String>,
}

/// The session, as far as it was read.
struct Reading {
    session: Session,
    chunk: usize,
    /// By channel.
    played: BTreeMap<u16, Played>,
    order: Option<u16>,
    /// By instance and port of the session: those of the graph.
    here: HashMap<(usize, usize), (usize, usize)>,
    /// By instance of the graph.
    items: Vec<VecDeque<(Time, Item)>>,
    /// How far it was read.
    horizon: Time,
    failure: Option<String>,
}

impl Reading {
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
                items[it.instance].push_back((now, Item::Message(it.port, bytes.to_vec())));
            } else if order_channel == Some(channel) {
                *horizon = (*horizon).max(now);
                for entry in order::decode(bytes)? {
                    if let Event::Gap { instance, port, gap } = entry.event
                        && let Some(&(instance, port)) = here.get(&(instance, port))
                    {
                        items[instance].push_back((entry.now, Item::Gap(port, gap)));
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

/// A node in whose place a session speaks.
struct Playback {
    index: usize,
    reading: Arc<Mutex<Reading>>,
}

impl ErasedNode for Playback {
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let mut reading = self.reading.lock().unwrap_or_else(PoisonError::into_inner);
        let reading = &mut *reading;
        while let Some((now, _)) = reading.items[self.index].front()
            && *now <= io.now()
        {
            match reading.items[self.index].pop_front() {
                Some((_, Item::Gap(port, gap))) => io.repeat_gap(port, gap),
                Some((now, Item::Message(port, bytes))) => {
                    let it = reading.played.values().find(|it| (it.instance, it.port) == (self.index, port));
                    let Some(it) = it else { continue };
                    io.repeat(
                        port,
                        decode(it, &bytes).map_err(|what| NodeError::input(format_args!("at {now}: {what}")))?,
                    );
                }
                None => break,
            }
        }
        match reading.failure.take() {
            Some(what) => Err(NodeError::input(what)),
            None => Ok(()),
        }
    }

    fn due(&mut self) -> Due {
        let mut reading = self.reading.lock().unwrap_or_else(PoisonError::into_inner);
        if reading.items[self.index].is_empty() && !reading.read_on() {
            // Who finds that the session cannot be read on says so.
            return if reading.failure.is_some() { Due::At(reading.horizon) } else { Due::Never };
        }
        Due::At(reading.items[self.index].front().map_or(reading.horizon, |it| it.0))
    }

    fn finish(&mut self, _: &mut Report) -> Result<(), NodeError> {
        Ok(())
    }
}

fn decode(played: &Played, bytes: &[u8]) -> Result<Packet, String> {
    match &played.schema {
        Some(schema) => picture::decode(schema, bytes),
        None => body::decode(&played.message, bytes),
    }
}

/// A node that gives nothing, since nobody who works anew needs it.
struct Silent;

impl ErasedNode for Silent {
    fn process(&mut self, _: &mut Io<'_>) -> Result<(), NodeError> {
        Ok(())
    }
    fn due(&mut self) -> Due {
        Due::Never
    }
    fn finish(&mut self, _: &mut Report) -> Result<(), NodeError> {
        Ok(())
    }
}

/// Settings of a node in whose place a session speaks.
struct InPlace {
    settings: Arc<dyn Settings>,
    playback: Option<(usize, Arc<Mutex<Reading>>)>,
}

impl Settings for InPlace {
    fn build(&self, _: &Setup) -> Result<Box<dyn ErasedNode>, ConfigError> {
        Ok(match &self.playback {
            Some((index, reading)) => Box::new(Playback { index: *index, reading: Arc::clone(reading) }),
            None => Box::new(Silent),
        })
    }
    fn resolved(&self) -> &dyn erased_serde::Serialize {
        self.settings.resolved()
    }
    fn as_any(&self) -> &dyn std::any::Any {
        self.settings.as_any()
    }
    fn plan(&self) -> Plan {
        self.settings.plan()
    }
    fn is_live(&self) -> bool {
        false
    }
}

/// `graph` with the session in place of the nodes that are not `made`; sentences about what those that are will not get.
///
/// # Errors
/// A sentence: a message that is needed has another layout than this program's.
pub fn in_place(mut graph: Graph, made: &[bool], mut session: Session) -> Result<Graph, String> {
    let recorded = session.graph()?;
    let mut played = BTreeMap::new();
    let mut here = HashMap::new();
    for (index, instance) in graph.instances.iter().enumerate().filter(|it| !made[it.0]) {
        let then = recorded.instances.iter().position(|it| *it == instance.path);
        for (port, output) in instance.node_type.ports.outputs.iter().enumerate() {
            if !graph.edges.iter().any(|it| it.from == (index, port) && made[it.to.0]) {
                continue;
            }
            if let Some(then) = then
                && let Some(its) = recorded.outputs.get(then).and_then(|it| it.iter().position(|it| it == output.name))
            {
                here.insert((then, its), (index, port));
            }
            let Some(channel) = session.channel(&topic(&instance.path, output.name)) else { continue };
            compatible(&session, channel, &output.message)?;
            let is_picture = channel.message_encoding == Schema::ENCODING;
            let schema = session.summary.schemas.get(&channel.schema_id).filter(|_| is_picture);
            let schema = schema.map(|it| it.0.name.clone());
            played.insert(channel.id, Played { instance: index, port, message: output.message, schema });
        }
    }
    let reading = Arc::new(Mutex::new(Reading {
        chunk: 0,
        order: session.channel(names::ORDER).map(|it| it.id),
        session,
        played,
        here,
        items: (0..graph.instances.len()).map(|_| VecDeque::new()).collect(),
        horizon: Time::ZERO,
        failure: None,
    }));
    graph.edges.retain(|it| made[it.to.0]);
    for (index, instance) in graph.instances.iter_mut().enumerate().filter(|it| !made[it.0]) {
        let speaks = graph.edges.iter().any(|it| it.from.0 == index);
        let playback = speaks.then(|| (index, Arc::clone(&reading)));
        instance.settings = Arc::new(InPlace { settings: Arc::clone(&instance.settings), playback });
        instance.node_type = Arc::new(source(&instance.node_type));
        instance.takes = Vec::new();
        instance.cost = Cost::default();
        instance.on_error = OnError::Stop;
    }
    Ok(graph)
}

/// The type of a node that gives out the same and takes nothing.
fn source(node_type: &NodeType) -> NodeType {
    NodeType {
        name: node_type.name,
        role: Role::Source,
        summary: node_type.summary,
        ports: Ports { inputs: Vec::new(), outputs: node_type.ports.outputs.clone() },
        figures: node_type.figures,
        schema: node_type.schema.clone(),
        origin: node_type.origin.clone(),
        decoder: Box::new(|_| Err(ConfigError::at("type", "speaks out of a session"))),
    }
}
