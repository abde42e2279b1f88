//! A threshold for each pixel, with what is needed to skip dark parts of a picture without reading it.

use crate::ImagingError;

/// Columns of a tile [px].
pub(crate) const TILE_WIDTH: usize = 64;
/// Rows of a tile [px].
pub(crate) const TILE_HEIGHT: usize = 8;
/// Pixels compared at once: the width of the vector registers that every x86-64 and ARM64 machine has [px].
pub(crate) const LANES: usize = 16;

/// A threshold for each pixel. A pixel is lit when it is brighter than its threshold; 255: it can never be lit.
///
/// Also keeps the lowest threshold of each tile of 64 × 8 px. A search compares whole tile rows with that one number
/// and looks at single thresholds only where it is exceeded, so a dark picture costs one read of its own pixels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ThresholdMap {
    width: usize,
    height: usize,
    thresholds: Vec<u8>,
    /// Lowest threshold of each tile, row by row, repeated over all lanes: SSE2 takes four steps to repeat a byte.
    tile_floor: Vec<[u8; LANES]>,
    /// How many pixels of each row can be lit.
    usable: Vec<u32>,
}

impl ThresholdMap {
    /// From `width × height` thresholds, row by row [gray level].
    pub fn new(thresholds: Vec<u8>, width: usize, height: usize) -> Result<Self, ImagingError> {
        let expected = width.saturating_mul(height);
        if thresholds.len() != expected {
            return Err(ImagingError::WrongLength { what: "threshold table", expected, found: thresholds.len() });
        }
        let n_tiles = width.div_ceil(TILE_WIDTH) * height.div_ceil(TILE_HEIGHT);
        let mut map =
            Self { width, height, thresholds, tile_floor: vec![[255; LANES]; n_tiles], usable: vec![0; height] };
        for band in 0..height.div_ceil(TILE_HEIGHT) {
            map.refresh_band(band);
        }
        Ok(map)
    }

    /// The same threshold everywhere [gray level].
    pub fn uniform(threshold: u8, width: usize, height: usize) -> Self {
        Self::new(vec![threshold; width * height], width, height).unwrap_or_else(|_| unreachable!("sizes agree"))
    }

    /// All thresholds, row by row [gray level].
    pub fn thresholds(&self) -> &[u8] {
        &self.thresholds
    }

    /// (width, height) [px].
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// How many pixels of row `y` can be lit; panics below the last row.
    pub fn usable_in_row(&self, y: usize) -> u32 {
        self.usable[y]
    }

    /// Lowest thresholds of the tiles that row `y` runs through, from the left.
    pub(crate) fn tile_floors(&self, y: usize) -> &[[u8; LANES]] {
        let n = self.width.div_ceil(TILE_WIDTH);
        &self.tile_floor[y / TILE_HEIGHT * n..][..n]
    }

    /// The rows of tile row `band`.
    pub(crate) fn rows_of_band(&self, band: usize) -> std::ops::Range<usize> {
        band * TILE_HEIGHT..((band + 1) * TILE_HEIGHT).min(self.height)
    }

    /// Lets `change` rewrite the thresholds of tile row `band` and brings the rest up to date.
    pub(crate) fn change_band(&mut self, band: usize, change: impl FnOnce(&mut [u8])) {
        let rows = self.rows_of_band(band);
        change(&mut self.thresholds[rows.start * self.width..rows.end * self.width]);
        self.refresh_band(band);
    }

    /// Recomputes what is derived from the thresholds of tile row `band`.
    fn refresh_band(&mut self, band: usize) {
        let n = self.width.div_ceil(TILE_WIDTH);
        let floors = &mut self.tile_floor[band * n..(band + 1) * n];
        floors.fill([255; LANES]);
        for y in band * TILE_HEIGHT..((band + 1) * TILE_HEIGHT).min(self.height) {
            let row = &self.thresholds[y * self.width..(y + 1) * self.width];
            self.usable[y] = row.iter().map(|&it| u32::from(it < 255)).sum();
            for (floor, tile_row) in floors.iter_mut().zip(row.chunks(TILE_WIDTH)) {
                let lowest = tile_row.iter().fold(floor[0], |lowest, &it| lowest.min(it));
                *floor = [lowest; LANES];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_tile_knows_its_lowest_threshold() {
        let (width, height) = (150, 21); // tiles cut at the right and at the bottom
        let thresholds: Vec<u8> = (0..width * height).map(|i| (i * 37 % 251) as u8).collect();
        let mut map = ThresholdMap::new(thresholds, width, height).unwrap();
        map.change_band(1, |it| it.iter_mut().for_each(|it| *it = it.saturating_add(60)));
        for y in 0..height {
            for (tile, floor) in map.tile_floors(y).iter().enumerate() {
                let rows = y / 8 * 8..(y / 8 * 8 + 8).min(height);
                let lowest = rows
                    .flat_map(|y| &map.thresholds()[y * width + tile * 64..y * width + (tile * 64 + 64).min(width)])
                    .min();
                assert_eq!(Some(&floor[0]), lowest);
            }
            let usable = map.thresholds()[y * width..][..width].iter().filter(|&&it| it < 255).count();
            assert_eq!(map.usable_in_row(y) as usize, usable);
        }
    }

    #[test]
    fn empty_and_wrong_tables() {
        assert_eq!(ThresholdMap::uniform(3, 0, 5).size(), (0, 5));
        assert!(ThresholdMap::new(vec![0; 5], 2, 3).is_err());
    }
}
