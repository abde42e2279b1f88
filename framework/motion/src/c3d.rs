//! C3D, the file format of motion capture laboratories: own reader and writer, pure functions over bytes.
//!
//! Source: *The C3D File Format: A Technical User Guide*, Motion Lab Systems, and files of several makers. What of it is ours to decide:
//!
//! | here | rule |
//! |---|---|
//! | points | 32-bit floats, or 16-bit integers times a scale |
//! | missing | residual −1, coordinates 0 |
//! | supplied by a model | residual 0, no camera: the format's own mark for interpolated points |
//! | measured | residual above 0, in steps of the scale, up to 255 of them |
//! | camera mask | 7 bits; what each stands for is told in `FOVEATE:CAMERAS` |
//! | more than 255 points | `LABELS2`, `LABELS3`, … of 255 labels each |
//! | more than 65,535 frames | the header saturates; `TRIAL:ACTUAL_START_FIELD`, `TRIAL:ACTUAL_END_FIELD` and `POINT:LONG_FRAMES` tell |
//! | byte order | Intel, DEC and SGI (MIPS), read and written |
//!
//! What readers hold against each other agrees: one analog sample a frame in the header beside `ANALOG:RATE` = `POINT:RATE`, though there are no channels,
//! and a description for each label.
//!
//! A file that lies about its sizes costs no more memory than a few times its own length.

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
pub use read::{read, read_told};
pub use write::{Coding, write};

/// One point in one frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sample {
    /// In the recording's unit; 0 where it is missing.
    pub position: [f32; 3],
    /// Mean distance between the point and the rays that it was made from, in the recording's unit: negative where the point is missing, 0 where it was not
    /// measured.
    pub residual: f32,
    /// The cameras that saw it, by the lower seven bits.
    pub cameras: u8,
}

impl Sample {
    /// A point that is not there.
    pub const MISSING: Sample = Sample { position: [0.0; 3], residual: -1.0, cameras: 0 };

    /// Whether the point is there.
    pub fn is_present(&self) -> bool {
        self.residual >= 0.0
    }
}

/// Something that happened at one time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Event {
    /// What.
    pub label: String,
    /// Whose, such as `Left`, `Right` or `General`; empty where the file does not say.
    pub context: String,
    /// On the file's own clock [s].
    pub time_s: f64,
}

/// What was recorded beside the points, several times a frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Analog {
    /// The channels.
    pub labels: Vec<String>,
    /// Samples of each channel in a frame.
    pub per_frame: usize,
    /// Sample by sample, in each of them channel by channel; scales and offsets are applied.
    pub values: Vec<f32>,
}

/// What a file holds.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Recording {
    /// Frames a second [Hz].
    pub rate_hz: f32,
    /// The unit of positions and residuals, such as `mm`.
    pub units: String,
    /// Number of the first frame, usually 1.
    pub first_frame: u32,
    /// The points.
    pub labels: Vec<String>,
    /// Frame by frame, in each of them point by point.
    pub samples: Vec<Sample>,
    /// What happened meanwhile.
    pub events: Vec<Event>,
    /// Analog channels; written only where there are none.
    pub analog: Analog,
    /// Session time of the first frame, where the file says it [s].
    pub start_s: Option<f64>,
    /// What each bit of [`Sample::cameras`] stands for, at most 7; empty where the file does not say.
    pub cameras: Vec<String>,
    /// Whether y is up (`POINT:Y_SCREEN` is `+Y`); else z is.
    pub y_is_up: bool,
    /// Points that are no places, by kind; not written.
    pub model_outputs: Vec<ModelOutputs>,
}

/// What a model made of a body, stored as points: three angles, a force and so on. The group `POINT` lists the labels of each kind.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ModelOutputs {
    /// The list's name, such as `ANGLES`.
    pub kind: String,
    /// By their place among the labels.
    pub points: Vec<usize>,
}

impl Recording {
    /// How many frames there are.
    pub fn n_frames(&self) -> usize {
        match (self.labels.len(), self.analog.labels.len() * self.analog.per_frame) {
            (0, 0) => 0,
            (0, per_frame) => self.analog.values.len() / per_frame,
            (n_points, _) => self.samples.len() / n_points,
        }
    }

    /// The points of a frame, counted from 0; empty beyond the last.
    pub fn frame(&self, frame: usize) -> &[Sample] {
        self.samples.chunks_exact(self.labels.len().max(1)).nth(frame).unwrap_or(&[])
    }
}

/// What is wrong with a file, and where.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct C3dError {
    /// The byte, counted from 0.
    pub offset: usize,
    /// What is there.
    pub found: String,
    /// What should be.
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
