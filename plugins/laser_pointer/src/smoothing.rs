//! Jitter filters for the positions of one pointer (none, 1€, or Kalman), with prediction.
//!
//! All of them get the positions of the tracker. Without a filter and with the 1€ filter, prediction uses the tracker's velocity; the Kalman filter has its own. How
//! they compare, at rest and in motion, is drawn by `cargo bench -p foveate-laser-pointer --bench filters`.

use foveate::estimation::{ConstantVelocity, OneEuro, OneEuroOptions};
use foveate::prelude::*;
use nalgebra::{Matrix3, Point2, Point3, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A filter of jitter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum JitterFilter {
    /// None: positions of the tracker.
    None,
    /// The 1€ filter.
    #[default]
    OneEuro,
    /// A Kalman filter of nearly constant velocity.
    Kalman,
}

/// Settings of the filter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SmoothingSettings {
    /// The filter [–]
    pub filter: JitterFilter,
    /// 1€ filter: cutoff at rest. Lower is calmer [Hz]
    #[schemars(range(min = 0.01, max = 1000.0))]
    pub min_cutoff_hz: f64,
    /// 1€ filter: by how much the cutoff rises with speed. Higher lags less [Hz per m/s]
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub beta: f64,
    /// 1€ filter: cutoff of the filtered speed [Hz]
    #[schemars(range(min = 0.01, max = 1000.0))]
    pub speed_cutoff_hz: f64,
    /// Kalman filter: spectral density of a hand's acceleration. Lower is calmer, higher lags less [m²/s³]
    #[schemars(range(min = 0.000001, max = 1000000.0))]
    pub acceleration_density: f64,
    /// Kalman filter: standard deviation of a position's noise, the hand's tremor included; 0: as the tracker states it [mm]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub noise_mm: f64,
    /// A slower pointer is at rest and not extrapolated; a faster one is extrapolated with a velocity reduced by 1 − (`still_m_s`/speed)² [m/s]
    #[schemars(range(min = 0.0, max = 100.0))]
    pub still_m_s: f64,
    /// Longest prediction of a pointer to the moment at which it is shown [ms]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub most_prediction_ms: f64,
}

impl Default for SmoothingSettings {
    fn default() -> Self {
        Self {
            filter: JitterFilter::default(),
            min_cutoff_hz: 0.5,
            beta: 100.0,
            speed_cutoff_hz: 1.0,
            acceleration_density: 3.0,
            noise_mm: 4.0,
            still_m_s: 0.2,
            most_prediction_ms: 100.0,
        }
    }
}

impl SmoothingSettings {
    /// Refuses settings out of range; they are named under `prefix`.
    pub(crate) fn check(&self, prefix: &str) -> Result<(), ConfigError> {
        let named = |name: &str| format!("{prefix}.{name}");
        ConfigError::unless_in(&named("min_cutoff_hz"), self.min_cutoff_hz, 0.01..=1000.0)?;
        ConfigError::unless_in(&named("beta"), self.beta, 0.0..=10_000.0)?;
        ConfigError::unless_in(&named("speed_cutoff_hz"), self.speed_cutoff_hz, 0.01..=1000.0)?;
        ConfigError::unless_in(&named("acceleration_density"), self.acceleration_density, 1e-6..=1e6)?;
        ConfigError::unless_in(&named("noise_mm"), self.noise_mm, 0.0..=1000.0)?;
        ConfigError::unless_in(&named("still_m_s"), self.still_m_s, 0.0..=100.0)?;
        ConfigError::unless_in(&named("most_prediction_ms"), self.most_prediction_ms, 0.0..=1000.0)
    }

    fn one_euro(&self) -> OneEuroOptions {
        let Self { min_cutoff_hz, beta, speed_cutoff_hz, .. } = *self;
        OneEuroOptions { min_cutoff_hz, beta, speed_cutoff_hz }
    }
}

/// Standard deviation of each component of a new pointer's velocity: a hand's speed [m/s].
const FIRST_SPEED: f64 = 1.0;

/// One pointer's filter.
#[derive(Debug, Clone)]
pub struct Smoother {
    settings: SmoothingSettings,
    filter: State,
    /// Velocity by the tracker [m/s].
    tracked_velocity: Vector2<f64>,
}

#[derive(Debug, Clone)]
enum State {
    None(Point2<f64>),
    OneEuro(OneEuro<2>),
    Kalman(Box<ConstantVelocity>),
}

impl Smoother {
    /// A filter for a new pointer at `target`, whose z is ignored.
    pub fn new(settings: &SmoothingSettings, target: &Target) -> Smoother {
        let at = target.position.xy();
        let filter = match settings.filter {
            JitterFilter::None => State::None(at),
            JitterFilter::OneEuro => State::OneEuro(OneEuro::new(settings.one_euro(), at.coords)),
            JitterFilter::Kalman => {
                let noise = noise(settings, target);
                State::Kalman(Box::new(ConstantVelocity::new(Point3::new(at.x, at.y, 0.0), noise, FIRST_SPEED)))
            }
        };
        Smoother { settings: settings.clone(), filter, tracked_velocity: target.velocity.xy() }
    }

    /// Takes in the target `dt_s` after the last one; `false`, and no change, if no time has passed.
    pub fn update(&mut self, target: &Target, dt_s: f64) -> bool {
        if !(dt_s > 0.0 && dt_s.is_finite()) {
            return false;
        }
        let at = target.position.xy();
        self.tracked_velocity = target.velocity.xy();
        match &mut self.filter {
            State::None(position) => *position = at,
            State::OneEuro(filter) => {
                filter.update(at.coords, dt_s);
            }
            State::Kalman(filter) => {
                filter.predict(dt_s, self.settings.acceleration_density);
                filter.update_position(&Point3::new(at.x, at.y, 0.0), &noise(&self.settings, target));
            }
        }
        true
    }

    /// Position on the wall [m].
    pub fn position(&self) -> Point2<f64> {
        match &self.filter {
            State::None(position) => *position,
            State::OneEuro(filter) => filter.value().into(),
            State::Kalman(filter) => filter.position.xy(),
        }
    }

    /// Velocity on the wall [m/s].
    pub fn velocity(&self) -> Vector2<f64> {
        match &self.filter {
            State::Kalman(filter) => filter.velocity.xy(),
            _ => self.tracked_velocity,
        }
    }

    /// Predicted position `span` after the last one, at most `most_prediction_ms` ahead [m]. The velocity is reduced by
    /// 1 − (`still_m_s`/speed)², not below 0: the tremor of a hand at rest is no motion.
    pub fn predicted(&self, span: Interval) -> Point2<f64> {
        let span = span.as_s().clamp(0.0, self.settings.most_prediction_ms * 1e-3);
        let velocity = self.velocity();
        let share = 1.0 - (self.settings.still_m_s / velocity.norm()).powi(2);
        self.position() + velocity * (span * if share > 0.0 { share } else { 0.0 })
    }
}

/// Covariance of a position; z is known, with a small variance so that the matrix can be inverted [m²].
fn noise(settings: &SmoothingSettings, target: &Target) -> Matrix3<f64> {
    let sigma = settings.noise_mm * 1e-3;
    let mut noise = Matrix3::from_diagonal_element(sigma * sigma);
    if sigma == 0.0 {
        noise.fixed_view_mut::<2, 2>(0, 0).copy_from(&target.covariance.fixed_view::<2, 2>(0, 0));
    }
    noise[(2, 2)] = noise[(0, 0)].max(1e-12);
    noise
}
