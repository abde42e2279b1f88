//! Bodies in voxels: the node, and its message.

mod bounded;
mod message;
mod node;
mod smoother;
#[cfg(test)]
mod tests;

pub use node::{BodyTrackerNode, BodyTrackerSettings, MarkOn};
