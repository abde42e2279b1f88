//! Estimation: least squares, Kalman filters, assignment, robust statistics and tracking metrics. Knows no sensors and no nodes.
//!
//! | module | what it gives |
//! |---|---|
//! | [`kalman`] | Kalman filter of a point at nearly constant velocity, updated by pixels or positions |
//! | [`motion`] | filters of a point under other motion models: constant acceleration, interacting models, adaptive noise |
//! | [`consistency`] | filter consistency: normalised innovations against χ² |
//! | [`clocks`] | clock offsets and drifts of cameras, from their innovations |
//! | [`least_squares`] | Levenberg–Marquardt with robust losses and covariance |
//! | [`bounded`] | linear least squares with bounds on each weight, warm-started |
//! | [`principal`] | principal components |
//! | [`assignment`] | optimal and greedy assignment of measurements to tracks, with a gate |
//! | [`allocation`] | assignment of pan-tilt heads to targets, where several heads on one target add value |
//! | [`gospa`] | distance between a recovered and the true set of points: OSPA, GOSPA |
//! | [`identities`] | ID switches and re-initialisations of tracks against truth |
//! | [`prediction`] | extrapolation of a moving point, by several methods weighted by recent prediction error |
//! | [`one_euro`] | the 1€ filter: no jitter at rest, little lag in motion |
//! | [`actuator`] | latency and pose of a pan-tilt head from commands and reports |
//! | [`statistics`] | median, percentiles, median absolute deviation, a summary |
//! | [`random`] | seeded random numbers, with a separate stream for each name |

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
pub use prediction::{Prediction, PredictionMethod, Predictor, PredictorOptions};
pub use principal::{Principal, PrincipalError, principal, principal_of};
pub use random::Random;
pub use statistics::Summary;
