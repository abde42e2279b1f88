//! The interacting multiple model (IMM) filter: one Kalman filter for each mode, mixed at every step.
//!
//! Source: H. Blom, Y. Bar-Shalom, "The interacting multiple model algorithm for systems with Markovian switching
//! coefficients", IEEE TAC 33(8), 1988; in the notation of Y. Bar-Shalom, X. Li, T. Kirubarajan, *Estimation with Applications
//! to Tracking and Navigation*, 2001, §11.6.6.
//!
//! | here | book | meaning |
//! |---|---|---|
//! | `probabilities[j]` | μⱼ | probability that mode j holds |
//! | `transition` | pᵢⱼ | probability of a change within the time that passed |
//! | `expected[j]` | c̄ⱼ | probability of mode j before the measurement |
//! | `share[i]` | μᵢ\|ⱼ | mixing probability: part of mode i in the start of mode j |
//!
//! A mode without acceleration takes position and velocity from one that has it; the other way round, its acceleration is
//! zero with the variance that the receiving mode states, uncorrelated with the rest. Time may pass without a measurement:
//! prediction mixes by itself, and a measurement at the same instant as the last one mixes nothing.

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Matrix6, Point3, SMatrix, SVector, Vector2, Vector3, Vector6};

use super::constant_acceleration::{ConstantAcceleration, stacked};
use super::{Interacting, Mode};
use crate::kalman::{ConstantVelocity, Innovation, SmallInverse};

/// The most modes of an [`Interacting`] model.
pub const MODES_MAX: usize = 3;

/// The state of one mode.
#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "three of them at most, in one box, and copied without an allocation")]
enum State {
    Velocity(ConstantVelocity),
    Acceleration(ConstantAcceleration),
}

/// A filter for each mode of one point, with the mode probabilities.
#[derive(Debug, Clone, PartialEq)]
pub struct InteractingFilter {
    model: Interacting,
    /// As many as the model has modes; the rest is never read.
    states: [State; MODES_MAX],
    probabilities: [f64; MODES_MAX],
    /// Mean and covariance of the mixture, of position and velocity.
    mixture: ConstantVelocity,
}

impl InteractingFilter {
    /// Initiates a track at `position` with `position_covariance` [m²] and `velocity` [m/s], each axis of the velocity
    /// with the standard deviation `velocity_sigma` [m/s]; the modes have their long-run probabilities.
    pub fn new(
        model: &Interacting,
        position: Point3<f64>,
        position_covariance: Matrix3<f64>,
        velocity: Vector3<f64>,
        velocity_sigma: f64,
    ) -> Self {
        let mixture =
            ConstantVelocity { velocity, ..ConstantVelocity::new(position, position_covariance, velocity_sigma) };
        let state = |mode: usize| match model.modes().get(mode) {
            Some(Mode::ConstantAcceleration { acceleration_sigma, .. }) => State::Acceleration(
                ConstantAcceleration::new(position, position_covariance, velocity, velocity_sigma, *acceleration_sigma),
            ),
            _ => State::Velocity(mixture.clone()),
        };
        let mut probabilities = [0.0; MODES_MAX];
        probabilities[..model.start().len()].copy_from_slice(model.start());
        Self { model: *model, states: [state(0), state(1), state(2)], probabilities, mixture }
    }

    /// Mean and covariance of position and velocity over all modes.
    #[inline]
    pub fn mixture(&self) -> &ConstantVelocity {
        &self.mixture
    }

    /// Mean acceleration over all modes, zero for those without [m/s²].
    pub fn acceleration(&self) -> Vector3<f64> {
        let each = self.modes().map(|(state, probability)| match state {
            State::Velocity(_) => Vector3::zeros(),
            State::Acceleration(it) => it.acceleration * probability,
        });
        each.sum()
    }

    /// Probability of each mode, in the order of the model.
    pub fn probabilities(&self) -> &[f64] {
        &self.probabilities[..self.model.modes().len()]
    }

    /// The modes' filters with their probabilities.
    fn modes(&self) -> impl Iterator<Item = (&State, f64)> {
        self.states.iter().zip(self.probabilities().iter().copied())
    }

    /// Position extrapolated by `dt_s` seconds if no mode changes; a negative `dt_s` looks back [m].
    pub fn position_after(&self, dt_s: f64) -> Point3<f64> {
        let each = self.modes().map(|(state, probability)| match state {
            State::Velocity(it) => it.position_after(dt_s).coords * probability,
            State::Acceleration(it) => it.position_after(dt_s).coords * probability,
        });
        Point3::from(each.sum::<Vector3<f64>>())
    }

    /// Predicts all modes `dt_s` seconds ahead, the process noise of each multiplied by `noise_scale`.
    ///
    /// Returns `false`, and keeps the state, for a negative or non-finite `dt_s` or scale, or where a covariance overflows.
    pub fn predict(&mut self, dt_s: f64, noise_scale: f64) -> bool {
        if !(dt_s >= 0.0 && dt_s.is_finite() && noise_scale >= 0.0 && noise_scale.is_finite()) {
            return false;
        }
        if dt_s == 0.0 {
            return true;
        }
        let (mut states, expected) = self.mixed(&self.model.transition(dt_s));
        for (state, mode) in states.iter_mut().zip(self.model.modes()) {
            let carried = match (state, mode) {
                (State::Velocity(it), Mode::ConstantVelocity { acceleration_density }) => {
                    it.predict(dt_s, acceleration_density * noise_scale) && it.covariance.sum().is_finite()
                }
                (State::Acceleration(it), Mode::ConstantAcceleration { jerk_density, .. }) => {
                    it.predict(dt_s, jerk_density * noise_scale)
                }
                _ => unreachable!("states are made from the modes"),
            };
            if !carried {
                return false;
            }
        }
        (self.states, self.probabilities) = (states, expected);
        self.merge();
        true
    }

    /// Updates with a pixel: `innovation` is measured minus projected mean of the mixture [px], with `jacobian` taken
    /// there; the innovation of each mode follows from it. The result is that of the mixture.
    pub fn update_pixel(
        &mut self,
        innovation: Vector2<f64>,
        jacobian: &Matrix2x3<f64>,
        measurement_covariance: &Matrix2<f64>,
    ) -> Innovation {
        self.update(innovation, jacobian, measurement_covariance)
    }

    /// Updates with a measured position [m] and its covariance [m²].
    pub fn update_position(&mut self, measured: &Point3<f64>, measurement_covariance: &Matrix3<f64>) -> Innovation {
        self.update(measured - self.mixture.position, &Matrix3::identity(), measurement_covariance)
    }

    /// What each mode starts from, and its probability, when a change has the probabilities of `transition`.
    fn mixed(&self, transition: &Matrix3<f64>) -> ([State; MODES_MAX], [f64; MODES_MAX]) {
        let (n, mut states) = (self.model.modes().len(), self.states.clone());
        let mut expected = [0.0; MODES_MAX];
        for j in 0..n {
            let joint: [f64; MODES_MAX] = std::array::from_fn(|i| transition[(i, j)] * self.probabilities[i]);
            expected[j] = joint.iter().sum();
            if expected[j] <= 0.0 {
                continue; // a mode that cannot hold keeps what it has
            }
            let share = joint.map(|it| it / expected[j]);
            match (&mut states[j], &self.model.modes()[j]) {
                (State::Velocity(receiver), _) => {
                    let (mean, covariance) = moments(&self.states[..n], &share, moving);
                    receiver.position = Point3::from(mean.fixed_rows::<3>(0).into_owned());
                    receiver.velocity = mean.fixed_rows::<3>(3).into_owned();
                    receiver.covariance = covariance;
                }
                (State::Acceleration(receiver), Mode::ConstantAcceleration { acceleration_sigma, .. }) => {
                    let variance = acceleration_sigma * acceleration_sigma;
                    let (mean, covariance) = moments(&self.states[..n], &share, |it| accelerating(it, variance));
                    receiver.position = Point3::from(mean.fixed_rows::<3>(0).into_owned());
                    receiver.velocity = mean.fixed_rows::<3>(3).into_owned();
                    receiver.acceleration = mean.fixed_rows::<3>(6).into_owned();
                    receiver.covariance = covariance;
                }
                _ => unreachable!("states are made from the modes"),
            }
        }
        (states, expected)
    }

    fn update<const N: usize>(
        &mut self,
        innovation: SVector<f64, N>,
        jacobian: &SMatrix<f64, N, 3>,
        noise: &SMatrix<f64, N, N>,
    ) -> Innovation
    where
        SMatrix<f64, N, N>: SmallInverse,
    {
        let n = self.model.modes().len();
        let spread = jacobian * self.mixture.covariance.fixed_view::<3, 3>(0, 0) * jacobian.transpose() + noise;
        let Some((precision, _)) = spread.inverse_and_determinant() else { return Innovation::IMPOSSIBLE };
        let mut states = self.states.clone();
        let mut log_joint = [f64::NEG_INFINITY; MODES_MAX]; // ln (Λⱼ c̄ⱼ)
        for (j, state) in states.iter_mut().enumerate().take(n) {
            let own = |position: &Point3<f64>| innovation + jacobian * (self.mixture.position - position);
            let found = match state {
                State::Velocity(it) => it.update(own(&it.position), jacobian, noise),
                State::Acceleration(it) => it.update(own(&it.position), jacobian, noise),
            };
            if found == Innovation::IMPOSSIBLE {
                return found;
            }
            log_joint[j] = found.log_likelihood + self.probabilities[j].ln();
        }
        let largest = log_joint.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let normalised_squared = innovation.dot(&(precision * innovation));
        if !(largest.is_finite() && normalised_squared.is_finite()) {
            return Innovation::IMPOSSIBLE;
        }
        let weights = log_joint.map(|it| (it - largest).exp());
        let total: f64 = weights.iter().sum();
        self.probabilities = weights.map(|it| it / total);
        self.states = states;
        self.merge();
        Innovation { normalised_squared, log_likelihood: largest + total.ln() }
    }

    /// Computes the mixture again.
    fn merge(&mut self) {
        let n = self.model.modes().len();
        let (mean, covariance) = moments(&self.states[..n], &self.probabilities, moving);
        self.mixture.position = Point3::from(mean.fixed_rows::<3>(0).into_owned());
        self.mixture.velocity = mean.fixed_rows::<3>(3).into_owned();
        self.mixture.covariance = covariance;
    }
}

/// Mean and covariance of Gaussians that are mixed by these shares, which add up to one.
#[inline]
fn moments<const D: usize>(
    states: &[State],
    shares: &[f64; MODES_MAX],
    gaussian: impl Fn(&State) -> (SVector<f64, D>, SMatrix<f64, D, D>),
) -> (SVector<f64, D>, SMatrix<f64, D, D>) {
    let each: [_; MODES_MAX] = std::array::from_fn(|i| gaussian(&states[i.min(states.len() - 1)]));
    // About the first mean rather than about zero: the mean of equal numbers is then that number.
    let origin = each[0].0;
    let mut mean = origin;
    for ((own, _), share) in each.iter().zip(shares).take(states.len()) {
        mean += (own - origin) * *share;
    }
    let mut covariance = SMatrix::zeros();
    for ((own_mean, own), share) in each.iter().zip(shares).take(states.len()) {
        let apart = own_mean - mean;
        covariance += (own + apart * apart.transpose()) * *share;
    }
    (mean, covariance)
}

/// Position and velocity of a mode.
#[inline]
fn moving(state: &State) -> (Vector6<f64>, Matrix6<f64>) {
    match state {
        State::Velocity(it) => (stacked(&it.position, &it.velocity), it.covariance),
        State::Acceleration(it) => it.moving(),
    }
}

/// Position, velocity and acceleration of a mode; where it has none, zero with this variance.
#[inline]
fn accelerating(state: &State, variance: f64) -> (SVector<f64, 9>, SMatrix<f64, 9, 9>) {
    let (mut mean, mut covariance) = (SVector::<f64, 9>::zeros(), SMatrix::<f64, 9, 9>::zeros());
    match state {
        State::Velocity(it) => {
            mean.fixed_rows_mut::<6>(0).copy_from(&stacked(&it.position, &it.velocity));
            covariance.fixed_view_mut::<6, 6>(0, 0).copy_from(&it.covariance);
            covariance.fixed_view_mut::<3, 3>(6, 6).fill_diagonal(variance);
        }
        State::Acceleration(it) => {
            mean.fixed_rows_mut::<6>(0).copy_from(&stacked(&it.position, &it.velocity));
            mean.fixed_rows_mut::<3>(6).copy_from(&it.acceleration);
            covariance = it.covariance;
        }
    }
    (mean, covariance)
}
