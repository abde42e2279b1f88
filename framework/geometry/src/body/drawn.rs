//! Voxels of tubes with round ends, for tests.

use nalgebra::{Point3, Vector3};

use super::field::VoxelField;

/// Edge of a voxel [m].
pub(super) const SIZE: f64 = 0.03;
/// The corner of voxel (0, 0, 0) that is least in x, y, z [m].
pub(super) const ORIGIN: Point3<f64> = Point3::new(-0.6, -0.9, 0.0);

/// Ends and radius [m].
pub(super) type Tube = ([Point3<f64>; 2], f64);

/// Somebody who stands at the origin with hanging arms.
pub(super) fn somebody() -> Vec<Tube> {
    let p = |x: f64, y: f64, z: f64| Point3::new(x, y, z);
    let mut tubes =
        vec![([p(0.0, 0.0, 1.62), p(0.0, 0.0, 1.65)], 0.10), ([p(0.0, 0.0, 1.40), p(0.0, 0.0, 1.60)], 0.055)];
    for side in [-1.0, 1.0] {
        tubes.push(([p(0.0, side * 0.08, 0.95), p(0.0, side * 0.09, 1.36)], 0.105));
        tubes.push(([p(0.0, 0.0, 1.42), p(0.0, side * 0.18, 1.42)], 0.06));
        tubes.push(([p(0.0, side * 0.18, 1.42), p(0.0, side * 0.27, 1.14)], 0.046));
        tubes.push(([p(0.0, side * 0.27, 1.14), p(0.08, side * 0.30, 0.80)], 0.04));
        tubes.push(([p(0.0, side * 0.09, 0.90), p(0.10, side * 0.16, 0.50)], 0.075));
        tubes.push(([p(0.10, side * 0.16, 0.50), p(0.0, side * 0.18, 0.06)], 0.055));
        tubes.push(([p(0.0, side * 0.18, 0.06), p(0.16, side * 0.18, 0.06)], 0.04));
    }
    tubes
}

/// Places in the grid of what lies in any of the tubes.
pub(super) fn indices(tubes: &[Tube]) -> Vec<[u16; 3]> {
    let is_in = |index: &[u16; 3]| {
        let place = ORIGIN + Vector3::from(index.map(|it| f64::from(it) + 0.5)) * SIZE;
        tubes.iter().any(|([a, b], radius)| {
            let along = b - a;
            let share = ((place - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
            (place - (a + along * share)).norm() < *radius
        })
    };
    let all = (0..80_u16).flat_map(|x| (0..60_u16).flat_map(move |y| (0..60_u16).map(move |z| [x, y, z])));
    all.filter(is_in).collect()
}

pub(super) fn field(tubes: &[Tube]) -> VoxelField {
    VoxelField::new(SIZE, &ORIGIN, &indices(tubes)).unwrap()
}
