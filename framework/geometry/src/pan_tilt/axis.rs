//! An axis of rotation in space: a line, with four parameters.

use nalgebra::{Isometry3, Point3, Unit, UnitQuaternion, Vector3, Vector4};

/// A line about which something rotates, right-handed about its direction. The position of `point` on the line has no effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axis {
    /// Any point on the line [m].
    pub point: Point3<f64>,
    /// Unit direction of the line.
    pub direction: Unit<Vector3<f64>>,
}

impl Axis {
    /// The axis through the origin along `direction`; `None` when that is zero or not finite.
    pub fn through_origin(direction: Vector3<f64>) -> Option<Axis> {
        let direction = Unit::try_new(direction, 0.0).filter(|it| it.iter().all(|x| x.is_finite()))?;
        Some(Axis { point: Point3::origin(), direction })
    }

    /// The rotation by `angle` [rad] about the axis: T R T⁻¹ of [Davis 2002 (2)].
    #[inline]
    pub fn turn(&self, angle: f64) -> Isometry3<f64> {
        let rotation = UnitQuaternion::from_axis_angle(&self.direction, angle);
        Isometry3::from_parts((self.point.coords - rotation * self.point.coords).into(), rotation)
    }

    /// The same axis with its `point` at the foot of the perpendicular from `place`.
    pub fn footed_at(&self, place: &Point3<f64>) -> Axis {
        let along = (place - self.point).dot(&self.direction);
        Axis { point: self.point + self.direction.into_inner() * along, direction: self.direction }
    }

    /// Two directions across the axis that make a right-handed frame with it, for the steps of [`Self::moved`].
    pub fn across(&self) -> [Vector3<f64>; 2] {
        let mut least = Vector3::zeros();
        least[self.direction.iamin()] = 1.0;
        let first = self.direction.cross(&least).normalize();
        [first, self.direction.cross(&first)]
    }

    /// The axis after a step of four numbers: rotated about either direction of [`Self::across`] [rad], then its point shifted along them [m].
    pub fn moved(&self, step: &Vector4<f64>) -> Axis {
        let [first, second] = self.across();
        let turn = UnitQuaternion::from_scaled_axis(first * step[0] + second * step[1]);
        let direction = Unit::new_normalize(turn * self.direction.into_inner());
        Axis { point: self.point + first * step[2] + second * step[3], direction }
    }

    /// The step with which [`Self::moved`] reaches the line of `other`; `None` when that is at a right angle or beyond.
    pub fn step_to(&self, other: &Axis) -> Option<Vector4<f64>> {
        let cosine = self.direction.dot(&other.direction);
        if cosine.is_nan() || cosine <= 1e-9 {
            return None;
        }
        let [first, second] = self.across();
        let sine = self.direction.cross(&other.direction);
        let length = sine.norm();
        let turn = if length > 0.0 { sine * (length.atan2(cosine) / length) } else { sine };
        // Where the other line passes the plane across this axis.
        let along = (self.point - other.point).dot(&self.direction) / cosine;
        let shift = other.point + other.direction.into_inner() * along - self.point;
        Some(Vector4::new(turn.dot(&first), turn.dot(&second), shift.dot(&first), shift.dot(&second)))
    }

    /// The angle between two axes as lines, 0 to π/2 [rad].
    pub fn angle_to(&self, other: &Axis) -> f64 {
        self.direction.cross(&other.direction).norm().atan2(self.direction.dot(&other.direction).abs())
    }

    /// Distance of the line from `place` [m].
    pub fn distance_to(&self, place: &Point3<f64>) -> f64 {
        (place - self.point).cross(&self.direction).norm()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn axes() -> impl Strategy<Value = Axis> {
        (prop::array::uniform3(-1.0..1.0), prop::array::uniform3(-2.0..2.0)).prop_filter_map(
            "zero",
            |(along, point)| {
                let axis = Axis::through_origin(Vector3::from(along))?;
                Some(Axis { point: Point3::from(point), ..axis })
            },
        )
    }

    proptest! {
        #[test]
        fn a_turn_leaves_the_axis_where_it_is(axis in axes(), angle in -7.0..7.0_f64, along in -3.0..3.0) {
            let on_axis: Point3<f64> = axis.point + axis.direction.into_inner() * along;
            prop_assert!((axis.turn(angle) * on_axis - on_axis).norm() < 1e-12);
            let beside = on_axis + axis.across()[0];
            let expected = on_axis + axis.across()[0] * angle.cos() + axis.across()[1] * angle.sin();
            prop_assert!((axis.turn(angle) * beside - expected).norm() < 1e-12);
            prop_assert!((axis.distance_to(&beside) - 1.0).abs() < 1e-12);
        }

        #[test]
        fn the_step_between_two_axes_leads_from_one_to_the_other(
            axis in axes(), step in prop::array::uniform4(-0.9..0.9), slide in -5.0..5.0,
        ) {
            let step = Vector4::from(step);
            let moved = axis.moved(&step);
            let slid = Axis { point: moved.point + moved.direction.into_inner() * slide, ..moved };
            prop_assert!((axis.step_to(&slid).unwrap() - step).norm() < 1e-9);
            prop_assert!((axis.angle_to(&moved) - step.fixed_rows::<2>(0).norm()).abs() < 1e-7);
        }
    }

    #[test]
    fn the_foot_is_the_nearest_point() {
        let axis = Axis { point: Point3::new(5.0, 1.0, 2.0), direction: Vector3::x_axis() };
        assert_eq!(axis.footed_at(&Point3::origin()).point, Point3::new(0.0, 1.0, 2.0));
    }

    #[test]
    fn what_has_no_direction_or_no_step_is_refused() {
        assert_eq!(Axis::through_origin(Vector3::zeros()), None);
        assert_eq!(Axis::through_origin(Vector3::new(f64::NAN, 0.0, 1.0)), None);
        let [x, y] = [Vector3::x(), Vector3::y()].map(|it| Axis::through_origin(it).unwrap());
        assert_eq!(x.step_to(&y), None);
        assert_eq!(x.step_to(&Axis::through_origin(-Vector3::x()).unwrap()), None);
    }
}
