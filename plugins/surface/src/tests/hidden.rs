//! What a body says of points that no picture shows for a while.

use std::collections::BTreeSet;

use super::*;

/// A limb before it is hidden, while nothing of it is seen for two moments, and after: it turns and goes by three pixels a moment.
fn pose(k: usize) -> Isometry3<f64> {
    let k = k as f64;
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.03, 0.06) * k);
    Isometry3::from_parts(Vector3::new(0.004 * k, 0.001 * k, 0.003 * k).into(), turn)
}

/// The limb, as a body has it.
fn body(k: usize) -> Skeletons {
    let part = SkeletonPart {
        part: 7,
        scale_from_part: pose(k),
        sizes: Vector3::new(0.06, 0.06, 0.1),
        size_sigmas: Vector3::repeat(0.003),
        provenance: Provenance::Measured,
    };
    let body = Skeleton {
        id: 0,
        joints: Vec::new(),
        parts: vec![part],
        limbs: [LimbDetail::Absent; 4],
        facing: 1.0,
        unexplained: 0.0,
        cameras: CameraSet::default(),
    };
    Skeletons { time: Time::from_s(k as f64 * 0.1), list: vec![body], unmodelled: Vec::new() }
}

/// Identities from before that are there after, those of them that lie elsewhere on the limb, and what was said.
fn followed(texture: u64, is_guided: bool) -> (usize, usize, Report) {
    let cameras = cameras(3);
    let scene = Scene { half_m: 0.05, ..Scene::of(Shape::Cylinder(0.06), texture) };
    let away = Isometry3::translation(0.6, 0.0, 0.0);
    let settings = tracker::TrackerSettings {
        surface: SurfaceSettings { reference: "cam-1".into(), ..settings() },
        first_search_px: 12.0,
        ..tracking()
    };
    let mut bench = NodeBench::<tracker::Tracker>::with_setup(settings, &setup(&cameras)).unwrap();
    for k in 0..6 {
        let is_hidden = k == 3 || k == 4;
        let pictures = scene.moved(if is_hidden { away } else { pose(k) }).pictures(&cameras);
        bench.feed_set(&tracker::IMAGE, Time::from_s(k as f64 * 0.1), pictures).unwrap();
        if is_guided {
            bench.feed(&tracker::SKELETONS, Time::from_s(k as f64 * 0.1), body(k)).unwrap();
        }
    }
    let surfaces: Vec<_> = bench.outputs(&tracker::TRACKED).into_iter().map(|it| it.value).collect();
    let counts: Vec<usize> = surfaces.iter().map(|it| it.list.len()).collect();
    assert!(counts[2] > 100 && counts[3] == 0 && counts[4] == 0 && counts[5] > 100, "{counts:?}");
    let place = |k: usize, id: u32| surfaces[k].get(id).map(|it| pose(k).inverse() * it.position);
    let before: BTreeSet<u32> = surfaces[2].list.iter().map(|it| it.id).collect();
    let both: Vec<f64> = before.iter().filter_map(|it| Some((place(2, *it)? - place(5, *it)?).norm())).collect();
    (both.len(), both.iter().filter(|it| **it > 2e-3).count(), bench.finish().unwrap())
}

#[test]
fn a_limb_that_was_hidden_keeps_its_points_where_a_body_says_how_it_went() {
    for texture in [31, 32] {
        let (back, wrong, report) = followed(texture, false);
        assert!(back == 0 && wrong == 0, "{back}, {wrong} wrong: {:?}", report.figures);
        let (back, wrong, report) = followed(texture, true);
        assert!(back > 60 && wrong == 0, "{back}, {wrong} wrong: {:?}", report.figures);
        assert!(report.figures["trajectories.guided"] > 60.0, "{:?}", report.figures);
    }
}

#[test]
fn points_behind_a_bar_are_found_again_where_their_neighbours_went() {
    // Six pixels a moment; the bar covers a stripe of each picture in the third and the fourth.
    let cameras = cameras(3);
    let scene = Scene::of(Shape::Plane, 33);
    let pose = |k: usize| Isometry3::translation(0.007 * k as f64, 0.0, 0.0);
    let moments: Vec<Vec<Image>> = (0..5)
        .map(|k| {
            let mut pictures = scene.moved(pose(k)).pictures(&cameras);
            for picture in pictures.iter_mut().filter(|_| k == 2 || k == 3) {
                picture.pixels.chunks_exact_mut(SIZE[0] as usize).for_each(|row| row[92..108].fill(60));
            }
            pictures
        })
        .collect();
    let surface = SurfaceSettings { reference: "cam-1".into(), ..settings() };
    let (surfaces, report) = tracked(&moments, &cameras, tracker::TrackerSettings { surface, ..tracking() });
    // The edge of the bar holds some up that lie half below it.
    let [(wrong, all), (jumped, _)] = [2e-3, 8e-3].map(|it| super::bad_input::strayed(&surfaces, it, pose));
    let back =
        surfaces[4].list.iter().filter(|it| surfaces[1].get(it.id).is_some() && surfaces[2].get(it.id).is_none());
    let back = back.count();
    assert!(
        back > 60 && 100 * wrong <= all && jumped == 0,
        "{back} back, {wrong}, {jumped} of {all} wrong: {:?}",
        report.figures
    );
}
