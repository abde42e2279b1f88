//! `calibrate.recorder`: hands the features of all cameras to the program that runs the rig.

use std::sync::{Arc, Mutex, PoisonError};

use foveate_calibration::coverage::Coverage;
use foveate_calibration::recording::{CameraFrame, Spot};
use foveate_messages::Features;
use foveate_node::error::{ConfigError, NodeError};
use foveate_node::{Io, Node, Ports, Registry, Role, Setup, ports};
use nalgebra::{Point2, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

ports! {
    FEATURES: In<Features> = each("features").many();
}

/// No spot is known better than this [px]; detectors that state less state nothing.
const LEAST_SIGMA_PX: f64 = 1e-3;

/// What was gathered so far.
#[derive(Debug)]
pub struct Gathered {
    /// In the order of delivery.
    pub camera_frames: Vec<CameraFrame>,
    /// Where the light has been.
    pub coverage: Coverage,
    /// By place in the rig's calibration: the number of the camera, where it is used.
    pub numbers: Vec<Option<usize>>,
}

/// Shared between the node and the program.
pub type Shared = Arc<Mutex<Gathered>>;

/// The node has no settings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RecorderSettings {}

/// Keeps what it gets for the program.
pub struct Recorder(Shared);

impl Node for Recorder {
    const TYPE: &'static str = "calibrate.recorder";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Passes features to `foveate calibrate`, which adds this node by itself";
    type Settings = RecorderSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(_settings: RecorderSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let message = format!("`{}` works only in `foveate calibrate`, expected it in no rig", setup.instance);
        Err(ConfigError { setting: None, message })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let mut gathered = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        while let Some(message) = io.take(&FEATURES) {
            let place = usize::from(message.value.camera.0);
            let Some(camera) = gathered.numbers.get(place).copied().flatten() else { continue };
            let spot = |it: &foveate_messages::Feature| Spot {
                pixel: it.centre,
                sigma_px: (it.covariance.trace() / 2.0).max(0.0).sqrt().max(LEAST_SIGMA_PX),
                peak: f64::from(it.peak),
                label: it.label,
            };
            let camera_frame = CameraFrame {
                camera,
                time_s: message.time().as_s(),
                spots: message.value.list.iter().map(spot).collect(),
            };
            gathered.coverage.observe(&without_board(&camera_frame));
            gathered.camera_frames.push(camera_frame);
        }
        Ok(())
    }
}

/// For coverage, the many numbered marks of a board are one spot, in their middle.
fn without_board(camera_frame: &CameraFrame) -> CameraFrame {
    let is_board = camera_frame.spots.len() > 2 && camera_frame.spots.iter().all(|it| it.label.is_some());
    let middle = |it: &CameraFrame| {
        let sum = it.spots.iter().fold(Vector2::zeros(), |sum, spot| sum + spot.pixel.coords);
        Spot { pixel: Point2::from(sum / it.spots.len() as f64), label: None, ..it.spots[0] }
    };
    let spots = if is_board { vec![middle(camera_frame)] } else { camera_frame.spots.clone() };
    CameraFrame { spots, ..*camera_frame }
}

/// Registers the node with a constructor that shares `shared`.
pub fn register(registry: &mut Registry, shared: &Shared) {
    let shared = Arc::clone(shared);
    registry.add_with::<Recorder>(move |_, _| Ok(Recorder(Arc::clone(&shared))));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_board_counts_as_one_spot_and_lights_as_they_are() {
        let spot = |at: usize, label| Spot { pixel: Point2::new(at as f64, 2.0), sigma_px: 0.1, peak: 0.0, label };
        let camera_frame = |label: fn(u32) -> Option<u32>| {
            let spots = (0..5).map(|it| spot(it, label(it as u32))).collect();
            CameraFrame { camera: 1, time_s: 2.0, spots }
        };
        let board = without_board(&camera_frame(Some));
        assert_eq!(board.spots, [spot(2, None)]);
        assert_eq!((board.camera, board.time_s), (1, 2.0));
        assert_eq!(without_board(&camera_frame(|_| None)).spots.len(), 5);
        let wand = CameraFrame { spots: camera_frame(Some).spots[..2].to_vec(), ..board };
        assert_eq!(without_board(&wand), wand);
    }
}
