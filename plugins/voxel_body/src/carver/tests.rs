//! The carver on a cylinder between six cameras, and on what can go wrong.

use foveate::geometry::{Camera, Distortion};
use foveate::scene::Calibration;
use foveate_testkit::check_node;
use foveate_testkit::scene::ring_calibration;
use nalgebra::{Matrix6, Point2, Point3, Vector3};

use super::*;

const N: usize = 6;

fn setup() -> Setup {
    setup_of(N)
}

fn setup_of(n: usize) -> Setup {
    let mut calibration = ring_calibration(n);
    for it in &mut calibration.cameras {
        it.camera = Camera {
            image_size: [160, 120],
            intrinsics: foveate::geometry::Intrinsics { focal: [98.0; 2], principal: [79.5, 59.5], skew: 0.0 },
            distortion: Distortion { k1: -0.1, ..Distortion::default() },
            ..it.camera.clone()
        };
    }
    let volume_m = Some([[-1.0, -1.0, 0.0], [1.0, 1.0, 2.0]]);
    Setup { calibration: Arc::new(calibration), volume_m, ..Setup::for_tests() }
}

/// Upright cylinders of 0.2 m radius, from 0.4 m to 1.6 m high.
fn silhouette(calibration: &Calibration, camera: usize, people: &[[f64; 2]]) -> Silhouette {
    let model = &calibration.cameras[camera].camera;
    let [width, height] = model.image_size;
    let is_body = |pixel: Point2<f64>| {
        let Some(ray) = model.ray(&pixel) else { return false };
        people.iter().any(|[x, y]| {
            let hits = |step: u32| {
                let point = ray.at(0.02 * f64::from(step));
                (point.x - x).hypot(point.y - y) < 0.2 && (0.4..1.6).contains(&point.z)
            };
            (0..300).any(hits)
        })
    };
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| Point2::new(f64::from(x), f64::from(y))));
    let confidence: Vec<u8> = pixels.map(|it| if is_body(it) { 255 } else { 0 }).collect();
    let n_body = confidence.iter().filter(|it| **it > 0).count() as u32;
    let status = if n_body == 0 { SilhouetteStatus::Empty } else { SilhouetteStatus::Seen };
    Silhouette { camera: CameraId(camera as u16), width, height, status, n_body, confidence, ..Silhouette::default() }
}

fn set(setup: &Setup, people: &[[f64; 2]]) -> Vec<Silhouette> {
    (0..N).map(|it| silhouette(&setup.calibration, it, people)).collect()
}

/// The upper two fifths of a silhouette.
fn lose_top(it: &mut Silhouette) {
    let rows: Vec<usize> =
        (0..it.height as usize).filter(|row| it.confidence[row * 160..][..160].iter().any(|it| *it > 0)).collect();
    let top = rows[0]..rows[2 * rows.len() / 5];
    it.confidence[top.start * 160..top.end * 160].fill(0);
    it.n_body = it.confidence.iter().filter(|it| **it > 0).count() as u32;
}

fn settings() -> CarverSettings {
    CarverSettings { voxel_mm: 40.0, ..CarverSettings::default() }
}

#[track_caller]
fn carve(setup: &Setup, settings: CarverSettings, set: Vec<Silhouette>) -> Arc<Voxels> {
    let mut bench = NodeBench::<Carver>::with_setup(settings, setup).unwrap();
    bench.feed_set(&SILHOUETTES, Time::from_s(1.0), set).unwrap();
    bench.outputs(&VOXELS).remove(0).value
}

fn litres() -> f64 {
    std::f64::consts::PI * 0.04 * 1.2 * 1e3
}

#[test]
fn node_keeps_its_promises() {
    check_node::<Carver>("volume_m = { min = [0, 0, 0], max = [1, 1, 1] }");
    check_node::<Carver>("volume_m = { min = [0, 0, 0], max = [1, 1, 1] }\nmay_err = 1\nmin_views = 3");
    check_node::<Carver>("volume_m = { min = [0, 0, 0], max = [1, 1, 1] }\nmay_lose = 0.1\nmin_component_l = 0.5");
    let refused = NodeBench::<Carver>::new(settings()).err().unwrap();
    assert!(refused.message.contains("found no volume"), "{refused:?}");
}

#[test]
fn more_views_than_there_are_cameras_are_refused() {
    for (settings, expected) in [
        (CarverSettings { may_err: 6, ..settings() }, "found 6, expected fewer than the 6 cameras"),
        (CarverSettings { min_views: 7, ..settings() }, "found 7, expected no more than the 6 cameras"),
    ] {
        let refused = NodeBench::<Carver>::with_setup(settings, &setup()).err().unwrap();
        assert!(refused.message.contains(expected), "{refused:?}");
    }
}

#[test]
fn a_person_has_the_right_volume_and_two_people_are_two() {
    let setup = setup();
    let one = carve(&setup, settings(), set(&setup, &[[0.1, 0.0]]));
    let ratio = one.volume() * 1e3 / litres();
    assert!((0.95..1.35).contains(&ratio), "{ratio}");
    assert!((one.components[0].centroid - Point3::new(0.1, 0.0, 1.0)).norm() < 0.08, "{:?}", one.components[0]);
    assert!(one.views.iter().all(|it| it.status == ViewStatus::Used && it.covered > 0.95), "{:?}", one.views);
    assert!(!one.components[0].is_cut_off && one.iter().any(|it| it.is_surface) && one.iter().any(|it| !it.is_surface));
    let two = carve(&setup, settings(), set(&setup, &[[0.5, 0.3], [-0.5, -0.2]]));
    assert_eq!(two.components.len(), 2);
    assert!(two.iter().all(|it| (it.component as usize) < 2 && it.seen == 6 && it.dissent == 0));
}

#[test]
fn a_target_names_the_body_that_it_is_in() {
    let setup = setup();
    let mut bench = NodeBench::<Carver>::with_setup(settings(), &setup).unwrap();
    let target = |id: u32, x: f64| Target {
        id: TargetId(id),
        position: Point3::new(x, 0.1, 1.5),
        velocity: Vector3::zeros(),
        covariance: Matrix6::identity(),
        cameras: CameraSet::default(),
        provenance: Provenance::Predicted,
    };
    let list = vec![target(7, -0.6), target(8, 0.55), target(9, 0.0)];
    bench.feed(&TARGETS, Time::from_s(1.0), Targets { time: Time::from_s(1.0), list }).unwrap();
    bench.feed_set(&SILHOUETTES, Time::from_s(1.0), set(&setup, &[[0.5, 0.1], [-0.5, 0.1]])).unwrap();
    let voxels = bench.outputs(&VOXELS).remove(0).value;
    for component in &voxels.components {
        let expected = if component.centroid.x > 0.0 { TargetId(8) } else { TargetId(7) };
        assert_eq!(component.target, Some(expected), "{component:?}");
    }
}

#[test]
fn views_that_are_worth_nothing_are_named_and_the_others_carve() {
    let setup = setup();
    let people = [[0.1, 0.0]];
    let with = |change: &dyn Fn(&mut Silhouette)| {
        let mut set = set(&setup, &people);
        change(&mut set[2]);
        set
    };
    let wrong_place = silhouette(&setup.calibration, 2, &[[-0.7, 0.6]]);
    let cases: [(ViewStatus, Vec<Silhouette>); 5] = [
        (ViewStatus::Empty, with(&|it| (*it).clone_from(&silhouette(&setup.calibration, 2, &[])))),
        (ViewStatus::Full, with(&|it| it.status = SilhouetteStatus::Full)),
        (ViewStatus::Moved, with(&|it| it.status = SilhouetteStatus::Moved)),
        (ViewStatus::Learning, with(&|it| it.status = SilhouetteStatus::Learning)),
        (ViewStatus::Contradicts, with(&|it| it.clone_from(&wrong_place))),
    ];
    for (status, set) in cases {
        let voxels = carve(&setup, settings(), set);
        let found: Vec<ViewStatus> = voxels.views.iter().map(|it| it.status).collect();
        let expected: Vec<ViewStatus> = (0..N).map(|it| if it == 2 { status } else { ViewStatus::Used }).collect();
        assert_eq!(found, expected);
        let ratio = voxels.volume() * 1e3 / litres();
        assert!((0.95..1.6).contains(&ratio), "{status:?}: {ratio}");
    }
}

#[test]
fn where_several_views_contradict_what_is_said_of_a_voxel_is_what_its_views_say() {
    use foveate::geometry::voxels::{CarveOptions, SilhouetteView, keeps};
    let setup = setup();
    let mut set = set(&setup, &[[0.1, 0.0]]);
    // Each of three cameras sees another person, whom no other sees: none of them alone is to blame.
    for camera in [0, 2, 4] {
        let centre = setup.calibration.cameras[camera].camera.centre();
        let aside = Vector3::new(-centre.y, centre.x, 0.0).normalize() * 0.7;
        set[camera] = silhouette(&setup.calibration, camera, &[[0.1, 0.0], [aside.x, aside.y]]);
    }
    let settings = CarverSettings { may_err: 1, min_views: 3, ..settings() };
    let voxels = carve(&setup, settings, set.clone());
    assert!(voxels.views.iter().all(|it| it.status == ViewStatus::Used), "{:?}", voxels.views);
    let views: Vec<SilhouetteView> = set
        .iter()
        .map(|it| SilhouetteView {
            camera: &setup.calibration.cameras[it.camera.0 as usize].camera,
            left: 0,
            top: 0,
            shrink: 1,
            width: it.width,
            height: it.height,
            confidence: &it.confidence,
        })
        .collect();
    let options = CarveOptions { may_err: 1, min_views: 3 };
    assert!(!voxels.is_empty());
    for voxel in voxels.iter() {
        let centre = voxels.origin + Vector3::from(voxel.index.map(|it| f64::from(it) + 0.5)) * voxels.size;
        let said = (usize::from(voxel.seen), usize::from(voxel.dissent));
        assert_eq!(keeps(&centre, &views, &options), Some(said), "{centre}");
    }
}

#[test]
fn a_camera_that_falls_silent_is_missing_and_one_without_worth_at_all_is_a_gap() {
    let setup = setup();
    let mut bench = NodeBench::<Carver>::with_setup(settings(), &setup).unwrap();
    bench.feed_set(&SILHOUETTES, Time::from_s(1.0), set(&setup, &[[0.0, 0.0]])).unwrap();
    let mut fewer = set(&setup, &[[0.0, 0.0]]);
    fewer.remove(4);
    bench.feed_set(&SILHOUETTES, Time::from_s(1.1), fewer).unwrap();
    let mut full = set(&setup, &[[0.0, 0.0]]);
    full.iter_mut().for_each(|it| it.status = SilhouetteStatus::Full);
    bench.feed_set(&SILHOUETTES, Time::from_s(1.2), full).unwrap();
    bench.feed_set(&SILHOUETTES, Time::from_s(1.3), set(&setup, &[])).unwrap();
    let voxels = bench.outputs(&VOXELS);
    assert_eq!(voxels[1].value.views[4].status, ViewStatus::Missing);
    assert!(voxels[1].value.len() >= voxels[0].value.len());
    assert!(voxels[2].value.is_empty(), "no person");
    assert_eq!(bench.gaps(&VOXELS)[0].reason, "no camera has a silhouette that is worth anything");
    let figures = bench.finish().unwrap().figures;
    assert_eq!((figures["voxels.frames"], figures["voxels.gaps"], figures["voxels.nobody"]), (3.0, 1.0, 1.0));
}

#[test]
fn who_leaves_the_volume_is_cut_off() {
    let setup = setup();
    let voxels = carve(&setup, settings(), set(&setup, &[[0.95, 0.0]]));
    assert!(voxels.components[0].is_cut_off);
    assert!(voxels.iter().all(|it| u32::from(it.index[0]) < voxels.cells[0]));
}

#[test]
fn a_person_as_dark_as_the_floor_is_carved_where_no_view_is_sure_of_background() {
    let setup = setup();
    let doubtful = |at: usize| {
        let mut it = silhouette(&setup.calibration, at, &[[0.1, 0.0]]);
        // Below the middle of the picture his clothes are as dark as the floor, and so is what lies around him far and wide in one view.
        let half = it.confidence.len() / 2;
        it.confidence[half..].iter_mut().for_each(|it| *it = (*it).min(100));
        if at == 0 {
            it.confidence[half..].iter_mut().for_each(|it| *it = (*it).max(90));
        }
        it.n_body = it.confidence.iter().filter(|it| **it >= Silhouette::BODY).count() as u32;
        it
    };
    let carve = |may_be: f64| {
        let settings = CarverSettings { may_be, min_completeness: 0.0, ..settings() };
        carve(&setup, settings, (0..N).map(doubtful).collect())
    };
    let (without, with) = (carve(0.5), carve(0.25));
    let whole = litres();
    assert!(without.volume() * 1e3 < 0.75 * whole, "{}", without.volume() * 1e3);
    let ratio = with.volume() * 1e3 / whole;
    assert!((0.95..1.35).contains(&ratio) && with.components.len() == 1, "{ratio}");
    // What views say of a voxel in doubt is what they say: that it is no body.
    assert!(without.iter().all(|it| it.dissent == 0) && with.iter().any(|it| it.seen == 6 && it.dissent == 6));
    for bad in [0.0, 0.6] {
        let refused = NodeBench::<Carver>::with_setup(CarverSettings { may_be: bad, ..settings() }, &setup).err();
        assert_eq!(refused.and_then(|it| it.setting).as_deref(), Some("may_be"));
    }
}

/// What a carver says at the end of one set.
#[track_caller]
fn remarks(setup: &Setup, settings: CarverSettings, set: Vec<Silhouette>) -> Vec<String> {
    let mut bench = NodeBench::<Carver>::with_setup(settings, setup).unwrap();
    bench.feed_set(&SILHOUETTES, Time::from_s(1.0), set).unwrap();
    bench.finish().unwrap().remarks
}

#[track_caller]
fn check_remark(remarks: &[String], expected: &str) {
    assert!(remarks.iter().any(|it| it.contains(expected)), "expected {expected:?} in {remarks:#?}");
}

#[test]
fn a_camera_that_is_off_by_less_than_a_body_is_left_out_and_named_with_its_shift() {
    let true_setup = setup();
    let set = set(&true_setup, &[[0.1, 0.0]]);
    let pixels_of = |metres: f64| {
        let camera = &true_setup.calibration.cameras[2].camera;
        let depth = (camera.camera_from_world * Point3::new(0.1, 0.0, 1.0)).z;
        (camera.intrinsics.focal[0] * metres / depth).round() as i32
    };
    for off in [0.1, -0.2] {
        let mut calibration = Calibration::clone(&true_setup.calibration);
        // The camera is said to stand to its right.
        calibration.cameras[2].camera.camera_from_world.translation.x -= off;
        let said = Setup { calibration: Arc::new(calibration), ..setup() };
        let settings = CarverSettings { voxel_mm: 20.0, ..settings() };
        let voxels = carve(&said, settings.clone(), set.clone());
        let statuses: Vec<ViewStatus> = voxels.views.iter().map(|it| it.status).collect();
        let expected = |it| if it == 2 { ViewStatus::Contradicts } else { ViewStatus::Used };
        assert_eq!(statuses, (0..N).map(expected).collect::<Vec<_>>());
        let ratio = voxels.volume() * 1e3 / litres();
        assert!((0.95..1.3).contains(&ratio), "{ratio}");
        // It sees the body farther right than the others say, by as much.
        let px = pixels_of(off);
        let side = if px > 0 { "right" } else { "left" };
        let name = &said.calibration.cameras[2].name;
        check_remark(
            &remarks(&said, settings, set.clone()),
            &format!(
                "{name}: left out of 1 of 1 sets because it contradicts the others: its silhouettes are {} px {side}",
                px.abs()
            ),
        );
    }
}

#[test]
fn a_camera_that_shows_to_be_off_now_and_then_stays_left_out_and_comes_back_once_it_fits() {
    let setup = setup();
    let right = set(&setup, &[[0.1, 0.0]]);
    let mut wrong = right.clone();
    wrong[2] = silhouette(&setup.calibration, 2, &[[0.1, 0.15]]);
    let mut bench = NodeBench::<Carver>::with_setup(CarverSettings { voxel_mm: 20.0, ..settings() }, &setup).unwrap();
    // A search in every ninth set: it shows in each second one, four times, and no more.
    for at in 0..14 * 9_u32 {
        let is_off = at < 63 && (at / 9).is_multiple_of(2);
        let set = if is_off { wrong.clone() } else { right.clone() };
        bench.feed_set(&SILHOUETTES, Time::from_s(f64::from(at) / 25.0), set).unwrap();
    }
    let out: Vec<bool> =
        bench.outputs(&VOXELS).iter().map(|it| it.value.views[2].status == ViewStatus::Contradicts).collect();
    assert!(out[..63].iter().all(|it| *it), "{out:?}");
    assert!(out[13 * 9..].iter().all(|it| !*it), "{out:?}");
}

#[test]
fn two_cameras_that_are_off_at_once_are_both_named_and_no_good_one_is() {
    let true_setup = setup_of(8);
    let set: Vec<Silhouette> = (0..8).map(|it| silhouette(&true_setup.calibration, it, &[[0.1, 0.0]])).collect();
    let settings = CarverSettings { voxel_mm: 20.0, ..settings() };
    let statuses = |off: &[(usize, [f64; 2])]| -> Vec<ViewStatus> {
        let mut calibration = Calibration::clone(&true_setup.calibration);
        for (camera, [x, y]) in off {
            let translation = &mut calibration.cameras[*camera].camera.camera_from_world.translation;
            translation.x += x;
            translation.y += y;
        }
        let said = Setup { calibration: Arc::new(calibration), ..setup_of(8) };
        carve(&said, settings.clone(), set.clone()).views.iter().map(|it| it.status).collect()
    };
    for (pair, off) in [([1, 4], [[0.15, 0.0], [-0.15, 0.0]]), ([2, 3], [[0.15, 0.0], [0.0, 0.15]])] {
        let expected = |it| if pair.contains(&it) { ViewStatus::Contradicts } else { ViewStatus::Used };
        let found = statuses(&[(pair[0], off[0]), (pair[1], off[1])]);
        assert_eq!(found, (0..8).map(expected).collect::<Vec<_>>(), "{pair:?}");
    }
    // Where every second one is off no majority is left that agrees: whoever is named is one of these.
    let found = statuses(&[(0, [0.15, 0.0]), (2, [-0.15, 0.0]), (4, [0.15, 0.0]), (6, [-0.15, 0.0])]);
    let good = [1, 3, 5, 7];
    assert!(good.iter().all(|it| found[*it] == ViewStatus::Used), "{found:?}");
}

#[test]
fn what_one_view_lost_is_kept_where_the_others_ask_for_it() {
    let setup = setup();
    let whole = set(&setup, &[[0.1, 0.0]]);
    let cut = |set: &[Silhouette]| {
        let mut set = set.to_vec();
        lose_top(&mut set[1]);
        set
    };
    let with = |may_lose: f64, set: Vec<Silhouette>| {
        carve(&setup, CarverSettings { may_lose, min_completeness: 0.0, voxel_mm: 20.0, ..settings() }, set)
    };
    let (truth, lost, kept) = (with(0.0, whole.clone()), with(0.0, cut(&whole)), with(0.25, cut(&whole)));
    let part = |it: &Voxels| it.volume() / truth.volume();
    assert!(part(&lost) < 0.9, "{}", part(&lost));
    assert!((0.95..1.03).contains(&part(&kept)), "{}", part(&kept));
    assert_eq!(kept.components.len(), 1);
    // The view that lost it is not taken for one that was moved.
    let judged = carve(&setup, CarverSettings { voxel_mm: 20.0, ..settings() }, cut(&whole));
    assert!(judged.views.iter().all(|it| it.status == ViewStatus::Used), "{:?}", judged.views);
    // Where silhouettes fit each other, and where one alone shows something, the hull is what it was.
    assert!((part(&with(0.25, whole.clone())) - 1.0).abs() < 0.003);
    let mut ghost = whole.clone();
    let of_ghost = silhouette(&setup.calibration, 3, &[[0.1, 0.0], [0.6, 0.6]]);
    assert!(of_ghost.n_body > ghost[3].n_body + 100);
    ghost[3] = of_ghost;
    assert!((part(&with(0.25, ghost.clone())) - 1.0).abs() < 0.003);
    let name = &setup.calibration.cameras[3].name;
    check_remark(&remarks(&setup, settings(), ghost), &format!("{name}: the voxels cover"));
}

#[test]
fn what_a_third_of_the_views_lost_is_kept_where_most_others_ask_for_it() {
    let setup = setup();
    let whole = set(&setup, &[[0.1, 0.0]]);
    let with = |may_lose: f64, set: &[Silhouette]| {
        let settings = CarverSettings { may_lose, min_completeness: 0.0, voxel_mm: 20.0, ..settings() };
        carve(&setup, settings, set.to_vec())
    };
    let truth = with(0.0, &whole);
    for lost in [[0, 1], [1, 3], [2, 5], [0, 4]] {
        let mut set = whole.clone();
        lost.iter().for_each(|it| lose_top(&mut set[*it]));
        let [without, kept] = [0.0, 0.2].map(|it| with(it, &set).volume() / truth.volume());
        assert!(without < 0.75 && (0.85..1.05).contains(&kept), "{lost:?}: {without} {kept}");
    }
    // Of ghosts in five views, each at a place of its own, no third person is made.
    let mut ghosts = whole.clone();
    for (camera, at) in [[0.6, 0.6], [-0.6, 0.5], [0.5, -0.6], [-0.5, -0.5], [0.7, 0.0]].into_iter().enumerate() {
        ghosts[camera] = silhouette(&setup.calibration, camera, &[[0.1, 0.0], at]);
    }
    assert!((with(0.2, &ghosts).volume() / truth.volume() - 1.0).abs() < 0.02);
}

#[test]
fn what_half_of_the_views_show_elsewhere_is_contested_and_what_fits_or_one_view_shows_is_not() {
    let setup = setup();
    let settings = CarverSettings { min_completeness: 0.0, ..settings() };
    let contested = |changed: usize, people: &[[f64; 2]]| {
        let mut set = set(&setup, &[[0.1, 0.0]]);
        (0..changed).for_each(|it| set[2 * it] = silhouette(&setup.calibration, 2 * it, people));
        let voxels = carve(&setup, settings.clone(), set);
        let volume = voxels.contested.iter().map(|it| it.volume).sum::<f64>();
        (volume / voxels.volume(), voxels.contested.clone())
    };
    assert!(contested(0, &[]).1.is_empty());
    // Somebody outside of the volume whom one view shows, too.
    assert!(contested(1, &[[0.1, 0.0], [-0.9, 2.5]]).0 < 0.02);
    let (share, blocks) = contested(3, &[[0.1, 0.25]]);
    assert!(share > 0.2, "{share}");
    let is_there = |it: &Contested| (it.centroid - Point3::new(0.1, 0.12, it.centroid.z)).norm() < 0.5;
    assert!(blocks.iter().all(|it| is_there(it) && it.volume <= 0.0021), "{blocks:?}");
}

#[test]
fn one_silhouette_for_two_cameras_is_told() {
    let setup = setup();
    let mut twice = set(&setup, &[[0.1, 0.0]]);
    twice[4].confidence = twice[3].confidence.clone();
    twice[4].n_body = twice[3].n_body;
    let [a, b] = [3, 4].map(|it| setup.calibration.cameras[it].name.clone());
    check_remark(
        &remarks(&setup, settings(), twice),
        &format!("{a} and {b}: the same silhouette, byte for byte, in 1 of 1 sets"),
    );
    let apart = remarks(&setup, settings(), set(&setup, &[[0.1, 0.0]]));
    assert!(apart.is_empty(), "{apart:?}");
}

#[test]
fn views_that_lost_a_person_are_named() {
    let setup = setup();
    let mut few = set(&setup, &[[0.1, 0.0]]);
    for it in few.iter_mut().skip(3) {
        *it = silhouette(&setup.calibration, it.camera.0 as usize, &[]);
    }
    let said = remarks(&setup, settings(), few.clone());
    let names: Vec<String> = setup.calibration.cameras[3..].iter().map(|it| format!("{} in 1", it.name)).collect();
    check_remark(&said, &format!("most show none ({}): these have lost it", names.join(", ")));
    // What two see may be outside of the volume, and an empty scene needs no remark.
    few[2] = silhouette(&setup.calibration, 2, &[]);
    for set in [few, set(&setup, &[])] {
        let said = remarks(&setup, settings(), set);
        assert!(!said.iter().any(|it| it.contains("most show none")), "{said:?}");
    }
}

#[test]
fn pictures_that_are_mirrored_are_told_and_those_as_taken_are_not() {
    let setup = setup();
    // Beside the middle; and with a shadow that one camera alone sees, so that silhouettes as taken fit badly, too.
    for people in [&[[0.5, 0.3], [-0.4, 0.1]][..], &[[0.6, -0.2]], &[[0.1, 0.05], [0.6, 0.5]]] {
        let taken = set(&setup, people);
        let turned_over = |it: &Silhouette| Silhouette {
            confidence: it.confidence.chunks(it.width as usize).flat_map(|row| row.iter().rev().copied()).collect(),
            ..it.clone()
        };
        let mirrored: Vec<Silhouette> = taken.iter().map(turned_over).collect();
        let said = remarks(&setup, settings(), mirrored);
        check_remark(&said, "mirrored left to right, in 1 of 1 sets");
        assert!(!said.iter().any(|it| it.contains("contradicts")), "{said:?}");
        let mut spoilt = taken.clone();
        let width = spoilt[1].width as usize;
        for row in spoilt[1].confidence.chunks_mut(width).skip(80) {
            row[20..90].fill(255);
        }
        for set in [taken, spoilt] {
            let said = remarks(&setup, settings(), set);
            assert!(!said.iter().any(|it| it.contains("mirrored")), "{people:?}: {said:?}");
        }
    }
}

#[test]
fn views_that_come_one_by_one_carve_nothing_and_are_told_why() {
    let setup = setup();
    let mut bench = NodeBench::<Carver>::with_setup(settings(), &setup).unwrap();
    for (at, it) in set(&setup, &[[0.1, 0.0]]).into_iter().enumerate() {
        bench.feed_set(&SILHOUETTES, Time::from_s(1.0 + at as f64), vec![it]).unwrap();
    }
    let gaps = bench.gaps(&VOXELS);
    assert!(gaps.len() == N && gaps[0].reason.contains("one view alone bounds no body"), "{gaps:?}");
    check_remark(&bench.finish().unwrap().remarks, "numbering = \"order\"");
}

#[test]
fn a_volume_that_is_too_small_or_in_other_units_is_told_in_words() {
    let whole = setup();
    let half = Setup { volume_m: Some([[-1.0, -1.0, 0.0], [1.0, 1.0, 1.0]]), ..setup() };
    let said = remarks(&half, settings(), set(&whole, &[[0.1, 0.0]]));
    check_remark(&said, "reach an end of the volume: its greatest z in 1 of 1 sets");
    check_remark(&said, "the voxels cover 5");
    let floor = "silhouettes extend below the volume's floor, z = 0.700 m, in 1 of 1 sets";
    let without_feet = Setup { volume_m: Some([[-1.0, -1.0, 0.7], [1.0, 1.0, 2.0]]), ..setup() };
    check_remark(&remarks(&without_feet, settings(), set(&whole, &[[0.1, 0.0]])), floor);
    for least in [0.0, 0.38, 0.44] {
        let on_floor = Setup { volume_m: Some([[-1.0, -1.0, least], [1.0, 1.0, 2.0]]), ..setup() };
        let said = remarks(&on_floor, settings(), set(&whole, &[[0.1, 0.0]]));
        assert!(!said.iter().any(|it| it.contains("below the volume's floor")), "{least}: {said:#?}");
    }
    let mut in_mm = Calibration::clone(&whole.calibration);
    in_mm.cameras.iter_mut().for_each(|it| it.camera.camera_from_world.translation.vector *= 1e3);
    let in_mm = Setup { calibration: Arc::new(in_mm), ..setup() };
    check_remark(&remarks(&in_mm, settings(), set(&whole, &[[0.1, 0.0]])), "is the calibration in millimetres");
    let large = CarverSettings { min_component_l: Some(1000.0), ..settings() };
    check_remark(&remarks(&whole, large, set(&whole, &[[0.1, 0.0]])), "all pieces were left out in 1 of 1 sets");
    let coarse = CarverSettings { voxel_mm: 300.0, ..settings() };
    check_remark(&remarks(&whole, coarse, set(&whole, &[[0.1, 0.0]])), "voxels long");
}

#[test]
fn a_calibration_whose_z_is_not_up_and_pictures_that_cut_a_person_off_are_reported() {
    let whole = setup();
    assert!(remarks(&whole, settings(), set(&whole, &[[0.1, 0.0]])).is_empty());
    for (about, expected) in [
        (Vector3::x() * std::f64::consts::PI, "upright with -z up"),
        (Vector3::x() * std::f64::consts::FRAC_PI_2, "upright with y up"),
    ] {
        let mut turned = Calibration::clone(&whole.calibration);
        let turn = nalgebra::UnitQuaternion::from_scaled_axis(about);
        turned.cameras.iter_mut().for_each(|it| it.camera.camera_from_world.rotation *= turn);
        let turned = Setup { calibration: Arc::new(turned), ..setup() };
        check_remark(&remarks(&turned, settings(), set(&whole, &[[0.1, 0.0]])), expected);
    }
    // The camera's picture ends below the middle of the body.
    let mut cut = set(&whole, &[[0.1, 0.0]]);
    let rows = cut[2].confidence.iter().position(|it| *it > 0).unwrap() / 160 + 20;
    cut[2].height = rows as u32;
    cut[2].confidence.truncate(160 * rows);
    cut[2].n_body = cut[2].confidence.iter().filter(|it| **it > 0).count() as u32;
    let expected = "a person reaches the edge of the pictures of ring-3 in 1 of 1 sets";
    check_remark(&remarks(&whole, settings(), cut.clone()), expected);
    let some = CarverSettings { min_views: 2, ..settings() };
    assert!(!remarks(&whole, some, cut).iter().any(|it| it.contains("the edge of the pictures")));
}

#[test]
fn where_several_views_may_err_what_is_said_stays_with_the_voxels_after_views_were_tried() {
    let setup = setup();
    let mut set = set(&setup, &[[0.1, 0.0]]);
    // None of these three is to blame alone: all are tried, none is left out, in a grid of other voxels.
    for camera in [0, 2, 4] {
        set[camera] = silhouette(&setup.calibration, camera, &[[0.1, 0.0], [-0.6, 0.6]]);
    }
    let settings = CarverSettings { may_err: 1, min_views: 3, min_completeness: 1.0, ..settings() };
    let voxels = carve(&setup, settings, set);
    assert!(!voxels.is_empty() && voxels.iter().all(|it| it.seen >= 3 && it.dissent < it.seen));
}

#[test]
fn a_set_waits_for_the_poses_of_its_heads_and_one_without_is_carved_by_the_others() {
    let mut setup = setup();
    setup.connected = vec!["poses".to_owned()];
    let text = "[calibration]\nlength_unit = \"m\"\n[camera.ring-2]\nimage_size_px = [160, 120]\nfocal_px = [98.0, 98.0]\n\
                principal_point_px = [79.5, 59.5]\nposition_m = [0.0, 0.0, 1.5]\ncamera_from_world_wxyz = [0.7071067811865476, 0.7071067811865476, 0.0, 0.0]\n\
                [head.ring-2]\npan_axis = { point_m = [0.0, 0.0, 0.0], direction = [0.0, 1.0, 0.0] }\n\
                tilt_axis = { point_m = [0.0, 0.0, 0.0], direction = [1.0, 0.0, 0.0] }\n";
    let heads = Calibration::from_toml(text, std::path::Path::new("test")).unwrap().heads;
    let at_rest = setup.calibration.cameras[1].camera.camera_from_world;
    Arc::make_mut(&mut setup.calibration).heads = heads;
    let pose = |time: Time| HeadPose {
        camera: CameraId(1),
        time,
        angles: [0.0; 2],
        angles_covariance: nalgebra::Matrix2::identity() * 1e-6,
        rates: [0.0; 2],
        zoom: None,
        camera_from_world: at_rest,
        covariance: Matrix6::identity() * 1e-6,
        age: Interval(0),
    };
    let mut bench = NodeBench::<Carver>::with_setup(settings(), &setup).unwrap();
    let [one, two, three] = [1.0, 2.0, 3.0].map(Time::from_s);
    let statuses = |bench: &mut NodeBench<Carver>| -> Vec<ViewStatus> {
        bench.outputs(&VOXELS).iter().map(|it| it.value.views[1].status).collect()
    };
    bench.feed_set(&SILHOUETTES, one, set(&setup, &[[0.1, 0.0]])).unwrap();
    assert_eq!(statuses(&mut bench), []);
    bench.feed(&POSES, one, pose(one)).unwrap();
    assert_eq!(statuses(&mut bench), [ViewStatus::Used]);
    bench.feed_set(&SILHOUETTES, two, set(&setup, &[[0.1, 0.0]])).unwrap();
    bench.feed_set(&SILHOUETTES, three, set(&setup, &[[0.1, 0.0]])).unwrap();
    bench.feed(&POSES, three, pose(three)).unwrap();
    assert_eq!(statuses(&mut bench), [ViewStatus::Unplaced, ViewStatus::Used]);
}
