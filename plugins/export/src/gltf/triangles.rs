//! Triangles over the marks of a surface: a Delaunay triangulation in the best-fitting plane, without rim triangles that span gaps.
//!
//! Source: A. Bowyer, "Computing Dirichlet tessellations", The Computer Journal 24(2), 1981; D. F. Watson in the same issue. Points are added one by one: all
//! triangles whose circle contains the point are removed, and their rim is connected with it.

use nalgebra::{Matrix3, Point2, Point3, Vector3};

/// Edges longer than this times the median edge span a gap.
const LONGEST: f64 = 3.0;

/// Corners by number, counter-clockwise as seen from `outside` (a direction out of the surface); none for fewer than three points, or points on a line.
pub(super) fn triangles(points: &[Point3<f64>], outside: &Vector3<f64>) -> Vec<[u16; 3]> {
    let Some(flat) = flattened(points, outside) else { return Vec::new() };
    let all = delaunay(&flat);
    let length = |a: usize, b: usize| (points[a] - points[b]).norm();
    let longest = |it: &[usize; 3]| length(it[0], it[1]).max(length(it[1], it[2])).max(length(it[2], it[0]));
    let mut edges: Vec<f64> = all.iter().flat_map(|it| [length(it[0], it[1]), length(it[1], it[2])]).collect();
    edges.sort_by(f64::total_cmp);
    let Some(median) = edges.get(edges.len() / 2) else { return Vec::new() };
    let kept = all.iter().filter(|it| longest(it) <= LONGEST * median);
    kept.map(|it| it.map(|corner| corner as u16)).collect()
}

/// Coordinates in the plane of least squares, in units of the extent; x, y and `outside` are right-handed.
fn flattened(points: &[Point3<f64>], outside: &Vector3<f64>) -> Option<Vec<Point2<f64>>> {
    if points.len() < 3 {
        return None;
    }
    let middle = points.iter().map(|it| it.coords).sum::<Vector3<f64>>() / points.len() as f64;
    let spread: Matrix3<f64> = points.iter().map(|it| (it.coords - middle) * (it.coords - middle).transpose()).sum();
    let eigen = spread.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let [largest, second, _] = order.map(|it| eigen.eigenvalues[it]);
    if second.is_nan() || second <= 1e-9 * largest {
        return None;
    }
    let [x, y, normal] = order.map(|it| eigen.eigenvectors.column(it).into_owned());
    let y = if x.cross(&y).dot(&normal) * normal.dot(outside) < 0.0 { -y } else { y };
    let extent = largest.sqrt();
    let flat = |it: &Point3<f64>| {
        let from_middle = (it.coords - middle) / extent;
        Point2::new(from_middle.dot(&x), from_middle.dot(&y))
    };
    Some(points.iter().map(flat).collect())
}

fn delaunay(points: &[Point2<f64>]) -> Vec<[usize; 3]> {
    let n = points.len();
    let mut all = points.to_vec();
    // A triangle around everything, far away: its corners take no part in the end.
    all.extend([Point2::new(-1e3, -1e3), Point2::new(1e3, -1e3), Point2::new(0.0, 1e3)]);
    let mut triangles = vec![[n, n + 1, n + 2]];
    for point in 0..n {
        let (gone, kept): (Vec<_>, Vec<_>) =
            triangles.into_iter().partition(|it| holds(it.map(|i| all[i]), all[point]));
        triangles = kept;
        let edges: Vec<[usize; 2]> = gone.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
        // An edge that two of them share runs both ways.
        let rim = edges.iter().filter(|&&[a, b]| !edges.contains(&[b, a]));
        triangles.extend(rim.map(|&[a, b]| [a, b, point]));
    }
    triangles.retain(|it| it.iter().all(|&corner| corner < n));
    triangles
}

/// Whether the circle through three corners, counter-clockwise, contains a point.
fn holds([a, b, c]: [Point2<f64>; 3], point: Point2<f64>) -> bool {
    let rows = [a, b, c].map(|it| {
        let to = it - point;
        [to.x, to.y, to.norm_squared()]
    });
    Matrix3::from_row_slice(rows.as_flattened()).determinant() > 0.0
}

#[cfg(test)]
mod tests {
    use foveate::estimation::random::Random;

    use super::*;

    #[test]
    fn marks_on_a_bowl_are_covered_once_and_look_outwards() {
        let mut random = Random::new(3);
        let point = |_| {
            let [x, y] = [0, 1].map(|_| random.uniform_in(-1.0, 1.0));
            Point3::new(2.0 - 0.3 * (x * x + y * y), x, y)
        };
        let points: Vec<Point3<f64>> = (0..70).map(point).collect();
        let all = triangles(&points, &Vector3::x());
        let area = |it: &[u16; 3]| {
            let [a, b, c] = it.map(|corner| points[usize::from(corner)]);
            (b - a).cross(&(c - a)).x / 2.0
        };
        assert!(all.iter().all(|it| area(it) > 0.0), "counter-clockwise from outside");
        let whole: f64 = all.iter().map(area).sum();
        // Nearly the square that they lie in, and not more.
        assert!((3.2..4.0).contains(&whole), "{whole}");
        let mut corners: Vec<u16> = all.iter().flatten().copied().collect();
        corners.sort_unstable();
        corners.dedup();
        assert_eq!(corners.len(), 70);
    }

    #[test]
    fn few_points_and_points_on_a_line_have_no_triangle() {
        let on_a_line: Vec<Point3<f64>> = (0..5).map(|it| Point3::new(f64::from(it), 0.0, 1.0)).collect();
        assert!(triangles(&on_a_line, &Vector3::z()).is_empty());
        assert!(triangles(&on_a_line[..2], &Vector3::z()).is_empty());
        assert!(triangles(&[], &Vector3::z()).is_empty());
    }
}
