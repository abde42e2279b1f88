//! Where boundaries of stripes pass between camera pixels, and how blurred they are.
//!
//! Two neighbouring camera pixels of neighbouring stripes have a boundary between them. It belongs to one bit of the Gray code, whose picture is brighter than its inverse on one side and darker on the other: the
//! boundary is where the difference, over white − black, passes through zero between the two. The projector coordinate of a boundary is known exactly. Where a level is cut off, the boundary may be anywhere from there to
//! the pixel that is brighter than it seems.

use super::super::code::{Axis, Shown, StripeCode};
use super::super::defocus::Defocus;
use super::super::gray::{Decoded, NONE, same_size};
use crate::{ImageView, ImagingError};

/// A boundary of two stripes in the camera's picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Boundary {
    /// Where it passes between two pixels, one of its coordinates being a whole number [px].
    pub x: f32,
    /// As above.
    pub y: f32,
    /// Projector column (row) of the boundary [px].
    pub at: f32,
    /// Standard deviation along the line of the two pixels, of what is different for each [px].
    pub sigma: f32,
    /// Standard deviation by levels that are cut off, alike for boundaries that lie alike between their pixels [px].
    pub cut_off: f32,
}

/// No boundary counts for more than one placed as well as this, however strong: what is between two pixels is not quite a straight line [px].
const BEST_SIGMA: f64 = 0.05;
/// Two pixels between which a boundary is placed differ in white − black by no more than this: on an edge of the surface's own colour they differ by more [–].
const MAX_RATIO: f64 = 1.5;
/// Blur of an edge from −1 to 1 times its slope: √(2 / π).
const OF_A_SLOPE: f64 = 0.797_884_560_802_865;
/// A gray level that may be cut off.
pub(super) const SATURATED: u8 = 250;
/// Every so many rows and columns boundaries tell how blurred they are; so many tell it.
const SAMPLED: usize = 4;
const MIN_BLURS: usize = 50;
/// Of how blurred they are those tell that are ends of stripes which are wider than the finest by so many powers of two.
const WIDE: u32 = 2;

/// The picture of a bit and its inverse.
type Pair<'a> = (&'a [u8], Option<&'a [u8]>);

/// What boundaries of one axis are placed by.
pub(super) struct Stripes<'a> {
    decoded: &'a Decoded,
    stripes: &'a [u16],
    /// By plane: the picture and its inverse, or twice the picture less white and black.
    pairs: Vec<Option<Pair<'a>>>,
    white: Option<&'a [u8]>,
    black: Option<&'a [u8]>,
    /// Boundaries before the first stripe of the code.
    first: u32,
}

/// A boundary between two neighbouring pixels.
struct Between {
    /// Which one, of the code.
    number: u32,
    /// How far from the first pixel to the second [px].
    part: f64,
    /// How much the difference of picture and inverse, over white − black, changes from one to the other [–].
    change: f64,
    /// Where a level is cut off, what is cut off leaves open where the boundary is: standard deviation [px].
    cut_off: f64,
}

impl<'a> Stripes<'a> {
    pub fn new(
        code: &StripeCode,
        pictures: &'a [ImageView<'_>],
        decoded: &'a Decoded,
        axis: Axis,
    ) -> Result<Stripes<'a>, ImagingError> {
        same_size(code, pictures)?;
        let index = axis.index();
        let shown = code.pictures();
        let picture = |what: Shown| shown.iter().position(|it| *it == what).map(|it| pictures[it].pixels());
        let pairs = (0..code.bits[index])
            .map(|plane| {
                let lit = picture(Shown::Bit { axis, plane, inverse: false })?;
                Some((lit, picture(Shown::Bit { axis, plane, inverse: true })))
            })
            .collect();
        Ok(Stripes {
            decoded,
            stripes: &decoded.stripes[index],
            pairs,
            white: picture(Shown::White),
            black: picture(Shown::Black),
            first: code.offset[index] / code.stripe[index],
        })
    }

    fn difference(&self, plane: usize, at: usize) -> f64 {
        let Some((lit, unlit)) = self.pairs[plane] else { return f64::NAN };
        let lit = f64::from(lit[at]);
        let difference = match (unlit, self.white, self.black) {
            (Some(unlit), ..) => lit - f64::from(unlit[at]),
            (None, Some(white), Some(black)) => 2.0 * lit - f64::from(white[at]) - f64::from(black[at]),
            (None, ..) => f64::NAN,
        };
        difference / f64::from(self.decoded.contrast[at].max(1))
    }

    /// Whether a level that tells the difference of a pixel is cut off: the difference is as large as it seems, or larger.
    fn is_cut_off(&self, plane: usize, at: usize) -> bool {
        let Some((lit, unlit)) = self.pairs[plane] else { return false };
        unlit.or(self.white).is_some_and(|it| it[at] >= SATURATED) || lit[at] >= SATURATED
    }

    /// Boundaries between two neighbouring pixels.
    fn between(&self, from: usize, to: usize) -> impl Iterator<Item = Between> {
        let (a, b) = (self.stripes[from], self.stripes[to]);
        let (contrast, other) = (self.decoded.contrast[from], self.decoded.contrast[to]);
        // Where bright meets dark each pixel is a mixture of both, and the boundary is not where the line says.
        let is_even = f64::from(contrast.max(other)) <= MAX_RATIO * f64::from(contrast.min(other));
        // Two boundaries between two pixels are of different bits, and each can be placed; more cannot be told from a step.
        let numbers = if is_even && a != NONE && b != NONE && a.abs_diff(b) <= 2 {
            u32::from(a.min(b)) + 1..u32::from(a.max(b)) + 1
        } else {
            0..0
        };
        numbers.filter_map(move |number| {
            let number = number + self.first;
            let plane = self.pairs.len().checked_sub(1 + number.trailing_zeros() as usize)?;
            let (before, after) = (self.difference(plane, from), self.difference(plane, to));
            let part = before / (before - after);
            // Anywhere from where it seems to the pixel that is brighter than it seems.
            let open = match [from, to].map(|it| self.is_cut_off(plane, it)) {
                [false, false] => 0.0,
                [true, false] => 1.0 - part,
                [false, true] => part,
                [true, true] => 1.0,
            };
            let cut_off = open / 12_f64.sqrt();
            (0.0..=1.0).contains(&part).then_some(Between { number, part, change: (before - after).abs(), cut_off })
        })
    }

    /// How far out of focus the camera is.
    pub fn defocus(&self, noise: f64) -> Defocus {
        let [width, height] = self.decoded.size;
        let mut blurred = Vec::new();
        for at in (0..height).step_by(SAMPLED).flat_map(|y| (0..width).step_by(SAMPLED).map(move |x| y * width + x)) {
            if at % width + 1 < width {
                blurred.extend(self.between(at, at + 1).map(|it| OF_A_SLOPE / it.change));
            }
            if at + width < width * height {
                blurred.extend(self.between(at, at + width).map(|it| OF_A_SLOPE / it.change));
            }
        }
        Defocus::of(&self.decoded.contrast, self.decoded.size, noise, blurred)
    }
}

/// How far out of focus the camera is, of a set of `pictures` as `code` says, by the stripes of `axis`; `noise`: of its gray levels, standard deviation.
///
/// # Errors
/// A set of pictures that is not as `code` says.
pub fn defocus(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    decoded: &Decoded,
    axis: Axis,
    noise: f64,
) -> Result<Defocus, ImagingError> {
    Ok(Stripes::new(code, pictures, decoded, axis)?.defocus(noise))
}

/// How blurred the boundaries of the stripes of `axis` are, by camera and projector together, on a set's pixels whose coordinates are `values`: of the sharper third of them, standard deviation [projector px]. `None` where too
/// few tell it.
///
/// # Errors
/// A set of pictures that is not as `code` says.
pub fn stripe_blur(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    decoded: &Decoded,
    axis: Axis,
    values: &[f32],
) -> Result<Option<f64>, ImagingError> {
    let all = Stripes::new(code, pictures, decoded, axis)?;
    let [width, height] = decoded.size;
    let mut blurs: Vec<f64> = Vec::new();
    for at in (0..height).step_by(SAMPLED).flat_map(|y| (0..width).step_by(SAMPLED).map(move |x| y * width + x)) {
        let beside = [(at % width + 1 < width, at + 1), (at + width < width * height, at + width)];
        for (_, other) in beside.into_iter().filter(|it| it.0) {
            let [from, to] = [at, other].map(|it| values.get(it).copied().unwrap_or(f32::NAN));
            let apart = f64::from((to - from).abs());
            // Beside the ends of narrow stripes the next ones take light off, too.
            let is_wide = |it: &Between| it.number.trailing_zeros() >= WIDE || code.steps > 0;
            let of_pair = all.between(at, other).filter(is_wide).map(|it| OF_A_SLOPE / it.change * apart);
            blurs.extend(of_pair.filter(|it| it.is_finite()));
        }
    }
    blurs.sort_by(f64::total_cmp);
    Ok(blurs.get(blurs.len() / 3).copied().filter(|_| blurs.len() >= MIN_BLURS))
}

/// All boundaries of the stripes of `axis`, row by row, in a row ascending by `x`; with, by row, where it begins, and the end.
///
/// # Errors
/// A set of pictures that is not as `code` says.
pub fn boundaries(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    decoded: &Decoded,
    axis: Axis,
    noise: f64,
) -> Result<(Vec<Boundary>, Vec<usize>), ImagingError> {
    let all = Stripes::new(code, pictures, decoded, axis)?;
    let defocus = all.defocus(noise);
    Ok(placed(&all, code, axis, noise, &defocus))
}

/// The boundaries, placed with what being out of focus draws them by.
pub(super) fn placed(
    all: &Stripes<'_>,
    code: &StripeCode,
    axis: Axis,
    noise: f64,
    defocus: &Defocus,
) -> (Vec<Boundary>, Vec<usize>) {
    let decoded = all.decoded;
    let [width, height] = decoded.size;
    let (stripe_width, offset) = (code.stripe[axis.index()], code.offset[axis.index()]);
    let (mut list, mut starts) = (Vec::new(), Vec::with_capacity(height + 1));
    let between = |from: usize, to: usize, down: bool, list: &mut Vec<Boundary>| {
        for Between { number, part, change, cut_off } in all.between(from, to) {
            let weakest = f64::from(decoded.contrast[from].min(decoded.contrast[to]).max(1));
            let along = noise * std::f64::consts::SQRT_2 / weakest * part.hypot(1.0 - part) / change;
            let place = [from % width, from / width];
            let line = if down { (height, width) } else { (width, 1) };
            let drawn = defocus.drawn(&decoded.contrast, from, place[usize::from(down)], line, OF_A_SLOPE / change);
            let (x, y) = (place[0] as f64, place[1] as f64);
            let (x, y) = if down { (x, y + part + drawn) } else { (x + part + drawn, y) };
            let at = f64::from(number * stripe_width) - 0.5 - f64::from(offset);
            list.push(Boundary {
                x: x as f32,
                y: y as f32,
                at: at as f32,
                sigma: along.hypot(BEST_SIGMA) as f32,
                cut_off: cut_off as f32,
            });
        }
    };
    for y in 0..height {
        starts.push(list.len());
        for x in 0..width {
            let at = y * width + x;
            if x + 1 < width {
                between(at, at + 1, false, &mut list);
            }
            if y + 1 < height {
                between(at, at + width, true, &mut list);
            }
        }
        let row = *starts.last().unwrap_or(&0);
        list[row..].sort_by(|a, b| a.x.total_cmp(&b.x));
    }
    starts.push(list.len());
    (list, starts)
}

#[cfg(test)]
mod tests {
    use super::super::super::gray::{DecodeOptions, decode};
    use super::super::super::scene::{Scene, wall};
    use super::super::{EdgeOptions, coordinates};
    use super::*;

    /// How blurred the stripes of both axes of a wall's set are found to be, the projector being out of focus by `defocus` [projector px].
    fn found(code: &StripeCode, defocus: f64, seed: u64) -> [Option<f64>; 2] {
        let pictures = Scene { defocus, ..wall(seed) }.pictures(code);
        let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
        let decoded = decode(code, &views, &Axis::BOTH, &DecodeOptions::default()).unwrap();
        let all = coordinates(code, &views, &decoded, &EdgeOptions::default()).unwrap();
        Axis::BOTH.map(|axis| stripe_blur(code, &views, &decoded, axis, &all.values[axis.index()]).unwrap())
    }

    #[test]
    fn stripes_are_as_blurred_as_the_projector_makes_them() {
        let code = StripeCode::gray([160, 120]);
        for seed in 41..=43 {
            // The sharper third of the boundaries: less than what the projector and two pixels of 0.6 of its own make on the whole.
            let parts = [0.45, 0.8, 1.2].map(|defocus: f64| {
                let expected = defocus.hypot(0.6 * (2.0_f64 / 12.0).sqrt());
                found(&code, defocus, seed).map(|it| it.unwrap() / expected)
            });
            let is_right = |it: &f64| (0.6..1.1).contains(it);
            assert!(parts.as_flattened().iter().all(is_right), "seed {seed}: {parts:?}");
        }
    }

    #[test]
    fn few_boundaries_say_nothing_of_their_blur() {
        let code = StripeCode::gray([160, 120]);
        let pictures = wall(44).pictures(&code);
        let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
        let decoded = decode(&code, &views, &Axis::BOTH, &DecodeOptions::default()).unwrap();
        let nothing = vec![f32::NAN; 160 * 120];
        assert_eq!(stripe_blur(&code, &views, &decoded, Axis::Columns, &nothing).unwrap(), None);
    }
}
