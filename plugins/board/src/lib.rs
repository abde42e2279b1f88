//! Boards that cameras are calibrated with.
//!
//! | node | what it does |
//! |---|---|
//! | `board.detector` | finds the inner corners of a chessboard, each with its number, in the pictures of one camera |
//!
//! It has the ports of `led.detector`, but for predictions. `foveate calibrate` takes the board's pattern and size from its settings.

pub mod detector;

pub use detector::BoardSettings;
use foveate::prelude::Registry;

/// Registers the nodes of this plugin.
pub fn register(registry: &mut Registry) {
    registry.add::<detector::Detector>();
}
