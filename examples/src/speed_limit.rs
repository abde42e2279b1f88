//! `example.speed_limit`: drops targets that are faster than anything in the room can be.

use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

ports! {
    TARGETS: In<Targets> = each("targets");
    CREDIBLE: Out<Targets> = "targets";
}

figures! {
    "speed_limit.dropped": count, neither, "Targets that were faster than max_speed, over all messages";
}

/// Settings of [`SpeedLimit`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SpeedLimitSettings {
    /// Faster targets are dropped. A sprinter's hand reaches 15 m/s [m/s].
    #[schemars(range(min = 0.01, max = 1000.0))]
    pub max_speed: f64,
}

impl Default for SpeedLimitSettings {
    fn default() -> Self {
        Self { max_speed: 15.0 }
    }
}

/// Targets in, the credible ones out under the same stamp. None left: an empty list.
pub struct SpeedLimit {
    max_speed: f64,
    dropped: u64,
}

impl Node for SpeedLimit {
    const TYPE: &'static str = "example.speed_limit";
    const ROLE: Role = Role::ModelFilter;
    const SUMMARY: &'static str = "Drops targets that are faster than anything in the room can be";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = SpeedLimitSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: SpeedLimitSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self { max_speed: settings.max_speed, dropped: 0 })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(targets) = io.take(&TARGETS) else { return Ok(()) };
        let mut credible = Targets::clone(&targets.value);
        credible.list.retain(|target| target.velocity.norm() <= self.max_speed);
        self.dropped += (targets.value.list.len() - credible.list.len()) as u64;
        io.emit(&CREDIBLE, targets.stamp, credible);
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.figure("speed_limit.dropped", self.dropped as f64);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use foveate_testkit::check_node;
    use nalgebra::{Matrix6, Point3, Vector3};

    use super::*;

    fn target(speed: f64) -> Target {
        Target {
            id: TargetId(1),
            position: Point3::origin(),
            velocity: Vector3::x() * speed,
            covariance: Matrix6::identity(),
            cameras: CameraSet::default(),
            provenance: Provenance::Measured,
        }
    }

    #[test]
    fn only_what_is_too_fast_is_dropped() {
        let mut bench = NodeBench::<SpeedLimit>::new(SpeedLimitSettings { max_speed: 8.0 }).unwrap();
        let given = Targets { time: Time::from_s(0.1), list: vec![target(7.9), target(8.1)] };
        bench.feed(&TARGETS, Time::from_s(0.1), given).unwrap();
        assert_eq!(bench.outputs(&CREDIBLE)[0].value.list, [target(7.9)]);
        assert_eq!(bench.finish().unwrap().figures["speed_limit.dropped"], 1.0);
    }

    #[test]
    fn the_node_keeps_what_every_node_promises() {
        check_node::<SpeedLimit>("max_speed = 3.0");
    }
}
