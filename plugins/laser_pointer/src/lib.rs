//! Laser pointers on a wall of displays: the large scale's machinery in a plane [Davis 2002 §6.1].
//!
//! Positions are metres on the wall: the origin is the top left corner of what the wall can show, x runs to the right, y runs down, z is 0.

use foveate::prelude::Registry;

/// Makes the nodes of this plugin known.
pub fn register(_registry: &mut Registry) {}
