//! Pictures of another scene in one set: camera, projector or what is seen was moved between two of them.
//!
//! A bit and its inverse add up to the scene under full light, whatever stripes they show; so do white and black. These sums, in the order of the pictures, are alike as long as nothing moves. Where they fall into
//! stretches that are alike each but not to one another, something moved between the last picture of the one and the first of the next, or a light was switched.

use super::code::{Axis, Inverse, Shown, StripeCode};
use crate::ImageView;

/// Sums differ in a pixel by more than this part of them, this many gray levels, and so many standard deviations of a picture's noise: three of the difference of two sums of two pictures.
const SHARE: f64 = 0.08;
const LEVELS: f64 = 8.0;
const SIGMAS: f64 = 6.0;
/// Sums are of different scenes where they differ in more than this part of the pixels: good sets of cameras whose pictures were packed differ in 0.02, a board that was moved by 4 px in 0.17 [–].
const MOVED: f64 = 0.08;
/// … and where more than a quarter of that in at least this part of the picture's blocks: what passes before the camera differs in its own place alone, and is left out there [–].
const SPREAD: f64 = 0.4;
/// Blocks along each side of the picture.
const BLOCKS: usize = 8;
/// A light makes all brighter, but for so many of the pixels that differ: what moves makes as many darker [–].
const OTHER_WAY: f64 = 0.03;
/// Opposite pictures differ by as much in all stretches, in the median, where these have one exposure: fine stripes by somewhat less [–]; what differs by less than so many gray levels does not count.
const SAME_EXPOSURE: std::ops::RangeInclusive<f32> = 0.92..=1.08;
const SEEN: u8 = 20;
/// Sums that a stretch needs to be one.
const MIN_SUMS: usize = 2;
/// A gray level that may be cut off.
const SATURATED: u8 = 250;

/// The scene under full light, by two pictures that show opposite stripes.
struct Sum {
    /// In their order.
    pictures: [usize; 2],
    /// What the one shows, and the pictures of it and of its opposite.
    shown: Shown,
    of_shown: [usize; 2],
    levels: Vec<f64>,
    is_cut_off: Vec<bool>,
}

/// What is alike in a set.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Stretches {
    /// By stretch its pictures in their order; two at least.
    pub(super) pictures: Vec<Vec<usize>>,
    /// Which of them tells most.
    pub(super) kept: usize,
    /// From each to the next: by how much all of the picture grew brighter, or darker where negative, where a light that was switched explains the difference [gray levels].
    pub(super) light: Vec<Option<f64>>,
}

/// What does not belong together in a set.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Scenes {
    /// Where it falls into stretches.
    pub(super) stretches: Option<Stretches>,
    /// Where it does not: pairs, a bit's picture first, whose sum is that of no other.
    pub(super) odd: Vec<(Shown, [usize; 2])>,
}

/// What of a set was taken of another scene. `lit` are pixels with their darkest and brightest levels.
pub(super) fn scenes(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    places: &[Option<usize>],
    lit: &[(usize, u8, u8)],
    noise: f64,
) -> Scenes {
    if code.inverse == Inverse::None {
        return Scenes::default();
    }
    let shown = code.pictures();
    let picture = |what: Shown| shown.iter().position(|it| *it == what).and_then(|it| places[it]);
    let bits = Axis::BOTH.into_iter().filter(|it| code.has(*it)).flat_map(|axis| {
        (0..code.bits[axis.index()]).map(move |plane| [false, true].map(|inverse| Shown::Bit { axis, plane, inverse }))
    });
    let mut sums: Vec<Sum> = Vec::new();
    let Some([width, height]) = pictures.first().map(|it| [it.width(), it.height()]) else { return Scenes::default() };
    let block_of = |it: &(usize, u8, u8)| {
        let (x, y) = (it.0 % width, it.0 / width);
        y * BLOCKS / height * BLOCKS + x * BLOCKS / width
    };
    let blocks: Vec<usize> = lit.iter().map(block_of).collect();
    for [one, other] in bits.chain([[Shown::White, Shown::Black]]) {
        let (Some(a), Some(b)) = (picture(one), picture(other)) else { continue };
        let [of_a, of_b] = [a, b].map(|it| pictures[it].pixels());
        sums.push(Sum {
            pictures: [a.min(b), a.max(b)],
            shown: one,
            of_shown: [a, b],
            levels: lit.iter().map(|it| f64::from(of_a[it.0]) + f64::from(of_b[it.0])).collect(),
            is_cut_off: lit.iter().map(|it| of_a[it.0].max(of_b[it.0]) >= SATURATED).collect(),
        });
    }
    sums.sort_by_key(|it| it.pictures);
    // Each joins the group that it is most alike to.
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for at in 0..sums.len() {
        let shares = groups.iter().map(|group| differ(&sums[group[0]], &sums[at], &blocks, noise));
        let best = shares.enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).filter(|it| it.1 < MOVED);
        match best {
            Some((group, _)) => groups[group].push(at),
            None => groups.push(vec![at]),
        }
    }
    let is_one = groups.iter().filter(|it| it.len() >= MIN_SUMS).count() == 1;
    let mut odd = Vec::new();
    for at in groups.iter().filter(|it| is_one && it.len() < MIN_SUMS).flatten() {
        odd.push((sums[*at].shown, sums[*at].of_shown));
    }
    groups.retain(|it| it.len() >= MIN_SUMS);
    Scenes { stretches: in_stretches(code, pictures, places, lit, noise, &sums, &groups), odd }
}

/// The stretches that groups of sums are.
fn in_stretches(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    places: &[Option<usize>],
    lit: &[(usize, u8, u8)],
    noise: f64,
    sums: &[Sum],
    groups: &[Vec<usize>],
) -> Option<Stretches> {
    if groups.len() < 2 {
        return None;
    }
    let shown = code.pictures();
    let mut stretches: Vec<Vec<usize>> =
        groups.iter().map(|group| group.iter().flat_map(|it| sums[*it].pictures).collect()).collect();
    stretches.iter_mut().for_each(|it| it.sort_unstable());
    stretches.sort();
    // Stretches that follow one another: groups that lie within one another are of something else.
    if stretches.windows(2).any(|it| it[0].last() > it[1].first()) {
        return None;
    }
    // Pictures that are of no sum, such as phase steps, belong to the stretch that they lie in or follow; between two stretches, as where a pair is of both, to the one whose range they stay in.
    let used: Vec<usize> = stretches.iter().flatten().copied().collect();
    let ends: Vec<usize> = stretches.iter().filter_map(|it| it.last().copied()).collect();
    for at in (0..pictures.len()).filter(|it| !used.contains(it) && places.contains(&Some(*it))) {
        let after = stretches.partition_point(|it| it[0] < at);
        let before = after.saturating_sub(1);
        if after == 0 || after == stretches.len() || ends[before] > at {
            stretches[before].push(at);
        } else {
            let outside = [after - 1, after].map(|it| outside(pictures, &stretches[it], at, lit, noise));
            let nearer = if outside[0] <= outside[1] { after - 1 } else { after };
            stretches[nearer].push(at);
        }
    }
    stretches.iter_mut().for_each(|it| it.sort_unstable());
    let is_told = |stretch: &Vec<usize>, axis: Axis| {
        let all = shown.iter().zip(places).filter(|it| it.0.axis() == Some(axis));
        code.has(axis)
            && all.clone().next().is_some()
            && all.clone().all(|it| it.1.is_some_and(|it| stretch.contains(&it)))
    };
    let worth = |it: &usize| {
        let stretch = &stretches[*it];
        let told = Axis::BOTH.map(|axis| is_told(stretch, axis));
        // Of one axis each, columns tell more: most cameras stand beside the projector.
        (told.iter().filter(|it| **it).count(), told[Axis::Columns.index()], stretch.len())
    };
    let kept = (0..stretches.len()).max_by_key(worth)?;
    let light = stretches.windows(2).map(|it| light(sums, [&it[0], &it[1]], noise)).collect();
    Some(Stretches { pictures: stretches, kept, light })
}

/// By how much the second of two stretches is brighter in the middle one of the pixels that differ, where nearly all that differ do so the same way.
fn light(sums: &[Sum], stretches: [&Vec<usize>; 2], noise: f64) -> Option<f64> {
    let [before, after] =
        stretches.map(|it| sums.iter().find(|sum| sum.pictures.iter().all(|picture| it.contains(picture))));
    let (before, after) = (before?, after?);
    let whole = (0..before.levels.len()).filter(|it| !before.is_cut_off[*it] && !after.is_cut_off[*it]);
    let mut off: Vec<f64> = whole.map(|it| after.levels[it] - before.levels[it]).collect();
    off.retain(|it| it.abs() > LEVELS.max(SIGMAS * noise));
    off.sort_by(f64::total_cmp);
    let n_darker = off.partition_point(|it| *it < 0.0) as f64 / off.len().max(1) as f64;
    let is_one_way = n_darker.min(1.0 - n_darker) <= OTHER_WAY;
    // Two pictures make a sum.
    off.get(off.len() / 2).filter(|_| is_one_way).map(|it| it / 2.0)
}

/// The pictures of other stretches than the one that is kept, as they would be without the light that was switched; none where anything else is different between stretches.
pub(super) fn relit(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    places: &[Option<usize>],
    stretches: &Stretches,
) -> Vec<(usize, Vec<u8>)> {
    if !stretches.light.iter().all(Option::is_some) {
        return Vec::new();
    }
    // Pictures that are of no pair go with those before them.
    let firsts: Vec<usize> = stretches.pictures.iter().map(|it| it[0]).collect();
    let of = |picture: usize| firsts.partition_point(|it| *it <= picture).saturating_sub(1);
    let listed =
        |picture: usize| stretches.pictures.iter().position(|it| it.contains(&picture)).unwrap_or_else(|| of(picture));
    let shown = code.pictures();
    let place = |what: &Shown| shown.iter().position(|it| it == what).and_then(|it| places[it]);
    let other = |what: &Shown| match *what {
        Shown::Bit { axis, plane, inverse: false } => Some(Shown::Bit { axis, plane, inverse: true }),
        Shown::White => Some(Shown::Black),
        Shown::Bit { .. } | Shown::Black | Shown::Phase { .. } | Shown::Boundary { .. } => None,
    };
    let pairs = shown.iter().filter_map(|it| Some([place(it)?, place(&other(it)?)?]));
    let pairs: Vec<[usize; 2]> = pairs.filter(|it| listed(it[0]) == listed(it[1])).collect();
    let n = pictures.first().map_or(0, |it| it.pixels().len());
    // Half of the mean sum of two opposite pictures, by stretch.
    let mean = |stretch: usize| {
        let (mut sums, mut n_pairs) = (vec![0_u32; n], 0_u32);
        for [a, b] in pairs.iter().filter(|it| listed(it[0]) == stretch) {
            n_pairs += 1;
            let both = pictures[*a].pixels().iter().zip(pictures[*b].pixels());
            sums.iter_mut().zip(both).for_each(|(sum, (a, b))| *sum += u32::from(*a) + u32::from(*b));
        }
        sums.iter().map(|it| *it as f32 / (2 * n_pairs.max(1)) as f32).collect::<Vec<f32>>()
    };
    // A light adds the same to opposite pictures; another exposure changes their difference.
    let difference = |stretch: usize| {
        let mut largest = vec![0_u8; n];
        for [a, b] in pairs.iter().filter(|it| listed(it[0]) == stretch) {
            let both = pictures[*a].pixels().iter().zip(pictures[*b].pixels());
            largest.iter_mut().zip(both).for_each(|(largest, (a, b))| *largest = (*largest).max(a.abs_diff(*b)));
        }
        largest
    };
    let by_kept = difference(stretches.kept);
    let is_exposed = |stretch: usize| {
        let there = difference(stretch);
        let seen = (0..n).filter(|it| by_kept[*it] >= SEEN && there[*it] >= SEEN);
        let mut ratios: Vec<f32> = seen.map(|it| f32::from(there[it]) / f32::from(by_kept[it])).collect();
        let middle = ratios.len() / 2;
        ratios.len() < 2 || !SAME_EXPOSURE.contains(ratios.select_nth_unstable_by(middle, f32::total_cmp).1)
    };
    if (0..firsts.len()).any(|it| it != stretches.kept && is_exposed(it)) {
        return Vec::new();
    }
    let kept = mean(stretches.kept);
    let mut found = Vec::new();
    for stretch in (0..firsts.len()).filter(|it| *it != stretches.kept) {
        let off: Vec<f32> = mean(stretch).iter().zip(&kept).map(|(there, kept)| there - kept).collect();
        for picture in places.iter().flatten().copied().filter(|it| listed(*it) == stretch) {
            let pixels = pictures[picture].pixels().iter().zip(&off);
            let without = |(level, off): (&u8, &f32)| {
                if *level >= SATURATED { *level } else { (f32::from(*level) - off).round() as u8 }
            };
            found.push((picture, pixels.map(without).collect()));
        }
    }
    found
}

/// Part of the pixels in which two sums differ; 0 where they do in a few blocks of the picture alone [–].
fn differ(a: &Sum, b: &Sum, blocks: &[usize], noise: f64) -> f64 {
    // By block: pixels, and those that differ.
    let mut counts = [(0_usize, 0_usize); BLOCKS * BLOCKS];
    for at in 0..a.levels.len() {
        if a.is_cut_off[at] || b.is_cut_off[at] {
            continue;
        }
        let (n, off) = &mut counts[blocks[at]];
        *n += 1;
        let most = (SHARE * a.levels[at].min(b.levels[at])).max(LEVELS).max(SIGMAS * noise);
        *off += usize::from((a.levels[at] - b.levels[at]).abs() > most);
    }
    let share = |(n, off): (usize, usize)| off as f64 / n.max(1) as f64;
    let there = counts.iter().filter(|it| it.0 > 0);
    let n_moved = there.clone().filter(|it| share(**it) > MOVED / 4.0).count();
    let is_everywhere = n_moved as f64 >= SPREAD * there.count() as f64;
    let all = counts.iter().fold((0, 0), |sum, it| (sum.0 + it.0, sum.1 + it.1));
    if is_everywhere { share(all) } else { 0.0 }
}

/// Part of the pixels in which a picture is brighter or darker than all those of some [–].
pub(super) fn outside(
    pictures: &[ImageView<'_>],
    some: &[usize],
    picture: usize,
    lit: &[(usize, u8, u8)],
    noise: f64,
) -> f64 {
    let n_off = lit.iter().filter(|it| {
        let level = |picture: usize| f64::from(pictures[picture].pixels()[it.0]);
        let (low, high) =
            some.iter().fold((f64::INFINITY, 0.0_f64), |(low, high), it| (low.min(level(*it)), high.max(level(*it))));
        let margin = (SHARE * high).max(LEVELS).max(SIGMAS / 2.0 * noise);
        !(low - margin..=high + margin).contains(&level(picture))
    });
    n_off.count() as f64 / lit.len().max(1) as f64
}
