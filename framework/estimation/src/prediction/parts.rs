//! The nearly independent parts of a motion: upright and level.
//!
//! A walking person bobs twice a stride and steers freely; a jumping person falls ballistically and stays in place.
//! The one predicts nothing about the other, so each part has predictors and weights of its own. Z is up
//! (docs/notation.md).

use nalgebra::{Matrix3, Point3, Vector3};

/// How many there are.
pub(super) const PARTS: usize = 2;
/// A line of sight so steep shows nothing of what is upright: sine of its angle to the plumb line [–].
const STEEP: f64 = 1e-3;

/// Which directions are which part, and what of them is seen.
#[derive(Debug, Clone, Copy)]
pub(super) struct Parts {
    /// Upright, or what of it lies across the line of sight; its length is 1.
    upright: Vector3<f64>,
    /// Takes from a difference what is seen of it and is not upright.
    level: Matrix3<f64>,
}

impl Parts {
    /// At about `place`, looked at from `eye`; without one all directions are seen.
    pub fn new(eye: Option<&Point3<f64>>, place: &Point3<f64>) -> Parts {
        let sight = eye.and_then(|eye| (place - eye).try_normalize(1e-9)).unwrap_or_else(Vector3::zeros);
        let across = Matrix3::identity() - sight * sight.transpose();
        let upright = (across * Vector3::z()).try_normalize(STEEP);
        // Seen from right above, any direction across the sight is as good.
        let upright = upright.unwrap_or_else(|| (across * Vector3::x()).normalize());
        Parts { upright, level: across - upright * upright.transpose() }
    }

    /// Takes from a difference what is seen of a part.
    pub fn seen(&self) -> [Matrix3<f64>; PARTS] {
        [self.level, self.upright * self.upright.transpose()]
    }

    /// In how many directions each part is seen [–].
    pub fn axes(&self) -> [f64; PARTS] {
        [self.level.trace(), 1.0]
    }

    /// What is seen of a miss: the square of each part, an axis [m²].
    pub fn squares(&self, missed: &Vector3<f64>) -> [f64; PARTS] {
        [(self.level * missed).norm_squared() / self.level.trace(), self.upright.dot(missed).powi(2)]
    }

    /// The upright part of the second, all else of the first: what is not seen goes with what is level.
    pub fn join(&self, of: [Vector3<f64>; PARTS]) -> Vector3<f64> {
        of[0] + self.upright * self.upright.dot(&(of[1] - of[0]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(eye: Option<[f64; 3]>, place: [f64; 3], n_seen: f64) {
        let parts = Parts::new(eye.map(Point3::from).as_ref(), &Point3::from(place));
        let [level, upright] = parts.seen();
        assert!((level.trace() + upright.trace() - n_seen).abs() < 1e-9);
        assert!((level * upright).norm() < 1e-9 && (level * level - level).norm() < 1e-9);
        let missed = Vector3::new(0.3, -0.7, 1.1);
        let [of_level, of_upright] = parts.squares(&missed);
        assert!((of_level * level.trace() - (level * missed).norm_squared()).abs() < 1e-12);
        assert!((of_upright - (upright * missed).norm_squared()).abs() < 1e-12);
        assert!((parts.join([missed; 2]) - missed).norm() < 1e-12, "what both say stays");
        let joined = parts.join([missed, Vector3::new(5.0, 4.0, 3.0)]);
        assert!((level * (joined - missed)).norm() < 1e-9);
        assert!((upright * (joined - Vector3::new(5.0, 4.0, 3.0))).norm() < 1e-9);
    }

    #[test]
    fn parts_are_apart_from_wherever_they_are_seen() {
        check(None, [1.0, 2.0, 3.0], 3.0);
        check(Some([0.0, 0.0, 1.0]), [3.0, 1.0, 1.5], 2.0);
        check(Some([0.0, 0.0, 5.0]), [1.0, 0.5, 0.0], 2.0);
        check(Some([1.0, 2.0, 5.0]), [1.0, 2.0, 0.0], 2.0);
        check(Some([1.0, 2.0, 3.0]), [1.0, 2.0, 3.0], 3.0);
    }

    #[test]
    fn from_the_side_upright_is_z() {
        let parts = Parts::new(Some(&Point3::new(-3.0, 1.0, 1.5)), &Point3::new(0.0, 0.0, 1.5));
        assert!((parts.upright - Vector3::z()).norm() < 1e-12);
    }
}
