//! Metaball bodies on a skeleton of single-angle joints, fitted to points, trajectories and silhouettes.
//!
//! Source: N. D'Apuzzo, R. Plänkers, P. Fua, A. Gruen, D. Thalmann, "Modeling human bodies from video sequences", SPIE 3641, 1999, §3–4. Equation numbers are the paper's.
//!
//! | file | what it gives |
//! |---|---|
//! | [`skeleton`] | segments, degrees of freedom and forward kinematics (1)–(3) |
//! | [`field`] | the balls, the field of a body and its derivatives (4)–(8) |
//! | [`fit`] | angles, lengths and radii from observations of several kinds (9)–(15) |
//! | [`people`] | the skeleton of a person and of an arm, with three balls a limb |
//! | [`isosurface`] | the surface as a closed mesh of triangles |
//! | [`skin`] | the same as B-spline patches over cross-sections (§3.1) |
//!
//! | here | paper | meaning | unit |
//! |---|---|---|---|
//! | `State::world_from_root`, `angles` | S_motion | posture: pose of the root and joint angles | rad, m |
//! | `State::scales` | s in (3) | length of a segment over that of the template | – |
//! | `State::radii` | L = (lx, ly, lz) | effective radii of a ball | m |
//! | `Ball::squared_distance` | d (7) | squared distance in units of the radii | – |
//! | `field` | F (4), (8) | Σ exp(−2 dᵢ) | – |
//! | [`field::THRESHOLD`] | w_t | value of the field on the surface | – |

pub mod field;
pub mod fit;
pub mod isosurface;
pub mod people;
pub mod skeleton;
pub mod skin;
#[cfg(test)]
mod tests;

pub use field::{Ball, Body, THRESHOLD};
pub use fit::{
    BodyFit, BodyFitError, BodyFitOptions, BodyObservation, Doubt, Free, Priors, RadiiPrior, ResidualKind, RootFreedom,
    RootPrior, fit_body,
};
pub use isosurface::surface;
pub use people::{Side, anthropometric, arm, person};
pub use skeleton::{Columns, Dof, Posed, Segment, Skeleton, SkeletonError, State};
pub use skin::{BodySkin, skin_patches};
