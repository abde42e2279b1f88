//! A simulated camera as a source: looks at the world at its own moments, delivers its fields later.

use foveate_estimation::random::Random;
use foveate_geometry::Camera;
use foveate_messages::{CameraId, Image};
use foveate_node::{ConfigError, Due, Figures, Io, Node, NodeError, Plan, Pool, Ports, Report, Role, Setup, ports};

use super::fields::{CLOCK_FIGURES, Fields, own_camera};
use crate::bump::Pending;
use crate::camera::{CameraSettings, Renderer, SensorSettings, field_of};
use crate::head::HeadMotion;
use crate::projector::Projection;
use crate::timing::{Arrival, Timing};
use crate::truth::TrueCamera;
use crate::world::World;

ports! {
    WORLD: In<World> = latest("world");
    HEAD: In<HeadMotion> = latest("head").optional();
    LIGHT: In<Projection> = latest("light").optional();
    IMAGE: Out<Image> = "image";
}

/// With `light` connected, that projector lights the surfaces that are measured. With `head` connected it stands on that head: the calibration's camera is the camera at rest, and field k shows the world as the turned
/// camera sees it, its LEDs smeared by the head's motion too. Field k is exposed around its capture time, stamped with what the camera's clock then shows, and delivered later: see
/// [`Timing`]. Its pixels depend on the rig's seed, the camera and k alone.
pub struct SimCamera {
    settings: CameraSettings,
    /// Its name in the calibration, and how that has it.
    name: Option<String>,
    calibrated: Camera,
    id: CameraId,
    random: Random,
    fields: Fields,
    scene: Option<Scene>,
    bump: Option<Pending>,
    pool: Pool<Image>,
}

/// What it looks at, and as what.
struct Scene {
    world: World,
    /// On a head: with both angles zero.
    camera: TrueCamera,
    /// One for all fields, or one for the even and one for the odd ones of an interlaced camera, each with a camera of its own.
    renderers: Vec<(TrueCamera, Renderer)>,
}

impl Node for SimCamera {
    const TYPE: &'static str = "sim.camera";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "A simulated camera: video fields with LEDs, clutter and noise, on its own clock";
    const FIGURES: Figures = CLOCK_FIGURES;
    type Settings = CameraSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: CameraSettings, setup: &Setup) -> Result<Self, ConfigError> {
        check(&settings)?;
        let (id, camera) = own_camera(setup)?;
        Ok(Self {
            bump: Pending::of(settings.bump.as_ref(), setup)?,
            name: setup.camera_name().map(str::to_owned),
            calibrated: camera.clone(),
            id,
            random: setup.random.clone(),
            fields: Fields::new(
                Timing::new(&settings.timing, settings.exposure_ms, &setup.random),
                setup.camera_name(),
            ),
            scene: None,
            pool: Pool::default(),
            settings,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if self.scene.is_none()
            && let Some(world) = io.latest(&WORLD).map(|it| it.value.clone())
        {
            let camera = world.camera(self.name.as_deref(), &self.calibrated);
            let camera = self.settings.stand_m.map_or(camera.clone(), |it| camera.on_stand(it.into()));
            self.scene = Some(self.scene(world, camera, io.latest(&HEAD).is_some()));
        }
        let Some(Arrival { frame, capture, stamp, .. }) = self.fields.next(io, &IMAGE) else {
            return Ok(());
        };
        if self.bump.as_ref().is_some_and(|it| capture >= it.at)
            && let Some((bump, Scene { world, camera, .. })) = self.bump.take().zip(self.scene.take())
        {
            self.scene = Some(self.scene(world, bump.knocked(&camera), io.latest(&HEAD).is_some()));
        }
        let Some(Scene { world, renderers, .. }) = &mut self.scene else {
            Fields::without_world(io, &IMAGE, stamp);
            return Ok(());
        };
        let kind = frame as usize % renderers.len();
        let (camera, renderer) = &mut renderers[kind];
        if !renderer.is_lit()
            && let Some(light) = io.latest(&LIGHT)
        {
            renderer.light_with(light.value, world);
        }
        let mut image = self.pool.take(Image::default);
        match io.latest(&HEAD) {
            None => renderer.render(world, capture, frame, &mut image),
            Some(motion) => renderer.render_on(motion.value, camera, world, capture, frame, &mut image),
        }
        io.emit_numbered(&IMAGE, stamp, frame, self.pool.share(image));
        Ok(())
    }

    fn due(&mut self) -> Due {
        self.fields.due()
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        self.fields.report_clock(report);
        Ok(())
    }

    fn plan(settings: &CameraSettings) -> Plan {
        settings.timing.plan()
    }
}

impl SimCamera {
    fn scene(&self, world: World, camera: TrueCamera, is_on_head: bool) -> Scene {
        let renderer = |camera: TrueCamera| {
            let renderer = if is_on_head {
                Renderer::on_head(&camera, self.id, &self.settings, &self.random)
            } else {
                Renderer::new(&camera, self.id, &world, &self.settings, &self.random)
            };
            (camera, renderer)
        };
        let is_interlaced = self.settings.sensor.as_ref().is_some_and(|it| it.interlaced);
        let renderers = if is_interlaced {
            [0, 1].map(|frame| renderer(field_of(&camera, frame))).into()
        } else {
            vec![renderer(camera.clone())]
        };
        Scene { world, camera, renderers }
    }
}

fn check(settings: &CameraSettings) -> Result<(), ConfigError> {
    settings.timing.check()?;
    ConfigError::unless_in("exposure_ms", settings.exposure_ms, 0.01..=100.0)?;
    ConfigError::unless_in("blur_samples", settings.blur_samples, 1..=32)?;
    ConfigError::unless_in("gain", settings.gain, 0.0..=20.0)?;
    ConfigError::unless_in("black_level", settings.black_level, 0.0..=128.0)?;
    ConfigError::unless_in("room_light", settings.room_light, 0.0..=4.0)?;
    ConfigError::unless_in("spot_sigma_px", settings.spot_sigma_px, 0.3..=20.0)?;
    ConfigError::unless_in("bloom", settings.bloom, 0.0..=0.5)?;
    ConfigError::unless_in("noise_sigma", settings.noise_sigma, 0.0..=20.0)?;
    ConfigError::unless_in("bits", settings.bits, 1..=8)?;
    settings.sensor.as_ref().map_or(Ok(()), SensorSettings::check)?;
    settings.board.as_ref().map_or(Ok(()), crate::camera::BoardSettings::check)?;
    for place in settings.stand_m.iter().flatten() {
        ConfigError::unless_in("stand_m", *place, -1e4..=1e4)?;
    }
    let readout_ms = settings.sensor.as_ref().map_or(0.0, |it| it.readout_ms);
    settings.timing.check_light(settings.exposure_ms, readout_ms)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use foveate_node::Time;
    use foveate_testkit::check_node;

    use super::*;
    use crate::bump::BumpSettings;
    use crate::lab::lab_calibration;
    use crate::timing::TimingSettings;

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
        check_node::<SimCamera>("sensor = { readout_ms = 6, flicker = 0.3 }");
        check_node::<SimCamera>("sensor = { interlaced = true, jpeg_quality = 80 }");
        check_node::<SimCamera>("clock_offset_spread_ms = 8\nfails_at_s = 3\nhiccup_hz = 1");
    }

    #[test]
    fn settings_that_contradict_each_other_are_refused() {
        assert_eq!(refusal(|it| it.timing.rate_hz = -1.0), "rate_hz");
        assert_eq!(refusal(|it| it.exposure_ms = 20.0), "exposure_ms");
        assert_eq!(refusal(|it| it.timing.latency_ms = 1.9), "latency_ms");
        assert_eq!(refusal(|it| it.noise_sigma = f64::NAN), "noise_sigma");
        assert_eq!(
            refusal(|it| it.sensor = Some(SensorSettings { flicker: 2.0, ..Default::default() })),
            "sensor.flicker"
        );
        fn rolling(readout_ms: f64) -> Option<SensorSettings> {
            Some(SensorSettings { readout_ms, ..SensorSettings::default() })
        }
        assert_eq!(refusal(|it| it.sensor = rolling(50.0)), "sensor.readout_ms");
        assert_eq!(refusal(|it| (it.exposure_ms, it.sensor) = (8.0, rolling(16.0))), "latency_ms");
        assert_eq!(refusal(|it| it.timing.latency_jitter_ms = -1.0), "latency_jitter_ms");
        fn bump(camera: &str, at_s: f64) -> Option<BumpSettings> {
            let camera = camera.to_owned();
            Some(BumpSettings { camera, at_s, yaw_mrad: 5.0, pitch_mrad: 0.0, roll_mrad: 0.0 })
        }
        assert_eq!(refusal(|it| it.stand_m = Some([0.0, f64::INFINITY, 0.0])), "stand_m");
        assert_eq!(refusal(|it| it.bump = bump("wide-99", 1.0)), "bump.camera");
        assert_eq!(refusal(|it| it.bump = bump("wide-1", -1.0)), "bump.at_s");
        assert_eq!(refusal(|it| it.timing.failure_every_s = 0.5), "failure_lasts_s");
        let without_camera = SimCamera::new(CameraSettings::default(), &Setup::for_tests());
        assert!(without_camera.is_err_and(|it| it.setting.is_none()));
    }

    #[test]
    fn cameras_look_at_moments_of_their_own_unless_synchronised() {
        let first = |synchronised: bool, camera: u16| {
            let timing = TimingSettings { synchronised, ..TimingSettings::default() };
            let settings = CameraSettings { timing, ..CameraSettings::default() };
            SimCamera::new(settings, &setup(camera)).unwrap().fields.timing.next().capture
        };
        let mut own: Vec<Time> = (0..18).map(|camera| first(false, camera)).collect();
        own.sort();
        own.dedup();
        assert_eq!(own.len(), 18);
        assert!(own.iter().all(|time| (0.002..0.002 + 1.0 / 60.0).contains(&time.as_s())), "{own:?}");
        assert!((0..18).all(|camera| first(true, camera) == Time::from_s(0.002)));
    }
}
