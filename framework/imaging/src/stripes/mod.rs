//! Structured light: stripes that a projector shows, and where in the projector each pixel of a camera is lit from.
//!
//! | module | what it is |
//! |---|---|
//! | [`code`] | which pictures make a code, in which order: Gray code with inverse pictures or with a threshold, phase shift on top of it |
//! | [`pattern`] | the pictures that a projector shows |
//! | [`gray`] | camera pixel → stripe, or none where the pictures do not say it for certain |
//! | [`edges`] | boundaries of stripes between camera pixels, and the projector coordinate of each camera pixel from them |
//! | [`phase`] | the projector coordinate of each camera pixel from shifted sine waves |
//! | [`boundary`] | stripe boundary codes, for what moves: four pictures again and again, boundaries tracked from picture to picture |
//! | [`drift`] | detects a camera that moved by less than a pixel during a set |
//! | [`steady`] | stabilises a set whose camera drifted |
//! | [`examine`] | finds what is wrong with a set of pictures: missing, duplicated, swapped, inverted, too bright, too dark |
//! | [`faults`] | the faults and their messages |
//! | [`finest`] | stripes that are finer than the camera resolves |
//! | [`noise`] | how noisy a picture is |
//! | [`ordering`] | places where columns or rows run backwards, because something moved |
//! | [`response`] | the camera's response, where gray levels are not proportional to light |
//!
//! Projector coordinates: (0, 0) is the centre of the projector's top-left pixel; column `c` reaches from `c − ½` to `c + ½`.
//!
//! Source: J. Posdamer, M. Altschuler, "Surface measurement by space-encoded projected beam systems", CGIP 18(1), 1982, with the Gray code of
//! S. Inokuchi et al., 1984; direct and global light: S. Nayar et al., "Fast separation of direct and global components of a scene using
//! high frequency illumination", SIGGRAPH 2006.

pub mod boundary;
pub mod code;
pub mod defocus;
pub mod drift;
pub mod edges;
pub mod ends;
pub mod examine;
mod explain;
mod exposure;
mod fade;
pub mod faults;
pub mod finest;
pub mod gray;
mod identify;
pub mod noise;
pub mod ordering;
pub mod pattern;
pub mod phase;
pub mod response;
#[cfg(test)]
mod scene;
pub mod steady;
mod stretches;
mod wave_steps;
mod way;

pub use code::{Axis, Group, Inverse, Shown, StripeCode};
pub use defocus::Defocus;
pub use edges::{Coordinates, EdgeOptions};
pub use examine::{Examination, Prepared, examine};
pub use faults::SetFault;
pub use gray::{DecodeOptions, Decoded, decode};
