//! Displays that know where somebody stands [Davis 2002 §6.1]: a view for each eye on each tile.
//!
//! | node | what it does |
//! |---|---|
//! | [`display.viewer`](viewer::Viewer) | from a head's lights to where its eyes will be, and a frustum for each eye and tile |
//! | [`display.registration`](registration::Registration) | where a wall of displays stands in the room, by a light that is held at its corners |
//! | [`display.page`](page::TilePage) | shows a box behind one tile for the eye's place, and sends the matrices as JSON over a WebSocket |
//! | [`display.osc`](osc::OscViews) | sends the matrices over OSC and UDP |

mod head;
pub mod osc;
pub mod page;
pub mod registration;
pub mod viewer;

use foveate::prelude::Registry;

/// Makes the nodes of this plugin known.
pub fn register(registry: &mut Registry) {
    registry.add::<viewer::Viewer>();
    registry.add::<registration::Registration>();
    registry.add::<page::TilePage>();
    registry.add::<osc::OscViews>();
}
