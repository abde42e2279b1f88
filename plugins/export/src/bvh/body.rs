//! Bones of fixed length and rotations of joints, from the positions of a body's targets.
//!
//! | joint | from → to | direction at rest | length |
//! |---|---|---|---|
//! | `Hips` | waist → chest, the middle of the shoulders | y up, left shoulder along x | median over the session |
//! | `Chest` | right → left shoulder | x | half the median distance of the shoulders |
//! | `Neck` | chest → head | y | median |
//! | `LeftArm`, `RightArm` | shoulder → elbow | x, −x | median |
//! | `LeftForeArm`, `RightForeArm` | elbow → wrist | x, −x | median |
//!
//! `Hips` have the rotation given by waist → chest and the shoulders; all others the shortest rotation from their rest direction, in the space of their parent:
//! the rotation of a limb about its own axis is unobservable.

use foveate::scene::skeleton::{Axis, Channel, Joint, SkeletonMotion, euler_angles};
use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};

/// The sites of the targets of [`Places`], in their order.
pub(super) const SITES: [&str; 8] =
    ["head", "waist", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist"];
const HEAD: usize = 0;
const WAIST: usize = 1;
const SHOULDERS: [usize; 2] = [2, 3];

/// Positions of the targets in a frame, y up.
pub(super) type Places = [Option<Point3<f64>>; 8];

/// Two targets nearer than this define no direction.
const SAME_PLACE: f64 = 1e-6;
/// With a smaller angle between waist → chest and the shoulders, the rotation is unobservable [rad].
const ONE_LINE: f64 = 1e-3;

const HIPS: usize = 0;
const CHEST: usize = 1;
const N_JOINTS: usize = 7;

/// A joint whose rotation is given by the direction of its bone.
struct Bone {
    name: &'static str,
    parent: usize,
    /// `None`: the chest.
    from: Option<usize>,
    to: usize,
    rest: Vector3<f64>,
}

/// The bones on the chest and on each other, as joints 2 to 6: parents first, and each limb in a row, as BVH has them.
fn bones() -> [Bone; N_JOINTS - 2] {
    let bone = |name, parent, from, to, rest| Bone { name, parent, from, to, rest };
    [
        bone("Neck", CHEST, None, HEAD, Vector3::y()),
        bone("LeftArm", CHEST, Some(2), 4, Vector3::x()),
        bone("LeftForeArm", 3, Some(4), 6, Vector3::x()),
        bone("RightArm", CHEST, Some(3), 5, -Vector3::x()),
        bone("RightForeArm", 5, Some(5), 7, -Vector3::x()),
    ]
}

/// The motion of a body, and its missing parts.
pub(super) struct Body {
    pub(super) motion: SkeletonMotion,
    /// Joints without targets in some frames, with the number of frames in which they keep a pose.
    pub(super) held: Vec<(String, usize)>,
    /// Frames in which any joint keeps a pose.
    pub(super) n_held: usize,
    /// Joints without a single pose, which are left out.
    pub(super) absent: Vec<&'static str>,
}

fn chest(places: &Places) -> Option<Point3<f64>> {
    let [left, right] = SHOULDERS.map(|it| places[it]);
    Some(nalgebra::center(&left?, &right?))
}

fn median(lengths: impl Iterator<Item = f64>) -> f64 {
    let mut lengths: Vec<f64> = lengths.collect();
    lengths.sort_unstable_by(f64::total_cmp);
    lengths.get(lengths.len() / 2).copied().unwrap_or(0.0)
}

/// The shortest rotation from `rest`, along x or y, to `along`; about z if they are opposite. `None`: `along` is no direction.
fn shortest(rest: &Vector3<f64>, along: &Vector3<f64>) -> Option<UnitQuaternion<f64>> {
    let along = along.try_normalize(SAME_PLACE)?;
    let half_turn = || UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI);
    Some(UnitQuaternion::rotation_between(rest, &along).unwrap_or_else(half_turn))
}

/// `world_from_hips` and `hips_from_chest`; `None`: not seen, or unobservable.
fn trunk(places: &Places) -> Option<[UnitQuaternion<f64>; 2]> {
    let up = (chest(places)? - places[WAIST]?).try_normalize(SAME_PLACE)?;
    let across = (places[SHOULDERS[0]]? - places[SHOULDERS[1]]?).try_normalize(SAME_PLACE)?;
    let left = (across - up * across.dot(&up)).try_normalize(ONE_LINE)?;
    let axes = Matrix3::from_columns(&[left, up, left.cross(&up)]);
    let hips = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    Some([hips, shortest(&Vector3::x(), &(hips.inverse() * across))?])
}

/// Rotations by joint, `parent_from_joint`, and the waist, frame by frame.
struct Course {
    waist: Vec<Point3<f64>>,
    /// `None`: before the first rotation.
    turns: [Vec<Option<UnitQuaternion<f64>>>; N_JOINTS],
    /// Which joints had a rotation, frame by frame.
    seen: Vec<[bool; N_JOINTS]>,
}

/// A joint that was not seen keeps its last rotation; before the first one, waist, hips and chest have their first.
fn follow(frames: &[Places], bones: &[Bone]) -> Option<Course> {
    let mut waist = frames.iter().find_map(|it| it[WAIST])?;
    let first = frames.iter().find_map(trunk)?;
    let mut last = [None; N_JOINTS];
    (last[HIPS], last[CHEST]) = (Some(first[0]), Some(first[1]));
    let mut course = Course { waist: Vec::new(), turns: Default::default(), seen: Vec::new() };
    for places in frames {
        let mut seen = [None; N_JOINTS];
        if let Some([hips, chest]) = trunk(places) {
            (seen[HIPS], seen[CHEST]) = (Some(hips), Some(chest));
        }
        waist = places[WAIST].unwrap_or(waist);
        let mut world: [Option<UnitQuaternion<f64>>; N_JOINTS] = [None; N_JOINTS];
        world[HIPS] = seen[HIPS].or(last[HIPS]);
        world[CHEST] = world[HIPS].zip(seen[CHEST].or(last[CHEST])).map(|(a, b)| a * b);
        for (bone, joint) in bones.iter().zip(CHEST + 1..) {
            let from = bone.from.map_or_else(|| chest(places), |it| places[it]);
            let ends = from.zip(places[bone.to]);
            seen[joint] = ends.zip(world[bone.parent]).and_then(|((from, to), world_from_parent)| {
                shortest(&bone.rest, &(world_from_parent.inverse() * (to - from)))
            });
            world[joint] = world[bone.parent].zip(seen[joint].or(last[joint])).map(|(a, b)| a * b);
        }
        course.waist.push(waist);
        for joint in 0..N_JOINTS {
            last[joint] = seen[joint].or(last[joint]);
            course.turns[joint].push(last[joint]);
        }
        course.seen.push(seen.map(|it| it.is_some()));
    }
    Some(course)
}

/// The body of these positions; `per_length` units of the file are one unit of the positions.
///
/// # Errors
/// A sentence: the body's rotation is unobservable from waist and shoulders.
pub(super) fn body(frames: &[Places], rate_hz: f64, per_length: f64) -> Result<Body, String> {
    let bones = bones();
    let Some(mut course) = follow(frames, &bones) else {
        let together = frames.iter().filter(|it| it[WAIST].is_some() && chest(it).is_some()).count();
        return Err(match together {
            0 => "found no frame with waist and both shoulders, expected one at least".to_owned(),
            n => {
                format!("found waist and shoulders at one place or on one line in all {n} frames, expected a triangle")
            }
        });
    };
    let size = |from: fn(&Places) -> Option<Point3<f64>>, to: usize| {
        per_length * median(frames.iter().filter_map(|it| Some((it[to]? - from(it)?).norm())))
    };
    let between =
        |from: usize, to: usize| per_length * median(frames.iter().filter_map(|it| Some((it[to]? - it[from]?).norm())));
    let rotations = [Axis::Z, Axis::X, Axis::Y].map(Channel::Rotation);
    let positions = [Axis::X, Axis::Y, Axis::Z].map(Channel::Position);
    let joint = |name: &str, parent: Option<usize>, offset: Vector3<f64>| Joint {
        name: name.to_owned(),
        parent,
        offset: offset.map(rounded),
        channels: if parent.is_none() { [positions, rotations].concat() } else { rotations.to_vec() },
        end: None,
    };
    let half = between(SHOULDERS[0], SHOULDERS[1]) / 2.0;
    let mut joints = vec![joint("Hips", None, Vector3::zeros())];
    joints.push(joint("Chest", Some(HIPS), Vector3::y() * size(chest, WAIST)));
    // Where each joint stands in the file.
    let mut kept = vec![HIPS, CHEST];
    let mut absent = Vec::new();
    let mut ends = vec![None, Some(Vector3::x() * half)];
    for (bone, index) in bones.iter().zip(CHEST + 1..) {
        // Before it was first seen it stands as it did then.
        let Some(first) = course.turns[index].iter().find_map(|it| *it) else {
            absent.push(bone.name);
            continue;
        };
        course.turns[index].iter_mut().for_each(|it| *it = it.or(Some(first)));
        let Some(parent) = kept.iter().position(|it| *it == bone.parent) else { continue };
        let offset = match (bone.from, bone.parent) {
            (Some(_), CHEST) => bone.rest * half,
            (Some(_), _) => ends[parent].unwrap_or_default(),
            (None, _) => Vector3::zeros(),
        };
        ends[parent] = None;
        ends.push(Some(bone.rest * bone.from.map_or_else(|| size(chest, bone.to), |from| between(from, bone.to))));
        joints.push(joint(bone.name, Some(parent), offset));
        kept.push(index);
    }
    for (joint, end) in joints.iter_mut().zip(ends) {
        joint.end = end.map(|it| it.map(rounded));
    }
    let held_in = |index: &usize| course.seen.iter().filter(|it| !it[*index]).count();
    let held = joints.iter().zip(&kept).map(|(joint, index)| (joint.name.clone(), held_in(index)));
    let held = held.filter(|it| it.1 > 0).collect();
    let n_held = course.seen.iter().filter(|it| kept.iter().any(|index| !it[*index])).count();
    let values = values(&course, &kept, per_length);
    Ok(Body { motion: SkeletonMotion { joints, frame_s: 1.0 / rate_hz, values }, held, n_held, absent })
}

/// To a millionth, so that a file is no longer than it must be; no negative zero.
fn rounded(value: f64) -> f64 {
    (value * 1e6).round() / 1e6 + 0.0
}

/// The numbers of all frames. Angles are unwrapped beyond half a turn, for programs that interpolate them.
fn values(course: &Course, kept: &[usize], per_length: f64) -> Vec<f64> {
    let mut values = Vec::with_capacity(course.waist.len() * (3 + 3 * kept.len()));
    let mut before = vec![[0.0; 3]; kept.len()];
    for (frame, waist) in course.waist.iter().enumerate() {
        values.extend(waist.iter().map(|it| rounded(it * per_length)));
        for (joint, before) in kept.iter().zip(&mut before) {
            let turn = course.turns[*joint][frame].unwrap_or_default().to_rotation_matrix();
            let angles = euler_angles(&turn, [Axis::Z, Axis::X, Axis::Y]).map(f64::to_degrees);
            for (last, angle) in before.iter_mut().zip(angles) {
                *last = angle - 360.0 * ((angle - *last) / 360.0).round();
                values.push(rounded(*last));
            }
        }
    }
    values
}
