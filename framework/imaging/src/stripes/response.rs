//! The response of the camera, where it is curved: pictures of telephones and webcams state a power of the light.
//!
//! Whatever a bit shows, its picture and the inverse together send back as much light as white and black together, what comes by way of other surfaces included. Gray levels say so only where they are
//! proportional to light. A level g means light g^γ: of all exponents the one under which pairs agree best with white and black is the camera's, where it is much better than none. No picture of
//! known brightness is needed for that. Where a pixel is as bright as white in one picture of a pair and as dark as black in the other, every exponent agrees: what tells it are pixels in between, on boundaries of stripes
//! and where other surfaces send light. A camera that sets its exposure by itself puts pairs off, too: under each exponent pictures are given the exposures that fit them best, where that explains more.

use super::code::{Axis, Inverse, Shown, StripeCode};
use super::exposure;
use crate::ImageView;

/// Pixels that are looked at.
const SAMPLES: usize = 10_000;
/// At least so many must.
const LEAST_SAMPLES: usize = 200;
/// A pixel takes part where white is so much brighter than black [gray levels].
const LEAST_CONTRAST: u8 = 30;
/// … and not cut off [gray levels].
const SATURATED: u8 = 250;
/// Both pictures of a pair are so much brighter than black where they tell it, as a part of white − black [–].
const BETWEEN: f64 = 0.15;
/// Pairs at pixels that tell it: at most so many, at least so many.
const PAIRS: usize = 20_000;
const LEAST_PAIRS: usize = 300;
/// Exponents that are tried: from 1 by such steps, so many of them.
const STEP: f64 = 0.05;
const STEPS: usize = 40;
/// Levels are taken as they are where pairs are off white and black by less than this, in the median [–] …
const LEAST_OFF: f64 = 0.03;
/// … or the best exponent leaves more than this part of that [–].
const BETTER: f64 = 0.6;
/// … or than this where pictures have exposures of their own, which take up some of a curve [–].
const BETTER_BESIDE_EXPOSURES: f64 = 0.8;
/// Pictures have exposures of their own where these leave less than this part of what an exponent alone does [–].
const BESIDE: f64 = 0.85;
/// Pixels that tell such exposures, under each exponent.
const FEW: usize = 2000;

/// The exponent that makes gray levels proportional to light; `None` where they are, nearly, or where pictures do not say. `pictures` stand in the order of [`StripeCode::pictures`].
pub fn exponent(code: &StripeCode, pictures: &[ImageView<'_>]) -> Option<f64> {
    let shown = code.pictures();
    if code.inverse == Inverse::None || pictures.len() != shown.len() {
        return None;
    }
    let place = |what: Shown| shown.iter().position(|it| *it == what);
    let (white, black) = (pictures[place(Shown::White)?].pixels(), pictures[place(Shown::Black)?].pixels());
    let pairs: Vec<[&[u8]; 2]> = Axis::BOTH
        .into_iter()
        .flat_map(|axis| (0..code.bits[axis.index()]).map(move |plane| (axis, plane)))
        .filter_map(|(axis, plane)| {
            let of = |inverse| Some(pictures[place(Shown::Bit { axis, plane, inverse })?].pixels());
            Some([of(false)?, of(true)?])
        })
        .collect();
    let is_lit = |it: &usize| white[*it] < SATURATED && white[*it] >= black[*it].saturating_add(LEAST_CONTRAST);
    let lit: Vec<usize> = (0..white.len()).filter(is_lit).collect();
    // The brighter half: of little light a curved response makes mostly noise.
    let mut contrasts: Vec<u8> = lit.iter().map(|it| white[*it] - black[*it]).collect();
    let half = contrasts.len() / 2;
    let least = if half > LEAST_SAMPLES { *contrasts.select_nth_unstable(half).1 } else { 0 };
    let lit: Vec<usize> = lit.into_iter().filter(|it| white[*it] - black[*it] >= least).collect();
    let some: Vec<usize> = lit.iter().copied().step_by(lit.len().div_ceil(SAMPLES).max(1)).collect();
    if some.len() < LEAST_SAMPLES {
        return None;
    }
    let is_between = |at: usize, pair: &[&[u8]; 2]| {
        let least = BETWEEN * f64::from(white[at] - black[at]);
        f64::from(pair[0][at].min(pair[1][at])) > f64::from(black[at]) + least
    };
    let all = some.iter().flat_map(|at| (0..pairs.len()).map(move |pair| (*at, pair)));
    let between: Vec<(usize, usize)> = all.filter(|it| is_between(it.0, &pairs[it.1])).collect();
    let between: Vec<_> = between.iter().step_by(between.len().div_ceil(PAIRS).max(1)).collect();
    if between.len() < LEAST_PAIRS {
        return None;
    }
    let mut off: Vec<f32> = Vec::with_capacity(between.len());
    let mut median_off = |exponent: f64, exposures: &[[f64; 2]]| -> f32 {
        let light = lights(exponent);
        let times: Vec<[f32; 2]> = exposures.iter().map(|it| it.map(|it| it.recip() as f32)).collect();
        let of = |pixels: &[u8], at: usize| light[usize::from(pixels[at])] as f32;
        off.clear();
        for (at, pair) in between.iter().copied() {
            let ([bit, inverse], [a, b]) = (pairs[*pair], times[*pair]);
            let both = of(white, *at) + of(black, *at);
            off.push(((a * of(bit, *at) + b * of(inverse, *at)) / both - 1.0).abs());
        }
        let middle = off.len() / 2;
        *off.select_nth_unstable_by(middle, f32::total_cmp).1
    };
    let least = |of: &[(f64, f32)]| of.iter().copied().min_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((1.0, 0.0));
    let exponents = (0..=STEPS).map(|it| 1.0 + it as f64 * STEP);
    let tried: Vec<_> = exponents.clone().map(|it| (it, median_off(it, &vec![[1.0; 2]; pairs.len()]))).collect();
    if f64::from(tried[0].1) <= LEAST_OFF {
        return None;
    }
    // Exposures of their own look like a curved response, and the other way round: both are found together.
    let few: Vec<usize> = some.iter().copied().step_by(some.len().div_ceil(FEW).max(1)).collect();
    let of = |exponent| (exponent, median_off(exponent, &exposures(&pairs, [white, black], &few, exponent)));
    let by_exposure: Vec<_> = exponents.map(of).collect();
    // They explain as much by themselves as an exponent does, or more beside one.
    let has_exposures =
        by_exposure[0].1 <= least(&tried).1 || f64::from(least(&by_exposure).1) < BESIDE * f64::from(least(&tried).1);
    let (tried, better) = if has_exposures { (by_exposure, BETTER_BESIDE_EXPOSURES) } else { (tried, BETTER) };
    let (as_they_are, (best, off)) = (tried[0].1, least(&tried));
    (f64::from(off) < better * f64::from(as_they_are)).then_some(best)
}

/// The light of each gray level under an exponent, of which the brightest one is 255.
fn lights(exponent: f64) -> [f64; 256] {
    std::array::from_fn(|it| 255.0 * (it as f64 / 255.0).powf(exponent))
}

/// By bit, how many times as bright as they should be its picture and its inverse are beside white and black: once where that is not known.
fn exposures(pairs: &[[&[u8]; 2]], [white, black]: [&[u8]; 2], at: &[usize], exponent: f64) -> Vec<[f64; 2]> {
    let light = lights(exponent);
    let of = |pixels: &[u8], at: usize| light[usize::from(pixels[at])];
    let row = |[bit, inverse]: [&[u8]; 2], at: usize| {
        let is_whole = bit[at] < SATURATED && inverse[at] < SATURATED;
        is_whole.then(|| [of(bit, at), of(inverse, at), of(white, at) + of(black, at)])
    };
    let of_pair = |pair: &[&[u8]; 2]| {
        let rows: Vec<[f64; 3]> = at.iter().filter_map(|it| row(*pair, *it)).collect();
        exposure::fit(&rows).unwrap_or([1.0; 2])
    };
    pairs.iter().map(of_pair).collect()
}

/// A picture with levels proportional to light; the brightest level stays.
pub fn straightened(pixels: &[u8], exponent: f64) -> Vec<u8> {
    let table: Vec<u8> = (0..256).map(|it| (255.0 * (f64::from(it) / 255.0).powf(exponent)).round() as u8).collect();
    pixels.iter().map(|it| table[usize::from(*it)]).collect()
}

#[cfg(test)]
mod tests {
    use super::super::scene::{Scene, wall};
    use super::*;

    /// Pictures of a wall, in a room that throws light back, by a camera that states the light's power of 1 / `exponent`.
    fn pictures(exponent: f64, seed: u64) -> (StripeCode, Vec<Vec<u8>>) {
        let code = StripeCode::gray([160, 120]);
        let pictures = Scene { gamma: exponent, global: |_, _| 0.1, ..wall(seed) }.pictures(&code);
        (code, pictures)
    }

    fn found(code: &StripeCode, pictures: &[Vec<u8>]) -> Option<f64> {
        let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
        exponent(code, &views)
    }

    #[test]
    fn a_curved_response_is_found_and_a_straight_one_left_alone() {
        for seed in 1..=3 {
            let (code, straight) = pictures(1.0, seed);
            assert_eq!(found(&code, &straight), None);
            for truth in [1.8, 2.2, 2.6] {
                let (code, curved) = pictures(truth, seed);
                let found = found(&code, &curved).unwrap();
                assert!((found - truth).abs() < 0.2, "seed {seed}: {found} for {truth}");
            }
        }
    }

    #[test]
    fn boundaries_alone_tell_it_where_no_surface_sends_light() {
        let code = StripeCode::gray([160, 120]);
        for seed in 1..=2 {
            for (truth, noise) in [(1.0, 1.0), (1.0, 5.0), (2.2, 1.0), (2.2, 3.0)] {
                let scene = Scene { gamma: truth, noise, global: |_, _| 0.0, ..wall(seed) };
                let found = found(&code, &scene.pictures(&code)).unwrap_or(1.0);
                assert!((found - truth).abs() < 0.25, "seed {seed}, noise {noise}: {found} for {truth}");
            }
        }
    }

    /// Pictures whose exposure follows the mean of each.
    fn exposed_by_itself(mut pictures: Vec<Vec<u8>>, strength: f64) -> Vec<Vec<u8>> {
        let mean = |it: &Vec<u8>| it.iter().map(|it| f64::from(*it)).sum::<f64>();
        let means: Vec<f64> = pictures.iter().map(mean).collect();
        for (picture, mean) in pictures.iter_mut().zip(&means) {
            let gain = 0.8 / (1.0 - strength + strength * mean / means[0]);
            picture.iter_mut().for_each(|it| *it = (f64::from(*it) * gain).round().min(255.0) as u8);
        }
        pictures
    }

    #[test]
    fn a_curved_response_and_exposures_of_each_picture_are_told_apart() {
        let code = StripeCode::gray([160, 120]);
        for seed in 1..=2 {
            for strength in [0.2, 0.5] {
                for (defocus, blur) in [(0.45, 0.0), (0.8, 0.7)] {
                    let sound = Scene { global: |_, _| 0.0, defocus, blur, ..wall(seed) }.pictures(&code);
                    let exposed = exposed_by_itself(sound, strength);
                    let what = format!("seed {seed}, {strength}, {defocus}");
                    assert_eq!(found(&code, &exposed), None, "{what}");
                    for exponent in [1.8, 2.2] {
                        let curve = |it: u8| (255.0 * (f64::from(it) / 255.0).powf(1.0 / exponent)).round() as u8;
                        let curved: Vec<Vec<u8>> =
                            exposed.iter().map(|it| it.iter().copied().map(curve).collect()).collect();
                        let told = found(&code, &curved).unwrap_or(1.0);
                        assert!((told - exponent).abs() < 0.11, "{what}: {told} for {exponent}");
                    }
                }
            }
        }
    }

    #[test]
    fn pictures_that_are_no_pairs_say_nothing() {
        let (code, mut curved) = pictures(2.2, 4);
        // All by one place, as if one were missing at the start and another doubled at the end.
        curved.rotate_left(1);
        assert_eq!(found(&code, &curved), None);
        curved.pop();
        assert_eq!(found(&code, &curved), None);
        assert_eq!(found(&code, &vec![vec![90; 160 * 120]; 32]), None);
    }

    #[test]
    fn straightened_levels_keep_their_order_and_their_ends() {
        let all: Vec<u8> = (0..=255).collect();
        let straight = straightened(&all, 2.2);
        assert!(straight.is_sorted() && straight[0] == 0 && straight[255] == 255 && straight[128] == 56);
    }
}
