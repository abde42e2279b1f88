//! The search for lit pixels: whole pictures, sampled rows, windows.
//!
//! Almost all pixels are dark, so the work is to pass over them at the speed of memory. A tile row of 64 px is compared
//! with the lowest threshold of its tile; where that is exceeded, 16 px at a time are compared with their own
//! thresholds; only a pixel brighter than its own threshold starts work of its own.

use super::component::{Component, Frame, Shape};
use super::parts::Parts;
use super::{Found, Measure, Sampling, Spot, SpotLimits, Window};
use crate::thresholds::{LANES, TILE_HEIGHT, TILE_WIDTH};
use crate::{ImageView, ImagingError, ThresholdMap};

/// Detector of LEDs and other bright spots; keeps its buffers from picture to picture and allocates only when pictures grow.
///
/// ```
/// use foveate_imaging::{ImageView, Measure, SpotFinder, SpotLimits, ThresholdMap};
///
/// // An LED at (40.3, 21.8) px, 1.5 px wide (one sigma), on a dark background of 10 gray levels.
/// let (truth, [width, height]) = ([40.3, 21.8], [96, 64]);
/// let level = |at: usize| {
///     let [dx, dy] = [(at % width) as f64 - truth[0], (at / width) as f64 - truth[1]];
///     (10.0 + 200.0 * (-(dx * dx + dy * dy) / (2.0 * 1.5 * 1.5)).exp()).round() as u8
/// };
/// let pixels: Vec<u8> = (0..width * height).map(level).collect();
/// let image = ImageView::new(&pixels, width, height)?;
///
/// // A pixel is lit when it is more than 20 gray levels above the background.
/// let thresholds = ThresholdMap::uniform(30, width, height);
/// let mut spots = Vec::new();
/// SpotFinder::new(Measure::default())?.find_full(&image, &thresholds, &SpotLimits::default(), &mut spots)?;
///
/// assert_eq!(spots.len(), 1);
/// let error_px = (spots[0].centre.x - truth[0]).hypot(spots[0].centre.y - truth[1]);
/// assert!(error_px < 0.02, "{error_px}");
/// # Ok::<(), foveate_imaging::ImagingError>(())
/// ```
pub struct SpotFinder {
    measure: Measure,
    component: Component,
    parts: Parts,
    /// First pixel of each kept spot, for the order.
    order: Vec<((usize, usize), Spot)>,
}

impl SpotFinder {
    /// A finder that measures centres as `measure` says; [`ImagingError::Setting`] when that cannot be.
    pub fn new(measure: Measure) -> Result<Self, ImagingError> {
        measure.check()?;
        Ok(Self { measure, component: Component::default(), parts: Parts::default(), order: Vec::new() })
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
        self.component.begin(image.pixels().len(), image.width());
        self.order.clear();
        let (width, height) = image.size();
        let frame = Frame { pixels: image.pixels(), thresholds: thresholds.thresholds(), width, height, raised: 0 };
        let mut search = Search { finder: self, frame, limits, n_components: 0, found: Found::default() };
        for window in windows {
            search.window(window, thresholds);
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
    fn window(&mut self, window: &Window, thresholds: &ThresholdMap) {
        let clip = |first: i32, size: u32, limit: usize| {
            let end = (i64::from(first) + i64::from(size)).clamp(0, limit as i64);
            i64::from(first).clamp(0, end) as usize..end as usize
        };
        let columns = clip(window.x, window.width, self.frame.width);
        let rows = clip(window.y, window.height, self.frame.height);
        if columns.is_empty() || rows.is_empty() {
            return;
        }
        let tiles = columns.start / TILE_WIDTH..columns.end.div_ceil(TILE_WIDTH);
        let mut floor = [0; LANES];
        for y in rows.clone() {
            if y == rows.start || y % TILE_HEIGHT == 0 {
                floor = [255; LANES];
                for tile_floor in &thresholds.tile_floors(y)[tiles.clone()] {
                    for lane in 0..LANES {
                        floor[lane] = floor[lane].min(tile_floor[lane]);
                    }
                }
            }
            let start = y * self.frame.width;
            if any_above(&self.frame.pixels[start + columns.start..start + columns.end], &floor) {
                self.span(y, columns.start, columns.end);
            }
        }
    }

    /// Searches columns `x0..x1` of row `y`, each pixel with its own threshold; returns how many are lit.
    fn span(&mut self, y: usize, x0: usize, x1: usize) -> u64 {
        let start = y * self.frame.width;
        let (pixels, thresholds) = (self.frame.pixels, self.frame.thresholds);
        let (pixels, thresholds) = (&pixels[start + x0..start + x1], &thresholds[start + x0..start + x1]);
        let mut n_lit = 0;
        let (blocks, rest) = pixels.as_chunks::<LANES>();
        for (i, (block, limits)) in blocks.iter().zip(thresholds.as_chunks::<LANES>().0).enumerate() {
            if any_lit(block, limits) {
                n_lit += self.block(y, x0 + i * LANES, lit_bits(block, limits));
            }
        }
        match pixels.last_chunk::<LANES>().zip(thresholds.last_chunk::<LANES>()) {
            _ if rest.is_empty() => {}
            Some((block, limits)) => {
                // The last 16 once more, without those that the blocks have covered.
                if any_lit(block, limits) {
                    let covered = LANES - rest.len();
                    let lit = lit_bits(block, limits) >> covered << covered;
                    n_lit += self.block(y, x1 - LANES, lit);
                }
            }
            None => {
                let (mut block, mut limits) = ([0; LANES], [255; LANES]);
                block[..rest.len()].copy_from_slice(rest);
                limits[..rest.len()].copy_from_slice(thresholds);
                n_lit += self.block(y, x0, lit_bits(&block, &limits));
            }
        }
        n_lit
    }

    /// Takes the groups that the lit pixels belong to, one bit of `lit` each from column `x` on; returns how many are lit.
    fn block(&mut self, y: usize, x: usize, lit: u16) -> u64 {
        // Most often all belong to a group that has been taken from the row above or from a window.
        let mut open = lit & !self.finder.component.taken_bits(y * self.frame.width + x);
        while open != 0 {
            let lane = open.trailing_zeros() as usize;
            open &= open - 1;
            self.lit(x + lane, y);
        }
        lit.count_ones().into()
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
        let SpotFinder { measure, component, parts, order } = &mut *self.finder;
        let limits = self.limits;
        if !limits.admit_area(shape.area) {
            self.found.refused += 1;
            return;
        }
        let spot = component.measure(&self.frame, &shape, measure);
        let apart =
            if limits.part { parts.of(&self.frame, component.last_runs(), &shape, &spot, measure) } else { &[] };
        let whole = [(shape, spot)];
        // What is too small or too long by itself, such as the bright end of a smear, says nothing against the whole.
        let spots = if apart.iter().any(|it| limits.admit(&it.0)) { apart } else { &whole };
        for (shape, spot) in spots {
            if !limits.admit(shape) {
                self.found.refused += 1;
            } else if order.len() == limits.max_spots {
                self.found.truncated = true;
            } else {
                order.push((shape.first, spot.clone()));
            }
        }
    }
}

impl SpotLimits {
    fn admit_area(&self, area: u64) -> bool {
        (u64::from(self.min_area)..=u64::from(self.max_area)).contains(&area)
    }

    fn admit(&self, shape: &Shape) -> bool {
        let [x0, y0, x1, y1] = shape.bounds;
        let fill = shape.area as f64 / ((x1 - x0 + 1) * (y1 - y0 + 1)) as f64;
        self.admit_area(shape.area) && shape.elongation <= self.max_elongation && fill >= self.min_fill
    }
}

/// Whether any pixel of a tile row is brighter than `floor`.
///
/// Written lane by lane, and with `|=` over flags: in this form the compiler makes four loads, three maxima, one
/// comparison and one test of it. A fold over the chunks takes ten times as long.
fn exceeds(tile: &[u8; TILE_WIDTH], floor: &[u8; LANES]) -> bool {
    let mut top = [0u8; LANES];
    for lane in 0..LANES {
        top[lane] = tile[lane].max(tile[lane + 16]).max(tile[lane + 32].max(tile[lane + 48]));
    }
    any_lit(&top, floor)
}

/// Whether any of `pixels` is brighter than `floor`, which is the same in all lanes.
fn any_above(pixels: &[u8], floor: &[u8; LANES]) -> bool {
    let Some(last) = pixels.last_chunk::<LANES>() else { return pixels.iter().any(|&it| it > floor[0]) };
    let mut top = *last;
    for block in pixels.as_chunks::<LANES>().0 {
        for lane in 0..LANES {
            top[lane] = top[lane].max(block[lane]);
        }
    }
    any_lit(&top, floor)
}

/// Whether any pixel is brighter than its threshold.
fn any_lit(block: &[u8; LANES], thresholds: &[u8; LANES]) -> bool {
    let mut any = false;
    for lane in 0..LANES {
        any |= block[lane] > thresholds[lane];
    }
    any
}

/// One bit for each pixel brighter than its threshold, the lowest for the first.
fn lit_bits(block: &[u8; LANES], thresholds: &[u8; LANES]) -> u16 {
    let mut flags = [0u8; LANES];
    for lane in 0..LANES {
        flags[lane] = u8::from(block[lane] > thresholds[lane]);
    }
    // 8i + 7k is different for all i < 8 and 1 <= k <= 8, so nothing carries, and byte i arrives at bit 56 + i (k = 8 - i).
    let gather = |bytes: u64| bytes.wrapping_mul(0x0102_0408_1020_4080) >> 56;
    let flags = u128::from_le_bytes(flags);
    (gather(flags as u64) | gather((flags >> 64) as u64) << 8) as u16
}
