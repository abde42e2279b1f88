//! Poses of drawn scenes against the truth, and what must be refused.

use proptest::prelude::*;

use super::*;
use crate::camera::{Distortion, Intrinsics};

/// A counter's hash: enough of a random number here.
struct Draw(u64);

impl Draw {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        self.0 >> 11
    }

    fn uniform(&mut self) -> f64 {
        self.bits() as f64 / (1u64 << 53) as f64
    }

    fn below(&mut self, n: u32) -> u32 {
        (self.uniform() * f64::from(n)) as u32
    }

    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

fn camera() -> Camera {
    Camera {
        image_size: [1920, 1080],
        intrinsics: Intrinsics { focal: [1500.0, 1490.0], principal: [950.0, 530.0], skew: 0.0 },
        distortion: Distortion { k1: -0.1, k2: 0.05, p1: 1e-3, p2: -5e-4, k3: 0.0 },
        ..Camera::look_at(Point3::new(40.0, -30.0, 2.0), Point3::new(0.0, 0.0, 15.0), [1920, 1080], 1500.0)
    }
}

/// Points about `origin` in a box of the given half sizes, and their pixels with noise of `sigma` [px].
fn scene(half: [f64; 3], n: usize, sigma: f64, draw: &mut Draw) -> (Vec<Point3<f64>>, Vec<Point2<f64>>) {
    let camera = camera();
    let points: Vec<Point3<f64>> = (0..n)
        .map(|_| Point3::new(0.0, 0.0, 15.0) + Vector3::from(half.map(|it| (2.0 * draw.uniform() - 1.0) * it)))
        .collect();
    let pixels = points
        .iter()
        .map(|it| camera.project(it).unwrap() + Vector2::new(draw.normal(), draw.normal()) * sigma)
        .collect();
    (points, pixels)
}

#[track_caller]
fn found(points: &[Point3<f64>], pixels: &[Point2<f64>], options: &ResectionOptions) -> Resection {
    let mut draw = Draw(7);
    resect(&camera(), points, pixels, options, |n| draw.below(n)).unwrap()
}

fn centre_error(found: &Resection) -> Vector3<f64> {
    found.camera_from_world.inverse_transform_point(&Point3::origin()) - camera().centre()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn exact_pixels_give_the_pose_back(seed in 0u64..1000, n in 6usize..40, height in prop_oneof![Just(0.0), 1.0..8.0]) {
        // Height 0: all points in a plane.
        let (points, pixels) = scene([10.0, 10.0, height], n, 0.0, &mut Draw(seed));
        let found = found(&points, &pixels, &ResectionOptions::default());
        prop_assert!(centre_error(&found).norm() < 1e-5, "{}", centre_error(&found));
        prop_assert!(found.camera_from_world.rotation.angle_to(&camera().camera_from_world.rotation) < 1e-6);
        prop_assert!(found.right.iter().all(|it| *it) && found.residuals_rms_px < 1e-4);
    }
}

#[test]
fn four_points_are_enough_and_three_are_not() {
    let (points, pixels) = scene([10.0, 10.0, 5.0], 4, 0.0, &mut Draw(3));
    assert!(centre_error(&found(&points, &pixels, &ResectionOptions::default())).norm() < 1e-5);
    let refused = resect(&camera(), &points[..3], &pixels[..3], &ResectionOptions::default(), |_| 0).unwrap_err();
    assert_eq!(refused, ResectionError::TooFew { count: 3 });
    let mut broken = pixels.clone();
    broken[2].x = f64::NAN;
    let refused = resect(&camera(), &points, &broken, &ResectionOptions::default(), |_| 0).unwrap_err();
    assert_eq!(refused, ResectionError::TooFew { count: 3 });
}

#[test]
fn seven_wrong_pairs_of_ten_are_found_out() {
    let mut draw = Draw(5);
    let (points, mut pixels) = scene([15.0, 15.0, 8.0], 300, 0.5, &mut draw);
    for pixel in pixels.iter_mut().take(210) {
        *pixel += Vector2::new(draw.normal(), draw.normal()) * 150.0;
    }
    let found = found(&points, &pixels, &ResectionOptions { trials: 2000, ..ResectionOptions::default() });
    assert!(centre_error(&found).norm() < 0.1, "{} m", centre_error(&found).norm());
    assert!(found.right[210..].iter().all(|it| *it));
    assert!(found.right[..210].iter().filter(|it| **it).count() < 5);
}

#[test]
fn the_error_is_what_the_covariance_says() {
    let (mut draw, runs) = (Draw(1), 400);
    let (mut of_centre, mut of_pose) = (0.0, 0.0);
    for _ in 0..runs {
        let (points, pixels) = scene([10.0, 10.0, 5.0], 60, 0.5, &mut draw);
        let found =
            refine_pose(&camera(), &points, &pixels, &ResectionOptions { inlier_px: 5.0, ..Default::default() })
                .unwrap();
        let error = centre_error(&found);
        of_centre += error.dot(&(found.centre_covariance().try_inverse().unwrap() * error));
        let delta = found.camera_from_world.inverse() * camera().camera_from_world;
        let turn = delta.rotation.scaled_axis();
        let pose = Vector6::from_iterator(turn.iter().chain(delta.translation.vector.iter()).copied());
        of_pose += pose.dot(&(found.covariance.try_inverse().unwrap() * pose));
    }
    // χ² of 3 and 6 degrees of freedom; Cauchy's weights below 1 make the stated covariance up to a third too large.
    let (centre, pose) = (of_centre / f64::from(runs), of_pose / f64::from(runs));
    assert!((1.8..3.4).contains(&centre) && (3.6..6.8).contains(&pose), "{centre} {pose}");
}

#[test]
fn places_of_a_map_keep_their_digits() {
    let far = Vector3::new(465_000.0, 5_247_000.0, 540.0);
    let (points, pixels) = scene([10.0, 10.0, 5.0], 30, 0.0, &mut Draw(9));
    let shifted: Vec<Point3<f64>> = points.iter().map(|it| it + far).collect();
    let found = found(&shifted, &pixels, &ResectionOptions::default());
    assert!((centre_error(&found) - far).norm() < 1e-4, "{}", (centre_error(&found) - far).norm());
}

#[test]
fn what_fixes_no_pose_is_refused_with_the_reason() {
    let options = ResectionOptions::default();
    let refused = |points: &[Point3<f64>], pixels: &[Point2<f64>], options: &ResectionOptions| {
        let mut draw = Draw(2);
        resect(&camera(), points, pixels, options, |n| draw.below(n)).unwrap_err()
    };
    let line: Vec<Point3<f64>> = (0..20).map(|it| Point3::new(f64::from(it), 0.5 * f64::from(it), 15.0)).collect();
    let on_line: Vec<Point2<f64>> = line.iter().map(|it| camera().project(it).unwrap()).collect();
    assert!(matches!(refused(&line, &on_line, &options), ResectionError::Collinear { .. }));
    assert!(matches!(refused(&[line[0]; 9], &[on_line[0]; 9], &options), ResectionError::Collinear { .. }));
    let (points, pixels) = scene([10.0, 10.0, 5.0], 30, 0.0, &mut Draw(4));
    assert_eq!(refused(&points, &pixels[1..], &options), ResectionError::LengthsDiffer { points: 30, pixels: 29 });
    let bad = ResectionOptions { inlier_px: 0.0, ..options };
    assert_eq!(refused(&points, &pixels, &bad), ResectionError::BadOption { option: "inlier_px", found: 0.0 });
    // Pixels that belong to no points.
    let mut draw = Draw(6);
    let noise: Vec<Point2<f64>> =
        points.iter().map(|_| Point2::new(draw.uniform() * 1920.0, draw.uniform() * 1080.0)).collect();
    let strict = ResectionOptions { inlier_px: 0.01, ..options };
    assert!(matches!(refused(&points, &noise, &strict), ResectionError::NoConsensus { .. }));
}

#[test]
fn points_behind_the_camera_are_never_right() {
    let (mut points, pixels) = scene([10.0, 10.0, 5.0], 40, 0.0, &mut Draw(8));
    for point in points.iter_mut().take(8) {
        let direction = *point - camera().centre();
        *point = camera().centre() - direction; // on the same line, behind
    }
    let found = found(&points, &pixels, &ResectionOptions::default());
    assert!(centre_error(&found).norm() < 1e-5);
    assert_eq!(found.right.iter().filter(|it| **it).count(), 32);
}

#[test]
fn a_pose_that_looks_away_costs_more_than_one_that_misses_by_dozens_of_limits() {
    let options = ResectionOptions::default();
    let (points, pixels) = scene([10.0, 10.0, 5.0], 40, 0.0, &mut Draw(8));
    let missed: Vec<Point2<f64>> = pixels.iter().map(|it| it + Vector2::new(40.0 * options.inlier_px, 0.0)).collect();
    let cost = |pixels: &[Point2<f64>], turn: f64| {
        let camera = camera();
        let problem = Problem::new(&camera, &points, pixels, &options).unwrap();
        let turned = Isometry3::rotation(Vector3::y() * turn) * camera.camera_from_world;
        problem.normal(&(turned * nalgebra::Translation3::from(problem.centroid))).cost
    };
    let [right, misses, away] = [cost(&pixels, 0.0), cost(&missed, 0.0), cost(&pixels, std::f64::consts::PI)];
    assert!(right < 1e-9 && misses > 1.0 && away > misses && away.is_finite(), "{right} {misses} {away}");
}
