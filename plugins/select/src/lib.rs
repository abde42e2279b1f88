//! Sub-regions without pan-tilt heads: "we might use an overview of the field to select a subset of the cameras in which the scene is currently
//! active", or "process a lower resolution version of each image in order to locate sub-regions of interest" [Davis 2002 §2.2].
//!
//! | node | what it does |
//! |---|---|
//! | `select.cameras` | chooses the fixed cameras that see the targets best together |
//! | `select.crop` | cuts a part around a target out of each picture |
//! | `select.gate` | passes on the pictures of chosen cameras, and every n-th of the others |
//!
//! The algorithm is a plain structure that knows no graph: [`cameras::Chooser`].

pub mod cameras;
pub mod crop;
pub mod gate;

use foveate::prelude::Registry;

/// Registers the nodes of this plugin.
pub fn register(registry: &mut Registry) {
    registry.add::<cameras::CamerasNode>();
    registry.add::<gate::Gate>();
    registry.add::<crop::Crop>();
}
