//! The simulated laboratory: its room, its wide cameras, and how well these cover the volume.

mod arrangement;
mod coverage;
mod hall;

use foveate_geometry::{Camera, Distortion};
use foveate_scene::calibration::{Calibration, LengthUnit, NamedCamera};

pub use arrangement::{FIELD_SIZE, N_CAMERAS, ROOM_M, VOLUME_M, wide_cameras};
pub use coverage::{Coverage, coverage};
pub use hall::hall_calibration;

/// The wide cameras of the lab as a calibration; camera `wide-1` has number 0, and so on.
pub fn lab_calibration() -> Calibration {
    let cameras = wide_cameras().into_iter().map(|(name, camera)| NamedCamera { name, camera }).collect();
    let origin = "the simulated lab as it was planned, for rigs in which it is so: calibration and truth are one";
    match Calibration::new(cameras, LengthUnit::Metre, origin.to_owned()) {
        Ok(calibration) => calibration,
        Err(error) => unreachable!("the lab's cameras are constants, and a test checks them: {error}"),
    }
}

/// Three cameras in a line before the arm of a studio, `left`, `centre` and `right` [D'Apuzzo 1999, Fig. 2], 40 cm apart, half a millimetre a pixel at the arm.
pub fn arm_calibration() -> Calibration {
    let camera = |(name, x): (&str, f64)| {
        let mut camera = Camera::look_at([x, -1.5, 1.25].into(), [0.0, 0.0, 1.20].into(), [1280, 960], 3000.0);
        camera.distortion = Distortion { k1: -0.08, k2: 0.05, ..Distortion::default() };
        NamedCamera { name: name.to_owned(), camera }
    };
    let cameras = [("left", -0.4), ("centre", 0.0), ("right", 0.4)].map(camera).into();
    match Calibration::new(cameras, LengthUnit::Metre, "three simulated cameras before an arm".to_owned()) {
        Ok(calibration) => calibration,
        Err(error) => unreachable!("these cameras are constants, and a test checks them: {error}"),
    }
}

#[cfg(test)]
mod tests {
    use foveate_testkit::{check_camera_model, golden};

    use super::*;

    fn cameras() -> Vec<foveate_geometry::Camera> {
        wide_cameras().into_iter().map(|(_, camera)| camera).collect()
    }

    #[test]
    fn cameras_hang_near_the_ceiling_inside_the_room() {
        assert_eq!(N_CAMERAS, 18);
        for camera in cameras() {
            let centre = camera.centre();
            assert!((2.5..=2.9).contains(&centre.z), "{centre}");
            let [min, max] = ROOM_M;
            assert!((0..2).all(|axis| min[axis] < centre[axis] && centre[axis] < max[axis]), "{centre}");
            check_camera_model(&camera);
        }
    }

    #[test]
    fn every_point_of_the_volume_is_seen_by_many() {
        let found = coverage(&cameras(), VOLUME_M, 0.125);
        assert!(found.fewest >= 8 && found.mean >= 15.5, "{found:?}");
    }

    #[test]
    fn resolution_is_better_before_the_display() {
        // Square pixels per square metre that all cameras together spend on a small sphere there.
        let spent = |y: f64| -> f64 {
            let point = nalgebra::Point3::new(0.0, y, 1.2);
            let seeing = cameras().into_iter().filter(|it| it.sees(&point).is_some());
            seeing.map(|it| (it.intrinsics.focal[0] / (point - it.centre()).norm()).powi(2)).sum()
        };
        assert!(spent(1.5) > 1.2 * spent(-1.5), "{} {}", spent(1.5), spent(-1.5));
    }

    #[test]
    fn committed_calibration_is_the_lab() {
        golden::check("graphs/ideal_lab.calibration.toml", &lab_calibration().to_toml());
    }

    #[test]
    fn committed_calibration_of_the_arms_cameras_is_theirs() {
        golden::check("graphs/arm.calibration.toml", &arm_calibration().to_toml());
    }

    /// The lab's cameras, named by what the rig makes of them.
    #[test]
    fn committed_calibration_of_the_unsynchronised_rig_is_the_lab_under_other_names() {
        let name = |i: usize| match i {
            3 | 8 | 12 | 16 => format!("half-{}", i + 1),
            5 | 14 => format!("slow-{}", i + 1),
            10 => format!("frail-{}", i + 1),
            _ => format!("full-{}", i + 1),
        };
        let cameras = cameras().into_iter().enumerate().map(|(i, camera)| NamedCamera { name: name(i), camera });
        let origin = "the simulated lab, its cameras named by their rates".to_owned();
        let renamed = Calibration::new(cameras.collect(), LengthUnit::Metre, origin).unwrap();
        golden::check("graphs/unsynchronised.calibration.toml", &renamed.to_toml());
    }
}
