//! A simulated pan-tilt head: a Sony EVI-D30 down to the bytes on its line [Davis 2002 chapter 4].
//!
//! It shares no code with the driver in `plugins/pan_tilt`: the bytes are read and written here independently, from the manuals, so that
//! the two check each other.
//!
//! | module | what it holds |
//! |---|---|
//! | [`settings`] | what the head is like, with the figures of the EVI-D30 |
//! | [`mechanics`] | motors with latency, limited acceleration and steps, and what vibrates on them |
//! | `drive` | motors that are not ideal: limited jerk, friction, play, a zero that wanders |
//! | `words` | the bytes of packets, read and written |
//! | [`device`] | the program inside the head: messages in, answers out |
//! | `commands` | execution of commands: sockets, acknowledgements, completions |
//! | `picture` | commands about the picture, which are stored only |
//! | `track` | where it looked, for a while back |
//! | [`line`](mod@line) | the serial line: time of each byte, noise, unplugging |
//! | [`datagrams`] | VISCA over IP |
//! | [`axes`] | where its axes really are |
//! | [`motion`] | the head at the end of its line in a rig: what a driver talks to, and where cameras on it stand |
//! | [`serve`] | the head as a process, in real time: a pseudo terminal, UDP |
//!
//! All but `serve` live on a logical clock: bytes and times go in, bytes and times come out, the same for the same seed.

pub mod axes;
mod commands;
pub mod datagrams;
pub mod device;
mod drive;
pub mod line;
pub mod mechanics;
pub mod motion;
mod picture;
pub mod serve;
pub mod settings;
#[cfg(test)]
mod tests;
mod track;
mod words;

pub use axes::Axes;
pub use datagrams::NetworkHead;
pub use device::{Head, Tag};
pub use line::SerialHead;
pub use motion::{HeadMotion, LineFaults, LineHead};
pub use settings::{
    AxesSettings, HeadSettings, LineSettings, MotorSettings, NetworkSettings, PanSettings, TiltSettings,
};
pub use track::REMEMBERED_S;
