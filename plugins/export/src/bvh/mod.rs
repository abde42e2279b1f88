//! `export.bvh`: the body of eight targets (head, waist, shoulders, elbows, wrists) as an animated skeleton, for animation programs.
//!
//! Bones have one length over the whole session, and BVH cannot mark missing values: a joint that is not seen keeps its last pose, and the report counts it.
//! Targets that cannot be a body are refused, with a proposal of those that can.
//!
//! y is up; x of the world is z of the file.

mod body;
mod guess;
mod names;
mod node;
mod of_motion;
mod proportions;
#[cfg(test)]
mod tests;

pub use node::{BodyTargets, ExportBvh, ExportBvhSettings, Unit};
pub use of_motion::{SkeletonFile, SkeletonOptions, bvh};
