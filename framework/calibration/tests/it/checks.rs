//! Faults that re-projection does not see are found and named, and nobody else is accused.

use crate::simulated_room::{BAD, FAULTS, Fault, innocent_candidates, is_named, solved, solved_at};
use foveate_calibration::checks::{Cause, CheckOptions, Checks, LengthSample, Level, check};
use foveate_calibration::solved::{ClockFit, ObservationRole, Solved, SolvedObservation};
use foveate_geometry::CameraStatus;
use foveate_scene::uncertainty::Fixed;
use nalgebra::{Point3, Vector2};

fn checked(solved: &Solved) -> Checks {
    check(solved, None, &CheckOptions::default())
}

#[test]
fn each_fault_is_named_and_nobody_else_is_accused() {
    for fault in FAULTS {
        let checks = checked(&solved(fault, 1));
        assert!(is_named(fault, &checks), "{fault:?}:\n{checks}");
        assert_eq!(innocent_candidates(fault, &checks), 0, "{fault:?}:\n{checks}");
        assert!((1..=5).contains(&checks.verdict.sentences.len()), "{fault:?}:\n{checks}");
    }
}

/// Nobody does a camera again for a twentieth of a pixel, however well the pixels are known.
#[test]
fn trifles_accuse_nobody_where_there_is_next_to_no_noise() {
    let strict = CheckOptions { trifle_px: 0.0, least_effect_px: 0.0, ..CheckOptions::default() };
    for fault in [Fault::Distortion(1.4e-3), Fault::Focal(1.0012), Fault::Moved(0.3), Fault::Clock(0.5)] {
        let network = solved_at(fault, 1, 0.02);
        // Of a camera that was moved by less than a pixel nothing is said under any rules.
        let is_told = !check(&network, None, &strict).candidates.is_empty();
        assert!(is_told || matches!(fault, Fault::Moved(_)), "{fault:?} can be told from noise");
        for network in [network, solved_at(fault, 1, 0.05)] {
            let checks = checked(&network);
            assert!(checks.candidates.is_empty() && checks.verdict.level == Level::Good, "{fault:?}:\n{checks}");
        }
    }
}

#[test]
fn faults_are_named_where_there_is_next_to_no_noise() {
    let of_a_camera = |it: &Fault| !matches!(it, Fault::Flipped | Fault::FlippedCamera | Fault::Flat);
    for fault in FAULTS.into_iter().filter(of_a_camera) {
        let checks = checked(&solved_at(fault, 1, 0.02));
        assert!(is_named(fault, &checks), "{fault:?}:\n{checks}");
        assert_eq!(innocent_candidates(fault, &checks), 0, "{fault:?}:\n{checks}");
    }
}

#[test]
fn clutter_that_was_left_out_is_reported_and_does_no_harm() {
    let reported = |network: &Solved, level: Level| {
        let checks = checked(network);
        let mut of_bad = checks.candidates.iter().filter(|it| it.camera == BAD);
        let found = of_bad.find(|it| matches!(it.cause, Cause::FalseObservations { .. }));
        let judgement = found.map(|it| &it.judgement);
        assert_eq!(judgement.map(|it| it.level), Some(level), "{checks}");
        assert!(checks.verdict.level == level, "{checks}");
        assert!(checks.verdict.sentences.iter().any(|it| Some(it) == judgement.map(|it| &it.sentence)), "{checks}");
    };
    reported(&solved(Fault::Wrong(0.3), 1), Level::Good);
    reported(&solved(Fault::Wrong(0.3), 2), Level::Good);
    reported(&solved(Fault::Wrong(0.6), 1), Level::Usable);
    // What is left is little.
    let mut few = solved(Fault::Wrong(0.3), 1);
    let mut index = 0;
    few.observations.retain(|it| {
        index += 1;
        it.camera != BAD || index % 8 == 0
    });
    reported(&few, Level::Usable);
    // Or it is in use.
    let mut in_use = solved(Fault::Wrong(0.3), 1);
    for it in in_use.observations.iter_mut().filter(|it| it.camera == BAD && it.role == ObservationRole::Rejected) {
        it.role = ObservationRole::Used;
    }
    reported(&in_use, Level::Usable);
}

#[test]
fn the_faulty_camera_comes_first_and_by_name() {
    let checks = checked(&solved(Fault::Moved(10.0), 3));
    assert_eq!(checks.verdict.level, Level::Redo);
    let first = &checks.verdict.sentences[0];
    assert!(first.contains("wide-4") && first.contains("10.0 s"), "{first}");
    let text = checks.to_string();
    for wanted in ["verdict: redo", "wide-8", "mrad", "held out", "handedness"] {
        assert!(text.contains(wanted), "{wanted} in\n{text}");
    }
}

#[test]
fn hold_out_errors_are_as_large_as_noise_and_geometry_make_them() {
    let good = checked(&solved(Fault::Nothing, 2));
    let excess = good.fit.excess.unwrap();
    assert!((0.85..1.15).contains(&excess), "{excess}");
    assert!((good.sigma_px / 0.3 - 1.0).abs() < 0.1, "{}", good.sigma_px);
    assert!(good.fit.ratio.unwrap() > 1.0);
    // Overfitted cameras: what was held out is off by more than the training shows.
    let mut spoilt = solved(Fault::Nothing, 2);
    for it in spoilt.observations.iter_mut().filter(|it| it.role == ObservationRole::HeldOut) {
        it.pixel += Vector2::new(1.5, -1.0);
        it.residual = it.residual.map(|residual| residual - Vector2::new(1.5, -1.0));
    }
    let checks = checked(&spoilt);
    assert!(checks.fit.judgement.level == Level::Redo && checks.fit.excess.unwrap() > 3.0, "{checks}");
}

#[test]
fn common_observations_that_intersect_nowhere_are_reported() {
    let mut room = solved(Fault::Nothing, 1);
    assert!(checked(&room).fit.unsolved < 0.05, "{}", checked(&room).fit.unsolved);
    // Three points of four were not found.
    for observation in room.observations.iter_mut().filter(|it| it.point.is_some_and(|point| point % 4 > 0)) {
        *observation =
            SolvedObservation { point: None, residual: None, role: ObservationRole::Unsolved, ..*observation };
    }
    room.points.truncate(room.points.len() / 4);
    room.observations.retain(|it| it.point.is_none_or(|point| point < room.points.len()));
    let found = checked(&room);
    assert!((0.6..0.9).contains(&found.fit.unsolved), "{}", found.fit.unsolved);
    assert_eq!(found.fit.judgement.level, Level::Redo);
    let percent = format!("{:.0} %", 100.0 * found.fit.unsolved);
    assert!(found.fit.judgement.sentence.contains(&percent), "{}", found.fit.judgement.sentence);
}

#[test]
fn a_camera_that_was_fitted_to_what_was_chosen_for_it_is_to_be_done_again() {
    let mut room = solved(Fault::Nothing, 1);
    let held = |it: &&mut SolvedObservation| it.camera == 2 && it.role == ObservationRole::HeldOut;
    for observation in room.observations.iter_mut().filter(held) {
        observation.residual = observation.residual.map(|it| it * 40.0);
    }
    let found = checked(&room);
    let judgement = &found.cameras[2].judgement;
    assert_eq!(judgement.level, Level::Redo, "{judgement:?}");
    assert!(judgement.sentence.contains("wide-3"), "{judgement:?}");
    assert!(found.cameras.iter().enumerate().all(|(at, it)| at == 2 || it.judgement.level < Level::Redo));
}

#[test]
fn cameras_below_the_floor_are_named_where_there_is_a_floor() {
    let mut network = solved(Fault::Nothing, 1);
    let fixed = || Some(Fixed { by: "an L-frame".to_owned(), sigma: None });
    (network.fixed.gravity, network.fixed.origin) = (fixed(), fixed());
    assert_eq!(checked(&network).floor.judgement.level, Level::Good);
    // One camera mirrored in the floor.
    let camera = &mut network.cameras[BAD].camera;
    let mut centre = camera.centre();
    centre.z = -0.59;
    camera.camera_from_world.translation.vector = -(camera.camera_from_world.rotation * centre.coords);
    let floor = checked(&network).floor;
    assert_eq!((floor.judgement.level, floor.cameras_below), (Level::Redo, vec![BAD]));
    assert!(floor.judgement.sentence.contains("wide-4") && floor.judgement.sentence.contains("0.59 m"));
    // The floor is unknown: no camera is named.
    network.fixed.origin = None;
    assert!(!checked(&network).floor.fixed);
}

#[test]
fn lengths_that_grow_along_an_axis_are_reported_with_it() {
    let network = solved(Fault::Nothing, 1);
    let samples = |slope: f64| -> Vec<LengthSample> {
        let at = |it: usize| Point3::new(0.1 * (it % 7) as f64, 0.01 * it as f64, (it % 3) as f64);
        let error = |it: usize| slope * (it as f64 / 300.0 - 0.5) + 0.002 * (it as f64 * 2.4).sin();
        (0..300).map(|it| LengthSample { at: at(it), relative_error: error(it) }).collect()
    };
    let lengths = |slope: f64| check(&network, Some(&samples(slope)), &CheckOptions::default()).lengths.unwrap();
    assert_eq!(lengths(0.0).judgement.level, Level::Good);
    let stretched = lengths(0.1);
    assert_eq!((stretched.judgement.level, stretched.slope_axis), (Level::Redo, 1), "{stretched:?}");
    assert!((stretched.slope - 0.1).abs() < 0.02, "{stretched:?}");
    assert!(check(&network, Some(&[]), &CheckOptions::default()).lengths.is_none());
}

#[test]
fn a_camera_that_is_linked_to_one_other_is_named() {
    let mut network = solved(Fault::Nothing, 1);
    let seen_by = |camera: usize, network: &Solved| -> Vec<usize> {
        network.observations.iter().filter(|it| it.camera == camera).map(|it| it.frame).collect()
    };
    // Whenever camera 1 sees the light, only camera 2 does as well.
    let frames = seen_by(0, &network);
    network.observations.retain(|it| it.camera < 2 || !frames.contains(&it.frame));
    let links = checked(&network).links;
    assert_eq!(links.hanging, [(0, 1)]);
    assert!(links.cuts == [1] && links.judgement.sentence.contains("wide-1"), "{links:?}");
    // Nor does camera 2: two rooms.
    network.observations.retain(|it| it.camera != 1 || !frames.contains(&it.frame));
    let links = checked(&network).links;
    assert!(links.groups.contains(&vec![0]) && links.judgement.level == Level::Redo, "{links:?}");
}

#[test]
fn a_camera_that_was_not_calibrated_is_named_with_the_reason() {
    let mut network = solved(Fault::Nothing, 1);
    network.cameras[5].status = CameraStatus::NoPartner { best: Some(2), common: 4, needed: 10 };
    let checks = checked(&network);
    assert_eq!(checks.verdict.level, Level::Usable);
    let is_it = |it: &String| ["wide-6", "4 frames", "wide-3", "10"].iter().all(|part| it.contains(part));
    assert!(checks.verdict.sentences.iter().any(is_it), "{checks}");
}

#[test]
fn a_camera_whose_pose_is_left_open_is_to_be_done_again() {
    let mut network = solved(Fault::Nothing, 1);
    for open in [vec![4], (0..network.cameras.len()).collect()] {
        open.into_iter().for_each(|it: usize| network.cameras[it].covariance = None);
        let checks = checked(&network);
        assert_eq!(checks.verdict.level, Level::Redo, "{checks}");
        let judgement = &checks.cameras[4].judgement;
        assert!(judgement.level == Level::Redo && judgement.sentence.contains("wide-5"), "{judgement:?}");
    }
}

#[test]
fn clocks_that_no_loop_confirms_or_that_were_not_found_are_reported() {
    let mut network = solved(Fault::Nothing, 1);
    let clock = |pairs: usize| Some(ClockFit { offset_s: 0.1, drift: 0.0, sigma_s: 1e-4, pairs });
    for (index, it) in network.cameras.iter_mut().enumerate() {
        it.clock = clock(if index == 0 { 0 } else { 3 });
    }
    assert_eq!(checked(&network).verdict.level, Level::Good);
    network.cameras[2].clock = clock(1);
    let verdict = checked(&network).verdict;
    assert!(verdict.level == Level::Usable && verdict.sentences[0].contains("clock of camera wide-3"), "{verdict}");
    let network = left_out(CameraStatus::ClockOpen { best: Some(0) }, |it| it.camera != BAD);
    let verdict = checked(&network).verdict;
    let first = &verdict.sentences[0];
    assert!(first.contains("clock of camera wide-4") && first.contains("wide-1"), "{verdict}");
}

/// The room with camera [`BAD`] left out of it, its pixels where `seen` has them.
fn left_out(why: CameraStatus, seen: impl Fn(&mut SolvedObservation) -> bool) -> Solved {
    let mut network = solved(Fault::Nothing, 1);
    (network.cameras[BAD].status, network.cameras[BAD].covariance) = (why, None);
    network.observations.retain_mut(|it| {
        if it.camera == BAD {
            (it.role, it.residual) = (ObservationRole::Unsolved, None);
        }
        seen(it)
    });
    network
}

#[test]
fn a_mirrored_picture_is_named_and_no_lens_is_diagnosed_for_it() {
    let status = || CameraStatus::Inconsistent { best: 0, common: 400, right: 20 };
    let mirrored = left_out(status(), |it| {
        if it.camera == BAD {
            it.pixel.x = 639.0 - it.pixel.x;
        }
        true
    });
    let of_bad = |network: &Solved| checked(network).candidates.into_iter().find(|it| it.camera == BAD);
    let found = of_bad(&mirrored).unwrap();
    assert_eq!((found.cause, found.judgement.level), (Cause::Mirrored, Level::Redo));
    assert!(found.judgement.sentence.contains("wide-4"), "{}", found.judgement.sentence);
    // Of another time: nothing explains that, least of all another focal length.
    let pixels: Vec<_> = mirrored.observations.iter().filter(|it| it.camera == BAD).map(|it| it.pixel).collect();
    let mut other_time = mirrored.clone();
    let n = pixels.len();
    for (index, it) in other_time.observations.iter_mut().filter(|it| it.camera == BAD).enumerate() {
        it.pixel = pixels[(7 * index + n / 3) % n];
    }
    assert_eq!(of_bad(&other_time), None);
}

#[test]
fn a_camera_that_shares_the_light_with_one_other_only_is_named() {
    let witnessed: Vec<usize> = {
        let network = solved(Fault::Nothing, 1);
        network.observations.iter().filter(|it| it.camera == BAD).map(|it| it.frame).collect()
    };
    // Where it sees the light, only wide-1 does as well.
    let status = CameraStatus::Inconsistent { best: 1, common: 0, right: 0 };
    let network = left_out(status, |it| it.camera == BAD || it.camera == 0 || !witnessed.contains(&it.frame));
    let sentence = checked(&network).cameras[BAD].judgement.sentence.clone();
    assert!(sentence.contains("wide-4") && sentence.contains("with wide-1 only"), "{sentence}");
}

#[test]
fn the_empty_part_of_a_picture_is_where_to_wave() {
    let mut network = solved(Fault::Nothing, 1);
    network.observations.retain(|it| it.camera != 2 || it.pixel.x > 213.0 || it.pixel.y > 159.0);
    let wave = checked(&network).cameras[2].wave.clone();
    assert!(wave.as_ref().is_some_and(|it| it.starts_with("upper left")), "{wave:?}");
}

#[test]
fn empty_rooms_and_rooms_without_numbers_are_checked_without_panic() {
    let nothing = checked(&Solved::default());
    assert_eq!(nothing.verdict.level, Level::Redo);
    assert!(nothing.to_string().starts_with("verdict: redo"));
    let mut broken = solved(Fault::Nothing, 1);
    broken.points[7].position.x = f64::NAN;
    broken.observations[3].pixel.y = f64::INFINITY;
    broken.observations[4].point = Some(1_000_000);
    broken.observations[5].residual = Some(Vector2::new(f64::NAN, 0.0));
    let _ = checked(&broken).to_string();
    let mut few = solved(Fault::Nothing, 1);
    few.observations.truncate(3);
    assert_eq!(checked(&few).verdict.level, Level::Redo);
}
