//! Pictures of another exposure: a camera that chose it by itself, a lamp that grew warm or went out.
//!
//! Whatever a bit shows, its picture and the inverse together are as bright as white and black together. With pictures that are a and b times as bright as they should be,
//! bit / a + inverse / b = white + black in every pixel, whichever of the two it is bright in: with hundreds of pixels of both kinds a and b follow by least squares, in blurred stripes too. Pixels that do not fit are left
//! out step by step; pairs that do not fit on the whole, such as those with a wrong picture, say nothing.
//!
//! Phase steps: over many periods each is as bright as the others on the whole, which tells their exposures nearly; where there are four and more, what is left between them and the waves of the pixels tells them
//! exactly.

use super::code::{Axis, Inverse, Shown, StripeCode};
use crate::ImageView;

/// Pixels that take part.
const SAMPLES: usize = 5000;
/// At least so many must.
const MIN_SAMPLES: usize = 200;
/// Steps of leaving out what does not fit.
const STEPS: usize = 5;
/// Pixels that do not fit in the end, at most [–].
const MOST_OFF: f64 = 0.15;
/// A factor is known where its standard deviation is at most this part of it [–].
const KNOWN: f64 = 0.02;
/// A set in which a picture is off by more than this is evened out. Packed pictures seem to be off by 0.02, those of cameras with a curved response in a room that throws a fifth of the light back by 0.09 [–].
const OFF: f64 = 0.1;
/// In such a set all pictures are evened out that are off by more than this [–].
const OFF_TOO: f64 = 0.01;
/// Of a picture that is bright nearly everywhere the exposure is that of its pixels where most of them, two standard deviations of noise, are alike to within this [–].
const SAME_EVERYWHERE: f64 = 0.1;
/// Exposures beyond this say that something else is wrong [–].
const RANGE: std::ops::RangeInclusive<f64> = 0.15..=6.0;
/// A gray level that may be cut off.
const SATURATED: f64 = 250.0;
/// Phase steps are evened out that are off by more than this [–] …
const STEP_OFF: f64 = 0.015;
/// … and by so many standard deviations, by how far parts of the picture, so many, disagree.
const STEP_SIGMAS: f64 = 5.0;
const PARTS: usize = 8;
/// A wave of a pixel is at least so high [gray levels] …
const LEAST_WAVE: f64 = 6.0;
/// … and its steps are off it by this part of its height at most [–].
const ON_WAVE: f64 = 0.3;
/// What waves tell of an exposure and what brightness on the whole tells differ by no more, where it is one [–].
const SAME: f64 = 0.06;
/// Rounds that estimate waves and exposures alternately: with four steps a round leaves three quarters of the error,
/// with more steps less.
const ROUNDS: usize = 40;

/// A bit's picture and its inverse, and how many times too bright each is beside white and black together.
pub(super) type Pair = ([usize; 2], [f64; 2]);

/// Pictures that are brighter or darker than most, each with how many times; `places` says which picture is what, and `lit` are pixels with their darkest and brightest levels.
pub(super) fn uneven(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    places: &[Option<usize>],
    lit: &[(usize, u8, u8)],
) -> Vec<(usize, f64)> {
    uneven_by(&factors_of_pairs(code, pictures, places, lit), code, pictures, places, lit)
}

/// The same, by what pairs tell.
pub(super) fn uneven_by(
    pairs: &[Pair],
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    places: &[Option<usize>],
    lit: &[(usize, u8, u8)],
) -> Vec<(usize, f64)> {
    let mut off = uneven_pairs(pairs, &of_one_side(code, pictures, places, lit), code, places);
    off.extend(Axis::BOTH.into_iter().flat_map(|axis| uneven_steps(code, axis, pictures, places, lit)));
    off.sort_by_key(|it| it.0);
    off
}

/// Phase steps of an axis of another exposure than the others.
fn uneven_steps(
    code: &StripeCode,
    axis: Axis,
    pictures: &[ImageView<'_>],
    places: &[Option<usize>],
    lit: &[(usize, u8, u8)],
) -> Vec<(usize, f64)> {
    let place = |step| code.place(Shown::Phase { axis, step }).and_then(|it| places[it]);
    let steps: Vec<usize> = (0..code.steps).filter_map(place).collect();
    if code.steps < 3 || steps.len() != code.steps as usize {
        return Vec::new();
    }
    let some = lit.iter().step_by(lit.len().div_ceil(SAMPLES).max(1));
    let rows: Vec<Vec<f64>> =
        some.map(|it| steps.iter().map(|step| f64::from(pictures[*step].pixels()[it.0])).collect()).collect();
    let rows: Vec<&[f64]> =
        rows.iter().map(|it| &it[..]).filter(|it| it.iter().all(|level| *level < SATURATED)).collect();
    if rows.len() < MIN_SAMPLES * PARTS {
        return Vec::new();
    }
    let Some(all) = of_steps(&rows) else { return Vec::new() };
    // By rows of the picture: what the light there has of its own does not depend on the step.
    let parts: Vec<Vec<f64>> = rows.chunks(rows.len().div_ceil(PARTS)).filter_map(of_steps).collect();
    if parts.len() < PARTS / 2 {
        return Vec::new();
    }
    let n = parts.len() as f64;
    let is_off = |at: usize| {
        let spread = parts.iter().map(|it| (it[at] - all[at]).powi(2)).sum::<f64>() / n;
        let off = (all[at] - 1.0).abs();
        off > STEP_OFF.max(STEP_SIGMAS * (spread / n).sqrt()) && RANGE.contains(&all[at])
    };
    (0..steps.len()).filter(|it| is_off(*it)).map(|it| (steps[it], all[it])).collect()
}

/// How many times as bright as the middle one of them the steps of a wave are, by what pixels see of each.
fn of_steps(rows: &[&[f64]]) -> Option<Vec<f64>> {
    let n = rows.first()?.len();
    let turns: Vec<[f64; 2]> =
        (0..n).map(|it| (std::f64::consts::TAU * it as f64 / n as f64).sin_cos()).map(|(s, c)| [c, s]).collect();
    let mut factors: Vec<f64> = (0..n).map(|step| rows.iter().map(|it| it[step]).sum()).collect();
    to_middle(&mut factors)?;
    if n == 3 {
        return Some(factors);
    }
    let on_the_whole = factors.clone();
    for _ in 0..ROUNDS {
        let (mut products, mut squares) = (vec![0.0; n], vec![0.0; n]);
        for row in rows {
            let (mut mean, mut cosine, mut sine) = (0.0, 0.0, 0.0);
            for ((level, factor), [c, s]) in row.iter().zip(&factors).zip(&turns) {
                let level = level / factor / n as f64;
                (mean, cosine, sine) = (mean + level, cosine + 2.0 * level * c, sine + 2.0 * level * s);
            }
            let wave = |[c, s]: &[f64; 2]| mean + cosine * c + sine * s;
            let height = cosine.hypot(sine);
            let off = row.iter().zip(&factors).zip(&turns);
            let off = off.map(|((level, factor), it)| (level / factor - wave(it)).powi(2)).sum::<f64>() / n as f64;
            if height < LEAST_WAVE || off.sqrt() > ON_WAVE * height {
                continue;
            }
            for (step, turn) in turns.iter().enumerate() {
                products[step] += row[step] * wave(turn);
                squares[step] += wave(turn).powi(2);
            }
        }
        factors = products.iter().zip(&squares).map(|(product, square)| product / square).collect();
        to_middle(&mut factors)?;
    }
    factors.iter().zip(&on_the_whole).all(|(waves, whole)| (waves - whole).abs() <= SAME).then_some(factors)
}

/// Divides by the middle one.
fn to_middle(factors: &mut [f64]) -> Option<()> {
    let mut sorted = factors.to_vec();
    sorted.sort_by(f64::total_cmp);
    let middle = 0.5 * (sorted[(sorted.len() - 1) / 2] + sorted[sorted.len() / 2]);
    factors.iter_mut().for_each(|it| *it /= middle);
    factors.iter().all(|it| it.is_finite() && *it > 0.0).then_some(())
}

/// Pictures of bits, and white, of another exposure; `alone` are those of which the other one of their bit is dark.
fn uneven_pairs(
    pairs: &[Pair],
    alone: &[(usize, f64)],
    code: &StripeCode,
    places: &[Option<usize>],
) -> Vec<(usize, f64)> {
    let mut factors: Vec<(usize, f64)> =
        pairs.iter().flat_map(|(pair, factors)| pair.iter().copied().zip(*factors)).collect();
    let mut all: Vec<f64> = factors.iter().map(|it| it.1).collect();
    all.sort_by(f64::total_cmp);
    let Some(most) = all.get(all.len() / 2).copied() else { return Vec::new() };
    factors.extend(alone);
    let picture = |what: Shown| code.place(what).and_then(|it| places[it]);
    if let (Some(white), Some(_)) = (picture(Shown::White), picture(Shown::Black)) {
        factors.push((white, 1.0));
    }
    let relative = factors.into_iter().map(|(picture, it)| (picture, it / most));
    let off: Vec<(usize, f64)> = relative.filter(|it| (it.1 - 1.0).abs() > OFF_TOO).collect();
    if off.iter().all(|it| (it.1 - 1.0).abs() <= OFF) {
        return Vec::new();
    }
    off
}

/// What pairs tell, without those that do not.
pub(super) fn factors_of_pairs(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    places: &[Option<usize>],
    lit: &[(usize, u8, u8)],
) -> Vec<Pair> {
    let rows = rows_of_pairs(code, pictures, places, lit);
    rows.into_iter().filter_map(|(pair, rows)| Some((pair, fit(&rows)?))).collect()
}

/// How many times too bright pictures are that are bright nearly everywhere, by white and black less the other picture of their bit, which is as dark as black: that one's exposure nothing tells.
fn of_one_side(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    places: &[Option<usize>],
    lit: &[(usize, u8, u8)],
) -> Vec<(usize, f64)> {
    let rows = rows_of_pairs(code, pictures, places, lit);
    rows.into_iter().filter_map(|(pair, rows)| fit_one(&rows).map(|(bright, it)| (pair[bright], it))).collect()
}

/// By pair of a bit and its inverse the levels of pixels in both, and white and black together.
fn rows_of_pairs(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    places: &[Option<usize>],
    lit: &[(usize, u8, u8)],
) -> Vec<([usize; 2], Vec<[f64; 3]>)> {
    if code.inverse == Inverse::None {
        return Vec::new();
    }
    let picture = |what: Shown| code.place(what).and_then(|it| places[it]);
    let (white, black) = (picture(Shown::White), picture(Shown::Black));
    let level = |picture: usize, at: usize| f64::from(pictures[picture].pixels()[at]);
    let some: Vec<&(usize, u8, u8)> = lit.iter().step_by(lit.len().div_ceil(SAMPLES).max(1)).collect();
    let sum = |it: &(usize, u8, u8)| match (white, black) {
        (Some(white), Some(black)) => {
            let white = level(white, it.0);
            (white < SATURATED).then(|| white + level(black, it.0))
        }
        _ => Some(f64::from(it.1) + f64::from(it.2)),
    };
    let sums: Vec<Option<f64>> = some.iter().map(|it| sum(it)).collect();
    let mut found = Vec::new();
    for (axis, plane) in Axis::BOTH.into_iter().flat_map(|axis| (0..code.bits[axis.index()]).map(move |it| (axis, it)))
    {
        let of = |inverse: bool| picture(Shown::Bit { axis, plane, inverse });
        let (Some(bit), Some(inverse)) = (of(false), of(true)) else { continue };
        let mut rows: Vec<[f64; 3]> = Vec::new();
        for (it, sum) in some.iter().zip(&sums) {
            let (a, b) = (level(bit, it.0), level(inverse, it.0));
            if let Some(sum) = sum.filter(|_| a < SATURATED && b < SATURATED) {
                rows.push([a, b, sum]);
            }
        }
        found.push(([bit, inverse], rows));
    }
    found
}

/// How many times too bright the two of a pair are, by the levels of pixels in both and by white and black together; `None` where they do not say it, or are no pair.
pub(super) fn fit(rows: &[[f64; 3]]) -> Option<[f64; 2]> {
    if rows.len() < MIN_SAMPLES {
        return None;
    }
    // A bit that is dark all over the picture says nothing: what light there is in it comes from where the projector shows it bright.
    if is_of_one_side(rows) {
        return None;
    }
    let mut kept = vec![true; rows.len()];
    let mut solved = ([1.0; 2], [0.0; 2]);
    for _ in 0..STEPS {
        solved = least_squares(rows.iter().zip(&kept).filter(|it| *it.1).map(|it| it.0))?;
        let off: Vec<f64> = rows.iter().map(|it| (solved.0[0] * it[0] + solved.0[1] * it[1] - it[2]).abs()).collect();
        let mut sorted = off.clone();
        sorted.sort_by(f64::total_cmp);
        // Three standard deviations, and what rounding and packing make of small levels.
        let most = 3.0 * 1.4826 * sorted[sorted.len() / 2] + 1.0;
        kept = off.iter().map(|it| *it <= most).collect();
    }
    let (inverses, sigmas) = solved;
    let is_off = |it: &&[f64; 3]| (inverses[0] * it[0] + inverses[1] * it[1] - it[2]).abs() > (0.1 * it[2]).max(12.0);
    let is_known = (0..2).all(|it| sigmas[it] <= KNOWN * inverses[it]);
    let fits = rows.iter().filter(is_off).count() as f64 <= MOST_OFF * rows.len() as f64;
    let factors = inverses.map(f64::recip);
    (is_known && fits && factors.iter().all(|it| RANGE.contains(it))).then_some(factors)
}

/// Whether one picture of a pair is bright nearly everywhere.
fn is_of_one_side(rows: &[[f64; 3]]) -> bool {
    let n_bright = rows.iter().filter(|it| it[0] > it[1]).count();
    n_bright.min(rows.len() - n_bright) < MIN_SAMPLES / 4
}

/// Which of a pair is bright nearly everywhere, and how many times too bright it is.
fn fit_one(rows: &[[f64; 3]]) -> Option<(usize, f64)> {
    if rows.len() < MIN_SAMPLES || !is_of_one_side(rows) {
        return None;
    }
    let bright = usize::from(2 * rows.iter().filter(|it| it[0] > it[1]).count() < rows.len());
    let mut ratios: Vec<f64> = rows.iter().map(|it| it[bright] / (it[2] - it[1 - bright]).max(1.0)).collect();
    ratios.sort_by(f64::total_cmp);
    let at = |share: f64| ratios[(share * (ratios.len() - 1) as f64) as usize];
    let (factor, spread) = (at(0.5), at(0.84) - at(0.16));
    // Another exposure is alike everywhere.
    (RANGE.contains(&factor) && spread <= SAME_EVERYWHERE * factor).then_some((bright, factor))
}

/// x and y of x a + y b = sum, with their standard deviations.
fn least_squares<'a>(rows: impl Iterator<Item = &'a [f64; 3]> + Clone) -> Option<([f64; 2], [f64; 2])> {
    let (mut aa, mut ab, mut bb, mut sa, mut sb) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for [a, b, sum] in rows.clone() {
        (aa, ab, bb, sa, sb) = (aa + a * a, ab + a * b, bb + b * b, sa + a * sum, sb + b * sum);
    }
    let determinant = aa * bb - ab * ab;
    let [x, y] = [(sa * bb - sb * ab) / determinant, (sb * aa - sa * ab) / determinant];
    let (mut squares, mut n) = (0.0, 0.0);
    for [a, b, sum] in rows {
        squares += (x * a + y * b - sum) * (x * a + y * b - sum);
        n += 1.0;
    }
    let variance: f64 = squares / n;
    let sigmas = [bb, aa].map(|it| (variance * it / determinant).sqrt());
    (x.is_finite() && y.is_finite() && sigmas.iter().all(|it| it.is_finite())).then_some(([x, y], sigmas))
}

/// A picture as it would be with the exposure of the others; what is saturated stays so.
pub(super) fn evened(pixels: &[u8], factor: f64) -> Vec<u8> {
    let level = |it: usize| match it as f64 {
        full if full >= SATURATED => it as u8,
        level => (level / factor).round().min(255.0) as u8,
    };
    let table: Vec<u8> = (0..256).map(level).collect();
    pixels.iter().map(|it| table[usize::from(*it)]).collect()
}

#[cfg(test)]
mod tests {
    use super::super::scene::{Scene, wall, wall_code, wall_set};
    use super::*;

    /// What is found of a wall's pictures some of which are darker or brighter.
    fn found(factors: &[(usize, f64)], seed: u64) -> Vec<(usize, f64)> {
        let code = wall_code();
        let mut pictures = wall_set(seed);
        for (picture, factor) in factors {
            pictures[*picture].iter_mut().for_each(|it| *it = (f64::from(*it) * factor).round().min(255.0) as u8);
        }
        let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
        let (white, black) = (&pictures[30], &pictures[31]);
        let lit = (0..19_200)
            .filter(|it| white[*it] > black[*it] + 20)
            .map(|it| (it, black[it], white[it]))
            .collect::<Vec<_>>();
        let mut found = uneven(&code, &views, &(0..32).map(Some).collect::<Vec<_>>(), &lit);
        found.retain(|it| (it.1 - 1.0).abs() > 0.05);
        found
    }

    #[test]
    fn pictures_of_another_exposure_are_found_with_their_factor() {
        for seed in 1..=3 {
            assert_eq!(found(&[], seed), [], "seed {seed}");
            for factors in [vec![(6, 0.7)], vec![(0, 0.6), (9, 1.2), (17, 0.8)], vec![(30, 0.75)]] {
                let found = found(&factors, seed);
                assert_eq!(found.len(), factors.len(), "seed {seed}: {found:?} for {factors:?}");
                for ((at, factor), (expected_at, expected)) in found.iter().zip(&factors) {
                    assert!(at == expected_at && (factor / expected - 1.0).abs() < 0.03, "seed {seed}: {found:?}");
                }
            }
        }
    }

    /// What is found of the phase steps of a wall's columns after `change`.
    fn found_of_steps(steps: u32, power: f64, change: impl Fn(&mut [Vec<u8>])) -> Vec<(usize, f64)> {
        let code = StripeCode::phase([160, 120], steps, 8);
        let mut pictures = Scene { power, ..wall(5) }.pictures(&code);
        let first = code.place(Shown::Phase { axis: Axis::Columns, step: 0 }).unwrap();
        change(&mut pictures[first..first + steps as usize]);
        let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
        let n = views.len();
        let lit: Vec<_> = (0..19_200).filter(|it| !(86..=90).contains(&(it % 160))).map(|it| (it, 10, 200)).collect();
        let found = uneven_steps(&code, Axis::Columns, &views, &(0..n).map(Some).collect::<Vec<_>>(), &lit);
        found.into_iter().map(|it| (it.0 - first, it.1)).collect()
    }

    #[test]
    fn phase_steps_of_another_exposure_are_found_with_their_factor() {
        let darker = |step: usize, factor: f64| {
            move |steps: &mut [Vec<u8>]| {
                steps[step].iter_mut().for_each(|it| *it = (f64::from(*it) * factor).round() as u8);
            }
        };
        for steps in [3, 4, 5, 8] {
            for power in [1.0, 2.2] {
                assert_eq!(found_of_steps(steps, power, |_| ()), [], "{steps} steps, power {power}");
                // Three steps tell it by how bright they are on the whole alone, which so small a picture tells but roughly.
                for factor in if steps == 3 { [0.6, 0.7] } else { [0.9, 0.7] } {
                    let found = found_of_steps(steps, power, darker(1, factor));
                    let is_it = found.len() == 1
                        && found[0].0 == 1
                        && (found[0].1 - factor).abs() < if steps == 3 { 0.03 } else { 0.02 };
                    assert!(is_it, "{steps} steps, power {power}: {found:?} for {factor}");
                }
            }
        }
        // What is no exposure is not evened out.
        assert_eq!(found_of_steps(8, 1.0, |it| it.swap(1, 2)), []);
        assert_eq!(found_of_steps(4, 1.0, |it| it[1].iter_mut().for_each(|it| *it = 255 - *it)), []);
    }

    #[test]
    fn a_lamp_that_fades_is_found_in_every_picture() {
        let fading: Vec<(usize, f64)> = (0..32).map(|it| (it, 1.0 - 0.4 * it as f64 / 31.0)).collect();
        let found = found(&fading, 2);
        let middle = fading[15].1;
        for (at, factor) in &found {
            assert!((factor * middle / fading[*at].1 - 1.0).abs() < 0.04, "{at}: {factor}");
        }
        assert!(found.len() > 20, "{found:?}");
    }

    #[test]
    fn a_picture_that_is_bright_everywhere_tells_its_exposure_and_its_opposite_none() {
        // White and black together of pixels, and a bit that is white everywhere.
        let rows = |factor: f64, uneven: f64| -> Vec<[f64; 3]> {
            let pixel = |it: usize| {
                let (white, black) = (60.0 + (it % 97) as f64, 8.0 + (it % 7) as f64);
                [factor * (white + uneven * (it % 3) as f64), black, white + black]
            };
            (0..1000).map(pixel).collect()
        };
        for factor in [0.7, 1.0, 1.3] {
            let (bright, found) = fit_one(&rows(factor, 0.0)).unwrap();
            assert!(bright == 0 && (found - factor).abs() < 0.01, "{found} for {factor}");
            let swapped: Vec<[f64; 3]> = rows(factor, 0.0).into_iter().map(|[a, b, sum]| [b, a, sum]).collect();
            assert_eq!(fit_one(&swapped), Some((1, found)));
            assert_eq!(fit(&rows(factor, 0.0)), None);
        }
        // What is not alike everywhere is no exposure; stripes tell both.
        assert_eq!(fit_one(&rows(1.0, 30.0)), None);
        let stripes: Vec<[f64; 3]> = rows(1.0, 0.0)
            .into_iter()
            .enumerate()
            .map(|(at, [a, b, sum])| if at % 2 == 0 { [a, b, sum] } else { [b, a, sum] })
            .collect();
        assert_eq!(fit_one(&stripes), None);
    }

    #[test]
    fn evened_pictures_keep_what_is_saturated() {
        assert_eq!(evened(&[0, 70, 140, 255], 0.7), [0, 100, 200, 255]);
    }
}
