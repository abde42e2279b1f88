//! The VISCA protocol: encoding and decoding. No time, no state, no line.
//!
//! Sources: Sony, *EVI-D30/D31 Command List*, version 1.21; *EVI-D100 Technical Manual*; *EVI-D70 Technical Manual*; *BRC-H700
//! Command List* (five digits of pan); *SRG-300H Technical Manual* (VISCA over IP).
//!
//! | module | what it holds |
//! |---|---|
//! | [`packet`] | header, message, terminator; packets found in a stream with garbage in it |
//! | [`request`] | messages of a controller: commands, inquiries, cancel, clear, address set |
//! | [`reply`] | messages of a head: acknowledged, completed, refused, answers |
//! | [`ip`] | the eight bytes before each packet over UDP |
//! | [`profile`] | differences between models: digits, units, ranges, speeds |

pub mod ip;
mod nibbles;
pub mod packet;
pub mod profile;
pub mod reply;
pub mod request;

pub use packet::{Framer, Packet};
pub use profile::{AxisProfile, Profile};
pub use reply::{Answer, Refusal, Reply, Version};
pub use request::{Command, Corner, Inquiry, OutOfRange, PanDrive, Request, Speed, TiltDrive, ZoomDrive};

/// The last byte of every packet.
pub(crate) const VISCA_END: u8 = 0xFF;

/// Address of a head on its line: 1 is next to the controller, 7 the last.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Address(u8);

impl Address {
    /// The first head of a line, and the only one over IP.
    pub const FIRST: Address = Address(1);

    /// The address `number`; `None` outside 1 to 7.
    pub fn new(number: u8) -> Option<Address> {
        (1..=7).contains(&number).then_some(Address(number))
    }

    /// 1 to 7.
    pub fn number(self) -> u8 {
        self.0
    }
}

/// Format of a model's positions, which the packets do not state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Format {
    /// Hexadecimal digits of a pan position, 4 or 5; tilt has 4 on every model.
    pub pan_digits: usize,
    /// Whether absolute and relative moves carry a speed of tilt; if not (BRC), pan's speed is used for both, and 0 is sent.
    pub tilt_speed: bool,
}

impl Format {
    /// EVI series and most others.
    pub const EVI: Format = Format { pan_digits: 4, tilt_speed: true };
    /// BRC-300, BRC-H700 and similar models.
    pub const BRC: Format = Format { pan_digits: 5, tilt_speed: false };
}
