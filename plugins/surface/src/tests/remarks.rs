//! What a run must say of itself: textures that repeat, calibrations of other pictures, motions that are too fast, settings that are wrong.

use super::*;

/// Places farther than 3 mm from the surface, and all of them.
fn off(scene: &Scene, points: &[CloudPoint]) -> (usize, usize) {
    let wrong = points.iter().filter(|it| scene.distance(&it.position.cast()) > 3e-3).count();
    (wrong, points.len())
}

#[test]
fn a_texture_that_repeats_is_left_out_and_told_and_one_with_a_little_of_its_own_is_not() {
    // So that what repeats is too fine to be noticed at the level at which seeds are looked for.
    let settings = SurfaceSettings { levels: 3, ..settings() };
    let mut n_refused = 0.0;
    for (period, texture) in [(13.0, 32), (16.0, 36), (19.0, 37), (10.0, 38)] {
        for n_cameras in [2, 3] {
            let cameras = cameras(n_cameras);
            let scene = Scene { period, ..Scene::of(Shape::Plane, texture) };
            let (points, report) = matched(scene.pictures(&cameras), &cameras, settings.clone());
            let (wrong, all) = off(&scene, &points);
            assert!(20 * wrong <= all, "{period}, {n_cameras} cameras: {wrong} of {all}: {:?}", report.figures);
            let refused = report.figures["surface.refused.repeats"];
            let is_reported = report.remarks.iter().any(|it| it.contains("match as well at another depth"));
            assert_eq!(refused > 0.0, is_reported, "{:?}", report.remarks);
            n_refused += refused;
        }
    }
    assert!(n_refused > 300.0, "{n_refused}");
    // A texture of its own, a fourth as strong, says which depth it is.
    let cameras = cameras(2);
    let scene = Scene { period: 16.0, own: 0.25, ..Scene::of(Shape::Plane, 36) };
    let (points, report) = matched(scene.pictures(&cameras), &cameras, settings);
    let (wrong, all) = off(&scene, &points);
    assert!(all > 200 && 20 * wrong <= all, "{wrong} of {all}: {:?}", report.figures);
}

#[test]
fn a_calibration_of_other_pictures_is_told() {
    let cameras = cameras(2);
    let scene = Scene::of(Shape::Plane, 33);
    let outcome = |turned_deg: f64| {
        let mut list = cameras.clone();
        let roll = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turned_deg.to_radians());
        list[1].camera_from_world = Isometry3::from_parts(Vector3::zeros().into(), roll) * list[1].camera_from_world;
        let (points, report) = matched(scene.pictures(&list), &cameras, settings());
        let is_reported = report.remarks.iter().any(|it| it.contains("off their epipolar lines"));
        (points.len(), is_reported, report)
    };
    let (n, is_reported, report) = outcome(0.0);
    assert!(n > 330 && !is_reported, "{n}: {:?}", report.remarks);
    let (n, is_reported, report) = outcome(3.0);
    assert!(n == 0 && is_reported, "{n}: {:?} {:?}", report.remarks, report.figures);
}

#[test]
fn motion_that_is_too_fast_for_the_search_is_told() {
    let cameras = cameras(2);
    let scene = Scene::of(Shape::Plane, 71);
    let outcome = |step_m: f64| {
        let moments: Vec<Vec<Image>> = (0..3)
            .map(|k| scene.moved(Isometry3::translation(step_m * k as f64, 0.0, 0.0)).pictures(&cameras))
            .collect();
        tracked(&moments, &cameras, tracking()).1.remarks.iter().any(|it| it.contains("`first_search_px` = 8"))
    };
    assert!(!outcome(0.006));
    assert!(outcome(0.03));
}

#[test]
fn uniform_motion_is_told_by_the_spacing_of_the_points_and_by_their_errors() {
    let cameras = cameras(2);
    let scene = Scene::of(Shape::Plane, 74);
    let moments: Vec<Vec<Image>> = (0..4).map(|k| scene.moved(pose(k)).pictures(&cameras)).collect();
    let kept = |uniform_radius_mm: f64, uniform_mm: f64| {
        let (surfaces, report) =
            tracked(&moments, &cameras, tracker::TrackerSettings { uniform_radius_mm, uniform_mm, ..tracking() });
        let is_reported = report.remarks.iter().any(|it| it.contains("move unlike their neighbours"));
        (surfaces[3].list.iter().filter(|it| it.n_samples == 4).count(), is_reported)
    };
    let (n, is_reported) = kept(0.0, 0.0);
    assert!(n > 300 && !is_reported, "{n}");
    // Less than from a point to the next.
    assert_eq!(kept(1.0, 0.0), (0, true));
}

#[test]
fn a_setting_of_the_surface_that_is_wrong_is_pointed_at_where_the_tracker_has_it() {
    let setup = setup(&cameras(2));
    let out = [[f64::from(SIZE[0]) + 3.0, 5.0], [5.0, 5.0]];
    let seed = ["cam-0", "cam-1"].into_iter().zip(out).map(|(name, at)| (name.to_owned(), at)).collect();
    let faults = [
        ("patch_px", SurfaceSettings { patch_px: 14, ..settings() }),
        ("reference", SurfaceSettings { reference: "cam-7".into(), ..settings() }),
        ("seeds", SurfaceSettings { seeds: vec![seed], ..settings() }),
    ];
    for (name, surface) in faults {
        let refused = tracker::Tracker::new(tracker::TrackerSettings { surface, ..tracking() }, &setup);
        let refused = refused.map(|_| ()).unwrap_err();
        assert_eq!(refused.setting, Some(format!("surface.{name}")), "{refused}");
    }
}

#[test]
fn a_moment_without_a_picture_leaves_its_number_free_and_counts_in_the_mean_step() {
    let cameras = cameras(2);
    let scene = Scene::of(Shape::Plane, 72);
    // Of moment 2 the reference has no picture; of moment 4 no camera has one, and nothing comes.
    let outcome = |moments: &[u32]| {
        let mut bench = NodeBench::<tracker::Tracker>::with_setup(tracking(), &setup(&cameras)).unwrap();
        for k in moments {
            let moved = scene.moved(Isometry3::translation(1.5e-3 * f64::from(*k), 0.0, 0.0));
            let mut pictures = moved.pictures(&cameras);
            if *k == 2 {
                pictures.remove(0);
            }
            bench.feed_set(&tracker::IMAGE, Time::from_s(0.1 * f64::from(*k)), pictures).unwrap();
        }
        let numbers: Vec<u64> = bench.outputs(&tracker::CLOUD).iter().map(|it| it.stamp.sequence).collect();
        let step_mm = bench.finish().unwrap().figures["step_mm.x"];
        assert!((step_mm - 1.5).abs() < 0.02, "{step_mm} mm with {moments:?}");
        numbers
    };
    assert_eq!(outcome(&[0, 1, 2, 3, 5]), [0, 1, 3, 4]);
    assert_eq!(outcome(&[1, 2, 3]), [0, 2]);
}

#[test]
fn a_calibration_in_millimetres_is_told_and_points_that_are_too_fast_are_not_called_lost() {
    let scene = Scene::of(Shape::Plane, 74);
    let moments: Vec<Vec<Image>> = (0..3)
        .map(|k| scene.moved(Isometry3::translation(1.5e-3 * f64::from(k), 0.0, 0.0)).pictures(&cameras(2)))
        .collect();
    let outcome = |unit: f64| {
        let mut cameras = cameras(2);
        cameras.iter_mut().for_each(|it| it.camera_from_world.translation.vector *= unit);
        let mut setup = setup(&cameras);
        setup.volume_m = setup.volume_m.map(|it| it.map(|corner| corner.map(|at| at * unit)));
        let settings = tracker::TrackerSettings { uniform_radius_mm: 0.0, uniform_mm: 0.0, ..tracking() };
        let mut bench = NodeBench::<tracker::Tracker>::with_setup(settings, &setup).unwrap();
        for (k, pictures) in moments.iter().enumerate() {
            bench.feed_set(&tracker::IMAGE, Time::from_s(k as f64 * 0.1), pictures.clone()).unwrap();
        }
        bench.finish().unwrap().remarks.join("; ")
    };
    let (as_is, in_mm) = (outcome(1.0), outcome(1000.0));
    assert!(!as_is.contains("millimetres") && !as_is.contains("max_speed"), "{as_is}");
    assert!(in_mm.contains("--metres-per-unit 0.001") && in_mm.contains("faster than `max_speed`"), "{in_mm}");
    assert!(!in_mm.contains("not found in the next picture"), "{in_mm}");
}

#[test]
fn a_camera_that_faces_a_surface_and_does_not_see_it_is_counted() {
    let cameras = cameras(3);
    let scene = Scene::of(Shape::Plane, 73);
    let unseen = |is_blind: bool| {
        let mut pictures = scene.pictures(&cameras);
        if is_blind {
            pictures[2].pixels.fill(130);
        }
        let settings = SurfaceSettings { reference: "cam-1".into(), ..settings() };
        matched(pictures, &cameras, settings).1.figures["surface.unseen"]
    };
    let (blind, seeing) = (unseen(true), unseen(false));
    assert!(blind > 0.6 && seeing < 0.3, "{blind} with a blind camera, {seeing} without");
}

#[test]
fn a_volume_that_cuts_the_surface_is_told() {
    let cameras = cameras(2);
    let scene = Scene::of(Shape::Plane, 85);
    let outcome = |low: f64| {
        let setup = Setup { volume_m: Some([[low, -0.15, -0.15], [0.15, 0.15, 0.15]]), ..setup(&cameras) };
        let mut bench = NodeBench::<matcher::Matcher>::with_setup(settings(), &setup).unwrap();
        bench.feed_set(&matcher::IMAGE, Time::from_s(1.0), scene.pictures(&cameras)).unwrap();
        let points: Vec<CloudPoint> = bench.outputs(&matcher::CLOUD)[0].value.iter().collect();
        assert!(points.len() > 150 && points.iter().all(|it| f64::from(it.position.x) > low - 1e-6));
        bench.finish().unwrap().remarks.iter().any(|it| it.contains("beyond the scale's `volume_m`"))
    };
    assert!(outcome(-0.02));
    assert!(!outcome(-0.15));
}
