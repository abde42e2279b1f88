//! Perfect segmentation as a source: silhouettes of people in the studio, each pixel true.

use foveate_messages::{Silhouette, SilhouetteStatus, Window};
use foveate_node::{ConfigError, Due, Figures, Io, Node, NodeError, Plan, Pool, Ports, Report, Role, Setup, ports};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::fields::{CLOCK_FIGURES, Fields, own_camera};
use crate::camera::PeopleView;
use crate::head::HeadMotion;
use crate::timing::{Arrival, Timing, TimingSettings};
use crate::truth::TrueCamera;
use crate::world::World;

ports! {
    WORLD: In<World> = latest("world");
    HEAD: In<HeadMotion> = latest("head").optional();
    SILHOUETTE: Out<Silhouette> = "silhouette";
}

/// Settings of [`SimSilhouettes`].
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SilhouettesSettings {
    /// Capture times, clock and delivery of its silhouettes.
    #[serde(flatten)]
    pub timing: TimingSettings,
}

/// What the centre of each pixel of its camera sees at the capture time: background or a person of the `studio`, all people as one. With `head` connected it stands on that head.
pub struct SimSilhouettes {
    name: Option<String>,
    id: foveate_messages::CameraId,
    /// The camera; on a head, with both angles zero.
    camera: TrueCamera,
    view: PeopleView,
    fields: Fields,
    world: Option<World>,
    pool: Pool<Silhouette>,
}

impl Node for SimSilhouettes {
    const TYPE: &'static str = "sim.silhouettes";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Perfect silhouettes of people in the simulated studio, without pictures";
    const FIGURES: Figures = CLOCK_FIGURES;
    type Settings = SilhouettesSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: SilhouettesSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.timing.check()?;
        let (id, camera) = own_camera(setup)?;
        Ok(Self {
            name: setup.camera_name().map(str::to_owned),
            id,
            camera: TrueCamera::from(camera),
            view: PeopleView::default(),
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
            self.world = Some(world.clone());
        }
        let Some(Arrival { frame, capture, stamp, .. }) = self.fields.next(io, &SILHOUETTE) else {
            return Ok(());
        };
        let Some(world) = &self.world else {
            Fields::without_world(io, &SILHOUETTE, stamp);
            return Ok(());
        };
        if world.studio().is_none() {
            return Err(NodeError::input(
                "found a world without people in clothes, expected `studio = {}` at `sim.lab`",
            ));
        }
        match io.latest(&HEAD) {
            None => self.view.look(world, &self.camera, capture),
            Some(motion) => self.view.look(world, &motion.value.camera_at(&self.camera, capture), capture),
        }
        let mut silhouette = self.pool.take(Silhouette::default);
        silhouette.confidence.clear();
        silhouette.confidence.extend(self.view.seen.iter().map(|it| if *it > 0 { 255 } else { 0 }));
        silhouette.n_body = self.view.seen.iter().filter(|it| **it > 0).count() as u32;
        (silhouette.camera, silhouette.window) = (self.id, Window::default());
        [silhouette.width, silhouette.height] = self.camera.image_size;
        silhouette.status = if silhouette.n_body > 0 { SilhouetteStatus::Seen } else { SilhouetteStatus::Empty };
        io.emit_numbered(&SILHOUETTE, stamp, frame, self.pool.share(silhouette));
        Ok(())
    }

    fn due(&mut self) -> Due {
        self.fields.due()
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        self.fields.report_clock(report);
        Ok(())
    }

    fn plan(settings: &SilhouettesSettings) -> Plan {
        settings.timing.plan()
    }
}

#[cfg(test)]
mod tests {
    use foveate_testkit::check_node;

    use super::*;

    #[test]
    fn node_keeps_the_law() {
        check_node::<SimSilhouettes>("");
        check_node::<SimSilhouettes>("rate_hz = 25\nsynchronised = true");
    }
}
