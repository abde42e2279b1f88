//! Known curves and rotations found again, wrong data outvoted, open parameters named.

use nalgebra::{Matrix1, Matrix1x3, UnitQuaternion, Vector1, Vector3};

use super::*;
use crate::least_squares::invert_information;
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
    assert!(matches!(refused(&Options { loss, ..options.clone() }), SolveError::BadOption { found: 0.0, .. }));
    assert!(matches!(refused(&Options { relative_gain: f64::NAN, ..options }), SolveError::BadOption { .. }));
}

#[test]
fn a_limit_on_steps_is_told_from_a_minimum() {
    let found = solved(&curve(0.01, 0, 5), &Options { max_iterations: 2, ..Options::default() });
    assert_eq!((found.stop, found.converged()), (Stop::IterationLimit, false));
}

/// A rotation found from directions before and after: the step is a turn about it, q exp(δ).
struct Turned {
    pairs: Vec<(Vector3<f64>, Vector3<f64>)>,
    sigma: f64,
}

impl Problem for Turned {
    type Parameters = UnitQuaternion<f64>;

    fn dimension(&self) -> usize {
        3
    }

    fn moved(&self, from: &UnitQuaternion<f64>, step: &DVector<f64>) -> UnitQuaternion<f64> {
        from * UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(0).into_owned())
    }

    fn linearise(&self, at: &UnitQuaternion<f64>, equations: &mut Equations) -> Option<()> {
        for (before, after) in &self.pairs {
            // q exp(δ) a = q (a + δ × a)
            let jacobian = at.to_rotation_matrix().into_inner() * -before.cross_matrix() / self.sigma;
            equations.add(&[0, 1, 2], &((at * before - after) / self.sigma), &jacobian);
        }
        Some(())
    }
}

#[test]
fn a_rotation_by_nearly_half_a_turn_is_found_on_its_manifold() {
    let (sigma, runs) = (1e-2, 200);
    let mut chi_squared = 0.0;
    for seed in 0..runs {
        let mut random = Random::new(seed);
        let mut vector = |size: f64| Vector3::new(random.normal(), random.normal(), random.normal()) * size;
        let truth = UnitQuaternion::from_scaled_axis(vector(1.0).normalize() * 3.0);
        let pairs = (0..10).map(|_| vector(1.0)).collect::<Vec<_>>();
        let pairs = pairs.into_iter().map(|it| (it, truth * it + vector(sigma))).collect();
        let found = solve(&Turned { pairs, sigma }, UnitQuaternion::identity(), &Options::default()).unwrap();
        let error = (found.parameters.inverse() * truth).scaled_axis();
        let covariance = found.covariance.unwrap();
        chi_squared += error.dot(&(covariance.try_inverse().unwrap() * error)) / runs as f64;
    }
    assert!((2.4..3.6).contains(&chi_squared), "{chi_squared}"); // 3 ± 3.5 σ of 200 draws
}

#[test]
fn a_minimum_without_residuals_is_reached_at_once() {
    let mut clean = curve(0.0, 0, 1);
    clean.sigma = 1.0;
    let found = solve(&clean, TRUTH, &Options::default()).unwrap();
    assert_eq!((found.stop, found.iterations, found.costs.first().copied()), (Stop::SmallGain, 1, Some(0.0)));
    assert_eq!(found.parameters, TRUTH);
}

#[test]
fn without_any_residual_nothing_moves_and_all_is_open() {
    let nothing = Curve { points: Vec::new(), sigma: 1.0 };
    let found = solve(&nothing, [1.0, 2.0, 3.0], &Options::default()).unwrap();
    assert_eq!(found.parameters, [1.0, 2.0, 3.0]);
    assert_eq!(found.covariance, Err(Unobservable { parameters: vec![0, 1, 2], of: 3 }));
    assert!(found.variance_factor.is_nan());
}

/// A straight line whose residual is no number beyond 1.
struct Cliff;

impl Problem for Cliff {
    type Parameters = f64;

    fn dimension(&self) -> usize {
        1
    }

    fn moved(&self, from: &f64, step: &DVector<f64>) -> f64 {
        from + step[0]
    }

    fn linearise(&self, at: &f64, equations: &mut Equations) -> Option<()> {
        equations.add_row(if *at > 1.0 { f64::NAN } else { at - 3.0 }, &[1.0]);
        Some(())
    }
}

#[test]
fn a_step_to_residuals_that_are_no_numbers_is_taken_back() {
    let found = solve(&Cliff, 0.0, &Options::default()).unwrap();
    assert!(found.parameters <= 1.0 && found.parameters > 0.9, "{found:?}");
    assert_eq!(solve(&Cliff, 2.0, &Options::default()).unwrap_err(), SolveError::BadStart);
}

#[test]
fn an_average_has_the_same_minimum_and_a_cost_for_each_residual() {
    struct Average(Curve);
    impl Problem for Average {
        type Parameters = [f64; 3];

        fn dimension(&self) -> usize {
            3
        }

        fn moved(&self, from: &[f64; 3], step: &DVector<f64>) -> [f64; 3] {
            self.0.moved(from, step)
        }

        fn linearise(&self, at: &[f64; 3], equations: &mut Equations) -> Option<()> {
            self.0.linearise(at, equations)?;
            equations.average();
            Some(())
        }
    }
    let sum = solved(&curve(0.05, 0, 6), &Options::default());
    let mean = solve(&Average(curve(0.05, 0, 6)), [1.0, -0.1, 0.0], &Options::default()).unwrap();
    for (a, b) in sum.parameters.iter().zip(mean.parameters) {
        assert!((a - b).abs() < 1e-6, "{a} {b}");
    }
    assert!((sum.costs.last().unwrap() / mean.costs.last().unwrap() - 100.0).abs() < 1e-6);
    let (sum, mean) = (sum.covariance.unwrap(), mean.covariance.unwrap());
    assert!((mean[(0, 0)] / sum[(0, 0)] - 100.0).abs() < 1e-3);
}

#[test]
fn what_others_explain_to_twelve_digits_is_open() {
    let tied = |rest: f64| DMatrix::from_row_slice(2, 2, &[4.0, 2.0 - rest, 2.0 - rest, 1.0]);
    assert_eq!(invert_information(&tied(1e-14)), Err(vec![1]));
    assert!(invert_information(&tied(1e-9)).is_ok());
}
