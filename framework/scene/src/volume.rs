//! The box in which a scale works.

use nalgebra::Point3;

/// An axis-aligned box in the coordinates of its scale's space; its faces belong to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WorkingVolume {
    /// The corner with the least coordinates [m].
    pub min: Point3<f64>,
    /// The corner with the largest coordinates [m].
    pub max: Point3<f64>,
}

impl WorkingVolume {
    /// The box between two corners; `None` unless `min` is less than `max` along each axis and all are finite.
    pub fn new(min: Point3<f64>, max: Point3<f64>) -> Option<WorkingVolume> {
        let finite = (max - min).iter().chain(min.iter()).all(|it| it.is_finite());
        (finite && min < max).then_some(WorkingVolume { min, max })
    }

    /// Whether `point` is inside or on a face; a NaN is not.
    pub fn contains(&self, point: &Point3<f64>) -> bool {
        (0..3).all(|axis| (self.min[axis]..=self.max[axis]).contains(&point[axis]))
    }

    /// The middle [m].
    pub fn centre(&self) -> Point3<f64> {
        nalgebra::center(&self.min, &self.max)
    }

    /// The eight corners [m]: x changes fastest, z slowest.
    pub fn corners(&self) -> [Point3<f64>; 8] {
        let ends = [self.min, self.max];
        std::array::from_fn(|index| Point3::new(ends[index & 1].x, ends[index >> 1 & 1].y, ends[index >> 2].z))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contains_its_corners_and_nothing_outside() {
        let volume = WorkingVolume::new(Point3::new(-1.75, -2.5, 0.5), Point3::new(1.75, 2.5, 2.0)).unwrap();
        assert!(volume.corners().iter().all(|corner| volume.contains(corner)));
        assert!(volume.contains(&volume.centre()));
        for axis in 0..3 {
            for value in [volume.min[axis] - 1e-9, volume.max[axis] + 1e-9, f64::NAN, f64::INFINITY] {
                let mut outside = volume.centre();
                outside[axis] = value;
                assert!(!volume.contains(&outside), "{outside}");
            }
        }
    }

    #[test]
    fn a_box_without_extent_is_refused() {
        let origin = Point3::origin();
        for max in [[1.0, 1.0, 0.0], [1.0, -1.0, 1.0], [f64::NAN, 1.0, 1.0], [f64::INFINITY, 1.0, 1.0]] {
            assert_eq!(WorkingVolume::new(origin, max.into()), None);
        }
    }
}
