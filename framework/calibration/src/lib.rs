//! Camera calibration from observations of a waved light, a wand or a board: poses, optics, clocks, covariances and a verdict. Pure functions: no
//! clock, no I/O, no nodes.
//!
//! | module | what it is |
//! |---|---|
//! | [`recording`] | the input: observations of each camera with their times, and what is known of the cameras' optics |
//! | [`solved`] | the output: cameras, path, the residual of each observation, and what remains undetermined |
//! | [`room`] | the way from one to the other with one waved light, from nothing or from an older calibration |
//! | [`board`] | optics and poses, in metres, from a rigid board |
//! | [`clocks`] | clock offsets of unsynchronised cameras from the continuity of the light's path |
//! | [`path`] | cameras from a path in space that another system measured, clocks unknown |
//! | [`wand`] | calibration with two lights a known distance apart |
//! | [`axes`] | scale, vertical and origin, and how well each is fixed |
//! | [`cause`] | faults of cameras, with fixed names for programs |
//! | [`checks`] | checks that the re-projection error alone cannot replace, and a verdict in words |
//! | [`quality`] | compares two calibrations over the same observations |
//! | [`coverage`] | where the light has been, to guide the person who waves it |
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
