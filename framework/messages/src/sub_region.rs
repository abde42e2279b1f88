//! The moving volume that the next scale looks into.

use nalgebra::{Isometry3, Matrix6, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::schema::{Numbers, Pose};
use crate::wire::portable;
use crate::{CameraId, Interval, Message, Provenance, Quality, Space, TargetId, Time, Wire};

/// What a sub-region selector follows: a ball about a target, in the space of the scale that the target lies in, which is the parent of the
/// selector's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SubRegion {
    /// The time that position and velocity are of.
    pub time: Time,
    /// The target at the centre.
    pub target: TargetId,
    /// Centre of the ball [m].
    #[schemars(with = "Numbers<3>")]
    pub centre: Point3<f64>,
    /// Velocity of the centre [m/s].
    #[schemars(with = "Numbers<3>")]
    pub velocity: Vector3<f64>,
    /// Of (centre, velocity) [m², m²/s, m²/s²].
    #[schemars(with = "Numbers<36>")]
    pub covariance: Matrix6<f64>,
    /// Radius of the ball [m].
    pub radius: f64,
    /// Whether the middle was measured, predicted or filled.
    pub provenance: Provenance,
}

impl SubRegion {
    /// The middle `interval` later if it keeps its velocity [m].
    pub fn centre_after(&self, interval: Interval) -> Point3<f64> {
        self.centre + self.velocity * interval.as_s()
    }
}

impl Message for SubRegion {
    const NAME: &'static str = "sub_region";
    const SPACE: Space = Space::PARENT_POINTS;
    const WIRE: Wire = portable!(SubRegion);

    fn quality(&self) -> Quality {
        let variance = self.covariance.fixed_view::<3, 3>(0, 0).trace() / 3.0;
        Quality { count: Some(1), sigma: Some(variance.max(0.0).sqrt()) }
    }
}

/// A scale of a rig by its number there, parents before children.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize, JsonSchema)]
pub struct ScaleId(pub u32);

/// The space of a scale that is anchored to a target, at one time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ScaleSpace {
    /// The scale whose space it is.
    pub scale: ScaleId,
    /// The time that the pose is of.
    pub time: Time,
    /// The target that carries the scale; `None` while it is lost: the scale is suspended, and the pose below is the last that was known
    /// (the parent's own space where none ever was).
    pub target: Option<TargetId>,
    /// Takes points of the scale's space to the parent's.
    #[serde(with = "Pose")]
    #[schemars(with = "Pose")]
    pub parent_from_scale: Isometry3<f64>,
    /// Of δ in `parent_from_scale` ∘ exp(δ), (rotation, translation) [rad², rad m, m²].
    #[schemars(with = "Numbers<36>")]
    pub covariance: Matrix6<f64>,
    /// Velocity of the space's origin in the parent [m/s].
    #[schemars(with = "Numbers<3>")]
    pub velocity: Vector3<f64>,
    /// Of (origin, velocity) in the parent [m², m²/s, m²/s²].
    #[schemars(with = "Numbers<36>")]
    pub motion_covariance: Matrix6<f64>,
}

impl Message for ScaleSpace {
    const NAME: &'static str = "scale_space";
    const SPACE: Space = Space::STATED;
    const WIRE: Wire = portable!(ScaleSpace);

    fn quality(&self) -> Quality {
        let sigma = (self.covariance.fixed_view::<3, 3>(3, 3).trace() / 3.0).max(0.0).sqrt();
        Quality { count: Some(u32::from(self.target.is_some())), sigma: self.target.map(|_| sigma) }
    }
}

/// Which target each camera on a head should follow.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Assignment {
    /// Ascending by camera; heads that are not named have nothing to follow.
    pub list: Vec<(CameraId, TargetId)>,
}

impl Assignment {
    /// What `camera` should follow.
    pub fn target_of(&self, camera: CameraId) -> Option<TargetId> {
        self.list.binary_search_by_key(&camera, |it| it.0).ok().map(|place| self.list[place].1)
    }
}

impl Message for Assignment {
    const NAME: &'static str = "assignment";
    const SPACE: Space = Space::NONE;
    const WIRE: Wire = portable!(Assignment);

    fn quality(&self) -> Quality {
        Quality { count: Some(self.list.len() as u32), sigma: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_finds_its_target_and_another_none() {
        let assignment = Assignment { list: vec![(CameraId(2), TargetId(9)), (CameraId(5), TargetId(1))] };
        assert_eq!(assignment.target_of(CameraId(5)), Some(TargetId(1)));
        assert_eq!(assignment.target_of(CameraId(3)), None);
    }

    #[test]
    fn a_region_moves_with_its_velocity() {
        let region = SubRegion {
            time: Time::ZERO,
            target: TargetId(0),
            centre: Point3::new(1.0, 2.0, 3.0),
            velocity: Vector3::new(0.0, -2.0, 0.0),
            covariance: Matrix6::identity() * 4.0,
            radius: 0.2,
            provenance: Provenance::Measured,
        };
        assert_eq!(region.centre_after(Interval::from_ms(500.0)), Point3::new(1.0, 1.0, 3.0));
        assert_eq!(region.quality().sigma, Some(2.0));
    }
}
