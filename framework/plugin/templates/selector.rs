//! `my_plugin.selector`: says where the next scale should look: at the highest target.

use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

ports! {
    TARGETS: In<Targets> = each("targets");
    CHOSEN: Out<Targets> = "chosen";
    REGION: Out<SubRegion> = "region";
}

/// Settings of [`MyNode`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct MyNodeSettings {
    /// How far around the target the next scale looks [m].
    #[schemars(range(min = 0.001, max = 100.0))]
    pub radius: f64,
}

impl Default for MyNodeSettings {
    fn default() -> Self {
        Self { radius: 0.25 }
    }
}

/// Targets in; out the highest one alone, and the ball around it. No target: an empty list, and no ball.
pub struct MyNode {
    radius: f64,
}

impl Node for MyNode {
    const TYPE: &'static str = "my_plugin.selector";
    const ROLE: Role = Role::Selector;
    const SUMMARY: &'static str = "Looks at the highest target";
    type Settings = MyNodeSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: MyNodeSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self { radius: settings.radius })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(targets) = io.take(&TARGETS) else { return Ok(()) };
        let highest = targets.value.list.iter().max_by(|a, b| a.position.z.total_cmp(&b.position.z));
        let time = targets.value.time;
        io.emit(&CHOSEN, targets.stamp, Targets { time, list: highest.cloned().into_iter().collect() });
        if let Some(target) = highest {
            let region = SubRegion {
                time,
                target: target.id,
                centre: target.position,
                velocity: target.velocity,
                covariance: target.covariance,
                radius: self.radius,
                provenance: target.provenance,
            };
            io.emit(&REGION, targets.stamp, region);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use foveate_testkit::check_node;
    use nalgebra::{Matrix6, Point3, Vector3};

    use super::*;

    fn target(id: u32, height: f64) -> Target {
        Target {
            id: TargetId(id),
            position: Point3::new(0.0, 0.0, height),
            velocity: Vector3::zeros(),
            covariance: Matrix6::identity(),
            cameras: CameraSet::default(),
            provenance: Provenance::Measured,
        }
    }

    #[test]
    fn the_highest_target_is_chosen_and_none_of_none() {
        let mut bench = NodeBench::<MyNode>::new(MyNodeSettings::default()).unwrap();
        let list = vec![target(1, 0.3), target(2, 1.8), target(3, 1.1)];
        bench.feed(&TARGETS, Time::from_s(0.1), Targets { time: Time::from_s(0.1), list }).unwrap();
        bench.feed(&TARGETS, Time::from_s(0.2), Targets::default()).unwrap();
        let regions = bench.outputs(&REGION);
        assert_eq!(regions.len(), 1);
        assert_eq!((regions[0].value.target, regions[0].value.radius), (TargetId(2), 0.25));
        let chosen = bench.outputs(&CHOSEN);
        assert_eq!(chosen.iter().map(|it| it.value.list.len()).collect::<Vec<_>>(), [1, 0]);
    }

    #[test]
    fn the_node_keeps_what_every_node_promises() {
        check_node::<MyNode>("radius = 0.5");
    }
}
