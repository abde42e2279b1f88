//! Motions of drawn skeletons on others.

use super::*;

/// Name, parent, offset and end of a joint.
type Row<'n> = (&'n str, Option<usize>, Vector3<f64>, Option<Vector3<f64>>);

/// Hips, spine to head, two arms that hang (or stretch out), two legs; `size` scales all, arms by `arms` more.
fn figure(size: f64, arms: f64, stretched: bool) -> SkeletonMotion {
    let out = if stretched { Vector3::x() } else { -Vector3::y() };
    let mut text: Vec<Row> = vec![("Hips", None, Vector3::new(0.0, 0.9, 0.0), None)];
    text.push(("Head", Some(0), Vector3::new(0.0, 0.6, 0.0), Some(Vector3::new(0.0, 0.2, 0.0))));
    for (side, names) in [
        (1.0, ["LeftArm", "LeftForeArm", "LeftUpLeg", "LeftLeg"]),
        (-1.0, ["RightArm", "RightForeArm", "RightUpLeg", "RightLeg"]),
    ] {
        let out = Vector3::new(side * out.x, out.y, out.z);
        let first = text.len();
        text.push((names[0], Some(0), Vector3::new(0.2 * side, 0.5, 0.0), None));
        text.push((names[1], Some(first), out * 0.3 * arms, Some(out * 0.25 * arms)));
        text.push((names[2], Some(0), Vector3::new(0.1 * side, -0.05, 0.0), None));
        text.push((names[3], Some(first + 2), Vector3::new(0.0, -0.42, 0.0), Some(Vector3::new(0.0, -0.43, 0.0))));
    }
    let joint = |(name, parent, offset, end): &Row| {
        let mut channels = [Axis::Z, Axis::X, Axis::Y].map(Channel::Rotation).to_vec();
        if parent.is_none() {
            channels.splice(0..0, [Axis::X, Axis::Y, Axis::Z].map(Channel::Position));
        }
        super::super::Joint {
            name: (*name).to_owned(),
            parent: *parent,
            offset: offset * size,
            channels,
            end: end.map(|it| it * size),
        }
    };
    SkeletonMotion { joints: text.iter().map(joint).collect(), frame_s: 0.04, values: Vec::new() }
}

/// Arms hang in the source; it walks on, bends a knee, lifts an arm, jumps in the last frame.
fn moving() -> SkeletonMotion {
    let mut motion = figure(1.0, 1.0, false);
    for frame in 0..5 {
        let part = f64::from(frame);
        for (number, joint) in motion.joints.clone().iter().enumerate() {
            if number == 0 {
                motion.values.extend([0.1 * part, if frame == 4 { 0.3 } else { 0.0 }, 0.2 * part]);
            }
            motion.values.extend(match joint.name.as_str() {
                "Hips" => [0.0, 3.0 * part, 10.0 * part],
                "LeftArm" => [20.0 * part, 0.0, 15.0],
                "LeftForeArm" => [0.0, -25.0 * part, 0.0],
                "RightUpLeg" => [0.0, -12.0 * part, 0.0],
                "RightLeg" => [0.0, 15.0 * part, 0.0],
                _ => [0.0; 3],
            });
        }
    }
    motion
}

fn by_name(rig: &SkeletonMotion) -> Vec<(String, String)> {
    rig.joints.iter().map(|it| (it.name.clone(), it.name.clone())).collect()
}

fn directions(motion: &SkeletonMotion, frame: usize) -> Vec<(String, Vector3<f64>)> {
    let poses = motion.poses(frame, 1.0).unwrap();
    let direction = |number: usize| {
        let joint = &motion.joints[number];
        let child = motion.joints.iter().position(|it| it.parent == Some(number));
        let tip = match joint.end {
            Some(end) => (poses[number] * nalgebra::Point3::from(end)).coords,
            None => poses[child.unwrap()].translation.vector,
        };
        (joint.name.clone(), (tip - poses[number].translation.vector).normalize())
    };
    (1..motion.joints.len()).map(direction).collect()
}

#[test]
fn bones_point_as_they_did_whatever_the_rest_posture_and_the_lengths() {
    let motion = moving();
    let rig = figure(60.0, 1.4, true);
    let poses = retarget(&motion, &rig_of(&rig), &by_name(&rig), Axis::Y, &UpAxes::both(Axis::Y)).unwrap();
    let found = as_motion(&rig, &poses, motion.frame_s).unwrap();
    assert_eq!((found.n_frames(), &found.joints[1..]), (5, &rig.joints[1..]));
    // Added to the offset or in place of it, the channels put the root at the same place.
    for (frame, pose) in poses.iter().enumerate() {
        let at = found.poses(frame, 1.0).unwrap()[0].translation.vector;
        let channels = &found.values[frame * found.n_channels()..][..3];
        assert!((at - pose.root).norm() < 1e-9 && (at - Vector3::from_column_slice(channels)).norm() < 1e-9);
    }
    for frame in 0..5 {
        for ((name, was), (_, is)) in directions(&motion, frame).iter().zip(directions(&found, frame)) {
            assert!(was.angle(&is) < 1e-6, "{name} in frame {frame}: {was:?} became {is:?}");
        }
    }
    let again = SkeletonMotion::from_bvh(&found.to_bvh()).unwrap();
    assert_eq!(again.n_frames(), 5);
}

#[test]
fn a_bone_whose_tip_no_joint_of_the_map_follows_points_as_it_did() {
    let motion = moving();
    // Feet hang on the legs, off their line, and nothing says what they follow.
    let mut rig = figure(1.0, 1.0, true);
    for leg in ["LeftLeg", "RightLeg"] {
        let number = rig.joints.iter().position(|it| it.name == leg).unwrap();
        let end = rig.joints[number].end.take().unwrap() + Vector3::new(0.0, 0.0, 0.15);
        let foot = super::super::Joint {
            name: format!("{leg}Foot"),
            parent: Some(number),
            offset: end,
            end: Some(Vector3::new(0.0, 0.0, 0.1)),
            ..rig.joints[number].clone()
        };
        rig.joints.push(foot);
    }
    let map: Vec<(String, String)> = by_name(&motion);
    let poses = retarget(&motion, &rig_of(&rig), &map, Axis::Y, &UpAxes::both(Axis::Y)).unwrap();
    let found = as_motion(&rig, &poses, motion.frame_s).unwrap();
    for frame in 0..5 {
        let of = directions(&found, frame);
        for (name, was) in directions(&motion, frame) {
            let is = of.iter().find(|it| it.0 == name).unwrap().1;
            assert!(was.angle(&is) < 1e-6, "{name} in frame {frame}: {was:?} became {is:?}");
        }
    }
}

#[test]
fn feet_stay_on_the_floor_and_leave_it_in_a_jump() {
    let motion = moving();
    // Legs twice as long, the rest as it was.
    let mut rig = figure(1.0, 1.0, true);
    for joint in rig.joints.iter_mut().filter(|it| it.name.ends_with("Leg")) {
        joint.offset *= if joint.name.ends_with("UpLeg") { 1.0 } else { 2.0 };
        joint.end = joint.end.map(|it| it * 2.0);
    }
    rig.joints[0].offset.y = 1.75;
    let joints = rig_of(&rig);
    let poses = retarget(&motion, &joints, &by_name(&rig), Axis::Y, &UpAxes::both(Axis::Y)).unwrap();
    let heights: Vec<f64> = poses.iter().map(|it| lowest(&joints, &stand(&joints, Some(it)), Axis::Y)).collect();
    let of_source: Vec<f64> =
        (0..5).map(|it| lowest(&rig_of(&motion), &motion.poses(it, 1.0).unwrap(), Axis::Y)).collect();
    let floor = of_source.iter().copied().fold(f64::INFINITY, f64::min);
    let scale = 1.75 / 0.9;
    for (frame, (height, was)) in heights.iter().zip(&of_source).enumerate() {
        assert!((height - scale * (was - floor)).abs() < 0.03 * scale, "frame {frame}: {heights:?} from {of_source:?}");
    }
    assert!(heights[4] > 0.4 && heights[..4].iter().all(|it| *it < 0.1), "{heights:?}");
    // It walks as much farther as its legs are longer.
    let gone = poses[3].root.z - poses[0].root.z;
    assert!((gone / 0.6 - scale).abs() < 0.1, "{gone} m");
}

#[test]
fn a_motion_along_another_axis_is_turned_upright_whether_its_rest_is_or_not() {
    let motion = moving();
    let rig = figure(2.0, 1.0, true);
    let map = by_name(&rig);
    let joints = rig_of(&rig);
    let expected = retarget(&motion, &joints, &map, Axis::Y, &UpAxes::both(Axis::Y)).unwrap();
    // The skeleton turned so that z, or -x, is up, and what is above it: the root's places and its turn.
    for (turn, moving) in [
        (UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.5 * std::f64::consts::PI), Vector3::z()),
        (UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.5 * std::f64::consts::PI), -Vector3::x()),
    ] {
        for rest_too in [false, true] {
            let mut other = motion.clone();
            for joint in other.joints.iter_mut().filter(|_| rest_too) {
                joint.offset = turn * joint.offset;
                joint.end = joint.end.map(|it| turn * it);
            }
            let n = other.n_channels();
            for frame in 0..5 {
                let poses = motion.poses(frame, 1.0).unwrap();
                let mut number = 0;
                for (joint, it) in motion.joints.iter().enumerate() {
                    let parent = it.parent.map_or_else(UnitQuaternion::identity, |it| poses[it].rotation);
                    let own = parent.inverse() * poses[joint].rotation;
                    let own = match (rest_too, joint) {
                        (true, _) => turn * own * turn.inverse(),
                        (false, 0) => turn * own,
                        (false, _) => own,
                    };
                    let at = frame * n + number;
                    let mut next = at;
                    if joint == 0 {
                        let place = turn * poses[0].translation.vector - other.joints[0].offset;
                        other.values[at..at + 3].copy_from_slice(place.as_slice());
                        next += 3;
                    }
                    let angles = euler_angles(&own.to_rotation_matrix(), [Axis::Z, Axis::X, Axis::Y]);
                    other.values[next..next + 3].copy_from_slice(&angles.map(f64::to_degrees));
                    number = next + 3 - frame * n;
                }
            }
            let ups = up_axes(&other, &joints, &map, Axis::Y).unwrap();
            assert_eq!(ups, UpAxes { rest: if rest_too { moving } else { Vector3::y() }, moving });
            let found = retarget(&other, &joints, &map, Axis::Y, &ups).unwrap();
            for (found, expected) in found.iter().zip(&expected) {
                assert!((found.root - expected.root).norm() < 1e-9, "{:?} {:?}", found.root, expected.root);
                let off = found.turns.iter().zip(&expected.turns).map(|(a, b)| a.angle_to(b));
                assert!(off.fold(0.0, f64::max) < 1e-6);
            }
        }
    }
    // An arm by itself does not say what is up.
    let arm = [("LeftArm", "LeftArm"), ("LeftForeArm", "LeftForeArm")];
    let arm: Vec<_> = arm.iter().map(|it| (it.0.to_owned(), it.1.to_owned())).collect();
    assert!(up_axes(&motion, &joints, &arm, Axis::Y).unwrap().are_both(Axis::Y));
}

#[test]
fn names_that_are_not_there_are_refused_with_those_that_are() {
    let rig = figure(1.0, 1.0, true);
    let map = vec![("Tail".to_owned(), "Hips".to_owned())];
    let error = retarget(&moving(), &rig_of(&rig), &map, Axis::Y, &UpAxes::both(Axis::Y)).unwrap_err().to_string();
    assert!(error.contains("`Tail`") && error.contains("LeftForeArm"), "{error}");
    let twice = [("Head", "Hips"), ("puppet:Head", "Head")].map(|it| (it.0.to_owned(), it.1.to_owned()));
    let mut named = rig.clone();
    named.joints[1].name = "puppet:Head".to_owned();
    let error = retarget(&moving(), &rig_of(&named), &twice, Axis::Y, &UpAxes::both(Axis::Y)).unwrap_err();
    let leaders = ["Hips", "Head"].map(str::to_owned);
    assert_eq!(error, RetargetError::TwoLeaders { name: "puppet:Head".to_owned(), leaders });
    let of_rig = rig.joints.len();
    let empty = |joints: usize, frames: usize| Err(RetargetError::Empty { joints, of_rig, frames });
    assert_eq!(retarget(&moving(), &rig_of(&rig), &[], Axis::Y, &UpAxes::both(Axis::Y)), empty(0, 5));
    let still = SkeletonMotion { values: Vec::new(), ..moving() };
    assert_eq!(retarget(&still, &rig_of(&rig), &by_name(&rig), Axis::Y, &UpAxes::both(Axis::Y)), empty(of_rig, 0));
    let mut one = rig.clone();
    one.joints[2].channels.pop();
    let poses = retarget(&moving(), &rig_of(&rig), &by_name(&rig), Axis::Y, &UpAxes::both(Axis::Y)).unwrap();
    assert!(matches!(as_motion(&one, &poses, 0.04), Err(RetargetError::Channels { found: 2, .. })));
}
