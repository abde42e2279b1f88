//! What a replay makes again, and what it takes from the recording.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use foveate_engine::Source;
use foveate_messages::Wire;
use foveate_node::error::{ConfigError, NodeError};
use foveate_node::io::Io;
use foveate_node::node::{Due, Node, Plan, Role};
use foveate_node::port::InputPolicy;
use foveate_node::registry::{ErasedNode, NodeType, Registry, Settings};
use foveate_node::report::Report;
use foveate_node::scale::ScaleAnchor;
use foveate_node::setup::Setup;
use foveate_rig::graph::{Graph, Instance};
use foveate_rig::{Diagnostics, Overrides};

use crate::attach;
use crate::names::{self, GraphNames, topic};
use crate::session::Session;

/// Whether nodes of a type are never made in a replay: what brings data into a rig, and what holds on to something of its process. (Settings say which nodes are devices.)
fn is_recorded(node_type: &NodeType) -> bool {
    let ports = &node_type.ports;
    let mut messages = ports.inputs.iter().map(|it| it.message).chain(ports.outputs.iter().map(|it| it.message));
    node_type.role == Role::Source
        || messages.any(|it| matches!(it.wire, Wire::Local))
        || node_type.name.starts_with("sim.")
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
                let settings: Arc<dyn Settings> = Arc::from(inner.decode(given)?);
                let (is_live, of_node) = (settings.is_live(), Arc::clone(&settings));
                let make: Make = match is_recorded(&inner) || is_live {
                    true => Box::new(|_| Ok(Box::new(Idle))),
                    false => Box::new(move |setup| of_node.build(setup)),
                };
                Ok(Box::new(Instead { settings, is_live, make }))
            }),
        }
    })
}

type Make = Box<dyn Fn(&Setup) -> Result<Box<dyn ErasedNode>, ConfigError> + Send + Sync>;

/// Settings of a node in whose place another one is made.
pub(crate) struct Instead {
    pub settings: Arc<dyn Settings>,
    pub is_live: bool,
    pub make: Make,
}

impl Settings for Instead {
    fn build(&self, setup: &Setup) -> Result<Box<dyn ErasedNode>, ConfigError> {
        (self.make)(setup)
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
        self.is_live
    }
}

/// A node that is not made: it takes all and gives nothing.
pub(crate) struct Idle;

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

/// Writes the rig of a session and the files that it reads below `folder`; gives the path and the text of the rig.
///
/// # Errors
/// A sentence about the session.
pub fn unpack(session: &mut Session, folder: &Path) -> Result<(PathBuf, String), String> {
    let text = session.text(names::REPLAY_RIG)?;
    let mut files = Vec::new();
    for it in session.summary.attachments.clone().into_iter().filter(|it| it.name.starts_with(names::FILES)) {
        let bytes = session.file(&it.name)?;
        files.push(attach::File { name: it.name, bytes, is_program: it.media_type == names::PROGRAM });
    }
    attach::unpack(&files, folder)?;
    Ok((folder.join(names::REPLAY_RIG), text))
}

/// The rig of a session, loaded with the files that travel in it. `folder` is where they are written.
///
/// # Errors
/// All faults of the rig, or a sentence about the session.
pub fn load(session: &mut Session, folder: &Path, known: &Registry) -> Result<Graph, LoadError> {
    let (path, text) = unpack(session, folder)?;
    let mut graph = foveate_rig::load(&text, &path, &registry(known), &Overrides::default()).map_err(LoadError::Rig)?;
    graph.resolved = session.text(names::RIG)?;
    let recorded = session.graph()?;
    let here = GraphNames::of(&graph);
    if !is_arranged(&recorded, &here) {
        let first = |a: &[String], b: &[String]| {
            let n = a.iter().zip(b).take_while(|it| it.0 == it.1).count();
            let name = |list: &[String]| list.get(n).map_or_else(|| "nothing".to_owned(), |it| format!("`{it}`"));
            (a != b).then(|| format!("{} stood where {} stands now", name(a), name(b)))
        };
        let what = first(&recorded.instances, &here.instances)
            .or(first(&recorded.edges, &here.edges))
            .or(first(&recorded.topics(), &here.topics()));
        return Err(LoadError::Session(format!(
            "`{}` was recorded by foveate {}, which arranges its rig in another way: {}",
            session.path.display(),
            session.fact("program"),
            what.unwrap_or_default()
        )));
    }
    Ok(graph)
}

/// Whether a rig is arranged here as it was then. A node may have more outputs than then, behind those that it had: the session has no messages of them.
fn is_arranged(then: &GraphNames, here: &GraphNames) -> bool {
    let mut outputs = then.outputs.iter().zip(&here.outputs);
    (&then.instances, &then.edges, then.outputs.len()) == (&here.instances, &here.edges, here.outputs.len())
        && outputs.all(|(then, here)| here.starts_with(then))
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

/// What is made again: all that can be, from the first edges on whose messages are whole. Says which nodes go without since they are not.
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
        let is_lossy =
            session.channel(&topic).is_some_and(|it| it.metadata.get("is_lossy").is_some_and(|it| it == "true"));
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

/// Where a replay with other settings begins.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Begin {
    /// At these nodes, `scale.node`.
    pub nodes: Vec<String>,
    /// At all nodes of these scales.
    pub scales: Vec<String>,
}

/// By instance: whether it works again when a replay begins there, and all that it leads to. With an empty `begin` all that can be. Sentences about nodes that cannot.
///
/// # Errors
/// A sentence: a node or scale that the rig does not have, one that is never made again, or one that would get nothing.
pub fn made(graph: &Graph, session: &Session, begin: &Begin) -> Result<(Vec<bool>, Vec<String>), String> {
    let node = |it: &Instance| it.path.split('[').next().unwrap_or_default().to_owned();
    let can: Vec<bool> = graph.instances.iter().map(|it| !is_recorded(&it.node_type) && !it.is_live()).collect();
    for name in &begin.nodes {
        let mut found = graph.instances.iter().zip(&can).filter(|it| node(it.0) == *name).peekable();
        if found.peek().is_none() {
            let known: Vec<String> = graph.instances.iter().map(node).collect();
            let near = foveate_rig::closest(name, known.iter().map(String::as_str));
            let near = near.map_or_else(String::new, |it| format!("; did you mean `{it}`?"));
            return Err(format!("the rig has no node `{name}`{near}"));
        }
        if !found.all(|it| *it.1) {
            return Err(format!(
                "`{name}` is never made again: it is a source, a device or holds one, and its messages come from the recording"
            ));
        }
    }
    for name in &begin.scales {
        if !graph.scales.iter().any(|it| it.name == *name) {
            let near = foveate_rig::closest(name, graph.scales.iter().map(|it| it.name.as_str()));
            let near = near.map_or_else(String::new, |it| format!("; did you mean `{it}`?"));
            return Err(format!("the rig has no scale `{name}`{near}"));
        }
    }
    let begins = |it: &Instance| {
        let scale = graph.scales[it.scale].name.as_str();
        *begin == Begin::default() || begin.nodes.contains(&node(it)) || begin.scales.iter().any(|it| it == scale)
    };
    let asked: Vec<bool> = graph.instances.iter().zip(&can).map(|(it, can)| *can && begins(it)).collect();
    let mut made = asked.clone();
    while let Some(edge) = graph.edges.iter().find(|it| made[it.from.0] && can[it.to.0] && !made[it.to.0]) {
        made[edge.to.0] = true;
    }
    open_gates(graph, &can, &mut made);
    let has = |instance: usize, port: usize| {
        let it = &graph.instances[instance];
        let channel = session.channel(&topic(&it.path, it.node_type.ports.outputs[port].name));
        channel.is_some_and(|it| session.summary.counts.get(&it.id).is_some_and(|it| *it > 0))
    };
    let mut remarks = Vec::new();
    loop {
        // An input that must be there and whose messages are not in the recording.
        let torn = graph.edges.iter().find(|it| {
            let input = &graph.instances[it.to.0].node_type.ports.inputs[it.to.1];
            let is_sampled = input.optional || input.policy == InputPolicy::Latest;
            made[it.to.0] && !made[it.from.0] && !is_sampled && !has(it.from.0, it.from.1)
        });
        let Some(edge) = torn else { break };
        let path = &graph.instances[edge.to.0].path;
        let sentence = format!("the recording has no messages of {}", edge.name);
        if asked[edge.to.0] && *begin != Begin::default() {
            return Err(format!("a replay cannot begin at {path}: {sentence}"));
        }
        made[edge.to.0] = false;
        remarks.push(format!("{path} is not made again: {sentence}"));
    }
    if !made.contains(&true) {
        return Err("nothing is left to be made again".to_owned());
    }
    Ok((made, remarks))
}

/// What follows the target of a scale works with the nodes of that scale, and of scales in it: it says whether they are suspended.
fn open_gates(graph: &Graph, can: &[bool], made: &mut [bool]) {
    let mut scales: Vec<usize> =
        graph.instances.iter().zip(made.iter()).filter(|it| *it.1).map(|it| it.0.scale).collect();
    while let Some(scale) = scales.pop() {
        let anchors = graph.instances.iter().enumerate().filter(|it| it.1.scale == scale);
        for (index, _) in anchors.filter(|it| it.1.node_type.name == ScaleAnchor::TYPE && can[it.0]) {
            made[index] = true;
        }
        scales.extend(graph.places[scale].parent.map(|it| it.0 as usize));
    }
}

/// `resolved` with the setting `path` (`scale.node.setting`) set to `value`, which is TOML, or a text where it is none.
///
/// # Errors
/// A sentence: the rig has no such node.
pub fn with_setting(resolved: &str, path: &str, value: &str) -> Result<String, String> {
    let parts: Vec<&str> = path.split('.').collect();
    let [scale, node, keys @ ..] = &parts[..] else { return Err(expected(path)) };
    if keys.is_empty() || keys.iter().any(|it| it.is_empty()) {
        return Err(expected(path));
    }
    let is_toml = format!("it = {value}").parse::<toml::Table>().is_ok();
    let value = if is_toml { value.to_owned() } else { toml::Value::from(value).to_string() };
    let header = format!("[scale.{}.node.{}]", key(scale), key(node));
    let mut lines: Vec<&str> = resolved.lines().collect();
    let Some(start) = lines.iter().position(|it| *it == header) else {
        return Err(format!("the rig has no node `{scale}.{node}`"));
    };
    let end = lines[start + 1..].iter().position(|it| it.starts_with('[')).map_or(lines.len(), |it| start + 1 + it);
    let name = keys.iter().map(|it| key(it)).collect::<Vec<_>>().join(".");
    let line = format!("{name} = {value}");
    let prefix = format!("{name} = ");
    match lines[start..end].iter().position(|it| it.starts_with(&prefix)) {
        Some(place) => lines[start + place] = &line,
        None => lines.insert(start + 1, &line),
    }
    Ok(lines.join("\n") + "\n")
}

fn expected(path: &str) -> String {
    format!("found `{path}`, expected SCALE.NODE.SETTING as `face.marks.window_px`")
}

/// A key as resolved rigs write it.
fn key(text: &str) -> String {
    let is_bare = !text.is_empty() && text.bytes().all(|it| it.is_ascii_alphanumeric() || it == b'_' || it == b'-');
    if is_bare { text.to_owned() } else { toml::Value::from(text).to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RIG: &str = "[rig]\nname = \"a\"\n\n[scale.face.node.marks]\ntype = \"x\"\nwindow_px = 15\n\n[scale.face.node.other]\nwindow_px = 15\n";

    #[test]
    fn a_session_from_before_an_output_was_added_is_arranged_as_here() {
        let names = |outputs: [&[&str]; 2]| GraphNames {
            instances: vec!["a".to_owned(), "b".to_owned()],
            edges: vec!["a.x".to_owned()],
            outputs: outputs.map(|it| it.iter().map(|it| (*it).to_owned()).collect()).to_vec(),
        };
        let then = names([&["x"], &["y", "z"]]);
        let fits = |outputs: [&[&str]; 2]| is_arranged(&then, &names(outputs));
        assert!(fits([&["x"], &["y", "z"]]) && fits([&["x", "line_traffic"], &["y", "z"]]));
        assert!(
            !fits([&["line_traffic", "x"], &["y", "z"]]) && !fits([&["x"], &["y"]]) && !fits([&["x"], &["z", "y"]])
        );
        assert!(!is_arranged(&then, &GraphNames { edges: Vec::new(), ..then.clone() }));
        assert_eq!(then.topics(), ["/a/x", "/b/y", "/b/z"]);
    }

    #[test]
    fn a_setting_is_replaced_or_added_at_its_node_alone() {
        let set = |path: &str, value: &str| with_setting(RIG, path, value).unwrap();
        assert_eq!(set("face.marks.window_px", "21"), RIG.replacen("window_px = 15", "window_px = 21", 1));
        let added = set("face.other.name", "two words");
        assert_eq!(added, RIG.replace("[scale.face.node.other]\n", "[scale.face.node.other]\nname = \"two words\"\n"));
        assert!(with_setting(RIG, "face.other2.a", "1").is_err_and(|it| it.contains("`face.other2`")));
        assert!(with_setting(RIG, "face.marks", "1").is_err() && with_setting(RIG, "face.marks..a", "1").is_err());
    }
}
