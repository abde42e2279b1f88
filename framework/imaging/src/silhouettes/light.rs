//! The light of a picture over the learnt one: of the whole, and of tiles whose texture is that of the background.

use super::model::{CHANNELS, Model};
use crate::foreground::light::Light;

/// Gains by channel.
pub(super) type Gains = [f32; CHANNELS];

/// Pixels that the gain of the whole is taken from, about.
const SAMPLES: usize = 1024;
/// A sample follows the gain of the whole where it is off by less than this part of it [–].
const NEAR: f32 = 0.1;
/// Edge of a tile [px].
pub(super) const TILE: usize = 64;
/// Pixels of a tile that are looked at: one in so many along both axes.
const TILE_STEP: usize = 5;
/// Part of the samples that may differ by more than a quarter after the gain of the whole.
const MAY_DIFFER: f32 = 0.12;
/// Standard deviation of a texture that can be recognised: with noise of two gray levels it correlates to 0.9 [gray level].
const TEXTURE: f32 = 4.0;
/// Correlation from which on it is.
const CORRELATION: f32 = 0.9;
/// A sample so near to what a light makes of the background is explained by it: a part of that, and no less than that of this gray level.
const EXPLAINED: f32 = 0.12;
const DARK: f32 = 32.0;
/// The share of a tile's samples that its own light explains, at least, and that of the whole picture does not.
const OWN: f32 = 0.75;
const NEEDED: f32 = 0.4;

/// The light of the last picture.
#[derive(Debug, Clone)]
pub(super) struct Lights {
    columns: usize,
    rows: usize,
    whole: Gains,
    /// By tile.
    tiles: Vec<Gains>,
    /// Whether its light is known, and whether it is its own.
    known: Vec<bool>,
    n_found: usize,
    finder: Light,
}

impl Lights {
    pub fn new(width: usize, height: usize) -> Lights {
        let (columns, rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
        Lights {
            columns,
            rows,
            whole: [1.0; CHANNELS],
            tiles: vec![[1.0; CHANNELS]; columns * rows],
            known: vec![false; columns * rows],
            n_found: 0,
            finder: Light::default(),
        }
    }

    /// The gain of the whole picture, channel by channel.
    pub fn whole(&self) -> Gains {
        self.whole
    }

    /// How many tiles have a gain of their own.
    pub fn n_regional(&self) -> usize {
        self.n_found
    }

    /// Back to the learnt light.
    pub fn reset(&mut self) {
        self.whole = [1.0; CHANNELS];
        self.tiles.fill([1.0; CHANNELS]);
        self.known.fill(false);
        self.n_found = 0;
    }

    /// Looks at a picture; `open` is 0 where it is masked.
    pub fn look(&mut self, pixels: &[u8], open: &[u8], model: &Model) {
        let n = model.width * model.height;
        let step = (n / SAMPLES) | 1;
        let places = || (0..n).step_by(step).filter(move |&i| open[i] != 0);
        let is_told = |i: &usize| !pixels[i * CHANNELS..(i + 1) * CHANNELS].contains(&255);
        let sums = |i: usize| {
            let of = i * CHANNELS..(i + 1) * CHANNELS;
            let pixel: f32 = pixels[of.clone()].iter().map(|it| f32::from(*it)).sum();
            (pixel / CHANNELS as f32, model.mean[of].iter().sum::<f32>() / CHANNELS as f32)
        };
        // All channels from the same pixels: where each half of the picture has a light, each channel would follow another half.
        if let Some(gain) = self.finder.ratio(places().filter(is_told).map(sums)) {
            let is_near = |i: &usize| {
                let (pixel, mean) = sums(*i);
                (pixel - gain * mean).abs() < NEAR * gain * mean
            };
            let near: Vec<usize> = places().filter(is_told).filter(is_near).collect();
            for (channel, whole) in self.whole.iter_mut().enumerate() {
                // The ratio on which they agree, not their mean: a body may be as bright as its background in another colour.
                let of = |i: &usize| (f32::from(pixels[i * CHANNELS + channel]), model.mean[i * CHANNELS + channel]);
                let gain = self.finder.ratio(near.iter().map(of)).unwrap_or(gain);
                // Closer to 1 than half a gray level in 255 is no change of light.
                *whole = if (gain - 1.0).abs() < 0.004 { 1.0 } else { gain };
            }
        }
        let (mut n_seen, mut n_off) = (0u32, 0u32);
        for i in places() {
            let at = i * CHANNELS + 1;
            let (pixel, mean) = (f32::from(pixels[at]), (self.whole[1] * model.mean[at]).min(255.0));
            n_seen += 1;
            n_off += u32::from((pixel - mean).abs() > 0.25 * mean.max(16.0));
        }
        self.known.fill(false);
        self.n_found = 0;
        if n_off as f32 > MAY_DIFFER * n_seen as f32 {
            for row in 0..self.rows {
                for column in 0..self.columns {
                    let tile = row * self.columns + column;
                    let light = tile_light(column, row, pixels, open, model, &self.whole);
                    self.known[tile] = light != TileLight::Unknown;
                    self.tiles[tile] = self.whole;
                    if let TileLight::Own(gains) = light {
                        self.tiles[tile] = gains;
                        self.n_found += 1;
                    }
                }
            }
            self.spread();
        } else {
            self.tiles.fill(self.whole);
        }
    }

    /// Tiles whose light is not known take the mean of those next to them whose light is.
    fn spread(&mut self) {
        for row in 0..self.rows {
            for column in 0..self.columns {
                if self.known[row * self.columns + column] {
                    continue;
                }
                let (mut n, mut sum) = (0.0, [0.0; CHANNELS]);
                for y in row.saturating_sub(1)..(row + 2).min(self.rows) {
                    for x in column.saturating_sub(1)..(column + 2).min(self.columns) {
                        if self.known[y * self.columns + x] {
                            n += 1.0;
                            sum.iter_mut().zip(self.tiles[y * self.columns + x]).for_each(|(sum, it)| *sum += it);
                        }
                    }
                }
                if n > 0.0 {
                    self.tiles[row * self.columns + column] = sum.map(|it| it / n);
                }
            }
        }
    }

    /// Whether all of the picture is in the learnt light.
    pub fn is_learnt(&self) -> bool {
        self.tiles.iter().flatten().all(|it| *it == 1.0)
    }

    /// The gains at a pixel: between the middles of tiles, linear along both axes.
    pub fn at(&self, x: usize, y: usize) -> Gains {
        if self.n_found == 0 {
            return self.whole;
        }
        let place = |at: usize, n: usize| {
            let at = ((at as f32 + 0.5) / TILE as f32 - 0.5).clamp(0.0, (n - 1) as f32);
            let first = at as usize;
            (first, (first + 1).min(n - 1), at - first as f32)
        };
        let ((x0, x1, a), (y0, y1, b)) = (place(x, self.columns), place(y, self.rows));
        let tile = |x: usize, y: usize| self.tiles[y * self.columns + x];
        let (upper, lower) = ((tile(x0, y0), tile(x1, y0)), (tile(x0, y1), tile(x1, y1)));
        std::array::from_fn(|c| {
            let across = |(left, right): (Gains, Gains)| left[c] + a * (right[c] - left[c]);
            across(upper) + b * (across(lower) - across(upper))
        })
    }
}

/// What is known of the light on a tile.
#[derive(Debug, Clone, Copy, PartialEq)]
enum TileLight {
    Unknown,
    Whole,
    Own(Gains),
}

/// A tile has a light of its own if its texture is that of the background, if the whole's does not explain it and its own does: a limb before a floor brightens its tile, too.
fn tile_light(column: usize, row: usize, pixels: &[u8], open: &[u8], model: &Model, whole: &Gains) -> TileLight {
    let places = || {
        let rows = (row * TILE..((row + 1) * TILE).min(model.height)).step_by(TILE_STEP);
        let columns = (column * TILE..((column + 1) * TILE).min(model.width)).step_by(TILE_STEP);
        let all = rows.flat_map(move |y| columns.clone().map(move |x| y * model.width + x));
        all.filter(|&i| open[i] != 0 && !pixels[i * CHANNELS..(i + 1) * CHANNELS].contains(&255))
    };
    let share = |gains: &Gains| {
        let (mut n, mut n_near) = (0.0f32, 0.0);
        for i in places() {
            let is_near = (0..CHANNELS).all(|c| {
                let lit = gains[c] * model.mean[i * CHANNELS + c];
                (f32::from(pixels[i * CHANNELS + c]) - lit).abs() < EXPLAINED * lit.max(DARK)
            });
            n += 1.0;
            n_near += f32::from(u8::from(is_near));
        }
        if n > 0.0 { n_near / n } else { 0.0 }
    };
    if share(whole) > 1.0 - NEEDED {
        return TileLight::Whole;
    }
    match tile_gains(places(), pixels, model) {
        Some(gains) if share(&gains) > OWN => TileLight::Own(gains),
        _ => TileLight::Unknown,
    }
}

/// The gains of a tile, if its texture is that of the background.
fn tile_gains(places: impl Iterator<Item = usize>, pixels: &[u8], model: &Model) -> Option<Gains> {
    let (mut n, mut sums) = (0.0f32, [0.0f32; 5]);
    let mut by_channel = [[0.0f32; 2]; CHANNELS];
    for i in places {
        let at = i * CHANNELS;
        let pixel: f32 = pixels[at..at + CHANNELS].iter().map(|it| f32::from(*it)).sum();
        let mean: f32 = model.mean[at..at + CHANNELS].iter().sum();
        n += 1.0;
        for (sum, it) in sums.iter_mut().zip([pixel, mean, pixel * pixel, pixel * mean, mean * mean]) {
            *sum += it;
        }
        for (channel, sum) in by_channel.iter_mut().enumerate() {
            sum[0] += f32::from(pixels[at + channel]) * model.mean[at + channel];
            sum[1] += model.mean[at + channel] * model.mean[at + channel];
        }
    }
    if n < 30.0 {
        return None;
    }
    let [pixel, mean, pixels, product, means] = sums.map(|it| it / n);
    let (a, b, both) = (pixels - pixel * pixel, means - mean * mean, product - pixel * mean);
    let channels = CHANNELS as f32;
    let is_textured = a.min(b) > (channels * TEXTURE).powi(2);
    let gains = by_channel.map(|[product, square]| if square > 0.0 { product / square } else { 1.0 });
    let is_credible = gains.iter().all(|it| (0.2..5.0).contains(it));
    (is_textured && both > CORRELATION * (a * b).sqrt() && is_credible).then_some(gains)
}
