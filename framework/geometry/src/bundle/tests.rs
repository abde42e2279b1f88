//! Disturbed rooms adjusted back, covariances compared with errors, and refusals.

use foveate_estimation::Random;
use nalgebra::{Isometry3, UnitQuaternion, Vector3, Vector6};

use super::*;
use crate::alignment::{AlignmentOptions, camera_errors};
use crate::test_room;

/// A room with known truth, and a disturbed start.
struct Room {
    truth: Vec<Camera>,
    points: Vec<Point3<f64>>,
    observations: Vec<Observation>,
    start: Vec<Camera>,
    start_points: Vec<Point3<f64>>,
}

fn disturbed(camera: &Camera, random: &mut Random, size: f64) -> Camera {
    let mut draw = || Vector3::new(random.normal(), random.normal(), random.normal()) * size;
    let (turn, shift) = (UnitQuaternion::from_scaled_axis(draw()), draw() * 1.5);
    let pose = Isometry3::from_parts(shift.into(), turn) * camera.camera_from_world;
    Camera { camera_from_world: pose, ..camera.clone() }
}

/// 3° and 8 cm off at `size` 0.05.
fn room(cameras: Vec<Camera>, n_points: usize, views: usize, sigma: f64, size: f64, seed: u64) -> Room {
    let mut random = Random::new(seed);
    let points = test_room::path(n_points);
    let observations = test_room::observations(&cameras, &points, views, sigma, &mut random);
    let start = cameras.iter().map(|it| disturbed(it, &mut random, size)).collect();
    let mut draw = || Vector3::new(random.normal(), random.normal(), random.normal()) * 2.0 * size;
    let start_points = points.iter().map(|it| it + draw()).collect();
    Room { truth: cameras, points, observations, start, start_points }
}

#[track_caller]
fn adjusted(room: &Room, freedom: Freedom, options: &BundleOptions) -> Adjusted {
    let freedoms = vec![freedom; room.start.len()];
    adjust(&room.start, &freedoms, &room.start_points, &room.observations, options).unwrap()
}

fn worst_centre(room: &Room, found: &Adjusted) -> f64 {
    let options = AlignmentOptions { scale: true, robust: false };
    let errors = camera_errors(&found.cameras, &room.truth, options).unwrap();
    errors.centres.iter().fold(0.0, |worst: f64, it| worst.max(*it))
}

const PRECISE: BundleOptions = BundleOptions {
    loss: Loss::Squared,
    gauge: Gauge::Inner,
    max_iterations: 100,
    relative_gain: 1e-14,
    covariance: false,
};

#[test]
fn a_disturbed_room_is_put_right_to_the_noise_floor() {
    let room = room(test_room::cameras(18, 1), 600, 6, 0.5, 0.05, 3);
    let found = adjusted(&room, Freedom::POSE, &BundleOptions::default());
    assert!(found.converged() && found.iterations < 12, "{:?} {}", found.stop, found.iterations);
    assert!(found.costs.is_sorted_by(|a, b| a > b), "{:?}", found.costs);
    // 2 × 3600 numbers less 18 × 6 + 600 × 3 − 7 unknowns: √2 σ √(1 − 1901/7200) = 0.607 px, 4 standard errors of 1.4 %.
    assert_eq!(room.observations.len(), 3600);
    assert!((0.575..0.640).contains(&found.rms_px), "{}", found.rms_px);
    assert!(worst_centre(&room, &found) < 5e-3, "{}", worst_centre(&room, &found));
}

#[test]
fn without_noise_the_truth_is_found_with_all_optics_free() {
    let mut cameras = test_room::cameras(6, 2);
    cameras.iter_mut().for_each(|it| it.distortion = test_room::lens());
    let mut room = room(cameras, 200, 6, 0.0, 0.02, 5);
    let optics = [
        Freedom::POSE,
        Freedom { focal: true, ..Freedom::POSE },
        Freedom { focal: true, k1: true, k2: true, ..Freedom::POSE },
        Freedom { focal: true, aspect: true, principal: true, k1: true, k2: true, decentering: true, ..Freedom::POSE },
    ];
    for (index, freedom) in optics.into_iter().enumerate() {
        for camera in room.start.iter_mut().filter(|_| index > 0) {
            camera.intrinsics.focal = [430.0, 430.0 + 5.0 * f64::from(u8::from(freedom.aspect))];
            if freedom.k1 {
                camera.distortion.k1 = -0.15;
            }
            if freedom.principal {
                camera.intrinsics.principal = [325.0, 235.0];
                camera.distortion.p1 = 0.0;
            }
        }
        let found = adjusted(&room, freedom, &PRECISE);
        assert!(
            found.rms_px < 1e-6 && worst_centre(&room, &found) < 1e-7,
            "{freedom:?} {} {:?}",
            found.rms_px,
            found.stop
        );
        for (camera, truth) in found.cameras.iter().zip(&room.truth) {
            assert!((camera.intrinsics.focal[1] - truth.intrinsics.focal[1]).abs() < 1e-4);
            assert!((camera.distortion.k1 - truth.distortion.k1).abs() < 1e-6);
        }
    }
}

#[test]
fn reduced_steps_are_those_of_the_whole_system() {
    // The same minimum as the dense solver of `estimation`, which knows nothing of blocks.
    use foveate_estimation::least_squares::{Equations, Options, Problem, solve};
    use nalgebra::{DVector, SMatrix};
    struct Whole<'a>(&'a Room);
    impl Problem for Whole<'_> {
        type Parameters = (Vec<Camera>, Vec<Point3<f64>>);
        fn dimension(&self) -> usize {
            6 * self.0.start.len() + 3 * self.0.points.len()
        }
        fn moved(&self, (cameras, points): &Self::Parameters, step: &DVector<f64>) -> Self::Parameters {
            let cameras = cameras.iter().enumerate();
            let moved = cameras.map(|(it, camera)| columns::moved(camera, step.rows(6 * it, 6).as_slice())).collect();
            let first = 6 * self.0.start.len();
            let points = points.iter().enumerate();
            (moved, points.map(|(it, point)| point + step.fixed_rows::<3>(first + 3 * it)).collect())
        }
        fn linearise(&self, (cameras, points): &Self::Parameters, equations: &mut Equations) -> Option<()> {
            for it in &self.0.observations {
                let point = &points[it.point];
                let (seen, by_point) = cameras[it.camera].project_with_jacobian(point)?;
                let mut jacobian = SMatrix::<f64, 2, 9>::zeros();
                jacobian.fixed_columns_mut::<3>(0).copy_from(&(by_point * -point.coords.cross_matrix()));
                jacobian.fixed_columns_mut::<3>(3).copy_from(&by_point);
                jacobian.fixed_columns_mut::<3>(6).copy_from(&by_point);
                let (camera, first) = (6 * it.camera, 6 * cameras.len() + 3 * it.point);
                let columns = std::array::from_fn(|at| if at < 6 { camera + at } else { first + at - 6 });
                equations.add(&columns, &((seen - it.pixel) / it.sigma_px), &(jacobian / it.sigma_px));
            }
            Some(())
        }
    }
    let room = room(test_room::cameras(4, 3), 25, 4, 0.5, 0.03, 8);
    for loss in [Loss::Squared, Loss::HUBER] {
        let options = Options { loss, ..Options::default() };
        let whole = solve(&Whole(&room), (room.start.clone(), room.start_points.clone()), &options).unwrap();
        let found = adjusted(&room, Freedom::POSE, &BundleOptions { loss, ..PRECISE });
        let (dense, sparse) = (whole.costs.last().unwrap(), found.costs.last().unwrap());
        assert!((dense - sparse).abs() < 1e-7 * dense, "{dense} {sparse}");
        assert!((whole.costs[0] - found.costs[0]).abs() < 1e-9 * dense);
        assert_eq!(whole.covariance.unwrap_err().parameters.len(), 7); // the gauge
    }
}

/// Mean over runs of eᵀ C⁻¹ e for the centre of camera 3, which has 3 degrees of freedom.
fn centre_chi_squared(gauge: Gauge) -> f64 {
    let (runs, mut sum) = (150, 0.0);
    let cameras = test_room::cameras(6, 4);
    for seed in 0..runs {
        let mut room = room(cameras.clone(), 80, 4, 0.5, 0.0, 100 + seed);
        // The gauge is that of the start: at the truth, errors are those in this gauge.
        room.start_points.clone_from(&room.points);
        let found = adjusted(&room, Freedom::POSE, &BundleOptions { gauge, covariance: true, ..PRECISE });
        let covariances = found.covariance.as_ref().unwrap().as_ref().unwrap();
        let error = found.cameras[3].centre() - room.truth[3].centre();
        sum += error.dot(&(covariances[3].centre.try_inverse().unwrap() * error));
        if let Gauge::Cameras { reference, other } = gauge {
            assert_eq!(found.cameras[reference], room.truth[reference]);
            assert!(covariances[reference].pose.norm() < 1e-15);
            let distance = |list: &[Camera]| (list[other].centre() - list[reference].centre()).norm();
            assert!((distance(&found.cameras) - distance(&room.truth)).abs() < 1e-9);
        }
    }
    sum / runs as f64
}

#[test]
fn errors_are_as_large_as_the_covariance_says_in_either_gauge() {
    // 3 ± 4 standard errors of 150 draws of χ² with 3 degrees of freedom.
    let inner = centre_chi_squared(Gauge::Inner);
    assert!((2.2..3.8).contains(&inner), "{inner}");
    let fixed = centre_chi_squared(Gauge::Cameras { reference: 1, other: 4 });
    assert!((2.2..3.8).contains(&fixed), "{fixed}");
}

#[test]
fn the_gauge_of_the_centres_says_what_an_alignment_of_them_leaves() {
    let (mut of_errors, mut stated) = (0.0, 0.0);
    let options = BundleOptions { gauge: Gauge::Centres, covariance: true, ..PRECISE };
    for seed in 0..40 {
        let room = room(test_room::cameras(6, 4), 60, 4, 0.5, 0.002, 100 + seed);
        let found = adjusted(&room, Freedom::POSE, &options);
        let traces = |found: &Adjusted| {
            let covariances = found.covariance.as_ref().unwrap().as_ref().unwrap();
            covariances.iter().map(|it| it.centre.trace()).sum::<f64>()
        };
        let similarity = AlignmentOptions { scale: true, robust: false };
        let errors = camera_errors(&found.cameras, &room.truth, similarity).unwrap().centres;
        of_errors += errors.iter().map(|it| it * it).sum::<f64>();
        stated += traces(&found);
        let inner = adjusted(&room, Freedom::POSE, &BundleOptions { gauge: Gauge::Inner, ..options });
        assert!(traces(&inner) > 1.01 * traces(&found));
    }
    // χ² of 11 degrees of freedom in 40 draws, four standard errors wide.
    assert!((of_errors / stated - 1.0).abs() < 0.27, "{of_errors} {stated}");
}

#[test]
fn inner_constraints_leave_the_scene_where_it_was() {
    let room = room(test_room::cameras(6, 4), 100, 4, 0.5, 0.01, 9);
    let found = adjusted(&room, Freedom::POSE, &PRECISE);
    let mut drift = Vector6::zeros();
    for (before, after) in room.start.iter().zip(&found.cameras) {
        let delta = before.camera_from_world.inverse() * after.camera_from_world;
        let turn = delta.rotation.scaled_axis();
        drift += Vector6::from_iterator(turn.iter().chain(delta.translation.vector.iter()).copied()) / 6.0;
    }
    // The mean motion of all cameras in the world vanishes to first order of the 0.6° and 15 mm that they move.
    assert!(drift.norm() < 2e-3, "{drift}");
}

#[test]
fn held_cameras_stay_and_fix_the_gauge() {
    let room = room(test_room::cameras(6, 4), 150, 4, 0.5, 0.02, 10);
    let mut start = room.start.clone();
    start[..2].clone_from_slice(&room.truth[..2]);
    let freedoms: Vec<Freedom> = (0..6).map(|it| if it < 2 { Freedom::NONE } else { Freedom::POSE }).collect();
    let options = BundleOptions { covariance: true, ..PRECISE };
    let found = adjust(&start, &freedoms, &room.start_points, &room.observations, &options).unwrap();
    assert_eq!(found.cameras[..2], room.truth[..2]);
    let worst =
        found.cameras.iter().zip(&room.truth).map(|(a, b)| (a.centre() - b.centre()).norm()).fold(0.0, f64::max);
    assert!(worst < 0.02, "{worst}"); // no alignment: metres are those of the held cameras
    let covariances = found.covariance.unwrap().unwrap();
    assert!(covariances[0].pose.norm() == 0.0 && covariances[4].centre.trace().sqrt() < 0.02);
    // One held camera leaves the scale open, which stays as it was.
    let one: Vec<Freedom> = (0..6).map(|it| if it < 1 { Freedom::NONE } else { Freedom::POSE }).collect();
    let found = adjust(&start, &one, &room.start_points, &room.observations, &options).unwrap();
    assert!(found.covariance.unwrap().is_ok());
}

#[test]
fn a_tenth_of_wrong_pixels_is_outvoted() {
    let mut room = room(test_room::cameras(8, 6), 200, 6, 0.5, 0.01, 11);
    room.observations.iter_mut().step_by(10).for_each(|it| it.pixel += Vector2::new(40.0, -25.0));
    let error = |loss: Loss| worst_centre(&room, &adjusted(&room, Freedom::POSE, &BundleOptions { loss, ..PRECISE }));
    assert!(error(Loss::Squared) > 0.02);
    assert!(error(Loss::CAUCHY) < 4e-3, "{}", error(Loss::CAUCHY));
}

#[test]
fn places_of_a_map_keep_their_digits() {
    let far = Vector3::new(465_000.0, 5_247_000.0, 540.0);
    let mut room = room(test_room::cameras(6, 4), 100, 5, 0.0, 0.02, 12);
    for camera in room.start.iter_mut().chain(&mut room.truth) {
        camera.camera_from_world *= nalgebra::Translation3::from(-far);
    }
    room.start_points.iter_mut().for_each(|it| *it += far);
    let found = adjusted(&room, Freedom::POSE, &BundleOptions { covariance: true, ..PRECISE });
    assert!(found.rms_px < 1e-3 && worst_centre(&room, &found) < 1e-5, "{}", found.rms_px);
    assert!(found.covariance.unwrap().is_ok());
}

#[test]
fn what_the_pixels_leave_open_is_named() {
    // Two cameras that share no point with the others: a scene of their own, with a gauge of its own.
    let room = room(test_room::cameras(6, 4), 100, 6, 0.5, 0.01, 13);
    let mut apart = room.observations.clone();
    apart.retain(|it| (it.camera < 2) == (it.point < 40));
    let options = BundleOptions { covariance: true, ..BundleOptions::default() };
    let found = adjust(&room.start, &[Freedom::POSE; 6], &room.start_points, &apart, &options).unwrap();
    assert!(found.converged());
    let open = found.covariance.unwrap().unwrap_err();
    assert!(open.parameters.len() == 7 && open.to_string().contains("of camera 5"), "{open}");
}

#[test]
fn what_is_seen_by_nobody_else_is_left_out() {
    let mut room = room(test_room::cameras(5, 4), 60, 5, 0.5, 0.01, 14);
    let alone = room.observations.iter().position(|it| it.point == 7).unwrap();
    let camera = room.observations[alone].camera;
    room.observations.retain(|it| it.point != 7 || it.camera == camera);
    let behind = room.start[0].centre() * 2.0;
    room.start_points[9] = Point3::from(behind.coords);
    let found = adjusted(&room, Freedom::POSE, &BundleOptions::default());
    assert_eq!(found.points[7], room.start_points[7]);
    assert!(found.left_out.contains(&alone), "{:?}", found.left_out);
    assert!(found.rms_px < 0.7, "{}", found.rms_px);
    // The same camera twice at one point is no second view, but both pixels count beside a second one.
    let mut twice = room.observations.clone();
    twice.extend(room.observations.iter().filter(|it| it.camera == 1).copied());
    let found = adjust(&room.start, &[Freedom::POSE; 5], &room.start_points, &twice, &PRECISE).unwrap();
    assert!(found.converged() && found.iterations < 30 && found.rms_px < 0.7, "{} {}", found.rms_px, found.iterations);
}

#[test]
fn bad_input_is_refused_by_place() {
    let room = room(test_room::cameras(3, 4), 20, 3, 0.5, 0.0, 15);
    let free = [Freedom::POSE; 3];
    let options = BundleOptions::default();
    let (points, observations) = (&room.points, &room.observations);
    let refused =
        |cameras: &[Camera], points: &[Point3<f64>], observations: &[Observation], options: &BundleOptions| {
            adjust(cameras, &free, points, observations, options).unwrap_err()
        };
    let with = |change: fn(&mut Observation)| {
        let mut broken = observations.clone();
        change(&mut broken[4]);
        refused(&room.truth, points, &broken, &options)
    };
    for fault in [
        with(|it| it.camera = 3),
        with(|it| it.point = 20),
        with(|it| it.pixel.x = f64::NAN),
        with(|it| it.sigma_px = 0.0),
        with(|it| it.sigma_px = f64::INFINITY),
    ] {
        assert!(matches!(fault, BundleError::BadObservation { observation: 4, .. }), "{fault}");
    }
    assert_eq!(
        refused(&room.truth[..2], points, observations, &options),
        BundleError::LengthsDiffer { cameras: 2, freedoms: 3 }
    );
    assert_eq!(refused(&room.truth, points, &[], &options), BundleError::NothingShared { observations: 0 });
    let mut broken = points.clone();
    broken[3].z = f64::NAN;
    assert_eq!(refused(&room.truth, &broken, observations, &options), BundleError::BadPoint { point: 3 });
    let mut cameras = room.truth.clone();
    cameras[1].intrinsics.focal[0] = -1.0;
    assert!(matches!(refused(&cameras, points, observations, &options), BundleError::BadCamera { camera: 1, .. }));
    let gauge = Gauge::Cameras { reference: 1, other: 1 };
    let fault = refused(&room.truth, points, observations, &BundleOptions { gauge, ..options });
    assert_eq!(fault, BundleError::BadGauge { reference: 1, other: 1, cameras: 3 });
    let loss = Loss::Huber { scale: f64::NAN };
    assert!(matches!(
        refused(&room.truth, points, observations, &BundleOptions { loss, ..options }),
        BundleError::BadOption { .. }
    ));
}

#[test]
fn beside_one_held_camera_the_other_has_no_error_in_scale() {
    let mut pair = room(test_room::cameras(18, 4), 80, 18, 0.5, 0.0, 21);
    pair.observations.retain(|it| it.camera < 2);
    let centroid = pair.points.iter().fold(Vector3::zeros(), |sum, it| sum + it.coords) / 80.0;
    let points: Vec<Point3<f64>> = pair.points.iter().map(|it| it - centroid).collect();
    let mut cameras = pair.truth[..2].to_vec();
    cameras.iter_mut().for_each(|it| it.camera_from_world *= nalgebra::Translation3::from(centroid));
    let options = BundleOptions { covariance: true, ..PRECISE };
    let found = adjust(&cameras, &[Freedom::NONE, Freedom::POSE], &points, &pair.observations, &options).unwrap();
    let covariance = found.covariance.as_ref().unwrap().as_ref().unwrap()[1].pose;
    // Seen from the centroid, a larger scene moves the free camera along the line between the two.
    let along = (found.cameras[1].centre() - found.cameras[0].centre()).normalize();
    let scale = Vector6::from_iterator([0.0; 3].into_iter().chain(along.iter().copied()));
    let (left, whole) = ((covariance * scale).norm(), covariance.norm());
    assert!(left < 1e-9 * whole && whole > 0.0, "{left} {whole}");
}

/// Pairs of points that are this far apart in truth.
fn lengths(room: &Room, sigma: f64) -> Vec<KnownLength> {
    let pair =
        |it: usize| KnownLength { points: [it, it + 1], length: (room.points[it] - room.points[it + 1]).norm(), sigma };
    (0..room.points.len() / 2).map(|it| pair(2 * it)).collect()
}

fn with_lengths(room: &Room, lengths: &[KnownLength], options: &BundleOptions) -> Adjusted {
    let freedoms = vec![Freedom { focal: true, ..Freedom::POSE }; room.start.len()];
    adjust_knowing(
        &room.start,
        &freedoms,
        &room.start_points,
        &room.observations,
        &Known { lengths, ..Known::default() },
        options,
    )
    .unwrap()
}

#[test]
fn known_lengths_bring_the_scale_home() {
    let mut room = room(test_room::cameras(6, 2), 80, 4, 0.0, 0.01, 5);
    // The start is 10 % too large.
    for camera in &mut room.start {
        camera.camera_from_world.translation.vector *= 1.1;
    }
    room.start_points.iter_mut().for_each(|it| it.coords *= 1.1);
    // One length alone is enough; all of them change nothing.
    for lengths in [&lengths(&room, 1e-3)[3..4], &lengths(&room, 1e-3)] {
        let found = with_lengths(&room, lengths, &PRECISE);
        let options = AlignmentOptions { scale: true, robust: false };
        let factor = camera_errors(&found.cameras, &room.truth, options).unwrap().true_from_found.scaling();
        assert!(
            (factor - 1.0).abs() < 1e-6 && found.costs.last().is_some_and(|it| *it < 1e-9),
            "{factor} {:?}",
            found.costs
        );
    }
}

#[test]
fn with_known_lengths_no_change_of_a_camera_or_point_lowers_the_cost() {
    let room = room(test_room::cameras(5, 2), 60, 4, 0.5, 0.01, 6);
    let lengths = lengths(&room, 2e-3);
    let cost = |cameras: &[Camera], points: &[Point3<f64>]| {
        let pixel = |it: &Observation| {
            ((cameras[it.camera].project(&points[it.point]).unwrap() - it.pixel) / 0.5).norm_squared()
        };
        let length =
            |it: &KnownLength| (((points[it.points[0]] - points[it.points[1]]).norm() - it.length) / it.sigma).powi(2);
        0.5 * (room.observations.iter().map(pixel).sum::<f64>() + lengths.iter().map(length).sum::<f64>())
    };
    let found = with_lengths(&room, &lengths, &PRECISE);
    let least = cost(&found.cameras, &found.points);
    assert!((least / found.costs.last().unwrap() - 1.0).abs() < 1e-9 && found.converged());
    let mut random = Random::new(3);
    let mut draw = || Vector3::new(random.normal(), random.normal(), random.normal()) * 1e-4;
    for trial in 0..40 {
        let (mut cameras, mut points) = (found.cameras.clone(), found.points.clone());
        points[trial] += draw();
        cameras[trial % 5] = disturbed(&cameras[trial % 5], &mut Random::new(trial as u64), 1e-5);
        assert!(cost(&cameras, &points) > least);
    }
}

#[test]
fn the_scale_is_as_uncertain_as_the_lengths() {
    let room = room(test_room::cameras(5, 2), 60, 4, 0.01, 0.01, 6);
    let size = |it: &[CameraCovariance]| it.iter().map(|it| it.centre.trace()).sum::<f64>().sqrt();
    let of = |sigma: f64| {
        let options = BundleOptions { covariance: true, ..PRECISE };
        size(&with_lengths(&room, &lengths(&room, sigma), &options).covariance.unwrap().unwrap())
    };
    // With good pixels, poor lengths leave all centres to grow from their midst together.
    let centroid = room.truth.iter().map(|it| it.centre().coords / 5.0).sum::<Vector3<f64>>();
    let lever = room.truth.iter().map(|it| (it.centre().coords - centroid).norm_squared()).sum::<f64>().sqrt();
    let information: f64 = lengths(&room, 0.05).iter().map(|it| (it.length / it.sigma).powi(2)).sum();
    let expected = lever / information.sqrt();
    assert!((0.9..1.6).contains(&(of(0.05) / expected)), "{} {expected}", of(0.05));
    assert!((1.9..2.1).contains(&(of(0.1) / of(0.05))), "{} {}", of(0.1), of(0.05));
}

#[test]
fn lengths_of_nothing_are_refused() {
    let room = room(test_room::cameras(3, 2), 20, 3, 0.5, 0.01, 6);
    let good = KnownLength { points: [0, 1], length: 1.0, sigma: 0.01 };
    let freedoms = vec![Freedom::POSE; 3];
    for bad in [
        KnownLength { points: [0, 0], ..good },
        KnownLength { points: [0, 20], ..good },
        KnownLength { points: [1, 2], ..good },
        KnownLength { points: [2, 3], length: 0.0, ..good },
        KnownLength { points: [2, 3], sigma: f64::NAN, ..good },
    ] {
        let fault = adjust_knowing(
            &room.start,
            &freedoms,
            &room.start_points,
            &room.observations,
            &Known { lengths: &[good, bad], ..Known::default() },
            &BundleOptions::default(),
        );
        let fault = fault.unwrap_err().to_string();
        assert!(fault.starts_with("length 1 is "), "{fault}");
    }
}

#[test]
fn what_is_known_roughly_of_optics_is_in_the_uncertainty_of_the_rest() {
    // Each room's principal points are off what is taken for them, by as much as is said of them.
    let (mut squares, mut held, mut n) = (0.0, 0.0, 0);
    let freedom = Freedom { focal: true, principal: true, ..Freedom::POSE };
    for seed in 0..40 {
        let room = room(test_room::cameras(4, 2), 60, 4, 0.5, 0.002, 300 + seed);
        let mut random = Random::new(seed);
        let mut guesses = room.truth.clone();
        let mut start = room.start.clone();
        for (guess, camera) in guesses.iter_mut().zip(&mut start) {
            guess.intrinsics.principal = guess.intrinsics.principal.map(|it| it + 4.0 * random.normal());
            camera.intrinsics.principal = guess.intrinsics.principal;
        }
        let nothing = OpticsSigma { focal: f64::INFINITY, aspect: 1.0, radial: [1.0; 3], ..OpticsSigma::default() };
        let sigma = OpticsSigma { principal: [4.0; 2], decentering: [1.0; 2], ..nothing };
        let optics: Vec<OpticsPrior> = guesses.into_iter().map(|camera| OpticsPrior { camera, sigma }).collect();
        let options = BundleOptions { covariance: true, ..PRECISE };
        let of = |freedom: Freedom| {
            let known = Known { optics: &optics, ..Known::default() };
            let found = adjust_knowing(&start, &[freedom; 4], &room.start_points, &room.observations, &known, &options)
                .unwrap();
            let sigmas: Vec<f64> =
                found.covariance.as_ref().unwrap().as_ref().unwrap().iter().map(|it| it.optics.focal).collect();
            let error =
                |(found, truth): (&Camera, &Camera)| (found.intrinsics.focal[0] / truth.intrinsics.focal[0]).ln();
            let errors: Vec<f64> = found.cameras.iter().zip(&room.truth).map(error).collect();
            errors.iter().zip(sigmas).map(|(error, sigma)| (error / sigma).powi(2)).sum::<f64>()
        };
        squares += of(freedom);
        held += of(Freedom { principal: false, ..freedom });
        n += 4;
    }
    let (squares, held) = (squares / f64::from(n), held / f64::from(n));
    // χ² of one degree of freedom; focal lengths of one room are correlated, so that its mean is good to some 0.3.
    assert!((0.6..1.4).contains(&squares), "{squares}");
    assert!(held > 2.0 * squares, "taken for certain, the guess does harm that nothing tells of: {held}");
}

#[test]
fn optics_known_of_some_cameras_or_to_no_sigma_are_refused() {
    let room = room(test_room::cameras(3, 2), 20, 3, 0.5, 0.01, 6);
    let guess = OpticsPrior::of_guess(&room.truth[0]);
    let zero = OpticsPrior { sigma: OpticsSigma::default(), ..guess.clone() };
    for (optics, words) in [(vec![guess.clone()], "1 of 3 cameras"), (vec![guess.clone(), guess, zero], "camera 2")] {
        let known = Known { optics: &optics, ..Known::default() };
        let (points, seen) = (&room.start_points, &room.observations);
        let fault = adjust_knowing(&room.start, &[Freedom::POSE; 3], points, seen, &known, &BundleOptions::default());
        let fault = fault.unwrap_err().to_string();
        assert!(fault.starts_with("known optics: ") && fault.contains(words), "{fault}");
    }
}

#[test]
fn a_point_that_ran_away_leaves_the_rest_as_well_known() {
    let mut room = room(test_room::cameras(6, 4), 100, 4, 0.5, 0.01, 15);
    let options = BundleOptions { covariance: true, ..BundleOptions::default() };
    let sigma = |found: &Adjusted| {
        let all = found.covariance.as_ref().unwrap().as_ref().unwrap();
        all.iter().map(|it| it.centre.trace()).sum::<f64>().sqrt()
    };
    let near = sigma(&adjusted(&room, Freedom::POSE, &options));
    // A point on the way to infinity before the cameras that see it.
    let seen = room.observations.iter().find(|it| it.point == 3).map(|it| it.camera).unwrap();
    let away = &room.start[seen];
    let ray = away.camera_from_world.inverse() * nalgebra::Vector3::new(0.0, 0.0, 1e9);
    room.start_points[3] = Point3::from(away.centre().coords + ray);
    let far = sigma(&adjusted(&room, Freedom::POSE, &options));
    assert!((far / near - 1.0).abs() < 0.1, "{far} {near}");
}
