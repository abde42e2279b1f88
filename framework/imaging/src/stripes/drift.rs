//! A camera, or all that it sees, that moved by less than a pixel during a set.
//!
//! A bit and its inverse add up to the scene under full light; so do white and black, and two phase steps half a period apart. Such a sum S of a scene R that lies d pixels elsewhere is a R + c − ∇R · d: colours and
//! shades of the surface tell d by least squares over all pixels, far finer than a pixel. Sums in the order of their pictures scatter about one d as long as nothing moves, about two where something did once, and about a line
//! where something creeps all the time, about any way where it creeps unevenly (`way`). Scenes without colours or edges say nothing.
//!
//! Source: B. Lucas, T. Kanade, "An iterative image registration technique with an application to stereo vision", IJCAI 1981.

use std::borrow::Cow;

use nalgebra::{Matrix4, Vector2, Vector4};

use super::Coordinates;
use super::code::{Axis, Inverse, Shown, StripeCode};
use super::way::{Creep, Way, evenly};
use crate::ImageView;

/// Pixels that tell it, at first, at most and at least.
const FEW_SAMPLES: usize = 6000;
const SAMPLES: usize = 60_000;
const MIN_SAMPLES: usize = 2000;
/// Sums before and after a move, at least.
const MIN_SUMS: usize = 3;
/// A gray level that may be cut off.
const SATURATED: u8 = 250;
/// Over an edge of a surface the scene has no slope: pixels that differ from their neighbours by more than this part of them say nothing [–].
const EDGE: f64 = 0.3;
/// Turns in which pixels are left out that do not fit, and by how many standard deviations.
const TURNS: usize = 3;
const OUTSIDE: f64 = 3.0;
/// One of so many pixels is in the median that says what a standard deviation is.
const MEDIAN_OF: usize = 4;
/// A move is at least so large [px] …
const LEAST: f64 = 0.15;
/// … and so many standard deviations of how sums scatter about the places before and after it.
const SIGMAS: f64 = 7.0;
/// Few pixels say that nothing moved where a move of [`LEAST`] would be so many standard deviations away.
const SURE: f64 = 4.0;
/// A scene creeps where sums lie nearer to a place that moves evenly than to two that stand, by this factor: of one that moved once in the middle they lie farther away [–].
const STEADY: f64 = 0.8;
/// A scene goes its own way where sums lie farther from an even creep, and from two places, than noise of the sums explains, by this factor: by noise alone both lie 0.8 to 1.2 times as far [–] …
const OFF: f64 = 1.6;
/// … and where its way explains that: what is left about it is no more than this part of the less of both [–].
const FOLLOWED: f64 = 0.6;
/// A surface that colours place no better than this says nothing, standard deviation of one sum [px].
const KNOWN: f64 = 0.1;

/// Where a scene moved during a set.
#[derive(Debug, Clone, PartialEq)]
pub struct Drift {
    /// A picture before it, by its place.
    pub last: usize,
    /// A picture after it.
    pub first: usize,
    /// How it went from the one to the other.
    pub pace: Pace,
    /// By how much the scene moved along rows and columns of the picture, from the one to the other [px].
    pub by: Vector2<f64>,
    /// Where it lies in each picture of the set, from where it lies in the first [px]; none of one that moved once.
    pub(super) way: Vec<Vector2<f64>>,
}

/// How a scene moved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// Once.
    Once,
    /// All the time, by as much from each picture to the next.
    Even,
    /// All the time, there and back, or faster and slower.
    Uneven,
}

impl Drift {
    /// Whether it moved all the time rather than once.
    pub fn creeps(&self) -> bool {
        self.pace != Pace::Once
    }

    /// Widens the standard deviations of coordinates by a single move: relative to the scene before or after it, their error is spread evenly from none to the whole move.
    pub fn widen(&self, coordinates: &mut Coordinates) {
        widen(coordinates, self.by / 3_f64.sqrt());
    }
}

/// Makes coordinates as vague as places in the picture are that are known by a standard deviation of `by` along rows and columns, in common [px].
pub(super) fn widen(coordinates: &mut Coordinates, by: Vector2<f64>) {
    let [width, height] = coordinates.size;
    for axis in Axis::BOTH.map(Axis::index) {
        let values = &coordinates.values[axis];
        if values.len() != width * height {
            continue;
        }
        let along = |at: usize, place: usize, n: usize, by: usize| -> Option<f64> {
            let other = |is_there: bool, at: usize| values.get(at).copied().filter(|it| is_there && it.is_finite());
            let (ahead, behind) = (other(place + 1 < n, at + by), other(place > 0, at.wrapping_sub(by)));
            match (ahead, behind) {
                (Some(a), Some(b)) => Some(f64::from(a - b) / 2.0),
                (Some(a), None) => Some(f64::from(a - values[at])),
                (None, Some(b)) => Some(f64::from(values[at] - b)),
                (None, None) => None,
            }
        };
        let change = |at: usize| {
            let slope = Vector2::new(along(at, at % width, width, 1)?, along(at, at / width, height, width)?);
            Some(slope.dot(&by).abs()).filter(|it| it.is_finite())
        };
        let known: Vec<usize> = (0..values.len()).filter(|it| values[*it].is_finite()).collect();
        let changes: Vec<Option<f64>> = known.iter().map(|at| change(*at)).collect();
        let mut sorted: Vec<f64> = changes.iter().flatten().copied().collect();
        sorted.sort_by(f64::total_cmp);
        let usual = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
        for (at, change) in known.into_iter().zip(changes) {
            let sigma = change.unwrap_or(usual);
            let own = &mut coordinates.sigmas[axis][at];
            *own = f64::from(*own).hypot(sigma) as f32;
        }
    }
}

/// A small move, if there was one, in a set whose picture k is `pictures[k]`; a pixel is lit where white − black is at least `min_contrast`.
pub fn drift(code: &StripeCode, pictures: &[ImageView<'_>], min_contrast: u8) -> Option<Drift> {
    let sums = Sums::of(code, pictures)?;
    let Sums { pairs, lit } = &sums;
    let mut samples = Samples::new(pictures, pairs, [&lit[0], &lit[1]], min_contrast)?;
    // Of most sets few pixels say that nothing moved; only where they do not, many are asked.
    samples.gather(FEW_SAMPLES);
    if samples.len() >= MIN_SAMPLES && is_surely_still(&samples.places()?) {
        return None;
    }
    samples.gather(SAMPLES);
    if samples.len() < MIN_SAMPLES {
        return None;
    }
    let places = samples.places()?;
    let is_told = |by: &Vector2<f64>, scatter: f64, sigma: f64| {
        scatter <= KNOWN.max(by.norm() / 4.0) && by.norm() >= LEAST.max(SIGMAS * sigma)
    };
    let split = best_split(&places)?;
    let ends = sums.ends()?;
    let creep = Creep::of(pairs, &places, ends);
    let way = Way::of(pairs, &places, pictures.len());
    let once = scatter_of_once(pairs, &places).unwrap_or(split.scatter).min(split.scatter);
    let least = creep.as_ref().map_or(once, |it| it.scatter.min(once));
    if let Some(way) = way
        && least > OFF * way.noise
        && way.scatter < FOLLOWED * least
        && is_told(&way.reach(), way.noise, way.noise / 2.0)
    {
        let by = way.places[ends[1]] - way.places[ends[0]];
        return Some(Drift { last: ends[0], first: ends[1], pace: Pace::Uneven, by, way: way.places });
    }
    if let Some(Creep { by, .. }) =
        creep.filter(|it| is_told(&it.by, it.scatter, it.sigma) && it.scatter < STEADY * split.scatter)
    {
        let way = evenly(by, ends, pictures.len());
        return Some(Drift { last: ends[0], first: ends[1], pace: Pace::Even, by, way });
    }
    // Sums of steps reach from the first half of the steps into the second: what moved among these lies between.
    let first = pairs[split.at][0];
    let last = pairs[..split.at].iter().map(|it| it[0]).max()?;
    let once = Drift { last, first, pace: Pace::Once, by: split.by, way: Vec::new() };
    is_told(&split.by, split.scatter, split.sigma).then_some(once)
}

/// Pictures of a set that add up to the scene under full light.
pub(super) struct Sums<'a> {
    /// Places of two pictures each, in the order of the first ones.
    pub pairs: Vec<[usize; 2]>,
    /// White and black, or what is as good where one of them lacks.
    lit: [Cow<'a, [u8]>; 2],
}

impl<'a> Sums<'a> {
    /// `None` where there are too few.
    pub fn of(code: &StripeCode, pictures: &[ImageView<'a>]) -> Option<Sums<'a>> {
        let shown = code.pictures();
        let picture = |what: Shown| shown.iter().position(|it| *it == what).filter(|it| *it < pictures.len());
        let mut pairs: Vec<[usize; 2]> = Vec::new();
        let mut add = |a: Shown, b: Shown| pairs.extend(picture(a).zip(picture(b)).map(|(a, b)| [a.min(b), a.max(b)]));
        for axis in Axis::BOTH.into_iter().filter(|it| code.has(*it)) {
            for plane in 0..code.bits[axis.index()] {
                let bit = |inverse: bool| Shown::Bit { axis, plane, inverse };
                if code.inverse != Inverse::None {
                    add(bit(false), bit(true));
                }
            }
            for step in (0..code.steps / 2).filter(|_| code.steps.is_multiple_of(2)) {
                add(Shown::Phase { axis, step }, Shown::Phase { axis, step: step + code.steps / 2 });
            }
        }
        add(Shown::White, Shown::Black);
        pairs.sort_unstable();
        if pairs.len() < 2 * MIN_SUMS {
            return None;
        }
        let lit = match picture(Shown::White).zip(picture(Shown::Black)) {
            Some((white, black)) => [white, black].map(|it| Cow::Borrowed(pictures[it].pixels())),
            None => [u8::max, u8::min].map(|of| {
                let mut all = pictures[pairs[0][0]].pixels().to_vec();
                for it in pairs.iter().flatten() {
                    all.iter_mut().zip(pictures[*it].pixels()).for_each(|(to, it)| *to = of(*to, *it));
                }
                Cow::Owned(all)
            }),
        };
        Some(Sums { pairs, lit })
    }

    /// The first and the last picture of all of them.
    fn ends(&self) -> Option<[usize; 2]> {
        Some([self.pairs.first()?[0], self.pairs.iter().map(|it| it[1]).max()?])
    }

    /// Where the scene lies in each picture, from where it lies in the first, and how sums scatter about that [px], if it moves at `pace`.
    pub fn way(&self, pictures: &[ImageView<'_>], min_contrast: u8, pace: Pace) -> Option<(Vec<Vector2<f64>>, f64)> {
        let mut samples = Samples::new(pictures, &self.pairs, [&self.lit[0], &self.lit[1]], min_contrast)?;
        samples.gather(SAMPLES);
        if samples.len() < MIN_SAMPLES {
            return None;
        }
        let (places, ends, n) = (samples.places()?, self.ends()?, pictures.len());
        if pace == Pace::Uneven {
            return Way::of(&self.pairs, &places, n).map(|it| (it.places, it.noise));
        }
        Creep::of(&self.pairs, &places, ends).map(|it| (evenly(it.by, ends, n), it.scatter))
    }
}

/// Sums in two parts, each about a place of its own.
struct Split {
    /// Sums before it.
    at: usize,
    /// From the mean place of the first part to that of the second [px].
    by: Vector2<f64>,
    /// Of the sums about the mean of their part, standard deviation [px].
    scatter: f64,
    /// Of `by`, by that scatter [px].
    sigma: f64,
}

fn splits(places: &[Vector2<f64>]) -> impl Iterator<Item = Split> {
    let mean = |of: &[Vector2<f64>]| of.iter().sum::<Vector2<f64>>() / of.len() as f64;
    let squares = move |of: &[Vector2<f64>]| of.iter().map(|it| (it - mean(of)).norm_squared()).sum::<f64>();
    (MIN_SUMS..=places.len() - MIN_SUMS).map(move |at| {
        let (before, after) = places.split_at(at);
        let variance = (squares(before) + squares(after)) / (places.len() as f64 - 2.0);
        let sigma = (variance * (1.0 / before.len() as f64 + 1.0 / after.len() as f64)).sqrt();
        Split { at, by: mean(after) - mean(before), scatter: variance.sqrt(), sigma }
    })
}

/// The split that leaves least scatter.
fn best_split(places: &[Vector2<f64>]) -> Option<Split> {
    splits(places).min_by(|a, b| a.scatter.total_cmp(&b.scatter))
}

/// How sums scatter about a place before and one after a move that came once, at the picture where that is least: sums of a picture before it and one after it lie between, and count for nothing [px].
fn scatter_of_once(pairs: &[[usize; 2]], places: &[Vector2<f64>]) -> Option<f64> {
    let last = pairs.iter().map(|it| it[1]).max()?;
    let scatter = |first: usize| {
        let part = |is_in: &dyn Fn(&[usize; 2]) -> bool| -> Vec<Vector2<f64>> {
            pairs.iter().zip(places).filter(|it| is_in(it.0)).map(|it| *it.1).collect()
        };
        let parts = [part(&|it| it[1] < first), part(&|it| it[0] >= first)];
        let n = parts[0].len() + parts[1].len();
        let squares = |of: &Vec<Vector2<f64>>| {
            let mean = of.iter().sum::<Vector2<f64>>() / of.len() as f64;
            of.iter().map(|it| (it - mean).norm_squared()).sum::<f64>()
        };
        let is_told = parts.iter().all(|it| it.len() >= MIN_SUMS) && 3 * n >= 2 * pairs.len();
        is_told.then(|| ((squares(&parts[0]) + squares(&parts[1])) / (n as f64 - 2.0)).sqrt())
    };
    (1..=last).filter_map(scatter).min_by(f64::total_cmp)
}

/// Whether no split can be a move, and nothing creeps, whatever more pixels would say: what creeps by so much over a set moves by half of it from the middle of its first half to that of the second.
fn is_surely_still(places: &[Vector2<f64>]) -> bool {
    let half = places.len() / 2;
    splits(places).all(|it| {
        let least = if it.at == half { LEAST / 2.0 } else { LEAST };
        it.scatter <= KNOWN && it.by.norm() + SURE * it.sigma < least
    })
}

/// Pixels that tell where the scene lies in each sum, by whole rows that are spread over the picture.
struct Samples<'a> {
    pictures: &'a [ImageView<'a>],
    pairs: &'a [[usize; 2]],
    white: &'a [u8],
    black: &'a [u8],
    min_contrast: u8,
    /// From one row that is asked to the next, around the picture.
    step: usize,
    /// Rows that have been asked.
    n_rows: usize,
    /// Pixels; for each the scene's level, 1, and its slopes with a minus: what a sum depends on.
    at: Vec<usize>,
    of: Vec<Vector4<f64>>,
}

impl<'a> Samples<'a> {
    fn new(
        pictures: &'a [ImageView<'a>],
        pairs: &'a [[usize; 2]],
        [white, black]: [&'a [u8]; 2],
        min_contrast: u8,
    ) -> Option<Samples<'a>> {
        let (width, height) = pictures.first()?.size();
        if width < 3 || height < 3 {
            return None;
        }
        // Rows in steps of the golden section lie evenly, however many of them are asked.
        let rows = height - 2;
        let step = ((rows as f64 * 0.618) as usize..).find(|it| greatest_divisor(*it, rows) == 1)?;
        Some(Samples { pictures, pairs, white, black, min_contrast, step, n_rows: 0, at: Vec::new(), of: Vec::new() })
    }

    fn len(&self) -> usize {
        self.at.len()
    }

    /// Asks more rows, until there are `n` pixels or no more rows.
    fn gather(&mut self, n: usize) {
        let (width, height) = self.pictures[0].size();
        let mut levels = [0; 3].map(|_| vec![0_u32; width]);
        let share = 1.0 / self.pairs.len() as f64;
        while self.at.len() < n && self.n_rows < height - 2 {
            let y = 1 + self.n_rows * self.step % (height - 2);
            self.n_rows += 1;
            for (level, y) in levels.iter_mut().zip(y - 1..) {
                level.fill(0);
                for picture in self.pairs.iter().flatten() {
                    let row = self.pictures[*picture].row(y);
                    level.iter_mut().zip(row).for_each(|(to, it)| *to += u32::from(*it));
                }
            }
            let [above, here, below] = [0, 1, 2].map(|it| &levels[it]);
            for x in 1..width - 1 {
                let at = y * width + x;
                let (white, black) = (self.white[at], self.black[at]);
                if white >= SATURATED || white < black.saturating_add(self.min_contrast) {
                    continue;
                }
                let level = |of: &[u32], x: usize| f64::from(of[x]) * share;
                let slope =
                    Vector2::new(level(here, x + 1) - level(here, x - 1), level(below, x) - level(above, x)) / 2.0;
                if slope.norm() <= EDGE * level(here, x) {
                    self.at.push(at);
                    self.of.push(Vector4::new(level(here, x), 1.0, -slope.x, -slope.y));
                }
            }
        }
    }

    /// Where the scene lies in each sum.
    fn places(&self) -> Option<Vec<Vector2<f64>>> {
        let all: Matrix4<f64> = self.of.iter().map(|it| it * it.transpose()).sum();
        let inverse = all.try_inverse()?;
        let (mut levels, mut off) = (vec![0.0; self.len()], vec![0.0; self.len()]);
        let mut sample: Vec<f64> = Vec::new();
        let mut place = |pair: &[usize; 2]| {
            let [a, b] = pair.map(|it| self.pictures[it].pixels());
            levels.iter_mut().zip(&self.at).for_each(|(to, at)| *to = f64::from(a[*at]) + f64::from(b[*at]));
            let right: Vector4<f64> = self.of.iter().zip(&levels).map(|(of, level)| of * *level).sum();
            let mut found = inverse * right;
            for _ in 1..TURNS {
                let misfits = self.of.iter().zip(&levels).map(|(of, level)| (level - of.dot(&found)).abs());
                off.iter_mut().zip(misfits).for_each(|(to, it)| *to = it);
                sample.clear();
                sample.extend(off.iter().step_by(MEDIAN_OF));
                let middle = sample.len() / 2;
                let most = OUTSIDE * 1.4826 * *sample.select_nth_unstable_by(middle, f64::total_cmp).1;
                let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
                for ((of, level), _) in self.of.iter().zip(&levels).zip(&off).filter(|it| *it.1 <= most) {
                    normal += of * of.transpose();
                    right += of * *level;
                }
                found = normal.try_inverse()? * right;
            }
            Some(Vector2::new(found.z, found.w))
        };
        self.pairs.iter().map(&mut place).collect()
    }
}

fn greatest_divisor(a: usize, b: usize) -> usize {
    if b == 0 { a } else { greatest_divisor(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::super::scene::{Scene, wall};
    use super::*;

    /// What is found of a wall's set that moved by so much from one of its pictures on.
    fn found(code: &StripeCode, from: usize, by: f64, seed: u64) -> Option<Drift> {
        let still = wall(seed).pictures(code);
        // The place of the scene is told by what is seen there.
        let moved = match by {
            0.0 => still.clone(),
            0.25 => Scene {
                projector: |x, y| (wall(1).projector)(x - 0.25, y),
                albedo: |x, y| (wall(1).albedo)(x - 0.25, y),
                shadow: |x, y| (wall(1).shadow)(x - 0.25, y),
                ..wall(seed)
            }
            .pictures(code),
            _ => Scene {
                projector: |x, y| (wall(1).projector)(x - 0.6, y),
                albedo: |x, y| (wall(1).albedo)(x - 0.6, y),
                shadow: |x, y| (wall(1).shadow)(x - 0.6, y),
                ..wall(seed)
            }
            .pictures(code),
        };
        let pictures: Vec<Vec<u8>> = still.into_iter().take(from).chain(moved.into_iter().skip(from)).collect();
        let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
        drift(code, &views, 12)
    }

    #[test]
    fn coordinates_are_as_vague_as_the_move_makes_them() {
        let size = [20, 10];
        // Two projector pixels to a pixel along rows, a half down columns; one pixel is alone.
        let mut columns: Vec<f32> = (0..200).map(|at| 2.0 * (at % 20) as f32 + 0.5 * (at / 20) as f32).collect();
        columns[45] = f32::NAN;
        let mut coordinates = Coordinates {
            size,
            values: [columns, Vec::new()],
            sigmas: [vec![0.1; 200], Vec::new()],
            ..Coordinates::default()
        };
        Drift { last: 3, first: 4, pace: Pace::Once, by: Vector2::new(0.3, 0.0), way: Vec::new() }
            .widen(&mut coordinates);
        let expected = 0.1_f32.hypot(0.6 / 3_f32.sqrt());
        let is_known = (0..200).filter(|it| *it != 45);
        assert!(is_known.clone().all(|it| (coordinates.sigmas[0][it] - expected).abs() < 1e-4));
        assert_eq!(coordinates.sigmas[0][45], 0.1);
        coordinates.sigmas[0].fill(0.1);
        widen(&mut coordinates, Vector2::new(0.05, 0.2));
        assert!((coordinates.sigmas[0][0] - 0.1_f32.hypot(0.2)).abs() < 1e-4);
    }

    #[test]
    fn a_camera_that_moved_by_less_than_a_pixel_is_noticed() {
        for (code, from) in [
            (StripeCode::gray([160, 120]), 14),
            (StripeCode::gray([160, 120]), 23),
            (StripeCode::phase([160, 120], 8, 8), 12),
            (StripeCode::phase([160, 120], 8, 8), 16),
            (StripeCode::phase([160, 120], 4, 8), 14),
        ] {
            for seed in 1..=2 {
                assert_eq!(found(&code, from, 0.0, seed), None, "{} pictures", code.pictures().len());
                for by in [0.25, 0.6] {
                    let drift = found(&code, from, by, seed).unwrap_or_else(|| panic!("{from}, {by} px, seed {seed}"));
                    // Sums of steps of before and after lie between.
                    let range = 0.6 * by..1.15 * by + 0.03;
                    assert!(range.contains(&drift.by.norm()), "{from}, {by} px: {drift:?}");
                    assert!(
                        !drift.creeps() && drift.last < from + 4 && drift.first + 4 >= from,
                        "{from}, {by} px: {drift:?}"
                    );
                }
            }
        }
    }

    /// The wall, farther to the right by a hundredth of a pixel times `HUNDREDTHS`.
    fn at<const HUNDREDTHS: usize>(code: &StripeCode, seed: u64) -> Vec<Vec<u8>> {
        fn by<const HUNDREDTHS: usize>() -> f64 {
            HUNDREDTHS as f64 / 100.0
        }
        Scene {
            projector: |x, y| (wall(1).projector)(x - by::<HUNDREDTHS>(), y),
            albedo: |x, y| (wall(1).albedo)(x - by::<HUNDREDTHS>(), y),
            shadow: |x, y| (wall(1).shadow)(x - by::<HUNDREDTHS>(), y),
            ..wall(seed)
        }
        .pictures(code)
    }

    #[test]
    fn a_camera_that_creeps_is_noticed() {
        for code in [StripeCode::gray([160, 120]), StripeCode::phase([160, 120], 8, 8)] {
            for seed in 21..=22 {
                let stations =
                    [at::<0>(&code, seed), at::<25>(&code, seed), at::<50>(&code, seed), at::<75>(&code, seed)];
                let n = stations[0].len();
                for (range, expected) in [(4, 0.75), (2, 0.25)] {
                    // Each picture is the mean of the stations before and after it, as a camera that creeps on sees it.
                    let crept = (0..n).map(|picture| {
                        let place = picture as f64 / (n - 1) as f64 * (range - 1) as f64;
                        let (from, part) =
                            ((place as usize).min(range - 2), place - place.floor().min((range - 2) as f64));
                        let both = stations[from][picture].iter().zip(&stations[from + 1][picture]);
                        both.map(|(a, b)| (f64::from(*a) * (1.0 - part) + f64::from(*b) * part).round() as u8).collect()
                    });
                    let pictures: Vec<Vec<u8>> = crept.collect();
                    let views: Vec<ImageView<'_>> =
                        pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
                    let found = drift(&code, &views, 12).unwrap_or_else(|| panic!("{n}, {expected} px, seed {seed}"));
                    let off = (found.by.norm() - expected).abs();
                    assert!(
                        found.pace == Pace::Even && off < 0.15 * expected + 0.05,
                        "{n}, {expected} px, seed {seed}: {found:?}"
                    );
                    assert_eq!([found.last, found.first], [0, n - 1]);
                }
            }
        }
    }
}
