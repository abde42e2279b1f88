//! Outcome for each camera, optics that could not be estimated, and errors.

use nalgebra::Point2;

use crate::bundle::Optic;
use crate::camera::CameraError;

/// Outcome of self-calibration for a camera.
#[derive(Debug, Clone, PartialEq)]
pub enum CameraStatus {
    /// Its pose was found.
    Calibrated,
    /// It saw the light in too few frames.
    TooFewObservations {
        /// Frames in which it saw the light.
        frames: usize,
        /// Frames that are needed.
        needed: usize,
    },
    /// Its pixels lie in one place, or on a line.
    LightStill {
        /// Standard deviation of its pixels across the line of largest spread [px].
        spread_px: f64,
    },
    /// It shares too few frames with any other camera.
    NoPartner {
        /// The camera with which it shares most frames, if any.
        best: Option<usize>,
        /// Frames shared with that camera.
        common: usize,
        /// Frames that are needed.
        needed: usize,
    },
    /// It shares frames, but its pixels fit no pose: a moved camera, a wrong lens, the track of another camera.
    Inconsistent {
        /// The partner that it fits best.
        best: usize,
        /// Frames shared with that partner.
        common: usize,
        /// Number of these that fit.
        right: usize,
    },
    /// It stands where its partner stands, or the light is too far away for a depth.
    NoDepth {
        /// The partner with which it shares most frames.
        best: usize,
    },
    /// It has relative poses, but shares too few frames with the larger group that was calibrated.
    Separate {
        /// The cameras of its own group.
        group: Vec<usize>,
    },
    /// The offset of its clock could not be estimated.
    ClockOpen {
        /// The camera with which the estimate came closest, if any.
        best: Option<usize>,
    },
    /// Its focal length is unobservable: too little depth, or a path in a plane.
    FocalOpen {
        /// Relative standard deviation of the focal length [–]; infinite without any information.
        sigma: f64,
    },
}

impl CameraStatus {
    /// The status as words, with cameras called by `name`.
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
                "its focal length is unobservable: too little depth, or a flat path".to_owned()
            }
            CameraStatus::FocalOpen { sigma } => {
                format!("its focal length is known to {:.1} %: too little depth, or a flat path", 100.0 * sigma)
            }
        }
    }
}

impl std::fmt::Display for CameraStatus {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        to.write_str(&self.sentence(|it| format!("camera {it}")))
    }
}

/// An optic that should have been estimated and is kept as given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OpticHeld {
    /// Which optic.
    pub optic: Optic,
    /// Why it is held.
    pub reason: HeldReason,
}

/// Why an optic was not freed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum HeldReason {
    /// It cannot be distinguished from the other parameters.
    Open,
    /// With it free, held-out observations were predicted no better.
    HoldOut {
        /// Error of held-out observations with this camera's optics as given, root mean square [px].
        held_px: f64,
        /// The same with its optics free [px].
        freed_px: f64,
    },
}

impl std::fmt::Display for OpticHeld {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(to, "{} is kept as given: ", self.optic)?;
        match self.reason {
            HeldReason::Open => write!(to, "it is unobservable"),
            HeldReason::HoldOut { held_px, freed_px } => {
                write!(to, "observations held out are {held_px:.2} px off with it held, {freed_px:.2} px with it free")
            }
        }
    }
}

/// Why no camera could be calibrated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SelfCalibrationError {
    /// Fewer than two cameras.
    #[error("{count} cameras, expected at least 2")]
    TooFewCameras {
        /// Number of cameras.
        count: usize,
    },
    /// Lists of different lengths.
    #[error("{cameras} cameras and {freedoms} freedoms, expected as many of each")]
    LengthsDiffer {
        /// Number of cameras.
        cameras: usize,
        /// Number of freedoms.
        freedoms: usize,
    },
    /// A camera that cannot be used.
    #[error("camera {camera}: {fault}")]
    BadCamera {
        /// Index of the camera.
        camera: usize,
        /// The fault of the camera.
        fault: CameraError,
    },
    /// An observation of an unknown camera, or with a pixel that is not finite.
    #[error(
        "observation {observation} is of camera {camera} at pixel {pixel}, expected a camera below {cameras} and finite numbers"
    )]
    BadObservation {
        /// Index of the observation.
        observation: usize,
        /// Its camera.
        camera: usize,
        /// Its pixel [px].
        pixel: Point2<f64>,
        /// Number of cameras.
        cameras: usize,
    },
    /// Two observations of the light by one camera in one frame.
    #[error("camera {camera} sees the light twice in frame {frame}, expected once at most")]
    SeenTwice {
        /// Index of the camera.
        camera: usize,
        /// Number of the frame.
        frame: usize,
    },
    /// An option out of range.
    #[error("{option} is {found}, expected more than 0")]
    BadOption {
        /// Which option.
        option: &'static str,
        /// Value that was found.
        found: f64,
    },
    /// No two cameras could be calibrated together, with the reason for each.
    #[error("no two cameras could be calibrated: {}", status.iter().enumerate().map(|(camera, it)| format!("camera {camera}: {it}")).collect::<Vec<_>>().join("; "))]
    NothingCalibrated {
        /// Outcome for each camera.
        status: Vec<CameraStatus>,
    },
}

impl SelfCalibrationError {
    /// The error as words, with cameras called by `name`.
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
