//! What a session calls things: topics, metadata, attachments.

use foveate_node::port::Ports;
use foveate_rig::graph::Graph;
use serde::{Deserialize, Serialize};

/// Profile of the file: what stands in an MCAP header.
pub const PROFILE: &str = "foveate";
/// Version of what is described here; a reader knows this one and those before it.
pub const VERSION: u32 = 1;
/// Topic of the order of delivery.
pub const ORDER: &str = "/foveate/order";
/// Topic of what was left out so far.
pub const STATUS: &str = "/foveate/status";
/// Encoding of the order of delivery.
pub const ORDER_ENCODING: &str = "foveate.order";
/// Encoding of messages of nodes.
pub const MESSAGE_ENCODING: &str = "msgpack";
/// Metadata of the whole session.
pub const SESSION: &str = "foveate.session";
/// The rig with every default filled in.
pub const RIG: &str = "rig.resolved.toml";
/// The rig with the names that its files have in the session.
pub const REPLAY_RIG: &str = "rig.replay.toml";
/// Metadata written soon after a live recording begins: when its time 0 was, by the clock on the wall.
pub const CLOCK: &str = "foveate.clock";
/// Metadata written when a recording ends in good order.
pub const END: &str = "foveate.end";
/// The names of instances and edges, in the order of their numbers.
pub const GRAPH: &str = "graph.json";
/// Media type of files that are programs.
pub const PROGRAM: &str = "application/x-executable";
/// Where files stand that the rig reads.
pub const FILES: &str = "files/";

/// The topic of an output port: `room.leds[wide-1]` and `features` make `/room/leds/wide-1/features`.
pub fn topic(instance: &str, port: &str) -> String {
    let (node, camera) =
        instance.split_once('[').map_or((instance, None), |(node, rest)| (node, rest.strip_suffix(']')));
    let camera = camera.map_or_else(String::new, |it| format!("/{it}"));
    format!("/{}{camera}/{port}", node.replace('.', "/"))
}

fn outputs(ports: &Ports) -> Vec<String> {
    ports.outputs.iter().map(|it| it.name.to_owned()).collect()
}

/// The names of instances and edges of a graph.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct GraphNames {
    /// By number.
    pub instances: Vec<String>,
    /// By number.
    pub edges: Vec<String>,
    /// By instance: its outputs.
    pub outputs: Vec<Vec<String>>,
}

impl GraphNames {
    /// Of `graph`.
    pub fn of(graph: &Graph) -> GraphNames {
        GraphNames {
            instances: graph.instances.iter().map(|it| it.path.clone()).collect(),
            edges: graph.edges.iter().map(|it| it.name.clone()).collect(),
            outputs: graph.instances.iter().map(|it| outputs(&it.node_type.ports)).collect(),
        }
    }

    /// The topics of all outputs, node by node.
    pub fn topics(&self) -> Vec<String> {
        let of_node = |(path, outputs): (&String, &Vec<String>)| outputs.iter().map(|it| topic(path, it)).collect();
        self.instances.iter().zip(&self.outputs).flat_map::<Vec<String>, _>(of_node).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topics_follow_scale_node_camera_and_port() {
        assert_eq!(topic("room.leds[wide-1]", "features"), "/room/leds/wide-1/features");
        assert_eq!(topic("room.targets", "targets"), "/room/targets/targets");
    }
}
