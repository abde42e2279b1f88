//! The room as a camera sees it behind people and LEDs: floor, walls, desks, the display, ceiling lamps.

use nalgebra::{Point3, Vector3};

use crate::chance::stream;
use crate::lab::ROOM_M;
use crate::rounding::floored;

/// Height of the desks [m].
pub(super) const DESK_HEIGHT_M: f64 = 0.74;

/// Desks: opposite corners on the floor [m].
const DESKS: [[[f64; 2]; 2]; 5] = [
    [[-2.95, -2.6], [-2.25, -0.6]],
    [[-2.95, 0.2], [-2.25, 2.0]],
    [[2.25, -1.9], [2.95, 0.1]],
    [[2.25, 0.9], [2.95, 2.7]],
    [[-1.2, -3.85], [1.2, -3.2]],
];

/// Monitors: middle on the floor plan [m], and where they face.
pub(super) const MONITOR_PLACES: [([f64; 2], [f64; 2]); 8] = [
    ([-2.62, -1.1], [1.0, 0.0]),
    ([2.62, 1.5], [-1.0, 0.0]),
    ([-0.5, -3.5], [0.0, 1.0]),
    ([-2.62, 1.3], [1.0, 0.0]),
    ([2.62, -0.6], [-1.0, 0.0]),
    ([0.5, -3.5], [0.0, 1.0]),
    ([-2.62, -2.0], [1.0, 0.0]),
    ([2.62, 2.2], [-1.0, 0.0]),
];

/// The display on the wall at +y: from and to along x and z [m].
pub(super) const DISPLAY: [[f64; 2]; 2] = [[-1.9, 0.7], [1.9, 2.35]];

/// Ceiling lamps: opposite corners [m].
const LAMPS: [[[f64; 2]; 2]; 4] =
    [[[-1.8, -2.6], [-1.5, -1.3]], [[1.5, -2.6], [1.8, -1.3]], [[-1.8, 1.2], [-1.5, 2.5]], [[1.5, 1.2], [1.8, 2.5]]];

/// What a ray ends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Surface {
    /// Tiles.
    Floor,
    /// Plain walls.
    Wall,
    /// The large display, dim.
    Display,
    /// Desk tops and sides.
    Desk,
    /// Ceiling tiles.
    Ceiling,
    /// Fluorescent lamps in the ceiling.
    Lamp,
}

/// What a ray that starts inside the room ends on, along which axis that is turned, and how far it is [lengths of `direction`].
pub(crate) fn room_hit(origin: &Point3<f64>, direction: &Vector3<f64>) -> (Surface, usize, f64) {
    let (depth, axis) = exit(origin, direction);
    let mut nearest = depth;
    let mut normal_axis = axis;
    let mut on_desk = false;
    for desk in DESKS {
        if let Some((depth, axis)) = desk_hit(desk, origin, direction)
            && depth < nearest
        {
            (nearest, normal_axis, on_desk) = (depth, axis, true);
        }
    }
    let point = origin + direction * nearest;
    let within = |[low, high]: [[f64; 2]; 2], a: f64, b: f64| low[0] < a && a < high[0] && low[1] < b && b < high[1];
    let surface = match (on_desk, normal_axis) {
        (true, _) => Surface::Desk,
        (_, 2) if direction.z < 0.0 => Surface::Floor,
        (_, 2) if LAMPS.iter().any(|&lamp| within(lamp, point.x, point.y)) => Surface::Lamp,
        (_, 2) => Surface::Ceiling,
        (_, 1) if direction.y > 0.0 && within(DISPLAY, point.x, point.z) => Surface::Display,
        _ => Surface::Wall,
    };
    (surface, normal_axis, nearest)
}

/// How bright the room is along a ray that starts inside it [gray level], what it ends on, and how far that is [lengths of
/// `direction`].
pub fn room_light(origin: &Point3<f64>, direction: &Vector3<f64>) -> (f64, Surface, f64) {
    let (surface, normal_axis, nearest) = room_hit(origin, direction);
    let point = origin + direction * nearest;
    let base = match surface {
        Surface::Floor => floor(&point),
        Surface::Wall => 46.0 + 4.0 * point.z + if point.z < 0.1 { -18.0 } else { 0.0 },
        Surface::Display => 64.0 + 10.0 * (1.3 * point.x).cos(),
        Surface::Desk if normal_axis == 2 => 52.0,
        Surface::Desk => 24.0,
        Surface::Ceiling => 58.0 - seam(point.x, point.y, 0.6) * 14.0,
        Surface::Lamp => return (400.0, surface, nearest),
    };
    // Corners and the floor below desks get less light; surfaces are not of one colour.
    let light = base * (0.72 + 0.28 * openness(&point)) + grain(&point, 0.03) * 3.0 + grain(&point, 0.15) * 1.5;
    (light, surface, nearest)
}

/// Where a ray from inside leaves the room, and through which axis' wall.
fn exit(origin: &Point3<f64>, direction: &Vector3<f64>) -> (f64, usize) {
    let [min, max] = ROOM_M;
    let mut nearest = (f64::INFINITY, 2);
    for axis in 0..3 {
        let wall = if direction[axis] > 0.0 { max[axis] } else { min[axis] };
        let depth = (wall - origin[axis]) / direction[axis];
        if depth >= 0.0 && depth < nearest.0 {
            nearest = (depth, axis);
        }
    }
    if nearest.0.is_finite() { nearest } else { (1.0, 2) }
}

/// Where a ray from outside enters the box of a desk, and through which axis' side.
fn desk_hit(desk: [[f64; 2]; 2], origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<(f64, usize)> {
    let [low, high] = desk;
    let (min, max) = ([low[0], low[1], 0.0], [high[0], high[1], DESK_HEIGHT_M]);
    let (mut enter, mut leave, mut side) = (0.0, f64::INFINITY, None);
    for axis in 0..3 {
        let ends = [min[axis], max[axis]].map(|wall| (wall - origin[axis]) / direction[axis]);
        let (near, far) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        if near > enter {
            (enter, side) = (near, Some(axis));
        }
        leave = leave.min(far);
    }
    side.filter(|_| enter < leave).map(|side| (enter, side))
}

/// Carpet tiles of half a metre, alternately a little darker, with seams.
fn floor(point: &Point3<f64>) -> f64 {
    let tile = (point.x / 0.5).floor() + (point.y / 0.5).floor();
    34.0 + if tile.rem_euclid(2.0) < 1.0 { 5.0 } else { 0.0 } - seam(point.x, point.y, 0.5) * 9.0
}

/// 1 on the seams of tiles of `size` [m], 0 elsewhere.
fn seam(x: f64, y: f64, size: f64) -> f64 {
    let distance = |it: f64| (it / size - (it / size).round()).abs() * size;
    if distance(x).min(distance(y)) < 0.008 { 1.0 } else { 0.0 }
}

/// From 0 in a corner of the room to 1 a metre and more away from all walls but one.
fn openness(point: &Point3<f64>) -> f64 {
    let [min, max] = ROOM_M;
    let mut distances = [0, 1, 2].map(|axis| (point[axis] - min[axis]).min(max[axis] - point[axis]).clamp(0.0, 1.0));
    distances.sort_by(f64::total_cmp);
    (distances[1] * (2.0 - distances[1])).max(0.0)
}

/// Between −1 and 1, constant over cubes of `size` [m]; the same at each call.
#[inline]
fn grain(point: &Point3<f64>, size: f64) -> f64 {
    let cell = point.coords.map(|it| floored(it / size));
    let index = cell.x.wrapping_mul(73_856_093) ^ cell.y.wrapping_mul(19_349_663) ^ cell.z.wrapping_mul(83_492_791);
    stream(17, (size * 1000.0) as u64, index).uniform_in(-1.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_end_where_they_should() {
        let origin = Point3::new(0.0, 0.0, 1.5);
        let surface = |x: f64, y: f64, z: f64| room_light(&origin, &(Point3::new(x, y, z) - origin)).1;
        assert_eq!(surface(0.0, 3.9, 1.5), Surface::Display);
        assert_eq!(surface(2.9, 3.9, 1.5), Surface::Wall);
        assert_eq!(surface(0.1, 0.3, 0.0), Surface::Floor);
        assert_eq!(surface(-2.6, -1.0, 0.74), Surface::Desk);
        assert_eq!(surface(-1.6, -2.0, 3.0), Surface::Lamp);
        assert_eq!(surface(0.0, 0.1, 3.0), Surface::Ceiling);
        let (_, _, depth) = room_light(&origin, &Vector3::new(0.0, 0.0, -3.0));
        assert!((depth - 0.5).abs() < 1e-12);
    }

    #[test]
    fn light_is_finite_everywhere() {
        let mut random = foveate_estimation::random::Random::new(3);
        for _ in 0..2000 {
            let origin = Point3::new(2.9 * random.uniform_in(-1.0, 1.0), 3.8 * random.uniform_in(-1.0, 1.0), 2.7);
            let direction = Vector3::from([(); 3].map(|()| random.normal()));
            let (light, _, depth) = room_light(&origin, &direction);
            assert!((0.0..=400.0).contains(&light) && depth > 0.0, "{light} {depth}");
        }
    }
}
