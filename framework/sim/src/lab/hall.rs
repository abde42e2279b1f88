//! Any number of cameras around a hall of any size, for tests of growth.
//!
//! They hang in rows below the ceiling, evenly around the walls, and look at points spread evenly over the middle of the hall, so that
//! each part of it is seen from many sides however many cameras there are.

use foveate_geometry::{Camera, Distortion};
use foveate_scene::{Calibration, CalibrationError, LengthUnit, NamedCamera};
use nalgebra::Point3;

use super::FIELD_SIZE;

/// Horizontal focal length [px]: a camera sees 77° across and 62° up and down.
const FOCAL: f64 = 400.0;
/// More cameras than these hang in more than one row [m].
const LEAST_DISTANCE_M: f64 = 0.6;
/// Between two rows [m].
const ROW_M: f64 = 0.5;
/// The lowest row hangs no lower than this share of the hall's height.
const LOWEST: f64 = 0.6;
/// From the walls [m].
const FROM_WALL_M: f64 = 0.15;

/// Cameras `wide-1` to `wide-N` around a hall of `size_m` (along x and y, its middle at the origin, and its height above the floor).
///
/// # Errors
/// No camera, or more than a calibration holds.
///
/// # Panics
/// When a side of the hall is less than 2 m or not finite.
pub fn hall_calibration(n_cameras: usize, size_m: [f64; 3]) -> Result<Calibration, CalibrationError> {
    assert!(size_m.iter().all(|it| it.is_finite() && *it >= 2.0), "a hall of {size_m:?} m, expected 2 m and more");
    let cameras =
        (0..n_cameras).map(|i| NamedCamera { name: format!("wide-{}", i + 1), camera: camera(i, n_cameras, size_m) });
    let [x, y, z] = size_m;
    Calibration::new(
        cameras.collect(),
        LengthUnit::Metre,
        format!("{n_cameras} simulated cameras around a hall of {x} x {y} x {z} m"),
    )
}

fn camera(i: usize, n: usize, [width, depth, height]: [f64; 3]) -> Camera {
    let half = [width, depth].map(|it| it / 2.0 - FROM_WALL_M);
    let around = 4.0 * (half[0] + half[1]);
    let room_for_rows = ((height * (1.0 - LOWEST)) / ROW_M).floor().max(1.0) as usize;
    let wanted = (n as f64 * LEAST_DISTANCE_M / around).ceil().max(1.0) as usize;
    let n_rows = wanted.min(room_for_rows);
    // Cameras go around once; rows take turns, so that all rows are filled evenly.
    let centre = on_wall(around * (i as f64 + 0.5) / n as f64, half, height - 0.2 - ROW_M * (i % n_rows) as f64);
    // A low-discrepancy sequence over the middle (M. Roberts' R2): any run of cameras looks everywhere.
    let [u, v] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_2].map(|step| (0.5 + step * (i + 1) as f64).fract());
    let aim = Point3::new((u - 0.5) * width * 0.5, (v - 0.5) * depth * 0.5, 1.0);
    let mut camera = Camera::look_at(centre, aim, FIELD_SIZE, FOCAL);
    camera.intrinsics.focal[1] = FOCAL / 2.0;
    camera.distortion = Distortion { k1: -0.11, k2: 0.019, ..Distortion::default() };
    camera
}

/// The point `way` along the walls, from the corner at −x, −y towards +x [m].
fn on_wall(way: f64, [x, y]: [f64; 2], z: f64) -> Point3<f64> {
    let sides = [2.0 * x, 2.0 * y, 2.0 * x];
    match way {
        way if way < sides[0] => Point3::new(way - x, -y, z),
        way if way < sides[0] + sides[1] => Point3::new(x, way - sides[0] - y, z),
        way if way < 2.0 * sides[0] + sides[1] => Point3::new(x - (way - sides[0] - sides[1]), y, z),
        way => Point3::new(-x, y - (way - 2.0 * sides[0] - sides[1]), z),
    }
}

#[cfg(test)]
mod tests {
    use foveate_testkit::{check_camera_model, golden};

    use super::*;
    use crate::lab::coverage;

    #[test]
    fn halls_of_all_sizes_are_seen_from_all_sides() {
        for (n, size, fewest) in [
            (18, [6.0, 7.8, 3.0], 5),
            (64, [12.0, 9.0, 4.0], 14),
            (200, [20.0, 15.0, 6.0], 40),
            (1000, [40.0, 25.0, 8.0], 120),
        ] {
            let calibration = hall_calibration(n, size).unwrap();
            let cameras: Vec<Camera> = calibration.cameras.into_iter().map(|it| it.camera).collect();
            assert_eq!(cameras.len(), n);
            cameras.iter().step_by(n / 9).for_each(check_camera_model);
            let half = [size[0] * 0.35, size[1] * 0.35];
            let volume = [[-half[0], -half[1], 0.3], [half[0], half[1], 2.0]];
            let found = coverage(&cameras, volume, 0.5);
            assert!(found.fewest >= fewest, "{n} cameras: {found:?}");
            let heights = cameras.iter().map(|it| it.centre().z);
            assert!(heights.clone().all(|it| (0.5 * size[2]..size[2]).contains(&it)));
            for camera in &cameras {
                let centre = camera.centre();
                assert!((0..2).all(|axis| centre[axis].abs() < size[axis] / 2.0), "{centre}");
            }
        }
    }

    #[test]
    fn no_camera_is_an_error() {
        assert!(hall_calibration(0, [6.0, 6.0, 3.0]).is_err());
    }

    #[test]
    fn committed_calibration_of_the_crowd_is_this_hall() {
        let hall = hall_calibration(64, [12.0, 9.0, 4.0]).unwrap();
        golden::check("graphs/crowd.calibration.toml", &hall.to_toml());
    }
}
