//! Levenberg–Marquardt on dense normal equations, for problems of up to some hundred parameters.

use nalgebra::{DMatrix, DVector, SMatrix, SVector};

use super::driver::{DriverOptions, Stop, System, minimise_with_costs, predicted_reduction, raise};
use super::information::{Unobservable, covariance, solve_positive};
use super::{Loss, SolveError};

/// A least-squares problem. Residuals are in units of their standard deviations.
pub trait Problem {
    /// The unknowns, on any manifold.
    type Parameters: Clone;

    /// Number of entries of a step.
    fn dimension(&self) -> usize;

    /// The parameters after a step of [`Self::dimension`] numbers.
    fn moved(&self, from: &Self::Parameters, step: &DVector<f64>) -> Self::Parameters;

    /// Adds all residuals at `at`, with their derivatives with respect to the step, to `equations`. `None` where they are not
    /// defined, such as behind a camera: a step to there is rejected.
    fn linearise(&self, at: &Self::Parameters, equations: &mut Equations) -> Option<()>;
}

/// Gauss–Newton normal equations, summed over the residuals: JᵀWJ δ = −JᵀW r.
#[derive(Debug, Clone, PartialEq)]
pub struct Equations {
    loss: Loss,
    /// While residuals are added, what sparse ones gave lies below the diagonal only: see [`Self::mirror`].
    information: DMatrix<f64>,
    gradient: DVector<f64>,
    cost: f64,
    residuals: usize,
    /// By parameter: whether it stays; sparse residuals leave it out.
    held: Vec<bool>,
    /// Of a sparse residual, what is free.
    sparse: Vec<(usize, f64)>,
}

impl Equations {
    fn new(loss: Loss, held: Vec<bool>) -> Equations {
        let dimension = held.len();
        let (information, gradient) = (DMatrix::zeros(dimension, dimension), DVector::zeros(dimension));
        Equations { loss, information, gradient, cost: 0.0, residuals: 0, held, sparse: Vec::new() }
    }

    /// Copies what lies below the diagonal to above it, once all residuals are there.
    fn mirror(&mut self) {
        self.information.fill_upper_triangle_with_lower_triangle();
    }

    fn clear(&mut self) {
        self.information.fill(0.0);
        self.gradient.fill(0.0);
        (self.cost, self.residuals) = (0.0, 0);
    }

    /// Adds a residual of R numbers, weighted by the loss as one, that depends on the C parameters `columns`.
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

    /// Divides all sums by the number of residuals: for problems whose number of residuals depends on the state, so
    /// that losing residuals is no gain. The covariance is then larger by that factor.
    pub fn average(&mut self) {
        let part = 1.0 / self.residuals.max(1) as f64;
        self.information *= part;
        self.gradient *= part;
        self.cost *= part;
    }

    /// Adds a scalar residual that may depend on every parameter: `jacobian` has an entry for each.
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

    /// Adds a scalar residual that depends on few of many parameters: `jacobian` names each of them once, with the
    /// derivative. `worth` is an extra weight after the loss: below 1 where several residuals share one error.
    pub fn add_sparse(&mut self, residual: f64, worth: f64, jacobian: &[(usize, f64)]) {
        let (cost, weight) = self.loss.at(residual * residual);
        self.add_with((worth * cost, worth * weight), residual, jacobian);
    }

    /// Adds a residual of certain prior knowledge: it costs its square whatever the loss is.
    pub fn add_known(&mut self, residual: f64, jacobian: &[(usize, f64)]) {
        self.add_with(Loss::Squared.at(residual * residual), residual, jacobian);
    }

    fn add_with(&mut self, (cost, weight): (f64, f64), residual: f64, jacobian: &[(usize, f64)]) {
        self.cost += 0.5 * cost;
        self.residuals += 1;
        let Self { information, gradient, held, sparse, .. } = self;
        sparse.clear();
        sparse.extend(jacobian.iter().filter(|it| !held[it.0]));
        // Columns are stored one after the other: in the order of the parameters each is walked downwards.
        sparse.sort_unstable_by_key(|it| it.0);
        let n = held.len();
        let information = information.as_mut_slice();
        for (place, &(column, by_column)) in sparse.iter().enumerate() {
            let by = weight * by_column;
            gradient[column] += by * residual;
            let down = &mut information[column * n..(column + 1) * n];
            for &(row, by_row) in &sparse[place..] {
                down[row] += by * by_row;
            }
        }
    }
}

/// Options of [`solve`].
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Robust loss of the residuals.
    pub loss: Loss,
    /// Parameters that are held fixed, by their index in the step; the others are free.
    pub held: Vec<usize>,
    /// Most iterations [–].
    pub max_iterations: u32,
    /// Convergence: stop when the predicted reduction of the next step is below this part of the cost [–].
    pub relative_gain: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { loss: Loss::Squared, held: Vec::new(), max_iterations: 100, relative_gain: 1e-12 }
    }
}

/// The solution of [`solve`].
#[derive(Debug, Clone, PartialEq)]
pub struct Solution<P> {
    /// The parameters of least cost.
    pub parameters: P,
    /// Covariance of the step, if the standard deviations of the residuals are right; rows and columns of held parameters are 0.
    pub covariance: Result<DMatrix<f64>, Unobservable>,
    /// ½ Σ ρ at the start and after each accepted step.
    pub costs: Vec<f64>,
    /// Why the search ended.
    pub stop: Stop,
    /// Iterations, rejected steps included.
    pub iterations: u32,
    /// Variance factor: twice the cost per redundant residual. Near 1 if the standard deviations are right; NaN without redundancy.
    pub variance_factor: f64,
}

impl<P> Solution<P> {
    /// Whether a minimum was reached.
    pub fn converged(&self) -> bool {
        self.stop != Stop::IterationLimit
    }
}

/// The part of the search that does not depend on what is sought.
struct Normal {
    free: Vec<usize>,
    here: Equations,
    there: Equations,
    /// The last step; 0 for what is held.
    step: DVector<f64>,
}

impl Normal {
    fn new(dimension: usize, options: &Options) -> Result<Normal, SolveError> {
        if let Some(&index) = options.held.iter().find(|it| **it >= dimension) {
            return Err(SolveError::NoSuchParameter { index, dimension });
        }
        if let Some(found) = options.loss.bad_scale() {
            return Err(SolveError::BadOption { option: "scale of the loss", found });
        }
        let free: Vec<usize> = (0..dimension).filter(|it| !options.held.contains(it)).collect();
        if free.is_empty() {
            return Err(SolveError::NothingFree { dimension });
        }
        let mut held = vec![true; dimension];
        free.iter().for_each(|it| held[*it] = false);
        let [here, there] = [(); 2].map(|()| Equations::new(options.loss, held.clone()));
        Ok(Normal { free, here, there, step: DVector::zeros(dimension) })
    }

    fn solve(&mut self, damping: f64) -> Option<f64> {
        let Normal { free, here: Equations { information, gradient, .. }, step, .. } = self;
        let n = free.len();
        let mut damped = DMatrix::from_fn(n, n, |row, column| information[(free[row], free[column])]);
        let gradient = gradient.select_rows(&*free);
        let largest = damped.diagonal().max();
        let raised = DVector::from_fn(n, |row, _| raise(damped[(row, row)], largest, damping));
        (0..n).for_each(|it| damped[(it, it)] += raised[it]);
        let own = solve_positive(damped, &-&gradient)?;
        free.iter().zip(own.iter()).for_each(|(to, value)| step[*to] = *value);
        Some(predicted_reduction(own.as_slice(), gradient.as_slice(), raised.as_slice()))
    }

    fn solution<P>(self, parameters: P, (outcome, costs): (super::Outcome, Vec<f64>)) -> Solution<P> {
        let surplus = self.here.residuals as f64 - self.free.len() as f64;
        let variance_factor = if surplus > 0.0 { 2.0 * self.here.cost / surplus } else { f64::NAN };
        let covariance = covariance(&self.here.information, &self.free);
        let super::Outcome { stop, iterations, .. } = outcome;
        Solution { parameters, covariance, costs, stop, iterations, variance_factor }
    }
}

/// A problem on its way.
struct Dense<'a, P: Problem> {
    problem: &'a P,
    parameters: P::Parameters,
    candidate: Option<P::Parameters>,
    normal: Normal,
}

impl<P: Problem> System for Dense<'_, P> {
    fn begin(&mut self) -> Option<f64> {
        self.problem.linearise(&self.parameters, &mut self.normal.here)?;
        self.normal.here.mirror();
        Some(self.normal.here.cost)
    }

    fn solve(&mut self, damping: f64) -> Option<f64> {
        self.normal.solve(damping)
    }

    fn attempt(&mut self) -> Option<f64> {
        let candidate = self.candidate.insert(self.problem.moved(&self.parameters, &self.normal.step));
        self.normal.there.clear();
        self.problem.linearise(candidate, &mut self.normal.there)?;
        self.normal.there.mirror();
        Some(self.normal.there.cost)
    }

    fn accept(&mut self) {
        if let Some(candidate) = self.candidate.take() {
            self.parameters = candidate;
            std::mem::swap(&mut self.normal.here, &mut self.normal.there);
        }
    }
}

/// Minimises `problem` from `start`.
///
/// # Errors
/// See [`SolveError`].
pub fn solve<P: Problem>(
    problem: &P,
    start: P::Parameters,
    options: &Options,
) -> Result<Solution<P::Parameters>, SolveError> {
    let normal = Normal::new(problem.dimension(), options)?;
    let mut system = Dense { problem, parameters: start, candidate: None, normal };
    let Options { max_iterations, relative_gain, .. } = *options;
    let options = DriverOptions { max_iterations, relative_gain, ..DriverOptions::default() };
    let found = minimise_with_costs(&mut system, &options)?;
    Ok(system.normal.solution(system.parameters, found))
}

#[cfg(test)]
mod tests;
