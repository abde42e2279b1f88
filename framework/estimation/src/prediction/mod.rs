//! Where a moving point will be some hundred milliseconds on: what a device that answers late has to be told now.
//!
//! [Davis 2002 §4.4] carries the target on with its velocity, P' = P + Δt V. What that misses grows with the square of Δt: a target that
//! swings from side to side is overshot at every turn. Here several ways to go on compete:
//!
//! | way | x(t + L) |
//! |---|---|
//! | [`Way::Still`] | x(t) |
//! | [`Way::Velocity`] | x(t) + L v(t), the paper's |
//! | [`Way::Damped`] | x(t) + τ (1 − exp(−L/τ)) v(t): a speed that fades, as that of hands and of those who look for something does |
//! | [`Way::Slowing`] | the same with twice the time constant |
//! | [`Way::Acceleration`] | a filter of nearly constant acceleration |
//! | [`Way::Interacting`] | interacting models of constant velocity and constant acceleration |
//! | [`Way::Linear`] | a combination of recent displacements, fitted to what followed them in the last seconds: `linear` |
//! | [`Way::Cautious`] | the same, fitted so that it hardly leaves a velocity that fades |
//! | [`Way::Weighted`] | all of them but that of constant acceleration, weighted by how well each one foretold what has happened since, what is level and what is upright apart: `weighting` |
//!
//! Acceleration by itself is no member of the mixture: where it fails it fails by the square of the horizon, and the interacting models have it where it holds.
//!
//! Whatever the way, the stated uncertainty is that of the predictions made over the same horizon in the last seconds.

mod history;
mod linear;
mod parts;
#[cfg(test)]
mod tests;
mod weighting;

use nalgebra::{Matrix3, Point3, Vector3};

use self::history::History;
use self::weighting::{PredictorWeighting, WAYS};
use crate::motion::{AdaptiveNoise, Filter, Interacting, Mode, Model};

/// How a point is extrapolated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    /// It stays where it is.
    Still,
    /// It keeps its velocity [Davis 2002 §4.4].
    Velocity,
    /// Its velocity fades.
    Damped,
    /// Its velocity fades half as fast.
    Slowing,
    /// It keeps its acceleration, as a filter finds it.
    Acceleration,
    /// Now this, now that.
    Interacting,
    /// As it went on after displacements like the last ones.
    Linear,
    /// The same, where little is learnt of it.
    Cautious,
    /// What has foretold best of late.
    Weighted,
}

/// The ways that are scored, in the order in which they are kept: all but the last compete.
const SCORED: [Way; WAYS] = [
    Way::Still,
    Way::Velocity,
    Way::Damped,
    Way::Slowing,
    Way::Interacting,
    Way::Linear,
    Way::Cautious,
    Way::Acceleration,
];
/// Time constant of a velocity that fades: that of a reach of a hand, half a second long, about half-way [s].
const FADES_S: f64 = 0.25;
/// The same of one that fades half as fast [s].
const SLOWS_S: f64 = 2.0 * FADES_S;

/// How much a point that is followed jerks, for the filters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PredictorOptions {
    /// How it is extrapolated.
    pub way: Way,
    /// Spectral density of the white-noise jerk [m²/s⁵], above 0.
    pub jerk_density: f64,
    /// Acceleration to be expected of it, each axis, standard deviation [m/s²].
    pub acceleration_sigma: f64,
    /// For how long it counts how well ways did, as a time constant [s].
    pub memory_s: f64,
    /// From where the point is looked at: then what matters, and is learnt from, is what is missed across that line of sight, and not along it, where cameras
    /// are worst. `None`: all directions alike [m].
    pub eye: Option<Point3<f64>>,
}

impl Default for PredictorOptions {
    /// Weighted, for people: jerks of 20 m²/s⁵, accelerations of 4 m/s², a memory of 2 s.
    fn default() -> Self {
        Self { way: Way::Weighted, jerk_density: 20.0, acceleration_sigma: 4.0, memory_s: 2.0, eye: None }
    }
}

/// A point in the future.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    /// Where [m].
    pub position: Point3<f64>,
    /// Of the position, from what predictions over this horizon have missed by of late [m²].
    pub covariance: Matrix3<f64>,
}

/// One point as it moves, and where it will be.
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
    /// The horizon that was asked for last [s].
    horizon_s: f64,
}

/// By this time a velocity is multiplied that fades with the time constant `fades_s`: the way that is made over a horizon [s].
fn faded_s(fades_s: f64, horizon_s: f64) -> f64 {
    fades_s * (1.0 - (-horizon_s / fades_s).exp())
}

/// For how long innovations count for the noise of the filters, as a time constant [s].
const NOISE_MEMORY_S: f64 = 0.5;
/// A point that was away for longer is another motion [s].
const LONGEST_GAP_S: f64 = 0.5;

impl Predictor {
    /// Of a point that has not been seen yet.
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

    /// Forgets all.
    pub fn clear(&mut self) {
        *self = Predictor::new(self.options);
    }

    /// When the point was seen last [s].
    pub fn last_s(&self) -> Option<f64> {
        self.history.last().map(|it| it.time_s)
    }

    /// Takes in where the point was at `time_s`, with its velocity and the covariance of its position [m, m/s, m²]. Samples that are not newer
    /// than the last one, or not finite, change nothing; after a gap of half a second all begins anew.
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
        // A millimetre more than is stated: no covariance that a filter is told is singular.
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
            let foretold = self.by_all(horizon);
            self.weighting.foretell(time_s, horizon, foretold);
        }
    }

    /// Where the point will be at `time_s`; `None` before it was seen. For a time that has passed: where it was.
    pub fn predict(&mut self, time_s: f64) -> Option<Prediction> {
        let last = *self.history.last()?;
        let horizon = time_s - last.time_s;
        if horizon <= 0.0 {
            let position = self.history.at(time_s)?;
            return Some(Prediction { position, covariance: Matrix3::zeros() });
        }
        self.horizon_s = horizon;
        let foretold = self.by(self.options.way, horizon);
        let way = SCORED.iter().position(|it| *it == self.options.way);
        let variance = self.weighting.variance(way, horizon);
        Some(Prediction { position: foretold, covariance: Matrix3::identity() * variance })
    }

    /// What all of [`SCORED`] say; before there is a sample this is not asked.
    fn by_all(&self, horizon_s: f64) -> [Point3<f64>; WAYS] {
        let linear = linear::predict(&self.history, horizon_s, self.options.eye.as_ref());
        SCORED.map(|way| match way {
            Way::Linear => linear[0],
            Way::Cautious => linear[1],
            way => self.by(way, horizon_s),
        })
    }

    /// One way's answer; before there is a sample this is not asked.
    fn by(&self, way: Way, horizon_s: f64) -> Point3<f64> {
        let Some(last) = self.history.last() else { return Point3::origin() };
        let by_filter =
            |index: usize| self.filters.as_ref().map_or(last.position, |it| it[index].position_after(horizon_s));
        let linear = || linear::predict(&self.history, horizon_s, self.options.eye.as_ref());
        match way {
            Way::Still => last.position,
            Way::Velocity => last.position + self.stated_velocity * horizon_s,
            Way::Damped => last.position + self.stated_velocity * faded_s(FADES_S, horizon_s),
            Way::Slowing => last.position + self.stated_velocity * faded_s(SLOWS_S, horizon_s),
            Way::Acceleration => by_filter(0),
            Way::Interacting => by_filter(1),
            Way::Linear => linear()[0],
            Way::Cautious => linear()[1],
            Way::Weighted => self.weighting.weigh(&self.by_all(horizon_s)),
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
