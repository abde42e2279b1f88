//! The simulated world: people with LEDs, and all that a camera may mistake for them.
//!
//! A [`World`] is a pure function of time and of its seed. Whatever happens at random (a window that opens on a monitor, a
//! glint in one lens) is drawn by the number of the event, so any camera may be asked at any time, in any order.
//!
//! Brightness is in gray levels of a camera with gain 1.

mod clutter;
mod furniture;

use std::sync::Arc;

use foveate_estimation::random::Random;
use foveate_messages::{CameraId, How, Message, SpaceKind, Target, TargetId, Targets, Time};
use nalgebra::{Matrix6, Point3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use clutter::{BrightSpot, Glint, MAX_MONITORS, Monitor, PANES};
pub use furniture::{Surface, room_light};

use crate::person::{BodyPart, N_LEDS, Person, Pose};

/// At this distance [m] a LED seen along its normal has the brightness [`SceneSettings::led_peak`].
pub const REFERENCE_DISTANCE_M: f64 = 3.0;

/// What is in the room.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SceneSettings {
    /// People who walk about, each with eight LEDs [–].
    #[schemars(range(min = 0, max = 4))]
    pub people: usize,
    /// When they come in, from one moment to the next: before, the empty room lets detectors learn what it looks like [s].
    #[schemars(range(min = 0.0, max = 3600.0))]
    pub people_enter_s: f64,
    /// How fast they walk on average; they slow down in turns [m/s].
    #[schemars(range(min = 0.1, max = 2.0))]
    pub speed_m_s: f64,
    /// What the middle of a LED's spot would reach, seen along its normal from 3 m with gain 1; above 255 it saturates
    /// [gray level].
    #[schemars(range(min = 0.0, max = 5000.0))]
    pub led_peak: f64,
    /// Small bright things that stay where they are: lamps, reflections [–].
    #[schemars(range(min = 0, max = 200))]
    pub bright_spots: usize,
    /// Monitors that flicker, and whose windows change at random times [–].
    #[schemars(range(min = 0, max = 8))]
    pub monitors: usize,
    /// Mean time between two changes of one window on a monitor [s].
    #[schemars(range(min = 0.05, max = 3600.0))]
    pub window_change_s: f64,
    /// How often the truth is told [Hz].
    #[schemars(range(min = 1.0, max = 10_000.0))]
    pub truth_hz: f64,
    /// Short glints, each in one camera only: how many a second and camera [Hz].
    #[schemars(range(min = 0.0, max = 30.0))]
    pub glints_hz: f64,
}

impl Default for SceneSettings {
    fn default() -> Self {
        Self {
            people: 1,
            people_enter_s: 1.0,
            speed_m_s: 0.9,
            led_peak: 800.0,
            bright_spots: 14,
            monitors: 4,
            window_change_s: 4.0,
            truth_hz: 60.0,
            glints_hz: 0.2,
        }
    }
}

/// A handle to the simulated world; cloning it is cheap.
#[derive(Debug, Clone)]
pub struct World(Arc<Scene>);

#[derive(Debug)]
struct Scene {
    settings: SceneSettings,
    people: Vec<Person>,
    spots: Vec<BrightSpot>,
    monitors: Vec<Monitor>,
    seed: u64,
}

impl Message for World {
    const NAME: &'static str = "world";
    const SPACE: SpaceKind = SpaceKind::ScalePoints;
}

/// A LED at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// Whose it is.
    pub id: TargetId,
    /// Where it is [m].
    pub position: Point3<f64>,
    /// Brightness at 3 m in the direction asked for [gray level].
    pub brightness: f64,
}

/// All people at one time; reused from frame to frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Moment {
    /// In the order of their numbers.
    pub poses: Vec<Pose>,
}

impl World {
    /// The world of these settings; out-of-range values are taken as they are. Same seed, same world.
    pub fn new(settings: SceneSettings, random: &Random) -> Self {
        let people = settings.people;
        let scene = Scene {
            people: (0..people).map(|i| Person::new(i, people, settings.speed_m_s, &random.fork("people"))).collect(),
            spots: clutter::bright_spots(settings.bright_spots, &mut random.fork("spots")),
            monitors: clutter::monitors(settings.monitors, &mut random.fork("monitors")),
            seed: random.fork("events").next_u64(),
            settings,
        };
        Self(Arc::new(scene))
    }

    /// What it was made of.
    pub fn settings(&self) -> &SceneSettings {
        &self.0.settings
    }

    /// How many targets there are once people have come in.
    pub fn n_targets(&self) -> usize {
        self.0.people.len() * N_LEDS
    }

    /// Those who have come in by `time`.
    fn people_at(&self, time: Time) -> &[Person] {
        if time.as_s() >= self.0.settings.people_enter_s { &self.0.people } else { &[] }
    }

    /// Fills `moment` with the people as they are at `time`.
    pub fn at(&self, time: Time, moment: &mut Moment) {
        moment.poses.clear();
        moment.poses.extend(self.people_at(time).iter().map(|person| person.pose(time.as_s())));
    }

    /// Where all LEDs truly are at `time`: measured, without uncertainty, seen by no camera in particular. Person p's LED l, in
    /// the order of [`LED_NAMES`](crate::person::LED_NAMES), is target 8 p + l.
    pub fn truth(&self, time: Time) -> Targets {
        let mut truth = Targets::default();
        self.truth_into(time, &mut truth);
        truth
    }

    /// As [`Self::truth`], in memory that is used again.
    pub fn truth_into(&self, time: Time, truth: &mut Targets) {
        truth.time = time;
        truth.list.clear();
        let leds = self.people_at(time).iter().flat_map(|person| person.motion(time.as_s()));
        truth.list.extend(leds.enumerate().map(|(i, (position, velocity))| Target {
            id: TargetId(i as u32),
            position,
            velocity,
            covariance: Matrix6::zeros(),
            cameras: Default::default(),
            how: How::Measured,
        }));
    }

    /// Small bright things that stay where they are.
    pub fn bright_spots(&self) -> &[BrightSpot] {
        &self.0.spots
    }

    /// The monitors; [`Self::pane_brightness`] tells how bright they are.
    pub fn monitors(&self) -> &[Monitor] {
        &self.0.monitors
    }

    /// How bright a pane of a monitor (both counted from 0) is at `time` [gray level].
    pub fn pane_brightness(&self, monitor: usize, pane: usize, time: Time) -> f64 {
        clutter::pane_brightness(self.0.seed, monitor * PANES + pane, self.0.settings.window_change_s, time.as_s())
    }

    /// The glints in this camera's image at `time`.
    pub fn glints(&self, camera: CameraId, time: Time) -> impl Iterator<Item = Glint> {
        clutter::glints(self.0.seed, camera, self.0.settings.glints_hz, time.as_s())
    }
}

impl Moment {
    /// The LEDs that are seen from `eye` [m], with their brightness in that direction; those that a body part hides, and those
    /// that shine away from it, are left out.
    pub fn lights_seen_from<'s>(&'s self, eye: &'s Point3<f64>, led_peak: f64) -> impl Iterator<Item = Light> + 's {
        let leds = self.poses.iter().flat_map(|pose| pose.leds);
        leds.enumerate().filter_map(move |(i, led)| {
            let brightness = led_peak * led.emission_towards(eye);
            let seen = brightness > 0.0 && !self.occluded(eye, &led.position);
            seen.then_some(Light { id: TargetId(i as u32), position: led.position, brightness })
        })
    }

    /// Whether somebody's body lies between `eye` and `point` [m].
    pub fn occluded(&self, eye: &Point3<f64>, point: &Point3<f64>) -> bool {
        self.poses.iter().any(|pose| pose.occluded(eye, point))
    }

    /// All body parts.
    pub fn parts(&self) -> impl Iterator<Item = &BodyPart> {
        self.poses.iter().flat_map(|pose| &pose.parts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lab::wide_cameras;

    fn world(settings: SceneSettings) -> World {
        World::new(SceneSettings { people_enter_s: 0.0, ..settings }, &Random::new(1))
    }

    #[test]
    fn answers_do_not_depend_on_the_order_of_questions() {
        let (one, other) = (world(SceneSettings::default()), world(SceneSettings::default()));
        let times: Vec<Time> = (0..200).map(|i| Time::from_s(f64::from(i * 37 % 200) * 0.05)).collect();
        let mut sorted = times.clone();
        sorted.sort();
        let answer = |world: &World, time: Time| {
            let panes: Vec<f64> = (0..PANES).map(|pane| world.pane_brightness(1, pane, time)).collect();
            let glints: Vec<Glint> = (0..18).flat_map(|camera| world.glints(CameraId(camera), time)).collect();
            (world.truth(time), panes, glints)
        };
        let in_order: Vec<_> = sorted.iter().map(|&time| answer(&one, time)).collect();
        for time in times {
            let expected = &in_order[sorted.binary_search(&time).unwrap()];
            assert_eq!(answer(&other, time), *expected);
        }
    }

    #[test]
    fn every_led_is_seen_by_several_cameras_nearly_always() {
        let world = world(SceneSettings::default());
        let cameras = wide_cameras();
        let mut moment = Moment::default();
        let (mut counts, n_times) = ([[0; 19]; N_LEDS], 600);
        for step in 0..n_times {
            world.at(Time::from_s(f64::from(step) * 0.1), &mut moment);
            let mut seen = [0; N_LEDS];
            for (_, camera) in &cameras {
                for light in moment.lights_seen_from(&camera.centre(), 1.0) {
                    let bright = light.brightness > 0.2;
                    seen[light.id.0 as usize] += usize::from(bright && camera.sees(&light.position).is_some());
                }
            }
            (0..N_LEDS).for_each(|led| counts[led][seen[led]] += 1);
        }
        for (led, histogram) in counts.iter().enumerate() {
            let sum: usize = histogram.iter().enumerate().map(|(n, count)| n * count).sum();
            let few: usize = histogram[..3].iter().sum();
            println!(
                "{:15} mean {:.1}, below 3: {few}",
                crate::person::LED_NAMES[led],
                sum as f64 / f64::from(n_times)
            );
            assert!(few * 50 < n_times as usize, "LED {led} is seen by fewer than three cameras in {few} of {n_times}");
        }
    }

    #[test]
    fn room_is_empty_until_people_come_in() {
        let world = World::new(SceneSettings { people_enter_s: 1.0, ..SceneSettings::default() }, &Random::new(1));
        let mut moment = Moment::default();
        for (time, n_people) in [(0.0, 0), (0.999, 0), (1.0, 1), (50.0, 1)] {
            world.at(Time::from_s(time), &mut moment);
            assert_eq!((moment.poses.len(), world.truth(Time::from_s(time)).list.len()), (n_people, n_people * N_LEDS));
        }
    }

    #[test]
    fn people_have_eight_targets_each_with_numbers_in_order() {
        let world = world(SceneSettings { people: 3, ..SceneSettings::default() });
        let truth = world.truth(Time::from_s(2.0));
        assert_eq!(truth.list.len(), world.n_targets());
        assert!(truth.list.iter().enumerate().all(|(i, it)| it.id == TargetId(i as u32)));
    }
}
