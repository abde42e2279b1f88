//! `pan_tilt.selector`: keeps a head on a target.

use foveate::geometry::pan_tilt::Setting;
use foveate::messages::ScaleId;
use foveate::node::scale::Spaces;
use foveate::prelude::*;

use crate::control::{ControlSettings, HeadController, Lead};
use crate::patrol::Patrol;
use crate::target_anchor::TargetAnchor;

ports! {
    TARGET: In<Targets> = each("target").of_parent();
    HEAD: In<HeadReport> = latest("head").optional();
    ASSIGNMENT: In<Assignment> = latest("assignment").optional();
    SPACES: In<ScaleSpace> = latest("spaces").many().optional();
    COMMANDS: Out<HeadCommand> = "commands";
    REGION: Out<SubRegion> = "region";
}

figures! {
        "heads.*.commands": count, neither, "Commands given to that head for a target";
        "heads.*.patrolled": count, neither, "Commands given to that head for its patrol while it had no target";
        "heads.*.out_of_reach": count, low, "Commands for a target beyond the head's limits, where it stops";
        "heads.*.target_changes": count, low, "Changes from one target to another, without the first target";
    "heads.*.latency_ms": ms, neither, "Latency from a command on the line to the first movement, as estimated at the end";
        "heads.*.latency_sigma_ms": ms, low, "Standard deviation of that latency";
}

/// Selects the target and controls its head, see [`HeadController`]. Where the target is of a moving scale, `spaces` takes the anchors of
/// that scale and of those around it: heads are in the world.
pub struct Selector {
    controller: HeadController,
    camera: CameraId,
    name: String,
    radius: f64,
    fixed: Option<TargetId>,
    anchor: TargetAnchor,
    /// Pose of the target's scale, if that moves.
    spaces: Option<(Spaces, ScaleId)>,
    following: Option<TargetId>,
    next_event: u64,
    counts: Counts,
    patrol: Patrol,
    /// Time of the last target, and the time after which a target is lost.
    seen: Option<Time>,
    lost: Interval,
}

#[derive(Default)]
struct Counts {
    commands: u64,
    /// Commands to places of the patrol.
    patrolled: u64,
    out_of_reach: u64,
    changes: u64,
}

impl Node for Selector {
    const TYPE: &'static str = "pan_tilt.selector";
    const ROLE: Role = Role::Selector;
    const SUMMARY: &'static str = "Keeps a pan-tilt head on a target: predicts it and compensates the head's latency";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = ControlSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: ControlSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        let (camera, head) = crate::head_of(setup)?;
        let radius = if settings.radius_m > 0.0 { settings.radius_m } else { setup.radius_m.unwrap_or(0.0) };
        if settings.fill > 0.0 && head.model.zoom.is_none() {
            let name = setup.camera_name().unwrap_or_default();
            let message = format!(
                "found {}, but the calibration has no `[[head.{name}.zoom]]`, expected 0 for a head that does not zoom",
                settings.fill
            );
            return Err(ConfigError::at("fill", message));
        }
        if settings.fill > 0.0 && radius <= 0.0 {
            let message = format!(
                "found {} without a radius, expected `radius_m` here or at the scale: the zoom depends on it",
                settings.fill
            );
            return Err(ConfigError::at("fill", message));
        }
        let limits = head.model.limits;
        let is_beyond = |it: &&[f64; 2]| !limits.contain(&Setting::new(it[0].to_radians(), it[1].to_radians()));
        if let Some([pan, tilt]) = settings.patrol_deg.iter().find(is_beyond) {
            let degrees = |it: [f64; 2]| it.map(f64::to_degrees);
            let message = format!(
                "found pan {pan}, tilt {tilt}, expected the range of the head of {}: pan {:.0?}, tilt {:.0?}",
                setup.camera_name().unwrap_or_default(),
                degrees(limits.pan),
                degrees(limits.tilt)
            );
            return Err(ConfigError::at("patrol_deg", message));
        }
        Ok(Self {
            patrol: Patrol::new(&settings),
            seen: None,
            lost: Interval::from_ms(settings.lost_ms),
            camera,
            name: setup.camera_name().unwrap_or_default().to_owned(),
            radius,
            fixed: settings.target.map(TargetId),
            anchor: TargetAnchor::new(setup),
            spaces: parent_space(setup)?,
            following: None,
            next_event: 0,
            controller: HeadController::new(settings, head.model, radius),
            counts: Counts::default(),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(targets) = io.take(&TARGET) else { return Ok(()) };
        if let Some(report) = io.latest(&HEAD) {
            self.controller.take_report(report.value, &mut self.next_event);
        }
        let assigned = io.latest(&ASSIGNMENT).map(|it| it.value.target_of(self.camera));
        let anchored = self.anchor.target(&targets.value).map(|it| it.id);
        let chosen = match (assigned, self.fixed) {
            (Some(assigned), _) => assigned,
            (None, Some(fixed)) => Some(fixed),
            (None, None) => anchored,
        };
        let Some(target) = targets.value.list.iter().find(|it| Some(it.id) == chosen) else {
            self.go_on_patrol(io, targets.value.time);
            return Ok(());
        };
        self.patrol.leave();
        self.seen = Some(io.now());
        let in_world;
        let target = match self.in_world(io, &targets.value, target) {
            None => target,
            Some(Some(moved)) => {
                in_world = moved;
                &in_world
            }
            Some(None) => return Ok(()),
        };
        if self.following != Some(target.id) {
            if self.following.replace(target.id).is_some() {
                self.counts.changes += 1;
            }
            self.controller.change_target();
        }
        // A sample that was only extrapolated says nothing that the predictor does not know.
        if target.provenance == Provenance::Measured {
            self.controller.see(targets.value.time, target, &self.anchor.offset);
        }
        let Some(Lead { order, zoom, reachable, .. }) = self.controller.command(io.now()) else { return Ok(()) };
        self.counts.commands += 1;
        self.counts.out_of_reach += u64::from(!reachable);
        let region = SubRegion {
            time: targets.value.time,
            target: target.id,
            centre: target.position + self.anchor.offset,
            velocity: target.velocity,
            covariance: target.covariance,
            radius: self.radius,
            provenance: target.provenance,
        };
        io.emit_at(&COMMANDS, targets.value.time, HeadCommand { camera: self.camera, order, zoom });
        io.emit_at(&REGION, targets.value.time, region);
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let Counts { commands, patrolled, out_of_reach, changes } = self.counts;
        let [latency, sigma] = self.controller.latency_s();
        let name = &self.name;
        report.figure(format!("heads.{name}.commands"), commands as f64);
        report.figure(format!("heads.{name}.out_of_reach"), out_of_reach as f64);
        report.figure(format!("heads.{name}.target_changes"), changes as f64);
        report.figure(format!("heads.{name}.latency_ms"), latency * 1e3);
        report.figure(format!("heads.{name}.latency_sigma_ms"), sigma * 1e3);
        if out_of_reach > 0 {
            let share = 100.0 * out_of_reach as f64 / commands as f64;
            report.remark(format!("The target was out of reach of the head of `{name}` for {share:.1} % of its commands: it went to its limits."));
        }
        if patrolled > 0 {
            report.figure(format!("heads.{name}.patrolled"), patrolled as f64);
        }
        if commands == 0 {
            let what = if patrolled > 0 { "only patrolled" } else { "got no command" };
            report.remark(format!("The head of `{name}` {what}: no target was found for it."));
        }
        Ok(())
    }
}

impl Selector {
    /// Patrols while there is no target, some time after the last one.
    fn go_on_patrol(&mut self, io: &mut Io<'_>, time: Time) {
        let now = io.now();
        if self.seen.is_some_and(|it| now - it <= self.lost) {
            return;
        }
        let angles = io.latest(&HEAD).and_then(|report| {
            report.value.events.iter().rev().find_map(|(_, event)| match event {
                HeadEvent::Position(position) => Some(position.angles),
                _ => None,
            })
        });
        if let Some(order) = self.patrol.step(now, angles) {
            self.counts.patrolled += 1;
            io.emit_at(&COMMANDS, time, HeadCommand { camera: self.camera, order, zoom: None });
        }
    }

    /// The target in the world; `None` where it is there already, `Some(None)` while its scale's pose is unknown.
    fn in_world(&mut self, io: &Io<'_>, targets: &Targets, target: &Target) -> Option<Option<Target>> {
        let (spaces, parent) = self.spaces.as_mut()?;
        io.latest_of_each(&SPACES).for_each(|it| spaces.learn(it.value));
        Some(spaces.target_in(spaces.root(), *parent, targets.time, target).ok())
    }
}

/// The spaces around the scale that the target lies in, where that moves.
fn parent_space(setup: &Setup) -> Result<Option<(Spaces, ScaleId)>, ConfigError> {
    let tree = &setup.scales;
    let Some(parent) = tree.place(tree.own).and_then(|it| it.parent) else { return Ok(None) };
    let moves = tree.around(parent).any(|it| tree.place(it).is_some_and(|it| it.is_anchored));
    if moves && !setup.is_connected(&SPACES) {
        let name = tree.place(parent).map_or("", |it| it.name.as_str());
        return Err(ConfigError::node(format_args!(
            "found no input `spaces`, expected `spaces = \"{name}.anchor.space\"`: the scale `{name}` moves, and heads are in the world"
        )));
    }
    Ok(moves.then(|| (Spaces::new(tree), parent)))
}

#[cfg(test)]
mod tests {
    use foveate_testkit::check_node;

    use super::*;

    #[test]
    fn node_keeps_the_law() {
        check_node::<Selector>("");
        check_node::<Selector>(
            "target = 3\npredictor = \"velocity\"\nlatency = \"fixed\"\ncontrol = \"step\"\nrate_hz = 15",
        );
    }
}
