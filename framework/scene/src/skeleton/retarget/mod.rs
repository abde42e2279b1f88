//! The motion of one skeleton on another: joint angles carry over, lengths stay those of the other, feet stay on the floor [D'Apuzzo 1999 §4.3]; a rig of which no leg follows one stands as it rests, on a floor at 0.
//!
//! Skeletons differ in their rest postures: arms hang down in one, and stretch out in another. What carries over is therefore where bones point: each joint of the rig that is named in the map turns in
//! the world as its counterpart does, after the turn that lays its bone, at rest, along the counterpart's. Joints that are not named stay as they rest against their parents.
//!
//! | here | meaning | unit |
//! |---|---|---|
//! | [`RigJoint::rest`], [`RigJoint::offset`] | the joint at rest in its parent's space; a BVH joint rests unturned | –, the rig's |
//! | `laid` | source_from_rig of a joint: its bone at rest laid along the counterpart's | – |
//! | `scale` | heights of the hips over the lowest joint at rest, the rig's over the source's | rig's per source's |

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::{Axis, Channel, SkeletonMotion, euler_angles};

mod odd;

pub use odd::suspicious_pairs;

/// Legs that end this near to one another, over the height of the hips, are both stood on [–].
const LEGS_ALIKE: f64 = 0.1;

/// The first joint of a skeleton that has legs is at least this high, over the height of all; people's hips are halfway up [–].
const LEAST_HIPS: f64 = 0.25;

/// Heights of joints at rest that vary by less than this part of the height of all do not say which way is up, standard deviation [–].
const LEAST_VARIED: f64 = 0.1;

/// A direction along which higher joints of a rig are found is up where it is this near to an axis, cosine [–].
const LEAST_UPRIGHT: f64 = 0.8;

/// A joint of a rig at rest.
#[derive(Debug, Clone, PartialEq)]
pub struct RigJoint {
    /// Its name.
    pub name: String,
    /// The joint that it hangs on, which stands before it; `None` for a root.
    pub parent: Option<usize>,
    /// From the parent's origin, along the parent's axes.
    pub offset: Vector3<f64>,
    /// How it is turned in its parent's space.
    pub rest: UnitQuaternion<f64>,
    /// Where a limb without a further joint ends, along the joint's axes.
    pub end: Option<Vector3<f64>>,
}

/// The rig in one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct RigPose {
    /// Of the first joint, in the rig's space, in place of its offset.
    pub root: Vector3<f64>,
    /// By joint: how it is turned in its parent's space.
    pub turns: Vec<UnitQuaternion<f64>>,
}

/// Why a motion cannot be retargeted to a rig.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RetargetError {
    /// A name of the map that a skeleton does not have.
    #[error("the {whose} has no joint `{name}`, expected one of {expected}")]
    NoJoint {
        /// Rig or motion.
        whose: &'static str,
        /// The name.
        name: String,
        /// Those that it has.
        expected: String,
    },
    /// One joint of the rig under two names that follow different ones.
    #[error("joint `{name}` of the rig is to follow both {} and {}, expected one of them", leaders[0], leaders[1])]
    TwoLeaders {
        /// Of the rig.
        name: String,
        /// Of the motion.
        leaders: [String; 2],
    },
    /// A skeleton that cannot stand: without height.
    #[error("the {whose} has no height at rest between its first joint and its lowest one")]
    Flat {
        /// Rig or motion.
        whose: &'static str,
    },
    /// Channels that cannot hold a turn.
    #[error("joint `{name}` of the rig has {found} channels of rotation, expected 3 about different axes")]
    Channels {
        /// Of the joint.
        name: String,
        /// How many it has.
        found: usize,
    },
    /// Nothing to carry over.
    #[error(
        "found {joints} joints in the map, {of_rig} in the rig and {frames} frames of motion, expected one of each at least"
    )]
    Empty {
        /// Of the map.
        joints: usize,
        /// Of the rig.
        of_rig: usize,
        /// Of the motion.
        frames: usize,
    },
}

/// The joints of a BVH skeleton at rest.
pub fn rig_of(skeleton: &SkeletonMotion) -> Vec<RigJoint> {
    let joint = |it: &super::Joint| RigJoint {
        name: it.name.clone(),
        parent: it.parent,
        offset: it.offset,
        rest: UnitQuaternion::identity(),
        end: it.end,
    };
    skeleton.joints.iter().map(joint).collect()
}

/// Where joints stand at rest, and with `pose` in a frame.
pub fn stand(rig: &[RigJoint], pose: Option<&RigPose>) -> Vec<Isometry3<f64>> {
    let mut stands: Vec<Isometry3<f64>> = Vec::with_capacity(rig.len());
    for (number, joint) in rig.iter().enumerate() {
        let turn = pose.map_or(joint.rest, |it| it.turns[number]);
        let offset = pose.filter(|_| number == 0).map_or(joint.offset, |it| it.root);
        let own = Isometry3::from_parts(Translation3::from(offset), turn);
        stands.push(joint.parent.map_or(own, |it| stands[it] * own));
    }
    stands
}

/// A joint and those that it hangs on, upwards.
fn above(joints: &[RigJoint], joint: usize) -> impl Iterator<Item = usize> {
    std::iter::successors(Some(joint), |it| joints[*it].parent)
}

/// The lower one of a joint's place and of its end.
fn foot_of(joint: &RigJoint, stand: &Isometry3<f64>, up: Axis) -> f64 {
    let tip = joint.end.map_or(f64::INFINITY, |it| (stand * nalgebra::Point3::from(it))[up.index()]);
    stand.translation.vector[up.index()].min(tip)
}

/// The joint that is lowest, or whose end is.
fn lowest_joint(rig: &[RigJoint], stands: &[Isometry3<f64>], up: Axis) -> Option<usize> {
    (0..rig.len()).min_by(|a, b| foot_of(&rig[*a], &stands[*a], up).total_cmp(&foot_of(&rig[*b], &stands[*b], up)))
}

/// The lowest place of joints and ends.
fn lowest(rig: &[RigJoint], stands: &[Isometry3<f64>], up: Axis) -> f64 {
    lowest_joint(rig, stands, up).map_or(f64::INFINITY, |it| foot_of(&rig[it], &stands[it], up))
}

fn find(joints: &[&str], whose: &'static str, name: &str) -> Result<usize, RetargetError> {
    let plain = |it: &&str| it.rsplit(':').next() == Some(name) || *it == name;
    joints.iter().position(plain).ok_or_else(|| RetargetError::NoJoint {
        whose,
        name: name.to_owned(),
        expected: joints.join(", "),
    })
}

/// By joint of a rig: which of the joints of a motion, of these names, it follows by a map; names may leave out what stands before a colon.
///
/// # Errors
/// A name of the map that one of both does not have, and a joint of the rig that is to follow two.
pub fn followed(
    rig: &[RigJoint],
    motion: &[&str],
    map: &[(String, String)],
) -> Result<Vec<Option<usize>>, RetargetError> {
    let of_rig: Vec<&str> = rig.iter().map(|it| it.name.as_str()).collect();
    let mut follows: Vec<Option<usize>> = vec![None; rig.len()];
    for (joint, leader) in map {
        let joint = find(&of_rig, "rig", joint)?;
        let leader = find(motion, "motion", leader)?;
        if let Some(before) = follows[joint].replace(leader).filter(|it| *it != leader) {
            let leaders = [before, leader].map(|it| motion[it].to_owned());
            return Err(RetargetError::TwoLeaders { name: rig[joint].name.clone(), leaders });
        }
    }
    Ok(follows)
}

/// Directions of the bones that leave a joint at rest to those of `to`, or, where there is none, to where it ends: the middle of what hangs on it.
fn bones(rig: &[RigJoint], stands: &[Isometry3<f64>], joint: usize, to: &[usize]) -> Vec<Vector3<f64>> {
    let from = stands[joint].translation.vector;
    let direction = |at: Vector3<f64>| (at - from).try_normalize(1e-9);
    let mut found: Vec<Vector3<f64>> = to.iter().filter_map(|it| direction(stands[*it].translation.vector)).collect();
    if to.is_empty() {
        let hang: Vec<Vector3<f64>> = (0..rig.len())
            .filter(|it| rig[*it].parent == Some(joint))
            .map(|it| stands[it].translation.vector)
            .collect();
        let middle = hang.iter().sum::<Vector3<f64>>() / hang.len() as f64;
        let end = rig[joint].end.map(|it| (stands[joint] * nalgebra::Point3::from(it)).coords);
        found.extend(end.or((!hang.is_empty()).then_some(middle)).and_then(direction));
    }
    found
}

/// The turn that lays `from` along `to`, nearest to `near` where they leave it open.
fn laid_along(from: &[Vector3<f64>], to: &[Vector3<f64>], near: UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    match (from, to) {
        ([one], [other]) => {
            let turned = near * one;
            UnitQuaternion::rotation_between(&turned, other).map_or(near, |it| it * near)
        }
        ([_, _, ..], _) if from.len() == to.len() => {
            // W. Kabsch, "A solution for the best rotation to relate two sets of vectors", 1976; bones that lie in a plane, as hips and spine do, fix it too.
            let mut sum = Matrix3::zeros();
            from.iter().zip(to).for_each(|(from, to)| sum += to * from.transpose());
            let svd = sum.svd(true, true);
            let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return near };
            if svd.singular_values[1] < 1e-3 {
                return near;
            }
            let sign = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v_t).determinant().signum()));
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(u * sign * v_t))
        }
        _ => near,
    }
}

/// The up axis of a motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UpAxes {
    /// In its skeleton at rest.
    pub rest: Vector3<f64>,
    /// As it moves.
    pub moving: Vector3<f64>,
}

impl UpAxes {
    /// The same axis at rest and as it moves.
    pub fn both(axis: Axis) -> UpAxes {
        UpAxes { rest: unit(axis), moving: unit(axis) }
    }

    /// Whether both are this axis.
    pub fn are_both(&self, axis: Axis) -> bool {
        *self == UpAxes::both(axis)
    }
}

fn unit(axis: Axis) -> Vector3<f64> {
    let mut unit = Vector3::zeros();
    unit[axis.index()] = 1.0;
    unit
}

/// The turn that brings what is up to the axis that is up in the rig.
fn upright(from: &Vector3<f64>, up: Axis) -> UnitQuaternion<f64> {
    let over = || UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    UnitQuaternion::rotation_between(from, &unit(up)).unwrap_or_else(over)
}

/// The up axis of `motion`: the mean direction, over all frames, of the joints that the rig's high joints follow. `up` where that is along no axis, or the map has too few joints.
///
/// # Errors
/// As [`followed`].
pub fn up_axes(
    motion: &SkeletonMotion,
    rig: &[RigJoint],
    map: &[(String, String)],
    up: Axis,
) -> Result<UpAxes, RetargetError> {
    let source = rig_of(motion);
    let names: Vec<&str> = source.iter().map(|it| it.name.as_str()).collect();
    let follows = followed(rig, &names, map)?;
    let stands = stand(rig, None);
    let heights: Vec<f64> = stands.iter().map(|it| it.translation.vector[up.index()]).collect();
    let led: Vec<(f64, usize)> = heights.iter().zip(&follows).filter_map(|it| Some((*it.0, (*it.1)?))).collect();
    let mean = led.iter().map(|it| it.0).sum::<f64>() / led.len().max(1) as f64;
    let varied = (led.iter().map(|it| (it.0 - mean).powi(2)).sum::<f64>() / led.len().max(1) as f64).sqrt();
    let [low, high] = [f64::min, f64::max].map(|it| heights.iter().copied().reduce(it).unwrap_or(0.0));
    if varied <= LEAST_VARIED * (high - low) {
        return Ok(UpAxes::both(up));
    }
    let along = |stands: &[Isometry3<f64>]| -> Vector3<f64> {
        led.iter().map(|(height, joint)| stands[*joint].translation.vector * (height - mean)).sum()
    };
    let axis_of = |way: Vector3<f64>| {
        let axis = [Axis::X, Axis::Y, Axis::Z][way.iamax()];
        let is_clear = way.amax() > LEAST_UPRIGHT * way.norm();
        if is_clear { unit(axis) * way[axis.index()].signum() } else { unit(up) }
    };
    let moving = (0..motion.n_frames()).filter_map(|it| motion.poses(it, 1.0)).map(|it| along(&it)).sum();
    Ok(UpAxes { rest: axis_of(along(&stand(&source, None))), moving: axis_of(moving) })
}

/// The frames of `motion` on `rig`. `map` names joints of the rig with those of the motion that they follow; `up` is the axis that points up in the rig, `ups` say what does in the motion, which is
/// turned.
///
/// # Errors
/// See [`RetargetError`].
pub fn retarget(
    motion: &SkeletonMotion,
    rig: &[RigJoint],
    map: &[(String, String)],
    up: Axis,
    ups: &UpAxes,
) -> Result<Vec<RigPose>, RetargetError> {
    let [rest_up, moving_up] = [&ups.rest, &ups.moving].map(|it| upright(it, up));
    let mut source = rig_of(motion);
    for joint in &mut source {
        joint.offset = rest_up * joint.offset;
        joint.end = joint.end.map(|it| rest_up * it);
    }
    if map.is_empty() || motion.n_frames() == 0 || rig.is_empty() {
        return Err(RetargetError::Empty { joints: map.len(), of_rig: rig.len(), frames: motion.n_frames() });
    }
    let names: Vec<&str> = source.iter().map(|it| it.name.as_str()).collect();
    let follows = followed(rig, &names, map)?;
    let (rig_rest, source_rest) = (stand(rig, None), stand(&source, None));
    let height = |joints: &[RigJoint], stands: &[Isometry3<f64>], whose| {
        let height = stands[0].translation.vector[up.index()] - lowest(joints, stands, up);
        if height > 1e-9 { Ok(height) } else { Err(RetargetError::Flat { whose }) }
    };
    // Without a leg that follows one on which the source stands, as of an arm by itself, the rig stands as it rests.
    let foot = lowest_joint(rig, &rig_rest, up);
    let led_by = foot.and_then(|foot| above(rig, foot).find_map(|it| follows[it]));
    let source_lowest = lowest(&source, &source_rest, up);
    let source_height = source_rest[0].translation.vector[up.index()] - source_lowest;
    let leads = |joint: usize| above(&source, joint).find(|it| follows.contains(&Some(*it)));
    let is_low = |it: &usize| foot_of(&source[*it], &source_rest[*it], up) - source_lowest < LEGS_ALIKE * source_height;
    let highest = source_rest.iter().map(|it| it.translation.vector[up.index()]).fold(f64::NEG_INFINITY, f64::max);
    let has_legs = source_height > LEAST_HIPS * (highest - source_lowest);
    let stands_on_floor =
        has_legs && led_by.is_some() && (0..source.len()).filter(is_low).any(|it| leads(it) == led_by);
    let scale =
        if stands_on_floor { height(rig, &rig_rest, "rig")? / height(&source, &source_rest, "motion")? } else { 1.0 };
    // The nearest joints below one that are in the map.
    let below = |joint: usize| -> Vec<usize> {
        let is_next = |it: &usize| {
            let mut above = std::iter::successors(rig[*it].parent, |it| rig[*it].parent);
            above.find(|it| follows[*it].is_some()) == Some(joint)
        };
        (joint + 1..rig.len()).filter(|it| follows[*it].is_some()).filter(is_next).collect()
    };
    let mut laid: Vec<UnitQuaternion<f64>> = Vec::with_capacity(rig.len());
    for joint in 0..rig.len() {
        let near = rig[joint].parent.map_or_else(UnitQuaternion::identity, |it| laid[it]);
        laid.push(match follows[joint] {
            None => near,
            Some(of_source) => {
                let children = below(joint);
                // One bone would tilt the whole rig: hips that carry an arm alone stand upright.
                if rig[joint].parent.is_none() && children.len() < 2 {
                    laid.push(near);
                    continue;
                }
                let theirs: Vec<usize> = children.iter().filter_map(|it| follows[*it]).collect();
                let from = bones(rig, &rig_rest, joint, &children);
                let to = bones(&source, &source_rest, of_source, &theirs);
                laid_along(&from, &to, near)
            }
        });
    }
    let turned = |it: &Isometry3<f64>| {
        let place = Translation3::from(moving_up * it.translation.vector);
        Isometry3::from_parts(place, moving_up * it.rotation * rest_up.inverse())
    };
    let poses_of = |it: usize| Some(motion.poses(it, 1.0)?.iter().map(turned).collect());
    let frames: Vec<Vec<Isometry3<f64>>> = (0..motion.n_frames()).filter_map(poses_of).collect();
    let floor = frames.iter().map(|it| lowest(&source, it, up)).fold(f64::INFINITY, f64::min);
    let mut poses = Vec::with_capacity(frames.len());
    for stands in &frames {
        let mut turns: Vec<UnitQuaternion<f64>> = Vec::with_capacity(rig.len());
        let mut in_world: Vec<UnitQuaternion<f64>> = Vec::with_capacity(rig.len());
        for (joint, it) in rig.iter().enumerate() {
            let parent = it.parent.map_or_else(UnitQuaternion::identity, |it| in_world[it]);
            let world = match follows[joint] {
                Some(of_source) => stands[of_source].rotation * laid[joint] * rig_rest[joint].rotation,
                None => parent * it.rest,
            };
            turns.push(parent.inverse() * world);
            in_world.push(world);
        }
        if !stands_on_floor {
            let mut root = rig[0].offset;
            root[up.index()] -= lowest(rig, &rig_rest, up);
            poses.push(RigPose { root, turns });
            continue;
        }
        let mut pose = RigPose { root: stands[0].translation.vector * scale, turns };
        // What is lowest is as far above the floor as it was, for the rig's size.
        let wanted = scale * (lowest(&source, stands, up) - floor);
        pose.root[up.index()] += wanted - lowest(rig, &stand(rig, Some(&pose)), up);
        poses.push(pose);
    }
    Ok(poses)
}

/// Poses of a BVH rig as its motion, with its own channels. Along axes of which the root has a channel its offset becomes nought: some readers add the two, others take the channel
/// in place of the offset, and so all have the root at the same place.
///
/// # Errors
/// A joint whose channels cannot hold a turn.
pub fn as_motion(rig: &SkeletonMotion, poses: &[RigPose], frame_s: f64) -> Result<SkeletonMotion, RetargetError> {
    let mut values = Vec::with_capacity(poses.len() * rig.n_channels());
    let mut before = vec![[0.0_f64; 3]; rig.joints.len()];
    for pose in poses {
        for (number, joint) in rig.joints.iter().enumerate() {
            let axes: Vec<Axis> = (joint.channels.iter())
                .filter_map(|it| match it {
                    Channel::Rotation(axis) => Some(*axis),
                    Channel::Position(_) => None,
                })
                .collect();
            let found = axes.len();
            let wrong = || RetargetError::Channels { name: joint.name.clone(), found };
            let axes: [Axis; 3] = axes.try_into().map_err(|_| wrong())?;
            if axes[0] == axes[1] || axes[1] == axes[2] || axes[0] == axes[2] {
                return Err(wrong());
            }
            let angles = euler_angles(&pose.turns[number].to_rotation_matrix(), axes).map(f64::to_degrees);
            let mut next = 0;
            for channel in &joint.channels {
                values.push(match channel {
                    Channel::Position(axis) if number == 0 => pose.root[axis.index()],
                    Channel::Position(_) => 0.0,
                    Channel::Rotation(_) => {
                        let angle = &mut before[number][next];
                        *angle = angles[next] - 360.0 * ((angles[next] - *angle) / 360.0).round();
                        next += 1;
                        *angle
                    }
                });
            }
        }
    }
    let mut joints = rig.joints.clone();
    if let Some(root) = joints.first_mut() {
        for channel in &root.channels {
            if let Channel::Position(axis) = channel {
                root.offset[axis.index()] = 0.0;
            }
        }
    }
    Ok(SkeletonMotion { joints, frame_s, values })
}

#[cfg(test)]
mod tests;
