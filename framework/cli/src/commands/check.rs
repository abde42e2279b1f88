//! `foveate check`: every fault of a rig before anything runs.

use std::path::Path;

use foveate_node::Registry;
use foveate_rig::Overrides;

use super::load;
use crate::exit;
use crate::output::say;

pub(super) fn run(rig: &Path, registry: &Registry) -> u8 {
    match load(rig, registry, &Overrides::default()) {
        Ok(graph) => {
            let (nodes, edges) = (graph.instances.len(), graph.edges.len());
            let cameras = graph.calibration.cameras.len();
            say(&format!("{}: no fault ({nodes} nodes, {edges} edges, {cameras} cameras)\n", rig.display()));
            exit::DONE
        }
        Err(code) => code,
    }
}
