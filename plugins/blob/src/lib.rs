//! Detection in natural scenes, without lights [Davis 2002 §3.3, last paragraph].
//!
//! | node | what it does |
//! |---|---|
//! | `blob.detector` | finds what moves before a learnt background, in the pictures of one camera |
//!
//! It has the ports of `led.detector`: in a rig only `type` and the settings change. The algorithm is a plain structure that
//! knows no graph: [`blob_detector::BlobDetector`].

pub mod blob_detector;
pub mod detector;
mod settings;

pub use settings::{BlobSettings, ReportedPoint};

use foveate::prelude::Registry;

/// Registers the nodes of this plugin.
pub fn register(registry: &mut Registry) {
    registry.add::<detector::Detector>();
}
