//! Surfaces from points: one cloud registered to another, clouds fused into a distance field, and the triangles of that.
//!
//! | file | what it gives |
//! |---|---|
//! | [`patches`] | oriented points gathered in cells, coarse to fine: what a cloud is registered to |
//! | [`range_image`] | the same by projection into the camera that saw them |
//! | [`registration`] | the pose of a cloud on a surface, point to plane, with its covariance and what the geometry leaves open |
//! | [`normals`] | normals of points that come without |
//! | [`field`] | a truncated signed distance field in blocks, fused from oriented points |
//! | [`mesh`] | its surface as triangles |
//! | [`ply`] | points and triangles of files of any program |
//! | [`shape`] | triangles or points to measure distances to |
//! | [`placing`] | how one shape lies on another, from anywhere |
//! | `planes` | the same of shapes that are mostly one plane |
//! | [`cylinder`] | the circular cylinder that fits points best |
//! | [`roughness`] | what points deviate from a quadric around them |
//! | [`distances`] | how far two shapes are apart, both ways |

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

/// One point of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Where it is [m].
    pub position: Point3<f64>,
    /// Of the position; symmetric [m²].
    pub covariance: Matrix3<f64>,
    /// Out of the surface, of length 1; zero where it is not known [–].
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
    /// Which part: points that share one share its error.
    pub number: usize,
    /// A point of it [m].
    pub position: Point3<f64>,
    /// Out of the surface, of length 1 [–].
    pub normal: Vector3<f64>,
    /// Of the position along the normal [m²].
    pub variance: f64,
}

/// A surface that clouds can be registered to.
pub trait Surface {
    /// Of how many levels of detail it is; level 0 is the finest.
    fn n_levels(&self) -> usize;

    /// How far from a point its match may be at a level [m].
    fn reach(&self, level: usize) -> f64;

    /// How far the surface may bend away from the plane of a match within the reach, standard deviation [m].
    fn bend(&self, level: usize) -> f64;

    /// What is nearest to `point` at a level; `None`: nothing within reach.
    fn nearest(&self, level: usize, point: &Point3<f64>) -> Option<Match>;
}
