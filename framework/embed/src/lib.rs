//! What programs that run rigs depend on: the rooms re-exported. No code of its own.
//!
//! A program fills a [`Registry`] with node types, reads a rig with [`rig::load`] and runs it with [`engine::deterministic`]
//! or [`engine::live`]. The built-in node types are those of `foveate_cli::registry()`. Authors of nodes need none of this: they depend on `foveate`.

pub use foveate_engine as engine;
pub use foveate_node::Registry;
pub use foveate_plugin as plugin;
pub use foveate_rig as rig;
