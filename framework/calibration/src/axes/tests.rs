//! A room of known truth, put into a space of its own, must come back into metres; and every way in which what is given can fail.

use foveate_estimation::Random;
use foveate_geometry::bundle::{CameraCovariance, Freedom, OpticsSigma};
use foveate_geometry::{Camera, CameraStatus};
use foveate_scene::uncertainty::Fixed;
use nalgebra::{Isometry3, Matrix3, Matrix6, Translation3, UnitQuaternion, Vector3, Vector6};

use super::*;
use crate::solved::{SolvedCamera, SolvedPoint};

const RATE_HZ: f64 = 100.0;
/// Of the light's places [m].
const NOISE_M: f64 = 1e-3;
/// When the light is let go, and when it lands.
const FALL_S: [f64; 2] = [14.0, 14.6];

/// Where the light is: on the floor at (0, 0), (1.2, 0) and (0.1, 0.9), waved, let go at 2 m, landed; then hung at two heights.
fn truth(time_s: f64) -> Point3<f64> {
    let stops = [[0.0, 0.0, 0.0], [1.2, 0.0, 0.0], [0.1, 0.9, 0.0], [0.5, 0.4, 2.0]];
    let leg = (time_s / 2.0).floor();
    if leg < 3.0 {
        // A stop for 1.5 s, then half a second along an arc to the next.
        let share = ((time_s - 2.0 * leg - 1.5) / 0.5).max(0.0);
        let [from, to] = [0, 1].map(|it| Vector3::from(stops[leg as usize + it]));
        let arc = if leg < 2.0 { 0.5 * (std::f64::consts::PI * share).sin() } else { 0.0 };
        return Point3::from(from + (to - from) * share + Vector3::z() * arc);
    }
    if time_s < 13.0 {
        let phase = time_s - 6.0;
        return Point3::new(
            0.5 + 1.3 * (1.1 * phase).sin(),
            0.4 + 1.1 * (1.7 * phase).sin(),
            2.0 - 0.8 * (0.9 * phase).sin().abs(),
        );
    }
    if time_s < FALL_S[1] {
        let falling = (time_s - FALL_S[0]).max(0.0);
        return Point3::new(0.4 + 0.3 * falling, 0.5, 2.0 - 0.5 * 9.806_65 * falling * falling);
    }
    let hung = if time_s < 17.0 { 0.3 } else { 1.9 };
    Point3::new(0.8, 0.2, hung)
}

/// From metres to the space of an unscaled solution.
fn solved_from_world() -> Similarity3<f64> {
    let turn = UnitQuaternion::from_euler_angles(0.7, -1.1, 2.3);
    Similarity3::from_parts(Translation3::new(0.4, -2.0, 0.9), turn, 0.37)
}

/// Five cameras under the ceiling, and the path with noise.
fn world(seed: u64, noise_m: f64) -> Solved {
    let mut random = Random::new(seed).fork("axes");
    let mut noise = |sigma: f64| Vector3::new(random.normal(), random.normal(), random.normal()) * sigma;
    let camera = |index: usize| {
        let angle = 1.2 * index as f64;
        let centre = Point3::new(0.5 + 3.0 * angle.cos(), 0.5 + 3.0 * angle.sin(), 2.8);
        let covariance = CameraCovariance {
            pose: Matrix6::identity() * 1e-8,
            centre: Matrix3::identity() * (0.1 * noise_m).powi(2).max(1e-12),
            optics: OpticsSigma::default(),
        };
        SolvedCamera {
            name: format!("wide-{}", index + 1),
            camera: Camera::look_at(centre, Point3::new(0.5, 0.5, 1.0), [640, 480], 500.0),
            status: CameraStatus::Calibrated,
            freed: Freedom::POSE,
            prior: None,
            covariance: Some(covariance),
            clock: None,
        }
    };
    let point = |frame: usize| {
        let time_s = frame as f64 / RATE_HZ;
        SolvedPoint { frame, time_s, label: 0, position: truth(time_s) + noise(noise_m) }
    };
    let points = (0..(19.0 * RATE_HZ) as usize).map(point).collect();
    Solved { cameras: (0..5).map(camera).collect(), points, ..Solved::default() }
}

fn unscaled(seed: u64) -> Solved {
    transformed(&world(seed, NOISE_M), &solved_from_world(), Default::default())
}

fn stop(number: usize) -> Place {
    Place::Stop { label: 0, number }
}

fn floor() -> Given {
    Given::Floor { places: (1..4).map(stop).collect(), height_m: 0.0, sigma_m: 1e-3 }
}

fn distance(a: &str, b: &str, metres: f64) -> Given {
    let [a, b] = [a, b].map(|it| Place::Camera(it.into()));
    Given::Distance { a, b, metres, sigma_m: 2e-3 }
}

fn l_frame(points: &[[f64; 3]]) -> Given {
    let known = points.iter().enumerate().map(|(index, it)| (stop(index + 1), Point3::from(*it))).collect();
    Given::Points { known, sigma_m: 1e-3 }
}

const FALL: Given = Given::Falling { label: 0, from_s: FALL_S[0], until_s: FALL_S[1] - 0.01 };
const FRAME: [[f64; 3]; 3] = [[0.0, 0.0, 0.0], [1.2, 0.0, 0.0], [0.1, 0.9, 0.0]];

fn fixed(solved: &Solved, given: &[Given]) -> AxesFixed {
    fix(solved, given, &AxesOptions::default()).unwrap_or_else(|it| panic!("{it}"))
}

#[track_caller]
fn fails(given: &[Given], is_expected: impl Fn(&AxesError) -> bool) {
    let fault = fix(&unscaled(1), given, &AxesOptions::default()).unwrap_err();
    assert!(is_expected(&fault), "{fault:?}");
}

/// Greatest distance of a camera from its true place [m].
fn worst_camera(found: &Solved) -> f64 {
    let truth = world(1, NOISE_M);
    let each =
        found.cameras.iter().zip(&truth.cameras).map(|(it, truth)| (it.camera.centre() - truth.camera.centre()).norm());
    each.fold(0.0, f64::max)
}

#[test]
fn stops_are_found_in_their_order() {
    let found = stops(&unscaled(1), 0, &AxesOptions::default());
    let back = solved_from_world().inverse();
    let places: Vec<Point3<f64>> = found.iter().map(|it| back * it.position).collect();
    let expected = [FRAME[0], FRAME[1], FRAME[2], [0.4, 0.5, 2.0], [0.8, 0.2, 0.3], [0.8, 0.2, 1.9]];
    assert_eq!(places.len(), expected.len(), "{places:?}");
    for (found, expected) in places.iter().zip(expected) {
        // The light leaves a stop slowly, so that its end is not sharp.
        assert!((found - Point3::from(expected)).norm() < 2e-3, "{found} {expected:?}");
    }
    assert!((found[0].span_s[1] - 1.5).abs() < 0.05 && found[0].scatter < 0.37 * 2.0 * NOISE_M, "{:?}", found[0]);
}

#[test]
fn floor_and_a_distance_give_the_world_back() {
    let truth = world(1, NOISE_M);
    let metres = (truth.cameras[0].camera.centre() - truth.cameras[2].camera.centre()).norm();
    let found = fixed(&unscaled(1), &[floor(), distance("wide-1", "wide-3", metres)]);
    assert!(worst_camera(&found.solved) < 6e-3, "{}", worst_camera(&found.solved));
    for freedom in [&found.solved.fixed.scale, &found.solved.fixed.gravity, &found.solved.fixed.origin] {
        assert!(freedom.as_ref().unwrap().sigma.is_some_and(|it| it > 1e-5 && it < 5e-3), "{freedom:?}");
    }
    assert!((found.world_from_solved.scaling() * 0.37 - 1.0).abs() < 2e-3);
    // A light whose centre is 3 cm above the floor puts the floor 3 cm lower, whichever side the order of the places shows.
    let mut places: Vec<Place> = (1..4).map(stop).collect();
    places.swap(1, 2);
    let raised = Given::Floor { places, height_m: 0.03, sigma_m: 1e-3 };
    let found = fixed(&unscaled(1), &[distance("wide-1", "wide-3", metres), raised]);
    assert!(
        (found.solved.cameras[0].camera.centre().z - 2.83).abs() < 8e-3,
        "{}",
        found.solved.cameras[0].camera.centre()
    );
}

#[test]
fn an_l_frame_gives_the_world_back() {
    let found = fixed(&unscaled(1), &[l_frame(&FRAME)]);
    assert!(worst_camera(&found.solved) < 8e-3, "{}", worst_camera(&found.solved));
    assert!(found.solved.fixed.scale.unwrap().sigma.unwrap() < 2e-3);
}

#[test]
fn a_fall_gives_gravity_and_metres_as_well_as_it_says() {
    let (mut of_scale, mut of_tilt) = (0.0, 0.0);
    for seed in 0..20 {
        let found = fixed(&unscaled(seed), &[FALL]);
        let [scale, gravity] =
            [&found.solved.fixed.scale, &found.solved.fixed.gravity].map(|it| it.as_ref().unwrap().sigma.unwrap());
        let up = found.world_from_solved.isometry.rotation * (solved_from_world().isometry.rotation * Vector3::z());
        let (tilt, error) = (up.angle(&Vector3::z()), found.world_from_solved.scaling() * 0.37 - 1.0);
        of_scale += (error / scale).powi(2) / 20.0;
        of_tilt += 0.5 * (tilt / gravity).powi(2) / 20.0;
        assert!(
            error.abs() < 0.02 && tilt < 0.02 && scale < 0.01 && found.falls[0].count > 30,
            "{error} {tilt} {scale}"
        );
        assert_eq!(found.solved.fixed.origin, None);
    }
    // χ² with 20 and 40 degrees of freedom, over these: from 0.37 and 0.52 to 2.0 and 1.7 in 99 of 100 cases.
    assert!((0.37..2.0).contains(&of_scale) && (0.52..1.7).contains(&of_tilt), "{of_scale} {of_tilt}");
}

#[test]
fn a_fall_is_found_in_a_span_that_is_named_loosely() {
    let solved = unscaled(3);
    let loose = Given::Falling { label: 0, from_s: FALL_S[0] - 0.15, until_s: FALL_S[1] + 0.2 };
    let found = fixed(&solved, &[loose]);
    let [from, until] = found.falls[0].span_s;
    assert!(from > FALL_S[0] - 0.06 && until < FALL_S[1] + 0.03, "{from} {until}");
    assert!(
        (found.world_from_solved.scaling() * 0.37 - 1.0).abs() < 0.03,
        "{}",
        found.world_from_solved.scaling() * 0.37
    );
    let mut spoilt = solved;
    for point in spoilt.points.iter_mut().skip(1402).step_by(9) {
        point.position.y += 0.1;
    }
    let found = fixed(&spoilt, &[FALL]);
    assert!(
        (found.world_from_solved.scaling() * 0.37 - 1.0).abs() < 0.02,
        "{}",
        found.world_from_solved.scaling() * 0.37
    );
}

#[test]
fn what_is_no_fall_is_refused() {
    let falling = |from_s, until_s| [Given::Falling { label: 0, from_s, until_s }];
    let is_short = |it: &AxesError| matches!(it, AxesError::NoFall { fault: FallError::TooShort { .. }, .. });
    fails(&falling(7.0, 9.0), |it| matches!(it, AxesError::NoFall { fault: FallError::NotConstant { .. }, .. }));
    fails(&falling(0.1, 1.3), is_short);
    fails(&falling(14.0, 14.1), is_short);
    fails(&falling(30.0, 31.0), |it| {
        let AxesError::NoLight { label: 0, from_s: 30.0, until_s: 31.0, found: 0, needed: 8, recorded_s } = it else {
            return false;
        };
        recorded_s[0] == 0.0 && (recorded_s[1] - 18.99).abs() < 0.01
    });
    fails(&falling(2.0, 1.0), |it| matches!(it, AxesError::BadNumber { found: -1.0, .. }));
    fails(&[Given::Falling { label: 4, from_s: 14.0, until_s: 14.6 }], |it| {
        matches!(it, AxesError::NoLight { label: 4, found: 0, .. })
    });
    let mut timeless = unscaled(1);
    timeless.points.iter_mut().for_each(|it| it.time_s = 14.0);
    let fault = fix(&timeless, &[FALL], &AxesOptions::default()).unwrap_err();
    assert!(matches!(fault, AxesError::NoFall { fault: FallError::NoTimes, .. }), "{fault:?}");
    // Carried down, ever more slowly.
    let mut carried = unscaled(1);
    for point in &mut carried.points {
        let since = (point.time_s - 14.0).clamp(0.0, 0.6);
        let down = Vector3::new(0.4, 0.5, 2.0 - 4.0 * since * since + 3.5 * since.powi(3));
        point.position = solved_from_world() * Point3::from(down);
    }
    let fault = fix(&carried, &[FALL], &AxesOptions::default()).unwrap_err();
    let AxesError::NoFall { fault, .. } = fault else { panic!("{fault:?}") };
    assert!(matches!(fault, FallError::Changing { .. } | FallError::NotConstant { .. }), "{fault:?}");
}

#[test]
fn a_plumb_line_and_upright_cameras_give_the_vertical_alone() {
    let plumb = Given::Plumb { top: stop(6), bottom: stop(5), sigma: 2e-3 };
    for (given, most) in [(plumb, 5e-3_f64), (Given::CamerasUpright, 0.05)] {
        let found = fixed(&unscaled(2), &[given]);
        let up = found.world_from_solved.isometry.rotation * (solved_from_world().isometry.rotation * Vector3::z());
        let gravity = found.solved.fixed.gravity.unwrap();
        let sigma = gravity.sigma.unwrap();
        assert!(up.angle(&Vector3::z()) < most.min(4.0 * sigma) && sigma < most, "{up} {gravity:?}");
        assert_eq!((found.solved.fixed.scale, found.solved.fixed.origin), (None, None));
        assert_eq!(found.world_from_solved.scaling(), 1.0);
    }
    let mut same = unscaled(1);
    let pose = same.cameras[0].camera.camera_from_world;
    same.cameras.iter_mut().for_each(|it| it.camera.camera_from_world.rotation = pose.rotation);
    let fault = fix(&same, &[Given::CamerasUpright], &AxesOptions::default()).unwrap_err();
    assert!(matches!(fault, AxesError::VerticalUnobservable { .. }), "{fault:?}");
}

#[test]
fn sources_that_cannot_both_be_right_are_named() {
    let truth = world(1, NOISE_M);
    let metres = (truth.cameras[0].camera.centre() - truth.cameras[2].camera.centre()).norm();
    let is_scale = |it: &AxesError| matches!(it, AxesError::Contradiction { freedom: FreedomName::Scale, .. });
    fails(&[distance("wide-1", "wide-3", 1.03 * metres), l_frame(&FRAME)], is_scale);
    fails(&[distance("wide-1", "wide-3", metres), distance("wide-1", "wide-3", 1.03 * metres)], is_scale);
    let both = fix(
        &unscaled(1),
        &[distance("wide-1", "wide-3", 1.1 * metres), distance("wide-1", "wide-3", metres)],
        &AxesOptions::default(),
    );
    let (wrong, fault) = (1.1 * metres, both.unwrap_err());
    let AxesError::Contradiction { difference, lengths_m: Some([known, other]), .. } = fault else {
        panic!("{fault:?}")
    };
    assert!((difference - 1.1_f64.ln()).abs() < 1e-3, "a logarithm of a ratio: {difference}");
    assert!((known - metres).abs() < 1e-9 && (other - wrong).abs() < 1e-3, "{known} {other}");
    let leaning = Given::Plumb { top: stop(6), bottom: stop(2), sigma: 2e-3 };
    fails(&[FALL, leaning], |it| matches!(it, AxesError::Contradiction { freedom: FreedomName::Gravity, .. }));
    let mut earlier = unscaled(1);
    earlier.fixed.scale = Some(Fixed { by: "a wand of 0.4 m".into(), sigma: Some(1e-3) });
    let fault = fix(&earlier, &[l_frame(&FRAME)], &AxesOptions::default()).unwrap_err();
    let AxesError::Contradiction { freedom: FreedomName::Scale, a, b, .. } = &fault else { panic!("{fault:?}") };
    assert!(a == "a wand of 0.4 m" && b.starts_with('3'), "the earlier source, then the three points: {a}, {b}");
    // What agrees is weighed, and is known better than by either.
    let both = fixed(&unscaled(1), &[FALL, l_frame(&FRAME)]);
    let of = |freedom: FreedomName| both.sources.iter().filter(move |it| it.freedom == freedom);
    assert_eq!(
        (of(FreedomName::Scale).count(), of(FreedomName::Gravity).count(), of(FreedomName::Origin).count()),
        (2, 2, 1)
    );
    let least = of(FreedomName::Scale).map(|it| it.sigma).fold(f64::INFINITY, f64::min);
    assert!(both.solved.fixed.scale.unwrap().sigma.unwrap() < least);
}

#[test]
fn points_of_the_wrong_shape_or_hand_are_refused() {
    // Swapped arms of unequal length are another shape; a mirrored flat frame would put the cameras below the floor.
    let is_mirrored = |it: &AxesError| matches!(it, AxesError::Mirrored { .. });
    let is_line = |it: &AxesError| matches!(it, AxesError::Collinear { .. });
    fails(&[l_frame(&[FRAME[0], [0.0, 0.9, 0.0], [1.2, 0.1, 0.0]])], |it| matches!(it, AxesError::Misfit { .. }));
    fails(&[l_frame(&[FRAME[0], [1.2, 0.0, 0.0], [0.1, -0.9, 0.0]])], is_mirrored);
    let raised = |sign: f64| [FRAME[0], FRAME[1], FRAME[2], [0.4, 0.5, sign * 2.0]];
    fixed(&unscaled(1), &[l_frame(&raised(1.0))]);
    fails(&[l_frame(&raised(-1.0))], is_mirrored);
    fails(&[l_frame(&FRAME[..2])], |it| matches!(it, AxesError::TooFewPlaces { found: 2, needed: 3, .. }));
    fails(&[l_frame(&[FRAME[0], FRAME[1], [2.0, 0.0, 0.0]])], is_line);
    fails(
        &[l_frame(&[FRAME[0], FRAME[1], [2.0, f64::NAN, 0.0]])],
        |it| matches!(it, AxesError::BadNumber { what, found, .. } if what.contains("point 3") && found.is_nan()),
    );
    fails(&[Given::Floor { places: vec![stop(1), stop(2), stop(1)], height_m: 0.0, sigma_m: 0.0 }], is_line);
    fails(&[Given::Floor { places: vec![stop(1), stop(2), stop(4)], height_m: 0.0, sigma_m: 0.0 }], |it| {
        matches!(it, AxesError::NoSideIsUp { .. })
    });
}

#[test]
fn numbers_and_names_that_cannot_be_are_refused() {
    fails(&[], |it| *it == AxesError::NothingGiven);
    for metres in [0.0, -0.4, f64::NAN] {
        let is_it =
            |it: &AxesError| matches!(it, AxesError::BadNumber { found, .. } if found.total_cmp(&metres).is_eq());
        fails(&[Given::WandLength { ends: [0, 1], metres, sigma_m: 0.0 }], is_it);
        fails(&[distance("wide-1", "wide-2", metres)], is_it);
    }
    fails(&[Given::WandLength { ends: [0, 1], metres: 0.4, sigma_m: 0.0 }], |it| {
        matches!(it, AxesError::NoWand { frames: 0, needed: 3, .. })
    });
    fails(
        &[distance("wide-1", "wide-9", 1.0)],
        |it| matches!(it, AxesError::NoSuchCamera { name, known } if name == "wide-9" && known[..2] == ["wide-1", "wide-2"]),
    );
    fails(&[distance("wide-1", "wide-1", 1.0)], |it| matches!(it, AxesError::SamePlace { .. }));
    fails(&[Given::Plumb { top: stop(9), bottom: stop(5), sigma: 0.0 }], |it| {
        matches!(it, AxesError::NoStop { label: 0, number: 9, found: 6, .. })
    });
    fails(&[Given::Plumb { top: stop(0), bottom: stop(5), sigma: 0.0 }], |it| {
        matches!(it, AxesError::NoStop { number: 0, .. })
    });
    let mut without = unscaled(1);
    without.cameras[1].status = CameraStatus::NoDepth { best: 0 };
    let fault = fix(&without, &[distance("wide-1", "wide-2", 1.0)], &AxesOptions::default()).unwrap_err();
    assert!(
        matches!(&fault, AxesError::CameraNotSolved { name, status: CameraStatus::NoDepth { best: 0 } } if name == "wide-2"),
        "{fault:?}"
    );
    let options = AxesOptions { stop_s: 0.0, ..AxesOptions::default() };
    let fault = fix(&without, &[FALL], &options).unwrap_err();
    assert!(matches!(&fault, AxesError::BadNumber { what, found: 0.0, .. } if what == "stop_s"), "{fault:?}");
    assert!(fix(&Solved::default(), &[FALL, Given::CamerasUpright], &AxesOptions::default()).is_err());
}

#[test]
fn covariances_and_pixels_follow_into_the_new_space() {
    let mut before = world(1, NOISE_M);
    let step = Vector6::new(0.3, -0.2, 0.5, 0.1, 0.4, -0.7) * 1e-6;
    let moved_by = |pose: &Isometry3<f64>, step: &Vector6<f64>| {
        let turn = UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(0).into_owned());
        pose * Isometry3::from_parts(Translation3::new(step[3], step[4], step[5]), turn)
    };
    // A covariance that is one step along a line must become that of the step in the new space.
    let covariance = before.cameras[1].covariance.as_mut().unwrap();
    covariance.pose = step * step.transpose();
    let mut stepped = before.clone();
    let pose = &mut stepped.cameras[1].camera.camera_from_world;
    *pose = moved_by(pose, &step);
    let centre_step = stepped.cameras[1].camera.centre() - before.cameras[1].camera.centre();
    before.cameras[1].covariance.as_mut().unwrap().centre = centre_step * centre_step.transpose();
    let [after, after_step] = [&before, &stepped].map(|it| transformed(it, &solved_from_world(), Default::default()));
    let [a, b] = [&after, &after_step].map(|it| &it.cameras[1].camera);
    let covariance = after.cameras[1].covariance.as_ref().unwrap();
    let difference = a.camera_from_world.inverse() * b.camera_from_world;
    let turn = difference.rotation.scaled_axis();
    let expected = Vector6::new(
        turn.x,
        turn.y,
        turn.z,
        difference.translation.x,
        difference.translation.y,
        difference.translation.z,
    );
    assert!((covariance.pose - expected * expected.transpose()).amax() < 1e-5 * covariance.pose.amax());
    let moved = b.centre() - a.centre();
    assert!((covariance.centre - moved * moved.transpose()).amax() < 1e-5 * covariance.centre.amax());
    for (old, new) in before.points.iter().zip(&after.points).step_by(97) {
        let [seen, now] =
            [(&before, old), (&after, new)].map(|(it, point)| it.cameras[2].camera.project(&point.position).unwrap());
        assert!((seen - now).norm() < 1e-9);
    }
}
