//! Which pixels of a set are examined, how bright and dark they are, and the fault where none is lit.

use super::super::code::{Axis, Inverse, StripeCode};
use super::super::faults::SetFault;
use super::{Examination, FEWEST, SATURATED};
use crate::ImageView;

/// A set whose brightest pictures are below this nearly all over is dark [gray levels].
const DARK: u8 = 40;
/// Pictures that may be brighter or darker than they should be without changing what is taken for bright and dark.
const WILD: usize = 2;
/// What noise takes off the darkest of many saturated pictures [gray levels].
const NOISE: u8 = 8;

/// How far into each of many stretches of `step` places one is taken: evenly spread, and in step with no stripes, as places that are equally far apart are where a camera sees a projector pixel for pixel. Multiples of the golden
/// ratio's fraction are.
pub(super) fn aside(number: usize, step: usize) -> usize {
    const GOLDEN: f64 = 0.618_033_988_749_895;
    ((number as f64 * GOLDEN).fract() * step as f64) as usize
}

/// Some of the pixels, `n` or so, two rows at a time, so that neighbours are there.
pub(super) fn sampled((width, height): (usize, usize), n: usize) -> Vec<usize> {
    let step = (2 * width * height).div_ceil(n).clamp(2, height.max(2));
    let first = |number: usize| number * step + aside(number, step - 1);
    let rows = (0..height.div_ceil(step)).flat_map(|it| [first(it), first(it) + 1]).filter(|it| *it < height);
    rows.flat_map(|y| y * width..(y + 1) * width).collect()
}

/// Pixels `step` apart or so, in step with no stripes.
pub(super) fn spread((width, height): (usize, usize), step: usize) -> Vec<usize> {
    let row = |number: usize| {
        let y = number * step + aside(number, step);
        (0..width.div_ceil(step)).map(move |it| [it * step + aside(it + number, step), y])
    };
    let all = (0..height.div_ceil(step)).flat_map(row).filter(|[x, y]| *x < width && *y < height);
    all.map(|[x, y]| y * width + x).collect()
}

/// Pixels of some whole rows and columns: every boundary between stripes crosses some of them, whichever way it runs.
pub(super) fn lattice((width, height): (usize, usize), n: usize) -> Vec<usize> {
    let step = (2 * width * height).div_ceil(n).max(1);
    let row =
        |y: usize| (0..width).filter(move |x| y % step == step / 2 || x % step == step / 2).map(move |x| y * width + x);
    (0..height).flat_map(row).collect()
}

/// Of pixels with their darkest and brightest levels those that are lit by `least` or more [gray levels].
pub(super) fn lit_of(samples: &[usize], ranges: &[(u8, u8)], least: f64) -> Vec<(usize, u8, u8)> {
    let both = samples.iter().zip(ranges).filter(|(_, (low, high))| f64::from(high - low) >= least);
    both.map(|(at, (low, high))| (*at, *low, *high)).collect()
}

/// Bright and dark of pixels, whatever a few wild pictures show.
pub(super) struct Wild<'a> {
    present: &'a [usize],
    n: usize,
}

impl<'a> Wild<'a> {
    pub fn of(code: &StripeCode, present: &'a [usize]) -> Wild<'a> {
        // Of a bit and its inverse one is bright; without inverse pictures a pixel may be bright in white and one bit alone.
        let n_pairs: u32 = Axis::BOTH.into_iter().filter(|it| code.has(*it)).map(|it| code.bits[it.index()]).sum();
        let n = if code.inverse == Inverse::None { 1 } else { WILD.min(n_pairs as usize / 2) };
        Wild { present, n: n.min(present.len().saturating_sub(1) / 2) }
    }

    pub fn ranges(&self, pictures: &[ImageView<'_>], samples: &[usize]) -> Vec<(u8, u8)> {
        let mut levels: Vec<u8> = Vec::new();
        let one = |at: &usize| {
            levels.clear();
            levels.extend(self.present.iter().map(|it| pictures[*it].pixels()[*at]));
            levels.sort_unstable();
            (levels[self.n], levels[levels.len() - 1 - self.n])
        };
        samples.iter().map(one).collect()
    }
}

/// Why nothing is lit in a set of `found` pictures, of which `n_read` could be read, with the darkest and brightest of some pixels.
pub(super) fn unlit(
    code: &StripeCode,
    found: &Examination,
    n_pictures: usize,
    n_read: usize,
    ranges: &[(u8, u8)],
    needed: u8,
) -> Vec<SetFault> {
    let expected = code.pictures().len();
    let mut faults = Vec::new();
    if n_pictures != expected || n_read < FEWEST {
        faults.push(SetFault::Count { found: n_read, expected, unpaired: None, is_explained: false });
    }
    // Pictures alone or two of them say nothing about light.
    if n_read < FEWEST {
        return faults;
    }
    let percentile = |mut list: Vec<u8>| {
        list.sort_unstable();
        list[list.len() * 95 / 100]
    };
    let contrast = percentile(ranges.iter().map(|(low, high)| high - low).collect());
    let level = percentile(ranges.iter().map(|it| it.1).collect());
    let saturated = ranges.iter().filter(|it| it.0 >= SATURATED - NOISE).count() as f64 / ranges.len() as f64;
    faults.push(if saturated > 0.5 {
        SetFault::Alike { level, contrast, noise: found.noise, saturated }
    } else if level < DARK {
        SetFault::TooDark { lit: found.lit, contrast, needed }
    } else {
        SetFault::Alike { level, contrast, noise: found.noise, saturated: 0.0 }
    });
    faults
}
