//! Painted marks on a surface that moves and deforms, a face or a knee, seen by cameras of narrow field of view
//! [Davis 2002 ch. 5, §6.1].

pub mod integrator;
pub mod shape_model;
pub mod tracker;

use foveate::prelude::Registry;

/// Registers the nodes of this plugin.
pub fn register(registry: &mut Registry) {
    registry.add::<tracker::TrackerNode>();
    registry.add::<integrator::Integrator>();
    registry.add::<shape_model::Shape>();
}
