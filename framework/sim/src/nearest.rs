//! The point of a surface of triangles that is nearest to a point.

use std::collections::{BTreeMap, HashSet};

use nalgebra::Point3;

use crate::painted::Triangle;

/// What was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Found {
    pub triangle: usize,
    /// Of its corners; they add up to 1.
    pub weights: [f64; 3],
    /// How far away it is, positive outside [m].
    pub distance: f64,
}

/// A surface, to be found near a point.
pub(crate) struct Nearest<'a> {
    triangles: &'a [Triangle],
    vertices: &'a [Point3<f64>],
    cells: BTreeMap<[i64; 3], Vec<u32>>,
    reach_m: f64,
}

/// The cell of this width that a point lies in.
pub(crate) fn cell(point: &Point3<f64>, size: f64) -> [i64; 3] {
    [point.x, point.y, point.z].map(|it| (it / size).floor() as i64)
}

impl<'a> Nearest<'a> {
    /// Farther away than `reach_m` nothing is found.
    pub fn new(triangles: &'a [Triangle], vertices: &'a [Point3<f64>], reach_m: f64) -> Nearest<'a> {
        let mut cells: BTreeMap<[i64; 3], Vec<u32>> = BTreeMap::new();
        for (number, triangle) in (0..).zip(triangles) {
            let corners = triangle.corners.map(|it| vertices[it as usize].coords);
            let low = corners.iter().fold(corners[0], |sum, it| sum.inf(it)).add_scalar(-reach_m);
            let high = corners.iter().fold(corners[0], |sum, it| sum.sup(it)).add_scalar(reach_m);
            let [low, high] = [low, high].map(|it| cell(&Point3::from(it), reach_m));
            for x in low[0]..=high[0] {
                for (y, z) in (low[1]..=high[1]).flat_map(|y| (low[2]..=high[2]).map(move |z| (y, z))) {
                    cells.entry([x, y, z]).or_default().push(number);
                }
            }
        }
        Nearest { triangles, vertices, cells, reach_m }
    }

    /// The nearest point within reach.
    pub fn find(&self, point: &Point3<f64>) -> Option<Found> {
        let mut best: Option<Found> = None;
        let mut known = HashSet::new();
        for &number in self.cells.get(&cell(point, self.reach_m))? {
            if !known.insert(number) {
                continue;
            }
            let corners = self.triangles[number as usize].corners.map(|it| self.vertices[it as usize]);
            let weights = nearest_on(corners, point);
            let nearest =
                corners.iter().zip(weights).fold(nalgebra::Vector3::zeros(), |sum, (it, w)| sum + it.coords * w);
            let off = point.coords - nearest;
            let distance = off.norm();
            let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
            if distance <= self.reach_m && best.is_none_or(|it| distance < it.distance.abs()) {
                let distance = if off.dot(&normal) < 0.0 { -distance } else { distance };
                best = Some(Found { triangle: number as usize, weights, distance });
            }
        }
        best
    }
}

/// Weights of the corners of a triangle at its point that is nearest to `point`. Source: C. Ericson, *Real-Time Collision Detection*, 2005, section 5.1.5.
fn nearest_on([a, b, c]: [Point3<f64>; 3], point: &Point3<f64>) -> [f64; 3] {
    let (ab, ac) = (b - a, c - a);
    let along = |from: &Point3<f64>| (ab.dot(&(point - from)), ac.dot(&(point - from)));
    let ((d1, d2), (d3, d4), (d5, d6)) = (along(&a), along(&b), along(&c));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let (va, vb, vc) = (d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2);
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let share = d1 / (d1 - d3);
        return [1.0 - share, share, 0.0];
    }
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let share = d2 / (d2 - d6);
        return [1.0 - share, 0.0, share];
    }
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let share = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return [0.0, 1.0 - share, share];
    }
    let sum = va + vb + vc;
    if sum > 0.0 { [va / sum, vb / sum, vc / sum] } else { [1.0, 0.0, 0.0] }
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;

    use super::*;

    #[test]
    fn the_nearest_point_of_a_triangle_is_the_nearest_of_many() {
        let mut random = Random::new(2);
        for _ in 0..200 {
            let mut any = || Point3::new(random.normal(), random.normal(), random.normal());
            let (corners, point) = ([any(), any(), any()], any());
            let weights = nearest_on(corners, &point);
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12 && weights.iter().all(|it| *it >= 0.0));
            let at = |u: f64, v: f64| {
                (corners[0] + (corners[1] - corners[0]) * u + (corners[2] - corners[0]) * v - point).norm()
            };
            let found = at(weights[1], weights[2]);
            let many = (0..=40).flat_map(|u| (0..=40 - u).map(move |v| (f64::from(u) / 40.0, f64::from(v) / 40.0)));
            let least = many.map(|(u, v)| at(u, v)).fold(f64::INFINITY, f64::min);
            assert!(found <= least + 1e-12 && least < found + 0.12, "{found} {least}");
        }
    }
}
