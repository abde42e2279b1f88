//! A wand waved in a room of known truth: labels found, metres as good as stated, and what must be noticed.

use foveate_estimation::Random;
use foveate_geometry::alignment::{AlignmentOptions, align};
use foveate_geometry::bundle::Freedom;
use foveate_geometry::self_calibration::SelfCalibrationOptions;
use foveate_geometry::{Camera, CameraStatus};
use nalgebra::{Point2, Point3, Vector2, Vector3};

use super::*;
use crate::axes::{self, AxesError, AxesOptions, Given, Place};
use crate::recording::{CameraFrame, CameraGuess, Recording, Spot};
use crate::solved::Solved;

const LENGTH_M: f64 = 0.5;
const SIGMA_PX: f64 = 0.3;

fn cameras(n: usize) -> Vec<CameraGuess> {
    let camera = |index: usize| {
        let angle = std::f64::consts::TAU * index as f64 / n as f64;
        let centre = Point3::new(2.6 * angle.cos(), 3.4 * angle.sin(), 2.5 + 0.3 * (index % 2) as f64);
        let target = Point3::new(-0.3 * angle.sin(), 0.3 * angle.cos(), 1.0);
        CameraGuess {
            name: format!("wide-{}", index + 1),
            camera: Camera::look_at(centre, target, [640, 480], 420.0),
            free: Freedom::POSE,
        }
    };
    (0..n).map(camera).collect()
}

/// Both ends in `frame` of `n`.
fn ends(frame: usize, n: usize) -> [Point3<f64>; 2] {
    let phase = std::f64::consts::TAU * frame as f64 / n as f64;
    let middle =
        Point3::new(1.2 * (5.0 * phase + 0.3).sin(), 1.6 * (3.3 * phase).sin(), 1.2 + 0.6 * (7.1 * phase).sin());
    let along = Vector3::new((4.1 * phase).cos(), (2.3 * phase + 1.0).sin(), 0.8 * (5.7 * phase).sin()).normalize();
    [-0.5, 0.5].map(|it| middle + along * it * LENGTH_M)
}

/// What all cameras see of both ends, labelled rightly; the order of the spots is that of chance.
fn recording(n_cameras: usize, n_frames: usize, seed: u64) -> Recording {
    let mut random = Random::new(seed).fork("wand");
    let cameras = cameras(n_cameras);
    let mut camera_frames = Vec::new();
    for frame in 0..n_frames {
        for (camera, guess) in cameras.iter().enumerate() {
            let mut spots = Vec::new();
            for (end, place) in ends(frame, n_frames).iter().enumerate() {
                if let Some(pixel) = guess.camera.sees(place) {
                    let noise = Vector2::new(random.normal(), random.normal()) * SIGMA_PX;
                    let peak = random.uniform_in(150.0, 200.0);
                    spots.push(Spot { pixel: pixel + noise, sigma_px: SIGMA_PX, peak, label: Some(end as u32) });
                }
            }
            if random.uniform() < 0.5 {
                spots.reverse();
            }
            camera_frames.push(CameraFrame { camera, time_s: frame as f64 / 50.0, spots });
        }
    }
    Recording { cameras, camera_frames }
}

fn without_labels(mut recording: Recording) -> Recording {
    recording.camera_frames.iter_mut().flat_map(|it| &mut it.spots).for_each(|it| it.label = None);
    recording
}

fn frames(recording: &Recording) -> Vec<Option<usize>> {
    frames_by_time(recording, 0.01)
}

fn labelled(recording: &Recording) -> Labelled {
    label(recording, &frames(recording), &LabelOptions::default()).unwrap_or_else(|it| panic!("{it}"))
}

/// Of the labels: how many are right, in each frame up to the better exchange of both; how many wrong; and how often that changes.
fn count(found: &Labelled, n_frames: usize) -> [usize; 3] {
    let (mut right, mut wrong, mut changes, mut before) = (0, 0, 0, None);
    for (frame, camera_frames) in found.recording.camera_frames.chunk_by(|a, b| a.time_s == b.time_s).enumerate() {
        let mut votes = [0, 0];
        for camera_frame in camera_frames {
            for spot in &camera_frame.spots {
                let camera = &found.recording.cameras[camera_frame.camera].camera;
                let off = ends(frame, n_frames).map(|it| (camera.project(&it).unwrap() - spot.pixel).norm());
                let end = usize::from(off[1] < off[0]);
                if off[end] > 8.0 * SIGMA_PX {
                    wrong += 1;
                } else {
                    votes[usize::from(spot.label != Some(end as u32))] += 1;
                }
            }
        }
        let exchanged = votes[1] > votes[0];
        right += votes[usize::from(exchanged)];
        wrong += votes[usize::from(!exchanged)];
        changes += usize::from(before.is_some_and(|it| it != exchanged) && votes != [0, 0]);
        before = Some(exchanged);
    }
    [right, wrong, changes]
}

fn solved(recording: &Recording) -> Solved {
    let options = SelfCalibrationOptions { sigma_px: SIGMA_PX, ..SelfCalibrationOptions::default() };
    solve(&recording.cameras, &observations(recording, &frames(recording)), &options).unwrap()
}

fn wand(length_m: f64) -> Wand {
    Wand { ends: [0, 1], length_m, sigma_m: 0.0 }
}

fn refined(solved: &Solved) -> Refined {
    let options = RefineOptions { sigma_px: SIGMA_PX, ..RefineOptions::default() };
    refine(solved, &wand(LENGTH_M), &options).unwrap_or_else(|it| panic!("{it}"))
}

/// Scale of the truth over that of the found cameras, and their root mean square distance after alignment without it [m].
fn against_truth(found: &Solved) -> [f64; 2] {
    let truth = cameras(found.cameras.len());
    let known: Vec<usize> =
        (0..truth.len()).filter(|it| found.cameras[*it].status == CameraStatus::Calibrated).collect();
    let [a, b]: [Vec<Point3<f64>>; 2] = [
        known.iter().map(|it| found.cameras[*it].camera.centre()).collect(),
        known.iter().map(|it| truth[*it].camera.centre()).collect(),
    ];
    let [scaled, rigid] = [true, false].map(|scale| align(&a, &b, AlignmentOptions { scale, robust: false }).unwrap());
    [scaled.b_from_a.scaling(), rigid.rms]
}

#[test]
fn lights_that_look_alike_are_told_apart() {
    let found = labelled(&without_labels(recording(6, 150, 1)));
    let [right, wrong, changes] = count(&found, 150);
    assert!(right > 1500 && 200 * wrong <= right && changes <= 4, "{right} {wrong} {changes} {}", found.dropped);
    assert!(found.unplaced.is_empty() && found.pairs.len() >= 5 && found.swapped.is_empty());
    let [factor, rms] = against_truth(&refined(&solved(&found.recording)).solved);
    assert!((factor - 1.0).abs() < 1e-3 && rms < 4e-3, "{factor} {rms}");
}

#[test]
fn clutter_lamps_and_hidden_ends_are_seen_through() {
    let mut seen = without_labels(recording(6, 200, 2));
    let mut random = Random::new(5);
    for camera_frame in &mut seen.camera_frames {
        let peak = random.uniform_in(100.0, 250.0);
        let spot = |pixel| Spot { pixel, sigma_px: SIGMA_PX, peak, label: None };
        if camera_frame.camera == 3 {
            camera_frame.spots.push(spot(Point2::new(222.0, 111.0)));
        }
        if random.uniform() < 0.1 {
            camera_frame.spots.truncate(1);
        }
        if random.uniform() < 0.2 {
            let pixel = Point2::new(random.uniform_in(0.0, 639.0), random.uniform_in(0.0, 479.0));
            camera_frame.spots.push(spot(pixel));
        }
    }
    let found = labelled(&seen);
    let [right, wrong, _] = count(&found, 200);
    assert!(
        right > 1500 && 50 * wrong < right && found.single > 20,
        "{right} {wrong} {} {}",
        found.single,
        found.dropped
    );
    let [factor, rms] = against_truth(&refined(&solved(&found.recording)).solved);
    assert!((factor - 1.0).abs() < 2e-3 && rms < 6e-3, "{factor} {rms}");
}

#[test]
fn three_wrong_spots_in_ten_do_not_hide_the_wand() {
    let mut seen = without_labels(recording(6, 200, 3));
    let mut random = Random::new(7);
    for spot in seen.camera_frames.iter_mut().flat_map(|it| &mut it.spots) {
        if random.uniform() < 0.3 {
            spot.pixel = Point2::new(random.uniform_in(0.0, 639.0), random.uniform_in(0.0, 479.0));
        }
    }
    let found = labelled(&seen);
    assert!(found.unplaced.is_empty(), "{:?}", found.pairs);
    let [factor, rms] = against_truth(&refined(&solved(&found.recording)).solved);
    assert!((factor - 1.0).abs() < 4e-3 && rms < 0.012, "{factor} {rms}");
}

#[test]
fn a_camera_with_its_ends_the_wrong_way_round_is_named() {
    let mut seen = recording(5, 100, 4);
    assert_eq!(labelled(&seen).swapped, Vec::<usize>::new());
    for camera_frame in seen.camera_frames.iter_mut().filter(|it| it.camera == 2) {
        camera_frame.spots.iter_mut().for_each(|it| it.label = it.label.map(|it| 1 - it));
    }
    let found = labelled(&seen);
    assert_eq!(found.swapped, [2]);
    let [right, wrong, _] = count(&found, 100);
    assert!(right > 900 && wrong == 0, "{right} {wrong}");
}

#[test]
fn cameras_that_never_see_the_wand_whole_are_calibrated_too() {
    let mut seen = recording(6, 150, 5);
    for camera_frame in seen.camera_frames.iter_mut().filter(|it| it.camera > 2) {
        camera_frame.spots.retain(|it| it.label == Some((camera_frame.camera % 2) as u32));
    }
    let found = refined(&solved(&labelled(&seen).recording));
    assert!(found.solved.cameras.iter().all(|it| it.status == CameraStatus::Calibrated));
    let [factor, rms] = against_truth(&found.solved);
    assert!((factor - 1.0).abs() < 3e-3 && rms < 8e-3, "{factor} {rms}");
    assert!(found.after.pairs.iter().all(|it| it.cameras[1] <= 2), "{:?}", found.after.pairs);
}

#[test]
fn metres_are_as_good_as_they_say() {
    let (mut of_scale, mut of_cameras, mut free, mut held) = (0.0, 0.0, 0.0, 0.0);
    for seed in 0..20 {
        let solved = solved(&recording(5, 60, 100 + seed));
        let found = refined(&solved);
        let [factor, rms] = against_truth(&found.solved);
        let sigma = found.solved.fixed.scale.as_ref().unwrap().sigma.unwrap();
        of_scale += ((factor - 1.0) / sigma).powi(2) / 20.0;
        let stated: f64 = found.solved.cameras.iter().map(|it| it.covariance.as_ref().unwrap().centre.trace()).sum();
        of_cameras += rms * rms * 5.0 / stated / 20.0;
        let [alone, _] = against_truth(&axes_by_wand(&solved));
        free += (alone - 1.0).powi(2) / 20.0;
        held += (factor - 1.0).powi(2) / 20.0;
    }
    assert!((0.2..2.5).contains(&of_scale) && (0.5..1.6).contains(&of_cameras), "{of_scale} {of_cameras}");
    assert!(held.sqrt() < 1e-3 && held < 1.2 * free, "{held} {free}");
}

/// Scaled by the wand, without an adjustment.
fn axes_by_wand(solved: &Solved) -> Solved {
    let given = Given::WandLength { ends: [0, 1], metres: LENGTH_M, sigma_m: 0.0 };
    axes::fix(solved, &[given], &AxesOptions::default()).unwrap().solved
}

#[test]
fn a_wrong_length_is_found_out_by_a_known_distance() {
    let solved = solved(&recording(5, 60, 6));
    let options = RefineOptions { sigma_px: SIGMA_PX, ..RefineOptions::default() };
    let truth = cameras(5);
    let metres = (truth[0].camera.centre() - truth[2].camera.centre()).norm();
    let [a, b] = ["wide-1", "wide-3"].map(|it| Place::Camera(it.into()));
    let distance = [Given::Distance { a, b, metres, sigma_m: 2e-3 }];
    for (length_m, agrees) in [(LENGTH_M, true), (0.9 * LENGTH_M, false)] {
        let found = refine(&solved, &wand(length_m), &options).unwrap().solved;
        let fixed = axes::fix(&found, &distance, &AxesOptions::default());
        assert_eq!(fixed.is_ok(), agrees, "{:?}", fixed.err());
        if let Err(fault) = fixed {
            let is_wand = |it: &AxesError| matches!(it, AxesError::Contradiction { a, .. } if a == "a wand of 0.45 m");
            assert!(is_wand(&fault), "{fault:?}");
        }
    }
}

#[test]
fn a_bent_world_shows_in_the_map_of_lengths() {
    let good = solved(&recording(5, 200, 7));
    let worst = |it: &Solved| {
        let found = lengths(it, [0, 1]).unwrap();
        assert!(found.map.len() > 6, "{:?}", found.map.len());
        found.map.iter().map(|it| it.error.abs()).fold(0.0, f64::max)
    };
    let mut bent = good.clone();
    for point in &mut bent.points {
        let x = point.position.x;
        point.position.x = x + 0.05 * x * x;
    }
    assert!(worst(&good) < 6e-3 && worst(&bent) > 2.5 * worst(&good), "{} {}", worst(&good), worst(&bent));
    let found = lengths(&good, [0, 1]).unwrap();
    assert!(found.pairs.len() == 10 && found.pairs.iter().all(|it| it.error.abs() < 5e-3), "{:?}", found.pairs);
    assert!(found.spread < 0.01 && found.sigma < 2e-3 && found.robust_spread < 0.01);
}

#[test]
fn held_out_frames_measure_the_wand() {
    let seen = recording(5, 120, 8);
    let all = observations(&seen, &frames(&seen));
    let (fit, held): (Vec<_>, Vec<_>) = all.into_iter().partition(|it| it.frame % 2 == 0);
    let options = SelfCalibrationOptions { sigma_px: SIGMA_PX, ..SelfCalibrationOptions::default() };
    let found = refined(&solve(&seen.cameras, &fit, &options).unwrap()).solved;
    let measured = intersect(&found.cameras, &held);
    let lengths = lengths(&measured, [0, 1]).unwrap();
    assert!((lengths.mean / LENGTH_M - 1.0).abs() < 2e-3 && lengths.samples.iter().all(|it| it.frame % 2 == 1));
    assert!(measured.observations.iter().filter_map(|it| it.residual).all(|it| it.norm() < 3.0));
}

#[test]
fn what_is_no_wand_is_refused() {
    let solved = solved(&recording(4, 60, 9));
    let refused = |solved: &Solved, wand: Wand| refine(solved, &wand, &RefineOptions::default()).unwrap_err();
    let is_number = |it: &RefineError, value: f64| matches!(it, RefineError::BadNumber { found, .. } if found.total_cmp(&value).is_eq());
    for length_m in [0.0, -1.0, f64::NAN] {
        let fault = refused(&solved, wand(length_m));
        assert!(is_number(&fault, length_m), "{fault:?}");
    }
    assert!(is_number(&refused(&solved, Wand { sigma_m: -1.0, ..wand(0.5) }), -1.0));
    let fault = refused(&solved, Wand { ends: [0, 7], ..wand(0.5) });
    assert!(matches!(fault, RefineError::NoWand(TooFewFrames { frames: 0, needed: 3 })), "{fault:?}");
    let mut in_one_place = solved;
    in_one_place.points.iter_mut().for_each(|it| it.position = Point3::origin());
    assert!(is_number(&refused(&in_one_place, wand(0.5)), f64::INFINITY));
    let refused = |recording: &Recording| label(recording, &frames(recording), &LabelOptions::default()).unwrap_err();
    let mut still = without_labels(recording(3, 40, 1));
    let first: Vec<CameraFrame> = still.camera_frames[..3].to_vec();
    for (index, camera_frame) in still.camera_frames.iter_mut().enumerate() {
        camera_frame.spots.clone_from(&first[index % 3].spots);
    }
    assert!(matches!(refused(&still), LabelError::NothingOriented { .. }), "{:?}", refused(&still));
    let mut alone = recording(3, 40, 1);
    alone.camera_frames.retain(|it| it.camera == 1);
    assert!(
        matches!(refused(&alone), LabelError::NothingOriented { frames: 0, needed: 10, .. }),
        "{:?}",
        refused(&alone)
    );
    alone.camera_frames[0].camera = 9;
    let fault = refused(&alone);
    assert!(matches!(fault, LabelError::NoSuchCamera { camera_frame: 0, camera: 9, cameras: 3 }), "{fault:?}");
    assert!(label(&alone, &[], &LabelOptions::default()).is_err());
}
