//! A camera from a 3×4 projection matrix: RQ decomposition.
//!
//! P ~ K [R t] with K upper triangular, its diagonal positive, and det R = +1. P is known up to a factor that may be
//! negative; since det K R > 0, the sign of the determinant of P's left half fixes it. The rows of K R are taken apart
//! from the last to the first by Gram–Schmidt, after R. Hartley and A. Zisserman, *Multiple View Geometry*, A4.1.1.

use nalgebra::{Isometry3, Matrix3, Matrix3x4, Rotation3, UnitQuaternion, Vector3};

use crate::camera::{Camera, Distortion, Intrinsics};

/// An extent smaller than this times the largest entry of P's left half is taken for zero.
const FLAT: f64 = 1e-9;

/// Why a 3×4 matrix is not that of a finite camera.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ProjectionError {
    /// A number that is NaN or infinite.
    #[error("row {row}, column {column} of the projection matrix is {found}, expected a finite number")]
    NotFinite {
        /// Row, from 0.
        row: usize,
        /// Column, from 0.
        column: usize,
        /// Value that was found.
        found: f64,
    },
    /// The left 3×3 half is singular: a camera at infinity, or none.
    #[error("the left 3x3 half of the projection matrix is singular ({ratio:.1e} of its size): no finite camera")]
    Singular {
        /// The extent that is too small (third row, then the two focal lengths times it), relative to the largest entry.
        ratio: f64,
    },
}

impl Camera {
    /// Decomposes the projection matrix `p`, pixel ~ `p` (x, y, z, 1), known up to a factor of either sign, into a
    /// camera without distortion. Its pixels have (0, 0) at the centre of the top-left pixel.
    ///
    /// If visible points come out behind the camera, the world of `p` is left-handed (a mirror image):
    /// negate one axis of the world, that is one of the first three columns of `p`, and all points' along with it.
    pub fn from_projection_matrix(p: &Matrix3x4<f64>, image_size: [u32; 2]) -> Result<Camera, ProjectionError> {
        for column in 0..4 {
            for row in 0..3 {
                let found = p[(row, column)];
                if !found.is_finite() {
                    return Err(ProjectionError::NotFinite { row, column, found });
                }
            }
        }
        let left: Matrix3<f64> = p.fixed_view::<3, 3>(0, 0).into_owned();
        let size = left.amax();
        let solid = |extent: f64| {
            let ratio = if size > 0.0 { extent / size } else { 0.0 };
            if ratio > FLAT { Ok(extent) } else { Err(ProjectionError::Singular { ratio }) }
        };
        let sign = if left.determinant() < 0.0 { -1.0 } else { 1.0 };
        let [m1, m2, m3]: [Vector3<f64>; 3] = [0, 1, 2].map(|row| left.row(row).transpose() * sign);
        // Focal lengths, skew and principal point stay multiplied by `axis`, the unknown factor, until the end.
        let axis = solid(m3.norm())?;
        let forward = m3 / axis;
        let v0 = m2.dot(&forward);
        let m2_across = m2 - forward * v0;
        let fv = solid(m2_across.norm())?;
        let down = m2_across / fv;
        let u0 = m1.dot(&forward);
        let skew = m1.dot(&down);
        let fu = solid((m1 - forward * u0 - down * skew).norm())?;
        let right = down.cross(&forward);
        let axes = Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()]);
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        let last = p.column(3) * sign;
        let z = last[2] / axis;
        let y = (last[1] - v0 * z) / fv;
        let x = (last[0] - u0 * z - skew * y) / fu;
        Ok(Camera {
            image_size,
            intrinsics: Intrinsics {
                focal: [fu / axis, fv / axis],
                principal: [u0 / axis, v0 / axis],
                skew: skew / axis,
            },
            distortion: Distortion::default(),
            camera_from_world: Isometry3::from_parts(Vector3::new(x, y, z).into(), rotation),
        })
    }

    /// The projection matrix K [R t], which ignores the distortion: pixel ~ matrix (x, y, z, 1).
    pub fn projection_matrix(&self) -> Matrix3x4<f64> {
        let Intrinsics { focal, principal, skew } = self.intrinsics;
        let k = Matrix3::new(focal[0], skew, principal[0], 0.0, focal[1], principal[1], 0.0, 0.0, 1.0);
        k * self.camera_from_world.to_homogeneous().fixed_view::<3, 4>(0, 0)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point2, Point3};
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_camera_comes_back_from_its_matrix(
            place in prop::array::uniform3(-3.0..3.0), turn in prop::array::uniform3(-3.2..3.2),
            focal in prop::array::uniform2(50.0..5000.0), principal in prop::array::uniform2(-1000.0..1000.0),
            skew in -50.0..50.0, size in -6.0..6.0, negative: bool,
        ) {
            let camera = Camera {
                image_size: [640, 480],
                intrinsics: Intrinsics { focal, principal, skew },
                distortion: Distortion::default(),
                camera_from_world: Isometry3::new(Vector3::from(place), Vector3::from(turn)),
            };
            let factor = if negative { -10f64.powf(size) } else { 10f64.powf(size) };
            let found = Camera::from_projection_matrix(&(camera.projection_matrix() * factor), [640, 480]).unwrap();
            found.check().unwrap();
            prop_assert!((found.intrinsics.skew - skew).abs() < 1e-7);
            for index in 0..2 {
                prop_assert!((found.intrinsics.focal[index] - focal[index]).abs() < 1e-7);
                prop_assert!((found.intrinsics.principal[index] - principal[index]).abs() < 1e-7);
            }
            prop_assert!(found.camera_from_world.rotation.angle_to(&camera.camera_from_world.rotation) < 1e-7);
            prop_assert!((found.centre() - camera.centre()).norm() < 1e-7);
            let ahead = camera.camera_from_world.inverse_transform_point(&Point3::new(0.1, 0.2, 1.0));
            let (before, after) = (camera.project(&ahead).unwrap(), found.project(&ahead).unwrap());
            prop_assert!((before - after).norm() < 1e-6);
        }
    }

    #[test]
    fn a_mirrored_world_shows_as_points_behind() {
        let camera = Camera::look_at(Point3::new(0.0, -2.0, 0.0), Point3::origin(), [640, 480], 500.0);
        let mut matrix = camera.projection_matrix();
        matrix.column_mut(2).neg_mut();
        let mirrored = Camera::from_projection_matrix(&matrix, [640, 480]).unwrap();
        assert_eq!(mirrored.project(&Point3::origin()), None);
        let homogeneous = matrix * Point3::new(0.1, 0.2, -0.3).to_homogeneous();
        let seen = Point2::from_homogeneous(homogeneous).unwrap();
        assert!((camera.project(&Point3::new(0.1, 0.2, 0.3)).unwrap() - seen).norm() < 1e-9);
    }

    #[test]
    fn what_is_no_finite_camera_is_refused() {
        let good = Camera::look_at(Point3::new(1.0, 2.0, 3.0), Point3::origin(), [640, 480], 500.0).projection_matrix();
        let refusal = |matrix: &Matrix3x4<f64>| Camera::from_projection_matrix(matrix, [640, 480]).unwrap_err();
        let mut broken = good;
        broken[(1, 3)] = f64::NAN;
        assert!(matches!(refusal(&broken), ProjectionError::NotFinite { row: 1, column: 3, found } if found.is_nan()));
        for row in 0..3 {
            let mut flat = good;
            let other: nalgebra::RowVector4<f64> = good.row((row + 1) % 3).into_owned();
            flat.row_mut(row).copy_from(&other);
            assert!(matches!(refusal(&flat), ProjectionError::Singular { .. }), "{row}");
            flat.row_mut(row).fill(0.0);
            assert!(matches!(refusal(&flat), ProjectionError::Singular { .. }), "{row}");
        }
        let affine = Matrix3x4::new(1.0, 0.0, 0.0, 5.0, 0.0, 1.0, 0.0, 5.0, 0.0, 0.0, 0.0, 1.0);
        assert_eq!(refusal(&affine), ProjectionError::Singular { ratio: 0.0 });
        assert_eq!(refusal(&Matrix3x4::zeros()), ProjectionError::Singular { ratio: 0.0 });
    }
}
