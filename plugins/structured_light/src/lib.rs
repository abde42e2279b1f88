//! Structured light: a camera sees a surface on which a projector shows patterns of stripes.
//!
//! | node | what it does |
//! |---|---|
//! | [`structured_light.pictures`](pictures::Pictures) | reads sets of pictures, a folder each |
//! | [`structured_light.projector`](projector::Projector) | shows the patterns on a projector, full screen in a browser, and says when |
//! | [`structured_light.collector`](collector::Collector) | gathers the pictures of a set out of a camera's and of what a projector was told to show |
//! | [`structured_light.decoder`](decoder::Decoder) | finds where in the projector each camera pixel is lit from |
//! | [`structured_light.boundaries`](boundaries::Boundaries) | tracks boundaries of stripes on what moves, picture by picture |
//! | [`structured_light.corners`](corners::Corners) | finds the corners of a chessboard in camera and projector |
//! | [`structured_light.points`](points::Points) | numbers points of whatever stands in the light, in cameras and projector, to calibrate them without a board |
//! | [`structured_light.calibrator`](calibrator::Calibrator) | calibrates camera and projector together from these, and tests each set by the others |
//! | [`structured_light.triangulator`](triangulator::Triangulator) | makes a point cloud with covariances and normals |
//! | [`structured_light.surface`](surface::JoinedSurface) | registers clouds of a thing that may move, and fuses them into one surface |
//!
//! In a calibration the projector is a camera like any other: light runs the other way along the same rays.

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

/// Makes the nodes of this plugin known.
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
