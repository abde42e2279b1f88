//! A camera from a 3×4 projection matrix: RQ decomposition.
//!
//! P ~ K [R t] with K upper triangular, its diagonal positive, and det R = +1. P is known up to a factor that may be
//! negative; since det K R > 0, the sign of the determinant of P's left half fixes it. The rows of K R are taken apart
//! from the last to the first by Gram–Schmidt, after R. Hartley and A. Zisserman, *Multiple View Geometry*, A4.1.1.

use nalgebra::{Isometry3, Matrix3, Matrix3x4, Rotation3, UnitQuaternion, Vector3};

use crate::camera::{Camera, Distortion, Intrinsics};

/// An extent smaller than this times the largest entry of P's left half is taken for zero.
const FLAT: f64 = 1e-9;

/// Why a 3×4 matrix is not that of a camera at a finite place.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ProjectionFault {
    /// A number that is NaN or infinite.
    #[error("row {row}, column {column} of the projection matrix is {found}, expected a finite number")]
    NotFinite {
        /// From 0.
        row: usize,
        /// From 0.
        column: usize,
        /// Its value.
        found: f64,
    },
    /// The left 3×3 half has no inverse: a camera at infinity, or none.
    #[error("the left 3x3 half of the projection matrix is singular ({ratio:.1e} of its size): no finite camera")]
    Singular {
        /// The extent that is too small (third row, then the two focal lengths times it), relative to the largest entry.
        ratio: f64,
    },
}

impl Camera {
    /// Takes the projection matrix `p`, pixel ~ `p` (x, y, z, 1), apart; `p` is known up to a factor of either sign.
    /// Its pixels are taken to have (0, 0) at the centre of the top-left pixel. No distortion.
    ///
    /// If points that were seen come out behind the camera, the world of `p` is left-handed (a mirror image):
    /// negate one axis of the world, that is one of the first three columns of `p`, and all points' along with it.
    pub fn from_projection_matrix(p: &Matrix3x4<f64>, image_size: [u32; 2]) -> Result<Camera, ProjectionFault> {
        for column in 0..4 {
            for row in 0..3 {
                let found = p[(row, column)];
                if !found.is_finite() {
                    return Err(ProjectionFault::NotFinite { row, column, found });
                }
            }
        }
        let left: Matrix3<f64> = p.fixed_view::<3, 3>(0, 0).into_owned();
        let size = left.amax();
        let solid = |extent: f64| {
            let ratio = if size > 0.0 { extent / size } else { 0.0 };
            if ratio > FLAT { Ok(extent) } else { Err(ProjectionFault::Singular { ratio }) }
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

    /// K [R t], which ignores the distortion: pixel ~ matrix (x, y, z, 1) where there is none.
    pub fn projection_matrix(&self) -> Matrix3x4<f64> {
        let Intrinsics { focal, principal, skew } = self.intrinsics;
        let k = Matrix3::new(focal[0], skew, principal[0], 0.0, focal[1], principal[1], 0.0, 0.0, 1.0);
        k * self.camera_from_world.to_homogeneous().fixed_view::<3, 4>(0, 0)
    }
}
