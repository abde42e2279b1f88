//! Profiles of head models: format of positions, units per degree, ranges and speeds.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::request::OutOfRange;
use super::{Command, Format, Speed};

/// A model of head.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Profile {
    /// Name of the model [–].
    pub name: String,
    /// Hexadecimal digits of a pan position; BRC models have 5 [–].
    #[schemars(range(min = 4, max = 5))]
    pub pan_digits: u8,
    /// Absolute moves carry a speed of tilt; BRC models use the speed of pan for both axes [–].
    pub tilt_speed: bool,
    /// The axis that turns the camera from side to side, positive to the right [–].
    pub pan: AxisProfile,
    /// The axis that turns the camera up and down, positive up [–].
    pub tilt: AxisProfile,
    /// Zoom position at the longest focal length; 0 is the shortest [units].
    #[schemars(range(min = 0, max = 65535))]
    pub zoom_max: u16,
}

/// One axis of a head.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AxisProfile {
    /// Units per degree, negative where the head counts in the opposite direction [units/°].
    #[schemars(range(min = -1000.0, max = 1000.0))]
    pub units_per_deg: f64,
    /// Lowest position [units].
    #[schemars(range(min = -524288, max = 524287))]
    pub min_units: i32,
    /// Highest position [units].
    #[schemars(range(min = -524288, max = 524287))]
    pub max_units: i32,
    /// Speeds 1, 2, …, ascending [°/s].
    pub speeds_deg_per_s: Vec<f64>,
}

impl Profile {
    /// Sony EVI-D30 and EVI-D31: the heads of [Davis 2002].
    pub fn evi_d30() -> Profile {
        Profile {
            name: "Sony EVI-D30".to_owned(),
            pan_digits: 4,
            tilt_speed: true,
            pan: AxisProfile {
                units_per_deg: 8.8,
                min_units: -880,
                max_units: 880,
                speeds_deg_per_s: (1..=24).map(|it| f64::from(it) * 80.0 / 24.0).collect(),
            },
            tilt: AxisProfile {
                units_per_deg: 12.0,
                min_units: -300,
                max_units: 300,
                speeds_deg_per_s: (1..=20).map(|it| f64::from(it) * 2.5).collect(),
            },
            zoom_max: 0x03FF,
        }
    }

    /// Sony EVI-D100, not in its D30 mode.
    pub fn evi_d100() -> Profile {
        let speeds = [
            2.0, 2.4, 3.0, 3.7, 4.7, 6.1, 7.4, 9.1, 11.0, 14.0, 18.0, 22.0, 27.0, 34.0, 42.0, 52.0, 65.0, 81.0, 100.0,
            125.0, 155.0, 190.0, 240.0, 300.0,
        ];
        Profile {
            name: "Sony EVI-D100".to_owned(),
            pan_digits: 4,
            tilt_speed: true,
            pan: AxisProfile {
                units_per_deg: 14.4,
                min_units: -1440,
                max_units: 1440,
                speeds_deg_per_s: speeds.to_vec(),
            },
            tilt: AxisProfile {
                units_per_deg: 14.4,
                min_units: -360,
                max_units: 360,
                speeds_deg_per_s: speeds[..20].to_vec(),
            },
            zoom_max: 0x7000,
        }
    }

    /// Format of positions.
    pub fn format(&self) -> Format {
        Format { pan_digits: usize::from(self.pan_digits), tilt_speed: self.tilt_speed }
    }

    /// Checks a user's profile; the sentence names the setting.
    ///
    /// # Errors
    /// The first fault.
    pub fn check(&self) -> Result<(), String> {
        if !(4..=5).contains(&self.pan_digits) {
            return Err(format!("`pan_digits` is {}, expected 4 or 5", self.pan_digits));
        }
        for (name, axis, digits) in [("pan", &self.pan, self.pan_digits), ("tilt", &self.tilt, 4)] {
            axis.check(digits).map_err(|fault| format!("`{name}.{fault}"))?;
        }
        Ok(())
    }

    /// Whether the head supports a command.
    ///
    /// # Errors
    /// The first number out of the model's range.
    pub fn check_command(&self, command: &Command) -> Result<(), OutOfRange> {
        let speeds = |speed: Speed| {
            OutOfRange::unless_in("speed of pan", i32::from(speed.pan), 1, self.pan.highest_speed())?;
            OutOfRange::unless_in("speed of tilt", i32::from(speed.tilt), 1, self.tilt.highest_speed())
        };
        let positions = |pan: i32, tilt: i32| {
            OutOfRange::unless_in("pan", pan, self.pan.min_units, self.pan.max_units)?;
            OutOfRange::unless_in("tilt", tilt, self.tilt.min_units, self.tilt.max_units)
        };
        match *command {
            Command::Absolute { pan, tilt, speed } => positions(pan, tilt).and(speeds(speed)),
            Command::Relative { pan, tilt, speed } => {
                let [pan_span, tilt_span] = [&self.pan, &self.tilt].map(|it| it.max_units - it.min_units);
                OutOfRange::unless_in("pan", pan, -pan_span, pan_span)?;
                OutOfRange::unless_in("tilt", tilt, -tilt_span, tilt_span)?;
                speeds(speed)
            }
            Command::Drive { speed, .. } => speeds(speed),
            Command::LimitSet { pan, tilt, .. } => positions(pan, tilt),
            Command::ZoomDirect(units) => OutOfRange::unless_in("zoom", i32::from(units), 0, i32::from(self.zoom_max)),
            _ => Ok(()),
        }
    }
}

impl AxisProfile {
    fn check(&self, digits: u8) -> Result<(), String> {
        let half = 1 << (4 * digits - 1);
        let scale = self.units_per_deg;
        if !scale.is_finite() || scale == 0.0 {
            return Err(format!("units_per_deg` is {scale}, expected a number that is not 0"));
        }
        if self.min_units >= self.max_units || self.min_units < -half || self.max_units >= half {
            let (min, max) = (self.min_units, self.max_units);
            return Err(format!(
                "min_units` to `max_units` is {min} to {max}, expected rising, within {digits} digits"
            ));
        }
        let speeds = &self.speeds_deg_per_s;
        let is_rising =
            speeds.windows(2).all(|it| it[0] < it[1]) && speeds.iter().all(|it| *it > 0.0 && it.is_finite());
        if speeds.is_empty() || speeds.len() > 0x7F || !is_rising {
            return Err(format!("speeds_deg_per_s` is {speeds:?}, expected 1 to 127 rising numbers above 0"));
        }
        Ok(())
    }

    /// Nearest position to an angle within the limits [units].
    pub fn units(&self, angle_rad: f64) -> i32 {
        let units = (angle_rad.to_degrees() * self.units_per_deg).round();
        (units as i32).clamp(self.min_units, self.max_units)
    }

    /// The angle of a position [rad].
    pub fn angle_rad(&self, units: i32) -> f64 {
        (f64::from(units) / self.units_per_deg).to_radians()
    }

    /// Lowest and highest angle [rad].
    pub fn range_rad(&self) -> [f64; 2] {
        let ends = [self.angle_rad(self.min_units), self.angle_rad(self.max_units)];
        if ends[0] < ends[1] { ends } else { [ends[1], ends[0]] }
    }

    /// Distance between two neighbouring positions [rad].
    pub fn step_rad(&self) -> f64 {
        self.angle_rad(1).abs()
    }

    /// The slowest speed that is not below `rad_per_s`; the fastest if none is.
    pub fn speed_code(&self, rad_per_s: f64) -> u8 {
        let wanted = rad_per_s.abs().to_degrees();
        // A hair's breadth, so that a speed that came from its own code goes back to it.
        let below = self.speeds_deg_per_s.partition_point(|&it| it * (1.0 + 1e-9) < wanted);
        (below + 1).min(self.speeds_deg_per_s.len()) as u8
    }

    /// Speed of a code [rad/s]; `None` for one that the model does not have.
    pub fn speed_rad_per_s(&self, code: u8) -> Option<f64> {
        self.speeds_deg_per_s.get(usize::from(code).checked_sub(1)?).map(|it| it.to_radians())
    }

    fn highest_speed(&self) -> i32 {
        self.speeds_deg_per_s.len() as i32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_models_that_are_known_are_sound() {
        for profile in [Profile::evi_d30(), Profile::evi_d100()] {
            assert_eq!(profile.check(), Ok(()), "{}", profile.name);
            for axis in [&profile.pan, &profile.tilt] {
                for units in [axis.min_units, -1, 0, 1, 7, axis.max_units] {
                    assert_eq!(axis.units(axis.angle_rad(units)), units);
                }
                for code in 1..=axis.speeds_deg_per_s.len() as u8 {
                    assert_eq!(axis.speed_code(axis.speed_rad_per_s(code).unwrap()), code);
                }
                assert_eq!([axis.speed_rad_per_s(0), axis.speed_rad_per_s(100)], [None, None]);
                assert_eq!([axis.speed_code(0.0), axis.speed_code(100.0)], [1, axis.speeds_deg_per_s.len() as u8]);
            }
        }
    }

    #[test]
    fn the_d30_is_that_of_its_data_sheet() {
        let d30 = Profile::evi_d30();
        assert_eq!(d30.pan.range_rad().map(|it| it.to_degrees().round()), [-100.0, 100.0]);
        assert_eq!(d30.tilt.range_rad().map(|it| it.to_degrees().round()), [-25.0, 25.0]);
        // [Davis 2002 §4.5]: "precision of only 0.1 degree".
        assert!((d30.pan.step_rad().to_degrees() - 0.1136).abs() < 1e-4);
        assert_eq!(d30.pan.units(9.0), 880);
        let speed = |axis: &AxisProfile, code| (axis.speed_rad_per_s(code).unwrap().to_degrees() * 10.0).round() / 10.0;
        assert_eq!([1, 2, 24].map(|code| speed(&d30.pan, code)), [3.3, 6.7, 80.0]);
        assert_eq!([1, 20].map(|code| speed(&d30.tilt, code)), [2.5, 50.0]);
    }

    #[test]
    fn a_head_that_counts_to_the_left_gets_the_other_sign() {
        let mut profile = Profile::evi_d30();
        profile.pan.units_per_deg = -8.8;
        assert_eq!(profile.pan.units(10f64.to_radians()), -88);
        assert!(profile.pan.range_rad()[0] < 0.0);
    }

    #[test]
    fn faults_of_a_written_profile_are_named() {
        let fault = |change: &dyn Fn(&mut Profile)| {
            let mut profile = Profile::evi_d30();
            change(&mut profile);
            profile.check().unwrap_err()
        };
        assert!(fault(&|it| it.pan_digits = 3).starts_with("`pan_digits` is 3"));
        assert!(fault(&|it| it.tilt.units_per_deg = 0.0).starts_with("`tilt.units_per_deg` is 0"));
        assert!(fault(&|it| it.pan.max_units = 40_000).starts_with("`pan.min_units`"));
        assert!(fault(&|it| it.pan.speeds_deg_per_s.reverse()).starts_with("`pan.speeds_deg_per_s`"));
        assert!(fault(&|it| it.tilt.speeds_deg_per_s.clear()).starts_with("`tilt.speeds_deg_per_s`"));
    }
}
