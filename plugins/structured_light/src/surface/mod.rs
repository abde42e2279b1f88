//! `structured_light.surface`: registers clouds of one object that may move to their common surface, and fuses them into it.

mod apart;
mod model;
mod node;
#[cfg(test)]
mod tests;

pub use model::{Joined, Model, ModelOptions, Piece, Refusal};
pub use node::{JoinedSurface, SurfaceSettings};
