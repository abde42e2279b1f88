//! Options of head calibration.

use foveate_estimation::Loss;

use super::HeadCalibrationError;
use crate::pan_tilt::head::{AxisUnits, Limits, Stacking};

/// Prior knowledge of a device's unit of angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum UnitsRule {
    /// Known, for example from the maker.
    Known(AxisUnits),
    /// Estimated, from this start.
    Near(AxisUnits),
    /// Estimated without a start, and positive: the axis points where the device's numbers increase. Needs settings with several targets each.
    Unknown {
        /// The device's number at angle zero.
        at_rest: f64,
    },
}

/// Prior knowledge of the camera's optics.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OpticsRule {
    /// All optics are known.
    Known,
    /// The focal lengths are estimated; their ratio and the rest are known.
    Focal,
}

/// The model of the axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AxesRule {
    /// Axes anywhere: equation (2).
    Free,
    /// Axes along the image's rows and columns, through the centre of projection: equation (1), for comparison.
    Aligned,
}

/// Options of [`calibrate_head`] and [`refine_head`].
#[derive(Debug, Clone, PartialEq)]
pub struct HeadOptions {
    /// Units of pan and tilt.
    pub units: [UnitsRule; 2],
    /// Model of the axes.
    pub axes: AxesRule,
    /// Whether the focal lengths are estimated too.
    pub optics: OpticsRule,
    /// Which axis carries the other.
    pub stacking: Stacking,
    /// Limits for the resulting head; without effect on the search.
    pub limits: Limits,
    /// Robust loss of an error, in its standard deviations.
    pub loss: Loss,
    /// Standard deviation of either angle between the device's report and the head [rad]. Above 0, each setting gets a correction of its own.
    pub setting_sigma: f64,
    /// Least range of the settings of pan and tilt [rad].
    pub least_range: [f64; 2],
    /// Largest accepted standard deviation of the axes' directions [rad].
    pub most_direction_sigma: f64,
    /// Largest accepted standard deviation of the places of the axes and the camera [m].
    pub most_place_sigma: f64,
    /// Number of parts for cross-validation: each part of the settings is predicted from the others; 0 for none [–].
    pub holdout_parts: usize,
    /// Seed of the random draws.
    pub seed: u64,
}

impl Default for HeadOptions {
    /// Settings in rad, optics known, axes free, Cauchy's loss, exact settings, ranges of 10° and 5°, directions to 1°, places to 50 mm, five parts.
    fn default() -> Self {
        Self {
            units: [UnitsRule::Known(AxisUnits::RADIANS); 2],
            axes: AxesRule::Free,
            optics: OpticsRule::Known,
            stacking: Stacking::default(),
            limits: Limits::WIDE,
            loss: Loss::CAUCHY,
            setting_sigma: 0.0,
            least_range: [10.0_f64.to_radians(), 5.0_f64.to_radians()],
            most_direction_sigma: 1.0_f64.to_radians(),
            most_place_sigma: 0.05,
            holdout_parts: 5,
            seed: 1,
        }
    }
}

impl HeadOptions {
    /// Finds what cannot be followed.
    pub(super) fn check(&self) -> Result<(), HeadCalibrationError> {
        let positive = "a finite number above 0";
        let named = [
            ("the range of pan", self.least_range[0]),
            ("the range of tilt", self.least_range[1]),
            ("most_direction_sigma", self.most_direction_sigma),
            ("most_place_sigma", self.most_place_sigma),
        ];
        let bad = |it: &&(&'static str, f64)| !(it.1.is_finite() && it.1 > 0.0);
        if let Some(&(option, found)) = named.iter().find(bad) {
            return Err(HeadCalibrationError::BadOption { option, found, expected: positive });
        }
        if let Some(found) = self.loss.bad_scale() {
            return Err(HeadCalibrationError::BadOption { option: "scale of the loss", found, expected: positive });
        }
        if !(self.setting_sigma.is_finite() && self.setting_sigma >= 0.0) {
            let (option, found) = ("setting_sigma", self.setting_sigma);
            return Err(HeadCalibrationError::BadOption { option, found, expected: "a finite number of 0 or more" });
        }
        for units in self.units {
            let (rad_per_unit, at_rest) = match units {
                UnitsRule::Known(it) | UnitsRule::Near(it) => (it.rad_per_unit, it.at_rest),
                UnitsRule::Unknown { at_rest } => (1.0, at_rest),
            };
            if !rad_per_unit.is_finite() || rad_per_unit == 0.0 {
                let expected = "a finite number other than 0";
                return Err(HeadCalibrationError::BadOption { option: "rad_per_unit", found: rad_per_unit, expected });
            }
            if !at_rest.is_finite() {
                return Err(HeadCalibrationError::BadOption {
                    option: "at_rest",
                    found: at_rest,
                    expected: "a finite number",
                });
            }
        }
        Ok(())
    }
}
