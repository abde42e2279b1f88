//! NPZ, the archive format of `numpy.load`: reader and writer, pure functions over numbers.
//!
//! An array is a file `NAME.npy` (NumPy's format 1.0: a dictionary in text, then the numbers, little-endian, the last index fastest) in a ZIP
//! archive without compression.

mod read;

pub use read::{Arrays, Numbers};

/// An archive that arrays are added to.
#[derive(Debug, Default)]
pub struct Archive {
    bytes: Vec<u8>,
    /// Name, checksum, length and place of each file.
    files: Vec<(String, u32, u32, u32)>,
}

/// No array or archive is longer: the lengths of a plain ZIP archive have 32 bits [bytes].
const MOST_BYTES: usize = u32::MAX as usize;
/// Of the file's own format: 1980-01-01, for nodes read no clock.
const DATE: u16 = 0x0021;

/// The archive would be longer than 4 GiB.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TooLong;

impl Archive {
    /// Adds an array of 64-bit floats.
    ///
    /// # Errors
    /// [`TooLong`].
    ///
    /// # Panics
    /// When `values` does not fill the shape.
    pub fn floats(&mut self, name: &str, shape: &[usize], values: &[f64]) -> Result<(), TooLong> {
        self.array(name, "<f8", shape, values.len(), 8, values.iter().flat_map(|it| it.to_le_bytes()))
    }

    /// Adds an array of 32-bit floats; errors and panics as [`Self::floats`].
    pub fn short_floats(&mut self, name: &str, shape: &[usize], values: &[f32]) -> Result<(), TooLong> {
        self.array(name, "<f4", shape, values.len(), 4, values.iter().flat_map(|it| it.to_le_bytes()))
    }

    /// Adds an array of bytes; errors and panics as [`Self::floats`].
    pub fn bytes(&mut self, name: &str, shape: &[usize], values: &[u8]) -> Result<(), TooLong> {
        self.array(name, "|u1", shape, values.len(), 1, values.iter().copied())
    }

    /// Adds an array of texts; errors as [`Self::floats`].
    pub fn texts(&mut self, name: &str, texts: &[&str]) -> Result<(), TooLong> {
        let length = texts.iter().map(|it| it.chars().count()).max().unwrap_or(0).max(1);
        let letters = texts.iter().flat_map(|it| it.chars().map(u32::from).chain(std::iter::repeat(0)).take(length));
        let kind = format!("<U{length}");
        self.array(name, &kind, &[texts.len()], texts.len(), 4 * length, letters.flat_map(u32::to_le_bytes))
    }

    fn array(
        &mut self,
        name: &str,
        kind: &str,
        shape: &[usize],
        n_values: usize,
        size: usize,
        values: impl Iterator<Item = u8>,
    ) -> Result<(), TooLong> {
        assert_eq!(shape.iter().product::<usize>(), n_values, "`{name}` has another shape than {shape:?}");
        let lengths: String = shape.iter().map(|it| format!("{it}, ")).collect();
        let text = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({lengths}), }}");
        // Such that the numbers begin at a multiple of 64 bytes of the array's file.
        let length = (10 + text.len() + 1).next_multiple_of(64) - 10;
        if n_values.saturating_mul(size).saturating_add(1 << 16) > MOST_BYTES - self.bytes.len().min(MOST_BYTES) {
            return Err(TooLong);
        }
        let file_name = format!("{name}.npy");
        let start = self.bytes.len();
        self.local_header(&file_name, 0, 0);
        let content = self.bytes.len();
        self.bytes.extend_from_slice(b"\x93NUMPY\x01\x00");
        self.bytes.extend((length as u16).to_le_bytes());
        self.bytes.extend_from_slice(format!("{text:<width$}\n", width = length - 1).as_bytes());
        self.bytes.reserve(n_values * size);
        self.bytes.extend(values);
        let (sum, size) = (crc32(&self.bytes[content..]), (self.bytes.len() - content) as u32);
        self.bytes[start + 14..start + 18].copy_from_slice(&sum.to_le_bytes());
        self.bytes[start + 18..start + 22].copy_from_slice(&size.to_le_bytes());
        self.bytes[start + 22..start + 26].copy_from_slice(&size.to_le_bytes());
        self.files.push((file_name, sum, size, start as u32));
        Ok(())
    }

    fn local_header(&mut self, name: &str, sum: u32, size: u32) {
        self.bytes.extend_from_slice(b"PK\x03\x04");
        self.common_header(name, sum, size);
        self.bytes.extend_from_slice(name.as_bytes());
    }

    /// What stands both before a file and in the list at the end: version, flags, no compression, time, checksum, sizes, lengths of the names.
    fn common_header(&mut self, name: &str, sum: u32, size: u32) {
        for word in [20, 0, 0, 0, DATE] {
            self.bytes.extend(word.to_le_bytes());
        }
        for word in [sum, size, size] {
            self.bytes.extend(word.to_le_bytes());
        }
        self.bytes.extend((name.len() as u16).to_le_bytes());
        self.bytes.extend([0, 0]);
    }

    /// The bytes of the whole archive.
    pub fn finish(mut self) -> Vec<u8> {
        let start = self.bytes.len();
        let files = std::mem::take(&mut self.files);
        for (name, sum, size, place) in &files {
            self.bytes.extend_from_slice(b"PK\x01\x02");
            self.bytes.extend(20_u16.to_le_bytes());
            self.common_header(name, *sum, *size);
            // No comment, first disk, no attributes.
            self.bytes.extend([0; 10]);
            self.bytes.extend(place.to_le_bytes());
            self.bytes.extend_from_slice(name.as_bytes());
        }
        let length = self.bytes.len() - start;
        self.bytes.extend_from_slice(b"PK\x05\x06\0\0\0\0");
        for _ in 0..2 {
            self.bytes.extend((files.len() as u16).to_le_bytes());
        }
        self.bytes.extend((length as u32).to_le_bytes());
        self.bytes.extend((start as u32).to_le_bytes());
        self.bytes.extend([0, 0]);
        self.bytes
    }
}

/// The checksum of ZIP (polynomial 0xEDB88320, reflected).
fn crc32(bytes: &[u8]) -> u32 {
    const TABLE: [u32; 256] = {
        let mut table = [0; 256];
        let mut byte = 0;
        while byte < 256 {
            let mut sum = byte as u32;
            let mut bit = 0;
            while bit < 8 {
                sum = if sum & 1 == 1 { sum >> 1 ^ 0xedb8_8320 } else { sum >> 1 };
                bit += 1;
            }
            table[byte] = sum;
            byte += 1;
        }
        table
    };
    !bytes.iter().fold(!0, |sum, &byte| sum >> 8 ^ TABLE[usize::from(sum as u8 ^ byte)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checksum_is_that_of_zip() {
        assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
    }

    #[test]
    fn array_begins_at_a_multiple_of_64() {
        let mut archive = Archive::default();
        archive.floats("a", &[2, 1], &[1.5, -2.0]).unwrap();
        let bytes = archive.finish();
        let start = 30 + "a.npy".len();
        assert_eq!(&bytes[start..start + 8], b"\x93NUMPY\x01\x00");
        let length = usize::from(u16::from_le_bytes([bytes[start + 8], bytes[start + 9]]));
        assert!((10 + length).is_multiple_of(64));
        let text = std::str::from_utf8(&bytes[start + 10..start + 10 + length]).unwrap();
        assert_eq!(text.trim_end(), "{'descr': '<f8', 'fortran_order': False, 'shape': (2, 1, ), }");
        assert_eq!(bytes[start + 10 + length..][..8], 1.5_f64.to_le_bytes());
    }
}
