//! Files come back as they were, bodies stand where they should, and broken files are named by their line.

use std::path::PathBuf;

use nalgebra::Point3;
use proptest::prelude::*;

use super::*;

const ARM: &str = "HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation
  JOINT Left Arm {
    OFFSET 1 0 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 2 0
    }
  }
}
MOTION
Frames: 2
Frame Time: .0083333
0 10 0 0 0 0 0 0 0
0 10 0 0 90 0 90 0 0
";

#[test]
fn joints_turn_in_the_order_of_their_channels() {
    let arm = SkeletonMotion::from_bvh(ARM).unwrap();
    assert_eq!((arm.n_frames(), arm.frame_s, arm.joint("Left Arm")), (2, 0.0083333, Some(1)));
    let end_at = |frame: usize| arm.poses(frame, 0.5).unwrap()[1] * (Point3::from(arm.joints[1].end.unwrap()) * 0.5);
    assert!((end_at(0) - Point3::new(0.5, 6.0, 0.0)).norm() < 1e-12, "{}", end_at(0));
    // The root turns x to −z; in its space the arm's turn about z takes y to −x, which is z of the world.
    assert!((end_at(1) - Point3::new(0.0, 5.0, 0.5)).norm() < 1e-12, "{}", end_at(1));
    assert_eq!(arm.poses(2, 0.5), None);
}

#[test]
fn y_up_becomes_z_up() {
    let turn = z_up_from_y_up();
    assert!((turn * Vector3::y() - Vector3::z()).norm() < 1e-12, "up");
    assert!((turn * Vector3::z() - Vector3::x()).norm() < 1e-12, "ahead");
    assert!((turn * Vector3::x() - Vector3::y()).norm() < 1e-12, "to the left");
}

const ORDERS: [[Axis; 3]; 6] = {
    use Axis::{X, Y, Z};
    [[X, Y, Z], [X, Z, Y], [Y, X, Z], [Y, Z, X], [Z, X, Y], [Z, Y, X]]
};

proptest! {
    #[test]
    fn angles_give_the_rotation_back(
        axis in [-1.0..1.0, -1.0..1.0, -1.0..1.0], order in prop::sample::select(ORDERS.to_vec()),
        right_angle in prop::option::of(prop::bool::ANY), outer in -3.0..3.0, inner in -3.0..3.0,
    ) {
        let turn = |axis: Axis, angle: f64| Rotation3::from_axis_angle(&axis.unit(), angle);
        let product = |angles: [f64; 3]| turn(order[0], angles[0]) * turn(order[1], angles[1]) * turn(order[2], angles[2]);
        let rotation = match right_angle {
            // Where two of the axes coincide.
            Some(positive) => product([outer, if positive { 1.0 } else { -1.0 } * std::f64::consts::FRAC_PI_2, inner]),
            None => Rotation3::new(Vector3::from(axis) * 3.0),
        };
        let again = product(euler_angles(&rotation, order));
        prop_assert!((again.matrix() - rotation.matrix()).norm() < 1e-6, "{} {}", rotation, again);
    }

    #[test]
    fn skeletons_of_any_shape_come_back(
        parents in prop::collection::vec(any::<prop::sample::Index>(), 0..12),
        numbers in prop::collection::vec(-1e6..1e6_f64, 60), n_frames in 0..3_usize,
    ) {
        let channel = |it: usize| if it.is_multiple_of(2) { Channel::Rotation(Axis::Y) } else { Channel::Position(Axis::Z) };
        let joint = |index: usize, parent: Option<usize>| Joint {
            name: format!("joint {index}"),
            parent,
            offset: Vector3::new(numbers[index], numbers[index + 1], -0.1),
            channels: (0..1 + index % 4).map(channel).collect(),
            end: index.is_multiple_of(3).then(|| Vector3::new(0.0, numbers[index + 2], 1.0 / 3.0)),
        };
        // Depth first, as a file has them: each hangs on the last one or on one of those around it.
        let mut joints = vec![joint(0, None)];
        for pick in &parents {
            let mut around = vec![joints.len() - 1];
            while let Some(up) = joints[around[around.len() - 1]].parent { around.push(up) }
            joints.push(joint(joints.len(), Some(around[pick.index(around.len())])));
        }
        let n_channels: usize = joints.iter().map(|it| it.channels.len()).sum();
        let values = (0..n_frames * n_channels).map(|it| numbers[it % 60] / 7.0).collect();
        let wanted = SkeletonMotion { joints, frame_s: 1.0 / 120.0, values };
        prop_assert_eq!(SkeletonMotion::from_bvh(&wanted.to_bvh()).unwrap(), wanted);
    }
}

#[test]
fn lines_may_end_in_any_way_and_a_mark_may_stand_first() {
    let wanted = SkeletonMotion::from_bvh(ARM).unwrap();
    for text in [
        format!("\u{feff}{ARM}"),
        format!("\u{feff}\r\n{}", ARM.replace('\n', "\r\n")),
        ARM.replace('\n', "\r"),
        ARM.trim_end().to_owned(),
        ARM.replace("  ", "\t").replace(' ', "\t").replace("Left\tArm", "Left Arm"),
        ARM.replace("Frames: 2", "Frames:2").replace("Time: ", "Time:"),
        ARM.replace("Frames: 2", "frames :\t2"),
    ] {
        assert_eq!(SkeletonMotion::from_bvh(&text).unwrap(), wanted, "{text:?}");
    }
}

#[track_caller]
fn check_broken(from: &str, to: &str, line: usize, words: &str) {
    assert!(ARM.contains(from));
    let error = SkeletonMotion::from_bvh(&ARM.replacen(from, to, 1)).unwrap_err();
    assert!(error.line == line && error.to_string().contains(words), "{error}");
}

#[test]
fn broken_files_are_named_by_line() {
    check_broken("HIERARCHY", "HIERARCHIE", 1, "found `HIERARCHIE`, expected `HIERARCHY`");
    check_broken("ROOT Hips", "ROOT", 2, "no name");
    check_broken("OFFSET 1 0 0", "OFFSET 1 O 0", 7, "found `O`, expected a number of an `OFFSET`");
    check_broken("OFFSET 1 0 0", "OFFSET 1 nan 0", 7, "`nan`");
    check_broken("CHANNELS 3", "CHANNELS 7", 8, "7 channels");
    check_broken("CHANNELS 3", "CHANNELS 4", 9, "found `End`");
    check_broken("Xrotation Y", "Xturn Y", 8, "`Xturn`");
    check_broken("JOINT", "BONE", 6, "`BONE`");
    check_broken("Frames: 2", "Frames: two", 16, "the number of frames");
    check_broken("Frames: 2", "Frames: 3", 19, "number 1 of 9 of frame 3 of 3");
    check_broken("Frames: 2", "Frames: 1", 19, "the end behind 1 frames");
    check_broken("Frames: 2", "Frames: 99999999999", 19, "frame 3 of 99999999999");
    check_broken(".0083333", "0", 17, "seconds above 0");
    check_broken("90 0 90", "90 x 90", 19, "number 6 of 9 of frame 2");
    // Where numbers are missing or too many shows at the end, and is named where it is.
    let rows = "0 10 0 0 0 0 0 0 0\n0 10";
    check_broken(rows, "0 10 0 0 0 0 0 0\n0 10", 19, "line 18 is the first that does not hold whole frames");
    check_broken(rows, "0 10 0 0 0 0 0 0 0 0\n0 10", 19, "line 18 is the first that does not hold whole frames");
    assert!(SkeletonMotion::from_bvh("").unwrap_err().to_string().contains("the end"));
    let second = "    End Site\n    {\n      OFFSET 0 2 0\n    }\n";
    check_broken(second, &second.repeat(2), 16, "a second `End Site`");
}

#[test]
fn cut_off_files_are_refused_and_deep_ones_do_no_harm() {
    let last = ARM.trim_end().rfind(' ').unwrap();
    (0..last).filter(|it| ARM.is_char_boundary(*it)).for_each(|it| {
        assert!(SkeletonMotion::from_bvh(&ARM[..it]).is_err(), "{}", &ARM[..it]);
    });
    let deep = format!(
        "HIERARCHY ROOT a {{ OFFSET 0 0 0 CHANNELS 0 {}",
        "JOINT\u{20}b { OFFSET 0 0 0 CHANNELS 0\n".repeat(2_000)
    );
    let error = SkeletonMotion::from_bvh(&deep).unwrap_err();
    assert!(error.found.contains("more than 1000 joints"), "{error}");
}

#[test]
fn recordings_are_read_and_come_back() {
    let Some(folder) = std::env::var_os("FOVEATE_DATA") else {
        return println!("skipped: recordings_are_read_and_come_back needs FOVEATE_DATA, the folder of recordings");
    };
    let folder = PathBuf::from(folder).join("s18_bvh");
    for (name, n_joints, n_frames, unit_m, height) in [
        ("131_01.bvh", 31, 994, CMU_UNIT_M, 1.0..2.0),
        ("131_03.bvh", 31, 1102, CMU_UNIT_M, 1.0..2.0),
        ("test_freebvh.bvh", 55, 69, 0.01, 1.0..2.0),
    ] {
        let motion = SkeletonMotion::from_bvh(&std::fs::read_to_string(folder.join(name)).unwrap()).unwrap();
        assert_eq!((motion.joints.len(), motion.n_frames()), (n_joints, n_frames), "{name}");
        assert_eq!(SkeletonMotion::from_bvh(&motion.to_bvh()).unwrap(), motion, "{name}");
        let poses = motion.poses(0, unit_m).unwrap();
        let head = poses[motion.joint("Head").unwrap()].translation.vector;
        assert!(height.contains(&head.y), "{name}: the head is at {head}");
    }
}
