//! Files of motion: points and skeletons over time, from bytes and to bytes. No nodes, no I/O.
//!
//! | module | what it reads and writes |
//! |---|---|
//! | [`bvh`] | skeletons that move |
//! | [`c3d`] | points, analog channels and events of motion capture laboratories |
//! | [`csv`] | fields of our own tables |
//! | [`npz`] | archives of arrays for NumPy (writing) |
//! | [`trc`] | tables of points, as OpenSim reads them |

pub mod c3d;
pub mod csv;
pub mod npz;
pub mod trc;

pub use foveate_scene::skeleton as bvh;
