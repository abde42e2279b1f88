//! Settings of the integrator, with the reasons for their defaults.

use foveate::estimation::motion::{Interacting, Mode, Model};
use foveate::prelude::ConfigError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// For how long the acceleration, or the jerk, of a target is taken to keep its value [s].
const CHANGE_LASTS_S: f64 = 0.1;
/// How long a target stays calm, or agile, on average [s].
const CALM_LASTS_S: f64 = 1.0;
const AGILE_LASTS_S: f64 = 0.3;

/// How a target is expected to move.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MotionModel {
    /// Nearly constant velocity; `acceleration_m_s2` is how far from it [Davis 2002 §3.4, Figures 42 to 44].
    #[default]
    ConstantVelocity,
    /// Nearly constant acceleration; `jerk_m_s3` is how far from it.
    ConstantAcceleration,
    /// Now calm, with `calm_m_s2`, now agile, with `acceleration_m_s2`: which, is estimated for each target.
    Interacting,
}

/// What happens to a frame captured before the filter's time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(extend("x-formerly" = { "refilter": "out_of_sequence" }))]
pub enum LateRule {
    /// It is discarded. With clocks that disagree this starves cameras [Davis 2002, Figure 35].
    Discard,
    /// It is applied as though it were of the filter's time, up to `late_tolerance_ms`: the rule of [Davis 2002 §3.5].
    #[default]
    Apply,
    /// The filters are taken back to its time and on again, up to `history_ms`.
    OutOfSequence,
}

/// What is made of the clocks of the cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Clocks {
    /// Stamps are taken as they are.
    #[default]
    Trust,
    /// Offset and drift of each clock are estimated from what moves, and shown at the end.
    Estimate,
    /// And stamps are corrected by them.
    Correct,
}

/// How features are given to targets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AssociationMethod {
    /// The best pair first, then the best of the rest [Davis 2002 §3.4].
    Nearest,
    /// The pairs whose costs have the least sum.
    #[default]
    Global,
    /// As `global`, and where one frame cannot tell, several answers are kept until later frames can. A spot that is two lights is then the spot of one of them.
    Hypotheses,
}

/// Settings of [`Integrator`](crate::integrator::Integrator).
///
/// Lengths in `_mm` are thousandths of the calibration's unit of length: where that is unknown (a calibration without a
/// measured length), they have to be chosen for its scale, and so have accelerations and speeds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct IntegratorSettings {
    /// How a target is expected to move: `constant_velocity`; `constant_acceleration` (`jerk_m_s3` counts; twice the time); `interacting`: now
    /// calm, now agile, which is found for each target (five times the time; best for lights that cross and turn) [–].
    pub motion: MotionModel,
    /// Acceleration to be expected of a target, standard deviation, taken to be independent from one tenth of a second to
    /// the next: the filter's white noise has the spectral density a² · 0.1 s. A walking person's wrist reaches 20 [m/s²].
    #[schemars(range(min = 0.001, max = 10000.0))]
    pub acceleration_m_s2: f64,
    /// With `motion = "constant_acceleration"`: change of the acceleration to be expected, standard deviation, likewise [m/s³].
    #[schemars(range(min = 0.001, max = 1000000.0))]
    pub jerk_m_s3: f64,
    /// With `motion = "interacting"`: acceleration to be expected while the target is calm, standard deviation, likewise [m/s²].
    #[schemars(range(min = 0.0001, max = 10000.0))]
    pub calm_m_s2: f64,
    /// Whether each target's noise follows its innovations: up where it turns faster than the settings say, to 64 times, and a little
    /// down where it is calmer, to 0.4 times [–].
    pub adapt_noise: bool,
    /// Error of a camera's model, one axis, standard deviation, added to each feature's own covariance [px].
    #[schemars(range(min = 0.001, max = 100.0))]
    pub camera_error_px: f64,
    /// A feature belongs to a target only within this many standard deviations of where the filter expects it [–].
    #[schemars(range(min = 1.0, max = 100.0))]
    pub gate_sigma: f64,
    /// And never further from there than this, however uncertain the filter is [px].
    #[schemars(range(min = 0.1, max = 10000.0))]
    pub gate_px: f64,
    /// Lines of sight this close to a point meet there. Covers the motion between unsynchronised frames as well, and so limits
    /// the speed of a target at its initiation [mm].
    #[schemars(range(min = 0.001, max = 1000000.0))]
    #[schemars(extend("x-formerly" = "birth_tolerance_mm"))]
    pub initiation_tolerance_mm: f64,
    /// Different cameras whose lines of sight must meet where a target is initiated. The paper used 2; with several lights, two
    /// lines of different lights meet by accident many times a second, three rarely [–].
    #[schemars(range(min = 2, max = 1000))]
    #[schemars(extend("x-formerly" = "birth_cameras"))]
    pub initiation_cameras: u32,
    /// And this part of the cameras whose field of view contains the point and that sent a frame within `stale_after_ms`.
    /// Keeps accidents out where many cameras look on; hidden and fast lights need a low value [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    #[schemars(extend("x-formerly" = "birth_share"))]
    pub initiation_share: f64,
    /// A target is given out at its initiation when this part of those cameras agrees; otherwise once three more frames have seen it,
    /// and `initiation_share` of all that show its place. 0: always at once, as in the paper [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    #[schemars(extend("x-formerly" = "birth_sure_share"))]
    pub initiation_sure_share: f64,
    /// Two lines of sight fix a point only at this angle or more: below, the depth is a guess, and cameras side by side
    /// are no confirmation of one another [deg].
    #[schemars(range(min = 0.01, max = 90.0))]
    #[schemars(extend("x-formerly" = "birth_angle_deg"))]
    pub initiation_angle_deg: f64,
    /// Speed to be expected at initiation, each axis, standard deviation [m/s].
    #[schemars(range(min = 0.001, max = 10000.0))]
    #[schemars(extend("x-formerly" = "birth_speed_m_s"))]
    pub initiation_speed_m_s: f64,
    /// A frame with more unmatched features than this is noise, and initiates nothing [–].
    #[schemars(range(min = 1, max = 1000))]
    #[schemars(extend("x-formerly" = "birth_features_max"))]
    pub initiation_features_max: u32,
    /// For this long after its initiation it is counted how many of the frames that show its place see a target; it is taken back
    /// when they are less than half of `initiation_share` [ms].
    #[schemars(range(min = 0.0, max = 10000.0))]
    #[schemars(extend("x-formerly" = "probation_ms"))]
    pub tentative_ms: f64,
    /// Unmatched features older than this do not take part in an initiation [ms].
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub stale_after_ms: f64,
    /// No target is initiated this close to another, and of two that stay this close without any camera seeing them apart, the
    /// younger one goes: they follow one light [mm].
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub separation_mm: f64,
    /// For how long two targets must be that close before the younger one goes [ms].
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub merge_after_ms: f64,
    /// A target that no camera has seen for this long is lost [ms].
    #[schemars(range(min = 1.0, max = 100000.0))]
    pub lost_after_ms: f64,
    /// A target that one camera only has seen for this long is lost: its depth drifts [ms].
    #[schemars(range(min = 1.0, max = 100000.0))]
    pub single_view_after_ms: f64,
    /// How features are given to targets: `nearest`, the best pair first, as in the paper; `global`, the pairs that fit best together;
    /// `hypotheses`, and where one frame cannot tell, several answers are kept until later ones can [–].
    pub association: AssociationMethod,
    /// How far an unmatched feature may be from where the one of that camera's frame before was expected, to be the same one: its motion
    /// lets fast targets be initiated. 0: only slow ones are, as in the paper [px].
    #[schemars(range(min = 0.0, max = 1000.0))]
    #[schemars(extend("x-formerly" = "birth_motion_px"))]
    pub initiation_motion_px: f64,
    /// For how long a lost target is remembered: one that is initiated where it can have gone, with the same distances to the others
    /// around, takes its identity up again. 0: never, as in the paper [ms].
    #[schemars(range(min = 0.0, max = 600000.0))]
    pub remember_ms: f64,
    /// What happens to a frame captured before the filter's time: `discard`; `apply`, as though of the filter's time, up to
    /// `late_tolerance_ms`, as in the paper; `out_of_sequence`, the filters are taken back to its time and on again, up to `history_ms` [–].
    pub late: LateRule,
    /// What is made of the clocks of the cameras: `trust`; `estimate`, offset and drift are found from what moves, against the mean of all
    /// cameras, and shown at the end (right for small offsets only); `correct`, and stamps are put right: best with `late = "out_of_sequence"` [–].
    pub clocks: Clocks,
    /// How far clocks are expected to be off, standard deviation, as far as they are estimated [ms].
    #[schemars(range(min = 0.01, max = 10000.0))]
    pub clock_spread_ms: f64,
    /// With `late = "apply"`: frames later than this are discarded and counted; five times `clock_spread_ms` where clocks are estimated and
    /// that is more [ms].
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub late_tolerance_ms: f64,
    /// With `late = "out_of_sequence"`: how far back; frames later than this are discarded and counted; likewise [ms].
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub history_ms: f64,
    /// Targets are initiated within this distance of the scale's working volume, where the rig states one, and lost beyond twice
    /// this distance [mm].
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub volume_margin_mm: f64,
}

impl Default for IntegratorSettings {
    /// The paper's values where it gives them: 15 mm, 70 ms, 300 ms.
    fn default() -> Self {
        Self {
            motion: MotionModel::ConstantVelocity,
            acceleration_m_s2: 10.0,
            jerk_m_s3: 100.0,
            calm_m_s2: 2.0,
            adapt_noise: true,
            camera_error_px: 0.3,
            gate_sigma: 4.0,
            gate_px: 40.0,
            initiation_tolerance_mm: 15.0,
            initiation_cameras: 3,
            initiation_share: 0.3,
            initiation_sure_share: 0.6,
            initiation_angle_deg: 3.0,
            initiation_speed_m_s: 1.0,
            initiation_features_max: 128,
            tentative_ms: 150.0,
            stale_after_ms: 70.0,
            separation_mm: 30.0,
            merge_after_ms: 100.0,
            lost_after_ms: 300.0,
            single_view_after_ms: 300.0,
            association: AssociationMethod::Global,
            initiation_motion_px: 40.0,
            remember_ms: 1000.0,
            clocks: Clocks::Trust,
            clock_spread_ms: 20.0,
            late: LateRule::Apply,
            late_tolerance_ms: 10.0,
            history_ms: 100.0,
            volume_margin_mm: 250.0,
        }
    }
}

impl IntegratorSettings {
    /// How far back late frames are put in their place [ms].
    pub(super) fn history_ms(&self) -> f64 {
        self.history_ms.max(self.clocks_off_ms())
    }

    /// How late frames may be by their clocks alone: one that is behind can only be found by frames that are let in [ms].
    pub(crate) fn clocks_off_ms(&self) -> f64 {
        if self.clocks == Clocks::Trust { 0.0 } else { 5.0 * self.clock_spread_ms }
    }

    /// The motion model that the settings describe.
    ///
    /// # Panics
    /// When they have not been checked.
    pub(super) fn model(&self) -> Model {
        let density = |value: f64| value.powi(2) * CHANGE_LASTS_S;
        let velocity = |acceleration: f64| Mode::ConstantVelocity { acceleration_density: density(acceleration) };
        let modes = [(velocity(self.calm_m_s2), CALM_LASTS_S), (velocity(self.acceleration_m_s2), AGILE_LASTS_S)];
        match self.motion {
            MotionModel::ConstantVelocity => velocity(self.acceleration_m_s2).into(),
            MotionModel::ConstantAcceleration => Model::ConstantAcceleration {
                jerk_density: density(self.jerk_m_s3),
                acceleration_sigma: self.acceleration_m_s2,
            },
            MotionModel::Interacting => Model::Interacting(
                Interacting::new(&modes).expect("two modes, with noise within the ranges of the settings"),
            ),
        }
    }

    /// Names the first setting that is out of its range.
    ///
    /// # Errors
    /// The setting, what was found, and the range.
    pub fn check(&self) -> Result<(), ConfigError> {
        let check = ConfigError::unless_in::<f64>;
        check("acceleration_m_s2", self.acceleration_m_s2, 0.001..=1e4)?;
        check("jerk_m_s3", self.jerk_m_s3, 0.001..=1e6)?;
        check("calm_m_s2", self.calm_m_s2, 0.0001..=1e4)?;
        check("camera_error_px", self.camera_error_px, 0.001..=100.0)?;
        check("gate_sigma", self.gate_sigma, 1.0..=100.0)?;
        check("gate_px", self.gate_px, 0.1..=1e4)?;
        check("initiation_tolerance_mm", self.initiation_tolerance_mm, 0.001..=1e6)?;
        ConfigError::unless_in("initiation_cameras", self.initiation_cameras, 2..=1000)?;
        check("initiation_share", self.initiation_share, 0.0..=1.0)?;
        check("initiation_sure_share", self.initiation_sure_share, 0.0..=1.0)?;
        check("initiation_angle_deg", self.initiation_angle_deg, 0.01..=90.0)?;
        check("initiation_speed_m_s", self.initiation_speed_m_s, 0.001..=1e4)?;
        ConfigError::unless_in("initiation_features_max", self.initiation_features_max, 1..=1000)?;
        check("tentative_ms", self.tentative_ms, 0.0..=1e4)?;
        check("stale_after_ms", self.stale_after_ms, 0.0..=1e4)?;
        check("separation_mm", self.separation_mm, 0.0..=1e6)?;
        check("merge_after_ms", self.merge_after_ms, 0.0..=1e4)?;
        check("lost_after_ms", self.lost_after_ms, 1.0..=1e5)?;
        check("single_view_after_ms", self.single_view_after_ms, 1.0..=1e5)?;
        check("initiation_motion_px", self.initiation_motion_px, 0.0..=1000.0)?;
        check("remember_ms", self.remember_ms, 0.0..=6e5)?;
        check("history_ms", self.history_ms, 0.0..=1e4)?;
        check("clock_spread_ms", self.clock_spread_ms, 0.01..=1e4)?;
        check("late_tolerance_ms", self.late_tolerance_ms, 0.0..=1e4)?;
        check("volume_margin_mm", self.volume_margin_mm, 0.0..=1e6)
    }
}
