//! Bodies from silhouettes [Mikić 2001]: which pixels are body, which voxels, which parts.
//!
//! | node | what it does |
//! |---|---|
//! | `voxel_body.tracker` | from voxels to bodies of ten parts, found and followed |

pub mod tracker;

use foveate::prelude::Registry;

/// Makes the nodes of this plugin known.
pub fn register(registry: &mut Registry) {
    registry.add::<tracker::BodyTrackerNode>();
}
