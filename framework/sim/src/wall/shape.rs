//! Walls that are not flat: where a point of what the wall shows is in space.
//!
//! Displays stand along an arc, and what they hang on sags: a cylinder, and on it swells that no cylinder has.

use foveate_geometry::Ray;
use nalgebra::{Isometry3, Matrix3, Point2, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How a wall is bent.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct CurveSettings {
    /// Radius of the arc along x; its ends are nearer to those who stand before it. Below 0: farther [m].
    pub radius_m: f64,
    /// How far swells stand out of it, and lie behind it [mm].
    #[schemars(range(min = 0.0, max = 500.0))]
    pub sag_mm: f64,
}

impl Default for CurveSettings {
    fn default() -> Self {
        Self { radius_m: 4.0, sag_mm: 5.0 }
    }
}

/// Where an upright wall stands in the room that its cameras stand in.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StandSettings {
    /// Its upper left corner, as seen by who looks at it [m].
    pub upper_left_m: [f64; 3],
    /// From the room's x to the wall's, which runs to the right of who looks at it, counterclockwise as seen from above [deg].
    #[serde(default)]
    pub turned_deg: f64,
}

impl StandSettings {
    /// From the wall's space, x to the right, y down, z into it, to the room's, whose z is up.
    pub(super) fn room_from_wall(&self) -> Isometry3<f64> {
        let upright = Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0);
        let upright = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(upright));
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.turned_deg.to_radians());
        Isometry3::from_parts(Translation3::from(Vector3::from(self.upper_left_m)), turn * upright)
    }
}

/// Steps to where a ray meets the wall; each has the square of the error of the one before it.
const STEPS: usize = 12;
/// That is near enough [m].
const NEAR: f64 = 1e-9;

/// The point of the wall in space [m].
pub(super) fn in_space(curve: Option<&CurveSettings>, size: [f64; 2], point: &Point2<f64>) -> Point3<f64> {
    let Some(CurveSettings { radius_m, sag_mm }) = curve else { return Point3::new(point.x, point.y, 0.0) };
    let angle = (point.x - size[0] / 2.0) / radius_m;
    let swell = (2.1 * point.x + 0.4).sin() * (1.7 * point.y - 0.3).cos() + 0.4 * (4.3 * point.y + 1.1 * point.x).sin();
    let out = radius_m * (1.0 - angle.cos()) + sag_mm * 1e-3 * swell / 1.4;
    // Out of the wall is along −z, and turned by the angle where the arc is; swells are low enough not to mind.
    Point3::new(size[0] / 2.0 + radius_m * angle.sin(), point.y, -out)
}

/// Where a ray meets the wall [m]; `None` where it does not.
pub(super) fn met(curve: Option<&CurveSettings>, size: [f64; 2], ray: &Ray) -> Option<Point2<f64>> {
    let mut distance = -ray.origin.z / ray.direction.z;
    if distance.is_nan() || distance <= 0.0 {
        return None;
    }
    let mut point = ray.at(distance).xy();
    if curve.is_none() {
        return Some(point);
    }
    for _ in 0..STEPS {
        let here = in_space(curve, size, &point);
        let off = here - ray.at(distance);
        if off.norm() < NEAR {
            return (distance > 0.0).then_some(point);
        }
        const STEP: f64 = 1e-5;
        let by = |x: f64, y: f64| (in_space(curve, size, &Point2::new(point.x + x, point.y + y)) - here) / STEP;
        let direction: Vector3<f64> = *ray.direction;
        let step = Matrix3::from_columns(&[by(STEP, 0.0), by(0.0, STEP), -direction]).try_inverse()? * off;
        point -= step.xy();
        distance -= step.z;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ray_to_a_point_of_a_bent_wall_meets_it_there() {
        let size = [4.0, 1.3];
        let curve = CurveSettings::default();
        let eye = Point3::new(1.4, 0.5, -2.4);
        for step in 0..40 {
            let point = Point2::new(0.1 * f64::from(step), 0.03 * f64::from(step));
            for curve in [None, Some(&curve)] {
                let there = in_space(curve, size, &point);
                let ray = Ray { origin: eye, direction: nalgebra::Unit::new_normalize(there - eye) };
                assert!((met(curve, size, &ray).unwrap() - point).norm() < 1e-7);
            }
        }
        // The ends come half a metre nearer: 4 m · (1 − cos(2 / 4)).
        assert!((in_space(Some(&curve), size, &Point2::new(0.0, 0.6)).z + 0.49).abs() < 0.02);
    }

    #[test]
    fn displays_are_as_long_along_the_arc_as_they_are() {
        let (size, curve) = ([4.0, 1.3], CurveSettings { sag_mm: 0.0, ..CurveSettings::default() });
        let at = |x: f64| in_space(Some(&curve), size, &Point2::new(x, 0.5));
        let length: f64 = (0..4000).map(|it| (at(f64::from(it + 1) * 1e-3) - at(f64::from(it) * 1e-3)).norm()).sum();
        assert!((length - 4.0).abs() < 1e-6, "{length}");
    }
}
