//! Clouds of known shapes at known poses: registered, fused, cut into triangles.

use foveate_estimation::random::Random;
use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, Vector3, Vector6};

use super::*;
use crate::camera::Camera;

/// Half the width of what is scanned [m].
const HALF: f64 = 0.08;
const SIGMA: f64 = 1e-4;

/// Surfaces above the plane z = 0, 16 cm wide.
#[derive(Clone, Copy, PartialEq)]
enum Shape {
    /// A bent surface with a nose, a brow and two cheeks of different heights.
    Face,
    Plane,
    /// Of 12 cm about (0, 0, −6 cm).
    Sphere,
    /// A rod along x of 12 cm.
    Cylinder,
}

impl Shape {
    fn height(self, x: f64, y: f64) -> f64 {
        let bump = |x0: f64, y0: f64, wide: f64, high: f64| {
            high * (-((x - x0).powi(2) + (y - y0).powi(2)) / (2.0 * wide * wide)).exp()
        };
        match self {
            Shape::Face => {
                let bumps =
                    bump(0.0, 0.005, 0.012, 0.025) + bump(0.035, 0.03, 0.02, 0.008) + bump(-0.03, 0.035, 0.018, 0.012);
                -4.0 * x * x - 2.5 * y * y + bumps + bump(0.01, -0.05, 0.02, 0.01)
            }
            Shape::Plane => 0.0,
            Shape::Sphere => (0.0144 - x * x - y * y).max(0.0).sqrt() - 0.06,
            Shape::Cylinder => (0.0144 - y * y).max(0.0).sqrt() - 0.06,
        }
    }

    fn normal(self, x: f64, y: f64) -> Vector3<f64> {
        let step = 1e-6;
        let slope = |dx: f64, dy: f64| (self.height(x + dx, y + dy) - self.height(x - dx, y - dy)) / (2.0 * step);
        Vector3::new(-slope(step, 0.0), -slope(0.0, step), 1.0).normalize()
    }

    /// Points between `from` and `to` along x, `spacing` apart, with noise along z and normals that are off by 5° or so.
    fn scan(self, [from, to]: [f64; 2], spacing: f64, sigma: f64, random: &mut Random) -> Vec<SurfacePoint> {
        let n = (2.0 * HALF / spacing) as usize;
        let mut points = Vec::new();
        for (row, column) in (0..n).flat_map(|row| (0..n).map(move |column| (row, column))) {
            let [x, y] = [column, row].map(|it| -HALF + spacing * (it as f64 + random.uniform()));
            if !(from..to).contains(&x) {
                continue;
            }
            let z = self.height(x, y) + sigma * random.normal();
            let off = Vector3::from_fn(|_, _| 0.08 * random.normal());
            points.push(SurfacePoint {
                position: Point3::new(x, y, z),
                covariance: Matrix3::from_diagonal(&Vector3::new(1e-12, 1e-12, sigma * sigma)),
                normal: (self.normal(x, y) + off).normalize(),
            });
        }
        points
    }
}

/// The same cloud as seen from a space that `surface_from_cloud` leads out of.
fn moved(points: &[SurfacePoint], surface_from_cloud: &Isometry3<f64>) -> Vec<SurfacePoint> {
    let back = surface_from_cloud.inverse();
    let turn = back.rotation.to_rotation_matrix().into_inner();
    let one = |it: &SurfacePoint| SurfacePoint {
        position: back * it.position,
        covariance: turn * it.covariance * turn.transpose(),
        normal: back.rotation * it.normal,
    };
    points.iter().map(one).collect()
}

fn patches(points: &[SurfacePoint]) -> Patches {
    let mut patches = Patches::new(0.002, 6, 1_000_000);
    assert!(points.iter().all(|it| patches.add(it)));
    patches
}

fn pose(random: &mut Random, shift: f64, turn: f64) -> Isometry3<f64> {
    let mut any = |size: f64| Vector3::from_fn(|_, _| size * random.normal());
    Isometry3::new(any(shift), any(turn))
}

/// Of a start that is off by so much [m, rad].
fn covariance(shift: f64, turn: f64) -> Matrix6<f64> {
    let (shift, turn) = (shift * shift, turn * turn);
    Matrix6::from_diagonal(&Vector6::new(turn, turn, turn, shift, shift, shift))
}

/// δ with `found` = `truth` exp(δ).
fn error(found: &Isometry3<f64>, truth: &Isometry3<f64>) -> Vector6<f64> {
    let off = truth.inverse() * found;
    let (turn, shift) = (off.rotation.scaled_axis(), off.translation.vector);
    Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z)
}

/// Errors of registrations over seeds, over what was stated, and in metres at the points.
fn over_seeds(n: u64, run: impl Fn(&mut Random) -> (Registration, Isometry3<f64>)) -> (f64, f64) {
    let (mut sum, mut worst) = (0.0, 0.0_f64);
    for seed in 0..n {
        let (found, truth) = run(&mut Random::new(seed));
        let error = error(&found.surface_from_cloud, &truth);
        sum += error.dot(&(found.covariance.try_inverse().unwrap() * error)) / 6.0;
        let off = |it: &Point3<f64>| (truth * it - found.surface_from_cloud * it).norm();
        worst = [[-HALF, 0.0, 0.0], [0.0, HALF, 0.0]].iter().map(|it| off(&Point3::from(*it))).fold(worst, f64::max);
    }
    (sum / n as f64, worst)
}

#[test]
fn a_cloud_that_overlaps_in_part_comes_to_lie_with_errors_as_large_as_stated() {
    let (normalised, worst) = over_seeds(30, |random| {
        let model = patches(&Shape::Face.scan([-HALF, 0.04], 0.001, SIGMA, random));
        let truth = pose(random, 0.01, 0.05);
        let cloud = moved(&Shape::Face.scan([-0.04, HALF], 0.0015, SIGMA, random), &truth);
        let start = truth * pose(random, 0.005, 0.03);
        let found =
            register(&cloud, &model, &start, &covariance(0.005, 0.03), &RegistrationOptions::default()).unwrap();
        assert!(found.not_held.is_empty() && found.overlap > 0.55, "{found:?}");
        (found, truth)
    });
    assert!((0.6..1.6).contains(&normalised), "{normalised}");
    assert!(worst < 1e-4, "{worst}");
}

#[test]
fn outliers_and_a_sigma_that_is_wrong_by_a_factor_do_not_mislead() {
    let (normalised, worst) = over_seeds(20, |random| {
        let model = patches(&Shape::Face.scan([-HALF, HALF], 0.001, SIGMA, random));
        let truth = pose(random, 0.01, 0.05);
        let mut cloud = moved(&Shape::Face.scan([-HALF, HALF], 0.002, SIGMA, random), &truth);
        for point in cloud.iter_mut().step_by(5) {
            point.position += Vector3::from_fn(|_, _| random.uniform_in(-0.02, 0.02));
        }
        cloud.iter_mut().for_each(|it| it.covariance *= 0.25);
        let start = truth * pose(random, 0.005, 0.03);
        let found =
            register(&cloud, &model, &start, &covariance(0.005, 0.03), &RegistrationOptions::default()).unwrap();
        assert!(found.misfit > 1.3, "{}", found.misfit);
        (found, truth)
    });
    assert!((0.6..1.7).contains(&normalised), "{normalised}");
    assert!(worst < 1.5e-4, "{worst}");
}

#[test]
fn errors_that_neighbours_share_are_in_the_covariance_of_the_pose() {
    for (wide, long) in [(0.009, 0.009), (0.004, 0.05)] {
        let (normalised, _) = over_seeds(30, |random| {
            let model = patches(&Shape::Face.scan([-HALF, HALF], 0.001, SIGMA, random));
            let truth = pose(random, 0.01, 0.05);
            let mut cloud = Shape::Face.scan([-HALF, HALF], 0.0015, SIGMA, random);
            let (n, m) = ((2.0 * HALF / wide) as usize + 2, (2.0 * HALF / long) as usize + 2);
            let [x, y] = [random.uniform(), random.uniform()];
            let shared: Vec<f64> = (0..n * m).map(|_| 2.0 * SIGMA * random.normal()).collect();
            for it in &mut cloud {
                let column = ((it.position.x + HALF) / wide + x) as usize;
                let row = ((it.position.y + HALF) / long + y) as usize;
                it.position.z += shared[row * n + column];
            }
            let start = truth * pose(random, 0.005, 0.03);
            let cloud = moved(&cloud, &truth);
            let prior = covariance(0.005, 0.03);
            let found = register(&cloud, &model, &start, &prior, &RegistrationOptions::default()).unwrap();
            (found, truth)
        });
        assert!((0.5..3.0).contains(&normalised), "cells of {wide} m x {long} m: {normalised}");
    }
}

#[test]
fn wrong_starts_of_centimetres_and_degrees_are_put_right_or_refused_and_never_believed() {
    let mut n_found = 0;
    for seed in 0..40 {
        let mut random = Random::new(seed);
        let model = patches(&Shape::Face.scan([-HALF, HALF], 0.001, SIGMA, &mut random));
        let truth = pose(&mut random, 0.05, 0.1);
        let cloud = moved(&Shape::Face.scan([-HALF, HALF], 0.002, SIGMA, &mut random), &truth);
        let [shift, turn] = if seed < 20 { [0.01, 0.07] } else { [0.05, 0.5] };
        let start = truth * pose(&mut random, shift, turn);
        let found = register(&cloud, &model, &start, &covariance(shift, turn), &RegistrationOptions::default());
        let off = found.as_ref().map(|it| (it.surface_from_cloud * Point3::origin() - truth * Point3::origin()).norm());
        assert!(off.as_ref().map_or(true, |it| *it < 1e-4), "{seed}: {off:?} {found:?}");
        n_found += usize::from(off.is_ok() && seed < 20);
    }
    assert!(n_found >= 18, "{n_found} of 20");
}

#[test]
fn planes_spheres_and_cylinders_are_said_to_slide_and_stay_at_the_start_where_they_do() {
    for (shape, n_open) in [(Shape::Plane, 3), (Shape::Sphere, 3), (Shape::Cylinder, 2), (Shape::Face, 0)] {
        let mut random = Random::new(7);
        let model = patches(&shape.scan([-HALF, HALF], 0.001, SIGMA, &mut random));
        let truth = Isometry3::identity();
        // Inside of the edges, which would hold it.
        let within = |it: &SurfacePoint| it.position.coords.amax() < 0.06;
        let cloud: Vec<SurfacePoint> =
            shape.scan([-HALF, HALF], 0.002, SIGMA, &mut random).into_iter().filter(within).collect();
        let start = truth * Isometry3::new(Vector3::new(0.002, -0.001, 0.003), Vector3::new(0.01, -0.01, 0.02));
        let prior = covariance(0.003, 0.02);
        let found = register(&cloud, &model, &start, &prior, &RegistrationOptions::default()).unwrap();
        assert_eq!(found.not_held.len(), n_open, "hold {}", found.hold);
        let off = error(&found.surface_from_cloud, &truth);
        // Off the surface nothing is open, wherever along it the cloud came to lie.
        let above = |it: &SurfacePoint| {
            let place = found.surface_from_cloud * it.position;
            (place.z - shape.height(place.x, place.y)) * shape.normal(place.x, place.y).z
        };
        let mean = cloud.iter().map(above).sum::<f64>() / cloud.len() as f64;
        assert!(mean.abs() < 1e-5, "{mean}");
        if shape == Shape::Plane {
            assert!(off[5].abs() < 1e-4 && off[0].abs() < 1e-3 && off[1].abs() < 1e-3, "{off}");
            assert!((off[3] - 0.002).abs() < 2e-4 && (off[2] - 0.02).abs() < 2e-3, "{off}");
            assert!((found.covariance[(3, 3)].sqrt() - 0.003).abs() < 3e-4, "{}", found.covariance);
        }
    }
}

#[test]
fn too_few_points_clouds_elsewhere_and_other_shapes_are_refused() {
    let mut random = Random::new(3);
    let model = patches(&Shape::Face.scan([-HALF, HALF], 0.001, SIGMA, &mut random));
    let cloud = Shape::Face.scan([-HALF, HALF], 0.002, SIGMA, &mut random);
    let options = RegistrationOptions::default();
    let prior = covariance(0.003, 0.02);
    let start = Isometry3::identity();
    let few = register(&cloud[..40], &model, &start, &prior, &options);
    assert_eq!(few, Err(RegistrationError::TooFewPoints { count: 40, expected: 60 }));
    let elsewhere = register(&cloud, &model, &Isometry3::translation(0.3, 0.0, 0.0), &prior, &options);
    assert!(matches!(elsewhere, Err(RegistrationError::NoOverlap { .. })), "{elsewhere:?}");
    let other = Shape::Sphere.scan([-HALF, HALF], 0.002, SIGMA, &mut random);
    let other = register(&other, &model, &start, &prior, &options);
    assert!(matches!(other, Err(RegistrationError::NoOverlap { .. } | RegistrationError::Misfit { .. })), "{other:?}");
    let nothing = register(&cloud, &Patches::new(0.002, 5, 10), &start, &prior, &options);
    assert!(matches!(nothing, Err(RegistrationError::NoOverlap { .. })), "{nothing:?}");
    let bad = register(&cloud, &model, &start, &Matrix6::zeros(), &options);
    assert_eq!(bad, Err(RegistrationError::BadStart));
}

#[test]
fn a_range_image_is_registered_to_by_projection() {
    let camera = Camera::look_at(Point3::new(0.0, 0.0, 1.0), Point3::origin(), [400, 400], 2000.0);
    let (normalised, worst) = over_seeds(10, |random| {
        let model = Shape::Face.scan([-HALF, HALF], 0.0004, SIGMA, random);
        let model = RangeImage::new(camera.clone(), model, vec![0.004, 0.015]);
        let truth = pose(random, 0.01, 0.05);
        let cloud = moved(&Shape::Face.scan([-HALF, HALF], 0.002, SIGMA, random), &truth);
        let start = truth * pose(random, 0.003, 0.02);
        let found =
            register(&cloud, &model, &start, &covariance(0.003, 0.02), &RegistrationOptions::default()).unwrap();
        (found, truth)
    });
    assert!((0.4..2.5).contains(&normalised) && worst < 2e-4, "{normalised} {worst}");
}

#[test]
fn normals_are_found_but_for_points_along_a_line() {
    let mut random = Random::new(2);
    let truth = Shape::Face.scan([-HALF, HALF], 0.001, 1e-5, &mut random);
    let mut bare: Vec<SurfacePoint> = truth.iter().map(|it| SurfacePoint { normal: Vector3::zeros(), ..*it }).collect();
    let viewpoint = Point3::new(0.0, 0.0, 2.0);
    assert!(find_normals(&mut bare, 0.003, &viewpoint) < 20);
    let mut off: Vec<f64> = bare
        .iter()
        .filter(|it| it.normal != Vector3::zeros())
        .map(|it| it.normal.angle(&Shape::Face.normal(it.position.x, it.position.y)).to_degrees())
        .collect();
    off.sort_by(f64::total_cmp);
    assert!(off[off.len() / 2] < 2.0 && off[off.len() * 99 / 100] < 25.0, "{}", off[off.len() / 2]);
    let on_line = |it: i32| {
        let y = f64::from(it) * 2e-4;
        SurfacePoint { position: Point3::new(0.0, y, Shape::Face.height(0.0, y)), normal: Vector3::zeros(), ..bare[0] }
    };
    let mut line: Vec<SurfacePoint> = (-50..50).map(on_line).collect();
    assert_eq!(find_normals(&mut line, 0.003, &viewpoint), line.len());
}

/// The surface fused from clouds, and its vertices' errors over the surface's own normals.
fn fused(n: u64, spacing: f64, sigma: f64) -> (DistanceField, TriangleMesh) {
    let mut field =
        DistanceField::new(FieldOptions { voxel_m: 0.001, truncation: 4.0, max_blocks: 10_000, changes: false });
    for seed in 0..n {
        for point in Shape::Face.scan([-HALF, HALF], spacing, sigma, &mut Random::new(seed)) {
            assert_eq!(field.fuse(&point, [90, 100, 200]), Fused::Yes);
        }
    }
    let mesh = field.mesh(&MeshOptions { min_points: 0.5, min_triangles: 50 });
    (field, mesh)
}

#[test]
fn fused_clouds_make_a_closed_surface_with_errors_as_large_as_stated() {
    let (field, mesh) = fused(6, 0.0006, SIGMA);
    let inner = |it: &&SurfaceVertex| it.position.coords.xy().amax() < HALF - 0.003;
    let (mut squares, mut normalised, mut turned, mut n) = (0.0, 0.0, 0.0, 0.0);
    for vertex in mesh.vertices.iter().filter(inner) {
        let (x, y) = (vertex.position.x, vertex.position.y);
        let normal = Shape::Face.normal(x, y);
        let off = (vertex.position.z - Shape::Face.height(x, y)) * normal.z;
        squares += off * off;
        normalised += (off / vertex.sigma).powi(2);
        turned += normal.angle(&vertex.normal).to_degrees();
        n += 1.0;
        assert_eq!(vertex.colour, [90, 100, 200]);
    }
    let (rms, normalised, turned): (f64, f64, f64) = ((squares / n).sqrt(), (normalised / n).sqrt(), turned / n);
    assert!(n > 20_000.0 && rms < 0.5 * SIGMA && (0.6..1.6).contains(&normalised) && turned < 3.0);
    // As large as the surface, once; each edge inside belongs to two triangles that run along it in opposite directions.
    let true_area: f64 = (0..160 * 160)
        .map(|it| {
            let [x, y] = [it % 160, it / 160].map(|it| -HALF + 0.001 * (f64::from(it) + 0.5));
            1e-6 / Shape::Face.normal(x, y).z
        })
        .sum();
    assert!((0.97..1.005).contains(&(mesh.area() / true_area)), "{} {true_area}", mesh.area());
    let edges: std::collections::HashSet<[u32; 2]> =
        mesh.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
    assert_eq!(edges.len(), 3 * mesh.triangles.len(), "no edge runs the same way twice");
    let is_inner = |it: u32| inner(&&mesh.vertices[it as usize]);
    let open = edges.iter().filter(|[a, b]| is_inner(*a) && is_inner(*b) && !edges.contains(&[*b, *a])).count();
    assert_eq!(open, 0);
    let outwards = mesh.triangles.iter().filter(|it| {
        let [a, b, c] = it.map(|corner| mesh.vertices[corner as usize].position);
        (b - a).cross(&(c - a)).dot(&mesh.vertices[it[0] as usize].normal) > 0.0
    });
    assert!(outwards.count() as f64 > 0.999 * mesh.triangles.len() as f64);
    let above = Point3::new(0.01, 0.02, Shape::Face.height(0.01, 0.02) + 0.002);
    assert!((field.distance(&above).unwrap() - 0.002 * Shape::Face.normal(0.01, 0.02).z).abs() < 2e-4);
    assert_eq!(field.distance(&Point3::new(0.0, 0.0, 0.5)), None);
}

#[test]
fn more_clouds_make_a_truer_surface_and_full_fields_say_so() {
    let rms = |mesh: &TriangleMesh| {
        let off = |it: &SurfaceVertex| (it.position.z - Shape::Face.height(it.position.x, it.position.y)).powi(2);
        (mesh.vertices.iter().map(off).sum::<f64>() / mesh.vertices.len() as f64).sqrt()
    };
    let (one, eight) = (rms(&fused(1, 0.001, 3e-4).1), rms(&fused(8, 0.001, 3e-4).1));
    assert!(eight < 0.55 * one, "{one} {eight}");
    let mut field =
        DistanceField::new(FieldOptions { voxel_m: 0.001, truncation: 4.0, max_blocks: 20, changes: false });
    let points = Shape::Face.scan([-HALF, HALF], 0.002, SIGMA, &mut Random::new(1));
    let full = points.iter().filter(|it| field.fuse(it, [0; 3]) == Fused::Full).count();
    assert!(full > points.len() / 2 && field.n_blocks() == 20);
    let bare = SurfacePoint { normal: Vector3::zeros(), ..points[0] };
    assert_eq!(field.fuse(&bare, [0; 3]), Fused::Unfit);
    let far = SurfacePoint { position: Point3::new(1e9, 0.0, f64::NAN), ..points[0] };
    assert_eq!(field.fuse(&far, [0; 3]), Fused::Unfit);
}

/// Adds a scan of the face that stands off along z by so much where `of` says so.
fn fuse_off(field: &mut DistanceField, off_m: f64, seed: u64, of: impl Fn(f64) -> bool) {
    for mut point in Shape::Face.scan([-HALF, HALF], 0.0007, 2e-5, &mut Random::new(seed)) {
        if of(point.position.x) {
            point.position.z += off_m;
            assert_eq!(field.fuse(&point, [0; 3]), Fused::Yes);
        }
    }
}

/// Of vertices away from the ends of a half: how far they are above the face in the mean [m], the median of their sigmas [m], and their number.
fn of_half(mesh: &TriangleMesh, is_right: bool) -> (f64, f64, usize) {
    let within = |it: &&SurfaceVertex| {
        let place = it.position;
        (place.x > 0.0) == is_right && place.x.abs() > 0.004 && place.coords.xy().amax() < HALF - 0.004
    };
    let half: Vec<&SurfaceVertex> = mesh.vertices.iter().filter(within).collect();
    let above = |it: &&SurfaceVertex| it.position.z - Shape::Face.height(it.position.x, it.position.y);
    let mut sigmas: Vec<f64> = half.iter().map(|it| it.sigma).collect();
    sigmas.sort_by(f64::total_cmp);
    let mean = half.iter().map(above).sum::<f64>() / half.len() as f64;
    (mean, sigmas.get(half.len() / 2).copied().unwrap_or(f64::NAN), half.len())
}

#[test]
fn clouds_that_contradict_each_other_make_no_small_sigma_and_by_more_no_surface() {
    let mesh = |off_m: f64| {
        let options = FieldOptions { voxel_m: 0.001, truncation: 4.0, max_blocks: 10_000, changes: false };
        let mut field = DistanceField::new(options);
        for seed in 0..12 {
            let side = if seed % 2 == 0 { off_m } else { -off_m };
            fuse_off(&mut field, 0.0, seed, |x| x <= 0.0);
            fuse_off(&mut field, side, seed, |x| x > 0.0);
        }
        field.mesh(&MeshOptions { min_points: 0.5, min_triangles: 50 })
    };
    let contradicted = mesh(1.5e-4);
    let [(_, sigma_left, _), (_, sigma_right, _)] = [false, true].map(|it| of_half(&contradicted, it));
    // Normals that are off by 5° contradict each other too, by some hundredths of a voxel.
    assert!(sigma_left < 6e-5, "{sigma_left}");
    assert!((1.2e-4..1.7e-4).contains(&sigma_right), "{sigma_right}");
    let torn = mesh(7e-4);
    let [(_, _, n_left), (_, _, n_right)] = [false, true].map(|it| of_half(&torn, it));
    assert!(n_left > 8000 && n_right < n_left / 50, "{n_left} {n_right}");
}

#[test]
fn of_what_changes_older_clouds_give_way_and_what_is_seen_no_more_ends() {
    let mesh = |changes: bool| {
        let options = FieldOptions { voxel_m: 0.001, truncation: 4.0, max_blocks: 10_000, changes };
        let mut field = DistanceField::new(options);
        for seed in 0..10 {
            fuse_off(&mut field, 0.0, seed, |_| true);
            field.fade(0.8);
        }
        // The right half is there no more, and the left one lies a millimetre farther out.
        for seed in 10..13 {
            fuse_off(&mut field, 1e-3, seed, |x| x <= 0.0);
            field.fade(0.6);
        }
        field.mesh(&MeshOptions { min_points: 0.5, min_triangles: 50 })
    };
    let (now, mean) = (mesh(true), mesh(false));
    let [(above, _, n_left), (_, _, n_right)] = [false, true].map(|it| of_half(&now, it));
    assert!((above - 1e-3).abs() < 5e-5 && n_left > 8000 && n_right == 0, "{above} {n_left} {n_right}");
    let [(_, _, n_left), (_, _, n_right)] = [false, true].map(|it| of_half(&mean, it));
    assert!(n_left < n_right / 4 && n_right > 8000, "{n_left} {n_right}");
}
