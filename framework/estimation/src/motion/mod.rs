//! Motion models for tracks of a point, behind one filter type: the model is a setting.
//!
//! | model | state | what is random |
//! |---|---|---|
//! | [`Model::ConstantVelocity`] | position, velocity | acceleration: white noise, [`ConstantVelocity`] |
//! | [`Model::ConstantAcceleration`] | and acceleration | jerk: white noise, [`ConstantAcceleration`] |
//! | [`Model::Interacting`] | those of two or three modes | and which mode holds: [`Interacting`] |
//!
//! [`AdaptiveNoise`] scales the process noise of any of them by the innovations.

mod adaptive;
mod constant_acceleration;
mod filter;
mod interacting;
mod markov;
#[cfg(test)]
mod tests;

pub use adaptive::AdaptiveNoise;
pub use constant_acceleration::ConstantAcceleration;
pub use filter::Filter;
pub use interacting::{InteractingFilter, MODES_MAX};
pub use markov::{BadModel, Interacting};

/// Motion model of a track.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Model {
    /// Nearly constant velocity.
    ConstantVelocity {
        /// Spectral density of the white-noise acceleration [m²/s³], 0 or more.
        acceleration_density: f64,
    },
    /// Nearly constant acceleration.
    ConstantAcceleration {
        /// Spectral density of the white-noise jerk [m²/s⁵], 0 or more.
        jerk_density: f64,
        /// Prior standard deviation of the acceleration, each axis [m/s²].
        acceleration_sigma: f64,
    },
    /// Switches between modes (IMM).
    Interacting(Interacting),
}

/// One of the models that an [`Interacting`] model switches between.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Mode {
    /// As [`Model::ConstantVelocity`].
    ConstantVelocity {
        /// Spectral density of the white-noise acceleration [m²/s³], 0 or more.
        acceleration_density: f64,
    },
    /// As [`Model::ConstantAcceleration`].
    ConstantAcceleration {
        /// Spectral density of the white-noise jerk [m²/s⁵], 0 or more.
        jerk_density: f64,
        /// Standard deviation of the acceleration, each axis, when the point enters this mode from one without acceleration [m/s²].
        acceleration_sigma: f64,
    },
}

impl From<Mode> for Model {
    fn from(mode: Mode) -> Model {
        match mode {
            Mode::ConstantVelocity { acceleration_density } => Model::ConstantVelocity { acceleration_density },
            Mode::ConstantAcceleration { jerk_density, acceleration_sigma } => {
                Model::ConstantAcceleration { jerk_density, acceleration_sigma }
            }
        }
    }
}
