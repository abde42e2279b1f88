//! `structured_light.surface`: clouds of one thing that may move, registered to the surface that they make and fused into it.

mod apart;
mod model;
mod node;
#[cfg(test)]
mod tests;

pub use model::{Joined, Model, ModelOptions, Piece, Refusal};
pub use node::{JoinedSurface, SurfaceSettings};
