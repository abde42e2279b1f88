//! A simulated projector as a source: its light in the world, and the pictures that it is commanded to show.

use foveate_messages::PatternShown;
use foveate_node::{ConfigError, Due, Io, Node, NodeError, Plan, Ports, Role, Setup, Time, ports};

use crate::projector::{Projection, ProjectorSettings};

ports! {
    LIGHT: Out<Projection> = "light";
    SHOWN: Out<PatternShown> = "shown";
}

/// Emits its light once, at time 0, before any camera looks, and for each picture a message at the time of its command; the light comes later by the
/// projector's latency. It stands in the calibration like a camera, which `camera` names.
pub struct SimProjector {
    projection: Projection,
    manifest: String,
    is_up: bool,
    /// Number of the next picture over all sets.
    next: u64,
}

impl Node for SimProjector {
    const TYPE: &'static str = "sim.projector";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "A simulated projector: shows striped patterns, with gamma, blur and latency";
    type Settings = ProjectorSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: ProjectorSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let (Some(id), Some(camera)) = (setup.camera, setup.camera_model()) else {
            return Err(ConfigError::node(
                "found no camera, expected `camera` to name the projector, which stands in the calibration like a camera",
            ));
        };
        let name = setup.camera_name().unwrap_or_default();
        Ok(Self {
            manifest: settings.manifest(camera.image_size),
            projection: Projection::new(name, id, camera, &settings, &setup.random)?,
            is_up: false,
            next: 0,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if !std::mem::replace(&mut self.is_up, true) {
            io.emit_at(&LIGHT, Time::ZERO, self.projection.clone());
        }
        let command = self.projection.command(self.next);
        if command.from > io.now() {
            return Ok(());
        }
        self.next += 1;
        let pictures = self.projection.pictures();
        let shown = PatternShown {
            projector: self.projection.id(),
            set: command.set,
            index: command.index as u32,
            count: pictures.len() as u32,
            name: pictures[command.index].to_string(),
            from: command.from,
            lasts: self.projection.period(),
            manifest: self.manifest.clone(),
        };
        io.emit_at(&SHOWN, command.from, shown);
        Ok(())
    }

    fn due(&mut self) -> Due {
        Due::At(if self.is_up { self.projection.command(self.next).from } else { Time::ZERO })
    }

    fn plan(settings: &ProjectorSettings) -> Plan {
        // What it shows is a function of time: nobody changes it.
        Plan { rate_hz: Some(settings.rate_hz), reacts_after_s: f64::INFINITY, ..Plan::default() }
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
        check_node::<SimProjector>("");
        check_node::<SimProjector>("code = \"gray\"\norder = \"white black columns\"\nstart_s = 1");
    }

    #[test]
    fn settings_out_of_range_and_a_missing_projector_are_refused() {
        let mut setup = Setup::for_tests();
        assert!(SimProjector::new(ProjectorSettings::default(), &setup).is_err_and(|it| it.setting.is_none()));
        (setup.calibration, setup.camera) = (Arc::new(lab_calibration()), Some(CameraId(0)));
        assert!(SimProjector::new(ProjectorSettings::default(), &setup).is_ok());
        let wrong = ProjectorSettings { rate_hz: -1.0, ..ProjectorSettings::default() };
        assert!(SimProjector::new(wrong, &setup).is_err_and(|it| it.setting.as_deref() == Some("rate_hz")));
    }
}
