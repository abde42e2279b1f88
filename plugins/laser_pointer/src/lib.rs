//! Laser pointers on a wall of displays: the large scale's machinery in a plane [Davis 2002 §6.1].
//!
//! Positions are metres on the wall: the origin is the top left corner of what the wall can show, x runs to the right, y runs down, z is 0.
//!
//! | node | what it does |
//! |---|---|
//! | [`laser_pointer.calibrator`](calibrator::Calibrator) | maps cameras to the wall by dots that the wall shows |
//! | [`laser_pointer.tracker`](tracker::Tracker) | tracks pointers in the wall's plane, from the spots that each camera finds |

pub mod calibrator;
pub mod tracker;

use foveate::prelude::Registry;

/// Makes the nodes of this plugin known.
pub fn register(registry: &mut Registry) {
    registry.add::<calibrator::Calibrator>();
    registry.add::<tracker::Tracker>();
}
