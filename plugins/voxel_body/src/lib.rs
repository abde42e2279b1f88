//! Bodies from silhouettes [Mikić 2001]: which pixels are body, which voxels, which parts.

use foveate::prelude::Registry;

/// Makes the nodes of this plugin known.
pub fn register(_registry: &mut Registry) {}
