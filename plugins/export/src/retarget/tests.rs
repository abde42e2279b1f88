//! A body on a BVH rig and on a GLB rig, read back.

use foveate::prelude::*;
use foveate::scene::skeleton::SkeletonMotion;
use foveate_testkit::check_node;
use nalgebra::{Isometry3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3};
use serde_json::{Value, json};

use super::glb::Rigged;
use super::{ExportRetarget, ExportRetargetSettings};

const SKELETONS: In<Skeletons> = In::each(0, "skeletons");

/// A right arm by itself: it hangs, and its elbow is bent forward by `bend`.
fn arm(bend: f64) -> Skeleton {
    let shoulder = Point3::new(0.1, -0.2, 1.4);
    let fore = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -bend);
    let elbow = shoulder - Vector3::z() * 0.3;
    let wrist = elbow - fore * Vector3::z() * 0.25;
    let joint = |(joint, position): (u8, Point3<f64>)| SkeletonJoint {
        joint,
        position,
        velocity: Vector3::zeros(),
        covariance: Matrix6::identity() * 1e-5,
        provenance: Provenance::Measured,
    };
    let part = |part: u8, from: Point3<f64>, to: Point3<f64>, turn| SkeletonPart {
        part,
        scale_from_part: Isometry3::from_parts(Translation3::from(nalgebra::center(&from, &to).coords), turn),
        sizes: Vector3::new(0.04, 0.04, 0.5 * (to - from).norm()),
        size_sigmas: Vector3::repeat(0.01),
        provenance: Provenance::Measured,
    };
    Skeleton {
        id: 0,
        joints: [3, 5, 7].into_iter().zip([shoulder, elbow, wrist]).map(joint).collect(),
        parts: vec![part(3, shoulder, elbow, UnitQuaternion::identity()), part(7, elbow, wrist, fore)],
        limbs: [LimbDetail::Absent, LimbDetail::Bent, LimbDetail::Absent, LimbDetail::Absent],
        facing: 1.0,
        unexplained: 0.0,
        cameras: CameraSet::default(),
    }
}

const PUPPET: &str = "HIERARCHY\nROOT pelvis\n{\nOFFSET 0 50 0\nCHANNELS 6 Xposition Yposition Zposition Yrotation Xrotation Zrotation\nJOINT arm_r\n{\nOFFSET -10 30 0\nCHANNELS 3 Yrotation \
Xrotation Zrotation\nJOINT fore_r\n{\nOFFSET -25 0 0\nCHANNELS 3 Yrotation Xrotation Zrotation\nEnd Site\n{\nOFFSET -20 0 0\n}\n}\n}\nJOINT leg_r\n{\nOFFSET -5 0 0\nCHANNELS 3 Yrotation Xrotation \
Zrotation\nEnd Site\n{\nOFFSET 0 -50 0\n}\n}\n}\nMOTION\nFrames: 0\nFrame Time: 0.04\n";

/// The same puppet as a skin of three joints.
fn puppet_glb() -> Vec<u8> {
    let document = json!({
        "asset": { "version": "2.0" },
        "nodes": [
            { "name": "pelvis", "translation": [0.0, 0.5, 0.0], "children": [1, 3] },
            { "name": "arm_r", "translation": [-0.1, 0.3, 0.0], "rotation": [0.0, 0.0, 0.0, 1.0], "children": [2] },
            { "name": "fore_r", "translation": [-0.25, 0.0, 0.0], "children": [4] },
            { "name": "foot", "translation": [0.0, -0.5, 0.0] },
            { "name": "hand_r", "translation": [-0.2, 0.0, 0.0] },
        ],
        "skins": [{ "joints": [0, 1, 2, 3, 4] }],
    });
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut file = b"glTF".to_vec();
    file.extend(2_u32.to_le_bytes());
    file.extend((20 + text.len() as u32).to_le_bytes());
    file.extend((text.len() as u32).to_le_bytes());
    file.extend_from_slice(b"JSON");
    file.extend(text);
    file
}

/// What the node writes for a rig: figures, remarks and the file.
fn written(file: &str, rig: &[u8], map: &[(&str, &str)]) -> (Report, Vec<u8>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(file);
    std::fs::write(&path, rig).unwrap();
    let setup = Setup { out_dir: Some(folder.path().to_owned()), ..Setup::for_tests() };
    let settings = ExportRetargetSettings {
        rig: path.display().to_string(),
        map: map.iter().map(|it| (it.0.to_owned(), it.1.to_owned())).collect(),
        ..ExportRetargetSettings::default()
    };
    let mut bench = NodeBench::<ExportRetarget>::with_setup(settings, &setup).unwrap();
    for frame in 0..5 {
        let time = Time::from_s(f64::from(frame) * 0.04);
        let list = vec![arm(0.3 * f64::from(frame))];
        bench.feed(&SKELETONS, time, Skeletons { time, list, unmodelled: Vec::new() }).unwrap();
    }
    let report = bench.finish().unwrap();
    let ending = file.rsplit('.').next().unwrap();
    let picture = std::fs::read_to_string(folder.path().join("retargeted.svg")).unwrap();
    assert!(picture.starts_with("<svg") && picture.contains("0.16 s"), "{picture}");
    let bytes = std::fs::read(folder.path().join(format!("retargeted.{ending}"))).unwrap();
    (report, bytes)
}

const MAP: [(&str, &str); 4] =
    [("pelvis", "Hips"), ("arm_r", "RightArm"), ("fore_r", "RightForeArm"), ("leg_r", "RightUpLeg")];

#[test]
fn node_keeps_the_law() {
    check_node::<ExportRetarget>("");
    check_node::<ExportRetarget>("name = \"puppet\"");
}

#[test]
fn an_arm_by_itself_drives_a_puppet_whose_arms_stretch_out() {
    let (report, bytes) = written("puppet.bvh", PUPPET.as_bytes(), &MAP);
    assert_eq!([report.figures["retarget.frames"], report.figures["retarget.joints"]], [5.0, 3.0]);
    let motion = SkeletonMotion::from_bvh(&String::from_utf8(bytes).unwrap()).unwrap();
    let rig = SkeletonMotion::from_bvh(PUPPET).unwrap();
    // The root's place stands in its channels alone.
    assert_eq!(motion.joints[1..], rig.joints[1..]);
    assert_eq!(motion.joints[0].offset, Vector3::zeros());
    for frame in 0..5 {
        let poses = motion.poses(frame, 1.0).unwrap();
        let at = |name: &str| poses[motion.joint(name).unwrap()];
        let upper = at("fore_r").translation.vector - at("arm_r").translation.vector;
        let fore = at("fore_r") * Point3::new(-20.0, 0.0, 0.0) - Point3::from(at("fore_r").translation.vector);
        // It hangs, and bends to the front, which is z of the file.
        let bend = 0.3 * frame as f64;
        assert!(upper.angle(&-Vector3::y()) < 1e-4, "frame {frame}: {upper}");
        assert!((fore.angle(&upper) - bend).abs() < 1e-4 && fore.z >= -1e-6, "frame {frame}: {fore}");
        assert!((at("leg_r") * Point3::new(0.0, -50.0, 0.0)).y.abs() < 1e-6);
    }
}

#[test]
fn unlikely_pairs_of_a_map_are_reported() {
    let of = |rig: &str, map: &[(&str, &str)]| {
        let remarks = written("puppet.bvh", rig.as_bytes(), map).0.remarks;
        remarks.iter().filter(|it| it.contains("The map may be wrong")).cloned().collect::<Vec<_>>().join("\n")
    };
    let remark = |map: &[(&str, &str)]| of(PUPPET, map);
    assert_eq!(remark(&MAP), "");
    let side = of(&PUPPET.replace("arm_r", "arm_l"), &[("pelvis", "Hips"), ("arm_l", "RightArm")]);
    assert!(side.contains("`arm_l` follows RightArm: left and right"), "{side}");
    let order = remark(&[("pelvis", "Hips"), ("arm_r", "RightForeArm"), ("fore_r", "RightArm")]);
    assert!(order.contains("`fore_r` hangs below `arm_r`") && order.contains("RightArm"), "{order}");
    let leg = remark(&[("pelvis", "Hips"), ("leg_r", "RightArm")]);
    assert!(leg.contains("`leg_r`, below the root at rest, follows RightArm, above it"), "{leg}");
}

#[test]
fn a_glb_rig_gets_the_same_motion_and_keeps_what_it_had() {
    let rig = puppet_glb();
    let map = &MAP[..3];
    let (report, bytes) = written("puppet.glb", &rig, map);
    assert_eq!(report.figures["retarget.frames"], 5.0);
    let (before, after) = (Rigged::read(rig).unwrap(), Rigged::read(bytes.clone()).unwrap());
    assert_eq!(before.joints, after.joints);
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let document: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    let channels = document["animations"][0]["channels"].as_array().unwrap();
    assert_eq!(channels.len(), 6);
    // The forearm's last turn, against its parent: 1.2 rad.
    let channel = channels.iter().find(|it| it["target"]["node"] == 2).unwrap();
    let output = &document["animations"][0]["samplers"][channel["sampler"].as_u64().unwrap() as usize]["output"];
    let accessor = &document["accessors"][output.as_u64().unwrap() as usize];
    let view = &document["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
    let first = 28 + length + view["byteOffset"].as_u64().unwrap() as usize + 4 * 16;
    let w = f32::from_le_bytes(bytes[first + 12..first + 16].try_into().unwrap());
    assert!((2.0 * w.abs().acos() - 1.2).abs() < 1e-3, "w is {w}");
}

#[test]
fn rigs_that_cannot_be_are_refused() {
    assert!(Rigged::read(b"solid cube".to_vec()).err().unwrap().contains("GLB"));
    let text = String::from_utf8_lossy(&puppet_glb())
        .replace("\"translation\":[-0.25,0.0,0.0]", "\"scale\":[2.00,2.0,2.0],\"na\":0");
    assert!(Rigged::read(text.into_bytes()).is_err());
    let settings = ExportRetargetSettings { rig: "no-such.bvh".to_owned(), ..ExportRetargetSettings::default() };
    let error = ExportRetarget::new(settings, &Setup::for_tests()).err().unwrap();
    assert_eq!(error.setting.as_deref(), Some("rig"));
}

#[test]
fn impossible_maps_are_refused_before_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.display().to_string()
    };
    let rig = file("puppet.bvh", PUPPET);
    let refused = |rig: &str, motion: &str, map: &[(&str, &str)]| {
        let settings = ExportRetargetSettings {
            rig: rig.to_owned(),
            motion: motion.to_owned(),
            map: map.iter().map(|it| (it.0.to_owned(), it.1.to_owned())).collect(),
            ..ExportRetargetSettings::default()
        };
        let error = ExportRetarget::new(settings, &Setup::for_tests()).err()?;
        Some((error.setting.clone().unwrap_or_default(), error.to_string()))
    };
    assert_eq!(refused(&rig, "", &MAP), None);
    let (setting, what) = refused(&rig, "", &[("tail", "Hips")]).unwrap();
    assert!(setting == "map.tail" && what.contains("fore_r"), "{setting}: {what}");
    let (setting, what) = refused(&rig, "", &[("arm_r", "RigthArm")]).unwrap();
    assert!(setting == "map.arm_r" && what.contains("RightForeArm"), "{setting}: {what}");
    // No name of the puppet is one of a body's.
    let (setting, what) = refused(&rig, "", &[]).unwrap();
    assert!(setting == "map" && what.contains("pelvis") && what.contains("LeftUpLeg"), "{setting}: {what}");
    // A recording has names of its own; this one has no frame.
    assert_eq!(refused(&rig, &rig, &[("arm_r", "RightArm")]).unwrap().0, "map.arm_r");
    assert_eq!(refused(&rig, &rig, &[("arm_r", "arm_r")]).unwrap().0, "motion");
    let stiff = PUPPET.replacen("CHANNELS 3 Yrotation Xrotation Zrotation", "CHANNELS 2 Yrotation Xrotation", 1);
    let (setting, what) = refused(&file("stiff.bvh", &stiff), "", &MAP).unwrap();
    assert!(setting == "rig" && what.contains("arm_r"), "{setting}: {what}");
}
