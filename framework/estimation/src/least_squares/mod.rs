//! Parameters at which weighted residuals are least: Levenberg–Marquardt on dense normal equations, with robust losses.
//!
//! A [`Problem`] gives residuals in units of their standard deviations with their derivatives; [`solve`] minimises ½ Σ ρ(|r|²) and
//! says why it stopped, what each iteration cost, and how well the data hold each parameter. Problems that leave a combination of
//! parameters open still get their minimum, but no covariance: [`Unobservable`] names the parameters in question.
//!
//! Source: K. Madsen, H. B. Nielsen, O. Tingleff, *Methods for non-linear least squares problems*, 2004, algorithm 3.16, with
//! Marquardt's scaling by the diagonal. Losses enter by their weights (iteratively reweighted least squares).

mod loss;

use nalgebra::{DMatrix, DVector, SMatrix, SVector};

pub use loss::Loss;

/// What is to be minimised. Residuals are in units of their standard deviations.
pub trait Problem {
    /// The unknowns, on whatever manifold they live.
    type Parameters: Clone;

    /// In how many directions the parameters can move.
    fn dimension(&self) -> usize;

    /// The parameters after a step of [`Self::dimension`] numbers.
    fn moved(&self, from: &Self::Parameters, step: &DVector<f64>) -> Self::Parameters;

    /// Adds all residuals at `at`, with their derivatives by the step, to `equations`. `None` where there are none, such as behind a
    /// camera: a step there is taken back.
    fn linearise(&self, at: &Self::Parameters, equations: &mut Equations) -> Option<()>;
}

/// Gauss–Newton's equations, summed over the residuals: JᵀWJ δ = −JᵀW r.
#[derive(Debug, Clone, PartialEq)]
pub struct Equations {
    loss: Loss,
    information: DMatrix<f64>,
    gradient: DVector<f64>,
    cost: f64,
    residuals: usize,
}

impl Equations {
    fn new(loss: Loss, dimension: usize) -> Equations {
        let (information, gradient) = (DMatrix::zeros(dimension, dimension), DVector::zeros(dimension));
        Equations { loss, information, gradient, cost: 0.0, residuals: 0 }
    }

    fn clear(&mut self) {
        self.information.fill(0.0);
        self.gradient.fill(0.0);
        (self.cost, self.residuals) = (0.0, 0);
    }

    /// Adds a residual of R numbers, judged by the loss as one, that depends on the C parameters `columns`.
    pub fn add<const R: usize, const C: usize>(
        &mut self,
        columns: &[usize; C],
        residual: &SVector<f64, R>,
        jacobian: &SMatrix<f64, R, C>,
    ) {
        let (cost, weight) = self.loss.at(residual.norm_squared());
        self.cost += 0.5 * cost;
        self.residuals += R;
        let weighted = jacobian.transpose() * weight;
        let (information, gradient) = (weighted * jacobian, weighted * residual);
        for (row, &to_row) in columns.iter().enumerate() {
            self.gradient[to_row] += gradient[row];
            for (column, &to_column) in columns.iter().enumerate() {
                self.information[(to_row, to_column)] += information[(row, column)];
            }
        }
    }

    /// Adds a residual of one number that may depend on every parameter: `jacobian` has an entry for each.
    pub fn add_row(&mut self, residual: f64, jacobian: &[f64]) {
        let (cost, weight) = self.loss.at(residual * residual);
        self.cost += 0.5 * cost;
        self.residuals += 1;
        for (row, by_row) in jacobian.iter().enumerate() {
            self.gradient[row] += weight * by_row * residual;
            for (column, by_column) in jacobian.iter().enumerate() {
                self.information[(row, column)] += weight * by_row * by_column;
            }
        }
    }
}

/// How to go about it.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// What residuals cost.
    pub loss: Loss,
    /// Parameters that stay as they are, by their place in the step; others are free.
    pub held: Vec<usize>,
    /// Steps tried at most [–].
    pub max_iterations: u32,
    /// Done when the next step promises less than this part of the cost [–].
    pub relative_gain: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { loss: Loss::Squared, held: Vec::new(), max_iterations: 100, relative_gain: 1e-12 }
    }
}

/// Why the search ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// The next step promises next to nothing: a minimum.
    SmallGain,
    /// No step however short lowers the cost: a minimum within rounding, or derivatives that are not those of the residuals.
    NoDescent,
    /// The allowed steps are used up.
    IterationLimit,
}

/// What [`solve`] found.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution<P> {
    /// Where the cost is least.
    pub parameters: P,
    /// Of the step, if residuals are as large as their standard deviations say; rows and columns of held parameters are 0.
    pub covariance: Result<DMatrix<f64>, Unobservable>,
    /// ½ Σ ρ at the start and after each accepted step.
    pub costs: Vec<f64>,
    /// Why it ended.
    pub stop: Stop,
    /// Steps tried, rejected ones included.
    pub iterations: u32,
    /// Twice the cost for each surplus residual: near 1 if the standard deviations are right; NaN without surplus.
    pub variance_factor: f64,
}

impl<P> Solution<P> {
    /// Whether a minimum was reached.
    pub fn converged(&self) -> bool {
        self.stop != Stop::IterationLimit
    }
}

/// Parameters that the data do not hold.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the data leave {} of {of} parameters open: they cannot be told from those before them: {parameters:?}", parameters.len())]
pub struct Unobservable {
    /// Which, by their place in the step: given the parameters before it, each is left open.
    pub parameters: Vec<usize>,
    /// How many are free in all.
    pub of: usize,
}

/// Why there is no answer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SolveError {
    /// The start has no residuals, or one that is not finite.
    #[error("at the start the residuals cannot be computed or are not finite")]
    BadStart,
    /// Nothing to find.
    #[error("none of {dimension} parameters is free")]
    NothingFree {
        /// Held and free ones.
        dimension: usize,
    },
    /// A held parameter that does not exist.
    #[error("parameter {index} is held, expected less than {dimension}")]
    NoSuchParameter {
        /// Which.
        index: usize,
        /// How many there are.
        dimension: usize,
    },
    /// A rule that cannot be followed.
    #[error("{rule} is {found}, expected a finite number above 0")]
    BadRule {
        /// Which.
        rule: &'static str,
        /// Its value.
        found: f64,
    },
}

/// A parameter of which those before it leave less than this part of its information is open.
const OPEN: f64 = 1e-12;
const MAX_DAMPING: f64 = 1e15;

/// Minimises `problem` from `start`.
///
/// # Errors
/// See [`SolveError`].
pub fn solve<P: Problem>(
    problem: &P,
    start: P::Parameters,
    options: &Options,
) -> Result<Solution<P::Parameters>, SolveError> {
    let dimension = problem.dimension();
    if let Some(&index) = options.held.iter().find(|it| **it >= dimension) {
        return Err(SolveError::NoSuchParameter { index, dimension });
    }
    if let Some(found) = options.loss.bad_scale() {
        return Err(SolveError::BadRule { rule: "the scale of the loss", found });
    }
    if !(options.relative_gain.is_finite() && options.relative_gain > 0.0) {
        return Err(SolveError::BadRule { rule: "relative_gain", found: options.relative_gain });
    }
    let free: Vec<usize> = (0..dimension).filter(|it| !options.held.contains(it)).collect();
    if free.is_empty() {
        return Err(SolveError::NothingFree { dimension });
    }
    let (mut here, mut there) = (Equations::new(options.loss, dimension), Equations::new(options.loss, dimension));
    let mut parameters = start;
    if problem.linearise(&parameters, &mut here).is_none() || !here.cost.is_finite() {
        return Err(SolveError::BadStart);
    }
    let mut costs = vec![here.cost];
    let (mut damping, mut growth) = (1e-4, 2.0);
    let (mut stop, mut iterations) = (Stop::IterationLimit, 0);
    while iterations < options.max_iterations {
        iterations += 1;
        let information = here.information.select_rows(&free).select_columns(&free);
        let downhill = -here.gradient.select_rows(&free);
        let Some(step) = damped_step(&information, &downhill, damping) else {
            damping *= growth;
            growth *= 2.0;
            if damping > MAX_DAMPING {
                stop = Stop::NoDescent;
                break;
            }
            continue;
        };
        let predicted_reduction = step.dot(&downhill) - 0.5 * step.dot(&(&information * &step));
        let small = predicted_reduction <= options.relative_gain * here.cost.max(f64::MIN_POSITIVE);
        let mut whole = DVector::zeros(dimension);
        free.iter().zip(step.iter()).for_each(|(&to, value)| whole[to] = *value);
        let candidate = problem.moved(&parameters, &whole);
        there.clear();
        let computed = problem.linearise(&candidate, &mut there).is_some() && there.cost.is_finite();
        if computed && there.cost <= here.cost {
            let gain = (here.cost - there.cost) / predicted_reduction.max(f64::MIN_POSITIVE);
            damping = (damping * (1.0 - (2.0 * gain.min(1.5) - 1.0).powi(3)).max(1.0 / 3.0)).max(1e-15); // (3.16)
            growth = 2.0;
            parameters = candidate;
            std::mem::swap(&mut here, &mut there);
            costs.push(here.cost);
        } else {
            damping = damping.max(1e-10) * growth;
            growth *= 2.0;
        }
        if small {
            stop = Stop::SmallGain;
            break;
        }
        if damping > MAX_DAMPING {
            stop = Stop::NoDescent;
            break;
        }
    }
    let surplus = here.residuals as f64 - free.len() as f64;
    let variance_factor = if surplus > 0.0 { 2.0 * here.cost / surplus } else { f64::NAN };
    let covariance = covariance(&here.information, &free);
    Ok(Solution { parameters, covariance, costs, stop, iterations, variance_factor })
}

/// Solves the equations with their diagonal raised by the part `damping`; parameters without any information stay where they are.
fn damped_step(information: &DMatrix<f64>, downhill: &DVector<f64>, damping: f64) -> Option<DVector<f64>> {
    let mut damped = information.clone();
    let least = 1e-12 * information.diagonal().max();
    for index in 0..damped.nrows() {
        let diagonal = information[(index, index)];
        damped[(index, index)] = diagonal + damping * diagonal.max(least) + f64::MIN_POSITIVE.sqrt();
    }
    let step = damped.cholesky()?.solve(downhill);
    step.iter().all(|it| it.is_finite()).then_some(step)
}

/// Inverse of the information of the `free` parameters, spread into rows and columns of all.
fn covariance(information: &DMatrix<f64>, free: &[usize]) -> Result<DMatrix<f64>, Unobservable> {
    let inverse = invert_information(&information.select_rows(free).select_columns(free));
    let inverse = inverse
        .map_err(|open| Unobservable { parameters: open.iter().map(|it| free[*it]).collect(), of: free.len() })?;
    let mut whole = DMatrix::zeros(information.nrows(), information.nrows());
    for (row, &to_row) in free.iter().enumerate() {
        for (column, &to_column) in free.iter().enumerate() {
            whole[(to_row, to_column)] = inverse[(row, column)];
        }
    }
    Ok(whole)
}

/// The inverse of a symmetric information matrix, whatever the units of its parameters.
///
/// # Errors
/// The parameters that are open given those before them.
pub fn invert_information(information: &DMatrix<f64>) -> Result<DMatrix<f64>, Vec<usize>> {
    let n = information.nrows();
    let scale = DVector::from_fn(n, |row, _| 1.0 / information[(row, row)].sqrt());
    let mut factor = DMatrix::from_fn(n, n, |row, column| information[(row, column)] * scale[row] * scale[column]);
    // Cholesky on the unit diagonal: a pivot is the part of its parameter that those before it do not explain.
    let mut open = Vec::new();
    for column in 0..n {
        let pivot = factor[(column, column)];
        if !scale[column].is_finite() || pivot.is_nan() || pivot <= OPEN {
            open.push(column);
            factor.column_mut(column).fill(0.0);
            continue;
        }
        let root = pivot.sqrt();
        factor.column_mut(column).rows_mut(column, n - column).unscale_mut(root);
        let (done, mut rest) = factor.columns_range_pair_mut(column, column + 1..);
        for later in column + 1..n {
            let share = -done[later];
            rest.column_mut(later - column - 1).rows_mut(later, n - later).axpy(
                share,
                &done.rows(later, n - later),
                1.0,
            );
        }
    }
    if !open.is_empty() {
        return Err(open);
    }
    factor.fill_upper_triangle(0.0, 1);
    let mut inverse = DMatrix::identity(n, n);
    if !factor.solve_lower_triangular_mut(&mut inverse) {
        return Err((0..n).collect());
    }
    let mut inverse = inverse.tr_mul(&inverse);
    for column in 0..n {
        for row in 0..n {
            inverse[(row, column)] *= scale[row] * scale[column];
        }
    }
    Ok(inverse)
}

#[cfg(test)]
mod tests;
