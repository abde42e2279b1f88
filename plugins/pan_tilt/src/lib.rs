//! Pan-tilt heads [Davis 2002 chapter 4].
//!
//! | module | what it holds |
//! |---|---|
//! | [`visca`] | the protocol of Sony's heads: bytes to meaning and back |
//! | [`driver`] | what is sent when, what is made of replies: no line, no clock |
//! | [`port`] | serial ports and UDP sockets |
//! | [`head`] | a driver on its port, with a thread that listens |

pub mod driver;
pub mod head;
pub mod port;
pub mod visca;
