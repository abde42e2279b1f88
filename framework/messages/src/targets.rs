//! The 3D points recovered at one scale.

use nalgebra::{Matrix6, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::schema::Numbers;
use crate::wire::portable;
use crate::{CameraSet, Interval, Message, Quality, Space, Time, Wire};

/// The identity of a target: lasts as long as the target does, and is not given out again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize, JsonSchema)]
pub struct TargetId(pub u32);

/// Whether a sample was measured, predicted or filled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize, JsonSchema)]
pub enum Provenance {
    /// From observations at this very time.
    #[default]
    Measured,
    /// Extrapolated from earlier observations by a motion model.
    Predicted,
    /// Supplied by a model of shape, without an observation of its own.
    Filled,
}

impl Provenance {
    /// As it stands in files: `measured`, `predicted` or `filled`.
    pub const fn name(self) -> &'static str {
        match self {
            Provenance::Measured => "measured",
            Provenance::Predicted => "predicted",
            Provenance::Filled => "filled",
        }
    }
}

/// One target at one time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Target {
    /// Its identity.
    pub id: TargetId,
    /// In the scale's space [m].
    #[schemars(with = "Numbers<3>")]
    pub position: Point3<f64>,
    /// In the scale's space [m/s].
    #[schemars(with = "Numbers<3>")]
    pub velocity: Vector3<f64>,
    /// Of (position, velocity) [m², m²/s, m²/s²].
    #[schemars(with = "Numbers<36>")]
    pub covariance: Matrix6<f64>,
    /// The cameras whose observations entered at this time; empty unless `provenance` is measured.
    pub cameras: CameraSet,
    /// Whether this sample was measured, predicted or filled.
    pub provenance: Provenance,
}

impl Target {
    /// Where the target is `interval` later if it keeps its velocity [m].
    pub fn position_after(&self, interval: Interval) -> Point3<f64> {
        self.position + self.velocity * interval.as_s()
    }

    /// Standard deviation of the position: the root of the mean variance over the three axes [m].
    pub fn position_sigma(&self) -> f64 {
        (self.covariance.fixed_view::<3, 3>(0, 0).trace() / 3.0).max(0.0).sqrt()
    }
}

/// All targets of one scale at one time, ascending by identity.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Targets {
    /// The time that all samples in `list` are of.
    pub time: Time,
    /// The targets.
    pub list: Vec<Target>,
}

impl Message for Targets {
    const NAME: &'static str = "targets";
    const SPACE: Space = Space::POINTS;
    const WIRE: Wire = portable!(Targets);

    fn quality(&self) -> Quality {
        let sum: f64 = self.list.iter().map(Target::position_sigma).sum();
        Quality {
            count: Some(self.list.len() as u32),
            sigma: (!self.list.is_empty()).then(|| sum / self.list.len() as f64),
        }
    }
}
