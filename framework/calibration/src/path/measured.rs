//! A path measured by another system, with interpolation between its rows.
//!
//! Between two rows the path is a cubic (Hermite) whose slopes are those of the parabola through three neighbours: at 5 Hz and 5 m/s²
//! a straight line would be off by 25 mm. Across a gap in the rows there is no path.

use foveate_estimation::statistics::median;
use nalgebra::{Matrix3, Point3, Vector3};

/// Rows that it takes to make a path [–].
const LEAST_ROWS: usize = 8;
/// Rows so many times further apart in time than most are a gap [–].
const GAP: f64 = 5.5;
/// A path that reaches so many times its own noise at most stands still [–].
const STILL: f64 = 8.0;
/// A path so many times longer than wide is a line: a turn about it changes nothing that a camera could see [–].
const LINE: f64 = 0.01;

/// Times and places of one point in space, in the order of time.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuredPath {
    times_s: Vec<f64>,
    places: Vec<Point3<f64>>,
    slopes: Vec<Vector3<f64>>,
    gap_s: f64,
    left_out: usize,
}

/// Why rows do not make a usable path.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum MeasuredPathError {
    /// Too few rows with finite numbers and distinct times.
    #[error("the path has {found} rows with finite numbers and distinct times, expected at least {LEAST_ROWS}")]
    TooFewRows {
        /// Number that was found.
        found: usize,
    },
    /// It does not move.
    #[error(
        "the path does not move: it extends over {reach_m:.3} m, no more than its own noise ({noise_m:.4} m); move the point through the whole volume"
    )]
    Still {
        /// Standard deviation along its longest axis [m].
        reach_m: f64,
        /// Of a row's place [m].
        noise_m: f64,
    },
    /// It moves along a line.
    #[error(
        "the path lies on a line ({along_m:.3} m along it, {across_m:.4} m across): a camera may be rotated about it freely; move the point sideways and up \
         and down as well"
    )]
    Line {
        /// Standard deviation along it [m].
        along_m: f64,
        /// And across [m].
        across_m: f64,
    },
}

impl MeasuredPath {
    /// From rows of time [s] and place [m] in any order; rows without finite numbers and rows with a repeated time are left out.
    ///
    /// # Errors
    /// See [`MeasuredPathError`].
    pub fn new(rows: &[(f64, Point3<f64>)]) -> Result<MeasuredPath, MeasuredPathError> {
        let mut usable: Vec<(f64, Point3<f64>)> =
            rows.iter().copied().filter(|it| it.0.is_finite() && it.1.coords.norm().is_finite()).collect();
        usable.sort_by(|a, b| a.0.total_cmp(&b.0));
        usable.dedup_by(|later, earlier| later.0 <= earlier.0);
        if usable.len() < LEAST_ROWS {
            return Err(MeasuredPathError::TooFewRows { found: usable.len() });
        }
        let (times_s, places): (Vec<f64>, Vec<Point3<f64>>) = usable.into_iter().unzip();
        let gaps: Vec<f64> = times_s.windows(2).map(|it| it[1] - it[0]).collect();
        let gap_s = GAP * median(&gaps).unwrap_or(0.0);
        let slopes = slopes(&times_s, &places, gap_s);
        let left_out = rows.len() - times_s.len();
        let path = MeasuredPath { times_s, places, slopes, gap_s, left_out };
        path.check_shape()?;
        Ok(path)
    }

    fn check_shape(&self) -> Result<(), MeasuredPathError> {
        let ([along_m, across_m, _], noise_m) = (spreads(&self.places), self.noise_m());
        if along_m <= STILL * noise_m || along_m <= 0.0 {
            return Err(MeasuredPathError::Still { reach_m: along_m, noise_m });
        }
        if across_m <= LINE * along_m {
            return Err(MeasuredPathError::Line { along_m, across_m });
        }
        Ok(())
    }

    /// Standard deviation of a row's coordinate, from second differences: what is left of them at a moving point is taken for noise [m].
    fn noise_m(&self) -> f64 {
        let second = |it: &[Point3<f64>]| (it[0].coords - 2.0 * it[1].coords + it[2].coords).norm();
        // √6 for the difference, and the median length of three Gaussian numbers is 1.538 of their standard deviation.
        median(&self.places.windows(3).map(second).collect::<Vec<_>>()).unwrap_or(0.0) / (6.0_f64.sqrt() * 1.538)
    }

    /// First and last time [s].
    pub fn span_s(&self) -> [f64; 2] {
        [self.times_s[0], self.times_s[self.times_s.len() - 1]]
    }

    /// Rows in use.
    pub fn len(&self) -> usize {
        self.times_s.len()
    }

    /// Always `false`: a path has rows.
    pub fn is_empty(&self) -> bool {
        self.times_s.is_empty()
    }

    /// Rows left out: without finite numbers, or with a repeated time.
    pub fn left_out(&self) -> usize {
        self.left_out
    }

    /// Rows a second, the median.
    pub fn rate_hz(&self) -> f64 {
        GAP / self.gap_s
    }

    /// The part of the path from one time to another; `None` where too little is left.
    ///
    /// # Errors
    /// See [`MeasuredPathError`].
    pub fn between(&self, from_s: f64, until_s: f64) -> Result<MeasuredPath, MeasuredPathError> {
        let rows = self.times_s.iter().copied().zip(self.places.iter().copied());
        let inside: Vec<_> = rows.filter(|it| (from_s..=until_s).contains(&it.0)).collect();
        MeasuredPath::new(&inside)
    }

    /// The middle of all places [m].
    pub fn middle(&self) -> Point3<f64> {
        let sum = self.places.iter().fold(Vector3::zeros(), |sum, it| sum + it.coords);
        Point3::from(sum / self.places.len() as f64)
    }

    /// The same path, seen from a world whose origin is at `origin` of this one.
    pub(super) fn seen_from(&self, origin: &Point3<f64>) -> MeasuredPath {
        let places = self.places.iter().map(|it| it - origin.coords).collect();
        MeasuredPath { places, ..self.clone() }
    }

    /// The same path with its first two axes swapped: that of a world of the other hand.
    pub(super) fn of_other_hand(&self) -> MeasuredPath {
        let places = self.places.iter().map(|it| Point3::new(it.y, it.x, it.z)).collect();
        let slopes = self.slopes.iter().map(|it| Vector3::new(it.y, it.x, it.z)).collect();
        MeasuredPath { places, slopes, ..self.clone() }
    }

    /// Whether there is a path at that time.
    pub fn covers(&self, time_s: f64) -> bool {
        let [from, until] = self.span_s();
        (from..=until).contains(&time_s) && {
            let after = self.times_s.partition_point(|it| *it < time_s);
            after == 0 || self.times_s[after] - self.times_s[after - 1] <= self.gap_s
        }
    }

    /// Place [m] and velocity [m/s]; before the first row, after the last and in gaps as if it went on.
    pub fn at(&self, time_s: f64) -> (Point3<f64>, Vector3<f64>) {
        let last = self.times_s.len() - 1;
        if time_s <= self.times_s[0] || time_s >= self.times_s[last] {
            let end = if time_s <= self.times_s[0] { 0 } else { last };
            return (self.places[end] + self.slopes[end] * (time_s - self.times_s[end]), self.slopes[end]);
        }
        let after = self.times_s.partition_point(|it| *it <= time_s);
        let (before, span) = (after - 1, self.times_s[after] - self.times_s[after - 1]);
        let s = (time_s - self.times_s[before]) / span;
        let (p, q) = (self.places[before].coords, self.places[after].coords);
        let (u, v) = (self.slopes[before] * span, self.slopes[after] * span);
        let (bend, twist) = (3.0 * (q - p) - 2.0 * u - v, 2.0 * (p - q) + u + v);
        let place = p + u * s + bend * s * s + twist * s * s * s;
        (Point3::from(place), (u + bend * 2.0 * s + twist * 3.0 * s * s) / span)
    }
}

/// At each row, the slope of the parabola through it and its neighbours; of a line at ends and beside gaps.
fn slopes(times_s: &[f64], places: &[Point3<f64>], gap_s: f64) -> Vec<Vector3<f64>> {
    let between = |index: usize| {
        let span = times_s[index + 1] - times_s[index];
        (span <= gap_s).then(|| ((places[index + 1] - places[index]) / span, span))
    };
    let at = |index: usize| {
        let before = index.checked_sub(1).and_then(between);
        let after = (index + 1 < times_s.len()).then(|| between(index)).flatten();
        match (before, after) {
            (Some((one, h)), Some((other, k))) => (one * k + other * h) / (h + k),
            (Some((one, _)), None) | (None, Some((one, _))) => one,
            (None, None) => Vector3::zeros(),
        }
    };
    (0..times_s.len()).map(at).collect()
}

/// Standard deviations along the principal axes, the longest first [m].
pub(super) fn spreads(places: &[Point3<f64>]) -> [f64; 3] {
    let n = places.len().max(1) as f64;
    let middle = places.iter().fold(Vector3::zeros(), |sum, it| sum + it.coords) / n;
    let scatter = places.iter().fold(Matrix3::zeros(), |sum, it| {
        let from_middle = it.coords - middle;
        sum + from_middle * from_middle.transpose() / n
    });
    let mut spreads: [f64; 3] = scatter.symmetric_eigenvalues().map(|it| it.max(0.0).sqrt()).into();
    spreads.sort_by(|a, b| b.total_cmp(a));
    spreads
}

/// Standard deviation of either coordinate behind lengths whose median is `median_length`: a Gaussian pair of numbers is half of the time
/// closer to 0 than 1.1774 of it.
pub(super) fn sigma_of_lengths(lengths: &[f64]) -> f64 {
    const MEDIAN_LENGTH: f64 = 1.177_41;
    median(lengths).unwrap_or(0.0) / MEDIAN_LENGTH
}

#[cfg(test)]
mod tests {
    use super::*;

    fn on_curve(time_s: f64) -> Point3<f64> {
        Point3::new(3.0 * time_s.cos(), 2.0 * time_s.sin(), 0.5 * (2.0 * time_s).sin())
    }

    fn rows() -> Vec<(f64, Point3<f64>)> {
        (0..100).map(|it| f64::from(it) * 0.1).map(|it| (it, on_curve(it))).collect()
    }

    #[test]
    fn between_rows_the_path_is_nearer_than_a_straight_line_would_be() {
        let path = MeasuredPath::new(&rows()).unwrap();
        let worst = (5..900).map(|it| f64::from(it) * 0.01 + 0.055).map(|it| (path.at(it).0 - on_curve(it)).norm());
        let straight = (on_curve(0.1) + (on_curve(0.2) - on_curve(0.1)) * 0.5 - on_curve(0.15)).norm();
        let worst = worst.fold(0.0, f64::max);
        assert!(straight > 3e-3 && worst < 6e-4, "{straight} {worst}");
        let (step, (_, velocity)) = (1e-5, path.at(4.03));
        let difference = (path.at(4.03 + step).0 - path.at(4.03 - step).0) / (2.0 * step);
        assert!((velocity - difference).norm() < 1e-6, "{velocity} {difference}");
    }

    #[test]
    fn rows_in_disorder_twice_and_without_numbers_do_not_matter() {
        let mut mixed = rows();
        mixed.reverse();
        mixed.push((2.0, Point3::origin()));
        mixed.push((f64::NAN, Point3::origin()));
        mixed.push((0.35, Point3::new(f64::INFINITY, 0.0, 0.0)));
        let (path, other) = (MeasuredPath::new(&mixed).unwrap(), MeasuredPath::new(&rows()).unwrap());
        assert_eq!((path.len(), path.left_out()), (100, 3));
        assert_eq!(path.at(0.31), other.at(0.31));
    }

    #[test]
    fn there_is_no_path_in_a_gap() {
        let with_gap: Vec<_> = rows().into_iter().filter(|it| !(3.0..5.0).contains(&it.0)).collect();
        let path = MeasuredPath::new(&with_gap).unwrap();
        assert!(
            !path.covers(4.0) && path.covers(2.85) && path.covers(5.05) && !path.covers(-0.1) && !path.covers(10.0)
        );
        assert!(path.covers(0.0) && path.covers(9.9));
    }

    #[test]
    fn what_fixes_nothing_is_refused() {
        let line: Vec<_> = rows().iter().map(|it| (it.0, Point3::new(it.0, 2.0 * it.0, 1.0))).collect();
        assert!(matches!(MeasuredPath::new(&line), Err(MeasuredPathError::Line { .. })));
        let still: Vec<_> = rows().iter().map(|it| (it.0, Point3::new(1.0, 2.0, 3.0))).collect();
        assert!(matches!(MeasuredPath::new(&still), Err(MeasuredPathError::Still { .. })));
        let mut random = foveate_estimation::Random::new(1);
        let mut noise = || 0.01 * random.normal();
        let noisy: Vec<_> = rows().iter().map(|it| (it.0, Point3::new(noise(), noise(), noise()))).collect();
        assert!(matches!(MeasuredPath::new(&noisy), Err(MeasuredPathError::Still { .. })));
        assert!(matches!(MeasuredPath::new(&rows()[..7]), Err(MeasuredPathError::TooFewRows { found: 7 })));
    }
}
