//! `pan_tilt.allocator`: gives several targets their heads [Davis 2002 §6.3].

mod deal;
mod settings;
#[cfg(test)]
mod tests;

pub use deal::{Allocator, Tally};
pub use settings::AllocatorSettings;

use foveate::estimation::allocation::MAX_HEADS;
use foveate::prelude::*;

ports! {
    TARGETS: In<Targets> = each("targets");
    REPORTS: In<HeadReport> = latest("reports").many().optional();
    ASSIGNMENT: Out<Assignment> = "assignment";
}

figures! {
    "allocator.assignments": count, neither, "Assignments of heads to targets that were given out";
    "allocator.switches": count, low, "Heads that were given another target than their last one";
    "allocator.forced_switches": count, low, "Of these, heads that left their target with fewer than two";
    "allocator.seen_by_two": share, high, "Targets that two heads or more had arrived at, of all targets of all assignments";
}

/// Targets in, which head follows which of them out. Two heads or more for each target that look at it from well apart, as long as there are
/// enough; which ones changes only where that gains something for a while, and one after another.
///
/// Without `reports` a head is taken to be where it was sent.
pub struct AllocatorNode {
    allocator: Allocator,
}

impl Node for AllocatorNode {
    const TYPE: &'static str = "pan_tilt.allocator";
    const ROLE: Role = Role::Selector;
    const SUMMARY: &'static str = "Gives each of several targets the pan-tilt heads that look at it best together";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = AllocatorSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: AllocatorSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        let mut heads = Vec::new();
        for camera in setup.cameras_named(&settings.cameras) {
            let Some(head) = setup.head_of(camera) else {
                let name = &setup.calibration.cameras[usize::from(camera.0)].name;
                let text = format_args!("the calibration has no head for `{name}`, expected a section [head.{name}]");
                return Err(ConfigError::at("cameras", text));
            };
            heads.push((camera, head.model));
        }
        if !(2..=MAX_HEADS).contains(&heads.len()) {
            let (found, pattern) = (heads.len(), &settings.cameras);
            let text = format_args!("`{pattern}` names {found} cameras of the calibration, expected 2 to {MAX_HEADS}");
            return Err(ConfigError::at("cameras", text));
        }
        Ok(Self { allocator: Allocator::new(settings, heads) })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(targets) = io.take(&TARGETS) else { return Ok(()) };
        io.latest_of_each(&REPORTS).for_each(|it| self.allocator.hear(it.value));
        if let Some(assignment) = self.allocator.update(&targets.value) {
            io.emit_at(&ASSIGNMENT, targets.time(), assignment);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let Tally { assignments, switches, forced, targets, seen_by_two } = self.allocator.tally();
        report.figure("allocator.assignments", assignments as f64);
        report.figure("allocator.switches", switches as f64);
        if forced > 0 {
            report.figure("allocator.forced_switches", forced as f64);
        }
        if targets > 0 {
            report.figure("allocator.seen_by_two", seen_by_two as f64 / targets as f64);
        }
        Ok(())
    }

    fn plan(settings: &AllocatorSettings) -> Plan {
        Plan { rate_hz: Some(settings.rate_hz), ..Plan::default() }
    }
}
