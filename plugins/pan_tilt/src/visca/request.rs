//! Messages of a controller to a head.

use super::{Address, Format, Packet, VISCA_END, nibbles};

/// One packet of the controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Request {
    /// Broadcast: the heads of the line number themselves from 1.
    AddressSet,
    /// Broadcast: every head drops its commands.
    ClearAll,
    /// The head drops its commands, including the one being executed.
    Clear,
    /// Cancels the command in this socket.
    Cancel {
        /// 1 or 2 with known heads; at most 15.
        socket: u8,
    },
    /// A command: acknowledged at once, completed when done.
    Command(Command),
    /// An inquiry: answered at once, takes no socket.
    Inquiry(Inquiry),
}

/// A command. Positions and speeds are in the head's units, see [`Profile`](super::Profile).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    /// Go to a position.
    Absolute {
        /// [units]
        pan: i32,
        /// [units]
        tilt: i32,
        /// Speed.
        speed: Speed,
    },
    /// Move relative to the present position. Some models round each step: a sequence of them drifts.
    Relative {
        /// [units]
        pan: i32,
        /// [units]
        tilt: i32,
        /// Speed.
        speed: Speed,
    },
    /// Move until another command; both axes at `Stop`: stop.
    Drive {
        /// Direction of pan.
        pan: PanDrive,
        /// Direction of tilt.
        tilt: TiltDrive,
        /// Speed.
        speed: Speed,
    },
    /// Go to the centre of both axes.
    Home,
    /// Find the ends of the axes again, then go to the centre.
    Reset,
    /// Set a limit of motion.
    LimitSet {
        /// The limited corner.
        corner: Corner,
        /// [units]
        pan: i32,
        /// [units]
        tilt: i32,
    },
    /// Remove a limit of motion.
    LimitClear {
        /// The limited corner.
        corner: Corner,
    },
    /// Go to this focal length [units].
    ZoomDirect(u16),
    /// Zoom until another command.
    Zoom(ZoomDrive),
    /// Autofocus on or off.
    FocusAuto(bool),
    /// Go to this focus [units]; refused while autofocus is on.
    FocusDirect(u16),
    /// On, or standby.
    Power(bool),
}

/// Speed of the axes, in the head's own steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Speed {
    /// 1 is the slowest.
    pub pan: u8,
    /// 1 is the slowest.
    pub tilt: u8,
}

/// Direction of pan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "the names say it")]
pub enum PanDrive {
    Left = 1,
    Right = 2,
    Stop = 3,
}

/// Direction of tilt.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "the names say it")]
pub enum TiltDrive {
    Up = 1,
    Down = 2,
    Stop = 3,
}

/// The two ends of one limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "the names say it")]
pub enum Corner {
    DownLeft = 0,
    UpRight = 1,
}

/// Direction of zoom, at the standard speed or at one from 0 to 15 (models support 0 to 7).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "the names say it")]
pub enum ZoomDrive {
    Stop,
    Tele(Option<u8>),
    Wide(Option<u8>),
}

/// An inquiry.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Inquiry {
    /// Whether it is on.
    Power,
    /// Maker, model, revision, number of sockets.
    Version,
    /// Focal length [units].
    Zoom,
    /// Whether autofocus is on.
    FocusMode,
    /// Focus [units].
    Focus,
    /// Status bits of the mechanics.
    PanTiltStatus,
    /// Largest speeds.
    PanTiltMaxSpeed,
    /// Pan and tilt [units].
    PanTiltPosition,
}

/// A number out of range.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{what} is {found}, expected {min} to {max}")]
pub struct OutOfRange {
    /// Name of the number.
    pub what: &'static str,
    /// Its value.
    pub found: i32,
    /// Smallest allowed value.
    pub min: i32,
    /// Largest allowed value.
    pub max: i32,
}

impl OutOfRange {
    /// `Ok` if `found` is in the range.
    pub(crate) fn unless_in(what: &'static str, found: i32, min: i32, max: i32) -> Result<(), OutOfRange> {
        if (min..=max).contains(&found) { Ok(()) } else { Err(OutOfRange { what, found, min, max }) }
    }
}

/// The "no limit" of [`Command::LimitClear`].
const NO_LIMIT: i32 = 0x7FFF;

impl Request {
    /// The packet to the head at `address`.
    ///
    /// # Errors
    /// A number that cannot be written.
    pub fn encode(&self, address: Address, format: Format) -> Result<Packet, OutOfRange> {
        let mut bytes = vec![0x80 | address.number()];
        match *self {
            Request::AddressSet => bytes = vec![0x88, 0x30, 0x01],
            Request::ClearAll => bytes = vec![0x88, 0x01, 0x00, 0x01],
            Request::Clear => bytes.extend([0x01, 0x00, 0x01]),
            Request::Cancel { socket } => {
                OutOfRange::unless_in("socket", i32::from(socket), 0, 15)?;
                bytes.push(0x20 | socket);
            }
            Request::Command(command) => command.write(format, &mut bytes)?,
            Request::Inquiry(inquiry) => {
                bytes.push(0x09);
                bytes.extend(inquiry.code());
            }
        }
        bytes.push(VISCA_END);
        Ok(Packet::from_bytes(&bytes).unwrap_or_else(|| unreachable!("requests have a header and 1 to 14 bytes")))
    }

    /// Decodes a packet; `None` for anything but these requests.
    pub fn decode(packet: &Packet, format: Format) -> Option<Request> {
        match *packet.message() {
            [0x30, 0x01] if packet.header() == 0x88 => Some(Request::AddressSet),
            [0x01, 0x00, 0x01] if packet.header() == 0x88 => Some(Request::ClearAll),
            _ if !(0x81..=0x87).contains(&packet.header()) => None,
            [0x01, 0x00, 0x01] => Some(Request::Clear),
            [cancel @ 0x20..=0x2F] => Some(Request::Cancel { socket: cancel & 0x0F }),
            [0x01, ref rest @ ..] => Command::read(rest, format).map(Request::Command),
            [0x09, group, number] => {
                Inquiry::ALL.into_iter().find(|it| it.code() == [group, number]).map(Request::Inquiry)
            }
            _ => None,
        }
    }
}

impl Command {
    fn write(self, format: Format, bytes: &mut Vec<u8>) -> Result<(), OutOfRange> {
        bytes.push(0x01);
        match self {
            Command::Absolute { pan, tilt, speed } => {
                bytes.extend([0x06, 0x02]);
                write_move(format, pan, tilt, speed, bytes)?;
            }
            Command::Relative { pan, tilt, speed } => {
                bytes.extend([0x06, 0x03]);
                write_move(format, pan, tilt, speed, bytes)?;
            }
            Command::Drive { pan, tilt, speed } => {
                speed.check()?;
                bytes.extend([0x06, 0x01, speed.pan, speed.tilt, pan as u8, tilt as u8]);
            }
            Command::Home => bytes.extend([0x06, 0x04]),
            Command::Reset => bytes.extend([0x06, 0x05]),
            Command::LimitSet { corner, pan, tilt } => {
                bytes.extend([0x06, 0x07, 0x00, corner as u8]);
                write_position(format, pan, tilt, bytes)?;
            }
            Command::LimitClear { corner } => {
                bytes.extend([0x06, 0x07, 0x01, corner as u8]);
                nibbles::write(if format.pan_digits == 5 { 0x7_FFFF } else { NO_LIMIT }, format.pan_digits, bytes);
                nibbles::write(NO_LIMIT, 4, bytes);
            }
            Command::ZoomDirect(units) => {
                bytes.extend([0x04, 0x47]);
                nibbles::write(i32::from(units), 4, bytes);
            }
            Command::Zoom(drive) => bytes.extend([0x04, 0x07, drive.code()?]),
            Command::FocusAuto(auto) => bytes.extend([0x04, 0x38, on_off(auto)]),
            Command::FocusDirect(units) => {
                bytes.extend([0x04, 0x48]);
                nibbles::write(i32::from(units), 4, bytes);
            }
            Command::Power(on) => bytes.extend([0x04, 0x00, on_off(on)]),
        }
        Ok(())
    }

    /// Decodes the bytes after the 0x01.
    fn read(message: &[u8], format: Format) -> Option<Command> {
        let position = |digits: &[u8]| {
            if digits.len() != format.pan_digits + 4 {
                return None;
            }
            let (pan, tilt) = digits.split_at(format.pan_digits);
            Some((nibbles::signed(pan)?, nibbles::signed(tilt)?))
        };
        let units = |digits: &[u8]| {
            if digits.len() == 4 { nibbles::unsigned(digits).and_then(|it| u16::try_from(it).ok()) } else { None }
        };
        Some(match *message {
            [0x06, kind @ (0x02 | 0x03), pan_speed, tilt_speed, ref digits @ ..] => {
                let ((pan, tilt), speed) = (position(digits)?, Speed { pan: pan_speed, tilt: tilt_speed });
                speed.check().ok()?;
                if kind == 0x02 {
                    Command::Absolute { pan, tilt, speed }
                } else {
                    Command::Relative { pan, tilt, speed }
                }
            }
            [0x06, 0x01, pan_speed, tilt_speed, pan, tilt] => {
                let speed = Speed { pan: pan_speed, tilt: tilt_speed };
                speed.check().ok()?;
                let pan = [PanDrive::Left, PanDrive::Right, PanDrive::Stop].into_iter().find(|&it| it as u8 == pan)?;
                let tilt =
                    [TiltDrive::Up, TiltDrive::Down, TiltDrive::Stop].into_iter().find(|&it| it as u8 == tilt)?;
                Command::Drive { pan, tilt, speed }
            }
            [0x06, 0x04] => Command::Home,
            [0x06, 0x05] => Command::Reset,
            [0x06, 0x07, clear @ (0 | 1), corner, ref digits @ ..] => {
                let corner = [Corner::DownLeft, Corner::UpRight].into_iter().find(|&it| it as u8 == corner)?;
                let (pan, tilt) = position(digits)?;
                if clear == 0 { Command::LimitSet { corner, pan, tilt } } else { Command::LimitClear { corner } }
            }
            [0x04, 0x47, ref digits @ ..] => Command::ZoomDirect(units(digits)?),
            [0x04, 0x07, 0x00] => Command::Zoom(ZoomDrive::Stop),
            [0x04, 0x07, 0x02] => Command::Zoom(ZoomDrive::Tele(None)),
            [0x04, 0x07, 0x03] => Command::Zoom(ZoomDrive::Wide(None)),
            [0x04, 0x07, code @ 0x20..=0x2F] => Command::Zoom(ZoomDrive::Tele(Some(code & 0x0F))),
            [0x04, 0x07, code @ 0x30..=0x3F] => Command::Zoom(ZoomDrive::Wide(Some(code & 0x0F))),
            [0x04, 0x38, auto @ (0x02 | 0x03)] => Command::FocusAuto(auto == 0x02),
            [0x04, 0x48, ref digits @ ..] => Command::FocusDirect(units(digits)?),
            [0x04, 0x00, on @ (0x02 | 0x03)] => Command::Power(on == 0x02),
            _ => return None,
        })
    }
}

fn write_move(format: Format, pan: i32, tilt: i32, speed: Speed, bytes: &mut Vec<u8>) -> Result<(), OutOfRange> {
    speed.check()?;
    bytes.extend([speed.pan, if format.tilt_speed { speed.tilt } else { 0 }]);
    write_position(format, pan, tilt, bytes)
}

fn write_position(format: Format, pan: i32, tilt: i32, bytes: &mut Vec<u8>) -> Result<(), OutOfRange> {
    for (what, value, digits) in [("pan", pan, format.pan_digits), ("tilt", tilt, 4)] {
        let half = 1 << (4 * digits - 1);
        if !nibbles::fits_signed(value, digits) {
            return Err(OutOfRange { what, found: value, min: -half, max: half - 1 });
        }
        nibbles::write(value, digits, bytes);
    }
    Ok(())
}

fn on_off(on: bool) -> u8 {
    if on { 0x02 } else { 0x03 }
}

impl Speed {
    fn check(self) -> Result<(), OutOfRange> {
        OutOfRange::unless_in("speed of pan", i32::from(self.pan), 0, 0x7F)?;
        OutOfRange::unless_in("speed of tilt", i32::from(self.tilt), 0, 0x7F)
    }
}

impl ZoomDrive {
    fn code(self) -> Result<u8, OutOfRange> {
        let (standard, group, speed) = match self {
            ZoomDrive::Stop => return Ok(0x00),
            ZoomDrive::Tele(speed) => (0x02, 0x20, speed),
            ZoomDrive::Wide(speed) => (0x03, 0x30, speed),
        };
        let Some(speed) = speed else { return Ok(standard) };
        OutOfRange::unless_in("speed of zoom", i32::from(speed), 0, 15)?;
        Ok(group | speed)
    }
}

impl Inquiry {
    /// Every inquiry.
    pub const ALL: [Inquiry; 8] = [
        Inquiry::Power,
        Inquiry::Version,
        Inquiry::Zoom,
        Inquiry::FocusMode,
        Inquiry::Focus,
        Inquiry::PanTiltStatus,
        Inquiry::PanTiltMaxSpeed,
        Inquiry::PanTiltPosition,
    ];

    fn code(self) -> [u8; 2] {
        match self {
            Inquiry::Power => [0x04, 0x00],
            Inquiry::Version => [0x00, 0x02],
            Inquiry::Zoom => [0x04, 0x47],
            Inquiry::FocusMode => [0x04, 0x38],
            Inquiry::Focus => [0x04, 0x48],
            Inquiry::PanTiltStatus => [0x06, 0x10],
            Inquiry::PanTiltMaxSpeed => [0x06, 0x11],
            Inquiry::PanTiltPosition => [0x06, 0x12],
        }
    }
}
