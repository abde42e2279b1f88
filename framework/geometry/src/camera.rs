//! A calibrated camera: projects points to pixels, with derivatives, and pixels to rays.
//!
//! | here | meaning | unit |
//! |---|---|---|
//! | `point_in_camera` | right, down, forward | m |
//! | `normalised` | (x/z, y/z), the ideal image at depth 1 | – |
//! | `distorted` | `normalised` after the lens, see [`Distortion`] | – |
//! | pixel | `focal`, `skew` and `principal` applied to `distorted` | px |
//!
//! All pixels are raw (distorted); nothing here takes or returns undistorted ones.

use nalgebra::{Isometry3, Matrix2, Matrix2x3, Point2, Point3, Unit, Vector2, Vector3};

pub use crate::distortion::Distortion;
use crate::ray::Ray;

/// The linear part of a camera model: u = focal₀ x' + skew y' + principal₀, v = focal₁ y' + principal₁.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    /// Horizontal and vertical focal length [px].
    pub focal: [f64; 2],
    /// Principal point, where the optical axis meets the image; (0, 0) is the centre of the top-left pixel [px].
    pub principal: [f64; 2],
    /// Skew between columns and rows, 0 for real sensors [px].
    pub skew: f64,
}

/// A calibrated camera: optics and pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// Image size: columns, rows [px].
    pub image_size: [u32; 2],
    /// Focal lengths, principal point, skew.
    pub intrinsics: Intrinsics,
    /// Lens distortion.
    pub distortion: Distortion,
    /// Pose: maps points in the world to points in the camera (x right, y down, z forward) [m].
    pub camera_from_world: Isometry3<f64>,
}

/// Why a [`Camera`] cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CameraError {
    /// A number that is NaN or infinite.
    #[error("{field} is {found}, expected a finite number")]
    NotFinite {
        /// Name of the field.
        field: &'static str,
        /// Value that was found.
        found: f64,
    },
    /// A focal length of zero or less.
    #[error("{field} is {found} px, expected more than 0 px")]
    FocalNotPositive {
        /// Which of the two focal lengths.
        field: &'static str,
        /// Value that was found [px].
        found: f64,
    },
    /// An image without pixels.
    #[error("image_size is {} x {} px, expected at least 1 x 1 px", found[0], found[1])]
    EmptyImage {
        /// Columns, rows [px].
        found: [u32; 2],
    },
    /// A rotation whose quaternion does not have length 1.
    #[error("the quaternion of camera_from_world has length {found}, expected 1")]
    NotARotation {
        /// Length of the quaternion.
        found: f64,
    },
}

impl Camera {
    /// Projects a point to its pixel. `None` when the point is not in front of the camera, not finite, or so far off
    /// the axis that it is outside the domain of the distortion. The pixel may lie outside the image: see
    /// [`Self::sees`].
    #[inline]
    pub fn project(&self, point_in_world: &Point3<f64>) -> Option<Point2<f64>> {
        let in_camera = self.camera_from_world * point_in_world;
        let (normalised, _) = to_normalised(&in_camera.coords)?;
        Some(self.intrinsics.pixel(&self.distortion.distort(&normalised)?))
    }

    /// As [`Self::project`], with the derivative of the pixel with respect to the point in the world [px/m].
    #[inline]
    pub fn project_with_jacobian(&self, point_in_world: &Point3<f64>) -> Option<(Point2<f64>, Matrix2x3<f64>)> {
        let rotation = self.camera_from_world.rotation.to_rotation_matrix();
        let rows = rotation.matrix();
        let in_camera = rows * point_in_world.coords + self.camera_from_world.translation.vector;
        let (normalised, per_depth) = to_normalised(&in_camera)?;
        let (distorted, distorted_by_normalised) = self.distortion.distort_with_jacobian(&normalised)?;
        let normalised_by_point = Matrix2x3::from_rows(&[
            (rows.row(0) - rows.row(2) * normalised.x) * per_depth,
            (rows.row(1) - rows.row(2) * normalised.y) * per_depth,
        ]);
        let pixel_by_normalised = self.intrinsics.pixel_by_distorted() * distorted_by_normalised;
        Some((self.intrinsics.pixel(&distorted), pixel_by_normalised * normalised_by_point))
    }

    /// Normalised, undistorted image coordinates (x/z, y/z) of `pixel`. `None` when the lens model maps nothing there, or when `pixel` is not finite.
    pub fn normalise(&self, pixel: &Point2<f64>) -> Option<Vector2<f64>> {
        let Intrinsics { focal, principal, skew } = self.intrinsics;
        let y = (pixel.y - principal[1]) / focal[1];
        let x = (pixel.x - principal[0] - skew * y) / focal[0];
        self.distortion.undistort(&Vector2::new(x, y))
    }

    /// The line of sight of `pixel`, from the camera's centre into the world. `None` as for [`Self::normalise`].
    pub fn ray(&self, pixel: &Point2<f64>) -> Option<Ray> {
        let direction_in_camera = self.normalise(pixel)?.push(1.0);
        let direction = Unit::new_normalize(self.camera_from_world.rotation.inverse() * direction_in_camera);
        Some(Ray { origin: self.centre(), direction })
    }

    /// The centre of projection in the world [m].
    pub fn centre(&self) -> Point3<f64> {
        self.camera_from_world.inverse_transform_point(&Point3::origin())
    }

    /// Projects a point to its pixel if that lies on the image; see [`Self::has_pixel`].
    #[inline]
    pub fn sees(&self, point_in_world: &Point3<f64>) -> Option<Point2<f64>> {
        self.project(point_in_world).filter(|pixel| self.has_pixel(pixel))
    }

    /// Whether `pixel` lies on the image, whose edges are half a pixel outside the outermost pixel centres.
    #[inline]
    pub fn has_pixel(&self, pixel: &Point2<f64>) -> bool {
        let [width, height] = self.image_size.map(f64::from);
        (-0.5..width - 0.5).contains(&pixel.x) && (-0.5..height - 0.5).contains(&pixel.y)
    }

    /// Checks that the camera can be used; the first fault, in the order of the fields.
    pub fn check(&self) -> Result<(), CameraError> {
        let Intrinsics { focal, principal, skew } = self.intrinsics;
        let Distortion { k1, k2, p1, p2, k3 } = self.distortion;
        let place = self.camera_from_world.translation.vector;
        let turn = self.camera_from_world.rotation.as_vector();
        if self.image_size.contains(&0) {
            return Err(CameraError::EmptyImage { found: self.image_size });
        }
        let named = [
            ("focal[0]", focal[0]),
            ("focal[1]", focal[1]),
            ("principal[0]", principal[0]),
            ("principal[1]", principal[1]),
            ("skew", skew),
            ("distortion k1", k1),
            ("distortion k2", k2),
            ("distortion p1", p1),
            ("distortion p2", p2),
            ("distortion k3", k3),
            ("translation x of camera_from_world", place.x),
            ("translation y of camera_from_world", place.y),
            ("translation z of camera_from_world", place.z),
            ("rotation of camera_from_world", turn.sum()),
        ];
        if let Some(&(field, found)) = named.iter().find(|(_, found)| !found.is_finite()) {
            return Err(CameraError::NotFinite { field, found });
        }
        if let Some(&(field, found)) = named[..2].iter().find(|(_, found)| *found <= 0.0) {
            return Err(CameraError::FocalNotPositive { field, found });
        }
        let length = turn.norm();
        if (length - 1.0).abs() > 1e-6 {
            return Err(CameraError::NotARotation { found: length });
        }
        Ok(())
    }
}

impl Intrinsics {
    /// The pixel of a distorted normalised point.
    #[inline]
    fn pixel(&self, distorted: &Vector2<f64>) -> Point2<f64> {
        Point2::new(
            self.focal[0] * distorted.x + self.skew * distorted.y + self.principal[0],
            self.focal[1] * distorted.y + self.principal[1],
        )
    }

    /// Derivative of [`Self::pixel`] [px].
    #[inline]
    fn pixel_by_distorted(&self) -> Matrix2<f64> {
        Matrix2::new(self.focal[0], self.skew, 0.0, self.focal[1])
    }
}

/// (x/z, y/z) and 1/z; `None` unless z > 0. Overflow is left to the distortion, which refuses what is too far out.
#[inline]
fn to_normalised(in_camera: &Vector3<f64>) -> Option<(Vector2<f64>, f64)> {
    let per_depth = 1.0 / in_camera.z;
    (in_camera.z > 0.0).then(|| (Vector2::new(in_camera.x * per_depth, in_camera.y * per_depth), per_depth))
}

#[cfg(test)]
mod tests {
    use foveate_laws::{check_camera_model, check_jacobian};
    use nalgebra::{DMatrix, UnitQuaternion};
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_camera_with_a_lens_keeps_the_law() {
        let mut camera = Camera::look_at(Point3::new(-3.0, 0.5, 2.4), Point3::new(0.0, 0.2, 1.4), [640, 480], 700.0);
        camera.distortion = Distortion { k1: -0.12, k2: 0.03, p1: 0.001, p2: -0.002, k3: 0.0 };
        let ray = |pixel: &Point2<f64>| camera.ray(pixel).map(|it| (it.origin, it.direction.into_inner()));
        check_camera_model(camera.image_size, &camera.centre(), ray, |point| camera.project(point));
    }

    /// Any pose, any sensible lens, and strong ones whose polynomial turns back inside the drawn field of view.
    fn cameras() -> impl Strategy<Value = Camera> {
        let lens = prop_oneof![
            Just([0.0; 5]),
            [-0.4..0.4, -0.1..0.1, -0.01..0.01, -0.01..0.01, -0.05..0.05],
            [-1.5..1.5, -1.5..1.5, -0.05..0.05, -0.05..0.05, -1.0..1.0],
        ];
        let place = prop::array::uniform3(-3.0..3.0);
        let turn = prop::array::uniform3(-3.2..3.2);
        let inner = [200.0..2000.0, 200.0..2000.0, -500.0..500.0, -500.0..500.0, -20.0..20.0];
        (place, turn, inner, lens).prop_map(|(place, turn, inner, [k1, k2, p1, p2, k3])| Camera {
            image_size: [640, 480],
            intrinsics: Intrinsics { focal: [inner[0], inner[1]], principal: [inner[2], inner[3]], skew: inner[4] },
            distortion: Distortion { k1, k2, p1, p2, k3 },
            camera_from_world: Isometry3::new(Vector3::from(place), Vector3::from(turn)),
        })
    }

    /// A point in the world at normalised coordinates (x, y) and depth z of `camera`.
    fn point_at(camera: &Camera, x: f64, y: f64, z: f64) -> Point3<f64> {
        camera.camera_from_world.inverse_transform_point(&Point3::new(x * z, y * z, z))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        #[test]
        fn the_ray_of_a_pixel_goes_through_the_point(
            camera in cameras(), x in -1.2..1.2, y in -1.2..1.2, z in 0.1..20.0,
        ) {
            let point = point_at(&camera, x, y, z);
            let Some((pixel, jacobian)) = camera.project_with_jacobian(&point) else { return Ok(()) };
            prop_assert!((camera.project(&point).unwrap() - pixel).norm() < 1e-9 * (1.0 + pixel.coords.norm()));
            let ray = camera.ray(&pixel).unwrap();
            // Near the turning point a pixel hardly depends on the ray: ask for the pixel back there, not for the ray.
            let again = camera.project(&ray.at(z)).unwrap();
            prop_assert!((again - pixel).norm() < 1e-8, "{again} {pixel}");
            let per_metre = jacobian * jacobian.transpose();
            if per_metre.determinant() > 1e-4 * per_metre.norm_squared() {
                prop_assert!(ray.distance_to(&point) < 1e-7 * z, "{}", ray.distance_to(&point));
                prop_assert!(ray.depth_of(&point) > 0.0);
            }
        }

        #[test]
        fn jacobian_is_that_of_central_differences(
            camera in cameras(), x in -1.2..1.2, y in -1.2..1.2, z in 0.1..20.0,
        ) {
            let point = point_at(&camera, x, y, z);
            let Some((_, jacobian)) = camera.project_with_jacobian(&point) else { return Ok(()) };
            // Where a neighbour has no pixel there is no difference either.
            let nan = Point2::new(f64::NAN, f64::NAN);
            let project = |at: &[f64]| camera.project(&Point3::new(at[0], at[1], at[2])).unwrap_or(nan).coords.as_slice().to_vec();
            let beside = |axis: usize, by: f64| point + Vector3::ith(axis, by);
            if (0..3).all(|axis| [1e-4, -1e-4].iter().all(|by| camera.project(&beside(axis, *by)).is_some())) {
                let jacobian = DMatrix::from_fn(2, 3, |row, column| jacobian[(row, column)]);
                check_jacobian(project, &jacobian, point.coords.as_slice(), 1e-4);
            }
        }

        #[test]
        fn nothing_beyond_the_turning_point_has_a_pixel(camera in cameras(), angle in 0.0..6.3_f64, radius in 0.0..3.0_f64) {
            let point = |radius: f64| point_at(&camera, radius * angle.cos(), radius * angle.sin(), 1.0);
            let Distortion { k1, k2, k3, .. } = camera.distortion;
            let radial = |r: f64| r * (1.0 + r * r * (k1 + r * r * (k2 + r * r * k3)));
            let turns_back = (0..1000).any(|it| {
                let r = radius * f64::from(it) / 1000.0;
                radial(r + radius / 1000.0) < radial(r)
            });
            if turns_back {
                prop_assert_eq!(camera.project(&point(radius)), None);
            }
        }

        #[test]
        fn a_pixel_without_a_ray_is_no_point_s_pixel(camera in cameras(), u in -900.0..900.0, v in -900.0..900.0) {
            let pixel = Point2::new(u, v);
            if camera.ray(&pixel).is_none() {
                for index in 0..1600 {
                    let (x, y) = (f64::from(index % 40) / 8.0 - 2.5, f64::from(index / 40) / 8.0 - 2.5);
                    let Some((seen, jacobian)) = camera.project_with_jacobian(&point_at(&camera, x, y, 1.0)) else { continue };
                    // 1/16 is half the grid: were there such a point, one of the grid would come this close.
                    prop_assert!((seen - pixel).norm() > 1e-3 * jacobian.norm());
                }
            }
        }
    }

    fn plain() -> Camera {
        Camera::look_at(Point3::origin(), Point3::new(0.0, 1.0, 0.0), [640, 480], 500.0)
    }

    #[test]
    fn right_and_down_are_where_they_should_be() {
        let pixel = plain().project(&Point3::new(0.2, 2.0, -0.1)).unwrap();
        assert!((pixel - Point2::new(319.5 + 50.0, 239.5 + 25.0)).norm() < 1e-9, "{pixel}");
    }

    #[test]
    fn distortion_is_that_of_opencv() {
        let distortion = Distortion { k1: -0.3, k2: 0.1, p1: 0.01, p2: -0.02, k3: 0.05 };
        // By hand: s = 0.25, f = 1 - 0.075 + 0.00625 + 0.00078125 = 0.93203125.
        let distorted = distortion.distort(&Vector2::new(0.3, 0.4)).unwrap();
        let x = 0.3 * 0.93203125 + 2.0 * 0.01 * 0.12 - 0.02 * (0.25 + 0.18);
        let y = 0.4 * 0.93203125 + 0.01 * (0.25 + 0.32) - 2.0 * 0.02 * 0.12;
        assert!((distorted - Vector2::new(x, y)).norm() < 1e-15, "{distorted}");
    }

    #[test]
    fn what_is_not_in_front_has_no_pixel() {
        let camera = plain();
        let points = [
            [0.0, -1.0, 0.0],
            [0.3, 0.0, 0.2],
            [0.0, 0.0, 0.0],
            [f64::NAN, 1.0, 0.0],
            [0.0, f64::NAN, 0.0],
            [f64::INFINITY, 1.0, 0.0],
            [0.0, f64::INFINITY, 0.0],
            [1.0, f64::MIN_POSITIVE, 0.0],
        ];
        for point in points.map(Point3::from) {
            assert_eq!(camera.project(&point), None, "{point}");
            assert_eq!(camera.project_with_jacobian(&point), None, "{point}");
        }
    }

    #[test]
    fn a_lens_that_turns_back_ends_there() {
        let mut camera = plain();
        camera.distortion.k1 = -1.0 / 3.0; // r - r³/3 turns back at r = 1, where it is 2/3
        let at = |r: f64| camera.project(&Point3::new(r, 1.0, 0.0));
        assert!(at(0.999).is_some());
        assert_eq!([at(1.001), at(1.7), at(30.0)], [None; 3]);
        // A second rise beyond the turn does not count either.
        camera.distortion.k2 = 0.05;
        let at = |r: f64| camera.project(&Point3::new(r, 1.0, 0.0));
        assert!(at(1.1).is_some());
        assert_eq!([at(1.5), at(2.0), at(5.0)], [None; 3]);
        camera.distortion.k2 = 0.0;
        let pixel = |r: f64| Point2::new(319.5 + 500.0 * r, 239.5);
        assert!(camera.ray(&pixel(0.6666)).is_some());
        for r in [0.6668, 0.7, 2.0, f64::NAN, f64::INFINITY] {
            assert_eq!(camera.ray(&pixel(r)), None, "{r}");
        }
    }

    #[test]
    fn without_distortion_a_broken_pixel_has_no_ray() {
        assert_eq!(plain().ray(&Point2::new(f64::NAN, 1.0)), None);
        assert_eq!(plain().normalise(&Point2::new(1.0, f64::NEG_INFINITY)), None);
    }

    #[test]
    fn the_image_ends_half_a_pixel_outside_the_last_centres() {
        let camera = plain();
        let seen = |u: f64, v: f64| camera.sees(&camera.ray(&Point2::new(u, v)).unwrap().at(3.0)).is_some();
        assert!(seen(-0.49, 0.0) && seen(639.49, 479.49));
        assert!(!seen(-0.51, 0.0) && !seen(0.0, -0.51) && !seen(639.51, 0.0) && !seen(0.0, 479.51));
    }

    #[test]
    fn what_makes_a_camera_unusable_is_named() {
        let fault_of = |change: &dyn Fn(&mut Camera)| {
            let mut camera = plain();
            change(&mut camera);
            camera.check().unwrap_err().to_string()
        };
        plain().check().unwrap();
        assert_eq!(fault_of(&|it| it.image_size = [640, 0]), "image_size is 640 x 0 px, expected at least 1 x 1 px");
        assert_eq!(fault_of(&|it| it.intrinsics.focal[1] = 0.0), "focal[1] is 0 px, expected more than 0 px");
        assert_eq!(fault_of(&|it| it.intrinsics.focal[0] = f64::NAN), "focal[0] is NaN, expected a finite number");
        assert_eq!(fault_of(&|it| it.distortion.k3 = f64::INFINITY), "distortion k3 is inf, expected a finite number");
        assert_eq!(
            fault_of(&|it| it.camera_from_world.translation.y = f64::NAN),
            "translation y of camera_from_world is NaN, expected a finite number"
        );
        assert_eq!(
            fault_of(&|it| it.camera_from_world.rotation = UnitQuaternion::new_unchecked([0.0, 0.0, 0.0, 2.0].into())),
            "the quaternion of camera_from_world has length 2, expected 1"
        );
    }
}
