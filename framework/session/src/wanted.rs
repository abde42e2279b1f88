//! Which messages of a rig are recorded.

use std::sync::Arc;

use foveate_engine::tap::Wanted;
use foveate_node::Role;
use foveate_rig::graph::Graph;
use foveate_scene::selection::matches;

use crate::hidden::Hidden;
use crate::picture::Pictures;

/// Names of messages that are pictures, which are left out first.
const PICTURES: [&str; 3] = ["image", "pattern_pictures", "silhouette"];
/// Names of messages that are recorded although no edge carries them: people read them after the run.
const FOR_PEOPLE: [&str; 1] = ["line_traffic"];

/// Sentences about what `[record]` of a rig names and the rig does not have.
pub fn misnamed(graph: &Arc<Graph>) -> Vec<String> {
    let Some(record) = &graph.record else { return Vec::new() };
    let cameras = &graph.calibration.cameras;
    let unknown = record.cameras.iter().filter(|it| !cameras.iter().any(|camera| matches(&it.0, &camera.name)));
    let unknown = unknown.map(|it| format!("`cameras` of `[record]` names `{}`, which is no camera of the rig", it.0));
    unknown.chain(Hidden::new(graph, &record.hide_px, &record.hide_scales).err()).collect()
}

/// Whether an output port gives pictures.
pub(crate) fn is_picture(graph: &Graph, instance: usize, port: usize) -> bool {
    PICTURES.contains(&graph.instances[instance].node_type.ports.outputs[port].message.name)
}

/// Whether the messages of an output port are recorded. What no edge carries is not, unless it is [for people](FOR_PEOPLE), nor are pictures that only sinks take.
pub(crate) fn is_wanted(graph: &Graph, instance: usize, port: usize, with_pictures: bool) -> bool {
    let output = &graph.instances[instance].node_type.ports.outputs[port];
    let mut consumers = graph.edges.iter().filter(|it| it.from == (instance, port)).map(|it| it.to.0);
    let is_used = consumers.clone().next().is_some() || FOR_PEOPLE.contains(&output.message.name);
    let only_shown = consumers.all(|it| graph.instances[it].node_type.role == Role::Sink);
    let is_picture_wanted = !is_picture(graph, instance, port) || (with_pictures && !only_shown);
    output.message.wire.codec().is_some() && is_used && is_picture_wanted
}

/// By instance and port: which messages are recorded.
pub(crate) fn wanted(graph: &Graph, pictures: &[Pictures], with_unused: bool) -> Vec<Vec<Wanted>> {
    let of_port =
        |instance: usize, port: usize| match is_wanted(graph, instance, port, pictures[instance] != Pictures::None)
            || with_unused
        {
            false => Wanted::No,
            true if is_picture(graph, instance, port) => Wanted::First,
            true => Wanted::Yes,
        };
    let ports = |instance: usize| 0..graph.instances[instance].node_type.ports.outputs.len();
    (0..graph.instances.len()).map(|it| ports(it).map(|port| of_port(it, port)).collect()).collect()
}
