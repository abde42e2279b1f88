//! Stripe boundary codes, for scenes that move: four pictures of stripes that are shown again and again, and boundaries of stripes that are tracked from picture to picture.
//!
//! | module | what it is |
//! |---|---|
//! | [`design`] | which stripe is lit in which of the four pictures |
//! | [`detect`] | edges of light along the rows of one picture |
//! | `wide` | edges of wide stripes and of faint ones |
//! | [`track`] | edges tracked from picture to picture, until four pictures say which boundary each is |
//! | [`agreement`] | which of the four pictures is shown, by known tracks |
//! | `adopt` | new tracks get their numbers from known ones around them |
//! | `sliding` | how a surface goes through the stripes, and where boundaries on it are next |
//! | `common` | the common offset of all tracks, as errors of a head's pose cause |
//! | [`turn`] | which of the four pictures is shown, where it is not stated |
//! | [`decode`] | boundaries that their neighbours confirm, and their places |
//!
//! A boundary is known by what is lit to its left and to its right in each of the four pictures. Where both sides are alike it does not show (a *ghost*), never twice in a row.
//! Rows of the camera's picture have to cross the stripes.
//!
//! Source: O. Hall-Holt, S. Rusinkiewicz, "Stripe boundary codes for real-time structured-light range scanning of moving objects", ICCV 2001.

mod adopt;
pub mod agreement;
mod common;
pub mod decode;
pub mod design;
pub mod detect;
#[cfg(test)]
mod scene;
mod sliding;
pub mod track;
pub mod turn;
mod wide;

pub use agreement::{Agreement, Shows};
pub use decode::{Line, lines};
pub use design::{BoundaryCode, FRAMES, Look};
pub use detect::{DetectOptions, Edge, Edges, detect};
pub use track::{TrackOptions, Tracker};
pub use turn::{Held, Turns};
