//! A wand and a board before simulated cameras that share no clock: offsets as they are, and a room as good as with one clock.

use std::collections::BTreeSet;

use foveate_calibration::board::{Board, BoardOptions, board_on_one_clock, calibrate};
use foveate_calibration::clocks::{ClockError, ClockOptions};
use foveate_calibration::network::{
    CalibrationTarget, NetworkOptions, NotSynchronised, SynchronisedNetwork, from_nothing, unsynchronised_wand,
};
use foveate_calibration::recording::{CameraFrame, CameraGuess, Recording, Spot};
use foveate_calibration::solved::{ClockFit, SolvedCamera};
use foveate_estimation::Random;
use foveate_geometry::bundle::Freedom;
use foveate_geometry::{AlignmentOptions, Camera, CameraStatus, camera_errors};
use nalgebra::{Isometry3, Point2, Point3, Translation3, UnitQuaternion, Vector2, Vector3};

const RATES_HZ: [f64; 4] = [30.0, 25.0, 60.0, 30.0];
/// What each camera's clock shows less what the first one's does [s].
const LATE_S: [f64; 4] = [0.0, 0.013, -0.21, 0.4];
/// One clock and one rate for all.
const TOGETHER: ([f64; 4], [f64; 4]) = ([0.0; 4], [30.0; 4]);
const APART: ([f64; 4], [f64; 4]) = (LATE_S, RATES_HZ);

fn cameras() -> Vec<Camera> {
    let of = |index: usize| {
        let angle = [0.2, 1.3, 2.6, -1.1][index];
        let centre = Point3::new(3.2 * f64::cos(angle), 3.4 * f64::sin(angle), 2.2 + 0.3 * (index % 2) as f64);
        Camera::look_at(centre, Point3::new(0.1, 0.0, 1.1), [1280, 720], 800.0)
    };
    (0..4).map(of).collect()
}

/// Three cameras in front of a board.
fn before_a_board() -> Vec<Camera> {
    let of = |index: usize| {
        let angle = -0.6 + 0.6 * index as f64;
        let centre = Point3::new(2.2 * angle.sin(), -2.2 * angle.cos(), 1.2 + 0.3 * (index % 2) as f64);
        Camera::look_at(centre, Point3::new(0.0, 0.0, 1.0), [1280, 720], 900.0)
    };
    (0..3).map(of).collect()
}

/// What cameras see of numbered `points`: one picture in twenty is dropped. Clocks are late by `late_s`, pictures taken at `rates_hz`.
fn recording(
    cameras: &[Camera],
    (late_s, rates_hz): ([f64; 4], [f64; 4]),
    duration_s: f64,
    points: impl Fn(f64) -> Vec<Point3<f64>>,
) -> Recording {
    let mut random = Random::new(7).fork("no shared clock");
    let mut camera_frames = Vec::new();
    for (camera, model) in cameras.iter().enumerate() {
        let rate_hz = rates_hz[camera];
        // Pictures at the same moments where the room has one clock.
        let phase_s = if late_s == [0.0; 4] { 0.0 } else { random.uniform() / rate_hz };
        for picture in 0..(duration_s * rate_hz) as usize {
            let room_s = phase_s + picture as f64 / rate_hz;
            let spot = |(label, place): (usize, &Point3<f64>)| {
                let pixel = model.sees(place)?;
                Some(Spot { pixel, sigma_px: 0.3, peak: 1.0, label: Some(label as u32) })
            };
            let mut spots: Vec<Spot> = points(room_s).iter().enumerate().filter_map(spot).collect();
            spots.iter_mut().for_each(|it| it.pixel += Vector2::new(random.normal(), random.normal()) * 0.3);
            if random.uniform() < 0.5 {
                spots.reverse();
            }
            if random.uniform() >= 0.05 {
                camera_frames.push(CameraFrame { camera, time_s: room_s + late_s[camera], spots });
            }
        }
    }
    camera_frames.sort_by(|a, b| a.time_s.total_cmp(&b.time_s).then(a.camera.cmp(&b.camera)));
    let guess = |(index, it): (usize, &Camera)| CameraGuess {
        name: format!("c{index}"),
        camera: Camera { camera_from_world: Isometry3::identity(), ..it.clone() },
        free: Freedom::POSE,
    };
    Recording { cameras: cameras.iter().enumerate().map(guess).collect(), camera_frames }
}

fn without_labels(mut seen: Recording) -> Recording {
    seen.camera_frames.iter_mut().flat_map(|it| &mut it.spots).for_each(|it| it.label = None);
    seen
}

/// The ends of a wand of half a metre.
fn wand(time_s: f64) -> Vec<Point3<f64>> {
    let phase = 0.4 * time_s;
    let middle =
        Point3::new(0.9 * (3.1 * phase + 0.3).sin(), 1.0 * (2.3 * phase).sin(), 1.1 + 0.5 * (4.1 * phase).sin());
    let along = Vector3::new((2.1 * phase).cos(), (1.3 * phase + 1.0).sin(), 0.8 * (2.7 * phase).sin()).normalize();
    [-0.25, 0.25].map(|it| middle + along * it).to_vec()
}

/// The marks of a board that is turned and moved before the cameras.
fn marks(board: &Board, time_s: f64) -> Vec<Point3<f64>> {
    let wave = |rate: f64, phase: f64| (rate * time_s + phase).sin();
    let at = Translation3::new(0.45 * wave(1.1, 0.2), 0.3 * wave(0.83, 1.0), 1.0 + 0.3 * wave(1.57, 0.5));
    let upright = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(wave(0.9, 0.0), wave(0.7, 2.0), wave(1.2, 1.0)) * 0.4);
    let pose = at * (turn * upright) * Translation3::new(-0.18, 0.12, 0.0);
    board.marks().map(|it| pose * it.1).collect()
}

/// Clocks within 2 ms of what they are, of those that were found; by how much the worst is off [s].
#[track_caller]
fn clocks_are_right(clocks: &[Option<ClockFit>], reference: usize, late_s: &[f64; 4]) -> f64 {
    let mut worst_s = 0.0_f64;
    for (camera, clock) in clocks.iter().enumerate() {
        let Some(clock) = clock else { continue };
        let (found, expected) = (clock.offset_s, late_s[reference] - late_s[camera]);
        assert!((found - expected).abs() < 2e-3, "camera {camera}: {found} s, expected {expected} s");
        worst_s = worst_s.max((found - expected).abs());
    }
    worst_s
}

fn clocks_of(found: &SynchronisedNetwork) -> Vec<Option<ClockFit>> {
    found.network.solved.cameras.iter().map(|it| it.clock).collect()
}

/// The furthest that the centre of a calibrated camera is from the truth, in parts of the distance between the first two cameras.
fn off(cameras: &[SolvedCamera], truth: &[Camera], scale: bool) -> f64 {
    let calibrated = |it: &(&SolvedCamera, &Camera)| it.0.status == CameraStatus::Calibrated;
    let both = cameras.iter().zip(truth).filter(calibrated).map(|(it, truth)| (it.camera.clone(), truth.clone()));
    let (found, known): (Vec<Camera>, Vec<Camera>) = both.unzip();
    let errors = camera_errors(&found, &known, AlignmentOptions { scale, robust: false }).unwrap();
    errors.centres.iter().fold(0.0_f64, |worst, it| worst.max(*it)) / (truth[0].centre() - truth[1].centre()).norm()
}

/// The cameras `expected` and no others have clocks and poses, which are right.
#[track_caller]
fn is_right(found: &SynchronisedNetwork, truth: &[Camera], late_s: &[f64; 4], expected: [bool; 4]) {
    let solved = &found.network.solved.cameras;
    let known = |it: &SolvedCamera| it.status == CameraStatus::Calibrated && it.clock.is_some();
    assert_eq!(solved.iter().map(known).collect::<Vec<_>>(), expected, "{:?}", found.clocks);
    let clocks_s = clocks_are_right(&clocks_of(found), found.reference, late_s);
    let off = off(solved, truth, true);
    println!("clocks off by {:.2} ms, centres by {off:.5}", 1e3 * clocks_s);
    assert!(off < 0.01, "{off}");
}

fn unsynchronised(seen: &Recording, max_offset_s: f64) -> Result<SynchronisedNetwork, NotSynchronised> {
    unsynchronised_wand(seen, &ClockOptions { max_offset_s, ..ClockOptions::default() }, &NetworkOptions::default())
}

fn wand_is_solved(strip: bool) {
    let truth = cameras();
    let seen = |how| {
        let seen = recording(&truth, how, 20.0, wand);
        if strip { without_labels(seen) } else { seen }
    };
    let found = unsynchronised(&seen(APART), 0.5).unwrap();
    is_right(&found, &truth, &LATE_S, [true; 4]);
    if !strip {
        let together = from_nothing(&seen(TOGETHER), CalibrationTarget::Wand, &NetworkOptions::default()).unwrap();
        assert!(off(&found.network.solved.cameras, &truth, true) < 5.0 * off(&together.solved.cameras, &truth, true));
    }
    let labels: BTreeSet<u32> = found.network.solved.points.iter().map(|it| it.label).collect();
    assert_eq!(labels.into_iter().collect::<Vec<_>>(), [0, 1]);
}

#[test]
fn a_labelled_wand_gives_the_clocks() {
    wand_is_solved(false);
}

#[test]
fn a_wand_whose_ends_look_alike_gives_the_clocks() {
    wand_is_solved(true);
}

#[test]
fn a_camera_with_the_ends_exchanged_is_put_right() {
    let truth = cameras();
    let mut seen = recording(&truth, APART, 20.0, wand);
    for camera_frame in seen.camera_frames.iter_mut().filter(|it| it.camera == 2) {
        camera_frame.spots.iter_mut().for_each(|it| it.label = it.label.map(|it| 1 - it));
    }
    is_right(&unsynchronised(&seen, 0.5).unwrap(), &truth, &LATE_S, [true; 4]);
}

#[test]
fn clocks_seconds_apart_are_found_if_they_are_looked_for() {
    let truth = cameras();
    let late_s = [0.0, 3.7, -0.3, 0.1];
    let seen = recording(&truth, (late_s, RATES_HZ), 25.0, wand);
    is_right(&unsynchronised(&seen, 5.0).unwrap(), &truth, &late_s, [true; 4]);
    let narrow = unsynchronised(&seen, 0.5).unwrap();
    is_right(&narrow, &truth, &late_s, [true, false, true, true]);
    assert!(narrow.clocks[1].may_be_further_off(), "{:?}", narrow.clocks);
}

#[test]
fn a_camera_that_sees_one_end_only_does_not_stop_the_others() {
    let truth = cameras();
    let mut seen = without_labels(recording(&truth, APART, 20.0, wand));
    seen.camera_frames.iter_mut().filter(|it| it.camera == 3).for_each(|it| it.spots.truncate(1));
    is_right(&unsynchronised(&seen, 0.5).unwrap(), &truth, &LATE_S, [true, true, true, false]);
}

#[test]
fn a_wand_that_leaves_the_view_and_lamps_beside_it_do_no_harm() {
    let truth = cameras();
    let far = |time_s: f64| wand(time_s).into_iter().map(|it| Point3::from(it.coords * 2.2)).collect();
    let mut seen = without_labels(recording(&truth, APART, 25.0, far));
    let shown = |n: usize| seen.camera_frames.iter().filter(|it| it.spots.len() == n).count();
    assert!(shown(0) > 300 && shown(1) > 300, "the wand leaves the view");
    let mut random = Random::new(3);
    for camera_frame in seen.camera_frames.iter_mut().filter(|_| random.uniform() < 0.15) {
        let pixel = Point2::new(
            40.0 * camera_frame.camera as f64 + 0.1 * camera_frame.time_s,
            700.0 - 300.0 * (0.1 * camera_frame.time_s).cos(),
        );
        camera_frame.spots.push(Spot { pixel, sigma_px: 0.3, peak: 1.0, label: None });
    }
    is_right(&unsynchronised(&seen, 0.5).unwrap(), &truth, &LATE_S, [true; 4]);
}

#[test]
fn a_camera_that_shares_nothing_is_named() {
    let truth = cameras();
    for strip in [false, true] {
        let mut seen = recording(&truth, APART, 30.0, wand);
        seen.camera_frames.retain(|it| (it.camera == 1) == (it.time_s > 18.0));
        let seen = if strip { without_labels(seen) } else { seen };
        let found = unsynchronised(&seen, 0.5).unwrap();
        is_right(&found, &truth, &LATE_S, [true, false, true, true]);
        assert!(matches!(found.network.solved.cameras[1].status, CameraStatus::ClockOpen { .. }), "{:?}", found.clocks);
        // Of two cameras alone nothing is left.
        let mut two = seen.clone();
        two.cameras.truncate(2);
        two.camera_frames.retain(|it| it.camera < 2);
        let fault = unsynchronised(&two, 0.5).unwrap_err();
        assert!(matches!(fault, NotSynchronised::Clocks(ClockError::NothingFound { .. })), "{fault}");
    }
}

#[test]
fn a_wand_at_rest_tells_no_clock() {
    let still = without_labels(recording(&cameras(), APART, 20.0, |_| wand(1.0)));
    let fault = unsynchronised(&still, 0.5).unwrap_err();
    assert!(fault.to_string().contains("moving light") || fault.to_string().contains("in place"), "{fault}");
}

/// A board before cameras with clocks of their own: clocks and cameras as they are.
#[track_caller]
fn board_is_solved(board: &Board, flip: bool) {
    let (truth, options) = (before_a_board(), BoardOptions { poses_guessed: false, ..BoardOptions::default() });
    let mut seen = recording(&truth, APART, 16.0, |time_s| marks(board, time_s));
    let last = board.marks().count() as u32 - 1;
    for camera_frame in seen.camera_frames.iter_mut().filter(|it| flip && it.camera == 1) {
        camera_frame.spots.iter_mut().for_each(|it| it.label = it.label.map(|it| last - it));
    }
    let shared = board_on_one_clock(&seen, board, &options, &ClockOptions::default()).unwrap();
    assert!(shared.clocks.iter().all(Option::is_some), "{:?}", shared.status);
    let clocks_s = clocks_are_right(&shared.clocks, shared.reference, &LATE_S);
    let found = calibrate(&shared.recording, board, &options).unwrap();
    assert!(found.solved.cameras.iter().all(|it| it.status == CameraStatus::Calibrated), "{:?}", found.solved.cameras);
    let off = off(&found.solved.cameras, &truth, false);
    println!("clocks off by {:.2} ms, centres by {off:.5}", 1e3 * clocks_s);
    assert!(off < 0.01, "{off}");
}

#[test]
fn a_board_gives_the_clocks() {
    board_is_solved(&Board::charuco(5, 4, 0.09).unwrap(), false);
}

#[test]
fn a_board_that_one_camera_reads_the_other_way_round_gives_the_clocks() {
    board_is_solved(&Board::chessboard(4, 4, 0.09).unwrap(), false);
    board_is_solved(&Board::chessboard(5, 3, 0.09).unwrap(), true);
}

#[test]
fn a_board_that_lies_on_the_floor_tells_no_clock() {
    let board = Board::charuco(5, 4, 0.09).unwrap();
    let seen = recording(&before_a_board(), APART, 10.0, |_| marks(&board, 0.0));
    let fault = board_on_one_clock(&seen, &board, &BoardOptions::default(), &ClockOptions::default()).unwrap_err();
    assert!(fault.to_string().contains("moving light") || fault.to_string().contains("in place"), "{fault}");
}
