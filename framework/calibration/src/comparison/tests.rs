//! Rooms laid over each other: displaced, mirrored, exchanged.

use foveate_geometry::bundle::Freedom;
use foveate_scene::NamedCamera;
use nalgebra::Translation3;

use super::*;
use crate::solved::SolvedCamera;

fn camera(index: usize) -> Camera {
    let angle = 1.1 * index as f64;
    let centre = Point3::new(3.0 * angle.cos(), 3.0 * angle.sin(), 2.0 + 0.2 * (index % 5) as f64);
    Camera::look_at(centre, Point3::new(0.0, 0.0, 1.0), [640, 480], 500.0)
}

/// The first `n` cameras in a world of another scale, turn and origin, with errors of `noise`; and where they are.
fn rooms(n: usize, noise: f64) -> (Solved, Calibration) {
    let mut random = foveate_estimation::Random::new(n as u64);
    let other = Isometry3::new(Vector3::new(4.0, 5.0, 6.0), Vector3::new(0.3, 0.2, 2.0));
    let solved_camera = |index: usize| {
        let mut camera = camera(index);
        let mut small = || noise * random.normal();
        camera.camera_from_world *=
            Isometry3::new(Vector3::new(small(), small(), small()), Vector3::new(small(), small(), small()) / 3.0);
        camera.camera_from_world *= other;
        camera.camera_from_world.translation.vector *= 0.25;
        SolvedCamera {
            name: format!("wide-{index}"),
            camera,
            status: CameraStatus::Calibrated,
            freed: Freedom::POSE,
            prior: None,
            covariance: None,
            clock: None,
        }
    };
    let solved = Solved { cameras: (0..n).map(solved_camera).collect(), ..Solved::default() };
    let named = (0..n).map(|it| NamedCamera { name: format!("wide-{it}"), camera: camera(it) });
    (solved, Calibration::new(named.collect(), LengthUnit::Metre, String::new()).unwrap())
}

#[test]
fn one_bad_camera_of_few_or_many_does_not_spoil_the_others() {
    let displaced = |it: &mut Camera| it.camera_from_world *= Translation3::new(0.3, -0.1, 0.05);
    let turned = |it: &mut Camera| {
        let turn = UnitQuaternion::from_euler_angles(0.05, 0.3, 0.1);
        it.camera_from_world = Isometry3::from_parts(Translation3::identity(), turn) * it.camera_from_world;
    };
    // A mirrored picture makes a camera that looks the other way from another place.
    let mirrored = |it: &mut Camera| {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 2.0);
        it.camera_from_world *= Isometry3::from_parts(Translation3::new(0.2, 0.4, -0.3), turn);
    };
    type Fault<'a> = (&'a str, &'a dyn Fn(&mut Camera));
    let faults: [Fault<'_>; 3] = [("displaced", &displaced), ("turned", &turned), ("mirrored", &mirrored)];
    for n in [3, 4, 5, 6, 18] {
        for (fault, change) in faults {
            for bad in [0, n / 2, n - 1] {
                let (mut solved, other) = rooms(n, 2e-4);
                change(&mut solved.cameras[bad].camera);
                let found = compare(&solved, &other).unwrap();
                let case =
                    format!("{fault} camera {bad} of {n}: {:.1?} mm, {:.1?} mrad", found.centres, found.turns_mrad);
                for index in 0..n {
                    let is_near = found.centres[index] < 5.0 && found.turns_mrad[index] < 2.0;
                    assert_eq!((is_near, found.agrees[index]), (index != bad, index != bad), "{case}");
                }
                assert!((found.scale() - 4.0).abs() < 0.02, "{case}: {}", found.scale());
                assert!(found.describe("t.toml").contains("elsewhere"), "{case}");
            }
        }
    }
}

#[test]
fn mirror_images_and_exchanged_names_are_named() {
    for n in [3, 4, 6] {
        for flip in [Vector3::new(-1.0, 1.0, 1.0), Vector3::new(1.0, -1.0, 1.0)] {
            let (mut solved, other) = rooms(n, 1e-3);
            solved.cameras.iter_mut().for_each(|it| it.camera = mirror_image(&it.camera, &flip));
            let found = compare(&solved, &other).unwrap();
            assert!(found.is_mirrored() && found.exchanged().is_none(), "{n}: {}", found.describe("t.toml"));
            assert!(found.describe("t.toml").contains("mirror"));
            assert!(found.centres.iter().all(|it| *it < 10.0), "{:?}", found.centres);
        }
        for [a, b] in [[0, 1], [0, n - 1], [1, 2]] {
            let (mut solved, other) = rooms(n, 1e-3);
            let first = solved.cameras[a].camera.clone();
            solved.cameras[a].camera = std::mem::replace(&mut solved.cameras[b].camera, first);
            let found = compare(&solved, &other).unwrap();
            let names = [format!("wide-{a}"), format!("wide-{b}")];
            assert_eq!(found.exchanged(), Some(&names), "{}", found.describe("t.toml"));
            assert!(!found.is_mirrored());
        }
        let (solved, other) = rooms(n, 1e-3);
        let found = compare(&solved, &other).unwrap();
        assert!(!found.is_mirrored() && found.exchanged().is_none());
    }
}

#[test]
fn a_third_camera_may_be_off_by_a_hundredth() {
    let (mut solved, other) = rooms(3, 1e-4);
    solved.cameras[0].camera.camera_from_world *= Translation3::new(0.03, 0.02, 0.0);
    let found = compare(&solved, &other).unwrap();
    assert!(found.agrees.iter().all(|it| *it), "{}", found.describe("t.toml"));
}

#[test]
fn cameras_that_all_agree_are_as_near_as_their_noise() {
    for n in [2, 3, 7] {
        let (solved, other) = rooms(n, 1e-3);
        let found = compare(&solved, &other).unwrap();
        assert!(found.agrees.iter().all(|it| *it) && found.centres.iter().all(|it| *it < 6.0), "{:?}", found.centres);
        let text = found.describe("t.toml");
        assert!(text.contains("+0.00 %") && !text.contains("elsewhere"), "{text}");
        assert_eq!(text.contains("two cameras"), n == 2);
    }
}

#[test]
fn of_two_calibrations_in_metres_that_of_equal_metres_is_right() {
    // Displaced along the line to the first: that pair alone would fit with another length of the metre.
    let (mut solved, other) = rooms(3, 0.0);
    for it in &mut solved.cameras {
        it.camera.camera_from_world.translation.vector *= 4.0;
    }
    solved.fixed.scale = Some(foveate_scene::Fixed { by: "a wand".into(), sigma: None });
    let away = solved.cameras[2].camera.centre() - solved.cameras[0].camera.centre();
    solved.cameras[2].camera.camera_from_world *= Translation3::from(-0.4 * away);
    let found = compare(&solved, &other).unwrap();
    assert_eq!(found.agrees, [true, true, false], "{:?}", found.centres);
}

#[test]
fn without_common_names_both_lists_are_named() {
    let (solved, mut other) = rooms(3, 0.0);
    other.cameras.iter_mut().for_each(|it| it.name = format!("cam{}", &it.name[5..]));
    let fault = compare(&solved, &other).unwrap_err();
    assert!(fault.contains("wide-0, wide-1, wide-2") && fault.contains("cam0, cam1, cam2"), "{fault}");
    // Sorted by name, as calibrations are.
    other.cameras[2].name = "wide-1".into();
    let fault = compare(&solved, &other).unwrap_err();
    assert!(fault.starts_with("only wide-1 ") && fault.contains("wide-0, wide-1, wide-2"), "{fault}");
    let (mut solved, other) = rooms(3, 0.0);
    let first = solved.cameras[0].camera.clone();
    solved.cameras.iter_mut().for_each(|it| it.camera.camera_from_world = first.camera_from_world);
    let fault = compare(&solved, &other).unwrap_err();
    assert!(fault.contains("wide-0, wide-1, wide-2") && !fault.contains("expected at least"), "{fault}");
}
