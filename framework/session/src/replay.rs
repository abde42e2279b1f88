//! What a replay makes anew, and what it takes from the recording.

use std::path::Path;
use std::sync::Arc;

use foveate_engine::Source;
use foveate_messages::Wire;
use foveate_node::error::{ConfigError, NodeError};
use foveate_node::io::Io;
use foveate_node::node::{Due, Plan, Role};
use foveate_node::registry::{ErasedNode, NodeType, Registry, Settings};
use foveate_node::report::Report;
use foveate_node::setup::Setup;
use foveate_rig::graph::Graph;
use foveate_rig::{Diagnostics, Overrides};

use crate::names::{self, GraphNames, topic};
use crate::session::Session;
use crate::attach;

/// Whether nodes of a type are never made in a replay: what brings data into a rig, and what holds on to something of its process. (Devices are told by their settings.)
fn is_recorded(node_type: &NodeType) -> bool {
    let ports = &node_type.ports;
    let mut messages = ports.inputs.iter().map(|it| it.message).chain(ports.outputs.iter().map(|it| it.message));
    node_type.role == Role::Source || messages.any(|it| matches!(it.wire, Wire::Local)) || node_type.name.starts_with("sim.")
}

/// `registry` with types whose nodes do nothing where a replay does not make them: no file is opened and no device touched.
pub fn registry(registry: &Registry) -> Registry {
    registry.replaced(|it| {
        let inner = Arc::clone(it);
        NodeType {
            name: it.name,
            role: it.role,
            summary: it.summary,
            ports: it.ports.clone(),
            figures: it.figures,
            schema: it.schema.clone(),
            origin: it.origin.clone(),
            decoder: Box::new(move |given| {
                let settings = inner.decode(given)?;
                let is_recorded = is_recorded(&inner) || settings.is_live();
                Ok(Box::new(Replayed { settings, is_recorded }))
            }),
        }
    })
}

/// Settings of a node in a replay.
struct Replayed {
    settings: Box<dyn Settings>,
    is_recorded: bool,
}

impl Settings for Replayed {
    fn build(&self, setup: &Setup) -> Result<Box<dyn ErasedNode>, ConfigError> {
        if self.is_recorded { Ok(Box::new(Idle)) } else { self.settings.build(setup) }
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
        self.settings.is_live()
    }
}

struct Idle;

impl ErasedNode for Idle {
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

/// The rig of a session, loaded with the files that travel in it. `folder` is where they are written.
///
/// # Errors
/// All faults of the rig, or a sentence about the session.
pub fn load(session: &mut Session, folder: &Path, known: &Registry) -> Result<Graph, LoadError> {
    let path = folder.join(names::REPLAY_RIG);
    let text = session.text(names::REPLAY_RIG)?;
    let mut files = Vec::new();
    for name in session.files() {
        if name.starts_with(names::FILES) {
            files.push((name.clone(), session.file(&name)?));
        }
    }
    attach::unpack(files.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice())), folder)?;
    let mut graph =
        foveate_rig::load(&text, &path, &registry(known), &Overrides::default()).map_err(LoadError::Rig)?;
    graph.resolved = session.text(names::RIG)?;
    let recorded = session.graph()?;
    let here = GraphNames::of(&graph);
    if recorded != here {
        let first = |a: &[String], b: &[String]| {
            let n = a.iter().zip(b).take_while(|it| it.0 == it.1).count();
            let name = |list: &[String]| list.get(n).map_or_else(|| "nothing".to_owned(), |it| format!("`{it}`"));
            (a != b).then(|| format!("{} stood where {} stands now", name(a), name(b)))
        };
        let what = first(&recorded.instances, &here.instances).or(first(&recorded.edges, &here.edges));
        return Err(LoadError::Session(format!(
            "`{}` was recorded by foveate {}, which arranges its rig in another way: {}",
            session.path.display(),
            session.fact("program"),
            what.unwrap_or_default()
        )));
    }
    Ok(graph)
}

/// Why the rig of a session cannot be used.
pub enum LoadError {
    /// All that is wrong with the rig.
    Rig(Diagnostics),
    /// A sentence.
    Session(String),
}

impl From<String> for LoadError {
    fn from(sentence: String) -> LoadError {
        LoadError::Session(sentence)
    }
}

/// What is made anew: all that can be, from the first edges on whose messages are whole. Says which nodes go without since they are not.
pub fn sources(graph: &Graph, session: &Session) -> (Vec<Source>, Vec<String>) {
    let mut sources: Vec<Source> = graph
        .instances
        .iter()
        .map(|it| if is_recorded(&it.node_type) || it.is_live() { Source::Recording } else { Source::Node })
        .collect();
    let left_away: Vec<String> = serde_json::from_str(session.fact("left_away")).unwrap_or_default();
    let is_whole = |instance: usize, port: usize| {
        let it = &graph.instances[instance];
        let output = &it.node_type.ports.outputs[port];
        let topic = topic(&it.path, output.name);
        let is_lossy = session.channel(&topic).is_some_and(|it| it.metadata.get("is_lossy").is_some_and(|it| it == "true"));
        !is_lossy && !left_away.contains(&topic) && session.left_out.get(&topic).is_none_or(|it| *it == 0)
    };
    let mut remarks = Vec::new();
    loop {
        let torn = graph.edges.iter().find(|it| {
            sources[it.to.0] == Source::Node
                && sources[it.from.0] == Source::Recording
                && !is_whole(it.from.0, it.from.1)
        });
        let Some(edge) = torn else { break };
        sources[edge.to.0] = Source::Recording;
        remarks.push(format!(
            "{} is not made again: messages of {} are not all in the recording",
            graph.instances[edge.to.0].path, edge.name
        ));
    }
    (sources, remarks)
}
