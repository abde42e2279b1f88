//! Files of motion: points and skeletons over time, from bytes and to bytes; filled, smoothed, compared. No nodes, no I/O.
//!
//! | module | what it gives |
//! |---|---|
//! | [`bvh`] | skeletons that move |
//! | [`c3d`] | points, analog channels and events of motion capture laboratories |
//! | [`compare`] | how far apart two motions are |
//! | [`csv`] | numbers of our own tables |
//! | [`fill`] | gaps crossed |
//! | [`forms`] | files of any form, by their content, as a [`Motion`], and a [`Motion`] as a file |
//! | [`motion`] | [`Motion`]: points over time, whatever they come from |
//! | [`npz`] | archives of arrays for NumPy |
//! | [`smooth`] | a low-pass without a lag |
//! | [`trc`] | tables of points, as OpenSim reads them |
//!
//! C3D, TRC, BVH and NPZ each have a codec that keeps what the file says; [`forms`] stands above them.

pub mod c3d;
pub mod compare;
pub mod csv;
pub mod fill;
pub mod forms;
mod interpolate;
mod last_row;
pub mod motion;
pub mod npz;
pub mod smooth;
pub mod trc;

pub use foveate_scene::skeleton as bvh;
pub use motion::Motion;
