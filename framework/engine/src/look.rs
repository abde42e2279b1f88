//! What viewers see of a run: the newest message of each output.
//!
//! A node that gives out a message never waits for a viewer: where one reads the slot at that moment, the message is not shown. A run without viewers has no slots.

use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use foveate_messages::Wire;
use foveate_node::io::Packet;
use foveate_rig::graph::Graph;

/// Where viewers look into a run. Clones are the same.
#[derive(Clone)]
pub struct Look(Arc<Vec<Vec<Slot>>>);

/// The newest message of an output; `None`: its messages stay with the nodes.
type Slot = Option<Mutex<Option<Packet>>>;

impl Look {
    /// A look into runs of `graph`.
    pub fn new(graph: &Graph) -> Look {
        let slots = graph.instances.iter().map(|instance| {
            let outputs = instance.node_type.ports.outputs.iter();
            outputs.map(|it| matches!(it.message.wire, Wire::Portable(_)).then(Mutex::default)).collect()
        });
        Look(Arc::new(slots.collect()))
    }

    /// The newest message of an output.
    pub fn newest(&self, instance: usize, port: usize) -> Option<Packet> {
        self.slot(instance, port)?.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// A node gives out a message.
    #[inline]
    pub(crate) fn see(&self, instance: usize, port: usize, packet: &Packet) {
        let Some(slot) = self.slot(instance, port) else { return };
        let old = match slot.try_lock() {
            Ok(mut newest) => newest.replace(packet.clone()),
            Err(_) => None,
        };
        drop(old);
    }

    fn slot(&self, instance: usize, port: usize) -> Option<&Mutex<Option<Packet>>> {
        self.0.get(instance)?.get(port)?.as_ref()
    }
}

impl fmt::Debug for Look {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Look").finish_non_exhaustive()
    }
}
