//! The mechanics of a head: two motors and a zoom that take their time.
//!
//! A move is made after its latency. A motor follows it with limited speed and acceleration, brakes in time, and stands at whole
//! units only. What it carries swings on it as a damped spring does:
//!
//! | here         | meaning                          | unit     |
//! |--------------|----------------------------------|----------|
//! | `motor`, `q` | where the motor stands, whole    | units    |
//! | `speed`, `v` | how fast it turns                | units/s  |
//! | `load`, `y`  | where the camera really looks    | units    |
//!
//! ÿ = −ω² (y − q) − 2 ζ ω (ẏ − v), stepped every millisecond.
//!
//! The motor is either ideal: it speeds up and brakes with the acceleration that is stated and stands at whole units; or it is one of [`MotorSettings`], see
//! `drive`, and then q is where its gear stands, which has play.

use std::collections::VecDeque;

use foveate_estimation::random::Random;
use foveate_messages::{Interval, Time};

use super::drive::Drive;
use super::settings::{AxisSettings, HeadSettings};

/// The step in which all mechanics go [ns].
pub(super) const TICK: Interval = Interval(1_000_000);
pub(super) const TICK_S: f64 = 1e-3;
/// This near to its goal a motor is there [units].
const THERE: f64 = 0.01;

/// A command to an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Goal {
    /// Go there [units], at most at this speed [units/s].
    At { units: f64, speed: f64 },
    /// Come to rest.
    Stop,
}

/// One axis: a motor and what it carries.
#[derive(Debug, Clone)]
pub struct Axis {
    settings: AxisSettings,
    /// [units/s²]
    acceleration: f64,
    /// Circular frequency of what swings [rad/s], 0 if nothing does, and its damping.
    swing: [f64; 2],
    goal: Goal,
    waiting: VecDeque<(Time, Goal)>,
    motor: f64,
    speed: f64,
    load: f64,
    load_speed: f64,
    /// `None`: an ideal motor.
    drive: Option<Drive>,
}

impl Axis {
    /// One of the axes of a head; `random` is its own.
    pub(super) fn new(settings: AxisSettings, head: &HeadSettings, random: &Random) -> Axis {
        Axis {
            drive: head.motor.as_ref().map(|motor| Drive::new(motor, &settings, head.acceleration_deg_per_s2, random)),
            settings,
            acceleration: head.acceleration_deg_per_s2 * settings.units_per_deg,
            swing: [head.vibration_hz * std::f64::consts::TAU, head.vibration_damping],
            goal: Goal::Stop,
            waiting: VecDeque::new(),
            motor: 0.0,
            speed: 0.0,
            load: 0.0,
            load_speed: 0.0,
        }
    }

    /// From `at` on this is the goal; moves come in the order of their times.
    pub(super) fn order(&mut self, at: Time, goal: Goal) {
        self.waiting.push_back((at, goal));
    }

    /// Forgets moves that have not begun by `felt`.
    pub(super) fn forget(&mut self, felt: Time) {
        self.waiting.retain(|it| it.0 < felt);
    }

    /// Speed number `code`, from 1 [units/s].
    pub(super) fn speed_of(&self, code: u8) -> f64 {
        let settings = &self.settings;
        f64::from(code) / f64::from(settings.speeds) * settings.max_speed_deg_per_s * settings.units_per_deg
    }

    /// One tick, which ends at `now`.
    pub(super) fn step(&mut self, now: Time) {
        while self.waiting.front().is_some_and(|it| it.0 <= now) {
            if let Some((_, goal)) = self.waiting.pop_front() {
                self.goal = goal;
            }
        }
        match &mut self.drive {
            Some(drive) => (self.motor, self.speed) = drive.step(self.motor, self.speed, self.goal),
            None => self.step_ideal(),
        }
        let reach = f64::from(self.settings.reach_units);
        if self.motor.abs() > reach {
            (self.motor, self.speed) = (self.motor.clamp(-reach, reach), 0.0);
        }
        let [stands, speed] = self.drive.as_ref().map_or([self.motor.round(), self.speed], Drive::gear);
        self.swing(stands, speed);
    }

    fn step_ideal(&mut self) {
        let acceleration = self.acceleration;
        let (way, limit) = match self.goal {
            Goal::Stop => (0.0, 0.0),
            Goal::At { units, speed } => (units - self.motor, speed),
        };
        let change = acceleration * TICK_S;
        // The greatest speed for this tick from which it can still stop in time: v² = 2 a (way − v · tick).
        let brakes = (change * change + 2.0 * acceleration * way.abs()).sqrt() - change;
        let wanted = limit.min(brakes).copysign(way);
        self.speed += (wanted - self.speed).clamp(-change, change);
        match self.goal {
            Goal::At { units, .. } if (units - self.motor).abs() < THERE && self.speed.abs() <= 4.0 * change => {
                (self.motor, self.speed) = (units, 0.0);
            }
            _ => self.motor += self.speed * TICK_S,
        }
    }

    /// On what stands here and moves at this speed [units, units/s].
    fn swing(&mut self, stands: f64, speed: f64) {
        let [omega, damping] = self.swing;
        if omega == 0.0 {
            (self.load, self.load_speed) = (stands, speed);
            return;
        }
        let drag = 2.0 * damping * omega * (self.load_speed - speed);
        self.load_speed -= (omega * omega * (self.load - stands) + drag) * TICK_S;
        self.load += self.load_speed * TICK_S;
    }

    /// Whether the motor stands, and nothing waits.
    pub(super) fn is_done(&self) -> bool {
        let is_there = match self.goal {
            Goal::Stop => true,
            Goal::At { units, .. } => self.motor_units() == units.round() as i32,
        };
        is_there && self.speed == 0.0 && self.waiting.is_empty()
    }

    /// Where the motor stands [units].
    pub fn motor_units(&self) -> i32 {
        self.motor.round() as i32
    }

    /// Where the camera looks, vibration and all [rad].
    pub fn angle_rad(&self) -> f64 {
        let wandered = self.drive.as_ref().map_or(0.0, Drive::zero_units);
        ((self.load + wandered) / self.settings.units_per_deg).to_radians()
    }

    /// How fast the motor turns [rad/s].
    pub fn speed_rad_per_s(&self) -> f64 {
        (self.speed / self.settings.units_per_deg).to_radians()
    }
}

/// The zoom, or the focus: from end to end at one speed [units].
#[derive(Debug, Clone)]
pub(super) struct Zoom {
    position: f64,
    goal: f64,
    units_per_s: f64,
    waiting: VecDeque<(Time, ZoomGoal)>,
}

/// A command to a zoom.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum ZoomGoal {
    /// Go there [units].
    At(f64),
    /// Stay where it then is.
    Stop,
}

impl Zoom {
    /// At the near end of `ends`, of which the way to the far one takes `travel_ms`.
    pub(super) fn new(ends: [f64; 2], travel_ms: f64) -> Zoom {
        let units_per_s = (ends[1] - ends[0]) / travel_ms * 1e3;
        Zoom { position: ends[0], goal: ends[0], units_per_s, waiting: VecDeque::new() }
    }

    /// From `at` on this is the goal; commands come in the order of their times.
    pub(super) fn order(&mut self, at: Time, goal: ZoomGoal) {
        self.waiting.push_back((at, goal));
    }

    /// One tick, which ends at `now`.
    pub(super) fn step(&mut self, now: Time) {
        while self.waiting.front().is_some_and(|it| it.0 <= now) {
            match self.waiting.pop_front() {
                Some((_, ZoomGoal::At(units))) => self.goal = units,
                Some((_, ZoomGoal::Stop)) => self.goal = self.position.round(),
                None => {}
            }
        }
        let most = self.units_per_s * TICK_S;
        self.position += (self.goal - self.position).clamp(-most, most);
    }

    pub(super) fn is_done(&self) -> bool {
        self.position == self.goal && self.waiting.is_empty()
    }

    /// Where it stands, between whole units too [units].
    pub(super) fn position(&self) -> f64 {
        self.position
    }

    /// Where it stands [units].
    pub(super) fn units(&self) -> u16 {
        self.position.round() as u16
    }
}

#[cfg(test)]
mod tests {
    use super::super::settings::MotorSettings;
    use super::*;

    /// Position of motor and camera [units] and speed [units/s] at every millisecond of one move of the pan axis.
    fn moved(goal: Goal, ticks: i64, settings: &HeadSettings) -> (Axis, Vec<[f64; 3]>) {
        let mut axis = Axis::new(settings.pan.axis(), settings, &Random::new(1));
        axis.order(Time(TICK.0), goal);
        let path = (1..=ticks).map(|tick| {
            axis.step(Time(tick * TICK.0));
            [axis.motor, axis.load, axis.speed]
        });
        let path = path.collect();
        (axis, path)
    }

    #[test]
    fn a_move_takes_the_time_that_speed_and_acceleration_allow() {
        let settings = HeadSettings::default();
        // 90° at 80°/s with 400°/s²: 90/80 + 80/400 s.
        let (axis, path) = moved(Goal::At { units: 792.0, speed: 704.0 }, 2000, &settings);
        let arrived = path.iter().position(|it| it[0] == 792.0).unwrap();
        assert!((1310..1345).contains(&arrived), "{arrived} ms");
        assert!(axis.is_done());
        assert!(path.iter().all(|it| it[0] <= 792.0), "the motor never overshoots");
        let change = path.windows(2).map(|it| (it[1][2] - it[0][2]).abs()).fold(0.0, f64::max);
        assert!(change <= 400.0 * 8.8 * 1e-3 * 4.0 + 1e-9, "{change}");
        assert!(path.iter().all(|it| it[2] <= 704.0 + 1e-9));
    }

    #[test]
    fn the_camera_swings_after_a_stop_at_its_frequency_and_comes_to_rest() {
        let (_, path) = moved(Goal::At { units: 88.0, speed: 704.0 }, 3000, &HeadSettings::default());
        let arrived = path.iter().position(|it| it[0] == 88.0).unwrap();
        let swings: Vec<usize> = (arrived + 1..path.len())
            .filter(|&tick| (path[tick - 1][1] - 88.0) * (path[tick][1] - 88.0) < 0.0)
            .collect();
        // Half a period is 1 / (2 · 8 Hz · √(1 − 0.15²)) = 63.2 ms.
        let half = (swings[3] - swings[0]) as f64 / 3.0;
        assert!((half - 63.2).abs() < 2.0, "{half} ms");
        let greatest = |from: usize| path[from..].iter().map(|it| (it[1] - 88.0).abs()).fold(0.0, f64::max);
        assert!(greatest(arrived) > 0.5, "it can be seen: {}", greatest(arrived));
        assert!(greatest(2500) < 0.01, "it dies away: {}", greatest(2500));
    }

    #[test]
    fn motors_stand_at_whole_units_and_within_their_reach() {
        let rigid = HeadSettings { vibration_hz: 0.0, ..HeadSettings::default() };
        let (_, path) = moved(Goal::At { units: 40.0, speed: 50.0 }, 1500, &rigid);
        assert!(path.iter().all(|it| it[1] == it[1].round()));
        let (axis, _) = moved(Goal::At { units: 5000.0, speed: 704.0 }, 3000, &rigid);
        assert_eq!(axis.motor_units(), 880);
    }

    #[test]
    fn a_stop_brakes() {
        let mut axis = moved(Goal::At { units: 800.0, speed: 704.0 }, 600, &HeadSettings::default()).0;
        let before = axis.motor;
        axis.order(Time(601 * TICK.0), Goal::Stop);
        (601..1200).for_each(|tick| axis.step(Time(tick * TICK.0)));
        // 80°/s at 400°/s²: 8°.
        assert!((axis.motor - before - 8.0 * 8.8).abs() < 1.0, "{}", axis.motor - before);
        assert!(axis.is_done());
    }

    /// With these motors and nothing that swings.
    fn driven(motor: MotorSettings) -> HeadSettings {
        HeadSettings { vibration_hz: 0.0, motor: Some(motor), ..HeadSettings::default() }
    }

    const EXACT: MotorSettings = MotorSettings {
        rise_ms: 40.0,
        position_gain_per_s: 12.0,
        friction: 0.08,
        viscous: 0.1,
        backlash_deg: 0.0,
        zero_drift_deg: 0.0,
        zero_drift_s: 120.0,
    };

    #[test]
    fn a_driven_axis_arrives_later_than_an_ideal_one_and_its_acceleration_never_jumps() {
        for (goal, speed) in [(792.0, 704.0), (-88.0, 200.0), (9.0, 704.0), (1.0, 30.0)] {
            let (axis, path) = moved(Goal::At { units: goal, speed }, 3000, &driven(EXACT));
            assert!(axis.is_done() && axis.motor_units() == goal as i32, "{goal}: {} units", axis.motor);
            let (_, ideal) = moved(Goal::At { units: goal, speed }, 3000, &HeadSettings::default());
            let arrived = |path: &[[f64; 3]]| path.iter().position(|it| (it[0] - goal).abs() < 0.5).unwrap();
            assert!(arrived(&path) > arrived(&ideal), "{goal}: after {} and {} ms", arrived(&path), arrived(&ideal));
            let overshoot = path.iter().map(|it| it[0] * goal.signum()).fold(0.0, f64::max) - goal.abs();
            assert!(overshoot < 0.06 * goal.abs() + 0.5, "{goal}: {overshoot} units too far");
            let most = 400.0 * 8.8 * 1e-3;
            let changes: Vec<f64> = path.windows(2).map(|it| it[1][2] - it[0][2]).collect();
            // Rubbing begins and ends at once, all else rises in 40 ms.
            let rubs = 0.12 * 2.0 * most;
            assert!(changes.windows(2).all(|it| (it[1] - it[0]).abs() < most / 40.0 + rubs + 1e-9), "{goal}");
            assert!(changes.iter().all(|it| it.abs() <= 1.2 * most), "{goal}");
            assert!(path.iter().all(|it| it[2].abs() <= 1.1 * speed), "{goal}");
        }
    }

    #[test]
    fn play_leaves_the_camera_behind_by_half_of_it_on_either_side() {
        let settings = driven(MotorSettings { backlash_deg: 1.0, ..EXACT });
        let mut axis = Axis::new(settings.pan.axis(), &settings, &Random::new(1));
        let mut stands = |units: f64, from_ms: i64| {
            axis.order(Time(from_ms * TICK.0), Goal::At { units, speed: 200.0 });
            (from_ms..from_ms + 3000).for_each(|tick| axis.step(Time(tick * TICK.0)));
            assert!(axis.is_done());
            axis.load - axis.motor
        };
        // A degree is 8.8 units.
        assert!((stands(100.0, 1) + 4.4).abs() < 1e-9);
        assert!((stands(50.0, 5000) - 4.4).abs() < 1e-9);
    }

    #[test]
    fn the_zero_wanders_slowly_and_as_far_as_is_said() {
        let settings = driven(MotorSettings { zero_drift_deg: 0.2, zero_drift_s: 2.0, ..EXACT });
        let mut axis = Axis::new(settings.pan.axis(), &settings, &Random::new(4));
        let angles: Vec<f64> = (1..400_000)
            .map(|tick| {
                axis.step(Time(tick * TICK.0));
                axis.angle_rad().to_degrees()
            })
            .collect();
        assert_eq!(axis.motor_units(), 0, "the counter does not know");
        let sigma = (angles.iter().map(|it| it * it).sum::<f64>() / angles.len() as f64).sqrt();
        assert!((0.15..0.25).contains(&sigma), "{sigma}");
        let in_100_ms = angles.windows(101).map(|it| (it[100] - it[0]).abs()).fold(0.0, f64::max);
        assert!((0.1..0.4).contains(&in_100_ms), "{in_100_ms}");
    }
}
