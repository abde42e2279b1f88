//! Points of a surface that are tracked without markers.

use nalgebra::{Matrix3, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::schema::Numbers;
use crate::wire::portable;
use crate::{CameraSet, Message, Provenance, Quality, Space, Time, Wire};

/// One point at one time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TrackedPoint {
    /// Which point of the surface it is: the same for as long as it is tracked, and given to no other one.
    pub id: u32,
    /// In the space of its producer's scale [m].
    #[schemars(with = "Numbers<3>")]
    pub position: Point3<f64>,
    /// Over the last step; zero for a point without one [m/s].
    #[schemars(with = "Numbers<3>")]
    pub velocity: Vector3<f64>,
    /// Over the last two steps; zero for a point without these [m/s²].
    #[schemars(with = "Numbers<3>")]
    pub acceleration: Vector3<f64>,
    /// Of the position [m²].
    #[schemars(with = "Numbers<9>")]
    pub covariance: Matrix3<f64>,
    /// Out of the surface, of length 1; zero where it is not known [–].
    #[schemars(with = "Numbers<3>")]
    pub normal: Vector3<f64>,
    /// The cameras that saw it.
    pub cameras: CameraSet,
    /// Whether this sample was measured, predicted or filled.
    pub provenance: Provenance,
    /// Samples of its trajectory up to this one, at least 1.
    pub n_samples: u32,
}

/// Why a trajectory ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
pub enum TrajectoryEnd {
    /// Not found in the next picture.
    Lost,
    /// Found in time and between views, at different places.
    Disagreed,
    /// Faster than anything there can be.
    TooFast,
    /// Accelerated more than anything there can be.
    TooAbrupt,
    /// Moved differently from its neighbours: that step is false, and left out.
    NotUniform,
    /// Another point came to lie on it.
    Merged,
    /// Its neighbours lie on another surface, or another point took its place on the grid.
    Alone,
    /// Each step agreed with its neighbours, but its whole path did not: dragged by a shadow's edge, or held back by a reflected lamp.
    Crept,
}

impl TrajectoryEnd {
    /// As it stands in tables and names of figures: `not_uniform`.
    pub const fn name(self) -> &'static str {
        match self {
            TrajectoryEnd::Lost => "lost",
            TrajectoryEnd::Disagreed => "disagreed",
            TrajectoryEnd::TooFast => "too_fast",
            TrajectoryEnd::TooAbrupt => "too_abrupt",
            TrajectoryEnd::NotUniform => "not_uniform",
            TrajectoryEnd::Merged => "merged",
            TrajectoryEnd::Alone => "alone",
            TrajectoryEnd::Crept => "crept",
        }
    }
}

/// All points of a surface at one time, and what became of those that were there before.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct TrackedSurface {
    /// The time that all samples are of.
    pub time: Time,
    /// Ascending by identity.
    pub list: Vec<TrackedPoint>,
    /// Trajectories that had a sample before and have none now: they are truncated there. Ascending by identity.
    pub ended: Vec<(u32, TrajectoryEnd)>,
}

impl TrackedSurface {
    /// The point of this identity.
    pub fn get(&self, id: u32) -> Option<&TrackedPoint> {
        self.list.binary_search_by_key(&id, |it| it.id).ok().map(|place| &self.list[place])
    }
}

impl Message for TrackedSurface {
    const NAME: &'static str = "tracked_surface";
    const SPACE: Space = Space::WORLD_POINTS;
    const WIRE: Wire = portable!(TrackedSurface);

    fn quality(&self) -> Quality {
        let n = self.list.len();
        let sum: f64 = self.list.iter().map(|it| (it.covariance.trace() / 3.0).max(0.0).sqrt()).sum();
        Quality { count: Some(n as u32), sigma: (n > 0).then(|| sum / n as f64) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_found_by_identity_and_state_their_quality() {
        let point = |id: u32, sigma: f64| TrackedPoint {
            id,
            position: Point3::origin(),
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
            covariance: Matrix3::identity() * sigma * sigma,
            normal: Vector3::zeros(),
            cameras: CameraSet::default(),
            provenance: Provenance::Measured,
            n_samples: 1,
        };
        let surface = TrackedSurface { list: vec![point(3, 1.0), point(7, 3.0)], ..TrackedSurface::default() };
        assert!(surface.get(7).is_some() && surface.get(5).is_none());
        assert_eq!(surface.quality(), Quality { count: Some(2), sigma: Some(2.0) });
        assert_eq!(TrackedSurface::default().quality().sigma, None);
    }
}
