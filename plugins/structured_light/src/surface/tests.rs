//! Clouds of a known shape that is moved: big ones, and thin ones along stripes.

use std::sync::Arc;

use foveate::estimation::random::Random;
use foveate::geometry::surface::{MeshOptions, RegistrationOptions, SurfacePoint};
use foveate::messages::ScaleId;
use foveate::node::scale::{ScalePlace, ScaleTree};
use foveate::prelude::*;
use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, Vector3};

use super::model::{Model, ModelOptions, Piece, Refusal, motion};
use super::node::{CLOUD, JOINED, JoinedSurface, SPACES, SURFACE, SurfaceSettings};

const HALF: f64 = 0.06;
const SIGMA: f64 = 1e-4;

/// A face of a kind, 12 cm wide.
fn height(x: f64, y: f64) -> f64 {
    let bump = |x0: f64, y0: f64, wide: f64, high: f64| {
        high * (-((x - x0).powi(2) + (y - y0).powi(2)) / (2.0 * wide * wide)).exp()
    };
    -4.0 * x * x - 2.5 * y * y
        + bump(0.0, 0.005, 0.012, 0.02)
        + bump(0.03, 0.025, 0.015, 0.008)
        + bump(-0.02, -0.03, 0.02, 0.01)
}

fn normal(x: f64, y: f64) -> Vector3<f64> {
    let slope = |dx: f64, dy: f64| (height(x + dx, y + dy) - height(x - dx, y - dy)) / 2e-6;
    Vector3::new(-slope(1e-6, 0.0), -slope(0.0, 1e-6), 1.0).normalize()
}

fn point(x: f64, y: f64, is_flat: bool, has_normal: bool, random: &mut Random) -> SurfacePoint {
    let (z, normal) = if is_flat { (0.0, Vector3::z()) } else { (height(x, y), normal(x, y)) };
    SurfacePoint {
        position: Point3::new(x, y, z + SIGMA * random.normal()),
        covariance: Matrix3::from_diagonal(&Vector3::new(1e-10, 1e-10, SIGMA * SIGMA)),
        normal: if has_normal { normal } else { Vector3::zeros() },
    }
}

/// Every `spacing`.
fn full(spacing: f64, is_flat: bool, random: &mut Random) -> Vec<SurfacePoint> {
    let n = (2.0 * HALF / spacing) as i32;
    let at = |it: i32| -HALF + spacing * f64::from(it);
    (0..n * n)
        .map(|it| {
            let [dx, dy] = [0, 1].map(|_| spacing * random.uniform());
            point(at(it % n) + dx, at(it / n) + dy, is_flat, true, random)
        })
        .collect()
}

/// Along stripes 12 mm apart, the first at `phase` of that, without normals.
fn stripes(phase: f64, random: &mut Random) -> Vec<SurfacePoint> {
    let lines = (0..10).map(|it| -HALF + 0.012 * (f64::from(it) + phase));
    lines
        .flat_map(|x| (0..120).map(move |it| (x, -HALF + 0.001 * f64::from(it))))
        .map(|(x, y)| point(x, y, false, false, random))
        .collect()
}

fn options() -> ModelOptions {
    ModelOptions {
        voxel_m: 0.001,
        truncation: 4.0,
        start_sigmas: [0.005, 0.05],
        max_pose_sigma_m: 0.0,
        keep_s: 0.0,
        registration: Some(RegistrationOptions::default()),
        max_bytes: 200_000_000,
    }
}

fn piece(points: &[SurfacePoint], surface_from_cloud: &Isometry3<f64>) -> Piece {
    let back = surface_from_cloud.inverse();
    let turn = back.rotation.to_rotation_matrix().into_inner();
    let one = |it: &SurfacePoint| {
        let there = SurfacePoint {
            position: back * it.position,
            covariance: turn * it.covariance * turn.transpose(),
            normal: back.rotation * it.normal,
        };
        (there, [100; 3])
    };
    Piece { points: points.iter().map(one).collect(), viewpoint: back * Point3::new(0.0, 0.0, 3.0), time_s: 0.0 }
}

fn rms(model: &Model) -> (f64, usize) {
    let mesh = model.mesh(&MeshOptions { min_points: 0.5, min_triangles: 100 });
    let off = |it: &Point3<f64>| ((it.z - height(it.x, it.y)) * normal(it.x, it.y).z).powi(2);
    let sum: f64 = mesh.vertices.iter().map(|it| off(&it.position)).sum();
    ((sum / mesh.vertices.len() as f64).sqrt(), mesh.vertices.len())
}

#[test]
fn a_thing_that_moves_and_turns_is_one_surface_and_nothing_drifts() {
    let mut random = Random::new(4);
    let mut model = Model::new(options());
    let mut truth = Isometry3::identity();
    let mut worst = 0.0_f64;
    for number in 0..12 {
        let joined = model.join(piece(&full(0.0012, false, &mut random), &truth), &Matrix6::identity()).unwrap();
        assert_eq!(joined.registration.is_some(), number > 0);
        let off = joined.surface_from_cloud.inverse() * truth * Point3::origin();
        worst = worst.max(off.coords.norm());
        // Over a centimetre and 5° in the end.
        truth *= Isometry3::new(Vector3::new(0.002, 0.001, -0.001), Vector3::new(0.004, -0.003, 0.007));
    }
    let (rms, n) = rms(&model);
    assert!(worst < 4e-5, "{worst}");
    assert!(rms < 0.5 * SIGMA && n > 12_000, "{rms} {n}");
}

#[test]
fn clouds_of_sides_that_do_not_meet_are_one_surface_where_they_lie_as_they_are_said_to() {
    let mut random = Random::new(5);
    let sides: [Vec<SurfacePoint>; 2] = {
        let (left, right) = full(0.0006, false, &mut random).into_iter().partition(|it| it.position.x < 0.0);
        [left, right]
    };
    let joined = |registration: Option<RegistrationOptions>| {
        let mut model = Model::new(ModelOptions { registration, ..options() });
        let cloud = |it: &[SurfacePoint]| piece(it, &Isometry3::identity());
        let first = model.join(cloud(&sides[0]), &Matrix6::identity()).map(|_| ());
        let second = model.join(cloud(&sides[1]), &Matrix6::identity()).map(|it| it.surface_from_cloud);
        assert!(first.is_ok(), "{first:?}");
        (second, rms(&model))
    };
    let (refused, (_, half)) = joined(Some(RegistrationOptions::default()));
    assert!(refused.is_err());
    let (lies, (rms, whole)) = joined(None);
    assert_eq!(lies, Ok(Isometry3::identity()));
    assert!(rms < 1.1 * SIGMA && whole > 3 * half / 2, "{rms} {half} {whole}");
}

/// The face, with a bump 2 mm high on its cheek.
fn full_with_bump(random: &mut Random) -> Vec<SurfacePoint> {
    let mut points = full(0.0012, false, random);
    for point in &mut points {
        let off = (point.position.x + 0.025).hypot(point.position.y - 0.02) / 0.008;
        point.position.z += 2e-3 * (-off * off / 2.0).exp();
    }
    points
}

#[test]
fn what_changes_its_shape_is_as_it_is_now_where_clouds_count_for_a_while_only() {
    let bump_mm = |keep_s: f64| {
        let mut random = Random::new(8);
        let registration = RegistrationOptions { max_misfit: 50.0, ..RegistrationOptions::default() };
        let mut model = Model::new(ModelOptions { keep_s, registration: Some(registration), ..options() });
        for number in 0..20 {
            let points = if number < 10 { full(0.0012, false, &mut random) } else { full_with_bump(&mut random) };
            let piece = Piece { time_s: 0.1 * f64::from(number), ..piece(&points, &Isometry3::identity()) };
            model.join(piece, &Matrix6::zeros()).unwrap();
        }
        let mesh = model.mesh(&MeshOptions { min_points: 0.5, min_triangles: 100 });
        let top = mesh.vertices.iter().filter(|it| (it.position.x + 0.025).hypot(it.position.y - 0.02) < 0.002);
        let heights: Vec<f64> = top.map(|it| 1e3 * (it.position.z - height(it.position.x, it.position.y))).collect();
        (heights.iter().sum::<f64>() / heights.len() as f64, heights.len())
    };
    // Where each counts for good, clouds with the bump and without contradict each other, and its top is left out.
    let ((_, n_mean), (now, _)) = (bump_mm(0.0), bump_mm(0.2));
    assert!(n_mean == 0 && (1.7..2.1).contains(&now), "{n_mean} {now}");
}

#[test]
fn what_does_not_fit_changes_nothing() {
    let mut random = Random::new(5);
    let mut model = Model::new(options());
    let still = Isometry3::identity();
    let prior = Matrix6::zeros();
    model.join(piece(&full(0.001, false, &mut random), &still), &prior).unwrap();
    let before = model.mesh(&MeshOptions { min_points: 0.5, min_triangles: 1 });
    let flat = model.join(piece(&full(0.001, true, &mut random), &still), &prior);
    assert!(matches!(flat, Err(Refusal::Unregistered(_))), "{flat:?}");
    let far = model.join(piece(&full(0.001, false, &mut random), &Isometry3::translation(0.2, 0.0, 0.0)), &prior);
    assert!(matches!(far, Err(Refusal::Unregistered(_))), "{far:?}");
    let few = model.join(piece(&full(0.02, false, &mut random), &still), &prior);
    assert!(few.unwrap_err().to_string().contains("36 points, expected at least 60"));
    assert_eq!(model.mesh(&MeshOptions { min_points: 0.5, min_triangles: 1 }), before);
    assert_eq!(model.n_pieces(), 1);
}

#[test]
fn planes_are_not_held_and_memory_is_bounded() {
    let mut random = Random::new(6);
    let mut model = Model::new(options());
    let still = Isometry3::identity();
    model.join(piece(&full(0.001, true, &mut random), &still), &Matrix6::zeros()).unwrap();
    let inner: Vec<SurfacePoint> =
        full(0.001, true, &mut random).into_iter().filter(|it| it.position.coords.xy().amax() < 0.04).collect();
    match model.join(piece(&inner, &still), &Matrix6::zeros()) {
        Err(Refusal::NotHeld { n_open: 3, sigma_m, .. }) => assert!((3e-3..2e-2).contains(&sigma_m), "{sigma_m}"),
        other => panic!("{other:?}"),
    }
    let mut small = Model::new(ModelOptions { max_bytes: 1_000_000, ..options() });
    let joined = small.join(piece(&full(0.001, false, &mut random), &still), &Matrix6::zeros()).unwrap();
    assert!(
        joined.n_beyond_memory > 1000 && small.bytes() <= 1_000_000,
        "{} {}",
        joined.n_beyond_memory,
        small.bytes()
    );
}

#[test]
fn what_all_points_of_a_cloud_share_is_no_noise() {
    let mut random = Random::new(8);
    let mut model = Model::new(options());
    let (mut normalised, n) = (0.0, 10);
    for number in 0..=n {
        let truth = Isometry3::translation(0.0, 2e-4 * random.normal(), 5e-4 * random.normal());
        let mut cloud = piece(&full(0.001, false, &mut random), &truth);
        cloud.points.iter_mut().for_each(|it| it.0.covariance += Matrix3::identity() * 1e-6);
        let joined = model.join(cloud, &Matrix6::zeros()).unwrap();
        if number > 0 {
            let off = truth.inverse() * joined.surface_from_cloud;
            let (turn, shift) = (off.rotation.scaled_axis(), off.translation.vector);
            let error = nalgebra::Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z);
            normalised += error.dot(&(joined.covariance.try_inverse().unwrap() * error)) / 6.0 / f64::from(n);
        } else {
            // All others are held against where the first one lay.
            model.clear();
            model.join(piece(&full(0.001, false, &mut random), &Isometry3::identity()), &Matrix6::zeros()).unwrap();
        }
    }
    assert!((0.3..3.0).contains(&normalised), "{normalised}");
    let mesh = model.mesh(&MeshOptions { min_points: 0.5, min_triangles: 100 });
    let sigma = mesh.vertices.iter().map(|it| it.sigma).sum::<f64>() / mesh.vertices.len() as f64;
    assert!((5e-6..3e-5).contains(&sigma), "{sigma}");
}

#[test]
fn where_older_clouds_fade_errors_of_poses_add_up_and_covariances_with_them() {
    let (mut normalised, n) = (0.0, 10);
    for seed in 0..n {
        let mut random = Random::new(seed);
        // Of each cloud, the next one finds hardly more than itself.
        let mut model = Model::new(ModelOptions { keep_s: 0.2, ..options() });
        for number in 0..9 {
            let mut cloud = piece(&full(0.0015, false, &mut random), &Isometry3::identity());
            cloud.time_s = f64::from(number);
            let joined = model.join(cloud, &Matrix6::zeros()).unwrap();
            if number == 8 {
                let off = joined.surface_from_cloud;
                let (turn, shift) = (off.rotation.scaled_axis(), off.translation.vector);
                let error = nalgebra::Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z);
                normalised += error.dot(&(joined.covariance.try_inverse().unwrap() * error)) / 6.0 / n as f64;
            }
        }
    }
    assert!((0.4..2.0).contains(&normalised), "{normalised}");
}

#[test]
fn what_a_cloud_shares_is_in_the_covariance_of_the_surfaces_place_and_in_no_vertex() {
    let mut random = Random::new(9);
    let mut model = Model::new(options());
    let mut cloud = piece(&full(0.001, false, &mut random), &Isometry3::identity());
    let shared = Matrix3::from_diagonal(&Vector3::new(1e-6, 4e-6, 9e-6));
    cloud.points.iter_mut().for_each(|it| it.0.covariance += shared);
    let joined = model.join(cloud, &Matrix6::zeros()).unwrap();
    assert!((joined.shared - shared).amax() < 3e-7, "{}", joined.shared);
    let mut alone = Model::new(options());
    let joined =
        alone.join(piece(&full(0.001, false, &mut random), &Isometry3::identity()), &Matrix6::zeros()).unwrap();
    assert!(joined.shared.amax() < 1e-8 && joined.sigma == 0.0, "{joined:?}");
}

#[test]
fn the_points_motion_by_a_covariance_is_the_mean_over_the_points() {
    let mut random = Random::new(10);
    let points: Vec<Point3<f64>> =
        (0..50).map(|_| Point3::from(Vector3::from_fn(|_, _| 0.3 + random.normal()))).collect();
    let root = Matrix6::from_fn(|_, _| random.normal());
    let covariance = root * root.transpose();
    let one = |it: &Point3<f64>| {
        let mut by = nalgebra::Matrix3x6::zeros();
        by.fixed_view_mut::<3, 3>(0, 0).copy_from(&-it.coords.cross_matrix());
        by.fixed_view_mut::<3, 3>(0, 3).copy_from(&Matrix3::identity());
        (by * covariance * by.transpose()).trace()
    };
    let expected = (points.iter().map(one).sum::<f64>() / points.len() as f64).sqrt();
    assert!((motion(&covariance, points.iter().copied()) - expected).abs() < 1e-9 * expected);
}

#[test]
fn the_voxel_follows_from_the_distance_of_points() {
    let mut random = Random::new(6);
    let mut model = Model::new(ModelOptions { voxel_m: 0.0, ..options() });
    model.join(piece(&full(0.002, false, &mut random), &Isometry3::identity()), &Matrix6::zeros()).unwrap();
    assert!((0.0015..0.004).contains(&model.voxel_m()), "{}", model.voxel_m());
}

/// A scale on a target, in a room.
fn setup() -> Setup {
    let place = |name: &str, parent: Option<ScaleId>| ScalePlace {
        name: name.to_owned(),
        parent,
        is_anchored: parent.is_some(),
    };
    let scales =
        ScaleTree { own: ScaleId(1), places: Arc::new([place("room", None), place("close", Some(ScaleId(0)))]) };
    Setup { scales, connected: vec!["cloud".to_owned(), "spaces".to_owned()], ..Setup::for_tests() }
}

/// Where the target of the tests below is at a time, moved at 10 cm/s and turned at 3 °/s; the tracker knows nothing of the turn.
fn world_from_thing(time_s: f64) -> Isometry3<f64> {
    Isometry3::new(Vector3::new(0.1 * time_s, 1.0, 1.5), Vector3::new(0.0, 0.05 * time_s, 0.0))
}

fn space(time: Time, random: &mut Random) -> ScaleSpace {
    let noise = Vector3::from_fn(|_, _| 3e-4 * random.normal());
    ScaleSpace {
        scale: ScaleId(1),
        time,
        target: Some(TargetId(1)),
        parent_from_scale: Isometry3::from_parts(
            (world_from_thing(time.as_s()).translation.vector + noise).into(),
            Default::default(),
        ),
        covariance: Matrix6::identity() * 1e-7,
        velocity: Vector3::new(0.1, 0.0, 0.0),
        motion_covariance: Matrix6::identity() * 1e-7,
    }
}

fn cloud(points: &[SurfacePoint], time: Time) -> PointCloud {
    let world_from_thing = world_from_thing(time.as_s());
    let turn = world_from_thing.rotation.to_rotation_matrix().into_inner();
    let viewpoint = Viewpoint { camera_from_space: Isometry3::translation(0.0, 0.0, -4.0) };
    let mut cloud = PointCloud { time, name: "set".to_owned(), viewpoint: Some(viewpoint), ..PointCloud::default() };
    for it in points {
        cloud.push(&CloudPoint {
            position: (world_from_thing * it.position).cast(),
            covariance: (turn * it.covariance * turn.transpose()).cast(),
            normal: (world_from_thing.rotation * it.normal).cast(),
            confidence: 1.0,
            pixel: [0, 0],
            colour: [50; 3],
        });
    }
    cloud
}

/// Runs the node over clouds at a rate; the last surface, and how far the poses of the last joined cloud and of the first are from each other, over the truth [m].
fn run(
    rate_hz: f64,
    n: usize,
    settings: SurfaceSettings,
    mut points: impl FnMut(usize, &mut Random) -> Vec<SurfacePoint>,
) -> (Arc<Mesh>, f64, Report) {
    let mut random = Random::new(9);
    let mut bench = NodeBench::<JoinedSurface>::with_setup(settings, &setup()).unwrap();
    for number in 0..n {
        let time = Time::from_s(number as f64 / rate_hz);
        bench.feed(&SPACES, time, space(time, &mut random)).unwrap();
        let points = points(number, &mut random);
        bench.feed(&CLOUD, time, cloud(&points, time)).unwrap();
    }
    let joined = bench.outputs(&JOINED);
    let thing_from_joined = |it: &ScaleCloud| world_from_thing(it.cloud.time.as_s()).inverse() * it.world_from_scale;
    let [first, last] = [joined.first(), joined.last()].map(|it| thing_from_joined(&it.unwrap().value));
    let off = (first.inverse() * last * Point3::origin()).coords.norm();
    let surfaces = bench.outputs(&SURFACE);
    (Arc::clone(&surfaces.last().unwrap().value), off, bench.finish().unwrap())
}

#[test]
fn few_big_clouds_of_a_target_that_turns_are_joined_in_its_space() {
    let (mesh, off, report) = run(2.0, 6, SurfaceSettings::default(), |_, random| full(0.001, false, random));
    assert_eq!((report.figures["surface.clouds"], report.figures["surface.clouds_refused"]), (6.0, 0.0));
    assert!(off < 5e-5, "{off}");
    assert!(mesh.vertices().len() > 3000 && mesh.n_clouds == 6, "{}", mesh.vertices().len());
    // Where the thing was when the last cloud was taken: its nose is there in the world.
    let nose = world_from_thing(mesh.time.as_s()) * Point3::new(0.0, 0.005, height(0.0, 0.005));
    let nearest = mesh.vertices().map(|it| (mesh.world_from_mesh * it.position.cast::<f64>() - nose).norm());
    assert!(nearest.fold(f64::INFINITY, f64::min) < 2e-3);
}

#[test]
fn many_thin_clouds_along_stripes_become_the_same_surface() {
    let settings = SurfaceSettings { voxel_mm: 1.5, gather_points: 20_000, ..SurfaceSettings::default() };
    let (mesh, off, report) = run(60.0, 120, settings, |number, random| stripes(0.37 * number as f64 % 1.0, random));
    assert!(report.figures["surface.clouds"] >= 100.0, "{:?}", report.figures);
    // Within a group clouds lie as the track has them: 0.3 mm an axis, for the first and for the last. Registered are groups.
    assert!(off < 2e-3, "{off}");
    let cells = (2.0 * HALF / 0.0015).powi(2);
    assert!(mesh.vertices().len() as f64 > 0.8 * cells, "{} of {cells}", mesh.vertices().len());
}

#[test]
fn a_surface_that_grows_is_sent_before_its_interval_is_over() {
    let settings = SurfaceSettings { voxel_mm: 1.5, gather_points: 20_000, ..SurfaceSettings::default() };
    // Three groups of seven clouds, in less time than `interval_ms`.
    let (mesh, _, report) = run(60.0, 24, settings, |number, random| stripes(0.37 * number as f64 % 1.0, random));
    assert_eq!(report.figures["surface.clouds"], 21.0);
    assert!(mesh.n_clouds >= 14 && mesh.triangles().count() > 3000, "{} {}", mesh.n_clouds, mesh.triangles().count());
}

#[test]
fn a_cloud_that_fits_far_worse_than_the_others_is_named() {
    let said = |n: usize, wrong: usize, worse: f64| {
        let (_, _, report) = run(2.0, n, SurfaceSettings::default(), |number, random| {
            let mut points = full(0.001, false, random);
            let by = if number == wrong { worse * SIGMA } else { 0.0 };
            points.iter_mut().for_each(|it| it.position.z += by * random.normal());
            points
        });
        assert_eq!(report.figures["surface.clouds"], n as f64, "{:?}", report.figures);
        report.remarks
    };
    assert_eq!(said(6, 9, 0.0), Vec::<String>::new());
    // Six to seven times as rough as it states.
    let remarks = said(6, 4, 6.5);
    assert_eq!(remarks.len(), 1, "{remarks:?}");
    assert!(remarks[0].starts_with("set at 2.000 s "), "{remarks:?}");
    assert!(remarks[0].contains("`max_misfit` below"), "{remarks:?}");
}

/// Clouds that are not registered, the first where it is said to be, the others beside that by `off`: the report, and of the vertices the mean error, the mean sigma and how many there are [m].
fn lying(n: usize, off: impl Fn(usize) -> Isometry3<f64>) -> (Report, [f64; 2], usize) {
    let mut random = Random::new(12);
    let settings = SurfaceSettings { voxel_mm: 1.0, register: false, ..SurfaceSettings::default() };
    let mut bench = NodeBench::<JoinedSurface>::with_setup(settings, &Setup::for_tests()).unwrap();
    let here = world_from_thing(0.0);
    for number in 0..n {
        let wrong = here * off(number) * here.inverse();
        let turn = wrong.rotation.to_rotation_matrix().into_inner().cast::<f32>();
        let right = cloud(&full(0.0006, false, &mut random), Time::ZERO);
        let mut there = PointCloud { name: format!("set_{number}"), points: Vec::new(), ..right.clone() };
        for it in right.iter() {
            there.push(&CloudPoint {
                position: (wrong * it.position.cast::<f64>()).cast(),
                covariance: turn * it.covariance * turn.transpose(),
                normal: turn * it.normal,
                ..it
            });
        }
        bench.feed(&CLOUD, Time::ZERO, there).unwrap();
    }
    let mesh = Arc::clone(&bench.outputs(&SURFACE).last().unwrap().value);
    let errors = mesh.vertices().map(|it| {
        let at = here.inverse() * it.position.cast::<f64>();
        ((at.z - height(at.x, at.y)) * normal(at.x, at.y).z).abs()
    });
    let n_vertices = mesh.vertices().len();
    let mean = errors.sum::<f64>() / n_vertices as f64;
    (bench.finish().unwrap(), [mean, mesh.mean_sigma], n_vertices)
}

#[test]
fn clouds_that_lie_beside_each_other_are_told_and_vertices_are_no_surer_than_that() {
    let moved = |it: usize, mm: f64| {
        let sign = if it.is_multiple_of(2) { 0.0 } else { 1e-3 * mm };
        Isometry3::new(Vector3::new(0.5 * sign, 0.0, sign), Vector3::new(0.0, 2.0 * sign, 0.0))
    };
    let (report, [error, sigma], n) = lying(4, |it| moved(it, 0.0));
    assert_eq!(report.remarks, Vec::<String>::new());
    assert!(report.figures["surface.apart_sigmas"] < 1.5, "{:?}", report.figures);
    assert!(error < 5e-5 && sigma < 5e-5 && n > 10_000, "{error} {sigma} {n}");
    // Layers 6 mm apart do not meet: each is thin, and was as sure as the one that is right.
    let (report, [error, sigma], _) = lying(4, |it| moved(it, 6.0));
    let said = report.remarks.iter().find(|it| it.contains("of the 3 clouds")).unwrap();
    assert!(said.starts_with("1 of the 3") && said.contains("`register = true`"), "{said}");
    assert!(report.figures["surface.apart_mm"] < 1.0, "{:?}", report.figures);
    assert!((0.3..3.0).contains(&(sigma / error)), "{sigma} {error}");
    // One after the other farther away: most contradict those before them.
    let away = |it: usize| Isometry3::translation(0.0, 0.0, 6e-3 * it as f64);
    let (report, [error, sigma], _) = lying(3, away);
    assert!((4.0..6.5).contains(&report.figures["surface.apart_mm"]), "{:?}", report.figures);
    assert!(report.remarks[0].starts_with("2 of the 2") && report.remarks[0].contains("set_"), "{:?}", report.remarks);
    assert!((0.3..3.0).contains(&(sigma / error)), "{sigma} {error}");
}

#[test]
fn each_moment_has_a_surface_of_its_own_of_all_its_clouds() {
    let settings = SurfaceSettings { voxel_mm: 1.0, register: false, each_moment: true, ..SurfaceSettings::default() };
    let mut bench = NodeBench::<JoinedSurface>::with_setup(settings, &Setup::for_tests()).unwrap();
    let all = full(0.0006, false, &mut Random::new(6));
    let (left, right): (Vec<_>, Vec<_>) = all.into_iter().partition(|it| it.position.x < 0.0);
    for (s, half) in [(0.0, &left), (0.0, &right), (0.01, &right)] {
        let time = Time::from_s(s);
        bench.feed(&CLOUD, time, cloud(half, time)).unwrap();
    }
    let meshes = bench.outputs(&SURFACE);
    let reach = |mesh: &Mesh| {
        let x = || mesh.vertices().map(|it| it.position.x);
        (mesh.time.as_s(), x().fold(f32::INFINITY, f32::min) < -0.05, x().fold(0.0, f32::max) > 0.05)
    };
    let reaches: Vec<_> = meshes.iter().map(|it| reach(&it.value)).collect();
    assert_eq!(reaches, [(0.0, true, false), (0.0, true, true), (0.01, false, true)]);
}

/// A shape of its own for each number, in the space of `setup`.
fn unlike(number: usize, random: &mut Random) -> Vec<SurfacePoint> {
    let mut points = full(0.001, false, random);
    let wave = 40.0 * (1.0 + number as f64);
    for it in &mut points {
        it.position.z += 0.003 * (wave * it.position.x).sin() * (wave * it.position.y).cos();
        // The node finds it among neighbours.
        it.normal = Vector3::zeros();
    }
    points
}

#[test]
fn a_surface_that_is_begun_anew_says_without_what_and_counts_what_it_holds() {
    // The first fits none of the next four; the sixth and the seventh are of one shape.
    let shape = |number: usize, random: &mut Random| unlike(number.min(5), random);
    let (mesh, _, report) = run(2.0, 7, SurfaceSettings::default(), shape);
    let figure = |name: &str| report.figures[name];
    assert_eq!(["surface.clouds", "surface.clouds_refused", "surface.restarts"].map(figure), [2.0, 5.0, 1.0]);
    assert!(mesh.n_clouds == 2 && figure("surface.points") < 3e4, "{} {}", mesh.n_clouds, figure("surface.points"));
    let said: Vec<&String> = report.remarks.iter().filter(|it| it.contains("restarted once")).collect();
    assert_eq!(said.len(), 1, "{:?}", report.remarks);
    for words in ["Not in it: set at 0.000 s; ", "it holds set at 2.500 s to set at 3.000 s (2 clouds)"] {
        assert!(said[0].contains(words), "{words}: {}", said[0]);
    }
    // Without a cloud after those that did not fit, the surface that was sent is the one that counts.
    let (mesh, _, report) = run(2.0, 5, SurfaceSettings::default(), shape);
    assert_eq!((mesh.n_clouds, report.figures["surface.clouds"], report.remarks.len()), (1, 1.0, 0));
}

#[test]
fn a_cloud_without_a_place_for_the_target_is_refused_with_a_remark() {
    let mut bench = NodeBench::<JoinedSurface>::with_setup(SurfaceSettings::default(), &setup()).unwrap();
    bench.feed(&CLOUD, Time::ZERO, cloud(&full(0.002, false, &mut Random::new(1)), Time::ZERO)).unwrap();
    assert!(bench.outputs(&JOINED).is_empty());
    let gaps = bench.gaps(&JOINED);
    assert!(gaps[0].reason.contains("target's place"), "{gaps:?}");
    let loose = Setup { connected: vec!["cloud".to_owned()], ..setup() };
    let refused = JoinedSurface::new(SurfaceSettings::default(), &loose).err().unwrap();
    assert!(refused.message.contains("expected `anchor.space`"), "{}", refused.message);
}

#[test]
fn node_keeps_its_promises() {
    foveate_testkit::check_node::<JoinedSurface>("voxel_mm = 2.0\ngather_ms = 50");
}
