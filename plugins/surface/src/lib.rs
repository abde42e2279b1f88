//! Surfaces without markers: matched between views by least squares, and tracked over time [D'Apuzzo 1999 §2].
//!
//! | node | what it does |
//! |---|---|
//! | [`surface.target`](target) | finds a target of numbered columns of rectangles in a picture |
//! | [`surface.calibrator`](calibrator) | calibrates cameras around it |
//! | [`surface.matcher`](matcher) | measures a surface densely at one moment |
//! | [`surface.tracker`](tracker) | measures it once, and then tracks its points |
//! | [`surface.cylinder`](cylinder) | fits a cylinder to a cloud: figures |
//! | [`surface.body`](body) | fits a body of metaballs on a skeleton to tracked points |
//! | [`surface.pictures`](pictures) | draws trajectories and the vector field |

pub mod bent;
pub mod body;
pub mod calibrator;
pub mod clouds;
pub mod cover;
pub mod cylinder;
pub mod engine;
pub mod filters;
pub mod guide;
pub mod in_step;
pub mod lost;
pub mod matcher;
pub mod measure;
pub mod path;
pub mod pictures;
pub mod repeats;
pub mod seeds;
pub mod settings;
pub mod target;
#[cfg(test)]
mod tests;
pub mod tracker;
pub mod tracks;
pub mod views;

use foveate::prelude::Registry;

/// Registers the nodes of this plugin.
pub fn register(registry: &mut Registry) {
    registry.add::<target::TargetDetector>();
    registry.add::<calibrator::TargetCalibrator>();
    registry.add::<matcher::Matcher>();
    registry.add::<tracker::Tracker>();
    registry.add::<cylinder::CylinderFit>();
    registry.add::<body::BodyFitter>();
    registry.add::<pictures::Pictures>();
}
