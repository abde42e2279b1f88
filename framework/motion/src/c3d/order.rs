//! The three byte orders of C3D, and reads that may run past the end.

use super::{C3dError, fault};

/// Byte order and floating-point format of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ByteOrder {
    /// Little-endian, IEEE floats.
    Intel,
    /// Little-endian, VAX F floats: two words with the higher one first, four times the IEEE value of the same bits.
    Dec,
    /// Big-endian, IEEE floats.
    Sgi,
}

/// Two in the exponent of a float.
const TWO: u32 = 2 << 23;

impl ByteOrder {
    /// By the number in the parameter section.
    pub(super) fn of_processor(number: u8) -> Option<Self> {
        match number {
            84 => Some(Self::Intel),
            85 => Some(Self::Dec),
            86 => Some(Self::Sgi),
            _ => None,
        }
    }

    pub(super) fn processor(self) -> u8 {
        match self {
            Self::Intel => 84,
            Self::Dec => 85,
            Self::Sgi => 86,
        }
    }

    pub(super) fn word(self, bytes: [u8; 2]) -> u16 {
        match self {
            Self::Intel | Self::Dec => u16::from_le_bytes(bytes),
            Self::Sgi => u16::from_be_bytes(bytes),
        }
    }

    pub(super) fn float(self, bytes: [u8; 4]) -> f32 {
        match self {
            Self::Intel => f32::from_le_bytes(bytes),
            Self::Sgi => f32::from_be_bytes(bytes),
            Self::Dec => {
                let [a, b, c, d] = bytes;
                let bits = u32::from_le_bytes([c, d, a, b]);
                let exponent = bits >> 23 & 0xff;
                if exponent > 2 { f32::from_bits(bits - TWO) } else { f32::from_bits(bits) / 4.0 }
            }
        }
    }

    pub(super) fn word_bytes(self, word: u16) -> [u8; 2] {
        match self {
            Self::Intel | Self::Dec => word.to_le_bytes(),
            Self::Sgi => word.to_be_bytes(),
        }
    }

    /// A DEC float has no infinity: what is too large becomes its largest.
    pub(super) fn float_bytes(self, value: f32) -> [u8; 4] {
        match self {
            Self::Intel => value.to_le_bytes(),
            Self::Sgi => value.to_be_bytes(),
            Self::Dec => {
                let bits = value.to_bits();
                let scaled = match bits >> 23 & 0xff {
                    0 => 0,
                    exponent if exponent < 254 => bits + TWO,
                    _ => bits & 1 << 31 | 0x7fff_ffff,
                };
                let [a, b, c, d] = scaled.to_le_bytes();
                [c, d, a, b]
            }
        }
    }
}

/// A file's bytes, and how its numbers are written.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bytes<'a> {
    pub all: &'a [u8],
    pub order: ByteOrder,
}

impl<'a> Bytes<'a> {
    /// `length` bytes from `offset` on.
    pub fn range(&self, offset: usize, length: usize, what: &str) -> Result<&'a [u8], C3dError> {
        let end = offset.checked_add(length);
        match end.and_then(|end| self.all.get(offset..end)) {
            Some(bytes) => Ok(bytes),
            None => {
                let found = format!("the end of the file at byte {}", self.all.len());
                fault(offset, found, format_args!("{length} bytes of {what}"))
            }
        }
    }

    pub fn byte(&self, offset: usize, what: &str) -> Result<u8, C3dError> {
        Ok(self.range(offset, 1, what)?[0])
    }

    pub fn word(&self, offset: usize, what: &str) -> Result<u16, C3dError> {
        let bytes = self.range(offset, 2, what)?;
        Ok(self.order.word([bytes[0], bytes[1]]))
    }

    pub fn float(&self, offset: usize, what: &str) -> Result<f32, C3dError> {
        let bytes = self.range(offset, 4, what)?;
        Ok(self.order.float([bytes[0], bytes[1], bytes[2], bytes[3]]))
    }
}

/// Text without what fills it up; what is not UTF-8 is taken as Latin-1.
pub(super) fn text(bytes: &[u8]) -> String {
    let text = match std::str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        Err(_) => bytes.iter().map(|&it| char::from(it)).collect(),
    };
    text.trim_matches([' ', '\0', '\t']).to_owned()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn numbers_come_back_in_each_order(word in any::<u16>(), value in -1e30_f32..1e30) {
            for order in [ByteOrder::Intel, ByteOrder::Dec, ByteOrder::Sgi] {
                prop_assert_eq!(order.word(order.word_bytes(word)), word);
                prop_assert_eq!(order.float(order.float_bytes(value)), value);
                prop_assert_eq!(ByteOrder::of_processor(order.processor()), Some(order));
            }
        }
    }

    /// From the VAX architecture handbook: 1 is 0x4080 in the first word; and the ends of the range.
    #[test]
    fn dec_floats_are_those_of_the_vax() {
        assert_eq!(ByteOrder::Dec.float_bytes(1.0), [0x80, 0x40, 0, 0]);
        assert_eq!(ByteOrder::Dec.float([0x80, 0xc0, 0, 0]), -1.0);
        assert_eq!(ByteOrder::Dec.float_bytes(0.0), [0; 4]);
        assert!((ByteOrder::Dec.float([0xff, 0x7f, 0xff, 0xff]) - 1.701_411_7e38).abs() < 1e31);
        assert_eq!(ByteOrder::Dec.float_bytes(f32::MAX), [0xff, 0x7f, 0xff, 0xff]);
    }
}
