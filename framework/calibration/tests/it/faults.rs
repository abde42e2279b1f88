//! Faults done to recordings on purpose: the culprit is named with its cause, nobody else is, and no wrong room passes.

use crate::faulty::faults::Fault;
use crate::faulty::sets::{self, Set};
use foveate_calibration::cause::Cause;
use foveate_calibration::checks::{CheckOptions, Checks, Level, check};
use foveate_calibration::comparison::compare;
use foveate_calibration::network::{self, NetworkError, SolvedNetwork};
use foveate_calibration::quality::quality;
use foveate_calibration::recording::Recording;
use foveate_calibration::solved::FixedFreedoms;
use foveate_geometry::{Camera, CameraStatus};

fn set() -> Set {
    sets::simulated(5, 11)
}

fn checked(set: &Set, recording: &Recording) -> Result<(SolvedNetwork, Checks), NetworkError> {
    let found = network::from_nothing(recording, set.sought, &set.options)?;
    let checks = check(&found.solved, None, &CheckOptions::default());
    Ok((found, checks))
}

#[track_caller]
fn named(fault: Fault, camera: usize) -> Checks {
    let set = set();
    let recording = fault.done_to(&set.recording, camera, 3).unwrap();
    let (_, checks) = checked(&set, &recording).unwrap();
    let culprits = fault.culprits(camera, set.recording.cameras.len());
    let told: Vec<(usize, &str)> = checks.candidates.iter().map(|it| (it.camera, it.cause.name())).collect();
    let causes = fault.causes(false);
    for culprit in &culprits {
        assert!(told.iter().any(|it| it.0 == *culprit && causes.contains(&it.1)), "{fault:?}: {told:?}\n{checks}");
    }
    assert!(told.iter().all(|it| culprits.contains(&it.0)), "{fault:?}: {told:?}\n{checks}");
    checks
}

#[test]
fn mirrored_late_and_knocked_cameras_are_named_and_the_room_is_not_usable() {
    for (fault, camera) in [(Fault::Mirrored, 1), (Fault::Late(1), 2), (Fault::Late(5), 0), (Fault::Knocked(10.0), 3)] {
        assert_eq!(named(fault, camera).verdict.level, Level::Redo, "{fault:?}");
    }
}

/// With optics that are free a room bends until a shift of some pixels shows in no residual.
#[test]
fn cameras_whose_picture_shifts_by_some_pixels_are_named_with_the_moment() {
    for (px, camera) in [(3.0, 0), (6.0, 2), (10.0, 4), (20.0, 1)] {
        let checks = named(Fault::Shifted(px), camera);
        let [moved] = &checks.candidates[..] else { panic!("{px} px: {checks}") };
        let Cause::Moved { at_s: Some(at_s), shift_px, .. } = moved.cause else { panic!("{px} px: {:?}", moved.cause) };
        assert!((at_s - 11.65).abs() < 0.3 && (shift_px / px - 1.0).abs() < 0.25, "{px} px: {shift_px} px at {at_s} s");
        assert_eq!(checks.verdict.level, Level::Redo);
        assert!(!checks.cameras[camera].calibrated, "{checks}");
    }
}

/// Little evidence is no evidence: lens, noise and a short path differ from one window to the next.
#[test]
fn short_windows_of_a_clean_recording_accuse_nobody() {
    let set = set();
    for (from, n) in [(0, 40), (0, 60), (90, 50), (150, 80), (210, 120), (330, 45), (400, 200), (480, 100), (610, 80)] {
        let recording = Fault::Window { from, n }.done_to(&set.recording, 0, 1).unwrap();
        let Ok((_, checks)) = checked(&set, &recording) else { continue };
        let accused: Vec<_> = checks.candidates.iter().map(|it| (it.camera, it.cause)).collect();
        assert!(accused.is_empty(), "{n} frames from {from}: {accused:?}\n{checks}");
    }
}

/// Its pictures coincide with nobody's; the light is known between them.
#[test]
fn camera_late_by_half_a_frame_is_named() {
    let checks = named(Fault::LatePart(0.5), 2);
    let late: Vec<f64> = checks.candidates.iter().filter_map(|it| it.cause.size()).collect();
    assert!(late.len() == 1 && (late[0] - 0.5 / 30.0).abs() < 0.004, "{late:?}");
    assert_eq!(checks.verdict.level, Level::Redo);
}

#[test]
fn rows_exchanged_from_the_middle_on_are_put_right_and_told() {
    let checks = named(Fault::SwappedHalf, 4);
    let since: Vec<f64> = checks.candidates.iter().filter_map(|it| it.cause.since_s()).collect();
    assert!(since.len() == 2 && since.iter().all(|it| (it - 11.65).abs() < 1.0), "{since:?}");
    assert!(checks.cameras.iter().all(|it| it.calibrated), "{checks}");
}

#[test]
fn pixels_that_are_not_square_are_told_though_nearly_all_fits() {
    let checks = named(Fault::WrongPixelShape(1.15), 2);
    let shape = checks.candidates.iter().find_map(|it| match it.cause {
        Cause::PixelShape { factor } => Some(factor),
        _ => None,
    });
    assert!(shape.is_some_and(|it| (it * 1.15 - 1.0).abs() < 0.04), "{shape:?}");
}

#[test]
fn share_of_false_observations_is_told_and_most_of_them_do_no_harm() {
    let usual = named(Fault::Random(0.3), 1);
    assert!(usual.verdict.level < Level::Redo && usual.candidates[0].judgement.level == Level::Good, "{usual}");
    let share = |checks: &Checks| checks.candidates[0].cause.size().unwrap();
    assert!((share(&usual) - 0.3).abs() < 0.08, "{}", share(&usual));
    let most = named(Fault::Random(0.7), 1);
    assert!((share(&most) - 0.7).abs() < 0.1 && most.verdict.level == Level::Redo, "{most}");
}

#[test]
fn clean_rooms_accuse_no_camera_whole_in_halves_and_without_each() {
    let set = set();
    let parts = [Fault::Clean, Fault::Half { first: true }, Fault::Half { first: false }, Fault::Rate(29.97)];
    let parts = parts.map(|it| (it, 0)).into_iter().chain((0..5).map(|camera| (Fault::Without, camera)));
    for (part, camera) in parts {
        let recording = part.done_to(&set.recording, camera, 1).unwrap();
        let (_, checks) = checked(&set, &recording).unwrap();
        let unseen = |it: usize| recording.camera_frames.iter().all(|camera_frame| camera_frame.camera != it);
        let accused: Vec<_> = checks.candidates.iter().filter(|it| !unseen(it.camera)).map(|it| it.cause).collect();
        assert!(accused.is_empty(), "{accused:?}\n{checks}");
    }
}

#[test]
fn a_focal_length_that_is_not_as_stated_and_a_camera_that_shares_nothing_are_named() {
    let set = set();
    let (clean, _) = checked(&set, &set.recording).unwrap();
    let mut stated = set.clone();
    for (guess, solved) in stated.recording.cameras.iter_mut().zip(&clean.solved.cameras) {
        (guess.camera, guess.free) = (solved.camera.clone(), foveate_geometry::Freedom::POSE);
    }
    stated.options.focal_unknown = false;
    for (fault, cause) in [(Fault::WrongFocal(1.1), "wrong_lens"), (Fault::FewCommon(3), "too_few_common")] {
        let (_, checks) = checked(&stated, &fault.done_to(&stated.recording, 1, 2).unwrap()).unwrap();
        let told: Vec<(usize, &str)> = checks.candidates.iter().map(|it| (it.camera, it.cause.name())).collect();
        assert_eq!(told, [(1, cause)], "{fault:?}\n{checks}");
    }
}

/// What cannot be seen from nothing changes no centre.
#[test]
fn roll_origin_and_names_cannot_be_seen_and_do_no_harm() {
    let set = set();
    let (clean, _) = checked(&set, &set.recording).unwrap();
    let distance = |it: &SolvedNetwork, a: usize, b: usize| {
        let centre = |camera: usize| it.solved.cameras[camera].camera.centre();
        (centre(a) - centre(b)).norm() / (centre(0) - centre(1)).norm()
    };
    for fault in [Fault::UpsideDown, Fault::OriginOff, Fault::NaNAndTwice, Fault::Dropped(0.3)] {
        let (found, checks) = checked(&set, &fault.done_to(&set.recording, 3, 5).unwrap()).unwrap();
        assert!(checks.candidates.is_empty() && checks.verdict.level < Level::Redo, "{fault:?}\n{checks}");
        for other in [2, 4] {
            let ratio = distance(&found, 3, other) / distance(&clean, 3, other);
            assert!((ratio - 1.0).abs() < 0.01, "{fault:?}: {ratio}");
        }
    }
}

/// Beside an older calibration the same faults are seen, each by its own name.
#[test]
fn exchanged_names_and_a_camera_upside_down_are_seen_beside_an_older_calibration() {
    let set = set();
    let (clean, _) = checked(&set, &set.recording).unwrap();
    let mut known = set.clone();
    for (guess, solved) in known.recording.cameras.iter_mut().zip(&clean.solved.cameras) {
        (guess.camera, guess.free) = (solved.camera.clone(), foveate_geometry::Freedom::POSE);
    }
    let fixed = FixedFreedoms::default();
    for (fault, cause) in [
        (Fault::Clean, None),
        (Fault::Swapped, Some("rows_swapped")),
        (Fault::UpsideDown, Some("upside_down")),
        (Fault::Mirrored, Some("mirrored")),
        (Fault::Late(3), Some("late")),
    ] {
        let recording = fault.done_to(&known.recording, 2, 1).unwrap();
        let found = network::recalibrate(&recording, known.sought, &fixed, &known.options).unwrap();
        let checks = check(&found.solved, None, &CheckOptions::default());
        let culprits = cause.map(|_| fault.culprits(2, 5)).unwrap_or_default();
        let told: Vec<(usize, &str)> = checks.candidates.iter().map(|it| (it.camera, it.cause.name())).collect();
        assert_eq!(told.len(), culprits.len(), "{fault:?}: {told:?}\n{checks}");
        assert!(told.iter().all(|it| culprits.contains(&it.0) && Some(it.1) == cause), "{fault:?}: {told:?}");
        let is_redo = checks.verdict.level == Level::Redo;
        assert_eq!(is_redo, fault != Fault::Clean, "{fault:?}\n{checks}");
    }
}

/// Cameras of the set with their optics and poses as of the whole recording.
fn known(set: &Set) -> Set {
    let (clean, _) = checked(set, &set.recording).unwrap();
    let mut known = set.clone();
    for (guess, solved) in known.recording.cameras.iter_mut().zip(&clean.solved.cameras) {
        (guess.camera, guess.free) = (solved.camera.clone(), foveate_geometry::Freedom::POSE);
    }
    known
}

/// One bad camera, or little to go by, and nobody else is said to have moved since the older calibration.
#[test]
fn beside_an_older_calibration_only_who_is_at_fault_is_named() {
    let known = known(&sets::simulated(4, 11));
    let windows = [(0, 60), (100, 50), (250, 80), (500, 60)].map(|(from, n)| (Fault::Window { from, n }, 0, None));
    let faults = [
        (Fault::Swapped, 0, Some("rows_swapped")),
        (Fault::Swapped, 1, Some("rows_swapped")),
        (Fault::UpsideDown, 0, Some("upside_down")),
        (Fault::Shifted(6.0), 3, Some("moved")),
    ];
    for (fault, camera, cause) in windows.into_iter().chain(faults) {
        let recording = fault.done_to(&known.recording, camera, 1).unwrap();
        let found = network::recalibrate(&recording, known.sought, &FixedFreedoms::default(), &known.options).unwrap();
        let checks = check(&found.solved, None, &CheckOptions::default());
        let mut told: Vec<(usize, &str)> = checks.candidates.iter().map(|it| (it.camera, it.cause.name())).collect();
        told.sort_unstable();
        let mut culprits = if cause.is_some() { fault.culprits(camera, 4) } else { Vec::new() };
        culprits.sort_unstable();
        let expected: Vec<(usize, &str)> = culprits.into_iter().zip(cause.into_iter().cycle()).collect();
        assert_eq!(told, expected, "{fault:?}\n{checks}");
        let is_named = checks.candidates.iter().all(|it| fault != Fault::Shifted(6.0) || it.cause.since_s().is_some());
        assert!(is_named, "{checks}");
    }
}

/// Nothing in the pictures alone tells a room from its mirror image; an older calibration does.
#[test]
fn pictures_of_all_cameras_mirrored_are_told_beside_an_older_calibration() {
    let known = known(&set());
    let mut recording = known.recording.clone();
    for camera in 0..5 {
        recording = Fault::Mirrored.done_to(&recording, camera, 1).unwrap();
    }
    let found = network::recalibrate(&recording, known.sought, &FixedFreedoms::default(), &known.options).unwrap();
    let checks = check(&found.solved, None, &CheckOptions::default());
    assert!(checks.candidates.len() == 5 && checks.candidates.iter().all(|it| it.cause == Cause::Mirrored), "{checks}");
    assert_eq!(checks.verdict.level, Level::Redo);
    let found = network::from_nothing(&recording, known.sought, &known.options).unwrap();
    let mut checks = check(&found.solved, None, &CheckOptions::default());
    assert!(checks.candidates.is_empty(), "{checks}");
    let named = known.recording.cameras.iter();
    let named = named.map(|it| foveate_scene::NamedCamera { name: it.name.clone(), camera: it.camera.clone() });
    let older = foveate_scene::Calibration::new(named.collect(), foveate_scene::LengthUnit::Unknown, String::new());
    let beside = compare(&found.solved, &older.unwrap()).unwrap();
    checks.add_beside_older(&beside, &CheckOptions::default());
    assert!(checks.candidates.len() == 5 && checks.verdict.level == Level::Redo, "{checks}");
}

/// A calibration that explains less of what was seen is worse, whatever its verdict.
#[test]
fn calibration_of_a_knocked_camera_is_worse_than_a_new_one() {
    let set = set();
    let (clean, _) = checked(&set, &set.recording).unwrap();
    let cameras: Vec<Option<Camera>> = clean.solved.cameras.iter().map(|it| Some(it.camera.clone())).collect();
    let good = quality(&clean.solved, &cameras, 3.0);
    assert!(good.explained > 0.97 && good.median_px < 0.5, "{good:?}");
    let mut knocked = cameras.clone();
    let turn = nalgebra::UnitQuaternion::from_euler_angles(0.02, 0.0, 0.0);
    if let Some(it) = &mut knocked[1] {
        it.camera_from_world.rotation = turn * it.camera_from_world.rotation;
    }
    let bad = quality(&clean.solved, &knocked, 3.0);
    assert!(bad.worse_than(&good).is_some() && good.worse_than(&bad).is_none(), "{bad:?}");
    assert!(clean.solved.cameras.iter().all(|it| it.status == CameraStatus::Calibrated));
}
