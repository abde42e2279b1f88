//! What is wrong with a set of pictures.
//!
//! What a Gray code promises is held against the pictures: a picture and its inverse make white and black together; white is the brightest and
//! black the darkest; no two pictures with stripes are alike; and where one bit changes, the next finer one is 1 and all finer ones are 0. A bit whose
//! pictures are exchanged breaks the last rule in one way, one that stands in another's place breaks it otherwise, and so does a frame that the
//! projector dropped. The coarsest bit alone can be exchanged unseen, unless columns come out that the projector does not have.

use super::code::{Axis, Group, Inverse, Shown, StripeCode};
use super::explain;
use super::faults::SetFault;
use super::identify::Samples;
use crate::ImageView;

/// What was found about a set.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Examination {
    /// All that is wrong.
    pub faults: Vec<SetFault>,
    /// Part of the pixels that the projector lights [–].
    pub lit: f64,
    /// Noise of a pixel, standard deviation [gray levels].
    pub noise: f64,
    /// By place in the set the picture that shows what belongs there.
    places: Vec<Option<usize>>,
}

impl Examination {
    /// The axes that can be decoded.
    pub fn usable(&self, code: &StripeCode) -> Vec<Axis> {
        let shown = code.pictures();
        let is_there = |what: Shown| shown.iter().zip(&self.places).any(|it| *it.0 == what && it.1.is_some());
        let is_lacking = |axis: Axis| {
            shown.iter().zip(&self.places).any(|(shown, picture)| picture.is_none() && shown.axis() == Some(axis))
        };
        // Without inverse pictures, white and black are the threshold.
        let needs_both = code.inverse == Inverse::None && !(is_there(Shown::White) && is_there(Shown::Black));
        let is_spoilt = |axis: Axis| needs_both || is_lacking(axis) || self.faults.iter().any(|it| it.spoils(axis));
        Axis::BOTH.into_iter().filter(|it| code.has(*it) && !is_spoilt(*it)).collect()
    }

    /// The code without white or black where these are not there, and for each of its places a picture: what [`super::decode()`] takes for the axes that can be decoded.
    pub fn decodable(&self, code: &StripeCode) -> (StripeCode, Vec<usize>) {
        let shown = code.pictures();
        let is_kept = |it: &Group| match it {
            Group::Stripes(_) => true,
            Group::White | Group::Black => {
                let what = if *it == Group::White { Shown::White } else { Shown::Black };
                shown.iter().zip(&self.places).any(|it| *it.0 == what && it.1.is_some())
            }
        };
        let left = StripeCode { order: code.order.iter().copied().filter(is_kept).collect(), ..code.clone() };
        let picture = |what: &Shown| shown.iter().position(|it| it == what).and_then(|it| self.places[it]);
        let pictures = left.pictures().iter().map(|it| picture(it).unwrap_or(0)).collect();
        (left, pictures)
    }
}

/// Pixels that are looked at, and those that are where something is wrong.
const SAMPLES: usize = 40_000;
const MANY_SAMPLES: usize = 160_000;
/// Pixels are neighbours over so many: between stripes that are out of focus lie some that are neither lit nor dark [px].
const REACH: usize = 3;
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
/// Pictures that may be brighter or darker than they should be without changing what is taken for bright and dark.
const WILD: usize = 2;
/// What noise makes of bright − dark where nothing is lit, over its standard deviation: third highest of some forty values less third lowest, and as much again.
const NOISE_RANGE: f64 = 5.0;
/// What noise makes of the sum of two pictures, over the standard deviation of one: two of the sum's.
const NOISE_SUM: f64 = 2.83;
/// A picture has another exposure where it is brighter or darker by this part, alike to within that [–].
const OTHER_EXPOSURE: f64 = 0.15;
const ALIKE: f64 = 0.35;

/// Holds a set of pictures against what `code` promises; a pixel is lit where white − black is at least `min_contrast`, and more than noise. The pictures `absent` could not be
/// read: whatever stands in their places is not looked at.
pub fn examine(code: &StripeCode, pictures: &[ImageView<'_>], absent: &[usize], min_contrast: u8) -> Examination {
    let shown = code.pictures();
    let mut found = Examination { places: vec![None; shown.len()], ..Examination::default() };
    let present: Vec<usize> = (0..pictures.len()).filter(|it| !absent.contains(it)).collect();
    let sound = |picture: usize| pictures[picture].size();
    let Some(first) = present.first().map(|it| &pictures[*it]).filter(|it| !it.pixels().is_empty()) else {
        let (found_pictures, expected) = (present.len(), shown.len());
        found.faults.push(SetFault::Count { found: found_pictures, expected, unpaired: None, is_explained: false });
        return found;
    };
    if let Some(at) = present.iter().copied().find(|it| sound(*it) != first.size()) {
        found.faults.push(SetFault::Size { picture: at, found: sound(at), expected: first.size() });
        return found;
    }
    // The noise of the least noisy half: stripes as fine as pixels look like noise.
    let mut noises: Vec<f64> = present.iter().map(|it| super::noise::noise(&pictures[*it])).collect();
    noises.sort_by(f64::total_cmp);
    found.noise = noises[noises.len() / 4];
    let samples = sampled(first.size(), SAMPLES);
    let wild = Wild::of(code, &present);
    let ranges: Vec<(u8, u8)> = wild.ranges(pictures, &samples);
    let least = (NOISE_RANGE * found.noise).max(f64::from(min_contrast.max(1)));
    let lit = lit_of(&samples, &ranges, least);
    found.lit = lit.len() as f64 / samples.len() as f64;
    if found.lit < MIN_LIT {
        let mut contrasts: Vec<u8> = ranges.iter().map(|(low, high)| high - low).collect();
        contrasts.sort_unstable();
        let contrast = contrasts[contrasts.len() * 95 / 100];
        let saturated = ranges.iter().filter(|it| it.0 >= SATURATED - NOISE).count() as f64 / ranges.len() as f64;
        if saturated > 0.5 {
            found.faults.push(SetFault::TooBright { saturated });
        }
        // Nothing can be decoded, whichever it is.
        found.faults.push(SetFault::TooDark { lit: found.lit, contrast, needed: least.round().min(255.0) as u8 });
        return found;
    }
    let width = first.size().0;
    let mut set = Set { code, pictures, shown: &shown, lit: &lit, width, noise: found.noise, skipped: absent.to_vec() };
    if pictures.len() == shown.len() {
        let saturated = lit.iter().filter(|it| it.2 >= SATURATED).count() as f64 / lit.len() as f64;
        if saturated > 0.5 {
            found.faults.push(SetFault::TooBright { saturated });
        }
        found.faults.extend(absent.iter().map(|it| SetFault::Unreadable { picture: *it, shown: shown[*it] }));
        found.places = (0..shown.len()).map(|it| Some(it).filter(|it| !absent.contains(it))).collect();
        let odd = set.odd();
        set.skipped.extend(odd.iter().map(|it| it.0));
        found.faults.extend(odd.into_iter().map(|it| it.1));
        let faults = set.broken_rules();
        if faults.is_empty() {
            return found;
        }
        let samples = lattice(first.size(), MANY_SAMPLES);
        let many = lit_of(&samples, &wild.ranges(pictures, &samples), least);
        match (Set { lit: &many, ..set }).explained() {
            Some((explained, places)) => {
                found.faults.extend(explained);
                let keep = |(old, new): (&Option<usize>, Option<usize>)| new.or(*old);
                found.places = found.places.iter().zip(places).map(keep).collect();
            }
            None => found.faults.extend(faults),
        }
        return found;
    }
    let samples = lattice(first.size(), MANY_SAMPLES);
    let many = lit_of(&samples, &wild.ranges(pictures, &samples), least);
    let count = |unpaired, is_explained| SetFault::Count {
        found: pictures.len(),
        expected: shown.len(),
        unpaired,
        is_explained,
    };
    let all = Set { lit: &many, skipped: set.skipped.clone(), ..set };
    match all.explained() {
        Some((explained, places)) => {
            found.faults.push(count(None, true));
            found.faults.extend(explained);
            found.places = places;
        }
        None => {
            found.faults.push(count(set.first_unpaired(), false));
            found.faults.extend(set.doubled());
        }
    }
    found
}

/// Some of the pixels, two rows at a time, so that neighbours are there.
fn sampled((width, height): (usize, usize), n: usize) -> Vec<usize> {
    let step = (2 * width * height).div_ceil(n).clamp(2, height.max(2));
    let rows = (0..height).filter(|y| y % step < 2);
    rows.flat_map(|y| y * width..(y + 1) * width).collect()
}

/// Pixels of some whole rows and columns: every boundary between stripes crosses some of them, whichever way it runs.
fn lattice((width, height): (usize, usize), n: usize) -> Vec<usize> {
    let step = (2 * width * height).div_ceil(n).max(1);
    let row =
        |y: usize| (0..width).filter(move |x| y % step == step / 2 || x % step == step / 2).map(move |x| y * width + x);
    (0..height).flat_map(row).collect()
}

fn lit_of(samples: &[usize], ranges: &[(u8, u8)], least: f64) -> Vec<(usize, u8, u8)> {
    let both = samples.iter().zip(ranges).filter(|(_, (low, high))| f64::from(high - low) >= least);
    both.map(|(at, (low, high))| (*at, *low, *high)).collect()
}

/// Bright and dark of pixels, whatever a few wild pictures show.
struct Wild<'a> {
    present: &'a [usize],
    n: usize,
}

impl<'a> Wild<'a> {
    fn of(code: &StripeCode, present: &'a [usize]) -> Wild<'a> {
        // Of a bit and its inverse one is bright; without inverse pictures a pixel may be bright in white and one bit alone.
        let n_pairs: u32 = Axis::BOTH.into_iter().filter(|it| code.has(*it)).map(|it| code.bits[it.index()]).sum();
        let n = if code.inverse == Inverse::None { 1 } else { WILD.min(n_pairs as usize / 2) };
        Wild { present, n: n.min(present.len().saturating_sub(1) / 2) }
    }

    fn ranges(&self, pictures: &[ImageView<'_>], samples: &[usize]) -> Vec<(u8, u8)> {
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

struct Set<'a> {
    code: &'a StripeCode,
    pictures: &'a [ImageView<'a>],
    shown: &'a [Shown],
    /// Pixels that the projector lights, each with its darkest and brightest level.
    lit: &'a [(usize, u8, u8)],
    width: usize,
    noise: f64,
    /// Pictures that say nothing.
    skipped: Vec<usize>,
}

impl Set<'_> {
    fn level(&self, picture: usize, at: usize) -> f64 {
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
    fn not_inverse(&self, a: usize, b: usize) -> f64 {
        self.share(|&(at, low, high)| {
            let off = self.level(a, at) + self.level(b, at) - f64::from(low) - f64::from(high);
            off.abs() > self.margin(low, high)
        })
    }

    /// Pictures whose gray levels are those of a negative or of another exposure, in a set with all its pictures.
    fn odd(&self) -> Vec<(usize, SetFault)> {
        let inside = |level: f64, low: u8, high: u8| {
            (f64::from(low) - self.margin(low, high)..=f64::from(high) + self.margin(low, high)).contains(&level)
        };
        let mut found = Vec::new();
        for (picture, shown) in self.shown.iter().enumerate().filter(|it| !self.skipped.contains(&it.0)) {
            let outside = self.share(|&(at, low, high)| !inside(self.level(picture, at), low, high));
            let negative = self.share(|&(at, low, high)| !inside(255.0 - self.level(picture, at), low, high));
            let is_negative = outside > BROKEN && negative < 0.5 * BROKEN;
            if is_negative || *shown == Shown::White && self.likeness(picture) < -0.5 {
                found.push((picture, SetFault::Negative { picture, shown: *shown }));
                continue;
            }
            if let Some(factor) = self.exposure(picture, *shown) {
                found.push((picture, SetFault::Exposed { picture, shown: *shown, factor }));
            }
        }
        found
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

    /// How many times too bright a picture is, where it is so everywhere alike.
    fn exposure(&self, picture: usize, shown: Shown) -> Option<f64> {
        let other = match shown {
            Shown::Bit { axis, plane, inverse } => Some(self.place(Shown::Bit { axis, plane, inverse: !inverse })?),
            Shown::White => None,
            Shown::Black | Shown::Phase { .. } | Shown::Boundary { .. } => return None,
        };
        // Where its inverse is dark, it is bright.
        let is_bright = |it: &&(usize, u8, u8)| {
            other.is_none_or(|other| 2.0 * self.level(other, it.0) < f64::from(it.1) + f64::from(it.2))
                && it.2 < SATURATED
        };
        let mut ratios: Vec<f64> =
            self.lit.iter().filter(is_bright).map(|it| self.level(picture, it.0) / f64::from(it.2)).collect();
        if ratios.len() < self.lit.len() / 10 {
            return None;
        }
        ratios.sort_by(f64::total_cmp);
        let at = |share: f64| ratios[(share * (ratios.len() - 1) as f64) as usize];
        let (factor, spread) = (at(0.5), at(0.85) - at(0.15));
        let is_off = match other {
            Some(other) => self.not_inverse(picture, other) > BROKEN,
            None => true,
        };
        (is_off && (factor - 1.0).abs() > OTHER_EXPOSURE && factor > 0.1 && spread < ALIKE * factor).then_some(factor)
    }

    /// What is broken of what the code promises, in a set with all its pictures.
    fn broken_rules(&self) -> Vec<SetFault> {
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
            let share = self.share(|&(at, low, high)| {
                let level = self.level(picture, at);
                let off = if shown == Shown::White { f64::from(high) - level } else { level - f64::from(low) };
                off > self.margin(low, high)
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
        let is_kept = |it: &usize| !self.skipped.contains(it);
        for b in (1..signs.len()).filter(is_kept) {
            let like = (0..b).filter(is_kept).find(|a| {
                let differ = signs[*a].iter().zip(&signs[b]).filter(|(a, b)| a != b).count();
                has_stripes(&signs[b]) && (differ as f64) < 0.03 * some.len() as f64
            });
            faults.extend(like.map(|same_as| SetFault::Doubled {
                picture: b,
                same_as,
                expected: self.shown.get(b).copied().filter(|_| self.shown.len() == self.pictures.len()),
            }));
        }
        faults
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

    /// What the changes of coarser bits say about finer ones, and stripes that cannot be.
    fn order(&self, axis: Axis) -> Vec<SetFault> {
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
                certain |=
                    u32::from(difference.abs() >= (0.25 * f64::from(high - low)).max(5.0).max(NOISE_SUM * self.noise))
                        << plane;
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

    /// What is wrong in terms of which picture shows what, and the picture for each place; `None` where pictures do not tell.
    fn explained(&self) -> Option<(Vec<SetFault>, Vec<Option<usize>>)> {
        explain::explain(self.code, self.pictures.len(), &self.skipped, &self.signs())
    }

    fn signs(&self) -> Samples {
        let sign = |picture: usize, &(at, low, high): &(usize, u8, u8)| -> i8 {
            let off = 2.0 * self.level(picture, at) - f64::from(low) - f64::from(high);
            let certain = off.abs() >= (0.3 * f64::from(high - low)).max(NOISE_SUM * self.noise);
            if certain { off.signum() as i8 } else { 0 }
        };
        let signs = (0..self.pictures.len()).map(|picture| self.lit.iter().map(|it| sign(picture, it)).collect());
        let mut neighbours = Vec::new();
        for (index, (at, ..)) in self.lit.iter().enumerate() {
            let to_the_right = (1..=REACH).filter(|it| at % self.width + it < self.width);
            let below = (1..=REACH).map(|it| it * self.width);
            let places =
                to_the_right.chain(below).filter_map(|it| self.lit.binary_search_by_key(&(at + it), |it| it.0).ok());
            neighbours.extend(places.map(|it| [index as u32, it as u32]));
        }
        Samples { signs: signs.collect(), neighbours }
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
mod tests;
