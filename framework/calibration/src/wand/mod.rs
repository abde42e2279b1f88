//! Calibration with a wand, two lights a known distance apart: labelling its ends, measuring its length, and adjustment with that length.
//!
//! The steps: [`label`] the spots of a recording, [`solve`] the room from the [`observations`] (or any other way to a
//! [`crate::solved::Solved`] whose points carry the labels of the ends), [`refine`] it with the length, and [`lengths`] of frames that were held
//! out ([`intersect`]) for a check.

mod label;
mod lengths;
mod refine;
mod solve;

pub use self::label::{LabelError, LabelOptions, Labelled, frames_by_time, label};
pub use self::lengths::{CellLength, PairLengths, TooFewFrames, WandLengths, WandSample, lengths};
pub use self::refine::{RefineError, RefineOptions, Refined, Wand, readjust, refine};
pub use self::solve::{WandObservation, intersect, observations, solve};

#[cfg(test)]
mod tests;
