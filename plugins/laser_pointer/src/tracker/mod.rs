//! `laser_pointer.tracker`: pointers on a wall, from the spots that cameras find [Davis 2002 §6.1].

mod codes;
mod colours;
mod health;
mod mirrors;
mod pointers;
mod settings;
#[cfg(test)]
mod tests;
mod users;

use std::collections::{BTreeMap, BTreeSet};

use foveate::prelude::*;
use foveate::scene::WallMap;

pub use pointers::{Pointers, Tally};
pub use settings::{TrackerSettings, UserCode};

use crate::wall::Wall;

ports! {
    FEATURES: In<Features> = each("features").many();
    TARGETS: Out<Targets> = "targets";
    USERS: Out<Users> = "users";
}

figures! {
        "pointers.begun": count, neither, "Pointers that appeared";
        "pointers.candidates_dropped": count, neither, "Spots that no second camera confirmed, or that disappeared too early";
        "pointers.spots": count, neither, "Spots received from the detectors";
        "pointers.spots_dim": count, neither, "Spots left out: no brighter than the wall itself can be";
        "pointers.spots_large": count, neither, "Spots left out: too large";
        "pointers.spots_beside": count, neither, "Spots left out: outside of the wall";
        "pointers.bezels": count, neither, "Mirror lines of bezels that were learnt, over all cameras";
    "pointers.frames_late": count, low, "Frames that came after a later one of another camera, and were left out";
        "pointers.disputed": count, low, "Spots that one camera reported for long and another, which sees the place, did not";
    "pointers.users_decided": count, high, "Pointers assigned to a user; this figure and those below are missing where users have neither codes nor colours";
    "pointers.switches_mended": count, neither, "ID switches between two pointers that codes or colours revealed and corrected";
    "pointers.hands_changed": count, low, "Pointers that became another user's by code or colour, and got a new identity";
    "pointers.users_corrected": count, low, "Continuously seen pointers whose user was corrected: they kept their identity";
        "pointers.codes_unknown": count, low, "Pointers that blinked in a period of no user";
        "pointers.codes_shared": count, low, "Pointers with the code or colour of a user who had another pointer at that time: they got no user";
}

/// Wall and working volume may differ by this part of the wall's sides [–].
const OTHER_SIZE: f64 = 0.03;

/// Spots of each camera in, at its own times; after each frame all pointers leave at the frame's time: in metres on the wall, x to the right and y down from its top left
/// corner, z = 0. An identity lasts from press to release. Pointers that this frame's camera did not see are predicted. Where users have codes or colours, the pointers' users
/// (`users`) are sent before them.
pub struct Tracker {
    pointers: Pointers,
    names: Vec<String>,
    /// Cameras of the rig that are missing in the map.
    unmapped: BTreeSet<String>,
    /// Spots of those cameras.
    seen_unmapped: BTreeMap<String, u64>,
    remarks: Vec<String>,
    pool: Pool<Targets>,
}

impl Node for Tracker {
    const TYPE: &'static str = "laser_pointer.tracker";
    const ROLE: Role = Role::Integrator;
    const SUMMARY: &'static str = "Tracks laser pointers on a wall from the spots that several cameras find";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = TrackerSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: TrackerSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        if settings.map.is_empty() {
            let message = "found no file name, expected the file that `laser_pointer.calibrator` wrote";
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
        let mut remarks = Vec::new();
        let of_volume = Wall::of(setup).ok().map(|it| [it.size.x, it.size.y]);
        if let Some(volume) =
            of_volume.filter(|it| (0..2).any(|axis| (it[axis] / map.size_m[axis] - 1.0).abs() > OTHER_SIZE))
        {
            remarks.push(format!(
                "{}: the wall is {:.3} m by {:.3} m, but {:.3} m by {:.3} m in `volume_m` of the scale: relative positions (TUIO) are stretched, expected the same size",
                path.display(),
                map.size_m[0],
                map.size_m[1],
                volume[0],
                volume[1]
            ));
        }
        let unmapped = names.iter().filter(|it| !map.cameras.contains_key(*it)).cloned().collect();
        let pointers = Pointers::new(settings, &map, &names);
        Ok(Self { pointers, names, unmapped, seen_unmapped: BTreeMap::new(), remarks, pool: Pool::default() })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(features) = io.take(&FEATURES) {
            let name = self.names.get(usize::from(features.value.camera.0));
            if let Some(name) = name.filter(|it| self.unmapped.contains(*it)) {
                *self.seen_unmapped.entry(name.clone()).or_insert(0_u64) += features.value.list.len() as u64;
            }
            let mut targets = self.pool.take(Targets::default);
            if self.pointers.take_in(features.time(), &features.value, &mut targets) {
                if let Some(users) = self.pointers.users(features.time()) {
                    io.emit_at(&USERS, features.time(), users);
                }
                io.emit_at(&TARGETS, features.time(), self.pool.share(targets));
            }
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let Tally { spots, dim, large, beside, late, begun, dropped, bezels } = self.pointers.tally();
        for (name, spots) in &self.seen_unmapped {
            report.remark(format!(
                "camera `{name}` is not in the map: its {spots} spots are left out; expected a map of each camera"
            ));
        }
        self.remarks.iter().for_each(|it| report.remark(it.clone()));
        self.pointers.remarks(&self.names).into_iter().for_each(|it| report.remark(it));
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
        if let Some(found) = self.pointers.users_tally() {
            report.figure("pointers.users_decided", found.decided as f64);
            report.figure("pointers.switches_mended", found.mended as f64);
            report.figure("pointers.hands_changed", found.changed as f64);
            report.figure("pointers.users_corrected", found.corrected as f64);
            report.figure("pointers.codes_unknown", found.unknown.values().sum::<u64>() as f64);
            report.figure("pointers.codes_shared", found.shared.values().sum::<u64>() as f64);
            for (period_ms, count) in &found.unknown {
                report.remark(format!(
                    "{count} pointers went dark about every {period_ms} ms, which is no user's code: expected the `period_ms` of one of `users`"
                ));
            }
            for (user, count) in &found.shared {
                report.remark(format!(
                    "{count} pointers had the code or the colour of user {user} while another one had it: expected one pointer per code"
                ));
            }
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
