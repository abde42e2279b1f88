//! What turns noisy numbers into estimates, without knowing sensors or nodes.
//!
//! | module | what it gives |
//! |---|---|
//! | [`kalman`] | a point that moves at nearly constant velocity, updated by pixels or positions |
//! | [`motion`] | the same under a motion model chosen by setting, interacting models, adapted noise |
//! | [`consistency`] | whether a filter's errors are as large as it says |
//! | [`clocks`] | clock offsets and drifts of cameras, from what their innovations show |
//! | [`least_squares`] | parameters at which weighted residuals are least, robust, with covariance |
//! | [`bounded`] | least squares with bounds on each weight, warm from the last answer |
//! | [`principal`] | directions in which samples vary most |
//! | [`assignment`] | which measurement belongs to which track, at the least cost, with a gate |
//! | [`allocation`] | which heads look at which target, where several at one target see more together |
//! | [`gospa`] | how far a set of points is from the true one: OSPA, GOSPA |
//! | [`identities`] | true targets and recovered identities matched over time: ID switches, reinitialisations |
//! | [`prediction`] | where a moving point will be, by what has foretold best of late |
//! | [`one_euro`] | a value without jitter at rest and without lag in motion: the 1€ filter |
//! | [`actuator`] | two motors that answer late: how late, and where they are |
//! | [`statistics`] | median, percentiles, median absolute deviation, a summary |
//! | [`random`] | seeded random numbers, with a stream of its own for each name |

pub mod actuator;
pub mod allocation;
pub mod assignment;
pub mod bounded;
pub mod clocks;
pub mod consistency;
pub mod gospa;
pub mod identities;
pub mod kalman;
pub mod least_squares;
pub mod motion;
pub mod one_euro;
pub mod prediction;
pub mod principal;
pub mod random;
pub mod statistics;

pub use actuator::{ActuatorEstimator, ActuatorOptions, ActuatorState};
pub use assignment::{Workspace, nearest_greedy, optimal};
pub use bounded::{Bounded, BoundedError, BoundedLeastSquares};
pub use clocks::{ClockEstimate, ClockEstimator, ClockObservation, ClockSettings};
pub use consistency::{Consistency, Verdict};
pub use gospa::SetDistance;
pub use kalman::{ConstantVelocity, Innovation};
pub use least_squares::Loss;
pub use motion::{AdaptiveNoise, Filter, Interacting, Mode, Model};
pub use one_euro::{OneEuro, OneEuroOptions};
pub use prediction::{Prediction, Predictor, PredictorOptions, Way};
pub use principal::{Principal, PrincipalError, principal, principal_of};
pub use random::Random;
pub use statistics::Summary;
