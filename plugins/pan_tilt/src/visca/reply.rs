//! Messages of a head to its controller.

use super::{Format, Inquiry, Packet, Speed, nibbles};

/// One packet of a head.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reply {
    /// The heads of the line have numbered themselves.
    AddressSet {
        /// Number of heads.
        heads: u8,
    },
    /// Every head has forgotten its commands.
    ClearedAll,
    /// A head was connected, disconnected or switched on: addresses have to be set again.
    NetworkChange,
    /// A command was accepted.
    Acknowledged {
        /// Socket that holds it until it is done.
        socket: u8,
    },
    /// A command is done, or cancelled commands are cleared (socket 0).
    Completed {
        /// The socket that is free again.
        socket: u8,
    },
    /// The answer to an inquiry, for [`Inquiry::read`].
    Answer(Packet),
    /// A command or an inquiry was refused.
    Refused {
        /// The command's socket; 0 without one.
        socket: u8,
        /// The reason.
        refusal: Refusal,
    },
}

/// Why a head refuses a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// 01
    #[error("the message is too long for the head")]
    Length,
    /// 02
    #[error("the message is unknown to the head, or a number in it is out of range")]
    Syntax,
    /// 03
    #[error("the head's command buffer is full")]
    BufferFull,
    /// 04
    #[error("the command was cancelled")]
    Cancelled,
    /// 05
    #[error("the head has no command in this socket")]
    NoSocket,
    /// 41
    #[error("the head cannot do this now")]
    NotExecutable,
    /// Any other number.
    #[error("the head refused with code {0:#04x}")]
    Other(u8),
}

impl Reply {
    /// Decodes a packet of the head at `address` (1 to 7); `None` for other packets.
    pub fn decode(packet: &Packet, address: u8) -> Option<Reply> {
        if packet.header() == 0x88 {
            return match *packet.message() {
                [0x30, next @ 2..=8] => Some(Reply::AddressSet { heads: next - 1 }),
                [0x01, 0x00, 0x01] => Some(Reply::ClearedAll),
                _ => None,
            };
        }
        // A head that was just switched on may not know its address yet.
        if matches!(packet.header(), 0x80 | 0x90 | 0xA0 | 0xB0 | 0xC0 | 0xD0 | 0xE0 | 0xF0)
            && packet.message() == [0x38]
        {
            return Some(Reply::NetworkChange);
        }
        if packet.header() != 0x80 | address << 4 {
            return None;
        }
        match *packet.message() {
            [ack @ 0x40..=0x4F] => Some(Reply::Acknowledged { socket: ack & 0x0F }),
            [done @ 0x50..=0x5F] => Some(Reply::Completed { socket: done & 0x0F }),
            [0x50, ..] => Some(Reply::Answer(*packet)),
            [error @ 0x60..=0x6F, number] => {
                Some(Reply::Refused { socket: error & 0x0F, refusal: Refusal::from_number(number) })
            }
            _ => None,
        }
    }
}

impl Refusal {
    fn from_number(number: u8) -> Refusal {
        match number {
            0x01 => Refusal::Length,
            0x02 => Refusal::Syntax,
            0x03 => Refusal::BufferFull,
            0x04 => Refusal::Cancelled,
            0x05 => Refusal::NoSocket,
            0x41 => Refusal::NotExecutable,
            other => Refusal::Other(other),
        }
    }
}

/// Answer of a head to an [`Inquiry`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Answer {
    /// Whether it is on.
    Power(bool),
    /// Which model it is.
    Version(Version),
    /// Focal length [units].
    Zoom(u16),
    /// Whether autofocus is on.
    FocusAuto(bool),
    /// Focus [units].
    Focus(u16),
    /// Status bits of the mechanics, as listed in the model's manual.
    Status(u16),
    /// Largest speeds.
    MaxSpeed(Speed),
    /// Pan and tilt.
    Position {
        /// [units]
        pan: i32,
        /// [units]
        tilt: i32,
    },
}

/// Model of a head.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Version {
    /// 0x0020 and 0x0001 are Sony.
    pub vendor: u16,
    /// 0x0402 is an EVI-D30.
    pub model: u16,
    /// Firmware revision.
    pub rom: u16,
    /// Number of sockets.
    pub sockets: u8,
}

impl Inquiry {
    /// The answer in a [`Reply::Answer`]; `None` if the packet answers another inquiry.
    pub fn read(self, packet: &Packet, format: Format) -> Option<Answer> {
        let answer = packet.message().strip_prefix(&[0x50])?;
        let units = || if answer.len() == 4 { u16::try_from(nibbles::unsigned(answer)?).ok() } else { None };
        let is_on = || match *answer {
            [0x02] => Some(true),
            [0x03] => Some(false),
            _ => None,
        };
        Some(match self {
            Inquiry::Power => Answer::Power(is_on()?),
            Inquiry::FocusMode => Answer::FocusAuto(is_on()?),
            Inquiry::Zoom => Answer::Zoom(units()?),
            Inquiry::Focus => Answer::Focus(units()?),
            Inquiry::Version => match *answer {
                [a, b, c, d, e, f, sockets] => {
                    let word = |high, low| u16::from_be_bytes([high, low]);
                    Answer::Version(Version { vendor: word(a, b), model: word(c, d), rom: word(e, f), sockets })
                }
                _ => return None,
            },
            Inquiry::PanTiltStatus => match *answer {
                [high, low] => Answer::Status(u16::from_be_bytes([high, low])),
                _ => return None,
            },
            Inquiry::PanTiltMaxSpeed => match *answer {
                [pan, tilt] => Answer::MaxSpeed(Speed { pan, tilt }),
                _ => return None,
            },
            Inquiry::PanTiltPosition => {
                if answer.len() != format.pan_digits + 4 {
                    return None;
                }
                let (pan, tilt) = answer.split_at(format.pan_digits);
                Answer::Position { pan: nibbles::signed(pan)?, tilt: nibbles::signed(tilt)? }
            }
        })
    }
}
