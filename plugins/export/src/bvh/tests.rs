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
        let at = |id: u32| Some(target(id, place(time.as_s(), id)?.into(), Provenance::Measured));
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

/// The remark that says why no file is written, and the map that it offers.
#[track_caller]
fn refusal(settings: &str, place: impl Fn(f64, u32) -> Option<Point3<f64>>) -> (String, Option<[u32; 8]>) {
    let (motion, report) = run(settings, place);
    assert!(motion.is_none(), "written: {:?}", report.figures);
    let why = report.remarks.iter().find(|it| it.contains("is not written")).unwrap().clone();
    let offered = why.split_once("joints = {").map(|it| {
        let text = format!("joints = {{{}", it.1);
        let settings: ExportBvhSettings = toml::from_str(&text).unwrap();
        let BodyTargets {
            head,
            waist,
            left_shoulder,
            right_shoulder,
            left_elbow,
            right_elbow,
            left_wrist,
            right_wrist,
        } = settings.joints;
        [head, waist, left_shoulder, right_shoulder, left_elbow, right_elbow, left_wrist, right_wrist]
    });
    (why, offered)
}

/// The body with its targets under other numbers: `order[site]`.
fn renumbered(order: [u32; 8]) -> impl Fn(f64, u32) -> Option<Point3<f64>> {
    move |seconds, id| order.iter().position(|it| *it == id).map(|site| places(seconds)[site])
}

#[test]
fn targets_exchanged_are_refused_and_put_right() {
    // Pairs of sites whose targets are exchanged, one after the other.
    for (a, b) in [(0, 1), (0, 6), (1, 4), (2, 3), (2, 4), (3, 7), (4, 5), (4, 6), (5, 7), (6, 7)] {
        let mut order = [0, 1, 2, 3, 4, 5, 6, 7];
        order.swap(a, b);
        let (why, offered) = refusal("", renumbered(order));
        assert_eq!(offered, Some(order), "{why}");
        assert!(why.contains("the targets cannot be a body") && why.contains("`joints."), "{why}");
    }
    let all_other_way = [5, 7, 0, 6, 1, 2, 4, 3];
    assert_eq!(refusal("", renumbered(all_other_way)).1, Some(all_other_way));
}

#[test]
fn sides_exchanged_throughout_are_found_from_the_movements() {
    let mirrored = [0, 1, 3, 2, 5, 4, 7, 6];
    let (why, offered) = refusal("", renumbered(mirrored));
    assert!(why.contains("left and right are exchanged"), "{why}");
    assert_eq!(offered, Some(mirrored));
}

#[test]
fn body_is_found_among_other_targets() {
    // A crowd of things that stand, wander or fly about, and the body under higher numbers.
    let order = [30, 31, 32, 33, 34, 35, 36, 37];
    let place = |seconds: f64, id: u32| match id {
        30.. => renumbered(order)(seconds, id),
        _ if id.is_multiple_of(3) => Some(Point3::new(f64::from(id), 0.3 * f64::from(id % 7), 0.2 * f64::from(id))),
        _ if id < 14 => {
            Some(Point3::new((seconds * f64::from(id)).sin(), 0.1 * f64::from(id), 1.0 + (seconds * 3.0).cos()))
        }
        _ => None,
    };
    let (why, offered) = refusal("", place);
    assert_eq!(offered, Some(order), "{why}");
}

#[test]
fn one_target_missing_leaves_a_limb_out_and_offers_nothing_wrong() {
    // A wrist that is no target: the arm is there without it.
    let (motion, report) = run("", |seconds, id| of_body(seconds, id).filter(|_| id != 6));
    assert!(
        motion.is_some() && report.remarks.iter().any(|it| it.contains("lacks LeftForeArm")),
        "{:?}",
        report.remarks
    );
    // A shoulder that is no target: seven make no body.
    let (why, offered) = refusal("", |seconds, id| of_body(seconds, id).filter(|_| id != 2));
    assert!(offered.is_none() && why.contains("no eight of the 7 targets"), "{why}");
}

#[test]
fn what_is_upside_down_or_too_large_is_refused() {
    let (why, _) = refusal("", |seconds, id| of_body(seconds, id).map(|it| Point3::new(it.x, -it.y, 2.0 - it.z)));
    assert!(why.contains("is below `joints.waist` = 1 in 100 %"), "{why}");
    let (why, _) = refusal("", |seconds, id| of_body(seconds, id).map(|it| it * 2.0));
    assert!(why.contains("m tall"), "{why}");
}

/// The upper arms of 68 and 43 cm of a map that was taken for a body.
#[test]
fn arms_of_two_lengths_are_refused_unless_the_rig_says_otherwise() {
    let uneven = |seconds: f64, id: u32| {
        let all = places(seconds);
        let stretched = |shoulder: usize, elbow: usize, length: f64, it: usize| {
            let along = (all[elbow] - all[shoulder]).normalize();
            all[it] + along * (length - 0.3)
        };
        Some(match id {
            4 | 6 => stretched(2, 4, 0.68, id as usize),
            5 | 7 => stretched(3, 5, 0.43, id as usize),
            _ => *all.get(id as usize)?,
        })
    };
    let (why, _) = refusal("", uneven);
    assert!(
        why.contains("the left upper arm (`joints.left_shoulder` = 2 and `joints.left_elbow` = 4) is 68 cm"),
        "{why}"
    );
    let settings = "part_factor = 3.0\nside_factor = 3.0\nstretch_percent = 300.0";
    assert!(run(settings, uneven).0.is_some());
    assert!(run("part_factor = 3.0\nstretch_percent = 300.0", uneven).0.is_none(), "the sides differ");
}

/// Two years old: 0.87 m, a quarter of it head and neck, short arms.
#[test]
fn a_child_is_a_body() {
    let child = |seconds: f64, id: u32| {
        let all = places(seconds);
        let scaled = |it: usize, from: usize, length: f64| (all[it] - all[from]).normalize() * length;
        let waist = all[1] * 0.5;
        let chest = waist + (nalgebra::center(&all[2], &all[3]) - all[1]).normalize() * 0.21;
        let across = (all[2] - all[3]).normalize() * 0.105;
        let [ls, rs] = [chest + across, chest - across];
        let [le, re] = [ls + scaled(4, 2, 0.15), rs + scaled(5, 3, 0.15)];
        let up = (all[0] - nalgebra::center(&all[2], &all[3])).normalize() * 0.22;
        Some(match id {
            0 => chest + up,
            1 => waist,
            2 => ls,
            3 => rs,
            4 => le,
            5 => re,
            6 => le + scaled(6, 4, 0.115),
            7 => re + scaled(7, 5, 0.115),
            _ => return None,
        })
    };
    let (motion, report) = run("", child);
    assert!(motion.is_some(), "{:?}", report.remarks);
}

/// Recorded people: their own map passes, and a map that is not theirs is put right.
#[test]
fn recorded_people_are_bodies() {
    let mut n_files = 0;
    for set in ["s22_bvh_people", "s18_bvh"] {
        let Some(folder) = foveate_testkit::data_dir_or_skip("recorded_people_are_bodies", set) else { return };
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_none_or(|it| it != "bvh") {
                continue;
            }
            let motion = SkeletonMotion::from_bvh(&String::from_utf8_lossy(&std::fs::read(&path).unwrap())).unwrap();
            let Some(sites) = joints_of(&motion) else {
                println!("skipped: {} has joints by other names", path.display());
                continue;
            };
            n_files += 1;
            let frames = recorded(&motion, &sites);
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            let at = |seconds: f64| frames[((seconds - 1.0) * 60.0).round() as usize * frames.len() / 91];
            let (own, report) = run("", |seconds, id| at(seconds).get(id as usize).copied());
            assert!(own.is_some(), "{name}: {:?}", report.remarks);
            for order in [[1, 0, 2, 3, 4, 5, 6, 7], [3, 5, 1, 7, 0, 2, 6, 4]] {
                let place = |seconds: f64, id: u32| order.iter().position(|it| *it == id).map(|site| at(seconds)[site]);
                let (why, offered) = refusal("", place);
                let exchanged = [0, 1, 3, 2, 5, 4, 7, 6].map(|it| order[it]);
                assert!(
                    offered == Some(order) || (offered == Some(exchanged) && why.contains("may be exchanged")),
                    "{name}: {why}"
                );
            }
        }
    }
    assert!(n_files >= 6, "{n_files} recordings");
}

/// Joints for the eight sites: names of several makers.
fn joints_of(motion: &SkeletonMotion) -> Option<[usize; 8]> {
    let any = |names: &[&str]| names.iter().find_map(|it| motion.joint(it));
    Some([
        any(&["Head", "head", "Head_end"])?,
        any(&["LowerBack", "lowerback", "Spine", "Chest"])?,
        any(&["LeftArm", "LeftShoulder", "LeftUpArm", "lShldr"])?,
        any(&["RightArm", "RightShoulder", "RightUpArm", "rShldr"])?,
        any(&["LeftForeArm", "LeftElbow", "LeftLowArm", "lForeArm"])?,
        any(&["RightForeArm", "RightElbow", "RightLowArm", "rForeArm"])?,
        any(&["LeftHand", "LeftWrist", "lHand"])?,
        any(&["RightHand", "RightWrist", "rHand"])?,
    ])
}

/// The places of the sites in each frame, z up, such that the upper arm is 31 cm: the units of files differ. The head's target sits on top of it.
fn recorded(motion: &SkeletonMotion, sites: &[usize; 8]) -> Vec<[Point3<f64>; 8]> {
    let poses = |frame: usize, unit_m: f64| motion.poses(frame, unit_m).unwrap();
    let place =
        |frame: usize, site: usize, unit_m: f64| Point3::from(poses(frame, unit_m)[sites[site]].translation.vector);
    let unit_m = 0.31 / (place(0, 4, 1.0) - place(0, 2, 1.0)).norm();
    // Some files have z up, whatever BVH is meant to have.
    let rise = (0..motion.n_frames()).map(|it| place(it, 0, unit_m) - place(it, 1, unit_m)).sum::<Vector3<f64>>();
    let up = if rise.z > rise.y { nalgebra::UnitQuaternion::identity() } else { z_up_from_y_up() };
    let of_frame = |frame: usize| {
        let mut all: [Point3<f64>; 8] = std::array::from_fn(|site| place(frame, site, unit_m));
        let chest = nalgebra::center(&all[2], &all[3]);
        let neck = all[0] - chest;
        all[0] += neck.normalize() * 0.14;
        all.map(|it| up * it)
    };
    (0..motion.n_frames()).map(of_frame).collect()
}
