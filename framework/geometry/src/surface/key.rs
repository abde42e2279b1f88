//! Cells of space by number, and a fast table of them.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use nalgebra::Point3;

/// Cells to either side of the origin that a number can tell.
const REACH: i32 = 1 << 20;

/// A cell as one number: 21 bits an axis. `None`: too far away.
#[inline]
pub(super) fn key(cell: [i32; 3]) -> Option<u64> {
    let is_near = cell.iter().all(|it| (-REACH..REACH).contains(it));
    let bits = |it: i32| (it + REACH) as u64;
    is_near.then(|| bits(cell[0]) << 42 | bits(cell[1]) << 21 | bits(cell[2]))
}

/// The cell that a point lies in. What is not a number lies in a cell that [`key`] refuses or that holds nothing.
#[inline]
pub(super) fn cell_of(point: &Point3<f64>, size: f64) -> [i32; 3] {
    [point.x, point.y, point.z].map(|it| (it / size).floor() as i32)
}

/// From cells to places in a list.
pub(super) type CellTable = HashMap<u64, u32, BuildHasherDefault<CellHasher>>;

/// Spreads the bits of a number.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct CellHasher(u64);

impl Hasher for CellHasher {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&it| self.write_u64(u64::from(it)));
    }

    #[inline]
    fn write_u64(&mut self, number: u64) {
        // 2⁶⁴ over the golden ratio: Knuth, *The Art of Computer Programming* 3, section 6.4.
        let spread = (self.0 ^ number).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        self.0 = spread ^ (spread >> 32);
    }
}
