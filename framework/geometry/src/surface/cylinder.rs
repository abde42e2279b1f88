//! Least-squares fit of a circular cylinder.
//!
//! Where normals are known the axis is perpendicular to all of them: it starts as the least eigenvector of Σ n nᵀ, the
//! circle across it as the algebraic one of I. Kåsa, "A circle fitting procedure and its error analysis", IEEE Trans.
//! Instrumentation and Measurement 25(1), 1976. Then Σ (distance to the axis − radius)² is minimised over a point and
//! a direction of the axis (two numbers each) and the radius by Gauss–Newton.

use nalgebra::{Matrix3, Matrix5, Point3, SMatrix, Unit, Vector3, Vector5};

use super::SurfacePoint;

/// A fitted cylinder without ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cylinder {
    /// The point on the axis nearest to the centroid of the points [m].
    pub point: Point3<f64>,
    /// Unit direction of the axis; its largest component is positive.
    pub direction: Unit<Vector3<f64>>,
    /// Radius [m].
    pub radius: f64,
    /// Standard deviation of the radius, from the residuals taken as independent [m].
    pub radius_sigma: f64,
    /// Root mean square distance of the points from the surface [m].
    pub rms: f64,
}

/// Steps of the search.
const STEPS: usize = 50;
/// A step this small beside the radius is none.
const DONE: f64 = 1e-12;
/// Normals that differ by less from one direction are those of a plane: the part of the second largest spread.
const FLAT: f64 = 1e-4;

impl Cylinder {
    /// Signed distance of a point from the surface; negative inside [m].
    pub fn distance(&self, point: &Point3<f64>) -> f64 {
        let off = point - self.point;
        (off - self.direction.into_inner() * self.direction.dot(&off)).norm() - self.radius
    }

    /// Fits a cylinder to points with normals; `None` for fewer than six points, for points of a plane, and without convergence.
    pub fn fit(points: &[SurfacePoint]) -> Option<Cylinder> {
        if points.len() < 6 {
            return None;
        }
        let n = points.len() as f64;
        let mut spread = Matrix3::zeros();
        points.iter().for_each(|it| spread += it.normal * it.normal.transpose() / n);
        let eigen = spread.symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
        if eigen.eigenvalues[order[1]] < FLAT {
            return None;
        }
        let axis = Unit::new_normalize(eigen.eigenvectors.column(order[0]).into_owned());
        let middle = Point3::from(points.iter().map(|it| it.position.coords).sum::<Vector3<f64>>() / n);
        let (point, radius) = circle(points, &middle, &axis)?;
        refine(points, &middle, point, axis, radius)
    }
}

/// Two directions across one.
fn across(axis: &Unit<Vector3<f64>>) -> [Vector3<f64>; 2] {
    let least = axis.iamin();
    let first = axis.cross(&Vector3::ith(least, 1.0)).normalize();
    [first, axis.cross(&first)]
}

fn circle(points: &[SurfacePoint], middle: &Point3<f64>, axis: &Unit<Vector3<f64>>) -> Option<(Point3<f64>, f64)> {
    let [u, v] = across(axis);
    let (mut normal, mut side) = (Matrix3::zeros(), Vector3::zeros());
    for it in points {
        let off = it.position - middle;
        let (x, y) = (off.dot(&u), off.dot(&v));
        let row = Vector3::new(2.0 * x, 2.0 * y, 1.0);
        normal += row * row.transpose();
        side += row * (x * x + y * y);
    }
    let solution = normal.try_inverse()? * side;
    let squared = solution[2] + solution[0] * solution[0] + solution[1] * solution[1];
    (squared > 0.0).then(|| (middle + u * solution[0] + v * solution[1], squared.sqrt()))
}

fn refine(
    points: &[SurfacePoint],
    middle: &Point3<f64>,
    mut point: Point3<f64>,
    mut axis: Unit<Vector3<f64>>,
    mut radius: f64,
) -> Option<Cylinder> {
    let n = points.len() as f64;
    for _ in 0..STEPS {
        let [u, v] = across(&axis);
        let (mut normal, mut side, mut squares) = (Matrix5::zeros(), Vector5::zeros(), 0.0);
        for it in points {
            let off = it.position - point;
            let along = off.dot(&axis);
            let out = off - axis.into_inner() * along;
            let distance = out.norm();
            let out = out / distance.max(f64::MIN_POSITIVE);
            // Of the distance by shifts of the axis' point and turns of its direction, and by the radius.
            let row: SMatrix<f64, 5, 1> =
                Vector5::new(-out.dot(&u), -out.dot(&v), -along * out.dot(&u), -along * out.dot(&v), -1.0);
            let residual = distance - radius;
            normal += row * row.transpose();
            side -= row * residual;
            squares += residual * residual;
        }
        let inverse = normal.try_inverse()?;
        let step = inverse * side;
        point += u * step[0] + v * step[1];
        axis = Unit::new_normalize(axis.into_inner() + u * step[2] + v * step[3]);
        radius += step[4];
        if !(radius.is_finite() && radius > 0.0) {
            return None;
        }
        if step.fixed_rows::<2>(0).norm() + step[4].abs() < DONE * radius && step.fixed_rows::<2>(2).norm() < 1e-10 {
            let flipped = axis[axis.iamax()] < 0.0;
            let direction = if flipped { -axis } else { axis };
            let point = point + direction.into_inner() * direction.dot(&(middle - point));
            let variance = squares / (n - 5.0).max(1.0);
            let radius_sigma = (inverse[(4, 4)] * variance).max(0.0).sqrt();
            return Some(Cylinder { point, direction, radius, radius_sigma, rms: (squares / n).sqrt() });
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;

    use super::*;

    fn points(noise: f64) -> (Unit<Vector3<f64>>, Vec<SurfacePoint>) {
        let axis = Unit::new_normalize(Vector3::new(0.1, -0.2, 1.0));
        let [u, v] = across(&axis);
        let mut random = Random::new(3);
        let list = (0..2000).map(|_| {
            let (angle, along) = (random.uniform_in(-1.0, 0.8), random.uniform_in(-0.1, 0.1));
            let out = u * angle.cos() + v * angle.sin();
            let position =
                Point3::new(0.3, 0.2, 1.0) + out * (0.0574 + noise * random.normal()) + axis.into_inner() * along;
            // Normals of a surface are worse than its places.
            let normal = (out + Vector3::new(random.normal(), random.normal(), random.normal()) * 0.05).normalize();
            SurfacePoint { position, covariance: Matrix3::identity() * 1e-10, normal }
        });
        (axis, list.collect())
    }

    #[test]
    fn part_of_a_cylinder_gives_back_its_radius_and_axis() {
        let (axis, exact) = points(0.0);
        let found = Cylinder::fit(&exact).unwrap();
        assert!((found.radius - 0.0574).abs() < 1e-9 && found.rms < 1e-9, "{found:?}");
        assert!(found.direction.angle(&axis) < 1e-7);
        let (_, noisy) = points(1e-4);
        let found = Cylinder::fit(&noisy).unwrap();
        assert!((found.rms - 1e-4).abs() < 1e-5);
        assert!((found.radius - 0.0574).abs() < 4.0 * found.radius_sigma && found.radius_sigma < 3e-5, "{found:?}");
        assert!(found.distance(&(found.point + found.direction.into_inner())) < 0.0);
    }

    #[test]
    fn a_plane_and_a_handful_are_refused() {
        let (_, some) = points(0.0);
        assert!(Cylinder::fit(&some[..5]).is_none());
        let flat: Vec<SurfacePoint> = some
            .iter()
            .map(|it| SurfacePoint {
                position: Point3::new(it.position.x, it.position.y, 0.0),
                normal: Vector3::z(),
                ..*it
            })
            .collect();
        assert!(Cylinder::fit(&flat).is_none());
    }
}
