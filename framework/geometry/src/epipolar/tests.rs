//! Known pairs of cameras found again, through outliers and planes, and what must be refused.

use nalgebra::Vector2;

use super::*;
use crate::test_room;

struct Scene {
    cameras: [Camera; 2],
    pixels: [Vec<Point2<f64>>; 2],
}

fn scene(points: &[Point3<f64>], sigma: f64, wrong_every: usize, seed: u64) -> Scene {
    let mut random = Random::new(seed);
    let mut cameras = test_room::cameras(18, 1);
    cameras.iter_mut().for_each(|it| it.distortion = test_room::lens());
    let cameras = [cameras[0].clone(), cameras[4].clone()];
    let mut pixels = [Vec::new(), Vec::new()];
    for point in points {
        let Some((a, b)) = cameras[0].sees(point).zip(cameras[1].sees(point)) else { continue };
        let mut noisy = |it: Point2<f64>| it + Vector2::new(random.normal(), random.normal()) * sigma;
        pixels[0].push(noisy(a));
        pixels[1].push(noisy(b));
        if wrong_every > 0 && pixels[0].len().is_multiple_of(wrong_every) {
            *pixels[1].last_mut().unwrap() = Point2::new(random.uniform_in(0.0, 639.0), random.uniform_in(0.0, 479.0));
        }
    }
    Scene { cameras, pixels }
}

fn found(scene: &Scene, options: &EpipolarOptions) -> Result<TwoViews, EpipolarError> {
    let [a, b] = &scene.cameras;
    let [in_a, in_b] = &scene.pixels;
    relative_pose([a, b], [in_a, in_b], options, &mut Random::new(5))
}

/// Angles of the rotation and of the direction of the baseline from the truth [rad].
fn errors(scene: &Scene, found: &TwoViews) -> [f64; 2] {
    let [a, b] = &scene.cameras;
    let truth = b.camera_from_world * a.camera_from_world.inverse();
    let shift = found.b_from_a.translation.vector;
    assert!((shift.norm() - 1.0).abs() < 1e-9);
    [found.b_from_a.rotation.angle_to(&truth.rotation), shift.angle(&truth.translation.vector)]
}

#[test]
fn a_clean_pair_is_found_exactly() {
    let scene = scene(&test_room::path(60), 0.0, 0, 1);
    let found = found(&scene, &EpipolarOptions::default()).unwrap();
    assert_eq!(found.n_right, scene.pixels[0].len());
    assert!(errors(&scene, &found).iter().all(|it| *it < 1e-6), "{:?}", errors(&scene, &found));
    assert!(found.planar_share < 0.7 && found.parallax_rad > 0.3, "{found:?}");
}

#[test]
fn two_dozen_noisy_points_with_a_third_wrong_are_enough() {
    for seed in 0..10 {
        let scene = scene(&test_room::path(30), 0.5, 3, seed);
        let found = found(&scene, &EpipolarOptions::default()).unwrap();
        assert!(errors(&scene, &found).iter().all(|it| *it < 0.05), "{seed}: {:?}", errors(&scene, &found));
        assert!(found.n_right * 10 >= scene.pixels[0].len() * 5, "{}", found.n_right);
    }
}

#[test]
fn a_path_in_a_plane_says_so() {
    let flat: Vec<Point3<f64>> = test_room::path(80).iter().map(|it| Point3::new(it.x, it.y, 1.0)).collect();
    let scene = scene(&flat, 0.3, 0, 2);
    let found = found(&scene, &EpipolarOptions::default()).unwrap();
    assert!(found.planar_share > 0.95, "{}", found.planar_share);
}

#[test]
fn what_fixes_no_pose_is_refused_with_the_reason() {
    let options = EpipolarOptions::default();
    let good = scene(&test_room::path(60), 0.2, 0, 3);
    let refused = |scene: &Scene| found(scene, &options).unwrap_err();
    let still = scene(&[Point3::new(0.0, 0.0, 1.2); 30], 0.5, 0, 3);
    assert!(matches!(refused(&still), EpipolarError::Collinear { .. }), "{}", refused(&still));
    let line: Vec<Point3<f64>> = (0..40).map(|it| Point3::new(0.02 * f64::from(it), 0.0, 1.0)).collect();
    let mut on_line = scene(&line, 0.3, 0, 3);
    on_line.cameras.iter_mut().for_each(|it| it.distortion = Default::default());
    assert!(matches!(refused(&on_line), EpipolarError::Collinear { .. }), "{}", refused(&on_line));
    let same = Scene {
        cameras: [good.cameras[0].clone(), good.cameras[0].clone()],
        pixels: [good.pixels[0].clone(), good.pixels[0].clone()],
    };
    assert!(
        matches!(refused(&same), EpipolarError::NoDepth { .. } | EpipolarError::NoConsensus { .. }),
        "{}",
        refused(&same)
    );
    let mut shifted = good.pixels.clone();
    shifted[1].rotate_left(7);
    let unrelated = Scene { cameras: good.cameras.clone(), pixels: shifted };
    let strict = EpipolarOptions { inlier_px: 0.5, min_right: 30, ..options };
    assert!(matches!(found(&unrelated, &strict), Err(EpipolarError::NoConsensus { .. })));
    let few = Scene { cameras: good.cameras.clone(), pixels: good.pixels.clone().map(|it| it[..5].to_vec()) };
    assert_eq!(refused(&few), EpipolarError::TooFew { count: 5, needed: 8 });
    let mut broken = good.pixels.clone();
    broken[0].iter_mut().for_each(|it| it.x = f64::NAN);
    let broken = Scene { cameras: good.cameras.clone(), pixels: broken };
    assert_eq!(refused(&broken), EpipolarError::TooFew { count: 0, needed: 8 });
    let bad = EpipolarOptions { sigma_px: -1.0, ..options };
    assert_eq!(found(&good, &bad).unwrap_err(), EpipolarError::BadOption { option: "sigma_px", found: -1.0 });
}
