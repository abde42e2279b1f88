//! Times the Kalman filter and the assignments; the best of several rounds, in ns a call.

use std::hint::black_box;
use std::time::Instant;

use foveate_estimation::{
    AdaptiveNoise, ClockEstimator, ClockObservation, ClockSettings, Consistency, ConstantVelocity, Filter, Interacting,
    Mode, Model, Random, Workspace, nearest_greedy, optimal,
};
use nalgebra::{Matrix2, Matrix2x3, Matrix3, Point3, Vector2, Vector3};

const ROUNDS: usize = 50;

fn time<T>(name: &str, calls: usize, mut call: impl FnMut(usize) -> T) {
    let round = |call: &mut dyn FnMut(usize) -> T| {
        let start = Instant::now();
        (0..calls).for_each(|index| drop(black_box(call(index))));
        start.elapsed().as_nanos() as f64 / calls as f64
    };
    let best = (0..ROUNDS).map(|_| round(&mut call)).fold(f64::INFINITY, f64::min);
    println!("{name:<34} {best:8.1} ns");
}

fn main() {
    let mut random = Random::new(1);
    let mut filters = vec![ConstantVelocity::new(Point3::origin(), Matrix3::identity(), 1.0); 8];
    let noise = Matrix2::identity() * 0.01;
    let jacobians: Vec<Matrix2x3<f64>> = (0..6).map(|_| Matrix2x3::from_fn(|_, _| 200.0 * random.normal())).collect();
    time("predict", 20_000, |it| filters[it % 8].predict(1e-6, 1.0));
    time("innovation_covariance", 20_000, |it| filters[it % 8].innovation_covariance(&jacobians[it % 6], &noise));
    time("predict and update_pixel", 20_000, |it| {
        filters[it % 8].predict(1e-3, 1.0);
        filters[it % 8].update_pixel(Vector2::new(0.1, -0.1), &jacobians[it % 6], &noise)
    });
    time("update_pixel", 20_000, |it| {
        filters[it % 8].update_pixel(Vector2::new(0.1, -0.1), &jacobians[it % 6], &noise)
    });
    let quiet = Mode::ConstantVelocity { acceleration_density: 0.1 };
    let agile = Mode::ConstantVelocity { acceleration_density: 10.0 };
    let turning = Mode::ConstantAcceleration { jerk_density: 100.0, acceleration_sigma: 5.0 };
    let interacting = |modes: &[(Mode, f64)]| Model::Interacting(Interacting::new(modes).expect("a model"));
    for (name, model) in [
        ("constant velocity", quiet.into()),
        ("constant acceleration", turning.into()),
        ("quiet + agile", interacting(&[(quiet, 1.0), (agile, 0.3)])),
        ("quiet + accelerating", interacting(&[(quiet, 1.0), (turning, 0.3)])),
        ("all three", interacting(&[(quiet, 1.0), (agile, 0.3), (turning, 0.3)])),
    ] {
        let one = Filter::new(&model, Point3::origin(), Matrix3::identity(), Vector3::zeros(), 1.0);
        let mut filters = vec![one; 8];
        time(&format!("both, {name}"), 20_000, |it| {
            filters[it % 8].predict(1e-3);
            filters[it % 8].update_pixel(Vector2::new(0.1, -0.1), &jacobians[it % 6], &noise)
        });
    }
    let mut adapted = AdaptiveNoise::new(0.25);
    time("AdaptiveNoise, observe and scale", 20_000, |it| {
        adapted.observe((it % 5) as f64, 2, 1e-3);
        adapted.scale()
    });
    let mut consistency = Consistency::default();
    time("Consistency, observe", 20_000, |it| consistency.observe((it % 5) as f64, 2));
    let mut clocks = ClockEstimator::new(18, ClockSettings::default());
    let mut seen = ClockObservation {
        stamp_s: 0.0,
        applied_offset_s: 0.0,
        innovation: Vector2::new(0.2, -0.1),
        innovation_covariance: Matrix2::identity() * 0.1,
        image_velocity: Vector2::new(200.0, 100.0),
    };
    time("ClockEstimator, estimate and observe", 20_000, |it| {
        seen.stamp_s += 1e-3;
        let estimate = clocks.estimate(it % 18, seen.stamp_s);
        clocks.observe(it % 18, &seen);
        estimate
    });
    let (mut workspace, mut assigned) = (Workspace::default(), Vec::new());
    for n in [8, 64] {
        let costs: Vec<f64> = (0..n * n).map(|_| random.uniform_in(0.0, 20.0)).collect();
        let calls = 100_000 / (n * n);
        time(&format!("optimal, {n} x {n}"), calls, |_| optimal(&costs, n, n, 9.2, &mut workspace, &mut assigned));
        time(&format!("nearest_greedy, {n} x {n}"), calls, |_| {
            nearest_greedy(&costs, n, n, 9.2, &mut workspace, &mut assigned);
        });
    }
    time("Random::normal", 20_000, |_| random.normal());
}
