//! A simulated camera before a wall as a source.

use foveate_estimation::random::Random;
use foveate_geometry::Camera;
use foveate_messages::{CameraId, Image};
use foveate_node::{ConfigError, Due, Figures, Io, Node, NodeError, Plan, Pool, Ports, Report, Role, Setup, ports};

use super::fields::{CLOCK_FIGURES, Fields, own_camera};
use crate::camera::{WallCameraSettings, WallRenderer};
use crate::timing::{Arrival, Timing};
use crate::wall::Wall;

ports! {
    WALL: In<Wall> = latest("wall");
    IMAGE: Out<Image> = "image";
}

/// Its pictures show the wall's contents and the spots of pointers, in its own time. Pixels depend on the rig's seed, the camera and the field's number alone.
pub struct SimWallCamera {
    settings: WallCameraSettings,
    name: Option<String>,
    calibrated: Camera,
    id: CameraId,
    random: Random,
    fields: Fields,
    renderer: Option<WallRenderer>,
    pool: Pool<Image>,
}

impl Node for SimWallCamera {
    const TYPE: &'static str = "sim.wall_camera";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str =
        "A simulated camera before the wall: video fields with contents and spots, on its own clock";
    const FIGURES: Figures = CLOCK_FIGURES;
    type Settings = WallCameraSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: WallCameraSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        let (id, camera) = own_camera(setup)?;
        let timing = Timing::new(&settings.timing, settings.exposure_ms, &setup.random);
        Ok(Self {
            name: setup.camera_name().map(str::to_owned),
            calibrated: camera.clone(),
            id,
            random: setup.random.clone(),
            fields: Fields::new(timing, setup.camera_name()),
            renderer: None,
            pool: Pool::default(),
            settings,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if self.renderer.is_none()
            && let Some(wall) = io.latest(&WALL).map(|it| it.value.clone())
        {
            let camera = wall.camera(self.name.as_deref(), &self.calibrated);
            self.renderer = Some(WallRenderer::new(wall, camera, self.id, &self.settings, &self.random));
        }
        let Some(Arrival { frame, capture, stamp, .. }) = self.fields.next(io, &IMAGE) else {
            return Ok(());
        };
        let Some(renderer) = &mut self.renderer else {
            Fields::without_world(io, &IMAGE, stamp);
            return Ok(());
        };
        let mut image = self.pool.take(Image::default);
        renderer.render(capture, frame, &mut image);
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

    fn plan(settings: &WallCameraSettings) -> Plan {
        settings.timing.plan()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use foveate_testkit::check_node;

    use super::*;
    use crate::lab::lab_calibration;

    #[test]
    fn node_keeps_the_law_and_refuses_what_contradicts_itself() {
        check_node::<SimWallCamera>("");
        check_node::<SimWallCamera>("gain = 0.5\nclock_offset_ms = -3");
        let refusal = |change: fn(&mut WallCameraSettings)| {
            let mut setup = Setup::for_tests();
            (setup.calibration, setup.camera) = (Arc::new(lab_calibration()), Some(CameraId(0)));
            let mut settings = WallCameraSettings::default();
            change(&mut settings);
            SimWallCamera::new(settings, &setup).err().and_then(|it| it.setting)
        };
        assert_eq!(refusal(|_| ()), None);
        assert_eq!(refusal(|it| it.exposure_ms = 20.0).as_deref(), Some("exposure_ms"));
        assert_eq!(refusal(|it| it.timing.latency_ms = 0.5).as_deref(), Some("latency_ms"));
        let none = SimWallCamera::new(WallCameraSettings::default(), &Setup::for_tests());
        assert!(none.is_err_and(|it| it.setting.is_none()));
    }
}
