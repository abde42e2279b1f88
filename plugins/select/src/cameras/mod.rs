//! `select.cameras`: chooses, out of many fixed cameras, those worth processing.

mod choose;
mod settings;
#[cfg(test)]
mod tests;

pub use choose::{Chooser, Tally};
pub use settings::CamerasSettings;

use foveate::prelude::*;

ports! {
    TARGETS: In<Targets> = each("targets");
    CHOICE: Out<CameraChoice> = "choice";
}

figures! {
    "select.choices": count, neither, "Choices made";
        "select.changes": count, low, "Cameras that were added to a choice; choices without targets are not counted";
    "select.cameras.mean": count, low, "Cameras chosen, mean over all choices";
        "select.targets_seen_by_fewer_than_two": share, low, "Share of the targets of all choices that fewer than two cameras can see";
}

/// Targets in, the cameras that see them best together out: in view and not at the rim, large, from different directions, not occluded; a few for each
/// target, and as few as possible in all. `select.gate` lets their pictures through.
///
/// Without targets all cameras are chosen. A choice changes only for a gain.
pub struct CamerasNode {
    chooser: Chooser,
}

impl Node for CamerasNode {
    const TYPE: &'static str = "select.cameras";
    const ROLE: Role = Role::Selector;
    const SUMMARY: &'static str = "Chooses the fixed cameras that together see the targets best";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = CamerasSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: CamerasSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        let model = |id: CameraId| (id, setup.calibration.cameras[usize::from(id.0)].camera.clone());
        let cameras: Vec<_> = setup.cameras_named(&settings.cameras).map(model).collect();
        if cameras.len() < 2 {
            let (found, pattern) = (cameras.len(), &settings.cameras);
            let text = format_args!("`{pattern}` matches {found} cameras of the calibration, expected 2 or more");
            return Err(ConfigError::at("cameras", text));
        }
        Ok(Self { chooser: Chooser::new(settings, cameras) })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(targets) = io.take(&TARGETS)
            && let Some(choice) = self.chooser.update(&targets.value)
        {
            io.emit_at(&CHOICE, targets.time(), choice);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let Tally { choices, cameras, changes, targets, unseen } = self.chooser.tally();
        report.figure("select.choices", choices as f64);
        report.figure("select.changes", changes as f64);
        if choices > 0 {
            report.figure("select.cameras.mean", cameras as f64 / choices as f64);
        }
        if targets > 0 && unseen > 0 {
            report.figure("select.targets_seen_by_fewer_than_two", unseen as f64 / targets as f64);
        }
        Ok(())
    }

    fn plan(settings: &CamerasSettings) -> Plan {
        Plan { rate_hz: Some(settings.rate_hz), ..Plan::default() }
    }
}
