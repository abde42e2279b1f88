//! Parameters at which weighted residuals are least: Levenberg–Marquardt with robust losses, on manifolds, with covariance.
//!
//! | module | what it holds |
//! |---|---|
//! | [`driver`] | the one loop: damping, gain ratio, acceptance, termination; its source and all its rules |
//! | [`dense`] | [`solve`]: a [`Problem`] gives residuals in units of their standard deviations with their derivatives |
//! | [`small`] | [`solve_small`]: the same for a few parameters, without allocation |
//! | [`schur`] | [`solve_grouped`]: shared parameters, and many small groups that do not know each other (Schur complement) |
//! | [`information`] | the inverse of an information matrix, or which parameters it leaves open |
//!
//! Each minimises ½ Σ ρ(|r|²). Losses enter by their weights (iteratively reweighted least squares). Parameters live on any manifold: a problem says where a
//! step leads. Problems that leave a combination of parameters open still get their minimum, but no covariance: [`Unobservable`] names the
//! parameters in question.

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
