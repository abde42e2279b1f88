//! A room that was solved: its cameras, the path of the light, and how each observation fits.

use foveate_geometry::Camera;
use foveate_geometry::bundle::{CameraCovariance, Freedom, OpticsPrior};
use foveate_geometry::self_calibration::{CameraStatus, Link};
use foveate_scene::uncertainty::Fixed;
use nalgebra::{Point2, Point3, Vector2};

use crate::cause::Culprit;

/// Cameras, points and observations of a room that was calibrated.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Solved {
    /// In the order of the recording.
    pub cameras: Vec<SolvedCamera>,
    /// The places of lights and marks, by frame and then by label.
    pub points: Vec<SolvedPoint>,
    /// What was seen of them.
    pub observations: Vec<SolvedObservation>,
    /// How the solution was approached, in order.
    pub steps: Vec<Step>,
    /// Pairs of cameras that were oriented with each other.
    pub links: Vec<Link>,
    /// What fixes scale, vertical and origin.
    pub fixed: FixedFreedoms,
    /// By camera: what was to be found of its optics, be it that the observations did not hold it; empty where that is what was found.
    pub asked: Vec<Freedom>,
    /// What is wrong with cameras, as far as it was found on the way.
    pub culprits: Vec<Culprit>,
}

/// One camera of a [`Solved`] room.
#[derive(Debug, Clone, PartialEq)]
pub struct SolvedCamera {
    /// Its name in the rig.
    pub name: String,
    /// As found; as given where the status says that it could not be.
    pub camera: Camera,
    /// Whether it was found, and if not, why.
    pub status: CameraStatus,
    /// Which of its optics were found rather than given.
    pub freed: Freedom,
    /// What was known of these beforehand, where that is more than nothing.
    pub prior: Option<OpticsPrior>,
    /// How well it is known; `None` when it is not calibrated, or the data leave something open.
    pub covariance: Option<CameraCovariance>,
    /// Its clock, where clocks were estimated.
    pub clock: Option<ClockFit>,
}

impl SolvedCamera {
    /// What was known of its optics beforehand, be it nothing.
    pub fn known_optics(&self) -> OpticsPrior {
        self.prior.clone().unwrap_or_else(|| OpticsPrior::none(&self.camera))
    }
}

/// How far the clock of a camera is from that of the room: room time = camera time · (1 + `drift`) + `offset_s`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockFit {
    /// To be added to the camera's time, at its time 0 [s].
    pub offset_s: f64,
    /// Seconds of the room for each of the camera's, less 1 [–].
    pub drift: f64,
    /// Standard deviation of the offset in the middle of the recording [s].
    pub sigma_s: f64,
    /// Pairs of cameras that it was found by: one has no loop that could contradict it; 0 where the clock is the room's or was given.
    pub pairs: usize,
}

impl ClockFit {
    /// The room's time when the camera's clock shows `camera_s` [s].
    pub fn room_s(&self, camera_s: f64) -> f64 {
        camera_s * (1.0 + self.drift) + self.offset_s
    }
}

/// A place in space, at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolvedPoint {
    /// Number of the frame, which is a moment of the room's time.
    pub frame: usize,
    /// That moment [s].
    pub time_s: f64,
    /// Which light or mark; 0 when there is but one.
    pub label: u32,
    /// Where, in the world [m, or the unit that the scale is in].
    pub position: Point3<f64>,
}

/// What became of an observation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ObservationRole {
    /// The solution was made of it.
    Used,
    /// It was held out, to test the solution: its point comes from other cameras' observations or other frames'.
    HeldOut,
    /// It contradicts the rest.
    Rejected,
    /// Its camera or its point was not found.
    Unsolved,
}

/// A light or a mark as a camera saw it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolvedObservation {
    /// Which camera.
    pub camera: usize,
    /// Which frame.
    pub frame: usize,
    /// Its place in [`Solved::points`], if that was found.
    pub point: Option<usize>,
    /// Where it was seen, raw [px].
    pub pixel: Point2<f64>,
    /// Where the solution has it − where it was seen, if both camera and point are known [px].
    pub residual: Option<Vector2<f64>>,
    /// What became of it.
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

/// What fixes the freedoms that pictures alone leave open; `None`: nothing does.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FixedFreedoms {
    /// The length of a metre; `sigma` is relative.
    pub scale: Option<Fixed>,
    /// The direction of Z; `sigma` in rad.
    pub gravity: Option<Fixed>,
    /// The place of the origin; `sigma` in m.
    pub origin: Option<Fixed>,
}
