//! A wand and a board before simulated cameras that share no clock: offsets as they are, and a room as good as with one clock.

use foveate_calibration::board::{Board, BoardRules, board_on_one_clock, calibrate};
use foveate_calibration::clocks::ClockRules;
use foveate_calibration::recording::{CameraGuess, Look, Recording, Spot};
use foveate_calibration::room::{RoomRules, Sought, from_nothing, unsynchronised_wand};
use foveate_calibration::solved::{ClockFit, SolvedCamera};
use foveate_estimation::Random;
use foveate_geometry::bundle::Freedom;
use foveate_geometry::{AlignmentRules, Camera, CameraStatus, camera_errors};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector2, Vector3};

const DURATION_S: f64 = 30.0;
const RATES_HZ: [f64; 4] = [30.0, 25.0, 60.0, 30.0];
/// What each camera's clock shows less what the first one's does [s].
const LATE_S: [f64; 4] = [0.0, 0.013, -0.21, 0.4];

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

/// What cameras see of numbered `points`: one picture in twenty is dropped. `late` says whether clocks are off.
fn recording(cameras: &[Camera], late: bool, points: impl Fn(f64) -> Vec<Point3<f64>>) -> Recording {
    let mut random = Random::new(7).fork("no shared clock");
    let mut looks = Vec::new();
    for (camera, model) in cameras.iter().enumerate() {
        // Pictures at the same moments where the room has one clock.
        let rate_hz = if late { RATES_HZ[camera] } else { 30.0 };
        let phase_s = if late { random.uniform() / rate_hz } else { 0.0 };
        for picture in 0..(DURATION_S * rate_hz) as usize {
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
            let time_s = room_s + if late { LATE_S[camera] } else { 0.0 };
            if random.uniform() >= 0.05 {
                looks.push(Look { camera, time_s, spots });
            }
        }
    }
    looks.sort_by(|a, b| a.time_s.total_cmp(&b.time_s).then(a.camera.cmp(&b.camera)));
    let guess = |(index, it): (usize, &Camera)| CameraGuess {
        name: format!("c{index}"),
        camera: Camera { camera_from_world: Isometry3::identity(), ..it.clone() },
        free: Freedom::POSE,
    };
    Recording { cameras: cameras.iter().enumerate().map(guess).collect(), looks }
}

/// The ends of a wand of half a metre.
fn wand(time_s: f64) -> Vec<Point3<f64>> {
    let phase = 0.4 * time_s;
    let middle =
        Point3::new(0.9 * (3.1 * phase + 0.3).sin(), 1.0 * (2.3 * phase).sin(), 1.1 + 0.5 * (4.1 * phase).sin());
    let along = Vector3::new((2.1 * phase).cos(), (1.3 * phase + 1.0).sin(), 0.8 * (2.7 * phase).sin()).normalize();
    [-0.25, 0.25].map(|it| middle + along * it).to_vec()
}

fn board() -> Board {
    Board::charuco(8, 6, 0.06).unwrap()
}

/// The marks of a board that is turned and moved before the cameras.
fn marks(time_s: f64) -> Vec<Point3<f64>> {
    let wave = |rate: f64, phase: f64| (rate * time_s + phase).sin();
    let at = Translation3::new(0.45 * wave(1.1, 0.2), 0.3 * wave(0.83, 1.0), 1.0 + 0.3 * wave(1.57, 0.5));
    let upright = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(wave(0.9, 0.0), wave(0.7, 2.0), wave(1.2, 1.0)) * 0.4);
    let pose = at * (turn * upright) * Translation3::new(-0.18, 0.12, 0.0);
    board().marks().map(|it| pose * it.1).collect()
}

/// Clocks within 2 ms of what they are.
#[track_caller]
fn clocks_are_right(clocks: &[Option<ClockFit>], reference: usize) {
    for (camera, clock) in clocks.iter().enumerate() {
        let expected = LATE_S[reference] - LATE_S[camera];
        let found = clock.unwrap_or_else(|| panic!("no clock of {camera}")).offset_s;
        assert!((found - expected).abs() < 2e-3, "camera {camera}: {found} s, expected {expected} s");
    }
}

/// The furthest that a centre is from the truth, in parts of the distance between the first two cameras.
fn off(cameras: &[SolvedCamera], truth: &[Camera], scale: bool) -> f64 {
    assert!(cameras.iter().all(|it| it.status == CameraStatus::Calibrated), "{cameras:?}");
    let found: Vec<Camera> = cameras.iter().map(|it| it.camera.clone()).collect();
    let errors = camera_errors(&found, truth, AlignmentRules { scale, robust: false }).unwrap();
    errors.centres.iter().fold(0.0_f64, |worst, it| worst.max(*it)) / (truth[0].centre() - truth[1].centre()).norm()
}

fn wand_is_solved(strip: bool) {
    let truth = cameras();
    let seen = |late: bool| {
        let mut it = recording(&truth, late, wand);
        if strip {
            it.looks.iter_mut().flat_map(|it| &mut it.spots).for_each(|it| it.label = None);
        }
        it
    };
    let found = unsynchronised_wand(&seen(true), &ClockRules::default(), &RoomRules::default()).unwrap();
    let solved = &found.room.solved;
    clocks_are_right(&solved.cameras.iter().map(|it| it.clock).collect::<Vec<_>>(), found.reference);
    let together = from_nothing(&seen(false), Sought::Wand, &RoomRules::default()).unwrap();
    let [now, best] = [off(&solved.cameras, &truth, true), off(&together.solved.cameras, &truth, true)];
    println!("centres off by {now:.5}, with one clock {best:.5}");
    assert!(now < 0.01 && best < 0.01, "{now} {best}");
    let labels: std::collections::BTreeSet<u32> = solved.points.iter().map(|it| it.label).collect();
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
    let mut seen = recording(&truth, true, wand);
    for look in seen.looks.iter_mut().filter(|it| it.camera == 2) {
        look.spots.iter_mut().for_each(|it| it.label = it.label.map(|it| 1 - it));
    }
    let found = unsynchronised_wand(&seen, &ClockRules::default(), &RoomRules::default()).unwrap();
    clocks_are_right(&found.room.solved.cameras.iter().map(|it| it.clock).collect::<Vec<_>>(), found.reference);
    assert!(off(&found.room.solved.cameras, &truth, true) < 0.01);
}

#[test]
fn a_camera_that_sees_one_end_only_does_not_stop_the_others() {
    let truth = cameras();
    let mut seen = recording(&truth, true, wand);
    seen.looks.iter_mut().flat_map(|it| &mut it.spots).for_each(|it| it.label = None);
    seen.looks.iter_mut().filter(|it| it.camera == 3).for_each(|it| it.spots.truncate(1));
    let found = unsynchronised_wand(&seen, &ClockRules::default(), &RoomRules::default()).unwrap();
    let status: Vec<bool> = found.room.solved.cameras.iter().map(|it| it.status == CameraStatus::Calibrated).collect();
    assert_eq!(status, [true, true, true, false]);
}

#[test]
fn a_board_gives_the_clocks() {
    let (truth, board, rules) = (before_a_board(), board(), BoardRules::default());
    let shared = board_on_one_clock(&recording(&truth, true, marks), &board, &rules, &ClockRules::default()).unwrap();
    clocks_are_right(&shared.clocks, shared.reference);
    let now = off(&calibrate(&shared.recording, &board, &rules).unwrap().solved.cameras, &truth, false);
    let together = calibrate(&recording(&truth, false, marks), &board, &rules).unwrap();
    let best = off(&together.solved.cameras, &truth, false);
    println!("centres off by {now:.5}, with one clock {best:.5}");
    assert!(now < 0.01 && best < 0.01, "{now} {best}");
}
