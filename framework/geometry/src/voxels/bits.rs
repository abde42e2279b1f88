//! A grid of bits, one for each voxel.

/// A set of voxels of a grid.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct BitGrid {
    cells: [u32; 3],
    /// Words along x.
    words: usize,
    bits: Vec<u64>,
}

impl BitGrid {
    /// An empty set in a grid of so many cells along x, y, z.
    pub fn new(cells: [u32; 3]) -> BitGrid {
        let mut grid = BitGrid::default();
        grid.reset(cells);
        grid
    }

    /// Nothing set; keeps its memory.
    pub(super) fn reset(&mut self, cells: [u32; 3]) {
        self.cells = cells;
        self.words = (cells[0] as usize).div_ceil(64);
        self.bits.clear();
        self.bits.resize(self.words * cells[1] as usize * cells[2] as usize, 0);
    }

    /// Number of cells along x, y, z.
    pub fn cells(&self) -> [u32; 3] {
        self.cells
    }

    /// Whether a cell is set; `false` outside the grid.
    pub fn get(&self, [x, y, z]: [u32; 3]) -> bool {
        let inside = x < self.cells[0] && y < self.cells[1] && z < self.cells[2];
        inside && self.row(y, z)[x as usize / 64] >> (x % 64) & 1 != 0
    }

    /// Sets a cell.
    ///
    /// # Panics
    /// When the cell lies outside the grid.
    pub fn set(&mut self, [x, y, z]: [u32; 3]) {
        assert!(x < self.cells[0], "cell {x} of {} along x", self.cells[0]);
        self.set_in_row(y, z, x as usize / 64, 1 << (x % 64));
    }

    /// Sets the bits of `mask` in word `word` of a row, as far as the row has them.
    #[inline]
    pub(super) fn set_in_row(&mut self, y: u32, z: u32, word: usize, mask: u64) {
        let left = self.cells[0] as usize - 64 * word;
        let mask = if left < 64 { mask & ((1 << left) - 1) } else { mask };
        let at = self.start(y, z) + word;
        self.bits[at] |= mask;
    }

    fn start(&self, y: u32, z: u32) -> usize {
        (z as usize * self.cells[1] as usize + y as usize) * self.words
    }

    /// The words of a row; bits beyond its last cell are 0.
    pub(super) fn row(&self, y: u32, z: u32) -> &[u64] {
        &self.bits[self.start(y, z)..][..self.words]
    }

    /// Number of set cells.
    pub fn count(&self) -> usize {
        self.bits.iter().map(|it| it.count_ones() as usize).sum()
    }

    /// The place of a cell in the order of [`Self::iter`] if all were set.
    pub(super) fn place(&self, [x, y, z]: [u32; 3]) -> usize {
        (z as usize * self.cells[1] as usize + y as usize) * self.cells[0] as usize + x as usize
    }

    /// All set cells, ascending by z, then y, then x.
    pub fn iter(&self) -> impl Iterator<Item = [u32; 3]> + '_ {
        let rows = (0..self.cells[2]).flat_map(|z| (0..self.cells[1]).map(move |y| (y, z)));
        rows.flat_map(move |(y, z)| {
            let words = self.row(y, z).iter().zip(0u32..).filter(|(word, _)| **word != 0);
            words.flat_map(move |(&word, at)| ones(word).map(move |bit| [64 * at + bit, y, z]))
        })
    }

    /// The set cells in runs along z of at least `least` set cells.
    pub(super) fn upright(&self, least: u32) -> BitGrid {
        let [_, n_rows, n_layers] = self.cells;
        let layer = self.words * n_rows as usize;
        let mut upright = BitGrid { cells: self.cells, words: self.words, bits: vec![0; self.bits.len()] };
        let least = (least as usize).max(1);
        let mut all = vec![0; layer];
        for first in 0..(n_layers as usize + 1).saturating_sub(least) {
            all.fill(u64::MAX);
            let layers = first * layer..(first + least) * layer;
            for bits in self.bits[layers.clone()].chunks_exact(layer) {
                all.iter_mut().zip(bits).for_each(|(all, bits)| *all &= bits);
            }
            for bits in upright.bits[layers].chunks_exact_mut(layer) {
                bits.iter_mut().zip(&all).for_each(|(bits, all)| *bits |= all);
            }
        }
        upright
    }

    /// The set cells with a face neighbour that is not set, or outside the grid.
    pub fn surface(&self) -> BitGrid {
        let mut surface = BitGrid { cells: self.cells, words: self.words, bits: vec![0; self.bits.len()] };
        let nothing = vec![0; self.words];
        let [_, n_rows, n_layers] = self.cells;
        for z in 0..n_layers {
            for y in 0..n_rows {
                let row = self.row(y, z);
                if row.iter().all(|it| *it == 0) {
                    continue;
                }
                let beside = |y: Option<u32>, z: Option<u32>| match (y, z) {
                    (Some(y), Some(z)) if y < n_rows && z < n_layers => self.row(y, z),
                    _ => &nothing[..],
                };
                let around = [
                    beside(y.checked_sub(1), Some(z)),
                    beside(Some(y + 1), Some(z)),
                    beside(Some(y), z.checked_sub(1)),
                    beside(Some(y), Some(z + 1)),
                ];
                let start = self.start(y, z);
                for at in 0..self.words {
                    let before = if at > 0 { row[at - 1] >> 63 } else { 0 };
                    let after = if at + 1 < self.words { row[at + 1] << 63 } else { 0 };
                    let mut inner = (row[at] << 1 | before) & (row[at] >> 1 | after);
                    around.iter().for_each(|it| inner &= it[at]);
                    surface.bits[start + at] = row[at] & !inner;
                }
            }
        }
        surface
    }
}

/// The places of the bits that are set, ascending.
pub(super) fn ones(mut word: u64) -> impl Iterator<Item = u32> {
    std::iter::from_fn(move || {
        let at = word.trailing_zeros();
        (word != 0).then(|| {
            word &= word - 1;
            at
        })
    })
}
