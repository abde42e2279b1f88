//! Converts a fitted body to joints and parts with uncertainty.

use foveate::geometry::metaball::{Body, BodyFit, Posed, Skeleton as Bones, State};
use foveate::prelude::*;
use nalgebra::{DMatrix, Isometry3, Matrix3, Matrix6, Point3, UnitQuaternion, Vector3};

/// Joints by their places in [`BODY_JOINTS`]: the segment, and whether it is its joint (or, of the head, its middle).
const JOINTS: [&str; 14] = [
    "head",
    "head",
    "upper_arm_left",
    "upper_arm_right",
    "forearm_left",
    "forearm_right",
    "hand_left",
    "hand_right",
    "thigh_left",
    "thigh_right",
    "shank_left",
    "shank_right",
    "foot_left",
    "foot_right",
];
/// Parts by their places in [`BODY_PARTS`].
const PARTS: [&str; 10] = [
    "trunk",
    "head",
    "upper_arm_left",
    "upper_arm_right",
    "thigh_left",
    "thigh_right",
    "forearm_left",
    "forearm_right",
    "shank_left",
    "shank_right",
];
/// Limbs by their places in [`BODY_LIMBS`]: upper and lower segment.
const LIMBS: [[&str; 2]; 4] = [
    ["upper_arm_left", "forearm_left"],
    ["upper_arm_right", "forearm_right"],
    ["thigh_left", "shank_left"],
    ["thigh_right", "shank_right"],
];
/// The middle of the head from the joint of the neck, in lengths of head and neck together.
const MIDDLE_OF_HEAD: f64 = 0.675;
/// Where the head meets the neck, in the same.
const CHIN_OF_HEAD: f64 = 0.35;

/// Joints of the message before, for velocities: place and covariance.
pub(super) type Before = Vec<(u8, Point3<f64>, Matrix3<f64>)>;

/// Whether a segment is a part of an arm or a leg, hands and feet left out.
pub(super) fn is_limb(bones: &Bones, segment: usize) -> bool {
    LIMBS.iter().flatten().any(|it| *it == bones.segments()[segment].name)
}

/// The segment that a joint is fixed to, and where in its space [m]; `None` where the model has none.
pub(super) fn joint_place(body: &Body, joint: usize) -> Option<(usize, Vector3<f64>)> {
    let bones = &body.skeleton;
    let segment = bones.find(JOINTS.get(joint)?)?;
    let along = match joint {
        0 => MIDDLE_OF_HEAD * bones.segments()[segment].length,
        1 => CHIN_OF_HEAD * bones.segments()[segment].length,
        _ => 0.0,
    };
    Some((segment, Vector3::new(0.0, 0.0, along)))
}

/// Where a place of a segment is in the world.
pub(super) fn place(body: &Body, posed: &Posed, state: &State, (segment, place): (usize, Vector3<f64>)) -> Point3<f64> {
    posed.world_from_segment[segment] * Point3::from(place * state.scales[body.skeleton.segments()[segment].scale])
}

/// A body as joints and parts. Joints of unsupported segments are `filled` from priors and from the joints before them.
pub(super) fn skeleton_of(
    body: &Body,
    fit: &BodyFit,
    unsupported: &[usize],
    before: Option<(f64, &Before)>,
    cameras: CameraSet,
) -> (Skeleton, Before) {
    let (bones, state) = (&body.skeleton, &fit.state);
    let posed = bones.pose(state);
    let found: Vec<(u8, (usize, Vector3<f64>))> =
        (0..BODY_JOINTS.len()).filter_map(|it| Some((it as u8, joint_place(body, it)?))).collect();
    let covariances = covariances(body, fit, &found);
    let mut now = Before::new();
    let mut joints = Vec::new();
    for ((joint, anchor), covariance) in found.iter().zip(covariances) {
        let position = place(body, &posed, state, *anchor);
        now.push((*joint, position, covariance));
        let mut both = Matrix6::zeros();
        both.fixed_view_mut::<3, 3>(0, 0).copy_from(&(covariance + of_model(body, &posed, anchor.0)));
        let earlier = before.and_then(|(since_s, list)| Some((since_s, list.iter().find(|it| it.0 == *joint)?)));
        let velocity = match earlier {
            Some((since_s, (_, was, its))) if since_s > 0.0 => {
                both.fixed_view_mut::<3, 3>(0, 3).copy_from(&(covariance / since_s));
                both.fixed_view_mut::<3, 3>(3, 0).copy_from(&(covariance / since_s));
                both.fixed_view_mut::<3, 3>(3, 3).copy_from(&((covariance + its) / (since_s * since_s)));
                (position - was) / since_s
            }
            _ => {
                both.fixed_view_mut::<3, 3>(3, 3).copy_from(&(Matrix3::identity() * 10.0));
                Vector3::zeros()
            }
        };
        // A joint lies between two segments: either of them fixes it.
        let parent = bones.segments()[anchor.0].parent;
        let is_filled = unsupported.contains(&anchor.0) && parent.is_none_or(|it| unsupported.contains(&it));
        let provenance = if is_filled { Provenance::Filled } else { Provenance::Measured };
        joints.push(SkeletonJoint { joint: *joint, position, velocity, covariance: both, provenance });
    }
    let flip = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let mut parts = Vec::new();
    for (part, name) in PARTS.iter().enumerate() {
        let Some(segment) = bones.find(name) else { continue };
        let own: Vec<usize> = (0..body.balls.len()).filter(|it| body.balls[*it].segment == segment).collect();
        let length = bones.segments()[segment].length * state.scales[bones.segments()[segment].scale];
        let from = &posed.world_from_segment[segment];
        let mut start = 0.0;
        if *name == "trunk" {
            // The torso is trunk and pelvis.
            start = from.inverse_transform_point(&bones.joint(&posed, 0)).z;
        }
        let middle = from * Point3::new(0.0, 0.0, 0.5 * (start + length));
        // Limbs' axes point down here, and towards the body there.
        let turn = if is_limb(bones, segment) { from.rotation * flip } else { from.rotation };
        let thickness = |axis| {
            let along = own.iter().map(|it| body.balls[*it].centre.z).sum::<f64>() / own.len().max(1) as f64;
            body.thickness_at(state, segment, along * state.scales[bones.segments()[segment].scale], axis)
        };
        let is_filled = unsupported.contains(&segment);
        parts.push(SkeletonPart {
            part: part as u8,
            scale_from_part: Isometry3::from_parts(middle.coords.into(), turn),
            sizes: Vector3::new(thickness(Vector3::x()), thickness(Vector3::y()), 0.5 * (length - start)),
            size_sigmas: Vector3::repeat(0.003),
            provenance: if is_filled { Provenance::Filled } else { Provenance::Measured },
        });
    }
    let limbs = LIMBS.map(|limb| match limb.map(|it| bones.find(it)) {
        [Some(_), Some(lower)] if unsupported.contains(&lower) => LimbDetail::Straight,
        [Some(_), Some(_)] => LimbDetail::Bent,
        _ => LimbDetail::Absent,
    });
    let n = fit.distances_m.len().max(1) as f64;
    let unexplained = fit.outliers as f64 / n;
    (Skeleton { id: 0, joints, parts, limbs, facing: 1.0, unexplained, cameras }, now)
}

/// Error of a joint due to the body model, constant over messages: metaballs slide along a limb until their ends fit.
fn of_model(body: &Body, posed: &Posed, segment: usize) -> Matrix3<f64> {
    let segments = body.skeleton.segments();
    let along = |it: usize| {
        let bone = posed.world_from_segment[it].rotation * Vector3::z();
        bone * bone.transpose() * ALONG_M.powi(2)
    };
    let parent = segments[segment].parent.map_or_else(Matrix3::zeros, along);
    Matrix3::identity() * ACROSS_M.powi(2) + (along(segment) + parent) * 0.5
}

/// Standard deviations of that along bones and across them [m]: shoulders and wrists of synthetic arms of ellipsoids were 31 to 45 mm off and their elbows 8 mm and more, hips and knees of simulated people
/// 20 to 90 mm.
const ALONG_M: f64 = 0.03;
const ACROSS_M: f64 = 0.005;

/// Of joints, from that of the parameters; where these are not all observable, that of what the model adds at least.
fn covariances(body: &Body, fit: &BodyFit, joints: &[(u8, (usize, Vector3<f64>))]) -> Vec<Matrix3<f64>> {
    /// Steps of the central differences, in each parameter's unit [rad, m, –].
    const STEP: f64 = 1e-5;
    let Ok(covariance) = &fit.covariance else { return vec![Matrix3::identity() * 1e-2; joints.len()] };
    let n = covariance.nrows();
    let free: Vec<usize> = (0..n).filter(|it| covariance[(*it, *it)] > 0.0).collect();
    let mut jacobian = DMatrix::zeros(3 * joints.len(), free.len());
    let mut step = vec![0.0; n];
    for (column, parameter) in free.iter().enumerate() {
        let mut at = |by: f64| {
            step[*parameter] = by;
            let state = fit.state.moved(&step);
            step[*parameter] = 0.0;
            let posed = body.skeleton.pose(&state);
            joints.iter().map(|it| place(body, &posed, &state, it.1)).collect::<Vec<_>>()
        };
        let (after, before) = (at(STEP), at(-STEP));
        for (row, (after, before)) in after.iter().zip(&before).enumerate() {
            jacobian.fixed_view_mut::<3, 1>(3 * row, column).copy_from(&((after - before) / (2.0 * STEP)));
        }
    }
    let own = DMatrix::from_fn(free.len(), free.len(), |a, b| covariance[(free[a], free[b])]);
    let all = &jacobian * own * jacobian.transpose();
    (0..joints.len()).map(|it| all.fixed_view::<3, 3>(3 * it, 3 * it).into_owned()).collect()
}
