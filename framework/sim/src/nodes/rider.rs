//! An ideal detector on a rig that a person carries: the cameras of a scale whose space moves.

use foveate_geometry::Camera;
use foveate_messages::{Features, TargetId, Targets};
use foveate_node::{
    ConfigError, Due, Figures, Io, Node, NodeError, Plan, Pool, Ports, Report, Role, Setup, Time, ports,
};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::fields::{CLOCK_FIGURES, Fields, own_camera};
use crate::observer::{Observer, ObserverSettings};
use crate::person::N_LEDS;
use crate::timing::{Arrival, Timing, TimingSettings};
use crate::world::World;

ports! {
    WORLD: In<World> = latest("world");
    FEATURES: Out<Features> = "features";
}

/// Most people of a simulated world, less one.
const LAST_PERSON: u32 = 31;

/// What the cameras ride on; in the order of [`LED_NAMES`](crate::person::LED_NAMES).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Carrier {
    /// The light on the head.
    #[default]
    Head,
    /// The light at the waist.
    Waist,
    /// The light on the left shoulder.
    LeftShoulder,
    /// The light on the right shoulder.
    RightShoulder,
    /// The light at the left elbow.
    LeftElbow,
    /// The light at the right elbow.
    RightElbow,
    /// The light at the left wrist.
    LeftWrist,
    /// The light at the right wrist.
    RightWrist,
}

/// The carrier of the cameras, and how well they see.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RiderSettings {
    /// Capture times, clock and delivery of its features.
    #[serde(flatten)]
    pub timing: TimingSettings,
    /// The person who carries the cameras, counted from 0; while that person is away they see nothing [–].
    #[schemars(range(min = 0, max = 31))]
    pub person: u32,
    /// The light of that person that they ride on [–].
    pub light: Carrier,
    /// Standard deviation of a feature along a row; along a column it is that divided by the pixels' aspect. Stated as it is with each
    /// feature [px].
    #[schemars(range(min = 0.001, max = 20.0))]
    pub noise_px: f64,
    /// Share of the lights in view that are not found, drawn for each light and field [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub missed: f64,
    /// Features that are no light, anywhere in the picture: mean number in a field [–].
    #[schemars(range(min = 0.0, max = 200.0))]
    pub clutter: f64,
}

impl Default for RiderSettings {
    fn default() -> Self {
        let ObserverSettings { timing, noise_px, missed, clutter, .. } = ObserverSettings::default();
        Self { timing, person: 0, light: Carrier::Head, noise_px, missed, clutter }
    }
}

/// A camera and its detector in one, on a light framework that one light of a person carries about: it moves with that light and keeps the
/// world's axes, so that the calibration's camera stands in a space whose origin that light is. Lights shine all around,
/// and nothing hides them. Only the simulation knows the carrier: a rig has to find it with its scale's anchor.
pub struct SimRider {
    observer: Observer,
    fields: Fields,
    person: u32,
    light: u32,
    world: Option<World>,
    /// Its camera in the calibration, by name and as that has it.
    name: Option<String>,
    calibrated: Camera,
    truth: Targets,
    lights: Vec<(TargetId, Point3<f64>)>,
    pool: Pool<Features>,
}

impl SimRider {
    /// All lights as they are seen from what carries the camera; none while that is away.
    fn look_around(&mut self, world: &World, capture: Time) {
        world.truth_into(capture, &mut self.truth);
        self.lights.clear();
        let n_people = world.settings().people as u32;
        let n_leds = N_LEDS as u32;
        let carries = |id: u32| id % n_leds == self.light && (id / n_leds).checked_rem(n_people) == Some(self.person);
        let Some(origin) = self.truth.list.iter().find(|it| carries(it.id.0)).map(|it| it.position) else { return };
        self.lights.extend(self.truth.list.iter().map(|it| (it.id, Point3::from(it.position - origin))));
    }
}

impl Node for SimRider {
    const TYPE: &'static str = "sim.rider";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "An ideal LED detector for cameras that move with one light of a simulated person";
    const FIGURES: Figures = CLOCK_FIGURES;
    type Settings = RiderSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: RiderSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let RiderSettings { timing, person, light, noise_px, missed, clutter } = settings;
        let observer = ObserverSettings { timing, noise_px, missed, clutter, ..ObserverSettings::default() };
        observer.check()?;
        ConfigError::unless_in("person", person, 0..=LAST_PERSON)?;
        let (id, camera) = own_camera(setup)?;
        Ok(Self {
            observer: Observer::new(camera, id, &observer, &setup.random),
            fields: Fields::new(Timing::new(&observer.timing, 0.0, &setup.random), setup.camera_name()),
            person,
            light: light as u32,
            world: None,
            name: setup.camera_name().map(str::to_owned),
            calibrated: camera.clone(),
            truth: Targets::default(),
            lights: Vec::new(),
            pool: Pool::default(),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if self.world.is_none()
            && let Some(world) = io.latest(&WORLD).map(|it| it.value.clone())
        {
            self.observer.stand(&world.camera(self.name.as_deref(), &self.calibrated));
            self.world = Some(world);
        }
        let Some(Arrival { frame, capture, stamp, .. }) = self.fields.next(io, &FEATURES) else {
            return Ok(());
        };
        let Some(world) = self.world.clone() else {
            Fields::without_world(io, &FEATURES, stamp);
            return Ok(());
        };
        self.look_around(&world, capture);
        let mut features = self.pool.take(Features::default);
        self.observer.look_at(&self.lights, capture, &mut features);
        io.emit_numbered(&FEATURES, stamp, frame, self.pool.share(features));
        Ok(())
    }

    fn due(&mut self) -> Due {
        self.fields.due()
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        self.fields.report_clock(report);
        Ok(())
    }

    fn plan(settings: &RiderSettings) -> Plan {
        settings.timing.plan()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use foveate_estimation::random::Random;
    use foveate_messages::CameraId;
    use foveate_testkit::check_node;

    use super::*;
    use crate::lab::lab_calibration;
    use crate::person::LED_NAMES;
    use crate::world::SceneSettings;

    #[test]
    fn node_keeps_the_law() {
        check_node::<SimRider>("");
        check_node::<SimRider>("person = 1\nlight = \"left_wrist\"\nclutter = 0.0\nrate_hz = 120");
    }

    #[test]
    fn what_carries_the_cameras_is_the_origin_while_it_is_there() {
        let world = World::new(SceneSettings { people: 2, ..SceneSettings::default() }, &Random::new(1));
        let mut setup = Setup::for_tests();
        (setup.calibration, setup.camera) = (Arc::new(lab_calibration()), Some(CameraId(0)));
        let settings = RiderSettings { person: 1, light: Carrier::LeftElbow, ..RiderSettings::default() };
        let mut rider = SimRider::new(settings, &setup).unwrap();
        rider.look_around(&world, Time::from_s(0.5));
        assert_eq!(rider.lights, [], "nobody is there yet");
        let time = Time::from_s(3.0);
        rider.look_around(&world, time);
        assert_eq!(LED_NAMES[4], "left elbow");
        let truth = world.truth(time);
        let offset = |id: u32| rider.lights.iter().find(|it| it.0 == TargetId(id)).unwrap().1;
        assert_eq!(offset(8 + 4), Point3::origin());
        let position = |id: u32| truth.list.iter().find(|it| it.id == TargetId(id)).unwrap().position;
        assert!((offset(3).coords - (position(3) - position(12))).norm() < 1e-12);
        assert_eq!(rider.lights.len(), 16);
    }

    #[test]
    fn settings_out_of_range_and_a_missing_camera_are_refused() {
        let refusal = |change: fn(&mut RiderSettings)| {
            let mut setup = Setup::for_tests();
            (setup.calibration, setup.camera) = (Arc::new(lab_calibration()), Some(CameraId(0)));
            let mut settings = RiderSettings::default();
            change(&mut settings);
            SimRider::new(settings, &setup).err().and_then(|it| it.setting)
        };
        assert_eq!(refusal(|_| ()), None);
        assert_eq!(refusal(|it| it.person = 32).as_deref(), Some("person"));
        assert_eq!(refusal(|it| it.noise_px = 0.0).as_deref(), Some("noise_px"));
        let without_camera = SimRider::new(RiderSettings::default(), &Setup::for_tests());
        assert!(without_camera.is_err_and(|it| it.setting.is_none()));
    }
}
