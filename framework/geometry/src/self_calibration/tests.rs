//! Rooms of known truth found from nothing, and every way in which a waved light can fail to tell where cameras are.

use nalgebra::Vector2;

use super::*;
use crate::alignment::{AlignmentOptions, camera_errors};
use crate::test_room;

/// What cameras see of the path: `views` of them at each point.
fn observations(
    cameras: &[Camera],
    path: &[Point3<f64>],
    views: usize,
    sigma: f64,
    seed: u64,
) -> Vec<LightObservation> {
    let all = test_room::observations(cameras, path, views, sigma, &mut Random::new(seed));
    all.iter().map(|it| LightObservation { camera: it.camera, frame: it.point, pixel: it.pixel }).collect()
}

/// Every `every`th observation becomes a reflection somewhere else.
fn spoil(observations: &mut [LightObservation], share: f64, seed: u64) {
    let mut random = Random::new(seed);
    for observation in observations {
        if random.uniform() < share {
            observation.pixel = Point2::new(random.uniform_in(0.0, 639.0), random.uniform_in(0.0, 479.0));
        }
    }
}

/// Root mean square and greatest error of the centres of calibrated cameras after alignment [m].
fn centre_errors(found: &SelfCalibration, truth: &[Camera]) -> [f64; 2] {
    let known: Vec<usize> = (0..truth.len()).filter(|it| found.status[*it] == CameraStatus::Calibrated).collect();
    let of = |list: &[Camera]| known.iter().map(|it| list[*it].clone()).collect::<Vec<_>>();
    let options = AlignmentOptions { scale: true, robust: false };
    let errors = camera_errors(&of(&found.cameras), &of(truth), options).unwrap().centres;
    let squares: f64 = errors.iter().map(|it| it * it).sum();
    [(squares / errors.len() as f64).sqrt(), errors.iter().fold(0.0, |worst: f64, it| worst.max(*it))]
}

fn known(cameras: &[Camera]) -> Vec<Freedom> {
    vec![Freedom::POSE; cameras.len()]
}

fn focal_free(cameras: &[Camera]) -> Vec<Freedom> {
    vec![Freedom { focal: true, ..Freedom::POSE }; cameras.len()]
}

#[track_caller]
fn all_calibrated(found: &SelfCalibration) {
    for (camera, status) in found.status.iter().enumerate() {
        assert_eq!(*status, CameraStatus::Calibrated, "camera {camera}: {status}");
    }
}

fn calibrated(cameras: &[Camera], observations: &[LightObservation]) -> SelfCalibration {
    self_calibrate(cameras, &known(cameras), observations, &SelfCalibrationOptions::default()).unwrap()
}

#[test]
fn a_room_is_found_when_each_point_is_seen_by_4_of_18() {
    for seed in 0..3 {
        let truth = test_room::cameras(18, seed + 1);
        let seen = observations(&truth, &test_room::path(600), 4, 0.5, seed);
        let found = calibrated(&truth, &seen);
        all_calibrated(&found);
        let [rms, worst] = centre_errors(&found, &truth);
        assert!(rms < 4e-3 && worst < 10e-3, "{seed}: {rms} {worst}");
        assert!((0.5..0.66).contains(&found.rms_px), "{}", found.rms_px);
        assert!(found.covariance.iter().all(|it| it.is_some()) && found.flatness > 0.1);
        assert!(found.right.iter().filter(|it| **it).count() > seen.len() * 98 / 100);
    }
}

#[test]
fn wrong_observations_in_three_of_ten_are_seen_through() {
    let truth = test_room::cameras(18, 2);
    // Of all observations, each point seen by 8; then in frames, each point seen by 4, one of them wrong.
    let mut seen = observations(&truth, &test_room::path(600), 8, 0.5, 4);
    spoil(&mut seen, 0.3, 5);
    let found = calibrated(&truth, &seen);
    all_calibrated(&found);
    let [rms, _] = centre_errors(&found, &truth);
    assert!(rms < 4e-3, "{rms}");
    let mut seen = observations(&truth, &test_room::path(600), 4, 0.5, 6);
    for observation in seen.iter_mut().step_by(4).filter(|it| it.frame % 10 < 3) {
        observation.pixel = Point2::new(639.0 - observation.pixel.x, 479.0 - 0.5 * observation.pixel.y);
    }
    let found = calibrated(&truth, &seen);
    all_calibrated(&found);
    let [rms, _] = centre_errors(&found, &truth);
    assert!(rms < 6e-3, "{rms}");
}

#[test]
fn lenses_and_frames_given_twice_do_no_harm() {
    let mut truth = test_room::cameras(8, 3);
    truth.iter_mut().for_each(|it| it.distortion = test_room::lens());
    let mut seen = observations(&truth, &test_room::path(200), 4, 0.3, 7);
    let again: Vec<LightObservation> =
        seen.iter().map(|it| LightObservation { frame: it.frame + 200, ..*it }).collect();
    seen.extend(again);
    let found = calibrated(&truth, &seen);
    all_calibrated(&found);
    assert!(centre_errors(&found, &truth)[0] < 6e-3, "{:?}", centre_errors(&found, &truth));
}

#[test]
fn the_same_input_gives_the_same_bytes() {
    let truth = test_room::cameras(6, 3);
    let mut seen = observations(&truth, &test_room::path(150), 4, 0.5, 7);
    spoil(&mut seen, 0.1, 8);
    assert_eq!(calibrated(&truth, &seen), calibrated(&truth, &seen));
}

#[test]
fn a_focal_length_that_was_guessed_is_refined() {
    for guess in [0.85, 1.15] {
        let truth = test_room::cameras(10, 4);
        let seen = observations(&truth, &test_room::path(400), 6, 0.5, 9);
        let mut guessed = truth.clone();
        guessed.iter_mut().for_each(|it| it.intrinsics.focal = [guess * 420.0; 2]);
        let found = self_calibrate(&guessed, &focal_free(&guessed), &seen, &SelfCalibrationOptions::default()).unwrap();
        all_calibrated(&found);
        for (camera, covariance) in found.cameras.iter().zip(&found.covariance) {
            let error = camera.intrinsics.focal[0] / 420.0 - 1.0;
            let sigma = covariance.as_ref().unwrap().optics.focal;
            assert!(error.abs() < 0.01 && error.abs() < 5.0 * sigma, "{error} {sigma}");
        }
        assert!(centre_errors(&found, &truth)[0] < 10e-3, "{:?}", centre_errors(&found, &truth));
    }
}

#[test]
fn a_path_in_a_plane_calibrates_known_optics_and_refuses_free_ones() {
    let truth = test_room::cameras(8, 4);
    let flat: Vec<Point3<f64>> = test_room::path(300).iter().map(|it| Point3::new(it.x, it.y, 1.0)).collect();
    let seen = observations(&truth, &flat, 6, 0.5, 10);
    let found = calibrated(&truth, &seen);
    all_calibrated(&found);
    assert!(found.flatness < 0.01, "{}", found.flatness);
    assert!(found.links.iter().all(|it| it.planar_share > 0.9), "{:?}", found.links);
    assert!(centre_errors(&found, &truth)[0] < 20e-3, "{:?}", centre_errors(&found, &truth));
    let far: Vec<Point3<f64>> =
        test_room::path(300).iter().map(|it| Point3::new(0.1 * it.x, 0.1 * it.y, 1.0 + 0.1 * it.z)).collect();
    let seen = observations(&truth, &far, 6, 0.5, 11);
    let refused = self_calibrate(&truth, &focal_free(&truth), &seen, &SelfCalibrationOptions::default());
    let status = match refused {
        Err(SelfCalibrationError::NothingCalibrated { status }) => status,
        Ok(found) => found.status,
        Err(fault) => panic!("{fault}"),
    };
    let open = status.iter().filter(|it| matches!(it, CameraStatus::FocalOpen { .. })).count();
    assert!(open >= 6 && !status.contains(&CameraStatus::Calibrated), "{status:?}");
}

#[test]
fn cameras_that_cannot_be_calibrated_say_why_and_leave_the_others_alone() {
    let truth = test_room::cameras(12, 5);
    let mut seen = observations(&truth, &test_room::path(600), 7, 0.5, 12);
    seen.retain(|it| it.camera != 3 || it.frame < 12); // sees next to nothing
    for observation in seen.iter_mut() {
        let jitter =
            Vector2::new(f64::from(observation.frame as u32 % 7), f64::from(observation.frame as u32 % 3)) * 0.1;
        match observation.camera {
            5 => observation.pixel = Point2::new(320.0, 200.0) + jitter, // a lamp, not the light
            8 => observation.pixel = Point2::new(639.0 - observation.pixel.x, observation.pixel.y), // mirrored
            _ => {}
        }
    }
    let found = calibrated(&truth, &seen);
    assert!(
        matches!(found.status[3], CameraStatus::TooFewObservations { .. } | CameraStatus::NoPartner { .. }),
        "{}",
        found.status[3]
    );
    assert!(matches!(found.status[5], CameraStatus::LightStill { .. }), "{}", found.status[5]);
    assert!(matches!(found.status[8], CameraStatus::Inconsistent { .. }), "{}", found.status[8]);
    for camera in (0..12).filter(|it| ![3, 5, 8].contains(it)) {
        assert_eq!(found.status[camera], CameraStatus::Calibrated, "camera {camera}: {}", found.status[camera]);
    }
    assert!(centre_errors(&found, &truth)[0] < 5e-3, "{:?}", centre_errors(&found, &truth));
    assert_eq!(found.cameras[8], truth[8]); // as given
    assert!(
        found.residuals.iter().zip(&seen).all(|(residual, it)| residual.is_none() || ![3, 5, 8].contains(&it.camera))
    );
}

#[test]
fn of_two_groups_that_share_no_frames_the_larger_is_calibrated() {
    let truth = test_room::cameras(9, 6);
    let mut seen = observations(&truth, &test_room::path(400), 9, 0.3, 13);
    seen.retain(|it| (it.camera < 3) == (it.frame < 150));
    let found = calibrated(&truth, &seen);
    for camera in 0..9 {
        let expected = match camera {
            0..3 => CameraStatus::Separate { group: vec![0, 1, 2] },
            _ => CameraStatus::Calibrated,
        };
        assert_eq!(found.status[camera], expected, "{}", found.status[camera]);
    }
    assert!(found.status[0].sentence(|it| format!("c{it}")).contains("c0, c1, c2"));
}

#[test]
fn swapped_cameras_of_one_kind_swap_their_poses_only() {
    let truth = test_room::cameras(6, 7);
    let mut seen = observations(&truth, &test_room::path(200), 5, 0.3, 14);
    for observation in &mut seen {
        observation.camera = [1, 0, 2, 3, 4, 5][observation.camera];
    }
    let found = calibrated(&truth, &seen);
    all_calibrated(&found);
    let mut swapped = truth.clone();
    swapped.swap(0, 1);
    assert!(centre_errors(&found, &swapped)[0] < 5e-3 && centre_errors(&found, &truth)[0] > 0.1);
}

#[test]
fn where_nothing_can_be_calibrated_each_camera_says_why() {
    let truth = test_room::cameras(5, 8);
    let status = |path: &[Point3<f64>], change: fn(&LightObservation) -> bool| {
        let mut seen = observations(&truth, path, 5, 0.5, 15);
        seen.retain(change);
        match self_calibrate(&truth, &known(&truth), &seen, &SelfCalibrationOptions::default()) {
            Err(SelfCalibrationError::NothingCalibrated { status }) => status,
            other => panic!("{other:?}"),
        }
    };
    let still = status(&[Point3::new(0.1, 0.2, 1.0); 100], |_| true);
    assert!(still.iter().all(|it| matches!(it, CameraStatus::LightStill { .. })), "{still:?}");
    let line: Vec<Point3<f64>> = (0..100).map(|it| Point3::new(0.01 * f64::from(it) - 0.5, 0.3, 1.0)).collect();
    let on_line = status(&line, |_| true);
    assert!(on_line.iter().all(|it| matches!(it, CameraStatus::LightStill { .. })), "{on_line:?}");
    let path = test_room::path(200);
    let alone = status(&path, |it| it.frame % 5 == it.camera);
    assert!(alone.iter().all(|it| matches!(it, CameraStatus::NoPartner { best: None, .. })), "{alone:?}");
    let none = status(&path, |_| false);
    assert!(none.iter().all(|it| matches!(it, CameraStatus::TooFewObservations { frames: 0, .. })), "{none:?}");
}

#[test]
fn bad_input_is_refused_by_place() {
    let truth = test_room::cameras(4, 9);
    let seen = observations(&truth, &test_room::path(60), 4, 0.5, 16);
    let options = SelfCalibrationOptions::default();
    let refused = |cameras: &[Camera], seen: &[LightObservation], options: &SelfCalibrationOptions| {
        self_calibrate(cameras, &known(cameras), seen, options).unwrap_err()
    };
    assert_eq!(refused(&truth[..1], &[], &options), SelfCalibrationError::TooFewCameras { count: 1 });
    let with = |change: fn(&mut LightObservation)| {
        let mut broken = seen.clone();
        change(&mut broken[9]);
        refused(&truth, &broken, &options)
    };
    assert!(matches!(with(|it| it.pixel.y = f64::NAN), SelfCalibrationError::BadObservation { observation: 9, .. }));
    assert!(matches!(with(|it| it.camera = 4), SelfCalibrationError::BadObservation { camera: 4, cameras: 4, .. }));
    let mut twice = seen.clone();
    twice.push(seen[7]);
    let fault = SelfCalibrationError::SeenTwice { camera: seen[7].camera, frame: seen[7].frame };
    assert_eq!(refused(&truth, &twice, &options), fault);
    let fewer = self_calibrate(&truth, &[Freedom::POSE; 3], &seen, &options).unwrap_err();
    assert_eq!(fewer, SelfCalibrationError::LengthsDiffer { cameras: 4, freedoms: 3 });
    let bad = SelfCalibrationOptions { inlier_px: f64::NAN, ..options };
    assert!(matches!(refused(&truth, &seen, &bad), SelfCalibrationError::BadOption { option: "inlier_px", .. }));
    let mut cameras = truth.clone();
    cameras[2].intrinsics.focal[1] = f64::NAN;
    assert!(matches!(refused(&cameras, &seen, &options), SelfCalibrationError::BadCamera { camera: 2, .. }));
}

const ALL_OPTICS: Freedom =
    Freedom { focal: true, principal: true, k1: true, k2: true, decentering: true, ..Freedom::POSE };

#[test]
fn a_lens_that_nobody_knows_is_found_where_the_light_was_everywhere() {
    let mut truth = test_room::cameras(10, 4);
    for camera in &mut truth {
        camera.distortion = test_room::lens();
        camera.intrinsics.principal = [326.0, 233.0];
    }
    let seen = observations(&truth, &test_room::path(600), 7, 0.3, 21);
    let mut given = truth.clone();
    for camera in &mut given {
        camera.distortion = Default::default();
        camera.intrinsics.principal = [319.5, 239.5];
        camera.intrinsics.focal = [460.0; 2];
    }
    let found = self_calibrate(&given, &[ALL_OPTICS; 10], &seen, &SelfCalibrationOptions::default()).unwrap();
    all_calibrated(&found);
    assert!(centre_errors(&found, &truth)[0] < 20e-3, "{:?}", centre_errors(&found, &truth));
    for (index, camera) in found.cameras.iter().enumerate() {
        let sigma = found.covariance[index].as_ref().unwrap().optics;
        assert!(found.freed[index].k1 && found.freed[index].principal, "{index}: {:?}", found.held[index]);
        let focal = camera.intrinsics.focal[0] / 420.0 - 1.0;
        assert!(focal.abs() < 0.01 && focal.abs() < 5.0 * sigma.focal, "{index}: {focal} {sigma:?}");
        let principal = camera.intrinsics.principal[0] - 326.0;
        assert!(principal.abs() < 5.0 * sigma.principal[0], "{index}: {principal} {sigma:?}");
        assert!((camera.distortion.k1 + 0.2).abs() < 5.0 * sigma.radial[0], "{index}: {:?}", camera.distortion);
    }
}

#[test]
fn optics_that_the_observations_do_not_hold_stay_within_reason() {
    // Seen near the middle of each picture only, k2 and k3 do nothing that could be seen.
    let truth = test_room::cameras(8, 4);
    let mut seen = observations(&truth, &test_room::path(600), 8, 0.5, 22);
    seen.retain(|it| (it.pixel - Point2::new(319.5, 239.5)).norm() < 110.0);
    let free = [Freedom { k1: true, k2: true, k3: true, ..Freedom::POSE }; 8];
    let found = self_calibrate(&truth, &free, &seen, &SelfCalibrationOptions::default()).unwrap();
    all_calibrated(&found);
    for (index, camera) in found.cameras.iter().enumerate() {
        let sigma = found.covariance[index].as_ref().unwrap().optics.radial;
        assert!(
            (0.25..0.31).contains(&sigma[2]) && camera.distortion.k3.abs() < 0.1,
            "{index}: {:?}",
            camera.distortion
        );
        assert!(camera.distortion.k1.abs() < 4.0 * sigma[0], "{index}: {:?} {sigma:?}", camera.distortion);
    }
}

#[test]
fn optics_that_predict_worse_than_those_given_are_given_back_and_the_focal_length_is_not() {
    // Lenses without distortion, each point seen by three: with some fifty observations of a camera a free lens follows their noise.
    let mut given_back = 0;
    for seed in 37..40 {
        let truth = test_room::cameras(6, 4);
        let seen = observations(&truth, &test_room::path(100), 3, 1.0, seed);
        let mut given = truth.clone();
        given.iter_mut().for_each(|it| it.intrinsics.focal = [400.0; 2]);
        let free = [Freedom { k3: true, ..ALL_OPTICS }; 6];
        let found = self_calibrate(&given, &free, &seen, &SelfCalibrationOptions::default()).unwrap();
        all_calibrated(&found);
        for (index, held) in found.held.iter().enumerate().filter(|it| !it.1.is_empty()) {
            given_back += 1;
            for it in held {
                let HeldReason::HoldOut { held_px, freed_px } = it.reason else { panic!("{index}: {it}") };
                assert!(freed_px > 1.05 * held_px && held_px > 0.5, "{index}: {it}");
            }
            assert_eq!(found.freed[index], Freedom { focal: true, ..Freedom::POSE }, "{index}");
            let camera = &found.cameras[index];
            assert_eq!(camera.distortion, given[index].distortion, "{index}");
            assert_eq!(camera.intrinsics.principal, given[index].intrinsics.principal, "{index}");
            let (error, sigma) =
                (camera.intrinsics.focal[0] / 420.0 - 1.0, found.covariance[index].as_ref().unwrap().optics.focal);
            assert!(error.abs() < 5.0 * sigma && (1e-4..0.05).contains(&sigma), "{index}: {error} {sigma}");
        }
    }
    assert!(given_back >= 6, "{given_back} of 18");
}
