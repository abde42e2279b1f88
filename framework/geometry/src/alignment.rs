//! The similarity or rigid transform that best maps one set of points onto another, in closed form, and the distance
//! between two sets of cameras after it.
//!
//! Source: S. Umeyama, "Least-squares estimation of transformation parameters between two point patterns", TPAMI 13(4), 1991.
//! Equation numbers are the paper's.
//!
//! | here | paper | meaning | unit |
//! |---|---|---|---|
//! | `points_in_a[i]` | xᵢ | point i, in space a | m |
//! | `points_in_b[i]` | yᵢ | the same point, in space b | m |
//! | `cross_covariance` | Σxy | (1/n) Σ (yᵢ − μy)(xᵢ − μx)ᵀ | m² |
//! | `b_from_a` | cR, t | yᵢ ≈ c R xᵢ + t | –, m |
//!
//! The robust option first fits the closer half of the pairs repeatedly (least trimmed squares), then weights each
//! pair by 1/(1 + (d/2.385 s)²), d its distance and s 1.4826 times the median distance (Cauchy's loss): up to a third
//! of wrong pairs does little harm.

use foveate_estimation::statistics::{SIGMA_PER_MAD, median};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Similarity3, UnitQuaternion, Vector3};

use crate::camera::Camera;

/// The transform that [`align`] found, with its residuals.
#[derive(Debug, Clone, PartialEq)]
pub struct Alignment {
    /// Maps points in a to points in b.
    pub b_from_a: Similarity3<f64>,
    /// By pair: distance in b after the transform [m].
    pub distances: Vec<f64>,
    /// Weighted root mean square of the distances [m].
    pub rms: f64,
}

/// Options of [`align`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct AlignmentOptions {
    /// Whether to estimate a scale: lengths in a may be in another unit than in b.
    pub scale: bool,
    /// Whether to be robust to wrong pairs.
    pub robust: bool,
}

/// Why there is no transform.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum AlignmentError {
    /// Lists of different lengths.
    #[error("{in_a} points in a and {in_b} in b, expected as many of each")]
    LengthsDiffer {
        /// Points in a.
        in_a: usize,
        /// Points in b.
        in_b: usize,
    },
    /// A point with a number that is NaN or infinite.
    #[error("pair {index} is not finite")]
    NotFinite {
        /// Index of the pair.
        index: usize,
    },
    /// Points in one place or on a line do not fix a rotation.
    #[error(
        "{count} points with spread ratio {spread_ratio:.1e} do not fix a rotation: they lie on a line or in one place"
    )]
    Degenerate {
        /// Number of pairs.
        count: usize,
        /// Second over first singular value of the cross-covariance.
        spread_ratio: f64,
    },
}

/// Cross-covariances whose second singular value is less than this part of the first are those of points on a line.
const COLLINEAR: f64 = 1e-9;
const TRIMMED_ROUNDS: usize = 20;
const WEIGHTED_ROUNDS: usize = 10;

/// The least-squares transform from a to b.
///
/// # Errors
/// See [`AlignmentError`].
pub fn align(
    points_in_a: &[Point3<f64>],
    points_in_b: &[Point3<f64>],
    options: AlignmentOptions,
) -> Result<Alignment, AlignmentError> {
    if points_in_a.len() != points_in_b.len() {
        return Err(AlignmentError::LengthsDiffer { in_a: points_in_a.len(), in_b: points_in_b.len() });
    }
    let finite = |it: &Point3<f64>| it.coords.norm_squared().is_finite();
    if let Some(index) = points_in_a.iter().zip(points_in_b).position(|(a, b)| !finite(a) || !finite(b)) {
        return Err(AlignmentError::NotFinite { index });
    }
    let mut weights = vec![1.0; points_in_a.len()];
    let mut b_from_a = weighted(points_in_a, points_in_b, &weights, options.scale)?;
    let distances_after = |b_from_a: &Similarity3<f64>| -> Vec<f64> {
        points_in_a.iter().zip(points_in_b).map(|(a, b)| (b_from_a * a - b).norm()).collect()
    };
    let mut distances = distances_after(&b_from_a);
    for round in 0..if options.robust { TRIMMED_ROUNDS + WEIGHTED_ROUNDS } else { 0 } {
        let middle = median(&distances).unwrap_or(0.0);
        let scale = 2.385 * SIGMA_PER_MAD * middle;
        if scale <= 0.0 {
            break;
        }
        let weight = |it: &f64| match round < TRIMMED_ROUNDS {
            true => f64::from(u8::from(*it <= middle)),
            false => 1.0 / (1.0 + (it / scale).powi(2)),
        };
        weights = distances.iter().map(weight).collect();
        b_from_a = weighted(points_in_a, points_in_b, &weights, options.scale)?;
        distances = distances_after(&b_from_a);
    }
    let squares: f64 = distances.iter().zip(&weights).map(|(it, weight)| weight * it * it).sum();
    Ok(Alignment { b_from_a, rms: (squares / weights.iter().sum::<f64>()).sqrt(), distances })
}

pub(crate) fn weighted(
    points_in_a: &[Point3<f64>],
    points_in_b: &[Point3<f64>],
    weights: &[f64],
    scale: bool,
) -> Result<Similarity3<f64>, AlignmentError> {
    let total: f64 = weights.iter().sum();
    let centroid = |points: &[Point3<f64>]| {
        points.iter().zip(weights).fold(Vector3::zeros(), |sum, (it, weight)| sum + it.coords * (weight / total))
    };
    let (centroid_a, centroid_b) = (centroid(points_in_a), centroid(points_in_b)); // (34), (35)
    let (mut cross_covariance, mut variance_a) = (Matrix3::zeros(), 0.0); // (38), (36)
    for ((a, b), weight) in points_in_a.iter().zip(points_in_b).zip(weights) {
        let (a, b) = (a.coords - centroid_a, b.coords - centroid_b);
        cross_covariance += b * a.transpose() * (weight / total);
        variance_a += a.norm_squared() * (weight / total);
    }
    let svd = cross_covariance.svd(true, true);
    let spread_ratio = svd.singular_values[1] / svd.singular_values[0];
    let fault = AlignmentError::Degenerate { count: points_in_a.len(), spread_ratio };
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Err(fault) };
    if spread_ratio.is_nan() || spread_ratio < COLLINEAR {
        return Err(fault);
    }
    let s = Vector3::new(1.0, 1.0, (u.determinant() * v_t.determinant()).signum()); // (39), (43)
    let rotation = Rotation3::from_matrix_unchecked(u * Matrix3::from_diagonal(&s) * v_t); // (40)
    let factor = if scale { svd.singular_values.dot(&s) / variance_a } else { 1.0 }; // (42)
    if !(factor.is_finite() && factor > 0.0) {
        return Err(fault);
    }
    let translation = centroid_b - rotation * centroid_a * factor; // (41)
    let rotation = UnitQuaternion::from_rotation_matrix(&rotation);
    Ok(Similarity3::from_isometry(Isometry3::from_parts(translation.into(), rotation), factor))
}

/// Errors of cameras against the truth.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraErrors {
    /// The similarity, or rigid transform, from the found world to the true one.
    pub true_from_found: Similarity3<f64>,
    /// By camera: distance between found and true centre [m].
    pub centres: Vec<f64>,
    /// By camera: angle between found and true rotation [rad].
    pub rotations: Vec<f64>,
}

/// Compares the poses of `found` cameras with the `truth`, after the best transform of their centres.
///
/// # Errors
/// See [`AlignmentError`]; cameras in a row do not fix a rotation.
pub fn camera_errors(
    found: &[Camera],
    truth: &[Camera],
    options: AlignmentOptions,
) -> Result<CameraErrors, AlignmentError> {
    let centres = |cameras: &[Camera]| -> Vec<Point3<f64>> { cameras.iter().map(Camera::centre).collect() };
    let alignment = align(&centres(found), &centres(truth), options)?;
    let true_from_found = alignment.b_from_a;
    let rotation = |(found, truth): (&Camera, &Camera)| {
        let aligned = found.camera_from_world.rotation * true_from_found.isometry.rotation.inverse();
        aligned.angle_to(&truth.camera_from_world.rotation)
    };
    let rotations = found.iter().zip(truth).map(rotation).collect();
    Ok(CameraErrors { true_from_found, centres: alignment.distances, rotations })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn points() -> impl Strategy<Value = Vec<Point3<f64>>> {
        let spread = prop::array::uniform3(-5.0..5.0);
        // Flat sets tell a rotation from a reflection only by the sign in (39).
        (prop::collection::vec(spread, 4..20), any::<bool>()).prop_map(|(list, flat)| {
            list.into_iter().map(|[x, y, z]| Point3::new(x, y, if flat { 0.0 } else { z })).collect()
        })
    }

    fn spread(points: &[Point3<f64>]) -> f64 {
        let first = points[0];
        let along =
            points.iter().map(|it| it - first).max_by(|a, b| a.norm().total_cmp(&b.norm())).unwrap().normalize();
        points.iter().map(|it| (it - first).cross(&along).norm()).fold(0.0, f64::max)
    }

    proptest! {
        #[test]
        fn a_similarity_is_found_again(
            points in points(), turn in prop::array::uniform3(-2.0..2.0), shift in prop::array::uniform3(-9.0..9.0), scale in 0.1..10.0,
        ) {
            prop_assume!(spread(&points) > 0.5);
            let truth = Similarity3::new(Vector3::from(shift), Vector3::from(turn), scale);
            let moved: Vec<Point3<f64>> = points.iter().map(|it| truth * it).collect();
            let found = align(&points, &moved, AlignmentOptions { scale: true, robust: false }).unwrap();
            prop_assert!((found.b_from_a.to_homogeneous() - truth.to_homogeneous()).norm() < 1e-9 * scale.max(1.0));
            prop_assert!(found.rms < 1e-9);
        }
    }

    #[test]
    fn a_mirrored_world_is_not_explained_by_a_rotation() {
        let points = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 2.0, 3.0]].map(Point3::from);
        let mirrored = points.map(|it| Point3::new(-it.x, it.y, it.z));
        let found = align(&points, &mirrored, AlignmentOptions { scale: true, robust: false }).unwrap();
        assert!(found.rms > 0.2, "{}", found.rms);
        let (determinant, scaling) =
            (found.b_from_a.isometry.rotation.to_rotation_matrix().matrix().determinant(), found.b_from_a.scaling());
        assert!((determinant - 1.0).abs() < 1e-9 && scaling > 0.0);
    }

    #[test]
    fn a_third_of_wrong_pairs_does_little_harm() {
        let points: Vec<Point3<f64>> =
            (0..30).map(|it| Point3::new(f64::from(it % 5), f64::from(it / 5 % 3), f64::from(it % 7))).collect();
        let truth = Similarity3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.1, 0.7, -0.4), 2.0);
        let mut moved: Vec<Point3<f64>> = points.iter().map(|it| truth * it).collect();
        moved.iter_mut().step_by(3).for_each(|it| *it += Vector3::new(3.0, -2.0, 8.0));
        let error = |robust: bool| {
            let found = align(&points, &moved, AlignmentOptions { scale: true, robust }).unwrap();
            (found.b_from_a * points[1] - truth * points[1]).norm()
        };
        assert!(error(false) > 1.0 && error(true) < 1e-2, "{} {}", error(false), error(true));
    }

    #[test]
    fn cameras_in_another_world_are_where_they_should_be() {
        let truth: Vec<Camera> = (0..5)
            .map(|it| {
                Camera::look_at(
                    Point3::new(f64::from(it), f64::from(it * it), 2.0),
                    Point3::origin(),
                    [640, 480],
                    500.0,
                )
            })
            .collect();
        let other = Isometry3::new(Vector3::new(4.0, 5.0, 6.0), Vector3::new(0.3, 0.2, 2.0));
        let found: Vec<Camera> = truth
            .iter()
            .map(|it| {
                let mut camera_from_world = it.camera_from_world * other;
                camera_from_world.translation.vector *= 0.25;
                Camera { camera_from_world, ..it.clone() }
            })
            .collect();
        let errors = camera_errors(&found, &truth, AlignmentOptions { scale: true, robust: false }).unwrap();
        assert!((errors.true_from_found.scaling() - 4.0).abs() < 1e-9);
        assert!(errors.centres.iter().chain(&errors.rotations).all(|it| *it < 1e-6), "{errors:?}");
    }

    #[test]
    fn what_fixes_no_rotation_is_refused() {
        let options = AlignmentOptions::default();
        let line: Vec<Point3<f64>> = (0..9).map(|it| Point3::new(f64::from(it), 2.0, f64::from(it))).collect();
        for points in [&line[..], &[line[0]; 5], &line[..1], &[]] {
            assert!(matches!(align(points, points, options), Err(AlignmentError::Degenerate { .. })), "{points:?}");
        }
        assert_eq!(align(&line, &line[1..], options).unwrap_err(), AlignmentError::LengthsDiffer { in_a: 9, in_b: 8 });
        let mut broken = line.clone();
        broken[3].y = f64::NAN;
        assert_eq!(align(&line, &broken, options).unwrap_err(), AlignmentError::NotFinite { index: 3 });
    }
}
