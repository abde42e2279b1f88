//! Cameras on all sides of a thing.

use std::f64::consts::TAU;

use super::*;

/// On a circle of half a metre about the vertical, a little above and below its plane by turns.
fn ring(n: usize) -> Vec<Camera> {
    let eye = |k: usize| {
        let (sin, cos) = (TAU * k as f64 / n as f64).sin_cos();
        Point3::new(0.5 * sin, -0.5 * cos, if k.is_multiple_of(2) { 0.03 } else { -0.03 })
    };
    (0..n).map(|k| Camera::look_at(eye(k), Point3::origin(), SIZE, FOCAL)).collect()
}

/// Clouds of one moment, by the camera whose patches they are of.
fn clouds(
    scene: &Scene,
    cameras: &[Camera],
    settings: SurfaceSettings,
) -> (Vec<(CameraId, String, Vec<CloudPoint>)>, Report) {
    clouds_of(scene.pictures(cameras), cameras, settings)
}

/// The same of pictures that may not be those of the cameras.
fn clouds_of(
    pictures: Vec<Image>,
    cameras: &[Camera],
    settings: SurfaceSettings,
) -> (Vec<(CameraId, String, Vec<CloudPoint>)>, Report) {
    let mut bench = NodeBench::<matcher::Matcher>::with_setup(settings, &setup(cameras)).unwrap();
    bench.feed_set(&matcher::IMAGE, Time::from_s(1.0), pictures).unwrap();
    let clouds = bench.outputs(&matcher::CLOUD).into_iter();
    let clouds = clouds.map(|it| (it.value.camera, it.value.name.clone(), it.value.iter().collect())).collect();
    (clouds, bench.finish().unwrap())
}

/// Of 24 sectors about the vertical, those with twenty points or more.
fn sectors<'a>(points: impl Iterator<Item = &'a CloudPoint>) -> usize {
    let mut counts = [0; 24];
    points.for_each(|it| {
        let turn = f64::from(it.position.y).atan2(f64::from(it.position.x)).rem_euclid(TAU) / TAU;
        counts[((turn * 24.0) as usize).min(23)] += 1;
    });
    counts.iter().filter(|it| **it >= 20).count()
}

#[test]
fn cameras_all_around_measure_all_sides_where_each_is_a_reference() {
    let cameras = ring(10);
    let scene = Scene::of(Shape::Sphere(0.08), 71);
    // From point to point the ball turns by 5°.
    let settings = || SurfaceSettings { step: 4e-3, ..settings() };
    let (one, report) = clouds(&scene, &cameras, settings());
    assert!(one.len() == 1 && sectors(one[0].2.iter()) < 12, "{} sectors", sectors(one[0].2.iter()));
    assert!(report.remarks.iter().any(|it| it.contains("look from another side")), "{:?}", report.remarks);

    let all = SurfaceSettings { reference: "*".into(), ..settings() };
    let (all, report) = clouds(&scene, &cameras, all);
    let who: Vec<u16> = all.iter().map(|it| it.0.0).collect();
    assert_eq!(who, (0..10).collect::<Vec<u16>>());
    assert!(all.iter().all(|it| it.1 == "1"), "named by their moment");
    let points = || all.iter().flat_map(|it| &it.2);
    assert_eq!(sectors(points()), 24);
    assert_eq!(report.figures["surface.points"], points().count() as f64);
    let distances = sorted(points().map(|it| scene.distance(&it.position.cast())).collect());
    let (median, p99) = (distances[distances.len() / 2], distances[distances.len() * 99 / 100]);
    assert!(median < 2e-4 && p99 < 3e-3, "{:.3} mm, {:.3} mm", 1e3 * median, 1e3 * p99);
    // Each cloud is of its own camera: the pixel that a point names sees it.
    for (camera, _, points) in &all {
        let camera = &cameras[usize::from(camera.0)];
        let off = |it: &CloudPoint| {
            let seen = camera.sees(&it.position.cast()).unwrap();
            (seen.x - f64::from(it.pixel[0])).hypot(seen.y - f64::from(it.pixel[1]))
        };
        assert!(points.iter().all(|it| off(it) < 1.5));
    }
    assert!(!report.remarks.iter().any(|it| it.contains("side") || it.contains("contradict")), "{:?}", report.remarks);
}

#[test]
fn a_camera_that_contradicts_all_others_is_named_and_left_out() {
    let cameras = ring(10);
    let scene = Scene::of(Shape::Sphere(0.08), 74);
    let settings = || SurfaceSettings { reference: "*".into(), step: 4e-3, ..settings() };
    let wrong = |all: &[(CameraId, String, Vec<CloudPoint>)]| {
        let points = || all.iter().flat_map(|it| &it.2);
        (points().filter(|it| scene.distance(&it.position.cast()) > 2e-3).count(), points().count())
    };
    let pictures = scene.pictures(&cameras);
    let (_, n) = wrong(&clouds_of(pictures.clone(), &cameras, settings()).0);
    // Along the ring, where no two cameras see it.
    let mut moved = cameras.clone();
    let aside = cameras[4].camera_from_world.inverse() * Vector3::new(0.006, 0.0, 0.0);
    moved[4].camera_from_world *= nalgebra::Translation3::from(aside);
    let (all, report) = clouds_of(pictures.clone(), &moved, settings());
    let named: Vec<&String> = report.remarks.iter().filter(|it| it.contains("contradicts the other cameras")).collect();
    assert!(named.len() == 1 && named[0].contains("`cam-4`"), "{:?}", report.remarks);
    assert!(all[4].2.is_empty() && report.figures["surface.refused.clouds"] > 20.0);
    let (n_wrong, n_left) = wrong(&all);
    assert!(50 * n_wrong < n_left && n_left > n / 2, "{n_wrong} of {n_left}, {n}");
    // Two exchanged.
    let exchanged = pictures.iter().map(|it| match it.camera.0 {
        2 => Image { camera: CameraId(3), ..it.clone() },
        3 => Image { camera: CameraId(2), ..it.clone() },
        _ => it.clone(),
    });
    let (all, report) = clouds_of(exchanged.collect(), &cameras, settings());
    let (n_wrong, n_left) = wrong(&all);
    assert!(50 * n_wrong <= n_left, "{n_wrong} of {n_left}, {:?}", report.remarks);
    let is_named = |it: &String| it.contains("contradict") || it.contains("`cam-2`") || it.contains("exchanged");
    assert!(report.remarks.iter().any(is_named), "{:?}", report.remarks);
}

#[test]
fn a_surface_that_bends_more_than_its_step_says_is_left_out_and_reported() {
    let cameras = ring(10);
    let scene = Scene::of(Shape::Sphere(0.08), 73);
    let (one, report) = clouds(&scene, &cameras, settings());
    assert!(one.iter().map(|it| it.2.len()).sum::<usize>() < 60);
    let is_named = |it: &String| it.contains("`step`") && it.contains("`spacing_px`");
    assert!(report.remarks.iter().any(is_named), "{:?}", report.remarks);
}

#[test]
fn a_reference_without_a_picture_costs_its_own_cloud_alone_and_a_tracker_takes_one() {
    let cameras = ring(10);
    let scene = Scene::of(Shape::Sphere(0.08), 72);
    let two = SurfaceSettings { reference: "cam-[13]".into(), ..settings() };
    assert!(NodeBench::<matcher::Matcher>::with_setup(two, &setup(&cameras)).is_err(), "no such camera");
    let all = SurfaceSettings { reference: "cam-*".into(), ..settings() };
    let mut bench = NodeBench::<matcher::Matcher>::with_setup(all.clone(), &setup(&cameras)).unwrap();
    let pictures = scene.pictures(&cameras).into_iter().filter(|it| it.camera.0 != 4);
    bench.feed_set(&matcher::IMAGE, Time::from_s(1.0), pictures.collect::<Vec<_>>()).unwrap();
    let who: Vec<u16> = bench.outputs(&matcher::CLOUD).iter().map(|it| it.value.camera.0).collect();
    assert_eq!(who, [0, 1, 2, 3, 5, 6, 7, 8, 9]);

    let tracking = tracker::TrackerSettings { surface: all, ..tracker::TrackerSettings::default() };
    let refused = NodeBench::<tracker::Tracker>::with_setup(tracking, &setup(&cameras)).map(|_| ()).unwrap_err();
    assert_eq!(refused.setting.as_deref(), Some("surface.reference"), "{refused}");
    assert!(refused.message.contains("10 cameras"), "{refused}");
}
