//! Articulated bodies in voxels [Mikić 2001]: a model of ten parts that is detected, fitted and tracked.
//!
//! I. Mikić, M. Trivedi, E. Hunter, P. Cosman, "Articulated body posture estimation from multi-camera voxel data", CVPR 2001.
//!
//! | module | what it gives |
//! |---|---|
//! | `parts` | ten parts, four limbs, fourteen joints |
//! | [`model`] | [`Body`]: state, kinematic chain (3) and its derivatives |
//! | [`proportions`] | proportions of people and limits of joints |
//! | `solid` | distance of a point from the skin of a part |
//! | [`field`] | [`VoxelField`]: faces and depths of voxels |
//! | [`acquire`] | head, neck and torso in voxels without a prior (§3) |
//! | [`limbs`] | arms and legs in them |
//! | [`fit`] | measurements of a body by voxels |
//! | [`filter`] | [`BodyFilter`]: the extended Kalman filter (§4) |
//! | `layout`, `smooth` | layout of the filter's state; a smoother |
//! | `facing` | the facing direction of a body |
//! | [`people`] | [`People`]: several bodies, and the assignment of voxels to them |
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
pub use people::{Cubes, People, PeopleOptions, TrackedBody};
pub use smooth::smooth;
pub use tracker::{BodyTracker, JointEstimate, JointSource, LimbLevel, TrackerOptions};
