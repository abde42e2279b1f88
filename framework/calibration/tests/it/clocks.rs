//! Rooms of cameras with clocks of their own: offsets found, and what must be refused.

use crate::waved_light::Scene;
use foveate_calibration::clocks::{
    ClockError, ClockOptions, ClockStatus, FrameOptions, PairError, Synchronised, frames, synchronise,
};
use foveate_calibration::recording::{CameraFrame, Recording};
use foveate_calibration::solved::ClockFit;
use foveate_estimation::Random;
use foveate_geometry::bundle::Freedom;
use nalgebra::{Point2, Point3, Vector2};

fn circling(time: f64) -> Point3<f64> {
    let phase = std::f64::consts::TAU * time / 2.5;
    Point3::new(1.1 * phase.cos(), 1.1 * phase.sin(), 1.2)
}

/// The same figure every four seconds, at no even pace.
fn repeating(time: f64) -> Point3<f64> {
    let phase = std::f64::consts::TAU * time / 4.0;
    Point3::new(1.2 * phase.sin(), 1.5 * (2.0 * phase + 0.4).sin(), 1.2 + 0.6 * (3.0 * phase).cos())
}

/// Largest error against the truth [s] of those found, each within its sigma as far as chance goes.
#[track_caller]
fn check(scene: &Scene, free: Freedom, options: &ClockOptions, limit_ms: f64) -> Synchronised {
    let found = synchronise(&scene.recording(free), options).unwrap();
    for (camera, (clock, truth)) in found.clocks.iter().zip(&scene.offsets_s).enumerate() {
        let Some(clock) = clock else { panic!("camera {camera}: {}", found.status[camera]) };
        let error = clock.offset_s - (truth - scene.offsets_s[found.reference]);
        assert!(
            error.abs() * 1e3 < limit_ms && error.abs() <= 4.5 * clock.sigma_s,
            "camera {camera}: {:.3} ms, sigma {:.3} ms, {:?}",
            error * 1e3,
            clock.sigma_s * 1e3,
            found.links
        );
    }
    assert!(found.last_move_s < 1e-4, "{}", found.last_move_s);
    found
}

const TENTHS: [f64; 6] = [0.0, 0.083, -0.1, 0.021, -0.055, 0.1];

#[test]
fn offsets_of_a_tenth_of_a_second_are_found() {
    let found = check(&Scene::new(&TENTHS), Freedom::NONE, &ClockOptions::default(), 0.5);
    assert!(found.rms_px < 0.8, "{}", found.rms_px);
    assert!(found.status.contains(&ClockStatus::Reference));
    assert!(found.links.iter().all(|it| it.consistent) && found.links.len() >= 12, "{:?}", found.links);
}

#[test]
fn clocks_beyond_the_limit_are_not_found_however_they_are_chained() {
    let scene = Scene::new(&[0.0, 0.08, 0.16, 0.24]);
    let options = ClockOptions { max_offset_s: 0.1, reference: Some(0), ..ClockOptions::default() };
    let found = synchronise(&scene.recording(Freedom::NONE), &options).unwrap();
    assert!(found.clocks[1].is_some_and(|it| (it.offset_s - 0.08).abs() < 1e-3), "{:?}", found.clocks);
    for camera in [2, 3] {
        assert_eq!(found.clocks[camera], None);
        let beyond = matches!(found.status[camera], ClockStatus::BeyondLimit { limit_s, .. } if limit_s == 0.1);
        assert!(beyond, "{}", found.status[camera]);
    }
}

#[test]
fn a_third_of_wrong_sights_is_no_obstacle() {
    let scene = Scene { wrong: 0.3, seed: 2, ..Scene::new(&TENTHS) };
    check(&scene, Freedom::NONE, &ClockOptions::default(), 1.0);
}

#[test]
fn focal_lengths_may_be_free() {
    let scene = Scene { seed: 3, ..Scene::new(&TENTHS) };
    let found = check(&scene, Freedom { focal: true, ..Freedom::NONE }, &ClockOptions::default(), 0.6);
    for camera in &found.cameras {
        assert!((camera.intrinsics.focal[0] - 420.0).abs() < 4.0, "{:?}", camera.intrinsics);
    }
}

#[test]
fn offsets_of_twenty_seconds_are_found_in_a_wide_window() {
    let scene = Scene { length_s: 50.0, seed: 4, ..Scene::new(&[0.0, 20.0, -13.7, 4.2, -20.0]) };
    let options = ClockOptions { max_offset_s: 45.0, reference: Some(0), ..ClockOptions::default() };
    check(&scene, Freedom::NONE, &options, 1.0);
}

#[test]
fn a_camera_that_sees_the_light_rarely_is_synchronised_too() {
    let scene = Scene { duty: vec![1.0, 1.0, 1.0, 1.0, 0.25, 1.0], length_s: 40.0, seed: 5, ..Scene::new(&TENTHS) };
    let found = check(&scene, Freedom::NONE, &ClockOptions::default(), 1.5);
    let [rare, usual] = [4, 5].map(|it| found.clocks[it].unwrap().sigma_s);
    assert!(found.reference == 5 || rare > 1.2 * usual, "{rare} {usual}");
}

/// Times that a camera's clock shows are those of its pictures: k / rate, to the last digit.
#[test]
fn cameras_of_any_exact_rate_are_synchronised() {
    const RATES_HZ: [&[f64]; 4] = [&[12.0], &[29.97], &[10.0, 12.0, 25.0], &[29.97, 30.0, 60.0]];
    for (seed, rates_hz) in RATES_HZ.into_iter().enumerate() {
        let slow = rates_hz[0] <= 12.0;
        for (rounded_s, dropped) in [(0.0, 0.0), (1e-3, 0.0), (0.0, 0.1), (1e-3, 0.1)] {
            let scene = Scene { rates_hz, rounded_s, dropped, seed: seed as u64, ..Scene::new(&TENTHS) };
            let recording = scene.recording(Freedom::NONE);
            let found = synchronise(&recording, &ClockOptions::default())
                .unwrap_or_else(|fault| panic!("{rates_hz:?} Hz, {rounded_s} s, {dropped}: {fault}"));
            for (camera, (clock, truth)) in found.clocks.iter().zip(&scene.offsets_s).enumerate() {
                let Some(clock) = clock else {
                    panic!("{rates_hz:?} Hz, {rounded_s} s, {dropped}: camera {camera}: {}", found.status[camera])
                };
                let error_ms = 1e3 * (clock.offset_s - (truth - scene.offsets_s[found.reference]));
                // A cubic between pictures a tenth of a second apart misses the light's turns by some pixels; where a period is a whole number of
                // milliseconds, rounding moves all stamps of a camera alike.
                let limit_ms = if slow { 3.0 } else { 0.5 } + 1e3 * rounded_s;
                assert!(
                    error_ms.abs() < limit_ms,
                    "{rates_hz:?} Hz, {rounded_s} s, {dropped}: camera {camera}: {error_ms} ms, sigma {}",
                    1e3 * clock.sigma_s
                );
            }
        }
    }
}

#[track_caller]
fn refused(scene: &Scene, options: &ClockOptions) -> Vec<ClockStatus> {
    match synchronise(&scene.recording(Freedom::NONE), options) {
        Err(ClockError::NothingFound { status }) => status,
        other => panic!("{:?}", other.map(|it| (it.clocks, it.status))),
    }
}

#[test]
fn a_light_that_goes_round_evenly_tells_no_time() {
    let scene = Scene { path: circling, seed: 6, ..Scene::new(&TENTHS[..4]) };
    for max_offset_s in [0.2, 0.5, 4.0] {
        let status = refused(&scene, &ClockOptions { max_offset_s, ..ClockOptions::default() });
        let told = |it: &ClockStatus| {
            matches!(it, ClockStatus::Undetermined { fault: PairError::Flat { .. } | PairError::Ambiguous { .. }, .. })
        };
        assert!(status.iter().all(told), "{max_offset_s}: {status:?}");
    }
}

#[test]
fn a_path_that_repeats_is_ambiguous_beyond_its_period_only() {
    let scene = Scene { path: repeating, seed: 7, ..Scene::new(&TENTHS[..4]) };
    let status = refused(&scene, &ClockOptions { max_offset_s: 6.0, ..ClockOptions::default() });
    let ambiguous =
        |it: &ClockStatus| matches!(it, ClockStatus::Undetermined { fault: PairError::Ambiguous { .. }, .. });
    assert!(status.iter().all(ambiguous), "{status:?}");
    check(&scene, Freedom::NONE, &ClockOptions { max_offset_s: 1.0, ..ClockOptions::default() }, 0.8);
}

#[test]
fn a_light_at_rest_tells_no_time() {
    let scene = Scene { path: |_| Point3::new(0.2, 0.1, 1.3), ..Scene::new(&TENTHS[..4]) };
    let still = |it: &ClockStatus| matches!(it, ClockStatus::LightStill { spread_px } if *spread_px < 1.5);
    let status = refused(&scene, &ClockOptions::default());
    assert!(status.iter().all(still), "{status:?}");
    // So does one that is never seen.
    let scene = Scene { duty: vec![0.0; 4], ..Scene::new(&TENTHS[..4]) };
    let status = refused(&scene, &ClockOptions::default());
    assert!(status.iter().all(|it| matches!(it, ClockStatus::TooFewViews { moments: 0, .. })), "{status:?}");
}

#[test]
fn a_camera_that_looks_elsewhere_is_named_and_the_others_are_found() {
    let scene = Scene { seed: 8, ..Scene::new(&TENTHS[..5]) };
    let mut recording = scene.recording(Freedom::NONE);
    // Its pictures in the order of another day.
    let mut random = Random::new(9);
    for camera_frame in recording.camera_frames.iter_mut().filter(|it| it.camera == 2) {
        let phase = 2.1 * camera_frame.time_s;
        let pixel = Point2::new(
            320.0 + 180.0 * (1.7 * phase).sin(),
            240.0 + 140.0 * (phase + 0.3 * (0.37 * phase).sin()).cos(),
        );
        camera_frame
            .spots
            .iter_mut()
            .for_each(|it| it.pixel = pixel + Vector2::new(random.normal(), random.normal()) * 0.5);
    }
    let found = synchronise(&recording, &ClockOptions { reference: Some(0), ..ClockOptions::default() }).unwrap();
    assert!(found.clocks[2].is_none(), "{:?}", found.status);
    for camera in [0, 1, 3, 4] {
        let error = found.clocks[camera].unwrap().offset_s - TENTHS[camera];
        assert!(error.abs() < 1e-3, "camera {camera}: {error}");
    }
    assert!(found.frames.observations.iter().all(|it| it.camera != 2));
}

#[test]
fn pictures_taken_together_are_frames_as_they_are() {
    let scene = Scene { wrong: 0.2, ..Scene::new(&[0.0; 3]) };
    let mut recording = scene.recording(Freedom::NONE);
    recording.camera_frames.retain(|it| it.camera == 0);
    for camera in 1..3 {
        let same: Vec<CameraFrame> = recording.camera_frames.iter().filter(|it| it.camera == 0).cloned().collect();
        recording.camera_frames.extend(same.into_iter().map(|it| CameraFrame { camera, ..it }));
    }
    let zero = ClockFit { offset_s: 0.0, drift: 0.0, sigma_s: 0.0, pairs: 0 };
    let made = frames(&recording, &[Some(zero), Some(zero), None], &FrameOptions::default());
    let seen = recording.camera_frames.iter().filter(|it| it.camera < 2 && !it.spots.is_empty()).count();
    assert_eq!((made.observations.len(), made.times_s.len() * 2), (seen, seen));
    for (observation, camera_frame) in made.observations.iter().zip(&made.camera_frames) {
        assert_eq!(observation.pixel, recording.camera_frames[camera_frame.unwrap()].spots[0].pixel);
    }
    let few = frames(&recording, &[Some(zero); 3], &FrameOptions { max_frames: 100, ..FrameOptions::default() });
    assert_eq!((few.times_s.len(), few.observations.len()), (100, 300));
    // An offset that puts one camera's pictures between those of the other.
    let half = ClockFit { offset_s: 0.5 / 30.0, ..zero };
    let between = frames(&recording, &[Some(zero), Some(half), None], &FrameOptions::default());
    let interpolated =
        between.camera_frames.iter().zip(&between.observations).filter(|(camera_frame, _)| camera_frame.is_none());
    assert!(interpolated.clone().all(|(_, it)| it.camera == 1) && interpolated.count() > 200);
}

#[test]
fn messages_about_clocks_name_cameras_and_no_flag() {
    let scene = Scene { path: circling, length_s: 12.0, seed: 6, ..Scene::new(&TENTHS[..3]) };
    let recording = scene.recording(Freedom::NONE);
    let fault = synchronise(&recording, &ClockOptions::default()).unwrap_err();
    let said = fault.sentence(|it| recording.name(it), |_| "; further".to_owned());
    assert!(recording.cameras.iter().all(|it| said.contains(&format!("{}: with cam", it.name))), "{said}");
    assert!(!said.contains("camera 0") && !said.contains("--"), "{said}");
    let statuses = [
        ClockStatus::BeyondLimit { offset_s: 0.7, limit_s: 0.5 },
        ClockStatus::Undetermined { other: 1, fault: PairError::Inconsistent { right: 3, moments: 90 } },
        ClockStatus::Separate { group: vec![0, 2] },
        ClockStatus::Undetermined { other: 1, fault: PairError::Flat { tolerance_s: 0.1 } },
    ];
    let said = statuses.each_ref().map(|it| it.sentence(|camera| recording.name(camera)));
    assert!(
        said[1].contains("cam1") && said[2].contains("cam0, cam2") && said.iter().all(|it| !it.contains("--")),
        "{said:?}"
    );
    assert_eq!(statuses.map(|it| it.may_be_further_off()), [true, true, false, false]);
}

#[test]
fn bad_input_is_refused_by_place() {
    let recording = Scene { length_s: 1.0, ..Scene::new(&TENTHS[..3]) }.recording(Freedom::NONE);
    let fault = |change: &dyn Fn(&mut Recording), options: ClockOptions| {
        let mut broken = recording.clone();
        change(&mut broken);
        synchronise(&broken, &options).unwrap_err()
    };
    let options = ClockOptions::default;
    assert_eq!(fault(&|it| it.cameras.truncate(1), options()), ClockError::TooFewCameras { count: 1 });
    assert!(matches!(
        fault(&|it| it.camera_frames[4].camera = 9, options()),
        ClockError::BadFrame { camera_frame: 4, camera: 9, .. }
    ));
    assert!(matches!(
        fault(&|it| it.camera_frames[5].time_s = f64::NAN, options()),
        ClockError::BadFrame { camera_frame: 5, .. }
    ));
    let bad_focal = fault(&|it| it.cameras[1].camera.intrinsics.focal[0] = 0.0, options());
    assert!(matches!(bad_focal, ClockError::BadCamera { camera: 1, .. }));
    for (bad, name) in [
        (ClockOptions { max_offset_s: 0.0, ..options() }, "max_offset_s"),
        (ClockOptions { max_drift: 1.0, ..options() }, "max_drift"),
        (ClockOptions { sigma_px: f64::NAN, ..options() }, "sigma_px"),
        (ClockOptions { reference: Some(3), ..options() }, "reference"),
        (ClockOptions { min_distinction: 0.5, ..options() }, "min_distinction"),
    ] {
        assert!(matches!(fault(&|_| (), bad), ClockError::BadOption { option, .. } if option == name), "{name}");
    }
    // Spots that are no numbers, and pictures recorded twice, are passed over.
    let broken = |it: &mut Recording| {
        it.camera_frames
            .iter_mut()
            .for_each(|camera_frame| camera_frame.spots.iter_mut().for_each(|it| it.pixel.x = f64::NAN));
    };
    assert!(matches!(fault(&broken, options()), ClockError::NothingFound { .. }));
}
