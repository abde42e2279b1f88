//! What cameras saw, each at its own time, and what is known of their optics.

use foveate_geometry::{Camera, bundle::Freedom};
use nalgebra::Point2;

/// Everything that a calibration is made of.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Recording {
    /// The cameras; a camera's place here is its number.
    pub cameras: Vec<CameraGuess>,
    /// Pictures, those without a spot among them, in the order of their times.
    pub camera_frames: Vec<CameraFrame>,
}

impl Recording {
    /// How people call a camera; its number where it is none of the recording.
    pub fn name(&self, camera: usize) -> String {
        self.cameras.get(camera).map_or_else(|| format!("number {camera}"), |it| it.name.clone())
    }
}

/// What is known of a camera beforehand.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraGuess {
    /// Its name in the rig.
    pub name: String,
    /// Optics as known or guessed; the pose is of no consequence to a calibration from nothing.
    pub camera: Camera,
    /// Which of the optics are to be found; the rest is taken as it stands in `camera`.
    pub free: Freedom,
}

/// One picture.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraFrame {
    /// Which camera.
    pub camera: usize,
    /// When, by the camera's clock [s].
    pub time_s: f64,
    /// What it shows, in no particular order.
    pub spots: Vec<Spot>,
}

/// A light, or a mark of a board, in a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// Its centre, raw [px].
    pub pixel: Point2<f64>,
    /// Standard deviation of either coordinate [px].
    pub sigma_px: f64,
    /// How bright it is, to choose by [gray levels, or any unit].
    pub peak: f64,
    /// Which mark it is, where the detector can tell: the corner of a board, the end of a wand.
    pub label: Option<u32>,
}
