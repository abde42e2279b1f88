//! Spaces that move, are lost and are found again.

use nalgebra::{Matrix3, Point3, UnitQuaternion, Vector6};
use proptest::prelude::*;

use super::*;

const SECOND: i64 = 1_000_000_000;

fn pose(translation: [f64; 3], turn: [f64; 3]) -> UncertainPose {
    UncertainPose::exact(Isometry3::new(translation.into(), turn.into()))
}

/// A room with a head anchored in it and an eye fixed in the head.
fn room_head_eye() -> (SceneGraph, [SpaceId; 3]) {
    let mut scene = SceneGraph::new("room", 4, SECOND / 10);
    let head = scene.add("head", SceneGraph::ROOT).unwrap();
    let eye = scene.add("eye", head).unwrap();
    scene.set_static(eye, pose([0.0, 0.1, 0.0], [0.0, 0.0, std::f64::consts::FRAC_PI_2])).unwrap();
    (scene, [SceneGraph::ROOT, head, eye])
}

fn anchor(scene: &mut SceneGraph, space: SpaceId, time_ns: i64, x: f64) {
    let mut pose = pose([x, 0.0, 1.5], [0.0; 3]);
    pose.covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&(Matrix3::identity() * 1e-4));
    scene.push(space, time_ns, pose).unwrap();
}

#[test]
fn a_point_goes_through_moving_and_fixed_spaces() {
    let (mut scene, [room, head, eye]) = room_head_eye();
    anchor(&mut scene, head, 0, 0.0);
    anchor(&mut scene, head, SECOND, 2.0);
    let room_from_eye = scene.a_from_b(room, eye, SECOND / 4).unwrap();
    let (point, covariance) = room_from_eye.transform_point(&Point3::new(1.0, 0.0, 0.0), &Matrix3::zeros());
    assert!((point - Point3::new(0.5, 1.1, 1.5)).norm() < 1e-12, "{point}");
    assert!((covariance - Matrix3::identity() * 1e-4).norm() < 1e-15);
    let back = scene.a_from_b(eye, room, SECOND / 4).unwrap();
    assert!((back.transform * point - Point3::new(1.0, 0.0, 0.0)).norm() < 1e-12);
    assert_eq!(scene.a_from_b(eye, eye, 7).unwrap(), pose([0.0; 3], [0.0; 3]));
}

#[test]
fn what_moves_both_spaces_adds_no_uncertainty() {
    let (mut scene, [_, head, eye]) = room_head_eye();
    let other = scene.add("other eye", head).unwrap();
    scene.set_static(other, pose([0.0, -0.1, 0.0], [0.0; 3])).unwrap();
    // The head has no pose at all, and need not.
    let between = scene.a_from_b(eye, other, 0).unwrap();
    assert_eq!(between.covariance, Matrix6::zeros());
    assert!((between.transform * Point3::origin() - Point3::new(-0.2, 0.0, 0.0)).norm() < 1e-12);
    assert_eq!(scene.a_from_b(SceneGraph::ROOT, eye, 0), Err(SceneError::NoPose { space: "head".into() }));
}

#[test]
fn rotations_are_interpolated_along_the_shorter_arc() {
    let (mut scene, [room, head, _]) = room_head_eye();
    let turn = |angle: f64| pose([0.0; 3], [0.0, 0.0, angle]);
    // Quaternions of 170° and 190°, the latter written with the opposite sign.
    scene.push(head, 0, turn(170f64.to_radians())).unwrap();
    let mut later = turn(190f64.to_radians());
    later.transform.rotation = UnitQuaternion::new_unchecked(-later.transform.rotation.into_inner());
    scene.push(head, 100, later).unwrap();
    let middle = scene.a_from_b(room, head, 25).unwrap().transform.rotation;
    assert!(middle.angle_to(&UnitQuaternion::from_scaled_axis(Vector3::z() * 175f64.to_radians())) < 1e-9);
}

#[test]
fn poses_hold_for_the_reach_and_no_longer() {
    let (mut scene, [room, head, _]) = room_head_eye();
    anchor(&mut scene, head, 0, 1.0);
    anchor(&mut scene, head, SECOND, 2.0);
    let x = |time_ns| scene.a_from_b(room, head, time_ns).map(|it| it.transform.translation.x);
    let reach = SECOND / 10;
    assert_eq!([x(-reach), x(0), x(SECOND), x(SECOND + reach)], [Ok(1.0), Ok(1.0), Ok(2.0), Ok(2.0)]);
    for time_ns in [-reach - 1, SECOND + reach + 1, i64::MIN, i64::MAX] {
        let out = SceneError::OutOfReach { space: "head".into(), first_ns: 0, last_ns: SECOND, time_ns };
        assert_eq!(x(time_ns), Err(out));
    }
}

#[test]
fn newest_pose_is_extrapolated_by_its_velocity_and_grows_less_certain() {
    let (mut scene, [room, head, _]) = room_head_eye();
    // A head that is turned by 90° about z; its own x is the room's y.
    let mut turned = pose([1.0, 0.0, 0.0], [0.0, 0.0, std::f64::consts::FRAC_PI_2]);
    turned.covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&Matrix3::from_diagonal(&[1e-6, 4e-4, 0.0].into()));
    let mut covariance = Matrix6::zeros();
    covariance[(0, 0)] = 4e-4;
    covariance[(1, 1)] = 1e-6;
    covariance[(3, 3)] = 0.01;
    (covariance[(0, 3)], covariance[(3, 0)]) = (1e-3, 1e-3);
    let velocity = Vector3::new(2.0, 0.0, 0.0);
    scene.push_moving(head, 0, turned, velocity, &covariance).unwrap();
    let later = scene.a_from_b(room, head, SECOND / 10).unwrap();
    let (origin, spread) = later.transform_point(&Point3::origin(), &Matrix3::zeros());
    assert!((origin - Point3::new(1.2, 0.0, 0.0)).norm() < 1e-12, "{origin}");
    // 4e-4 + 2 · 0.1 · 1e-3 + 0.1² · 0.01 along x of the room; nothing new along y.
    let expected = Matrix3::from_diagonal(&[7e-4, 1e-6, 0.0].into());
    assert!((spread - expected).norm() < 1e-12, "{spread}");
    // A newer pose without a velocity holds, and a late one does not bring a velocity back.
    scene.push(head, 50_000_000, pose([1.1, 0.0, 0.0], [0.0; 3])).unwrap();
    scene.push_moving(head, 10_000_000, turned, velocity, &covariance).unwrap();
    assert_eq!(scene.a_from_b(room, head, SECOND / 10).unwrap().transform.translation.x, 1.1);
    let broken = Vector3::new(f64::NAN, 0.0, 0.0);
    assert!(matches!(scene.push_moving(head, 0, turned, broken, &covariance), Err(SceneError::NotFinite { .. })));
}

#[test]
fn history_is_bounded_and_takes_late_and_repeated_poses() {
    let (mut scene, [room, head, _]) = room_head_eye();
    for (time_ns, x) in [(10, 1.0), (30, 3.0), (20, 5.0), (20, 2.0), (40, 4.0), (50, 5.0)] {
        anchor(&mut scene, head, time_ns, x);
    }
    let Motion::Timed(samples, _) = &scene.spaces[head.0].motion else { panic!() };
    assert_eq!(samples.iter().map(|it| it.0).collect::<Vec<_>>(), [20, 30, 40, 50]);
    assert_eq!(scene.a_from_b(room, head, 25).unwrap().transform.translation.x, 2.5);
}

#[test]
fn times_at_the_ends_of_the_clock_do_not_overflow() {
    let (mut scene, [room, head, _]) = room_head_eye();
    anchor(&mut scene, head, i64::MIN, 0.0);
    anchor(&mut scene, head, i64::MAX, 1.0);
    let middle = scene.a_from_b(room, head, 0).unwrap();
    assert!((middle.transform.translation.x - 0.5).abs() < 1e-9);
}

#[test]
fn a_lost_anchor_is_suspended_and_resumes_with_the_next_pose() {
    let (mut scene, [room, head, eye]) = room_head_eye();
    anchor(&mut scene, head, 0, 1.0);
    anchor(&mut scene, head, 100, 2.0);
    scene.suspend(head).unwrap();
    assert!(scene.is_suspended(eye).unwrap() && !scene.is_suspended(room).unwrap());
    let suspended = SceneError::Suspended { space: "head".into(), last_ns: 100, time_ns: 101 };
    assert_eq!(scene.a_from_b(room, eye, 101), Err(suspended));
    assert!(scene.a_from_b(room, eye, 50).is_ok());
    anchor(&mut scene, head, 60, 1.6); // late: not a sign of life
    assert!(scene.is_suspended(eye).unwrap());
    anchor(&mut scene, head, 200, 3.0);
    assert!(!scene.is_suspended(eye).unwrap());
    assert!((scene.a_from_b(room, head, 150).unwrap().transform.translation.x - 2.5).abs() < 1e-12);
}

#[test]
fn misuse_is_refused_by_name() {
    let (mut scene, [room, head, _]) = room_head_eye();
    assert_eq!(scene.add("eye", room), Err(SceneError::NameTaken { name: "eye".into() }));
    assert_eq!(scene.push(room, 0, pose([0.0; 3], [0.0; 3])), Err(SceneError::Root { name: "room".into() }));
    assert_eq!(scene.suspend(room), Err(SceneError::Root { name: "room".into() }));
    let broken = pose([f64::NAN, 0.0, 0.0], [0.0; 3]);
    assert_eq!(scene.push(head, 0, broken), Err(SceneError::NotFinite { space: "head".into() }));
    let foreign = SceneError::Foreign { index: 9, count: 3 };
    assert_eq!(scene.a_from_b(SpaceId(9), head, 0), Err(foreign.clone()));
    assert_eq!(scene.add("x", SpaceId(9)), Err(foreign));
    assert_eq!((scene.find("eye"), scene.name(head)), (Some(SpaceId(2)), Ok("head")));
}

/// exp(δ) up to the second order, which is enough for the small δ of the test.
fn moved(pose: &Isometry3<f64>, delta: &Vector6<f64>) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(delta.fixed_rows::<3>(0).into_owned());
    pose * Isometry3::from_parts(delta.fixed_rows::<3>(3).into_owned().into(), turn)
}

/// The δ that takes `from` to `to`, to first order.
fn difference(from: &Isometry3<f64>, to: &Isometry3<f64>) -> Vector6<f64> {
    let step = from.inverse() * to;
    let (turn, shift) = (step.rotation.scaled_axis(), step.translation.vector);
    Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z)
}

proptest! {
    /// Moves each input along each direction by a little and compares with what the adjoint says: this checks the
    /// covariances of composition, inversion and transformed points without chance.
    #[test]
    fn covariances_follow_small_displacements(
        numbers in prop::array::uniform12(-2.0..2.0), turn in prop::array::uniform3(-1.0..1.0),
    ) {
        let [a, b, c, d, e, f, g, h, i, x, y, z] = numbers;
        let c_from_b = pose([a, b, c], [d, e, f]);
        let b_from_a = pose([g, h, i], turn);
        let point = Point3::new(x, y, z);
        const SMALL: f64 = 1e-6;
        // Along each axis, and along two mixtures of rotation and translation.
        let axes = (0..6).map(|axis| Vector6::ith(axis, SMALL));
        let mixtures = [Vector6::repeat(SMALL), Vector6::new(1.0, -2.0, 1.0, 2.0, 1.0, -1.0) * SMALL];
        for delta in axes.chain(mixtures) {
            // A covariance of rank one along δ, whose image must be the outer product of δ's image.
            let uncertain = |pose: &UncertainPose| UncertainPose {
                transform: pose.transform,
                covariance: delta * delta.transpose() / (SMALL * SMALL),
            };
            let expect = |image: Vector6<f64>, found: Matrix6<f64>| {
                (image * image.transpose() / (SMALL * SMALL) - found).norm() < 1e-4 * (1.0 + found.norm())
            };
            let straight = c_from_b.transform * b_from_a.transform;
            let first = moved(&c_from_b.transform, &delta) * b_from_a.transform;
            prop_assert!(expect(difference(&straight, &first), uncertain(&c_from_b).then_from(&b_from_a).covariance));
            let second = c_from_b.transform * moved(&b_from_a.transform, &delta);
            prop_assert!(expect(difference(&straight, &second), c_from_b.then_from(&uncertain(&b_from_a)).covariance));
            let inverse = moved(&c_from_b.transform, &delta).inverse();
            prop_assert!(
                expect(difference(&c_from_b.transform.inverse(), &inverse), uncertain(&c_from_b).inverse().covariance)
            );
            let (there, spread) = uncertain(&c_from_b).transform_point(&point, &Matrix3::zeros());
            let shift = (moved(&c_from_b.transform, &delta) * point - there) / SMALL;
            prop_assert!((shift * shift.transpose() - spread).norm() < 1e-4 * (1.0 + spread.norm()));
        }
    }
}
