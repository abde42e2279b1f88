//! Cameras that look at different times, or show a picture twice.

use super::*;

/// A plane before two cameras across their base, `late_m` behind in the second one at the moments named.
fn late(moments: std::ops::Range<usize>, late_m: f64, n_moments: usize) -> Vec<Vec<Image>> {
    let cameras = cameras(2);
    let scene = Scene::of(Shape::Plane, 82);
    let at = |z: f64| scene.moved(Isometry3::translation(0.0, 0.0, z));
    let one = |k: usize| {
        let z = 0.003 * k as f64;
        let late = if moments.contains(&k) { late_m } else { 0.0 };
        vec![at(z).picture(&cameras[0], 0), at(z - late).picture(&cameras[1], 1)]
    };
    (0..n_moments).map(one).collect()
}

fn ids(surface: &TrackedSurface) -> std::collections::BTreeSet<u32> {
    surface.list.iter().map(|it| it.id).collect()
}

#[test]
fn moments_out_of_step_are_left_out_and_points_are_followed_over_them() {
    let (in_step, _) = tracked(&late(0..0, 0.0, 5), &cameras(2), tracking());
    assert_eq!(in_step.len(), 5);
    // A pixel and a half, then most of the points are no longer where lines of sight meet; and eight pixels, where next to none is.
    for late_m in [0.0012, 0.0024, 0.006] {
        let (surfaces, report) = tracked(&late(2..3, late_m, 5), &cameras(2), tracking());
        let is_told = report.remarks.iter().any(|it| it.contains("moments were left out"));
        assert!(is_told && report.figures["surface.out_of_step"] == 1.0, "{:?} {:?}", report.remarks, report.figures);
        assert_eq!(surfaces.len(), 4);
        let (before, after) = (ids(&surfaces[1]), ids(&surfaces[2]));
        let kept = before.intersection(&after).count();
        assert!(10 * kept > 9 * before.len() && before.len() > 300, "{kept} of {}", before.len());
        assert!((report.figures["step_mm.z"] - 3.0).abs() < 0.03, "{:?}", report.figures);
        // Out of step to the end: nothing more.
        let (surfaces, report) = tracked(&late(2..5, late_m, 5), &cameras(2), tracking());
        assert_eq!((surfaces.len(), report.figures["surface.out_of_step"]), (2, 3.0), "{:?}", report.remarks);
    }
}

#[test]
fn the_matcher_leaves_out_a_moment_out_of_step() {
    let mut bench = NodeBench::<matcher::Matcher>::with_setup(settings(), &setup(&cameras(2))).unwrap();
    for (k, pictures) in late(1..2, 0.0012, 3).into_iter().enumerate() {
        bench.feed_set(&matcher::IMAGE, Time::from_s(k as f64 * 0.1), pictures).unwrap();
    }
    assert_eq!(bench.outputs(&matcher::CLOUD).len(), 2);
    assert_eq!(bench.finish().unwrap().figures["surface.out_of_step"], 1.0);
}

#[test]
fn cameras_that_come_into_step_later_are_told() {
    let (surfaces, report) = tracked(&late(0..2, 0.0012, 4), &cameras(2), tracking());
    let is_told = report.remarks.iter().any(|it| it.contains("lines of sight of a moment's points pass"));
    assert!(is_told && surfaces.len() == 4, "{}: {:?}", surfaces.len(), report.remarks);
}

#[test]
fn a_picture_that_comes_twice_is_taken_for_none_while_the_other_cameras_go_on() {
    let mut moments = late(0..0, 0.0, 5);
    moments[3][1].pixels = moments[2][1].pixels.clone();
    let (surfaces, report) = tracked(&moments, &cameras(2), tracking());
    assert_eq!((surfaces.len(), report.figures["surface.stuck"]), (4, 1.0));
    assert!(report.remarks.iter().any(|it| it.contains("`cam-1`: found the same picture")), "{:?}", report.remarks);
    assert!((report.figures["step_mm.z"] - 3.0).abs() < 0.03, "{:?}", report.figures);
    // A scene at rest, without noise: all show the same again.
    let still = late(0..0, 0.0, 1);
    let (surfaces, report) = tracked(&[still[0].clone(), still[0].clone()], &cameras(2), tracking());
    assert_eq!((surfaces.len(), report.figures["surface.stuck"]), (2, 0.0));
}
