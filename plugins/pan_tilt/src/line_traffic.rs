//! The message `line_traffic`: the bytes that went over the line of a head, both ways.

use foveate::messages::{Quality, Space, Wire};
use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Bytes that went over a line since the message before this one.
///
/// What goes over the line after the last activation of its node is in no message: the end of a packet, or the command that stops the motors.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub struct LineTraffic {
    /// Number of pieces before the first of `pieces` that were dropped, because the node was not activated for a long time.
    pub lost: u64,
    /// Pieces in the order of their times, at least one.
    pub pieces: Vec<LinePiece>,
}

/// Bytes that went over a line together.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct LinePiece {
    /// Session time at which the driver wrote the bytes to the line, or read the first of them from it.
    pub time: Time,
    /// Which way they went.
    pub direction: Direction,
    /// The bytes. Sent: one frame, which is on the line even if the port then reports an error. Received: a datagram, or bytes of a serial line; the bytes of a
    /// packet are not divided unless there is a pause in it.
    pub bytes: Vec<u8>,
}

/// Direction of bytes on a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Direction {
    /// From the driver to the device.
    Sent,
    /// From the device to the driver.
    Received,
}

impl LineTraffic {
    /// The same on a clock that is ahead by `offset`.
    pub fn later_by(mut self, offset: Interval) -> LineTraffic {
        self.pieces.iter_mut().for_each(|it| it.time = it.time + offset);
        self
    }
}

impl Message for LineTraffic {
    const NAME: &'static str = "line_traffic";
    const SPACE: Space = Space::NONE;
    const WIRE: Wire = Wire::portable::<LineTraffic>();

    fn quality(&self) -> Quality {
        Quality { count: Some(self.pieces.len() as u32), sigma: None }
    }
}
