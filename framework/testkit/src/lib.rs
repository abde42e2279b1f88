//! Scenes with known truth, law checks, golden texts and fault-injecting nodes. A dev-dependency only.
//!
//! | module | what it gives |
//! |---|---|
//! | [`scene`] | cameras and points whose truth is known: [`camera_ring`], [`render_spot`] |
//! | [`lab`] | a lab with moving lights and realistic disturbances, and the score of a tracker |
//! | [`laws`] | checks that hold for every camera model, derivative and node, one call each |
//! | [`golden`] | texts that are compared with a committed file, which can be rewritten |
//! | [`allocation`] | an allocator that counts |
//! | [`data`] | where the real recordings lie, if this machine has them |
//! | `chromium` | a browser without a window, and what it shows (feature `browser`) |
//! | [`nodes`] | nodes for tests of engines: counters, faults, a collector |
//!
//! All checks panic with what was found and expected, as tests do.

pub mod allocation;
#[cfg(feature = "browser")]
pub mod chromium;
pub mod data;
pub mod golden;
pub mod lab;
pub mod laws;
pub mod nodes;
pub mod scene;

pub use data::{data_dir, data_dir_or_skip};
pub use foveate_laws::check_jacobian;
pub use laws::{check_camera_model, check_node, check_runs};
pub use nodes::register;
pub use scene::{camera_ring, render_spot};
