//! Articulated bodies in voxels [Mikić 2001]: a model of ten parts that is found, fitted and followed.
//!
//! I. Mikić, M. Trivedi, E. Hunter, P. Cosman, "Articulated body posture estimation from multi-camera voxel data", CVPR 2001.
//!
//! | module | what it gives |
//! |---|---|
//! | `parts` | ten parts, four limbs, fourteen joints |
//! | [`model`] | [`Body`]: state, kinematic chain (3) and its derivatives |
//! | [`proportions`] | what people look like and how far joints bend |
//! | `solid` | how far a point is from the skin of a part |
//! | [`field`] | [`VoxelField`]: faces and depths of voxels |
//! | [`acquire`] | head, neck and torso in voxels of which nothing is known (§3) |
//! | [`limbs`] | arms and legs there |
//! | [`fit`] | what voxels say of a body |
//! | [`filter`] | [`BodyFilter`]: the extended Kalman filter (§4) |
//! | `layout`, `smooth` | where its blocks begin; a smoother |
//! | `facing` | which way a body looks |
//! | [`people`] | [`People`]: several of them, and who has which voxels |
//! | [`tracker`] | [`BodyTracker`]: one body through all frames, with the levels of §6 |

pub mod acquire;
#[cfg(test)]
mod drawn;
mod facing;
pub mod field;
pub mod filter;
pub mod fit;
mod layout;
pub mod limbs;
pub mod model;
mod parts;
pub mod people;
pub mod proportions;
mod smooth;
mod solid;
#[cfg(test)]
mod standing;
pub mod tracker;

pub use acquire::{AcquisitionFailure, AcquisitionOptions};
pub use field::VoxelField;
pub use filter::{BodyFilter, Step};
pub use fit::{Labelled, Support};
pub use layout::{Layout, Presence};
pub use model::Body;
pub use parts::{ANKLE_DOWN, HIP_OUT, Joint, Limb, N_JOINTS, N_PARTS, Part, SHOULDER_UP, WRIST_DOWN};
pub use people::{Cubes, Followed, People, PeopleOptions};
pub use smooth::smooth;
pub use tracker::{BodyTracker, JointEstimate, JointSource, LimbLevel, TrackerOptions};
