//! Median motion of the nearest neighbours of a place.

use nalgebra::{Point2, Vector2};

/// Number of neighbours.
const N: usize = 7;
/// Fewest neighbours.
const LEAST: usize = 3;

/// The nearest pairs of a place and a motion, gathered one by one.
pub(super) struct Neighbours {
    about: Point2<f64>,
    /// Ascending by the square of the distance.
    nearest: [(f64, Vector2<f64>); N],
    /// In which of the four surrounding quadrants each of them lies.
    quarters: [u8; N],
    n: usize,
}

impl Neighbours {
    /// The neighbours of `about`, none farther than `far`.
    pub fn of(about: Point2<f64>, far: f64, all: impl Iterator<Item = (Point2<f64>, Vector2<f64>)>) -> Self {
        let mut neighbours = Self { about, nearest: [(f64::INFINITY, Vector2::zeros()); N], quarters: [0; N], n: 0 };
        for (place, motion) in all {
            let offset = place - neighbours.about;
            let squared = offset.norm_squared();
            if squared <= far * far {
                let quarter = 1 << (u8::from(offset.x > 0.0) + 2 * u8::from(offset.y > 0.0));
                neighbours.add(squared, quarter, motion);
            }
        }
        neighbours
    }

    fn add(&mut self, squared: f64, quarter: u8, motion: Vector2<f64>) {
        let place = self.nearest.partition_point(|it| it.0 <= squared);
        if place < N {
            self.nearest[place..].rotate_right(1);
            self.nearest[place] = (squared, motion);
            self.quarters[place..].rotate_right(1);
            self.quarters[place] = quarter;
            self.n = (self.n + 1).min(N);
        }
    }

    /// Whether they lie in three or more quadrants: their motion then interpolates that of the middle.
    pub fn surround(&self) -> bool {
        self.quarters[..self.n].iter().fold(0, |all, it| all | it).count_ones() >= 3
    }

    /// The median of their motions along each axis; `None` with too few.
    pub fn median(&self) -> Option<Vector2<f64>> {
        if self.n < LEAST {
            return None;
        }
        let middle = |axis: usize| {
            let mut values = [f64::INFINITY; N];
            for (value, it) in values.iter_mut().zip(&self.nearest[..self.n]) {
                *value = it.1[axis];
            }
            values.sort_unstable_by(f64::total_cmp);
            (values[(self.n - 1) / 2] + values[self.n / 2]) / 2.0
        };
        Some(Vector2::new(middle(0), middle(1)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_that_of_the_nearest_and_one_stray_does_not_matter() {
        let about = Point2::new(10.0, 0.0);
        let motion = |x: f64| if x == 11.0 { Vector2::new(50.0, -50.0) } else { Vector2::new(x, 1.0) };
        let all = |n: usize| (0..n).map(move |it| (Point2::new(it as f64, 0.0), motion(it as f64)));
        // 7 to 13 are nearest; 11 strays: the middle of 7, 8, 9, 10, 12, 13, 50 is 10.
        assert_eq!(Neighbours::of(about, 100.0, all(40)).median(), Some(Vector2::new(10.0, 1.0)));
        assert_eq!(Neighbours::of(about, 1.0, all(10)).median(), None, "one is near enough");
        assert_eq!(Neighbours::of(about, 100.0, all(2)).median(), None);
        assert_eq!(Neighbours::of(about, 100.0, all(4)).median(), Some(Vector2::new(1.5, 1.0)));
    }

    #[test]
    fn neighbours_of_one_side_do_not_surround() {
        let around = |places: &[[f64; 2]]| {
            let all = places.iter().map(|it| (Point2::from(*it), Vector2::zeros()));
            Neighbours::of(Point2::new(1.0, 1.0), 100.0, all).surround()
        };
        assert!(!around(&[[2.0, 0.0], [2.0, 2.0], [3.0, 2.0], [5.0, -4.0]]));
        assert!(around(&[[2.0, 0.0], [2.0, 2.0], [3.0, 2.0], [0.0, -4.0]]));
    }
}
