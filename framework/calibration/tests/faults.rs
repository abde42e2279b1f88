//! Faults done to recordings on purpose: the culprit is named with its cause, nobody else is, and no wrong room passes.

mod faulty;

use faulty::faults::Fault;
use faulty::sets::{self, Set};
use foveate_calibration::cause::Cause;
use foveate_calibration::checks::{CheckRules, Checks, Level, check};
use foveate_calibration::quality::quality;
use foveate_calibration::recording::Recording;
use foveate_calibration::room::{self, RoomFault, SolvedRoom};
use foveate_calibration::solved::FixedFreedoms;
use foveate_geometry::{Camera, CameraStatus};

fn set() -> Set {
    sets::simulated(5, 11)
}

fn checked(set: &Set, recording: &Recording) -> Result<(SolvedRoom, Checks), RoomFault> {
    let found = room::from_nothing(recording, set.sought, &set.rules)?;
    let checks = check(&found.solved, None, &CheckRules::default());
    Ok((found, checks))
}

#[track_caller]
fn named(fault: Fault, camera: usize) -> Checks {
    let set = set();
    let recording = fault.done_to(&set.recording, camera, 3).unwrap();
    let (_, checks) = checked(&set, &recording).unwrap();
    let culprits = fault.culprits(camera, set.recording.cameras.len());
    let told: Vec<(usize, &str)> = checks.suspects.iter().map(|it| (it.camera, it.cause.name())).collect();
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

#[test]
fn rows_exchanged_from_the_middle_on_are_put_right_and_told() {
    let checks = named(Fault::SwappedHalf, 4);
    let since: Vec<f64> = checks.suspects.iter().filter_map(|it| it.cause.since_s()).collect();
    assert!(since.len() == 2 && since.iter().all(|it| (it - 11.65).abs() < 1.0), "{since:?}");
    assert!(checks.cameras.iter().all(|it| it.calibrated), "{checks}");
}

#[test]
fn pixels_that_are_not_square_are_told_though_nearly_all_fits() {
    let checks = named(Fault::WrongPixelShape(1.15), 2);
    let shape = checks.suspects.iter().find_map(|it| match it.cause {
        Cause::PixelShape { factor } => Some(factor),
        _ => None,
    });
    assert!(shape.is_some_and(|it| (it * 1.15 - 1.0).abs() < 0.04), "{shape:?}");
}

#[test]
fn share_of_false_observations_is_told_and_most_of_them_do_no_harm() {
    let usual = named(Fault::Random(0.3), 1);
    assert!(usual.verdict.level < Level::Redo && usual.suspects[0].judgement.level == Level::Good, "{usual}");
    let share = |checks: &Checks| checks.suspects[0].cause.size().unwrap();
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
        let unseen = |it: usize| recording.looks.iter().all(|look| look.camera != it);
        let accused: Vec<_> = checks.suspects.iter().filter(|it| !unseen(it.camera)).map(|it| it.cause).collect();
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
    stated.rules.focal_unknown = false;
    for (fault, cause) in [(Fault::WrongFocal(1.1), "wrong_lens"), (Fault::FewCommon(3), "too_few_common")] {
        let (_, checks) = checked(&stated, &fault.done_to(&stated.recording, 1, 2).unwrap()).unwrap();
        let told: Vec<(usize, &str)> = checks.suspects.iter().map(|it| (it.camera, it.cause.name())).collect();
        assert_eq!(told, [(1, cause)], "{fault:?}\n{checks}");
    }
}

/// What cannot be seen from nothing changes no centre.
#[test]
fn roll_origin_and_names_cannot_be_seen_and_do_no_harm() {
    let set = set();
    let (clean, _) = checked(&set, &set.recording).unwrap();
    let distance = |it: &SolvedRoom, a: usize, b: usize| {
        let centre = |camera: usize| it.solved.cameras[camera].camera.centre();
        (centre(a) - centre(b)).norm() / (centre(0) - centre(1)).norm()
    };
    for fault in [Fault::UpsideDown, Fault::OriginOff, Fault::NaNAndTwice, Fault::Dropped(0.3)] {
        let (found, checks) = checked(&set, &fault.done_to(&set.recording, 3, 5).unwrap()).unwrap();
        assert!(checks.suspects.is_empty() && checks.verdict.level < Level::Redo, "{fault:?}\n{checks}");
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
        let found = room::recalibrate(&recording, known.sought, &fixed, &known.rules).unwrap();
        let checks = check(&found.solved, None, &CheckRules::default());
        let culprits = cause.map(|_| fault.culprits(2, 5)).unwrap_or_default();
        let told: Vec<(usize, &str)> = checks.suspects.iter().map(|it| (it.camera, it.cause.name())).collect();
        assert_eq!(told.len(), culprits.len(), "{fault:?}: {told:?}\n{checks}");
        assert!(told.iter().all(|it| culprits.contains(&it.0) && Some(it.1) == cause), "{fault:?}: {told:?}");
        let is_redo = checks.verdict.level == Level::Redo;
        assert_eq!(is_redo, fault != Fault::Clean, "{fault:?}\n{checks}");
    }
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
