//! A calibrated camera: point to pixel with its derivative, pixel to ray.
//!
//! | here | meaning | unit |
//! |---|---|---|
//! | `point_in_camera` | right, down, forward | m |
//! | `normalised` | (x/z, y/z), the ideal image at depth 1 | – |
//! | `distorted` | what the lens makes of it, see [`Distortion`] | – |
//! | pixel | `focal`, `skew` and `principal` applied to `distorted` | px |
//!
//! Raw, distorted pixels only: nothing here takes or gives undistorted ones.

use nalgebra::{Isometry3, Matrix2, Matrix2x3, Point2, Point3, Unit, Vector2, Vector3};

pub use crate::distortion::Distortion;
use crate::ray::Ray;

/// The linear part of a camera: u = focal₀ x' + skew y' + principal₀, v = focal₁ y' + principal₁.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    /// Horizontal and vertical focal length [px].
    pub focal: [f64; 2],
    /// Where the optical axis meets the image; (0, 0) is the centre of the top-left pixel [px].
    pub principal: [f64; 2],
    /// By how much a column leans, 0 for real sensors [px].
    pub skew: f64,
}

/// A camera with known optics and place.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// Columns, rows [px].
    pub image_size: [u32; 2],
    /// Focal lengths, principal point, skew.
    pub intrinsics: Intrinsics,
    /// The lens.
    pub distortion: Distortion,
    /// Takes points in the world to points in the camera (x right, y down, z forward) [m].
    pub camera_from_world: Isometry3<f64>,
}

/// Why a [`Camera`] cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CameraFault {
    /// A number that is NaN or infinite.
    #[error("{field} is {found}, expected a finite number")]
    NotFinite {
        /// Which field.
        field: &'static str,
        /// Its value.
        found: f64,
    },
    /// A focal length of zero or less.
    #[error("{field} is {found} px, expected more than 0 px")]
    FocalNotPositive {
        /// Which of the two.
        field: &'static str,
        /// Its value [px].
        found: f64,
    },
    /// An image without pixels.
    #[error("image_size is {} x {} px, expected at least 1 x 1 px", found[0], found[1])]
    EmptyImage {
        /// Columns, rows [px].
        found: [u32; 2],
    },
    /// A rotation whose quaternion has not length 1.
    #[error("the quaternion of camera_from_world has length {found}, expected 1")]
    NotARotation {
        /// Its length.
        found: f64,
    },
}

impl Camera {
    /// The pixel at which `point_in_world` is seen. `None` when the point is not in front of the camera, not finite, or
    /// so far off the axis that the distortion polynomial has turned back. May lie outside the image: see [`Self::sees`].
    #[inline]
    pub fn project(&self, point_in_world: &Point3<f64>) -> Option<Point2<f64>> {
        let in_camera = self.camera_from_world * point_in_world;
        let (normalised, _) = to_normalised(&in_camera.coords)?;
        Some(self.intrinsics.pixel(&self.distortion.distort(&normalised)?))
    }

    /// As [`Self::project`], with the derivative of the pixel by the point in the world [px/m].
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

    /// The ideal image (x/z, y/z) of what is seen at `pixel`. `None` when the lens model maps nothing there, or when
    /// `pixel` is not finite.
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

    /// The pixel at which `point_in_world` is seen, if that lies on the image: from half a pixel left of the first
    /// pixel's centre to half a pixel right of the last one's, and so for the rows.
    #[inline]
    pub fn sees(&self, point_in_world: &Point3<f64>) -> Option<Point2<f64>> {
        self.project(point_in_world).filter(|pixel| self.has_pixel(pixel))
    }

    /// Whether `pixel` lies on the image, whose edge is half a pixel outside the outermost centres.
    #[inline]
    pub fn has_pixel(&self, pixel: &Point2<f64>) -> bool {
        let [width, height] = self.image_size.map(f64::from);
        (-0.5..width - 0.5).contains(&pixel.x) && (-0.5..height - 0.5).contains(&pixel.y)
    }

    /// Finds what makes the camera unusable; the first such thing, in the order of the fields.
    pub fn check(&self) -> Result<(), CameraFault> {
        let Intrinsics { focal, principal, skew } = self.intrinsics;
        let Distortion { k1, k2, p1, p2, k3 } = self.distortion;
        let place = self.camera_from_world.translation.vector;
        let turn = self.camera_from_world.rotation.as_vector();
        if self.image_size.contains(&0) {
            return Err(CameraFault::EmptyImage { found: self.image_size });
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
            return Err(CameraFault::NotFinite { field, found });
        }
        if let Some(&(field, found)) = named[..2].iter().find(|(_, found)| *found <= 0.0) {
            return Err(CameraFault::FocalNotPositive { field, found });
        }
        let length = turn.norm();
        if (length - 1.0).abs() > 1e-6 {
            return Err(CameraFault::NotARotation { found: length });
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

/// (x/z, y/z) and 1/z; `None` unless z > 0. Overflow to infinity is left to the distortion, which refuses it.
#[inline]
fn to_normalised(in_camera: &Vector3<f64>) -> Option<(Vector2<f64>, f64)> {
    let per_depth = 1.0 / in_camera.z;
    (in_camera.z > 0.0).then(|| (Vector2::new(in_camera.x * per_depth, in_camera.y * per_depth), per_depth))
}
