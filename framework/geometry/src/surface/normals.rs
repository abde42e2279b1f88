//! Normals of points without them: the least-squares plane through the neighbours of each.

use nalgebra::{Matrix3, Point3, Vector3};

use super::SurfacePoint;
use super::key::{CellTable, cell_of, key};

/// Neighbours that a normal needs.
const MIN_NEIGHBOURS: usize = 6;
/// The plane's second extent is at least this part of the first, or the points lie along a line [–].
const MIN_BREADTH: f64 = 0.25;
/// What is left across the plane is at most this part of its second extent [–].
const MAX_THICKNESS: f64 = 0.5;

/// Gives each point without a normal that of its neighbours within `radius_m`, towards `viewpoint`. Points with too
/// few neighbours, or whose neighbours lie along a line (as in one stripe) or form no surface, get none; returns how
/// many.
pub fn find_normals(points: &mut [SurfacePoint], radius_m: f64, viewpoint: &Point3<f64>) -> usize {
    let mut table = CellTable::default();
    let mut next: Vec<Option<u32>> = vec![None; points.len()];
    for (number, point) in points.iter().enumerate() {
        if let Some(key) = key(cell_of(&point.position, radius_m)) {
            next[number] = table.insert(key, number as u32);
        }
    }
    let around = |position: &Point3<f64>| -> (usize, Vector3<f64>, Matrix3<f64>) {
        let (mut n, mut sum, mut squares) = (0, Vector3::zeros(), Matrix3::zeros());
        let [x, y, z] = cell_of(position, radius_m);
        for (dx, dy, dz) in (-1..=1).flat_map(|dx| (-1..=1).flat_map(move |dy| (-1..=1).map(move |dz| (dx, dy, dz)))) {
            let cell = [x.saturating_add(dx), y.saturating_add(dy), z.saturating_add(dz)];
            let mut place = key(cell).and_then(|it| table.get(&it).copied());
            while let Some(number) = place {
                let offset = points[number as usize].position - position;
                if offset.norm_squared() <= radius_m * radius_m {
                    n += 1;
                    sum += offset;
                    squares += offset * offset.transpose();
                }
                place = next[number as usize];
            }
        }
        (n, sum, squares)
    };
    let normal = |point: &SurfacePoint| -> Option<Vector3<f64>> {
        let (n, sum, squares) = around(&point.position);
        if n < MIN_NEIGHBOURS {
            return None;
        }
        let eigen = (squares / n as f64 - sum * sum.transpose() / (n * n) as f64).symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        let [least, second, first] = order.map(|it| eigen.eigenvalues[it].max(0.0).sqrt());
        if second < MIN_BREADTH * first || least > MAX_THICKNESS * second {
            return None;
        }
        let normal = eigen.eigenvectors.column(order[0]).into_owned();
        Some(if normal.dot(&(viewpoint - point.position)) < 0.0 { -normal } else { normal })
    };
    let found: Vec<Option<Vector3<f64>>> =
        points.iter().map(|it| if it.normal == Vector3::zeros() { normal(it) } else { Some(it.normal) }).collect();
    let mut n_without = 0;
    for (point, found) in points.iter_mut().zip(found) {
        n_without += usize::from(found.is_none());
        point.normal = found.unwrap_or_else(Vector3::zeros);
    }
    n_without
}
