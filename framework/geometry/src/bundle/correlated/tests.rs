//! Stated covariances compared with actual errors: white noise, noise that lasts, lenses that the model does not know.

use foveate_estimation::Random;
use nalgebra::Vector2;

use crate::alignment::{AlignmentOptions, camera_errors};
use crate::bundle::{BundleError, BundleOptions, CameraCovariance, Freedom, Known, Observation, adjust_knowing};
use crate::camera::Camera;
use crate::test_room;

const N_POINTS: usize = 400;
const SIGMA_PX: f64 = 0.5;
const SEEDS: u64 = 3;

/// Mean over cameras and seeds of what is stated of the centres with stretches over what is without, and root mean square of errors over what is stated.
#[track_caller]
fn check(noise: impl Fn(&mut Random, usize) -> Vec<Vector2<f64>>, seen_by: impl Fn(&Camera) -> Camera) -> (f64, f64) {
    let (mut ratios, mut squares) = (Vec::new(), Vec::new());
    for seed in 0..SEEDS {
        let mut random = Random::new(seed);
        let cameras = test_room::cameras(8, seed);
        let points = test_room::path(N_POINTS);
        let real: Vec<Camera> = cameras.iter().map(&seen_by).collect();
        let mut observations: Vec<Observation> = test_room::observations(&real, &points, 6, 0.0, &mut random);
        let errors: Vec<Vec<Vector2<f64>>> = (0..cameras.len()).map(|it| noise(&mut random, it)).collect();
        for it in &mut observations {
            it.pixel += errors[it.camera][it.point];
            it.sigma_px = SIGMA_PX;
        }
        let stretches: Vec<usize> = (0..N_POINTS).map(|it| it * 24 / N_POINTS).collect();
        let freedoms = vec![Freedom { focal: true, ..Freedom::POSE }; cameras.len()];
        let options = BundleOptions { covariance: true, ..BundleOptions::default() };
        let stated = |stretches: &[usize]| -> (Vec<Camera>, Vec<CameraCovariance>) {
            let known = Known { stretches, ..Known::default() };
            let found = adjust_knowing(&cameras, &freedoms, &points, &observations, &known, &options).unwrap();
            (found.cameras, found.covariance.unwrap().unwrap())
        };
        let ((found, with), (_, without)) = (stated(&stretches), stated(&[]));
        let apart = camera_errors(&found, &cameras, AlignmentOptions { scale: true, robust: false }).unwrap();
        for ((with, without), error) in with.iter().zip(&without).zip(&apart.centres) {
            assert!(with.pose.symmetric_eigenvalues().min() > 0.0, "{}", with.pose);
            ratios.push((with.centre.trace() / without.centre.trace()).sqrt());
            squares.push(error * error / with.centre.trace());
        }
    }
    let mean = |it: &[f64]| it.iter().sum::<f64>() / it.len() as f64;
    (mean(&ratios), mean(&squares).sqrt())
}

fn white(random: &mut Random) -> Vector2<f64> {
    Vector2::new(random.normal(), random.normal()) * SIGMA_PX
}

#[test]
fn white_noise_is_stated_as_it_was() {
    let (ratio, error) = check(|random, _| (0..N_POINTS).map(|_| white(random)).collect(), Camera::clone);
    assert!((0.95..1.3).contains(&ratio) && (0.6..1.2).contains(&error), "{ratio} {error}");
}

#[test]
fn noise_that_lasts_for_a_while_counts_once_in_that_while() {
    // Eight points in a row err alike: an eighth of the observations, √8 times the error.
    let lasting = |random: &mut Random, _: usize| {
        let mut held = Vector2::zeros();
        let one = |it: usize| {
            if it.is_multiple_of(8) {
                held = white(random);
            }
            held
        };
        (0..N_POINTS).map(one).collect()
    };
    let (ratio, error) = check(lasting, Camera::clone);
    assert!((2.0..4.0).contains(&ratio) && (0.5..1.5).contains(&error), "{ratio} {error}");
}

#[test]
fn a_lens_that_the_model_does_not_know_is_stated() {
    let richer = |camera: &Camera| {
        let mut camera = camera.clone();
        (camera.distortion.k2, camera.distortion.p1) = (0.02, 2e-3);
        camera
    };
    let (ratio, error) = check(|random, _| (0..N_POINTS).map(|_| white(random) * 0.4).collect(), richer);
    assert!(ratio > 1.0 && error < 2.5, "{ratio} {error}");
}

#[test]
fn stretches_are_one_for_each_point() {
    let cameras = test_room::cameras(2, 1);
    let points = test_room::path(N_POINTS);
    let observations = test_room::observations(&cameras, &points, 2, SIGMA_PX, &mut Random::new(1));
    for stretches in [vec![0; 3], vec![100_000; N_POINTS]] {
        let known = Known { stretches: &stretches, ..Known::default() };
        let freedoms = [Freedom::POSE; 2];
        let fault = adjust_knowing(&cameras, &freedoms, &points, &observations, &known, &BundleOptions::default());
        assert!(matches!(fault, Err(BundleError::BadStretches { .. })), "{fault:?}");
    }
}
