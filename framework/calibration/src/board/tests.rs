//! Simulated boards with known truth: cameras around a volume in which a board is turned, and what they see of it.

use foveate_estimation::Random;
use foveate_geometry::bundle::{Freedom, Optic};
use foveate_geometry::self_calibration::CameraStatus;
use foveate_geometry::{AlignmentOptions, Camera, Distortion, camera_errors};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector2, Vector3};

use super::*;
use crate::recording::{CameraFrame, CameraGuess, Recording, Spot};
use crate::solved::ObservationRole;

const ALL: Freedom = Freedom {
    pose: true,
    focal: true,
    aspect: false,
    principal: true,
    k1: true,
    k2: true,
    k3: false,
    decentering: false,
};

struct Scene {
    board: Board,
    cameras: Vec<Camera>,
    world_from_board: Vec<Isometry3<f64>>,
    noise_px: f64,
}

/// `n` cameras 2.2 m around the origin, and the board turned in front of them.
fn scene(n: usize, frames: usize, board: Board, seed: u64) -> Scene {
    let mut random = Random::new(seed).fork("board");
    let cameras = (0..n).map(|it| {
        let angle = 1.2 * it as f64 / n.max(2) as f64 + 0.1 * random.normal();
        let centre = Point3::new(2.2 * angle.sin(), -2.2 * angle.cos(), 0.9 + 0.3 * random.normal());
        let mut camera = Camera::look_at(centre, Point3::origin(), [640, 480], 620.0 + 30.0 * random.normal());
        camera.intrinsics.principal = [319.5 + 6.0 * random.normal(), 239.5 + 6.0 * random.normal()];
        camera.distortion = Distortion { k1: -0.2, k2: 0.08, ..Distortion::default() };
        camera
    });
    let cameras = cameras.collect();
    let middle = board.marks().fold(Vector3::zeros(), |sum, it| sum + it.1.coords) / board.marks().count() as f64;
    let world_from_board = (0..frames).map(|_| {
        let at = Translation3::new(0.35 * random.normal(), 0.3 * random.normal(), 0.25 * random.normal());
        // Upright, its face to the cameras, then turned at will.
        let upright = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
        let about = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.3);
        let turn =
            UnitQuaternion::from_scaled_axis(Vector3::new(random.normal(), random.normal(), random.normal()) * 0.4);
        at * (about * turn * upright) * Translation3::from(-middle)
    });
    let world_from_board = world_from_board.collect();
    Scene { board, cameras, world_from_board, noise_px: 0.2 }
}

impl Scene {
    fn camera_frame(&self, camera: usize, frame: usize, random: &mut Random) -> CameraFrame {
        let eye = &self.cameras[camera];
        let board = &self.world_from_board[frame];
        let facing = (board * Vector3::z()).dot(&(eye.centre() - board * Point3::origin())) > 0.0;
        let spots = self.board.marks().filter(|_| facing).filter_map(|(id, place)| {
            let noise = Vector2::new(random.normal(), random.normal()) * self.noise_px;
            let pixel = eye.sees(&(board * place))? + noise;
            Some(Spot { pixel, sigma_px: self.noise_px, peak: 1.0, label: Some(id) })
        });
        CameraFrame { camera, time_s: frame as f64 * 0.1, spots: spots.collect() }
    }

    fn recording(&self, free: Freedom, seed: u64) -> Recording {
        let mut random = Random::new(seed).fork("noise");
        let guess = |(at, it): (usize, &Camera)| {
            let mut camera = Camera { camera_from_world: Isometry3::identity(), ..it.clone() };
            if free.focal {
                camera.intrinsics.focal = [800.0; 2];
                camera.intrinsics.principal = [319.5, 239.5];
                camera.distortion = Distortion::default();
            }
            CameraGuess { name: format!("cam-{at}"), camera, free }
        };
        let cameras = self.cameras.iter().enumerate().map(guess).collect();
        let frames = self.world_from_board.len();
        let camera_frames = (0..frames).flat_map(|frame| (0..self.cameras.len()).map(move |camera| (camera, frame)));
        Recording {
            cameras,
            camera_frames: camera_frames.map(|(camera, frame)| self.camera_frame(camera, frame, &mut random)).collect(),
        }
    }
}

fn solved(recording: &Recording, board: &Board) -> BoardSolution {
    calibrate(recording, board, &BoardOptions::default()).unwrap()
}

/// Worst distance of a centre [m] and worst rotation [rad], after a rigid fit.
#[track_caller]
fn errors(solution: &BoardSolution, truth: &[Camera]) -> (f64, f64) {
    let found: Vec<Camera> = solution.solved.cameras.iter().map(|it| it.camera.clone()).collect();
    let errors = camera_errors(&found, truth, AlignmentOptions::default()).unwrap();
    (errors.centres.iter().copied().fold(0.0, f64::max), errors.rotations.iter().copied().fold(0.0, f64::max))
}

fn charuco() -> Board {
    Board::charuco(8, 6, 0.06).unwrap()
}

/// Errors of the optics in units of what is stated, root mean square over cameras and seeds: 1 when that is honest.
#[derive(Default)]
struct Honesty {
    squares: f64,
    count: usize,
    worst: f64,
}

impl Honesty {
    fn add(&mut self, error: f64, sigma: f64) {
        self.squares += (error / sigma).powi(2);
        self.count += 1;
        self.worst = self.worst.max((error / sigma).abs());
    }

    #[track_caller]
    fn check(&self, what: &str) {
        let rms = (self.squares / self.count as f64).sqrt();
        assert!((0.6..1.5).contains(&rms) && self.worst < 5.0, "{what}: {rms:.2}, worst {:.2}", self.worst);
    }
}

#[test]
fn cameras_and_optics_are_found_from_nothing_and_are_as_good_as_is_stated() {
    let (mut focal, mut principal) = (Honesty::default(), Honesty::default());
    for seed in 0..12 {
        let scene = scene(4, 24, charuco(), seed);
        let solution = solved(&scene.recording(ALL, seed), &scene.board);
        assert!(solution.solved.cameras.iter().all(|it| it.status == CameraStatus::Calibrated), "{seed}");
        let (centre, rotation) = errors(&solution, &scene.cameras);
        assert!(centre < 0.02 && rotation < 0.03, "seed {seed}: {:.1} mm, {:.1} mrad", centre * 1e3, rotation * 1e3);
        for (found, truth) in solution.solved.cameras.iter().zip(&scene.cameras) {
            let (found_optics, sigma) = (&found.camera.intrinsics, found.covariance.as_ref().unwrap().optics);
            let ratio = found_optics.focal[0] / truth.intrinsics.focal[0];
            assert!((ratio - 1.0).abs() < 0.03, "seed {seed}: {ratio}");
            if found.freed.focal {
                focal.add(ratio - 1.0, sigma.focal);
            }
            if found.freed.principal {
                principal.add(found_optics.principal[0] - truth.intrinsics.principal[0], sigma.principal[0]);
                principal.add(found_optics.principal[1] - truth.intrinsics.principal[1], sigma.principal[1]);
            }
        }
        assert!((0.2..0.32).contains(&solution.rms_px), "{}", solution.rms_px);
        let kept = solution.hold_out.unwrap();
        assert!(kept.frames && kept.median_px < 0.5, "{kept:?}");
        assert!(solution.ambiguous.is_empty());
    }
    assert!(focal.count > 40 && principal.count > 60, "{} {}", focal.count, principal.count);
    focal.check("focal length");
    principal.check("principal point");
}

#[test]
fn a_board_that_is_printed_too_long_one_way_is_told_and_others_are_not() {
    let with_aspect = Freedom { aspect: true, ..ALL };
    for seed in 0..4 {
        for (by, free) in [
            (0.0, ALL),
            (0.02, ALL),
            (-0.012, with_aspect),
            (0.04, with_aspect),
            (0.0, with_aspect),
            (0.02, Freedom::POSE),
        ] {
            let mut scene = scene(2, 12, charuco(), 40 + seed);
            let said = scene.board.clone();
            scene.board = said.clone().with_longer_rows(by);
            let solution = solved(&scene.recording(free, seed), &said);
            match solution.stretch {
                Some(it) => {
                    assert!(by != 0.0 && (it.by - by).abs() < 0.003 + 0.2 * by.abs(), "seed {seed}, {by}: {it:?}")
                }
                None => assert_eq!(by, 0.0, "seed {seed}"),
            }
        }
        // Held upright all the time it is told, too, though pixels of another shape would explain it.
        let mut held = scene(2, 12, charuco(), 60 + seed);
        let said = held.board.clone();
        held.board = said.clone().with_longer_rows(0.02);
        for (at, pose) in held.world_from_board.iter_mut().enumerate() {
            let tilt = [0.5, -0.5].map(|it| it * (1.3 * at as f64).sin());
            let upright = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2 + tilt[0]);
            pose.rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.3 + tilt[1]) * upright;
        }
        let solution = solved(&held.recording(with_aspect, seed), &said);
        assert!(solution.stretch.is_some_and(|it| (it.by - 0.02).abs() < 0.004), "seed {seed}: {:?}", solution.stretch);
        // Pixels that are not square are no board.
        let mut scene = scene(2, 12, charuco(), 50 + seed);
        scene.cameras.iter_mut().for_each(|it| it.intrinsics.focal[1] *= 1.03);
        assert_eq!(solved(&scene.recording(with_aspect, seed), &scene.board).stretch, None, "seed {seed}");
    }
}

#[test]
fn a_symmetric_board_that_each_camera_reads_its_own_way_round_is_put_right() {
    for (seed, columns, rows) in [(1, 8, 6), (2, 6, 6), (3, 7, 7)] {
        let scene = scene(3, 16, Board::chessboard(columns, rows, 0.05).unwrap(), seed);
        let mut recording = scene.recording(Freedom::POSE, seed);
        let mut random = Random::new(seed).fork("which way round");
        let turns = scene.board.turns().to_vec();
        for camera_frame in &mut recording.camera_frames {
            let turn = turns[random.below(turns.len() as u32) as usize];
            for spot in &mut camera_frame.spots {
                let place = scene.board.place(spot.label.unwrap()).unwrap();
                spot.label = Some(scene.board.nearest(&(turn * place)));
            }
        }
        let solution = solved(&recording, &scene.board);
        let (centre, _) = errors(&solution, &scene.cameras);
        assert!(centre < 0.01 && solution.ambiguous.is_empty(), "{columns} x {rows}: {centre}");
        // Each mark has one label in a frame, whatever its cameras called it.
        let off =
            solution.solved.observations.iter().filter_map(|it| it.residual).map(|it| it.norm()).fold(0.0, f64::max);
        assert!(off < 2.0, "{off}");
    }
}

#[test]
fn turns_are_those_after_which_colours_and_corners_are_the_same() {
    let turns = |columns, rows| Board::chessboard(columns, rows, 0.03).unwrap().turns().len();
    assert_eq!([turns(8, 6), turns(7, 5), turns(8, 5), turns(6, 6), turns(7, 7)], [2, 2, 1, 4, 2]);
    let board = Board::chessboard(8, 6, 0.03).unwrap();
    let turned = board.turns()[1] * board.place(0).unwrap();
    assert_eq!(board.nearest(&turned), 47);
    assert!((turned - board.place(47).unwrap()).norm() < 1e-12);
    assert!((board.size() - 0.03 * 7.0_f64.hypot(5.0)).abs() < 1e-12);
}

#[test]
fn a_single_frame_of_a_symmetric_board_is_said_to_be_ambiguous_and_a_guess_decides() {
    let mut scene = scene(3, 1, Board::chessboard(8, 6, 0.115).unwrap(), 5);
    scene.world_from_board[0] = Translation3::new(-0.4, 0.3, -0.3) * UnitQuaternion::identity();
    let mut recording = scene.recording(Freedom::POSE, 5);
    for spot in &mut recording.camera_frames[1].spots {
        spot.label = spot.label.map(|it| 47 - it);
    }
    let solution = solved(&recording, &scene.board);
    assert!(!solution.ambiguous.is_empty());
    for (guess, truth) in recording.cameras.iter_mut().zip(&scene.cameras) {
        let off = UnitQuaternion::from_scaled_axis(Vector3::new(0.1, -0.1, 0.1));
        guess.camera.camera_from_world = off * truth.camera_from_world;
    }
    let options = BoardOptions { poses_guessed: true, floor_time_s: Some(0.0), ..BoardOptions::default() };
    let solution = calibrate(&recording, &scene.board, &options).unwrap();
    let (centre, _) = errors(&solution, &scene.cameras);
    assert!(centre < 0.02 && solution.ambiguous.is_empty(), "{centre}");
    // The board on the floor is the world, with Z up.
    assert!(solution.solved.fixed.gravity.is_some());
    assert!(solution.solved.cameras.iter().all(|it| it.camera.centre().z > 0.3));
    assert!(solution.solved.points.iter().all(|it| it.position.z.abs() < 1e-9));
}

#[test]
fn a_pose_and_its_mirror_image_are_both_seen_and_the_frames_decide() {
    // Far away and small: each picture alone is nearly as well explained by the mirrored board.
    let mut scene = scene(2, 30, Board::charuco(5, 4, 0.04).unwrap(), 7);
    for camera in &mut scene.cameras {
        let focal = camera.intrinsics.focal.map(|it| 2.0 * it);
        *camera = Camera::look_at(Point3::from(camera.centre().coords * 2.0), Point3::origin(), [640, 480], focal[0]);
    }
    scene.noise_px = 0.5;
    let mut random = Random::new(7);
    let camera_frame = scene.camera_frame(0, 3, &mut random);
    let places: Vec<_> = camera_frame.spots.iter().map(|it| scene.board.place(it.label.unwrap()).unwrap()).collect();
    let pixels: Vec<_> = camera_frame.spots.iter().map(|it| it.pixel).collect();
    let poses = plane::poses(&scene.cameras[0], &places, &pixels, 6.0);
    assert_eq!(poses.len(), 2);
    let truth = scene.cameras[0].camera_from_world * scene.world_from_board[3];
    assert!(poses.iter().any(|it| it.camera_from_board.rotation.angle_to(&truth.rotation) < 0.1));
    let solution = solved(&scene.recording(Freedom::POSE, 7), &scene.board);
    // Two cameras: their distance and angle, against the truth.
    let relative = |cameras: [&Camera; 2]| cameras[1].camera_from_world * cameras[0].camera_from_world.inverse();
    let found = relative([&solution.solved.cameras[0].camera, &solution.solved.cameras[1].camera]);
    let truth = relative([&scene.cameras[0], &scene.cameras[1]]);
    assert!(found.rotation.angle_to(&truth.rotation) < 0.02, "{}", found.rotation.angle_to(&truth.rotation));
}

#[test]
fn one_camera_alone_gets_its_optics_and_one_that_saw_nothing_is_named() {
    let scene = scene(2, 15, charuco(), 11);
    let mut recording = scene.recording(ALL, 11);
    recording.camera_frames.iter_mut().filter(|it| it.camera == 1).for_each(|it| it.spots.clear());
    let solution = solved(&recording, &scene.board);
    let cameras = &solution.solved.cameras;
    assert_eq!(cameras[0].status, CameraStatus::Calibrated);
    let ratio = cameras[0].camera.intrinsics.focal[0] / scene.cameras[0].intrinsics.focal[0];
    assert!(
        (ratio - 1.0).abs() < 0.03,
        "{ratio} {:?} {:?} {:?}",
        solution.solved.steps,
        cameras[0].camera.intrinsics,
        scene.cameras[0].intrinsics
    );
    assert_eq!(cameras[1].status, CameraStatus::TooFewObservations { frames: 0, needed: 1 });
    assert_eq!(cameras[1].camera, recording.cameras[1].camera);
}

#[test]
fn optics_that_the_views_cannot_hold_are_refused_with_the_reason() {
    let refusals = |scene: &Scene| {
        let recording = scene.recording(ALL, 13);
        solved_or_refused(&recording, &scene.board)
    };
    let of = |fit: &OpticsFit, what: Optic| fit.refused.iter().find(|it| it.what == what).map(|it| it.why);
    let few = refusals(&scene(1, 2, charuco(), 13));
    assert_eq!(of(&few, Optic::Focal), Some(OpticsRefusal::TooFewViews { views: 2, needed: 3 }));
    // Twelve pictures of a board that lies still are one view.
    let mut still = scene(1, 12, charuco(), 13);
    let first = still.world_from_board[0];
    still.world_from_board.fill(first);
    assert_eq!(of(&refusals(&still), Optic::Focal), Some(OpticsRefusal::TooFewViews { views: 1, needed: 3 }));
    // Parallel to the picture all the time.
    let mut flat = scene(1, 12, charuco(), 13);
    let facing = flat.cameras[0].camera_from_world.rotation.inverse()
        * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    for pose in &mut flat.world_from_board {
        pose.rotation = facing;
        pose.translation.vector *= 0.3;
    }
    assert!(
        matches!(of(&refusals(&flat), Optic::Focal), Some(OpticsRefusal::ViewsParallel { .. })),
        "{:?}",
        refusals(&flat).refused
    );
    // As is guessed for an unknown camera: the reason is the board that was never tilted, rather than wrong optics.
    let mut guessed = flat.recording(ALL, 13);
    guessed.cameras[0].camera.intrinsics.focal = [4000.0; 2];
    let fault = calibrate(&guessed, &flat.board, &BoardOptions::default()).unwrap_err();
    assert!(matches!(fault, BoardError::NeverTilted { .. }), "{fault:?}");
    // A focal length that was stated is kept, and the camera is placed by it.
    let mut stated = flat.recording(ALL, 13);
    stated.cameras[0].camera.intrinsics = flat.cameras[0].intrinsics;
    let options = BoardOptions { focal_guessed: false, ..BoardOptions::default() };
    let solution = calibrate(&stated, &flat.board, &options).unwrap();
    let camera = &solution.solved.cameras[0];
    assert_eq!((camera.status.clone(), camera.freed.focal), (CameraStatus::Calibrated, false));
    assert_eq!(camera.camera.intrinsics.focal, flat.cameras[0].intrinsics.focal);
    // Small, and in the middle of the picture.
    let mut middle = scene(1, 12, Board::charuco(8, 6, 0.015).unwrap(), 13);
    middle.world_from_board.iter_mut().for_each(|it| it.translation.vector *= 0.05);
    let fit = refusals(&middle);
    assert!(matches!(of(&fit, Optic::K2), Some(OpticsRefusal::MiddleOnly { .. })), "{:?}", fit.refused);
}

#[test]
fn boards_of_one_direction_are_told_from_boards_of_several() {
    let pose = |tilt: f64, way: f64| {
        UnitQuaternion::from_scaled_axis(Vector3::new(tilt * way.cos(), tilt * way.sin(), 0.0)) * Vector3::z()
    };
    assert_eq!(one_angle(&[pose(0.5, 0.0)]), None);
    assert!(one_angle(&[pose(0.5, 0.0), pose(0.53, 0.1), pose(0.5, 0.05)]).is_some_and(|it| it < 0.1));
    assert_eq!(one_angle(&[pose(0.5, 0.0), pose(0.5, 1.0), pose(0.5, 3.0)]), None);
}

#[test]
fn one_or_two_pictures_are_told_for_what_they_are() {
    for n in [1, 2] {
        let scene = scene(1, n, charuco(), 13);
        let mut recording = scene.recording(ALL, 13);
        // As is guessed of a camera of which nothing is known.
        recording.cameras[0].camera.intrinsics.focal = [4000.0; 2];
        let fault = calibrate(&recording, &scene.board, &BoardOptions::default()).unwrap_err();
        let BoardError::TooFewViews { views, needed: 3, .. } = fault else { panic!("{fault}") };
        assert_eq!(views, n);
    }
}

fn solved_or_refused(recording: &Recording, board: &Board) -> OpticsFit {
    match calibrate(recording, board, &BoardOptions::default()) {
        Ok(solution) => solution.optics[0].clone(),
        Err(BoardError::NoPose { .. } | BoardError::TooFewViews { .. } | BoardError::NeverTilted { .. }) => {
            // With its focal length known it can be placed; the refusals are those of the optics alone.
            let (camera_frames, views) = (recording, views::views_of(recording, board, &BoardOptions::default()));
            optics::fit(
                &camera_frames.cameras[0].camera,
                camera_frames.cameras[0].free,
                &views.iter().collect::<Vec<_>>(),
                &BoardOptions::default(),
            )
        }
        Err(fault) => panic!("{fault}"),
    }
}

#[test]
fn wrong_and_doubled_numbers_do_little_harm() {
    let scene = scene(3, 20, charuco(), 17);
    let mut recording = scene.recording(Freedom::POSE, 17);
    let mut random = Random::new(17);
    let mut doubled = 0;
    for camera_frame in &mut recording.camera_frames {
        for spot in &mut camera_frame.spots {
            if random.uniform() < 0.1 {
                spot.pixel += Vector2::new(random.normal(), random.normal()) * 40.0;
            }
        }
        if let Some(first) = camera_frame.spots.first().copied() {
            camera_frame.spots.push(Spot { pixel: first.pixel + Vector2::new(30.0, 0.0), ..first });
            camera_frame.spots.push(Spot { pixel: first.pixel * f64::NAN, label: Some(3), ..first });
            doubled += 3;
        }
    }
    let solution = solved(&recording, &scene.board);
    assert_eq!(solution.unusable_spots, doubled);
    let (centre, _) = errors(&solution, &scene.cameras);
    assert!(centre < 0.01, "{centre}");
    assert!(solution.solved.observations.iter().any(|it| it.role == ObservationRole::Rejected));
}

#[test]
fn a_board_of_another_size_and_pictures_without_one_are_refused() {
    let scene = scene(2, 8, Board::chessboard(8, 6, 0.05).unwrap(), 19);
    let recording = scene.recording(Freedom::POSE, 19);
    let fault = calibrate(&recording, &Board::chessboard(6, 8, 0.05).unwrap(), &BoardOptions::default()).unwrap_err();
    assert!(matches!(fault, BoardError::OtherBoard { .. }), "{fault}");
    let mut blank = recording.clone();
    blank.camera_frames.iter_mut().for_each(|it| it.spots.clear());
    let fault = calibrate(&blank, &scene.board, &BoardOptions::default()).unwrap_err();
    assert!(matches!(fault, BoardError::NoBoardSeen { unusable: 0, .. }), "{fault}");
    assert!(matches!(
        calibrate(&Recording::default(), &scene.board, &BoardOptions::default()),
        Err(BoardError::NoBoardSeen { .. })
    ));
    let mut wrong = recording.clone();
    wrong.camera_frames[0].camera = 9;
    assert!(matches!(
        calibrate(&wrong, &scene.board, &BoardOptions::default()),
        Err(BoardError::NoSuchCamera { camera_frame: 0, camera: 9, cameras: 2 })
    ));
    let options = BoardOptions { inlier_px: f64::NAN, ..BoardOptions::default() };
    assert!(matches!(
        calibrate(&recording, &scene.board, &options),
        Err(BoardError::BadOption { option: "inlier_px", .. })
    ));
    for (columns, rows, square_m) in
        [(1, 6, 0.1), (8, 1, 0.1), (8, 6, 0.0), (8, 6, -0.1), (8, 6, f64::NAN), (8, 1000, 0.1)]
    {
        assert!(Board::chessboard(columns, rows, square_m).is_err(), "{columns} x {rows}, {square_m}");
    }
    assert!(Board::charuco(2, 5, 0.1).is_err() && Board::charuco(0, 0, 0.1).is_err());
}

#[test]
fn optics_are_not_bent_to_make_up_for_a_clock_that_differs() {
    let mut scene = scene(3, 24, charuco(), 29);
    let mut recording = scene.recording(ALL, 29);
    // The third camera saw the board where it was later: up to some centimetres away.
    let mut random = Random::new(29).fork("motion");
    for board in &mut scene.world_from_board {
        let moved = Vector3::new(random.normal(), random.normal(), random.normal()) * 0.02;
        *board = Translation3::from(moved) * *board;
    }
    let later = scene.recording(ALL, 29);
    for (camera_frame, later) in
        recording.camera_frames.iter_mut().zip(later.camera_frames).filter(|it| it.0.camera == 2)
    {
        *camera_frame = later;
    }
    let solution = solved(&recording, &scene.board);
    for (found, truth) in solution.solved.cameras.iter().zip(&scene.cameras) {
        let ratio = found.camera.intrinsics.focal[0] / truth.intrinsics.focal[0];
        assert!((ratio - 1.0).abs() < 0.03, "{}: {ratio}", found.name);
    }
    let contradicted: Vec<bool> = solution.optics.iter().map(|it| it.contradicted).collect();
    assert!(contradicted.contains(&true), "{contradicted:?}");
}

#[test]
fn two_groups_that_share_no_frame_are_told_apart() {
    let scene = scene(4, 24, charuco(), 23);
    let mut recording = scene.recording(Freedom::POSE, 23);
    recording.camera_frames.retain(|it| ((it.time_s * 10.0).round() as usize).is_multiple_of(2) == (it.camera < 2));
    let solution = solved(&recording, &scene.board);
    let statuses: Vec<_> = solution.solved.cameras.iter().map(|it| it.status.clone()).collect();
    let separate = |it: &&CameraStatus| matches!(it, CameraStatus::Separate { .. });
    assert_eq!(statuses.iter().filter(separate).count(), 2, "{statuses:?}");
}
