//! Sources: cameras, picture sequences, videos, 2D detections, motion files.
//!
//! | node | what it reads |
//! |---|---|
//! | [`capture.v4l`](v4l::V4l) | a camera of this machine; needs the feature `hardware` to run |
//! | [`capture.images`](images::Images) | a folder of JPEG or PNG pictures, numbered in their names |
//! | [`capture.video`](video::Video) | a video file, decoded by an `ffmpeg` child process |
//! | [`capture.detections`](detections::Detections) | 2D points of one or more cameras in a CSV file |
//! | [`capture.motion`](motion::CaptureMotion) | targets and marks in a motion file: C3D, TRC, BVH, our own tables, NPZ |
//!
//! What cannot be read is a counted gap at its own capture time, with a reason that names the file; a file or folder
//! without any usable frame is refused before the run.

mod clock;
mod decode;
pub mod detections;
mod detections_csv;
pub mod encoder;
mod ffmpeg;
mod ffmpeg_words;
pub mod images;
pub mod labels;
mod listing;
pub mod motion;
mod points_dat;
pub mod settings;
pub mod size;
#[cfg_attr(
    not(all(feature = "hardware", target_os = "linux")),
    allow(dead_code, reason = "constructed by real cameras only, but built and tested without one")
)]
pub mod v4l;
pub mod video;

use foveate::prelude::Registry;

/// Registers the nodes of this plugin.
pub fn register(registry: &mut Registry) {
    registry.add::<v4l::V4l>();
    registry.add::<images::Images>();
    registry.add::<video::Video>();
    registry.add::<detections::Detections>();
    registry.add::<motion::CaptureMotion>();
}
