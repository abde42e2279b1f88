//! The nodes of this room, one file each.

pub mod body_score;
pub mod camera;
pub mod cloud_score;
pub mod display_score;
mod fields;
pub mod head;
pub mod head_score;
pub mod lab;
pub mod mark_observer;
pub mod mark_score;
pub mod observer;
pub mod posture_score;
pub mod projector;
pub mod rider;
pub mod score;
pub mod silhouette_score;
pub mod silhouettes;
pub mod surface_score;
mod table;
pub mod tracked_score;
pub mod true_surface;
pub mod wall;
pub mod wall_camera;
pub mod wall_observer;
pub mod wall_score;
