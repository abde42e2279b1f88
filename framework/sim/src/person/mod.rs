//! A person who walks about with eight LEDs: a pure function of time.
//!
//! The LEDs sit on head, waist, shoulders, elbows and wrists [Davis 2002, Fig. 26]. [`Person::pose`] gives the LEDs and the
//! body parts that may hide them; nothing is remembered between calls, so times may come in any order.

mod body;
mod gait;
mod walk;

use foveate_estimation::random::Random;
use nalgebra::{Point3, Vector3};

pub use body::{BodyPart, Led, N_PARTS, Pose};
use gait::Gait;
use walk::Walk;

/// How many LEDs a person wears.
pub const N_LEDS: usize = 8;

/// What the LEDs of [`Pose::leds`] sit on, in their order.
pub const LED_NAMES: [&str; N_LEDS] =
    ["head", "waist", "left shoulder", "right shoulder", "left elbow", "right elbow", "left wrist", "right wrist"];

/// Half the interval over which velocities are differenced [s]. With accelerations that change by less than 1 km/s³ the
/// difference is within 1e-7 m/s of the derivative, and rounding adds less than 1e-10.
const HALF_DIFFERENCE_S: f64 = 1e-5;

/// One person of the scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Person {
    walk: Walk,
    gait: Gait,
}

impl Person {
    /// Number `index` of `n_people` who follow each other along one closed path, well apart, at `speed` on average [m/s].
    /// `random` decides the path's shape (the same for all who share it) and the habits of each.
    pub fn new(index: usize, n_people: usize, speed: f64, random: &Random) -> Self {
        let share = index as f64 / n_people.max(1) as f64;
        let walk = Walk::new(share, speed, &mut random.fork("walk"));
        let gait = Gait::new(speed, &mut random.fork(&format!("gait {index}")));
        Self { walk, gait }
    }

    /// The person at `time_s` on the session clock [s].
    pub fn pose(&self, time_s: f64) -> Pose {
        body::pose(&self.walk.at(time_s), &self.gait, time_s)
    }

    /// The LEDs' positions [m] and velocities [m/s] at `time_s` [s].
    pub fn motion(&self, time_s: f64) -> [(Point3<f64>, Vector3<f64>); N_LEDS] {
        let now = self.pose(time_s).leds;
        let before = self.pose(time_s - HALF_DIFFERENCE_S).leds;
        let after = self.pose(time_s + HALF_DIFFERENCE_S).leds;
        std::array::from_fn(|i| (now[i].position, (after[i].position - before[i].position) / (2.0 * HALF_DIFFERENCE_S)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lab::VOLUME_M;

    fn people() -> Vec<Person> {
        let random = Random::new(3);
        (1..=4).flat_map(|n| (0..n).map(move |i| (i, n))).map(|(i, n)| Person::new(i, n, 0.9, &random)).collect()
    }

    #[test]
    fn all_leds_stay_in_the_volume() {
        let [min, max] = VOLUME_M;
        for seed in 0..30 {
            for speed in [0.1, 0.9, 2.0] {
                let person = Person::new(0, 1, speed, &Random::new(seed));
                for step in 0..1500 {
                    let time = f64::from(step) * 0.11;
                    for (led, name) in person.pose(time).leds.iter().zip(LED_NAMES) {
                        let inside = (0..3).all(|axis| (min[axis]..max[axis]).contains(&led.position[axis]));
                        assert!(inside, "{name} is at {} m at {time} s, speed {speed}, seed {seed}", led.position);
                    }
                }
            }
        }
    }

    #[test]
    fn velocity_is_the_derivative_of_the_position() {
        // Simpson's rule over the velocities gives the displacement; its error over 1 ms is far below the bound.
        let person = Person::new(0, 1, 1.0, &Random::new(1));
        for step in 0..200 {
            let (from, half) = (f64::from(step) * 0.173, 0.0005);
            let [a, b, c] = [0.0, 1.0, 2.0].map(|it| person.motion(from + it * half));
            for led in 0..N_LEDS {
                let integral = (a[led].1 + b[led].1 * 4.0 + c[led].1) * (half / 3.0);
                let error = (c[led].0 - a[led].0 - integral).norm();
                assert!(error < 1e-9, "{} at {from} s: {error} m", LED_NAMES[led]);
            }
        }
    }

    #[test]
    fn walking_speed_is_as_asked_and_there_are_turns_to_both_sides() {
        for speed in [0.5, 1.2] {
            let person = Person::new(0, 1, speed, &Random::new(2));
            let (mut sum, mut left, mut right) = (0.0, 0, 0);
            let n = 4000;
            for step in 0..n {
                let time = f64::from(step) * 0.02;
                let (now, later) = (person.walk.at(time), person.walk.at(time + 0.02));
                sum += (later.position - now.position).norm() / 0.02;
                let turn = now.forward.x * later.forward.y - now.forward.y * later.forward.x;
                *(if turn > 0.0 { &mut left } else { &mut right }) += 1;
            }
            let mean = sum / f64::from(n);
            assert!((mean / speed - 1.0).abs() < 0.1, "{mean} m/s instead of {speed}");
            assert!(left > n / 10 && right > n / 10, "{left} steps turn left, {right} right");
        }
    }

    #[test]
    fn arms_swing_against_each_other() {
        let person = Person::new(0, 1, 1.0, &Random::new(4));
        // How far each elbow is before its shoulder, while no arm is raised in a gesture.
        let reaches: Vec<[f64; 2]> = (0..4000)
            .map(|step| person.pose(f64::from(step) * 0.01))
            .map(|pose| [4, 5].map(|it| (pose.leds[it].position - pose.leds[it - 2].position).dot(&pose.forward)))
            .filter(|[left, right]| left.max(*right) < 0.14)
            .collect();
        let mean = |f: &dyn Fn(&[f64; 2]) -> f64| reaches.iter().map(f).sum::<f64>() / reaches.len() as f64;
        let [left, right] = [mean(&|it| it[0]), mean(&|it| it[1])];
        let covariance = mean(&|it| (it[0] - left) * (it[1] - right));
        let variance = mean(&|it| (it[0] - left).powi(2));
        assert!(reaches.len() > 1000 && covariance < -0.5 * variance, "{covariance} {variance} {}", reaches.len());
    }

    #[test]
    fn people_keep_apart() {
        let people = people();
        for step in 0..1000 {
            let time = f64::from(step) * 0.1;
            let heads: Vec<_> = people[6..].iter().map(|it| it.pose(time).leds[0].position).collect();
            for i in 0..heads.len() {
                for j in 0..i {
                    assert!((heads[i] - heads[j]).norm() > 0.9, "{i} and {j} at {time} s");
                }
            }
        }
    }

    #[test]
    fn a_led_is_hidden_from_behind_the_body_and_seen_from_its_own_side() {
        let person = Person::new(0, 1, 1.0, &Random::new(5));
        for step in 0..50 {
            let pose = person.pose(f64::from(step) * 0.31);
            let waist = pose.leds[1].position;
            let ahead = waist + pose.forward * 2.0 + Vector3::z() * 0.6;
            let behind = waist - pose.forward * 2.0 + Vector3::z() * 0.6;
            assert!(pose.occluded(&behind, &waist), "the waist is seen through the body at step {step}");
            assert_eq!(pose.leds[1].emission_towards(&behind), 0.0);
            assert!(pose.leds[1].emission_towards(&ahead) > 0.5);
            let head = pose.leds[0].position;
            assert!(!pose.occluded(&(head + Vector3::z()), &head));
        }
    }
}
