//! Nonlinear least squares: Levenberg–Marquardt with robust losses, on manifolds, with covariance.
//!
//! | module | what it holds |
//! |---|---|
//! | [`driver`] | the shared loop: damping, gain ratio, acceptance, termination |
//! | [`dense`] | [`solve`]: dense normal equations, for up to some hundred parameters |
//! | [`small`] | [`solve_small`]: a few parameters, without allocation |
//! | [`schur`] | [`solve_grouped`]: shared parameters and many small independent groups (Schur complement) |
//! | [`information`] | the inverse of an information matrix, or its unobservable parameters |
//!
//! Each solver minimises ½ Σ ρ(|r|²). Losses enter by their weights (iteratively reweighted least squares). Parameters
//! live on any manifold: the problem applies a step to them. A problem with unobservable parameters still gets a
//! minimum, but no covariance: [`Unobservable`] names the parameters.

pub mod dense;
pub mod driver;
pub mod information;
mod loss;
pub mod schur;
pub mod small;

pub use dense::{Equations, Options, Problem, Solution, solve};
pub use driver::{Damping, DriverOptions, Iteration, Outcome, Stop, System, minimise, minimise_with_costs};
pub use information::{Unobservable, invert_information};
pub use loss::Loss;
pub use schur::{GroupedEquations, GroupedProblem, GroupedSolution, solve_grouped};
pub use small::{SmallEquations, SmallProblem, SmallSolution, solve_small};

/// Why there is no solution.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SolveError {
    /// The start has no residuals, or one that is not finite.
    #[error("at the start the residuals cannot be computed or are not finite")]
    BadStart,
    /// Every parameter is held.
    #[error("none of {dimension} parameters is free")]
    NothingFree {
        /// Number of parameters.
        dimension: usize,
    },
    /// A held parameter that does not exist.
    #[error("parameter {index} is held, expected less than {dimension}")]
    NoSuchParameter {
        /// Index that was given.
        index: usize,
        /// Number of parameters.
        dimension: usize,
    },
    /// An option out of range.
    #[error("{option} is {found}, expected a finite number above 0")]
    BadOption {
        /// Which option.
        option: &'static str,
        /// Its value.
        found: f64,
    },
}
