//! Parts of `foveate calibrate`: observations gathered from a rig's detectors, and the outcome in figures and words.

pub mod advice;
pub mod boards;
pub mod capture;
pub mod figures;
mod guide;
pub mod path;
pub mod places;
mod recorder;
pub mod selected;
pub mod shown;
pub mod words;
