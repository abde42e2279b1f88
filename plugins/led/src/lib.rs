//! LED detection and integration [Davis 2002 §3.3, §3.4, §3.6].
//!
//! | node | what it does |
//! |---|---|
//! | `led.detector` | finds bright lights in the pictures of one camera |
//! | `led.integrator` | tracks targets in space from the lights of all cameras, each in its own time |
//! | `led.triangulator` | the same for synchronised cameras, without a motion model: for comparison |
//! | `led.clocks` | estimates offset and rate of each camera's clock from the path of one target |
//! | `led.camera_watch` | detects that a camera was bumped, and by how much |
//! | `led.path_error` | compares recovered targets with a measured path, in metres |
//! | `led.reprojection` | compares recovered targets with what the cameras saw, in pixels |
//!
//! The algorithms are plain structures that know no graph: [`led_detector::LedDetector`], [`tracker::Tracker`],
//! [`triangulator::Triangulator`], [`camera_watch::Watch`], [`clocks::search`](clocks::search::search), [`reprojection::Comparison`].

pub mod camera_watch;
pub mod clocks;
pub mod consensus;
pub mod detector;
pub mod integrator;
pub mod led_detector;
pub mod path_error;
pub mod reprojection;
pub mod tracker;
pub mod triangulator;

use foveate::prelude::Registry;

/// Registers the nodes of this plugin.
pub fn register(registry: &mut Registry) {
    registry.add::<detector::Detector>();
    registry.add::<integrator::Integrator>();
    registry.add::<triangulator::TriangulatorNode>();
    registry.add::<reprojection::Reprojection>();
    registry.add::<clocks::ClocksNode>();
    registry.add::<path_error::PathError>();
    registry.add::<camera_watch::CameraWatch>();
}
