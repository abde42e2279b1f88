//! Gray code: which stripe each camera pixel is lit by.
//!
//! For each bit a pixel is brighter in one of two pictures: with the stripes or with their inverse. The bit is *certain* where the two
//! differ by more than noise and by more than a part of what the projector makes of the pixel at all (white − black).
//!
//! - A pixel with one bit that is not certain is kept if both values of the bit are neighbouring stripes: it lies on their boundary, which [`super::edges`]
//!   places. Anything else that is not certain is left out.
//! - Let D be the light that comes straight from the projector and G what comes over other surfaces. Any bit's difference is ±D plus at most G, so
//!   signs are right where D > G. The finest stripes are too fine for G to follow: there the difference is ±D. A pixel whose largest difference in
//!   these is below half of white − black (= D + G) is left out.
//! - Without inverse pictures the stripe that all bits of an axis leave dark is left out, of both axes: a shadow that moved off before white was taken looks the same.
//! - White − black too small is shadow, a dark surface or somewhere that the projector does not reach. A saturated pixel has pictures that do not differ.

use super::code::{Axis, Shown, StripeCode};
use crate::{ImageView, ImagingError};

/// In [`Decoded::stripes`]: no stripe.
pub const NONE: u16 = u16::MAX;

/// Thresholds that a pixel must pass to be decoded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DecodeOptions {
    /// White − black, at least [gray levels].
    pub min_contrast: u8,
    /// Difference of the two pictures of a bit, at least: three standard deviations of a difference of two pixels of a camera with noise of one
    /// gray level, and rounding [gray levels].
    pub min_difference: u8,
    /// The same over white − black, at least [–].
    pub min_share: f64,
    /// Direct light over all light, at least; 0 takes pixels as they come [–].
    pub min_direct: f64,
    /// Threads.
    pub threads: usize,
}

impl Default for DecodeOptions {
    fn default() -> Self {
        Self { min_contrast: 12, min_difference: 5, min_share: 0.125, min_direct: 0.5, threads: 1 }
    }
}

impl DecodeOptions {
    fn check(&self) -> Result<(), ImagingError> {
        let share = "0 to 0.5";
        ImagingError::unless((0.0..=0.5).contains(&self.min_share), "min_share", share, self.min_share)?;
        ImagingError::unless((0.0..=1.0).contains(&self.min_direct), "min_direct", "0 to 1", self.min_direct)?;
        let threads = self.threads as f64;
        ImagingError::unless((1..=256).contains(&self.threads), "threads", "1 to 256", threads)
    }
}

/// The stripe that lights each camera pixel.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Decoded {
    /// Columns and rows of the camera's pictures [px].
    pub size: [usize; 2],
    /// By axis, row by row: number of the stripe, counted from that of projector column (row) 0 without its offset, or [`NONE`]; empty for an axis that was
    /// not decoded.
    pub stripes: [Vec<u16>; 2],
    /// By pixel: white − black [gray levels].
    pub contrast: Vec<u8>,
}

/// Pixels that are worked on at once: what is kept of them stays in the first cache.
const BLOCK: usize = 2048;
/// Bits that are taken in at once, so that what is kept of a pixel is fetched and put back once for all of them.
const AT_ONCE: usize = 4;
/// The finest bits, in which light over other surfaces is distinguished from direct light.
const FINEST: u32 = 3;

/// Decodes the `axes` of a set of pictures, which are in the order of `code`: the stripe of each camera pixel, by axis. For projector coordinates between
/// stripes continue with [`coordinates`](super::edges::coordinates).
///
/// ```
/// use foveate_imaging::ImageView;
/// use foveate_imaging::stripes::code::{Axis, StripeCode};
/// use foveate_imaging::stripes::gray::{DecodeOptions, decode};
/// use foveate_imaging::stripes::pattern::picture;
///
/// // A projector of 64 x 48 px on a gray wall; the camera sees projector column 63 - x in its column x.
/// let (code, [width, height]) = (StripeCode::gray([64, 48]), [64, 48]);
/// let captured = |pattern: Vec<u8>| -> Vec<u8> {
///     let seen = |at: usize| 10 + pattern[at / width * width + (width - 1 - at % width)] / 2;
///     (0..width * height).map(seen).collect()
/// };
/// let set: Vec<Vec<u8>> = code.pictures().into_iter().map(|it| captured(picture(&code, it, 1.0))).collect();
/// let views: Result<Vec<_>, _> = set.iter().map(|it| ImageView::new(it, width, height)).collect();
///
/// let decoded = decode(&code, &views?, &[Axis::Columns], &DecodeOptions::default())?;
/// let columns = &decoded.stripes[Axis::Columns.index()];
/// assert!((0..width * height).all(|at| usize::from(columns[at]) == width - 1 - at % width));
/// # Ok::<(), foveate_imaging::ImagingError>(())
/// ```
///
/// # Errors
/// A code that cannot be; another number of pictures; pictures of different sizes.
pub fn decode(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    axes: &[Axis],
    options: &DecodeOptions,
) -> Result<Decoded, ImagingError> {
    let mut decoded = Decoded::default();
    decode_into(code, pictures, axes, options, &mut decoded)?;
    Ok(decoded)
}

/// As [`decode`], into buffers that are used again.
///
/// # Errors
/// [`decode`]'s; `decoded` is then in no particular state.
pub fn decode_into(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    axes: &[Axis],
    options: &DecodeOptions,
    decoded: &mut Decoded,
) -> Result<(), ImagingError> {
    code.check()?;
    options.check()?;
    let size = same_size(code, pictures)?;
    let n = size[0] * size[1];
    let plan = Plan::new(code, pictures, axes, options);
    decoded.size = size;
    decoded.contrast.resize(n, 0);
    for axis in 0..2 {
        let is_told = plan.axes.iter().any(|it| it.index == axis);
        decoded.stripes[axis].resize(if is_told { n } else { 0 }, NONE);
    }
    let threads = options.threads.min(n.div_ceil(BLOCK)).max(1);
    let share = n.div_ceil(threads).div_ceil(BLOCK).max(1) * BLOCK;
    let [columns, rows] = &mut decoded.stripes;
    let mut parts: Vec<Part<'_>> = Vec::new();
    let (mut columns, mut rows) = (columns.chunks_mut(share), rows.chunks_mut(share));
    for (part, contrast) in decoded.contrast.chunks_mut(share).enumerate() {
        let stripes = [columns.next().unwrap_or_default(), rows.next().unwrap_or_default()];
        parts.push((part * share, contrast, stripes));
    }
    std::thread::scope(|scope| {
        let mut parts = parts.into_iter();
        let own = parts.next();
        for (start, contrast, stripes) in parts {
            let plan = &plan;
            scope.spawn(move || plan.run(start, contrast, stripes));
        }
        if let Some((start, contrast, stripes)) = own {
            plan.run(start, contrast, stripes);
        }
    });
    Ok(())
}

/// Some of the pixels: the first one, their contrasts, their stripes by axis.
type Part<'a> = (usize, &'a mut [u8], [&'a mut [u16]; 2]);

/// The size that all pictures of a set have.
///
/// # Errors
/// Another number of pictures than `code` has, or a picture of another size than the first.
pub(super) fn same_size(code: &StripeCode, pictures: &[ImageView<'_>]) -> Result<[usize; 2], ImagingError> {
    let expected = code.pictures().len();
    if pictures.len() != expected {
        return Err(ImagingError::WrongLength { what: "set of pictures", expected, found: pictures.len() });
    }
    let first = pictures[0].size();
    match pictures.iter().find(|it| it.size() != first) {
        Some(other) => Err(ImagingError::WrongSize { what: "picture", expected: first, found: other.size() }),
        None => Ok([first.0, first.1]),
    }
}

/// A bit's pictures: with its stripes, and with their inverse where there is one.
struct Bit<'a> {
    lit: &'a [u8],
    unlit: Option<&'a [u8]>,
    is_fine: bool,
}

struct AxisPlan<'a> {
    index: usize,
    bits: Vec<Bit<'a>>,
    /// Stripes that the projector has, and the number of its first one.
    n_stripes: u16,
    first: u16,
    /// Whether nothing tells a stripe that all bits leave dark from a place that the light did not reach.
    dark_is_none: bool,
}

/// Which picture is what.
struct Plan<'a> {
    white: Option<&'a [u8]>,
    black: Option<&'a [u8]>,
    axes: Vec<AxisPlan<'a>>,
    options: &'a DecodeOptions,
}

/// What is kept of a block of pixels.
struct Block {
    contrast: [u8; BLOCK],
    threshold: [u8; BLOCK],
    unlit: [[u8; BLOCK]; AT_ONCE],
    direct: [u8; BLOCK],
    bit: [u8; BLOCK],
    /// The upper and the lower eight bits of the stripe's number, and of where it is not certain.
    number: [[u8; BLOCK]; 2],
    open: [[u8; BLOCK]; 2],
    /// 1 where all bits of an axis are dark, and that is no stripe.
    dark: [u8; BLOCK],
}

impl<'a> Plan<'a> {
    fn new(code: &StripeCode, pictures: &[ImageView<'a>], axes: &[Axis], options: &'a DecodeOptions) -> Plan<'a> {
        let shown = code.pictures();
        let of = |what: Shown| shown.iter().position(|it| *it == what).map(|it| pictures[it].pixels());
        let axis = |axis: Axis| {
            let index = axis.index();
            let bits = code.bits[index];
            let bit = |plane: u32| {
                let lit = of(Shown::Bit { axis, plane, inverse: false })?;
                let unlit = of(Shown::Bit { axis, plane, inverse: true });
                Some(Bit { lit, unlit, is_fine: plane + FINEST >= bits })
            };
            let first = code.offset[index] / code.stripe[index];
            let last = (code.offset[index] + code.projector[index] - 1) / code.stripe[index];
            let bits: Vec<Bit<'_>> = (0..bits).filter_map(bit).collect();
            AxisPlan {
                index,
                dark_is_none: code.steps == 0 && bits.iter().all(|it| it.unlit.is_none()),
                bits,
                n_stripes: (last - first + 1) as u16,
                first: first as u16,
            }
        };
        let axes = Axis::BOTH.into_iter().filter(|it| code.has(*it) && axes.contains(it)).map(axis).collect();
        Plan { white: of(Shown::White), black: of(Shown::Black), axes, options }
    }

    fn run(&self, start: usize, contrast: &mut [u8], stripes: [&mut [u16]; 2]) {
        let zeros = [0; BLOCK];
        let mut block = Box::new(Block {
            contrast: zeros,
            threshold: zeros,
            unlit: [zeros; AT_ONCE],
            direct: zeros,
            bit: zeros,
            number: [zeros; 2],
            open: [zeros; 2],
            dark: zeros,
        });
        let blocks = contrast.chunks_mut(BLOCK).enumerate();
        for (index, contrast) in blocks {
            let (at, n) = (start + index * BLOCK, contrast.len());
            self.light(&mut block, at, n);
            contrast.copy_from_slice(&block.contrast[..n]);
            block.direct[..n].fill(0);
            block.dark[..n].fill(0);
            for axis in &self.axes {
                block.of_axis(axis, self, at, n);
                let out = &mut stripes[axis.index][index * BLOCK..][..n];
                block.finish(axis, out);
                if axis.dark_is_none {
                    block.mark_dark(n);
                }
            }
            let least = self.options.min_contrast;
            // Direct light is judged by the stripes of both axes, so last.
            let share = (self.options.min_direct * 256.0) as u16;
            for axis in &self.axes {
                let out = &mut stripes[axis.index][index * BLOCK..][..n];
                for ((out, contrast), direct) in out.iter_mut().zip(&block.contrast[..n]).zip(&block.direct[..n]) {
                    let is_direct = u16::from(*direct) << 8 >= share.wrapping_mul(u16::from(*contrast));
                    let good = is_direct & (*contrast >= least);
                    *out |= u16::from(!good).wrapping_neg();
                }
                if self.axes.iter().any(|it| it.dark_is_none) {
                    let dark = out.iter_mut().zip(&block.dark).filter(|it| *it.1 > 0);
                    dark.for_each(|it| *it.0 = NONE);
                }
            }
        }
    }

    /// White − black, and from which difference on a bit is certain.
    fn light(&self, block: &mut Block, at: usize, n: usize) {
        let contrast = &mut block.contrast[..n];
        match (self.white, self.black) {
            (Some(white), Some(black)) => {
                for ((to, white), black) in contrast.iter_mut().zip(&white[at..at + n]).zip(&black[at..at + n]) {
                    *to = white.saturating_sub(*black);
                }
            }
            _ => {
                contrast.fill(0);
                for bit in self.axes.iter().flat_map(|it| &it.bits) {
                    let Some(unlit) = bit.unlit else { continue };
                    for ((to, p), q) in contrast.iter_mut().zip(&bit.lit[at..at + n]).zip(&unlit[at..at + n]) {
                        *to = (*to).max(p.abs_diff(*q));
                    }
                }
            }
        }
        let (share, least) = ((self.options.min_share * 256.0) as u16, self.options.min_difference);
        for (to, contrast) in block.threshold[..n].iter_mut().zip(&block.contrast[..n]) {
            *to = ((u16::from(*contrast).wrapping_mul(share) >> 8) as u8).max(least);
        }
    }
}

impl Block {
    fn of_axis(&mut self, axis: &AxisPlan<'_>, plan: &Plan<'_>, at: usize, n: usize) {
        self.bit[..n].fill(0);
        let low = axis.bits.len().saturating_sub(8);
        let halves = [&axis.bits[..low], &axis.bits[low..]];
        for (half, bits) in halves.into_iter().enumerate() {
            self.number[half][..n].fill(0);
            self.open[half][..n].fill(0);
            for like in bits.chunk_by(|a, b| a.is_fine == b.is_fine) {
                for some in like.chunks(AT_ONCE) {
                    self.add(half, some, plan, at, n);
                }
            }
        }
    }

    /// Takes in up to [`AT_ONCE`] bits that are all among the finest or all not.
    fn add(&mut self, half: usize, bits: &[Bit<'_>], plan: &Plan<'_>, at: usize, n: usize) {
        for (unlit, bit) in self.unlit.iter_mut().zip(bits) {
            if let (None, Some(white), Some(black)) = (bit.unlit, plan.white, plan.black) {
                let both = white[at..at + n].iter().zip(&black[at..at + n]);
                for ((to, (white, black)), lit) in unlit[..n].iter_mut().zip(both).zip(&bit.lit[at..at + n]) {
                    let sum = i16::from(*white) + i16::from(*black) - i16::from(*lit);
                    *to = sum.clamp(0, 255) as u8;
                }
            }
        }
        let is_fine = bits[0].is_fine;
        let pairs: [[&[u8]; 2]; AT_ONCE] = std::array::from_fn(|it| match bits.get(it) {
            Some(bit) => [&bit.lit[at..at + n], bit.unlit.map_or(&self.unlit[it][..n], |unlit| &unlit[at..at + n])],
            None => [&[] as &[u8]; 2],
        });
        let pixels = Pixels {
            threshold: &self.threshold[..n],
            bit: &mut self.bit[..n],
            number: &mut self.number[half][..n],
            open: &mut self.open[half][..n],
            direct: &mut self.direct[..n],
        };
        match (bits.len(), is_fine) {
            (1, false) => pixels.add::<1, false>(&pairs),
            (2, false) => pixels.add::<2, false>(&pairs),
            (3, false) => pixels.add::<3, false>(&pairs),
            (_, false) => pixels.add::<AT_ONCE, false>(&pairs),
            (1, true) => pixels.add::<1, true>(&pairs),
            (2, true) => pixels.add::<2, true>(&pairs),
            (_, true) => pixels.add::<3, true>(&pairs),
        }
    }

    /// Marks pixels all of whose bits are dark.
    fn mark_dark(&mut self, n: usize) {
        let [high, low] = &self.number;
        for ((dark, high), low) in self.dark[..n].iter_mut().zip(high).zip(low) {
            *dark |= u8::from(high | low == 0);
        }
    }

    /// The stripes of the block, [`NONE`] where a bit is not certain and not one of two neighbours.
    fn finish(&self, axis: &AxisPlan<'_>, out: &mut [u16]) {
        let n = out.len();
        let (first, n_stripes) = (axis.first, axis.n_stripes);
        let number = self.number[0][..n].iter().zip(&self.number[1][..n]);
        let open = self.open[0][..n].iter().zip(&self.open[1][..n]);
        for ((out, (high, low)), (open_high, open_low)) in out.iter_mut().zip(number).zip(open) {
            let number = u16::from(*high) << 8 | u16::from(*low);
            let open = u16::from(*open_high) << 8 | u16::from(*open_low);
            // A bit of the Gray code turns all bits from there on: 0111 and 1000 are neighbours.
            let below = open.wrapping_sub(1);
            let is_one = open & below == 0;
            let tail = number & (open | below);
            let is_boundary = (tail == below) | (tail == open);
            let stripe = number.wrapping_sub(first);
            let good = ((open == 0) | (is_one & is_boundary)) & (stripe < n_stripes);
            *out = stripe | u16::from(!good).wrapping_neg();
        }
    }
}

struct Pixels<'b> {
    threshold: &'b [u8],
    bit: &'b mut [u8],
    number: &'b mut [u8],
    open: &'b mut [u8],
    direct: &'b mut [u8],
}

impl Pixels<'_> {
    /// Takes in the next `K` bits of all pixels, each by its picture and the inverse. Written for the compiler to do sixteen pixels or more at once.
    fn add<const K: usize, const FINE: bool>(self, pairs: &[[&[u8]; 2]; AT_ONCE]) {
        let n = self.threshold.len();
        let pairs: [[&[u8]; 2]; K] = std::array::from_fn(|it| pairs[it].map(|it| &it[..n]));
        let (threshold, bits) = (&self.threshold[..n], &mut self.bit[..n]);
        let (numbers, opens, directs) = (&mut self.number[..n], &mut self.open[..n], &mut self.direct[..n]);
        for at in 0..n {
            let (mut bit, mut number, mut open, mut direct) = (bits[at], numbers[at], opens[at], directs[at]);
            for [lit, unlit] in pairs {
                let over = lit[at].saturating_sub(unlit[at]);
                let difference = over | unlit[at].saturating_sub(lit[at]);
                bit ^= u8::from(over != 0);
                number = (number << 1) | bit;
                open = (open << 1) | u8::from(difference < threshold[at]);
                if FINE {
                    direct = direct.max(difference);
                }
            }
            (bits[at], numbers[at], opens[at]) = (bit, number, open);
            if FINE {
                directs[at] = direct;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::code::{Group, Inverse, StripeCode};
    use super::super::scene::{Scene, wall};
    use super::*;

    /// How many pixels carry a stripe of `axis`, of them how many one that the pixel does not touch.
    fn judged(scene: &Scene, code: &StripeCode, decoded: &Decoded, axis: Axis) -> (usize, usize) {
        let index = axis.index();
        let (mut found, mut wrong) = (0, 0);
        for (at, stripe) in decoded.stripes[index].iter().enumerate().filter(|it| *it.1 != NONE) {
            let (x, y) = ((at % scene.size[0]) as f64, (at / scene.size[0]) as f64);
            let coordinate = |dx: f64, dy: f64| (scene.projector)(x + dx, y + dy)[index];
            let corners = [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)].map(|it| coordinate(it.0, it.1));
            let low = corners.iter().fold(f64::INFINITY, |low, it| low.min(*it));
            let high = corners.iter().fold(f64::NEG_INFINITY, |high, it| high.max(*it));
            let width = f64::from(code.stripe[index]);
            let first = f64::from(code.offset[index] % code.stripe[index]);
            let begins = f64::from(*stripe) * width - first - 0.5;
            found += 1;
            // The stripes beside it, where defocus carries its light.
            wrong += usize::from(begins > high + 1.0 || begins + width < low - 1.0);
        }
        (found, wrong)
    }

    fn run(scene: &Scene, code: &StripeCode, options: &DecodeOptions) -> Decoded {
        let pictures = scene.pictures(code);
        let views: Vec<ImageView<'_>> =
            pictures.iter().map(|it| ImageView::new(it, scene.size[0], scene.size[1]).unwrap()).collect();
        decode(code, &views, &Axis::BOTH, options).unwrap()
    }

    /// Least share of pixels found and most pixels wrong over seeds.
    #[track_caller]
    fn check(make: impl Fn(u64) -> Scene, code: &StripeCode, least: f64, most_wrong: usize) {
        for seed in 1..=5 {
            let scene = make(seed);
            let decoded = run(&scene, code, &DecodeOptions::default());
            for axis in Axis::BOTH {
                let (found, wrong) = judged(&scene, code, &decoded, axis);
                let share = found as f64 / decoded.contrast.len() as f64;
                assert!(share >= least, "seed {seed}, {axis:?}: {share} of the pixels");
                assert!(wrong <= most_wrong, "seed {seed}, {axis:?}: {wrong} of {found} wrong");
            }
        }
    }

    #[test]
    fn every_pixel_of_a_wall_has_its_stripe_but_those_in_shadow() {
        check(wall, &StripeCode::gray([160, 120]), 0.93, 0);
        check(wall, &StripeCode::gray([160, 120]).with_bits([None, None], true), 0.93, 0);
        check(wall, &StripeCode { inverse: Inverse::None, ..StripeCode::gray([160, 120]) }, 0.9, 0);
        check(wall, &StripeCode { inverse: Inverse::Apart, fine_first: true, ..StripeCode::gray([160, 120]) }, 0.93, 0);
        let order = vec![Group::White, Group::Black, Group::Stripes(Axis::Rows), Group::Stripes(Axis::Columns)];
        check(wall, &StripeCode { order, inverse: Inverse::Before, ..StripeCode::gray([160, 120]) }, 0.93, 0);
        check(wall, &StripeCode::gray([160, 120]).with_bits([Some(6), Some(5)], false), 0.93, 0);
    }

    #[test]
    fn a_camera_with_a_gamma_sees_the_same_stripes() {
        check(|seed| Scene { gamma: 2.2, ..wall(seed) }, &StripeCode::gray([160, 120]), 0.93, 0);
    }

    /// The stripe of one pixel lit by `column` whose bit `plane` is not certain.
    fn with_open_bit(column: u32, plane: u32) -> u16 {
        let code = StripeCode {
            order: vec![Group::Stripes(Axis::Columns), Group::White, Group::Black],
            ..StripeCode::gray([256, 1])
        };
        let level = |shown: &Shown| match shown {
            Shown::Bit { plane: open, .. } if *open == plane => 100,
            it => super::super::pattern::picture(&code, *it, 1.0)[column as usize] / 2 + 40,
        };
        let pictures: Vec<[u8; 1]> = code.pictures().iter().map(|it| [level(it)]).collect();
        let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 1, 1).unwrap()).collect();
        decode(&code, &views, &[Axis::Columns], &DecodeOptions::default()).unwrap().stripes[0][0]
    }

    #[test]
    fn one_bit_that_is_not_certain_is_allowed_between_two_neighbours_alone() {
        // Between 63 and 64 bit 1 of 8 changes, between 127 and 128 bit 0.
        for (column, plane) in [(63, 1), (64, 1), (127, 0), (128, 0), (40, 4), (39, 4), (17, 7)] {
            let found = with_open_bit(column, plane);
            assert!(u32::from(found).abs_diff(column) <= 1, "{found} for {column}");
        }
        for (column, plane) in [(63, 0), (64, 2), (70, 1), (0, 1), (255, 3), (40, 5)] {
            assert_eq!(with_open_bit(column, plane), NONE, "column {column}, bit {plane}");
        }
    }

    #[test]
    fn a_shadow_that_moved_off_during_a_set_without_inverse_pictures_is_left_out() {
        let code = StripeCode { inverse: Inverse::None, ..StripeCode::gray([160, 120]) };
        let lit = Scene { shadow: |_, _| false, ..wall(3) };
        let shaded = wall(3).pictures(&code);
        // It moves off after the columns, after half of the rows too, and before the last picture.
        for moved in [8, 11, 15] {
            let mut pictures = lit.pictures(&code);
            pictures[..moved].clone_from_slice(&shaded[..moved]);
            let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
            let decoded = decode(&code, &views, &Axis::BOTH, &DecodeOptions::default()).unwrap();
            let inside = || (0..120).flat_map(|y| (87..90).map(move |x| y * 160 + x));
            let known = |axis: usize| inside().filter(|at| decoded.stripes[axis][*at] != NONE).count();
            assert_eq!([known(0), known(1)], [0, 0], "moved before picture {moved}");
        }
    }

    #[test]
    fn shadow_is_left_out() {
        let scene = wall(3);
        let decoded = run(&scene, &StripeCode::gray([160, 120]), &DecodeOptions::default());
        let inside = (0..120).flat_map(|y| (87..90).map(move |x| y * 160 + x));
        assert_eq!(inside.filter(|at| decoded.stripes[0][*at] != NONE).count(), 0);
    }

    #[test]
    fn light_over_other_surfaces_is_left_out_rather_than_decoded_wrong() {
        // A corner in which more comes over the other wall than straight.
        let scene = Scene { global: |x, _| if x < 40.0 { 2.5 } else { 0.05 }, gain: 60.0, ..wall(1) };
        let code = StripeCode::gray([160, 120]);
        let decoded = run(&scene, &code, &DecodeOptions::default());
        let lit = |at: &usize| decoded.stripes[0][*at] != NONE;
        let corner = (0..120 * 160).filter(|at| at % 160 < 40);
        assert_eq!(corner.filter(lit).count(), 0);
        assert!((0..120 * 160).filter(|at| at % 160 > 41).filter(lit).count() > 12_000);
        assert_eq!(judged(&scene, &code, &decoded, Axis::Columns).1, 0);
        // Without that rule some of it comes out wrong or right by chance.
        let lenient = DecodeOptions { min_direct: 0.0, min_share: 0.0, min_difference: 1, ..DecodeOptions::default() };
        assert!(
            run(&scene, &code, &lenient).stripes[0].iter().enumerate().any(|(at, it)| at % 160 < 40 && *it != NONE)
        );
    }

    #[test]
    fn saturated_pixels_are_left_out() {
        let scene = Scene { albedo: |x, _| if x < 50.0 { 25.0 } else { 0.7 }, ..wall(2) };
        let decoded = run(&scene, &StripeCode::gray([160, 120]), &DecodeOptions::default());
        assert_eq!((0..19_200).filter(|at| at % 160 < 49 && decoded.stripes[0][*at] != NONE).count(), 0);
    }

    #[test]
    fn any_number_of_threads_gives_the_same() {
        let (scene, code) = (wall(4), StripeCode::gray([160, 120]));
        let one = run(&scene, &code, &DecodeOptions::default());
        for threads in [2, 3, 64] {
            assert_eq!(run(&scene, &code, &DecodeOptions { threads, ..DecodeOptions::default() }), one);
        }
    }

    #[test]
    fn sets_that_are_none_are_refused() {
        let code = StripeCode::gray([16, 8]);
        let (small, large) = (vec![0; 12], vec![0; 20]);
        let view = |it: &'static [u8; 0]| ImageView::new(it, 0, 0).unwrap();
        let error = |views: &[ImageView<'_>]| decode(&code, views, &Axis::BOTH, &DecodeOptions::default()).unwrap_err();
        assert!(error(&[view(&[])]).to_string().contains("holds 1 elements"));
        let mut views = vec![ImageView::new(&small, 4, 3).unwrap(); code.pictures().len()];
        views[5] = ImageView::new(&large, 4, 5).unwrap();
        assert!(error(&views).to_string().contains("4x5 px where 4x3"));
        let bad = DecodeOptions { threads: 0, ..DecodeOptions::default() };
        assert!(decode(&code, &views, &Axis::BOTH, &bad).is_err());
    }
}
