//! Fills short gaps in the paths of points.
//!
//! A gap is filled with the cubic that meets the samples at its ends with the velocities that the path has there
//! (Hermite). A velocity is the derivative, at the
//! last sample before the gap (or the first after it), of the least-squares parabola through up to [`RUN`] samples
//! there, or of the line through fewer than three; next to
//! a single sample it is that of the straight line across. Filled samples are marked: their `provenance` is filled, and they have no covariance.

use foveate_messages::Provenance;
use nalgebra::{Matrix3, Point3, Vector3};

use crate::motion::{Motion, Sample};

/// Samples beside a gap that determine its path: a tenth of a second at 50 Hz, over which people move along a parabola to a millimetre.
pub const RUN: usize = 5;

/// What [`fill`] did, for reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Filled {
    /// Number of gaps filled.
    pub n_gaps: usize,
    /// Number of samples filled.
    pub n_samples: usize,
    /// Number of gaps left because they are too long.
    pub n_too_long: usize,
    /// Samples missing before the first and after the last of a point: these are not gaps.
    pub n_outside: usize,
}

/// Fills the gaps of every point whose ends are at most `longest_s` apart [s].
pub fn fill(motion: &mut Motion, longest_s: f64) -> Filled {
    let mut filled = Filled::default();
    let n_points = motion.labels.len();
    for point in 0..n_points {
        let there: Vec<usize> = (0..motion.n_frames()).filter(|it| motion.get(*it, point).is_some()).collect();
        let (Some(first), Some(last)) = (there.first(), there.last()) else { continue };
        filled.n_outside += first + motion.n_frames() - 1 - last;
        for pair in there.windows(2).filter(|it| it[1] > it[0] + 1) {
            let (from, to) = (pair[0], pair[1]);
            // Half a microsecond: times in files are rounded.
            if motion.times_s[to] - motion.times_s[from] > longest_s + 0.5e-6 {
                filled.n_too_long += 1;
                continue;
            }
            // Of what was there before: gaps that are filled say nothing about the next one.
            let places = crossing(motion, &there, point, [from, to]);
            filled.n_gaps += 1;
            filled.n_samples += places.len();
            for (frame, place) in (from + 1..to).zip(places) {
                motion.samples[frame * n_points + point] =
                    Some(Sample { provenance: Provenance::Filled, ..Sample::at(place) });
            }
        }
    }
    if filled.n_samples > 0 {
        motion.skeleton = None;
    }
    filled
}

/// The places of a point in the frames between two in which it is.
fn crossing(motion: &Motion, there: &[usize], point: usize, [from, to]: [usize; 2]) -> Vec<Point3<f64>> {
    let place = |frame: usize| motion.get(frame, point).map_or_else(Point3::origin, |it| it.position);
    let (a, b) = (place(from), place(to));
    let (start, span) = (motion.times_s[from], motion.times_s[to] - motion.times_s[from]);
    let at = there.partition_point(|it| *it < from);
    // Up to RUN frames in a row, the nearest first.
    let before = there[..=at].iter().rev().take(RUN).copied().enumerate().take_while(|(n, it)| it + n == from);
    let behind = there[at + 1..].iter().take(RUN).copied().enumerate().take_while(|(n, it)| *it == to + n);
    let across = (b - a) / span;
    let slope = |frames: Vec<usize>| {
        let run: Vec<(f64, Point3<f64>)> =
            frames.iter().map(|it| (motion.times_s[*it] - motion.times_s[frames[0]], place(*it))).collect();
        velocity(&run).unwrap_or(across)
    };
    let (u, v) = (slope(before.map(|it| it.1).collect()) * span, slope(behind.map(|it| it.1).collect()) * span);
    (from + 1..to)
        .map(|frame| {
            let s = (motion.times_s[frame] - start) / span;
            let (s2, s3) = (s * s, s * s * s);
            a + (b - a) * (3.0 * s2 - 2.0 * s3) + u * (s3 - 2.0 * s2 + s) + v * (s3 - s2)
        })
        .collect()
}

/// The derivative at time 0 of the parabola (line) of least squares through places; `None` of fewer than two.
fn velocity(run: &[(f64, Point3<f64>)]) -> Option<Vector3<f64>> {
    let [(_, first), .., (last, end)] = run else { return None };
    if run.len() < 3 || *last == 0.0 {
        return (*last != 0.0).then(|| (end - first) / *last);
    }
    // In steps of the whole run, so that the powers are alike.
    let mut normal = Matrix3::zeros();
    let mut sides = Matrix3::zeros();
    for (time, place) in run {
        let s = time / last;
        let powers = Vector3::new(1.0, s, s * s);
        normal += powers * powers.transpose();
        sides += powers * (place - first).transpose();
    }
    let solved = normal.try_inverse()? * sides;
    Some(solved.row(1).transpose() / *last)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wrist that swings 0.3 m at 1 Hz, seen at 100 Hz; `is_there` of the frame.
    fn swing(is_there: impl Fn(usize) -> bool) -> (Motion, Vec<Point3<f64>>) {
        let place = |frame: usize| {
            let phase = frame as f64 / 100.0 * std::f64::consts::TAU;
            Point3::new(0.3 * phase.sin(), 0.1 * phase.cos(), 1.0)
        };
        let motion = Motion {
            labels: vec!["wrist".to_owned()],
            times_s: (0..200).map(|it| f64::from(it) / 100.0).collect(),
            rate_hz: Some(100.0),
            samples: (0..200).map(|it| is_there(it).then(|| Sample::at(place(it)))).collect(),
            ..Motion::default()
        };
        (motion, (0..200).map(place).collect())
    }

    fn worst(motion: &Motion, truth: &[Point3<f64>]) -> f64 {
        let errors =
            motion.samples.iter().zip(truth).filter_map(|(it, truth)| Some((it.as_ref()?.position - truth).norm()));
        errors.fold(0.0, f64::max)
    }

    #[test]
    fn gaps_up_to_the_longest_are_filled_and_say_so() {
        let is_there = |it: usize| !(it < 3 || (20..30).contains(&it) || (60..81).contains(&it) || it > 195);
        let (mut motion, truth) = swing(is_there);
        let filled = fill(&mut motion, 0.11);
        assert_eq!(filled, Filled { n_gaps: 1, n_samples: 10, n_too_long: 1, n_outside: 3 + 4 });
        assert_eq!(motion.n_of(Provenance::Filled), 10);
        assert!(
            motion.samples[20..30]
                .iter()
                .flatten()
                .all(|it| it.provenance == Provenance::Filled && it.sigma().is_none())
        );
        assert!(motion.samples[60].is_none() && motion.samples[0].is_none() && motion.samples[199].is_none());
        // A straight line across a tenth of a second is 18 mm off; the cubic by far less.
        assert!(worst(&motion, &truth) < 0.5e-3, "{} m", worst(&motion, &truth));
    }

    #[test]
    fn gaps_beside_single_samples_are_crossed_in_a_straight_line() {
        let (mut motion, _) = swing(|it| it == 10 || it == 14);
        assert_eq!(fill(&mut motion, 1.0).n_samples, 3);
        let place = |it: usize| motion.samples[it].as_ref().unwrap().position;
        assert!((place(12) - nalgebra::center(&place(10), &place(14))).norm() < 1e-12);
    }

    #[test]
    fn runs_of_two_and_irregular_times_do_no_harm() {
        let (mut motion, truth) = swing(|it| !(50..54).contains(&it) && !(56..60).contains(&it));
        fill(&mut motion, 0.06);
        assert!(worst(&motion, &truth) < 1e-3, "{}", worst(&motion, &truth));
        let (mut uneven, _) = swing(|it| it.is_multiple_of(3));
        uneven.times_s.iter_mut().enumerate().for_each(|(it, time)| *time += 0.003 * (it as f64).sin());
        fill(&mut uneven, 10.0);
        assert!(uneven.samples.iter().flatten().all(|it| it.position.coords.norm() < 2.0));
        assert_eq!(fill(&mut Motion::default(), 1.0), Filled::default());
    }
}
