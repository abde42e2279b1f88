//! Numbers as VISCA writes them: one hexadecimal digit a byte, the highest first, negative ones as two's complement.

/// Whether `value` can be written as a signed number of so many digits.
pub(super) fn fits_signed(value: i32, digits: usize) -> bool {
    let half = 1i64 << (4 * digits - 1);
    (-half..half).contains(&i64::from(value))
}

/// Appends the lowest `digits` digits of `value`.
pub(super) fn write(value: i32, digits: usize, into: &mut Vec<u8>) {
    into.extend((0..digits).rev().map(|digit| (value >> (4 * digit)) as u8 & 0x0F));
}

/// An unsigned number; `None` if a byte is no digit or there are more than 7.
pub(super) fn unsigned(digits: &[u8]) -> Option<i32> {
    if digits.len() > 7 || digits.iter().any(|&it| it > 0x0F) {
        return None;
    }
    Some(digits.iter().fold(0, |value, &digit| value << 4 | i32::from(digit)))
}

/// A signed number of as many digits as there are; `None` as for [`unsigned`], or without any.
pub(super) fn signed(digits: &[u8]) -> Option<i32> {
    let value = unsigned(digits).filter(|_| !digits.is_empty())?;
    let bits = 4 * digits.len();
    Some(if value >> (bits - 1) == 1 { value - (1 << bits) } else { value })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn positions_of_the_manuals_are_read() {
        assert_eq!(signed(&[0x0F, 0x0C, 0x09, 0x00]), Some(-880));
        assert_eq!(signed(&[0x00, 0x03, 0x07, 0x00]), Some(880));
        assert_eq!(signed(&[0x0F, 0x07, 0x05, 0x0A, 0x08]), Some(-35_416));
        assert_eq!(signed(&[0x08, 0x00, 0x00, 0x00]), Some(-32_768));
        assert_eq!(signed(&[0x10, 0x00, 0x00, 0x00]), None);
        assert_eq!([signed(&[]), unsigned(&[0; 8])], [None, None]);
    }

    proptest! {
        #[test]
        fn what_fits_comes_back(value in -524_288..524_288i32, digits in 4usize..=5) {
            let mut bytes = Vec::new();
            write(value, digits, &mut bytes);
            prop_assert_eq!(bytes.len(), digits);
            prop_assert_eq!(signed(&bytes) == Some(value), fits_signed(value, digits));
        }
    }
}
