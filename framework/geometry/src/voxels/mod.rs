//! Visual hulls: the voxels that silhouettes leave, with surface, connected components and colours.
//!
//! Source: R. Szeliski, "Rapid octree construction from image sequences", CVGIP 58(1), 1993; used as in [Mikić 2001 §2].
//!
//! *Definition.* A voxel counts in a view when its **centre** projects (lens included) onto the view's picture; it is body there when that
//! pixel is. It is kept when it counts in at least `min_views` views and is background in at most `may_err` of these. There is no sampling
//! within a voxel. The projection is in single precision, so that a centre within some 0.001 px of the border of a pixel may count for its neighbour
//! (`tests` compare it with double precision).
//!
//! *How a whole cube is decided.* With (u, v) = (X/Z, Y/Z) of its middle, no centre of it is further from u than max
//! |dX − u dZ| / (Z − max |dZ|); the
//! lens maps that interval to one of pixels (`view`), and a table of sums over the silhouette's bounding box gives
//! with four look-ups how many of these pixels are
//! body. A view that has decided for a cube is not evaluated inside it again. Cubes that no view decides are halved,
//! down to 4 × 4 × 4 voxels, which are
//! projected one by one. Nothing is tabulated by place, so that a camera may turn between two pictures.

mod bits;
mod colour;
mod cover;
mod doubt;
mod mask;
mod octree;
mod parts;
#[cfg(test)]
mod tests;
mod view;

use nalgebra::{Point3, Vector3};

pub use bits::BitGrid;
pub use colour::{Picture, colours};
pub use cover::{Cover, cover};
pub use doubt::{Doubt, DoubtOptions};
pub use mask::BODY;
pub use octree::Carver;
pub use parts::{Part, Parts};

use crate::Camera;

/// A grid of cubic voxels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelGrid {
    /// Corner of voxel (0, 0, 0) with the least x, y and z [m].
    pub origin: Point3<f64>,
    /// Edge of a voxel [m].
    pub size: f64,
    /// Number of voxels along x, y, z.
    pub cells: [u32; 3],
}

/// Most voxels along an axis: indices are 16-bit numbers.
pub const MOST_CELLS: u32 = 1 << 16;
/// Cubes in all, at most: a bit each, and what they are worth in two bytes, is 4.5 GiB.
const MOST_VOXELS: u64 = 1 << 31;
/// Most views.
pub const MOST_VIEWS: usize = 255;

impl VoxelGrid {
    /// The grid of voxels of `size` that covers the box from `min` to `max`, starting at `min`.
    ///
    /// # Errors
    /// An invalid size or box, or too many voxels.
    pub fn covering(min: Point3<f64>, max: Point3<f64>, size: f64) -> Result<VoxelGrid, CarveError> {
        if !(size > 0.0 && size.is_finite()) {
            return Err(CarveError::Size { found: size });
        }
        let extent = max - min;
        if !extent.iter().all(|it| *it > 0.0 && it.is_finite()) {
            return Err(CarveError::Volume { min, max });
        }
        // A volume of a whole number of cubes does not get one more from rounding.
        let cells = extent.map(|it| (it / size - 1e-6).ceil().max(1.0));
        let n: f64 = cells.iter().product();
        if cells.max() > f64::from(MOST_CELLS) || n > MOST_VOXELS as f64 {
            return Err(CarveError::TooMany { cells: cells.into(), size });
        }
        let [x, y, z]: [f64; 3] = cells.into();
        Ok(VoxelGrid { origin: min, size, cells: [x as u32, y as u32, z as u32] })
    }

    /// The centre of a voxel [m].
    pub fn centre(&self, index: [u32; 3]) -> Point3<f64> {
        self.origin + Vector3::from(index.map(|it| f64::from(it) + 0.5)) * self.size
    }
}

/// The silhouette of one camera.
#[derive(Debug, Clone, Copy)]
pub struct SilhouetteView<'a> {
    /// Model and pose of the camera.
    pub camera: &'a Camera,
    /// Columns of the camera's image to the left of the silhouette [px].
    pub left: u32,
    /// Rows of the camera's image above the silhouette [px].
    pub top: u32,
    /// Width and height of one of its pixels in camera pixels, at least 1.
    pub shrink: u32,
    /// Width [px].
    pub width: u32,
    /// Height [px].
    pub height: u32,
    /// Confidence of each pixel, one byte, row by row: body from [`BODY`] on.
    pub confidence: &'a [u8],
}

/// Options of carving.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CarveOptions {
    /// Number of views that may wrongly call a voxel background.
    pub may_err: usize,
    /// Least number of views in whose picture a voxel must lie; 0, or more than there are: all.
    pub min_views: usize,
}

impl CarveOptions {
    /// Views in whose picture a voxel has to lie, of `n`.
    fn least(&self, n: usize) -> usize {
        if self.min_views == 0 { n } else { self.min_views.min(n) }
    }
}

/// Why nothing can be carved.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CarveError {
    /// An invalid size of a voxel.
    #[error("a voxel of {found} m, expected more than 0 m")]
    Size {
        /// Size that was found [m].
        found: f64,
    },
    /// A box without inside.
    #[error("a volume from {min} to {max} m, expected the smaller corner first")]
    Volume {
        /// Least corner of the box [m].
        min: Point3<f64>,
        /// Greatest corner of the box [m].
        max: Point3<f64>,
    },
    /// Too many voxels for memory and indices.
    #[error("{} x {} x {} voxels of {size} m, expected at most 65536 along an axis and 2^31 in all", cells[0], cells[1], cells[2])]
    TooMany {
        /// Number along x, y, z.
        cells: [f64; 3],
        /// Edge of a voxel [m].
        size: f64,
    },
    /// A silhouette with a wrong number of bytes.
    #[error("view {view} has {found} bytes, expected {expected} for its {width} x {height} px")]
    Length {
        /// Index of the view.
        view: usize,
        /// Width [px].
        width: u32,
        /// Height [px].
        height: u32,
        /// Bytes that were expected.
        expected: usize,
        /// Bytes that were found.
        found: usize,
    },
    /// No view, or too many.
    #[error("{found} views, expected 1 to 255")]
    Views {
        /// Number of views.
        found: usize,
    },
    /// As many views may err as there are.
    #[error("{may_err} of {n_views} views may err, expected fewer than there are")]
    Rules {
        /// Views that may err.
        may_err: usize,
        /// Number of views.
        n_views: usize,
    },
}

/// Whether a voxel centre is kept, by the definition, in double precision, without tables or octree: slow, for tests
/// of [`Carver`]. Returns the number of views in whose picture the centre lies, and how many of them call it
/// background; `None` where it is not kept.
pub fn keeps(centre: &Point3<f64>, views: &[SilhouetteView], options: &CarveOptions) -> Option<(usize, usize)> {
    let (seen, dissent) = opinions(centre, views);
    (seen >= options.least(views.len()) && dissent <= options.may_err && dissent < seen).then_some((seen, dissent))
}

/// The number of views in whose picture a voxel centre lies, and how many of them do not call it body.
pub fn opinions(centre: &Point3<f64>, views: &[SilhouetteView]) -> (usize, usize) {
    let (mut seen, mut dissent) = (0, 0);
    for view in views {
        let Some(pixel) = view.camera.project(centre) else { continue };
        let at = |pixel: f64, start: u32| ((pixel + 0.5 - f64::from(start)) / f64::from(view.shrink)).floor();
        let (x, y) = (at(pixel.x, view.left), at(pixel.y, view.top));
        if x >= 0.0 && y >= 0.0 && x < f64::from(view.width) && y < f64::from(view.height) {
            seen += 1;
            dissent += usize::from(view.confidence[y as usize * view.width as usize + x as usize] < BODY);
        }
    }
    (seen, dissent)
}
