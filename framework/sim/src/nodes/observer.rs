//! An ideal detector as a source: features without pictures, for set-ups too large to render.

use foveate_messages::Features;
use foveate_node::{ConfigError, Due, Figures, Io, Node, NodeError, Plan, Pool, Ports, Report, Role, Setup, ports};

use super::fields::{CLOCK_FIGURES, Fields, own_camera};
use crate::bump::Pending;
use crate::head::HeadMotion;
use crate::observer::{Observer, ObserverSettings};
use crate::timing::{Arrival, Timing};
use crate::truth::TrueCamera;
use crate::world::World;

ports! {
    WORLD: In<World> = latest("world");
    HEAD: In<HeadMotion> = latest("head").optional();
    FEATURES: Out<Features> = "features";
}

/// A camera and its detector in one. With `head` connected it stands on that head, the calibration's camera being the camera at rest. Clock, delays and failures are those of `sim.camera`; what is seen is [`Observer`]'s.
pub struct SimObserver {
    observer: Observer,
    /// Its name in the calibration.
    name: Option<String>,
    /// The camera; on a head, with both angles zero.
    camera: TrueCamera,
    bump: Option<Pending>,
    fields: Fields,
    world: Option<World>,
    pool: Pool<Features>,
}

impl Node for SimObserver {
    const TYPE: &'static str = "sim.observer";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "An ideal LED detector in the simulated lab: noise, misses and clutter, no pictures";
    const FIGURES: Figures = CLOCK_FIGURES;
    type Settings = ObserverSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: ObserverSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        let (id, camera) = own_camera(setup)?;
        Ok(Self {
            bump: Pending::of(settings.bump.as_ref(), setup)?,
            name: setup.camera_name().map(str::to_owned),
            camera: TrueCamera::from(camera),
            observer: Observer::new(camera, id, &settings, &setup.random),
            fields: Fields::new(Timing::new(&settings.timing, 0.0, &setup.random), setup.camera_name()),
            world: None,
            pool: Pool::default(),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if self.world.is_none()
            && let Some(world) = io.latest(&WORLD).map(|it| it.value)
        {
            self.camera = world.camera(self.name.as_deref(), &self.camera);
            self.observer.stand(&self.camera);
            self.world = Some(world.clone());
        }
        let Some(Arrival { frame, capture, stamp, .. }) = self.fields.next(io, &FEATURES) else {
            return Ok(());
        };
        if let Some(bump) = self.bump.take_if(|it| capture >= it.at) {
            self.camera = bump.knocked(&self.camera);
            self.observer.stand(&self.camera);
        }
        if let Some(motion) = io.latest(&HEAD) {
            self.observer.stand(&motion.value.camera_at(&self.camera, capture));
        }
        let Some(world) = &self.world else {
            Fields::without_world(io, &FEATURES, stamp);
            return Ok(());
        };
        let mut features = self.pool.take(Features::default);
        self.observer.look(world, capture, &mut features);
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

    fn plan(settings: &ObserverSettings) -> Plan {
        settings.timing.plan()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use foveate_messages::CameraId;
    use foveate_testkit::check_node;

    use super::*;
    use crate::lab::lab_calibration;

    #[test]
    fn node_keeps_the_law() {
        check_node::<SimObserver>("");
        check_node::<SimObserver>("noise_px = 0.5\nclock_offset_ms = -3\nbodies = false");
    }

    #[test]
    fn settings_out_of_range_and_a_missing_camera_are_refused() {
        let refusal = |change: fn(&mut ObserverSettings)| {
            let mut setup = Setup::for_tests();
            (setup.calibration, setup.camera) = (Arc::new(lab_calibration()), Some(CameraId(0)));
            let mut settings = ObserverSettings::default();
            change(&mut settings);
            SimObserver::new(settings, &setup).err().and_then(|it| it.setting)
        };
        assert_eq!(refusal(|_| ()), None);
        assert_eq!(refusal(|it| it.noise_px = 0.0).as_deref(), Some("noise_px"));
        assert_eq!(refusal(|it| it.missed = f64::NAN).as_deref(), Some("missed"));
        assert_eq!(refusal(|it| it.timing.hiccup_hz = -1.0).as_deref(), Some("hiccup_hz"));
        assert_eq!(refusal(|it| it.hidden_every_s = 0.2).as_deref(), Some("hidden_lasts_s"));
        let without_camera = SimObserver::new(ObserverSettings::default(), &Setup::for_tests());
        assert!(without_camera.is_err_and(|it| it.setting.is_none()));
    }
}
