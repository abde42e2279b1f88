//! `pan_tilt.allocator`: allocates heads to several targets [Davis 2002 §6.3].

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
        "allocator.assignments": count, neither, "Assignments of heads to targets that were sent";
        "allocator.switches": count, low, "Heads that were assigned another target than their last one";
        "allocator.forced_switches": count, low, "Switches that left a target with fewer than two heads";
        "allocator.seen_by_two": share, high, "Share of the targets of all assignments at which two or more heads had arrived";
}

/// Targets in, assignments of heads to targets out. Two or more heads from different directions for each target, as long as there are
/// enough; the assignment changes only for a lasting gain, and one head at a time.
///
/// Without `reports` a head is assumed to be where it was sent.
pub struct AllocatorNode {
    allocator: Allocator,
}

impl Node for AllocatorNode {
    const TYPE: &'static str = "pan_tilt.allocator";
    const ROLE: Role = Role::Selector;
    const SUMMARY: &'static str = "Assigns to each of several targets the pan-tilt heads that see it best together";
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
            let text =
                format_args!("`{pattern}` matches {found} cameras of the calibration, expected 2 to {MAX_HEADS}");
            return Err(ConfigError::at("cameras", text));
        }
        Ok(Self { allocator: Allocator::new(settings, heads) })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(targets) = io.take(&TARGETS) else { return Ok(()) };
        io.latest_of_each(&REPORTS).for_each(|it| self.allocator.take_report(it.value));
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
