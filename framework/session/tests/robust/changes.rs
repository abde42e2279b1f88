//! Random changes of a file, of several kinds, one after another.

use super::parts::Random;

/// `bytes` with one to four changes.
pub fn changed(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for _ in 0..1 + random.below(4) {
        let (at, n) = (random.below(bytes.len()), 1 + random.below(64));
        let end = (at + n).min(bytes.len());
        match random.below(9) {
            0 => bytes[at] ^= 1 << random.below(8),
            1 => bytes[at] = random.below(256) as u8,
            2 => bytes.truncate(at.max(1)),
            3 => drop(bytes.drain(at..end)),
            4 => bytes[at..end].fill(0),
            5 => {
                let copy = bytes[at..end].to_vec();
                let to = random.below(bytes.len());
                drop(bytes.splice(to..to, copy));
            }
            6 => bytes.extend((0..n).map(|_| random.below(256) as u8).collect::<Vec<_>>()),
            7 => {
                // A length, a place or a time that lies.
                let value = [0, 1, u64::MAX, u64::from(u32::MAX), 1 << 30, bytes.len() as u64][random.below(6)];
                let end = (at + 8).min(bytes.len());
                bytes[at..end].copy_from_slice(&value.to_le_bytes()[..end - at]);
            }
            _ => {
                // Two records change places.
                let (a, b) = (random.below(bytes.len()), random.below(bytes.len()));
                bytes.swap(a, b);
            }
        }
        if bytes.is_empty() {
            bytes.push(0x89);
        }
    }
    bytes
}
