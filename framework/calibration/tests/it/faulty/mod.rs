//! Recordings with faults on purpose, and what a calibration made of them.

pub mod faults;
pub mod sets;
