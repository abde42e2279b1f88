//! Compares the pictures of a set with the rules of a Gray code.

use std::collections::BTreeMap;

use super::super::code::{Axis, Inverse, Shown, StripeCode};
use super::super::faults::{Found, SetFault};
use super::super::identify::Samples;
use super::super::stretches;
use super::super::wave_steps;
use super::{
    ALIKE, BEYOND, BROKEN, CLEARLY, FAR, MIN_CHANGES, MOST_CHANGES, NO_WAVE, NOISE_SUM, OTHER_EXPOSURE, REACH,
    SATURATED,
};
use crate::ImageView;

/// Of exchanges of phase steps that waves do not tell apart, the stripes agree with the right one, and with others less by this factor [–].
const AGREES_LESS: f64 = 0.85;

/// A bit's picture is all bright (dark) that is not in less than this part of the pixels [–].
const NO_STRIPES: f64 = 0.05;
/// Coarser bits say what this part of the pixels and more have of them [–].
const SOME_STRIPES: f64 = 0.02;
/// A pixel: its place, its bits, and those of them that are certain.
type Read = (usize, u32, u32);

pub(super) struct Set<'a> {
    pub(super) code: &'a StripeCode,
    pub(super) pictures: &'a [ImageView<'a>],
    pub(super) shown: &'a [Shown],
    /// Pixels that the projector lights, each with its darkest and brightest level.
    pub(super) lit: &'a [(usize, u8, u8)],
    pub(super) width: usize,
    pub(super) noise: f64,
    /// Pictures that say nothing.
    pub(super) skipped: Vec<usize>,
}

impl Set<'_> {
    /// Columns and rows of a picture [px].
    pub(super) fn size(&self) -> [f64; 2] {
        let rows = self.pictures.first().map_or(0, |it| it.height());
        [self.width, rows].map(|it| it as f64)
    }

    pub(super) fn level(&self, picture: usize, at: usize) -> f64 {
        f64::from(self.pictures[picture].pixels()[at])
    }

    fn share(&self, holds: impl Fn(&(usize, u8, u8)) -> bool) -> f64 {
        self.lit.iter().filter(|it| holds(it)).count() as f64 / self.lit.len().max(1) as f64
    }

    fn margin(&self, low: u8, high: u8) -> f64 {
        (0.35 * f64::from(high - low)).max(8.0).max(NOISE_SUM * self.noise)
    }

    fn place(&self, what: Shown) -> Option<usize> {
        self.shown.iter().position(|it| *it == what).filter(|it| !self.skipped.contains(it))
    }

    /// Part of the pixels in which two pictures do not make white and black together.
    pub(super) fn not_inverse(&self, a: usize, b: usize) -> f64 {
        // What is cut off adds up to nothing, most of all in stripes that are out of focus.
        let whole = self.lit.iter().filter(|it| it.2 < SATURATED);
        let n = whole.clone().count();
        if n < self.lit.len() / 20 {
            return 0.0;
        }
        let off = whole.filter(|(at, low, high)| {
            let off = self.level(a, *at) + self.level(b, *at) - f64::from(*low) - f64::from(*high);
            off.abs() > self.margin(*low, *high)
        });
        off.count() as f64 / n.max(1) as f64
    }

    /// Pictures whose gray levels are those of a negative or of another exposure, in a set with all its pictures.
    pub(super) fn odd(&self) -> Vec<(usize, SetFault)> {
        let mut found = Vec::new();
        for (picture, shown) in self.shown.iter().enumerate().filter(|it| !self.skipped.contains(&it.0)) {
            if self.is_negative(picture) || *shown == Shown::White && self.likeness(picture) < -0.5 {
                found.push((picture, SetFault::Negative { picture, shown: *shown, mended: false }));
                continue;
            }
            if let Some(factor) = self.exposure(picture, *shown) {
                found.push((picture, SetFault::Exposed { picture, shown: *shown, factor }));
            }
        }
        let flat = self.bits_without_stripes().into_iter().chain(self.steps_without_a_wave());
        let flat: Vec<(usize, SetFault)> = flat.filter(|it| !found.iter().any(|named| named.0 == it.0)).collect();
        found.extend(flat);
        found
    }

    /// Whether the gray levels of a picture are beyond dark and bright, and those of its negative are not.
    pub(super) fn is_negative(&self, picture: usize) -> bool {
        let beyond = |level: f64, low: u8, high: u8| {
            let margin = self.margin(low, high);
            !(f64::from(low) - margin..=f64::from(high) + margin).contains(&level)
        };
        self.share(|&(at, low, high)| beyond(self.level(picture, at), low, high)) > BROKEN
            && self.share(|&(at, low, high)| beyond(255.0 - self.level(picture, at), low, high)) < 0.5 * BROKEN
    }

    /// Bits that are all bright or all dark and cannot be, in a set without inverse pictures: with these, pairs tell it. Where a coarser bit changes, the next finer one is 1; and where it changes twice, there is all
    /// that lies between.
    fn bits_without_stripes(&self) -> Vec<(usize, SetFault)> {
        if self.code.inverse != Inverse::None {
            return Vec::new();
        }
        let of_axis = |axis: Axis| {
            let mut faults = Vec::new();
            // What the coarser bits say of each pixel.
            let (mut words, mut n_words) = (vec![0_u32; self.lit.len()], 0);
            for plane in 0..self.code.bits[axis.index()] {
                let expected = Shown::Bit { axis, plane, inverse: false };
                let Some(picture) = self.place(expected).filter(|it| !self.skipped.contains(it)) else { continue };
                let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
                words.iter().for_each(|it| *counts.entry(*it).or_default() += 1);
                let n_common = counts.values().filter(|it| **it as f64 > SOME_STRIPES * words.len() as f64).count();
                // Of finer bits words are too many for each to be common.
                n_words = n_words.max(n_common);
                let is_flat = |shown| self.not_flat(picture, shown) < NO_STRIPES;
                let shows = match n_words {
                    0 | 1 => None,
                    2 => Some(Shown::Black).filter(|it| is_flat(*it)),
                    _ => [Shown::White, Shown::Black].into_iter().find(|it| is_flat(*it)),
                };
                if let Some(shows) = shows {
                    faults.push((picture, SetFault::Shows { picture, found: Found::Shown(shows), expected }));
                    continue;
                }
                for (word, (at, low, high)) in words.iter_mut().zip(self.lit) {
                    let is_lit = 2.0 * self.level(picture, *at) > f64::from(*low) + f64::from(*high);
                    *word = *word << 1 | u32::from(is_lit);
                }
            }
            faults
        };
        Axis::BOTH.into_iter().filter(|it| self.code.has(*it)).flat_map(of_axis).collect()
    }

    /// Phase steps that are all bright or all dark, where most are not.
    fn steps_without_a_wave(&self) -> Vec<(usize, SetFault)> {
        let steps = self.shown.iter().enumerate().filter(|it| matches!(it.1, Shown::Phase { .. }));
        let steps: Vec<(usize, Shown)> =
            steps.filter(|it| !self.skipped.contains(&it.0)).map(|it| (it.0, *it.1)).collect();
        let flat = steps.iter().filter_map(|(picture, expected)| {
            let shows = [Shown::White, Shown::Black].into_iter().find(|it| self.not_flat(*picture, *it) < NO_WAVE)?;
            let found = Found::Shown(shows);
            Some((*picture, SetFault::Shows { picture: *picture, found, expected: *expected }))
        });
        let flat: Vec<(usize, SetFault)> = flat.collect();
        if 2 * flat.len() < steps.len() { flat } else { Vec::new() }
    }

    /// The pictures of a phase step of the columns and one of the rows that stand in each other's places, in a set with all its pictures.
    pub(super) fn steps_exchanged_across(&self) -> Option<[usize; 2]> {
        let places = Axis::BOTH.map(|axis| {
            let place = |step| self.place(Shown::Phase { axis, step });
            (0..self.code.steps).map(place).collect::<Option<Vec<usize>>>().unwrap_or_default()
        });
        let pixels = |picture: usize| self.pictures[picture].pixels();
        let [columns, rows] = places.each_ref().map(|it| it.iter().map(|it| pixels(*it)).collect::<Vec<_>>());
        let white_and_black = [pixels(self.place(Shown::White)?), pixels(self.place(Shown::Black)?)];
        let lit: Vec<usize> = self.lit.iter().map(|it| it.0).collect();
        let mut told = wave_steps::exchanged_across([&columns, &rows], white_and_black, &lit);
        if told.len() > 1 {
            // What the stripes agree with.
            let agreement = |pair: &[usize; 2]| {
                let (mut columns, mut rows) = (columns.clone(), rows.clone());
                std::mem::swap(&mut columns[pair[0]], &mut rows[pair[1]]);
                self.agreement(Axis::Columns, &columns) + self.agreement(Axis::Rows, &rows)
            };
            let mut by_stripes: Vec<(f64, [usize; 2])> = told.iter().map(|it| (agreement(it), *it)).collect();
            by_stripes.sort_by(|a, b| b.0.total_cmp(&a.0));
            told.clear();
            told.extend((by_stripes[1].0 < AGREES_LESS * by_stripes[0].0).then_some(by_stripes[0].1));
        }
        let [a, b] = *told.first()?;
        Some([places[0][a], places[1][b]])
    }

    /// How well phases of steps agree with stripes, whichever way steps run and wherever they begin: in the middle of a stripe and where it ends, the length of the mean of their differences as unit vectors [–].
    fn agreement(&self, axis: Axis, steps: &[&[u8]]) -> f64 {
        let place = |plane: u32, inverse: bool| self.place(Shown::Bit { axis, plane, inverse });
        let planes: Vec<[Option<usize>; 2]> =
            (0..self.code.bits[axis.index()]).map(|it| [place(it, false), place(it, true)]).collect();
        let numbers: Vec<Option<u32>> = self.lit.iter().map(|it| self.number(&planes, it)).collect();
        let turn = std::f64::consts::TAU / steps.len() as f64;
        let phase = |at: usize| {
            let [cosine, sine] = steps.iter().zip(0..).fold([0.0; 2], |sum, (step, k)| {
                let (s, c) = (turn * f64::from(k)).sin_cos();
                [sum[0] + c * f64::from(step[at]), sum[1] + s * f64::from(step[at])]
            });
            sine.atan2(cosine)
        };
        // By way: of middles and of ends.
        let mut sums = [[[0.0; 2]; 2]; 2];
        let mut n = [0.0_f64; 2];
        for (index, (&(at, ..), number)) in self.lit.iter().zip(&numbers).enumerate() {
            let Some(number) = *number else { continue };
            let phase = phase(at);
            let beside = [self.lit.get(index + 1).filter(|it| it.0 == at + 1).map(|_| index + 1)];
            let below = self.lit.binary_search_by_key(&(at + self.width), |it| it.0).ok();
            let ends = beside.into_iter().chain([below]).flatten().filter_map(|it| numbers[it]);
            let ends = ends.filter(|it| it.abs_diff(number) == 1).map(|it| (1, f64::from(it.max(number))));
            for (what, half_periods) in ends.chain([(0, f64::from(number) + 0.5)]) {
                for (sums, sign) in sums.iter_mut().zip([1.0, -1.0]) {
                    let (s, c) = (std::f64::consts::PI * half_periods - sign * phase).sin_cos();
                    sums[what] = [sums[what][0] + c, sums[what][1] + s];
                }
                n[what] += 1.0;
            }
        }
        let length = |sums: &[[f64; 2]; 2]| {
            let part = |of: usize| (0..2).map(|what| sums[what][of] / n[what].max(1.0)).sum::<f64>();
            part(0).hypot(part(1))
        };
        sums.iter().map(length).fold(0.0, f64::max)
    }

    /// Correlation of a picture with the brightest that pixels are; 0 where they are all alike.
    fn likeness(&self, picture: usize) -> f64 {
        let n = self.lit.len() as f64;
        let pair = |it: &(usize, u8, u8)| [self.level(picture, it.0), f64::from(it.2)];
        let [a, b] = self.lit.iter().map(pair).fold([0.0; 2], |sum, it| [sum[0] + it[0] / n, sum[1] + it[1] / n]);
        let (mut aa, mut ab, mut bb) = (0.0, 0.0, 0.0);
        for [x, y] in self.lit.iter().map(pair) {
            (aa, ab, bb) = (aa + (x - a) * (x - a), ab + (x - a) * (y - b), bb + (y - b) * (y - b));
        }
        if aa.min(bb) < 4.0 * n { 0.0 } else { ab / (aa * bb).sqrt() }
    }

    /// How many times too bright white is, where it is so everywhere alike, in a set without inverse pictures: with these, pairs tell it of all.
    fn exposure(&self, picture: usize, shown: Shown) -> Option<f64> {
        if shown != Shown::White || self.code.inverse != Inverse::None {
            return None;
        }
        let is_whole = |it: &&(usize, u8, u8)| it.2 < SATURATED;
        let mut ratios: Vec<f64> =
            self.lit.iter().filter(is_whole).map(|it| self.level(picture, it.0) / f64::from(it.2)).collect();
        if ratios.len() < self.lit.len() / 10 {
            return None;
        }
        ratios.sort_by(f64::total_cmp);
        let at = |share: f64| ratios[(share * (ratios.len() - 1) as f64) as usize];
        let (factor, spread) = (at(0.5), at(0.85) - at(0.15));
        ((factor - 1.0).abs() > OTHER_EXPOSURE && factor > 0.1 && spread < ALIKE * factor).then_some(factor)
    }

    /// What is broken of what the code promises, in a set with all its pictures.
    pub(super) fn broken_rules(&self) -> Vec<SetFault> {
        let mut faults = self.white_and_black();
        faults.extend(self.doubled());
        for axis in Axis::BOTH.into_iter().filter(|it| self.code.has(*it)) {
            let inverses = self.inverses(axis);
            if inverses.is_empty() {
                faults.extend(self.order(axis));
            }
            faults.extend(inverses);
        }
        faults
    }

    /// Axes without a fault of which at least half of the bits are resolved, provided that all faults concern the other
    /// axis.
    pub(super) fn sound_axes(&self, faults: &[SetFault]) -> Vec<Axis> {
        let axes = |it: &SetFault| {
            let mut axes = it.axes()?;
            if let SetFault::Doubled { same_as, .. } = it {
                axes.extend(self.shown[*same_as].axis());
            }
            Some(axes)
        };
        let broken: Option<Vec<Vec<Axis>>> = faults.iter().map(axes).collect();
        let Some(broken) = broken else { return Vec::new() };
        let is_told = |axis: Axis| 2 * self.n_told(axis) >= self.code.bits[axis.index()] as usize;
        let has_all = |axis: Axis| {
            let mut of_axis = self.shown.iter().enumerate().filter(|it| it.1.axis() == Some(axis));
            of_axis.all(|it| !self.skipped.contains(&it.0))
        };
        let is_sound = |axis: &Axis| {
            self.code.has(*axis) && !broken.iter().flatten().any(|it| it == axis) && has_all(*axis) && is_told(*axis)
        };
        Axis::BOTH.into_iter().filter(is_sound).collect()
    }

    /// The first picture that is not the inverse of the one it would be paired with.
    pub(super) fn first_unpaired(&self) -> Option<usize> {
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
        let mean = |picture: usize| self.lit.iter().map(|it| self.level(picture, it.0)).sum::<f64>();
        let (white, black) = (self.place(Shown::White), self.place(Shown::Black));
        if let (Some(white), Some(black)) = (white, black)
            && mean(white) < mean(black)
        {
            return vec![SetFault::WhiteIsBlack { white, black }];
        }
        let checks = [(white, Shown::White), (black, Shown::Black)];
        let one = |(picture, shown): (Option<usize>, Shown)| {
            let picture = picture?;
            let share = self.not_flat(picture, shown);
            (share > BROKEN).then_some(SetFault::NotWhite { picture, shown, share })
        };
        checks.into_iter().filter_map(one).collect()
    }

    /// Part of the pixels in which a picture is not the brightest, or, as black, not the darkest.
    pub(super) fn not_flat(&self, picture: usize, shown: Shown) -> f64 {
        self.share(|&(at, low, high)| {
            let level = self.level(picture, at);
            let off = if shown == Shown::White { f64::from(high) - level } else { level - f64::from(low) };
            off > self.margin(low, high)
        })
    }

    /// Pictures with stripes of which an earlier one is the same.
    pub(super) fn doubled(&self) -> Vec<SetFault> {
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
        let is_kept = |it: &usize| !self.skipped.contains(it);
        for b in (1..signs.len()).filter(is_kept) {
            let like = (0..b).filter(is_kept).find(|a| {
                let differ = signs[*a].iter().zip(&signs[b]).filter(|(a, b)| a != b).count();
                has_stripes(&signs[b]) && (differ as f64) < 0.03 * some.len() as f64 && self.is_one_step(*a, b, &some)
            });
            faults.extend(like.map(|same_as| SetFault::Doubled {
                picture: b,
                same_as,
                expected: self.shown.get(b).copied().filter(|_| self.shown.len() == self.pictures.len()),
            }));
        }
        faults
    }

    /// Whether two pictures of a code with a phase shift are the same in their gray levels: those of neighbouring steps are dark and bright in nearly the same places.
    fn is_one_step(&self, a: usize, b: usize, some: &[&(usize, u8, u8)]) -> bool {
        if self.code.steps == 0 {
            return true;
        }
        let off =
            |it: &&(usize, u8, u8)| (self.level(a, it.0) - self.level(b, it.0)).abs() / f64::from((it.2 - it.1).max(1));
        let mean = some.iter().map(off).sum::<f64>() / some.len().max(1) as f64;
        // The mean difference of two sines of a wave as high as white − black, one step apart.
        let step = 2.0 / std::f64::consts::PI * (std::f64::consts::PI / f64::from(self.code.steps)).sin();
        mean < 0.5 * step
    }

    fn inverses(&self, axis: Axis) -> Vec<SetFault> {
        let one = |plane: u32| {
            let shown = Shown::Bit { axis, plane, inverse: false };
            let inverse = Shown::Bit { axis, plane, inverse: true };
            let pictures = [self.place(shown)?, self.place(inverse)?];
            let share = self.not_inverse(pictures[0], pictures[1]);
            (share > BROKEN).then_some(SetFault::NotInverse { shown, pictures, share })
        };
        (0..self.code.bits[axis.index()]).filter_map(one).collect()
    }

    /// Of how many bits of an axis the changes of coarser ones tell whether they are in order.
    pub(super) fn n_told(&self, axis: Axis) -> usize {
        self.rates(axis).0.iter().flatten().count()
    }

    /// By bit how often it is as it should be where a coarser one changes, where that is seen often enough; and by pixel its bits, and those that are certain.
    fn rates(&self, axis: Axis) -> (Vec<Option<f64>>, Vec<Read>) {
        let bits = self.code.bits[axis.index()] as usize;
        let place = |plane: usize, inverse: bool| self.place(Shown::Bit { axis, plane: plane as u32, inverse });
        let places: Vec<[Option<usize>; 2]> = (0..bits).map(|it| [place(it, false), place(it, true)]).collect();
        // By pixel: the bits, and those that are certain.
        let read = |&(at, low, high): &(usize, u8, u8)| {
            let (mut ones, mut certain) = (0_u32, 0_u32);
            for (plane, place) in places.iter().enumerate() {
                let sum = f64::from(low) + f64::from(high);
                let level = |it: usize| place[it].map(|it| self.level(it, at));
                let (lit, unlit) = match (level(0), level(1)) {
                    (None, None) => continue,
                    (lit, unlit) => (lit.or(unlit.map(|it| sum - it)), unlit.or(lit.map(|it| sum - it))),
                };
                let difference = lit.unwrap_or(0.0) - unlit.unwrap_or(0.0);
                ones |= u32::from(difference > 0.0) << plane;
                certain |= u32::from(difference.abs() >= self.certain(low, high)) << plane;
            }
            (at, ones, certain)
        };
        let pixels: Vec<Read> = self.lit.iter().map(read).collect();
        let is_wide = self.wide(&pixels, bits);
        // By bit, next to each other and further apart: how often it is as it should be and as it should not where a coarser one changes.
        let mut right = vec![[[0_usize; 2]; 2]; bits];
        let mut compare = |a: &Read, b: &Read, between: &[u32]| {
            let certain = a.2 & b.2;
            let changed = (a.1 ^ b.1) & certain;
            // Over pixels that are neither lit nor dark: no stripe fits in between.
            if changed.count_ones() != 1 || between.iter().any(|it| it & changed != 0) {
                return;
            }
            let plane = changed.trailing_zeros() as usize;
            for (finer, counts) in right.iter_mut().enumerate().skip(plane + 1) {
                if certain & (1 << finer) != 0 {
                    let should = finer == plane + 1;
                    counts[usize::from(!between.is_empty())][usize::from((a.1 >> finer & 1 == 1) == should)] += 1;
                }
            }
        };
        let below = |at: usize| pixels.binary_search_by_key(&(at + self.width), |it| it.0).ok();
        for (index, it) in pixels.iter().enumerate() {
            let row = it.0 / self.width;
            let mut between = Vec::with_capacity(REACH);
            for other in pixels[index + 1..].iter().take(REACH) {
                if other.0 != it.0 + between.len() + 1 || other.0 / self.width != row {
                    break;
                }
                compare(it, other, &between);
                between.push(other.2);
            }
            between.clear();
            let mut at = it.0;
            while let Some(other) = below(at).map(|it| &pixels[it]).filter(|_| between.len() < REACH) {
                compare(it, other, &between);
                between.push(other.2);
                at = other.0;
            }
        }
        let judge = |[near, far]: &[[usize; 2]; 2]| {
            let rate = |counts: &[usize; 2]| {
                let all = counts[0] + counts[1];
                (all >= MIN_CHANGES).then(|| counts[1] as f64 / all as f64)
            };
            // From further apart fine stripes may be others already, where coarse ones are as they are next to it.
            let both = [near[0] + far[0], near[1] + far[1]];
            rate(near).or_else(|| rate(&both).filter(|it| !(FAR..=1.0 - FAR).contains(it)))
        };
        let rates = right.iter().zip(is_wide).map(|(counts, is_wide)| judge(counts).filter(|_| is_wide));
        (rates.collect(), pixels)
    }

    /// The number of the stripe that a pixel is lit by, of bits whose pictures and inverses are these; of one of them the other is what lacks to dark and bright together. `None` where a bit is not certain.
    pub(super) fn number(&self, planes: &[[Option<usize>; 2]], &(at, low, high): &(usize, u8, u8)) -> Option<u32> {
        let sum = f64::from(low) + f64::from(high);
        let (mut bit, mut number) = (false, 0);
        for pictures in planes {
            let difference = match pictures.map(|it| it.map(|it| self.level(it, at))) {
                [Some(lit), Some(unlit)] => lit - unlit,
                [Some(lit), None] => 2.0 * lit - sum,
                [None, Some(unlit)] => sum - 2.0 * unlit,
                [None, None] => return None,
            };
            if difference.abs() < self.certain(low, high) {
                return None;
            }
            bit ^= difference > 0.0;
            number = number << 1 | u32::from(bit);
        }
        Some(number)
    }

    /// What a picture and its inverse differ by where a bit is certain [gray levels].
    fn certain(&self, low: u8, high: u8) -> f64 {
        (0.25 * f64::from(high - low)).max(5.0).max(NOISE_SUM * self.noise)
    }

    /// By bit whether its stripes are so much wider than pixels that the next pixel beside a change of another bit is within the same stripe.
    fn wide(&self, pixels: &[Read], bits: usize) -> Vec<bool> {
        let mut counts = vec![[[0_usize; 2]; 2]; bits];
        for (index, (at, ones, certain)) in pixels.iter().enumerate() {
            let to_the_right = pixels.get(index + 1).filter(|it| it.0 == at + 1 && it.0 % self.width != 0);
            let below = pixels.binary_search_by_key(&(at + self.width), |it| it.0).ok().map(|it| &pixels[it]);
            for (direction, other) in [to_the_right, below].into_iter().enumerate() {
                let Some((_, other, also)) = other else { continue };
                for (plane, counts) in counts.iter_mut().enumerate().filter(|it| (certain & also) >> it.0 & 1 == 1) {
                    counts[direction][0] += 1;
                    counts[direction][1] += (ones ^ other) as usize >> plane & 1;
                }
            }
        }
        let is_wide = |[n, n_changes]: &[usize; 2]| *n_changes as f64 <= MOST_CHANGES * *n as f64;
        counts.iter().map(|it| it.iter().all(is_wide)).collect()
    }

    /// What the changes of coarser bits say about finer ones, and stripes that cannot be.
    fn order(&self, axis: Axis) -> Vec<SetFault> {
        let bits = self.code.bits[axis.index()] as usize;
        let (rates, pixels) = self.rates(axis);
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
            faults.push(SetFault::Inverted { axis, planes: inverted, all, mended: false });
        }
        if faults.is_empty() {
            faults.extend(self.range(axis, bits, &pixels));
        }
        faults
    }

    /// Of pairs that do not belong together, names the picture that shows another scene, where one of the two clearly does.
    pub(super) fn tell_other_scenes(&self, faults: &mut [SetFault]) {
        for fault in faults {
            let SetFault::NotInverse { shown, pictures, .. } = fault else { continue };
            let others: Vec<usize> =
                (0..self.pictures.len()).filter(|it| !self.skipped.contains(it) && !pictures.contains(it)).collect();
            let beyond = pictures.map(|it| stretches::outside(self.pictures, &others, it, self.lit, self.noise));
            let worse = usize::from(beyond[1] > beyond[0]);
            if beyond[worse] < BEYOND || beyond[worse] < CLEARLY * beyond[1 - worse] {
                continue;
            }
            let picture = pictures[worse];
            let shown = match (*shown, worse) {
                (Shown::Bit { axis, plane, .. }, 1) => Shown::Bit { axis, plane, inverse: true },
                (shown, _) => shown,
            };
            *fault = SetFault::OtherScene { picture, shown };
        }
    }

    pub(super) fn signs(&self) -> Samples {
        let sign = |picture: usize, &(at, low, high): &(usize, u8, u8)| -> i8 {
            let off = 2.0 * self.level(picture, at) - f64::from(low) - f64::from(high);
            let certain = off.abs() >= (0.3 * f64::from(high - low)).max(NOISE_SUM * self.noise);
            if certain { off.signum() as i8 } else { 0 }
        };
        let signs = (0..self.pictures.len()).map(|picture| self.lit.iter().map(|it| sign(picture, it)).collect());
        let (mut neighbours, mut is_down) = (Vec::new(), Vec::new());
        for (index, (at, ..)) in self.lit.iter().enumerate() {
            let to_the_right = (1..=REACH).filter(|it| at % self.width + it < self.width);
            let below = (1..=REACH).map(|it| it * self.width);
            for (by, down) in to_the_right.map(|it| (it, false)).chain(below.map(|it| (it, true))) {
                if let Ok(other) = self.lit.binary_search_by_key(&(at + by), |it| it.0) {
                    neighbours.push([index as u32, other as u32]);
                    is_down.push(down);
                }
            }
        }
        Samples { signs: signs.collect(), neighbours, is_down }
    }

    fn range(&self, axis: Axis, bits: usize, pixels: &[Read]) -> Option<SetFault> {
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
