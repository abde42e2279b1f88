//! Lights that dart about: from place to place at full speed, round sharp turns and to dead stops, by no process that a motion model knows.
//!
//! A light's velocity goes from one straight way to the next, or to rest and on, by a constant acceleration: from u to w within |w − u|/a. So a turn, a stop and a
//! reversal are all as hard as the acceleration says, and come when a way happens to end.

use foveate_estimation::random::Random;
use foveate_node::ConfigError;
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Paths are drawn for so long; afterwards the lights rest [s].
const DRAWN_S: f64 = 900.0;
/// So many places are drawn to go to next, until one is far enough for the light to reach its speed.
const MOST_TRIED: usize = 32;

/// How many lights dart about, where, how fast, and how hard they turn and stop.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct DartSettings {
    /// Lights, which shine to all sides [–].
    #[schemars(range(min = 1, max = 64))]
    pub lights: usize,
    /// Speed on each straight way [m/s].
    #[schemars(range(min = 0.01, max = 100.0))]
    pub speed_m_s: f64,
    /// Acceleration with which they start, turn and stop; at 100 m/s² a light of 5 m/s stops in 50 ms, within 125 mm [m/s²].
    #[schemars(range(min = 0.1, max = 10_000.0))]
    pub acceleration_m_s2: f64,
    /// Part of the paths that end at rest; the others continue into the next path at full speed [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub stops: f64,
    /// How long a light rests at most; drawn evenly from 0 on [s].
    #[schemars(range(min = 0.0, max = 60.0))]
    pub rest_s: f64,
    /// Corner of the box in which paths begin and end, with the least coordinates; turns and stops reach past it by up to v²/a [m].
    pub min_m: [f64; 3],
    /// Corner with the greatest coordinates [m].
    pub max_m: [f64; 3],
}

impl Default for DartSettings {
    fn default() -> Self {
        Self {
            lights: 8,
            speed_m_s: 5.0,
            acceleration_m_s2: 100.0,
            stops: 0.5,
            rest_s: 0.5,
            min_m: [-1.0, -1.7, 0.4],
            max_m: [1.0, 1.7, 1.9],
        }
    }
}

impl DartSettings {
    /// Refuses numbers out of their ranges, and a box that is too small for the speed.
    pub(crate) fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("darts.lights", self.lights, 1..=64)?;
        ConfigError::unless_in("darts.speed_m_s", self.speed_m_s, 0.01..=100.0)?;
        ConfigError::unless_in("darts.acceleration_m_s2", self.acceleration_m_s2, 0.1..=10_000.0)?;
        ConfigError::unless_in("darts.stops", self.stops, 0.0..=1.0)?;
        ConfigError::unless_in("darts.rest_s", self.rest_s, 0.0..=60.0)?;
        for corner in self.min_m.iter().chain(&self.max_m) {
            ConfigError::unless_in("darts.min_m", *corner, -1e4..=1e4)?;
        }
        let (low, high) = (self.min_m, self.max_m);
        if low.iter().zip(high).any(|(low, high)| *low > high) {
            let message = format!("found {low:?} with `max_m = {high:?}`, expected no coordinate above that one's");
            return Err(ConfigError::at("darts.min_m", message));
        }
        let (across, least) = ((Point3::from(high) - Point3::from(low)).norm(), 2.0 * self.shortest_m());
        if across < least {
            let message = format!(
                "found {across:.2} m from corner to corner of the box, expected {least:.2} m or more: room for four times the {:.2} m in which a light gets to \
                 {} m/s",
                0.25 * least,
                self.speed_m_s
            );
            return Err(ConfigError::at("darts.max_m", message));
        }
        Ok(())
    }

    /// A light gets to its speed and stops again within this distance [m].
    fn shortest_m(&self) -> f64 {
        self.speed_m_s * self.speed_m_s / self.acceleration_m_s2
    }
}

/// From `begins_s` on, until the next one: where it is then, how it moves, and how that changes.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Stretch {
    begins_s: f64,
    place: Point3<f64>,
    velocity: Vector3<f64>,
    acceleration: Vector3<f64>,
}

impl Stretch {
    fn position(&self, time_s: f64) -> Point3<f64> {
        let t = time_s - self.begins_s;
        self.place + self.velocity * t + self.acceleration * (0.5 * t * t)
    }
}

/// The way of one light.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Dart(Vec<Stretch>);

impl Dart {
    /// Same settings and numbers, same way.
    pub fn new(settings: &DartSettings, random: &mut Random) -> Self {
        let mut drawn = Self(vec![Stretch {
            begins_s: 0.0,
            place: draw_place(settings, random),
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
        }]);
        drawn.rest(settings, random);
        while drawn.end().begins_s < DRAWN_S {
            let way = draw_way(settings, &drawn.end(), random);
            let heading = way.normalize() * settings.speed_m_s;
            drawn.change(heading, settings.acceleration_m_s2);
            // What is left of the way goes by at full speed.
            let left = way.norm() - settings.shortest_m();
            drawn.go_on(left.max(0.0) / settings.speed_m_s);
            if random.uniform() < settings.stops {
                drawn.change(Vector3::zeros(), settings.acceleration_m_s2);
                drawn.rest(settings, random);
            }
        }
        drawn.change(Vector3::zeros(), settings.acceleration_m_s2);
        drawn
    }

    /// Where it is, `time_s` after the lights are there [m].
    pub fn position(&self, time_s: f64) -> Point3<f64> {
        let next = self.0.partition_point(|it| it.begins_s <= time_s);
        let stretch = &self.0[next.max(1) - 1];
        stretch.position(time_s.max(stretch.begins_s))
    }

    /// The last stretch, which goes on for ever.
    fn end(&self) -> Stretch {
        self.0[self.0.len() - 1]
    }

    /// Keeps its acceleration for `lasts_s`, and then has none.
    fn go_on(&mut self, lasts_s: f64) {
        let last = self.end();
        let begins_s = last.begins_s + lasts_s;
        let velocity = last.velocity + last.acceleration * lasts_s;
        self.0.push(Stretch { begins_s, place: last.position(begins_s), velocity, acceleration: Vector3::zeros() });
    }

    /// Changes its velocity to `to` [m/s] by `rate` [m/s²], from the end on.
    fn change(&mut self, to: Vector3<f64>, rate: f64) {
        let Some(last) = self.0.last_mut() else { return };
        let change = to - last.velocity;
        let lasts_s = change.norm() / rate;
        if lasts_s > 0.0 {
            last.acceleration = change / lasts_s;
            self.go_on(lasts_s);
        }
    }

    fn rest(&mut self, settings: &DartSettings, random: &mut Random) {
        self.go_on(settings.rest_s * random.uniform());
    }
}

fn draw_place(settings: &DartSettings, random: &mut Random) -> Point3<f64> {
    Point3::from(
        [0, 1, 2].map(|axis| settings.min_m[axis] + (settings.max_m[axis] - settings.min_m[axis]) * random.uniform()),
    )
}

/// From the end of `last` to a place of the box that is far enough; of those that were tried the farthest, where none is [m].
fn draw_way(settings: &DartSettings, last: &Stretch, random: &mut Random) -> Vector3<f64> {
    let mut longest = Vector3::zeros();
    for _ in 0..MOST_TRIED {
        let way = draw_place(settings, random) - last.place;
        if way.norm() > longest.norm() {
            longest = way;
        }
        if longest.norm() > 1.5 * settings.shortest_m() {
            break;
        }
    }
    longest
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_S: f64 = 1e-3;

    fn places(settings: &DartSettings, seed: u64) -> Vec<Point3<f64>> {
        let dart = Dart::new(settings, &mut Random::new(seed));
        (0..60_000).map(|it| dart.position(f64::from(it) * STEP_S)).collect()
    }

    #[test]
    fn lights_keep_their_speed_and_turn_as_hard_as_they_are_told_to() {
        let settings = DartSettings::default();
        for seed in 1..=5 {
            let places = places(&settings, seed);
            let velocities: Vec<Vector3<f64>> = places.windows(2).map(|it| (it[1] - it[0]) / STEP_S).collect();
            let fastest = velocities.iter().map(Vector3::norm).fold(0.0, f64::max);
            assert!((5.0 - 1e-9..5.0 + 1e-6).contains(&fastest), "{fastest} m/s");
            let hardest = velocities.windows(2).map(|it| (it[1] - it[0]).norm() / STEP_S).fold(0.0, f64::max);
            assert!((99.0..100.0 + 1e-6).contains(&hardest), "{hardest} m/s²");
            let part_of = |least: f64, most: f64| {
                let speeds = velocities.iter().map(Vector3::norm);
                speeds.filter(|it| (least..most).contains(it)).count() as f64 / velocities.len() as f64
            };
            let (at_rest, at_speed) = (part_of(0.0, 1e-6), part_of(4.99, 5.01));
            assert!((0.1..0.5).contains(&at_rest) && at_speed > 0.3, "{at_rest} at rest, {at_speed} at full speed");
        }
    }

    #[test]
    fn lights_stay_by_their_box_and_never_jump() {
        for (acceleration_m_s2, seed) in [(50.0, 1), (100.0, 2), (200.0, 3), (1000.0, 4)] {
            let settings = DartSettings { acceleration_m_s2, ..DartSettings::default() };
            let places = places(&settings, seed);
            assert!(places.windows(2).all(|it| (it[1] - it[0]).norm() < 5.001 * STEP_S));
            let beyond = places.iter().flat_map(|it| {
                (0..3).map(move |axis| (settings.min_m[axis] - it[axis]).max(it[axis] - settings.max_m[axis]))
            });
            let farthest = beyond.fold(0.0, f64::max);
            assert!(farthest <= 25.0 / acceleration_m_s2, "{farthest} m beyond the box");
        }
    }

    #[test]
    fn a_light_rests_when_its_ways_are_over() {
        let dart = Dart::new(&DartSettings::default(), &mut Random::new(1));
        assert_eq!(dart.position(1e4), dart.position(2e4));
    }

    #[test]
    fn box_without_room_for_the_speed_is_refused() {
        let settings = DartSettings { acceleration_m_s2: 5.0, ..DartSettings::default() };
        let error = settings.check().unwrap_err();
        assert_eq!(error.setting.as_deref(), Some("darts.max_m"));
        assert!(error.to_string().contains("10.00 m"), "{error}");
        assert!(DartSettings::default().check().is_ok());
    }
}
