//! Stripes that are finer than the camera resolves: of a projector with more pixels than the camera has on its picture, or out of focus.
//!
//! Where a camera blurs stripes, the finest bit has the least contrast, and that of coarser ones is much larger. Light that comes over other
//! surfaces takes off contrast too, but as much of all fine stripes alike: such a bit is not taken for too fine, and [`super::gray`] leaves its pixels out.
//! Without its finest bits a Gray code is a Gray code of stripes twice as wide.
//!
//! Stripes narrower than pixels that the camera sees sharply may show any contrast, of their beat with the pixels. Their width follows from coarser ones: each bit changes twice as often as the next coarser one.

use super::code::{Axis, Shown, StripeCode};
use crate::ImageView;

/// By block of the camera's picture, how many of the finest bits of columns and rows are too fine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TooFine {
    columns: usize,
    /// Row by row; `None` where the projector lights too little.
    blocks: Vec<Option<[u32; 2]>>,
    /// By block, of columns and rows: stripes of the finest bit are too narrow by so many bits to be resolved all over the block, however they look.
    narrow: Vec<[u32; 2]>,
    overall: [u32; 2],
}

/// Side of a block [px].
const BLOCK: usize = 64;
/// Every so many pixels of a row one is looked at, …
const STEP: usize = 9;
/// … in each row so many farther to the right than in the one above: within nine rows in each place of the step, and so in columns. A grid of every third column sees stripes three pixels wide at their edges alone, or never there.
const ASIDE: usize = 7;
/// Pixels of a block that have to be lit.
const MIN_SAMPLES: usize = 60;
/// The contrast of a bit in a block is that which so many of its pixels do not have [–].
const PERCENTILE: f64 = 0.8;
/// A bit is too fine where its contrast is below this part of white − black: less than half of it may as well be other light.
const WEAK: f64 = 0.5;
/// And below this part of that of the next two coarser bits.
const WEAKER: f64 = 0.7;
/// Stripes of less contrast than this part of white − black are not seen at all [–].
const NOTHING: f64 = 0.15;
/// A bit that changes more often than this from one pixel to the next is too fine, whatever its contrast [1/px].
const TOO_OFTEN: f64 = 0.9;
/// Periods of phase steps are resolved from so many pixels on: by sampling [px].
const LEAST_PERIOD: f64 = 2.0;
/// Changes in all over those that are seen between two pixels that are certain: rendered cameras that saw periods of 1.5, 1.8, 2.4 and 3 px seemed to see 2.2, 2.5, 3.4 and 4 [–].
const MISSED: f64 = 1.45;
/// One that changes more often than this may be too fine here and there.
const NARROW: f64 = 0.5;
/// Bits that change as often as this are well resolved and tell how often finer ones do [1/px]; the next coarser one changes half as often, but for this factor [–].
const RESOLVED: std::ops::RangeInclusive<f64> = 0.02..=0.15;
const HALF: f64 = 1.6;
/// Pairs of pixels, and changes among them, that tell it.
const MIN_PAIRS: usize = 100;
const MIN_CHANGES: usize = 8;
/// A bit is certain in a pixel where it is off the middle of dark and bright by this part of their difference [–].
const CERTAIN: f64 = 0.25;
/// In a block some of whose lit pixels cannot be decoded, more than this part, coarser stripes may tell [–].
const UNDECODED: f64 = 0.12;
/// Bits that are kept.
const MIN_BITS: usize = 3;
/// All blocks but this part have to want it before a bit is taken to be too fine all over the picture.
const FEW: f64 = 0.05;

impl TooFine {
    /// Looks at `pictures`, which are as many as `code` has; pixels of less than `min_contrast` gray levels are not looked at. Codes of a phase shift need their
    /// finest bits, and none of theirs is too fine.
    pub fn of(code: &StripeCode, pictures: &[ImageView<'_>], min_contrast: u8) -> TooFine {
        let nothing = TooFine { columns: 1, blocks: Vec::new(), narrow: Vec::new(), overall: [0; 2] };
        let shown = code.pictures();
        let Some(first) = pictures.first().filter(|_| code.steps == 0 && pictures.len() == shown.len()) else {
            return nothing;
        };
        let (width, height) = first.size();
        if pictures.iter().any(|it| it.size() != (width, height)) {
            return nothing;
        }
        let views: Vec<&[u8]> = pictures.iter().map(|it| it.pixels()).collect();
        let bits = bits_of(code, &shown);
        let columns = width.div_ceil(BLOCK).max(1);
        let mut blocks = vec![None; columns * height.div_ceil(BLOCK)];
        let all = all_samples(&views, width, height, min_contrast);
        // Of few pixels not every block tells how wide stripes are.
        let everywhere = all.concat();
        let often_everywhere = [0, 1].map(|axis| how_often(&bits[axis], &views, &everywhere, width));
        let too_often_everywhere = [0, 1].map(|axis| beyond(often_everywhere[axis], TOO_OFTEN, bits[axis].len()));
        let mut narrow = vec![[0; 2]; blocks.len()];
        for ((block, narrow), samples) in blocks.iter_mut().zip(&mut narrow).zip(&all) {
            if samples.len() >= MIN_SAMPLES {
                *block = Some([0, 1].map(|axis| {
                    let often = how_often(&bits[axis], &views, samples, width);
                    narrow[axis] = beyond(often.or(often_everywhere[axis]), NARROW, bits[axis].len());
                    let too_often = beyond(often, TOO_OFTEN, bits[axis].len());
                    finest(&bits[axis], &views, samples).max(too_often.min(too_often_everywhere[axis] + 1))
                }));
            }
        }
        // The level that nearly all blocks reach.
        let overall = [0, 1].map(|axis| {
            let mut levels: Vec<u32> = blocks.iter().flatten().map(|it: &[u32; 2]| it[axis]).collect();
            levels.sort_unstable();
            let in_blocks = levels.get((levels.len() as f64 * FEW) as usize).copied().unwrap_or(0);
            in_blocks.max(too_often_everywhere[axis])
        });
        TooFine { columns, blocks, narrow, overall }
    }

    /// With one bit more of an axis too fine in blocks where pixels that the projector lights have no coordinate and stripes are so narrow that this may be why; `None` where there is no such block. `is_open` says of a pixel and an axis whether that is so, `None` where it is not
    /// lit. No more than `most` bits of an axis.
    pub fn coarser_where(
        &self,
        size: [usize; 2],
        most: [u32; 2],
        is_open: impl Fn(usize, usize) -> Option<bool>,
    ) -> Option<TooFine> {
        let mut counts = vec![[[0_usize; 2]; 2]; self.blocks.len()];
        for at in 0..size[0] * size[1] {
            let Some(counts) = counts.get_mut(at / size[0] / BLOCK * self.columns + at % size[0] / BLOCK) else {
                continue;
            };
            for (axis, [n, n_open]) in counts.iter_mut().enumerate() {
                if let Some(is_open) = is_open(at, axis) {
                    *n += 1;
                    *n_open += usize::from(is_open);
                }
            }
        }
        let mut coarser = self.clone();
        for ((block, narrow), counts) in coarser.blocks.iter_mut().zip(&self.narrow).zip(&counts) {
            for (axis, dropped) in block.iter_mut().flatten().enumerate() {
                let [n, n_open] = counts[axis];
                if n_open as f64 > UNDECODED * n as f64
                    && n_open > MIN_SAMPLES
                    && *dropped < most[axis].min(narrow[axis])
                {
                    *dropped += 1;
                }
            }
        }
        (coarser != *self).then_some(coarser)
    }

    /// Bits of columns and rows that are too fine all over the picture.
    pub fn overall(&self) -> [u32; 2] {
        self.overall
    }

    /// Bits of columns and rows that are too fine around a pixel.
    pub fn at(&self, x: usize, y: usize) -> [u32; 2] {
        self.blocks.get(y / BLOCK * self.columns + x / BLOCK).copied().flatten().unwrap_or(self.overall)
    }

    /// All that occur, each once, in ascending order.
    pub fn levels(&self) -> Vec<[u32; 2]> {
        let mut levels: Vec<[u32; 2]> = self.blocks.iter().flatten().copied().chain([self.overall]).collect();
        levels.sort_unstable();
        levels.dedup();
        levels
    }

    /// Part of what the projector lights in which at least one bit of an axis is too fine [–].
    pub fn share(&self, axis: Axis) -> f64 {
        let all = self.blocks.iter().flatten();
        all.clone().filter(|it| it[axis.index()] > 0).count() as f64 / all.count().max(1) as f64
    }
}

/// By axis how wide a period of the phase steps is in the picture, where its stripes are narrower than the camera resolves [px]; `pictures` are as many as `code` has.
pub fn unresolved_periods(code: &StripeCode, pictures: &[ImageView<'_>], min_contrast: u8) -> [Option<f64>; 2] {
    let shown = code.pictures();
    let Some(first) = pictures.first().filter(|_| code.steps > 0 && pictures.len() == shown.len()) else {
        return [None; 2];
    };
    let (width, height) = first.size();
    if pictures.iter().any(|it| it.size() != (width, height)) {
        return [None; 2];
    }
    let views: Vec<&[u8]> = pictures.iter().map(|it| it.pixels()).collect();
    let bits = bits_of(code, &shown);
    let everywhere = all_samples(&views, width, height, min_contrast).concat();
    // The finest bit changes once a period. Where too little tells it of an axis, it is taken to be as with the other.
    let periods = [0, 1].map(|axis| Some(1.0 / (MISSED * how_often(&bits[axis], &views, &everywhere, width)?)));
    [periods[0].or(periods[1]), periods[1].or(periods[0])].map(|it| it.filter(|it| *it < LEAST_PERIOD))
}

/// By axis and bit the places of its pictures.
fn bits_of(code: &StripeCode, shown: &[Shown]) -> [Vec<Vec<usize>>; 2] {
    Axis::BOTH.map(|axis| {
        let n = if code.has(axis) { code.bits[axis.index()] } else { 0 };
        let is_of =
            |it: &Shown, at: u32| matches!(it, Shown::Bit { axis: of, plane, .. } if *of == axis && *plane == at);
        (0..n).map(|at| (0..shown.len()).filter(|it| is_of(&shown[*it], at)).collect()).collect()
    })
}

/// By block pixels that are lit: where, and darkest plus brightest, and the difference.
fn all_samples(views: &[&[u8]], width: usize, height: usize, min_contrast: u8) -> Vec<Vec<(usize, i32, i32)>> {
    let columns = width.div_ceil(BLOCK).max(1);
    let mut all = vec![Vec::new(); columns * height.div_ceil(BLOCK)];
    for y in 0..height {
        for x in (ASIDE * y % STEP..width).step_by(STEP) {
            let at = y * width + x;
            let (low, high) = views.iter().fold((255, 0), |(low, high), it| (it[at].min(low), it[at].max(high)));
            if high.saturating_sub(low) >= min_contrast.max(1) {
                let (low, high) = (i32::from(low), i32::from(high));
                all[y / BLOCK * columns + x / BLOCK].push((at, low + high, high - low));
            }
        }
    }
    all
}

/// How many of the finest bits, each with its pictures, are too fine in these pixels.
fn finest(bits: &[Vec<usize>], views: &[&[u8]], samples: &[(usize, i32, i32)]) -> u32 {
    // Of both pictures the one that shows more: one that is another's double has its contrast.
    let contrast = |plane: usize| {
        let of = |&(at, sum, difference): &(usize, i32, i32)| {
            let off = bits[plane].iter().map(|it| (2 * i32::from(views[*it][at]) - sum).abs()).max().unwrap_or(0);
            f64::from(off) / f64::from(difference)
        };
        let mut list: Vec<f64> = samples.iter().map(of).collect();
        let place = (PERCENTILE * (list.len() - 1) as f64) as usize;
        *list.select_nth_unstable_by(place, f64::total_cmp).1
    };
    // From the finest on.
    let contrasts: Vec<f64> = (0..bits.len()).rev().map(contrast).collect();
    let most = bits.len().saturating_sub(MIN_BITS);
    let is_too_fine = |it: &usize| {
        // Two bits that are both too fine may look alike.
        let coarser = contrasts[it + 1..].iter().take(2).copied().fold(0.0, f64::max);
        contrasts[*it] < WEAK && (contrasts[*it] < NOTHING || contrasts[*it] < WEAKER * coarser)
    };
    let dropped = (0..most).take_while(is_too_fine).count();
    // Where no bit is left that is seen, it is not for want of resolution.
    if contrasts.get(dropped).is_some_and(|it| *it >= WEAK) { dropped as u32 } else { 0 }
}

/// How often the finest bit changes from one pixel to the next, inferred from bits that are resolved [1/px].
fn how_often(bits: &[Vec<usize>], views: &[&[u8]], samples: &[(usize, i32, i32)], width: usize) -> Option<f64> {
    let n_pixels = views.first().map_or(0, |it| it.len());
    // How often a bit changes to the right and downwards.
    let often = |pictures: &Vec<usize>| -> Option<f64> {
        let lit = |at: usize, sum: i32, difference: i32| -> Option<bool> {
            let off = match pictures[..] {
                [bit, inverse] => i32::from(views[bit][at]) - i32::from(views[inverse][at]),
                [bit] => 2 * i32::from(views[bit][at]) - sum,
                _ => return None,
            };
            (f64::from(off.abs()) >= CERTAIN * f64::from(difference)).then_some(off > 0)
        };
        let mut counts = [[0_usize; 2]; 2];
        for &(at, sum, difference) in samples {
            let Some(here) = lit(at, sum, difference) else { continue };
            for (by, [n, n_changes]) in [1, width].into_iter().zip(&mut counts) {
                if at + by >= n_pixels || by == 1 && (at + 1) % width == 0 {
                    continue;
                }
                if let Some(there) = lit(at + by, sum, difference) {
                    *n += 1;
                    *n_changes += usize::from(there != here);
                }
            }
        }
        let is_told =
            counts.iter().all(|it| it[0] >= MIN_PAIRS) && counts.iter().map(|it| it[1]).sum::<usize>() >= MIN_CHANGES;
        let [right, down] = counts.map(|[n, n_changes]| n_changes as f64 / n.max(1) as f64);
        is_told.then(|| right.hypot(down))
    };
    let all: Vec<Option<f64>> = bits.iter().map(often).collect();
    let tells = |plane: usize| {
        let (often, coarser) = (all[plane].filter(|it| RESOLVED.contains(it))?, all[plane.checked_sub(1)?]?);
        (1.0 / HALF..=HALF).contains(&(often / (2.0 * coarser))).then_some((plane, often))
    };
    let (plane, often) = (0..bits.len()).rev().find_map(tells)?;
    Some(often * 2_f64.powi((bits.len() - 1 - plane) as i32))
}

/// How many of the finest bits change more often than `most`, where the finest one does so `often`.
fn beyond(often: Option<f64>, most: f64, n_bits: usize) -> u32 {
    let dropped = (0..n_bits.saturating_sub(MIN_BITS))
        .take_while(|it| often.is_some_and(|often| often * 0.5_f64.powi(*it as i32) > most));
    dropped.count() as u32
}

#[cfg(test)]
mod tests {
    use super::super::scene::{Scene, wall};
    use super::*;

    fn found(scene: &Scene, code: &StripeCode, change: impl Fn(&mut Vec<Vec<u8>>)) -> TooFine {
        let mut pictures = scene.pictures(code);
        change(&mut pictures);
        let [width, height] = scene.size;
        let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, width, height).unwrap()).collect();
        TooFine::of(code, &views, 12)
    }

    #[test]
    fn a_camera_that_sees_stripes_has_none_that_are_too_fine() {
        let code = StripeCode::gray([160, 120]);
        for seed in 1..=3 {
            assert_eq!(found(&wall(seed), &code, |_| ()).levels(), [[0, 0]], "seed {seed}");
        }
    }

    #[test]
    fn stripes_as_wide_as_a_whole_number_of_pixels_are_not_taken_for_finer_ones() {
        // Finest stripes of 3, 4 and 6 pixels, upright in the picture.
        let scales: [fn(f64, f64) -> [f64; 2]; 3] = [
            |x, y| [(x + 0.5) / 1.5 + 9.5, (y + 0.5) / 1.5 + 9.5],
            |x, y| [(x + 0.5) / 2.0 + 9.5, (y + 0.5) / 2.0 + 9.5],
            |x, y| [(x + 0.5) / 3.0 + 9.5, (y + 0.5) / 3.0 + 9.5],
        ];
        for (number, projector) in scales.into_iter().enumerate() {
            let scene = Scene { projector, shadow: |_, _| false, ..wall(4) };
            let found = found(&scene, &StripeCode::gray([160, 120]), |_| ());
            assert_eq!(
                (found.levels(), found.narrow.concat()),
                (vec![[0, 0]], vec![0; 2 * found.narrow.len()]),
                "{number}"
            );
        }
    }

    #[test]
    fn what_the_camera_does_not_resolve_is_found() {
        let code = StripeCode::gray([160, 120]);
        // Wide enough to leave nothing of stripes two pixels wide, and most of the light of those four pixels wide.
        let blurred = Scene { defocus: 1.6, ..wall(2) };
        assert_eq!(found(&blurred, &code, |_| ()).overall(), [1, 1]);
        assert!(found(&blurred, &code, |_| ()).share(Axis::Rows) > 0.9);
        // Six and three projector pixels to a camera pixel.
        let fine = Scene { projector: |x, y| [20.0 + 6.3 * x, 12.0 + 3.1 * y], ..wall(2) };
        assert_eq!(found(&fine, &StripeCode::gray([1024, 512]), |_| ()).at(40, 40), [2, 1]);
    }

    #[test]
    fn periods_that_the_camera_does_not_resolve_are_told() {
        type Projected = fn(f64, f64) -> [f64; 2];
        // Projector pixels to a camera pixel, of columns and rows, and periods in the picture.
        let scales: [(Projected, [Option<f64>; 2]); 3] = [
            (|x, y| [20.0 + 9.8 * x, 12.0 + 3.1 * y], [Some(16.0 / 9.8), None]),
            (|x, y| [20.0 + 6.2 * x, 12.0 + 10.5 * y], [None, Some(16.0 / 10.5)]),
            (|x, y| [20.0 + 2.0 * x, 12.0 + 2.0 * y], [None, None]),
        ];
        let code = StripeCode::phase([2048, 1536], 4, 16);
        for (projector, expected) in scales {
            let scene = Scene { projector, shadow: |_, _| false, ..wall(2) };
            let pictures = scene.pictures(&code);
            let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
            for (found, expected) in unresolved_periods(&code, &views, 12).into_iter().zip(expected) {
                assert_eq!(found.is_some(), expected.is_some(), "{found:?} for {expected:?}");
                let off = found.unwrap_or(0.0) - expected.unwrap_or(0.0);
                assert!(off.abs() < 0.4, "{found:?} for {expected:?}");
            }
        }
    }

    #[test]
    fn what_is_resolved_gives_coordinates_where_all_bits_give_none() {
        use super::super::{DecodeOptions, EdgeOptions, decode, edges};
        let code = StripeCode::gray([160, 120]);
        let scene = Scene { defocus: 1.6, ..wall(2) };
        let pictures = scene.pictures(&code);
        // Known pixels of those that are lit, and the median and 95th percentile of how far their columns are off.
        let judged = |dropped: [u32; 2]| {
            let coarse = code.without_finest(dropped);
            let kept = coarse.pictures();
            let all = code.pictures();
            let views: Vec<ImageView<'_>> = all
                .iter()
                .zip(&pictures)
                .filter(|it| kept.contains(it.0))
                .map(|it| ImageView::new(it.1, 160, 120).unwrap())
                .collect();
            let decoded = decode(&coarse, &views, &[Axis::Columns], &DecodeOptions::default()).unwrap();
            let found = edges::coordinates(&coarse, &views, &decoded, &EdgeOptions::default()).unwrap();
            let lit = decoded.contrast.iter().filter(|it| **it >= 12).count();
            let known = found.values[0].iter().enumerate().filter(|it| it.1.is_finite());
            let off = |(at, u): (usize, &f32)| {
                (f64::from(*u) - (scene.projector)((at % 160) as f64, (at / 160) as f64)[0]).abs()
            };
            let mut errors: Vec<f64> = known.map(off).collect();
            errors.sort_by(f64::total_cmp);
            let at = |share: f64| errors.get((share * errors.len() as f64) as usize).copied().unwrap_or(f64::NAN);
            (errors.len() as f64 / lit as f64, at(0.5), at(0.95))
        };
        let (all, coarse) = (judged([0, 0]), judged([1, 1]));
        assert!(all.0 < 0.6 && coarse.0 > 0.95, "{all:?} {coarse:?}");
        assert!(coarse.1 < 0.5 * all.1 && coarse.2 < 0.5 * all.2, "{all:?} {coarse:?}");
    }

    #[test]
    fn sharp_stripes_narrower_than_pixels_are_found_by_how_often_coarser_ones_change() {
        // By projector pixels to a camera pixel: bits that change from nearly every pixel to the next.
        for (ratio, expected) in [(0.6, 0), (1.4, 0), (2.6, 1), (3.3, 1), (5.8, 2)] {
            let scene = Scene {
                projector: match expected {
                    0 if ratio < 1.0 => |x, y| [300.0 + 0.6 * x + 0.1 * y, 250.0 + 0.6 * y - 0.1 * x],
                    0 => |x, y| [300.0 + 1.4 * x + 0.2 * y, 250.0 + 1.4 * y - 0.2 * x],
                    1 if ratio < 3.0 => |x, y| [300.0 + 2.6 * x + 0.3 * y, 150.0 + 2.6 * y - 0.3 * x],
                    1 => |x, y| [300.0 + 3.3 * x + 0.3 * y, 100.0 + 3.3 * y - 0.3 * x],
                    _ => |x, y| [20.0 + 5.8 * x + 0.4 * y, 60.0 + 5.8 * y - 0.4 * x],
                },
                defocus: 0.4,
                ..wall(3)
            };
            let code = StripeCode::gray([1024, 768]);
            let found = found(&scene, &code, |_| ());
            assert_eq!(found.overall(), [expected; 2], "{ratio} projector pixels");
            // Pictures in other places say nothing.
            let wrong = super::tests::found(&scene, &code, |it| it.swap(4, 18));
            assert!(wrong.overall()[0] <= expected, "{ratio}: {:?}", wrong.overall());
        }
    }

    #[test]
    fn blocks_that_cannot_be_decoded_are_tried_with_coarser_stripes() {
        let code = StripeCode::gray([160, 120]);
        // Stripes 1.4 pixels wide in the wall's picture; those of the other wall are 3.3 wide.
        let scene =
            Scene { projector: |x, y| [300.0 + 1.4 * x + 0.2 * y, 250.0 + 1.4 * y - 0.2 * x], defocus: 0.4, ..wall(1) };
        let fine = found(&scene, &StripeCode::gray([1024, 768]), |_| ());
        let wide = found(&wall(1), &code, |_| ());
        assert_eq!(wide.coarser_where([160, 120], [2, 2], |_, _| Some(true)), None);
        let open_left = |at: usize, axis: usize| Some(axis == 0 && at % 160 < 64 && at.is_multiple_of(3));
        let coarser = fine.coarser_where([160, 120], [2, 2], open_left).unwrap();
        assert_eq!((coarser.at(10, 10), coarser.at(100, 10), coarser.at(10, 100)), ([1, 0], [0, 0], [1, 0]));
        assert_eq!(coarser.coarser_where([160, 120], [1, 1], open_left), None);
        assert_eq!(fine.coarser_where([160, 120], [2, 2], |_, _| Some(false)), None);
        assert_eq!(fine.coarser_where([160, 120], [2, 2], |_, _| None), None);
    }

    #[test]
    fn light_over_other_surfaces_and_a_picture_that_is_another_are_not_taken_for_blur() {
        let code = StripeCode::gray([160, 120]);
        let corner = Scene { global: |_, _| 1.4, gain: 90.0, ..wall(2) };
        assert_eq!(found(&corner, &code, |_| ()).overall(), [0, 0]);
        // The finest inverse of the columns is its bit once more.
        let doubled = found(&wall(2), &code, |it| it[15] = it[14].clone());
        assert_eq!(doubled.overall(), [0, 0]);
    }
}
