//! A camera and a projector: the point of a surface that a camera pixel sees and a projector coordinate lights.
//!
//! The point lies on the camera's ray. How far along it follows from where the projector would have to light it from: the depth under which that is nearest to the coordinates
//! decoded, each weighed by its standard deviation, with the projector's distortion. One coordinate is enough; a second one tells whether they belong together.

use foveate::geometry::{Camera, Ray};
use foveate::prelude::ProjectorSample;
use nalgebra::{Matrix2x3, Matrix3, Point2, Point3, Vector2, Vector3};

/// A point on a camera's ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OnRay {
    /// The ray.
    pub ray: Ray,
    /// How far along it [m].
    pub depth: f64,
    /// Its standard deviation [m].
    pub sigma: f64,
    /// How far the projector coordinates of the point are from those decoded [projector px].
    pub misfit: f64,
}

impl OnRay {
    /// The point in the world [m].
    pub fn point(&self) -> Point3<f64> {
        self.ray.at(self.depth)
    }

    /// Of the point in the world, the camera's pixel being known to `pixel_sigma` radians to either side [m²].
    pub fn covariance(&self, angle_sigma: f64) -> Matrix3<f64> {
        let along = self.ray.direction.into_inner();
        let along = along * along.transpose();
        along * self.sigma.powi(2) + (Matrix3::identity() - along) * (self.depth * angle_sigma).powi(2)
    }
}

/// Steps of the search for a depth: each squares how far it is off.
const STEPS: usize = 6;

/// The point that `pixel` of the camera sees and `sample` says the projector lights; `None` where no coordinate is known, or none in front of both fits.
pub fn triangulate(
    camera: &Camera,
    projector: &Camera,
    pixel: &Point2<f64>,
    sample: &ProjectorSample,
) -> Option<OnRay> {
    triangulate_ray(|| camera.ray(pixel), projector, sample)
}

/// The same with a ray that is computed only where a coordinate is known.
#[inline]
pub fn triangulate_ray(
    ray: impl FnOnce() -> Option<Ray>,
    projector: &Camera,
    sample: &ProjectorSample,
) -> Option<OnRay> {
    let seen = sample.coordinate.map(f64::from);
    let weights = [0, 1].map(|it| {
        let sigma = f64::from(sample.sigma[it]);
        if seen[it].is_finite() && sigma > 0.0 { 1.0 / (sigma * sigma) } else { 0.0 }
    });
    if weights == [0.0; 2] {
        return None;
    }
    let ray = ray()?;
    let mut depth = start(projector, &ray, seen, weights)?;
    let along = ray.direction.into_inner();
    for step in 0..=STEPS {
        let (at, jacobian): (Point2<f64>, Matrix2x3<f64>) = projector.project_with_jacobian(&ray.at(depth))?;
        let slope: Vector2<f64> = jacobian * along;
        let off = [0, 1].map(|it| if weights[it] > 0.0 { at[it] - seen[it] } else { 0.0 });
        let information = weights[0] * slope.x * slope.x + weights[1] * slope.y * slope.y;
        let change = (weights[0] * slope.x * off[0] + weights[1] * slope.y * off[1]) / information;
        if change.is_nan() || change.abs() > depth {
            return None;
        }
        if change.abs() < 1e-9 * depth || step == STEPS {
            let sigma = information.sqrt().recip();
            return (depth > 0.0 && sigma.is_finite()).then_some(OnRay {
                ray,
                depth,
                sigma,
                misfit: off[0].hypot(off[1]),
            });
        }
        depth -= change;
    }
    None
}

/// The depth at which a projector without distortion would light the ray from there.
fn start(projector: &Camera, ray: &Ray, seen: [f64; 2], weights: [f64; 2]) -> Option<f64> {
    // A coordinate that is not known hardly changes what the other one is without distortion: the middle will do.
    let coordinate = |it: usize| if weights[it] > 0.0 { seen[it] } else { f64::from(projector.image_size[it]) / 2.0 };
    let ideal = projector.normalise(&Point2::new(coordinate(0), coordinate(1)))?;
    let origin = projector.camera_from_world * ray.origin;
    let along: Vector3<f64> = projector.camera_from_world * ray.direction.into_inner();
    // x = ideal.x z and y = ideal.y z at origin + depth · along.
    let (mut product, mut square) = (0.0, 0.0);
    for it in 0..2 {
        let slope = along[it] - ideal[it] * along.z;
        let offset = origin[it] - ideal[it] * origin.z;
        product -= weights[it] * slope * offset;
        square += weights[it] * slope * slope;
    }
    let depth = product / square;
    (depth.is_finite() && depth > 0.0).then_some(depth)
}

#[cfg(test)]
pub(crate) mod tests {
    use foveate::geometry::{Distortion, Intrinsics};
    use nalgebra::{Isometry3, Translation3, UnitQuaternion};

    use super::*;

    /// A camera at the origin that looks along +z, and a projector to its right and below, with distortion.
    pub(crate) fn rig() -> (Camera, Camera) {
        let camera = Camera {
            image_size: [640, 480],
            intrinsics: Intrinsics { focal: [900.0, 900.0], principal: [320.0, 238.0], skew: 0.0 },
            distortion: Distortion { k1: -0.1, k2: 0.02, ..Distortion::default() },
            camera_from_world: Isometry3::identity(),
        };
        let turn = UnitQuaternion::from_euler_angles(0.06, -0.12, 0.02);
        let projector = Camera {
            image_size: [1024, 768],
            intrinsics: Intrinsics { focal: [1500.0, 1500.0], principal: [510.0, 700.0], skew: 0.0 },
            distortion: Distortion { k1: 0.05, p1: 0.002, ..Distortion::default() },
            camera_from_world: Isometry3::from_parts(Translation3::new(-0.3, -0.15, 0.05), turn),
        };
        (camera, projector)
    }

    #[track_caller]
    fn check(known: [bool; 2], bound: f64) {
        let (camera, projector) = rig();
        for place in [[0.1, 0.05, 1.5], [-0.3, 0.2, 2.5], [0.2, -0.1, 0.9], [0.0, 0.0, 4.0]] {
            let place = Point3::from(place);
            let (pixel, lit) = (camera.project(&place).unwrap(), projector.project(&place).unwrap());
            let one = |it: usize| if known[it] { lit[it] as f32 } else { f32::NAN };
            let sample = ProjectorSample { coordinate: [one(0), one(1)], sigma: [0.1, 0.1] };
            let found = triangulate(&camera, &projector, &pixel, &sample).unwrap();
            assert!((found.point() - place).norm() < bound, "{} for {place}", found.point());
            // A coordinate that is off by a standard deviation moves the point by one.
            let moved = ProjectorSample { coordinate: [one(0) + 0.1, one(1)], ..sample };
            if known == [true, false] {
                let other = triangulate(&camera, &projector, &pixel, &moved).unwrap();
                let change = (other.depth - found.depth).abs();
                assert!((change / found.sigma - 1.0).abs() < 0.02, "{change} for {}", found.sigma);
            }
        }
    }

    #[test]
    fn points_come_back_from_columns_rows_or_both() {
        check([true, false], 1e-4);
        check([false, true], 1e-3);
        check([true, true], 1e-4);
    }

    #[test]
    fn coordinates_that_do_not_belong_together_are_told() {
        let (camera, projector) = rig();
        let place = Point3::new(0.1, 0.05, 1.5);
        let (pixel, lit) = (camera.project(&place).unwrap(), projector.project(&place).unwrap());
        // Along the epipolar line both agree on another depth; across it they cannot.
        let sample = ProjectorSample { coordinate: [lit.x as f32 - 6.0, lit.y as f32 + 12.0], sigma: [0.1, 0.1] };
        assert!(triangulate(&camera, &projector, &pixel, &sample).unwrap().misfit > 5.0);
        assert!(triangulate(&camera, &projector, &pixel, &ProjectorSample::NONE).is_none());
    }
}
