//! Bodies from silhouettes [Mikić 2001]: which pixels are body, which voxels, which parts.
//!
//! | node | what it does |
//! |---|---|
//! | [`voxel_body.silhouette`](silhouette::SilhouetteNode) | separates a body from background, shadow and highlight, in the pictures of one camera |
//! | [`voxel_body.masks`](masks::Masks) | reads mask pictures of another program as silhouettes |
//! | [`voxel_body.carver`](carver::Carver) | carves voxels from the silhouettes of all cameras |
//! | [`voxel_body.tracker`](tracker::BodyTrackerNode) | fits bodies of ten parts to voxels and tracks them |

pub mod carver;
pub mod finder;
pub mod hull;
pub mod masks;
mod on_head;
mod panorama;
mod rim;
mod settings;
pub mod silhouette;
pub mod tracker;

pub use settings::SilhouetteSettings;

use foveate::prelude::Registry;

/// Registers the nodes of this plugin.
pub fn register(registry: &mut Registry) {
    registry.add::<silhouette::SilhouetteNode>();
    registry.add::<masks::Masks>();
    registry.add::<carver::Carver>();
    registry.add::<tracker::BodyTrackerNode>();
}
