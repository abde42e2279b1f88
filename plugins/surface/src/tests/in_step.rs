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
    for late_m in [0.0012, 0.006] {
        let (surfaces, report) = tracked(&late(2..3, late_m, 5), &cameras(2), tracking());
        let is_reported = report.remarks.iter().any(|it| it.contains("moments were left out"));
        assert!(
            is_reported && report.figures["surface.out_of_step"] == 1.0,
            "{:?} {:?}",
            report.remarks,
            report.figures
        );
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
    let is_reported = report.remarks.iter().any(|it| it.contains("the median residual of lines of sight"));
    assert!(is_reported && surfaces.len() == 4, "{}: {:?}", surfaces.len(), report.remarks);
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

/// A plane before three cameras that moves across them, `change` made of each camera's picture.
fn three(cameras: &[Camera], change: impl Fn(usize, usize) -> (usize, f64)) -> Vec<Vec<Image>> {
    let scene = Scene::of(Shape::Plane, 82);
    let one = |k: usize| {
        let picture = |id: usize| {
            let (shown, late) = change(k, id);
            let at = 0.004 * (k as f64 - late);
            scene.moved(Isometry3::translation(at, 0.3 * at, 0.0)).picture(&cameras[shown], id as u16)
        };
        (0..3).map(picture).collect()
    };
    (0..3).map(one).collect()
}

/// With the third camera's pictures shifted along the base.
fn shifted(mut moments: Vec<Vec<Image>>, by: usize) -> Vec<Vec<Image>> {
    for picture in moments.iter_mut().map(|it| &mut it[2]) {
        let width = picture.width as usize;
        let row = |row: &[u8]| [&row[..by], &row[..width - by]].concat();
        picture.pixels = picture.pixels.chunks(width).flat_map(row).collect();
    }
    moments
}

fn reference() -> tracker::TrackerSettings {
    tracker::TrackerSettings { surface: SurfaceSettings { reference: "cam-1".into(), ..settings() }, ..tracking() }
}

#[test]
fn three_cameras_that_contradict_each_other_from_the_first_moment_on_are_told_and_points_are_as_uncertain() {
    let cameras = cameras(3);
    let (as_calibrated, report) = tracked(&three(&cameras, |_, id| (id, 0.0)), &cameras, reference());
    assert!(!report.remarks.iter().any(|it| it.contains("contradict")), "{:?}", report.remarks);
    let sigma_mm = report.figures["surface.sigma_mm"];
    // One sees pictures that are shifted by two pixels along the base; one is half a picture late.
    let shifted = shifted(three(&cameras, |_, id| (id, 0.0)), 2);
    let late = three(&cameras, |_, id| (id, if id == 2 { 0.5 } else { 0.0 }));
    for (what, moments) in [("shifted", shifted), ("late", late)] {
        let (surfaces, report) = tracked(&moments, &cameras, reference());
        let is_reported = report.remarks.iter().any(|it| it.contains("contradict each other"));
        assert!(is_reported && report.figures["surface.sigma_mm"] > 5.0 * sigma_mm, "{what}: {:?}", report.remarks);
        let off = |it: &TrackedPoint| it.position.y.abs() / it.covariance[(1, 1)].sqrt();
        let far = surfaces[0].list.iter().filter(|it| off(it) > 3.0).count();
        assert!(20 * far < surfaces[0].list.len() && surfaces[0].list.len() > 100, "{what}: {far} beyond 3 sigma");
    }
    assert!(as_calibrated[0].list.len() > 300);
}

#[test]
fn pictures_of_exchanged_cameras_give_nothing() {
    let cameras = cameras(3);
    let (surfaces, report) = tracked(&three(&cameras, |_, id| ([1, 0, 2][id], 0.0)), &cameras, reference());
    let n: usize = surfaces.iter().map(|it| it.list.len()).sum();
    assert_eq!(n, 0, "{:?} {:?}", report.remarks, report.figures);
}

/// Six pixels along the base: no three lines of sight meet, any two do.
#[test]
fn a_camera_that_sees_all_at_another_depth_is_no_texture_that_repeats() {
    let cameras = cameras(3);
    let moments = shifted(three(&cameras, |_, id| (id, 0.0)), 6);
    let (surfaces, report) = tracked(&moments, &cameras, reference());
    let n: usize = surfaces.iter().map(|it| it.list.len()).sum();
    let said = |text: &str| report.remarks.iter().any(|it| it.contains(text));
    assert_eq!(n, 0, "{:?} {:?}", report.remarks, report.figures);
    assert!(said("between cameras") && !said("the texture repeats"), "{:?}", report.remarks);
}

/// The second camera's pictures are a row too low and three columns off: that row is all that shows of it.
#[test]
fn two_cameras_that_contradict_each_other_across_their_base_are_told_and_points_are_as_uncertain() {
    let cameras = cameras(2);
    let mut picture = Scene::of(Shape::Plane, 82).pictures(&cameras);
    let (_, as_calibrated) = matched(picture.clone(), &cameras, settings());
    let width = SIZE[0] as usize;
    let shifted: Vec<u8> =
        [&picture[1].pixels[..width + 3], &picture[1].pixels[..picture[1].pixels.len() - width - 3]].concat();
    picture[1].pixels = shifted;
    let settings = SurfaceSettings { max_misfit_px: 2.0, ..settings() };
    let (points, report) = matched(picture, &cameras, settings);
    let is_reported = |it: &Report| it.remarks.iter().any(|it| it.contains("points that two of them see"));
    assert!(is_reported(&report) && !is_reported(&as_calibrated), "{:?}", report.remarks);
    let off = |it: &CloudPoint| f64::from(it.position.y.abs() / it.covariance[(1, 1)].sqrt());
    let far = points.iter().filter(|it| off(it) > 4.0).count();
    assert!(points.len() > 300 && 20 * far < points.len(), "{far} of {} beyond four standard deviations", points.len());
}
