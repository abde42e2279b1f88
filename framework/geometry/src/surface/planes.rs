//! Starts of global registration for shapes that are mostly one plane, such as a wall with objects: plane on plane, aligned by what stands out.
//!
//! 1. The plane with most points of each shape is found from random triples.
//! 2. Heights over the plane become a map of cells.
//! 3. For each of many angles, cells that stand out vote for the shifts that bring them to cells of the other map that
//!    stand out as much (a Hough transform); the shifts with most votes are
//!    judged by all cells that both maps know.
//!
//! Sources: M. Fischler and R. Bolles, "Random sample consensus", CACM 24(6), 1981; D. Ballard, "Generalizing the Hough transform to detect arbitrary shapes", Pattern Recognition 13(2), 1981.

use std::collections::HashMap;

use foveate_estimation::Random;
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::SurfacePoint;

/// Points that the plane is found from.
const SEARCHED: usize = 2000;
const TRIPLES: usize = 300;
/// Points no farther from the plane than this part of the extent are in it; cells of the maps are so large.
const FLAT: f64 = 1.0 / 200.0;
const CELL: f64 = 1.0 / 48.0;
/// Part of the points that a plane must hold.
const LEAST_FLAT: f64 = 0.25;
/// Turns about the normal that are tried.
const TURNS: usize = 120;
/// Shifts of each turn that are judged.
const SHIFTS: usize = 6;
/// Starts closer than so many cells and turns are one.
const APART: [f64; 2] = [2.0, 2.0];
/// Of points that stand out, there is one in the plane for so many, and so many at least.
const FLAT_SHARE: usize = 4;
const LEAST_POINTS: usize = 100;
/// Cells that must stand out.
const LEAST_CELLS: usize = 5;

/// The plane that holds most points of a shape, and what stands out of it.
#[derive(Debug)]
pub(super) struct Flat {
    /// x and y lie in the plane, z is its normal.
    world_from_plane: Isometry3<f64>,
    /// By point: whether it stands out.
    stands_out: Vec<bool>,
}

impl Flat {
    /// `None`: no plane holds a good part of them.
    pub(super) fn of(points: &[SurfacePoint], extent: f64) -> Option<Flat> {
        let tolerance = FLAT * extent;
        let some: Vec<Point3<f64>> =
            points.iter().step_by(points.len().div_ceil(SEARCHED)).map(|it| it.position).collect();
        let mut random = Random::new(1);
        let mut pick = || some[(random.uniform() * some.len() as f64) as usize % some.len()];
        let mut best: Option<(usize, Point3<f64>, Vector3<f64>)> = None;
        for _ in 0..TRIPLES {
            let [a, b, c] = [pick(), pick(), pick()];
            let Some(normal) = (b - a).cross(&(c - a)).try_normalize(1e-9 * extent * extent) else { continue };
            let n = some.iter().filter(|it| normal.dot(&(**it - a)).abs() < tolerance).count();
            if best.is_none_or(|it| n > it.0) {
                best = Some((n, a, normal));
            }
        }
        let (n, mut middle, mut normal) = best?;
        if (n as f64) < LEAST_FLAT * some.len() as f64 {
            return None;
        }
        for _ in 0..3 {
            let inside = |it: &&Point3<f64>| normal.dot(&(**it - middle)).abs() < tolerance;
            let within: Vec<Point3<f64>> = some.iter().filter(inside).copied().collect();
            middle = Point3::from(within.iter().map(|it| it.coords).sum::<Vector3<f64>>() / within.len() as f64);
            let spread: Matrix3<f64> = within.iter().map(|it| (it - middle) * (it - middle).transpose()).sum();
            let eigen = spread.symmetric_eigen();
            let thin = eigen.eigenvalues.imin();
            let found: Vector3<f64> = eigen.eigenvectors.column(thin).into_owned();
            normal = if found.dot(&normal) < 0.0 { -found } else { found };
        }
        // Out of the plane as its points say, where they do.
        let said: Vector3<f64> = points.iter().map(|it| it.normal).sum();
        if said.dot(&normal) < 0.0 {
            normal = -normal;
        }
        let aside = if normal.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
        let x = aside.cross(&normal).normalize();
        let rotation = Matrix3::from_columns(&[x, normal.cross(&x), normal]);
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
        let stands_out = points.iter().map(|it| normal.dot(&(it.position - middle)).abs() >= tolerance).collect();
        Some(Flat { world_from_plane: Isometry3::from_parts(Translation3::from(middle), rotation), stands_out })
    }

    /// The points that stand out of it.
    pub(super) fn standing_out(&self, points: &[SurfacePoint]) -> Vec<SurfacePoint> {
        points.iter().zip(&self.stands_out).filter(|it| *it.1).map(|it| *it.0).collect()
    }

    /// Some of the points, most of them of those that stand out: these say where the shape lies along the plane, and what scatters is judged by the median of all.
    pub(super) fn balanced(&self, points: &[SurfacePoint], n: usize) -> Vec<SurfacePoint> {
        let of = |is_out: bool, most: usize| {
            let all: Vec<&SurfacePoint> =
                points.iter().zip(&self.stands_out).filter(|it| *it.1 == is_out).map(|it| it.0).collect();
            let step = all.len().div_ceil(most.max(1)).max(1);
            all.into_iter().step_by(step).copied().collect::<Vec<_>>()
        };
        let mut out = of(true, n);
        out.extend(of(false, (out.len() / FLAT_SHARE).max(LEAST_POINTS)));
        out
    }

    /// The largest height of each cell; where `sign` is −1, after half a turn about x.
    fn heights(&self, points: &[SurfacePoint], cell: f64, sign: f64) -> HashMap<[i32; 2], f64> {
        let mut heights: HashMap<[i32; 2], f64> = HashMap::new();
        for point in points {
            let at = self.world_from_plane.inverse_transform_point(&point.position);
            let place = [at.x / cell, sign * at.y / cell].map(|it| it.round() as i32);
            let height = heights.entry(place).or_insert(0.0);
            if at.z.abs() > height.abs() {
                *height = sign * at.z;
            }
        }
        heights
    }
}

/// Poses that take points of the one to the other, the likeliest first, `most` at most. `has_sides`: which side is out is known of both.
pub(super) fn starts(
    [a, b]: [(&Flat, &[SurfacePoint]); 2],
    extent: f64,
    has_sides: bool,
    most: usize,
) -> Vec<Isometry3<f64>> {
    let (cell, tolerance) = (CELL * extent, FLAT * extent);
    let of_b = b.0.heights(b.1, cell, 1.0);
    let out = |map: &HashMap<[i32; 2], f64>| -> Vec<([i32; 2], f64)> {
        let mut list: Vec<_> = map.iter().map(|it| (*it.0, *it.1)).filter(|it| it.1.abs() >= tolerance).collect();
        list.sort_unstable_by_key(|it| it.0);
        list
    };
    let out_b = out(&of_b);
    // Score, pose in the planes: side, turn, shift.
    let mut found: Vec<(f64, f64, usize, [i32; 2])> = Vec::new();
    for sign in if has_sides { &[1.0][..] } else { &[1.0, -1.0][..] } {
        let of_a = a.0.heights(a.1, cell, *sign);
        let out_a = out(&of_a);
        if out_a.len().min(out_b.len()) < LEAST_CELLS {
            continue;
        }
        let known_a: Vec<([i32; 2], f64)> = {
            let mut list: Vec<_> = of_a.iter().map(|it| (*it.0, *it.1)).collect();
            list.sort_unstable_by_key(|it| it.0);
            list
        };
        for turn in 0..TURNS {
            let (sin, cos) = (std::f64::consts::TAU * turn as f64 / TURNS as f64).sin_cos();
            let turned = |[x, y]: [i32; 2]| {
                let (x, y) = (f64::from(x), f64::from(y));
                [cos * x - sin * y, sin * x + cos * y].map(|it| it.round() as i32)
            };
            let mut votes: HashMap<[i32; 2], u32> = HashMap::new();
            for (place, height) in &out_a {
                let [x, y] = turned(*place);
                for (there, other) in &out_b {
                    if (height - other).abs() < cell {
                        *votes.entry([there[0] - x, there[1] - y]).or_default() += 1;
                    }
                }
            }
            let mut shifts: Vec<([i32; 2], u32)> = votes.into_iter().collect();
            shifts.sort_unstable_by_key(|it| (std::cmp::Reverse(it.1), it.0));
            for (shift, _) in shifts.into_iter().take(SHIFTS) {
                let judge = |(place, height): &([i32; 2], f64)| {
                    let [x, y] = turned(*place);
                    let Some(other) = of_b.get(&[x + shift[0], y + shift[1]]) else { return 0.0 };
                    let is_flat = height.abs().max(other.abs()) < tolerance;
                    match (is_flat, (height - other).abs() < cell) {
                        (true, _) => 0.1,
                        (false, true) => 1.0,
                        (false, false) => -1.0,
                    }
                };
                found.push((known_a.iter().map(judge).sum(), *sign, turn, shift));
            }
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut kept: Vec<(f64, usize, [i32; 2])> = Vec::new();
    for (_, sign, turn, shift) in found {
        let is_near = |it: &(f64, usize, [i32; 2])| {
            let turns = (it.1 as f64 - turn as f64).abs();
            let off = [0, 1].map(|axis| f64::from(it.2[axis] - shift[axis]));
            it.0 == sign && turns.min(TURNS as f64 - turns) <= APART[1] && off[0].hypot(off[1]) <= APART[0]
        };
        if kept.len() < most && !kept.iter().any(is_near) {
            kept.push((sign, turn, shift));
        }
    }
    let pose = |(sign, turn, shift): &(f64, usize, [i32; 2])| {
        let angle = std::f64::consts::TAU * *turn as f64 / TURNS as f64;
        let about_normal = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
        let over = if *sign < 0.0 { std::f64::consts::PI } else { 0.0 };
        let by = Translation3::new(f64::from(shift[0]) * cell, f64::from(shift[1]) * cell, 0.0);
        let within =
            Isometry3::from_parts(by, about_normal * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), over));
        b.0.world_from_plane * within * a.0.world_from_plane.inverse()
    };
    kept.iter().map(pose).collect()
}
