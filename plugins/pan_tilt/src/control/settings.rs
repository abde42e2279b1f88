//! Settings of tracking a target with a head.

use foveate::estimation::{ActuatorOptions, PredictionMethod, PredictorOptions};
use foveate::prelude::ConfigError;
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Prediction of the target to the moment at which a command takes effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(extend("x-formerly" = { "learned": "linear", "contest": "weighted" }))]
pub enum PredictorKind {
    /// No prediction.
    None,
    /// With its velocity [Davis 2002 §4.4].
    Velocity,
    /// With a velocity that fades within a quarter of a second.
    Damped,
    /// With a velocity that fades within half a second.
    Slowing,
    /// With its acceleration.
    Acceleration,
    /// Interacting models: now at constant velocity, now not.
    Interacting,
    /// Linear prediction: a combination of recent displacements, fitted to what followed them [Prony].
    Linear,
    /// The same, fitted so that it hardly leaves a velocity that fades.
    Cautious,
    /// All of these but that with its acceleration, weighted by their recent prediction errors: what is level and what is upright apart.
    #[default]
    Weighted,
}

/// Source of the head's latency.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LatencyFrom {
    /// The setting, from the capture time of the target to the head's movement.
    Fixed,
    /// Estimated during the run from commands and position answers; the setting is the initial value.
    #[default]
    Measured,
}

/// Control of the head.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(extend("x-formerly" = { "pursuit": "predictive" }))]
pub enum Control {
    /// To the predicted target, with a speed proportional to the distance [Davis 2002 §4.3].
    Step,
    /// Along with the target: of all possible commands, the one whose predicted motion of the motors stays nearest to the predicted target
    /// (model predictive control).
    #[default]
    Predictive,
}

/// Settings of [`Selector`](crate::selector::Selector).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ControlSettings {
    /// Number of the tracked target; left out: the target that the scale is anchored to, or the one that an allocator assigns [–]
    pub target: Option<u32>,
    /// Prediction of the target to the moment at which a command takes effect [–].
    pub predictor: PredictorKind,
    /// Source of the latency: `fixed` or `estimated` [–].
    pub latency: LatencyFrom,
    /// Initial latency from the capture of the target's position to the head's movement [ms].
    #[schemars(range(min = 0.0, max = 800.0))]
    pub latency_ms: f64,
    /// Control of the head: `step` or `predictive` [–].
    pub control: Control,
    /// Most commands per second: on a line of 9600 baud a head takes about 19, and more than 30 fill its queue [Hz].
    #[schemars(range(min = 1.0, max = 120.0))]
    pub rate_hz: f64,
    /// With `control = "step"`: time in which the remaining distance is covered: shorter is nearer to the target and shakes more [ms].
    #[schemars(range(min = 10.0, max = 5000.0))]
    pub settle_ms: f64,
    /// Time constant for smoothing the target's direction while it is slow; less smoothing the faster it is [ms].
    #[schemars(range(min = 0.0, max = 5000.0))]
    pub damping_ms: f64,
    /// Dead band for slow targets, so that the head does not oscillate [°].
    #[schemars(range(min = 0.0, max = 10.0))]
    pub dead_band_deg: f64,
    /// Largest speed of a slow target, as seen by the head [°/s].
    #[schemars(range(min = 0.0, max = 100.0))]
    pub still_deg_per_s: f64,
    /// Largest speed of the head: pan and tilt [°/s].
    #[schemars(inner(range(min = 0.1, max = 1000.0)))]
    pub max_speed_deg_per_s: [f64; 2],
    /// Number of speeds, even parts of the largest: pan and tilt, each 1 to 1000. Default: the EVI-D30's [–].
    #[schemars(inner(range(min = 1, max = 1000)))]
    pub speeds: [u32; 2],
    /// Approximate acceleration of the head; it is estimated during the run [°/s²].
    #[schemars(range(min = 10.0, max = 10_000.0))]
    pub acceleration_deg_per_s2: f64,
    /// Time without an observation after which a target is lost: the head stays where it is until it is seen again [ms].
    #[schemars(range(min = 10.0, max = 60_000.0))]
    pub lost_ms: f64,
    /// Settings that the head visits repeatedly while there is no target, to find one and to let cameras learn their background; left out: it stays where it is. Each pan -360 to 360, tilt -180 to 180 [°]
    pub patrol_deg: Vec<[f64; 2]>,
    /// Speed between these settings [°/s].
    #[schemars(range(min = 0.1, max = 1000.0))]
    pub patrol_deg_per_s: f64,
    /// Time at each of them [ms].
    #[schemars(range(min = 0.0, max = 60_000.0))]
    pub patrol_stay_ms: f64,
    /// Radius of the sub-region around the target; 0: that of the scale [m].
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub radius_m: f64,
    /// Zoom of the head: the sub-region covers this part of half the image's shorter side; 0: the zoom is not controlled [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub fill: f64,
}

impl Default for ControlSettings {
    fn default() -> Self {
        Self {
            target: None,
            predictor: PredictorKind::Weighted,
            latency: LatencyFrom::Measured,
            latency_ms: 300.0,
            control: Control::Predictive,
            rate_hz: 20.0,
            settle_ms: 100.0,
            damping_ms: 100.0,
            dead_band_deg: 0.12,
            still_deg_per_s: 2.0,
            max_speed_deg_per_s: [80.0, 50.0],
            speeds: [24, 20],
            acceleration_deg_per_s2: 400.0,
            lost_ms: 500.0,
            patrol_deg: Vec::new(),
            patrol_deg_per_s: 40.0,
            patrol_stay_ms: 200.0,
            radius_m: 0.0,
            fill: 0.0,
        }
    }
}

impl ControlSettings {
    /// Refuses settings out of range.
    ///
    /// # Errors
    /// The first such setting.
    pub fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("latency_ms", self.latency_ms, 0.0..=800.0)?;
        ConfigError::unless_in("rate_hz", self.rate_hz, 1.0..=120.0)?;
        for [pan, tilt] in &self.patrol_deg {
            ConfigError::unless_in("patrol_deg", *pan, -360.0..=360.0)?;
            ConfigError::unless_in("patrol_deg", *tilt, -180.0..=180.0)?;
        }
        ConfigError::unless_in("patrol_deg_per_s", self.patrol_deg_per_s, 0.1..=1000.0)?;
        ConfigError::unless_in("patrol_stay_ms", self.patrol_stay_ms, 0.0..=60_000.0)?;
        ConfigError::unless_in("settle_ms", self.settle_ms, 10.0..=5000.0)?;
        ConfigError::unless_in("damping_ms", self.damping_ms, 0.0..=5000.0)?;
        ConfigError::unless_in("dead_band_deg", self.dead_band_deg, 0.0..=10.0)?;
        ConfigError::unless_in("still_deg_per_s", self.still_deg_per_s, 0.0..=100.0)?;
        for speed in self.max_speed_deg_per_s {
            ConfigError::unless_in("max_speed_deg_per_s", speed, 0.1..=1000.0)?;
        }
        for speeds in self.speeds {
            ConfigError::unless_in("speeds", speeds, 1..=1000)?;
        }
        ConfigError::unless_in("acceleration_deg_per_s2", self.acceleration_deg_per_s2, 10.0..=10_000.0)?;
        ConfigError::unless_in("lost_ms", self.lost_ms, 10.0..=60_000.0)?;
        ConfigError::unless_in("radius_m", self.radius_m, 0.0..=1000.0)?;
        ConfigError::unless_in("fill", self.fill, 0.0..=1.0)
    }

    pub(super) fn predictor_options(&self, eye: Point3<f64>) -> PredictorOptions {
        let method = match self.predictor {
            PredictorKind::None => PredictionMethod::Still,
            PredictorKind::Velocity => PredictionMethod::Velocity,
            PredictorKind::Damped => PredictionMethod::Damped,
            PredictorKind::Slowing => PredictionMethod::Slowing,
            PredictorKind::Acceleration => PredictionMethod::Acceleration,
            PredictorKind::Interacting => PredictionMethod::Interacting,
            PredictorKind::Linear => PredictionMethod::Linear,
            PredictorKind::Cautious => PredictionMethod::Cautious,
            PredictorKind::Weighted => PredictionMethod::Weighted,
        };
        PredictorOptions { method, eye: Some(eye), ..PredictorOptions::default() }
    }

    pub(super) fn actuator_options(&self) -> ActuatorOptions {
        ActuatorOptions {
            latency_s: [(self.latency_ms * 1e-3 - 0.03).max(0.0), 0.08],
            acceleration: self.acceleration_deg_per_s2.to_radians(),
            ..ActuatorOptions::default()
        }
    }
}
