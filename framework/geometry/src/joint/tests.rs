//! Points and poses together against known truth, with heads a tenth of a degree off.

use foveate_estimation::Random;
use nalgebra::{Vector2, Vector3};

use super::*;

const DEGREE: f64 = std::f64::consts::PI / 180.0;

/// Four long lenses 3 m from a face.
fn cameras() -> Vec<Camera> {
    [-1.8, -0.6, 0.7, 1.9]
        .map(|x| Camera::look_at(Point3::new(x, 3.0, 1.9), Point3::new(0.05, 0.0, 1.6), [640, 480], 2600.0))
        .into()
}

/// Places of marks on something like a face.
fn face(n: usize, random: &mut Random) -> Vec<Point3<f64>> {
    let mut mark = || {
        let (x, z) = (random.uniform_in(-0.08, 0.08), random.uniform_in(-0.1, 0.1));
        Point3::new(x, 0.09 - 6.0 * (x * x + 0.5 * z * z), 1.6 + z)
    };
    (0..n).map(|_| mark()).collect()
}

struct Scene {
    truth: Vec<Point3<f64>>,
    viewpoints: Vec<Viewpoint>,
    observations: Vec<JointObservation>,
}

/// Cameras whose heads point `error` off at random [rad], observations with noise `sigma` [px].
fn scene(error: f64, sigma: f64, seed: u64) -> Scene {
    let mut random = Random::new(seed);
    let truth = face(60, &mut random);
    let mut viewpoints = Vec::new();
    let mut observations = Vec::new();
    for (viewpoint, camera) in cameras().into_iter().enumerate() {
        for (point, place) in truth.iter().enumerate() {
            let noise = Vector2::new(random.normal(), random.normal()) * sigma;
            let covariance = Matrix2::identity() * sigma.max(1e-3).powi(2);
            observations.push(JointObservation {
                viewpoint,
                point,
                pixel: camera.project(place).unwrap() + noise,
                covariance,
            });
        }
        let turn = Vector3::from_fn(|_, _| random.normal() * error);
        let centre = camera.centre().coords;
        let about = Translation3::from(centre) * UnitQuaternion::from_scaled_axis(turn) * Translation3::from(-centre);
        let mut covariance = Matrix6::zeros();
        let by_turn = {
            let mut by = nalgebra::SMatrix::<f64, 6, 3>::zeros();
            by.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
            by.fixed_view_mut::<3, 3>(3, 0).copy_from(&centre.cross_matrix());
            by
        };
        covariance += by_turn * by_turn.transpose() * error * error;
        let believed = Camera { camera_from_world: camera.camera_from_world * about.inverse(), ..camera };
        viewpoints.push(Viewpoint { camera: believed, covariance });
    }
    Scene { truth, viewpoints, observations }
}

fn solve(scene: &Scene, options: &JointOptions) -> Joint {
    triangulate_jointly(&scene.viewpoints, scene.truth.len(), &scene.observations, options).unwrap()
}

/// Median deviation of the distances between neighbouring marks from the truth [mm].
fn pair_error(scene: &Scene, joint: &Joint) -> f64 {
    let mut errors = Vec::new();
    for (a, b) in (0..scene.truth.len()).flat_map(|a| (0..a).map(move |b| (a, b))) {
        if let (Some(one), Some(other)) = (&joint.points[a], &joint.points[b]) {
            let true_distance = (scene.truth[a] - scene.truth[b]).norm();
            errors.push(((one.position - other.position).norm() - true_distance).abs() * 1e3);
        }
    }
    median(&errors).unwrap()
}

#[test]
fn marks_fit_together_though_the_heads_are_a_tenth_of_a_degree_off() {
    let mut scene = scene(0.1 * DEGREE, 0.1, 1);
    // The left half of the face is hidden from one side, the right half from the other.
    scene.observations.retain(|it| it.viewpoint != if scene.truth[it.point].x < 0.0 { 3 } else { 0 });
    let fixed = JointOptions { estimate_poses: false, outlier_sigmas: f64::INFINITY, ..JointOptions::default() };
    let [ours, without] = [JointOptions::default(), fixed].map(|options| pair_error(&scene, &solve(&scene, &options)));
    assert!(ours < 0.15 && without > 3.0 * ours, "{ours} mm, {without} mm with the poses as believed");
}

#[test]
fn poses_that_are_right_stay_and_points_are_exact_without_noise() {
    let scene = scene(0.0, 0.0, 2);
    let joint = solve(&scene, &JointOptions::default());
    for (found, truth) in joint.points.iter().zip(&scene.truth) {
        assert!((found.unwrap().position - truth).norm() < 1e-9);
    }
    assert!(joint.disputed.iter().all(|it| !it) && joint.residuals.iter().all(|it| it.unwrap() < 1e-5));
}

#[test]
fn wrong_sights_are_named_and_do_no_harm() {
    let mut scene = scene(0.1 * DEGREE, 0.1, 3);
    let wrong = [5, 77, 140, 201, 230];
    for index in wrong {
        scene.observations[index].pixel += Vector2::new(6.0, -9.0);
    }
    let joint = solve(&scene, &JointOptions::default());
    let named: Vec<usize> = (0..scene.observations.len()).filter(|it| joint.disputed[*it]).collect();
    assert_eq!(named, wrong);
    assert!(pair_error(&scene, &joint) < 0.12 && joint.points.iter().all(Option::is_some));
}

#[test]
fn a_point_that_two_cameras_see_differently_is_left_out() {
    let mut scene = scene(0.02 * DEGREE, 0.1, 4);
    // Point 7 is seen by the first two cameras only, one of them 5 px off its line.
    scene.observations.retain(|it| it.point != 7 || it.viewpoint < 2);
    scene.observations[7].pixel.y += 5.0;
    let joint = solve(&scene, &JointOptions::default());
    assert!(joint.points[7].is_none() && joint.points[8].is_some());
    assert_eq!(joint.disputed.iter().filter(|it| **it).count(), 2);
}

#[test]
fn what_is_uncertain_is_said_of_the_whole_and_of_each_point() {
    let (mut whole, mut beside, mut n) = (0.0, 0.0, 0.0);
    for seed in 0..60 {
        let scene = scene(0.1 * DEGREE, 0.15, 100 + seed);
        let joint = solve(&scene, &JointOptions { pixel_floor: 1e-3, ..JointOptions::default() });
        let found: Vec<Point3<f64>> = joint.points.iter().map(|it| it.unwrap().position).collect();
        let options = crate::AlignmentOptions::default();
        let alignment = crate::align(&found, &scene.truth, options).unwrap();
        for (point, truth) in joint.points.iter().zip(&scene.truth) {
            let point = point.unwrap();
            let left = alignment.b_from_a.isometry * point.position - truth;
            beside += (left.transpose() * point.covariance.try_inverse().unwrap() * left).x;
            n += 3.0;
        }
        let shift = alignment.b_from_a.isometry * joint.middle - joint.middle;
        let place = joint.covariance.fixed_view::<3, 3>(3, 3).into_owned();
        whole += (shift.transpose() * place.try_inverse().unwrap() * shift).x / 3.0;
    }
    let [whole, beside] = [(whole / 60.0).sqrt(), f64::sqrt(beside / n)];
    assert!((0.8..1.2).contains(&whole) && (0.85..1.15).contains(&beside), "{whole} {beside} standard deviations");
}

#[test]
fn what_cannot_be_solved_is_refused_by_its_place() {
    let mut scene = scene(0.0, 0.1, 5);
    let fault = |scene: &Scene| {
        triangulate_jointly(&scene.viewpoints, scene.truth.len(), &scene.observations, &JointOptions::default())
    };
    scene.observations[3].pixel.x = f64::NAN;
    assert_eq!(fault(&scene), Err(JointError::BadObservation { index: 3 }));
    scene.observations[3].point = 99;
    assert!(matches!(fault(&scene), Err(JointError::NoSuch { index: 3, point: 99, .. })));
    scene.observations.truncate(3);
    assert_eq!(fault(&scene), Err(JointError::NothingSeenTwice));
    scene.viewpoints[1].covariance = Matrix6::identity() * -1.0;
    assert_eq!(fault(&scene), Err(JointError::BadViewpoint { index: 1 }));
    assert_eq!(triangulate_jointly(&[], 0, &[], &JointOptions::default()), Err(JointError::NothingSeenTwice));
}
