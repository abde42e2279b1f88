//! Learns how bright each pixel is without targets, and derives its threshold [Davis 2002 §3.3 "Thresholding"].
//!
//! threshold = max(`min_threshold`, background + `offset`), saturating at 255; a pixel is lit when it is brighter. The
//! background of a pixel is its maximum over the first `learn_frames` frames. When more than `relearn_fraction` of the
//! pixels that are not masked exceed their thresholds, the room has changed and it is learned again.
//!
//! What the paper leaves open, and what is done here:
//!
//! - *A target in view while learning.* A maximum over frames burns its whole path into the background, which is then
//!   blind along it until the next learning. [`Statistic::WithoutHighest`] leaves out the brightest few frames of each
//!   pixel: a light that moves on within that many frames leaves no trace. A light that stands still cannot be
//!   distinguished from a lamp; `sink` lets its trace fade after it has gone (and lets the whole table follow when the room
//!   gets darker, which the paper's rule never notices).
//! - *What is emitted while learning.* Without a table nothing can be detected: [`Background::thresholds`] is `None`. While
//!   learning again the old table stays in force, but a frame that floods it is not to be trusted:
//!   [`Verdict::Flooded`].
//! - *A flash.* Learning again ends with a new table only if a fifth of its frames were flooded; otherwise the old one
//!   was right and stays.
//! - *A room so bright that background + offset passes 255.* Such pixels can never be lit and so never exceed. If more
//!   than `relearn_fraction` are blind in this way, learning goes on until the light has gone.
//! - *Sampled pictures.* The fraction is estimated from the sampled rows; windows, where targets are expected, do not
//!   count.

use crate::{Found, ImageView, ImagingError, ThresholdMap};

/// What the background of a pixel is, given the frames it was learned from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Statistic {
    /// The brightest of all frames: the paper's. The surest against flicker; burns in whatever light passes.
    #[default]
    Maximum,
    /// The brightest after leaving out this many brighter frames, at most 15. Takes memory and time in proportion.
    WithoutHighest(u8),
}

/// Settings of [`Background`].
#[derive(Debug, Clone, PartialEq)]
pub struct BackgroundConfig {
    /// Frames that a background is learned from, at least 1.
    pub learn_frames: u32,
    /// A pixel is lit when brighter than its background by more than this [gray level]. Covers what learning did not
    /// see: about three times the noise, and slow changes of the light.
    pub offset: u8,
    /// No threshold is lower than this [gray level], however dark the background was.
    pub min_threshold: u8,
    /// Learn again when more than this part of the unmasked pixels is lit, 0..=1.
    pub relearn_fraction: f64,
    /// What the background of a pixel is.
    pub statistic: Statistic,
    /// How far the background of a pixel that has become darker sinks each time it is visited; 0: never, as in the
    /// paper [gray level]. Each frame visits one band of 8 rows. Lit pixels are left alone, and no background rises
    /// above what was learned.
    pub sink: u8,
}

impl Default for BackgroundConfig {
    /// The paper's maximum over 30 frames, 20 gray levels above it, at least 40, learned again from 2 % on.
    fn default() -> Self {
        Self {
            learn_frames: 30,
            offset: 20,
            min_threshold: 40,
            relearn_fraction: 0.02,
            statistic: Statistic::Maximum,
            sink: 0,
        }
    }
}

impl BackgroundConfig {
    /// [`ImagingError::Setting`] that names the first setting out of its range.
    pub fn check(&self) -> Result<(), ImagingError> {
        let Self { learn_frames, relearn_fraction, .. } = *self;
        ImagingError::unless(learn_frames >= 1, "learn_frames", "at least 1", learn_frames.into())?;
        ImagingError::unless((0.0..=1.0).contains(&relearn_fraction), "relearn_fraction", "0 to 1", relearn_fraction)?;
        let n_left_out = self.n_left_out();
        let fits = n_left_out <= 15 && (n_left_out as u32) < learn_frames;
        ImagingError::unless(
            fits,
            "statistic",
            "at most 15 frames left out, fewer than learn_frames",
            n_left_out as f64,
        )
    }

    fn n_left_out(&self) -> usize {
        match self.statistic {
            Statistic::Maximum => 0,
            Statistic::WithoutHighest(n) => n.into(),
        }
    }
}

/// Whether the spots found in a frame can be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// There is no table yet (or was none for this frame): nothing could be found.
    Learning,
    /// The table fits the frame.
    Trusted,
    /// The frame exceeds the table in too many places: its spots are mostly false.
    Flooded,
}

/// Learnt background brightness and thresholds of one camera. Costs time only while it learns or sinks.
#[derive(Debug, Clone)]
pub struct Background {
    config: BackgroundConfig,
    width: usize,
    height: usize,
    masked: Vec<bool>,
    /// The brightest values of each pixel while learning, the highest in `ranks[0]`.
    ranks: Vec<Vec<u8>>,
    /// `None` when not learning.
    learning: Option<Learning>,
    /// As learned.
    learned: Vec<u8>,
    /// As learned, less what has sunk since.
    background: Vec<u8>,
    table: Option<ThresholdMap>,
    next_band: usize,
}

#[derive(Debug, Clone, Copy)]
struct Learning {
    n_frames: u32,
    n_flooded: u32,
    /// How many flooded frames it takes for the new table to be believed.
    n_to_believe: u32,
}

impl Background {
    /// A background for pictures of this size [px], about to learn; nothing is masked.
    pub fn new(config: BackgroundConfig, width: usize, height: usize) -> Result<Self, ImagingError> {
        config.check()?;
        let n = width * height;
        let mut this = Self {
            ranks: vec![vec![0; n]; config.n_left_out() + 1],
            config,
            width,
            height,
            masked: vec![false; n],
            learning: None,
            learned: vec![0; n],
            background: vec![0; n],
            table: None,
            next_band: 0,
        };
        this.start_learning(0);
        Ok(this)
    }

    /// The settings in force.
    pub fn config(&self) -> &BackgroundConfig {
        &self.config
    }

    /// Masked pixels (`width × height`, row by row) can never be lit; takes effect at once, also while learning.
    pub fn set_mask(&mut self, masked: Vec<bool>) -> Result<(), ImagingError> {
        let expected = self.width * self.height;
        if masked.len() != expected {
            return Err(ImagingError::WrongLength { what: "mask", expected, found: masked.len() });
        }
        self.masked = masked;
        self.rebuild();
        Ok(())
    }

    /// Changes the two levels that can be adjusted while the system runs [gray level]; takes effect at once.
    pub fn set_levels(&mut self, offset: u8, min_threshold: u8) {
        self.config.offset = offset;
        self.config.min_threshold = min_threshold;
        self.rebuild();
    }

    /// Learns again from the next frame on; the table in force stays until then.
    pub fn relearn(&mut self) {
        self.start_learning(0);
    }

    /// The thresholds to search the next frame with; `None` until the first learning has ended.
    pub fn thresholds(&self) -> Option<&ThresholdMap> {
        self.table.as_ref()
    }

    /// The background in force, row by row [gray level]; zeros until the first learning has ended.
    pub fn levels(&self) -> &[u8] {
        &self.background
    }

    /// Frames learned so far and frames needed, while learning.
    pub fn progress(&self) -> Option<(u32, u32)> {
        self.learning.map(|it| (it.n_frames, self.config.learn_frames))
    }

    /// Part of the unmasked pixels whose threshold is 255, so that no target can be seen there; 0 without a table.
    pub fn blind_fraction(&self) -> f64 {
        let Some(table) = &self.table else { return 0.0 };
        let unmasked = self.masked.iter().filter(|&&it| !it).count();
        let usable: u64 = (0..self.height).map(|y| u64::from(table.usable_in_row(y))).sum();
        if unmasked == 0 { 0.0 } else { 1.0 - usable as f64 / unmasked as f64 }
    }

    /// Learns from a frame and from what was found in it with [`Background::thresholds`] (`None`: not searched).
    ///
    /// Call it once for each frame, after the search. [`ImagingError::WrongSize`] leaves everything as it was.
    pub fn update(&mut self, image: &ImageView, found: Option<&Found>) -> Result<Verdict, ImagingError> {
        let expected = (self.width, self.height);
        if image.size() != expected {
            return Err(ImagingError::WrongSize { what: "picture", expected, found: image.size() });
        }
        let verdict = match (&self.table, found) {
            (None, _) => Verdict::Learning,
            (_, Some(found)) if found.lit_fraction() > self.config.relearn_fraction => Verdict::Flooded,
            _ => Verdict::Trusted,
        };
        if verdict == Verdict::Flooded && self.learning.is_none() {
            self.start_learning(self.config.learn_frames.div_ceil(5));
        }
        if self.learning.is_some() {
            self.learn(image, verdict == Verdict::Flooded);
        } else if self.config.sink > 0 {
            self.sink(image);
        }
        Ok(verdict)
    }

    fn start_learning(&mut self, n_to_believe: u32) {
        self.ranks.iter_mut().for_each(|it| it.fill(0));
        self.learning = Some(Learning { n_frames: 0, n_flooded: 0, n_to_believe });
    }

    /// Sorts the frame into the ranks, and ends the learning when it was the last.
    fn learn(&mut self, image: &ImageView, flooded: bool) {
        let Some(learning) = &mut self.learning else { return };
        learning.n_frames += 1;
        learning.n_flooded += u32::from(flooded);
        // Each rank keeps the brighter and hands the darker one down. The first takes the frame itself.
        let (highest, lower) = self.ranks.split_at_mut(1);
        if lower.is_empty() {
            for (top, &pixel) in highest[0].iter_mut().zip(image.pixels()) {
                *top = pixel.max(*top);
            }
        } else {
            for (i, &pixel) in image.pixels().iter().enumerate() {
                let mut handed = pixel;
                for rank in self.ranks.iter_mut() {
                    let kept = handed.max(rank[i]);
                    handed = handed.min(rank[i]);
                    rank[i] = kept;
                }
            }
        }
        let Some(learning) = self.learning.filter(|it| it.n_frames >= self.config.learn_frames) else { return };
        self.learning = None;
        if learning.n_flooded >= learning.n_to_believe {
            self.learned.copy_from_slice(&self.ranks[self.config.n_left_out()]);
            self.background.copy_from_slice(&self.learned);
            self.table = Some(ThresholdMap::uniform(255, self.width, self.height));
            self.rebuild();
            if self.blind_fraction() > self.config.relearn_fraction {
                self.start_learning(0);
            }
        }
    }

    /// Lets the background of one band of rows follow the picture downwards.
    fn sink(&mut self, image: &ImageView) {
        let Some(table) = &mut self.table else { return };
        let n_bands = self.height.div_ceil(crate::thresholds::TILE_HEIGHT);
        if n_bands == 0 {
            return;
        }
        let band = self.next_band % n_bands;
        self.next_band = band + 1;
        let rows = table.rows_of_band(band);
        let span = rows.start * self.width..rows.end * self.width;
        for i in span.clone() {
            let (pixel, level) = (image.pixels()[i], self.background[i]);
            if pixel < level {
                self.background[i] = pixel.max(level.saturating_sub(self.config.sink));
            } else if pixel <= table.thresholds()[i] {
                self.background[i] = pixel.min(self.learned[i]); // a peak of the noise, not a target
            }
        }
        let (config, background, masked) = (&self.config, &self.background[span.clone()], &self.masked[span]);
        table.change_band(band, |thresholds| fill_thresholds(thresholds, background, masked, config));
    }

    /// Brings the table up to date with background, mask and levels.
    fn rebuild(&mut self) {
        let Some(table) = &mut self.table else { return };
        for band in 0..self.height.div_ceil(crate::thresholds::TILE_HEIGHT) {
            let rows = table.rows_of_band(band);
            let span = rows.start * self.width..rows.end * self.width;
            let (config, background, masked) = (&self.config, &self.background[span.clone()], &self.masked[span]);
            table.change_band(band, |thresholds| fill_thresholds(thresholds, background, masked, config));
        }
    }
}

fn fill_thresholds(thresholds: &mut [u8], background: &[u8], masked: &[bool], config: &BackgroundConfig) {
    for ((threshold, &level), &masked) in thresholds.iter_mut().zip(background).zip(masked) {
        let open = level.saturating_add(config.offset).max(config.min_threshold);
        *threshold = if masked { 255 } else { open };
    }
}
