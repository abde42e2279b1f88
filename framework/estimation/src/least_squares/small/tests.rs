//! The small system beside the dense one on the same problem.

use nalgebra::{DVector, Matrix2, Vector1, Vector2};

use super::*;
use crate::least_squares::{Equations, Loss, Options, Problem, Stop, solve};

/// Rosenbrock's valley as residuals, and none at all left of −2.
struct Valley;

impl Valley {
    fn rows(at: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let residual = Vector2::new(10.0 * (at.y - at.x * at.x), 1.0 - at.x);
        (residual, Matrix2::new(-20.0 * at.x, 10.0, -1.0, 0.0))
    }
}

impl SmallProblem<2> for Valley {
    type Parameters = Vector2<f64>;

    fn moved(&self, from: &Vector2<f64>, step: &Vector2<f64>) -> Vector2<f64> {
        from + step
    }

    fn linearise(&self, at: &Vector2<f64>, equations: &mut SmallEquations<2>) -> Option<()> {
        let (residual, jacobian) = Valley::rows(at);
        equations.information += jacobian.tr_mul(&jacobian);
        equations.gradient += jacobian.tr_mul(&residual);
        equations.cost += 0.5 * residual.norm_squared();
        (at.x > -2.0).then_some(())
    }
}

impl Problem for Valley {
    type Parameters = Vector2<f64>;

    fn dimension(&self) -> usize {
        2
    }

    fn moved(&self, from: &Vector2<f64>, step: &DVector<f64>) -> Vector2<f64> {
        from + step.fixed_rows::<2>(0)
    }

    fn linearise(&self, at: &Vector2<f64>, equations: &mut Equations) -> Option<()> {
        let (residual, jacobian) = Valley::rows(at);
        equations.add(&[0, 1], &residual, &jacobian);
        (at.x > -2.0).then_some(())
    }
}

#[test]
fn it_takes_the_same_way_as_the_dense_system() {
    let start = Vector2::new(-1.2, 1.0);
    let small = solve_small(&Valley, start, &DriverOptions::default()).unwrap();
    let dense = solve(&Valley, start, &Options::default()).unwrap();
    assert!((small.parameters - Vector2::new(1.0, 1.0)).norm() < 1e-9, "{small:?}");
    assert!((small.parameters - dense.parameters).norm() < 1e-9);
    assert_eq!((small.outcome.iterations, small.outcome.stop), (dense.iterations, dense.stop));
    let covariance = small.equations.information.try_inverse().unwrap();
    let of_dense = dense.covariance.unwrap();
    assert!((covariance - of_dense.fixed_view::<2, 2>(0, 0)).norm() < 1e-6 * covariance.norm());
}

#[test]
fn a_start_without_residuals_is_refused() {
    let start = Vector2::new(-3.0, 0.0);
    assert_eq!(solve_small(&Valley, start, &DriverOptions::default()).unwrap_err(), SolveError::BadStart);
}

/// The mean of a few numbers, robustly; the second parameter is not seen at all.
struct Mean([f64; 5]);

impl SmallProblem<2> for Mean {
    type Parameters = [f64; 2];

    fn moved(&self, from: &[f64; 2], step: &Vector2<f64>) -> [f64; 2] {
        [from[0] + step[0], from[1] + step[1]]
    }

    fn linearise(&self, at: &[f64; 2], equations: &mut SmallEquations<2>) -> Option<()> {
        for it in self.0 {
            let residual = Vector1::new(at[0] - it);
            let (cost, weight) = Loss::CAUCHY.at(residual.norm_squared());
            equations.cost += 0.5 * cost;
            equations.information[(0, 0)] += weight;
            equations.gradient[0] += weight * residual.x;
        }
        Some(())
    }
}

#[test]
fn losses_enter_by_their_weights_and_what_is_not_seen_stays() {
    let found = solve_small(&Mean([0.9, 1.0, 1.0, 1.1, 1e3]), [0.0, 7.0], &DriverOptions::default()).unwrap();
    assert!((found.parameters[0] - 1.0).abs() < 0.02, "{found:?}");
    assert_eq!((found.parameters[1], found.outcome.stop), (7.0, Stop::SmallGain));
}
