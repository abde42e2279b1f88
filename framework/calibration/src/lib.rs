//! From what cameras saw of a light or a wand to a calibration with a verdict. Pure functions: no clock, no I/O, no nodes.
//!
//! | module | what it is |
//! |---|---|
//! | [`recording`] | what went in: who saw what, where and when, and what is known of the cameras' optics |
//! | [`solved`] | what came out: cameras, path, the residual of each observation, and what remains open |
//! | [`room`] | the way from one to the other with one waved light, from nothing or from an older calibration |
//! | [`board`] | cameras that see a rigid board: optics and poses in metres |
//! | [`clocks`] | cameras that share no clock: their offsets from the continuity of the light's path |
//! | [`path`] | cameras from a path in space that another system measured, clocks unknown |
//! | [`wand`] | two lights a known distance apart |
//! | [`axes`] | metres, the vertical and the origin, and what fixes each how well |
//! | [`cause`] | what may be wrong about a camera, under names that programs know |
//! | [`checks`] | what re-projection cannot see, and a verdict in words |
//! | [`quality`] | two calibrations over the same observations |
//! | [`coverage`] | where the light has been, for those who wave it |
//! | [`head`] | the axes of pan-tilt heads |
//! | [`report`] | one HTML page with pictures |
//! | [`words`] | numbers as a person reads them |

pub mod axes;
pub mod board;
pub mod cause;
pub mod checks;
pub mod clocks;
pub mod comparison;
pub mod convergence;
pub mod coverage;
pub mod head;
pub mod network;
pub mod path;
mod pose_change;
pub mod quality;
pub mod recording;
pub mod report;
pub mod solved;
mod stretches;
pub mod wand;
pub mod words;
