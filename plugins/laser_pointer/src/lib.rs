//! Laser pointers on a wall of displays: the large scale's machinery in a plane [Davis 2002 §6.1].
//!
//! Positions are metres on the wall: the origin is the top left corner of the displayed area, x runs to the right, y runs down, z is 0.
//!
//! | node | what it does |
//! |---|---|
//! | [`laser_pointer.calibrator`](calibrator::Calibrator) | maps cameras to the wall from dots or a chessboard that it shows |
//! | [`laser_pointer.wave_calibrator`](waved::WaveCalibrator) | maps cameras to the wall from a waved pointer alone |
//! | [`laser_pointer.tracker`](tracker::Tracker) | tracks pointers in the wall's plane, from the spots that each camera finds |
//! | [`laser_pointer.events`](events::Events) | filters jitter and sends events: press, move, hover, dwell, release, strokes |
//! | [`laser_pointer.page`](page::DrawingPage) | shows strokes and pointers on a page, and sends them as JSON over a WebSocket |
//! | [`laser_pointer.tuio`](tuio::Tuio) | sends pointers to TUIO 1.1 clients over UDP |
//! | [`laser_pointer.uinput`](uinput::Uinput) | presents pointers as a touch screen or a mouse of Linux |

pub mod calibrator;
pub mod events;
pub mod page;
pub mod smoothing;
pub mod tracker;
pub mod tuio;
pub mod uinput;
mod wall;
pub mod waved;

use foveate::prelude::Registry;

/// Registers the nodes of this plugin.
pub fn register(registry: &mut Registry) {
    registry.add::<calibrator::Calibrator>();
    registry.add::<waved::WaveCalibrator>();
    registry.add::<tracker::Tracker>();
    registry.add::<events::Events>();
    registry.add::<page::DrawingPage>();
    registry.add::<tuio::Tuio>();
    registry.add::<uinput::Uinput>();
}
