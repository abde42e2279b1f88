//! The lines of sight of one camera to one moving target, in the camera's own time.

use nalgebra::{Point3, Vector3};

/// One line of sight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bearing {
    /// On the camera's clock [s].
    pub time_s: f64,
    /// In the world, of length 1.
    pub direction: Vector3<f64>,
}

/// All lines of sight of a static camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Bearings {
    /// Its position [m].
    pub centre: Point3<f64>,
    /// Ascending by time.
    list: Vec<Bearing>,
    /// Largest gap between bearings that is interpolated; see [`Bearings::follow_period`] [s].
    max_gap_s: f64,
    /// A faster rotation between two bearings is due to a wrong one [1/s].
    max_turn: f64,
}

impl Bearings {
    /// Nothing seen yet by a camera at `centre`.
    pub fn new(centre: Point3<f64>, max_gap_s: f64, max_turn: f64) -> Self {
        Self { centre, list: Vec::new(), max_gap_s, max_turn }
    }

    /// Adds a bearing; one that is not later than the last one is left out.
    pub fn push(&mut self, bearing: Bearing) {
        if self.list.last().is_none_or(|it| it.time_s < bearing.time_s) {
            self.list.push(bearing);
        }
    }

    /// Call after the last bearing: for a camera with less than one picture in the allowed gap, the gap is extended to bridge neighbouring
    /// pictures.
    pub fn follow_period(&mut self) {
        let mut gaps: Vec<f64> = self.list.windows(2).map(|it| it[1].time_s - it[0].time_s).collect();
        gaps.sort_by(f64::total_cmp);
        // Pictures without the target make most gaps several periods long; a tenth of them is not.
        let period_s = gaps.get(gaps.len() / 10).copied().unwrap_or(0.0);
        self.max_gap_s = self.max_gap_s.max(NEIGHBOUR_PERIODS * period_s);
    }

    /// All of them, ascending by time.
    pub fn list(&self) -> &[Bearing] {
        &self.list
    }

    /// Time of the first and the last [s].
    pub fn span_s(&self) -> Option<(f64, f64)> {
        Some((self.list.first()?.time_s, self.list.last()?.time_s))
    }

    /// Direction at `time_s`, interpolated between its two neighbours, and its derivative [1/s]; `None` in a gap, and beside
    /// a wrong bearing, which would have a large weight due to its speed.
    pub fn at(&self, time_s: f64) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let next = self.list.partition_point(|it| it.time_s < time_s);
        let (before, after) = (self.list.get(next.checked_sub(1)?)?, self.list.get(next)?);
        let step = after.time_s - before.time_s;
        if step > self.max_gap_s {
            return None;
        }
        let change = (after.direction - before.direction) / step;
        if change.norm() > self.max_turn {
            return None;
        }
        Some(((before.direction + change * (time_s - before.time_s)).normalize(), change))
    }

    /// Directions at the times `start_s` + i · `step_s` up to the last bearing.
    pub fn resampled(&self, start_s: f64, step_s: f64) -> Vec<Option<Vector3<f64>>> {
        let Some((_, end)) = self.span_s() else { return Vec::new() };
        let n = ((end - start_s) / step_s).max(0.0) as usize + 1;
        (0..n).map(|it| Some(self.at(start_s + it as f64 * step_s)?.0)).collect()
    }
}

/// Signed angle by which two lines of sight miss one another: the triple product of the baseline's direction and the two lines, as
/// far as both would have to turn to meet [rad]. `None` where one line runs along the baseline.
#[inline]
pub(super) fn miss(baseline: &Vector3<f64>, a: &Vector3<f64>, b: &Vector3<f64>) -> Option<(f64, f64)> {
    let (across_a, across_b) = (baseline.cross(a), baseline.cross(b));
    let scale = (across_a.norm_squared() + across_b.norm_squared()).sqrt();
    (across_a.norm_squared() > ALONG && across_b.norm_squared() > ALONG).then(|| (across_a.dot(b) / scale, 1.0 / scale))
}

/// Bearings this many periods apart are neighbours, however slow the camera [–].
const NEIGHBOUR_PERIODS: f64 = 1.5;

/// Square of the sine of the angle to the baseline below which a line of sight is uninformative: 3°.
const ALONG: f64 = 2.7e-3;

#[cfg(test)]
mod tests {
    use super::*;

    fn bearing(time_s: f64, x: f64) -> Bearing {
        Bearing { time_s, direction: Vector3::new(x, 1.0, 0.0).normalize() }
    }

    #[test]
    fn directions_are_interpolated_and_gaps_are_not_bridged() {
        let mut bearings = Bearings::new(Point3::origin(), 0.5, 1.0);
        [(0.0, 0.0), (0.4, 0.04), (0.2, 9.0), (2.0, 0.1), (2.1, 0.1)]
            .into_iter()
            .for_each(|(time, x)| bearings.push(bearing(time, x)));
        assert_eq!(bearings.list().len(), 4, "one was out of order");
        let (direction, change) = bearings.at(0.1).unwrap();
        assert!((direction.x - 0.01).abs() < 1e-4 && (change.x - 0.1).abs() < 1e-3, "{direction} {change}");
        assert_eq!([bearings.at(1.0), bearings.at(-0.1), bearings.at(2.2)], [None; 3]);
        let grid = bearings.resampled(0.05, 0.2);
        assert_eq!(grid.len(), 11);
        assert!(grid[0].is_some() && grid[3].is_none() && grid[10].is_some());
    }

    #[test]
    fn neighbours_of_a_slow_camera_are_bridged_whatever_its_rate() {
        // Three and a third pictures a second: gaps of 0.3 s to the last digit, or one more.
        let mut bearings = Bearings::new(Point3::origin(), 0.3, 1.0);
        (0..40).for_each(|it| bearings.push(bearing(f64::from(it) * 0.3, 0.01 * f64::from(it))));
        bearings.push(bearing(14.0, 0.5));
        bearings.follow_period();
        assert!((0..38).all(|it| bearings.at(f64::from(it) * 0.3 + 0.15).is_some()));
        assert_eq!(bearings.at(13.0), None);
    }

    #[test]
    fn lines_that_meet_miss_by_nothing_and_others_by_their_angle() {
        let point = Point3::new(3.0, 20.0, 5.0);
        let ends = [Point3::origin(), Point3::new(10.0, 0.0, 0.0)];
        let [a, b] = ends.map(|it| (point - it).normalize());
        let baseline = Vector3::x();
        assert!(miss(&baseline, &a, &b).unwrap().0.abs() < 1e-12);
        let turned = (b + Vector3::z() * 0.01).normalize();
        let (angle, _) = miss(&baseline, &a, &turned).unwrap();
        assert!((angle.abs() - 0.01 / 2.0_f64.sqrt()).abs() < 1.5e-3, "{angle}");
        assert_eq!(miss(&baseline, &baseline, &b), None);
    }
}
