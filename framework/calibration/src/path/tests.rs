//! Simulated recordings with known truth, by a model that is not the solver's: rolling shutters, a lens with more terms, clocks that jitter,
//! marks of another thing, and rows of the path with noise.

use foveate_estimation::Random;
use foveate_geometry::{Camera, Distortion, Freedom};
use nalgebra::{Point2, Point3, Translation3, Vector3};

use super::*;
use crate::checks::Level;
use crate::recording::{CameraFrame, CameraGuess, Spot};

/// How long a picture takes from its first row to its last [s].
const ROLLING_S: f64 = 0.02;

/// A path with the frequencies of a flight by hand; `kind` makes other ones.
fn flight(kind: u64, time_s: f64) -> Point3<f64> {
    let mut random = Random::new(kind).fork("flight");
    let mut axis = |reach: f64| -> f64 {
        (0..4)
            .map(|it| {
                let period = random.uniform_in(9.0, 16.0) * (1.0 + f64::from(it));
                reach
                    * random.uniform_in(0.2, 0.4)
                    * (time_s / period * std::f64::consts::TAU + random.uniform_in(0.0, 6.0)).sin()
            })
            .sum()
    };
    Point3::new(axis(40.0), axis(30.0), 15.0 + axis(12.0))
}

fn rows(length_s: f64, at: impl Fn(f64) -> Point3<f64>) -> Vec<(f64, Point3<f64>)> {
    let mut random = Random::new(7).fork("rtk");
    let mut noise = || 0.01 * random.normal();
    let times = (0..(5.0 * length_s) as usize).map(|it| it as f64 / 5.0);
    times.map(|it| (it, at(it) + Vector3::new(noise(), noise(), 1.5 * noise()))).collect()
}

#[derive(Debug, Clone)]
struct Simulated {
    camera: Camera,
    /// Path time = offset + rate · camera time [s].
    offset_s: f64,
    rate: f64,
    length_s: f64,
    frame_rate_hz: f64,
    /// Part of the pictures in which another thing was marked, in runs [–].
    wrong: f64,
    /// By how much the clock runs to and fro, as with a variable rate [s].
    wander_s: f64,
    mirrored: bool,
    /// Degrees of the sixth power and prism terms, beyond what the solver knows.
    strange_lens: bool,
}

impl Simulated {
    fn new(index: usize) -> Simulated {
        let angle = 1.3 * index as f64 + 0.4;
        let centre = Point3::new(75.0 * angle.cos(), 70.0 * angle.sin(), 1.5 + index as f64);
        let mut camera = Camera::look_at(centre, Point3::new(0.0, 0.0, 15.0), [1920, 1080], 1500.0);
        camera.distortion = Distortion { k1: 0.06, k2: -0.1, p1: 5e-4, p2: -4e-4, k3: 0.03 };
        Simulated {
            camera,
            offset_s: [-17.3, 12.7, 31.1, 3.9][index % 4],
            rate: [1.0, 1.001, 1.0, 0.9996][index % 4],
            length_s: 60.0,
            frame_rate_hz: [25.0, 29.97, 30.0, 24.0][index % 4],
            wrong: 0.08,
            wander_s: 0.0,
            mirrored: false,
            strange_lens: true,
        }
    }

    /// Where the point is marked while it is there.
    fn project(&self, point: &Point3<f64>) -> Option<Point2<f64>> {
        let in_camera = self.camera.camera_from_world * point;
        if in_camera.z <= 0.5 {
            return None;
        }
        let (x, y) = (in_camera.x / in_camera.z, in_camera.y / in_camera.z);
        let (r2, d) = (x * x + y * y, self.camera.distortion);
        let more = if self.strange_lens { 0.01 * r2.powi(4) } else { 0.0 };
        let prism = if self.strange_lens { 2e-4 * r2 } else { 0.0 };
        let f = 1.0 + r2 * (d.k1 + r2 * (d.k2 + r2 * d.k3)) + more;
        let u = x * f + 2.0 * d.p1 * x * y + d.p2 * (r2 + 2.0 * x * x) + prism;
        let v = y * f + d.p1 * (r2 + 2.0 * y * y) + 2.0 * d.p2 * x * y - prism;
        let [fx, fy] = self.camera.intrinsics.focal;
        let [cx, cy] = self.camera.intrinsics.principal;
        Some(Point2::new(fx * u + cx, fy * v + cy)).filter(|it| self.camera.has_pixel(it))
    }

    fn camera_frames(&self, index: usize, path: &impl Fn(f64) -> Point3<f64>) -> Vec<CameraFrame> {
        let mut random = Random::new(99).fork(&format!("camera {index}"));
        let n = (self.length_s * self.frame_rate_hz) as usize;
        let (mut camera_frames, mut wrong_until) = (Vec::new(), 0);
        for frame in 0..n {
            let camera_s = frame as f64 / self.frame_rate_hz;
            let varied = camera_s + self.wander_s * (camera_s / self.length_s * 9.0).sin() + 1e-3 * random.normal();
            let path_s = self.offset_s + self.rate * varied;
            // A row further down is taken later.
            let first = self.project(&path(path_s));
            let pixel = first.and_then(|it| self.project(&path(path_s + ROLLING_S * it.y / 1080.0)));
            if frame >= wrong_until && random.uniform() < self.wrong / 12.0 {
                wrong_until = frame + 12;
            }
            let other = flight(77 + index as u64, 0.5 * path_s);
            let marked = if frame < wrong_until { self.project(&other) } else { pixel };
            let mut spots = Vec::new();
            if let Some(it) = marked {
                let mut pixel = it + nalgebra::Vector2::new(random.normal(), random.normal()) * 0.8;
                if self.mirrored {
                    pixel.x = 1919.0 - pixel.x;
                }
                spots.push(Spot { pixel, sigma_px: 2.0, peak: 0.0, label: None });
            }
            camera_frames.push(CameraFrame { camera: index, time_s: camera_s, spots });
        }
        camera_frames
    }
}

fn recording(simulated: &[Simulated], path: &impl Fn(f64) -> Point3<f64>) -> Recording {
    let guess = |(index, it): (usize, &Simulated)| {
        let camera = Camera { camera_from_world: Default::default(), ..it.camera.clone() };
        CameraGuess { name: format!("cam{index}"), camera, free: Freedom::POSE }
    };
    let cameras = simulated.iter().enumerate().map(guess).collect();
    let camera_frames = simulated.iter().enumerate().flat_map(|(index, it)| it.camera_frames(index, path)).collect();
    Recording { cameras, camera_frames }
}

fn solve(simulated: &[Simulated]) -> PathNetwork {
    let path = |time_s: f64| flight(1, time_s);
    calibrate(&recording(simulated, &path), &MeasuredPath::new(&rows(80.0, path)).unwrap(), &PathOptions::default())
}

#[track_caller]
fn assert_found(network: &PathNetwork, index: usize, truth: &Simulated) {
    let found = network.cameras[index].as_ref().unwrap_or_else(|it| panic!("cam{index}: {it}"));
    let camera = &network.solved.cameras[index];
    let off = (camera.camera.centre() - truth.camera.centre()).norm();
    let turn = camera.camera.camera_from_world.rotation.angle_to(&truth.camera.camera_from_world.rotation);
    // Half of a rolling picture is the offset that one clock for all rows leaves.
    let middle = 0.5 * truth.length_s;
    let clock = found.offset_s + (1.0 + found.drift) * middle - truth.offset_s - truth.rate * middle - 0.5 * ROLLING_S;
    let figures = format!(
        "cam{index}: {off:.3} ± {:.3} m, {:.2} ± {:.2} mrad, {:.1} ± {:.1} ms, drift {:+.0} ppm, {:.1} % right, {:.2} px",
        found.centre_sigma_m,
        1e3 * turn,
        1e3 * found.turn_sigma,
        1e3 * clock,
        1e3 * found.offset_sigma_s,
        1e6 * found.drift,
        100.0 * found.share(),
        found.used_px[0]
    );
    println!("{figures}");
    assert!(off < 0.25 && off < 5.0 * found.centre_sigma_m + 0.1, "{figures}");
    assert!(turn < 3e-3, "{figures}");
    assert!(clock.abs() < 0.015, "{figures}");
    assert!((found.drift - (truth.rate - 1.0)).abs() < 3e-4, "{figures}");
}

#[test]
fn poses_and_clocks_are_found_whatever_the_offset() {
    let simulated: Vec<Simulated> = (0..3).map(Simulated::new).collect();
    let network = solve(&simulated);
    for (index, truth) in simulated.iter().enumerate() {
        assert_found(&network, index, truth);
        assert!(network.cameras[index].as_ref().unwrap().share() > 0.85);
    }
    let verdict = network.verdict(&PathOptions::default());
    assert_eq!(verdict.level, Level::Good, "{:?}", verdict.sentences);
    // The session begins with whoever is first: camera 0, 17 s before the path.
    assert!(
        (network.session_from_s + 17.3).abs() < 0.02 && (network.path_start_s - 17.3).abs() < 0.02,
        "{}",
        network.session_from_s
    );
    let clock = network.solved.cameras[2].clock.unwrap();
    assert!((clock.room_s(0.0) - (31.1 + 17.3)).abs() < 0.03, "{clock:?}");
    let again = solve(&simulated[..1]);
    assert_eq!(network.cameras[0], again.cameras[0], "the same input gives the same answer, whoever stands beside");
}

#[test]
fn a_camera_that_mostly_saw_another_thing_is_refused_and_the_others_stand() {
    let mut simulated: Vec<Simulated> = (0..2).map(Simulated::new).collect();
    simulated[1].wrong = 4.0;
    let network = solve(&simulated);
    let refusal = network.cameras[1].as_ref().unwrap_err();
    assert!(matches!(refusal, Refusal::Disagrees { right, of, .. } if 2 * right < *of), "{refusal}");
    assert!(matches!(network.solved.cameras[1].status, CameraStatus::Inconsistent { .. }));
    assert_found(&network, 0, &simulated[0]);
    let verdict = network.verdict(&PathOptions::default());
    assert_eq!(verdict.level, Level::Usable);
    assert!(verdict.findings.iter().any(|it| it.camera.as_deref() == Some("cam1") && it.cause == "false_observations"));
}

#[test]
fn a_third_of_marks_on_another_thing_does_no_harm_and_is_told() {
    let mut simulated = vec![Simulated::new(0)];
    simulated[0].wrong = 0.55;
    let network = solve(&simulated);
    assert_found(&network, 0, &simulated[0]);
    let share = network.cameras[0].as_ref().unwrap().share();
    assert!((0.5..0.75).contains(&share), "{share}");
    assert_eq!(network.verdict(&PathOptions::default()).level, Level::Usable);
}

#[test]
fn mirrored_pictures_and_left_handed_paths_are_named() {
    let mut simulated: Vec<Simulated> = (0..2).map(Simulated::new).collect();
    simulated[1].mirrored = true;
    let network = solve(&simulated);
    assert_found(&network, 0, &simulated[0]);
    assert!(matches!(network.cameras[1], Err(Refusal::Mirrored { .. })), "{:?}", network.cameras[1]);
    assert!(!network.other_hand);
    let path = |time_s: f64| flight(1, time_s);
    let swapped = |time_s: f64| Point3::new(path(time_s).y, path(time_s).x, path(time_s).z);
    let simulated = [Simulated::new(0)];
    let measured = MeasuredPath::new(&rows(80.0, swapped)).unwrap();
    let network = calibrate(&recording(&simulated, &path), &measured, &PathOptions::default());
    assert!(network.other_hand);
    let verdict = network.verdict(&PathOptions::default());
    assert_eq!((verdict.level, verdict.findings[0].cause), (Level::Redo, "path_left_handed"));
}

#[test]
fn a_loop_that_repeats_leaves_the_clock_ambiguous() {
    let lap = |time_s: f64| {
        let angle = time_s / 20.0 * std::f64::consts::TAU;
        Point3::new(30.0 * angle.cos(), 25.0 * angle.sin(), 15.0 + 8.0 * (2.0 * angle).sin())
    };
    let mut simulated = Simulated::new(1);
    simulated.length_s = 30.0;
    let measured = MeasuredPath::new(&rows(80.0, lap)).unwrap();
    let network = calibrate(&recording(&[simulated], &lap), &measured, &PathOptions::default());
    let Err(Refusal::ClockAmbiguous { offset_s, other_s, .. }) = network.cameras[0] else {
        panic!("{:?}", network.cameras[0])
    };
    // After half a lap it looks the same from the other side.
    let laps = (offset_s - other_s) / 10.0;
    assert!((laps - laps.round()).abs() < 0.02 && laps.round() != 0.0, "{offset_s} {other_s}");
    assert_eq!(network.verdict(&PathOptions::default()).level, Level::Redo);
}

#[test]
fn what_a_camera_saw_too_little_of_fixes_nothing() {
    let short = Simulated { length_s: 1.2, ..Simulated::new(0) };
    let before = Simulated { offset_s: -500.0, ..Simulated::new(1) };
    let simulated = [short, before];
    let network = solve(&simulated);
    assert!(matches!(network.cameras[0], Err(Refusal::TooFew { .. })), "{:?}", network.cameras[0]);
    // Of a camera that recorded before the path began, whatever fits by chance is little.
    assert!(network.cameras[1].is_err(), "{:?}", network.cameras[1]);
    assert!(network.solved.observations.is_empty() && network.solved.points.is_empty());
}

#[test]
fn a_flat_path_far_away_has_two_poses() {
    let flat = |time_s: f64| Point3::new(flight(1, time_s).x, flight(1, time_s).y, 0.0);
    let mut simulated = Simulated::new(0);
    simulated.camera =
        Camera::look_at(Point3::new(25_000.0, 4000.0, 9000.0), Point3::origin(), [1920, 1080], 400_000.0);
    simulated.strange_lens = false;
    let measured = MeasuredPath::new(&rows(80.0, flat)).unwrap();
    let network = calibrate(&recording(&[simulated], &flat), &measured, &PathOptions::default());
    assert!(
        matches!(network.cameras[0], Err(Refusal::TwoPoses { .. } | Refusal::Weak { .. })),
        "{:?}",
        network.cameras[0]
    );
}

#[test]
fn a_focal_length_that_nobody_stated_is_found() {
    let simulated = [Simulated::new(0)];
    let path = |time_s: f64| flight(1, time_s);
    let mut recording = recording(&simulated, &path);
    recording.cameras[0].camera.intrinsics.focal = [2300.0; 2];
    recording.cameras[0].camera.distortion = Distortion::default();
    recording.cameras[0].free = Freedom { focal: true, k1: true, k2: true, ..Freedom::POSE };
    let measured = MeasuredPath::new(&rows(80.0, path)).unwrap();
    let options = PathOptions { focal_unknown: true, ..PathOptions::default() };
    let network = calibrate(&recording, &measured, &options);
    let found = network.cameras[0].as_ref().unwrap_or_else(|it| panic!("{it}"));
    let focal = network.solved.cameras[0].camera.intrinsics.focal[0];
    println!("focal {focal:.1} px, {:.1} % right", 100.0 * found.share());
    assert!((focal / 1500.0 - 1.0).abs() < 0.01, "{focal}");
}

#[test]
fn a_clock_that_runs_to_and_fro_is_told() {
    let simulated = [Simulated { wander_s: 0.12, length_s: 75.0, offset_s: 2.0, ..Simulated::new(0) }];
    let network = solve(&simulated);
    let verdict = network.verdict(&PathOptions::default());
    assert!(
        verdict.findings.iter().any(|it| it.cause == "clock_unsteady"),
        "{:?} {:?}",
        network.cameras,
        verdict.sentences
    );
}

#[test]
fn a_path_in_national_coordinates_gives_the_same_camera() {
    let simulated = [Simulated::new(1)];
    let far = Vector3::new(2_683_000.0, 1_247_000.0, 430.0);
    let path = |time_s: f64| flight(1, time_s);
    let shifted: Vec<_> = rows(80.0, path).into_iter().map(|it| (it.0 + 1.7e9, it.1 + far)).collect();
    let network =
        calibrate(&recording(&simulated, &path), &MeasuredPath::new(&shifted).unwrap(), &PathOptions::default());
    let camera = &network.solved.cameras[0];
    assert!((camera.camera.centre() - far - simulated[0].camera.centre()).norm() < 0.25, "{:?}", network.cameras);
    assert!(
        network.session_from_s > 1.6e9 && camera.clock.unwrap().offset_s.abs() < 60.0,
        "{}",
        network.session_from_s
    );
    let here = camera.camera.camera_from_world * Translation3::from(far);
    assert!((here.translation.vector - simulated[0].camera.camera_from_world.translation.vector).norm() < 0.5);
}
