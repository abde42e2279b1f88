//! The nodes of this room, one file each.

pub mod camera;
pub mod lab;
pub mod score;
