//! Simulated worlds and cameras.

pub mod camera;
mod chance;
pub mod lab;
pub mod person;
pub mod world;
