//! The bytes of packets as the program inside the head reads and writes them.

use super::picture::{self, Change};

/// What a controller said.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Word {
    /// The head takes this number, the next head the next.
    AddressSet(u8),
    Clear {
        broadcast: bool,
    },
    Cancel(u8),
    Order(Order),
    Question(Question),
}

/// A command: takes a socket.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Order {
    /// Speeds of pan and tilt, then positions.
    Absolute([u8; 2], [i32; 2]),
    Relative([u8; 2], [i32; 2]),
    /// Speeds, then −1, 0, 1 for left or down, stop, right or up.
    Drive([u8; 2], [i8; 2]),
    Home,
    Reset,
    /// Up and right, or down and left, and how far.
    Limit(bool, [i32; 2]),
    NoLimit(bool),
    ZoomTo(u16),
    /// −1 wide, 0 stop, 1 tele.
    ZoomDrive(i8),
    FocusAuto(bool),
    /// Toggles between automatic and manual.
    FocusToggle,
    FocusTo(u16),
    /// −1 far, 0 stop, 1 near.
    FocusDrive(i8),
    /// What is done with the place of this number.
    Memory(Memory, u8),
    Picture(Change),
    Power(bool),
}

/// What is done with a place of the memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Memory {
    Reset,
    Set,
    Recall,
}

/// An inquiry: answered from no socket.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Question {
    Power,
    Version,
    Zoom,
    FocusMode,
    Focus,
    MaxSpeed,
    Position,
    /// The place of the memory that was recalled last.
    Memory,
    /// A setting of the picture by its index.
    Picture(usize),
}

/// Reads a packet without header and terminator; `None`: a syntax error.
pub(super) fn read(header: u8, message: &[u8]) -> Option<Word> {
    Some(match *message {
        [0x30, number @ 1..=7] if header == 0x88 => Word::AddressSet(number),
        [0x01, 0x00, 0x01] => Word::Clear { broadcast: header == 0x88 },
        [cancel @ 0x20..=0x2F] => Word::Cancel(cancel & 0x0F),
        [0x01, group, code, ref rest @ ..] => Word::Order(order(group, code, rest)?),
        [0x09, group, code] => Word::Question(match (group, code) {
            (0x00, 0x02) => Question::Version,
            (0x04, 0x00) => Question::Power,
            (0x04, 0x47) => Question::Zoom,
            (0x04, 0x38) => Question::FocusMode,
            (0x04, 0x48) => Question::Focus,
            (0x06, 0x11) => Question::MaxSpeed,
            (0x06, 0x12) => Question::Position,
            (0x04, 0x3F) => Question::Memory,
            _ => Question::Picture(picture::asked(group, code)?),
        }),
        _ => return None,
    })
}

fn order(group: u8, code: u8, rest: &[u8]) -> Option<Order> {
    Some(match (group, code, rest) {
        (0x06, 0x01, &[v, w, pan, tilt]) => {
            let way = |it: u8, less: u8, more: u8| match it {
                3 => Some(0),
                it if it == less => Some(-1),
                it if it == more => Some(1),
                _ => None,
            };
            Order::Drive([v, w], [way(pan, 1, 2)?, way(tilt, 2, 1)?])
        }
        (0x06, 0x02, &[v, w, ref digits @ ..]) => Order::Absolute([v, w], two_words(digits)?),
        (0x06, 0x03, &[v, w, ref digits @ ..]) => Order::Relative([v, w], two_words(digits)?),
        (0x06, 0x04, []) => Order::Home,
        (0x06, 0x05, []) => Order::Reset,
        (0x06, 0x07, &[0x00, corner @ 0..=1, ref digits @ ..]) => Order::Limit(corner == 1, two_words(digits)?),
        (0x06, 0x07, &[0x01, corner @ 0..=1, 7, 15, 15, 15, 7, 15, 15, 15]) => Order::NoLimit(corner == 1),
        (0x04, 0x00, [0x02]) => Order::Power(true),
        (0x04, 0x00, [0x03]) => Order::Power(false),
        (0x04, 0x07, [0x00]) => Order::ZoomDrive(0),
        (0x04, 0x07, [0x02 | 0x20..=0x27]) => Order::ZoomDrive(1),
        (0x04, 0x07, [0x03 | 0x30..=0x37]) => Order::ZoomDrive(-1),
        (0x04, 0x47, digits) => Order::ZoomTo(word(digits)? as u16),
        (0x04, 0x38, [0x02]) => Order::FocusAuto(true),
        (0x04, 0x38, [0x03]) => Order::FocusAuto(false),
        (0x04, 0x38, [0x10]) => Order::FocusToggle,
        (0x04, 0x18, [0x02]) => Order::FocusDrive(-1),
        (0x04, 0x48, digits) => Order::FocusTo(word(digits)? as u16),
        (0x04, 0x08, [0x00]) => Order::FocusDrive(0),
        (0x04, 0x08, [0x02 | 0x20..=0x27]) => Order::FocusDrive(-1),
        (0x04, 0x08, [0x03 | 0x30..=0x37]) => Order::FocusDrive(1),
        (0x04, 0x3F, &[0x00, number]) => Order::Memory(Memory::Reset, number),
        (0x04, 0x3F, &[0x01, number]) => Order::Memory(Memory::Set, number),
        (0x04, 0x3F, &[0x02, number]) => Order::Memory(Memory::Recall, number),
        _ => Order::Picture(picture::change(group, code, rest)?),
    })
}

/// Four digits as a 16-bit number with sign.
pub(super) fn word(digits: &[u8]) -> Option<i16> {
    let &[a, b, c, d] = digits else { return None };
    if [a, b, c, d].iter().any(|it| *it > 15) {
        return None;
    }
    Some(i16::from_be_bytes([a << 4 | b, c << 4 | d]))
}

fn two_words(digits: &[u8]) -> Option<[i32; 2]> {
    if digits.len() != 8 {
        return None;
    }
    Some([i32::from(word(&digits[..4])?), i32::from(word(&digits[4..])?)])
}

/// The four digits of a 16-bit number.
pub(super) fn digits(value: i32) -> [u8; 4] {
    let [high, low] = (value as i16).to_be_bytes();
    [high >> 4, high & 15, low >> 4, low & 15]
}
