//! One filter type for every motion model.

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Matrix6, Point3, Vector2, Vector3};

use super::{ConstantAcceleration, InteractingFilter, Model};
use crate::kalman::{ConstantVelocity, Innovation};

/// A track of a moving point under a [`Model`].
///
/// Prediction and updates allocate nothing; the state of the larger models lies in a box, so that many filters of constant
/// velocity lie close together.
#[derive(Debug, Clone, PartialEq)]
pub struct Filter(State);

#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "the large one is the frequent one, and to be reached without a pointer")]
enum State {
    Velocity { filter: ConstantVelocity, acceleration_density: f64 },
    Acceleration(Box<Jerky>),
    Interacting(Box<InteractingFilter>),
}

#[derive(Debug, Clone, PartialEq)]
struct Jerky {
    filter: ConstantAcceleration,
    jerk_density: f64,
}

impl Filter {
    /// Initiates a track at `position` with `position_covariance` [m²] and `velocity` [m/s] (zero if unknown), each
    /// axis of the velocity with the standard deviation `velocity_sigma` [m/s].
    pub fn new(
        model: &Model,
        position: Point3<f64>,
        position_covariance: Matrix3<f64>,
        velocity: Vector3<f64>,
        velocity_sigma: f64,
    ) -> Filter {
        Filter(match *model {
            Model::ConstantVelocity { acceleration_density } => {
                let at_rest = ConstantVelocity::new(position, position_covariance, velocity_sigma);
                State::Velocity { filter: ConstantVelocity { velocity, ..at_rest }, acceleration_density }
            }
            Model::ConstantAcceleration { jerk_density, acceleration_sigma } => {
                let filter = ConstantAcceleration::new(
                    position,
                    position_covariance,
                    velocity,
                    velocity_sigma,
                    acceleration_sigma,
                );
                State::Acceleration(Box::new(Jerky { filter, jerk_density }))
            }
            Model::Interacting(model) => State::Interacting(Box::new(InteractingFilter::new(
                &model,
                position,
                position_covariance,
                velocity,
                velocity_sigma,
            ))),
        })
    }

    /// Mean position [m].
    #[inline]
    pub fn position(&self) -> Point3<f64> {
        match &self.0 {
            State::Velocity { filter, .. } => filter.position,
            State::Acceleration(it) => it.filter.position,
            State::Interacting(it) => it.mixture().position,
        }
    }

    /// Mean velocity [m/s].
    #[inline]
    pub fn velocity(&self) -> Vector3<f64> {
        match &self.0 {
            State::Velocity { filter, .. } => filter.velocity,
            State::Acceleration(it) => it.filter.velocity,
            State::Interacting(it) => it.mixture().velocity,
        }
    }

    /// Mean acceleration [m/s²]; zero where the model has none.
    pub fn acceleration(&self) -> Vector3<f64> {
        match &self.0 {
            State::Velocity { .. } => Vector3::zeros(),
            State::Acceleration(it) => it.filter.acceleration,
            State::Interacting(it) => it.acceleration(),
        }
    }

    /// Covariance of the position [m²].
    #[inline]
    pub fn position_covariance(&self) -> Matrix3<f64> {
        match &self.0 {
            State::Velocity { filter, .. } => filter.position_covariance(),
            State::Acceleration(it) => it.filter.covariance.fixed_view::<3, 3>(0, 0).into_owned(),
            State::Interacting(it) => it.mixture().position_covariance(),
        }
    }

    /// Covariance of (position, velocity) [m², m²/s, m²/s²].
    #[inline]
    pub fn covariance(&self) -> Matrix6<f64> {
        match &self.0 {
            State::Velocity { filter, .. } => filter.covariance,
            State::Acceleration(it) => it.filter.covariance.fixed_view::<6, 6>(0, 0).into_owned(),
            State::Interacting(it) => it.mixture().covariance,
        }
    }

    /// Probability of each mode of an interacting model, in its order; empty for the other models.
    pub fn mode_probabilities(&self) -> &[f64] {
        match &self.0 {
            State::Interacting(it) => it.probabilities(),
            State::Velocity { .. } | State::Acceleration(_) => &[],
        }
    }

    /// Position extrapolated by `dt_s` seconds; a negative `dt_s` looks back [m].
    #[inline]
    pub fn position_after(&self, dt_s: f64) -> Point3<f64> {
        match &self.0 {
            State::Velocity { filter, .. } => filter.position_after(dt_s),
            State::Acceleration(it) => it.filter.position_after(dt_s),
            State::Interacting(it) => it.position_after(dt_s),
        }
    }

    /// Predicts the state `dt_s` seconds ahead.
    ///
    /// Returns `false`, and keeps the state, for a negative or non-finite `dt_s`.
    #[inline]
    pub fn predict(&mut self, dt_s: f64) -> bool {
        self.predict_scaled(dt_s, 1.0)
    }

    /// As [`Self::predict`], with the density of the process noise multiplied by `noise_scale`, 0 or more
    /// (see [`AdaptiveNoise`](super::AdaptiveNoise)).
    #[inline]
    pub fn predict_scaled(&mut self, dt_s: f64, noise_scale: f64) -> bool {
        match &mut self.0 {
            State::Velocity { filter, acceleration_density } => {
                filter.predict(dt_s, *acceleration_density * noise_scale)
            }
            State::Acceleration(it) => it.filter.predict(dt_s, it.jerk_density * noise_scale),
            State::Interacting(it) => it.predict(dt_s, noise_scale),
        }
    }

    /// Innovation covariance S of a pixel, for gating [px²]: `jacobian` is the derivative of the pixel with respect to
    /// the position [px/m] at [`Self::position`], `measurement_covariance` the covariance of the pixel itself [px²].
    #[inline]
    pub fn innovation_covariance(
        &self,
        jacobian: &Matrix2x3<f64>,
        measurement_covariance: &Matrix2<f64>,
    ) -> Matrix2<f64> {
        match &self.0 {
            State::Velocity { filter, .. } => filter.innovation_covariance(jacobian, measurement_covariance),
            State::Interacting(it) => it.mixture().innovation_covariance(jacobian, measurement_covariance),
            State::Acceleration(it) => {
                jacobian * it.filter.covariance.fixed_view::<3, 3>(0, 0) * jacobian.transpose() + measurement_covariance
            }
        }
    }

    /// Updates with a pixel (extended Kalman filter): `innovation` is measured minus projected [px], the rest as for
    /// [`Self::innovation_covariance`]. An interacting model linearises all its modes at the mean of the mixture.
    #[inline]
    pub fn update_pixel(
        &mut self,
        innovation: Vector2<f64>,
        jacobian: &Matrix2x3<f64>,
        measurement_covariance: &Matrix2<f64>,
    ) -> Innovation {
        match &mut self.0 {
            State::Velocity { filter, .. } => filter.update_pixel(innovation, jacobian, measurement_covariance),
            State::Acceleration(it) => it.filter.update_pixel(innovation, jacobian, measurement_covariance),
            State::Interacting(it) => it.update_pixel(innovation, jacobian, measurement_covariance),
        }
    }

    /// Updates with a measured position [m] and its covariance [m²].
    pub fn update_position(&mut self, measured: &Point3<f64>, measurement_covariance: &Matrix3<f64>) -> Innovation {
        match &mut self.0 {
            State::Velocity { filter, .. } => filter.update_position(measured, measurement_covariance),
            State::Acceleration(it) => it.filter.update_position(measured, measurement_covariance),
            State::Interacting(it) => it.update_position(measured, measurement_covariance),
        }
    }
}
