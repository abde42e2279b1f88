//! The Levenberg–Marquardt loop shared by all solvers: damping, gain ratio, acceptance and termination. A [`System`]
//! linearises, solves and moves, and keeps the parameters in whatever form suits it.
//!
//! Source: K. Madsen, H. B. Nielsen, O. Tingleff, *Methods for non-linear least squares problems*, 2nd edition, 2004, algorithm 3.16.
//!
//! | here | source | meaning |
//! |---|---|---|
//! | cost | F | ½ Σ ρ(\|r\|²); with ρ(s) = s, ½ Σ \|r\|² |
//! | H, g | A, g | JᵀWJ and JᵀWr, W the weights of the robust loss |
//! | `damping` | μ | the damped equations are (H + D) h = −g; source: D = μ I, here: D = μ diag(H) (Marquardt's scaling) |
//! | `growth` | ν | factor of the damping after the next rejected step |
//! | predicted reduction | L(0) − L(h) | ½ hᵀ (D h − g), (3.14) |
//! | gain ratio | ϱ | (F(x) − F(x + h)) / predicted reduction, (3.14) |
//!
//! Each iteration solves the damped equations and evaluates the cost after the step. The step is *accepted* when that cost is not higher
//! (source: when it is lower): μ ← μ max(q, 1 − (2ϱ − 1)³), ν ← 2, with q = 1/3 in the source and
//! [`Damping::fastest_decrease`] here. It is *rejected* when the
//! cost is higher, not finite or not defined, or when the equations are singular: μ ← ν max(μ, 1e-10), ν ← 2 ν. In the
//! source μ may fall without a limit; here it
//! stays at or above [`Damping::least`].
//!
//! The loop ends for one of these reasons, in this order of precedence:
//!
//! 1. [`Stop::SmallGain`]: the predicted reduction of an accepted step was at most `relative_gain` F + `absolute_gain`, F being the cost before the
//!    step. (Source: a small gradient or a small step, (3.15), which depend on units.)
//! 2. [`Stop::NoDescent`]: a step was rejected although its predicted reduction was as small as that, or rejected steps have raised the
//!    damping beyond 1e15.
//! 3. [`Stop::IterationLimit`]: `max_iterations` steps were tried, rejected ones included. With 0, no step is tried.
//!
//! A start without a finite cost is refused with [`SolveError::BadStart`].

use super::SolveError;

/// What the loop needs of a least-squares problem.
///
/// The system keeps its parameters, its linearisation about them, and one trial step with the state after it.
pub trait System {
    /// Linearises at the start and returns the cost ½ Σ ρ there; `None` where residuals are not defined.
    fn begin(&mut self) -> Option<f64>;

    /// Solves the damped equations about the present parameters and stores the step. Returns its predicted reduction of the cost
    /// ([`predicted_reduction`]); `None` where the equations are singular or the step is not finite.
    fn solve(&mut self, damping: f64) -> Option<f64>;

    /// The cost after the step of the last [`Self::solve`]; `None` where residuals are not defined, such as behind a camera.
    fn attempt(&mut self) -> Option<f64>;

    /// Accepts the last step: its parameters and linearisation become the present ones.
    fn accept(&mut self);
}

/// How the damping changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Damping {
    /// Damping of the first step, relative to the diagonal [–].
    pub initial: f64,
    /// Lower limit of the damping [–].
    pub least: f64,
    /// Factor after a step that gained as predicted, above 0 and at most 1 [–]: 1/3 in the source; less for problems
    /// that are nearly linear or badly conditioned, where any damping only costs steps.
    pub fastest_decrease: f64,
}

impl Default for Damping {
    fn default() -> Self {
        Self { initial: 1e-4, least: 1e-15, fastest_decrease: 1.0 / 3.0 }
    }
}

impl Damping {
    /// After an accepted step.
    fn lowered(&self, damping: f64, gain_ratio: f64) -> f64 {
        (damping * (1.0 - (2.0 * gain_ratio - 1.0).powi(3)).max(self.fastest_decrease)).max(self.least)
    }
}

/// Options of the loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriverOptions {
    /// Levenberg–Marquardt damping.
    pub damping: Damping,
    /// Most iterations, rejected steps included [–].
    pub max_iterations: u32,
    /// Convergence: a predicted reduction of at most this part of the cost ends the search, above 0 [–].
    pub relative_gain: f64,
    /// Absolute reduction added to that limit, for problems whose cost may be 0; 0 or more [cost].
    pub absolute_gain: f64,
}

impl Default for DriverOptions {
    fn default() -> Self {
        Self { damping: Damping::default(), max_iterations: 100, relative_gain: 1e-12, absolute_gain: 0.0 }
    }
}

impl DriverOptions {
    fn check(&self) -> Result<(), SolveError> {
        let Damping { initial, least, fastest_decrease } = self.damping;
        let positive = |it: f64| it.is_finite() && it > 0.0;
        let options = [
            ("relative_gain", self.relative_gain, positive(self.relative_gain)),
            ("absolute_gain", self.absolute_gain, self.absolute_gain == 0.0 || positive(self.absolute_gain)),
            ("initial damping", initial, positive(initial)),
            ("least damping", least, positive(least)),
            ("fastest decrease of the damping", fastest_decrease, positive(fastest_decrease)),
        ];
        let bad = options.into_iter().find(|it| !it.2);
        bad.map_or(Ok(()), |(option, found, _)| Err(SolveError::BadOption { option, found }))
    }
}

/// Why the search ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// Converged: the predicted reduction of the last step is negligible, and the step did not raise the cost.
    SmallGain,
    /// No step, however short, lowers the cost: a minimum within rounding, or derivatives that do not match the residuals.
    NoDescent,
    /// The limit of iterations was reached.
    IterationLimit,
}

/// One trial step, for logs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Iteration {
    /// Damping of the step [–].
    pub damping: f64,
    /// Predicted reduction of the cost; `None` where the equations were singular.
    pub predicted_reduction: Option<f64>,
    /// Cost before the step.
    pub before: f64,
    /// Cost after the step; `None` where there was no step or no finite cost.
    pub after: Option<f64>,
    /// Whether the step was accepted.
    pub accepted: bool,
}

impl Iteration {
    /// Actual over predicted reduction: 1 where the residuals are linear, below 0 where the cost rises [–].
    pub fn gain_ratio(&self) -> Option<f64> {
        Some((self.before - self.after?) / self.predicted_reduction?.max(f64::MIN_POSITIVE))
    }
}

/// How a search ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome {
    /// Final cost ½ Σ ρ.
    pub cost: f64,
    /// Why the search ended.
    pub stop: Stop,
    /// Iterations, rejected steps included.
    pub iterations: u32,
}

/// Least damping after a refused step.
const RESTART: f64 = 1e-10;
const MAX_DAMPING: f64 = 1e15;

/// Minimises the cost of `system`, and passes each trial step to `log`. Allocates nothing itself.
///
/// # Errors
/// [`SolveError::BadStart`] and [`SolveError::BadOption`].
pub fn minimise(
    system: &mut dyn System,
    options: &DriverOptions,
    log: &mut dyn FnMut(&Iteration),
) -> Result<Outcome, SolveError> {
    options.check()?;
    let mut cost = system.begin().filter(|it| it.is_finite()).ok_or(SolveError::BadStart)?;
    let (mut damping, mut growth) = (options.damping.initial, 2.0);
    for iterations in 1..=options.max_iterations {
        let predicted_reduction = system.solve(damping).filter(|it| it.is_finite());
        let after = predicted_reduction.and_then(|_| system.attempt()).filter(|it| it.is_finite());
        let accepted = after.is_some_and(|it| it <= cost);
        let tried = Iteration { damping, predicted_reduction, before: cost, after, accepted };
        log(&tried);
        let limit = options.relative_gain * cost.max(f64::MIN_POSITIVE) + options.absolute_gain;
        let is_small = predicted_reduction.is_some_and(|it| it <= limit);
        match (accepted, after, tried.gain_ratio()) {
            (true, Some(after), Some(gain_ratio)) => {
                system.accept();
                (cost, growth) = (after, 2.0);
                damping = options.damping.lowered(damping, gain_ratio);
            }
            _ => {
                damping = damping.max(RESTART) * growth;
                growth *= 2.0;
            }
        }
        if is_small && accepted {
            return Ok(Outcome { cost, stop: Stop::SmallGain, iterations });
        }
        if is_small || damping > MAX_DAMPING {
            return Ok(Outcome { cost, stop: Stop::NoDescent, iterations });
        }
    }
    Ok(Outcome { cost, stop: Stop::IterationLimit, iterations: options.max_iterations })
}

/// As [`minimise`], and returns the cost at the start and after each accepted step.
///
/// # Errors
/// As for [`minimise`].
pub fn minimise_with_costs(
    system: &mut dyn System,
    options: &DriverOptions,
) -> Result<(Outcome, Vec<f64>), SolveError> {
    let mut costs = Vec::new();
    let outcome = minimise(system, options, &mut |it| {
        if costs.is_empty() {
            costs.push(it.before);
        }
        costs.extend(it.after.filter(|_| it.accepted));
    })?;
    if costs.is_empty() {
        costs.push(outcome.cost);
    }
    Ok((outcome, costs))
}

/// Predicted reduction of the cost by the step h of the damped equations (H + D) h = −g, if the residuals are linear:
/// ½ hᵀ (D h − g). `raised` is the diagonal of D. Reductions of parts of the step add up.
#[inline]
pub fn predicted_reduction(step: &[f64], gradient: &[f64], raised: &[f64]) -> f64 {
    let each = step.iter().zip(gradient).zip(raised);
    0.5 * each.map(|((step, gradient), raised)| step * (raised * step - gradient)).sum::<f64>()
}

/// By how much `damping` raises an entry of the diagonal of the information whose largest entry is `largest`. What has no information
/// is raised as well, so that it stays where it is.
#[inline]
pub(super) fn raise(entry: f64, largest: f64, damping: f64) -> f64 {
    damping * entry.max(1e-12 * largest) + f64::MIN_POSITIVE.sqrt()
}

#[cfg(test)]
mod tests;
