//! Files of a body that turns, read back.

use std::f64::consts::FRAC_PI_2;

use foveate::geometry::body::{Body, Joint, Part, proportions::Proportions};
use foveate::prelude::*;
use foveate::scene::skeleton::{SkeletonMotion, z_up_from_y_up};
use foveate_testkit::check_node;
use nalgebra::{Isometry3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3};

use super::{ExportBodies, ExportBodiesSettings};

const SKELETONS: In<Skeletons> = In::each(0, "skeletons");

fn body(turned: f64) -> Body {
    let heading = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turned);
    let mut turns = [heading; 10];
    turns[Part::LeftUpperArm.index()] = heading * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2);
    turns[Part::RightCalf.index()] = heading * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 0.7);
    Body { torso: Point3::new(0.3, -0.2, 1.2), turns, sizes: Proportions::default().sizes() }
}

fn skeleton(body: &Body, without_arm: bool) -> Skeleton {
    let is_left_out = |it: &Part| without_arm && matches!(it, Part::LeftUpperArm | Part::LeftLowerArm);
    let parts = Part::ALL.into_iter().filter(|it| !is_left_out(it)).map(|part| SkeletonPart {
        part: part.index() as u8,
        scale_from_part: Isometry3::from_parts(Translation3::from(body.centre(part)), *body.turn(part)),
        sizes: *body.size(part),
        size_sigmas: Vector3::zeros(),
        provenance: Provenance::Measured,
    });
    let joints = Joint::ALL.map(|joint| SkeletonJoint {
        joint: joint as u8,
        position: body.joint(joint),
        velocity: Vector3::zeros(),
        covariance: Matrix6::identity() * 1e-4,
        provenance: Provenance::Measured,
    });
    Skeleton {
        id: 4,
        joints: joints.to_vec(),
        parts: parts.collect(),
        limbs: [LimbDetail::Bent; 4],
        facing: 1.0,
        unexplained: 0.0,
        cameras: CameraSet::default(),
    }
}

#[test]
fn node_keeps_the_law() {
    check_node::<ExportBodies>("");
    check_node::<ExportBodies>("unit = \"m\"\nglb = \"\"");
}

#[test]
fn joints_of_the_files_are_where_the_body_had_them() {
    let folder = tempfile::tempdir().unwrap();
    let setup = Setup { out_dir: Some(folder.path().to_owned()), ..Setup::for_tests() };
    let settings = ExportBodiesSettings { unit: crate::bvh::Unit::M, ..ExportBodiesSettings::default() };
    let mut bench = NodeBench::<ExportBodies>::with_setup(settings, &setup).unwrap();
    for frame in 0..31 {
        let time = Time::from_s(f64::from(frame) / 30.0);
        let list = vec![skeleton(&body(f64::from(frame) * 0.02), frame == 20)];
        bench.feed(&SKELETONS, time, Skeletons { time, list, unmodelled: Vec::new() }).unwrap();
    }
    let report = bench.finish().unwrap();
    assert_eq!([report.figures["bodies.count"], report.figures["bodies.bvh_frames_held"]], [1.0, 1.0]);
    let text = std::fs::read_to_string(folder.path().join("body-4.bvh")).unwrap();
    let motion = SkeletonMotion::from_bvh(&text).unwrap();
    assert_eq!(motion.n_frames(), 31);
    for frame in [0, 10, 30] {
        let poses = motion.poses(frame, 1.0).unwrap();
        let truth = body(frame as f64 * 0.02);
        for (name, expected) in [
            ("LeftArm", truth.joint(Joint::LeftShoulder)),
            ("LeftForeArm", truth.joint(Joint::LeftElbow)),
            ("RightLeg", truth.joint(Joint::RightKnee)),
            ("Head", truth.held(Part::Head)),
        ] {
            let pose = poses[motion.joint(name).unwrap()];
            let place = z_up_from_y_up() * Point3::from(pose.translation.vector);
            let off = (place - expected).norm();
            assert!(off < 1e-4, "{name} of frame {frame} is {off} m off");
        }
    }
    let rows = std::fs::read_to_string(folder.path().join("bodies.csv")).unwrap();
    assert_eq!(rows.lines().count(), 1 + 31 * 14);
    let knee = rows.lines().find(|it| it.contains("right-knee")).unwrap();
    let x: f64 = knee.split(',').nth(3).unwrap().parse().unwrap();
    assert!((x - body(0.0).joint(Joint::RightKnee).x).abs() < 1e-6 && knee.contains(",measured,bent,"), "{knee}");
    let glb = std::fs::read(folder.path().join("bodies.glb")).unwrap();
    let length = u32::from_le_bytes([glb[12], glb[13], glb[14], glb[15]]) as usize;
    let json: serde_json::Value = serde_json::from_slice(&glb[20..20 + length]).unwrap();
    assert_eq!(json["skins"][0]["joints"].as_array().unwrap().len(), 10);
    assert_eq!(json["animations"][0]["channels"].as_array().unwrap().len(), 30);
}

#[test]
fn arms_hang_where_the_body_had_them_whatever_its_proportions() {
    let mut arms_up = skeleton(&body(0.4), false);
    let up = Vector3::new(0.0, 0.0, 0.07);
    for part in &mut arms_up.parts {
        let arms = [Part::LeftUpperArm, Part::LeftLowerArm, Part::RightUpperArm, Part::RightLowerArm];
        if arms.iter().any(|it| it.index() == usize::from(part.part)) {
            part.scale_from_part.translation.vector += up;
        }
    }
    let frames = (0..3).map(|it| (Time::from_s(0.1 * f64::from(it)), arms_up.clone())).collect();
    let (motion, n_held) = super::bvh::motion(&super::Course { id: 1, frames }, 1.0).unwrap();
    let poses = motion.poses(1, 1.0).unwrap();
    let place = |name: &str| z_up_from_y_up() * Point3::from(poses[motion.joint(name).unwrap()].translation.vector);
    let truth = body(0.4);
    for (name, joint) in [("LeftArm", Joint::LeftShoulder), ("RightForeArm", Joint::RightElbow)] {
        assert!((place(name) - truth.joint(joint) - up).norm() < 1e-4, "{name}: {}", place(name));
    }
    assert!((place("LeftUpLeg") - truth.joint(Joint::LeftHip)).norm() < 1e-4 && n_held == 0);
}
