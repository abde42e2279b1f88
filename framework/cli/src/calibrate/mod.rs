//! What `foveate calibrate` is made of: sightings gathered from a rig's detectors, and the outcome in figures and words.

pub mod advice;
pub mod boards;
pub mod capture;
pub mod figures;
mod guide;
mod recorder;
pub mod words;
