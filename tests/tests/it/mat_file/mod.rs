//! Numbers out of MATLAB 5 files, as far as the recordings need them: real matrices by name, deflated or not.

use std::io::Read as _;

/// The element types that matter here, by their numbers in a file.
const DOUBLE: u32 = 9;
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;
/// Header of the file, of a tag.
const HEADER: usize = 128;
const TAG: usize = 8;

/// The matrix of doubles called `name`: rows, columns, and the values column by column.
pub fn matrix(bytes: &[u8], name: &str) -> Option<(usize, usize, Vec<f64>)> {
    let mut rest = bytes.get(HEADER..)?;
    while let Some((kind, body, after)) = element(rest) {
        rest = after;
        let inflated = match kind {
            COMPRESSED => {
                let mut inflated = Vec::new();
                flate2::read::ZlibDecoder::new(body).read_to_end(&mut inflated).ok()?;
                inflated
            }
            _ => bytes_of(kind, body),
        };
        if let Some((MATRIX, body, _)) = element(&inflated)
            && let Some(found) = read(body, name)
        {
            return Some(found);
        }
    }
    None
}

/// An element that is not deflated, with a tag in front again.
fn bytes_of(kind: u32, body: &[u8]) -> Vec<u8> {
    let mut bytes = kind.to_le_bytes().to_vec();
    bytes.extend((body.len() as u32).to_le_bytes());
    bytes.extend(body);
    bytes
}

/// Kind, contents and what follows: contents of up to four bytes may stand in the tag itself.
fn element(bytes: &[u8]) -> Option<(u32, &[u8], &[u8])> {
    let word = |at: usize| Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
    let (first, second) = (word(0)?, word(4)?);
    if first >> 16 != 0 {
        let length = (first >> 16) as usize;
        return Some((first & 0xffff, bytes.get(4..4 + length)?, &bytes[TAG..]));
    }
    let length = second as usize;
    let padded = if first == COMPRESSED { length } else { length.div_ceil(8) * 8 };
    Some((first, bytes.get(TAG..TAG + length)?, bytes.get(TAG + padded..).unwrap_or(&[])))
}

/// Flags, extents, name, numbers.
fn read(body: &[u8], name: &str) -> Option<(usize, usize, Vec<f64>)> {
    let (_, _, rest) = element(body)?;
    let (_, extents, rest) = element(rest)?;
    let (_, found, rest) = element(rest)?;
    let (kind, numbers, _) = element(rest)?;
    if found != name.as_bytes() || kind != DOUBLE {
        return None;
    }
    let extent = |at: usize| Some(u32::from_le_bytes(extents.get(at..at + 4)?.try_into().ok()?) as usize);
    let numbers =
        numbers.chunks_exact(8).map(|it| f64::from_le_bytes([it[0], it[1], it[2], it[3], it[4], it[5], it[6], it[7]]));
    Some((extent(0)?, extent(4)?, numbers.collect()))
}
