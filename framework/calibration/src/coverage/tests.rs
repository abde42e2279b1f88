//! Waved lights in a simulated room, held against whether they can be calibrated.

use std::f64::consts::{PI, TAU};

use foveate_estimation::Random;
use foveate_geometry::{
    AlignmentOptions, CameraStatus, Freedom, LightObservation, SelfCalibrationOptions, camera_errors, self_calibrate,
};
use nalgebra::{Point3, Vector2, Vector3};

use super::*;
use crate::recording::Spot;

const SIGMA_PX: f64 = 0.5;
const FRAME_S: f64 = 1.0 / 30.0;

/// Cameras under the ceiling of a room of 3.5 × 5 × 2.5 m, aimed across it.
fn cameras(n: usize, seed: u64) -> Vec<CameraGuess> {
    let mut random = Random::new(seed).fork("cameras");
    let camera = |index: usize| {
        let angle = TAU * index as f64 / n as f64;
        let centre = Point3::new(2.6 * angle.cos(), 3.4 * angle.sin(), 2.7 + 0.2 * random.normal());
        let mut across = || angle + PI * random.uniform_in(0.6, 1.4);
        let target = Point3::new(0.9 * across().cos(), 1.3 * across().sin(), 1.0);
        let camera = Camera::look_at(centre, target, [640, 480], 420.0);
        CameraGuess { name: format!("wide-{}", index + 1), camera, free: Freedom::POSE }
    };
    (0..n).map(camera).collect()
}

/// A person who walks to one random place after the other, at random speeds, within a box.
struct Waving {
    random: Random,
    low: Point3<f64>,
    high: Point3<f64>,
    from: Point3<f64>,
    to: Point3<f64>,
    part: f64,
    speed: f64,
}

impl Waving {
    fn new(seed: u64, low: [f64; 3], high: [f64; 3]) -> Self {
        let (low, high) = (Point3::from(low), Point3::from(high));
        Self { random: Random::new(seed).fork("waving"), low, high, from: low, to: low, part: 1.0, speed: 0.0 }
    }

    fn network(seed: u64) -> Self {
        Self::new(seed, [-1.7, -2.4, 0.3], [1.7, 2.4, 2.1])
    }

    fn next(&mut self) -> Point3<f64> {
        if self.part >= 1.0 {
            self.from = self.to;
            let draw = Vector3::from_fn(|_, _| self.random.uniform());
            self.to = self.low + (self.high - self.low).component_mul(&draw);
            self.speed = self.random.uniform_in(0.8, 2.0);
            self.part = 0.0;
        }
        let way = self.to - self.from;
        self.part += self.speed * FRAME_S / way.norm().max(1e-3);
        self.from + way * self.part.min(1.0)
    }
}

fn spot(pixel: Point2<f64>, peak: f64) -> Spot {
    Spot { pixel, sigma_px: SIGMA_PX, peak, label: None }
}

/// A light waved in front of cameras, frame by frame.
struct Take {
    cameras: Vec<CameraGuess>,
    coverage: Coverage,
    observations: Vec<LightObservation>,
    noise: Random,
    frame: usize,
    /// Part of the observations that is missing, and of the rest that is anywhere.
    hidden: f64,
    wrong: f64,
}

impl Take {
    fn new(n: usize, seed: u64) -> Self {
        let cameras = cameras(n, seed);
        let coverage = Coverage::new(&cameras, &CoverageOptions::default());
        let noise = Random::new(seed).fork("noise");
        Self { cameras, coverage, observations: Vec::new(), noise, frame: 0, hidden: 0.0, wrong: 0.0 }
    }

    fn frame(&mut self, light: &Point3<f64>) {
        for (index, guess) in self.cameras.iter().enumerate() {
            let hidden = self.noise.uniform() < self.hidden;
            let seen = guess.camera.sees(light).filter(|_| !hidden);
            let noise = Vector2::new(self.noise.normal(), self.noise.normal()) * SIGMA_PX;
            let mut pixel = seen.map(|it| it + noise).filter(|it| guess.camera.has_pixel(it));
            if pixel.is_some() && self.noise.uniform() < self.wrong {
                pixel = Some(Point2::new(self.noise.uniform_in(0.0, 639.0), self.noise.uniform_in(0.0, 479.0)));
            }
            let spots = pixel.map(|it| spot(it, 200.0)).into_iter().collect();
            self.coverage.observe(&CameraFrame { camera: index, time_s: self.frame as f64 * FRAME_S, spots });
            let frame = self.frame;
            self.observations.extend(pixel.map(|pixel| LightObservation { camera: index, frame, pixel }));
        }
        self.frame += 1;
    }

    /// Waves until it is enough, asked once a second; `None` when it never is.
    fn until_enough(&mut self, limit: usize, mut light: impl FnMut() -> Point3<f64>) -> Option<usize> {
        while self.frame < limit {
            for _ in 0..30 {
                self.frame(&light());
            }
            if self.coverage.state().enough {
                return Some(self.frame);
            }
        }
        None
    }

    /// Root mean square error of the centres [m]; `None` unless all cameras are calibrated.
    fn error_m(&self, focal_guess: f64) -> Option<f64> {
        let truth: Vec<Camera> = self.cameras.iter().map(|it| it.camera.clone()).collect();
        let mut given = truth.clone();
        given.iter_mut().for_each(|it| it.intrinsics.focal = it.intrinsics.focal.map(|focal| focal * focal_guess));
        let free = vec![Freedom { focal: focal_guess != 1.0, ..Freedom::POSE }; given.len()];
        let found = self_calibrate(&given, &free, &self.observations, &SelfCalibrationOptions::default()).ok()?;
        let whole = found.status.iter().all(|it| *it == CameraStatus::Calibrated);
        let similarity = AlignmentOptions { scale: true, robust: false };
        let centres = camera_errors(&found.cameras, &truth, similarity).ok().filter(|_| whole)?.centres;
        Some((centres.iter().map(|it| it * it).sum::<f64>() / centres.len() as f64).sqrt())
    }
}

#[track_caller]
fn assert_misses(coverage: &Coverage, is_it: impl Fn(&Advice) -> bool) {
    let missing = coverage.state().missing;
    assert!(missing.iter().any(is_it), "{missing:#?}");
}

/// `FOVEATE_SEEDS=20` for as many rooms and wavings of each kind as docs/results.md states.
#[test]
fn what_is_enough_can_be_calibrated() {
    let seeds = std::env::var("FOVEATE_SEEDS").ok().and_then(|it| it.parse().ok()).unwrap_or(2);
    for (n, hidden, wrong, focal_guess) in [(18, 0.0, 0.0, 1.0), (18, 0.6, 0.05, 1.0), (6, 0.2, 0.0, 1.15)] {
        let (mut taken, mut errors_mm) = (Vec::new(), Vec::new());
        for seed in 0..seeds {
            let mut take = Take { hidden, wrong, ..Take::new(n, seed) };
            let mut waving = Waving::network(seed);
            let frames = take.until_enough(6000, || waving.next());
            let error = take.error_m(focal_guess);
            assert!(
                frames.is_some() && error.is_some_and(|it| it < 0.01),
                "{n} cameras, seed {seed}: enough after {frames:?} frames, then {error:?} m; {:#?}",
                take.coverage.state()
            );
            taken.extend(frames);
            errors_mm.extend(error.map(|it| 1e3 * it));
        }
        taken.sort_unstable();
        errors_mm.sort_by(f64::total_cmp);
        println!(
            "{n} cameras, {hidden} hidden, {wrong} wrong: enough after {taken:?} frames, centres to {errors_mm:.2?} mm"
        );
    }
}

#[test]
fn bad_waving_is_never_enough() {
    for seed in 0..5 {
        let says = |what: &str, mut light: Box<dyn FnMut() -> Point3<f64>>, hidden: f64, wrong: f64| {
            let mut take = Take { hidden, wrong, ..Take::new(18, seed) };
            let frames = take.until_enough(3000, &mut light);
            assert_eq!(frames, None, "{what}");
            take.coverage
        };
        let flat = || Waving::new(seed, [-1.7, -2.4, 1.2], [1.7, 2.4, 1.2]);
        for (hidden, wrong) in [(0.0, 0.0), (0.3, 0.1)] {
            let mut waving = flat();
            let coverage = says("flat", Box::new(move || waving.next()), hidden, wrong);
            assert_misses(&coverage, |it| matches!(it, Advice::Flat { .. }));
        }
        let mut corner = Waving::new(seed, [1.2, 1.8, 0.8], [1.7, 2.4, 1.3]);
        let coverage = says("corner", Box::new(move || corner.next()), 0.0, 0.0);
        assert_misses(&coverage, |it| matches!(it, Advice::Narrow { .. }));
        let still = says("still", Box::new(|| Point3::new(0.2, 0.1, 1.0)), 0.0, 0.0);
        assert_eq!(still.state().missing, [Advice::LightStill]);
    }
}

#[test]
fn a_stationary_light_beside_the_waved_one_is_named_and_does_not_count() {
    let mut take = Take::new(4, 3);
    let mut waving = Waving::network(3);
    let lamp = Point2::new(312.2, 40.1);
    let guesses = take.cameras.clone();
    for frame in 0..400 {
        let light = waving.next();
        for (camera, guess) in guesses.iter().enumerate() {
            let mut spots: Vec<Spot> = guess.camera.sees(&light).map(|it| spot(it, 100.0)).into_iter().collect();
            if camera == 2 {
                spots.push(spot(lamp + Vector2::new(0.1 * take.noise.normal(), 0.0), 250.0));
            }
            take.coverage.observe(&CameraFrame { camera, time_s: f64::from(frame) * FRAME_S, spots });
        }
    }
    let missing = take.coverage.state().missing;
    let standing = missing.iter().filter_map(|it| match it {
        Advice::StandingLight { camera, pixel } => Some((camera.as_str(), *pixel)),
        _ => None,
    });
    let [("wide-3", pixel)] = standing.collect::<Vec<_>>()[..] else { panic!("{missing:#?}") };
    assert!((pixel - lamp).norm() < 1.0, "{pixel}");
    let lamp_cell = usize::from(take.coverage.cells(2)[3]);
    assert!(lamp_cell < 60, "{lamp_cell}");
    // Once covered, it is forgotten.
    for frame in 400..600 {
        let light = waving.next();
        for (camera, guess) in guesses.iter().enumerate() {
            let spots = guess.camera.sees(&light).map(|it| spot(it, 100.0)).into_iter().collect();
            take.coverage.observe(&CameraFrame { camera, time_s: f64::from(frame) * FRAME_S, spots });
        }
    }
    assert!(!take.coverage.state().missing.iter().any(|it| matches!(it, Advice::StandingLight { .. })));
}

#[test]
fn two_waved_lights_are_named_unless_they_are_a_wand() {
    for (lights, told) in [(1, true), (2, false)] {
        let guesses = cameras(4, 5);
        let mut coverage = Coverage::new(&guesses, &CoverageOptions { lights, ..CoverageOptions::default() });
        let mut waving = [Waving::network(5), Waving::network(6)];
        for frame in 0..300 {
            let places = [waving[0].next(), waving[1].next()];
            for (camera, guess) in guesses.iter().enumerate() {
                let spots = places.iter().filter_map(|it| guess.camera.sees(it)).map(|it| spot(it, 100.0)).collect();
                coverage.observe(&CameraFrame { camera, time_s: f64::from(frame) * FRAME_S, spots });
            }
        }
        assert_eq!(coverage.state().missing.iter().any(|it| matches!(it, Advice::SeveralLights { .. })), told);
    }
}

/// Pictures of cameras that see the light in pairs, as often as `pairs` says: any view graph.
fn linked(pairs: &[(usize, usize, u32)], n: usize) -> Coverage {
    let guesses = cameras(n, 1);
    let mut coverage = Coverage::new(&guesses, &CoverageOptions::default());
    let mut random = Random::new(4);
    let mut time_s = 0.0;
    for &(a, b, count) in pairs {
        for _ in 0..count {
            time_s += 1.0;
            for camera in [a, b] {
                let pixel = Point2::new(random.uniform_in(0.0, 639.0), random.uniform_in(0.0, 479.0));
                coverage.observe(&CameraFrame { camera, time_s, spots: vec![spot(pixel, 1.0)] });
            }
        }
    }
    coverage
}

#[test]
fn groups_and_single_links_are_named_with_the_pair_that_could_link_them() {
    let apart = linked(&[(0, 1, 200), (2, 3, 200), (3, 4, 200), (1, 4, 7)], 5);
    assert_eq!([apart.common(0, 1), apart.common(4, 1), apart.common(0, 4), apart.common(0, 0)], [200, 7, 0, 0]);
    assert_misses(&apart, |it| {
        let Advice::Apart { cameras, between, common: 7, needed: 30 } = it else { return false };
        cameras[..] == ["wide-1", "wide-2"] && *between == ["wide-2", "wide-5"]
    });
    let by_one = linked(&[(0, 1, 200), (1, 2, 200), (2, 3, 200), (1, 3, 200), (0, 3, 5), (3, 4, 200), (4, 2, 200)], 5);
    assert_misses(&by_one, |it| {
        let Advice::LinkedByOne { cameras, by, between: Some(between) } = it else { return false };
        cameras[..] == ["wide-1"] && by == "wide-2" && *between == ["wide-1", "wide-4"]
    });
    assert!(by_one.state().enough, "{:?}", by_one.state());
}

#[test]
fn frames_of_two_cameras_match_within_the_tolerance_and_once() {
    let guesses = cameras(2, 1);
    for (shift_s, expected) in [(0.0, 100), (0.016, 100), (0.018, 0), (-0.016, 100)] {
        // At 25 frames a second, so that the neighbours are out of reach.
        let mut camera_frames = Vec::new();
        for frame in 0..100 {
            for camera in 0..2 {
                let time_s = f64::from(frame) * 0.04 + if camera == 1 { shift_s } else { 0.0 };
                let spots = vec![spot(Point2::new(5.0 * f64::from(frame), 100.0), 1.0)];
                camera_frames.push(CameraFrame { camera, time_s, spots });
            }
        }
        camera_frames.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        let coverage =
            Coverage::of(&Recording { cameras: guesses.clone(), camera_frames }, &CoverageOptions::default());
        assert_eq!(coverage.common(0, 1), expected, "{shift_s}");
    }
    // One camera twice as fast: each frame of the slow one meets one of the fast one.
    let mut coverage = Coverage::new(&guesses, &CoverageOptions { tolerance_s: 0.03, ..CoverageOptions::default() });
    for tick in 0..200 {
        let (time_s, spots) = (f64::from(tick) * 0.02, vec![spot(Point2::new(3.0 * f64::from(tick), 9.0), 1.0)]);
        coverage.observe(&CameraFrame { camera: 0, time_s, spots: spots.clone() });
        if tick % 2 == 0 {
            coverage.observe(&CameraFrame { camera: 1, time_s, spots });
        }
    }
    assert_eq!(coverage.common(0, 1), 100);
}

#[test]
fn cells_and_regions_are_where_the_light_was() {
    let guesses = cameras(2, 1);
    let mut coverage = Coverage::new(&guesses, &CoverageOptions { full_cell: 1, ..CoverageOptions::default() });
    for (index, (column, row)) in (0..8).flat_map(|column| (0..6).map(move |row| (column, row))).enumerate() {
        if column > 2 || row > 1 {
            let pixel = Point2::new(80.0 * f64::from(column) + 20.0, 80.0 * f64::from(row) + 30.0);
            for repeat in 0..3 {
                let pixel = pixel + Vector2::new(10.0 * f64::from(repeat), 0.0);
                let time_s = index as f64 + 0.1 * f64::from(repeat);
                coverage.observe(&CameraFrame { camera: 0, time_s, spots: vec![spot(pixel, 1.0)] });
            }
        }
    }
    assert_eq!((coverage.frames(0), coverage.cells(0)[2], coverage.cells(0)[3]), (3 * 42, 0, 3));
    assert!((coverage.share(0) - 42.0 / 48.0).abs() < 1e-12);
    let upper_left = Region { column: 0, row: 0 };
    assert_misses(
        &coverage,
        |it| matches!(it, Advice::RegionEmpty { camera, region } if camera == "wide-1" && *region == upper_left),
    );
    assert_misses(
        &coverage,
        |it| matches!(it, Advice::TooFewFrames { cameras, .. } if cameras[..] == [("wide-2".to_owned(), 0)]),
    );
}

#[test]
fn with_poses_the_volume_and_the_depths_are_known() {
    let mut take = Take::new(6, 2);
    let known: Vec<Option<Camera>> = take.cameras.iter().map(|it| Some(it.camera.clone())).collect();
    let volume = WorkingVolume::new(Point3::new(-1.7, -2.4, 0.3), Point3::new(1.7, 2.4, 2.1)).unwrap();
    assert_eq!((take.coverage.volume_share(), take.coverage.depth_m(0)), (None, None));
    take.coverage.place(&known, volume);
    let mut left = Waving::new(2, [-1.7, -2.4, 0.3], [-0.1, 2.4, 2.1]);
    let mut depths = [f64::INFINITY, 0.0_f64];
    for _ in 0..1500 {
        let light = left.next();
        if take.cameras[0].camera.sees(&light).is_some() {
            let away = (light - take.cameras[0].camera.centre()).norm();
            depths = [depths[0].min(away), depths[1].max(away)];
        }
        take.frame(&light);
    }
    let half = take.coverage.volume_share().unwrap();
    assert!((0.25..0.52).contains(&half), "{half}");
    let found = take.coverage.depth_m(0).unwrap();
    assert!((found[0] - depths[0]).abs() < 0.1 && (found[1] - depths[1]).abs() < 0.1, "{found:?} {depths:?}");
    let missing = take.coverage.state().missing;
    let place = missing.iter().find_map(|it| match it {
        Advice::VolumeEmpty { place, .. } => Some(*place),
        _ => None,
    });
    assert!(place.is_some_and(|it| it.x > 1.0), "{missing:?}");
    let mut right = Waving::new(3, [0.1, -2.4, 0.3], [1.7, 2.4, 2.1]);
    (0..1500).for_each(|_| take.frame(&right.next()));
    assert!(take.coverage.volume_share().unwrap() > half + 0.2);
}

#[test]
fn nonsense_counts_for_nothing() {
    let mut coverage = Coverage::new(&cameras(2, 1), &CoverageOptions::default());
    let before = coverage.clone();
    coverage.observe(&CameraFrame { camera: 7, time_s: 0.0, spots: vec![spot(Point2::new(1.0, 1.0), 1.0)] });
    coverage.observe(&CameraFrame { camera: 0, time_s: f64::NAN, spots: vec![spot(Point2::new(1.0, 1.0), 1.0)] });
    assert_eq!(coverage, before);
    for pixel in [Point2::new(f64::NAN, 1.0), Point2::new(1.0, f64::INFINITY), Point2::new(-20.0, 1.0)] {
        coverage.observe(&CameraFrame { camera: 0, time_s: 0.0, spots: vec![spot(pixel, f64::NAN)] });
    }
    assert_eq!(coverage.frames(0), 0);
    assert_eq!(coverage.state().missing, [Advice::NothingSeen]);
    for n in 0..2 {
        let few = Coverage::new(&cameras(n, 1), &CoverageOptions { grid: [0, 0], ..CoverageOptions::default() });
        assert_eq!(few.state().missing, [Advice::TooFewCameras { found: n }]);
        assert!(!few.render(80, true).is_empty());
    }
}

#[test]
fn pictures_keep_to_the_width_and_any_number_of_cameras_has_one() {
    for n in [1, 2, 4, 6, 7, 18, 64, 65, 200] {
        let mut take = Take::new(n, 1);
        let mut waving = Waving::network(1);
        (0..120).for_each(|_| take.frame(&waving.next()));
        for width in [20, 40, 80, 132] {
            let text = take.coverage.render(width, false);
            let widest = text.lines().map(|it| it.chars().count()).max().unwrap();
            assert!(widest <= width.max(42), "{n} {width}: {widest}\n{text}");
            if n == 18 {
                let lines: Vec<&str> = text.lines().collect();
                assert_eq!(lines[0].chars().count(), lines[1].chars().count(), "{text}");
            }
            assert!((1..=n).all(|it| text.contains(&format!("wide-{it} "))), "{n} {width}\n{text}");
            let bare = take.coverage.render(width, true);
            let mut stripped = String::new();
            let mut rest = bare.as_str();
            while let Some((before, after)) = rest.split_once("\x1b[") {
                stripped += before;
                rest = after.split_once('m').unwrap().1;
            }
            stripped += rest;
            assert_eq!(stripped.lines().count(), text.lines().count());
        }
        if let Ok(folder) = std::env::var("FOVEATE_LOOK") {
            for (color, name) in [(false, "txt"), (true, "ansi")] {
                std::fs::write(format!("{folder}/coverage_{n}.{name}"), take.coverage.render(100, color)).unwrap();
            }
        }
    }
}
