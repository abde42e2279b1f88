//! What is wrong with a set of pictures.
//!
//! What a Gray code promises is held against the pictures: a picture and its inverse make white and black together; white is the brightest and
//! black the darkest; no two pictures with stripes are alike; and where one bit changes, the next finer one is 1 and all finer ones are 0. A bit whose
//! pictures are exchanged breaks the last rule in one way, one that stands in another's place breaks it otherwise, and so does a frame that the
//! projector dropped. The coarsest bit alone can be exchanged unseen, unless columns come out that the projector does not have.

use super::code::{Axis, Shown, StripeCode};
use crate::ImageView;

/// Something that is wrong with a set of pictures. Pictures are numbered in their order, from 0.
#[derive(Debug, Clone, PartialEq)]
pub enum SetFault {
    /// Another number of pictures than the code has.
    Count {
        /// How many there are.
        found: usize,
        /// How many the code has.
        expected: usize,
        /// The first one that is not the inverse that stands before or after it.
        unpaired: Option<usize>,
    },
    /// A picture of another size than the first.
    Size {
        /// Which.
        picture: usize,
        /// Its columns and rows [px].
        found: (usize, usize),
        /// Those of the first [px].
        expected: (usize, usize),
    },
    /// Two pictures show the same stripes.
    Doubled {
        /// The later one.
        picture: usize,
        /// The earlier one.
        same_as: usize,
    },
    /// White is darker than black.
    WhiteIsBlack {
        /// The white picture.
        white: usize,
        /// The black one.
        black: usize,
    },
    /// White is not the brightest picture, or black not the darkest.
    NotWhite {
        /// Which.
        picture: usize,
        /// What it should show.
        shown: Shown,
        /// Part of the pixels in which another picture is clearly brighter (darker) [–].
        share: f64,
    },
    /// A picture and its inverse do not make white and black together.
    NotInverse {
        /// The bit.
        shown: Shown,
        /// Its picture and the inverse.
        pictures: [usize; 2],
        /// Part of the pixels in which they do not [–].
        share: f64,
    },
    /// Bits whose picture and inverse are exchanged.
    Inverted {
        /// Which axis.
        axis: Axis,
        /// Which bits.
        planes: Vec<u32>,
        /// Whether that is all that can be told.
        all: bool,
    },
    /// Bits that do not fit those before them.
    OutOfPlace {
        /// Which axis.
        axis: Axis,
        /// Which bits.
        planes: Vec<u32>,
    },
    /// Columns (rows) that the projector does not have.
    OutOfRange {
        /// Which axis.
        axis: Axis,
        /// Part of the pixels that show one [–].
        share: f64,
        /// How many the projector has [px].
        side: u32,
    },
    /// The projector hardly lights anything.
    TooDark {
        /// Part of the pixels that it lights [–].
        lit: f64,
        /// The 95th percentile of white − black [gray levels].
        contrast: u8,
        /// What is needed [gray levels].
        needed: u8,
    },
    /// Most of what the projector lights is saturated.
    TooBright {
        /// Part of the lit pixels that are [–].
        saturated: f64,
    },
}

impl SetFault {
    /// The axis that cannot be decoded, where it is one alone.
    pub fn axis(&self) -> Option<Axis> {
        match self {
            SetFault::NotInverse { shown: Shown::Bit { axis, .. }, .. }
            | SetFault::Inverted { axis, .. }
            | SetFault::OutOfPlace { axis, .. }
            | SetFault::OutOfRange { axis, .. } => Some(*axis),
            _ => None,
        }
    }

    /// Whether what can be decoded is sound all the same.
    pub fn is_remark(&self) -> bool {
        matches!(self, SetFault::Doubled { .. } | SetFault::TooBright { .. })
    }

    /// For people; `name` says how a picture is called.
    pub fn describe(&self, code: &StripeCode, name: &dyn Fn(usize) -> String) -> String {
        let bits = |axis: &Axis, planes: &[u32]| {
            let one = |plane: &u32| {
                let place = |inverse| code.place(Shown::Bit { axis: *axis, plane: *plane, inverse });
                let names: Vec<String> = [false, true].into_iter().filter_map(place).map(name).collect();
                format!("bit {plane} ({})", names.join(", "))
            };
            planes.iter().map(one).collect::<Vec<_>>().join(", ")
        };
        match self {
            SetFault::Count { found, expected, unpaired } => {
                let [columns, rows] = code.projector;
                let start = format!("found {found} pictures, expected {expected} of this code for {columns} x {rows}");
                match unpaired {
                    Some(at) => format!(
                        "{start}; {} is the first that is not the inverse of its neighbour: a picture is missing or doubled there",
                        name(*at)
                    ),
                    None => start,
                }
            }
            SetFault::Size { picture, found, expected } => {
                format!(
                    "{} is {} x {} px, expected {} x {} px as the first",
                    name(*picture),
                    found.0,
                    found.1,
                    expected.0,
                    expected.1
                )
            }
            SetFault::Doubled { picture, same_as } => {
                format!(
                    "{} shows the same stripes as {}, expected other ones: a frame was taken twice",
                    name(*picture),
                    name(*same_as)
                )
            }
            SetFault::WhiteIsBlack { white, black } => {
                format!(
                    "{} is darker than {}, expected white and black: are they exchanged?",
                    name(*white),
                    name(*black)
                )
            }
            SetFault::NotWhite { picture, shown, share } => {
                let than = if *shown == Shown::White { "brightest" } else { "darkest" };
                format!(
                    "{} is not the {than} picture in {:.0} % of the pixels, expected the {shown} one",
                    name(*picture),
                    100.0 * share
                )
            }
            SetFault::NotInverse { shown, pictures: [a, b], share } => format!(
                "{} and {} do not make white together in {:.0} % of the pixels, expected {shown} and its inverse",
                name(*a),
                name(*b),
                100.0 * share
            ),
            SetFault::Inverted { axis, planes, all } => {
                let which = bits(axis, planes);
                let help = if *all { ": do inverse pictures come first?" } else { "" };
                format!("{} of the {}: picture and inverse are exchanged{help}", which, axis.in_words())
            }
            SetFault::OutOfPlace { axis, planes } => {
                format!(
                    "{} of the {} fit no Gray code where they stand: pictures out of order, or a frame that was dropped",
                    bits(axis, planes),
                    axis.in_words()
                )
            }
            SetFault::OutOfRange { axis, share, side } => format!(
                "{:.0} % of the pixels show {} beyond the projector's {side}: another projector, offset or order, or the coarsest bit inverted",
                100.0 * share,
                axis.in_words()
            ),
            SetFault::TooDark { lit, contrast, needed } => format!(
                "the projector lights {:.1} % of the pixels, white - black being {contrast} gray levels at most, expected {needed} at least: too dark",
                100.0 * lit
            ),
            SetFault::TooBright { saturated } => {
                format!(
                    "{:.0} % of the lit pixels are saturated, expected less than half: too bright",
                    100.0 * saturated
                )
            }
        }
    }
}

/// What was found about a set.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Examination {
    /// All of it.
    pub faults: Vec<SetFault>,
    /// Part of the pixels that the projector lights [–].
    pub lit: f64,
}

impl Examination {
    /// The axes that can be decoded.
    pub fn usable(&self, code: &StripeCode) -> Vec<Axis> {
        let is_spoilt =
            |axis: Axis| self.faults.iter().any(|it| !it.is_remark() && it.axis().is_none_or(|other| other == axis));
        Axis::BOTH.into_iter().filter(|it| code.has(*it) && !is_spoilt(*it)).collect()
    }
}

/// Pixels that are looked at.
const SAMPLES: usize = 40_000;
/// Changes of a bit that say something.
const MIN_CHANGES: usize = 30;
/// A rule is broken in more than this part of the pixels [–].
const BROKEN: f64 = 0.3;
/// A gray level that is saturated.
const SATURATED: u8 = 254;
/// What noise takes off the darkest of many saturated pictures [gray levels].
const NOISE: u8 = 8;
/// Part of the picture that the projector has to light at least [–].
const MIN_LIT: f64 = 0.001;

/// Holds a set of pictures against what `code` promises; a pixel is lit where white − black is at least `min_contrast`.
pub fn examine(code: &StripeCode, pictures: &[ImageView<'_>], min_contrast: u8) -> Examination {
    let mut found = Examination::default();
    let shown = code.pictures();
    if let Some(at) = pictures.iter().position(|it| it.size() != pictures[0].size()) {
        let (size, expected) = (pictures[at].size(), pictures[0].size());
        found.faults.push(SetFault::Size { picture: at, found: size, expected });
        return found;
    }
    let Some(first) = pictures.first().filter(|it| !it.pixels().is_empty()) else {
        found.faults.push(SetFault::Count { found: 0, expected: shown.len(), unpaired: None });
        return found;
    };
    let (width, height) = first.size();
    // Two rows at a time, so that neighbours are there.
    let step = (2 * width * height).div_ceil(SAMPLES).clamp(2, height.max(2));
    let rows = (0..height).filter(|y| y % step < 2);
    let samples: Vec<usize> = rows.flat_map(|y| y * width..(y + 1) * width).collect();
    let range = |at: usize| {
        let levels = || pictures.iter().map(|it| it.pixels()[at]);
        (levels().min().unwrap_or(0), levels().max().unwrap_or(0))
    };
    let ranges: Vec<(u8, u8)> = samples.iter().map(|it| range(*it)).collect();
    let lit: Vec<(usize, u8, u8)> = samples
        .iter()
        .zip(&ranges)
        .filter(|(_, (low, high))| high - low >= min_contrast.max(1))
        .map(|(at, (low, high))| (*at, *low, *high))
        .collect();
    found.lit = lit.len() as f64 / samples.len() as f64;
    if found.lit < MIN_LIT {
        let mut contrasts: Vec<u8> = ranges.iter().map(|(low, high)| high - low).collect();
        contrasts.sort_unstable();
        let contrast = contrasts[contrasts.len() * 95 / 100];
        let saturated = ranges.iter().filter(|it| it.0 >= SATURATED - NOISE).count() as f64 / ranges.len() as f64;
        found.faults.push(match saturated > 0.5 {
            true => SetFault::TooBright { saturated },
            false => SetFault::TooDark { lit: found.lit, contrast, needed: min_contrast },
        });
        // Nothing can be decoded, whichever it is.
        if saturated > 0.5 {
            found.faults.push(SetFault::TooDark { lit: found.lit, contrast, needed: min_contrast });
        }
        return found;
    }
    let set = Set { code, pictures, shown: &shown, lit: &lit, width };
    if pictures.len() != shown.len() {
        let unpaired = set.first_unpaired();
        found.faults.push(SetFault::Count { found: pictures.len(), expected: shown.len(), unpaired });
        found.faults.extend(set.doubled());
        return found;
    }
    let saturated = lit.iter().filter(|it| it.2 >= SATURATED).count() as f64 / lit.len() as f64;
    if saturated > 0.5 {
        found.faults.push(SetFault::TooBright { saturated });
    }
    found.faults.extend(set.white_and_black());
    found.faults.extend(set.doubled());
    for axis in Axis::BOTH.into_iter().filter(|it| code.has(*it)) {
        let inverses = set.inverses(axis);
        if inverses.is_empty() {
            found.faults.extend(set.order(axis));
        }
        found.faults.extend(inverses);
    }
    found
}

struct Set<'a> {
    code: &'a StripeCode,
    pictures: &'a [ImageView<'a>],
    shown: &'a [Shown],
    /// Pixels that the projector lights, each with its darkest and brightest level.
    lit: &'a [(usize, u8, u8)],
    width: usize,
}

impl Set<'_> {
    fn level(&self, picture: usize, at: usize) -> f64 {
        f64::from(self.pictures[picture].pixels()[at])
    }

    fn share(&self, holds: impl Fn(&(usize, u8, u8)) -> bool) -> f64 {
        self.lit.iter().filter(|it| holds(it)).count() as f64 / self.lit.len().max(1) as f64
    }

    /// Part of the pixels in which two pictures do not make white and black together.
    fn not_inverse(&self, a: usize, b: usize) -> f64 {
        self.share(|&(at, low, high)| {
            let off = self.level(a, at) + self.level(b, at) - f64::from(low) - f64::from(high);
            off.abs() > (0.35 * f64::from(high - low)).max(8.0)
        })
    }

    /// The first picture that is not the inverse of the one it would be paired with.
    fn first_unpaired(&self) -> Option<usize> {
        let is_bit = |it: &Shown| matches!(it, Shown::Bit { .. });
        let mut at = 0;
        while at + 1 < self.shown.len() && at + 1 < self.pictures.len() {
            match (self.shown[at], self.shown[at + 1]) {
                (Shown::Bit { plane: a, axis: of_a, .. }, Shown::Bit { plane: b, axis: of_b, .. })
                    if a == b && of_a == of_b =>
                {
                    if self.not_inverse(at, at + 1) > BROKEN {
                        return Some(at);
                    }
                    at += 2;
                }
                _ if is_bit(&self.shown[at]) => return None,
                _ => at += 1,
            }
        }
        None
    }

    fn white_and_black(&self) -> Vec<SetFault> {
        let place = |what: Shown| self.shown.iter().position(|it| *it == what);
        let mean = |picture: usize| self.lit.iter().map(|it| self.level(picture, it.0)).sum::<f64>();
        let (white, black) = (place(Shown::White), place(Shown::Black));
        if let (Some(white), Some(black)) = (white, black)
            && mean(white) < mean(black)
        {
            return vec![SetFault::WhiteIsBlack { white, black }];
        }
        let margin = |low: u8, high: u8| (0.35 * f64::from(high - low)).max(8.0);
        let checks = [(white, Shown::White), (black, Shown::Black)];
        let one = |(picture, shown): (Option<usize>, Shown)| {
            let picture = picture?;
            let share = self.share(|&(at, low, high)| {
                let level = self.level(picture, at);
                let off = if shown == Shown::White { f64::from(high) - level } else { level - f64::from(low) };
                off > margin(low, high)
            });
            (share > BROKEN).then_some(SetFault::NotWhite { picture, shown, share })
        };
        checks.into_iter().filter_map(one).collect()
    }

    /// Pictures with stripes of which an earlier one is the same.
    fn doubled(&self) -> Vec<SetFault> {
        let some: Vec<&(usize, u8, u8)> = self.lit.iter().step_by(self.lit.len().div_ceil(4000).max(1)).collect();
        let is_lit =
            |picture: usize, it: &(usize, u8, u8)| 2.0 * self.level(picture, it.0) > f64::from(it.1) + f64::from(it.2);
        let signs: Vec<Vec<bool>> =
            (0..self.pictures.len()).map(|picture| some.iter().map(|it| is_lit(picture, it)).collect()).collect();
        // A picture that is nearly all lit, or nearly all dark, is like others by right.
        let has_stripes = |it: &Vec<bool>| {
            let lit = it.iter().filter(|it| **it).count() as f64 / it.len().max(1) as f64;
            (0.1..0.9).contains(&lit)
        };
        let mut faults = Vec::new();
        for b in 1..signs.len() {
            let like = (0..b).find(|a| {
                let differ = signs[*a].iter().zip(&signs[b]).filter(|(a, b)| a != b).count();
                has_stripes(&signs[b]) && (differ as f64) < 0.03 * some.len() as f64
            });
            faults.extend(like.map(|same_as| SetFault::Doubled { picture: b, same_as }));
        }
        faults
    }

    fn inverses(&self, axis: Axis) -> Vec<SetFault> {
        let one = |plane: u32| {
            let shown = Shown::Bit { axis, plane, inverse: false };
            let inverse = Shown::Bit { axis, plane, inverse: true };
            let place = |what: Shown| self.shown.iter().position(|it| *it == what);
            let pictures = [place(shown)?, place(inverse)?];
            let share = self.not_inverse(pictures[0], pictures[1]);
            (share > BROKEN).then_some(SetFault::NotInverse { shown, pictures, share })
        };
        (0..self.code.bits[axis.index()]).filter_map(one).collect()
    }

    /// What the changes of coarser bits say about finer ones, and stripes that cannot be.
    fn order(&self, axis: Axis) -> Vec<SetFault> {
        let bits = self.code.bits[axis.index()] as usize;
        let place = |plane: usize, inverse: bool| {
            let what = Shown::Bit { axis, plane: plane as u32, inverse };
            self.shown.iter().position(|it| *it == what)
        };
        let places: Vec<Option<(usize, Option<usize>)>> =
            (0..bits).map(|it| Some((place(it, false)?, place(it, true)))).collect();
        // By pixel: the bits, and those that are certain.
        let read = |&(at, low, high): &(usize, u8, u8)| {
            let (mut ones, mut certain) = (0_u32, 0_u32);
            for (plane, place) in places.iter().enumerate() {
                let Some((lit, unlit)) = *place else { continue };
                let sum = f64::from(low) + f64::from(high);
                let other = unlit.map_or(sum - self.level(lit, at), |it| self.level(it, at));
                let difference = self.level(lit, at) - other;
                ones |= u32::from(difference > 0.0) << plane;
                certain |= u32::from(difference.abs() >= (0.25 * f64::from(high - low)).max(5.0)) << plane;
            }
            (at, ones, certain)
        };
        let pixels: Vec<(usize, u32, u32)> = self.lit.iter().map(read).collect();
        // By bit: how often it is as it should be and as it should not where a coarser one changes.
        let mut right = vec![[0_usize; 2]; bits];
        let mut compare = |ones: u32, other: u32, certain: u32| {
            let changed = (ones ^ other) & certain;
            if changed.count_ones() != 1 {
                return;
            }
            let plane = changed.trailing_zeros() as usize;
            for (finer, counts) in right.iter_mut().enumerate().skip(plane + 1) {
                if certain & (1 << finer) != 0 {
                    let should = finer == plane + 1;
                    counts[usize::from((ones >> finer & 1 == 1) == should)] += 1;
                }
            }
        };
        for (index, (at, ones, certain)) in pixels.iter().enumerate() {
            let to_the_right = pixels.get(index + 1).filter(|it| it.0 == at + 1 && it.0 % self.width != 0);
            let below = pixels.binary_search_by_key(&(at + self.width), |it| it.0).ok().map(|it| &pixels[it]);
            for (_, other, also) in to_the_right.into_iter().chain(below) {
                compare(*ones, *other, certain & also);
            }
        }
        let judge = |counts: &[usize; 2]| {
            let all = counts[0] + counts[1];
            (all >= MIN_CHANGES).then(|| counts[1] as f64 / all as f64)
        };
        let rates: Vec<Option<f64>> = right.iter().map(judge).collect();
        let with = |test: fn(f64) -> bool| -> Vec<u32> {
            let planes = rates.iter().zip(0..).filter(|(rate, _)| rate.is_some_and(test));
            planes.map(|it| it.1).collect()
        };
        let (inverted, lost) = (with(|it| it < 0.25), with(|it| (0.25..0.75).contains(&it)));
        let mut faults = Vec::new();
        if !lost.is_empty() {
            faults.push(SetFault::OutOfPlace { axis, planes: lost });
        }
        if !inverted.is_empty() {
            let all = inverted.len() == rates.iter().flatten().count();
            faults.push(SetFault::Inverted { axis, planes: inverted, all });
        }
        if faults.is_empty() {
            faults.extend(self.range(axis, bits, &pixels));
        }
        faults
    }

    fn range(&self, axis: Axis, bits: usize, pixels: &[(usize, u32, u32)]) -> Option<SetFault> {
        let index = axis.index();
        let width = self.code.stripe[index];
        let from = self.code.offset[index];
        let until = from + self.code.projector[index];
        let all = (1_u32 << bits) - 1;
        let (mut beyond, mut certain) = (0_usize, 0_usize);
        for (_, ones, _) in pixels.iter().filter(|it| it.2 & all == all) {
            let (mut bit, mut number) = (0, 0);
            for plane in 0..bits {
                bit ^= ones >> plane & 1;
                number = number << 1 | bit;
            }
            certain += 1;
            beyond += usize::from((number + 1) * width <= from || number * width >= until);
        }
        let share = beyond as f64 / certain.max(1) as f64;
        (certain > MIN_CHANGES && share > 0.2).then(|| SetFault::OutOfRange {
            axis,
            share,
            side: self.code.projector[index],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::code::{Group, Inverse};
    use super::super::scene::{Scene, wall};
    use super::*;

    const MIN_CONTRAST: u8 = 12;

    fn code() -> StripeCode {
        StripeCode::gray([160, 120])
    }

    fn examined(code: &StripeCode, pictures: &[Vec<u8>]) -> Examination {
        let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
        examine(code, &views, MIN_CONTRAST)
    }

    /// The faults of the wall's pictures after `change`, in words, and the axes that are left.
    #[track_caller]
    fn check(change: impl Fn(&mut Vec<Vec<u8>>), expected: &[&str], usable: &[Axis]) {
        for seed in 1..=3 {
            let mut pictures = wall(seed).pictures(&code());
            change(&mut pictures);
            let found = examined(&code(), &pictures);
            let words: Vec<String> =
                found.faults.iter().map(|it| it.describe(&code(), &|at| format!("`{at}.png`"))).collect();
            assert_eq!(words.len(), expected.len(), "seed {seed}: {words:#?}");
            for (words, expected) in words.iter().zip(expected) {
                assert!(words.contains(expected), "seed {seed}: {words} lacks {expected}");
            }
            assert_eq!(found.usable(&code()), usable, "seed {seed}: {words:?}");
        }
    }

    #[test]
    fn good_sets_are_good() {
        check(|_| (), &[], &Axis::BOTH);
        for inverse in [Inverse::Before, Inverse::Apart, Inverse::None] {
            let order = vec![Group::Black, Group::White, Group::Stripes(Axis::Rows), Group::Stripes(Axis::Columns)];
            let code = StripeCode { inverse, order, fine_first: true, ..code() }.with_bits([None, None], true);
            let found = examined(&code, &wall(1).pictures(&code));
            assert_eq!(found.faults, [], "{inverse:?}");
        }
        let glossy = Scene { gamma: 2.2, global: |_, _| 0.2, defocus: 0.7, ..wall(2) };
        assert_eq!(examined(&code(), &glossy.pictures(&code())).faults, []);
    }

    #[test]
    fn a_missing_picture_is_named() {
        check(
            |it| drop(it.remove(7)),
            &["found 31 pictures, expected 32 of this code for 160 x 120; `6.png` is the first"],
            &[],
        );
    }

    #[test]
    fn a_doubled_picture_is_named_and_the_other_axis_kept() {
        check(
            |it| it[9] = it[8].clone(),
            &["`9.png` shows the same stripes as `8.png`", "`8.png` and `9.png` do not make white together"],
            &[Axis::Rows],
        );
    }

    #[test]
    fn an_exchanged_pair_is_named_and_the_other_axis_kept() {
        check(|it| it.swap(6, 7), &["bit 3 (`6.png`, `7.png`) of the columns: picture and inverse"], &[Axis::Rows]);
    }

    #[test]
    fn inverse_first_is_told() {
        let swap_all = |it: &mut Vec<Vec<u8>>| (0..15).for_each(|pair| it.swap(2 * pair, 2 * pair + 1));
        check(swap_all, &["do inverse pictures come first?", "do inverse pictures come first?"], &[]);
    }

    #[test]
    fn bits_in_another_order_are_named() {
        let exchange = |it: &mut Vec<Vec<u8>>| {
            it.swap(4, 10);
            it.swap(5, 11);
        };
        check(exchange, &["of the columns fit no Gray code where they stand"], &[Axis::Rows]);
    }

    #[test]
    fn a_dropped_frame_is_named() {
        // From picture 11 on, each is the one before.
        let drop_frame = |it: &mut Vec<Vec<u8>>| {
            let again = it[10].clone();
            it.insert(11, again);
            it.pop();
        };
        let mut pictures = wall(1).pictures(&code());
        drop_frame(&mut pictures);
        let found = examined(&code(), &pictures);
        assert!(found.faults.contains(&SetFault::Doubled { picture: 11, same_as: 10 }), "{:?}", found.faults);
        assert_eq!(found.usable(&code()), []);
    }

    #[test]
    fn white_and_black_exchanged_are_told() {
        check(|it| it.swap(30, 31), &["`30.png` is darker than `31.png`"], &[]);
    }

    #[test]
    fn a_picture_of_another_size_is_named() {
        let pictures = wall(1).pictures(&code());
        let mut views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
        views[3] = ImageView::new(&pictures[3], 120, 160).unwrap();
        let found = examine(&code(), &views, MIN_CONTRAST);
        assert_eq!(found.faults, [SetFault::Size { picture: 3, found: (120, 160), expected: (160, 120) }]);
    }

    #[test]
    fn dark_and_bright_scenes_are_told() {
        let faults = |scene: Scene| {
            let found = examined(&code(), &scene.pictures(&code()));
            let words: Vec<String> = found.faults.iter().map(|it| it.describe(&code(), &|at| at.to_string())).collect();
            words.join("; ")
        };
        assert!(faults(Scene { gain: 3.0, ..wall(1) }).contains("too dark"));
        assert!(faults(Scene { gain: 900.0, ..wall(1) }).contains("too bright"));
        assert!(faults(Scene { ambient: 2000.0, ..wall(1) }).contains("too bright"));
    }

    #[test]
    fn rows_taken_for_columns_are_told() {
        // 160 columns need eight bits and 120 rows seven; with eight bits each, 160 columns do not fit 120 rows.
        let right = code().with_bits([Some(8), Some(8)], false);
        let order = vec![Group::Stripes(Axis::Rows), Group::Stripes(Axis::Columns), Group::White, Group::Black];
        let wrong = StripeCode { order, projector: [160, 60], ..right.clone() }.with_bits([Some(8), Some(8)], false);
        let found = examined(&wrong, &wall(1).pictures(&right));
        let of_rows = |it: &SetFault| {
            matches!(
                it,
                SetFault::OutOfRange { axis: Axis::Rows, .. } | SetFault::OutOfPlace { .. } | SetFault::Inverted { .. }
            )
        };
        assert!(found.faults.iter().any(of_rows), "{:?}", found.faults);
    }
}
