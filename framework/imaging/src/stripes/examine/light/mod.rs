//! Ambient light that differs between the pictures of a set, and the set without it.

use super::super::code::{Axis, Inverse, Shown, StripeCode};
use super::super::faults::SetFault;
use super::super::{exposure, stretches};
use super::{Examination, look};
use crate::ImageView;
use waves::Waves;

mod waves;

/// Pictures with their pixels in another light.
type Relit = Vec<(usize, Vec<u8>)>;

/// Lights are switched so many times in a set.
const SWITCHED: usize = 2;
/// Pairs and pixels that tell an unsteady light, at least, and pixels at most.
const MIN_PAIRS: usize = 6;
const MIN_SAMPLES: usize = 500;
const SAMPLES: usize = 5000;
/// A gray level that may be cut off.
const SATURATED: u8 = 250;
/// Turns in which the light's picture and what each pair has of it are found.
const ROUNDS: usize = 8;
/// Light that differs by less in sums of two pictures is steady [gray levels]. At least so many sums that differ
/// distinguish it from another exposure, whose stripes differ in each sum; with fewer, the stripes themselves decide.
const LEAST: f64 = 2.0;
const MIN_UNLIKE: usize = 3;
/// Its picture has one sign in this part of the pixels [–].
const ONE_SIGN: f64 = 0.97;
/// It explains a sum where it is off by no more than so many gray levels, and so many standard deviations of a picture's noise, but in this part of the pixels.
const LEVELS: f64 = 5.0;
const SIGMAS: f64 = 6.0;
const OFF: f64 = 0.05;
/// … and this part of the sum: pairs of packed pictures and of responses that are a little curved are off in proportion [–].
const PART: f64 = 0.05;
/// In a pixel that the projector lights the two of the middle one of all pairs differ by this part of what those of any pair do, at least [–].
const STRIPED: f64 = 0.45;
/// The difference of the two of a pair is what this part of all pairs do not exceed: of fine stripes less is seen, and a lamp that is on in one picture makes more [–].
const USUAL: f64 = 0.94;
/// A light that few sums have is as bright where a picture is bright as where it is dark, but for this factor: another exposure is not [–].
const AS_BRIGHT: f64 = 1.6;
/// A pixel of a pair is certain where its difference is this part of the usual one of all pairs [–].
const CERTAIN: f64 = 0.85;
/// … and in some direction where it is this part.
const SEEN: f64 = 0.3;
/// Stripes and light are distinguished where they are less alike than this, as 1 less the square of their correlation [–].
const TOLD_APART: f64 = 0.2;
/// Pictures of which both tell it, at least.
const MIN_TOLD: usize = 4;
/// Pixels of a picture that tell how much of the light it has, at least.
const MIN_SEEN: usize = 30;
/// What dark and what bright places tell of the light of pictures is as alike [–].
const ALIKE: f64 = 0.4;

/// What is found of a set with all its pictures without the light that they differ in, which was switched or not steady; `found` is what was found with it. `None` where there is no such light, or
/// anything else differs: exposures, and what moved.
pub(super) fn in_one_light(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    absent: &[usize],
    min_contrast: u8,
    found: &Examination,
    lit: &[(usize, u8, u8)],
    places: &[Option<usize>],
) -> Option<Examination> {
    let shown = code.pictures();
    let without = |(mut relit, lights): (Relit, Vec<SetFault>)| {
        let views = replaced(pictures, &relit)?;
        let (mut without, lit) = look(code, &views, absent, min_contrast);
        let is_moved = without.faults.iter().any(|it| matches!(it, SetFault::Moved { .. }));
        let uneven = exposure::uneven(code, &views, places, &lit);
        drop(views);
        let is_step = |it: usize| places.iter().position(|at| *at == Some(it)).map(|it| shown[it]);
        let is_step = |it: usize| matches!(is_step(it), Some(Shown::Phase { .. }));
        // What is left in steps is evened out; in others it says that the light is none.
        if is_moved || !uneven.iter().all(|it| is_step(it.0)) {
            return None;
        }
        for (picture, factor) in uneven {
            let of_picture = relit.iter_mut().find(|it| it.0 == picture)?;
            of_picture.1 = exposure::evened(&of_picture.1, factor);
        }
        without.faults.splice(0..0, lights);
        without.relit = relit;
        Some(without)
    };
    let switched = switched(code, pictures, found, lit, places);
    let steadied = || steadied(code, pictures, places, lit, found.noise).and_then(without);
    // What seems to be switched again and again is not steady.
    match switched {
        Some(it) if it.1.len() > SWITCHED => steadied().or_else(|| without(it)),
        Some(it) => without(it).or_else(steadied),
        None => steadied(),
    }
}

/// Without lights that were switched between two pictures.
fn switched(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    found: &Examination,
    lit: &[(usize, u8, u8)],
    places: &[Option<usize>],
) -> Option<(Relit, Vec<SetFault>)> {
    let switched = |it: &SetFault| match *it {
        SetFault::Moved { last, first, light: Some(by), .. } => Some(SetFault::Relit { last, first, by }),
        _ => None,
    };
    let lights: Vec<SetFault> = found.faults.iter().filter_map(switched).collect();
    if lights.is_empty() {
        return None;
    }
    let stretches = stretches::scenes(code, pictures, places, lit, found.noise).stretches?;
    let relit = stretches::relit(code, pictures, places, &stretches);
    (!relit.is_empty()).then_some((relit, lights))
}

/// Without what a light that was not steady has more or less of in each picture than in all of them.
///
/// A pair of opposite pictures adds up to white and black, whatever its stripes are, and to what both have of the light: sums differ from the middle one by one picture, that of the light, times one number a pair. How
/// the two of a pair share it their difference says, which is that of white and black in one or the other direction, and what the one has more of the light.
fn steadied(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    places: &[Option<usize>],
    lit: &[(usize, u8, u8)],
    noise: f64,
) -> Option<(Relit, Vec<SetFault>)> {
    let picture = |what: Shown| code.place(what).and_then(|it| places[it]);
    let bits = Axis::BOTH.into_iter().filter(|it| code.has(*it)).flat_map(|axis| {
        (0..code.bits[axis.index()]).map(move |plane| [false, true].map(|inverse| Shown::Bit { axis, plane, inverse }))
    });
    let pairs = bits.chain([[Shown::White, Shown::Black]]);
    let pairs: Vec<[usize; 2]> = pairs.filter_map(|[a, b]| Some([picture(a)?, picture(b)?])).collect();
    if code.inverse == Inverse::None || pairs.len() < MIN_PAIRS {
        return None;
    }
    let levels = |picture: usize, at: usize| f64::from(pictures[picture].pixels()[at]);
    let is_whole = |it: &&(usize, u8, u8)| it.2 < SATURATED;
    // Where the projector does not reach, a light that differs from picture to picture makes pixels bright and dark too, but not by as much in all pairs.
    let has_stripes = |at: usize| {
        let mut all: Vec<f64> = pairs.iter().map(|[a, b]| (levels(*a, at) - levels(*b, at)).abs()).collect();
        all.sort_by(f64::total_cmp);
        all[all.len() / 2] >= STRIPED * all[all.len() - 1]
    };
    let some: Vec<usize> = lit
        .iter()
        .filter(is_whole)
        .step_by(lit.len().div_ceil(SAMPLES).max(1))
        .map(|it| it.0)
        .filter(|it| has_stripes(*it))
        .collect();
    if some.len() < MIN_SAMPLES {
        return None;
    }
    // By pair and sample: how far the sum is off that of the middle pair, and how large the difference is, with its sign.
    let mut sums: Vec<Vec<f64>> =
        pairs.iter().map(|[a, b]| some.iter().map(|at| levels(*a, *at) + levels(*b, *at)).collect()).collect();
    let mut middles = vec![0.0; some.len()];
    for (it, middle) in middles.iter_mut().enumerate() {
        let mut all: Vec<f64> = sums.iter().map(|sum| sum[it]).collect();
        all.sort_by(f64::total_cmp);
        *middle = 0.5 * (all[all.len() / 2] + all[(all.len() - 1) / 2]);
        sums.iter_mut().for_each(|sum| sum[it] -= *middle);
    }
    let differences: Vec<Vec<f64>> =
        pairs.iter().map(|[a, b]| some.iter().map(|at| levels(*a, *at) - levels(*b, *at)).collect()).collect();
    // The one picture whose multiples sums differ by.
    let power = |it: &Vec<f64>| it.iter().map(|it| it * it).sum::<f64>();
    let mut light = sums.iter().max_by(|a, b| power(a).total_cmp(&power(b)))?.clone();
    let mut shares = vec![0.0; pairs.len()];
    for _ in 0..ROUNDS {
        let all = power(&light);
        shares = sums.iter().map(|sum| dot(sum, &light) / all).collect();
        let all = power(&shares);
        light = (0..some.len())
            .map(|it| sums.iter().zip(&shares).map(|(sum, share)| sum[it] * share).sum::<f64>() / all)
            .collect();
    }
    // A light is nowhere dark; and it is all that sums differ by.
    let n_lit = light.iter().filter(|it| **it > 0.0).count() as f64 / light.len() as f64;
    let is_off = |(sum, share): (&Vec<f64>, &f64)| {
        let most = |middle: f64| LEVELS.max(SIGMAS * noise).max(PART * middle);
        let off = sum.iter().zip(&light).zip(&middles);
        let off = off.filter(|((sum, light), middle)| (*sum - share * *light).abs() > most(**middle)).count();
        off as f64 > OFF * some.len() as f64
    };
    let mut sorted = light.clone();
    sorted.sort_by(f64::total_cmp);
    let brightness = sorted[sorted.len() / 2].abs();
    let n_unlike = shares.iter().filter(|it| it.abs() * brightness >= LEAST).count();
    if n_lit.max(1.0 - n_lit) < ONE_SIGN || n_unlike == 0 || sums.iter().zip(&shares).any(is_off) {
        return None;
    }
    if n_unlike < MIN_UNLIKE {
        let is_unlike = |it: &(&Vec<f64>, &f64)| it.1.abs() * brightness >= LEAST;
        let mut unlike = differences.iter().zip(&shares).filter(is_unlike);
        if !unlike.all(|(of, _)| is_as_bright(&light, of)) {
            return None;
        }
    }
    // What each picture has of it, by where it is dark and by where it is bright: another exposure makes bright places brighter, and dark ones hardly.
    let of_bits = &differences[..differences.len() - 1];
    let contrast: Vec<f64> =
        (0..some.len()).map(|it| at_share(USUAL, of_bits.iter().map(|of| of[it].abs()).collect())).collect();
    let sides = [false, true].map(|is_bright| {
        let seen = pairs.iter().zip(&differences).flat_map(|(pair, of)| {
            [0, 1].map(|which| {
                let sign = if (which == 0) == is_bright { 1.0 } else { -1.0 };
                let there = (0..some.len()).filter(|it| sign * of[*it] >= CERTAIN * contrast[*it]);
                there.map(|it| (it, levels(pair[which], some[it]))).collect::<Vec<_>>()
            })
        });
        of_each(&seen.collect::<Vec<_>>(), &light)
    });
    // Each counts from a mean of its own, of the pictures that it tells something of.
    let both = sides[0].iter().zip(&sides[1]).filter_map(|(dark, bright)| Some([(*dark)?, (*bright)?]));
    let both: Vec<[f64; 2]> = both.collect();
    let [dark, bright] = [0, 1].map(|side| {
        let mean = both.iter().map(|it| it[side]).sum::<f64>() / both.len().max(1) as f64;
        both.iter().map(|it| it[side] - mean).collect::<Vec<f64>>()
    });
    let (dark, bright) = (&dark, &bright);
    // Of few sums, which stripes told apart from exposures above, blur of fine stripes tells more here than light.
    if n_unlike >= MIN_UNLIKE
        && (both.len() < MIN_TOLD || dot(dark, bright) < ALIKE * dot(dark, dark).max(dot(bright, bright)))
    {
        return None;
    }
    // What the first of a pair has more than the second: differences are so many times the usual one, in one or the other direction, and this. White is brighter than black everywhere: of them it is as
    // many times as of coarse bits.
    let sums_of = |of: &Vec<f64>| {
        let [mut cc, mut cl, mut ll, mut co, mut lo] = [0.0; 5];
        for it in (0..some.len()).filter(|it| of[*it].abs() >= SEEN * contrast[*it]) {
            let (c, l) = (of[it].signum() * contrast[it], light[it]);
            (cc, cl, ll, co, lo) = (cc + c * c, cl + c * l, ll + l * l, co + c * of[it], lo + l * of[it]);
        }
        (cc * ll - cl * cl, [cc, cl, ll, co, lo])
    };
    let all: Vec<(f64, [f64; 5])> = differences.iter().map(sums_of).collect();
    let is_told = |determinant: f64, [cc, _, ll, ..]: [f64; 5]| determinant > TOLD_APART * cc * ll;
    let told = all.iter().filter(|it| is_told(it.0, it.1));
    let usual = told.map(|(determinant, [_, cl, ll, co, lo])| (ll * co - cl * lo) / determinant).fold(0.0, f64::max);
    let mut parts: Vec<(usize, f64)> = Vec::new();
    for ([a, b], (share, (determinant, sums))) in pairs.iter().zip(shares.iter().zip(&all)) {
        let [cc, cl, ll, co, lo] = *sums;
        let more = match is_told(*determinant, *sums) {
            true => (cc * lo - cl * co) / determinant,
            false => (lo - usual * cl) / ll.max(1e-9),
        };
        parts.extend([(*a, (share + more) / 2.0), (*b, (share - more) / 2.0)]);
    }
    let n = pictures.first()?.pixels().len();
    let mut whole = vec![0.0_f32; n];
    let mean = shares.iter().sum::<f64>() / pairs.len() as f64;
    let square: f64 = shares.iter().map(|it| (it - mean).powi(2)).sum();
    for ([a, b], share) in pairs.iter().zip(&shares) {
        let weight = ((share - mean) / square) as f32;
        let both = pictures[*a].pixels().iter().zip(pictures[*b].pixels());
        whole.iter_mut().zip(both).for_each(|(to, (a, b))| *to += weight * (f32::from(*a) + f32::from(*b)));
    }
    if code.steps > 0 {
        // Steps of a wave have no opposite.
        let part_of = |picture: usize| parts.iter().find(|it| it.0 == picture).map_or(0.0, |it| it.1);
        let in_steps = |what: Shown| {
            let picture = picture(what)?;
            Some(some.iter().map(|at| levels(picture, *at) - part_of(picture) * f64::from(whole[*at])).collect())
        };
        let (white, black) = (in_steps(Shown::White)?, in_steps(Shown::Black)?);
        let light = some.iter().map(|at| f64::from(whole[*at])).collect();
        let waves = Waves { white, black, light };
        for axis in Axis::BOTH.into_iter().filter(|it| code.has(*it)) {
            let steps: Option<Vec<usize>> = (0..code.steps).map(|step| picture(Shown::Phase { axis, step })).collect();
            let Some(steps) = steps else { continue };
            let rows: Vec<Vec<f64>> = some.iter().map(|at| steps.iter().map(|it| levels(*it, *at)).collect()).collect();
            parts.extend(steps.into_iter().zip(waves.light_of_steps(&rows)?));
        }
    }
    let one = |&(picture, part): &(usize, f64)| {
        let off = whole.iter().map(|it| part as f32 * it);
        let pixels = pictures[picture].pixels().iter().zip(off);
        (picture, pixels.map(|(it, off)| (f32::from(*it) - off).round().clamp(0.0, 255.0) as u8).collect())
    };
    let by = parts.iter().map(|it| it.1.abs()).fold(0.0, f64::max) * brightness;
    Some((parts.iter().map(one).collect(), vec![SetFault::Unsteady { by }]))
}

/// Whether a light is as bright where the difference of a pair has one sign as where it has the other.
fn is_as_bright(light: &[f64], difference: &[f64]) -> bool {
    let middle = |sign: f64| {
        let mut there: Vec<f64> =
            light.iter().zip(difference).filter(|it| it.1 * sign > 0.0).map(|it| it.0.abs()).collect();
        there.sort_by(f64::total_cmp);
        there.get(there.len() / 2).copied().filter(|_| there.len() >= MIN_SAMPLES / 4)
    };
    let (Some(a), Some(b)) = (middle(1.0), middle(-1.0)) else { return false };
    a.max(b) <= AS_BRIGHT * a.min(b)
}

/// What this part of some numbers do not exceed.
fn at_share(part: f64, mut all: Vec<f64>) -> f64 {
    all.sort_by(f64::total_cmp);
    all.get((part * all.len().saturating_sub(1) as f64) as usize).copied().unwrap_or_default()
}

/// How many times a light each picture has, by some of their pixels: number and level; `None` of a picture without any. Without it, levels of a pixel are the same in all pictures that have it.
fn of_each(seen: &[Vec<(usize, f64)>], light: &[f64]) -> Vec<Option<f64>> {
    let mut times = vec![0.0; seen.len()];
    for _ in 0..ROUNDS {
        let mut means = vec![(0.0, 0.0); light.len()];
        for (picture, times) in seen.iter().zip(&times) {
            for (at, level) in picture {
                means[*at] = (means[*at].0 + level - times * light[*at], means[*at].1 + 1.0);
            }
        }
        for (picture, times) in seen.iter().zip(&mut times) {
            let (mut product, mut square) = (0.0, 0.0);
            for (at, level) in picture {
                product += (level - means[*at].0 / means[*at].1) * light[*at];
                square += light[*at].powi(2);
            }
            *times = if square > 0.0 { product / square } else { 0.0 };
        }
    }
    times.into_iter().zip(seen).map(|(times, seen)| Some(times).filter(|_| seen.len() >= MIN_SEEN)).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|it| it.0 * it.1).sum()
}

/// Pictures with some of them replaced.
pub(super) fn replaced<'a>(pictures: &[ImageView<'a>], by: &'a [(usize, Vec<u8>)]) -> Option<Vec<ImageView<'a>>> {
    let mut views = pictures.to_vec();
    for (at, pixels) in by {
        let (width, height) = views[*at].size();
        views[*at] = ImageView::new(pixels, width, height).ok()?;
    }
    Some(views)
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;

    use super::super::super::scene::{Scene, wall, wall_code, wall_set};
    use super::super::tests::{MIN_CONTRAST, check, examined};
    use super::super::{Prepared, examine};
    use super::*;

    #[test]
    fn a_light_that_is_switched_is_not_called_motion() {
        let switched = |from: usize, by: u8| {
            move |it: &mut Vec<Vec<u8>>| it[from..].iter_mut().flatten().for_each(|it| *it = it.saturating_add(by))
        };
        let on = |it: &SetFault| matches!(it, SetFault::Relit { by, .. } | SetFault::Moved { light: Some(by), .. } if (by - 25.0).abs() < 0.5);
        check(switched(16, 25), &[&on], &Axis::BOTH);
        check(switched(6, 25), &[&on], &Axis::BOTH);
        for seed in 4..=5 {
            let (plain, mut changed) = (wall_set(seed), wall_set(seed));
            switched(10, 40)(&mut changed);
            let views: Vec<ImageView<'_>> = changed.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
            let found = examine(&wall_code(), &views, &[], MIN_CONTRAST);
            let Prepared { pictures, .. } = found.prepared(&wall_code(), &views);
            // All in the light of the stretch that is kept.
            let off = |at: usize| {
                let levels = pictures[at].iter().zip(&plain[at]).map(|(a, b)| f64::from(*a) - f64::from(*b));
                levels.sum::<f64>() / 19_200.0
            };
            let all: Vec<f64> = (0..pictures.len()).map(off).collect();
            assert!(all.iter().all(|it| (it - all[31]).abs() < 1.0), "seed {seed}: {all:?}");
        }
        let moved = |it: &mut Vec<Vec<u8>>| it[16..].iter_mut().for_each(|it| it.rotate_right(5));
        check(moved, &[&|it| matches!(it, SetFault::Moved { light: None, .. })], &[Axis::Columns]);
    }

    /// The wall's pictures with so many times the room's light of each, which is 14 gray levels times the surface's albedo.
    fn under(light: &[f64], seed: u64) -> Vec<Vec<u8>> {
        let scene = wall(seed);
        let add = |(picture, times): (Vec<u8>, &f64)| {
            let more = |at: usize| 14.0 * (times - 1.0) * (scene.albedo)((at % 160) as f64, (at / 160) as f64);
            let pixels = picture.iter().enumerate();
            pixels.map(|(at, it)| (f64::from(*it) + more(at)).round().clamp(0.0, 255.0) as u8).collect()
        };
        wall_set(seed).into_iter().zip(light).map(add).collect()
    }

    #[test]
    fn a_light_that_is_not_steady_is_taken_off() {
        let n = wall_code().pictures().len();
        for seed in 1..=3 {
            let mut random = Random::new(seed);
            let flicker: Vec<f64> = (0..n).map(|_| 1.8 + 0.6 * random.normal()).collect();
            let growing: Vec<f64> = (0..n).map(|it| 1.0 + 0.1 * it as f64).collect();
            for light in [flicker, growing] {
                let pictures = under(&light, seed);
                let found = examined(&wall_code(), &pictures);
                assert!(matches!(found.faults[..], [SetFault::Unsteady { by }] if by > 2.0), "{:?}", found.faults);
                // As in the middle one of all pairs.
                let mut pairs: Vec<f64> = light.chunks(2).map(|it| (it[0] + it[1]) / 2.0).collect();
                pairs.sort_by(f64::total_cmp);
                let middle = 0.5 * (pairs[pairs.len() / 2] + pairs[(pairs.len() - 1) / 2]);
                let steady = under(&vec![middle; n], seed);
                let views: Vec<ImageView<'_>> =
                    pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
                let Prepared { pictures: evened, .. } = found.prepared(&wall_code(), &views);
                for at in 0..n {
                    // What is cut off stays so.
                    let whole = (0..19_200).filter(|it| pictures[at][*it] < SATURATED);
                    let off: Vec<f64> = whole.map(|it| f64::from(evened[at][it]) - f64::from(steady[at][it])).collect();
                    let rms = (dot(&off, &off) / off.len() as f64).sqrt();
                    // (It differs by 5.5.)
                    assert!(rms < 3.0, "seed {seed}, picture {at}: {rms}");
                }
            }
        }
    }

    /// How far phase steps are off those of a steady light after it was taken off, root mean square [gray levels]: the most of all steps.
    fn steps_off(steps: u32, power: f64, seed: u64) -> (f64, Vec<SetFault>) {
        let code = StripeCode::phase([160, 120], steps, 8);
        let shown = code.pictures();
        let scene = Scene { power, ..wall(seed) };
        let whole = scene.pictures(&code);
        let mut random = Random::new(seed);
        let add = |picture: &Vec<u8>| {
            let times = 1.5 + 0.7 * random.normal();
            let more = |at: usize| 14.0 * times * (scene.albedo)((at % 160) as f64, (at / 160) as f64);
            let pixels = picture.iter().enumerate();
            pixels.map(|(at, it)| (f64::from(*it) + more(at)).round().clamp(0.0, 255.0) as u8).collect()
        };
        let pictures: Vec<Vec<u8>> = whole.iter().map(add).collect();
        let found = examined(&code, &pictures);
        let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
        let prepared = found.prepared(&code, &views);
        let off = |axis: Axis| {
            let steps: Vec<usize> = (0..steps).filter_map(|step| code.place(Shown::Phase { axis, step })).collect();
            let is_whole = |at: &usize| steps.iter().all(|it| pictures[*it][*at] < SATURATED);
            let some: Vec<usize> = (0..19_200).filter(is_whole).collect();
            let one = |step: usize| {
                let off = some.iter().map(|at| {
                    let off = |it: usize| f64::from(prepared.pictures[it][*at]) - f64::from(whole[it][*at]);
                    // What all steps have alike is no matter.
                    let mean = steps.iter().map(|it| off(*it)).sum::<f64>() / steps.len() as f64;
                    (off(steps[step]) - mean).powi(2)
                });
                (off.sum::<f64>() / some.len() as f64).sqrt()
            };
            (0..steps.len()).map(one).fold(0.0, f64::max)
        };
        assert_eq!(prepared.pictures.len(), shown.len(), "{:?}", found.faults);
        (Axis::BOTH.map(off).into_iter().fold(0.0, f64::max), found.faults)
    }

    #[test]
    fn a_light_that_is_not_steady_is_taken_off_phase_steps() {
        for (steps, power) in [(3, 1.0), (4, 1.0), (8, 1.0), (8, 2.2)] {
            for seed in 1..=2 {
                let (off, faults) = steps_off(steps, power, seed);
                assert!(matches!(faults[..], [SetFault::Unsteady { by }] if by > 5.0), "{steps}, {seed}: {faults:?}");
                // (As they come they differ by 7 to 12.)
                assert!(off < 1.5, "{steps} steps, power {power}, seed {seed}: {off}");
            }
        }
    }

    #[test]
    fn a_light_is_no_exposure_where_the_camera_sees_more_than_the_projector_lights() {
        let code = wall_code();
        let n = code.pictures().len();
        for seed in 1..=2 {
            // A third of the picture lies beside what the projector reaches.
            let scene = Scene { projector: |x, y| [-60.0 + 1.1 * x, 12.0 + 0.58 * y], ..wall(seed) };
            let plain = scene.pictures(&code);
            let mut random = Random::new(seed);
            let flicker: Vec<f64> = (0..n).map(|_| 2.5 + 1.2 * random.normal()).collect();
            let one_lamp: Vec<f64> = (0..n).map(|it| if it == 9 { 4.0 } else { 1.0 }).collect();
            for light in [flicker, one_lamp] {
                let add = |(picture, times): (&Vec<u8>, &f64)| {
                    let more = |at: usize| 14.0 * (times - 1.0) * (scene.albedo)((at % 160) as f64, (at / 160) as f64);
                    let pixels = picture.iter().enumerate();
                    pixels.map(|(at, it)| (f64::from(*it) + more(at)).round().clamp(0.0, 255.0) as u8).collect()
                };
                let pictures: Vec<Vec<u8>> = plain.iter().zip(&light).map(add).collect();
                let found = examined(&code, &pictures);
                assert!(matches!(found.faults[..], [SetFault::Unsteady { .. }]), "seed {seed}: {:?}", found.faults);
                let views: Vec<ImageView<'_>> =
                    pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
                let Prepared { pictures: evened, .. } = found.prepared(&code, &views);
                // All pictures in one light: what a pair adds up to is what white and black do.
                let sum =
                    |pair: usize, at: usize| f64::from(evened[2 * pair][at]) + f64::from(evened[2 * pair + 1][at]);
                for pair in 0..n / 2 - 1 {
                    let some = (0..19_200).filter(|it| (0..n).all(|picture| pictures[picture][*it] < SATURATED));
                    let off: Vec<f64> = some.map(|at| sum(pair, at) - sum(n / 2 - 1, at)).collect();
                    let mean = off.iter().sum::<f64>() / off.len() as f64;
                    assert!(mean.abs() < 4.0, "seed {seed}, pair {pair}: {mean}");
                }
            }
        }
    }

    #[test]
    fn what_moves_and_other_exposures_are_no_unsteady_light() {
        let n = wall_code().pictures().len();
        let is_light = |pictures: &[Vec<u8>]| {
            let found = examined(&wall_code(), pictures);
            found.faults.iter().any(|it| matches!(it, SetFault::Unsteady { .. }))
        };
        assert!(!is_light(&wall_set(1)));
        let mut moving = wall_set(1);
        moving.iter_mut().enumerate().for_each(|(at, it)| it.rotate_right(at / 4));
        assert!(!is_light(&moving));
        let mut exposed = wall_set(1);
        for (at, picture) in exposed.iter_mut().enumerate() {
            let times = if at * 2 < n { 0.7 } else { 1.0 };
            picture.iter_mut().for_each(|it| *it = (f64::from(*it) * times).round() as u8);
        }
        assert!(!is_light(&exposed));
        for (of, times) in [(4, 0.6), (11, 1.3), (20, 0.75), (30, 0.7)] {
            let mut exposed = wall_set(2);
            exposed[of].iter_mut().for_each(|it| *it = (f64::from(*it) * times).round() as u8);
            assert!(!is_light(&exposed), "{of}");
        }
    }
}
