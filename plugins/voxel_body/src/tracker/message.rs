//! From a body that is followed to its message.

use foveate::geometry::body::{JointSource, Limb, LimbLevel, Part, Presence, TrackedBody};
use foveate::prelude::*;
use nalgebra::{Isometry3, Translation3, Vector3};

/// The cameras that carved.
pub(super) fn cameras_of(voxels: &Voxels) -> CameraSet {
    voxels.views.iter().filter(|it| it.status == ViewStatus::Used).map(|it| it.camera).collect()
}

/// The message of one body.
pub(super) fn skeleton_of(followed: &TrackedBody, cameras: &CameraSet) -> Skeleton {
    let tracker = &followed.tracker;
    let filter = tracker.filter();
    let joints = tracker.joints().into_iter().map(|it| SkeletonJoint {
        joint: it.joint as u8,
        position: it.position,
        velocity: it.velocity,
        covariance: it.covariance,
        provenance: match it.source {
            JointSource::Measured if followed.is_seen => Provenance::Measured,
            JointSource::Filled => Provenance::Filled,
            _ => Provenance::Predicted,
        },
    });
    let parts = filter.layout().parts().map(|part| {
        let centre = filter.body.centre(part);
        let covariance = filter.part_covariance(part);
        let provenance = match filter.layout().presence(part) {
            _ if !(followed.is_seen && tracker.shows(part)) => Provenance::Predicted,
            Presence::Tied => Provenance::Filled,
            _ => Provenance::Measured,
        };
        SkeletonPart {
            part: part.index() as u8,
            scale_from_part: Isometry3::from_parts(Translation3::from(centre), *filter.body.turn(part)),
            sizes: *filter.body.size(part),
            size_sigmas: Vector3::from_fn(|axis, _| covariance[(6 + axis, 6 + axis)].max(0.0).sqrt()),
            provenance,
        }
    });
    let limbs = Limb::ALL.map(|limb| match tracker.level(limb) {
        LimbLevel::Absent => LimbDetail::Absent,
        LimbLevel::Straight => LimbDetail::Straight,
        LimbLevel::Bent => LimbDetail::Bent,
    });
    let has_voxels = followed.is_seen && tracker.shows(Part::Torso);
    Skeleton {
        id: followed.id,
        joints: joints.collect(),
        parts: parts.collect(),
        limbs,
        facing: tracker.facing(),
        unexplained: tracker.support().unexplained,
        cameras: if has_voxels { cameras.clone() } else { CameraSet::default() },
    }
}

#[cfg(test)]
mod tests {
    use foveate::geometry::body::Joint;

    use super::*;

    #[test]
    fn names_of_the_message_are_those_of_the_model() {
        assert_eq!(Part::ALL.map(Part::name), BODY_PARTS);
        assert_eq!(Joint::ALL.map(Joint::name), BODY_JOINTS);
        assert_eq!(Limb::ALL.map(|it| it.name().replace(' ', "-")), BODY_LIMBS);
    }
}
