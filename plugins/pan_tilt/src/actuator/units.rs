//! Conversion between angles of calibrated axes and the numbers of a head.

use foveate::geometry::pan_tilt::AxisUnits;
use foveate::prelude::{CalibratedHead, HeadOrder};

use crate::visca::{AxisProfile, Command, PanDrive, Profile, Speed, TiltDrive};

/// One axis of one head.
#[derive(Debug, Clone)]
struct AxisScale {
    profile: AxisProfile,
    units: AxisUnits,
}

/// Units of a head.
#[derive(Debug, Clone)]
pub(super) struct Scale {
    pan: AxisScale,
    tilt: AxisScale,
    zoom_max: u16,
}

impl Scale {
    /// By the calibration of the head, or by the data sheet of its model where the calibration does not state device units: it then
    /// states degrees, which no head uses as whole units.
    pub fn new(profile: &Profile, calibrated: Option<&CalibratedHead>) -> Scale {
        let axis = |profile: &AxisProfile, units: Option<AxisUnits>| AxisScale {
            profile: profile.clone(),
            units: units
                .filter(|it| *it != AxisUnits::DEGREES)
                .unwrap_or(AxisUnits { rad_per_unit: 1f64.to_radians() / profile.units_per_deg, at_rest: 0.0 }),
        };
        Scale {
            pan: axis(&profile.pan, calibrated.map(|it| it.units[0])),
            tilt: axis(&profile.tilt, calibrated.map(|it| it.units[1])),
            zoom_max: profile.zoom_max,
        }
    }

    /// The command for an order; `None` for invalid numbers.
    pub fn command(&self, order: &HeadOrder) -> Option<Command> {
        match *order {
            HeadOrder::Go { angles, speeds } => {
                angles.iter().chain(&speeds).all(|it| it.is_finite()).then(|| Command::Absolute {
                    pan: self.pan.position(angles[0]),
                    tilt: self.tilt.position(angles[1]),
                    speed: Speed { pan: self.pan.speed_code(speeds[0]), tilt: self.tilt.speed_code(speeds[1]) },
                })
            }
            HeadOrder::Turn { rates } => rates.iter().all(|it| it.is_finite()).then(|| {
                let [(pan_way, pan), (tilt_way, tilt)] = [self.pan.drive(rates[0]), self.tilt.drive(rates[1])];
                let pan_drive = [PanDrive::Left, PanDrive::Stop, PanDrive::Right][(pan_way + 1) as usize];
                let tilt_drive = [TiltDrive::Down, TiltDrive::Stop, TiltDrive::Up][(tilt_way + 1) as usize];
                Command::Drive { pan: pan_drive, tilt: tilt_drive, speed: Speed { pan, tilt } }
            }),
        }
    }

    /// The zoom command for a position; `None` for a number that is none.
    pub fn zoom(&self, units: f64) -> Option<Command> {
        let nearest = units.round().clamp(0.0, f64::from(self.zoom_max));
        units.is_finite().then_some(Command::ZoomDirect(nearest as u16))
    }

    /// The motion of the axes by a command, within the head's limits; `None` for commands that do not move them to a position or at a rate.
    pub fn order(&self, command: &Command) -> Option<HeadOrder> {
        match *command {
            Command::Absolute { pan, tilt, speed } => Some(HeadOrder::Go {
                angles: self.angles(pan, tilt),
                speeds: [self.pan.speed(speed.pan), self.tilt.speed(speed.tilt)],
            }),
            Command::Drive { pan, tilt, speed } => {
                let pan_way = match pan {
                    PanDrive::Left => -1.0,
                    PanDrive::Stop => 0.0,
                    PanDrive::Right => 1.0,
                };
                let tilt_way = match tilt {
                    TiltDrive::Down => -1.0,
                    TiltDrive::Stop => 0.0,
                    TiltDrive::Up => 1.0,
                };
                let rates = [
                    pan_way * self.pan.sign() * self.pan.speed(speed.pan),
                    tilt_way * self.tilt.sign() * self.tilt.speed(speed.tilt),
                ];
                Some(HeadOrder::Turn { rates })
            }
            _ => None,
        }
    }

    /// Pan and tilt [rad].
    pub fn angles(&self, pan: i32, tilt: i32) -> [f64; 2] {
        [self.pan.units.angle(f64::from(pan)), self.tilt.units.angle(f64::from(tilt))]
    }
}

impl AxisScale {
    /// The nearest position within the limits.
    fn position(&self, angle: f64) -> i32 {
        (self.units.units(angle).round() as i32).clamp(self.profile.min_units, self.profile.max_units)
    }

    /// Ratio of the data sheet's radian to the calibrated radian.
    fn nominal(&self) -> f64 {
        (1f64.to_radians() / (self.units.rad_per_unit * self.profile.units_per_deg)).abs()
    }

    fn speed_code(&self, rate: f64) -> u8 {
        self.profile.speed_code(rate * self.nominal())
    }

    /// [rad/s]
    fn speed(&self, code: u8) -> f64 {
        self.profile.speed_rad_per_s(code).unwrap_or(0.0) / self.nominal()
    }

    /// Direction (-1: left or down, 0, 1: right or up) and speed; below half the slowest speed the axis stands still.
    fn drive(&self, rate: f64) -> (i8, u8) {
        let slowest = self.speed(1);
        if rate.abs() < slowest / 2.0 {
            return (0, 1);
        }
        // The nearest speed, not the next faster one: a target that is pursued is neither lost nor overtaken.
        let faster = self.speed_code(rate);
        let slower = faster.saturating_sub(1).max(1);
        let is_nearer = (self.speed(slower) - rate.abs()).abs() < (self.speed(faster) - rate.abs()).abs();
        let way = if rate * self.sign() > 0.0 { 1 } else { -1 };
        (way, if is_nearer { slower } else { faster })
    }

    /// 1 where the angle increases to the right or up.
    fn sign(&self) -> f64 {
        (self.units.rad_per_unit * self.profile.units_per_deg).signum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nominal() -> Scale {
        Scale::new(&Profile::evi_d30(), None)
    }

    fn with_units(units: [AxisUnits; 2]) -> Scale {
        let profile = Profile::evi_d30();
        Scale {
            pan: AxisScale { profile: profile.pan, units: units[0] },
            tilt: AxisScale { profile: profile.tilt, units: units[1] },
            zoom_max: profile.zoom_max,
        }
    }

    #[test]
    fn places_go_there_and_back() {
        let go = |angles: [f64; 2], speeds| HeadOrder::Go { angles, speeds };
        let speeds = [24, 20].map(|code| f64::from(code) * 80f64.to_radians() / 24.0);
        let command = nominal().command(&go([0.5, -0.2], [speeds[0], 50f64.to_radians()]));
        let Some(Command::Absolute { pan, tilt, speed }) = command else { panic!("{command:?}") };
        assert_eq!((pan, tilt, speed), (252, -138, Speed { pan: 24, tilt: 20 }));
        let Some(HeadOrder::Go { angles, speeds }) = nominal().order(&command.unwrap()) else { panic!() };
        assert!((angles[0] - 0.5).abs() < 0.001 && (angles[1] + 0.2).abs() < 0.001);
        assert!((speeds[0].to_degrees() - 80.0).abs() < 1e-9 && (speeds[1].to_degrees() - 50.0).abs() < 1e-9);
        // Beyond its end it goes to its end, and a speed of 0 is the slowest.
        let far = nominal().command(&go([9.0, -9.0], [0.0, 1e9]));
        assert_eq!(far, Some(Command::Absolute { pan: 880, tilt: -300, speed: Speed { pan: 1, tilt: 20 } }));
        assert_eq!(nominal().command(&go([f64::NAN, 0.0], [1.0, 1.0])), None);
    }

    #[test]
    fn calibrated_units_count_and_so_does_their_sign() {
        // A pan axis that points up, 5 % short of its data sheet, at rest at 40 units.
        let pan = AxisUnits { rad_per_unit: -0.95 * 1f64.to_radians() / 8.8, at_rest: 40.0 };
        let scale = with_units([pan, AxisUnits { rad_per_unit: 1f64.to_radians() / 12.0, at_rest: 0.0 }]);
        let order = HeadOrder::Go { angles: [10f64.to_radians(), 0.0], speeds: [76f64.to_radians(), 0.1] };
        let Some(Command::Absolute { pan, speed, .. }) = scale.command(&order) else { panic!() };
        // 10° are 92.6 units to the left of 40.
        assert_eq!((pan, speed.pan), (-53, 24));
        let turn = HeadOrder::Turn { rates: [76f64.to_radians(), 0.0] };
        let command = scale.command(&turn);
        let expected = Command::Drive { pan: PanDrive::Left, tilt: TiltDrive::Stop, speed: Speed { pan: 24, tilt: 1 } };
        assert_eq!(command, Some(expected));
        let Some(HeadOrder::Turn { rates }) = scale.order(&expected) else { panic!() };
        assert!((rates[0].to_degrees() - 76.0).abs() < 1e-9 && rates[1] == 0.0, "{rates:?}");
    }

    #[test]
    fn a_calibration_that_states_no_units_is_not_taken_for_degrees() {
        let stated = with_units([AxisUnits::DEGREES; 2]);
        assert_eq!(stated.angles(88, 0)[0], 88f64.to_radians());
        let found = Scale::new(&Profile::evi_d30(), None).angles(88, 0)[0];
        assert!((found - 10f64.to_radians()).abs() < 1e-12);
    }

    #[test]
    fn turns_take_the_nearest_speed_and_stand_still_below_half_the_slowest() {
        let drive = |rate_deg: f64| nominal().pan.drive(rate_deg.to_radians());
        assert_eq!([drive(0.0), drive(1.6), drive(1.7)], [(0, 1), (0, 1), (1, 1)]);
        assert_eq!([drive(-8.2), drive(-8.4), drive(500.0)], [(-1, 2), (-1, 3), (1, 24)]);
        let both = HeadOrder::Turn { rates: [-0.5, 0.3] };
        let command = nominal().command(&both).unwrap();
        assert!(matches!(command, Command::Drive { pan: PanDrive::Left, tilt: TiltDrive::Up, .. }));
        assert_eq!(nominal().command(&HeadOrder::Turn { rates: [0.0, f64::INFINITY] }), None);
    }

    #[test]
    fn zoom_is_kept_within_the_drive() {
        assert_eq!(
            [-5.0, 511.6, 1e9].map(|it| nominal().zoom(it)),
            [0, 512, 1023].map(|it| Some(Command::ZoomDirect(it)))
        );
        assert_eq!(nominal().zoom(f64::NAN), None);
    }
}
