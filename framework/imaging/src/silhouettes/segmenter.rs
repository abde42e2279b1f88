//! Splits the pictures of one camera: the order of the steps.

use std::ops::Range;

use super::light::{Gains, Lights};
use super::model::{BLOCK, CHANNELS, Model, Quick, distances};
use super::texture::Texture;
use super::{BODY, SURE};
use crate::foreground::learning::Learning;
use crate::foreground::majority::Majority;
use crate::{ImagingError, Verdict};

/// Settings of [`Segmenter`].
#[derive(Debug, Clone, PartialEq)]
pub struct SegmenterConfig {
    /// Pictures that the background is learnt from, at least 1.
    pub learn_frames: u32,
    /// The part of the background that lies within the limits, 0.5 to below 1.
    pub detection_rate: f32,
    /// The part of its light that a shadow leaves, at least, 0..=1; 1: what is darker is body.
    pub shadow_ratio: f32,
    /// How much brighter a highlight may be, at least 1; 1: what is brighter is body.
    pub highlight_ratio: f32,
    /// Whether a shadow must preserve the texture of its background over windows of 6 px; otherwise each pixel is judged alone. For cameras and lenses that have moved by no part of a pixel since learning.
    pub by_texture: bool,
    /// No standard deviation is taken to be lower than this [gray level], above 0.
    pub noise_floor: f32,
    /// How far an edge of the background may have moved, one standard deviation [px], at least 0.
    pub jitter_px: f32,
    /// Pictures in which the background follows a slow change by 63 %, at least 1.
    pub adapt_frames: f32,
    /// Pictures after which what stands still is background; 0: never.
    pub absorb_frames: u32,
    /// A picture with a larger part of its unmasked pixels body is not to be trusted, 0..=1; `learn_frames` of them, and the background is learnt again.
    pub relearn_fraction: f64,
}

impl Default for SegmenterConfig {
    /// 30 pictures, 99.99 % of the background, shadows from 45 % of the light on, highlights up to 150 %, both by single pixels, a floor of 2 gray levels, a quarter of a pixel, 200 pictures to adapt,
    /// nothing absorbed, learnt again when more than 60 % is body.
    fn default() -> Self {
        Self {
            learn_frames: 30,
            detection_rate: 0.9999,
            shadow_ratio: 0.45,
            highlight_ratio: 1.5,
            by_texture: false,
            noise_floor: 2.0,
            jitter_px: 0.25,
            adapt_frames: 200.0,
            absorb_frames: 0,
            relearn_fraction: 0.6,
        }
    }
}

impl SegmenterConfig {
    /// [`ImagingError::Setting`] that names the first setting out of its range.
    pub fn check(&self) -> Result<(), ImagingError> {
        let unless = |good, name, expected, found: f32| ImagingError::unless(good, name, expected, found.into());
        ImagingError::unless(self.learn_frames >= 1, "learn_frames", "at least 1", self.learn_frames.into())?;
        unless(
            (0.5..0.999_999).contains(&self.detection_rate),
            "detection_rate",
            "0.5 to 0.999999",
            self.detection_rate,
        )?;
        unless((0.0..=1.0).contains(&self.shadow_ratio), "shadow_ratio", "0 to 1", self.shadow_ratio)?;
        unless((1.0..=10.0).contains(&self.highlight_ratio), "highlight_ratio", "1 to 10", self.highlight_ratio)?;
        let positive = self.noise_floor > 0.0 && self.noise_floor.is_finite();
        unless(positive, "noise_floor", "above 0 gray levels", self.noise_floor)?;
        unless((0.0..=10.0).contains(&self.jitter_px), "jitter_px", "0 to 10 px", self.jitter_px)?;
        unless(self.adapt_frames >= 1.0, "adapt_frames", "at least 1", self.adapt_frames)?;
        let share = self.relearn_fraction;
        ImagingError::unless((0.0..=1.0).contains(&share), "relearn_fraction", "0 to 1", share)
    }
}

/// Background model of one camera, and the silhouettes in its last picture.
#[derive(Debug, Clone)]
pub struct Segmenter {
    config: SegmenterConfig,
    model: Model,
    /// `None`: learnt.
    learning: Option<Learning>,
    /// 255: may be body; 0: masked.
    open: Vec<u8>,
    n_open: usize,
    lights: Lights,
    texture: Texture,
    /// How pictures of the empty scene fitted the backgrounds that were set for them.
    rehearsed: Vec<[f32; 2]>,
    /// How far their edges were off [px].
    edges_rehearsed: Vec<f32>,
    confidence: Vec<u8>,
    raw: Vec<u8>,
    mask: Vec<u8>,
    majority: Majority,
    /// By pixel: the colour that it keeps while it is body, and for how many pictures.
    stays: Vec<Stay>,
    held: Vec<[u32; 4]>,
    /// One row of a picture in the learnt light, and what the quick test says of it.
    row: Vec<u8>,
    quick: Quick,
    /// One row in the learnt light, and by how much the background follows each of its bytes.
    relit: Vec<f32>,
    shares: Vec<f32>,
    n_pictures: u32,
    n_flooded: u32,
    /// Pixels on edges of the background, by quarter of the picture.
    edges: [Vec<u32>; 4],
    edges_off: f64,
}

#[derive(Debug, Clone, Copy, Default)]
struct Stay {
    value: [u8; CHANNELS],
    n: u32,
}

/// So many rehearsals, at least, tell how well pictures fit.
const REHEARSALS: usize = 4;
/// Edges that are further off tell nothing of a tremble [px].
const MOST_JITTER: f32 = 2.0;
/// One row in so many follows the background at a picture.
const BANDS: usize = 16;
/// Below this confidence (f = 0.58) a pixel is no shadow either, and the background follows it.
const PLAIN: u8 = 64;
/// Pixels on edges that are looked at to see whether the camera was moved, in each quarter of the picture.
const EDGES: usize = 256;
/// Difference over two pixels that makes an edge [gray level].
const EDGE: f32 = 24.0;

impl Segmenter {
    /// A model for pictures of this size [px], about to learn; nothing is masked.
    ///
    /// # Errors
    /// A setting out of its range.
    pub fn new(config: SegmenterConfig, width: usize, height: usize) -> Result<Self, ImagingError> {
        config.check()?;
        let n = width * height;
        Ok(Self {
            learning: Some(Learning::new(config.learn_frames, n * CHANNELS)),
            model: Model::new(width, height),
            open: vec![255; n],
            n_open: n,
            lights: Lights::new(width, height),
            texture: Texture::new(width, height),
            rehearsed: Vec::new(),
            edges_rehearsed: Vec::new(),
            confidence: vec![0; n],
            raw: vec![0; n],
            mask: vec![0; n],
            majority: Majority::default(),
            stays: if config.absorb_frames > 0 { vec![Stay::default(); n] } else { Vec::new() },
            held: Vec::new(),
            row: vec![0; width * CHANNELS],
            quick: Quick::default(),
            relit: Vec::new(),
            shares: Vec::new(),
            n_pictures: 0,
            n_flooded: 0,
            edges: Default::default(),
            edges_off: 0.0,
            config,
        })
    }

    /// Masked pixels (`width × height`, row by row) are never body.
    ///
    /// # Errors
    /// Another number of pixels.
    pub fn set_mask(&mut self, masked: &[bool]) -> Result<(), ImagingError> {
        let (expected, found) = (self.open.len(), masked.len());
        if found != expected {
            return Err(ImagingError::WrongLength { what: "mask", expected, found });
        }
        for (open, &masked) in self.open.iter_mut().zip(masked) {
            *open = if masked { 0 } else { 255 };
        }
        self.n_open = masked.iter().filter(|it| !**it).count();
        Ok(())
    }

    /// Begins with one picture of the empty scene instead of learning.
    ///
    /// # Errors
    /// A picture of another size.
    pub fn set_background(&mut self, rgb: &[u8]) -> Result<(), ImagingError> {
        self.fits(rgb)?;
        let jitter_px = self.config.jitter_px.max(self.edges_jitter());
        self.model.take(rgb, &SegmenterConfig { jitter_px, ..self.config.clone() });
        if self.rehearsed.len() < REHEARSALS {
            self.texture.reset();
        } else {
            self.texture.take(&self.rehearsed, 1.0);
        }
        self.learnt();
        Ok(())
    }

    /// Learns from a picture of the empty scene how well a rendered background fits real pictures: how far edges are displaced, and how well texture fits. From then on the same misfit is expected of all
    /// backgrounds that are set.
    ///
    /// # Errors
    /// A picture of another size.
    pub fn rehearse(&mut self, rgb: &[u8]) -> Result<(), ImagingError> {
        self.fits(rgb)?;
        if !self.has_learnt() {
            return Ok(());
        }
        let Self { lights, texture, model, open, .. } = self;
        lights.look(rgb, open, model);
        let gains = lights.whole();
        self.edges_rehearsed.extend(model.edges_off(rgb, gains, open));
        if self.config.by_texture {
            // What is masked fits.
            let mut shown = rgb.to_vec();
            for (at, (level, mean)) in shown.iter_mut().zip(&model.mean).enumerate() {
                if open[at / CHANNELS] == 0 {
                    *level = (mean * gains[at % CHANNELS]) as u8;
                }
            }
            self.rehearsed.push(texture.fits_of(&shown, model, |x, y| lights.at(x, y), self.config.detection_rate));
        }
        Ok(())
    }

    /// How far edges were off in nine of ten rehearsals [px].
    fn edges_jitter(&self) -> f32 {
        let mut off = self.edges_rehearsed.clone();
        off.sort_by(f32::total_cmp);
        off.get(off.len() * 9 / 10).map_or(0.0, |it| it.min(MOST_JITTER))
    }

    /// Sets, from the next background on, the least standard deviation of a pixel [gray level] and that of the place of an edge [px].
    ///
    /// # Errors
    /// One of them out of its range, which leaves both as they were.
    pub fn set_tolerance(&mut self, noise_floor: f32, jitter_px: f32) -> Result<(), ImagingError> {
        let config = SegmenterConfig { noise_floor, jitter_px, ..self.config.clone() };
        config.check()?;
        self.config = config;
        Ok(())
    }

    /// Learns from a picture of the empty scene. After the first picture that was split it changes nothing.
    ///
    /// # Errors
    /// A picture of another size.
    pub fn teach(&mut self, rgb: &[u8]) -> Result<(), ImagingError> {
        self.fits(rgb)?;
        if let Some(learning) = &mut self.learning
            && learning.add(rgb)
        {
            learning.level(CHANNELS);
            self.model.learn(learning, &self.config);
            self.texture.learn(learning.samples(), &self.model, self.config.detection_rate);
            self.learnt();
        }
        Ok(())
    }

    /// Ends learning with the pictures of the empty scene so far. `false`: there was none, and learning goes on.
    pub fn end_teaching(&mut self) -> bool {
        if self.learning.as_mut().is_some_and(Learning::end)
            && let Some(mut learning) = self.learning.take()
        {
            learning.level(CHANNELS);
            self.model.learn(&learning, &self.config);
            self.texture.learn(learning.samples(), &self.model, self.config.detection_rate);
            self.learnt();
        }
        self.learning.is_none()
    }

    fn learnt(&mut self) {
        self.learning = None;
        self.lights.reset();
        let Model { width, height, .. } = self.model;
        self.edges = Default::default();
        let step = (width * height / (16 * EDGES)) | 1;
        for i in (0..width * height).step_by(step) {
            let (x, y) = (i % width, i / width);
            if x == 0 || y == 0 || x + 1 == width || y + 1 == height || self.open[i] == 0 {
                continue;
            }
            let green = |pixel: usize| self.model.mean[pixel * CHANNELS + 1];
            let slope = (green(i + 1) - green(i - 1)).abs().max((green(i + width) - green(i - width)).abs());
            let quarter = &mut self.edges[usize::from(x >= width / 2) + 2 * usize::from(y >= height / 2)];
            if slope > EDGE && quarter.len() < EDGES {
                quarter.push(i as u32);
            }
        }
    }

    /// Whether the background is known.
    pub fn has_learnt(&self) -> bool {
        self.learning.is_none()
    }

    /// Boxes [x0, y0, x1, y1] in which nothing is absorbed however long it stands: where a person is known to be [px].
    pub fn hold(&mut self, boxes: impl IntoIterator<Item = [u32; 4]>) {
        self.held.clear();
        self.held.extend(boxes);
    }

    /// Confidence of each pixel of the last picture, row by row: body from [`BODY`] on, 255 at most; specks and pinholes are removed.
    pub fn confidence(&self) -> &[u8] {
        &self.confidence
    }

    /// The mask of the last picture, row by row: 0 background, 1 body, 2 surely body.
    pub fn mask(&self) -> &[u8] {
        &self.mask
    }

    /// Columns and rows [px].
    pub fn size(&self) -> (usize, usize) {
        (self.model.width, self.model.height)
    }

    /// Light of the last picture over that of the learnt scene, by channel.
    pub fn gains(&self) -> [f32; 3] {
        self.lights.whole()
    }

    /// Tiles of the last picture that have a light of their own.
    pub fn n_regional(&self) -> usize {
        self.lights.n_regional()
    }

    /// Limits of chromaticity and of brightness [σ].
    pub fn limits(&self) -> [f32; 2] {
        self.model.limits
    }

    /// Part of the background's edges displaced in the last picture, by more than shadows and video coding explain: that of the quarter of the picture where it is least, among quarters with
    /// enough edges. Near 1 when the camera was moved.
    pub fn edges_off(&self) -> f64 {
        self.edges_off
    }

    /// By what single pixels say: texture beside a body is off for less.
    fn look_at_edges(&self) -> f64 {
        let of = |places: &Vec<u32>| {
            let n_off = places.iter().filter(|at| self.confidence[**at as usize] >= BODY / 8).count();
            (places.len() >= 16).then_some(n_off as f64 / places.len() as f64)
        };
        let quarters: Vec<f64> = self.edges.iter().filter_map(of).collect();
        if quarters.len() < 2 { 0.0 } else { quarters.into_iter().fold(1.0, f64::min) }
    }

    /// Segments a picture into body and background, and learns from it.
    ///
    /// [`Verdict::Learning`]: there is no body yet. [`Verdict::Flooded`]: more than `relearn_fraction` of the picture is body, so the mask is
    /// unreliable.
    ///
    /// # Errors
    /// A picture of another size, which leaves everything as it was.
    pub fn update(&mut self, rgb: &[u8]) -> Result<Verdict, ImagingError> {
        self.fits(rgb)?;
        if self.learning.is_some() {
            self.mask.fill(0);
            self.confidence.fill(0);
            self.teach(rgb)?;
            return Ok(Verdict::Learning);
        }
        self.n_pictures = self.n_pictures.wrapping_add(1);
        self.lights.look(rgb, &self.open, &self.model);
        self.split(rgb);
        self.edges_off = self.look_at_edges();
        if self.config.by_texture {
            self.split_by_texture(rgb);
        }
        let Model { width, height, .. } = self.model;
        let lit = self.majority.filter(&self.raw, &self.open, width, height, &mut self.mask);
        settle(&self.mask, &mut self.confidence);
        self.follow(rgb);
        if lit as f64 <= self.config.relearn_fraction * self.n_open as f64 {
            self.n_flooded = 0;
            return Ok(Verdict::Trusted);
        }
        self.n_flooded += 1;
        if self.n_flooded >= self.config.learn_frames {
            self.n_flooded = 0;
            self.learning = Some(Learning::new(self.config.learn_frames, rgb.len()));
        }
        Ok(Verdict::Flooded)
    }

    fn fits(&self, rgb: &[u8]) -> Result<(), ImagingError> {
        let (expected, found) = (self.open.len() * CHANNELS, rgb.len());
        if expected == found { Ok(()) } else { Err(ImagingError::WrongLength { what: "RGB picture", expected, found }) }
    }

    /// The confidence of each pixel.
    fn split(&mut self, rgb: &[u8]) {
        let Model { width, height, .. } = self.model;
        let is_learnt = self.lights.is_learnt();
        self.texture.begin();
        for y in 0..height {
            let bytes = y * width * CHANNELS..(y + 1) * width * CHANNELS;
            let row = &rgb[bytes.clone()];
            if !is_learnt {
                self.relight(row, y);
            }
            let seen = if is_learnt { row } else { &self.row[..] };
            self.model.examine(seen, y, &mut self.quick);
            self.confidence[y * width..(y + 1) * width].fill(0);
            self.raw[y * width..(y + 1) * width].fill(0);
            for block in 0..self.quick.doubtful.len() {
                if self.quick.doubtful[block] {
                    let first = block * BLOCK;
                    let n = BLOCK.min(width - first);
                    let gains = if is_learnt { [1.0; CHANNELS] } else { self.lights.at(first + n / 2, y) };
                    let pixels = y * width + first..y * width + first + n;
                    let n_off = self.decide(rgb, pixels.clone(), gains, u8::MAX);
                    // Where a light of one region ends is not known to the pixel: what that of the whole explains is background, too.
                    if self.lights.n_regional() > 0 {
                        self.decide(rgb, pixels.clone(), self.lights.whole(), 0);
                    }
                    let n_body = self.raw[pixels].iter().filter(|it| **it != 0).count();
                    self.texture.doubt(first, y, n_off, n_body as u16);
                }
            }
        }
    }

    /// What has another texture or colour than the background in any light is body.
    fn split_by_texture(&mut self, rgb: &[u8]) {
        let Self { texture, model, lights, confidence, raw, open, .. } = self;
        let width = model.width;
        texture.look(
            rgb,
            model,
            |x, y| lights.at(x, y),
            |y, columns, square| {
                let seen = (255.0 * square / (1.0 + square) + 0.5) as u8;
                for pixel in y * width + columns.start..y * width + columns.end {
                    let it = confidence[pixel].max(seen & open[pixel]);
                    confidence[pixel] = it;
                    raw[pixel] = u8::from(it >= BODY) + u8::from(it >= SURE);
                }
            },
        );
    }

    /// A row in the learnt light, rounded.
    fn relight(&mut self, row: &[u8], y: usize) {
        const BYTES: usize = BLOCK * CHANNELS;
        let n_bytes = self.row.len();
        for first in (0..n_bytes).step_by(BYTES) {
            let end = (first + BYTES).min(n_bytes);
            let gains = self.lights.at((first + end) / (2 * CHANNELS), y);
            // 12 bits after the point; a picture less than 1/15 as bright is black.
            let factors = gains.map(|it| (4096.0 / it.max(0.067) + 0.5) as u16);
            let factors: [u16; BYTES] = std::array::from_fn(|i| factors[i % CHANNELS]);
            for ((lit, value), factor) in self.row[first..end].iter_mut().zip(&row[first..end]).zip(&factors) {
                // The upper half of the product has 4 bits after the point.
                let product = ((u32::from(u16::from(*value) << 8) * u32::from(*factor)) >> 16) as u16;
                *lit = ((product + 8) >> 4).min(255) as u8;
            }
        }
    }

    /// The confidence of up to [`BLOCK`] pixels; at most what it is, or `at_most` where that is more. Gives how many are off by more than noise.
    fn decide(&mut self, rgb: &[u8], pixels: Range<usize>, gains: Gains, at_most: u8) -> u16 {
        let n = pixels.len();
        let bytes = pixels.start * CHANNELS..pixels.end * CHANNELS;
        let (mut value, mut mean, mut variance) =
            ([[0.0f32; BLOCK]; CHANNELS], [[1.0f32; BLOCK]; CHANNELS], [[1.0f32; BLOCK]; CHANNELS]);
        let (from, means, variances) =
            (&rgb[bytes.clone()], &self.model.mean[bytes.clone()], &self.model.variance[bytes]);
        for at in 0..n {
            for c in 0..CHANNELS {
                value[c][at] = from[at * CHANNELS + c].into();
                mean[c][at] = means[at * CHANNELS + c] * gains[c];
                variance[c][at] = variances[at * CHANNELS + c];
            }
        }
        let SegmenterConfig { shadow_ratio, highlight_ratio, .. } = self.config;
        let [chroma_limit, bright_limit] = self.model.limits;
        let per_chroma = 1.0 / (chroma_limit * chroma_limit);
        let (darkest, brightest) = (1.0 - shadow_ratio, highlight_ratio - 1.0);
        let mut confidence = [0u8; BLOCK];
        let mut is_off = [0u16; BLOCK];
        for at in 0..BLOCK {
            let of = |lists: &[[f32; BLOCK]; CHANNELS]| std::array::from_fn(|c| lists[c][at]);
            let weight: [f32; CHANNELS] = std::array::from_fn(|c| 1.0 / variance[c][at]);
            let (alpha, square, chroma) = distances(of(&value), of(&mean), weight);
            let noise = bright_limit / square.sqrt();
            let off = alpha - 1.0;
            let reach = if off < 0.0 { darkest } else { brightest };
            let reach = if reach > noise { reach } else { noise };
            let by_light = off * off / (reach * reach);
            let by_chroma = chroma * per_chroma;
            is_off[at] = u16::from(by_chroma >= 1.0) | u16::from(off * off >= noise * noise);
            let square = if by_chroma > by_light { by_chroma } else { by_light };
            // Half of it, and more, is body.
            confidence[at] = (255.0 * square / (1.0 + square) + 0.5) as u8;
        }
        let open = &self.open[pixels.clone()];
        for (at, pixel) in pixels.enumerate() {
            let it = (confidence[at] & open[at]).min(self.confidence[pixel].max(at_most));
            self.confidence[pixel] = it;
            self.raw[pixel] = u8::from(it >= BODY) + u8::from(it >= SURE);
        }
        is_off[..n].iter().sum()
    }

    /// Mean and variance of one row in so many follow what is background there; what has stood still for long becomes background.
    fn follow(&mut self, rgb: &[u8]) {
        let Model { width, height, .. } = self.model;
        let rate = (BANDS as f32 / self.config.adapt_frames).min(1.0);
        for y in (self.n_pictures as usize % BANDS..height).step_by(BANDS) {
            let row = y * width..(y + 1) * width;
            self.shares.clear();
            for (mask, confidence) in self.mask[row.clone()].iter().zip(&self.confidence[row.clone()]) {
                let share = if *mask == 0 && *confidence < PLAIN { rate } else { 0.0 };
                self.shares.extend([share; CHANNELS]);
            }
            self.relit.clear();
            let bytes = row.start * CHANNELS..row.end * CHANNELS;
            self.relit.extend(rgb[bytes].iter().map(|it| f32::from(*it)));
            if !self.lights.is_learnt() {
                for (block, values) in self.relit.chunks_mut(BLOCK * CHANNELS).enumerate() {
                    let per_gain = self.lights.at(block * BLOCK, y).map(|it| 1.0 / it);
                    values.iter_mut().enumerate().for_each(|(at, it)| *it *= per_gain[at % CHANNELS]);
                }
            }
            self.model.follow(row.clone(), &self.relit, &self.shares);
            if self.config.absorb_frames > 0 {
                for i in row.clone() {
                    // At its corners, too, which the majority rounds off.
                    if self.mask[i] != 0 || self.raw[i] != 0 {
                        let per_gain = self.lights.at((i - row.start) / BLOCK * BLOCK, y).map(|it| 1.0 / it);
                        let at = i * CHANNELS;
                        self.stay(i, [rgb[at], rgb[at + 1], rgb[at + 2]], per_gain);
                    }
                }
            }
            self.model.set_quick(row);
        }
    }

    fn stay(&mut self, i: usize, value: [u8; CHANNELS], per_gain: Gains) {
        let (x, y) = ((i % self.model.width) as u32, (i / self.model.width) as u32);
        let stay = &mut self.stays[i];
        let near = (8.0 * self.config.noise_floor) as u8;
        let is_same = value.iter().zip(&stay.value).all(|(a, b)| a.abs_diff(*b) <= near);
        let is_held = self.held.iter().any(|[x0, y0, x1, y1]| (*x0..=*x1).contains(&x) && (*y0..=*y1).contains(&y));
        if !is_same || is_held {
            *stay = Stay { value, n: 0 };
            return;
        }
        stay.n += BANDS as u32;
        if stay.n >= self.config.absorb_frames {
            for c in 0..CHANNELS {
                self.model.replace(i * CHANNELS + c, f32::from(value[c]) * per_gain[c]);
            }
        }
    }
}

/// The confidence of pixels that the majority around them has moved to the other side is that of the limit.
fn settle(mask: &[u8], confidence: &mut [u8]) {
    for (it, mask) in confidence.iter_mut().zip(mask) {
        let body = if *it < BODY { BODY } else { *it };
        let background = if *it >= BODY { BODY - 1 } else { *it };
        *it = if *mask != 0 { body } else { background };
    }
}
