//! Sessions: recordings of runs as MCAP files, written while a rig runs, mended, read and replayed.
//!
//! A session holds the messages of nodes, the order of delivery ([`order`]), the rig with every default filled in and the files that it reads. What nodes make of
//! the same messages in the same order is the same, so that a replay gives the same results byte by byte.

pub mod attach;
pub mod body;
pub mod cut;
pub mod file;
mod gathered;
pub mod glance;
mod hidden;
pub mod merge;
pub mod names;
pub mod order;
pub mod picture;
pub mod playback;
pub mod player;
pub mod reading;
pub mod recorder;
pub mod records;
pub mod replay;
pub mod session;
mod shift;
mod shown;
pub mod source;
pub mod summary;
pub mod viewer;
pub mod wanted;

pub use file::Packing;
pub use picture::Pictures;
pub use player::Player;
pub use recorder::{Recorded, Recorder, Recording};
pub use session::Session;
