//! A person who walks about with eight LEDs: a pure function of time.
//!
//! The LEDs sit on head, waist, shoulders, elbows and wrists [Davis 2002, Fig. 26]. [`Person::pose`] gives the LEDs and the
//! body parts that may hide them; nothing is remembered between calls, so times may come in any order.

mod body;
mod braid;
mod course;
mod figure;
mod gait;
mod headband;
mod joints;
mod posture;
mod recorded;
mod skeleton;
mod stage;
#[cfg(test)]
mod sticks;
mod upright;
mod visit;
mod walk;
mod whole;

use std::sync::Arc;

use foveate_estimation::random::Random;
use nalgebra::{Point3, Vector2, Vector3};

pub use body::{BodyPart, Led, N_PARTS, Pose};
pub(crate) use braid::Braid;
use gait::Gait;
pub use headband::{Headband, N_ON_HEADBAND};
use posture::Posture;
pub use recorded::RecordedBody;
pub use skeleton::{JOINT_NAMES, Joints, N_JOINT_CENTRES};
pub use stage::COME_S;
use stage::Stage;
use walk::Walk;
pub use whole::{RecordingHints, WholeBody};

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
    way: Way,
    gait: Gait,
    /// In place of the gait: a recording, and how much of it this person is ahead.
    recorded: Option<(Arc<RecordedBody>, f64)>,
    /// How tall, relative to the built-in body or to the recorded one [–].
    size: f64,
}

#[derive(Debug, Clone, PartialEq)]
enum Way {
    Walk(Box<Walk>),
    Stage(Stage),
    Recorded(Recorded),
}

/// Goes where a recording goes.
#[derive(Debug, Clone, PartialEq)]
struct Recorded {
    body: Arc<WholeBody>,
    /// When to begin and which way to face.
    ahead: [f64; 2],
    /// Of the area that it goes about in [m].
    centre: Vector2<f64>,
}

impl Person {
    /// Number `index` of `n_people` who follow each other along one closed path in an area of `area_m`, well apart, at `speed` on
    /// average [m/s]. `random` decides the path's shape (the same for all who share it) and the habits of each.
    pub fn new(index: usize, n_people: usize, area_m: [f64; 2], speed: f64, random: &Random) -> Self {
        let share = index as f64 / n_people.max(1) as f64;
        let walk = Walk::round(share, area_m, speed, &mut random.fork("walk"));
        Self {
            way: Way::Walk(Box::new(walk)),
            gait: Gait::new(speed, &mut random.fork(&format!("gait {index}"))),
            recorded: None,
            size: 1.0,
        }
    }

    /// Number `index` of those who cross each other's ways on `braid`, at `speed` on average [m/s]; comes in at `enter_s` or
    /// somewhat later, stays and stays away at least as long as said (0: for good, and never again).
    pub(crate) fn in_crowd(
        index: usize,
        braid: &Braid,
        speed: f64,
        enter_s: f64,
        stay_away_s: [f64; 2],
        random: &Random,
    ) -> Self {
        let walk = Walk::braid(index, braid, speed, enter_s, stay_away_s, &mut random.fork("walk"));
        Self {
            way: Way::Walk(Box::new(walk)),
            gait: Gait::new(speed, &mut random.fork(&format!("gait {index}"))),
            recorded: None,
            size: 1.0,
        }
    }

    /// An actor who comes in at `enter_s`, stands from [`COME_S`] later on for `stand_s`, and then walks to and fro over `width_m` along X
    /// at `speed` on average [m/s], the face towards +Y nearly always. Who `shows_knee` bends the right one while standing.
    pub fn on_stage(enter_s: f64, stand_s: f64, width_m: f64, speed: f64, shows_knee: bool, random: &Random) -> Self {
        let stage = Stage::new(enter_s, stand_s, width_m, speed, shows_knee, &mut random.fork("stage"));
        Self {
            way: Way::Stage(stage),
            gait: Gait::without_gestures(speed, &mut random.fork("gait 0")),
            recorded: None,
            size: 1.0,
        }
    }

    /// A person who repeats a recorded motion around `centre` [m]; `random` draws the start time and the facing
    /// direction.
    pub fn whole(body: Arc<WholeBody>, centre: Vector2<f64>, random: &mut Random) -> Self {
        let ahead = WholeBody::ahead(random);
        let way = Way::Recorded(Recorded { body, ahead, centre });
        Self { way, gait: Gait::without_gestures(1.0, random), recorded: None, size: 1.0 }
    }

    /// The same person with the body of a recording.
    pub fn recorded(mut self, body: Arc<RecordedBody>, random: &mut Random) -> Self {
        self.recorded = Some((body, RecordedBody::phase(random)));
        self
    }

    /// Which visit it is at `time_s` [s], counted from 0; `None` while the person is not there.
    pub fn visit(&self, time_s: f64) -> Option<u32> {
        match &self.way {
            Way::Walk(walk) => walk.visit(time_s),
            Way::Stage(_) | Way::Recorded(_) => Some(0),
        }
    }

    /// Makes the person so many times as tall; who goes where a recording goes stays as recorded.
    pub(crate) fn grow(&mut self, by: f64) {
        if !matches!(self.way, Way::Recorded(_)) {
            self.size *= by;
        }
    }

    /// The person at `time_s` on the session clock [s].
    pub fn pose(&self, time_s: f64) -> Pose {
        let pose = self.average_pose(time_s);
        if self.size == 1.0 { pose } else { pose.grown(self.size) }
    }

    fn average_pose(&self, time_s: f64) -> Pose {
        let recorded = |way: f64| self.recorded.as_ref().map(|(body, ahead)| body.posture(way, time_s, *ahead));
        let (place, posture) = match &self.way {
            Way::Walk(walk) => {
                let place = walk.at(time_s);
                let posture = recorded(place.way);
                (place, posture.unwrap_or_else(|| Posture::from(self.gait.joints(place.way, time_s))))
            }
            Way::Stage(stage) => {
                let (place, joints, vigour) = stage.at(&self.gait, time_s);
                let posture = Posture::from(joints);
                // Who stands does what the stage asks for; the head always does.
                (place, recorded(place.way).map_or(posture, |it| posture.towards(&it, vigour)))
            }
            Way::Recorded(Recorded { body, ahead, centre }) => return body.pose(time_s, *ahead, *centre),
        };
        body::pose(&place, &posture)
    }

    /// Position [m] and velocity [m/s] of [`Pose::knee_led`] at `time_s` [s].
    pub fn knee_motion(&self, time_s: f64) -> (Point3<f64>, Vector3<f64>) {
        let at = |time_s: f64| self.pose(time_s).knee_led().position;
        let moved = at(time_s + HALF_DIFFERENCE_S) - at(time_s - HALF_DIFFERENCE_S);
        (at(time_s), moved / (2.0 * HALF_DIFFERENCE_S))
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

    const AREA_M: [f64; 2] = [2.5, 4.0];

    fn place(person: &Person, time_s: f64) -> walk::Place {
        match &person.way {
            Way::Walk(walk) => walk.at(time_s),
            Way::Stage(stage) => stage.at(&person.gait, time_s).0,
            Way::Recorded(_) => panic!("a recording has no walk"),
        }
    }

    fn people() -> Vec<Person> {
        let random = Random::new(3);
        (1..=4)
            .flat_map(|n| (0..n).map(move |i| (i, n)))
            .map(|(i, n)| Person::new(i, n, AREA_M, 0.9, &random))
            .collect()
    }

    #[test]
    fn all_leds_stay_in_the_volume() {
        let [min, max] = VOLUME_M;
        for seed in 0..30 {
            for speed in [0.1, 0.9, 2.0] {
                let person = Person::new(0, 1, AREA_M, speed, &Random::new(seed));
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
        let person = Person::new(0, 1, AREA_M, 1.0, &Random::new(1));
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
            let person = Person::new(0, 1, AREA_M, speed, &Random::new(2));
            let (mut sum, mut left, mut right) = (0.0, 0, 0);
            let n = 4000;
            for step in 0..n {
                let time = f64::from(step) * 0.02;
                let (now, later) = (place(&person, time), place(&person, time + 0.02));
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
        let person = Person::new(0, 1, AREA_M, 1.0, &Random::new(4));
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
    fn people_in_a_crowd_keep_apart_also_while_some_come_and_go() {
        let mut nearest = f64::INFINITY;
        for (n, area) in [(4, AREA_M), (8, AREA_M), (32, [9.0, 12.0])] {
            let braid = Braid::new(n, area, 0.6).unwrap();
            let random = Random::new(3);
            let people: Vec<_> = (0..n).map(|i| Person::in_crowd(i, &braid, 0.9, 1.0, [15.0, 4.0], &random)).collect();
            let mut most = 0;
            for step in 0..1200 {
                let time = f64::from(step) * 0.1;
                let here = people.iter().filter(|it| it.visit(time).is_some());
                let places: Vec<_> = here.map(|it| place(it, time).position).collect();
                most = most.max(places.len());
                for i in 0..places.len() {
                    (0..i).for_each(|j| nearest = nearest.min((places[i] - places[j]).norm()));
                }
            }
            assert!(nearest > 0.5, "of {n} people two come as near as {nearest} m");
            assert!(most * 2 > n, "at most {most} of {n} people are there at once");
        }
        assert!(nearest < 0.8, "nobody comes nearer than {nearest} m");
    }

    #[test]
    fn whole_body_is_within_its_reach() {
        let person = Person::new(0, 1, AREA_M, 1.2, &Random::new(7));
        for step in 0..300 {
            let pose = person.pose(f64::from(step) * 0.17);
            let mut farthest: f64 = 0.0;
            for part in pose.parts {
                for end in part.ends {
                    farthest = farthest.max((end.xy() - pose.middle).norm() + part.radius);
                }
            }
            assert!((farthest - pose.reach).abs() < 1e-12 && (0.2..1.0).contains(&pose.reach), "{}", pose.reach);
        }
    }

    #[test]
    fn the_head_is_upright_below_its_led_and_looks_ahead_on_average() {
        let person = Person::new(0, 1, AREA_M, 1.0, &Random::new(5));
        let mut ahead = 0.0;
        for step in 0..400 {
            let pose = person.pose(f64::from(step) * 0.31);
            assert!((pose.head * Vector3::z() - Vector3::z()).norm() < 1e-12);
            let led = pose.head.inverse_transform_point(&pose.leds[0].position);
            assert!((led - Point3::new(0.0235, 0.0, 0.1177)).norm() < 1e-3, "{led}");
            ahead += (pose.head * Vector3::x()).dot(&pose.forward) / 400.0;
        }
        assert!(ahead > 0.9, "{ahead}");
    }

    #[test]
    fn an_actor_comes_in_stands_and_walks_over_the_stage_facing_it() {
        let actor = Person::on_stage(1.0, 8.0, 2.0, 0.9, false, &Random::new(5));
        let (mut across, mut seen, mut n) = ([f64::INFINITY, f64::NEG_INFINITY], 0, 0);
        let mut before: Option<Point3<f64>> = None;
        for step in 0..12_000 {
            let time = 1.0 + f64::from(step) * 0.005;
            let pose = actor.pose(time);
            let head = Point3::from(pose.head.translation.vector);
            if let Some(before) = before.replace(head) {
                assert!((head - before).norm() / 0.005 < 1.7, "{} m/s at {time} s", (head - before).norm() / 0.005);
            }
            let facing = pose.head * Vector3::x();
            if (1.0 + COME_S..9.0 + COME_S).contains(&time) {
                assert!(head.xy().coords.norm() < 0.12 && facing.y > 0.98, "{head} {facing} at {time} s");
            } else if time > 12.0 + COME_S {
                across = [across[0].min(head.x), across[1].max(head.x)];
                assert!(pose.forward.y > 0.6, "{}", pose.forward);
                (seen, n) = (seen + usize::from(facing.y > 0.64), n + 1);
            }
        }
        assert!(actor.pose(1.0).middle.y < -1.5);
        assert!(across.iter().all(|it| (0.9..1.25).contains(&it.abs())), "{across:?}");
        assert!(seen * 20 > n * 19, "{seen} of {n}");
    }

    #[test]
    fn a_led_is_hidden_from_behind_the_body_and_seen_from_its_own_side() {
        let person = Person::new(0, 1, AREA_M, 1.0, &Random::new(5));
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
