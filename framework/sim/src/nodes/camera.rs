//! A simulated camera as a source: looks at the world at its own moments, delivers its fields later.

use foveate_dataflow::{
    ConfigError, Due, In, Interval, Io, Node, NodeError, Out, Plan, Pool, Ports, Role, Setup, Time,
};
use foveate_estimation::random::Random;
use foveate_geometry::Camera;
use foveate_messages::{CameraId, Image};

use crate::camera::{CameraSettings, Renderer};
use crate::chance::stream;
use crate::world::World;

const WORLD: In<World> = In::latest(0, "world");
const IMAGE: Out<Image> = Out::new(0, "image");

/// A camera whose delivery is this late gives up on the fields that it could not make [s].
const PATIENCE_S: f64 = 0.1;

/// Field k is exposed around `phase + k / rate + exposure / 2`, stamped with that time, and delivered `latency` later. Its pixels
/// depend on the rig's seed, the camera and k alone.
pub struct SimCamera {
    settings: CameraSettings,
    camera: Camera,
    id: CameraId,
    random: Random,
    lottery: u64,
    phase_s: f64,
    next: u64,
    scene: Option<(World, Renderer)>,
    /// Whether the turn at the start of the session was taken.
    is_up: bool,
    pool: Pool<Image>,
}

impl Node for SimCamera {
    const TYPE: &'static str = "sim.camera";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "A camera in a simulated world: fields with LEDs, clutter, noise, in its own time";
    type Settings = CameraSettings;

    fn ports() -> Ports {
        Ports::new().input(&WORLD).output(&IMAGE)
    }

    fn new(settings: CameraSettings, setup: &Setup) -> Result<Self, ConfigError> {
        check(&settings)?;
        let (Some(id), Some(camera)) = (setup.camera, setup.camera_model()) else {
            return Err(ConfigError::node(
                "found no camera, expected `each` or `camera` to name cameras of the calibration",
            ));
        };
        let period = 1.0 / settings.rate_hz;
        let phase_s = if settings.synchronised { 0.0 } else { setup.random.fork("phase").uniform() * period };
        Ok(Self {
            camera: camera.clone(),
            id,
            random: setup.random.clone(),
            lottery: setup.random.fork("lost fields").next_u64(),
            phase_s,
            next: 0,
            scene: None,
            is_up: false,
            pool: Pool::default(),
            settings,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if self.scene.is_none()
            && let Some(world) = io.latest(&WORLD).map(|it| it.value.clone())
        {
            let renderer = Renderer::new(&self.camera, self.id, &world, &self.settings, &self.random);
            self.scene = Some((world, renderer));
        }
        if !std::mem::replace(&mut self.is_up, true) {
            return Ok(()); // the turn before the first field, in which the room is built
        }
        while (io.now() - self.delivery(self.next)).as_s() > PATIENCE_S {
            io.gap(&IMAGE, self.capture(self.next), "the simulated camera was asked too late for this field");
            self.next += 1;
        }
        let (frame, capture) = (self.next, self.capture(self.next));
        self.next += 1;
        if stream(self.lottery, 0, frame as i64).uniform() < self.settings.lost {
            io.gap(&IMAGE, capture, "the settings of the simulated camera lose this field");
            return Ok(());
        }
        let Some((world, renderer)) = &mut self.scene else {
            io.gap(&IMAGE, capture, "the simulated world has not arrived yet");
            return Ok(());
        };
        let mut image = self.pool.take(Image::default);
        renderer.render(world, capture, frame, &mut image);
        io.emit_numbered(&IMAGE, capture, frame, self.pool.share(image));
        Ok(())
    }

    fn due(&mut self) -> Due {
        Due::At(if self.is_up { self.delivery(self.next) } else { Time::ZERO })
    }

    fn plan(settings: &CameraSettings) -> Plan {
        Plan { rate_hz: Some(settings.rate_hz), latency_s: settings.latency_ms * 1e-3 }
    }
}

impl SimCamera {
    /// The middle of the exposure of field `frame`.
    fn capture(&self, frame: u64) -> Time {
        Time::from_s(self.phase_s + frame as f64 / self.settings.rate_hz + self.settings.exposure_ms * 0.5e-3)
    }

    fn delivery(&self, frame: u64) -> Time {
        self.capture(frame) + Interval::from_ms(self.settings.latency_ms)
    }
}

fn check(settings: &CameraSettings) -> Result<(), ConfigError> {
    ConfigError::unless_in("rate_hz", settings.rate_hz, 0.1..=1000.0)?;
    ConfigError::unless_in("exposure_ms", settings.exposure_ms, 0.01..=100.0)?;
    ConfigError::unless_in("latency_ms", settings.latency_ms, 0.0..=10_000.0)?;
    ConfigError::unless_in("lost", settings.lost, 0.0..=1.0)?;
    ConfigError::unless_in("blur_samples", settings.blur_samples, 1..=32)?;
    ConfigError::unless_in("gain", settings.gain, 0.0..=20.0)?;
    ConfigError::unless_in("black_level", settings.black_level, 0.0..=128.0)?;
    ConfigError::unless_in("room_light", settings.room_light, 0.0..=4.0)?;
    ConfigError::unless_in("spot_sigma_px", settings.spot_sigma_px, 0.3..=20.0)?;
    ConfigError::unless_in("noise_sigma", settings.noise_sigma, 0.0..=20.0)?;
    ConfigError::unless_in("bits", settings.bits, 1..=8)?;
    let (exposure, latency) = (settings.exposure_ms, settings.latency_ms);
    if exposure > 1000.0 / settings.rate_hz {
        let period = 1000.0 / settings.rate_hz;
        return Err(ConfigError::at(
            "exposure_ms",
            format_args!("found {exposure}, expected at most {period:.2}, the time between two fields"),
        ));
    }
    if latency < exposure / 2.0 {
        return Err(ConfigError::at(
            "latency_ms",
            format_args!("found {latency}, expected at least {}: light is gathered until then", exposure / 2.0),
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use foveate_testkit::check_node;

    use super::*;
    use crate::lab::lab_calibration;

    fn setup(camera: u16) -> Setup {
        let mut setup = Setup::for_tests();
        setup.calibration = Arc::new(lab_calibration());
        setup.camera = Some(CameraId(camera));
        setup.random = setup.random.fork(&format!("camera {camera}"));
        setup
    }

    fn refusal(change: fn(&mut CameraSettings)) -> String {
        let mut settings = CameraSettings::default();
        change(&mut settings);
        SimCamera::new(settings, &setup(0)).err().and_then(|it| it.setting).unwrap()
    }

    #[test]
    fn node_keeps_the_law() {
        check_node::<SimCamera>("");
        check_node::<SimCamera>("synchronised = true\nbits = 6");
    }

    #[test]
    fn settings_that_contradict_each_other_are_refused() {
        assert_eq!(refusal(|it| it.rate_hz = -1.0), "rate_hz");
        assert_eq!(refusal(|it| it.exposure_ms = 20.0), "exposure_ms");
        assert_eq!(refusal(|it| it.latency_ms = 1.9), "latency_ms");
        assert_eq!(refusal(|it| it.noise_sigma = f64::NAN), "noise_sigma");
        let without_camera = SimCamera::new(CameraSettings::default(), &Setup::for_tests());
        assert!(without_camera.is_err_and(|it| it.setting.is_none()));
    }

    #[test]
    fn cameras_look_at_moments_of_their_own_unless_synchronised() {
        let first = |synchronised: bool, camera: u16| {
            let settings = CameraSettings { synchronised, ..CameraSettings::default() };
            SimCamera::new(settings, &setup(camera)).unwrap().capture(0)
        };
        let mut own: Vec<Time> = (0..18).map(|camera| first(false, camera)).collect();
        own.sort();
        own.dedup();
        assert_eq!(own.len(), 18);
        assert!(own.iter().all(|time| (0.002..0.002 + 1.0 / 60.0).contains(&time.as_s())), "{own:?}");
        assert!((0..18).all(|camera| first(true, camera) == Time::from_s(0.002)));
    }
}
