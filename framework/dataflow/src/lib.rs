//! Nodes and typed ports, rigs in TOML, checked graphs, their schedule, and the ledger on every edge.
//!
//! | module | what it holds |
//! |---|---|
//! | [`node`], [`port`], [`io`] | what an author writes: a type with ports, settings and `process` |
//! | [`registry`] | the node types that a program knows, erased |
//! | [`rig`] | TOML → every fault, or a [`graph::Graph`] |
//! | [`graph`] | instances and edges, checked and expanded, and their pictures |
//! | [`run`] | two engines over one graph: deterministic (simulated, files) and live (worker threads) |
//! | [`scale`] | the scales at run time: who carries a scale's space, and where it is |
//! | [`ledger`] | what each edge measured, and the requirements it was held to |

pub mod error;
pub mod graph;
pub mod io;
pub mod ledger;
pub mod line;
pub mod node;
pub mod pool;
pub mod port;
pub mod registry;
pub mod report;
pub mod rig;
pub mod run;
pub mod scale;
pub mod setting_docs;
pub mod setup;

pub use error::{ConfigError, NodeError};
pub use foveate_messages::{Interval, Message, SourceId, Stamp, Stamped, Time};
pub use io::Io;
pub use line::{Device, Line};
pub use node::{Due, Node, Plan, Role};
pub use pool::Pool;
pub use port::{In, Out, Ports};
pub use registry::Registry;
pub use report::Report;
pub use setup::{Purpose, Setup};
