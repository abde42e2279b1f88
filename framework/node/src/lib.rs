//! The interface for authors of nodes. It knows no TOML, no graphs and no threads.
//!
//! | module | what it holds |
//! |---|---|
//! | [`node`], [`port`], [`io`] | what an author writes: a type with ports, settings and `process` |
//! | [`figure`] | the figures that a type declares: name, unit, which values are better, one line |
//! | [`setup`], [`report`], [`error`] | what a node gets when it is made, what it reports at the end, the errors that it may return |
//! | [`given`] | settings as a rig gives them, read into those of a node |
//! | [`guard`] | the guard around every call of foreign code |
//! | [`bench`] | runs one node without a rig, for tests |
//! | [`registry`] | the node types that a program knows, type-erased |
//! | [`library`] | where node types come from, and libraries of them that a program opens while it runs |
//! | [`page`] | pages in a browser: what a node serves, and how it talks to its page |
//! | [`scale`] | the scales at run time: who carries a scale's space, and where it is |
//! | [`setting_docs`] | the settings of a node type for people |

pub mod bench;
pub mod detector;
pub mod error;
pub mod figure;
pub mod given;
pub mod guard;
pub mod host;
pub mod io;
pub mod library;
pub mod line;
pub mod node;
pub mod page;
pub mod pool;
pub mod port;
pub mod registry;
pub mod report;
pub mod scale;
pub mod setting_docs;
pub mod setup;

pub use bench::NodeBench;
pub use error::{ConfigError, NodeError};
pub use figure::Figures;
pub use foveate_messages::{Interval, Message, SourceId, Stamp, Stamped, Time};
pub use host::Host;
pub use io::Io;
pub use library::{LibraryError, Origin};
pub use line::{Device, Line};
pub use node::{Due, Node, Plan, Role};
pub use page::{Page, PageLink, Pages};
pub use pool::Pool;
pub use port::{In, Out, Ports};
pub use registry::Registry;
pub use report::Report;
pub use setup::{Purpose, Setup};
