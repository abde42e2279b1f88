//! The perspective-three-point problem (P3P): the poses, at most four, from which three points are seen in three given directions.
//!
//! Source: J. A. Grunert, 1841, as given in R. M. Haralick, C.-N. Lee, K. Ottenberg, M. Nölle, "Review and analysis of
//! solutions of the three point perspective pose estimation problem", IJCV 13(3), 1994. Equation numbers are that paper's.
//!
//! | here | paper | meaning |
//! |---|---|---|
//! | `directions[i]` | jᵢ | unit direction of point i in the camera |
//! | `a2`, `b2`, `c2` | a², b², c² | squared distance of points 2–3, 1–3, 1–2 [m²] |
//! | `depths[i]` | sᵢ | distance of point i from the camera, s₃ = v s₁ [m] |

use nalgebra::{Isometry3, Matrix3, Matrix4, Point3, Rotation3, Schur, Unit, UnitQuaternion, Vector3};

/// A triangle whose height over its longest side is less than this part of that side is a line.
const FLAT: f64 = 1e-6;

/// Sides whose squares differ by more than this part of the longest are not the same.
const MISFIT: f64 = 1e-6;

/// Steps that polish the depths of one root.
const POLISHINGS: usize = 8;

/// A pair of complex roots whose imaginary part is less than this part of the real one may be one double root in noise.
const NEARLY_REAL: f64 = 0.02;

/// All `camera_from_world` with `points_in_world` on the rays of `directions`, in front of the camera; empty when the
/// points lie on a line, or when numerics fail.
pub fn poses(points_in_world: &[Point3<f64>; 3], directions: &[Unit<Vector3<f64>>; 3]) -> Vec<Isometry3<f64>> {
    let [p1, p2, p3] = points_in_world;
    let [j1, j2, j3] = directions;
    let (a2, b2, c2) = ((p2 - p3).norm_squared(), (p1 - p3).norm_squared(), (p1 - p2).norm_squared());
    let Some(axes_in_world) = axes(points_in_world) else { return Vec::new() };
    let (cos_a, cos_b, cos_c) = (j2.dot(j3), j1.dot(j3), j1.dot(j2));
    let (q, p) = ((a2 - c2) / b2, (a2 + c2) / b2);
    // (9)
    let quartic = [
        (1.0 + q).powi(2) - 4.0 * a2 / b2 * cos_c * cos_c,
        4.0 * (-q * (1.0 + q) * cos_b + 2.0 * a2 / b2 * cos_c * cos_c * cos_b - (1.0 - p) * cos_a * cos_c),
        2.0 * (q * q - 1.0 + 2.0 * q * q * cos_b * cos_b + 2.0 * (b2 - c2) / b2 * cos_a * cos_a
            - 4.0 * p * cos_a * cos_b * cos_c
            + 2.0 * (b2 - a2) / b2 * cos_c * cos_c),
        4.0 * (q * (1.0 - q) * cos_b - (1.0 - p) * cos_a * cos_c + 2.0 * c2 / b2 * cos_a * cos_a * cos_b),
        (q - 1.0).powi(2) - 4.0 * c2 / b2 * cos_a * cos_a,
    ];
    let mut found = Vec::with_capacity(4);
    for v in positive_roots(&quartic) {
        let s1 = (b2 / (1.0 + v * v - 2.0 * v * cos_b)).sqrt(); // (5)
        // (8) divides by cos γ − v cos α, which may vanish; the triangles 1–2 and 2–3 give the same without.
        let half = (c2 - s1 * s1 * (1.0 - cos_c * cos_c)).max(0.0).sqrt();
        let misfit = |s2: &f64| (s2 * s2 + v * v * s1 * s1 - 2.0 * s2 * v * s1 * cos_a - a2).abs();
        let [near, far] = [s1 * cos_c - half, s1 * cos_c + half];
        let depths = [s1, if misfit(&near) < misfit(&far) { near } else { far }, v * s1];
        let Some(depths) = polished_depths(depths, [a2, b2, c2], [cos_a, cos_b, cos_c]) else { continue };
        let in_camera = [0, 1, 2].map(|it| Point3::from(directions[it].into_inner() * depths[it]));
        let Some(axes_in_camera) = axes(&in_camera) else { continue };
        let rotation = Rotation3::from_matrix_unchecked(axes_in_camera * axes_in_world.transpose());
        let rotation = UnitQuaternion::from_rotation_matrix(&rotation);
        let translation = in_camera[0] - rotation * p1;
        found.push(Isometry3::from_parts(translation.into(), rotation));
    }
    found
}

/// Depths that fit all three sides: Gauss-Newton refinement of approximate depths (equations 1 to 3). `None` without
/// positive depths nearby: a root with a small imaginary part may represent no triangle at all.
fn polished_depths(start: [f64; 3], sides: [f64; 3], cosines: [f64; 3]) -> Option<[f64; 3]> {
    const OPPOSITE: [(usize, usize); 3] = [(1, 2), (0, 2), (0, 1)];
    let longest = sides.iter().fold(0.0_f64, |longest, it| longest.max(*it));
    let misfits = |s: &Vector3<f64>| {
        Vector3::from_fn(|side, _| {
            let (i, j) = OPPOSITE[side];
            s[i] * s[i] + s[j] * s[j] - 2.0 * s[i] * s[j] * cosines[side] - sides[side]
        })
    };
    let mut depths = Vector3::from(start);
    let mut misfit = misfits(&depths);
    for _ in 0..POLISHINGS {
        let mut slopes = Matrix3::zeros();
        for (side, (i, j)) in OPPOSITE.into_iter().enumerate() {
            slopes[(side, i)] = 2.0 * (depths[i] - depths[j] * cosines[side]);
            slopes[(side, j)] = 2.0 * (depths[j] - depths[i] * cosines[side]);
        }
        // Where two solutions run into one, the slopes have no inverse; the pseudo-inverse takes the step that still helps.
        let Ok(inverse) = slopes.pseudo_inverse(1e-9 * longest.sqrt()) else { break };
        let next = depths - inverse * misfit;
        let left = misfits(&next);
        if !left.norm().is_finite() || left.norm() >= misfit.norm() {
            break;
        }
        (depths, misfit) = (next, left);
    }
    let fits = misfit.norm() < MISFIT * longest && depths.iter().all(|it| it.is_finite() && *it > 0.0);
    fits.then(|| depths.into())
}

/// Right-handed orthonormal axes that are tied to a triangle: along its first side, in its plane, normal to it.
fn axes(triangle: &[Point3<f64>; 3]) -> Option<Matrix3<f64>> {
    let (along, other) = (triangle[1] - triangle[0], triangle[2] - triangle[0]);
    let normal = along.cross(&other);
    let longest = along.norm_squared().max(other.norm_squared()).max((other - along).norm_squared());
    if !normal.norm().is_finite() || normal.norm() <= FLAT * longest {
        return None;
    }
    let (x, z) = (along.normalize(), normal.normalize());
    Some(Matrix3::from_columns(&[x, z.cross(&x), z]))
}

/// The real positive roots of Σ cᵢ xⁱ, by the eigenvalues of the companion matrix, polished; double ones may come out twice.
fn positive_roots(c: &[f64; 5]) -> Vec<f64> {
    let largest = c.iter().fold(0.0_f64, |largest, it| largest.max(it.abs()));
    if !largest.is_finite() || c[4].abs() <= 1e-12 * largest {
        return Vec::new();
    }
    let mut companion = Matrix4::zeros();
    for row in 0..4 {
        companion[(row, 3)] = -c[row] / c[4];
        if row > 0 {
            companion[(row, row - 1)] = 1.0;
        }
    }
    let Some(schur) = Schur::try_new(companion, 1e-14, 200) else { return Vec::new() };
    let mut roots = Vec::with_capacity(4);
    for root in schur.complex_eigenvalues().iter() {
        // Rounding makes a double root a pair of complex ones close to the real axis, the farther the worse the quartic is conditioned.
        if root.re > 0.0 && root.im.abs() < NEARLY_REAL * root.re {
            roots.push(polished(c, root.re));
        }
    }
    roots
}

/// Two steps of Newton's method.
fn polished(c: &[f64; 5], start: f64) -> f64 {
    let mut x = start;
    for _ in 0..2 {
        let (mut value, mut slope) = (0.0, 0.0);
        for coefficient in c.iter().rev() {
            slope = slope * x + value;
            value = value * x + coefficient;
        }
        let step = value / slope;
        if step.is_finite() && step.abs() < 0.1 * x.abs() {
            x -= step;
        }
    }
    x
}

#[cfg(test)]
mod tests {
    use foveate_estimation::Random;

    use super::*;

    #[test]
    fn depths_that_are_a_percent_off_are_polished_to_the_last_digits() {
        let corners = [Point3::new(0.3, -0.2, 2.0), Point3::new(-0.5, 0.4, 2.6), Point3::new(0.6, 0.5, 3.1)];
        let along = |it: usize| corners[it].coords.normalize();
        let sides = [(1, 2), (0, 2), (0, 1)];
        let squares = sides.map(|(i, j)| (corners[i] - corners[j]).norm_squared());
        let cosines = sides.map(|(i, j)| along(i).dot(&along(j)));
        let depths = corners.map(|it| it.coords.norm());
        let start = [depths[0] * 1.01, depths[1] * 0.99, depths[2] * 1.005];
        let found = polished_depths(start, squares, cosines).unwrap();
        assert!(
            found.iter().zip(depths).all(|(found, depth)| (found - depth).abs() < 1e-12),
            "{found:?} for {depths:?}"
        );
    }

    #[test]
    fn all_poses_found_fit_and_the_true_one_is_among_them() {
        const TRIANGLES: usize = 20_000;
        let mut random = Random::new(1);
        let mut missed = 0;
        for _ in 0..TRIANGLES {
            let mut vector = |scale: f64| Vector3::from_fn(|_, _| random.uniform_in(-scale, scale));
            let (points, turn) = ([0, 1, 2].map(|_| Point3::from(vector(1.0))), vector(3.0));
            let depth = random.uniform_in(2.5, 20.0);
            let truth = Isometry3::new(Vector3::new(0.3, -0.2, depth), turn);
            let directions = points.map(|it| Unit::new_normalize((truth * it).coords));
            let found = poses(&points, &directions);
            for pose in &found {
                for (point, direction) in points.iter().zip(&directions) {
                    let seen = (pose * point).coords.normalize();
                    assert!((seen - direction.into_inner()).norm() < 1e-5, "{points:?}: {seen} {direction:?}");
                }
            }
            let error = |it: &Isometry3<f64>| (it.inverse() * truth).translation.vector.norm();
            missed += usize::from(found.iter().map(error).fold(f64::INFINITY, f64::min) > 1e-3 * depth);
        }
        // Where solutions run into one (the danger cylinder), they are known to the root of the rounding only, or to its third root.
        assert!(missed < TRIANGLES / 1000, "{missed}");
    }

    #[test]
    fn three_points_on_a_line_fix_no_pose() {
        let points = [0.0, 1.0, 2.5].map(|it| Point3::new(it, 2.0 * it, 0.1));
        let directions = points.map(|it| Unit::new_normalize(it.coords + Vector3::z() * 5.0));
        assert!(poses(&points, &directions).is_empty());
        assert!(poses(&[Point3::origin(); 3], &directions).is_empty());
    }
}
