//! Head-tracked displays [Davis 2002 §6.1]: a view for each eye on each tile.
//!
//! | node | what it does |
//! |---|---|
//! | [`display.viewer`](viewer::Viewer) | predicts the eyes from a head's lights, and computes a frustum for each eye and tile |
//! | [`display.registration`](registration::Registration) | measures the pose of a wall of displays in the room from a light held at its corners, or from dots that it shows |
//! | [`display.page`](page::TilePage) | shows a box behind one tile for the eye's place, and sends the matrices as JSON over a WebSocket |
//! | [`display.osc`](osc::OscViews) | sends the matrices over OSC and UDP |

mod head;
pub mod osc;
pub mod page;
pub mod registration;
pub mod viewer;

use foveate::prelude::Registry;

/// Registers the nodes of this plugin.
pub fn register(registry: &mut Registry) {
    registry.add::<viewer::Viewer>();
    registry.add::<registration::Registration>();
    registry.add::<page::TilePage>();
    registry.add::<osc::OscViews>();
}
