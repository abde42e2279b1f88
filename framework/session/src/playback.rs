//! Nodes whose messages come out of a session, each at the time at which it was given out: the rest of a rig works on them with other settings.
//!
//! The session is read once for all of them: see [`reading`](crate::reading).

use std::sync::{Arc, Mutex, PoisonError};

use foveate_node::error::{ConfigError, NodeError};
use foveate_node::io::Io;
use foveate_node::node::{Due, Role};
use foveate_node::port::Ports;
use foveate_node::registry::{ErasedNode, NodeType};
use foveate_node::report::Report;
use foveate_rig::graph::{Cost, Graph, OnError};

use crate::names::topic;
use crate::reading::{Item, Reading};
use crate::replay::{Idle, Instead};
use crate::session::Session;

/// A node in whose place a session speaks.
struct Playback {
    index: usize,
    reading: Arc<Mutex<Reading>>,
}

impl ErasedNode for Playback {
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let mut reading = self.reading.lock().unwrap_or_else(PoisonError::into_inner);
        while let Some((now, item)) = reading.take(self.index, io.now()) {
            match item {
                Item::Gap(port, gap) => io.repeat_gap(port, gap),
                Item::Message(channel, bytes) => {
                    let failed = |what: String| NodeError::input(format_args!("at {now}: {what}"));
                    let (port, packet) = reading.decode(channel, &bytes).map_err(failed)?;
                    io.repeat(port, packet);
                }
            }
        }
        reading.failure()
    }

    fn due(&mut self) -> Due {
        self.reading.lock().unwrap_or_else(PoisonError::into_inner).due(self.index)
    }

    fn finish(&mut self, _: &mut Report) -> Result<(), NodeError> {
        Ok(())
    }
}

/// `graph` with the session in place of the nodes that are not `made`.
///
/// # Errors
/// A sentence: a message that is needed has another layout than this program's.
pub fn in_place(mut graph: Graph, made: &[bool], mut session: Session) -> Result<Graph, String> {
    let recorded = session.graph()?;
    let mut reading = Reading::new(session);
    for (index, instance) in graph.instances.iter().enumerate() {
        let line = reading.line();
        debug_assert_eq!(line, index, "a line for each node, so that they have the same numbers");
        let then = recorded.instances.iter().position(|it| *it == instance.path);
        for (port, output) in instance.node_type.ports.outputs.iter().enumerate() {
            let is_needed = graph.edges.iter().any(|it| it.from == (index, port) && made[it.to.0]);
            if made[index] || !is_needed {
                continue;
            }
            let its = then.and_then(|then| {
                let outputs = recorded.outputs.get(then)?;
                Some((then, outputs.iter().position(|it| it == output.name)?))
            });
            reading.play(line, port, &topic(&instance.path, output.name), output.message, its)?;
        }
    }
    let reading = Arc::new(Mutex::new(reading));
    graph.edges.retain(|it| made[it.to.0]);
    // Ages are those of the run that was recorded.
    graph.budgets.clear();
    for (index, instance) in graph.instances.iter_mut().enumerate().filter(|it| !made[it.0]) {
        let speaks = graph.edges.iter().any(|it| it.from.0 == index);
        let reading = Arc::clone(&reading);
        instance.settings = Arc::new(Instead {
            settings: Arc::clone(&instance.settings),
            is_live: false,
            make: Box::new(move |_| match speaks {
                true => Ok(Box::new(Playback { index, reading: Arc::clone(&reading) })),
                false => Ok(Box::new(Idle)),
            }),
        });
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
