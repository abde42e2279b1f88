//! Surfaces from points: registration of clouds, fusion into a distance field, meshes, and distances between shapes.
//!
//! | file | what it gives |
//! |---|---|
//! | [`patches`] | oriented points in cells, coarse to fine, as a target of registration |
//! | [`range_image`] | the same by projection into the camera that observed them |
//! | [`registration`] | ICP: pose of a cloud on a surface, point to plane, with covariance and unobservable directions |
//! | [`normals`] | normals of points without them |
//! | [`field`] | a truncated signed distance field (TSDF) in blocks, fused from oriented points |
//! | [`mesh`] | its surface as triangles |
//! | [`ply`] | reader of PLY files |
//! | [`shape`] | triangles or points with nearest-point queries |
//! | [`placing`] | global registration of one shape on another, without a start |
//! | `planes` | the same for shapes that are mostly one plane |
//! | [`cylinder`] | least-squares cylinder |
//! | [`roughness`] | deviation of points from a local quadric |
//! | [`distances`] | distances between two shapes, both ways |

pub mod cylinder;
pub mod distances;
pub mod field;
mod key;
pub mod mesh;
pub mod normals;
pub mod patches;
pub mod placing;
mod planes;
pub mod ply;
pub mod range_image;
pub mod registration;
pub mod roughness;
pub mod shape;
#[cfg(test)]
mod tests;

use nalgebra::{Matrix3, Point3, Vector3};

pub use cylinder::Cylinder;
pub use distances::{DistanceOptions, Distances, ShapeDistances, distances};
pub use field::{DistanceField, FieldOptions, Fused};
pub use mesh::{MeshOptions, SurfaceVertex, TriangleMesh};
pub use normals::find_normals;
pub use patches::Patches;
pub use placing::{Placing, PlacingError, PlacingOptions, place};
pub use range_image::RangeImage;
pub use registration::{Registration, RegistrationError, RegistrationOptions, register};
pub use roughness::roughness;
pub use shape::{Nearest, Shape};

/// A point of a surface, with covariance and normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Position [m].
    pub position: Point3<f64>,
    /// Covariance of the position; symmetric [m²].
    pub covariance: Matrix3<f64>,
    /// Unit normal, outwards; zero where it is unknown [–].
    pub normal: Vector3<f64>,
}

impl SurfacePoint {
    /// Whether position and covariance are numbers and the covariance is one.
    pub(crate) fn is_sound(&self) -> bool {
        let finite = self.position.coords.norm_squared().is_finite() && self.normal.norm_squared().is_finite();
        finite && self.covariance.trace().is_finite() && self.covariance.diagonal().min() > 0.0
    }

    /// Variance along a direction of length 1 [m²].
    pub(crate) fn variance_along(&self, direction: &Vector3<f64>) -> f64 {
        direction.dot(&(self.covariance * direction)).max(0.0)
    }
}

/// The part of a surface nearest to a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// Index of the part; points matched to the same part share its error.
    pub number: usize,
    /// A point of the part [m].
    pub position: Point3<f64>,
    /// Unit normal, outwards [–].
    pub normal: Vector3<f64>,
    /// Variance of the position along the normal [m²].
    pub variance: f64,
}

/// A surface to register clouds to.
pub trait Surface {
    /// Number of levels of detail; level 0 is the finest.
    fn n_levels(&self) -> usize;

    /// Largest distance of a match from its point at a level [m].
    fn reach(&self, level: usize) -> f64;

    /// Standard deviation of the surface about the plane of a match, within the reach [m].
    fn bend(&self, level: usize) -> f64;

    /// The part nearest to `point` at a level; `None`: nothing within reach.
    fn nearest(&self, level: usize, point: &Point3<f64>) -> Option<Match>;
}
