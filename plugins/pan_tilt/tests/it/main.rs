//! Pan-tilt heads: bytes, lines, the driver, and heads in rigs.

mod any_bytes;
mod datagrams;
mod driver;
mod lines;
mod rig;
mod vectors;
