//! What became of each camera, which of its optics could not be found, and why there may be no answer at all.

use nalgebra::Point2;

use crate::bundle::Optic;
use crate::camera::CameraError;

/// What became of a camera.
#[derive(Debug, Clone, PartialEq)]
pub enum CameraStatus {
    /// Its pose is known.
    Calibrated,
    /// It saw too little.
    TooFewObservations {
        /// In how many frames it saw the light.
        frames: usize,
        /// How many are needed.
        needed: usize,
    },
    /// What it saw stays in place, or on a line.
    LightStill {
        /// Standard deviation of its pixels across the line along which they spread most [px].
        spread_px: f64,
    },
    /// It shares too few frames with any other camera.
    NoPartner {
        /// The camera with which it shares most, if any.
        best: Option<usize>,
        /// How many frames these two share.
        common: usize,
        /// How many are needed.
        needed: usize,
    },
    /// It shares frames, but its pixels fit no pose: a moved camera, a wrong lens, the track of another camera.
    Inconsistent {
        /// The partner that it fits best.
        best: usize,
        /// Frames shared with that.
        common: usize,
        /// Of which fit.
        right: usize,
    },
    /// It stands where its partners stand, or the light is too far away for a depth.
    NoDepth {
        /// The partner with which it shares most.
        best: usize,
    },
    /// It was oriented with others, but shares no frames with the larger group that was calibrated.
    Separate {
        /// The cameras of its own group.
        group: Vec<usize>,
    },
    /// How far its clock is from those of the others could not be told.
    ClockOpen {
        /// The camera beside which it came closest, if any.
        best: Option<usize>,
    },
    /// Its focal length cannot be told: too little depth, or a path in a plane.
    FocalOpen {
        /// Standard deviation, relative [–]; infinite when it is entirely open.
        sigma: f64,
    },
}

impl CameraStatus {
    /// What became of it, the cameras that it speaks of by `name`.
    pub fn sentence(&self, name: impl Fn(usize) -> String) -> String {
        match self {
            CameraStatus::Calibrated => "calibrated".to_owned(),
            CameraStatus::TooFewObservations { frames, needed } => {
                format!("saw the light in {frames} frames, expected at least {needed}")
            }
            CameraStatus::LightStill { spread_px } => {
                format!("the light stays in place or on a line: {spread_px:.2} px across it")
            }
            CameraStatus::NoPartner { best: Some(best), common, needed } => {
                format!("shares {common} frames with {} and fewer with others, expected at least {needed}", name(*best))
            }
            CameraStatus::NoPartner { best: None, .. } => "shares no frame with another camera".to_owned(),
            CameraStatus::Inconsistent { common: 0, .. } => {
                "never saw the light where two of the other cameras saw it too".to_owned()
            }
            CameraStatus::Inconsistent { best, common, right } => {
                format!("no pose explains its pixels: with {}, {right} of {common} common frames fit", name(*best))
            }
            CameraStatus::NoDepth { best } => {
                format!("stands where {} stands, or the light is too far away", name(*best))
            }
            CameraStatus::Separate { group } => {
                let group: Vec<String> = group.iter().map(|it| name(*it)).collect();
                format!("shares too few frames with the larger group of cameras; its own is {}", group.join(", "))
            }
            CameraStatus::ClockOpen { best: Some(best) } => {
                format!("its clock could not be found, nearest beside that of {}", name(*best))
            }
            CameraStatus::ClockOpen { best: None } => "its clock could not be found".to_owned(),
            CameraStatus::FocalOpen { sigma } if sigma.is_infinite() => {
                "nothing tells its focal length: too little depth, or a flat path".to_owned()
            }
            CameraStatus::FocalOpen { sigma } => {
                format!("its focal length is known to {:.1} % only: too little depth, or a flat path", 100.0 * sigma)
            }
        }
    }
}

impl std::fmt::Display for CameraStatus {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        to.write_str(&self.sentence(|it| format!("camera {it}")))
    }
}

/// An optic that was to be found and stays as it was given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OpticHeld {
    /// Which.
    pub optic: Optic,
    /// Why.
    pub reason: HeldBecause,
}

/// Why an optic was not freed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum HeldBecause {
    /// Nothing tells it from the others.
    Open,
    /// With it, observations that had been held out were predicted no better.
    HoldOut {
        /// Their error with this camera's optics as given, root mean square [px].
        held_px: f64,
        /// And with its optics free [px].
        freed_px: f64,
    },
}

impl std::fmt::Display for OpticHeld {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(to, "{} stays as given: ", self.optic)?;
        match self.reason {
            HeldBecause::Open => write!(to, "the observations leave it open"),
            HeldBecause::HoldOut { held_px, freed_px } => {
                write!(to, "observations held out are {held_px:.2} px off with it held, {freed_px:.2} px with it free")
            }
        }
    }
}

/// Why there is no answer at all.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SelfCalibrationError {
    /// One camera, or none.
    #[error("{count} cameras, expected at least 2")]
    TooFewCameras {
        /// How many.
        count: usize,
    },
    /// Not as many of one as of the other.
    #[error("{cameras} cameras and {freedoms} lists of what is free, expected as many of each")]
    LengthsDiffer {
        /// How many cameras.
        cameras: usize,
        /// How many lists.
        freedoms: usize,
    },
    /// A camera with a number that is none.
    #[error("camera {camera}: {fault}")]
    BadCamera {
        /// Which.
        camera: usize,
        /// What is wrong.
        fault: CameraError,
    },
    /// An observation by nobody, or of nothing.
    #[error(
        "observation {observation} is of camera {camera} at pixel {pixel}, expected a camera below {cameras} and finite numbers"
    )]
    BadObservation {
        /// Which.
        observation: usize,
        /// Its camera.
        camera: usize,
        /// Its pixel [px].
        pixel: Point2<f64>,
        /// How many cameras there are.
        cameras: usize,
    },
    /// Two pixels of one light in one picture.
    #[error("camera {camera} sees the light twice in frame {frame}, expected once at most")]
    SeenTwice {
        /// Which camera.
        camera: usize,
        /// Which frame.
        frame: usize,
    },
    /// A rule that cannot be followed.
    #[error("{rule} is {found}, expected more than 0")]
    BadRule {
        /// Which.
        rule: &'static str,
        /// Its value.
        found: f64,
    },
    /// No two cameras could be calibrated together; the reason of each.
    #[error("no two cameras could be calibrated: {}", status.iter().enumerate().map(|(camera, it)| format!("camera {camera}: {it}")).collect::<Vec<_>>().join("; "))]
    NothingCalibrated {
        /// By camera.
        status: Vec<CameraStatus>,
    },
}

impl SelfCalibrationError {
    /// Why, the cameras that it speaks of by `name`.
    pub fn sentence(&self, name: impl Fn(usize) -> String) -> String {
        match self {
            SelfCalibrationError::BadCamera { camera, fault } => format!("{}: {fault}", name(*camera)),
            SelfCalibrationError::SeenTwice { camera, frame } => {
                format!("{} sees the light twice in frame {frame}, expected once at most", name(*camera))
            }
            SelfCalibrationError::NothingCalibrated { status } => {
                let each =
                    status.iter().enumerate().map(|(camera, it)| format!("{}: {}", name(camera), it.sentence(&name)));
                format!("no two cameras could be calibrated: {}", each.collect::<Vec<_>>().join("; "))
            }
            other => other.to_string(),
        }
    }
}
