//! What a page learns first: the rig as it was checked.

use foveate_messages::{Space, SpaceOwner, Wire};
use foveate_node::port::OutputSpec;
use foveate_node::setting_docs::setting_docs;
use foveate_rig::graph::{Edge, Graph, Instance};
use foveate_rig::{live, unit_of};
use foveate_scene::calibration::NamedCamera;
use nalgebra::Isometry3;
use serde_json::{Map, Value, json};

use crate::settings::in_json;

/// Nodes and outputs of a graph, as the page numbers them.
pub struct Index {
    /// By node: its name (`room.leds`) and its instances.
    pub nodes: Vec<(String, Vec<usize>)>,
    /// By topic: instance and output port.
    pub topics: Vec<(usize, usize)>,
}

impl Index {
    /// Of `graph`.
    pub fn of(graph: &Graph) -> Index {
        let mut nodes: Vec<(String, Vec<usize>)> = Vec::new();
        for (index, it) in graph.instances.iter().enumerate() {
            let name = node_name(graph, it);
            match nodes.iter_mut().find(|it| it.0 == name) {
                Some(node) => node.1.push(index),
                None => nodes.push((name, vec![index])),
            }
        }
        let outputs = |index: usize| graph.instances[index].node_type.ports.outputs.len();
        let topics = (0..graph.instances.len()).flat_map(|it| (0..outputs(it)).map(move |port| (it, port)));
        Index { nodes, topics: topics.collect() }
    }
}

fn node_name(graph: &Graph, it: &Instance) -> String {
    format!("{}.{}", graph.scales[it.scale].name, it.node)
}

/// All of it but what the program says of itself: `scales`, `cameras`, `nodes`, `instances`, `topics`, `edges`, `budgets`.
pub fn of_graph(graph: &Graph, index: &Index) -> Map<String, Value> {
    let node_of = |instance: usize| index.nodes.iter().position(|it| it.1.contains(&instance));
    let instances =
        graph.instances.iter().enumerate().map(
            |(number, it)| json!({ "path": it.path, "node": node_of(number), "camera": it.camera.map(|it| it.0) }),
        );
    let topics = index.topics.iter().map(|&(instance, port)| topic(graph, instance, port));
    let edges = graph.edges.iter().map(|it| edge(graph, index, it));
    let budgets = graph.budgets.iter().map(|it| json!({ "from": it.from, "to": it.to, "age_ms": it.age_s * 1e3 }));
    let mut map = Map::new();
    map.insert("scales".to_owned(), scales(graph));
    map.insert("cameras".to_owned(), cameras(graph));
    map.insert("nodes".to_owned(), index.nodes.iter().map(|it| node(graph, it)).collect());
    map.insert("instances".to_owned(), instances.collect());
    map.insert("topics".to_owned(), topics.collect());
    map.insert("edges".to_owned(), edges.collect());
    map.insert("budgets".to_owned(), budgets.collect());
    map
}

fn scales(graph: &Graph) -> Value {
    let number = |name: &String| graph.scales.iter().position(|it| it.name == *name);
    let scale = |it: &foveate_rig::graph::Scale| {
        json!({
            "name": it.name, "parent": it.parent.as_ref().and_then(number), "anchor": it.anchor,
            "volume_m": it.volume_m, "radius_m": it.radius_m,
        })
    };
    graph.scales.iter().map(scale).collect()
}

fn cameras(graph: &Graph) -> Value {
    let calibration = &graph.calibration;
    let camera = |it: &NamedCamera| {
        let optics = &it.camera.intrinsics;
        json!({
            "name": it.name, "size": it.camera.image_size, "focal": optics.focal, "principal": optics.principal,
            "on_head": calibration.heads.0.contains_key(&it.name), "camera_from_world": pose(&it.camera.camera_from_world),
        })
    };
    calibration.cameras.iter().map(camera).collect()
}

/// A pose as messages write it.
pub fn pose(it: &Isometry3<f64>) -> Value {
    let (turn, shift) = (it.rotation.coords, it.translation.vector);
    json!({ "rotation": [turn.x, turn.y, turn.z, turn.w], "translation": [shift.x, shift.y, shift.z] })
}

fn node(graph: &Graph, (name, instances): &(String, Vec<usize>)) -> Value {
    let first = &graph.instances[instances[0]];
    json!({
        "name": name, "type": first.node_type.name, "role": first.node_type.role.name(), "summary": first.node_type.summary,
        "scale": first.scale, "instances": instances, "settings": settings(first),
    })
}

fn settings(instance: &Instance) -> Value {
    let present = live::table(&*instance.settings).map(|it| in_json(&it)).unwrap_or_default();
    let root = instance.node_type.schema.as_value();
    let docs = setting_docs(&instance.node_type).into_iter().map(|it| {
        let value = it.name.split('.').try_fold(&present, |at, key| at.get(key)).cloned();
        let bounds = root.pointer(&format!("/properties/{}", it.name.replace('.', "/properties/")));
        let bound = |name: &str, exclusive: &str| bounds.and_then(|it| it.get(name).or(it.get(exclusive))).cloned();
        let choices = it.kind.strip_prefix("one of ").map(|it| it.split(", ").map(|it| it.trim_matches('"').to_owned()));
        let kind = match it.kind.as_str() {
            "integer" => "integer",
            "number" => "number",
            "true or false" => "boolean",
            "text" => "text",
            _ if choices.is_some() => "choice",
            _ => "json",
        };
        let unit = unit_of(&it.description).filter(|it| *it != "–").unwrap_or_default();
        let help = it.description.rfind('[').map_or(it.description.as_str(), |at| it.description[..at].trim_end());
        json!({
            "name": it.name, "kind": kind, "unit": unit, "help": help, "value": value, "default": default(root, &it.name),
            "min": bound("minimum", "exclusiveMinimum"), "max": bound("maximum", "exclusiveMaximum"),
            "choices": choices.map(|it| it.collect::<Vec<_>>()), "live": it.is_live,
        })
    });
    docs.collect()
}

fn default(root: &Value, name: &str) -> Option<Value> {
    root.pointer(&format!("/properties/{}/default", name.replace('.', "/properties/"))).cloned()
}

fn topic(graph: &Graph, instance: usize, port: usize) -> Value {
    let it = &graph.instances[instance];
    let OutputSpec { name, message } = &it.node_type.ports.outputs[port];
    let Space { owner, unit, .. } = message.space;
    let owner = match owner {
        SpaceOwner::Nobody => "none",
        SpaceOwner::Camera => "camera",
        SpaceOwner::EachCamera => "each camera",
        SpaceOwner::Scale => "scale",
        SpaceOwner::ParentScale => "parent scale",
        SpaceOwner::World => "world",
        SpaceOwner::Stated => "stated",
        SpaceOwner::Other(_) => "other",
    };
    json!({
        "path": format!("{}.{name}", it.path), "instance": instance, "port": name, "message": message.name, "camera": it.camera.map(|it| it.0),
        "scale": it.scale, "owner": owner, "unit": unit, "portable": matches!(message.wire, Wire::Portable(_)),
    })
}

fn edge(graph: &Graph, index: &Index, it: &Edge) -> Value {
    let input = &graph.instances[it.to.0].node_type.ports.inputs[it.to.1];
    let require = it.require.map(|it| {
        json!({ "age_ms": it.age_s.map(|it| it * 1e3), "rate_hz": it.rate_hz, "sigma": it.sigma, "loss": it.loss })
    });
    json!({
        "name": it.name, "from": [it.from.0, it.from.1], "to": [it.to.0, it.to.1], "input": input.name, "feedback": it.feedback,
        "topic": index.topics.iter().position(|topic| *topic == it.from), "require": require,
    })
}
