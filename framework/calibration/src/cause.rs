//! Faults of a camera, with fixed names for programs.

/// What is wrong with a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Cause {
    /// The camera was moved during the recording, or since the older calibration.
    Moved {
        /// When [s of the room]; `None`: before the recording began.
        at_s: Option<f64>,
        /// Median distance in the picture of where it sees the light before and after [px].
        shift_px: f64,
        /// By how much it turned [rad].
        turn: f64,
        /// How far its centre moved [m or units].
        distance: f64,
    },
    /// Its clock is off.
    Clock {
        /// To be added to its times [s].
        offset_s: f64,
        /// Standard deviation of that [s].
        sigma_s: f64,
    },
    /// Its focal length is wrong.
    Focal {
        /// What it should be over what it is [–].
        factor: f64,
    },
    /// Its lens distortion differs from its model.
    Distortion {
        /// To be added to k1 [–].
        k1: f64,
    },
    /// Its pixels are not as wide over high as stated.
    PixelShape {
        /// Height over width of the focal length, what it should be over what it is [–].
        factor: f64,
    },
    /// Its observations are those of another camera.
    Swapped {
        /// Of this one.
        with: usize,
        /// From when on [s of the room]; `None`: throughout.
        since_s: Option<f64>,
    },
    /// Its picture is mirrored, left to right.
    Mirrored,
    /// Its picture is upside down: turned by half about the line of sight.
    UpsideDown,
    /// Part of its observations are not of the light. Where these were left out and the others suffice, the level stays good.
    FalseObservations {
        /// Which part [–].
        share: f64,
    },
    /// It saw too little of the light.
    FewObservations {
        /// Number of its observations [–].
        count: usize,
        /// Of the median camera [–].
        median: usize,
    },
    /// It shares too few frames with the others.
    FewCommon {
        /// How many with the camera with which it shares most [–].
        count: usize,
    },
    /// None of these explains it: focus, a loose lens, a rolling shutter.
    Unknown {
        /// Share of its observations that no pose explains, or how many times worse it fits than others [–].
        size: f64,
    },
}

impl Cause {
    /// Its fixed name, for programs.
    pub fn name(&self) -> &'static str {
        match self {
            Cause::Moved { .. } => "moved",
            Cause::Clock { .. } => "late",
            Cause::Focal { .. } | Cause::Distortion { .. } => "wrong_lens",
            Cause::PixelShape { .. } => "wrong_pixel_shape",
            Cause::Swapped { .. } => "rows_swapped",
            Cause::Mirrored => "mirrored",
            Cause::UpsideDown => "upside_down",
            Cause::FalseObservations { .. } => "false_observations",
            Cause::FewObservations { .. } => "few_observations",
            Cause::FewCommon { .. } => "too_few_common",
            Cause::Unknown { .. } => "unknown",
        }
    }

    /// How large it is, in the unit of [`Self::unit`]; `None` for causes without a size.
    pub fn size(&self) -> Option<f64> {
        match *self {
            Cause::Moved { shift_px, .. } => Some(shift_px),
            Cause::Clock { offset_s, .. } => Some(-offset_s),
            Cause::Focal { factor } | Cause::PixelShape { factor } => Some(factor - 1.0),
            Cause::Distortion { k1 } => Some(k1),
            Cause::FalseObservations { share } => Some(share),
            Cause::FewObservations { count, .. } | Cause::FewCommon { count } => Some(count as f64),
            Cause::Unknown { size } => Some(size),
            Cause::Swapped { .. } | Cause::Mirrored | Cause::UpsideDown => None,
        }
    }

    /// The unit of [`Self::size`]: `px`, `s` (late is positive), `1` for shares and relative sizes, or `count`.
    pub fn unit(&self) -> &'static str {
        match self {
            Cause::Moved { .. } => "px",
            Cause::Clock { .. } => "s",
            Cause::FewObservations { .. } | Cause::FewCommon { .. } => "count",
            _ => "1",
        }
    }

    /// Since when it is so [s of the room], if that is later than the beginning.
    pub fn since_s(&self) -> Option<f64> {
        match *self {
            Cause::Moved { at_s, .. } => at_s,
            Cause::Swapped { since_s, .. } => since_s,
            _ => None,
        }
    }
}

/// A faulty camera that was left out of a solved camera network, and its fault.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraFault {
    /// Index of the camera.
    pub camera: usize,
    /// What is wrong.
    pub cause: Cause,
    /// Share of its observations that fit the others, first as they are and then with the cause put right [–].
    pub shares: [f64; 2],
}
