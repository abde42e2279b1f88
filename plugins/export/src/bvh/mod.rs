//! `export.bvh`: the body that eight targets sit on (head, waist, shoulders, elbows, wrists) as a skeleton that moves, for animation programs.
//!
//! Bones have one length over the whole session, and BVH has no word for missing: what is not seen holds its last pose, and the report counts it.
//! Targets that cannot be a body are refused, with those that can.
//!
//! y is up; what looks along x of the world looks along z in the file.

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
