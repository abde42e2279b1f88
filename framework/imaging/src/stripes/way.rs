//! The way that a scene goes in the camera's picture during a set, from where it lies in sums of two pictures each ([`drift`](super::drift)).
//!
//! A camera on a floor that gives, or one that settles, goes there and back, or faster at first. Where the scene lies in one picture is estimated from the sums around its time: a line through the nearest of them, the
//! nearer ones weighing more (Cleveland's local regression). Its uncertainty follows from how far each sum lies off the middle of its neighbours: noise, and bends too quick to follow.
//!
//! Source: W. Cleveland, "Robust locally weighted regression and smoothing scatterplots", JASA 74, 1979.

use nalgebra::Vector2;

/// Sums that say where the scene lies in a picture.
const NEAREST: usize = 5;
/// Sums that tell a way, at least.
const MIN_SUMS: usize = 8;

/// Where a scene lies in each picture of a set.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Way {
    /// By picture, from where it lies in the first one [px].
    pub places: Vec<Vector2<f64>>,
    /// What a sum is off the middle of its neighbours, standard deviation, where that comes of the sum alone [px].
    pub noise: f64,
    /// Of the sums about the way, standard deviation [px].
    pub scatter: f64,
}

impl Way {
    /// Of `n` pictures, two of which, `pairs[i]`, add up to a sum in which the scene lies at `places[i]`; `None` where these are too few.
    pub fn of(pairs: &[[usize; 2]], places: &[Vector2<f64>], n: usize) -> Option<Way> {
        let mut sums: Vec<(f64, Vector2<f64>)> =
            pairs.iter().zip(places).map(|([a, b], place)| ((a + b) as f64 / 2.0, *place)).collect();
        sums.sort_by(|a, b| a.0.total_cmp(&b.0));
        if sums.len() < MIN_SUMS {
            return None;
        }
        let off = sums.windows(3).map(|it| {
            let [(first, a), (middle, b), (last, c)] = [it[0], it[1], it[2]];
            let part = if last > first { (middle - first) / (last - first) } else { 0.5 };
            let variances = 1.0 + part * part + (1.0 - part) * (1.0 - part);
            (b - a * (1.0 - part) - c * part).norm_squared() / variances
        });
        let noise = (off.sum::<f64>() / (sums.len() - 2) as f64).sqrt();
        let at = |time: f64| local_line(&sums, time);
        let start = at(0.0);
        let about = sums.iter().map(|(time, place)| (place - at(*time)).norm_squared()).sum::<f64>();
        let scatter = (about / sums.len() as f64).sqrt();
        Some(Way { places: (0..n).map(|it| at(it as f64) - start).collect(), noise, scatter })
    }

    /// How far apart the two places are that lie farthest from each other along rows, and the same down columns [px].
    pub fn reach(&self) -> Vector2<f64> {
        reach(&self.places)
    }
}

/// How far places reach along rows and down columns [px].
pub(super) fn reach(places: &[Vector2<f64>]) -> Vector2<f64> {
    let ends = |axis: usize| {
        let along = places.iter().map(|it| it[axis]);
        along.clone().fold(f64::NEG_INFINITY, f64::max) - along.fold(f64::INFINITY, f64::min)
    };
    if places.is_empty() { Vector2::zeros() } else { Vector2::new(ends(0), ends(1)) }
}

/// Sums about a place that moves evenly from picture to picture.
pub(super) struct Creep {
    /// From the first picture to the last [px].
    pub by: Vector2<f64>,
    /// Of the sums about it, standard deviation [px].
    pub scatter: f64,
    /// Of `by`, by that scatter [px].
    pub sigma: f64,
}

impl Creep {
    /// `None` where sums are all of one moment.
    pub fn of(pairs: &[[usize; 2]], places: &[Vector2<f64>], [first, last]: [usize; 2]) -> Option<Creep> {
        let n = places.len() as f64;
        // A sum is of the moment in the middle between its two pictures.
        let times: Vec<f64> = pairs.iter().map(|[a, b]| (a + b) as f64 / 2.0).collect();
        let middle = times.iter().sum::<f64>() / n;
        let mean = places.iter().sum::<Vector2<f64>>() / n;
        let power: f64 = times.iter().map(|it| (it - middle).powi(2)).sum();
        let product: Vector2<f64> = times.iter().zip(places).map(|(time, it)| (it - mean) * (time - middle)).sum();
        let a_picture = product / power;
        let off = times.iter().zip(places).map(|(time, it)| (it - mean - a_picture * (time - middle)).norm_squared());
        let scatter = (off.sum::<f64>() / (n - 2.0)).sqrt();
        let range = (last - first) as f64;
        (power > 0.0).then(|| Creep { by: a_picture * range, scatter, sigma: scatter * range / power.sqrt() })
    }
}

/// Places in `n` pictures of a scene that moves by `by` from the first of `ends` to the last, from where it lies in picture 0.
pub(super) fn evenly(by: Vector2<f64>, ends: [usize; 2], n: usize) -> Vec<Vector2<f64>> {
    let a_picture = by / (ends[1] - ends[0]).max(1) as f64;
    (0..n).map(|it| a_picture * it as f64).collect()
}

/// Where the line through the sums that are nearest in time lies at `time`.
fn local_line(sums: &[(f64, Vector2<f64>)], time: f64) -> Vector2<f64> {
    let mut near: Vec<&(f64, Vector2<f64>)> = sums.iter().collect();
    near.sort_by(|a, b| (a.0 - time).abs().total_cmp(&(b.0 - time).abs()));
    near.truncate(NEAREST);
    // The farthest of them still counts a little.
    let far = 1.2 * near.last().map_or(1.0, |it| (it.0 - time).abs()).max(0.5);
    let weight = |it: f64| (1.0 - ((it - time).abs() / far).min(1.0).powi(3)).powi(3);
    let total: f64 = near.iter().map(|it| weight(it.0)).sum();
    let mean_time = near.iter().map(|it| weight(it.0) * it.0).sum::<f64>() / total;
    let mean = near.iter().map(|it| it.1 * weight(it.0)).sum::<Vector2<f64>>() / total;
    let power: f64 = near.iter().map(|it| weight(it.0) * (it.0 - mean_time).powi(2)).sum();
    let product: Vector2<f64> = near.iter().map(|it| (it.1 - mean) * (weight(it.0) * (it.0 - mean_time))).sum();
    if power > 1e-9 { mean + product / power * (time - mean_time) } else { mean }
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;

    use super::*;

    /// Sums of 42 pictures, two after each other, of a scene that goes by `way`, with noise.
    fn found(way: impl Fn(f64) -> f64, noise: f64, seed: u64) -> Way {
        let mut random = Random::new(seed);
        let pairs: Vec<[usize; 2]> = (0..21).map(|it| [2 * it, 2 * it + 1]).collect();
        let mean = |a: usize| (way(a as f64) + way(a as f64 + 1.0)) / 2.0;
        let places: Vec<Vector2<f64>> = pairs
            .iter()
            .map(|it| Vector2::new(mean(it[0]) + noise * random.normal(), noise * random.normal()))
            .collect();
        Way::of(&pairs, &places, 42).unwrap()
    }

    #[test]
    fn a_way_of_a_pixel_is_followed_to_a_tenth_of_it() {
        let there_and_back = |it: f64| if it < 20.0 { it / 20.0 } else { 2.0 - it / 20.0 };
        let settles = |it: f64| 1.0 - (-it / 8.0).exp();
        for seed in 1..=10 {
            for way in [there_and_back, settles, |it: f64| (it / 7.0).sin() / 2.0, |_: f64| 0.0] {
                let found = found(way, 0.02, seed);
                let off = |it: usize| found.places[it].x - (way(it as f64) - way(0.0));
                let rms = ((0..42).map(|it| off(it).powi(2)).sum::<f64>() / 42.0).sqrt();
                assert!(rms < 0.12 && found.noise < 0.06, "seed {seed}: {rms} px, {}", found.noise);
                let all = || (0..=410).map(|it| way(f64::from(it) / 10.0));
                let reach = all().fold(f64::NEG_INFINITY, f64::max) - all().fold(f64::INFINITY, f64::min);
                // A line is no bend: peaks are cut.
                assert!((found.reach().x - reach).abs() < 0.15, "seed {seed}: {} for {reach}", found.reach().x);
            }
        }
    }

    #[test]
    fn few_sums_tell_no_way() {
        let pairs: Vec<[usize; 2]> = (0..MIN_SUMS - 1).map(|it| [2 * it, 2 * it + 1]).collect();
        assert_eq!(Way::of(&pairs, &[Vector2::zeros(); MIN_SUMS - 1], 14), None);
    }
}
