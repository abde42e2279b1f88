//! A solved camera network: its cameras, the path of the light, and the residual of each observation.

use foveate_geometry::Camera;
use foveate_geometry::bundle::{CameraCovariance, Freedom, OpticsPrior};
use foveate_geometry::self_calibration::{CameraStatus, Link};
use foveate_scene::uncertainty::Fixed;
use nalgebra::{Point2, Point3, Vector2};

use crate::cause::CameraFault;

/// A solved camera network: the result of every calibration, with all cameras, points and observations.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Solved {
    /// In the order of the recording.
    pub cameras: Vec<SolvedCamera>,
    /// Places of lights and marks, by frame and then by label.
    pub points: Vec<SolvedPoint>,
    /// Observations of them.
    pub observations: Vec<SolvedObservation>,
    /// How the solution was approached, in order.
    pub steps: Vec<Step>,
    /// Pairs of cameras that were oriented with each other.
    pub links: Vec<Link>,
    /// What fixes scale, vertical and origin.
    pub fixed: FixedFreedoms,
    /// By camera: the optics that were to be found, including those that the observations did not determine; empty where all were found.
    pub asked: Vec<Freedom>,
    /// Faults of cameras that were diagnosed during the solution.
    pub camera_faults: Vec<CameraFault>,
}

/// One camera of a [`Solved`] room.
#[derive(Debug, Clone, PartialEq)]
pub struct SolvedCamera {
    /// Its name in the rig.
    pub name: String,
    /// The calibrated camera; as given where the status says that it was not calibrated.
    pub camera: Camera,
    /// Whether it was calibrated, and if not, why.
    pub status: CameraStatus,
    /// Which of its optics were estimated rather than given.
    pub freed: Freedom,
    /// What was known of these beforehand, if anything.
    pub prior: Option<OpticsPrior>,
    /// Covariance of its parameters; `None` when it is not calibrated, or the data do not determine all of them.
    pub covariance: Option<CameraCovariance>,
    /// Its clock, where clocks were estimated.
    pub clock: Option<ClockFit>,
}

impl SolvedCamera {
    /// What was known of its optics beforehand; an uninformative prior if nothing was.
    pub fn known_optics(&self) -> OpticsPrior {
        self.prior.clone().unwrap_or_else(|| OpticsPrior::none(&self.camera))
    }
}

/// The clock of a camera relative to the network's: network time = camera time · (1 + `drift`) + `offset_s`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockFit {
    /// To be added to the camera's time, at its time 0 [s].
    pub offset_s: f64,
    /// Seconds of the network's clock for each of the camera's, less 1 [–].
    pub drift: f64,
    /// Standard deviation of the offset in the middle of the recording [s].
    pub sigma_s: f64,
    /// Pairs of cameras from which it was found: with one, no loop confirms it; 0 for the reference clock and for given clocks.
    pub pairs: usize,
}

impl ClockFit {
    /// The network's time when the camera's clock shows `camera_s` [s].
    pub fn room_s(&self, camera_s: f64) -> f64 {
        camera_s * (1.0 + self.drift) + self.offset_s
    }
}

/// The place of a light or mark at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolvedPoint {
    /// Number of the frame, a moment of the network's time.
    pub frame: usize,
    /// That moment [s].
    pub time_s: f64,
    /// Which light or mark; 0 when there is but one.
    pub label: u32,
    /// Place in the world [m, or the arbitrary unit while no scale is fixed].
    pub position: Point3<f64>,
}

/// The role of an observation in the solution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ObservationRole {
    /// Used in the solution.
    Used,
    /// Held out to test the solution: its point comes from observations of other cameras or other frames.
    HeldOut,
    /// Rejected, since it contradicts the rest.
    Rejected,
    /// Its camera was not calibrated, or its point not found.
    Unsolved,
}

/// An observation of a light or mark by one camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolvedObservation {
    /// Index of the camera.
    pub camera: usize,
    /// Which frame.
    pub frame: usize,
    /// Its place in [`Solved::points`], if that was found.
    pub point: Option<usize>,
    /// Place in the picture, raw [px].
    pub pixel: Point2<f64>,
    /// Predicted − observed, if both camera and point are known [px].
    pub residual: Option<Vector2<f64>>,
    /// Its role in the solution.
    pub role: ObservationRole,
}

/// One step towards the solution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// What was done.
    pub stage: &'static str,
    /// Root of the mean squared length of the residuals in use after it [px].
    pub rms_px: f64,
    /// Observations in use.
    pub used: usize,
}

/// What fixes scale, vertical and origin, which pictures alone do not determine; `None`: not fixed.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FixedFreedoms {
    /// The length of a metre; `sigma` is relative.
    pub scale: Option<Fixed>,
    /// The direction of Z; `sigma` in rad.
    pub gravity: Option<Fixed>,
    /// The place of the origin; `sigma` in m.
    pub origin: Option<Fixed>,
}
