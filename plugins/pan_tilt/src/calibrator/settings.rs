//! Settings of a head's calibration: observations that are used, and the required accuracy.

use foveate::geometry::pan_tilt::{AxisUnits, HeadOptions, Limits, OpticsRule, Stacking, UnitsRule};
use foveate::prelude::ConfigError;
use foveate_calibration::head::GatherOptions;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How the head's units are treated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Units {
    /// As stated in the calibration or `units_per_deg`.
    Known,
    /// Estimated from that initial value.
    Estimated,
}

/// How the optics of cameras on heads are treated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Optics {
    /// As stated in the calibration.
    Known,
    /// As stated, but for the focal length, which is estimated.
    Focal,
}

/// Order of the axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Carrier {
    /// The pan axis is fixed, as in nearly all heads.
    TiltOnPan,
    /// The tilt axis is fixed.
    PanOnTilt,
}

/// Settings of [`Calibrator`](super::Calibrator).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CalibratorSettings {
    /// Whether the angle of the device's units is known or estimated [–]
    pub units: Units,
    /// Device units per degree of pan and tilt, by the data sheet; needed where the calibration has no units of the head and these are
    /// to be estimated. They must equal those of `pan_tilt.head` (its `model` or `profile`), which gives the angles: another number here only
    /// scales the units that are written. Each -100000 to 100000, not 0 [units/°]
    pub units_per_deg: Option<[f64; 2]>,
    /// Whether the optics of the cameras on heads are known, or their focal length is estimated [–]
    pub optics: Optics,
    /// Which axis carries the other: `tilt_on_pan` or `pan_on_tilt` [–]
    pub stacking: Carrier,
    /// Largest distance between reports of the head at one setting [°]
    #[schemars(range(min = 0.001, max = 10.0))]
    pub tolerance_deg: f64,
    /// Settling time of the camera after a motion [ms]
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub settle_ms: f64,
    /// Largest interval between the light's samples around a picture [ms]
    #[schemars(range(min = 1.0, max = 10000.0))]
    pub most_apart_ms: f64,
    /// Motion of the light in the picture after which it is used again at one setting [px]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub step_px: f64,
    /// Most observations that are used at one setting [–]
    #[schemars(range(min = 2, max = 100000))]
    pub most_a_setting: usize,
    /// Error of the head's reported angles, standard deviation; above 0 each setting gets a correction of its own [°]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub setting_sigma_deg: f64,
    /// Smallest range of pan [°]
    #[schemars(range(min = 0.1, max = 360.0))]
    pub least_pan_deg: f64,
    /// Smallest range of tilt [°]
    #[schemars(range(min = 0.1, max = 360.0))]
    pub least_tilt_deg: f64,
    /// Largest standard deviation of the axes' directions [°]
    #[schemars(range(min = 0.001, max = 90.0))]
    pub most_direction_sigma_deg: f64,
    /// Largest standard deviation of the positions of axes and camera [mm]
    #[schemars(range(min = 0.01, max = 10000.0))]
    pub most_place_sigma_mm: f64,
    /// File of the calibration of all cameras, with the calibrated heads, in the results folder [–]
    pub file: String,
    /// File of a picture with the errors of three models in the results folder; `{camera}` is the camera's name [–]
    pub picture: String,
}

impl Default for CalibratorSettings {
    fn default() -> Self {
        Self {
            units: Units::Known,
            units_per_deg: None,
            optics: Optics::Known,
            stacking: Carrier::TiltOnPan,
            tolerance_deg: 0.1,
            settle_ms: 500.0,
            most_apart_ms: 50.0,
            step_px: 12.0,
            most_a_setting: 30,
            setting_sigma_deg: 0.0,
            least_pan_deg: 20.0,
            least_tilt_deg: 10.0,
            most_direction_sigma_deg: 1.0,
            most_place_sigma_mm: 20.0,
            file: "heads.calibration.toml".to_owned(),
            picture: "head_models.{camera}.svg".to_owned(),
        }
    }
}

impl CalibratorSettings {
    /// Refuses settings out of range.
    ///
    /// # Errors
    /// The first such setting.
    pub fn check(&self) -> Result<(), ConfigError> {
        let check = ConfigError::unless_in::<f64>;
        for it in self.units_per_deg.iter().flatten() {
            check("units_per_deg", *it, -1e5..=1e5)?;
            if *it == 0.0 {
                return Err(ConfigError::at("units_per_deg", "found 0, expected the number of units per degree"));
            }
        }
        check("tolerance_deg", self.tolerance_deg, 0.001..=10.0)?;
        check("settle_ms", self.settle_ms, 0.0..=10_000.0)?;
        check("most_apart_ms", self.most_apart_ms, 1.0..=10_000.0)?;
        check("step_px", self.step_px, 0.0..=1000.0)?;
        ConfigError::unless_in("most_a_setting", self.most_a_setting, 2..=100_000)?;
        check("setting_sigma_deg", self.setting_sigma_deg, 0.0..=10.0)?;
        check("least_pan_deg", self.least_pan_deg, 0.1..=360.0)?;
        check("least_tilt_deg", self.least_tilt_deg, 0.1..=360.0)?;
        check("most_direction_sigma_deg", self.most_direction_sigma_deg, 0.001..=90.0)?;
        check("most_place_sigma_mm", self.most_place_sigma_mm, 0.01..=10_000.0)
    }

    /// The settings as options for gathering.
    pub fn gathering(&self) -> GatherOptions {
        GatherOptions {
            tolerance: self.tolerance_deg.to_radians(),
            settle_s: 1e-3 * self.settle_ms,
            most_apart_s: 1e-3 * self.most_apart_ms,
            step_px: self.step_px,
            most_a_setting: self.most_a_setting,
        }
    }

    /// The settings as options for solving; settings of the head come as angles.
    pub fn solving(&self) -> HeadOptions {
        let units = match self.units {
            Units::Known => UnitsRule::Known(AxisUnits::RADIANS),
            Units::Estimated => UnitsRule::Near(AxisUnits::RADIANS),
        };
        HeadOptions {
            units: [units; 2],
            optics: match self.optics {
                Optics::Known => OpticsRule::Known,
                Optics::Focal => OpticsRule::Focal,
            },
            stacking: match self.stacking {
                Carrier::TiltOnPan => Stacking::TiltOnPan,
                Carrier::PanOnTilt => Stacking::PanOnTilt,
            },
            limits: Limits::WIDE,
            setting_sigma: self.setting_sigma_deg.to_radians(),
            least_range: [self.least_pan_deg, self.least_tilt_deg].map(f64::to_radians),
            most_direction_sigma: self.most_direction_sigma_deg.to_radians(),
            most_place_sigma: 1e-3 * self.most_place_sigma_mm,
            ..HeadOptions::default()
        }
    }
}
