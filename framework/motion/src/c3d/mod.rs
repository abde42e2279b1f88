//! C3D, the file format of motion capture laboratories: reader and writer, pure functions over bytes.
//!
//! Source: *The C3D File Format: A Technical User Guide*, Motion Lab Systems, and files of several makers. Conventions of this codec:
//!
//! | here | rule |
//! |---|---|
//! | points | 32-bit floats, or 16-bit integers times a scale |
//! | missing | residual −1, coordinates 0 |
//! | supplied by a model | residual 0, no camera: the format's own mark for interpolated points |
//! | measured | residual above 0, in steps of the scale, up to 255 of them |
//! | camera mask | 7 bits; `FOVEATE:CAMERAS` names the camera of each |
//! | more than 255 points | `LABELS2`, `LABELS3`, … of 255 labels each |
//! | more than 65,535 frames | the header saturates; `TRIAL:ACTUAL_START_FIELD`, `TRIAL:ACTUAL_END_FIELD` and `POINT:LONG_FRAMES` tell |
//! | byte order | Intel, DEC and SGI (MIPS), read and written |
//!
//! Values that readers compare are written consistently: one analog sample a frame in the header and `ANALOG:RATE` =
//! `POINT:RATE`, though there are no channels, and a description for each label.
//!
//! A file with wrong sizes costs no more memory than a few times its own length.
//!
//! ```
//! use foveate_motion::c3d::{ByteOrder, Coding, Recording, Sample, read, write};
//!
//! let at = |x: f32| Sample { position: [x, 0.0, 450.0], residual: 0.5, cameras: 0b11 };
//! let recording = Recording {
//!     rate_hz: 100.0,
//!     units: "mm".to_owned(),
//!     first_frame: 1,
//!     labels: vec!["LKNE".to_owned(), "RKNE".to_owned()],
//!     samples: vec![at(100.0), at(-100.0), at(101.5), Sample::MISSING], // two frames of two points
//!     ..Recording::default()
//! };
//! let file = write(&recording, Coding::Float { residual_step: 0.1 }, ByteOrder::Intel)?;
//! let back = read(&file)?;
//! assert_eq!((back.n_frames(), back.labels), (2, recording.labels));
//! assert_eq!(back.samples[2].position, [101.5, 0.0, 450.0]);
//! assert!((back.samples[2].residual - 0.5).abs() < 1e-6 && !back.samples[3].is_present());
//! # Ok::<(), foveate_motion::c3d::C3dError>(())
//! ```

mod growing;
mod layout;
mod model_outputs;
mod order;
mod parameters;
mod read;
#[cfg(test)]
mod tests;
mod write;

use std::fmt;

pub use growing::{Growing, POINT_BYTES};
pub use order::ByteOrder;
pub use read::{read, read_with_remarks};
pub use write::{Coding, write};

/// A point in one frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sample {
    /// Position in the recording's unit; 0 where it is missing.
    pub position: [f32; 3],
    /// Residual: mean distance between the point and the rays that it was triangulated from, in the recording's unit;
    /// negative where the point is missing, 0 where it was not measured.
    pub residual: f32,
    /// Bit mask of the cameras that saw it (lower seven bits).
    pub cameras: u8,
}

impl Sample {
    /// A missing point.
    pub const MISSING: Sample = Sample { position: [0.0; 3], residual: -1.0, cameras: 0 };

    /// Whether the point is present.
    pub fn is_present(&self) -> bool {
        self.residual >= 0.0
    }
}

/// A labelled moment, such as a foot strike.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Event {
    /// Label of the event.
    pub label: String,
    /// Subject or side, such as `Left`, `Right` or `General`; empty where the file does not say.
    pub context: String,
    /// Time on the file's clock [s].
    pub time_s: f64,
}

/// Analog channels, sampled several times a frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Analog {
    /// Names of the channels.
    pub labels: Vec<String>,
    /// Samples of each channel per frame.
    pub per_frame: usize,
    /// Values sample by sample, channel by channel within; scales and offsets are applied.
    pub values: Vec<f32>,
}

/// The content of a C3D file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Recording {
    /// Frame rate [Hz].
    pub rate_hz: f32,
    /// The unit of positions and residuals, such as `mm`.
    pub units: String,
    /// Number of the first frame, usually 1.
    pub first_frame: u32,
    /// Names of the points.
    pub labels: Vec<String>,
    /// Samples frame by frame, point by point within.
    pub samples: Vec<Sample>,
    /// Labelled moments.
    pub events: Vec<Event>,
    /// Analog channels; must be empty for writing.
    pub analog: Analog,
    /// Session time of the first frame, where the file says it [s].
    pub start_s: Option<f64>,
    /// Camera of each bit of [`Sample::cameras`], at most 7; empty where the file does not say.
    pub cameras: Vec<String>,
    /// Whether y is up (`POINT:Y_SCREEN` is `+Y`); otherwise z is.
    pub y_is_up: bool,
    /// Points that are not positions, by kind; not written.
    pub model_outputs: Vec<ModelOutputs>,
}

/// Outputs of a body model that are stored as points, such as three angles or a force. The group `POINT` lists the labels of each kind.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ModelOutputs {
    /// Name of the list, such as `ANGLES`.
    pub kind: String,
    /// Indices of the points among the labels.
    pub points: Vec<usize>,
}

impl Recording {
    /// Number of frames.
    pub fn n_frames(&self) -> usize {
        match (self.labels.len(), self.analog.labels.len() * self.analog.per_frame) {
            (0, 0) => 0,
            (0, per_frame) => self.analog.values.len() / per_frame,
            (n_points, _) => self.samples.len() / n_points,
        }
    }

    /// The samples of a frame, counted from 0; empty beyond the last.
    pub fn frame(&self, frame: usize) -> &[Sample] {
        self.samples.chunks_exact(self.labels.len().max(1)).nth(frame).unwrap_or(&[])
    }
}

/// Why a file cannot be read or written, with the place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct C3dError {
    /// Offset of the byte, from 0.
    pub offset: usize,
    /// What was found.
    pub found: String,
    /// What was expected.
    pub expected: String,
}

impl fmt::Display for C3dError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "at byte {}: found {}, expected {}", self.offset, self.found, self.expected)
    }
}

impl std::error::Error for C3dError {}

fn fault<T>(offset: usize, found: impl fmt::Display, expected: impl fmt::Display) -> Result<T, C3dError> {
    Err(C3dError { offset, found: found.to_string(), expected: expected.to_string() })
}

/// Header and parameters are counted in blocks of this many bytes.
const BLOCK: usize = 512;
/// What the second byte of a file is.
const MAGIC: u8 = 0x50;
/// Stands before events in the header whose labels have four characters.
const FOUR_CHARACTERS: u16 = 12345;
/// Events that the header holds.
const HEADER_EVENTS: usize = 18;
/// Labels in one parameter.
const LABELS_A_PARAMETER: usize = 255;
