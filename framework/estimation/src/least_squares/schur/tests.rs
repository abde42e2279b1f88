//! The block arrow system beside the dense one on the same problem, and what holds for groups alone.

use nalgebra::{Matrix2, Matrix2x3, UnitVector3, Vector2, Vector3};

use super::*;
use crate::least_squares::{Equations, Options, Problem, Solution, Stop, solve};
use crate::random::Random;

/// A plane seen by sliders: sensor s is at x = shared[2 s] with gain shared[2 s + 1], and measures of point p its place and the gain's
/// multiple of its height squared. Sensor 0's place is held by being known.
#[derive(Clone)]
struct Sliders {
    n_sensors: usize,
    n_points: usize,
    /// Sensor, point, measured.
    measured: Vec<(usize, usize, Vector2<f64>)>,
    sigma: f64,
}

#[derive(Debug, Clone, PartialEq)]
struct State {
    shared: Vec<f64>,
    points: Vec<Vector2<f64>>,
}

type Rows = (Vector2<f64>, Matrix2<f64>, Matrix2<f64>);

impl Sliders {
    fn rows(&self, at: &State, (sensor, point, measured): &(usize, usize, Vector2<f64>)) -> Rows {
        let (place, gain) = (at.shared[2 * sensor], at.shared[2 * sensor + 1]);
        let it = at.points[*point];
        let seen = Vector2::new(it.x - place, gain * it.y * it.y);
        let by_shared = Matrix2::new(-1.0, 0.0, 0.0, it.y * it.y);
        let by_point = Matrix2::new(1.0, 0.0, 0.0, 2.0 * gain * it.y);
        ((seen - measured) / self.sigma, by_shared / self.sigma, by_point / self.sigma)
    }

    /// What is known of sensor 0: rows and values, to 1e-3.
    fn known(at: &State) -> [(usize, f64); 2] {
        [(0, at.shared[0] * 1e3), (1, (at.shared[1] - 1.0) * 1e3)]
    }
}

impl GroupedProblem<2> for Sliders {
    type Parameters = State;

    fn dimension(&self) -> usize {
        2 * self.n_sensors
    }

    fn n_groups(&self) -> usize {
        self.n_points
    }

    fn moved(&self, from: &State, shared: &DVector<f64>, groups: &[Vector2<f64>]) -> State {
        let shared = from.shared.iter().zip(shared.iter()).map(|(a, b)| a + b).collect();
        State { shared, points: from.points.iter().zip(groups).map(|(a, b)| a + b).collect() }
    }

    fn linearise(&self, at: &State, equations: &mut GroupedEquations<2>) -> Option<()> {
        for it in &self.measured {
            let (residual, by_shared, by_point) = self.rows(at, it);
            equations.add(&[Some(2 * it.0), Some(2 * it.0 + 1)], it.1, &residual, (&by_shared, &by_point));
        }
        Sliders::known(at).into_iter().for_each(|(row, value)| equations.add_known(row, value, 1e3));
        Some(())
    }
}

/// The same with all parameters in one list.
struct InOne<'a>(&'a Sliders);

impl Problem for InOne<'_> {
    type Parameters = State;

    fn dimension(&self) -> usize {
        2 * (self.0.n_sensors + self.0.n_points)
    }

    fn moved(&self, from: &State, step: &DVector<f64>) -> State {
        let n = 2 * self.0.n_sensors;
        let of_points: Vec<_> = (0..self.0.n_points).map(|it| step.fixed_rows::<2>(n + 2 * it).into_owned()).collect();
        self.0.moved(from, &step.rows(0, n).into_owned(), &of_points)
    }

    fn linearise(&self, at: &State, equations: &mut Equations) -> Option<()> {
        let n = 2 * self.0.n_sensors;
        for it in &self.0.measured {
            let (residual, by_shared, by_point) = self.0.rows(at, it);
            let mut jacobian = SMatrix::<f64, 2, 4>::zeros();
            jacobian.fixed_columns_mut::<2>(0).copy_from(&by_shared);
            jacobian.fixed_columns_mut::<2>(2).copy_from(&by_point);
            let point = n + 2 * it.1;
            equations.add(&[2 * it.0, 2 * it.0 + 1, point, point + 1], &residual, &jacobian);
        }
        for (row, value) in Sliders::known(at) {
            let mut jacobian = vec![0.0; self.dimension()];
            jacobian[row] = 1e3;
            equations.add_row(value, &jacobian);
        }
        Some(())
    }
}

fn scene(seed: u64, wrong: usize) -> (Sliders, State) {
    let mut random = Random::new(seed);
    let (n_sensors, n_points, sigma) = (4, 12, 0.01);
    let mut shared = vec![0.0, 1.0];
    (1..n_sensors).for_each(|it| shared.extend([it as f64, 1.0 + 0.2 * it as f64]));
    let points: Vec<_> = (0..n_points).map(|_| Vector2::new(random.normal(), random.uniform_in(1.0, 2.0))).collect();
    let mut problem = Sliders { n_sensors, n_points, measured: Vec::new(), sigma: 1.0 };
    let truth = State { shared, points };
    for point in 0..n_points {
        for sensor in (0..n_sensors).filter(|it| (it + point) % 4 != 0) {
            let seen = problem.rows(&truth, &(sensor, point, Vector2::zeros())).0;
            problem.measured.push((sensor, point, seen + Vector2::new(random.normal(), random.normal()) * sigma));
        }
    }
    // Twice by the same sensor.
    problem.measured.extend_from_within(..5);
    problem.measured.iter_mut().step_by(7).take(wrong).for_each(|it| it.2.x += 3.0);
    problem.sigma = sigma;
    (problem, truth)
}

fn off(truth: &State) -> State {
    let shared = truth.shared.iter().map(|it| 1.1 * it + 0.05).collect();
    State { shared, points: truth.points.iter().map(|it| it * 1.2).collect() }
}

#[track_caller]
fn both(problem: &Sliders, start: &State, loss: Loss) -> (GroupedSolution<State, 2>, Solution<State>) {
    let schur = solve_grouped(problem, start.clone(), loss, &DriverOptions::default()).unwrap();
    let options = Options { loss, ..Options::default() };
    (schur, solve(&InOne(problem), start.clone(), &options).unwrap())
}

fn largest_difference(a: &State, b: &State) -> f64 {
    let shared = a.shared.iter().zip(&b.shared).map(|(a, b)| (a - b).abs());
    shared.chain(a.points.iter().zip(&b.points).map(|(a, b)| (a - b).norm())).fold(0.0, f64::max)
}

#[test]
fn it_takes_the_same_steps_as_the_dense_system_and_states_the_same_covariance() {
    for (seed, loss) in [(1, Loss::Squared), (2, Loss::HUBER), (3, Loss::CAUCHY)] {
        let (problem, truth) = scene(seed, if loss == Loss::Squared { 0 } else { 3 });
        let (schur, dense) = both(&problem, &off(&truth), loss);
        assert!(largest_difference(&schur.parameters, &dense.parameters) < 1e-8, "{seed}");
        assert!(largest_difference(&schur.parameters, &truth) < 0.05, "{seed}: {schur:?}");
        let Outcome { cost, stop, iterations } = schur.outcome;
        assert_eq!((stop, iterations), (dense.stop, dense.iterations), "{seed}");
        assert!((cost / dense.costs.last().unwrap() - 1.0).abs() < 1e-9, "{seed}");
        let (covariance, _) = schur.covariance().unwrap();
        let n = covariance.nrows();
        let whole = dense.covariance.unwrap();
        assert!((whole.view((0, 0), (n, n)) - &covariance).norm() < 1e-7 * covariance.norm(), "{seed}");
    }
}

#[test]
fn a_step_solves_the_damped_equations_and_its_predicted_reduction_is_that_of_the_linear_model() {
    let (problem, truth) = scene(4, 0);
    let (here, there) = (GroupedEquations::new(Loss::Squared, 8, 12), GroupedEquations::new(Loss::Squared, 8, 12));
    let (step, of_groups, damping) = (DVector::zeros(8), vec![SVector::zeros(); 12], 0.7);
    let parameters = off(&truth);
    let mut system = Grouped { problem: &problem, parameters, candidate: None, here, there, step, of_groups };
    system.begin().unwrap();
    let predicted = system.solve(damping).unwrap();
    let Grouped { here, step, of_groups, .. } = &system;
    let raise = |diagonal: f64, step: f64| (1.0 + damping) * diagonal * step - diagonal * step;
    let mut of_shared = &here.information * step + &here.gradient;
    let mut by_hand = -here.gradient.dot(step) - 0.5 * step.dot(&(&here.information * step));
    (0..8).for_each(|it| of_shared[it] += raise(here.information[(it, it)], step[it]));
    for (group, own) in here.groups.iter().zip(of_groups) {
        let mut left = group.information * own + group.gradient;
        by_hand -= group.gradient.dot(own) + 0.5 * own.dot(&(group.information * own));
        (0..2).for_each(|it| left[it] += raise(group.information[(it, it)], own[it]));
        for (row, between) in &group.between {
            left += between * step[*row];
            of_shared[*row] += between.dot(own);
            by_hand -= step[*row] * between.dot(own);
        }
        assert!(left.norm() < 1e-9 * group.gradient.norm().max(1.0), "{left}");
    }
    assert!(of_shared.norm() < 1e-9 * here.gradient.norm(), "{of_shared}");
    assert!((predicted / by_hand - 1.0).abs() < 1e-9, "{predicted} {by_hand}");
}

#[test]
fn an_information_weighs_as_a_residual_in_its_standard_deviations_does() {
    let (residual, by_shared) = (Vector2::new(0.3, -2.0), Matrix2::new(1.0, 2.0, 3.0, 4.0));
    let by_group = Matrix2::new(-1.0, 0.5, 2.0, 1.0);
    let [mut of_pixels, mut of_sigmas] = [BlockSum::<2, 2>::zeros(), BlockSum::zeros()];
    of_pixels.add(&Loss::CAUCHY, &residual, (&by_shared, &by_group), 4.0);
    of_sigmas.add(&Loss::CAUCHY, &(residual * 2.0), (&(by_shared * 2.0), &(by_group * 2.0)), 1.0);
    assert!((of_pixels.of_shared - of_sigmas.of_shared).norm() < 1e-12);
    assert!((of_pixels.of_group - of_sigmas.of_group).norm() < 1e-12);
    assert!((of_pixels.between - of_sigmas.between).norm() < 1e-12);
    assert!((of_pixels.gradient_of_shared - of_sigmas.gradient_of_shared).norm() < 1e-12);
    assert!((of_pixels.gradient_of_group - of_sigmas.gradient_of_group).norm() < 1e-12);
    assert!((of_pixels.cost - of_sigmas.cost).abs() < 1e-12);
}

#[test]
fn unobservable_shared_parameters_are_named_and_the_minimum_is_reached_all_the_same() {
    let (mut problem, truth) = scene(5, 0);
    // Of sensor 3 the second number is not measured, and sensor 2 sees nothing.
    problem.measured.retain(|it| it.0 != 2);
    struct Blind(Sliders);
    impl GroupedProblem<2> for Blind {
        type Parameters = State;

        fn dimension(&self) -> usize {
            self.0.dimension()
        }

        fn n_groups(&self) -> usize {
            self.0.n_groups()
        }

        fn moved(&self, from: &State, shared: &DVector<f64>, groups: &[Vector2<f64>]) -> State {
            self.0.moved(from, shared, groups)
        }

        fn linearise(&self, at: &State, equations: &mut GroupedEquations<2>) -> Option<()> {
            for it in &self.0.measured {
                let (residual, by_shared, by_point) = self.0.rows(at, it);
                let gain = (it.0 != 3).then_some(2 * it.0 + 1);
                let by = (&by_shared, &by_point);
                equations.add(&[Some(2 * it.0), gain], it.1, &residual, by);
            }
            Sliders::known(at).into_iter().for_each(|(row, value)| equations.add_known(row, value, 1e3));
            Some(())
        }
    }
    let mut start = off(&truth);
    start.shared[7] = truth.shared[7];
    let unseen = start.shared[4];
    let found = solve_grouped(&Blind(problem), start, Loss::Squared, &DriverOptions::default()).unwrap();
    assert_eq!(found.covariance().unwrap_err(), Unobservable { parameters: vec![4, 5, 7], of: 8 });
    assert!((found.parameters.shared[6] - truth.shared[6]).abs() < 0.05, "{found:?}");
    assert_eq!((found.parameters.shared[4], found.outcome.stop), (unseen, Stop::SmallGain));
}

#[test]
fn groups_without_residuals_or_with_too_few_stay() {
    let (mut problem, truth) = scene(6, 0);
    problem.measured.retain(|it| it.1 != 11);
    let start = off(&truth);
    let found = solve_grouped(&problem, start.clone(), Loss::Squared, &DriverOptions::default()).unwrap();
    assert_eq!(found.parameters.points[11], start.points[11]);
    assert!(found.covariance().unwrap().1[11] == Matrix2::zeros());
}

/// Groups alone: directions on the sphere, each the mean of what was measured of it. Moved on the manifold by a turn.
struct Directions(Vec<(usize, Vector3<f64>)>, usize);

impl GroupedProblem<2> for Directions {
    type Parameters = Vec<UnitVector3<f64>>;

    fn dimension(&self) -> usize {
        0
    }

    fn n_groups(&self) -> usize {
        self.1
    }

    fn moved(&self, from: &Self::Parameters, _: &DVector<f64>, groups: &[Vector2<f64>]) -> Self::Parameters {
        let moved = |(it, step): (&UnitVector3<f64>, &Vector2<f64>)| {
            let across = across(it);
            UnitVector3::new_normalize(it.into_inner() + across * step)
        };
        from.iter().zip(groups).map(moved).collect()
    }

    fn linearise(&self, at: &Self::Parameters, equations: &mut GroupedEquations<2>) -> Option<()> {
        for (group, measured) in &self.0 {
            let residual = at[*group].into_inner() - measured;
            equations.add(&[], *group, &residual, (&SMatrix::<f64, 3, 0>::zeros(), &across(&at[*group])));
        }
        Some(())
    }
}

fn across(direction: &UnitVector3<f64>) -> nalgebra::Matrix3x2<f64> {
    let first =
        UnitVector3::new_normalize(direction.cross(&if direction.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() }));
    Matrix2x3::from_rows(&[first.transpose(), direction.cross(&first).transpose()]).transpose()
}

#[test]
fn groups_alone_are_solved_each_by_itself() {
    let measured = vec![
        (0, Vector3::new(1.0, 0.1, 0.0)),
        (0, Vector3::new(1.0, -0.1, 0.2)),
        (1, Vector3::new(0.0, 0.3, -1.0)),
        (1, Vector3::new(0.1, 0.3, -1.0)),
    ];
    let start = vec![UnitVector3::new_normalize(Vector3::new(0.5, 0.5, 0.5)); 2];
    let found = solve_grouped(&Directions(measured, 2), start, Loss::Squared, &DriverOptions::default()).unwrap();
    for (found, mean) in found.parameters.iter().zip([Vector3::new(2.0, 0.0, 0.2), Vector3::new(0.1, 0.6, -2.0)]) {
        assert!((found.into_inner() - mean.normalize()).norm() < 1e-6, "{found:?}");
    }
    let nothing = Directions(Vec::new(), 0);
    let found = solve_grouped(&nothing, Vec::new(), Loss::Squared, &DriverOptions::default()).unwrap();
    assert!(found.covariance().unwrap().0.is_empty());
    assert_eq!((found.outcome.cost, found.outcome.stop), (0.0, Stop::SmallGain));
    assert!(matches!(
        solve_grouped(&nothing, Vec::new(), Loss::Cauchy { scale: -1.0 }, &DriverOptions::default()).unwrap_err(),
        SolveError::BadOption { found: -1.0, .. }
    ));
}
