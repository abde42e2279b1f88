//! Levenberg–Marquardt for N parameters known at compile time: no allocation, for problems that are solved thousands of times.

use nalgebra::{Cholesky, Const, SMatrix, SVector};

use super::SolveError;
use super::driver::{DriverOptions, Outcome, System, minimise, predicted_reduction, raise};

/// A least-squares problem over N parameters.
pub trait SmallProblem<const N: usize> {
    /// The unknowns, on any manifold.
    type Parameters: Clone;

    /// The parameters after a step.
    fn moved(&self, from: &Self::Parameters, step: &SVector<f64, N>) -> Self::Parameters;

    /// Adds all residuals at `at` to `equations`, which are 0 before. `None` where they are not defined, such as behind a camera: a step to there is rejected.
    fn linearise(&self, at: &Self::Parameters, equations: &mut SmallEquations<N>) -> Option<()>;
}

/// Gauss–Newton normal equations H h = −g, summed over the residuals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SmallEquations<const N: usize> {
    /// Information H = JᵀWJ.
    pub information: SMatrix<f64, N, N>,
    /// Gradient g = JᵀWr.
    pub gradient: SVector<f64, N>,
    /// Cost ½ Σ ρ.
    pub cost: f64,
}

impl<const N: usize> SmallEquations<N> {
    /// Empty equations, without residuals.
    pub fn zeros() -> Self {
        SmallEquations { information: SMatrix::zeros(), gradient: SVector::zeros(), cost: 0.0 }
    }
}

/// The solution of [`solve_small`].
#[derive(Debug, Clone, PartialEq)]
pub struct SmallSolution<P, const N: usize> {
    /// The parameters of least cost.
    pub parameters: P,
    /// The normal equations at the solution; the inverse of the information is the covariance if the standard deviations of the residuals are right.
    pub equations: SmallEquations<N>,
    /// How the search ended.
    pub outcome: Outcome,
}

struct Small<'a, P: SmallProblem<N>, const N: usize> {
    problem: &'a P,
    parameters: P::Parameters,
    candidate: P::Parameters,
    here: SmallEquations<N>,
    there: SmallEquations<N>,
    step: SVector<f64, N>,
}

impl<P: SmallProblem<N>, const N: usize> System for Small<'_, P, N> {
    fn begin(&mut self) -> Option<f64> {
        self.problem.linearise(&self.parameters, &mut self.here)?;
        Some(self.here.cost)
    }

    fn solve(&mut self, damping: f64) -> Option<f64> {
        let mut damped = self.here.information;
        let diagonal = damped.diagonal();
        let largest = diagonal.iter().copied().fold(0.0, f64::max);
        let raised = diagonal.map(|it| raise(it, largest, damping));
        (0..N).for_each(|it| damped[(it, it)] += raised[it]);
        self.step = Cholesky::<f64, Const<N>>::new(damped)?.solve(&-self.here.gradient);
        Some(predicted_reduction(self.step.as_slice(), self.here.gradient.as_slice(), raised.as_slice()))
    }

    fn attempt(&mut self) -> Option<f64> {
        self.candidate = self.problem.moved(&self.parameters, &self.step);
        self.there = SmallEquations::zeros();
        self.problem.linearise(&self.candidate, &mut self.there)?;
        Some(self.there.cost)
    }

    fn accept(&mut self) {
        std::mem::swap(&mut self.parameters, &mut self.candidate);
        std::mem::swap(&mut self.here, &mut self.there);
    }
}

/// Minimises `problem` from `start`.
///
/// # Errors
/// [`SolveError::BadStart`] and [`SolveError::BadOption`].
pub fn solve_small<P: SmallProblem<N>, const N: usize>(
    problem: &P,
    start: P::Parameters,
    options: &DriverOptions,
) -> Result<SmallSolution<P::Parameters, N>, SolveError> {
    let (here, there) = (SmallEquations::zeros(), SmallEquations::zeros());
    let mut system =
        Small { problem, candidate: start.clone(), parameters: start, here, there, step: SVector::zeros() };
    let outcome = minimise(&mut system, options, &mut |_| ())?;
    Ok(SmallSolution { parameters: system.parameters, equations: system.here, outcome })
}

#[cfg(test)]
mod tests;
