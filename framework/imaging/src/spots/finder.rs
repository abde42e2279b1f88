//! The search for lit pixels: whole pictures, sampled rows, windows.
//!
//! Almost all pixels are dark, so the work is to pass over them at the speed of memory. A tile row of 64 px is compared
//! with the lowest threshold of its tile; where that is exceeded, 16 px at a time are compared with their own
//! thresholds; only a pixel brighter than its own threshold starts work of its own.

use super::component::{Component, Frame};
use super::{Found, Measure, Sampling, Spot, SpotLimits, Window};
use crate::thresholds::{LANES, TILE_WIDTH};
use crate::{ImageView, ImagingError, ThresholdMap};

/// Finds spots; keeps its buffers from picture to picture and allocates only when pictures grow.
pub struct SpotFinder {
    measure: Measure,
    component: Component,
    /// First pixel of each kept spot, for the order.
    order: Vec<((usize, usize), Spot)>,
}

impl SpotFinder {
    /// A finder that measures centres as `measure` says; [`ImagingError::Setting`] when that cannot be.
    pub fn new(measure: Measure) -> Result<Self, ImagingError> {
        measure.check()?;
        Ok(Self { measure, component: Component::default(), order: Vec::new() })
    }

    /// How centres are measured.
    pub fn measure(&self) -> &Measure {
        &self.measure
    }

    /// Fills `spots` with all spots of `image`, in scan order of their first pixels.
    ///
    /// Connected over sides and corners. [`ImagingError::WrongSize`] when `thresholds` are of another size than the
    /// picture; `spots` is empty then.
    pub fn find_full(
        &mut self,
        image: &ImageView,
        thresholds: &ThresholdMap,
        limits: &SpotLimits,
        spots: &mut Vec<Spot>,
    ) -> Result<Found, ImagingError> {
        self.find_sampled(image, thresholds, Sampling { every_rows: 1, first_row: 0 }, &[], limits, spots)
    }

    /// Fills `spots` with the spots of `image` that meet a sampled row or a window, in scan order of their first pixels.
    ///
    /// Each spot is taken whole, also beyond the window, and once. Otherwise as [`SpotFinder::find_full`].
    pub fn find_sampled(
        &mut self,
        image: &ImageView,
        thresholds: &ThresholdMap,
        sampling: Sampling,
        windows: &[Window],
        limits: &SpotLimits,
        spots: &mut Vec<Spot>,
    ) -> Result<Found, ImagingError> {
        spots.clear();
        limits.check()?;
        if thresholds.size() != image.size() {
            let (expected, found) = (image.size(), thresholds.size());
            return Err(ImagingError::WrongSize { what: "threshold table", expected, found });
        }
        self.component.begin(image.pixels().len());
        self.order.clear();
        let (width, height) = image.size();
        let frame = Frame { pixels: image.pixels(), thresholds: thresholds.thresholds(), width, height };
        let mut search = Search { finder: self, frame, limits, n_components: 0, found: Found::default() };
        for window in windows {
            search.window(window);
        }
        let every_rows = sampling.every_rows.max(1);
        for y in (sampling.first_row % every_rows..height).step_by(every_rows) {
            search.found.examined += u64::from(thresholds.usable_in_row(y));
            search.row(y, thresholds.tile_floors(y));
        }
        let found = search.found;
        self.order.sort_unstable_by_key(|it| it.0);
        spots.extend(self.order.drain(..).map(|it| it.1));
        Ok(found)
    }
}

/// One search of one picture.
struct Search<'a> {
    finder: &'a mut SpotFinder,
    frame: Frame<'a>,
    limits: &'a SpotLimits,
    n_components: usize,
    found: Found,
}

impl Search<'_> {
    /// Searches row `y`, whose tiles have at least the thresholds `tile_floors`.
    fn row(&mut self, y: usize, tile_floors: &[[u8; LANES]]) {
        let row = &self.frame.pixels[y * self.frame.width..(y + 1) * self.frame.width];
        let (tiles, _) = row.as_chunks::<TILE_WIDTH>();
        for (i, (tile, floor)) in tiles.iter().zip(tile_floors).enumerate() {
            if exceeds(tile, floor) {
                self.found.lit += self.span(y, i * TILE_WIDTH, (i + 1) * TILE_WIDTH);
            }
        }
        if tiles.len() * TILE_WIDTH < self.frame.width {
            self.found.lit += self.span(y, tiles.len() * TILE_WIDTH, self.frame.width);
        }
    }

    /// Searches every pixel of `window` that lies in the picture.
    fn window(&mut self, window: &Window) {
        let clip = |first: i32, size: u32, limit: usize| {
            let end = (i64::from(first) + i64::from(size)).clamp(0, limit as i64);
            i64::from(first).clamp(0, end) as usize..end as usize
        };
        let columns = clip(window.x, window.width, self.frame.width);
        for y in clip(window.y, window.height, self.frame.height) {
            self.span(y, columns.start, columns.end);
        }
    }

    /// Searches columns `x0..x1` of row `y`, each pixel with its own threshold; returns how many are lit.
    fn span(&mut self, y: usize, x0: usize, x1: usize) -> u64 {
        let start = y * self.frame.width;
        let (pixels, thresholds) =
            (&self.frame.pixels[start + x0..start + x1], &self.frame.thresholds[start + x0..start + x1]);
        let (pixel_blocks, pixel_rest) = pixels.as_chunks::<LANES>();
        let (threshold_blocks, threshold_rest) = thresholds.as_chunks::<LANES>();
        let mut n_lit = 0;
        for (i, (block, limits)) in pixel_blocks.iter().zip(threshold_blocks).enumerate() {
            n_lit += self.block(y, x0 + i * LANES, excess(block, limits));
        }
        if !pixel_rest.is_empty() {
            let (mut block, mut limits) = ([0; LANES], [255; LANES]);
            block[..pixel_rest.len()].copy_from_slice(pixel_rest);
            limits[..pixel_rest.len()].copy_from_slice(threshold_rest);
            n_lit += self.block(y, x0 + pixel_blocks.len() * LANES, excess(&block, &limits));
        }
        n_lit
    }

    /// Takes the groups that the lit pixels of a block belong to; `excess` has a byte for each, from column `x` on.
    fn block(&mut self, y: usize, x: usize, mut excess: u128) -> u64 {
        let mut n_lit = 0;
        while excess != 0 {
            let lane = excess.trailing_zeros() as usize / 8;
            excess &= !(0xff << (lane * 8));
            n_lit += 1;
            self.lit(x + lane, y);
        }
        n_lit
    }

    /// Takes the group of the lit pixel (x, y), unless it has been taken or there have been too many.
    fn lit(&mut self, x: usize, y: usize) {
        let component = &mut self.finder.component;
        if self.found.truncated || component.taken(y * self.frame.width + x) {
            return;
        }
        if self.n_components == self.limits.max_components {
            self.found.truncated = true;
            return;
        }
        self.n_components += 1;
        let shape = component.take(&self.frame, x, y);
        let limits = self.limits;
        let [x0, y0, x1, y1] = shape.bounds;
        let fill = shape.area as f64 / ((x1 - x0 + 1) * (y1 - y0 + 1)) as f64;
        if !(u64::from(limits.min_area)..=u64::from(limits.max_area)).contains(&shape.area)
            || shape.elongation > limits.max_elongation
            || fill < limits.min_fill
        {
            self.found.refused += 1;
        } else if self.finder.order.len() == limits.max_spots {
            self.found.truncated = true;
        } else {
            let spot = component.measure(&self.frame, &shape, &self.finder.measure);
            self.finder.order.push((shape.first, spot));
        }
    }
}

/// Whether any pixel of a tile row is brighter than `floor`.
fn exceeds(tile: &[u8; TILE_WIDTH], floor: &[u8; LANES]) -> bool {
    let mut any = [0u8; LANES];
    for block in tile.as_chunks::<LANES>().0 {
        for lane in 0..LANES {
            any[lane] |= block[lane].saturating_sub(floor[lane]);
        }
    }
    u128::from_le_bytes(any) != 0
}

/// By how much each pixel is brighter than its threshold: one byte a pixel, the first in the lowest bits.
fn excess(block: &[u8; LANES], thresholds: &[u8; LANES]) -> u128 {
    let mut excess = [0u8; LANES];
    for lane in 0..LANES {
        excess[lane] = block[lane].saturating_sub(thresholds[lane]);
    }
    u128::from_le_bytes(excess)
}
