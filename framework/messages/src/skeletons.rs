//! Bodies as parts and joints.

use nalgebra::{Isometry3, Matrix6, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::schema::{Numbers, Pose};
use crate::wire::portable;
use crate::{CameraSet, Message, Provenance, Quality, Space, TargetId, Time, Wire};

/// A joint of a body: see [`BODY_JOINTS`] for their names.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SkeletonJoint {
    /// Its place in [`BODY_JOINTS`].
    pub joint: u8,
    /// In the space of the producer's scale [m].
    #[schemars(with = "Numbers<3>")]
    pub position: Point3<f64>,
    /// In that space [m/s].
    #[schemars(with = "Numbers<3>")]
    pub velocity: Vector3<f64>,
    /// Of (position, velocity) [m², m²/s, m²/s²].
    #[schemars(with = "Numbers<36>")]
    pub covariance: Matrix6<f64>,
    /// Measured: its part lies in voxels; predicted: it moves on; filled: proportions put it on a limb that was never seen bent.
    pub provenance: Provenance,
}

impl SkeletonJoint {
    /// As it stands in files, such as `left-elbow`.
    pub fn name(&self) -> &'static str {
        BODY_JOINTS.get(usize::from(self.joint)).copied().unwrap_or("?")
    }

    /// Standard deviation of the position: the root of the mean variance over the three axes [m].
    pub fn sigma(&self) -> f64 {
        (self.covariance.fixed_view::<3, 3>(0, 0).trace() / 3.0).max(0.0).sqrt()
    }
}

/// A part of a body: see [`BODY_PARTS`] for their names.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SkeletonPart {
    /// Its place in [`BODY_PARTS`].
    pub part: u8,
    /// Takes points of the part to the space of the producer's scale: the origin in its middle, z of a limb towards the body, of the torso to the neck, of the head away from it; x to the
    /// front and y to the left, of limbs only when it hangs down.
    #[serde(with = "Pose")]
    #[schemars(with = "Pose")]
    pub scale_from_part: Isometry3<f64>,
    /// Half of what it measures along its axes [m].
    #[schemars(with = "Numbers<3>")]
    pub sizes: Vector3<f64>,
    /// Standard deviations of the sizes [m].
    #[schemars(with = "Numbers<3>")]
    pub size_sigmas: Vector3<f64>,
    /// Measured where voxels show it at this time.
    pub provenance: Provenance,
}

impl SkeletonPart {
    /// As it stands in files, such as `left-thigh`.
    pub fn name(&self) -> &'static str {
        BODY_PARTS.get(usize::from(self.part)).copied().unwrap_or("?")
    }
}

/// How much of a limb the model has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LimbDetail {
    /// Nothing: it is not distinguished from the trunk, or not there.
    Absent,
    /// One straight piece.
    Straight,
    /// Two parts.
    Bent,
}

/// What the parts of a body are called, in the order of [`SkeletonPart::part`].
pub const BODY_PARTS: [&str; 10] = [
    "torso",
    "head",
    "left-upper-arm",
    "right-upper-arm",
    "left-thigh",
    "right-thigh",
    "left-lower-arm",
    "right-lower-arm",
    "left-calf",
    "right-calf",
];

/// What the joints of a body are called, in the order of [`SkeletonJoint::joint`]: `head` is its middle, `neck` where it meets the torso.
pub const BODY_JOINTS: [&str; 14] = [
    "head",
    "neck",
    "left-shoulder",
    "right-shoulder",
    "left-elbow",
    "right-elbow",
    "left-wrist",
    "right-wrist",
    "left-hip",
    "right-hip",
    "left-knee",
    "right-knee",
    "left-ankle",
    "right-ankle",
];

/// What the limbs of a body are called, in the order of [`Skeleton::limbs`].
pub const BODY_LIMBS: [&str; 4] = ["left-arm", "right-arm", "left-leg", "right-leg"];

/// One body at one time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Skeleton {
    /// Who: lasts as long as the body is followed, and is not given out again.
    pub id: u32,
    /// Ascending by joint; those that the model has.
    pub joints: Vec<SkeletonJoint>,
    /// Ascending by part; those that the model has: of a whole body torso and head at least, of an arm by itself its two.
    pub parts: Vec<SkeletonPart>,
    /// The level of the model, limb by limb, in the order of [`BODY_LIMBS`].
    pub limbs: [LimbDetail; 4],
    /// How sure it is which side is the left one, from 0 (guessed) to 1 [–].
    pub facing: f64,
    /// The part of its voxels' skin that no part of it explains [–].
    pub unexplained: f64,
    /// The cameras whose silhouettes the voxels come from.
    pub cameras: CameraSet,
}

impl Skeleton {
    /// The joint of this name.
    pub fn joint(&self, name: &str) -> Option<&SkeletonJoint> {
        self.joints.iter().find(|it| it.name() == name)
    }
}

/// Voxels that belong to no body.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Unmodelled {
    /// Mean of their centres, in the space of the producer's scale [m].
    #[schemars(with = "Numbers<3>")]
    pub centroid: Point3<f64>,
    /// What they hold together [m³].
    pub volume: f64,
    /// The target that they were taken for, if any.
    pub target: Option<TargetId>,
    /// Why no body was made of them.
    pub reason: String,
}

/// All bodies of one scale at one time.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Skeletons {
    /// The time that all are of.
    pub time: Time,
    /// Ascending by identity.
    pub list: Vec<Skeleton>,
    /// Groups of voxels large enough for a body that are not one so far.
    pub unmodelled: Vec<Unmodelled>,
}

impl Message for Skeletons {
    const NAME: &'static str = "skeletons";
    const SPACE: Space = Space::POINTS;
    const WIRE: Wire = portable!(Skeletons);

    fn quality(&self) -> Quality {
        let sigmas: Vec<f64> = self.list.iter().flat_map(|it| &it.joints).map(SkeletonJoint::sigma).collect();
        Quality {
            count: Some(self.list.len() as u32),
            sigma: (!sigmas.is_empty()).then(|| sigmas.iter().sum::<f64>() / sigmas.len() as f64),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joints_are_found_by_name_and_quality_is_their_mean_sigma() {
        let joint = |joint: u8, sigma: f64| SkeletonJoint {
            joint,
            position: Point3::new(f64::from(joint), 0.0, 0.0),
            velocity: Vector3::zeros(),
            covariance: Matrix6::identity() * sigma * sigma,
            provenance: Provenance::Measured,
        };
        let body = Skeleton {
            id: 3,
            joints: vec![joint(0, 0.01), joint(5, 0.03)],
            parts: Vec::new(),
            limbs: [LimbDetail::Absent, LimbDetail::Bent, LimbDetail::Absent, LimbDetail::Straight],
            facing: 0.5,
            unexplained: 0.0,
            cameras: CameraSet::default(),
        };
        assert_eq!(body.joint("right-elbow").map(|it| it.position.x), Some(5.0));
        assert_eq!(body.joint("left-knee"), None);
        let message = Skeletons { list: vec![body], ..Skeletons::default() };
        let quality = message.quality();
        assert!(quality.count == Some(1) && (quality.sigma.unwrap() - 0.02).abs() < 1e-12);
        assert_eq!(Skeletons::default().quality(), Quality { count: Some(0), sigma: None });
    }
}
