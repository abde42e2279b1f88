//! Settings of the integrator, with the reasons for their defaults.

use foveate::estimation::motion::{Interacting, Mode, Model};
use foveate::prelude::ConfigError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Correlation time of a target's acceleration, or jerk [s].
const CHANGE_LASTS_S: f64 = 0.1;
/// Mean time that a target stays calm, or agile [s].
const CALM_LASTS_S: f64 = 1.0;
const AGILE_LASTS_S: f64 = 0.3;

/// Motion model of targets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MotionModel {
    /// Nearly constant velocity; `acceleration_m_s2` is the deviation from it [Davis 2002 §3.4, Figures 42 to 44].
    #[default]
    ConstantVelocity,
    /// Nearly constant acceleration; `jerk_m_s3` is the deviation from it.
    ConstantAcceleration,
    /// Switches between calm, with `calm_m_s2`, and agile, with `acceleration_m_s2`, estimated for each target.
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
    Apply,
    /// The filters are rolled back to its time and updated again, up to `history_ms`.
    #[default]
    OutOfSequence,
}

/// Use of the cameras' clocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Clocks {
    /// Stamps are used as they are.
    #[default]
    Trust,
    /// Offset and drift of each clock are estimated from moving targets, and reported at the end.
    Estimate,
    /// The estimates also correct the stamps.
    Correct,
}

/// Association of features with targets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AssociationMethod {
    /// The best pair first, then the best of the rest [Davis 2002 §3.4].
    Nearest,
    /// The pairs with the smallest sum of costs.
    #[default]
    Global,
    /// As `global`, and in ambiguous frames several hypotheses are kept until later frames resolve them. A spot of two lights is then associated with one of them.
    Hypotheses,
}

/// Settings of [`Integrator`](crate::integrator::Integrator).
///
/// Lengths in `_mm` are thousandths of the calibration's unit of length: where that is unknown (a calibration without a
/// measured length), they have to be chosen for its scale, and so have accelerations and speeds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct IntegratorSettings {
    /// Motion model of targets: `constant_velocity`; `constant_acceleration` (uses `jerk_m_s3`; twice the time); `interacting`: switches
    /// between calm and agile for each target (five times the time; best for lights that cross and turn) [–].
    pub motion: MotionModel,
    /// Acceleration of a target, standard deviation, assumed to be independent from one tenth of a second to
    /// the next: the filter's white noise has the spectral density a² · 0.1 s. A walking person's wrist reaches 20 [m/s²].
    #[schemars(range(min = 0.001, max = 10000.0))]
    pub acceleration_m_s2: f64,
    /// With `motion = "constant_acceleration"`: change of the acceleration, standard deviation, likewise [m/s³].
    #[schemars(range(min = 0.001, max = 1000000.0))]
    pub jerk_m_s3: f64,
    /// With `motion = "interacting"`: acceleration while the target is calm, standard deviation, likewise [m/s²].
    #[schemars(range(min = 0.0001, max = 10000.0))]
    pub calm_m_s2: f64,
    /// Whether each target's process noise adapts to its innovations: up to 64 times for fast turns, and down
    /// to 0.4 times for calm targets [–].
    pub adapt_noise: bool,
    /// Error of a camera's model, one axis, standard deviation, added to each feature's own covariance [px].
    #[schemars(range(min = 0.001, max = 100.0))]
    pub camera_error_px: f64,
    /// Gate: largest distance between a feature and a target's prediction in standard deviations [–].
    #[schemars(range(min = 1.0, max = 100.0))]
    pub gate_sigma: f64,
    /// Largest such distance in pixels, for uncertain filters [px].
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
    /// Smallest part of the cameras that must agree, among those with the point in view and a frame within `stale_after_ms`.
    /// Avoids accidental targets where many cameras have the point in view; occluded and fast lights need a low value [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    #[schemars(extend("x-formerly" = "birth_share"))]
    pub initiation_share: f64,
    /// A target is sent from its initiation on when this part of those cameras agrees; otherwise once three more frames have seen it,
    /// and `initiation_share` of all frames with its place in view. 0: always at once, as in the paper [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    #[schemars(extend("x-formerly" = "birth_sure_share"))]
    pub initiation_sure_share: f64,
    /// Smallest angle between two lines of sight that determine a point: below, the depth is uncertain, and adjacent cameras
    /// do not confirm each other [deg].
    #[schemars(range(min = 0.01, max = 90.0))]
    #[schemars(extend("x-formerly" = "birth_angle_deg"))]
    pub initiation_angle_deg: f64,
    /// Speed at initiation, each axis, standard deviation [m/s].
    #[schemars(range(min = 0.001, max = 10000.0))]
    #[schemars(extend("x-formerly" = "birth_speed_m_s"))]
    pub initiation_speed_m_s: f64,
    /// A frame with more unmatched features than this is noise, and initiates nothing [–].
    #[schemars(range(min = 1, max = 1000))]
    #[schemars(extend("x-formerly" = "birth_features_max"))]
    pub initiation_features_max: u32,
    /// Confirmation time after initiation, in which the frames that see the target are counted; it is terminated
    /// when they are less than half of `initiation_share` of those with its place in view [ms].
    #[schemars(range(min = 0.0, max = 10000.0))]
    #[schemars(extend("x-formerly" = "probation_ms"))]
    pub tentative_ms: f64,
    /// Unmatched features older than this are not used for initiation [ms].
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub stale_after_ms: f64,
    /// No target is initiated this close to another, and of two targets that stay this close without being resolved by any camera, the
    /// younger one is terminated: they track one light [mm].
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub separation_mm: f64,
    /// Time for which two targets must be that close before the younger one is terminated [ms].
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub merge_after_ms: f64,
    /// A target is terminated when no camera has seen it for this long [ms].
    #[schemars(range(min = 1.0, max = 100000.0))]
    pub lost_after_ms: f64,
    /// A target is terminated when only one camera has seen it for this long: its depth drifts [ms].
    #[schemars(range(min = 1.0, max = 100000.0))]
    pub single_view_after_ms: f64,
    /// Association of features with targets: `nearest`, the best pair first, as in the paper; `global`, the smallest sum of costs;
    /// `hypotheses`, also keeps several hypotheses in ambiguous frames until later ones resolve them [–].
    pub association: AssociationMethod,
    /// Largest distance of an unmatched feature from the prediction of one in that camera's frame before, to be the same one: its motion
    /// allows the initiation of fast targets. 0: only slow ones, as in the paper [px].
    #[schemars(range(min = 0.0, max = 1000.0))]
    #[schemars(extend("x-formerly" = "birth_motion_px"))]
    pub initiation_motion_px: f64,
    /// How long a lost target is remembered: one that is initiated within its reach, with the same distances to the others
    /// around it, gets its identity again. 0: never, as in the paper [ms].
    #[schemars(range(min = 0.0, max = 600000.0))]
    pub remember_ms: f64,
    /// What happens to a frame captured before the filter's time: `out_of_sequence`, the filters are rolled back to its time and updated
    /// again, up to `history_ms`; `apply`, used as if it were of the filter's time, up to `late_tolerance_ms`, as in the paper; `discard` [–].
    pub late: LateRule,
    /// Use of the cameras' clocks: `trust`; `estimate`, offset and drift relative to the mean of all cameras are estimated from moving
    /// targets and reported at the end (valid for small offsets only); `correct`, stamps are also corrected [–].
    pub clocks: Clocks,
    /// Expected offsets of clocks, standard deviation, where they are estimated [ms].
    #[schemars(range(min = 0.01, max = 10000.0))]
    pub clock_spread_ms: f64,
    /// With `late = "apply"`: frames later than this are discarded and counted; five times `clock_spread_ms` where clocks are estimated and
    /// that is more [ms].
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub late_tolerance_ms: f64,
    /// With `late = "out_of_sequence"`: longest delay; later frames are discarded and counted; likewise [ms].
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub history_ms: f64,
    /// Targets are initiated within this distance of the scale's working volume, where the rig states one, and terminated beyond twice
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
            late: LateRule::OutOfSequence,
            late_tolerance_ms: 10.0,
            history_ms: 100.0,
            volume_margin_mm: 250.0,
        }
    }
}

impl IntegratorSettings {
    /// Longest delay of out-of-sequence frames [ms].
    pub(super) fn history_ms(&self) -> f64 {
        self.history_ms.max(self.clocks_off_ms())
    }

    /// Delay of frames that clock errors alone can cause: a slow clock can only be found from accepted frames [ms].
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

    /// Checks the range of each setting.
    ///
    /// # Errors
    /// The first setting out of its range, what was found, and the range.
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
