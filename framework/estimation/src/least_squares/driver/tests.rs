//! A system that answers by a script: every rule of damping and termination by its numbers.

use super::*;

/// What one step is to look like: predicted reduction and cost after it.
type Answer = (Option<f64>, Option<f64>);

struct Script {
    start: Option<f64>,
    answers: Vec<Answer>,
    tried: usize,
    accepted: Vec<usize>,
}

impl System for Script {
    fn begin(&mut self) -> Option<f64> {
        self.start
    }

    fn solve(&mut self, _damping: f64) -> Option<f64> {
        self.tried += 1;
        self.answers[(self.tried - 1) % self.answers.len()].0
    }

    fn attempt(&mut self) -> Option<f64> {
        self.answers[(self.tried - 1) % self.answers.len()].1
    }

    fn accept(&mut self) {
        self.accepted.push(self.tried);
    }
}

fn options() -> DriverOptions {
    let damping = Damping { initial: 1.0, ..Damping::default() };
    DriverOptions { damping, relative_gain: 1e-3, max_iterations: 20, ..DriverOptions::default() }
}

fn run(start: f64, answers: &[Answer], options: &DriverOptions) -> (Outcome, Vec<Iteration>, Vec<usize>) {
    let mut system = Script { start: Some(start), answers: answers.to_vec(), tried: 0, accepted: Vec::new() };
    let mut log = Vec::new();
    let outcome = minimise(&mut system, options, &mut |it| log.push(*it)).unwrap();
    (outcome, log, system.accepted)
}

const fn to(predicted: f64, cost: f64) -> Answer {
    (Some(predicted), Some(cost))
}

#[test]
fn the_damping_follows_the_gain_ratio() {
    // Gain ratios 1, 0.5, 0.25, 0.75 and 8: factors 1/3, 1, 1 + 1/8, 1 − 1/8 and 1/3.
    let answers = [to(10.0, 90.0), to(20.0, 80.0), to(40.0, 70.0), to(8.0, 64.0), to(0.5, 60.0), to(0.0, 60.0)];
    let (outcome, log, accepted) = run(100.0, &answers, &options());
    let ratios: Vec<f64> = log.iter().take(5).map(|it| it.gain_ratio().unwrap()).collect();
    assert_eq!(ratios, [1.0, 0.5, 0.25, 0.75, 8.0]);
    let factors: Vec<f64> = log.windows(2).map(|it| it[1].damping / it[0].damping).collect();
    for (factor, expected) in factors.iter().zip([1.0 / 3.0, 1.0, 1.125, 0.875, 1.0 / 3.0]) {
        assert!((factor - expected).abs() < 1e-12, "{factors:?}");
    }
    assert_eq!((outcome.stop, outcome.iterations, outcome.cost), (Stop::SmallGain, 6, 60.0));
    assert_eq!(accepted, [1, 2, 3, 4, 5, 6]);
}

#[test]
fn refused_steps_raise_the_damping_ever_faster_until_one_is_accepted() {
    // Worse, no residuals, no number, singular; then a good one, and one that is worse again.
    let refused = [to(10.0, 101.0), (Some(10.0), None), to(10.0, f64::NAN), (None, Some(1.0))];
    let answers = [refused.as_slice(), &[to(10.0, 95.0), to(10.0, 96.0), to(0.0, 95.0)]].concat();
    let (outcome, log, accepted) = run(100.0, &answers, &options());
    let dampings: Vec<f64> = log.iter().map(|it| it.damping).collect();
    assert_eq!(dampings, [1.0, 2.0, 8.0, 64.0, 1024.0, 1024.0, 2048.0]);
    assert_eq!(accepted, [5, 7]);
    assert_eq!(log.iter().map(|it| it.accepted).collect::<Vec<_>>(), [false, false, false, false, true, false, true]);
    assert_eq!(log.iter().map(|it| it.after).collect::<Vec<_>>()[..4], [Some(101.0), None, None, None]);
    assert_eq!(outcome.cost, 95.0);
}

#[test]
fn a_gain_that_is_next_to_nothing_ends_the_search() {
    let (outcome, log, accepted) = run(100.0, &[to(0.1, 99.95)], &options());
    assert_eq!((outcome.stop, outcome.iterations, outcome.cost), (Stop::SmallGain, 1, 99.95), "{log:?}");
    assert_eq!(accepted, [1]);
    // The cost rises where next to nothing was to be gained: no minimum of the linear model, at best one within rounding.
    let (outcome, log, accepted) = run(100.0, &[to(0.1, 100.5)], &options());
    assert_eq!((outcome.stop, outcome.iterations, outcome.cost), (Stop::NoDescent, 1, 100.0), "{log:?}");
    assert_eq!(accepted, []);
    assert_eq!(run(100.0, &[to(0.11, 100.0)], &options()).0.stop, Stop::IterationLimit);
    let absolute = DriverOptions { absolute_gain: 0.02, ..options() };
    assert_eq!(run(100.0, &[to(0.11, 100.0)], &absolute).0.stop, Stop::SmallGain);
    assert_eq!(run(0.0, &[to(0.0, 0.0)], &options()).0.stop, Stop::SmallGain);
}

#[test]
fn steps_that_never_help_end_it_too() {
    let (outcome, log, accepted) = run(100.0, &[to(10.0, 100.5)], &options());
    assert_eq!((outcome.stop, outcome.cost), (Stop::NoDescent, 100.0));
    assert_eq!((outcome.iterations, accepted.len()), (10, 0), "{log:?}"); // 2^(1 + 2 + … + 10) > 1e15
    assert_eq!(run(100.0, &[(None, None)], &options()).0.stop, Stop::NoDescent);
}

#[test]
fn the_limit_on_steps_holds() {
    let answers = [to(50.0, 90.0), to(50.0, 100.0)];
    let (outcome, ..) = run(100.0, &answers, &DriverOptions { max_iterations: 2, ..options() });
    assert_eq!((outcome.stop, outcome.iterations, outcome.cost), (Stop::IterationLimit, 2, 90.0));
    let (outcome, log, _) = run(100.0, &answers, &DriverOptions { max_iterations: 0, ..options() });
    assert_eq!((outcome.stop, outcome.iterations, outcome.cost, log.len()), (Stop::IterationLimit, 0, 100.0, 0));
}

#[test]
fn the_damping_keeps_between_its_bounds() {
    let damping = Damping { initial: 1.0, least: 0.2, fastest_decrease: 0.5 };
    let answers = [to(1.0, 99.0), to(1.0, 98.0), to(1.0, 97.0), to(1.0, 96.0)];
    let (_, log, _) = run(100.0, &answers, &DriverOptions { damping, max_iterations: 4, ..options() });
    assert_eq!(log.iter().map(|it| it.damping).collect::<Vec<_>>(), [1.0, 0.5, 0.25, 0.2]);
    // From next to nothing it does not take hundreds of refused steps to get anywhere.
    let damping = Damping { initial: 1e-15, ..Damping::default() };
    let (_, log, _) = run(100.0, &[to(1.0, 101.0)], &DriverOptions { damping, ..options() });
    assert_eq!(log[1].damping, 2e-10);
}

#[test]
fn costs_are_those_of_the_start_and_of_each_accepted_step() {
    let answers = vec![to(10.0, 90.0), to(10.0, 95.0), to(0.0, 89.0)];
    let mut system = Script { start: Some(100.0), answers, tried: 0, accepted: Vec::new() };
    assert_eq!(minimise_with_costs(&mut system, &options()).unwrap().1, [100.0, 90.0, 89.0]);
    let none = DriverOptions { max_iterations: 0, ..options() };
    assert_eq!(minimise_with_costs(&mut system, &none).unwrap().1, [100.0]);
}

#[test]
fn bad_starts_and_options_are_refused_with_the_reason() {
    let refused = |start: Option<f64>, options: &DriverOptions| {
        let mut system = Script { start, answers: vec![to(0.0, 0.0)], tried: 0, accepted: Vec::new() };
        minimise(&mut system, options, &mut |_| ()).unwrap_err()
    };
    for start in [None, Some(f64::NAN), Some(f64::INFINITY)] {
        assert_eq!(refused(start, &options()), SolveError::BadStart);
    }
    let option = |options: DriverOptions| match refused(Some(1.0), &options) {
        SolveError::BadOption { option, .. } => option,
        other => panic!("{other}"),
    };
    let damping = Damping::default();
    assert_eq!(option(DriverOptions { relative_gain: 0.0, ..options() }), "relative_gain");
    assert_eq!(option(DriverOptions { absolute_gain: -1.0, ..options() }), "absolute_gain");
    let with = |damping: Damping| DriverOptions { damping, ..options() };
    assert_eq!(option(with(Damping { initial: 0.0, ..damping })), "initial damping");
    assert_eq!(option(with(Damping { least: f64::NAN, ..damping })), "least damping");
    assert_eq!(option(with(Damping { fastest_decrease: 0.0, ..damping })), "fastest decrease of the damping");
}

#[test]
fn the_predicted_reduction_is_that_of_the_linear_model() {
    // H = diag(2, 4), g = (1, −3), D = (0.5, 1): h = −(H + D)⁻¹ g; −gᵀh − ½ hᵀ H h by hand.
    let (gradient, raised) = ([1.0, -3.0], [0.5, 1.0]);
    let step = [-1.0 / 2.5, 3.0 / 5.0];
    let by_hand = 0.4 + 1.8 - 0.5 * (2.0 * 0.4 * 0.4 + 4.0 * 0.6 * 0.6);
    assert!((predicted_reduction(&step, &gradient, &raised) - by_hand).abs() < 1e-12);
}
