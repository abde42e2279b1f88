//! Times the Kalman filter and the assignments; the best of several rounds, in ns a call.

use std::hint::black_box;
use std::time::Instant;

use foveate_estimation::{ConstantVelocity, Random, Workspace, nearest_greedy, optimal};
use nalgebra::{Matrix2, Matrix2x3, Matrix3, Point3, Vector2};

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
