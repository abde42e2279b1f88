//! Model predictive control of a motor along a path.
//!
//! A motor with limited speed and acceleration lags after every change of the path's speed, and overshoots when it has
//! caught up. So each candidate command is tried on a model of the motor, as if it stayed the only one for a while;
//! the command after which the motor was nearest to the path in the mean square is taken (J. Richalet et al., *Model
//! predictive heuristic control*, Automatica 14, 1978).

use super::Order;
use super::motor::Motor;

/// Step of the trials [s].
const STEP_S: f64 = 0.005;
/// What a change of speed costs, as the way that is made during this time at the speed gained: heads that jerk shake their camera, and what one prediction asks for the next ones
/// take back in part, which costs twice the time that the motor speeds up. By trials with hands, heads and feet of recorded people: from 10 to 50 ms it is the same [s].
const CALM_S: f64 = 0.023;
/// What it costs to come out of the trial too fast to stay with the path: of the square of the distance at which the motor would have the path's speed again [–].
const AFTERWARDS: f64 = 0.3;

/// Limits of a motor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotorLimits {
    /// Largest acceleration and deceleration, above 0 [rad/s²].
    pub acceleration: f64,
    /// Highest speed, above 0 [rad/s].
    pub max_speed: f64,
    /// Number of speeds that the device can be set to, evenly spaced up to the highest; 1 or more.
    pub speeds: u32,
}

/// The next command that keeps a motor nearest to `path`: goal [rad] and speed [rad/s]. The motor is at `angle` [rad]
/// and turns at `rate` [rad/s] when it obeys; `path` holds where it should be from then on, one angle every `period_s`
/// [rad, s]. With one angle only the command leads there; with none the motor stays.
pub fn track_path([angle, rate]: [f64; 2], limits: &MotorLimits, path: &[f64], period_s: f64) -> [f64; 2] {
    let MotorLimits { acceleration, max_speed, speeds } = *limits;
    let (Some(last), true) = (path.last(), path.len() > 1) else {
        return [path.first().copied().unwrap_or(angle), max_speed];
    };
    let length_s = period_s * (path.len() - 1) as f64;
    let mut best = (f64::INFINITY, [*last, max_speed]);
    let mut try_out = |goal: f64, speed: f64| {
        let motor = Motor { angle, rate, order: Order::Go { goal, speed } };
        let cost = cost(motor, acceleration, path, period_s);
        if cost < best.0 {
            best = (cost, [goal, speed]);
        }
    };
    for number in 1..=speeds {
        let speed = max_speed * f64::from(number) / f64::from(speeds);
        path.iter().for_each(|goal| try_out(*goal, speed));
        // On and on: so far that it brakes after the time that is looked at, should no other order come.
        let way = speed * length_s + speed * speed / acceleration;
        [angle - way, angle + way].into_iter().for_each(|goal| try_out(goal, speed));
    }
    best.1
}

/// Mean squared distance from the path, and what comes of the state at its end [rad²].
fn cost(mut motor: Motor, acceleration: f64, path: &[f64], period_s: f64) -> f64 {
    let (mut sum, mut steps, mut changes) = (0.0, 0.0, 0.0);
    let length_s = period_s * (path.len() - 1) as f64;
    let mut time_s = 0.0;
    while time_s + STEP_S <= length_s {
        let before = motor.rate;
        motor.advance(STEP_S, acceleration);
        time_s += STEP_S;
        let place = time_s / period_s;
        let index = (place as usize).min(path.len() - 2);
        let wanted = path[index] + (path[index + 1] - path[index]) * (place - index as f64);
        sum += (motor.angle - wanted).powi(2);
        changes += (motor.rate - before).abs();
        steps += 1.0;
    }
    let end = path.len() - 1;
    let too_fast = motor.rate - (path[end] - path[end - 1]) / period_s;
    let passes = motor.angle - path[end] + 0.5 * too_fast * too_fast.abs() / acceleration;
    sum / f64::max(steps, 1.0) + (changes * CALM_S).powi(2) + AFTERWARDS * passes * passes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    const LIMITS: MotorLimits = MotorLimits { acceleration: 7.0, max_speed: 1.4, speeds: 24 };
    const PERIOD_S: f64 = 0.05;

    /// Root of the mean squared distance from `path` over 20 s of orders, each for the next 50 ms, by `leads` [rad].
    fn missed(path: impl Fn(f64) -> f64, leads: impl Fn([f64; 2], &[f64]) -> [f64; 2]) -> f64 {
        let mut motor = Motor::at_rest(path(0.0));
        let (mut sum, mut count) = (0.0, 0.0);
        for order in 0..400 {
            let now_s = f64::from(order) * PERIOD_S;
            let places: Vec<f64> = (0..4).map(|it| path(now_s + f64::from(it) * PERIOD_S)).collect();
            let [goal, speed] = leads([motor.angle, motor.rate], &places);
            motor.order = Order::Go { goal, speed };
            for step in 1..=50 {
                motor.advance(1e-3, LIMITS.acceleration);
                sum += (motor.angle - path(now_s + f64::from(step) * 1e-3)).powi(2);
                count += 1.0;
            }
        }
        (sum / count).sqrt()
    }

    #[test]
    fn a_path_that_the_motor_can_follow_is_followed_closer_than_by_going_where_it_should_be() {
        let mut random = Random::new(8);
        for _ in 0..6 {
            let (size, pace, phase) = (random.uniform_in(0.1, 0.6), random.uniform_in(0.5, 2.0), random.uniform());
            let path = |time_s: f64| size * (pace * time_s + phase).sin();
            let ours = missed(path, |state, path| track_path(state, &LIMITS, path, PERIOD_S));
            let step = missed(path, |state, path| [path[0], ((path[0] - state[0]).abs() / PERIOD_S).clamp(1e-3, 1.4)]);
            assert!(ours < 0.25 * step && ours < 0.01, "{ours} and {step} rad, {size} rad at {pace} rad/s");
        }
    }

    #[test]
    fn what_it_cannot_follow_it_does_not_overshoot() {
        // From end to end at once: 0.5 rad take 0.71 s with 1.4 rad/s and 7 rad/s².
        let path = |time_s: f64| if time_s.rem_euclid(4.0) < 2.0 { 0.25 } else { -0.25 };
        let mut farthest = 0.0_f64;
        let mut motor = Motor::at_rest(0.25);
        for order in 0..400 {
            let now_s = f64::from(order) * PERIOD_S;
            let places: Vec<f64> = (0..4).map(|it| path(now_s + f64::from(it) * PERIOD_S)).collect();
            let [goal, speed] = track_path([motor.angle, motor.rate], &LIMITS, &places, PERIOD_S);
            motor.order = Order::Go { goal, speed };
            (0..50).for_each(|_| motor.advance(1e-3, LIMITS.acceleration));
            farthest = farthest.max(motor.angle.abs());
        }
        assert!(farthest < 0.27, "{farthest} rad");
        let ours = missed(path, |state, path| track_path(state, &LIMITS, path, PERIOD_S));
        assert!(ours < 0.22, "{ours} rad");
    }

    #[test]
    fn speeds_are_those_that_the_motor_has_and_short_paths_are_answered() {
        let [_, speed] = track_path([0.0, 0.0], &LIMITS, &[0.0, 0.01, 0.02, 0.03], PERIOD_S);
        let part = speed / LIMITS.max_speed * 24.0;
        assert!((part - part.round()).abs() < 1e-9 && part >= 1.0, "{part}");
        assert_eq!(track_path([0.3, 0.0], &LIMITS, &[0.5], PERIOD_S), [0.5, 1.4]);
        assert_eq!(track_path([0.3, 0.0], &LIMITS, &[], PERIOD_S), [0.3, 1.4]);
    }
}
