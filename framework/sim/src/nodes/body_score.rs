//! How well bodies are found in voxels: against the joints of the simulated people.

use foveate_messages::Skeletons;
use foveate_node::{ConfigError, Figures, Io, Node, NodeError, Ports, Report, Role, Setup, figures, ports};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::score::body::{BodyRules, BodyScorer};
use crate::world::World;

ports! {
    WORLD: In<World> = latest("world");
    SKELETONS: In<Skeletons> = each("skeletons");
}

figures! {
    "joint_mm.{median,p95}": mm, low, "Distance of head, neck, shoulders, elbows, hips and knees of a skeleton from those of its person, over all that skeletons state, predicted and filled ones too; people without a skeleton are left out" => "joints off the truth";
    "end_mm.{median,p95}": mm, low, "The same of wrists and ankles, which lie within the model's last parts";
    "joint.*.mm.median": mm, low, "The same of one joint";
    "head_right": share, high, "People wholly in the volume whose skeleton's head is within head_right_mm, over all of them and all messages" => "heads found where they are";
    "head_wrong": share, low, "The same with a skeleton whose head is farther off";
    "parts_found_s": s, low, "From the first message with a person wholly in the volume until their skeleton has all ten parts, median over people; missing if half of them never have";
    "joints_missing": share, low, "Joints of people wholly in the volume that no skeleton states, over all of them and all messages";
    "joints_lost": count, low, "Times that a joint was off by more than lost_mm for lost_ms or longer";
    "joints_lost_fast": count, low, "The same while a wrist of the person was faster than fast_m_s";
    "sides_swapped": share, low, "Skeletons whose left side is nearer to the person's right one, over all with a person";
    "bodies_false": count, low, "Skeletons without a person within half a metre, over all messages";
    "wrist_speed.max": "m/s", neither, "Speed of the fastest true wrist between two messages";
    "joint_normalised": ratio, neither, "Mean squared error of joints over their stated covariance, per degree of freedom: 1 is consistent";
}

/// Settings of [`BodyScore`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct BodyScoreSettings {
    /// A head within this distance of the true one is right [mm]
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub head_right_mm: f64,
    /// A joint farther from the true one is lost [mm]
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub lost_mm: f64,
    /// once it has been that far off for this long [ms]
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub lost_ms: f64,
    /// Wrists above this are fast [m/s]
    #[schemars(range(min = 0.1, max = 20.0))]
    pub fast_m_s: f64,
    /// Session time at which scoring begins [s]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub start_s: f64,
}

impl Default for BodyScoreSettings {
    fn default() -> Self {
        Self { head_right_mm: 50.0, lost_mm: 150.0, lost_ms: 500.0, fast_m_s: 3.0, start_s: 0.0 }
    }
}

/// Compares skeletons with the people of the world.
pub struct BodyScore {
    scorer: BodyScorer,
    volume: Option<[[f64; 3]; 2]>,
    world: Option<World>,
}

impl Node for BodyScore {
    const TYPE: &'static str = "sim.body_score";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Compares skeletons with the joints of the simulated people";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = BodyScoreSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: BodyScoreSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("head_right_mm", settings.head_right_mm, 1.0..=1000.0)?;
        ConfigError::unless_in("lost_mm", settings.lost_mm, 1.0..=1000.0)?;
        let rules = BodyRules {
            head_right: settings.head_right_mm * 1e-3,
            lost: settings.lost_mm * 1e-3,
            lost_s: settings.lost_ms * 1e-3,
            fast: settings.fast_m_s,
            start_s: settings.start_s,
        };
        Ok(Self { scorer: BodyScorer::new(rules), volume: setup.volume_m, world: None })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(world) = io.latest(&WORLD) {
            self.world = Some(world.value.clone());
        }
        while let Some(found) = io.take(&SKELETONS) {
            let Some(world) = &self.world else { continue };
            let people = world.joints(found.value.time);
            let volume = self.volume;
            let is_there = |place: &nalgebra::Point3<f64>| {
                volume.is_none_or(|[min, max]| (0..3).all(|axis| (min[axis]..=max[axis]).contains(&place[axis])))
            };
            self.scorer.add(&found.value, &people, is_there);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        self.scorer.finish(report);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use foveate_testkit::check_node;

    use super::*;

    #[test]
    fn node_keeps_the_law() {
        check_node::<BodyScore>("");
        check_node::<BodyScore>("head_right_mm = 40\nlost_ms = 200\nstart_s = 1");
    }

    #[test]
    fn settings_out_of_range_are_refused() {
        let wrong = BodyScoreSettings { head_right_mm: f64::NAN, ..BodyScoreSettings::default() };
        let refused = BodyScore::new(wrong, &Setup::for_tests()).err().and_then(|it| it.setting);
        assert_eq!(refused.as_deref(), Some("head_right_mm"));
    }
}
