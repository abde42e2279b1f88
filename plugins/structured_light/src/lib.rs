//! Structured light: a camera sees a surface on which a projector shows patterns of stripes.
//!
//! | node | what it does |
//! |---|---|
//! | [`structured_light.pictures`](pictures::Pictures) | reads sets of pictures, a folder each |
//! | [`structured_light.projector`](projector::Projector) | shows the patterns on a projector, full screen in a browser, and reports when |
//! | [`structured_light.collector`](collector::Collector) | collects the pictures of a set from a camera's pictures and the projector's reports |
//! | [`structured_light.decoder`](decoder::Decoder) | decodes which projector position lights each camera pixel |
//! | [`structured_light.boundaries`](boundaries::Boundaries) | tracks stripe boundaries on moving surfaces, picture by picture |
//! | [`structured_light.corners`](corners::Corners) | finds the corners of a chessboard in camera and projector |
//! | [`structured_light.points`](points::Points) | matches points of any lit scene between cameras and projector, to calibrate them without a board |
//! | [`structured_light.calibrator`](calibrator::Calibrator) | calibrates camera and projector together from these, and tests each set by the others |
//! | [`structured_light.triangulator`](triangulator::Triangulator) | makes a point cloud with covariances and normals |
//! | [`structured_light.surface`](surface::JoinedSurface) | registers clouds of an object that may move, and fuses them into one surface |
//!
//! In a calibration the projector is an inverse camera: light runs the other way along the same rays.

pub mod boundaries;
mod boundary_map;
pub mod calibrator;
pub mod collector;
pub mod corners;
mod counter;
pub mod decoder;
pub mod files;
mod foresight;
mod moved;
mod orientation;
pub mod pair;
pub mod pattern;
mod picture_file;
pub mod pictures;
pub mod points;
#[cfg(test)]
mod procam_tests;
pub mod projector;
pub mod surface;
pub mod triangulator;
mod unfit;

pub use pattern::PatternSettings;

use foveate::prelude::Registry;

/// Registers the nodes of this plugin.
pub fn register(registry: &mut Registry) {
    registry.add::<pictures::Pictures>();
    registry.add::<projector::Projector>();
    registry.add::<collector::Collector>();
    registry.add::<decoder::Decoder>();
    registry.add::<boundaries::Boundaries>();
    registry.add::<corners::Corners>();
    registry.add::<points::Points>();
    registry.add::<calibrator::Calibrator>();
    registry.add::<triangulator::Triangulator>();
    registry.add::<surface::JoinedSurface>();
}
