//! By how much the clock of one motion is off another's.
//!
//! First the cross-correlation of speeds, which a transform in space does not change: of each pair of points, or of the mean over all points where pairs are not known yet. Then the shift
//! near its peak with the least mean square distance.

use super::{common_times, lay_onto, move_in_time, places};
use crate::motion::Motion;

/// Frames that must overlap, and the part of the shorter motion.
const LEAST_FRAMES: usize = 10;
const LEAST_SHARE: f64 = 0.25;
/// Lags that are tried, at most.
const MOST_LAGS: f64 = 200_000.0;

/// The speeds of points on one clock, NaN where they are not known [m/s].
fn speeds(motion: &Motion, points: &[usize], rate_hz: f64) -> Vec<Vec<f64>> {
    let gap = motion.neighbours_s(super::NEIGHBOURS_S);
    let start = (motion.start_s() * rate_hz).ceil();
    let end = motion.times_s.last().copied().unwrap_or(0.0) * rate_hz;
    let times: Vec<f64> = (0..(end - start + 1.0).max(0.0) as usize).map(|it| (start + it as f64) / rate_hz).collect();
    let of_point = |point: &usize| {
        let places: Vec<_> = times.iter().map(|it| motion.at(*point, *it, gap).map(|it| it.position)).collect();
        let speed = |it: &[Option<nalgebra::Point3<f64>>]| {
            it[0].zip(it[2]).map_or(f64::NAN, |(a, b)| (b - a).norm() * rate_hz / 2.0)
        };
        places.windows(3).map(speed).collect()
    };
    points.iter().map(of_point).collect()
}

/// The mean of several series, each where it is known.
fn mean(all: &[Vec<f64>]) -> Vec<f64> {
    let n = all.first().map_or(0, Vec::len);
    let at = |place: usize| {
        let known = all.iter().map(|it| it[place]).filter(|it| it.is_finite());
        let (n, sum) = known.fold((0.0, 0.0), |all, it| (all.0 + 1.0, all.1 + it));
        sum / n
    };
    (0..n).map(at).collect()
}

/// Sums for the correlation of two series over what both know.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    n: f64,
    x: f64,
    y: f64,
    xx: f64,
    yy: f64,
    xy: f64,
}

impl Sums {
    /// Of x[i] with y[i − lag].
    fn of(x: &[f64], y: &[f64], lag: i64) -> Self {
        let mut sums = Sums::default();
        let first = lag.max(0) as usize;
        let last = (y.len() as i64 + lag).clamp(0, x.len() as i64) as usize;
        for place in first..last.max(first) {
            let (x, y) = (x[place], y[(place as i64 - lag) as usize]);
            if x.is_finite() && y.is_finite() {
                sums.n += 1.0;
                (sums.x, sums.y) = (sums.x + x, sums.y + y);
                (sums.xx, sums.yy, sums.xy) = (sums.xx + x * x, sums.yy + y * y, sums.xy + x * y);
            }
        }
        sums
    }

    /// Covariance and the two variances.
    fn moments(&self) -> [f64; 3] {
        let n = self.n.max(1.0);
        [self.xy - self.x * self.y / n, self.xx - self.x * self.x / n, self.yy - self.y * self.y / n]
    }
}

/// What is to be added to B's times so that its speeds go with A's.
///
/// # Errors
/// A sentence: nothing moves, or no shift within the limit leaves enough overlap.
pub(super) fn by_speeds(a: &Motion, b: &Motion, pairs: Option<&[[usize; 2]]>, most_s: f64) -> Result<f64, String> {
    let rate = |it: &Motion| it.usual_rate_hz().unwrap_or(1.0);
    let rate_hz = rate(a).min(rate(b));
    if most_s * rate_hz > MOST_LAGS {
        return Err(format!(
            "found a shift of up to {most_s} s at {rate_hz} Hz, expected at most {:.0} s",
            MOST_LAGS / rate_hz
        ));
    }
    let points = |of: usize, n: usize| {
        pairs.map_or_else(|| (0..n).collect(), |it| it.iter().map(|it| it[of]).collect::<Vec<_>>())
    };
    let mut in_a = speeds(a, &points(0, a.labels.len()), rate_hz);
    let mut in_b = speeds(b, &points(1, b.labels.len()), rate_hz);
    if pairs.is_none() {
        (in_a, in_b) = (vec![mean(&in_a)], vec![mean(&in_b)]);
    }
    // Both count from a frame of the common clock.
    let offset = (a.start_s() * rate_hz).ceil() as i64 - (b.start_s() * rate_hz).ceil() as i64;
    let shorter = in_a.first().map_or(0, Vec::len).min(in_b.first().map_or(0, Vec::len));
    let least = LEAST_FRAMES.max((LEAST_SHARE * shorter as f64) as usize);
    let correlation = |lag: i64| {
        let overlap = |x: &[f64], y: &[f64]| {
            let lag = lag - offset;
            (y.len() as i64 + lag).min(x.len() as i64) - lag.max(0)
        };
        let mut all = [0.0; 3];
        for (x, y) in in_a.iter().zip(&in_b) {
            if overlap(x, y) < least as i64 {
                return f64::NEG_INFINITY;
            }
            let of_pair = Sums::of(x, y, lag - offset).moments();
            all.iter_mut().zip(of_pair).for_each(|(to, it)| *to += it);
        }
        let scale = (all[1] * all[2]).sqrt();
        if scale > 0.0 { all[0] / scale } else { f64::NEG_INFINITY }
    };
    let most = (most_s * rate_hz).floor() as i64;
    // Of equal ones the smallest shift.
    let lags = (0..=most).flat_map(|it| if it == 0 { vec![0] } else { vec![it, -it] });
    let mut best = (f64::NEG_INFINITY, 0);
    for lag in lags {
        let value = correlation(lag);
        if value > best.0 + 1e-12 {
            best = (value, lag);
        }
    }
    match best {
        (value, _) if value == f64::NEG_INFINITY => {
            Err(format!("found no shift within {most_s} s that leaves {least} frames in common in which points move"))
        }
        (_, lag) => Ok(lag as f64 / rate_hz),
    }
}

/// What is still to be added to B's times, within a frame, for the least mean square distance.
pub(super) fn refined(a: &Motion, b: &Motion, pairs: &[[usize; 2]], is_aligned: bool) -> Result<f64, String> {
    let cost = |shift: f64| -> Result<f64, String> {
        let mut b = b.clone();
        move_in_time(&mut b, shift);
        let a_from_b = if is_aligned { lay_onto(a, &b, pairs)? } else { Default::default() };
        let (times_s, _) = common_times(a, &b);
        let step = (times_s.len() * pairs.len()).div_ceil(super::MOST_FITTED).max(1);
        let few: Vec<f64> = times_s.into_iter().step_by(step).collect();
        let mut distances: Vec<f64> = Vec::new();
        for pair in pairs {
            let both = places(a, &b, &few, *pair).into_iter();
            distances.extend(both.filter_map(|it| Some((a_from_b * it[1]? - it[0]?).norm_squared())));
        }
        distances.sort_by(f64::total_cmp);
        // Without the worst tenth: exchanged points do not move with the others.
        let kept = &distances[..distances.len() - distances.len() / 10];
        Ok(if kept.is_empty() { f64::INFINITY } else { kept.iter().sum::<f64>() / kept.len() as f64 })
    };
    let rate = |it: &Motion| it.usual_rate_hz().unwrap_or(1.0);
    let frame = 1.0 / rate(a).min(rate(b));
    let (mut from, mut to) = (-1.5 * frame, 1.5 * frame);
    // Golden section: to a thousandth of a frame.
    let golden = (5.0_f64.sqrt() - 1.0) / 2.0;
    while to - from > 1e-3 * frame {
        let (left, right) = (to - golden * (to - from), from + golden * (to - from));
        if cost(left)? <= cost(right)? { to = right } else { from = left }
    }
    let best = (from + to) / 2.0;
    // A shift that gains nothing is none.
    Ok(if cost(best)? < cost(0.0)? * (1.0 - 1e-6) { best } else { 0.0 })
}
