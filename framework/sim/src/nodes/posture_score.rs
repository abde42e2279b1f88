//! How well postures are recovered: the directions of limbs and the angles of joints, against the truth.

use foveate_estimation::statistics::percentile;
use foveate_messages::{BODY_JOINTS, Skeleton, Skeletons};
use foveate_node::{ConfigError, Figures, Io, Node, NodeError, Ports, Report, Role, Setup, figures, ports};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::score::body::true_joints;
use crate::world::World;

ports! {
    WORLD: In<World> = latest("world");
    SKELETONS: In<Skeletons> = each("skeletons");
}

figures! {
    "joint_deg.{median,p95}": deg, low, "Difference of the angle at an elbow or knee from the true one, over those that skeletons have both bones of, and all messages" => "elbows and knees off the truth";
    "bone_deg.{median,p95}": deg, low, "Angle between an upper arm, forearm, thigh or shank of a skeleton and the true one, over the same";
    "joint_off_mm.{median,p95}": mm, low, "Distance of shoulders, elbows, wrists, hips, knees and ankles from the true ones, over the same";
    "postures.missing": share, low, "Messages without a skeleton, over all messages while a person, or the arm, is there";
}

/// The three joints of each limb, by their places in [`BODY_JOINTS`].
const LIMBS: [[usize; 3]; 4] = [[2, 4, 6], [3, 5, 7], [8, 10, 12], [9, 11, 13]];

/// Settings of [`PostureScore`].
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PostureScoreSettings {
    /// Session time at which scoring begins [s]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub start_s: f64,
}

/// Compares the first skeleton with the first person of the world, or with its arm.
pub struct PostureScore {
    start_s: f64,
    joints: Vec<f64>,
    bones: Vec<f64>,
    distances: Vec<f64>,
    n: u64,
    n_missing: u64,
}

impl Node for PostureScore {
    const TYPE: &'static str = "sim.posture_score";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Compares joint angles of a skeleton with those of the simulated arm or person";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = PostureScoreSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: PostureScoreSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("start_s", settings.start_s, 0.0..=1e6)?;
        let [joints, bones, distances] = [const { Vec::new() }; 3];
        Ok(Self { start_s: settings.start_s, joints, bones, distances, n: 0, n_missing: 0 })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(found) = io.take(&SKELETONS) {
            let Some(world) = io.latest(&WORLD).map(|it| it.value.clone()) else { continue };
            let time = found.value.time;
            if time.as_s() < self.start_s {
                continue;
            }
            // The arm is the right one of a skeleton.
            let arm = world.arm_joints(time).map(|it| vec![([3, 5, 7], it.places)]);
            let person = || {
                let truth = true_joints(&world.joints(time).first()?.1);
                Some(LIMBS.map(|limb| (limb, limb.map(|it| truth[it]))).to_vec())
            };
            let Some(limbs) = arm.or_else(person) else { continue };
            self.n += 1;
            match found.value.list.first() {
                Some(skeleton) => self.compare(skeleton, &limbs),
                None => self.n_missing += 1,
            }
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let at = |list: &[f64], percent: f64| percentile(list, percent).unwrap_or(f64::NAN);
        for (name, list, unit) in [
            ("joint_deg", &self.joints, 1_f64.to_degrees()),
            ("bone_deg", &self.bones, 1_f64.to_degrees()),
            ("joint_off_mm", &self.distances, 1e3),
        ] {
            report.figure(format!("{name}.median"), unit * at(list, 50.0));
            report.figure(format!("{name}.p95"), unit * at(list, 95.0));
        }
        report.figure("postures.missing", self.n_missing as f64 / self.n as f64);
        Ok(())
    }
}

impl PostureScore {
    fn compare(&mut self, skeleton: &Skeleton, limbs: &[([usize; 3], [Point3<f64>; 3])]) {
        for (numbers, truth) in limbs {
            let [Some(a), Some(b), Some(c)] =
                numbers.map(|it| skeleton.joint(BODY_JOINTS[it]).map(|joint| joint.position))
            else {
                continue;
            };
            let [upper, lower] = [b - a, c - b];
            let [true_upper, true_lower] = [truth[1] - truth[0], truth[2] - truth[1]];
            self.bones.extend([upper.angle(&true_upper), lower.angle(&true_lower)]);
            self.joints.push((upper.angle(&lower) - true_upper.angle(&true_lower)).abs());
            self.distances.extend([a, b, c].iter().zip(truth).map(|(found, truth)| (found - truth).norm()));
        }
    }
}

#[cfg(test)]
mod tests {
    use foveate_messages::{CameraSet, LimbDetail, Provenance, SkeletonJoint};
    use foveate_testkit::check_node;
    use nalgebra::{Matrix6, Vector3};

    use super::*;

    #[test]
    fn node_keeps_the_law() {
        check_node::<PostureScore>("");
        check_node::<PostureScore>("start_s = 1");
    }

    #[test]
    fn errors_are_those_that_were_put_in() {
        let truth = [Point3::origin(), Point3::new(0.3, 0.0, 0.0), Point3::new(0.3, 0.25, 0.0)];
        // The forearm is turned by 10 degrees about the elbow.
        let turn = nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), 10_f64.to_radians());
        let found = [truth[0], truth[1], truth[1] + turn * (truth[2] - truth[1])];
        let joint = |(joint, position): (u8, Point3<f64>)| SkeletonJoint {
            joint,
            position,
            velocity: Vector3::zeros(),
            covariance: Matrix6::identity(),
            provenance: Provenance::Measured,
        };
        let skeleton = Skeleton {
            id: 0,
            joints: [3, 5, 7].into_iter().zip(found).map(joint).collect(),
            parts: Vec::new(),
            limbs: [LimbDetail::Bent; 4],
            facing: 1.0,
            unexplained: 0.0,
            cameras: CameraSet::default(),
        };
        let mut score = PostureScore::new(PostureScoreSettings::default(), &Setup::for_tests()).unwrap();
        score.compare(&skeleton, &[([3, 5, 7], truth), ([2, 4, 6], truth)]);
        let mut report = Report::default();
        score.finish(&mut report).unwrap();
        let figure = |name: &str| report.figures[name];
        assert!((figure("joint_deg.median") - 10.0).abs() < 1e-9, "{}", figure("joint_deg.median"));
        assert!((figure("bone_deg.p95") - 10.0).abs() < 1.0 && figure("bone_deg.median") <= 5.1);
        assert!(figure("joint_off_mm.median") < 1e-9);
    }
}
