//! Voxels that silhouettes leave over: a hull, its surface, its parts, its colours.
//!
//! Source: R. Szeliski, "Rapid octree construction from image sequences", CVGIP 58(1), 1993; used as in [Mikić 2001 §2].
//!
//! *Definition.* A voxel counts in a view when its **centre** projects (lens and all) onto the view's picture; it is body there when the pixel that the
//! centre falls into is. It is kept when it counts in at least `min_views` views and is background in at most `may_err` of these. There is no sampling
//! within a voxel. The projection is in single precision, so that a centre within some 0.001 px of the border of a pixel may count for its neighbour
//! (`tests` hold it against the same in double precision).
//!
//! *How a cube is decided at once.* With (u, v) = (X/Z, Y/Z) of its middle, no centre of it is further from u than max |dX − u dZ| / (Z − max |dZ|); the
//! lens maps that interval to one of pixels (`view`), and a table of sums over the silhouette's bounding box says in four readings how many of these pixels are
//! body. A view that has decided for a cube is asked no more inside it. What no view can decide is halved, down to 4 × 4 × 4 voxels, which are
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

/// A grid of cubes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelGrid {
    /// The corner of cube (0, 0, 0) that is least in x, y and z [m].
    pub origin: Point3<f64>,
    /// Edge of a cube [m].
    pub size: f64,
    /// Cubes along x, y, z.
    pub cells: [u32; 3],
}

/// Cubes along an axis, at most: indices are 16-bit numbers.
pub const MOST_CELLS: u32 = 1 << 16;
/// Cubes in all, at most: a bit each, and what they are worth in two bytes, is 4.5 GiB.
const MOST_VOXELS: u64 = 1 << 31;
/// Views, at most.
pub const MOST_VIEWS: usize = 255;

impl VoxelGrid {
    /// The grid of cubes of `size` that covers the box from `min` to `max`, from `min` on.
    ///
    /// # Errors
    /// A size or a box that is none, or too many cubes.
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

    /// The centre of a cube [m].
    pub fn centre(&self, index: [u32; 3]) -> Point3<f64> {
        self.origin + Vector3::from(index.map(|it| f64::from(it) + 0.5)) * self.size
    }
}

/// What one camera saw.
#[derive(Debug, Clone, Copy)]
pub struct SilhouetteView<'a> {
    /// Its model and where it stood.
    pub camera: &'a Camera,
    /// Columns of the camera's picture to the left of the silhouette [px].
    pub left: u32,
    /// Rows above it [px].
    pub top: u32,
    /// How many of the camera's pixels each of its pixels is wide and high, at least 1.
    pub shrink: u32,
    /// Columns [px].
    pub width: u32,
    /// Rows [px].
    pub height: u32,
    /// One byte a pixel, row by row: body from [`BODY`] on.
    pub confidence: &'a [u8],
}

/// When a voxel is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CarveOptions {
    /// Views that may call a voxel background although it is body.
    pub may_err: usize,
    /// Views in whose picture a voxel has to lie; 0, or more than there are: in all.
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
    /// An edge of a cube that is none.
    #[error("a voxel of {found} m, expected more than 0 m")]
    Size {
        /// What it was [m].
        found: f64,
    },
    /// A box without inside.
    #[error("a volume from {min} to {max} m, expected one with an inside")]
    Volume {
        /// Its least corner [m].
        min: Point3<f64>,
        /// Its greatest corner [m].
        max: Point3<f64>,
    },
    /// More than memory and indices hold.
    #[error("{} x {} x {} voxels of {size} m, expected at most 65536 along an axis and 2^31 in all", cells[0], cells[1], cells[2])]
    TooMany {
        /// Along x, y, z.
        cells: [f64; 3],
        /// Edge of a cube [m].
        size: f64,
    },
    /// A silhouette whose bytes are not what its size promises.
    #[error("view {view} has {found} bytes, expected {expected} for its {width} x {height} px")]
    Length {
        /// Its place in the list.
        view: usize,
        /// Columns [px].
        width: u32,
        /// Rows [px].
        height: u32,
        /// Bytes that its size asks for.
        expected: usize,
        /// Bytes that it has.
        found: usize,
    },
    /// No view, or more than can be counted.
    #[error("{found} views, expected 1 to 255")]
    Views {
        /// How many.
        found: usize,
    },
    /// Rules that no voxel can keep.
    #[error("{may_err} of {n_views} views may err, expected fewer than there are")]
    Rules {
        /// Views that may err.
        may_err: usize,
        /// Views that there are.
        n_views: usize,
    },
}

/// Whether a voxel centre is kept, by the definition, in double precision, without any table or octree: slow, and what [`Carver`] is held against.
/// The views in whose picture it lies, and those of them that call it background, or nothing.
pub fn keeps(centre: &Point3<f64>, views: &[SilhouetteView], options: &CarveOptions) -> Option<(usize, usize)> {
    let (seen, dissent) = opinions(centre, views);
    (seen >= options.least(views.len()) && dissent <= options.may_err && dissent < seen).then_some((seen, dissent))
}

/// The views in whose picture a voxel centre lies, and those of them that do not call it body.
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
