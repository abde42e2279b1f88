//! `laser_pointer.tracker`: pointers on a wall, from the spots that cameras find [Davis 2002 §6.1].

mod mirrors;
mod pointers;
mod settings;
#[cfg(test)]
mod tests;

use foveate::prelude::*;
use foveate::scene::WallMap;

pub use pointers::{Pointers, Tally};
pub use settings::TrackerSettings;

ports! {
    FEATURES: In<Features> = each("features").many();
    TARGETS: Out<Targets> = "targets";
}

figures! {
    "pointers.begun": count, neither, "Pointers that began";
    "pointers.candidates_dropped": count, neither, "Spots that no second camera saw at the same place, or that did not stay";
    "pointers.spots": count, neither, "Spots that came in from the detectors";
    "pointers.spots_dim": count, neither, "Those of them that the wall itself could have shown";
    "pointers.spots_large": count, neither, "Those that were too large";
    "pointers.spots_beside": count, neither, "Those beside the wall";
    "pointers.bezels": count, neither, "Lines in which bezels mirror spots, as learnt, over all cameras";
    "pointers.frames_late": count, low, "Frames that came after a later one of another camera, and were left out";
    "pointers.disputed": count, low, "Spots that one camera reported for long and another, which sees the place, did not";
}

/// Spots of each camera in, at its own times; after each frame all pointers leave at the frame's time: in metres on the wall, x to the right and y down from its top left
/// corner, z = 0. An identity lasts from press to release. Pointers that this frame's camera did not see are predicted.
pub struct Tracker {
    pointers: Pointers,
    names: Vec<String>,
    pool: Pool<Targets>,
}

impl Node for Tracker {
    const TYPE: &'static str = "laser_pointer.tracker";
    const ROLE: Role = Role::Integrator;
    const SUMMARY: &'static str = "Tracks laser pointers on a wall, from the spots that several cameras find";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = TrackerSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: TrackerSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        if settings.map.is_empty() {
            let message = "found nothing, expected the file that `laser_pointer.calibrator` wrote";
            return Err(ConfigError::at("map", message));
        }
        let path = setup.path("map", &settings.map)?;
        let map = WallMap::load(&path).map_err(|error| ConfigError::at("map", error.to_string()))?;
        let names: Vec<String> = setup.calibration.cameras.iter().map(|it| it.name.clone()).collect();
        for named in &setup.calibration.cameras {
            let Some(camera) = map.cameras.get(&named.name) else { continue };
            let (found, expected) = (camera.map.image_size, named.camera.image_size);
            if found != expected {
                let message = format!(
                    "{}: found {} x {} px for `{}`, expected the {} x {} px of the rig's calibration",
                    path.display(),
                    found[0],
                    found[1],
                    named.name,
                    expected[0],
                    expected[1]
                );
                return Err(ConfigError::at("map", message));
            }
        }
        if !names.iter().any(|it| map.cameras.contains_key(it)) {
            let known: Vec<&str> = map.cameras.keys().map(String::as_str).collect();
            let message = format!(
                "{}: found {}, expected a camera of the rig's calibration among them",
                path.display(),
                known.join(", ")
            );
            return Err(ConfigError::at("map", message));
        }
        Ok(Self { pointers: Pointers::new(settings, &map, &names), names, pool: Pool::default() })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(features) = io.take(&FEATURES) {
            let mut targets = self.pool.take(Targets::default);
            if self.pointers.take_in(features.time(), &features.value, &mut targets) {
                io.emit_at(&TARGETS, features.time(), self.pool.share(targets));
            }
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let Tally { spots, dim, large, beside, late, begun, dropped, bezels } = self.pointers.tally();
        let disputed: u64 = self.pointers.disputes().map(|it| it.2).sum();
        for (name, count) in [
            ("begun", begun),
            ("candidates_dropped", dropped),
            ("spots", spots),
            ("spots_dim", dim),
            ("spots_large", large),
            ("spots_beside", beside),
            ("bezels", bezels),
            ("frames_late", late),
            ("disputed", disputed),
        ] {
            report.figure(format!("pointers.{name}"), count as f64);
        }
        for (saw, not, count) in self.pointers.disputes() {
            let name = |it: CameraId| self.names.get(usize::from(it.0)).map_or("?", String::as_str);
            report.remark(format!(
                "cameras `{}` and `{}` disagree: the first one saw {count} spots at places where the second one saw none; reflections, or a camera that was moved",
                name(saw),
                name(not)
            ));
        }
        Ok(())
    }
}
