//! What `registration` promises, tried.

use foveate::estimation::Random;
use nalgebra::{Isometry3, Matrix6, Rotation3, UnitQuaternion};

use super::*;

const SETTINGS: &str = "tiles = [3, 2]\ntile_m = [1.0, 0.6]\ngap_mm = [10, 20]\nsize_px = [1280, 768]";

fn settings() -> RegistrationSettings {
    RegistrationSettings {
        tiles: [3, 2],
        tile_m: [1.0, 0.6],
        gap_mm: [10.0, 20.0],
        size_px: [1280, 768],
        touch_m: Vec::new(),
        touch_mm: default_touch_mm(),
        hold_s: default_hold_s(),
        still_mm: default_still_mm(),
        settle_ms: default_settle_ms(),
        limit_mm: default_limit_mm(),
        file: default_file(),
    }
}

/// A wall that stands upright at y = 2.5, seen from smaller y: its x along the room's, its y down; and turned a little.
fn truth() -> Isometry3<f64> {
    let upright = Rotation3::from_matrix_unchecked(Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0));
    let turn = UnitQuaternion::from_euler_angles(0.03, -0.02, 0.1) * UnitQuaternion::from_rotation_matrix(&upright);
    Isometry3::from_parts(nalgebra::Translation3::new(-1.5, 2.5, 1.9), turn)
}

fn touched(order: [usize; 4], noise: f64, seed: u64, crowd: bool) -> Registration {
    touched_beside(order, noise, seed, crowd, None)
}

/// The same where one of the corners, by its place in the order, is touched so far beside it [m].
fn touched_beside(order: [usize; 4], noise: f64, seed: u64, crowd: bool, beside: Option<(usize, f64)>) -> Registration {
    let mut setup = Setup::for_tests();
    setup.volume_m = Some([[-2.0, -2.5, 0.0], [2.0, 2.0, 2.2]]);
    let mut node = Registration::new(settings(), &setup).unwrap();
    let mut random = Random::new(seed);
    let hold = Interval::from_s(1.0);
    let corners = settings().corners();
    let mut held = Vec::new();
    for at in order {
        let place = truth() * Point3::new(corners[at].x, corners[at].y, 0.0);
        let miss = Vector3::new(random.normal(), random.normal(), random.normal()) * noise;
        held.push(place + miss);
    }
    if let Some((at, by)) = beside {
        held[at] += truth() * Vector3::x() * by;
    }
    let mut time_s = 0.0;
    for (number, place) in held.iter().enumerate() {
        for step in 0..90 {
            time_s += 1.0 / 60.0;
            let shake = Vector3::new(random.normal(), random.normal(), random.normal()) * 1e-3;
            let covariance = Matrix3::from_diagonal_element(1e-6);
            node.rests.add(Time::from_s(time_s), place + shake, covariance, 0.015, hold);
            node.crowded += u64::from(crowd && step == 0);
        }
        let next = held.get(number + 1).unwrap_or(place);
        for step in 1..40 {
            time_s += 1.0 / 60.0;
            let at =
                place + (next - place) * f64::from(step) / 40.0 + Vector3::new(0.0, 0.0, 0.02 * f64::from(step % 7));
            node.rests.add(Time::from_s(time_s), at, Matrix3::from_diagonal_element(1e-6), 0.015, hold);
        }
    }
    node.span = Some([Time::from_s(0.0), Time::from_s(time_s)]);
    node
}

#[test]
fn corners_give_the_pose_and_its_covariance_says_how_well() {
    let (mut normalised, mut n) = (0.0, 0.0);
    for seed in 1..=60 {
        let pose = touched([0, 1, 2, 3], 2e-3, seed, false).registered().unwrap();
        assert_eq!((pose.misses.len(), pose.held_out.len()), (4, 4));
        for on_wall in [Point2::new(0.0, 0.0), Point2::new(1.5, 0.6), Point2::new(3.0, 1.2)] {
            let off = pose.point(&on_wall) - truth() * Point3::new(on_wall.x, on_wall.y, 0.0);
            assert!(off.norm() < 9e-3, "{} mm", off.norm() * 1e3);
            normalised += off.dot(&(pose.covariance_at(&on_wall).try_inverse().unwrap() * off));
            n += 3.0;
        }
    }
    assert!((0.5..1.5).contains(&(normalised / n)), "normalised error {}", normalised / n);
}

#[test]
fn tiles_stand_where_the_wall_has_them_and_the_viewer_takes_them() {
    let mut node = touched([0, 1, 2, 3], 0.0, 1, false);
    let pose = node.registered().unwrap();
    let text = node.text(&pose, 1.0);
    assert_eq!(text.matches("name = ").count(), 6, "{text}");
    let line = text.lines().find(|it| it.contains("\"2-2\"")).unwrap();
    let number = line.split("lower_left_m = [").nth(1).unwrap().split(']').next().unwrap();
    let found: Vec<f64> = number.split(',').map(|it| it.trim().parse().unwrap()).collect();
    // Second column, second row: a tile and a gap to the right, and all the way down.
    let expected = truth() * Point3::new(1.01, 1.22, 0.0);
    assert!((Point3::new(found[0], found[1], found[2]) - expected).norm() < 3e-3, "{found:?}, {expected}");
    let covariance: Matrix6<f64> = pose.covariance;
    assert!((covariance - covariance.transpose()).norm() < 1e-12);
}

#[test]
fn wrong_order_wrong_size_and_missing_corners_are_named() {
    let behind = touched([1, 0, 3, 2], 0.0, 1, false).registered().unwrap_err();
    assert!(behind.contains("face away") && behind.contains("clockwise"), "{behind}");
    let mut fewer = touched([0, 1, 2, 3], 0.0, 1, false);
    fewer.settings.touch_m = vec![[0.0, 0.0], [3.02, 0.0], [3.02, 1.22]];
    let message = fewer.registered().unwrap_err();
    assert!(message.contains("held still 4 times") && message.contains("expected 3"), "{message}");
    let mut larger = touched([0, 1, 2, 3], 0.0, 1, true);
    larger.settings.tile_m = [1.1, 0.6];
    let mut report = Report::default();
    let refused = larger.finish(&mut report).unwrap_err().to_string();
    assert!(refused.contains("expected at most 20") && refused.contains("`tile_m`"), "{refused}");
    assert!(report.remarks[0].contains("several lights"), "{:?}", report.remarks);
    let mut nothing = Registration::new(settings(), &Setup::for_tests()).unwrap();
    nothing.finish(&mut report).unwrap();
    assert!(report.remarks[1].contains("never"), "{:?}", report.remarks);
}

#[test]
fn a_corner_that_was_touched_elsewhere_is_named() {
    for at in 0..4 {
        let mut node = touched_beside([0, 1, 2, 3], 1e-3, 5, false, Some((at, 0.2)));
        let refused = node.finish(&mut Report::default()).unwrap_err().to_string();
        assert!(refused.contains(&format!("place {}, (", at + 1)) && refused.contains("without it"), "{refused}");
    }
}

#[test]
fn settings_are_read_and_refused() {
    foveate_testkit::check_node::<Registration>(SETTINGS);
    let refused = |change: fn(&mut RegistrationSettings)| {
        let mut settings = settings();
        change(&mut settings);
        Registration::new(settings, &Setup::for_tests()).err().and_then(|it| it.setting)
    };
    assert_eq!(refused(|_| ()), None);
    assert_eq!(refused(|it| it.tiles = [0, 1]).as_deref(), Some("tiles"));
    assert_eq!(refused(|it| it.touch_m = vec![[0.0; 2]; 2]).as_deref(), Some("touch_m"));
    assert_eq!(refused(|it| it.touch_m = vec![[0.0; 2], [3.0, 0.0], [3.3, 1.0]]).as_deref(), Some("touch_m[2]"));
    assert_eq!(refused(|it| it.still_mm = f64::NAN).as_deref(), Some("still_mm"));
}

/// Dots all over the wall, half a second each, seen 80 ms late with noise where `sees` says so; `mirrored` tells their places from the right edge.
fn by_dots(mirrored: bool, sees: impl Fn(usize) -> bool) -> NodeBench<Registration> {
    let setup = Setup {
        volume_m: Some([[-2.0, -2.5, 0.0], [2.0, 2.0, 2.2]]),
        connected: vec!["targets".to_owned(), "shown".to_owned()],
        ..Setup::for_tests()
    };
    let mut bench = NodeBench::<Registration>::with_setup(settings(), &setup).unwrap();
    let mut random = Random::new(4);
    let dots: Vec<Point2<f64>> =
        (0..24).map(|it| Point2::new(0.1 + 0.55 * f64::from(it % 6), 0.1 + 0.33 * f64::from(it / 6))).collect();
    let target = |id: u32, position: Point3<f64>| Target {
        id: TargetId(id),
        position,
        velocity: Vector3::zeros(),
        covariance: Matrix6::identity() * 4e-6,
        cameras: CameraSet::default(),
        provenance: Provenance::Measured,
    };
    for step in 0..24 * 30 {
        let time = Time::from_s(f64::from(step) / 60.0);
        let number = step as usize / 30;
        let told = dots[number];
        let told = Point3::new(if mirrored { 3.02 - told.x } else { told.x }, told.y, 0.0);
        let shown = Targets { time, list: vec![target(number as u32, told)] };
        bench.feed(&SHOWN, time, shown).unwrap();
        let late = (step - 5).max(0) as usize / 30;
        let noise = Vector3::from_fn(|_, _| random.normal()) * 2e-3;
        let seen = truth() * Point3::new(dots[late].x, dots[late].y, 0.0) + noise;
        // Another light in the room for the time of one dot.
        let mut list: Vec<Target> = if sees(late) { vec![target(late as u32, seen)] } else { Vec::new() };
        if late == 7 && sees(late) {
            list.push(target(99, Point3::new(0.5, 0.5, 1.0)));
        }
        bench.feed(&TARGETS, time, Targets { time, list }).unwrap();
    }
    bench
}

#[test]
fn dots_that_the_room_sees_give_the_walls_pose() {
    let bench = by_dots(false, |it| it != 3);
    let report = bench.finish().unwrap();
    // One was not seen, and one was seen together with another light.
    assert_eq!((report.figures["registration.places"], report.figures["registration.dots_left_out"]), (22.0, 2.0));
    assert!(report.figures["registration.held_out_mm"] < 2.5, "{:?}", report.figures);
    assert!(report.figures["registration.worst_sigma_mm"] < 2.0, "{:?}", report.figures);
}

#[test]
fn mirrored_and_unseen_dots_are_reported() {
    let bench = by_dots(true, |_| true);
    let why = bench.finish().map(|_| ()).unwrap_err().to_string();
    assert!(why.contains("mirrored"), "{why}");
    let bench = by_dots(false, |it| it < 2);
    let why = bench.finish().map(|_| ()).unwrap_err().to_string();
    assert!(why.contains("24 dots were shown and 2 seen"), "{why}");
}
