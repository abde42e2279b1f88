//! One camera's observations of one light, in the camera's own time: which of them lie on a smooth path, and where the light was between them.

use nalgebra::{Matrix3x4, Point2, Vector2, Vector3};

use crate::recording::Recording;

/// The light in a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sample {
    /// By the camera's clock [s].
    pub time_s: f64,
    /// Raw [px], or wherever [`Track::mapped`] took it.
    pub pixel: Point2<f64>,
    /// Standard deviation of either coordinate [px].
    pub sigma_px: f64,
    /// Place of the picture in the recording.
    pub camera_frame: usize,
}

/// Samples ascending by time.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Track {
    pub samples: Vec<Sample>,
    /// Time from one picture to the next, pictures that are missing left out of account [s]; infinite with fewer than two.
    pub period_s: f64,
}

/// Where the light was at a time between samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Between {
    pub pixel: Point2<f64>,
    /// How fast it moved [px/s].
    pub velocity: Vector2<f64>,
    /// Standard deviation of either coordinate [px].
    pub sigma_px: f64,
}

/// Neighbours on either side that a sample is compared with.
const NEIGHBOURS: usize = 3;
/// What a smooth path may deviate from a parabola, beside noise [px].
const BENDING_PX: f64 = 1.0;
/// And as a part of how far the light moves meanwhile [–].
const BENDING: f64 = 0.05;
/// Interpolation that multiplies noise by more is none: samples that lie badly [–].
const MAX_AMPLIFICATION: f64 = 1.5;

/// Samples this many periods apart are neighbours, however slow the camera: one picture is missing at 2, and stamps are uneven [–].
const NEIGHBOUR_PERIODS: f64 = 1.5;

/// Time from one picture to the next at these times of one camera, pictures that are missing left out of account [s]; infinite with fewer
/// than two. Where most pictures are missing, as those without a light may be, the median gap is several periods: a tenth of the gaps is not.
pub(super) fn period_s(times_s: &[f64]) -> f64 {
    let mut gaps: Vec<f64> = times_s.windows(2).map(|it| it[1] - it[0]).filter(|it| *it > 0.0).collect();
    gaps.sort_by(f64::total_cmp);
    let Some(short) = gaps.get(gaps.len() / 10).copied() else { return f64::INFINITY };
    // Stamps that are uneven make the shortest gaps too short; those of one period lie around it.
    let single = &gaps[..gaps.partition_point(|it| *it < NEIGHBOUR_PERIODS * short)];
    single.get(single.len() / 2).copied().unwrap_or(short)
}

/// By camera: the brightest spot of each of its pictures. Pictures at the same time are one picture recorded twice.
pub(super) fn brightest(recording: &Recording) -> Vec<Track> {
    let mut tracks = vec![Track::default(); recording.cameras.len()];
    let mut times_s: Vec<Vec<f64>> = vec![Vec::new(); recording.cameras.len()];
    for (index, camera_frame) in recording.camera_frames.iter().enumerate() {
        if let Some(own) = times_s.get_mut(camera_frame.camera).filter(|_| camera_frame.time_s.is_finite()) {
            own.push(camera_frame.time_s);
        }
        let usable = |it: &&crate::recording::Spot| it.pixel.coords.norm().is_finite() && it.sigma_px > 0.0;
        let best = camera_frame.spots.iter().filter(usable).max_by(|a, b| a.peak.total_cmp(&b.peak));
        if let (Some(track), Some(spot)) = (tracks.get_mut(camera_frame.camera), best) {
            let (pixel, sigma_px) = (spot.pixel, spot.sigma_px);
            track.samples.push(Sample { time_s: camera_frame.time_s, pixel, sigma_px, camera_frame: index });
        }
    }
    for (track, times_s) in tracks.iter_mut().zip(&mut times_s) {
        track.samples.sort_by(|a, b| a.time_s.total_cmp(&b.time_s).then(a.camera_frame.cmp(&b.camera_frame)));
        track.samples.dedup_by(|later, earlier| later.time_s <= earlier.time_s);
        times_s.sort_by(f64::total_cmp);
        track.period_s = period_s(times_s);
    }
    tracks
}

impl Track {
    /// Between samples further apart the path is not known: `max_gap_s`, but never less than neighbours are apart [s].
    fn reach_s(&self, max_gap_s: f64) -> f64 {
        if self.period_s.is_finite() { max_gap_s.max(NEIGHBOUR_PERIODS * self.period_s) } else { max_gap_s }
    }

    /// The samples that their neighbours predict: first by any three of them, then, among what is left, by half of all threes.
    pub(super) fn smooth(&self, max_gap_s: f64) -> Track {
        let once = self.agreeing(max_gap_s, 0.0);
        once.agreeing(max_gap_s, 0.5)
    }

    fn agreeing(&self, max_gap_s: f64, share: f64) -> Track {
        let samples = (0..self.samples.len()).filter(|it| {
            let (agreeing, all) = self.votes(*it, max_gap_s);
            agreeing > 0 && agreeing as f64 >= share * all as f64
        });
        Track { samples: samples.map(|it| self.samples[it]).collect(), period_s: self.period_s }
    }

    /// How many parabolas through three neighbours pass by a sample, and of how many.
    fn votes(&self, index: usize, max_gap_s: f64) -> (usize, usize) {
        let own = &self.samples[index];
        let reach = max_gap_s.max((NEIGHBOURS as f64 + 0.5) * self.period_s);
        let first = index.saturating_sub(NEIGHBOURS);
        let end = (index + NEIGHBOURS + 1).min(self.samples.len());
        let near: Vec<&Sample> = (first..end)
            .filter(|it| *it != index)
            .map(|it| &self.samples[it])
            .filter(|it| (it.time_s - own.time_s).abs() <= reach)
            .collect();
        let (mut agreeing, mut all) = (0, 0);
        for third in 2..near.len() {
            for second in 1..third {
                for first in 0..second {
                    let chosen = [near[first], near[second], near[third]];
                    let (weights, _) = lagrange(&chosen.map(|it| it.time_s), own.time_s);
                    let mut predicted = Vector2::zeros();
                    let (mut variance, mut extent) = (own.sigma_px * own.sigma_px, 0.0_f64);
                    for (sample, weight) in chosen.iter().zip(weights) {
                        predicted += sample.pixel.coords * weight;
                        variance += (weight * sample.sigma_px).powi(2);
                        extent = extent.max((sample.pixel - chosen[0].pixel).norm());
                    }
                    all += 1;
                    let limit = 4.0 * variance.sqrt() + BENDING_PX + BENDING * extent;
                    agreeing += usize::from((own.pixel.coords - predicted).norm() <= limit);
                }
            }
        }
        (agreeing, all)
    }

    /// The same samples elsewhere; those that `map` has no place for are left out.
    pub(super) fn mapped(&self, map: impl Fn(&Point2<f64>) -> Option<Point2<f64>>) -> Track {
        let samples = self.samples.iter().filter_map(|it| Some(Sample { pixel: map(&it.pixel)?, ..*it }));
        Track { samples: samples.collect(), period_s: self.period_s }
    }

    /// First and last time [s].
    pub(super) fn span_s(&self) -> Option<[f64; 2]> {
        Some([self.samples.first()?.time_s, self.samples.last()?.time_s])
    }

    /// The cubic through the two samples before and the two after `time_s`; `None` in a gap, at an end, and where the four are not smooth:
    /// where the parabolas through the first and the last three disagree.
    pub(super) fn at(&self, time_s: f64, max_gap_s: f64) -> Option<Between> {
        let next = self.samples.partition_point(|it| it.time_s <= time_s);
        let four: [Sample; 4] = self.samples.get(next.checked_sub(2)?..next + 2)?.try_into().ok()?;
        let times = four.map(|it| it.time_s);
        let reach_s = self.reach_s(max_gap_s);
        if times.windows(2).any(|it| it[1] - it[0] > reach_s) {
            return None;
        }
        let (weights, slopes) = lagrange(&times, time_s);
        let slopes = apart_from(&weights, slopes, &times, time_s);
        let (mut pixel, mut velocity, mut variance) = (Vector2::zeros(), Vector2::zeros(), 0.0);
        for ((sample, weight), slope) in four.iter().zip(weights).zip(slopes) {
            pixel += sample.pixel.coords * weight;
            velocity += sample.pixel.coords * slope;
            variance += (weight * sample.sigma_px).powi(2);
        }
        let worst = four.iter().fold(0.0, |worst: f64, it| worst.max(it.sigma_px));
        if variance > (MAX_AMPLIFICATION * worst).powi(2) {
            return None;
        }
        let parabola = |three: [Sample; 3]| {
            let (weights, _) = lagrange(&three.map(|it| it.time_s), time_s);
            three.iter().zip(weights).fold(Vector2::zeros(), |sum, (it, weight)| sum + it.pixel.coords * weight)
        };
        let bend = (parabola([four[0], four[1], four[2]]) - parabola([four[1], four[2], four[3]])).norm();
        let smooth = bend <= 5.0 * worst + BENDING * (four[3].pixel - four[0].pixel).norm();
        let (pixel, sigma_px) = (Point2::from(pixel), variance.sqrt());
        smooth.then_some(Between { pixel, velocity, sigma_px })
    }
}

/// Weights with which the polynomial through values at `times` has its value and its slope at `time`.
fn lagrange<const N: usize>(times: &[f64; N], time: f64) -> ([f64; N], [f64; N]) {
    let weight = |own: usize| {
        let others = (0..N).filter(|it| *it != own);
        others.map(|it| (time - times[it]) / (times[own] - times[it])).product::<f64>()
    };
    let slope = |own: usize| {
        let others = || (0..N).filter(|it| *it != own);
        let scale: f64 = others().map(|it| times[own] - times[it]).product();
        let without =
            |left_out: usize| others().filter(|it| *it != left_out).map(|it| time - times[it]).product::<f64>();
        others().map(without).sum::<f64>() / scale
    };
    (std::array::from_fn(weight), std::array::from_fn(slope))
}

/// The slopes nearest to `slopes` whose noise has nothing to do with that of the place: products of velocity and residual, which is what clocks
/// are found from, would otherwise have a mean that is not 0 (at a sample, that of half its noise per period).
fn apart_from(weights: &[f64; 4], slopes: [f64; 4], times: &[f64; 4], time: f64) -> [f64; 4] {
    let scale = 1.0 / (times[3] - times[0]);
    // Constants keep the slope 0 and lines theirs.
    let kept = Matrix3x4::from_fn(|row, column| match row {
        0 => 1.0,
        1 => (times[column] - time) * scale,
        _ => weights[column],
    });
    let common: f64 = weights.iter().zip(&slopes).map(|(weight, slope)| weight * slope).sum();
    let Some(inverse) = (kept * kept.transpose()).try_inverse() else { return slopes };
    let moved = kept.transpose() * (inverse * Vector3::new(0.0, 0.0, -common));
    std::array::from_fn(|it| slopes[it] + moved[it])
}

#[cfg(test)]
mod tests {
    use foveate_estimation::Random;

    use super::*;

    /// A light waved once a second at 30 Hz, every third observation wrong at random.
    fn waved(wrong: f64, sigma_px: f64) -> (Track, Vec<bool>) {
        let mut random = Random::new(3);
        let (mut samples, mut right) = (Vec::new(), Vec::new());
        for camera_frame in 0..600 {
            let time_s = camera_frame as f64 / 30.0;
            let noise = Vector2::new(random.normal(), random.normal()) * sigma_px;
            let is_wrong = random.uniform() < wrong;
            let anywhere = Point2::new(random.uniform_in(0.0, 640.0), random.uniform_in(0.0, 480.0));
            let pixel = if is_wrong { anywhere } else { place(time_s) + noise };
            samples.push(Sample { time_s, pixel, sigma_px: sigma_px.max(0.1), camera_frame });
            right.push(!is_wrong);
        }
        (Track { samples, period_s: 1.0 / 30.0 }, right)
    }

    fn place(time_s: f64) -> Point2<f64> {
        let phase = std::f64::consts::TAU * time_s;
        Point2::new(320.0 + 150.0 * phase.sin(), 240.0 + 120.0 * (0.7 * phase).cos())
    }

    #[test]
    fn a_third_of_wrong_sights_is_left_out_and_hardly_a_right_one() {
        let (track, right) = waved(0.3, 0.5);
        let kept = track.smooth(0.1);
        let wrong = kept.samples.iter().filter(|it| !right[it.camera_frame]).count();
        let n_right = right.iter().filter(|it| **it).count();
        assert!(wrong <= 3, "{wrong}");
        assert!(kept.samples.len() - wrong > n_right * 3 / 4, "{} of {n_right}", kept.samples.len());
        let (clean, _) = waved(0.0, 0.5);
        assert!(clean.smooth(0.1).samples.len() > 590);
    }

    #[test]
    fn between_sights_the_light_is_where_it_was_and_as_fast() {
        let (track, _) = waved(0.0, 0.0);
        for step in 0..400 {
            let time = 1.0 + 0.0137 * f64::from(step);
            let found = track.at(time, 0.1).unwrap();
            let slope = (place(time + 1e-5) - place(time - 1e-5)) / 2e-5;
            assert!((found.pixel - place(time)).norm() < 0.05, "{time}: {found:?}");
            // Up to 7500 px/s² times half a period of 1/30 s.
            assert!((found.velocity - slope).norm() < 125.0, "{time}: {found:?} {slope}");
        }
    }

    #[test]
    fn noise_of_place_and_velocity_have_nothing_in_common() {
        let (truth, _) = waved(0.0, 0.0);
        let (noisy, _) = waved(0.0, 0.5);
        for phase in [0.0, 0.13, 0.5, 0.8] {
            let (mut product, mut n) = (0.0, 0.0);
            for picture in 2..596 {
                let time = (f64::from(picture) + phase + 1e-9) / 30.0;
                let Some((found, exact)) = noisy.at(time, 0.1).zip(truth.at(time, 0.1)) else { continue };
                product += (found.pixel - exact.pixel).dot(&(found.velocity - exact.velocity));
                n += 2.0;
            }
            // Slopes that pass through the sample have half its variance times 30 Hz there, 3.75; 4 standard errors of 0.5 · 15 px²/s are 0.9.
            assert!(n > 1000.0 && (product / n).abs() < 0.9, "{phase}: {}", product / n);
        }
    }

    #[test]
    fn gaps_ends_and_corners_are_not_bridged() {
        let (mut track, _) = waved(0.0, 0.0);
        assert_eq!([track.at(-0.01, 0.1), track.at(0.01, 0.1), track.at(19.99, 0.1)], [None; 3]);
        track.samples.retain(|it| !(3.0..3.2).contains(&it.time_s));
        assert_eq!(track.at(3.1, 0.1), None);
        assert!(track.at(3.4, 0.1).is_some());
        track.samples.iter_mut().filter(|it| it.time_s > 10.0).for_each(|it| it.pixel.x += 40.0);
        assert_eq!(track.at(10.01, 0.1), None);
        assert!(track.at(10.2, 0.1).is_some());
    }
}
