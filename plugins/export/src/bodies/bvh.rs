//! From the parts of a body to bones of fixed length that turn.
//!
//! A part has the rotation of the joint at its root: `Hips` (the torso, between the hip joints), `Head`, and `LeftArm`, `LeftForeArm`, `LeftUpLeg`, `LeftLeg`, and the same on the right. At rest all
//! are aligned with the torso, arms and legs down; y is up, and x of the world is z of the file. BVH cannot mark missing values: a limb that is not in the model keeps its last rotation relative to the torso.

use foveate::geometry::body::Part;
use foveate::scene::skeleton::{Axis, Channel, Joint, SkeletonMotion, euler_angles, z_up_from_y_up};
use nalgebra::{UnitQuaternion, Vector3};

use super::{Course, frame_s, median_of, median_sizes, part_of};

/// Name, part, parent joint (its index in this list).
const JOINTS: [(&str, Part, Option<usize>); 10] = [
    ("Hips", Part::Torso, None),
    ("Head", Part::Head, Some(0)),
    ("LeftArm", Part::LeftUpperArm, Some(0)),
    ("LeftForeArm", Part::LeftLowerArm, Some(2)),
    ("RightArm", Part::RightUpperArm, Some(0)),
    ("RightForeArm", Part::RightLowerArm, Some(4)),
    ("LeftUpLeg", Part::LeftThigh, Some(0)),
    ("LeftLeg", Part::LeftCalf, Some(6)),
    ("RightUpLeg", Part::RightThigh, Some(0)),
    ("RightLeg", Part::RightCalf, Some(8)),
];

/// The joints that a body may have in files, from the hips on.
pub(crate) fn joint_names() -> Vec<&'static str> {
    JOINTS.iter().map(|it| it.0).collect()
}

/// The motion of a body in units of `1/per_m` metres, and the number of frames in which any joint keeps its last rotation. `None`: not a single frame.
pub(crate) fn motion(course: &Course, per_m: f64) -> Option<(SkeletonMotion, usize)> {
    let step_s = frame_s(std::slice::from_ref(course));
    let (first, last) = (course.frames.first()?.0, course.frames.last()?.0);
    let n_frames = ((last - first).as_s() / step_s).round() as usize + 1;
    let torso = median_sizes(course, Part::Torso.index())?;
    // Of our axes to those of the file.
    let to_file = z_up_from_y_up().inverse();
    let size = |part: Part| median_sizes(course, part.index());
    // Where a part hangs on the torso, the median over the frames: bodies of other models have their shoulders elsewhere.
    let hung = |part: Part| -> Option<Vector3<f64>> {
        let end = Vector3::z() * if part == Part::Head { -1.0 } else { 1.0 };
        let places = course.frames.iter().filter_map(|(_, skeleton)| {
            let [torso, own] = [Part::Torso, part].map(|it| part_of(skeleton, it.index()));
            let (torso, own) = torso.zip(own)?;
            let place = own.scale_from_part * nalgebra::Point3::from(end * own.sizes.z);
            Some(torso.scale_from_part.inverse_transform_point(&place).coords)
        });
        Some(median_of(&places.collect::<Vec<_>>())? + Vector3::z() * torso.z)
    };
    let offset = |part: Part, parent: Option<Part>| -> Option<Vector3<f64>> {
        match parent {
            None => Some(Vector3::zeros()),
            Some(Part::Torso) => hung(part),
            Some(parent) => Some(Vector3::z() * (-2.0 * size(parent)?.z)),
        }
    };
    let rotations = [Axis::Z, Axis::X, Axis::Y];
    let mut joints: Vec<Joint> = Vec::new();
    let mut kept: Vec<usize> = Vec::new();
    for (number, (name, part, parent)) in JOINTS.iter().enumerate() {
        let Some(own) = size(*part) else { continue };
        let on = match parent {
            None => None,
            Some(parent) => match kept.iter().position(|it| it == parent) {
                Some(place) => Some(place),
                None => continue,
            },
        };
        let Some(offset) = offset(*part, parent.map(|it| JOINTS[it].1)) else { continue };
        let mut channels: Vec<Channel> = rotations.map(Channel::Rotation).to_vec();
        if on.is_none() {
            channels.splice(0..0, [Axis::X, Axis::Y, Axis::Z].map(Channel::Position));
        }
        let tip = if *part == Part::Head { Vector3::z() * (2.0 * own.z) } else { Vector3::z() * (-2.0 * own.z) };
        let has_child = JOINTS.iter().any(|it| it.2 == Some(number) && size(it.1).is_some());
        joints.push(Joint {
            name: (*name).to_owned(),
            parent: on,
            offset: to_file * offset * per_m,
            channels,
            end: (!has_child).then(|| to_file * tip * per_m),
        });
        kept.push(number);
    }
    let mut values = Vec::new();
    let mut n_held = 0;
    let mut turns = vec![UnitQuaternion::identity(); kept.len()];
    let mut angles_before = vec![[0.0; 3]; kept.len()];
    let mut hips = Vector3::zeros();
    let mut next = 0;
    for frame in 0..n_frames {
        let time_s = frame as f64 * step_s;
        while next + 1 < course.frames.len() && (course.frames[next + 1].0 - first).as_s() <= time_s + step_s / 2.0 {
            next += 1;
        }
        let (time, skeleton) = &course.frames[next];
        let is_there = ((*time - first).as_s() - time_s).abs() <= step_s;
        let mut is_held = !is_there;
        let world = |number: usize| part_of(skeleton, JOINTS[number].1.index()).map(|it| it.scale_from_part);
        if let Some(torso_pose) = world(0).filter(|_| is_there) {
            hips = torso_pose * nalgebra::Point3::new(0.0, 0.0, -torso.z) - nalgebra::Point3::origin();
        }
        values.extend((to_file * hips * per_m).iter().map(|it| rounded(*it)));
        for (place, number) in kept.iter().enumerate() {
            let parent = JOINTS[*number].2.map(world);
            match (world(*number).filter(|_| is_there), parent) {
                (Some(own), None) => turns[place] = own.rotation,
                (Some(own), Some(Some(parent))) => turns[place] = parent.rotation.inverse() * own.rotation,
                _ => is_held = true,
            }
            let turn = (to_file * turns[place] * to_file.inverse()).to_rotation_matrix();
            let angles = euler_angles(&turn, rotations).map(f64::to_degrees);
            for (last, angle) in angles_before[place].iter_mut().zip(angles) {
                *last = angle - 360.0 * ((angle - *last) / 360.0).round();
                values.push(rounded(*last));
            }
        }
        n_held += usize::from(is_held);
    }
    Some((SkeletonMotion { joints, frame_s: step_s, values }, n_held))
}

/// Rounded to a millionth; no negative zero.
fn rounded(value: f64) -> f64 {
    (value * 1e6).round() / 1e6 + 0.0
}
