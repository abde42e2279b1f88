//! What is written is read again, and its joints stand where the targets were.

use std::sync::Arc;

use foveate::prelude::*;
use foveate::scene::skeleton::{SkeletonMotion, z_up_from_y_up};
use nalgebra::{Isometry3, Point3, Rotation3, Vector3};

use super::*;
use crate::target_rows::tests::target;

/// A body of fixed bones that walks a circle, leans, swings its arms and turns its shoulders, in the world, in the order of the default numbers [m].
fn places(seconds: f64) -> [Point3<f64>; 8] {
    let turn = |x: f64, y: f64, z: f64| Rotation3::from_euler_angles(x, y, z);
    let swing = (5.0 * seconds).sin();
    let waist = Point3::new(2.0 * seconds.cos(), 2.0 * seconds.sin(), 1.0 + 0.03 * swing);
    let hips = turn(0.05 * swing, 0.2, 2.0 * seconds);
    let chest = waist + hips * Vector3::new(0.0, 0.0, 0.45);
    // Shoulders shrug: their line is not square to the trunk.
    let shoulders = hips * turn(0.2 * swing, 0.0, 0.0);
    let head = chest + shoulders * turn(0.1, 0.3 * swing, 0.0) * Vector3::z() * 0.3;
    let arm = |side: f64| {
        let shoulder = chest + shoulders * Vector3::y() * (0.19 * side);
        let upper = shoulders * turn(0.3 * side, -0.8 * side * swing, 0.0);
        let elbow = shoulder - upper * Vector3::z() * 0.3;
        let wrist = elbow - upper * turn(0.0, -0.7 - 0.5 * swing, 0.2) * Vector3::z() * 0.26;
        [shoulder, elbow, wrist]
    };
    let ([ls, le, lw], [rs, re, rw]) = (arm(1.0), arm(-1.0));
    [head, waist, ls, rs, le, re, lw, rw]
}

/// What a run of one second and a half at 60 Hz gives, of targets that `keep` leaves over.
fn run(settings: &str, place: impl Fn(f64, u32) -> Option<Point3<f64>>) -> (Option<SkeletonMotion>, Report) {
    let folder = tempfile::tempdir().unwrap();
    let setup = Setup { out_dir: Some(folder.path().to_owned()), ..Setup::for_tests() };
    let mut node = ExportBvh::new(toml::from_str(settings).unwrap(), &setup).unwrap();
    for frame in 60..150 {
        let time = Time::from_s(f64::from(frame) / 60.0);
        let at = |id: u32| Some(target(id, place(time.as_s(), id)?.into(), How::Measured));
        let list = (0..40).filter_map(at).collect();
        node.gather.as_mut().unwrap().push_targets(Arc::new(Targets { time, list }), false);
    }
    let mut report = Report::default();
    node.finish(&mut report).unwrap();
    let text = std::fs::read_to_string(folder.path().join("motion.bvh")).ok();
    (text.map(|it| SkeletonMotion::from_bvh(&it).unwrap()), report)
}

fn of_body(seconds: f64, id: u32) -> Option<Point3<f64>> {
    places(seconds).get(id as usize).copied()
}

/// The eight in a frame, z up, by forward kinematics [m].
fn found(motion: &SkeletonMotion, frame: usize, unit_m: f64) -> [Point3<f64>; 8] {
    let poses = motion.poses(frame, unit_m).unwrap();
    let up = z_up_from_y_up();
    let origin = |name: &str| up * Point3::from(poses[motion.joint(name).unwrap()].translation.vector);
    let end = |name: &str| {
        let joint = motion.joint(name).unwrap();
        let pose: &Isometry3<f64> = &poses[joint];
        up * (pose * Point3::from(motion.joints[joint].end.unwrap() * unit_m))
    };
    [
        end("Neck"),
        origin("Hips"),
        origin("LeftArm"),
        origin("RightArm"),
        origin("LeftForeArm"),
        origin("RightForeArm"),
        end("LeftForeArm"),
        end("RightForeArm"),
    ]
}

#[test]
fn node_keeps_its_promises() {
    foveate_testkit::check_node::<ExportBvh>("unit = \"m\"");
}

#[test]
fn joints_stand_where_the_targets_were() {
    for (settings, unit_m) in [("", 0.01), ("unit = \"m\"", 1.0)] {
        let (motion, report) = run(settings, of_body);
        let motion = motion.unwrap();
        assert_eq!((motion.n_frames(), motion.joints.len(), report.figures["bvh.frames_held"]), (90, 7, 0.0));
        assert!((motion.frame_s - 1.0 / 60.0).abs() < 1e-12);
        assert!((report.figures["bvh.start_s"] - 1.0).abs() < 1e-6);
        for frame in 0..90 {
            let wanted = places(1.0 + frame as f64 / 60.0);
            for (site, (it, wanted)) in found(&motion, frame, unit_m).iter().zip(wanted).enumerate() {
                assert!((it - wanted).norm() < 1e-3, "frame {frame}, target {site}: {it}, expected {wanted}");
            }
        }
        // Angles do not jump.
        let n = motion.n_channels();
        assert!(motion.values.windows(n + 1).all(|it| (it[0] - it[n]).abs() < 90.0));
    }
}

#[test]
fn a_body_at_rest_has_no_angles() {
    // Looks along x, arms to the sides.
    let rest = [[0.0, 0.0, 1.7], [0.0, 0.0, 1.0], [0.0, 0.2, 1.4], [0.0, -0.2, 1.4]];
    let arms = [[0.0, 0.5, 1.4], [0.0, -0.5, 1.4], [0.0, 0.8, 1.4], [0.0, -0.8, 1.4]];
    let (motion, _) = run("", |_, id| rest.iter().chain(&arms).nth(id as usize).map(|it| Point3::from(*it)));
    let motion = motion.unwrap();
    let frame = motion.frame(0).unwrap();
    assert_eq!(frame[..3], [0.0, 100.0, 0.0]);
    assert!(frame[3..].iter().all(|it| it.abs() < 1e-5), "{frame:?}");
    assert_eq!(motion.joints[1].offset, Vector3::new(0.0, 40.0, 0.0));
    assert_eq!(motion.joints[3].offset, Vector3::new(20.0, 0.0, 0.0));
}

#[test]
fn what_is_missing_holds_its_last_pose_and_is_counted() {
    let is_hidden = |seconds: f64, id: u32| id == 6 && !(1.2..2.0).contains(&seconds);
    let (motion, report) = run("", |seconds, id| of_body(seconds, id).filter(|_| !is_hidden(seconds, id)));
    let motion = motion.unwrap();
    assert_eq!(report.figures["bvh.frames_held"], 42.0);
    assert!(report.remarks.iter().any(|it| it.contains("in 42 of 90 frames") && it.contains("LeftForeArm in 42")));
    // Its three angles, behind root, chest, neck and arm.
    let turn = |frame: usize| motion.frame(frame).unwrap()[15..18].to_vec();
    assert_eq!((turn(0), turn(89)), (turn(12), turn(59)));
    assert_ne!(turn(58), turn(59));
    for frame in [0, 30, 89] {
        let wanted = places(1.0 + frame as f64 / 60.0);
        let found = found(&motion, frame, 0.01);
        assert!([0, 1, 2, 3, 4, 5, 7].iter().all(|it| (found[*it] - wanted[*it]).norm() < 1e-3), "frame {frame}");
    }
}

#[test]
fn limbs_never_seen_are_left_out() {
    let (motion, report) = run("", |seconds, id| of_body(seconds, id).filter(|_| id != 0 && id != 5));
    let motion = motion.unwrap();
    let names: Vec<_> = motion.joints.iter().map(|it| it.name.as_str()).collect();
    assert_eq!(names, ["Hips", "Chest", "LeftArm", "LeftForeArm"]);
    assert_eq!(report.figures["bvh.frames_held"], 0.0);
    assert!(report.remarks.iter().any(|it| it.contains("lacks Neck, RightArm, RightForeArm")), "{:?}", report.remarks);
}

#[track_caller]
fn check_unwritten(place: impl Fn(f64, u32) -> Option<Point3<f64>>, words: &str) {
    let (motion, report) = run("", place);
    assert_eq!(motion, None);
    assert!(report.remarks.iter().any(|it| it.contains(words)), "{:?}", report.remarks);
}

#[test]
fn what_is_no_body_is_not_written() {
    check_unwritten(|_, _| None, "no frame with waist and both shoulders");
    check_unwritten(|seconds, id| of_body(seconds, id).filter(|_| id != 3), "no frame with waist and both shoulders");
    check_unwritten(|_, id| (id < 8).then(Point3::origin), "in all 90 frames");
    check_unwritten(|_, id| (id < 8).then(|| Point3::new(0.0, 0.0, f64::from(id))), "in all 90 frames");
}

#[test]
fn numbers_are_all_there_and_each_another() {
    let table = |waist: &str| {
        format!(
            "[joints]\nhead = 10\n{waist}left_shoulder = 12\nright_shoulder = 13\nleft_elbow = 14\nright_elbow = 15\n\
             left_wrist = 16\nright_wrist = 17"
        )
    };
    let (motion, _) = run(&table("waist = 11\n"), |seconds, id| of_body(seconds, id.checked_sub(10)?));
    assert_eq!(motion.unwrap().joints.len(), 7);
    let missing = toml::from_str::<ExportBvhSettings>(&table("")).unwrap_err();
    assert!(missing.to_string().contains("missing field `waist`"), "{missing}");
    let doubled = toml::from_str(&table("waist = 15\n")).unwrap();
    let error = ExportBvh::new(doubled, &Setup::for_tests()).err().unwrap();
    assert!(error.message.contains("target 15 for both `waist` and `right_elbow`"), "{error:?}");
}
