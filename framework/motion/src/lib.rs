//! Motion files: points and skeletons over time, read from and written to bytes; filled, smoothed, compared. No nodes, no I/O.
//!
//! | module | what it gives |
//! |---|---|
//! | [`bvh`] | BVH: moving skeletons |
//! | [`c3d`] | C3D: points, analog channels and events of motion capture laboratories |
//! | [`compare`] | distances between two motions |
//! | [`csv`] | numbers in our own tables |
//! | [`fill`] | gap filling |
//! | [`forms`] | files of any format, recognised by content, from and to a [`Motion`] |
//! | [`motion`] | [`Motion`]: points over time, from any file |
//! | [`npz`] | NPZ: archives of NumPy arrays |
//! | [`smooth`] | a zero-lag low-pass filter |
//! | [`trc`] | TRC: tables of points, as OpenSim reads them |
//!
//! C3D, TRC, BVH and NPZ each have a codec that keeps what the file says; [`forms`] builds on them.

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
