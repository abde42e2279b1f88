//! Lines of sight, and their closest approach.

use nalgebra::{Point3, Unit, Vector3};

/// Two rays whose angle has a smaller sine than this [rad] count as parallel.
const PARALLEL: f64 = 1e-6;

/// A line of sight: a line with an origin and a direction. Depths along it are signed, negative behind the origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Origin, for example a camera's centre [m].
    pub origin: Point3<f64>,
    /// Unit direction.
    pub direction: Unit<Vector3<f64>>,
}

/// Where two rays come closest to each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Approach {
    /// Midway between the two closest points [m].
    pub midpoint: Point3<f64>,
    /// Distance between the two closest points [m].
    pub gap: f64,
    /// Depth of the closest point on the first ray; negative behind its origin [m].
    pub depth_a: f64,
    /// Depth of the closest point on the second ray; negative behind its origin [m].
    pub depth_b: f64,
}

impl Ray {
    /// The point at `depth` along the ray [m].
    #[inline]
    pub fn at(&self, depth: f64) -> Point3<f64> {
        self.origin + self.direction.into_inner() * depth
    }

    /// Depth of the point on the ray closest to `point`; negative behind the origin [m].
    #[inline]
    pub fn depth_of(&self, point: &Point3<f64>) -> f64 {
        (point - self.origin).dot(&self.direction)
    }

    /// Distance of `point` from the whole line, also behind the origin [m].
    #[inline]
    pub fn distance_to(&self, point: &Point3<f64>) -> f64 {
        (point - self.origin).cross(&self.direction).norm()
    }
}

/// The closest approach of the lines of `a` and `b`; `None` when they are parallel to within a millionth of a radian,
/// or not finite. Check the depths where only points in front of the origins count.
#[inline]
pub fn closest_approach(a: &Ray, b: &Ray) -> Option<Approach> {
    let normal = a.direction.cross(&b.direction);
    let sine_squared = normal.norm_squared();
    let between = b.origin - a.origin;
    let depth_a = between.cross(&b.direction).dot(&normal) / sine_squared;
    let depth_b = between.cross(&a.direction).dot(&normal) / sine_squared;
    let (on_a, on_b) = (a.at(depth_a), b.at(depth_b));
    let gap = (on_b - on_a).norm();
    (sine_squared > PARALLEL * PARALLEL && gap.is_finite()).then(|| Approach {
        midpoint: nalgebra::center(&on_a, &on_b),
        gap,
        depth_a,
        depth_b,
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn ray(origin: [f64; 3], direction: [f64; 3]) -> Ray {
        Ray { origin: origin.into(), direction: Unit::new_normalize(direction.into()) }
    }

    #[test]
    fn skew_lines_meet_halfway() {
        let approach =
            closest_approach(&ray([0.0; 3], [1.0, 0.0, 0.0]), &ray([2.0, 5.0, 1.0], [0.0, 1.0, 0.0])).unwrap();
        assert!((approach.midpoint - Point3::new(2.0, 0.0, 0.5)).norm() < 1e-12);
        assert!((approach.gap - 1.0).abs() < 1e-12);
        assert!((approach.depth_a - 2.0).abs() < 1e-12);
        assert!((approach.depth_b + 5.0).abs() < 1e-12);
    }

    #[test]
    fn parallel_identical_and_broken_rays_have_no_approach() {
        let a = ray([0.0; 3], [1.0, 2.0, 3.0]);
        for b in [
            a,
            ray([1.0, 0.0, 0.0], [1.0, 2.0, 3.0]),
            ray([1.0, 0.0, 0.0], [-1.0, -2.0, -3.0]),
            ray([1.0, 0.0, 0.0], [1.0, 2.0, 3.0 + 1e-7]),
            ray([f64::NAN, 0.0, 0.0], [0.0, 0.0, 1.0]),
            ray([f64::INFINITY, 0.0, 0.0], [0.0, 0.0, 1.0]),
        ] {
            assert_eq!(closest_approach(&a, &b), None, "{b:?}");
        }
    }

    proptest! {
        #[test]
        fn no_other_pair_of_points_is_closer(
            origins in prop::array::uniform2(prop::array::uniform3(-3.0..3.0)),
            directions in prop::array::uniform2(prop::array::uniform3(-1.0..1.0)),
            shift in prop::array::uniform2(-1.0..1.0),
        ) {
            prop_assume!(directions.iter().all(|it| Vector3::from(*it).norm() > 0.1));
            let (a, b) = (ray(origins[0], directions[0]), ray(origins[1], directions[1]));
            prop_assume!(a.direction.cross(&b.direction).norm() > 1e-3);
            let found = closest_approach(&a, &b).unwrap();
            let (on_a, on_b) = (a.at(found.depth_a + shift[0]), b.at(found.depth_b + shift[1]));
            prop_assert!((on_a - on_b).norm() >= found.gap - 1e-9);
            prop_assert!((a.distance_to(&found.midpoint) - found.gap / 2.0).abs() < 1e-9);
            prop_assert!((b.depth_of(&found.midpoint) - found.depth_b).abs() < 1e-7);
        }
    }
}
