//! Rooms of known cameras, recorded with all that spoils a recording.

use foveate_estimation::Random;
use foveate_geometry::bundle::Freedom;
use foveate_geometry::{AlignmentOptions, Camera, CameraStatus, camera_errors};
use foveate_scene::Calibration;
use nalgebra::{Isometry3, Point2, Point3, UnitQuaternion, Vector2, Vector3, point};

use super::*;
use crate::recording::{CameraFrame, CameraGuess, Recording, Spot};
use crate::solved::{FixedFreedoms, ObservationRole};

const N_FRAMES: usize = 300;
const RATE_HZ: f64 = 30.0;

fn ring(n: usize) -> Vec<Camera> {
    let camera = |index: usize| {
        let angle = index as f64 / n as f64 * std::f64::consts::TAU;
        let height = 2.2 + 0.4 * (index % 3) as f64;
        let centre = point![3.2 * angle.cos(), 2.8 * angle.sin(), height];
        Camera::look_at(centre, point![0.1 * index as f64 / n as f64, 0.0, 1.0], [640, 480], 520.0)
    };
    (0..n).map(camera).collect()
}

/// Where the light is at `time_s`: all about the room.
fn path(time_s: f64) -> Point3<f64> {
    let (a, b, c) = (1.7 * time_s, 2.3 * time_s + 1.0, 3.1 * time_s + 0.5);
    point![1.1 * a.sin(), 0.9 * b.sin(), 1.1 + 0.7 * c.sin()]
}

fn spot(pixel: Point2<f64>, peak: f64) -> Spot {
    Spot { pixel, sigma_px: 0.5, peak, label: None }
}

/// What `cameras` see of the light, with 0.3 px of noise.
fn recorded(cameras: &[Camera], free: Freedom, seed: u64) -> Recording {
    let mut random = Random::new(seed);
    let mut camera_frames = Vec::new();
    for frame in 0..N_FRAMES {
        let time_s = frame as f64 / RATE_HZ;
        for (index, camera) in cameras.iter().enumerate() {
            let noise = 0.3 * Vector2::new(random.normal(), random.normal());
            let seen = camera.sees(&path(time_s)).map(|it| spot(it + noise, 200.0));
            camera_frames.push(CameraFrame { camera: index, time_s, spots: seen.into_iter().collect() });
        }
    }
    let guess = |(index, camera): (usize, &Camera)| CameraGuess {
        name: format!("wide-{}", index + 1),
        camera: Camera { camera_from_world: Isometry3::identity(), ..camera.clone() },
        free,
    };
    Recording { cameras: cameras.iter().enumerate().map(guess).collect(), camera_frames }
}

/// Largest distance of a centre from the truth [mm].
#[track_caller]
fn worst_mm(found: &SolvedNetwork, truth: &[Camera]) -> f64 {
    let known = |it: &usize| found.solved.cameras[*it].status == CameraStatus::Calibrated;
    let known: Vec<usize> = (0..truth.len()).filter(known).collect();
    let list = |of: &dyn Fn(usize) -> Camera| -> Vec<Camera> { known.iter().map(|it| of(*it)).collect() };
    let options = AlignmentOptions { scale: true, robust: false };
    let errors =
        camera_errors(&list(&|it| found.solved.cameras[it].camera.clone()), &list(&|it| truth[it].clone()), options);
    1e3 * errors.unwrap().centres.into_iter().fold(0.0, f64::max)
}

#[test]
fn room_is_found_with_its_noise_and_what_was_held_out_fits_as_well() {
    let truth = ring(6);
    let found = from_nothing(&recorded(&truth, Freedom::POSE, 1), CalibrationTarget::Light, &NetworkOptions::default())
        .unwrap();
    assert!(worst_mm(&found, &truth) < 3.0, "{} mm", worst_mm(&found, &truth));
    assert!((0.28..0.32).contains(&found.sigma_px), "{} px", found.sigma_px);
    let lengths = |role| -> Vec<f64> {
        let of = found.solved.observations.iter().filter(|it| it.role == role);
        of.filter_map(|it| Some(it.residual?.norm())).collect()
    };
    let (used, kept) = (lengths(ObservationRole::Used), lengths(ObservationRole::HeldOut));
    assert!((kept.len() as f64 / used.len() as f64 - 1.0 / 9.0).abs() < 0.05);
    let median = |list: &[f64]| foveate_estimation::statistics::median(list).unwrap();
    assert!((0.8..1.3).contains(&(median(&kept) / median(&used))));
}

#[test]
fn errors_of_centres_are_as_large_as_stated() {
    let truth = ring(6);
    let (mut squares, mut n) = (0.0, 0);
    for seed in 0..5 {
        let found =
            from_nothing(&recorded(&truth, Freedom::POSE, seed), CalibrationTarget::Light, &NetworkOptions::default())
                .unwrap();
        let cameras: Vec<Camera> = found.solved.cameras.iter().map(|it| it.camera.clone()).collect();
        let options = AlignmentOptions { scale: true, robust: false };
        let errors = camera_errors(&cameras, &truth, options).unwrap();
        let scale = errors.true_from_found.scaling();
        for (camera, error) in found.solved.cameras.iter().zip(&errors.centres) {
            let variance = camera.covariance.as_ref().unwrap().centre.trace() * scale * scale;
            squares += error * error / variance;
            n += 1;
        }
    }
    let ratio = (squares / f64::from(n)).sqrt();
    assert!((0.6..1.5).contains(&ratio), "errors are {ratio} times what is stated");
}

#[test]
fn focal_lengths_far_from_the_guess_are_found() {
    let truth = ring(6);
    let free = Freedom { focal: true, ..Freedom::POSE };
    let mut recording = recorded(&truth, free, 2);
    recording.cameras.iter_mut().for_each(|it| it.camera.intrinsics.focal = [900.0; 2]);
    let found = from_nothing(
        &recording,
        CalibrationTarget::Light,
        &NetworkOptions { focal_unknown: true, ..NetworkOptions::default() },
    )
    .unwrap();
    for camera in &found.solved.cameras {
        assert!((camera.camera.intrinsics.focal[0] - 520.0).abs() < 5.0, "{:?}", camera.camera.intrinsics);
    }
}

#[test]
fn lamps_second_spots_numbers_that_are_none_and_double_pictures_do_no_harm() {
    let truth = ring(5);
    let mut recording = recorded(&truth, Freedom::POSE, 3);
    let mut random = Random::new(9);
    let mut last = Vec::new();
    for (index, camera_frame) in recording.camera_frames.iter_mut().enumerate() {
        match camera_frame.camera {
            0 => camera_frame.spots.push(spot(point![100.0 + random.normal(), 50.0], 250.0)),
            1 => camera_frame.spots.insert(0, spot(point![f64::NAN, 3.0], 255.0)),
            2 if index % 3 == 0 => {
                camera_frame.spots.push(spot(point![random.uniform() * 639.0, random.uniform() * 479.0], 190.0))
            }
            3 if index % 20 < 5 => camera_frame.spots.clone_from(&last),
            _ => {}
        }
        if camera_frame.camera == 3 {
            last.clone_from(&camera_frame.spots);
        }
    }
    let repeated = recording.camera_frames[40].clone();
    recording.camera_frames.push(repeated);
    let found = from_nothing(&recording, CalibrationTarget::Light, &NetworkOptions::default()).unwrap();
    assert!(worst_mm(&found, &truth) < 4.0, "{} mm", worst_mm(&found, &truth));
    let notes = &found.cleaning;
    assert_eq!(notes[0].lamps.len(), 1);
    assert!((notes[0].lamps[0][0] - 100.0).abs() < 4.0);
    assert!(notes[1].unusable >= N_FRAMES);
    assert!(notes[2].ambiguous > 80, "{}", notes[2].ambiguous);
    assert!(notes[3].repeated_pictures > 50, "{}", notes[3].repeated_pictures);
    assert_eq!(notes.iter().map(|it| it.repeated_times).sum::<usize>(), 1);
    let of_third = found.solved.observations.iter().filter(|it| it.camera == 2);
    let used = of_third.clone().filter(|it| it.role == ObservationRole::Used).count();
    assert!(used as f64 > 0.85 * 0.9 * of_third.count() as f64, "doubtful pictures are decided by the other cameras");
}

#[test]
fn cameras_that_can_be_calibrated_are_when_others_cannot() {
    let truth = ring(6);
    let mut recording = recorded(&truth, Freedom::POSE, 4);
    for camera_frame in &mut recording.camera_frames {
        match camera_frame.camera {
            // Blind but for a moment; and before a light that never moves.
            1 if camera_frame.time_s > 0.2 => camera_frame.spots.clear(),
            4 => camera_frame.spots = vec![spot(point![200.0, 100.0], 200.0)],
            _ => {}
        }
    }
    let found = from_nothing(&recording, CalibrationTarget::Light, &NetworkOptions::default()).unwrap();
    let status = |it: usize| found.solved.cameras[it].status.clone();
    assert!(matches!(status(1), CameraStatus::TooFewObservations { .. }), "{:?}", status(1));
    assert!(matches!(status(4), CameraStatus::LightStill { .. }), "{:?}", status(4));
    for index in [0, 2, 3, 5] {
        assert_eq!(found.solved.cameras[index].status, CameraStatus::Calibrated);
    }
    assert!(worst_mm(&found, &truth) < 4.0);
    let calibration = found.solved.to_calibration(Origin::default()).unwrap();
    assert_eq!(calibration.cameras.len(), 4);
}

#[test]
fn cameras_on_one_clock_need_not_look_at_the_same_moments() {
    let truth = ring(6);
    let mut random = Random::new(12);
    let mut recording = recorded(&truth, Freedom::POSE, 12);
    recording.camera_frames.clear();
    for frame in 0..2 * N_FRAMES {
        for (index, camera) in truth.iter().enumerate() {
            let time_s = (frame as f64 + index as f64 / 6.0) / (2.0 * RATE_HZ);
            let noise = 0.3 * Vector2::new(random.normal(), random.normal());
            let seen = camera.sees(&path(time_s)).map(|it| spot(it + noise, 200.0));
            recording.camera_frames.push(CameraFrame { camera: index, time_s, spots: seen.into_iter().collect() });
        }
    }
    let found = from_nothing(&recording, CalibrationTarget::Light, &NetworkOptions::default()).unwrap();
    assert!(worst_mm(&found, &truth) < 5.0, "{} mm", worst_mm(&found, &truth));
}

#[test]
fn one_camera_or_nothing_seen_is_said() {
    let truth = ring(3);
    let mut recording = recorded(&truth, Freedom::POSE, 5);
    recording.camera_frames.iter_mut().filter(|it| it.camera != 1).for_each(|it| it.spots.clear());
    let fault = from_nothing(&recording, CalibrationTarget::Light, &NetworkOptions::default()).unwrap_err();
    assert!(matches!(&fault, NetworkError::OneCamera { seen, .. } if seen == "wide-2"), "{fault:?}");
    recording.camera_frames.iter_mut().for_each(|it| it.spots.clear());
    let fault = from_nothing(&recording, CalibrationTarget::Light, &NetworkOptions::default()).unwrap_err();
    assert!(matches!(fault, NetworkError::NothingSeen { camera_frames: 900 }), "{fault:?}");
}

#[test]
fn cameras_that_never_look_together_are_named() {
    let truth = ring(2);
    let mut recording = recorded(&truth, Freedom::POSE, 6);
    recording
        .camera_frames
        .iter_mut()
        .filter(|it| (it.time_s < 5.0) == (it.camera == 0))
        .for_each(|it| it.spots.clear());
    let fault = from_nothing(&recording, CalibrationTarget::Light, &NetworkOptions::default()).unwrap_err();
    let NetworkError::NothingCalibrated { reasons } = fault else { panic!("{fault:?}") };
    assert_eq!(reasons.iter().map(|it| it.0.as_str()).collect::<Vec<_>>(), ["wide-1", "wide-2"]);
}

/// The cameras where they were, `which` turned about the vertical since.
fn older(truth: &[Camera], which: usize, angle_rad: f64) -> Vec<Camera> {
    let mut older = truth.to_vec();
    let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle_rad);
    older[which].camera_from_world = Isometry3::from_parts(Default::default(), turn) * older[which].camera_from_world;
    older
}

fn recalibrated(older: &[Camera], truth: &[Camera]) -> Result<SolvedNetwork, NetworkError> {
    let mut recording = recorded(truth, Freedom::POSE, 7);
    recording.cameras.iter_mut().zip(older).for_each(|(it, older)| it.camera.clone_from(older));
    recalibrate(&recording, CalibrationTarget::Light, &FixedFreedoms::default(), &NetworkOptions::default())
}

#[test]
fn recalibration_names_the_camera_that_moved_and_keeps_the_world() {
    let truth = ring(6);
    for angle_mrad in [8.0, 60.0, 400.0] {
        let found = recalibrated(&older(&truth, 2, 1e-3 * angle_mrad), &truth).unwrap();
        let [moved] = &found.moved[..] else { panic!("{angle_mrad} mrad: {:?}", found.moved) };
        assert_eq!(moved.camera, 2);
        assert!((1e3 * moved.angle_rad - angle_mrad).abs() < 1.0, "{} mrad", 1e3 * moved.angle_rad);
        for (camera, truth) in found.solved.cameras.iter().zip(&truth) {
            assert!((camera.camera.centre() - truth.centre()).norm() < 4e-3, "{angle_mrad} mrad, {}", camera.name);
        }
    }
}

#[test]
fn no_camera_is_diagnosed_when_none_moved() {
    let truth = ring(6);
    let found = recalibrated(&truth, &truth).unwrap();
    assert_eq!(found.moved, []);
}

#[test]
fn calibration_of_another_room_is_refused() {
    let truth = ring(6);
    let other: Vec<Camera> = (0..6).map(|it| older(&truth, it, 0.5 + 0.2 * it as f64)[it].clone()).collect();
    let fault = recalibrated(&other, &truth).unwrap_err();
    assert!(matches!(fault, NetworkError::NotThisRoom { .. }), "{fault:?}");
}

/// One picture a camera, of `n` points with labels.
fn one_picture(truth: &[Camera], n: u32) -> Recording {
    let mut recording = recorded(truth, Freedom::POSE, 7);
    recording.cameras.iter_mut().zip(truth).for_each(|(it, truth)| it.camera.clone_from(truth));
    recording.camera_frames = truth
        .iter()
        .enumerate()
        .map(|(camera, it)| {
            let spots = (0..n).filter_map(|label| {
                let pixel = it.project(&path(0.35 * f64::from(label)))?;
                Some(Spot { label: Some(label), ..spot(pixel, 200.0) })
            });
            CameraFrame { camera, time_s: 0.0, spots: spots.collect() }
        })
        .collect();
    recording
}

#[test]
fn one_picture_of_many_points_is_enough_for_three_cameras_and_not_for_two() {
    let truth = ring(6);
    let solved = |cameras: usize, n: u32| {
        let (fixed, options) = (FixedFreedoms::default(), NetworkOptions::default());
        recalibrate(&one_picture(&truth[..cameras], n), CalibrationTarget::Labels { mirrored: &[] }, &fixed, &options)
    };
    let found = solved(3, 120).unwrap();
    assert!(found.moved.is_empty() && worst_mm(&found, &truth[..3]) < 5.0, "{:?}", found.moved);
    let fault = solved(3, 6).unwrap_err().to_string();
    assert!(fault.contains("wide-2: 6 observations, expected at least 10"), "{fault}");
    let fault = solved(2, 120).unwrap_err().to_string();
    assert!(fault.contains("`--from-nothing --distance wide-1:wide-2=LENGTH`"), "{fault}");
}

#[test]
fn calibration_file_holds_what_was_found() {
    let truth = ring(4);
    let found = from_nothing(&recorded(&truth, Freedom::POSE, 8), CalibrationTarget::Light, &NetworkOptions::default())
        .unwrap();
    let origin = Origin { method: "one waved light".into(), sources: vec!["take.csv".into()], ..Origin::default() };
    let saved = found.solved.to_calibration(origin).unwrap();
    let read = Calibration::from_toml(&saved.to_toml(), std::path::Path::new("saved.toml")).unwrap();
    assert_eq!(read.provenance, saved.provenance);
    assert_eq!(read.uncertainties.len(), 4);
    assert!(read.provenance.as_ref().unwrap().scale.is_none());
    let centre = read.camera("wide-3").unwrap().centre();
    assert!((centre - found.solved.cameras[2].camera.centre()).norm() < 1e-9);
}
