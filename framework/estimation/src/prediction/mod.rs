//! Predicts where a moving point will be some hundred milliseconds ahead, for devices with latency such as pan-tilt heads.
//!
//! [Davis 2002 §4.4] extrapolates the target with its velocity, P' = P + Δt V. The error grows with the square of Δt:
//! a target that swings from side to side is overshot at every turn. Here several methods compete:
//!
//! | method | x(t + L) |
//! |---|---|
//! | [`PredictionMethod::Still`] | x(t) |
//! | [`PredictionMethod::Velocity`] | x(t) + L v(t), the paper's |
//! | [`PredictionMethod::Damped`] | x(t) + τ (1 − exp(−L/τ)) v(t): a fading velocity, as of hands that reach and of people who search |
//! | [`PredictionMethod::Slowing`] | the same with twice the time constant |
//! | [`PredictionMethod::Acceleration`] | a filter of nearly constant acceleration |
//! | [`PredictionMethod::Interacting`] | interacting models of constant velocity and constant acceleration |
//! | [`PredictionMethod::Linear`] | a combination of recent displacements, fitted to what followed them in the last seconds: `linear` |
//! | [`PredictionMethod::Cautious`] | the same, with weights held near a fading velocity |
//! | [`PredictionMethod::Weighted`] | all of them but constant acceleration, weighted by recent prediction error, level and upright motion separately: `weighting` |
//!
//! Constant acceleration by itself is not part of the mixture: its error grows with the square of the horizon where it
//! does not hold, and the interacting models include it where it does.
//!
//! Whatever the method, the stated covariance comes from the errors of recent predictions over the same horizon.

mod history;
mod linear;
mod parts;
#[cfg(test)]
mod tests;
mod weighting;

use nalgebra::{Matrix3, Point3, Vector3};

use self::history::History;
use self::weighting::{METHODS, PredictorWeighting};
use crate::motion::{AdaptiveNoise, Filter, Interacting, Mode, Model};

/// How a point is extrapolated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PredictionMethod {
    /// The point stays where it is.
    Still,
    /// The point keeps its velocity [Davis 2002 §4.4].
    Velocity,
    /// The velocity fades.
    Damped,
    /// The velocity fades half as fast.
    Slowing,
    /// The point keeps its acceleration, as a filter estimates it.
    Acceleration,
    /// Interacting models of constant velocity and constant acceleration.
    Interacting,
    /// Linear prediction: continues as it did after similar displacements.
    Linear,
    /// Linear prediction with weights held near a fading velocity.
    Cautious,
    /// All methods but constant acceleration, weighted by recent prediction error.
    Weighted,
}

/// The methods that are scored, in the order in which they are kept: all but the last compete.
const SCORED: [PredictionMethod; METHODS] = [
    PredictionMethod::Still,
    PredictionMethod::Velocity,
    PredictionMethod::Damped,
    PredictionMethod::Slowing,
    PredictionMethod::Interacting,
    PredictionMethod::Linear,
    PredictionMethod::Cautious,
    PredictionMethod::Acceleration,
];
/// Time constant of a velocity that fades: that of a reach of a hand, half a second long, about half-way [s].
const FADES_S: f64 = 0.25;
/// The same of one that fades half as fast [s].
const SLOWS_S: f64 = 2.0 * FADES_S;

/// Settings of a [`Predictor`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PredictorOptions {
    /// How the point is extrapolated.
    pub method: PredictionMethod,
    /// Spectral density of the white-noise jerk [m²/s⁵], above 0.
    pub jerk_density: f64,
    /// Prior standard deviation of the acceleration, each axis [m/s²].
    pub acceleration_sigma: f64,
    /// Time constant over which prediction errors are averaged for the weights [s].
    pub memory_s: f64,
    /// Where the point is observed from: only errors across that line of sight are then counted and learnt from, not
    /// those along it, where cameras measure worst. `None`: all directions count alike [m].
    pub eye: Option<Point3<f64>>,
}

impl Default for PredictorOptions {
    /// Weighted, for people: jerk density 20 m²/s⁵, accelerations of 4 m/s², a memory of 2 s.
    fn default() -> Self {
        Self {
            method: PredictionMethod::Weighted,
            jerk_density: 20.0,
            acceleration_sigma: 4.0,
            memory_s: 2.0,
            eye: None,
        }
    }
}

/// A predicted position with covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    /// Predicted position [m].
    pub position: Point3<f64>,
    /// Covariance of the position, from the errors of recent predictions over this horizon [m²].
    pub covariance: Matrix3<f64>,
}

/// Predicts one moving point.
#[derive(Debug, Clone)]
pub struct Predictor {
    options: PredictorOptions,
    history: History,
    /// Both filters at the time of the newest sample; `None` before the first.
    filters: Option<[Filter; 2]>,
    /// Their noise follows what they miss: the same rules serve a hand and a field.
    noise: [AdaptiveNoise; 2],
    weighting: PredictorWeighting,
    /// The velocity that came with the newest sample [m/s].
    stated_velocity: Vector3<f64>,
    /// The horizon that was requested last [s].
    horizon_s: f64,
}

/// By this time a velocity is multiplied that fades with the time constant `fades_s`: the method that is made over a horizon [s].
fn faded_s(fades_s: f64, horizon_s: f64) -> f64 {
    fades_s * (1.0 - (-horizon_s / fades_s).exp())
}

/// For how long innovations count for the noise of the filters, as a time constant [s].
const NOISE_MEMORY_S: f64 = 0.5;
/// A point that was away for longer is another motion [s].
const LONGEST_GAP_S: f64 = 0.5;

impl Predictor {
    /// A predictor of a point without observations.
    pub fn new(options: PredictorOptions) -> Predictor {
        let weighting = PredictorWeighting::new(options.memory_s, options.eye);
        let noise = [AdaptiveNoise::bounded(NOISE_MEMORY_S, 0.1, 1e5); 2];
        Predictor {
            options,
            history: History::default(),
            filters: None,
            noise,
            weighting,
            stated_velocity: Vector3::zeros(),
            horizon_s: 0.3,
        }
    }

    /// Discards all observations.
    pub fn clear(&mut self) {
        *self = Predictor::new(self.options);
    }

    /// Time of the last observation [s].
    pub fn last_s(&self) -> Option<f64> {
        self.history.last().map(|it| it.time_s)
    }

    /// Takes in the position of the point at `time_s`, with its velocity and the covariance of the position [m, m/s,
    /// m²]. Samples that are not newer than the last one, or not finite, are ignored; after a gap of half a second the
    /// predictor starts again.
    pub fn observe(&mut self, time_s: f64, position: Point3<f64>, velocity: Vector3<f64>, covariance: &Matrix3<f64>) {
        let finite = time_s.is_finite()
            && position.iter().chain(velocity.iter()).chain(covariance.iter()).all(|it| it.is_finite());
        let newest = self.last_s();
        if !finite || newest.is_some_and(|it| time_s <= it) {
            return;
        }
        if newest.is_some_and(|it| time_s - it > LONGEST_GAP_S) {
            self.clear();
        }
        // A millimetre more than is stated: no covariance that a filter gets is singular.
        let stated = covariance + Matrix3::identity() * 1e-6;
        match (&mut self.filters, newest) {
            (Some(filters), Some(last)) => {
                for (filter, noise) in filters.iter_mut().zip(&mut self.noise) {
                    filter.predict_scaled(time_s - last, noise.scale());
                    let innovation = filter.update_position(&position, &stated);
                    noise.observe(innovation.normalised_squared, 3, time_s - last);
                }
            }
            _ => {
                let filter = |model: &Model| Filter::new(model, position, stated, velocity, 1.0);
                self.filters = Some([filter(&self.acceleration()), filter(&self.interacting())]);
            }
        }
        self.stated_velocity = velocity;
        // The velocity that is stated trembles more than the filter's lags.
        let velocity = self.filters.as_ref().map_or(velocity, |it| it[0].velocity());
        if self.history.push(time_s, position, velocity) {
            self.weighting.score(time_s, &self.history);
            let horizon = self.horizon_s;
            let predicted = self.by_all(horizon);
            self.weighting.store(time_s, horizon, predicted);
        }
    }

    /// Predicts the position at `time_s`; for a time in the past, the observed position. `None` before the first observation.
    pub fn predict(&mut self, time_s: f64) -> Option<Prediction> {
        let last = *self.history.last()?;
        let horizon = time_s - last.time_s;
        if horizon <= 0.0 {
            let position = self.history.at(time_s)?;
            return Some(Prediction { position, covariance: Matrix3::zeros() });
        }
        self.horizon_s = horizon;
        let predicted = self.by(self.options.method, horizon);
        let method = SCORED.iter().position(|it| *it == self.options.method);
        let variance = self.weighting.variance(method, horizon);
        Some(Prediction { position: predicted, covariance: Matrix3::identity() * variance })
    }

    /// What all of [`SCORED`] say; before there is a sample this is not asked.
    fn by_all(&self, horizon_s: f64) -> [Point3<f64>; METHODS] {
        let linear = linear::predict(&self.history, horizon_s, self.options.eye.as_ref());
        SCORED.map(|method| match method {
            PredictionMethod::Linear => linear[0],
            PredictionMethod::Cautious => linear[1],
            method => self.by(method, horizon_s),
        })
    }

    /// One method's answer; before there is a sample this is not asked.
    fn by(&self, method: PredictionMethod, horizon_s: f64) -> Point3<f64> {
        let Some(last) = self.history.last() else { return Point3::origin() };
        let by_filter =
            |index: usize| self.filters.as_ref().map_or(last.position, |it| it[index].position_after(horizon_s));
        let linear = || linear::predict(&self.history, horizon_s, self.options.eye.as_ref());
        match method {
            PredictionMethod::Still => last.position,
            PredictionMethod::Velocity => last.position + self.stated_velocity * horizon_s,
            PredictionMethod::Damped => last.position + self.stated_velocity * faded_s(FADES_S, horizon_s),
            PredictionMethod::Slowing => last.position + self.stated_velocity * faded_s(SLOWS_S, horizon_s),
            PredictionMethod::Acceleration => by_filter(0),
            PredictionMethod::Interacting => by_filter(1),
            PredictionMethod::Linear => linear()[0],
            PredictionMethod::Cautious => linear()[1],
            PredictionMethod::Weighted => self.weighting.weigh(&self.by_all(horizon_s)),
        }
    }

    fn acceleration(&self) -> Model {
        let PredictorOptions { jerk_density, acceleration_sigma, .. } = self.options;
        Model::ConstantAcceleration { jerk_density, acceleration_sigma }
    }

    fn interacting(&self) -> Model {
        let PredictorOptions { jerk_density, acceleration_sigma, .. } = self.options;
        let modes = [
            (Mode::ConstantVelocity { acceleration_density: 0.1 }, 1.0),
            (Mode::ConstantAcceleration { jerk_density: 3.0 * jerk_density, acceleration_sigma }, 0.5),
        ];
        Interacting::new(&modes).map_or_else(|_| self.acceleration(), Model::Interacting)
    }
}
