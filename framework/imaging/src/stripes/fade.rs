//! A lamp that fades, or an exposure that grows, a little from each picture to the next.
//!
//! Each pair of a bit and its inverse tells how many times too bright its two pictures are ([`super::exposure`]). Of a light that fades, the logarithms of these lie on a smooth curve over the places of the pictures, here a
//! cubic, *and* within each pair the later picture is darker than the earlier one by as much as the curve falls there. A light that was switched, or an exposure that was set once, has steps between pairs and none within
//! them; light of the room that fades makes both pictures of a pair brighter or darker alike, wherever stripes are.

use nalgebra::{Matrix4, Vector4};

use super::code::{Shown, StripeCode};
use super::exposure::Pair;

/// Pairs that tell it, at least.
const MIN_PAIRS: usize = 6;
/// From the brightest to the darkest picture it is at least so much [–].
const LEAST: f64 = 0.02;
/// Pairs are off the curve by no more than this part of what it falls at all, root mean square: a step is off by a sixth of its height [–] …
const OFF: f64 = 1.0 / 12.0;
/// … between these: less is what packed pictures make, and of more the pairs tell more than the curve [–].
const OFF_ANYWAY: f64 = 0.004;
const OFF_AT_MOST: f64 = 0.02;
/// What pictures fall within pairs, over what the curve does there [–].
const WITHIN: std::ops::RangeInclusive<f64> = 0.6..=1.4;
/// … and that is so many standard deviations from none, by how far pairs disagree.
const SIGMAS: f64 = 5.0;
/// Pairs this many standard deviations off the curve are left out, twice.
const OUTSIDE: f64 = 3.0;

/// How bright each picture is, over the middle one of them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Fade {
    /// Each picture, in their order.
    pub(super) factors: Vec<(usize, f64)>,
}

impl Fade {
    /// The first and the last picture, and how many times as bright as the first the last one is.
    pub(super) fn ends(&self) -> Option<([usize; 2], f64)> {
        let ((first, of_first), (last, of_last)) = (self.factors.first()?, self.factors.last()?);
        Some(([*first, *last], of_last / of_first))
    }
}

/// How a light faded over a set, by what pairs of it tell, if it did; `places` says which picture is what.
pub(super) fn faded(pairs: &[Pair], code: &StripeCode, places: &[Option<usize>]) -> Option<Fade> {
    let reference = code.place(Shown::White).and_then(|it| places[it]);
    let has_black = code.place(Shown::Black).and_then(|it| places[it]).is_some();
    let curve = Curve::through(pairs, reference.filter(|_| has_black), places.len())?;
    let mut all: Vec<usize> = places.iter().flatten().copied().collect();
    all.sort_unstable();
    let logs: Vec<f64> = all.iter().map(|it| curve.at(*it)).collect();
    let range = |it: &[f64]| {
        it.iter().copied().fold(f64::NEG_INFINITY, f64::max) - it.iter().copied().fold(f64::INFINITY, f64::min)
    };
    let range = range(&logs);
    if range < LEAST || curve.off > (OFF * range).clamp(OFF_ANYWAY, OFF_AT_MOST) || !curve.holds_within(pairs) {
        return None;
    }
    let mut sorted = logs.clone();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted[sorted.len() / 2];
    Some(Fade { factors: all.into_iter().zip(logs).map(|(picture, log)| (picture, (log - middle).exp())).collect() })
}

/// A cubic curve over the places of pictures.
struct Curve {
    terms: Vector4<f64>,
    /// Half of how many pictures there are.
    half: f64,
    /// Of what it went through, root mean square [–].
    off: f64,
}

impl Curve {
    fn through(pairs: &[Pair], reference: Option<usize>, n: usize) -> Option<Curve> {
        let half = n as f64 / 2.0;
        let mut points: Vec<(usize, f64)> = pairs
            .iter()
            .flat_map(|(pair, factors)| pair.iter().copied().zip(factors.map(f64::ln)))
            .chain(reference.map(|it| (it, 0.0)))
            .collect();
        let mut curve = Curve { terms: Vector4::zeros(), half, off: f64::INFINITY };
        for turn in 0..3 {
            if points.len() < 2 * MIN_PAIRS {
                return None;
            }
            let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
            for (picture, log) in &points {
                let row = curve.row(*picture);
                normal += row * row.transpose();
                right += row * *log;
            }
            curve.terms = normal.try_inverse()? * right;
            let off: Vec<f64> = points.iter().map(|it| (it.1 - curve.at(it.0)).abs()).collect();
            curve.off = (off.iter().map(|it| it * it).sum::<f64>() / points.len() as f64).sqrt();
            if turn < 2 {
                let most = OUTSIDE * curve.off;
                points = points.into_iter().zip(off).filter(|it| it.1 <= most).map(|it| it.0).collect();
            }
        }
        Some(curve)
    }

    fn row(&self, picture: usize) -> Vector4<f64> {
        let at = picture as f64 / self.half - 1.0;
        Vector4::new(1.0, at, at * at, at * at * at)
    }

    /// The logarithm of how bright a picture is.
    fn at(&self, picture: usize) -> f64 {
        self.terms.dot(&self.row(picture))
    }

    /// Whether the two pictures of pairs differ by what the curve falls from the one to the other.
    fn holds_within(&self, pairs: &[Pair]) -> bool {
        let steps: Vec<[f64; 2]> =
            pairs.iter().map(|([a, b], of)| [self.at(*b) - self.at(*a), (of[1] / of[0]).ln()]).collect();
        let power: f64 = steps.iter().map(|it| it[0] * it[0]).sum();
        let part = steps.iter().map(|it| it[0] * it[1]).sum::<f64>() / power;
        let off: f64 = steps.iter().map(|it| (it[1] - part * it[0]).powi(2)).sum();
        let sigma = (off / (steps.len() as f64 - 1.0) / power).sqrt();
        WITHIN.contains(&part) && part >= SIGMAS * sigma
    }
}

#[cfg(test)]
mod tests {
    use super::super::code::Axis;
    use super::super::examine::{Examination, examine};
    use super::super::faults::SetFault;
    use super::super::scene::{wall, wall_code, wall_set};
    use crate::ImageView;

    const N: usize = 32;

    fn examined(pictures: &[Vec<u8>]) -> Examination {
        let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
        examine(&wall_code(), &views, &[], 12)
    }

    /// The wall's pictures, each so many times as bright.
    fn exposed(times: impl Fn(usize) -> f64, seed: u64) -> Vec<Vec<u8>> {
        let darker = |(at, picture): (usize, Vec<u8>)| {
            picture.iter().map(|it| (f64::from(*it) * times(at)).round().min(255.0) as u8).collect()
        };
        wall_set(seed).into_iter().enumerate().map(darker).collect()
    }

    #[test]
    fn a_lamp_that_fades_slowly_is_evened_out() {
        for seed in 11..=13 {
            for a_picture in [0.002, 0.004, 0.007, 0.01, 0.02, -0.004] {
                let found = examined(&exposed(|at| 1.0 - a_picture * at as f64, seed));
                let expected = 1.0 - a_picture * (N - 1) as f64;
                let is_it = match found.faults[..] {
                    [SetFault::Faded { ends: [0, 31], factor }] => (factor / expected - 1.0).abs() < 0.04,
                    _ => false,
                };
                assert!(is_it, "seed {seed}, {a_picture} a picture: {:?}", found.faults);
                assert_eq!(found.usable(&wall_code()), Axis::BOTH, "seed {seed}, {a_picture}");
            }
            // A lamp that grows warm does so ever more slowly.
            let found = examined(&exposed(|at| 1.0 - 0.15 * (-(at as f64) / 12.0).exp(), seed));
            assert!(matches!(found.faults[..], [SetFault::Faded { .. }]), "seed {seed}: {:?}", found.faults);
        }
    }

    #[test]
    fn what_does_not_fade_is_called_no_fading() {
        let no_fade = |pictures: &[Vec<u8>], what: &str| {
            let found = examined(pictures);
            let is_faded = found.faults.iter().any(|it| matches!(it, SetFault::Faded { .. }));
            assert!(!is_faded, "{what}: {:?}", found.faults);
            found
        };
        for seed in 11..=13 {
            assert_eq!(no_fade(&wall_set(seed), "still").faults, []);
            // Exposures that were set once, twice, or anew for each pair.
            no_fade(&exposed(|at| if at < 16 { 0.85 } else { 1.0 }, seed), "one step");
            no_fade(&exposed(|at| [0.8, 0.9, 1.0][at / 11], seed), "two steps");
            no_fade(&exposed(|at| 1.0 - 0.012 * (at / 2) as f64, seed), "a step from pair to pair");
            // A light of the room.
            for switched in [8, 16, 24] {
                let mut pictures = wall_set(seed);
                pictures[switched..].iter_mut().flatten().for_each(|it| *it = it.saturating_sub(13));
                let found = no_fade(&pictures, "switched off");
                assert!(matches!(found.faults[..], [SetFault::Relit { .. }]), "seed {seed}: {:?}", found.faults);
            }
            let mut pictures = wall_set(seed);
            let albedo = wall(seed).albedo;
            for (times, picture) in pictures.iter_mut().enumerate() {
                let less = |at: usize| 0.03 * 14.0 * times as f64 * albedo((at % 160) as f64, (at / 160) as f64);
                let pixels = picture.iter_mut().enumerate();
                pixels.for_each(|(at, it)| *it = (f64::from(*it) - less(at)).round() as u8);
            }
            no_fade(&pictures, "a lamp of the room");
        }
    }
}
