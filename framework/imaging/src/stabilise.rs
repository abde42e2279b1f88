//! The dominant translation between two pictures: "the relative translation between frames is calculated such that the dominant object
//! position stays fixed in the frame" [Davis 2002 §5.1].
//!
//! Only the pixels with the steepest gradients vote, so that the object that has texture decides and the dull background does not. Their gray levels
//! are compared under every shift on a coarse level of the pyramid, differences cut off at a limit (what moves otherwise then counts little);
//! the few best shifts are refined from level to level; the best of them at the end gets its last fraction of a pixel by Gauss-Newton over the same pixels.

use nalgebra::{Matrix2, Vector2};

use crate::{ImageView, ImagingError, Pyramid};

/// Search range and sampling of [`Stabiliser`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StabiliserSettings {
    /// The largest shift along a row or a column [px].
    pub reach_px: usize,
    /// Pixels that vote, at most [–].
    pub votes: usize,
    /// Differences count no more than this [gray level].
    pub cutoff: u16,
}

impl Default for StabiliserSettings {
    /// 50 px a frame is usual [Davis 2002 §5.1]; a head that turns fast adds to it.
    fn default() -> Self {
        Self { reach_px: 80, votes: 384, cutoff: 30 }
    }
}

/// The translation of the dominant textured object between two pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shift {
    /// From the first picture to the second [px].
    pub translation: Vector2<f64>,
    /// Mean difference of the voting pixels under it, cut off [gray level].
    pub difference: f64,
    /// The same under no shift at all.
    pub difference_at_rest: f64,
}

/// Estimates dominant translations between pictures; its buffers are reused.
#[derive(Debug, Clone)]
pub struct Stabiliser {
    settings: StabiliserSettings,
    /// (steepness, column, row) on the coarse level.
    steep: Vec<(u16, u16, u16)>,
    costs: Vec<u32>,
    rimmed: Vec<u16>,
}

/// The coarse level has at most this many of the fine pixels in one of its own.
const COARSEST: usize = 3;
/// Steeper than this is texture; the rest is noise [gray level, over two pixels, both directions together].
const MIN_STEEPNESS: u16 = 6;
/// Shifts of the coarse level that are followed to the fine ones.
const CANDIDATES: usize = 4;

impl Stabiliser {
    /// An estimator with these settings.
    ///
    /// # Errors
    /// [`ImagingError::Setting`] names the first setting out of its range.
    pub fn new(settings: StabiliserSettings) -> Result<Self, ImagingError> {
        let StabiliserSettings { reach_px, votes, cutoff } = settings;
        ImagingError::unless(reach_px <= 1000, "reach_px", "0 to 1000", reach_px as f64)?;
        ImagingError::unless((16..=100_000).contains(&votes), "votes", "16 to 100000", votes as f64)?;
        ImagingError::unless((1..=255).contains(&cutoff), "cutoff", "1 to 255", f64::from(cutoff))?;
        Ok(Self { settings, steep: Vec::new(), costs: Vec::new(), rimmed: Vec::new() })
    }

    /// The dominant translation from the picture of `from` to that of `to`. `None` where the first has no texture, or they have not the same size.
    pub fn shift(&mut self, from: &Pyramid, to: &Pyramid) -> Option<Shift> {
        let (width, height) = from.size();
        if from.size() != to.size() || width < 8 || height < 8 || width.max(height) > usize::from(u16::MAX) {
            return None;
        }
        let coarsest = COARSEST.min(from.n_levels() - 1).min(to.n_levels() - 1);
        self.choose(&from.level(coarsest));
        if self.steep.is_empty() {
            return None;
        }
        let mut candidates = self.search(&from.level(coarsest), &to.level(coarsest), coarsest);
        let mut level = coarsest;
        while level > 0 {
            level -= 1;
            let (a, b) = (from.level(level), to.level(level));
            for candidate in candidates.iter_mut().flatten() {
                *candidate = self.refine(&a, &b, coarsest - level, [2 * candidate.0[0], 2 * candidate.0[1]]);
            }
            // The picture itself is only asked where a coarse level cannot be had.
            if level <= 1 {
                break;
            }
        }
        let (shift, cost) = candidates.into_iter().flatten().min_by_key(|it| it.1)?;
        let (a, b, finer) = (from.level(level), to.level(level), coarsest - level);
        let translation = self.polish(&a, &b, finer, shift) * f64::from(1u32 << level);
        let mean = |cost: u32| f64::from(cost) / self.steep.len() as f64;
        let difference_at_rest = mean(self.cost(&a, &b, finer, [0, 0]));
        Some(Shift { translation, difference: mean(cost), difference_at_rest })
    }

    /// The steepest pixels of the coarse picture, but those on its rim.
    fn choose(&mut self, view: &ImageView<'_>) {
        self.steep.clear();
        let (width, height) = view.size();
        for y in 1..height.saturating_sub(1) {
            let (up, at, down) = (view.row(y - 1), view.row(y), view.row(y + 1));
            for x in 1..width.saturating_sub(1) {
                let steepness = u16::from(at[x + 1].abs_diff(at[x - 1])) + u16::from(down[x].abs_diff(up[x]));
                if steepness >= MIN_STEEPNESS {
                    self.steep.push((steepness, x as u16, y as u16));
                }
            }
        }
        if self.steep.len() > self.settings.votes {
            // The place decides among equals: the same on every machine.
            self.steep.select_nth_unstable_by_key(self.settings.votes, |it| (std::cmp::Reverse(it.0), it.2, it.1));
            self.steep.truncate(self.settings.votes);
        }
    }

    /// The best shifts on the coarse level, no two of them neighbours.
    fn search(
        &mut self,
        a: &ImageView<'_>,
        b: &ImageView<'_>,
        level: usize,
    ) -> [Option<([isize; 2], u32)>; CANDIDATES] {
        let reach = self.settings.reach_px.div_ceil(1 << level);
        let side = 2 * reach + 1;
        // With a rim as wide as the reach, beyond every gray level: what leaves the picture differs by the limit.
        let wide = b.width() + 2 * reach;
        self.rimmed.clear();
        self.rimmed.resize(wide * (b.height() + 2 * reach), u16::MAX / 2);
        for (row, out) in self.rimmed.chunks_exact_mut(wide).skip(reach).take(b.height()).enumerate() {
            out[reach..].iter_mut().zip(b.row(row)).for_each(|(out, it)| *out = u16::from(*it));
        }
        let cutoff = self.settings.cutoff;
        self.costs.clear();
        self.costs.resize(side * side, 0);
        for &(_, x, y) in &self.steep {
            let (x, y) = (usize::from(x), usize::from(y));
            let here = u16::from(a.row(y)[x]);
            for (dy, costs) in self.costs.chunks_exact_mut(side).enumerate() {
                let row = &self.rimmed[(y + dy) * wide + x..][..side];
                costs.iter_mut().zip(row).for_each(|(cost, it)| *cost += u32::from(it.abs_diff(here).min(cutoff)));
            }
        }
        let (reach, costs) = (reach as isize, &self.costs);
        let mut best = [None; CANDIDATES];
        for k in 0..CANDIDATES {
            let is_free = |i: usize| {
                let (dx, dy) = ((i % side) as isize - reach, (i / side) as isize - reach);
                let taken = |it: &([isize; 2], u32)| (it.0[0] - dx).abs() <= 1 && (it.0[1] - dy).abs() <= 1;
                (!best[..k].iter().flatten().any(taken)).then_some(([dx, dy], costs[i]))
            };
            // The shorter of two equal shifts: nothing moves unless something says so.
            let rank = |it: &([isize; 2], u32)| (it.1, it.0[0].abs() + it.0[1].abs(), it.0);
            best[k] = (0..costs.len()).filter_map(is_free).min_by_key(rank);
        }
        best
    }

    /// Downhill from `shift` on a finer level, for a few steps.
    fn refine(&self, a: &ImageView<'_>, b: &ImageView<'_>, finer: usize, shift: [isize; 2]) -> ([isize; 2], u32) {
        let mut best = (shift, self.cost(a, b, finer, shift));
        for _ in 0..3 {
            let centre = best.0;
            for dy in -1..=1 {
                for dx in -1..=1 {
                    let shift = [centre[0] + dx, centre[1] + dy];
                    let cost = self.cost(a, b, finer, shift);
                    if cost < best.1 {
                        best = (shift, cost);
                    }
                }
            }
            if best.0 == centre {
                break;
            }
        }
        best
    }

    /// Sum of the voting pixels' differences under a shift, on a level that is `finer` levels below the coarse one.
    /// A pixel that leaves the picture counts the limit.
    fn cost(&self, a: &ImageView<'_>, b: &ImageView<'_>, finer: usize, [dx, dy]: [isize; 2]) -> u32 {
        let cutoff = self.settings.cutoff;
        let (width, height) = (b.width(), b.height());
        let mut sum = 0;
        for &(_, x, y) in &self.steep {
            let (x, y) = (usize::from(x) << finer, usize::from(y) << finer);
            let (u, v) = (x.wrapping_add_signed(dx), y.wrapping_add_signed(dy));
            let difference = if u < width && v < height {
                let here = a.pixels()[y * width + x];
                u16::from(here.abs_diff(b.pixels()[v * width + u])).min(cutoff)
            } else {
                cutoff
            };
            sum += u32::from(difference);
        }
        sum
    }

    /// The shift to a fraction of a pixel, on the same level as [`Self::cost`]: least squares over the pixels that differ by less than the limit.
    fn polish(&self, a: &ImageView<'_>, b: &ImageView<'_>, finer: usize, shift: [isize; 2]) -> Vector2<f64> {
        let start = Vector2::new(shift[0] as f64, shift[1] as f64);
        let mut at = start;
        for _ in 0..4 {
            let (mut tensor, mut mismatch) = (Matrix2::zeros(), Vector2::zeros());
            for &(_, x, y) in &self.steep {
                let (x, y) = (usize::from(x) << finer, usize::from(y) << finer);
                let (Some([here, gx, gy]), Some([there, ..])) =
                    (sample(a, x as f64, y as f64), sample(b, x as f64 + at.x, y as f64 + at.y))
                else {
                    continue;
                };
                let (difference, gradient) = (there - here, Vector2::new(gx, gy));
                if difference.abs() < f64::from(self.settings.cutoff) {
                    tensor += gradient * gradient.transpose();
                    mismatch += gradient * difference;
                }
            }
            let Some(step) = tensor.cholesky().map(|it| -it.solve(&mismatch)) else { break };
            at += step;
            // Further than the search was coarse: the shift that was found is the better answer.
            if (at - start).amax() > 1.5 {
                return start;
            }
            if step.norm() < 0.01 {
                break;
            }
        }
        at
    }
}

/// The gray level between four pixels and, of the pixel at the top left of these, the gradient. `None` on the rim and outside.
fn sample(view: &ImageView<'_>, x: f64, y: f64) -> Option<[f64; 3]> {
    let (width, height) = view.size();
    let is_inside = x >= 1.0 && y >= 1.0 && x < width as f64 - 2.0 && y < height as f64 - 2.0;
    if !is_inside {
        return None;
    }
    let (i, j) = (x as usize, y as usize);
    let (fx, fy) = (x - i as f64, y - j as f64);
    let at = |dx: usize, dy: usize| f64::from(view.pixels()[(j + dy - 1) * width + i + dx - 1]);
    let level = (1.0 - fy) * ((1.0 - fx) * at(1, 1) + fx * at(2, 1)) + fy * ((1.0 - fx) * at(1, 2) + fx * at(2, 2));
    Some([level, (at(2, 1) - at(0, 1)) / 2.0, (at(1, 2) - at(1, 0)) / 2.0])
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;

    use super::*;

    const WIDTH: usize = 320;
    const HEIGHT: usize = 240;

    /// An object of radius 60 px with texture at `at`, before a background of faint texture that lies at `behind`.
    fn picture(at: [f64; 2], behind: [f64; 2], noise: f64, random: &mut Random) -> Pyramid {
        let level = |i: usize| {
            let (x, y) = ((i % WIDTH) as f64, (i / WIDTH) as f64);
            let (u, v) = (x - at[0], y - at[1]);
            let value = if u.hypot(v) < 60.0 {
                150.0 + 40.0 * (0.13 * u + 1.3).sin() * (0.11 * v).cos() + 30.0 * (0.31 * u - 0.22 * v).sin()
            } else {
                let (u, v) = (x - behind[0], y - behind[1]);
                60.0 + 4.0 * (0.2 * u).sin() * (0.17 * v).cos()
            };
            (value + noise * random.normal()).round().clamp(0.0, 255.0) as u8
        };
        let pixels: Vec<u8> = (0..WIDTH * HEIGHT).map(level).collect();
        let mut pyramid = Pyramid::default();
        pyramid.build(&ImageView::new(&pixels, WIDTH, HEIGHT).unwrap(), 4);
        pyramid
    }

    fn stabiliser() -> Stabiliser {
        Stabiliser::new(StabiliserSettings::default()).unwrap()
    }

    #[test]
    fn the_object_decides_and_not_what_is_behind_it() {
        let mut random = Random::new(4);
        let first = picture([150.0, 120.0], [0.0; 2], 2.0, &mut random);
        for shift in [[0.0, 0.0], [0.4, -0.3], [7.3, 2.2], [40.3, 29.7], [-50.4, -10.1], [70.0, 0.5]] {
            let second = picture([150.0 + shift[0], 120.0 + shift[1]], [0.0; 2], 2.0, &mut random);
            let found = stabiliser().shift(&first, &second).unwrap();
            let error = (found.translation - Vector2::from(shift)).norm();
            assert!(error < 0.3, "{shift:?}: {error} px off");
            assert!(found.difference <= found.difference_at_rest);
        }
    }

    #[test]
    fn a_fresh_and_a_used_stabiliser_say_the_same() {
        let mut random = Random::new(4);
        let first = picture([150.0, 120.0], [0.0; 2], 2.0, &mut random);
        let second = picture([161.0, 115.0], [0.0; 2], 2.0, &mut random);
        let mut used = stabiliser();
        used.shift(&second, &first);
        assert_eq!(used.shift(&first, &second), stabiliser().shift(&first, &second));
    }

    #[test]
    fn pictures_without_texture_or_of_other_sizes_have_no_motion() {
        let build = |pixels: &[u8], width| {
            let mut pyramid = Pyramid::default();
            pyramid.build(&ImageView::new(pixels, width, pixels.len() / width).unwrap(), 4);
            pyramid
        };
        let flat = build(&[90; 64 * 48], 64);
        let mut random = Random::new(4);
        let textured = picture([150.0, 120.0], [0.0; 2], 2.0, &mut random);
        assert_eq!(stabiliser().shift(&flat, &flat), None);
        assert_eq!(stabiliser().shift(&textured, &flat), None);
        assert_eq!(stabiliser().shift(&Pyramid::default(), &Pyramid::default()), None);
        let tiny = build(&[0, 255, 9, 200], 2);
        assert_eq!(stabiliser().shift(&tiny, &tiny), None);
    }

    #[test]
    fn settings_out_of_range_are_named() {
        let named = |settings| Stabiliser::new(settings).err().map(|it| it.to_string());
        let settings = StabiliserSettings::default();
        for (name, settings) in [
            ("reach_px", StabiliserSettings { reach_px: 5000, ..settings }),
            ("votes", StabiliserSettings { votes: 3, ..settings }),
            ("cutoff", StabiliserSettings { cutoff: 0, ..settings }),
        ] {
            assert!(named(settings).is_some_and(|it| it.contains(name)), "{name}");
        }
    }
}
