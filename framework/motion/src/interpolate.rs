//! Interpolation between frames, and resampling.
//!
//! Between two neighbouring frames with the point, it moves along the Catmull–Rom cubic; where one outer neighbour is
//! missing along the parabola through three, where both are along a line. Covariances are the weighted mean of the
//! two, which is never too small; the provenance of a sample is the worse of the two.

use foveate_messages::Provenance;
use nalgebra::{Point3, Vector3};

use crate::motion::{Motion, Sample, rate_of};

/// Times this near to a frame's are its own [s].
const SAME_TIME_S: f64 = 1e-6;

impl Motion {
    /// A point at any time; `None` where it is missing in the frame before or after, or these are more than `gap_s` apart.
    pub fn at(&self, point: usize, time_s: f64, gap_s: f64) -> Option<Sample> {
        let behind = self.times_s.partition_point(|it| *it < time_s - SAME_TIME_S);
        let next = *self.times_s.get(behind)?;
        if (next - time_s).abs() <= SAME_TIME_S {
            return self.get(behind, point).cloned();
        }
        let before = behind.checked_sub(1)?;
        let (from, to) = (self.get(before, point)?, self.get(behind, point)?);
        let (start, span) = (self.times_s[before], next - self.times_s[before]);
        if span > gap_s {
            return None;
        }
        let place = |frame: Option<usize>| {
            let frame = frame?;
            let time = *self.times_s.get(frame)?;
            // Across a hole in time there is no velocity to be had.
            ((time - time_s).abs() <= 2.0 * gap_s).then_some((time, self.get(frame, point)?.position))
        };
        let across = (to.position - from.position) / span;
        let slope = |a: Option<(f64, Point3<f64>)>, b: Option<(f64, Point3<f64>)>| -> Option<Vector3<f64>> {
            a.zip(b).map(|(a, b)| (b.1 - a.1) / (b.0 - a.0))
        };
        let u = slope(place(before.checked_sub(1)), Some((next, to.position)));
        let v = slope(Some((start, from.position)), place(Some(behind + 1)));
        // With one neighbour the parabola through the three.
        let other = |it: Option<Vector3<f64>>| it.map_or(across, |it| across * 2.0 - it);
        let (u, v) = (u.unwrap_or_else(|| other(v)) * span, v.unwrap_or_else(|| other(u)) * span);
        let s = (time_s - start) / span;
        let (s2, s3) = (s * s, s * s * s);
        let chord = to.position - from.position;
        let position = from.position + chord * (3.0 * s2 - 2.0 * s3) + u * (s3 - 2.0 * s2 + s) + v * (s3 - s2);
        let mut covariance = from.covariance;
        for (it, other) in covariance.iter_mut().zip(to.covariance) {
            *it = (f64::from(*it) * (1.0 - s) + f64::from(other) * s) as f32;
        }
        let mut cameras = from.cameras.clone();
        to.cameras.iter().for_each(|it| cameras.insert(it));
        let rank = |it: Provenance| {
            [Provenance::Measured, Provenance::Filled, Provenance::Predicted]
                .iter()
                .position(|provenance| *provenance == it)
        };
        let provenance = if rank(to.provenance) > rank(from.provenance) { to.provenance } else { from.provenance };
        Some(Sample { position, covariance, cameras, provenance })
    }

    /// The largest time between neighbouring frames: one and a half steps of a regular clock, or `of_irregular_s` [s].
    pub fn neighbours_s(&self, of_irregular_s: f64) -> f64 {
        self.rate_hz.map_or(of_irregular_s, |it| 1.5 / it)
    }

    /// The frame rate, or for irregular times that of the median step; `None`: fewer than two frames.
    pub fn usual_rate_hz(&self) -> Option<f64> {
        self.rate_hz.or_else(|| {
            let mut steps: Vec<f64> = self.times_s.windows(2).map(|it| it[1] - it[0]).collect();
            steps.sort_by(f64::total_cmp);
            let step = *steps.get(steps.len() / 2)?;
            Some(rate_of(&[0.0, step]).unwrap_or(1.0 / step))
        })
    }

    /// The motion at another rate, from the first frame to the last. Frames more than `gap_s` apart leave a gap.
    ///
    /// # Errors
    /// A sentence: an invalid rate, or more than 2²⁴ frames.
    pub fn resampled(&self, rate_hz: f64, gap_s: f64) -> Result<Motion, String> {
        let span = self.times_s.last().map_or(0.0, |it| it - self.start_s());
        let n_frames = span * rate_hz + 1.0 + 1e-3;
        if !(rate_hz > 0.0 && n_frames <= f64::from(1 << 24)) {
            return Err(format!(
                "found {rate_hz} frames a second over {span:.1} s, expected more than 0 and at most {} frames",
                1 << 24
            ));
        }
        let n_frames = if self.times_s.is_empty() { 0 } else { n_frames as usize };
        let times_s: Vec<f64> = (0..n_frames).map(|it| self.start_s() + it as f64 / rate_hz).collect();
        let n_points = self.labels.len();
        let samples =
            (0..n_frames * n_points).map(|it| self.at(it % n_points, times_s[it / n_points], gap_s)).collect();
        Ok(Motion { times_s, rate_hz: Some(rate_hz), samples, skeleton: None, ..self.without_samples() })
    }

    /// All but the samples and their times.
    fn without_samples(&self) -> Motion {
        Motion {
            labels: self.labels.clone(),
            up: self.up,
            events: self.events.clone(),
            cameras: self.cameras.clone(),
            unit: self.unit.clone(),
            besides: self.besides.clone(),
            ..Motion::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(t: f64) -> Point3<f64> {
        Point3::new((3.0 * t).sin(), (2.0 * t).cos(), t)
    }

    fn motion(times_s: Vec<f64>, rate_hz: Option<f64>) -> Motion {
        let samples = times_s.iter().map(|it| Some(Sample::at(place(*it)).with_sigma(1e-3))).collect();
        Motion { labels: vec!["a".to_owned()], times_s, rate_hz, samples, ..Motion::default() }
    }

    #[test]
    fn another_rate_keeps_the_path() {
        let at_100 = motion((0..=200).map(|it| f64::from(it) / 100.0).collect(), Some(100.0));
        let at_60 = at_100.resampled(60.0, at_100.neighbours_s(0.05)).unwrap();
        assert_eq!((at_60.n_frames(), at_60.n_present(), at_60.rate_hz), (121, 121, Some(60.0)));
        for (time, sample) in at_60.times_s.iter().zip(&at_60.samples) {
            let sample = sample.as_ref().unwrap();
            // A line between frames is 0.1 mm off at 9 m/s².
            assert!((sample.position - place(*time)).norm() < 1e-5, "{time}");
            assert!((sample.sigma().unwrap() - 1e-3).abs() < 1e-9);
        }
    }

    #[test]
    fn holes_stay_holes_and_the_worse_origin_counts() {
        let mut holed = motion((0..=10).map(|it| f64::from(it) / 10.0).collect(), Some(10.0));
        holed.samples[5] = None;
        holed.samples[2].as_mut().unwrap().provenance = Provenance::Filled;
        let at_20 = holed.resampled(20.0, holed.neighbours_s(0.05)).unwrap();
        let missing: Vec<usize> = (0..21).filter(|it| at_20.samples[*it].is_none()).collect();
        assert_eq!(missing, [9, 10, 11]);
        let filled: Vec<usize> = (0..21)
            .filter(|it| at_20.samples[*it].as_ref().is_some_and(|it| it.provenance == Provenance::Filled))
            .collect();
        assert_eq!(filled, [3, 4, 5]);
        assert!(holed.at(0, -0.01, 1.0).is_none() && holed.at(0, 1.01, 1.0).is_none());
    }

    #[test]
    fn irregular_times_become_regular() {
        let times: Vec<f64> = (0..100).map(|it| f64::from(it) / 50.0 + 0.004 * f64::from(it).sin()).collect();
        let uneven = motion(times, None);
        let rate = uneven.usual_rate_hz().unwrap();
        assert!((40.0..60.0).contains(&rate), "{rate}");
        let even = uneven.resampled(50.0, 0.05).unwrap();
        assert_eq!(even.n_present(), even.n_frames());
        for (time, sample) in even.times_s.iter().zip(&even.samples) {
            assert!((sample.as_ref().unwrap().position - place(*time)).norm() < 1e-4);
        }
    }

    #[test]
    fn rates_that_cannot_be_are_refused() {
        let at_10 = motion((0..=10).map(|it| f64::from(it) / 10.0).collect(), Some(10.0));
        for rate_hz in [0.0, -5.0, f64::NAN, f64::INFINITY, 1e9] {
            assert!(at_10.resampled(rate_hz, 1.0).is_err(), "{rate_hz}");
        }
    }
}
