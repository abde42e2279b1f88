//! A motor that is not ideal, the gear on it, and the counter's zero.
//!
//! | here | meaning | unit |
//! |---|---|---|
//! | `torque`, u | what the current gives, as the acceleration that it would cause by itself; it rises no faster than its limit | units/s² |
//! | `gear`, g | where the gear stands: behind the motor by no more than half of the play | units |
//! | `zero` | how far the counter's zero has wandered: an Ornstein–Uhlenbeck process | units |
//!
//! Two loops control it, as in drives that are sold: the way that is left asks for a speed, in proportion, no more than lets it brake in time; what is missing of the
//! speed, and its sum, ask for a torque. The motor knows nothing of what friction takes: v̇ = u − c sign(v) − b v, and standing it holds until u is half as
//! large again as c. None of this is what a rig's own model of a head says (`estimation::actuator`: accelerations that jump).

use foveate_estimation::random::Random;

use super::mechanics::{Goal, TICK_S};
use super::settings::{AxisSettings, MotorSettings};

/// Part of the greatest torque with which braking is planned: the rest is a reserve for errors [–].
const BRAKES_WITH: f64 = 0.7;
/// How quickly the inner loop makes up for a speed that is missing, relative to the outer one [–].
const INNER: f64 = 4.0;
/// How quickly its sum does, relative to itself [–].
const SUM: f64 = 0.25;
/// Static friction relative to sliding friction [–].
const STICKS: f64 = 1.5;
/// This near to its goal the drive lets go, and friction holds it [units].
const LETS_GO: f64 = 0.4;
/// Slower than this nothing slides [units/s].
const STANDS: f64 = 1.0;

/// One axis' drive.
#[derive(Debug, Clone)]
pub(super) struct Drive {
    /// [units/s²]
    most_torque: f64,
    /// [units/s³]
    most_jerk: f64,
    /// [1/s]
    gain: f64,
    /// [units/s²]
    friction: f64,
    /// [1/s]
    viscous: f64,
    half_play: f64,
    /// Standard deviation [units] and time constant [s] of the zero.
    wanders: [f64; 2],
    random: Random,
    torque: f64,
    /// Of speeds that were missing [units].
    sum: f64,
    gear: f64,
    gear_speed: f64,
    zero: f64,
}

impl Drive {
    pub fn new(motor: &MotorSettings, axis: &AxisSettings, acceleration_deg_per_s2: f64, random: &Random) -> Drive {
        let most_torque = acceleration_deg_per_s2 * axis.units_per_deg;
        let fastest = axis.max_speed_deg_per_s * axis.units_per_deg;
        Drive {
            most_torque,
            most_jerk: most_torque / (motor.rise_ms * 1e-3),
            gain: motor.position_gain_per_s,
            friction: motor.friction * most_torque,
            viscous: motor.viscous * most_torque / fastest,
            half_play: 0.5 * motor.backlash_deg * axis.units_per_deg,
            wanders: [motor.zero_drift_deg * axis.units_per_deg, motor.zero_drift_s],
            random: random.fork("zero"),
            torque: 0.0,
            sum: 0.0,
            gear: 0.0,
            gear_speed: 0.0,
            zero: 0.0,
        }
    }

    /// One tick of a motor that stands at `place` and moves at `speed` [units, units/s]: the same after it.
    pub fn step(&mut self, place: f64, speed: f64, goal: Goal) -> (f64, f64) {
        let (way, limit) = match goal {
            Goal::Stop => (0.0, 0.0),
            Goal::At { units, speed } => (units - place, speed),
        };
        let brakes = (2.0 * BRAKES_WITH * self.most_torque * way.abs()).sqrt();
        let wanted = limit.min(brakes).min(self.gain * way.abs()).copysign(way);
        let is_there = way.abs() < LETS_GO && speed.abs() < STANDS;
        let asked = if is_there {
            self.sum = 0.0;
            0.0
        } else {
            let (missing, inner) = (wanted - speed, INNER * self.gain);
            let asked = inner * (missing + SUM * inner * self.sum);
            // What cannot be given is not summed up.
            if asked.abs() < self.most_torque {
                self.sum += missing * TICK_S;
            }
            asked.clamp(-self.most_torque, self.most_torque)
        };
        let most = self.most_jerk * TICK_S;
        self.torque += (asked - self.torque).clamp(-most, most);
        let after = self.slide(speed);
        let place = place + after * TICK_S;
        let gear = self.gear.clamp(place - self.half_play, place + self.half_play);
        (self.gear_speed, self.gear) = ((gear - self.gear) / TICK_S, gear);
        let [sigma, time_s] = self.wanders;
        if sigma > 0.0 {
            let share = TICK_S / time_s;
            self.zero += sigma * (2.0 * share).sqrt() * self.random.normal() - share * self.zero;
        }
        (place, after)
    }

    /// The speed after a tick of torque and friction [units/s].
    fn slide(&self, speed: f64) -> f64 {
        if speed == 0.0 && self.torque.abs() <= STICKS * self.friction {
            return 0.0;
        }
        let pushed = speed + (self.torque - self.viscous * speed) * TICK_S;
        let rubbed = self.friction * TICK_S;
        // Friction brings to rest, it never turns round.
        if pushed.abs() <= rubbed { 0.0 } else { pushed - rubbed.copysign(pushed) }
    }

    /// Where the gear stands and how fast it moves [units, units/s].
    pub fn gear(&self) -> [f64; 2] {
        [self.gear, self.gear_speed]
    }

    /// How far the counter's zero has wandered [units].
    pub fn zero_units(&self) -> f64 {
        self.zero
    }
}
