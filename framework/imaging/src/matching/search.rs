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
/// Half a box at the finer levels of a pyramid [px].
const REFINED: usize = 2;
/// A patch at a coarser level is at least this large, for it has to be told from others [px].
const LEAST_REACH: usize = 4;

/// What a search found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correlated {
    /// The best place, bent as the start.
    pub warp: Warp,
    /// Correlation there, −1 to 1 [–].
    pub correlation: f64,
    /// The best correlation more than two pixels off, −1 without any [–]: as good means that the place is ambiguous.
    pub second: f64,
}

/// Memory of a search, used again.
#[derive(Debug, Clone, Default)]
pub struct SearchBuffers {
    region: Vec<f32>,
    sums: Vec<f32>,
    energies: Vec<f32>,
    scores: Vec<f32>,
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
    let reach = template.reach;
    let (side, places) = (2 * reach + 1, 2 * box_px + 1);
    let wide = side + 2 * box_px;
    let SearchBuffers { region, sums, energies, scores } = buffers;
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
    let best = (0..scores.len()).fold(0, |best, it| if scores[it] > scores[best] { it } else { best });
    let (x, y) = (best % places, best / places);
    let far = |it: &usize| (it % places).abs_diff(x) > ONE_PEAK || (it / places).abs_diff(y) > ONE_PEAK;
    let second = (0..scores.len()).filter(far).fold(-1.0f32, |second, it| second.max(scores[it]));
    let offset = [x, y].map(|it| it as f64 - box_px as f64);
    Some(Correlated { warp: start.beside(offset), correlation: f64::from(scores[best]), second: f64::from(second) })
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
    /// ±2 px. The best place, and the second best of the coarsest level, where an ambiguity shows. `None`: outside, or without texture.
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
