//! The input of a calibration: observations of each camera with their times, and what is known of the optics.

use foveate_geometry::{Camera, bundle::Freedom};
use nalgebra::Point2;

/// The input of a calibration: cameras and their pictures.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Recording {
    /// The cameras; a camera's place here is its number.
    pub cameras: Vec<CameraGuess>,
    /// Pictures, those without a spot among them, in the order of their times.
    pub camera_frames: Vec<CameraFrame>,
}

impl Recording {
    /// The name of camera `camera`, for messages; its number if the recording has no such camera.
    pub fn name(&self, camera: usize) -> String {
        self.cameras.get(camera).map_or_else(|| format!("number {camera}"), |it| it.name.clone())
    }
}

/// A camera with what is known of its optics beforehand.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraGuess {
    /// Its name in the rig.
    pub name: String,
    /// Optics as known or guessed; a calibration from nothing ignores the pose.
    pub camera: Camera,
    /// Which of the optics are to be found; the rest stays as in `camera`.
    pub free: Freedom,
}

/// One picture of one camera, reduced to its detected spots.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraFrame {
    /// Index of the camera.
    pub camera: usize,
    /// Time by the camera's clock [s].
    pub time_s: f64,
    /// The detected spots, in any order.
    pub spots: Vec<Spot>,
}

/// The image of a light, or of a mark of a board, in a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// Its centre, raw [px].
    pub pixel: Point2<f64>,
    /// Standard deviation of either coordinate [px].
    pub sigma_px: f64,
    /// Brightness, by which spots are chosen [gray levels, or any unit].
    pub peak: f64,
    /// Which mark it is, where the detector can tell: the corner of a board, the end of a wand.
    pub label: Option<u32>,
}
