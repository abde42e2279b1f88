//! A bumped camera and its neighbours, in simulated observations.

use std::sync::Arc;

use foveate::estimation::Random;
use foveate::geometry::Camera;
use foveate::messages::{CameraId, CameraSet, Feature, Features, Provenance, Target, TargetId, Targets};
use foveate_testkit::{camera_ring, check_node};
use nalgebra::{Isometry3, Matrix2, Matrix6, Point2, Point3, Translation3, UnitQuaternion, Vector2, Vector3};

use super::*;

const SIGMA_PX: f64 = 0.1;
const RATE_HZ: f64 = 60.0;

/// Where light number `light` is.
fn light(number: usize, time_s: f64) -> Point3<f64> {
    let phase = 2.1 * number as f64;
    Point3::new(
        0.6 * (0.9 * time_s + phase).sin(),
        0.6 * (0.7 * time_s + 1.7 * phase).cos(),
        1.0 + 0.35 * (1.3 * time_s + 0.6 * phase).sin(),
    )
}

/// What may go wrong in a scene beside a bump.
#[derive(Clone, Copy, Default)]
struct Scene {
    cameras: usize,
    lasts_s: f64,
    /// Share of the observations that are missing [–].
    hidden: f64,
    /// Features that are no light, in each picture.
    clutter: usize,
    /// Whether there is a target where no light is.
    ghost: bool,
}

/// Runs a scene; `turn` gives by how much a camera is turned at a time, about its own axes [rad].
fn watched(scene: Scene, turn: impl Fn(usize, f64) -> Vector3<f64>) -> Watch {
    let cameras = camera_ring(scene.cameras);
    let mut watch = Watch::new(CameraWatchSettings::default().options(), cameras.clone());
    let mut random = Random::new(7);
    let mut moments: Vec<(Time, usize)> = Vec::new();
    for camera in 0..scene.cameras {
        let own = camera as f64 / (RATE_HZ * scene.cameras as f64);
        moments.extend(
            (0..(scene.lasts_s * RATE_HZ) as usize).map(|it| (Time::from_s(own + it as f64 / RATE_HZ), camera)),
        );
    }
    moments.sort_unstable();
    for (time, camera) in moments {
        let time_s = time.as_s();
        let turned = UnitQuaternion::from_scaled_axis(turn(camera, time_s));
        let model = Camera {
            camera_from_world: Isometry3::from_parts(Translation3::identity(), turned)
                * cameras[camera].camera_from_world,
            ..cameras[camera].clone()
        };
        let mut normal3 = || Vector3::new(random.normal(), random.normal(), random.normal());
        let mut list: Vec<Target> = (0..3)
            .map(|number| {
                // At velocities a bumped camera pulls most: nothing is to hang on them.
                target(number, light(number, time_s) + normal3() * 1e-3, normal3() * 2.0)
            })
            .collect();
        if scene.ghost {
            list.push(target(3, light(0, time_s) + Vector3::new(0.05, 0.04, 0.3), Vector3::zeros()));
        }
        let mut features = Vec::new();
        for number in 0..3 {
            let noise = Vector2::new(random.normal(), random.normal()) * SIGMA_PX;
            let seen = model.sees(&light(number, time_s)).map(|it| it + noise);
            features.extend(seen.filter(|_| random.uniform() >= scene.hidden).map(feature));
        }
        let [width, height] = model.image_size.map(f64::from);
        for _ in 0..scene.clutter {
            features.push(feature(Point2::new(random.uniform() * (width - 1.0), random.uniform() * (height - 1.0))));
        }
        watch.add_features(time, Arc::new(Features { camera: CameraId(camera as u16), list: features }));
        watch.add_targets(Arc::new(Targets { time, list }));
    }
    watch.finish();
    watch
}

fn feature(centre: Point2<f64>) -> Feature {
    Feature { centre, covariance: Matrix2::identity() * SIGMA_PX * SIGMA_PX, area: 4, peak: 200, label: None }
}

fn target(number: usize, position: Point3<f64>, velocity: Vector3<f64>) -> Target {
    let mut covariance = Matrix6::identity() * 1e-6;
    covariance.fixed_view_mut::<3, 3>(3, 3).fill_diagonal(0.05 * 0.05);
    Target {
        id: TargetId(number as u32),
        position,
        velocity,
        covariance,
        cameras: CameraSet::default(),
        provenance: Provenance::Measured,
    }
}

const QUIET: Scene = Scene { cameras: 6, lasts_s: 12.0, hidden: 0.1, clutter: 0, ghost: false };

fn knocked(which: usize, at: f64, turn: Vector3<f64>) -> impl Fn(usize, f64) -> Vector3<f64> {
    move |camera, time_s| if camera == which && time_s >= at { turn } else { Vector3::zeros() }
}

#[test]
fn a_bumped_camera_is_named_with_time_size_and_axis() {
    for (mrad, late_s) in [(1.0, 2.5), (5.0, 2.0), (20.0, 2.0)] {
        let turn = Vector3::new(0.2, 0.95, -0.24).normalize() * mrad * 1e-3;
        let watch = watched(QUIET, knocked(2, 5.2, turn));
        let [bump] = watch.bumps() else { panic!("{mrad} mrad: {:?}", watch.bumps()) };
        assert_eq!(bump.cameras, [2], "{mrad} mrad");
        assert!((bump.at.as_s() - 5.2).abs() < 0.6 && bump.detected_at.as_s() - 5.2 < late_s, "{mrad} mrad: {bump:?}");
        assert!((bump.turn - turn).norm() < 0.1 * turn.norm() + 2e-4, "{mrad} mrad: {bump:?}");
    }
}

#[test]
fn a_camera_that_was_turned_from_the_start_is_named_as_well() {
    let watch = watched(QUIET, knocked(4, 0.0, Vector3::new(0.0, 8e-3, 0.0)));
    assert!(watch.bumps().iter().all(|it| it.cameras == [4]), "{:?}", watch.bumps());
    assert_eq!(watch.bumps().len(), 1);
}

#[test]
fn occlusion_clutter_and_a_false_target_report_no_camera() {
    let hard = Scene { lasts_s: 30.0, hidden: 0.4, clutter: 5, ghost: true, ..QUIET };
    for scene in [Scene { lasts_s: 30.0, ..QUIET }, hard] {
        let watch = watched(scene, |_, _| Vector3::zeros());
        assert_eq!(watch.bumps(), []);
        assert!(watch.rows().len() > 300, "{}", watch.rows().len());
    }
    // And the bump is still found among them.
    let watch = watched(hard, knocked(1, 15.0, Vector3::new(4e-3, 0.0, 0.0)));
    assert_eq!(watch.bumps().iter().map(|it| it.cameras.clone()).collect::<Vec<_>>(), [[1]]);
}

#[test]
fn ambiguous_bumps_name_several_cameras() {
    let few = Scene { cameras: 3, ..QUIET };
    let watch = watched(few, knocked(1, 5.0, Vector3::new(0.0, 5e-3, 0.0)));
    for bump in watch.bumps() {
        assert!(bump.cameras.len() > 1 && bump.cameras.contains(&1), "{bump:?}");
    }
    // All are knocked, each another way: nobody is.
    let axes = [Vector3::x(), Vector3::y(), -Vector3::x(), -Vector3::y(), Vector3::x() + Vector3::y(), Vector3::z()];
    let watch = watched(QUIET, |camera, time_s| if time_s >= 5.0 { axes[camera] * 1.5e-3 } else { Vector3::zeros() });
    assert!(watch.bumps().iter().all(|it| it.cameras.len() > 1), "{:?}", watch.bumps());
}

#[test]
fn a_second_bump_of_the_same_camera_is_told_too() {
    let watch = watched(Scene { lasts_s: 20.0, ..QUIET }, |camera, time_s| {
        Vector3::y()
            * if camera != 3 || time_s < 5.0 {
                0.0
            } else if time_s < 13.0 {
                4e-3
            } else {
                8e-3
            }
    });
    let times: Vec<f64> = watch.bumps().iter().filter(|it| it.cameras == [3]).map(|it| it.at.as_s().round()).collect();
    assert_eq!(times, [5.0, 13.0], "{:?}", watch.bumps());
}

#[test]
fn what_is_not_known_yet_is_an_empty_cell_of_the_table() {
    let watch = watched(Scene { cameras: 6, lasts_s: 4.0, ..Scene::default() }, |_, _| Vector3::zeros());
    let names = (0..6).map(|it| format!("c{it}")).collect();
    let table = CameraWatch { watch, names, out: None, file: String::new() }.table();
    let last: Vec<&str> = table.lines().skip(1).map(|it| it.rsplit_once(',').unwrap().1).collect();
    assert!(last.iter().any(|it| it.is_empty()) && !table.contains("NaN"), "{table}");
    assert!(last.iter().all(|it| it.is_empty() || it.parse::<f64>().is_ok_and(f64::is_finite)), "{table}");
}

#[test]
fn cameras_are_named_unless_most_contradict_each_other() {
    let sentence = |of: usize, cameras: usize| {
        let watch = Watch::new(CameraWatchSettings::default().options(), camera_ring(of));
        let names = (0..of).map(|it| format!("c{it}")).collect();
        let bump = Bump {
            cameras: (0..cameras).collect(),
            at: Time::from_s(3.0),
            detected_at: Time::from_s(4.0),
            turn: Vector3::new(0.003, -0.004, 0.0),
            shift_px: 2.5,
            sigmas: 9.0,
        };
        CameraWatch { watch, names, out: None, file: String::new() }.sentence(&bump)
    };
    let one = sentence(6, 1);
    assert!(one.contains("c0 was bumped at 3.0 s: 5.0 mrad (pan +4.0, tilt -3.0, roll -0.0), 2.5 px"), "{one}");
    for (of, cameras) in [(6, 2), (4, 3), (8, 4)] {
        let some = sentence(of, cameras);
        assert!(some.starts_with("one of c0, c1") && some.contains("3.0 s"), "{of}: {some}");
    }
    for (of, cameras) in [(7, 4), (4, 4)] {
        assert!(sentence(of, cameras).starts_with("since 3.0 s most cameras contradict each other"), "{of}, {cameras}");
    }
}

#[test]
fn node_keeps_its_promises() {
    check_node::<CameraWatch>("");
    check_node::<CameraWatch>("bin_s = 1\nbins = 2\nsigmas = 6");
}

#[test]
fn settings_out_of_range_and_missing_cameras_are_named() {
    let none = CameraWatch::new(CameraWatchSettings::default(), &Setup::for_tests()).err();
    assert!(none.is_some_and(|it| it.message.contains("expected at least 3")));
    let settings = CameraWatchSettings { sigmas: 0.0, ..CameraWatchSettings::default() };
    let refused = CameraWatch::new(settings, &Setup::for_tests()).err();
    assert_eq!(refused.and_then(|it| it.setting).as_deref(), Some("sigmas"));
    let settings = CameraWatchSettings { file: "../x".to_owned(), ..CameraWatchSettings::default() };
    let refused = CameraWatch::new(settings, &Setup::for_tests()).err();
    assert_eq!(refused.and_then(|it| it.setting).as_deref(), Some("file"));
}
