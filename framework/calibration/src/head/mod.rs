//! The axes of pan-tilt heads, from a light that the room's system tracks and the camera on the head sees [Davis 2002 §4.2].
//!
//! | module | what it does |
//! |---|---|
//! | [`sweep`] | drives a head over settings: when to go on, and where the light is needed |
//! | [`rest`] | periods of rest from reported positions |
//! | [`gather`] | joins light, picture and setting into what [`foveate_geometry::pan_tilt::calibrate_head`] takes |
//! | [`compare`] | three models side by side, as in Figures 51 and 52 |
//! | [`picture`] | the same as a picture |
//! | [`to_calibration`] | what was found as sections of a calibration |
//!
//! The camera's pose need not be known; its optics must be.

pub mod compare;
pub mod gather;
pub mod picture;
pub mod rest;
pub mod sweep;
pub mod to_calibration;

#[cfg(test)]
mod tests;

pub use compare::{Comparison, ModelFit, compare};
pub use gather::{GatherOptions, Gathered, HeadRecording, LightSample, LitFrame};
pub use picture::picture;
pub use rest::{PositionReport, RestPeriod, rest_periods};
pub use sweep::{Sweep, SweepOptions, SweepOrder};
pub use to_calibration::calibrated_head;
