//! Known curves found again, wrong data outvoted, open parameters named.

use nalgebra::{Matrix1, Matrix1x3, Vector1};

use super::*;
use crate::random::Random;

/// y = a exp(b x) + c, with σ.
struct Curve {
    points: Vec<(f64, f64)>,
    sigma: f64,
}

impl Problem for Curve {
    type Parameters = [f64; 3];

    fn dimension(&self) -> usize {
        3
    }

    fn moved(&self, from: &[f64; 3], step: &DVector<f64>) -> [f64; 3] {
        [from[0] + step[0], from[1] + step[1], from[2] + step[2]]
    }

    fn linearise(&self, at: &[f64; 3], equations: &mut Equations) -> Option<()> {
        for (x, y) in &self.points {
            let grown = (at[1] * x).exp();
            let residual = Vector1::new((at[0] * grown + at[2] - y) / self.sigma);
            let jacobian = Matrix1x3::new(grown, at[0] * x * grown, 1.0) / self.sigma;
            equations.add(&[0, 1, 2], &residual, &jacobian);
        }
        Some(())
    }
}

const TRUTH: [f64; 3] = [2.0, -0.7, 0.5];

fn curve(sigma: f64, wrong: usize, seed: u64) -> Curve {
    let mut random = Random::new(seed);
    let mut points: Vec<(f64, f64)> = (0..100)
        .map(|it| {
            let x = 0.05 * f64::from(it);
            (x, TRUTH[0] * (TRUTH[1] * x).exp() + TRUTH[2] + sigma * random.normal())
        })
        .collect();
    points.iter_mut().step_by(3).take(wrong).for_each(|it| it.1 += 20.0);
    Curve { points, sigma }
}

#[track_caller]
fn solved(curve: &Curve, options: &Options) -> Solution<[f64; 3]> {
    solve(curve, [1.0, -0.1, 0.0], options).unwrap()
}

#[test]
fn a_clean_curve_is_found_to_the_last_digits() {
    let mut clean = curve(0.0, 0, 1);
    clean.sigma = 1.0;
    let found = solved(&clean, &Options::default());
    assert!(found.converged() && found.costs.is_sorted_by(|a, b| a >= b), "{found:?}");
    for (found, truth) in found.parameters.iter().zip(TRUTH) {
        assert!((found - truth).abs() < 1e-8, "{found} {truth}");
    }
}

#[test]
fn errors_are_as_large_as_the_covariance_says() {
    let runs = 300;
    let (mut chi_squared, mut factor) = (0.0, 0.0);
    for seed in 0..runs {
        let found = solved(&curve(0.05, 0, seed), &Options::default());
        let error = DVector::from_fn(3, |row, _| found.parameters[row] - TRUTH[row]);
        chi_squared += error.dot(&(found.covariance.unwrap().try_inverse().unwrap() * &error));
        factor += found.variance_factor;
    }
    let (chi_squared, factor) = (chi_squared / runs as f64, factor / runs as f64);
    assert!((2.55..3.45).contains(&chi_squared), "{chi_squared}"); // 3 ± 4 σ of 300 draws
    assert!((0.96..1.04).contains(&factor), "{factor}");
}

#[test]
fn robust_losses_outvote_one_wrong_value_in_five() {
    let error = |loss: Loss| {
        let found = solved(&curve(0.05, 20, 4), &Options { loss, ..Options::default() });
        (found.parameters[0] - TRUTH[0]).abs() + (found.parameters[2] - TRUTH[2]).abs()
    };
    assert!(error(Loss::Squared) > 1.0);
    assert!(error(Loss::HUBER) < 0.3, "{}", error(Loss::HUBER));
    assert!(error(Loss::CAUCHY) < 0.1, "{}", error(Loss::CAUCHY));
}

#[test]
fn held_parameters_stay() {
    let found = solved(&curve(0.01, 0, 5), &Options { held: vec![1], ..Options::default() });
    assert_eq!(found.parameters[1], -0.1);
    let covariance = found.covariance.unwrap();
    assert!(covariance.row(1).iter().all(|it| *it == 0.0) && covariance[(0, 0)] > 0.0);
}

/// Only p₀ + p₁ is seen, and p₂ not at all.
struct Sum;

impl Problem for Sum {
    type Parameters = DVector<f64>;

    fn dimension(&self) -> usize {
        3
    }

    fn moved(&self, from: &DVector<f64>, step: &DVector<f64>) -> DVector<f64> {
        from + step
    }

    fn linearise(&self, at: &DVector<f64>, equations: &mut Equations) -> Option<()> {
        equations.add_row(at[0] + at[1] - 3.0, &[1.0, 1.0, 0.0]);
        equations.add_row(2.0 * (at[0] + at[1] - 3.0), &[2.0, 2.0, 0.0]);
        Some(())
    }
}

#[test]
fn open_parameters_are_named_and_the_minimum_is_reached_all_the_same() {
    let found = solve(&Sum, DVector::zeros(3), &Options::default()).unwrap();
    assert!((found.parameters[0] + found.parameters[1] - 3.0).abs() < 1e-6, "{found:?}");
    assert_eq!(found.covariance, Err(Unobservable { parameters: vec![1, 2], of: 3 }));
    let held = solve(&Sum, DVector::zeros(3), &Options { held: vec![1, 2], ..Options::default() }).unwrap();
    assert!((held.covariance.unwrap()[(0, 0)] - 0.2).abs() < 1e-12);
}

/// Has residuals for positive values only; the least is at 0.01.
struct Positive;

impl Problem for Positive {
    type Parameters = f64;

    fn dimension(&self) -> usize {
        1
    }

    fn moved(&self, from: &f64, step: &DVector<f64>) -> f64 {
        from + step[0]
    }

    fn linearise(&self, at: &f64, equations: &mut Equations) -> Option<()> {
        if *at <= 0.0 {
            return None;
        }
        equations.add(&[0], &Vector1::new(at.ln() - 0.01_f64.ln()), &Matrix1::new(1.0 / at));
        Some(())
    }
}

#[test]
fn a_step_to_where_nothing_is_defined_is_taken_back() {
    let found = solve(&Positive, 5.0, &Options::default()).unwrap();
    assert!(found.iterations as usize >= found.costs.len());
    assert!((found.parameters - 0.01).abs() < 1e-9, "{}", found.parameters);
}

#[test]
fn what_cannot_be_solved_is_refused_with_the_reason() {
    let options = Options::default();
    assert_eq!(solve(&Positive, -1.0, &options).unwrap_err(), SolveError::BadStart);
    assert_eq!(solve(&Positive, f64::NAN, &options).unwrap_err(), SolveError::BadStart);
    let refused = |options: &Options| solve(&Positive, 1.0, options).unwrap_err();
    assert_eq!(refused(&Options { held: vec![0], ..options.clone() }), SolveError::NothingFree { dimension: 1 });
    assert_eq!(
        refused(&Options { held: vec![7], ..options.clone() }),
        SolveError::NoSuchParameter { index: 7, dimension: 1 }
    );
    let loss = Loss::Cauchy { scale: 0.0 };
    assert!(matches!(refused(&Options { loss, ..options.clone() }), SolveError::BadRule { found: 0.0, .. }));
    assert!(matches!(refused(&Options { relative_gain: f64::NAN, ..options }), SolveError::BadRule { .. }));
}

#[test]
fn a_limit_on_steps_is_told_from_a_minimum() {
    let found = solved(&curve(0.01, 0, 5), &Options { max_iterations: 2, ..Options::default() });
    assert_eq!((found.stop, found.converged()), (Stop::IterationLimit, false));
}
