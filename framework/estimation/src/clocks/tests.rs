//! Clocks recovered while lights are tracked: open and closed loop, wrong associations, lights at rest.

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Point3, Rotation3, Vector2, Vector3};

use super::*;
use crate::kalman::ConstantVelocity;
use crate::random::Random;

/// A camera of 500 px of focal length on a ring, looking at the middle of the room.
struct Camera {
    from_world: Rotation3<f64>,
    centre: Point3<f64>,
}

impl Camera {
    fn on_ring(angle: f64, height_m: f64) -> Camera {
        let centre = Point3::new(3.5 * angle.cos(), 3.5 * angle.sin(), height_m);
        let from_world = Rotation3::look_at_rh(&(Point3::new(0.0, 0.0, 1.1) - centre), &Vector3::z());
        Camera { from_world, centre }
    }

    fn project(&self, point: &Point3<f64>) -> (Vector2<f64>, Matrix2x3<f64>) {
        let seen = self.from_world * (point - self.centre);
        let (x, y, z) = (seen.x, seen.y, -seen.z);
        let by_seen = Matrix2x3::new(1.0, 0.0, x / z, 0.0, 1.0, y / z) * (500.0 / z);
        (Vector2::new(x, y) * (500.0 / z), by_seen * self.from_world.matrix())
    }
}

/// A person who walks a circle, and whose wrists swing. `pace` scales all speeds.
fn place(target: usize, time_s: f64, pace: f64) -> Point3<f64> {
    let t = time_s * pace;
    let walked = Vector3::new(1.1 * t.cos(), 0.9 * (t + 0.4).sin(), 1.2 + 0.03 * (11.0 * t).sin());
    let side = if target == 1 { 1.0 } else { -1.0 };
    let swing = if target == 0 {
        Vector3::zeros()
    } else {
        Vector3::new(
            0.25 * (6.0 * t).sin() * side,
            0.2 * side + 0.15 * (5.0 * t).cos(),
            0.2 * (6.5 * t + side).sin() - 0.3,
        )
    };
    Point3::from(walked + swing)
}

#[derive(Clone, Copy)]
struct Scene {
    n_cameras: usize,
    /// Offsets and drifts are uniform within plus and minus these.
    offset_s: f64,
    drift: f64,
    pace: f64,
    seconds: f64,
    /// Whether stamps are corrected by the estimate.
    corrected: bool,
    /// Part of the measurements that is of something else, 15 px away; the clocks see them, the filter is spared.
    wrong_share: f64,
}

const SCENE: Scene =
    Scene { n_cameras: 12, offset_s: 0.02, drift: 100e-6, pace: 1.0, seconds: 20.0, corrected: true, wrong_share: 0.0 };

/// Errors of the offsets at the end, with the mean taken out [s], and in standard deviations that were stated.
struct Recovered {
    rms_s: f64,
    worst_s: f64,
    in_sigmas: f64,
    drift_rms: f64,
    mean_speed: f64,
}

fn track(scene: &Scene, seed: u64) -> Recovered {
    let mut random = Random::new(seed);
    let n = scene.n_cameras;
    let angle = |camera: usize| std::f64::consts::TAU * camera as f64 / n as f64;
    let cameras: Vec<Camera> = (0..n).map(|it| Camera::on_ring(angle(it), 1.0 + 1.5 * random.uniform())).collect();
    let offsets: Vec<f64> = (0..n).map(|_| random.uniform_in(-scene.offset_s, scene.offset_s)).collect();
    let drifts: Vec<f64> = (0..n).map(|_| random.uniform_in(-scene.drift, scene.drift)).collect();
    let phases: Vec<f64> = (0..n).map(|_| random.uniform() / 60.0).collect();
    let mut frames: Vec<(f64, usize)> = Vec::new();
    for (camera, phase) in phases.iter().enumerate() {
        frames.extend((0..(60.0 * scene.seconds) as usize).map(|k| (k as f64 / 60.0 + phase, camera)));
    }
    frames.sort_by(|a, b| a.0.total_cmp(&b.0));

    let sigma_px = 0.3;
    let noise = Matrix2::identity() * sigma_px * sigma_px;
    let settings =
        ClockSettings { offset_sigma_s: scene.offset_s, drift_sigma: scene.drift, ..ClockSettings::default() };
    let mut clocks = ClockEstimator::new(n, settings);
    let start = |target| ConstantVelocity::new(place(target, 0.0, scene.pace), Matrix3::identity() * 1e-4, 1.5);
    let mut filters: Vec<(ConstantVelocity, f64)> = (0..3).map(|it| (start(it), 0.0)).collect();
    let (mut speeds, mut last_s) = (0.0, 0.0);
    let mut pending: Vec<(f64, usize)> = Vec::new();
    let mut arriving = frames.iter();
    loop {
        // A tracker waits a little and takes frames in the order of their stamps.
        let of_frame = |clocks: &ClockEstimator, (time_s, camera): (f64, usize)| {
            let stamp_s = time_s + offsets[camera] + drifts[camera] * time_s;
            let estimate = clocks.estimate(camera, stamp_s).unwrap();
            let applied = if scene.corrected { estimate.offset_s } else { 0.0 };
            (stamp_s, applied, estimate.mean_squared_error(applied))
        };
        while pending.len() < 9 * n
            && let Some(frame) = arriving.next()
        {
            pending.push(*frame);
        }
        let seen_at = |frame: &(f64, usize)| {
            let (stamp_s, applied, _) = of_frame(&clocks, *frame);
            stamp_s - applied
        };
        let Some(next) = (0..pending.len()).min_by(|a, b| seen_at(&pending[*a]).total_cmp(&seen_at(&pending[*b])))
        else {
            break;
        };
        let (time_s, camera) = &pending.swap_remove(next);
        let (stamp_s, applied, doubt) = of_frame(&clocks, (*time_s, *camera));
        for (target, (filter, filter_s)) in filters.iter_mut().enumerate() {
            let seen_s = stamp_s - applied;
            // Clocks disagree, so a frame may seem older than the filter: it is compared with where the target was then.
            if seen_s > *filter_s {
                let density = [4.0, 40.0, 40.0][target] * scene.pace.powi(3);
                assert!(filter.predict(seen_s - *filter_s, density));
                *filter_s = seen_s;
            }
            let (pixel, _) = cameras[*camera].project(&place(target, *time_s, scene.pace));
            let mut measured = pixel + Vector2::new(random.normal(), random.normal()) * sigma_px;
            let wrong = random.uniform() < scene.wrong_share;
            if wrong {
                measured += Vector2::new(random.normal(), random.normal()) * 15.0;
            }
            let (expected, jacobian) = cameras[*camera].project(&filter.position_after(seen_s - *filter_s));
            let image_velocity = jacobian * filter.velocity;
            let noise = noise + image_velocity * image_velocity.transpose() * doubt;
            let seen = ClockObservation {
                stamp_s,
                applied_offset_s: applied,
                innovation: measured - expected,
                innovation_covariance: filter.innovation_covariance(&jacobian, &noise),
                image_velocity,
            };
            assert!(clocks.observe(*camera, &seen));
            if !wrong {
                filter.update_pixel(seen.innovation, &jacobian, &noise);
            }
            speeds += filter.velocity.norm();
        }
        last_s = *time_s;
    }
    let truth: Vec<f64> = (0..n).map(|it| offsets[it] + drifts[it] * last_s).collect();
    let found: Vec<ClockEstimate> = (0..n).map(|it| clocks.estimate(it, last_s + truth[it]).unwrap()).collect();
    let centred = |values: Vec<f64>| {
        let mean = values.iter().sum::<f64>() / n as f64;
        values.into_iter().map(|it| it - mean).collect::<Vec<f64>>()
    };
    let rms = |values: &[f64]| (values.iter().map(|it| it * it).sum::<f64>() / values.len() as f64).sqrt();
    let errors = centred((0..n).map(|it| found[it].offset_s - truth[it]).collect());
    let drift_errors = centred((0..n).map(|it| found[it].drift - drifts[it]).collect());
    let normalised: Vec<f64> = errors.iter().zip(&found).map(|(error, it)| error / it.offset_sigma_s).collect();
    Recovered {
        rms_s: rms(&errors),
        worst_s: errors.iter().fold(0.0, |most, it| most.max(it.abs())),
        in_sigmas: rms(&normalised),
        drift_rms: rms(&drift_errors),
        mean_speed: speeds / (3 * frames.len()) as f64,
    }
}

/// RMS over so many scenes, in ms, and of the errors in standard deviations.
fn over_scenes(scene: &Scene, n_scenes: u64) -> (f64, f64, Recovered) {
    let all: Vec<Recovered> = (0..n_scenes).map(|seed| track(scene, seed)).collect();
    let mean = |of: &dyn Fn(&Recovered) -> f64| all.iter().map(of).sum::<f64>() / n_scenes as f64;
    let worst = all.iter().fold(0.0, |most, it| it.worst_s.max(most));
    let (rms_ms, in_sigmas) = (1e3 * mean(&|it| it.rms_s.powi(2)).sqrt(), mean(&|it| it.in_sigmas.powi(2)).sqrt());
    let drift_rms = mean(&|it| it.drift_rms.powi(2)).sqrt();
    let mean_speed = mean(&|it| it.mean_speed);
    println!(
        "{} cameras, ±{} ms, {} % wrong, {mean_speed:.2} m/s, {}: {rms_ms:.2} ms (worst {:.2}), {in_sigmas:.1} sigma, {:.0} ppm",
        scene.n_cameras,
        1e3 * scene.offset_s,
        1e2 * scene.wrong_share,
        if scene.corrected { "corrected" } else { "as stamped" },
        1e3 * worst,
        1e6 * drift_rms,
    );
    (rms_ms, in_sigmas, Recovered { rms_s: rms_ms / 1e3, worst_s: worst, in_sigmas, drift_rms, mean_speed })
}

#[test]
fn offsets_are_recovered_while_tracking_with_corrected_stamps() {
    for n_cameras in [6, 12, 18] {
        for offset_s in [0.005, 0.02, 0.05] {
            let (rms_ms, in_sigmas, all) = over_scenes(&Scene { n_cameras, offset_s, ..SCENE }, 3);
            assert!(rms_ms < 0.25 && all.worst_s < 0.6e-3 && all.drift_rms < 20e-6, "{n_cameras} {offset_s}: {rms_ms}");
            assert!((0.2..1.3).contains(&in_sigmas), "{n_cameras} {offset_s}: {in_sigmas}");
        }
    }
}

#[test]
fn small_offsets_are_recovered_without_correction_too_and_large_ones_are_not() {
    for n_cameras in [6, 12, 18] {
        let rms_ms = |offset_s| over_scenes(&Scene { n_cameras, offset_s, corrected: false, ..SCENE }, 3).0;
        let [small, middle, _large] = [0.005, 0.02, 0.05].map(rms_ms);
        assert!(small < 1.2, "{n_cameras}: {small}");
        assert!(middle < 8.0, "{n_cameras}: {middle}");
    }
}

#[test]
fn wrong_associations_do_little_harm() {
    for wrong_share in [0.05, 0.1] {
        let (rms_ms, _, all) = over_scenes(&Scene { wrong_share, ..SCENE }, 3);
        assert!(rms_ms < 0.5 && all.worst_s < 2e-3, "{rms_ms}");
    }
}

#[test]
fn the_faster_the_target_the_better_until_the_filter_cannot_follow() {
    let at = |pace| over_scenes(&Scene { pace, ..SCENE }, 3);
    let [still, slow, walking, hurrying, running] = [0.03, 0.1, 0.3, 1.0, 3.0].map(at);
    assert!(still.0 > slow.0 && slow.0 > walking.0 && walking.0 > hurrying.0);
    assert!(still.0 < 3.0 && slow.0 < 1.2 && hurrying.0 < 0.2 && running.0 < 3.0);
    // Slow targets say little, and that is known.
    assert!(still.1 < 1.3 && slow.1 < 1.3);
}

fn settings() -> ClockSettings {
    ClockSettings::default()
}

/// What a camera sees of a target whose place is known, if its clock is ahead by so much.
fn seen(stamp_s: f64, offset_s: f64, applied_offset_s: f64, image_velocity: Vector2<f64>) -> ClockObservation {
    let innovation = -image_velocity * (offset_s - applied_offset_s);
    ClockObservation {
        stamp_s,
        applied_offset_s,
        innovation,
        innovation_covariance: Matrix2::new(0.2, 0.05, 0.05, 0.1),
        image_velocity,
    }
}

#[test]
fn a_clock_that_is_ahead_has_a_positive_offset_corrected_or_not() {
    // Camera 0 is the reference, and right; camera 1 is 8 ms ahead and gains 40 ppm.
    for corrected in [false, true] {
        let mut clocks = ClockEstimator::new(2, ClockSettings { reference: Some(0), ..settings() });
        let truth = |stamp_s: f64| 0.008 + 40e-6 * stamp_s;
        for step in 0..6000 {
            let stamp_s = f64::from(step) / 60.0;
            let velocity = Vector2::new(300.0 * stamp_s.sin(), 200.0 * stamp_s.cos());
            assert!(clocks.observe(0, &seen(stamp_s, 0.0, 0.0, velocity)));
            let applied = if corrected { clocks.estimate(1, stamp_s).unwrap().offset_s } else { 0.0 };
            assert!(clocks.observe(1, &seen(stamp_s, truth(stamp_s), applied, velocity)));
        }
        let found = clocks.estimate(1, 101.0).unwrap();
        assert!((found.offset_s - truth(101.0)).abs() < 0.05e-3, "{corrected} {found:?}");
        assert!((found.drift - 40e-6).abs() < 3e-6 && found.offset_sigma_s < 0.3e-3, "{corrected} {found:?}");
        assert_eq!(found.n_observations, 6000);
        let reference = clocks.estimate(0, 101.0).unwrap();
        assert_eq!((reference.offset_s, reference.offset_sigma_s, reference.drift), (0.0, 0.0, 0.0));
        let expected = (found.offset_s - 0.001).powi(2) + found.offset_sigma_s.powi(2);
        assert!((found.mean_squared_error(0.001) - expected).abs() < 1e-15);
    }
}

#[test]
fn the_weighted_mean_offset_is_zero_whatever_was_seen() {
    let mut random = Random::new(5);
    let mut clocks = ClockEstimator::new(5, settings());
    for step in 0..20_000 {
        let camera = random.below(4) as usize; // camera 4 sees nothing
        let velocity = Vector2::new(random.normal(), random.normal()) * if camera == 3 { 0.5 } else { 300.0 };
        let stamp_s = f64::from(step) * 1e-3 + 1e6;
        assert!(clocks.observe(camera, &seen(stamp_s, 0.01 * camera as f64, 0.0, velocity)));
    }
    let at = 1e6 + 21.0;
    let found: Vec<ClockEstimate> = (0..5).map(|it| clocks.estimate(it, at).unwrap()).collect();
    let weighted = |of: &dyn Fn(&ClockEstimate) -> f64| -> f64 {
        found.iter().zip(&clocks.clocks).map(|(it, clock)| of(it) * clock.weight).sum()
    };
    assert!(weighted(&|it| it.offset_s).abs() < 1e-9 && weighted(&|it| it.drift).abs() < 1e-9);
    assert!(clocks.clocks[0].weight > 0.9 && clocks.clocks[3].weight < clocks.clocks[0].weight);
    assert!((found[2].offset_s - found[0].offset_s - 0.02).abs() < 0.2e-3, "{found:?}");
    assert_eq!(found[4], ClockEstimate { drift: 0.0, ..ClockEstimator::new(1, settings()).estimate(0, at).unwrap() });
    assert_eq!((found[4].offset_s, found[4].offset_sigma_s), (0.0, settings().offset_sigma_s));
}

#[test]
fn a_target_at_rest_says_nothing() {
    let mut clocks = ClockEstimator::new(1, ClockSettings { offset_walk_s: 0.0, drift_sigma: 0.0, ..settings() });
    for step in 0..100 {
        let still = ClockObservation {
            innovation: Vector2::new(0.3, 0.2),
            ..seen(f64::from(step), 0.0, 0.0, Vector2::zeros())
        };
        assert!(clocks.observe(0, &still));
    }
    let found = clocks.estimate(0, 99.0).unwrap();
    assert_eq!(found.offset_s, 0.0);
    assert!((found.offset_sigma_s - settings().offset_sigma_s).abs() < 1e-3);
}

#[test]
fn what_cannot_be_is_refused_and_changes_nothing() {
    let mut clocks = ClockEstimator::new(2, settings());
    let good = seen(1.0, 0.005, 0.0, Vector2::new(300.0, 100.0));
    assert!(clocks.observe(0, &good));
    let before = clocks.clone();
    assert!(!clocks.observe(2, &good));
    assert_eq!(clocks.estimate(2, 1.0), None);
    let bad = f64::NAN;
    for broken in [
        ClockObservation { stamp_s: bad, ..good },
        ClockObservation { stamp_s: f64::INFINITY, ..good },
        ClockObservation { applied_offset_s: bad, ..good },
        ClockObservation { innovation: Vector2::new(bad, 0.0), ..good },
        ClockObservation { image_velocity: Vector2::new(0.0, bad), ..good },
        ClockObservation { image_velocity: Vector2::new(1e200, 0.0), ..good },
        ClockObservation { innovation_covariance: Matrix2::zeros(), ..good },
        ClockObservation { innovation_covariance: Matrix2::identity() * bad, ..good },
        ClockObservation { innovation_covariance: Matrix2::identity() * -1.0, ..good },
    ] {
        assert!(!clocks.observe(0, &broken), "{broken:?}");
        assert!(!clocks.observe(1, &broken), "{broken:?}");
    }
    assert_eq!(clocks, before);
    // A stamp from before: taken, and time does not run backwards.
    assert!(clocks.observe(0, &ClockObservation { stamp_s: 0.5, ..good }));
    assert_eq!(clocks.clocks[0].stamp_s, 1.0);
    assert!(clocks.estimate(0, 1.0).unwrap().offset_s.is_finite());
}
