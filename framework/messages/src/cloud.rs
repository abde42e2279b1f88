//! Points of surfaces.

use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::schema::{Numbers, Pose};
use crate::wire::portable;
use crate::{CameraId, Message, Quality, Space, Time, Wire};

/// One point of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CloudPoint {
    /// In the space of its cloud [m].
    pub position: Point3<f32>,
    /// Of the position; symmetric [m²].
    pub covariance: Matrix3<f32>,
    /// Unit normal, out of the surface; zero where its neighbours do not determine it [–].
    pub normal: Vector3<f32>,
    /// Confidence, 0 to 1: the fraction of its neighbours that lie on the same surface [–].
    pub confidence: f32,
    /// The camera's pixel that saw it: column, row [px].
    pub pixel: [u16; 2],
    /// Red, green, blue of the surface as lit by the projector [gray level, 0..=255].
    pub colour: [u8; 3],
}

impl CloudPoint {
    /// Bytes of a point in [`PointCloud::points`].
    pub const BYTES: usize = 60;

    /// Little endian: position, covariance (xx, xy, xz, yy, yz, zz), normal, confidence as 32-bit floats; pixel as 16-bit words; colour and a zero.
    pub fn to_bytes(&self) -> [u8; Self::BYTES] {
        let (p, c, n) = (&self.position, &self.covariance, &self.normal);
        let covariance = [c[(0, 0)], c[(0, 1)], c[(0, 2)], c[(1, 1)], c[(1, 2)], c[(2, 2)]];
        let floats = [p.x, p.y, p.z].into_iter().chain(covariance).chain([n.x, n.y, n.z, self.confidence]);
        let mut bytes = [0; Self::BYTES];
        for (to, from) in bytes.chunks_exact_mut(4).zip(floats) {
            to.copy_from_slice(&from.to_le_bytes());
        }
        bytes[52..54].copy_from_slice(&self.pixel[0].to_le_bytes());
        bytes[54..56].copy_from_slice(&self.pixel[1].to_le_bytes());
        bytes[56..59].copy_from_slice(&self.colour);
        bytes
    }

    /// What [`Self::to_bytes`] wrote.
    pub fn from_bytes(bytes: &[u8; Self::BYTES]) -> CloudPoint {
        let f =
            |at: usize| f32::from_le_bytes([bytes[4 * at], bytes[4 * at + 1], bytes[4 * at + 2], bytes[4 * at + 3]]);
        let word = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
        CloudPoint {
            position: Point3::new(f(0), f(1), f(2)),
            covariance: Matrix3::new(f(3), f(4), f(5), f(4), f(6), f(7), f(5), f(7), f(8)),
            normal: Vector3::new(f(9), f(10), f(11)),
            confidence: f(12),
            pixel: [word(52), word(54)],
            colour: [bytes[56], bytes[57], bytes[58]],
        }
    }

    /// Standard deviation of the position: the root of the mean variance over the three axes [m].
    pub fn sigma(&self) -> f32 {
        (self.covariance.trace() / 3.0).max(0.0).sqrt()
    }
}

/// Where a camera stood.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Viewpoint {
    /// Takes points of the space that the message is in to that of the camera, whose z is its depth.
    #[serde(with = "Pose")]
    #[schemars(with = "Pose")]
    pub camera_from_space: Isometry3<f64>,
}

/// Points of surfaces as one camera saw them at one time.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct PointCloud {
    /// The time that all points are of.
    pub time: Time,
    /// The camera whose pixels they are of.
    pub camera: CameraId,
    /// Name of the set of pictures that they come from.
    pub name: String,
    /// Columns and rows of that camera [px].
    pub camera_size: [u32; 2],
    /// Where that camera stood; `None`: where the calibration says.
    pub viewpoint: Option<Viewpoint>,
    /// Mean of the points' standard deviations [m]; 0 without points.
    pub mean_sigma: f64,
    /// [`CloudPoint::BYTES`] bytes a point, ascending by row, then by column of its pixel.
    #[serde(skip)]
    pub points: Vec<u8>,
}

impl PointCloud {
    /// How many points there are.
    pub fn len(&self) -> usize {
        self.points.len() / CloudPoint::BYTES
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Adds a point.
    pub fn push(&mut self, point: &CloudPoint) {
        let n = self.len() as f64;
        self.mean_sigma = (self.mean_sigma * n + f64::from(point.sigma())) / (n + 1.0);
        self.points.extend(point.to_bytes());
    }

    /// All points in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = CloudPoint> + '_ {
        let (points, _) = self.points.as_chunks::<{ CloudPoint::BYTES }>();
        points.iter().map(CloudPoint::from_bytes)
    }
}

impl Message for PointCloud {
    const NAME: &'static str = "point_cloud";
    const SPACE: Space = Space::WORLD_POINTS;
    const WIRE: Wire = portable!(PointCloud);

    fn quality(&self) -> Quality {
        Quality { count: Some(self.len() as u32), sigma: (!self.is_empty()).then_some(self.mean_sigma) }
    }

    fn bulk(&self) -> &[u8] {
        &self.points
    }

    fn set_bulk(&mut self, bytes: Vec<u8>) {
        self.points = bytes;
    }
}

/// A point cloud in the space of its producer's scale, where it lies still however the scale's target moves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ScaleCloud {
    /// All of it in that space, its viewpoint too.
    pub cloud: PointCloud,
    /// Takes points of that space to the world (the outermost scale) at the cloud's time.
    #[serde(with = "Pose")]
    #[schemars(with = "Pose")]
    pub world_from_scale: Isometry3<f64>,
    /// Of δ in `world_from_scale` ∘ exp(δ), (rotation, translation) [rad², rad m, m²].
    #[schemars(with = "Numbers<36>")]
    pub covariance: Matrix6<f64>,
}

impl Message for ScaleCloud {
    const NAME: &'static str = "scale_cloud";
    const SPACE: Space = Space::POINTS;
    const WIRE: Wire = portable!(ScaleCloud);

    fn quality(&self) -> Quality {
        self.cloud.quality()
    }

    fn bulk(&self) -> &[u8] {
        &self.cloud.points
    }

    fn set_bulk(&mut self, bytes: Vec<u8>) {
        self.cloud.points = bytes;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_come_back_as_they_were_put_in() {
        let point = |x: f32| CloudPoint {
            position: Point3::new(x, -2.5, 3.25),
            covariance: Matrix3::new(4.0, 1.0, 0.5, 1.0, 5.0, 0.25, 0.5, 0.25, 6.0),
            normal: Vector3::y(),
            confidence: 0.75,
            pixel: [1279, 1023],
            colour: [1, 2, 255],
        };
        let mut cloud = PointCloud::default();
        assert!(cloud.is_empty() && cloud.quality().sigma.is_none());
        cloud.push(&point(1.0));
        cloud.push(&point(2.0));
        assert_eq!(cloud.iter().collect::<Vec<_>>(), [point(1.0), point(2.0)]);
        assert_eq!(cloud.quality().count, Some(2));
        assert!((cloud.mean_sigma - f64::from(point(1.0).sigma())).abs() < 1e-6);
    }
}
