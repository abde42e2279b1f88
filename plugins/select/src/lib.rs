//! Sub-regions without pan-tilt heads: "we might use an overview of the field to select a subset of the cameras in which the scene is currently
//! active", or "process a lower resolution version of each image in order to locate sub-regions of interest" [Davis 2002 §2.2].
//!
//! | node | what it does |
//! |---|---|
//! | `select.cameras` | says which of many fixed cameras see the targets best together |
//! | `select.crop` | follows a target with a part of each picture |
//! | `select.gate` | lets through what those cameras give, and a look by the others now and then |
//!
//! The algorithm is a plain structure that knows no graph: [`cameras::Chooser`].

pub mod cameras;
pub mod crop;
pub mod gate;

use foveate::prelude::Registry;

/// Makes the nodes of this plugin known.
pub fn register(registry: &mut Registry) {
    registry.add::<cameras::CamerasNode>();
    registry.add::<gate::Gate>();
    registry.add::<crop::Crop>();
}
