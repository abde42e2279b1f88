//! The best place of a template in a box by cross-correlation: the start of a least squares match [D'Apuzzo 1999 §2.4.1].
//!
//! The box is sampled once, on the template's own lattice as the start's bending lays it into the picture, and normalised cross-correlation is taken
//! at whole steps of that lattice. Where the box is larger than [`WIDEST`] steps a pyramid carries the search: the whole box at a coarse level, then ±2 a level.

use super::spline::SplineImage;
use super::template::Template;
use super::{MAX_REACH, MatchOptions, Warp};
use crate::{ImageView, Pyramid};

/// Half the side of a box that is searched in one go [px].
pub const WIDEST: usize = 12;
/// Peaks nearer than this are one [px].
const ONE_PEAK: usize = 2;
/// Places connected with the best one that correlate at least this well relative to it belong to its own peak: flanks, and a ridge along an edge [–].
const SAME_PEAK: f32 = 0.97;
/// Half a box at the finer levels of a pyramid [px].
const REFINED: usize = 2;
/// A patch at a coarser level is at least this large, so that it can be distinguished from others [px].
const LEAST_REACH: usize = 4;

/// What a search found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correlated {
    /// The best place, bent as the start.
    pub warp: Warp,
    /// Correlation there, −1 to 1 [–].
    pub correlation: f64,
    /// The best correlation of another peak, −1 without any [–]: as good means that the place is ambiguous. Another peak is a local maximum, more than two
    /// pixels off, that no ridge nearly as high as the best place leads to.
    pub second: f64,
}

/// Memory of a search, used again.
#[derive(Debug, Clone, Default)]
pub struct SearchBuffers {
    region: Vec<f32>,
    sums: Vec<f32>,
    energies: Vec<f32>,
    scores: Vec<f32>,
    is_same: Vec<bool>,
    reached: Vec<usize>,
}

/// Finds the best place of `template` within `box_px` of `start`, both directions, in steps of a pixel of the template. `None` where the whole box
/// does not lie on the picture.
pub fn search(
    template: &Template,
    picture: &SplineImage,
    start: &Warp,
    box_px: usize,
    buffers: &mut SearchBuffers,
) -> Option<Correlated> {
    let best = correlate(template, picture, start, box_px, buffers)?;
    let places = 2 * box_px + 1;
    let second = other_peaks(places, best, buffers).fold(-1.0f32, |second, it| second.max(it.1));
    let correlation = f64::from(buffers.scores[best]);
    Some(Correlated { warp: start.beside(offset(best, box_px)), correlation, second: f64::from(second) })
}

/// Where else within `box_px` of its own centre `picture`, which `template` was taken from, looks like it: offsets of peaks of correlation of at least
/// `least`, [px]. Of a box that does not lie on the picture as much is searched as does, by halves.
pub fn repeats(
    template: &Template,
    picture: &SplineImage,
    box_px: usize,
    least: f64,
    buffers: &mut SearchBuffers,
) -> Vec<[f64; 2]> {
    let start = Warp::shift(template.centre());
    let mut box_px = box_px;
    while box_px > ONE_PEAK {
        if let Some(best) = correlate(template, picture, &start, box_px, buffers) {
            let peaks = other_peaks(2 * box_px + 1, best, buffers).filter(|it| f64::from(it.1) >= least);
            return peaks.map(|it| offset(it.0, box_px)).collect();
        }
        box_px /= 2;
    }
    Vec::new()
}

/// Of a place in a box, from its middle [px].
fn offset(place: usize, box_px: usize) -> [f64; 2] {
    let side = 2 * box_px + 1;
    [place % side, place / side].map(|it| it as f64 - box_px as f64)
}

/// Correlation at all places of a box, in rows, and the best of them.
fn correlate(
    template: &Template,
    picture: &SplineImage,
    start: &Warp,
    box_px: usize,
    buffers: &mut SearchBuffers,
) -> Option<usize> {
    let reach = template.reach;
    let (side, places) = (2 * reach + 1, 2 * box_px + 1);
    let wide = side + 2 * box_px;
    let SearchBuffers { region, sums, energies, scores, .. } = buffers;
    region.resize(wide * wide, 0.0);
    if !picture.sample(start, reach + box_px, template.mean, region) {
        return None;
    }
    for list in [&mut *sums, energies, scores] {
        list.clear();
        list.resize(places * places, 0.0);
    }
    for dy in 0..places {
        let [sums, energies, scores] = [&mut *sums, energies, scores].map(|it| &mut it[dy * places..(dy + 1) * places]);
        for j in 0..side {
            let row = &region[(dy + j) * wide..(dy + j + 1) * wide];
            for i in 0..side {
                let weight = template.values[j * side + i];
                for (score, value) in scores.iter_mut().zip(&row[i..i + places]) {
                    *score += weight * value;
                }
            }
            // Sums along the row: one goes in, one goes out.
            let (mut sum, mut energy) = (0.0, 0.0);
            for value in &row[..side - 1] {
                sum += value;
                energy += value * value;
            }
            for dx in 0..places {
                let comes = row[dx + side - 1];
                (sum, energy) = (sum + comes, energy + comes * comes);
                (sums[dx], energies[dx]) = (sums[dx] + sum, energies[dx] + energy);
                (sum, energy) = (sum - row[dx], energy - row[dx] * row[dx]);
            }
        }
        let n = (side * side) as f32;
        for dx in 0..places {
            let energy = (energies[dx] - sums[dx] * sums[dx] / n) * template.energy as f32;
            scores[dx] = if energy > 0.0 { scores[dx] / energy.sqrt() } else { 0.0 };
        }
    }
    Some((0..scores.len()).fold(0, |best, it| if scores[it] > scores[best] { it } else { best }))
}

/// Peaks other than that of `best`, with their scores; rows of these are `side` long.
fn other_peaks(side: usize, best: usize, buffers: &mut SearchBuffers) -> impl Iterator<Item = (usize, f32)> {
    let SearchBuffers { scores, is_same, reached, .. } = buffers;
    let around = move |at: usize| {
        let (x, y) = (at % side, at / side);
        let rows = y.saturating_sub(1)..(y + 2).min(side);
        rows.flat_map(move |row| (x.saturating_sub(1)..(x + 2).min(side)).map(move |column| row * side + column))
    };
    is_same.clear();
    is_same.resize(scores.len(), false);
    reached.clear();
    reached.push(best);
    is_same[best] = true;
    let least = SAME_PEAK * scores[best];
    while let Some(here) = reached.pop() {
        for there in around(here).filter(|it| scores[*it] >= least) {
            if !std::mem::replace(&mut is_same[there], true) {
                reached.push(there);
            }
        }
    }
    let (scores, is_same) = (&*scores, &*is_same);
    let (x, y) = (best % side, best / side);
    let far = move |it: usize| (it % side).abs_diff(x) > ONE_PEAK || (it / side).abs_diff(y) > ONE_PEAK;
    let is_peak = move |it: usize| around(it).all(|beside| scores[beside] <= scores[it]);
    (0..scores.len()).filter(move |it| !is_same[*it] && far(*it) && is_peak(*it)).map(|it| (it, scores[it]))
}

/// Splines of the levels of a pyramid.
#[derive(Debug, Clone, Default)]
pub struct SearchPyramid {
    pyramid: Pyramid,
    levels: Vec<SplineImage>,
}

impl SearchPyramid {
    /// Takes `picture` and makes `n_levels` levels, at least one.
    pub fn build(&mut self, picture: &ImageView<'_>, n_levels: usize) {
        self.pyramid.build(picture, n_levels);
        self.levels.resize_with(self.pyramid.n_levels(), SplineImage::default);
        for (level, spline) in self.levels.iter_mut().enumerate() {
            spline.build(&self.pyramid.level(level));
        }
    }

    /// The picture itself.
    ///
    /// # Panics
    /// Before the first [`Self::build`].
    pub fn finest(&self) -> &SplineImage {
        &self.levels[0]
    }

    /// One level, 0 the picture itself; `None` where there is none.
    pub fn level(&self, level: usize) -> Option<&SplineImage> {
        self.levels.get(level)
    }

    /// (width, height) of the picture [px]; (0, 0) before the first.
    pub fn size(&self) -> (usize, usize) {
        self.pyramid.size()
    }

    /// How many levels a search of ±`box_px` takes: each halves it, down to [`WIDEST`].
    pub fn levels_for(box_px: f64) -> usize {
        let mut levels = 1;
        while box_px / f64::from(1u32 << (levels - 1)) > WIDEST as f64 {
            levels += 1;
        }
        levels
    }

    /// Finds the patch of `from` around `centre`, reaching `reach`, within `box_px` of `start`: at the coarsest level the whole box, at each finer one
    /// ±2 px. The best place, and the second best of the coarsest level. `None`: outside, or without texture. What repeats in a few pixels is even at a coarse level: see [`repeats`].
    pub fn search_from(
        &self,
        from: &SearchPyramid,
        centre: [f64; 2],
        reach: usize,
        start: &Warp,
        box_px: f64,
        buffers: &mut (Template, SearchBuffers),
    ) -> Option<Correlated> {
        let n_levels = Self::levels_for(box_px).min(self.levels.len()).min(from.levels.len());
        let options = MatchOptions { min_contrast: 1.0, ..MatchOptions::default() };
        let (template, buffers) = buffers;
        let mut warp = *start;
        let mut found: Option<Correlated> = None;
        for level in (0..n_levels).rev() {
            let factor = f64::from(1u32 << level);
            let reach = (reach >> level).max(LEAST_REACH.min(reach)).min(MAX_REACH);
            let box_px = match found {
                Some(_) => REFINED,
                None => ((box_px / factor).ceil() as usize).min(2 * WIDEST),
            };
            let taken = template.take(&from.levels[level], centre.map(|it| it / factor), reach, &options);
            let at_level = Warp { at: warp.at.map(|it| it / factor), ..warp };
            let here = taken.ok().and_then(|()| search(template, &self.levels[level], &at_level, box_px, buffers));
            match here {
                Some(here) => {
                    warp.at = here.warp.at.map(|it| it * factor);
                    let second = found.map_or(here.second, |it| it.second);
                    found = Some(Correlated { warp, second, ..here });
                }
                // A patch at a coarse level may leave the picture where the fine one does not.
                None if level > 0 => {}
                None => return None,
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flanks_and_ridges_are_no_second_peaks_and_peaks_are() {
        const SIDE: usize = 17;
        let peak = |at: [f32; 2], widths: [f32; 2]| {
            move |x: f32, y: f32| (-((x - at[0]) / widths[0]).powi(2) - ((y - at[1]) / widths[1]).powi(2)).exp()
        };
        let second = |of: &dyn Fn(f32, f32) -> f32| {
            let scores: Vec<f32> = (0..SIDE * SIDE).map(|it| of((it % SIDE) as f32, (it / SIDE) as f32)).collect();
            let best = (0..scores.len()).fold(0, |best, it| if scores[it] > scores[best] { it } else { best });
            let mut buffers = SearchBuffers { scores, ..SearchBuffers::default() };
            other_peaks(SIDE, best, &mut buffers).fold(-1.0f32, |second, it| second.max(it.1))
        };
        // So broad that three pixels off it is still 0.99 of its height, in the middle and at the border.
        let broad = peak([8.0, 8.0], [30.0, 30.0]);
        assert_eq!(second(&broad), -1.0);
        assert_eq!(second(&peak([0.0, 5.0], [30.0, 30.0])), -1.0);
        // A ridge that waves a little: an edge and noise.
        let ridge = peak([8.0, 8.0], [40.0, 2.0]);
        assert_eq!(second(&|x, y| ridge(x, y) * (1.0 + 0.005 * (1.5 * x).cos())), -1.0);
        let (near, far) = (peak([4.0, 8.0], [2.0, 2.0]), peak([13.0, 7.0], [2.0, 2.0]));
        assert!((second(&|x, y| near(x, y) + 0.98 * far(x, y)) - 0.98).abs() < 1e-3);
        // One whose top lies beyond the border counts for what is seen of it.
        let beyond = peak([18.0, 8.0], [3.0, 3.0]);
        assert!((second(&|x, y| near(x, y) + beyond(x, y)) - beyond(16.0, 8.0)).abs() < 1e-3);
    }
}
