//! Bodies from silhouettes [Mikić 2001]: which pixels are body, which voxels, which parts.
//!
//! | node | what it does |
//! |---|---|
//! | [`voxel_body.silhouette`](silhouette::SilhouetteNode) | tells the pixels of a body from background, shadow and highlight, in the pictures of one camera |
//! | [`voxel_body.masks`](masks::Masks) | takes pictures of masks, which another program made, for silhouettes |
//! | [`voxel_body.carver`](carver::Carver) | carves the voxels that the silhouettes of all cameras leave over |
//! | [`voxel_body.tracker`](tracker::BodyTrackerNode) | finds bodies of ten parts in voxels and follows them |

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

/// Makes the nodes of this plugin known.
pub fn register(registry: &mut Registry) {
    registry.add::<silhouette::SilhouetteNode>();
    registry.add::<masks::Masks>();
    registry.add::<carver::Carver>();
    registry.add::<tracker::BodyTrackerNode>();
}
