//! Targets in reach, at its edges and beyond.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Isometry3, UnitQuaternion};
use proptest::prelude::*;

use super::*;
use crate::pan_tilt::head::Stacking;
use crate::pan_tilt::head::tests::{crooked, stackings};

/// A head that looks along +Y of the world from 2 m up, its axes perfect.
fn straight(limits: Limits) -> PanTiltHead {
    let camera = Camera::look_at(Point3::new(0.0, 0.0, 2.0), Point3::new(0.0, 5.0, 2.0), [640, 480], 700.0);
    PanTiltHead::aligned(camera, limits)
}

/// What a camera at `setting` has in the middle of its image, at `distance`.
fn seen_from(head: &PanTiltHead, setting: &Setting, distance: f64) -> Point3<f64> {
    head.camera_at(setting).ray(&Point2::new(319.5, 239.5)).unwrap().at(distance)
}

#[track_caller]
fn aimed(head: &PanTiltHead, target: &Point3<f64>, from: &Setting) -> Aim {
    let found = aim(head, target, from).unwrap_or_else(|it| panic!("{it}: {it:?}"));
    assert!(found.off_centre_px < 1e-5 && head.limits.contain(&found.setting), "{found:?}");
    let seen = head.camera_at(&found.setting).project(target).unwrap();
    assert!((seen - Point2::new(319.5, 239.5)).norm() < 1e-5, "{seen}");
    found
}

#[track_caller]
fn refused(head: &PanTiltHead, target: &Point3<f64>, from: &Setting) -> Unreachable {
    let found = aim(head, target, from).unwrap_err();
    assert!(head.limits.contain(&found.nearest.setting), "{found:?}");
    found
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn a_target_that_a_setting_has_in_the_middle_is_found_by_the_nearest_such_setting(
        turn in prop::array::uniform4(-0.2..0.2), shift in prop::array::uniform4(-0.1..0.1), stacking in stackings(),
        pan in -1.7..1.7, tilt in -0.49..0.49, distance in 0.6..8.0, from_pan in -1.7..1.7, from_tilt in -0.49..0.49,
    ) {
        let head = crooked(turn, shift, stacking);
        // With the pan axis carried, the line of sight at a quarter turn of pan is along the tilt axis: there are several settings there.
        let pan = if stacking == Stacking::PanOnTilt { 0.7 * pan } else { pan };
        let truth = Setting::new(pan, tilt);
        let target = seen_from(&head, &truth, distance);
        let found = aimed(&head, &target, &Setting::new(from_pan, from_tilt));
        prop_assert!((found.setting.pan - pan).hypot(found.setting.tilt - tilt) < 1e-6, "{found:?} {truth:?}");
        prop_assert!((found.distance - distance).abs() < 1e-7 && found.iterations < 20, "{found:?}");
    }

    #[test]
    fn any_axes_at_all_are_solved_or_refused_without_panic(
        pan_axis in prop::array::uniform3(-1.0..1.0), tilt_axis in prop::array::uniform3(-1.0..1.0),
        shift in prop::array::uniform4(-0.5..0.5), stacking in stackings(), place in prop::array::uniform3(-4.0..4.0),
        pan in -3.0..3.0, tilt in -3.0..3.0,
    ) {
        let mut head = crooked([0.0; 4], shift, stacking);
        head.limits = Limits { pan: [-9.0, 9.0], tilt: [-9.0, 9.0] };
        head.pan.direction = nalgebra::Unit::new_normalize(Vector3::from(pan_axis));
        head.tilt.direction = nalgebra::Unit::new_normalize(Vector3::from(tilt_axis));
        let target = Point3::from(place);
        match aim(&head, &target, &Setting::new(pan, tilt)) {
            Ok(found) => prop_assert!(found.off_centre_px < 1e-3, "{found:?}"),
            Err(found) => prop_assert!(matches!(
                found.reason, Obstacle::NearAxis { .. } | Obstacle::TooNear { .. } | Obstacle::OutOfLimits { .. },
            ), "{found:?}"),
        }
        // Where the axes let a setting have it in the middle, it is found.
        let target = seen_from(&head, &Setting::new(pan, tilt), 3.0);
        let found = aim(&head, &target, &Setting::new(pan + 0.1, tilt - 0.1));
        prop_assert!(found.is_ok_and(|it| it.off_centre_px < 1e-3), "{found:?}");
    }
}

#[test]
fn lens_ten_centimetres_from_the_axes() {
    let mut head = straight(Limits::symmetric(3.0, 1.4));
    head.pan.point = Point3::new(0.03, 0.0, -0.10);
    head.tilt.point = Point3::new(0.0, 0.04, -0.10);
    for distance in [0.3, 0.5, 1.0, 10.0, 1e4] {
        let truth = Setting::new(2.1, -0.7);
        let found = aimed(&head, &seen_from(&head, &truth, distance), &Setting::default());
        assert!((found.setting.pan - 2.1).abs() < 1e-7 && (found.setting.tilt + 0.7).abs() < 1e-7, "{found:?}");
    }
}

#[test]
fn a_target_that_moves_is_followed_without_a_jump() {
    // Round the head and up and down, past ±180° of pan, within limits that allow one and a half turns.
    let mut head = crooked([0.05, -0.04, 0.03, 0.06], [0.03, -0.05, 0.04, 0.02], Stacking::TiltOnPan);
    head.limits = Limits { pan: [-4.7, 4.7], tilt: [-1.3, 1.5] };
    let mut setting = Setting::new(0.0, 0.1);
    for step in 0..4000 {
        let phase = f64::from(step) * 1e-3;
        let wanted = Setting::new(4.6 * (1.3 * phase).sin(), 0.1 + 1.1 * (5.0 * phase).sin());
        let target = seen_from(&head, &wanted, 1.0 + 0.5 * (7.0 * phase).cos());
        let found = aimed(&head, &target, &setting);
        let way = (found.setting.pan - setting.pan).hypot(found.setting.tilt - setting.tilt);
        assert!(way < 0.03, "step {step}, {way} rad: {setting:?} to {:?}", found.setting);
        setting = found.setting;
    }
}

#[test]
fn a_target_that_passes_overhead_is_followed_over_the_top() {
    let mut head = straight(Limits { pan: [-4.0, 4.0], tilt: [-0.5, 2.6] });
    head.pan.point.x = 0.01;
    let mut setting = Setting::default();
    for step in 0..=150 {
        let angle = 0.02 * f64::from(step);
        let target = Point3::new(0.0, 3.0 * f64::cos(angle), 2.0 + 3.0 * f64::sin(angle));
        let Ok(found) = aim(&head, &target, &setting) else { continue };
        let way = (found.setting.pan - setting.pan).hypot(found.setting.tilt - setting.tilt);
        if angle < 2.55 {
            assert!(way < 0.1, "{angle}: {setting:?} to {:?}", found.setting);
        }
        setting = found.setting;
    }
    // Beyond the limit of tilt the target was kept in the image as long as that went, and then taken from the other side.
    assert!(setting.tilt < 0.3 && setting.pan.abs() > 3.0, "{setting:?}");
}

#[test]
fn at_a_limit_the_head_stays_until_the_target_has_left_the_image() {
    let head = straight(Limits { pan: [-PI, PI], tilt: [-1.0, 1.0] });
    let target = |pan: f64| seen_from(&head, &Setting::new(pan, 0.1), 4.0);
    let from = Setting::new(3.1, 0.1);
    let held = refused(&head, &target(PI + 0.1), &from);
    assert!((held.nearest.setting.pan - PI).abs() < 1e-6 && held.nearest.off_centre_px < 90.0, "{held:?}");
    let other = held.other.unwrap();
    assert!((other.pan - (0.1 - PI)).abs() < 1e-6 && (other.tilt - 0.1).abs() < 1e-6, "{other:?}");
    let Obstacle::OutOfLimits { pan, tilt } = held.reason else { panic!("{held:?}") };
    assert!((pan - 0.1).abs() < 1e-9 && tilt == 0.0);
    // Half the image is 25°.
    let taken = aimed(&head, &target(PI + 0.6), &from);
    assert!((taken.setting.pan - (0.6 - PI)).abs() < 1e-6, "{taken:?}");
    // And back: it dithers about the limit without swinging round.
    assert!(refused(&head, &target(PI - 0.1), &Setting::new(0.6 - PI, 0.1)).nearest.setting.pan < -3.1);
}

#[test]
fn no_head_stays_at_a_limit_for_want_of_a_small_turn() {
    // Near the tilt axis that stands still, solutions lie close to one another, and the nearest of them may be out of the limits.
    let head = crooked([0.13, -0.17, 0.12, 0.0], [0.0; 4], Stacking::PanOnTilt);
    for pan in 0..=15 {
        for tilt in -4..=4 {
            let truth = Setting::new(-1.75 + 0.02 * f64::from(pan), 0.1 * f64::from(tilt));
            let from = head.limits.clamp(&Setting::new(truth.pan + 0.5, truth.tilt - 0.3));
            aimed(&head, &seen_from(&head, &truth, 3.0), &from);
        }
    }
}

#[test]
fn what_lies_beyond_the_limits_is_said_to_and_approached() {
    let head = straight(Limits::symmetric(1.0, 0.4));
    let beyond = refused(&head, &seen_from(&head, &Setting::new(1.2, 0.3), 3.0), &Setting::default());
    let Obstacle::OutOfLimits { pan, tilt } = beyond.reason else { panic!("{beyond:?}") };
    assert!((pan - 0.2).abs() < 1e-9 && tilt == 0.0 && beyond.other.is_none());
    let text = beyond.to_string();
    assert!(text.contains("11.5° of pan") && text.contains("0.0° of tilt"), "{text}");
    // The nearest is really the nearest: no allowed setting around has it closer to the middle.
    let target = seen_from(&head, &Setting::new(1.3, -0.9), 3.0);
    let corner = refused(&head, &target, &Setting::default()).nearest;
    for pan in 0..=200 {
        for tilt in 0..=80 {
            let setting = Setting::new(f64::from(pan) * 0.01 - 1.0, f64::from(tilt) * 0.01 - 0.4);
            let seen = head.camera_at(&setting).project(&target);
            let off = seen.map_or(f64::INFINITY, |it| (it - Point2::new(319.5, 239.5)).norm());
            assert!(off > corner.off_centre_px - 1e-3, "{setting:?} {off} {corner:?}");
        }
    }
    let behind = refused(&head, &Point3::new(0.3, -4.0, 2.0), &Setting::default());
    assert_eq!((behind.reason, behind.nearest.off_centre_px), (Obstacle::Behind, f64::INFINITY));
    assert!((behind.nearest.setting.pan - 1.0).abs() < 1e-6);
}

#[test]
fn a_head_that_cannot_tilt_reaches_its_plane_only() {
    let head = straight(Limits { pan: [-2.0, 2.0], tilt: [0.0, 0.0] });
    let level = aimed(&head, &Point3::new(1.0, 2.0, 2.0), &Setting::default());
    assert!((level.setting.pan - 0.5_f64.atan()).abs() < 1e-9 && level.setting.tilt == 0.0);
    let above = refused(&head, &Point3::new(1.0, 2.0, 2.5), &Setting::default());
    assert!((above.nearest.setting.pan - 0.5_f64.atan()).abs() < 1e-6);
    let tangent = 0.5 / 5.0_f64.sqrt();
    assert!((above.nearest.off_centre_px - 700.0 * tangent).abs() < 1e-3, "{above:?}");
}

#[test]
fn straight_up_and_down_keep_the_present_pan() {
    let head = straight(Limits::WIDE);
    for (target, tilt) in [([0.0, 0.0, 7.0], FRAC_PI_2), ([0.0, 0.0, 0.5], -FRAC_PI_2)] {
        for pan in [-2.0, 0.0, 1.3] {
            let found = aimed(&head, &Point3::from(target), &Setting::new(pan, 0.2));
            assert!((found.setting.pan - pan).abs() < 1e-6 && (found.setting.tilt - tilt).abs() < 1e-6, "{found:?}");
        }
    }
}

#[test]
fn a_target_on_the_axis_of_a_head_whose_lens_is_beside_it_is_refused() {
    let mut head = straight(Limits { pan: [-4.0, 4.0], tilt: [-2.0, 2.0] });
    head.pan.point.x = 0.10; // the line of sight always passes the axis 10 cm off
    let on_axis = refused(&head, &Point3::new(0.10, 0.0, 7.0), &Setting::new(0.4, 0.3));
    assert!(matches!(on_axis.reason, Obstacle::NearAxis { distance } if distance < 1e-9), "{on_axis:?}");
    // As near as it gets: 10 cm off at 5 m.
    let expected = 700.0 * 0.10 / 5.0;
    assert!((on_axis.nearest.off_centre_px - expected).abs() < 0.1 * expected, "{on_axis:?}");
    let beside = refused(&head, &Point3::new(0.15, 0.0, 7.0), &Setting::new(0.4, 0.3));
    assert!(matches!(beside.reason, Obstacle::NearAxis { distance } if (distance - 0.05).abs() < 1e-9));
    aimed(&head, &Point3::new(0.25, 0.0, 7.0), &Setting::new(0.4, 0.3));
}

#[test]
fn parallel_axes_are_named() {
    let mut head = straight(Limits::symmetric(3.0, 3.0));
    head.tilt = head.pan;
    let parallel = refused(&head, &Point3::new(1.0, 2.0, 2.5), &Setting::default());
    assert!(matches!(parallel.reason, Obstacle::ParallelAxes { angle } if angle < 1e-9), "{parallel:?}");
    // What is in the plane that it sweeps is in reach all the same.
    aimed(&head, &Point3::new(1.0, 2.0, 2.0), &Setting::default());
}

#[test]
fn a_target_within_the_swing_of_the_lens_is_refused() {
    let mut head = straight(Limits::symmetric(3.0, 3.0));
    head.pan.point.z = -0.3;
    head.tilt.point.z = -0.3;
    let near = refused(&head, &Point3::new(0.0, -0.25, 2.0), &Setting::default());
    assert!(matches!(near.reason, Obstacle::TooNear { distance } if (distance - 0.05).abs() < 1e-9), "{near:?}");
}

#[test]
fn what_is_not_finite_is_refused() {
    let head = straight(Limits::symmetric(1.0, 1.0));
    let nan = refused(&head, &Point3::new(f64::NAN, 1.0, 1.0), &Setting::new(0.3, 0.2));
    assert_eq!((nan.reason, nan.nearest.setting), (Obstacle::NotFinite, Setting::new(0.3, 0.2)));
    let from = refused(&head, &Point3::new(0.0, 1.0, 1.0), &Setting::new(f64::INFINITY, 0.2));
    assert_eq!((from.reason, from.nearest.setting), (Obstacle::NotFinite, Setting::new(0.0, 0.2)));
}

#[test]
fn the_middle_of_the_image_is_not_the_principal_point() {
    let mut head = straight(Limits::symmetric(1.0, 1.0));
    head.at_rest.intrinsics.principal = [300.0, 260.0];
    head.at_rest.distortion.k1 = -0.2;
    aimed(&head, &Point3::new(0.4, 3.0, 2.3), &Setting::default());
}

#[test]
fn the_whole_rig_may_stand_anywhere() {
    let mut head = crooked([0.05; 4], [0.05; 4], Stacking::TiltOnPan);
    let target = seen_from(&head, &Setting::new(0.7, 0.2), 3.0);
    let here = aimed(&head, &target, &Setting::default());
    let moved = Isometry3::from_parts(
        Vector3::new(40.0, -7.0, 1.0).into(),
        UnitQuaternion::from_scaled_axis(Vector3::new(0.3, 1.2, -2.0)),
    );
    head.at_rest.camera_from_world *= moved.inverse();
    let there = aimed(&head, &(moved * target), &Setting::default());
    assert!(
        (here.setting.pan - there.setting.pan).abs() < 1e-9 && (here.setting.tilt - there.setting.tilt).abs() < 1e-9
    );
}

#[test]
fn zoom_is_chosen_such_that_the_region_fills_the_image() {
    use crate::pan_tilt::zoom::{ZoomStop, ZoomTable};
    let mut head = crooked([0.05; 4], [0.05; 4], Stacking::TiltOnPan);
    let target = seen_from(&head, &Setting::new(0.7, 0.2), 3.0);
    assert_eq!(aim_at_sphere(&head, &target, 0.3, 0.8, &Setting::default()), aim(&head, &target, &Setting::default()));
    let stop = |zoom: f64, focal: f64, u: f64| {
        let mut intrinsics = head.at_rest.intrinsics;
        (intrinsics.focal, intrinsics.principal[0]) = ([focal; 2], u);
        ZoomStop { zoom, intrinsics, distortion: Default::default() }
    };
    head.zoom = Some(ZoomTable::new(vec![stop(0.0, 700.0, 319.5), stop(1.0, 8400.0, 340.0)]).unwrap());
    let found = aim_at_sphere(&head, &target, 0.15, 0.8, &Setting::default()).unwrap();
    let camera = head.camera_at(&found.setting);
    assert!((camera.project(&target).unwrap() - Point2::new(319.5, 239.5)).norm() < 1e-6);
    let focal = camera.intrinsics.focal[0];
    assert!((focal * (0.15_f64 / 3.0).asin().tan() - 0.8 * 240.0).abs() < 0.01 * 192.0, "{found:?}");
}
