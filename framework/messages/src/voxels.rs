//! The part of a volume that silhouettes leave over, in cubes.

use nalgebra::{Isometry3, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::schema::{Numbers, Pose};
use crate::wire::portable;
use crate::{CameraId, Message, Quality, Space, TargetId, Time, Wire};

/// One cube that may be body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Voxel {
    /// Its place in the grid along x, y, z.
    pub index: [u16; 3],
    /// Red, green, blue as the cameras that see it free see it; black where none does [gray level, 0..=255].
    pub colour: [u8; 3],
    /// Whether one of its six neighbours is empty or lies outside the grid.
    pub is_surface: bool,
    /// Views in whose picture its centre lies.
    pub seen: u8,
    /// Of these, how many call it background: as many as are allowed to err, at most.
    pub dissent: u8,
    /// Which of [`Voxels::components`] it belongs to.
    pub component: u16,
}

impl Voxel {
    /// Bytes of a voxel in [`Voxels::voxels`].
    pub const BYTES: usize = 14;

    /// Little endian: index and component as 16-bit words; colour, views that saw it, views that dissent, 1 for surface.
    pub fn to_bytes(&self) -> [u8; Self::BYTES] {
        let [x, y, z] = self.index.map(u16::to_le_bytes);
        let (c, [r, g, b]) = (self.component.to_le_bytes(), self.colour);
        let surface = u8::from(self.is_surface);
        [x[0], x[1], y[0], y[1], z[0], z[1], c[0], c[1], r, g, b, self.seen, self.dissent, surface]
    }

    /// What [`Self::to_bytes`] wrote.
    pub fn from_bytes(bytes: &[u8; Self::BYTES]) -> Voxel {
        let word = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
        Voxel {
            index: [word(0), word(2), word(4)],
            component: word(6),
            colour: [bytes[8], bytes[9], bytes[10]],
            seen: bytes[11],
            dissent: bytes[12],
            is_surface: bytes[13] != 0,
        }
    }
}

/// What became of one camera's view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ViewStatus {
    /// It carved.
    Used,
    /// No silhouette came for this time.
    Missing,
    /// Its background is still being learnt.
    Learning,
    /// It sees no body where others do: left out.
    Empty,
    /// Its silhouette fills the picture: left out.
    Full,
    /// The camera was moved, as its silhouette says: left out.
    Moved,
    /// It contradicts the others, as a camera does that was moved or that is not where its calibration says: left out.
    Contradicts,
    /// Where it stood at this time is not known (a pan-tilt head without a pose): left out.
    Unplaced,
    /// None of the volume lies in its picture.
    OutOfView,
}

/// What one camera contributed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct VoxelView {
    /// The camera.
    pub camera: CameraId,
    /// What became of its view.
    pub status: ViewStatus,
    /// Pixels of body in its silhouette [px].
    pub body_px: u32,
    /// Of these, the part that the voxels cover: below 1 where other views carved too much, or where the body leaves the volume; 0 without any [–].
    pub covered: f64,
    /// The part of the voxels' projection that its silhouette calls background: above 0 where it was left out or allowed to err [–].
    pub outside: f64,
}

/// Connected voxels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct VoxelComponent {
    /// How many there are.
    pub n_voxels: u32,
    /// Mean of their centres, in the space of the producer's scale [m].
    #[schemars(with = "Numbers<3>")]
    pub centroid: Point3<f64>,
    /// Smallest index along x, y, z.
    pub min: [u16; 3],
    /// Largest index along x, y, z.
    pub max: [u16; 3],
    /// Whether it reaches an end of the grid, beyond which it may go on; the lowest layer does not count, since that is the floor.
    pub is_cut_off: bool,
    /// The target that lies in it or next to it, if there is one.
    pub target: Option<TargetId>,
}

/// A block of space that views disagree on: many of them show body there, of which several have no voxel behind it, and others call it background.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Contested {
    /// Mean of the contested places, in the space of the producer's scale [m].
    #[schemars(with = "Numbers<3>")]
    pub centroid: Point3<f64>,
    /// What they hold together [m³].
    pub volume: f64,
}

/// The cubes of a grid that may be body at one time: those that no more views than allowed call background.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Voxels {
    /// The time that all silhouettes are of.
    pub time: Time,
    /// Edge of a cube [m].
    pub size: f64,
    /// The corner of cube (0, 0, 0) that is least in x, y and z, in the space of the producer's scale [m].
    #[schemars(with = "Numbers<3>")]
    pub origin: Point3<f64>,
    /// Cubes along x, y, z.
    pub cells: [u32; 3],
    /// Takes points of the producer's scale to the world (the outermost scale) at `time`.
    #[serde(with = "Pose")]
    #[schemars(with = "Pose")]
    pub world_from_scale: Isometry3<f64>,
    /// What each camera contributed, ascending by camera.
    pub views: Vec<VoxelView>,
    /// Connected voxels, the largest first.
    pub components: Vec<VoxelComponent>,
    /// Where silhouettes contradict each other: body pixels without a voxel behind them, in blocks of a decimetre or so, ascending by z, y, x. None where they are consistent.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub contested: Vec<Contested>,
    /// [`Voxel::BYTES`] bytes a voxel, ascending by z, then y, then x.
    #[serde(skip)]
    pub voxels: Vec<u8>,
}

impl Default for Voxels {
    /// None, in a grid of no cells of 1 m.
    fn default() -> Self {
        Voxels {
            time: Time::ZERO,
            size: 1.0,
            origin: Point3::origin(),
            cells: [0; 3],
            world_from_scale: Isometry3::identity(),
            views: Vec::new(),
            components: Vec::new(),
            contested: Vec::new(),
            voxels: Vec::new(),
        }
    }
}

impl Voxels {
    /// How many voxels there are.
    pub fn len(&self) -> usize {
        self.voxels.len() / Voxel::BYTES
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Adds a voxel.
    pub fn push(&mut self, voxel: &Voxel) {
        self.voxels.extend(voxel.to_bytes());
    }

    /// All voxels in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Voxel> + '_ {
        let (voxels, _) = self.voxels.as_chunks::<{ Voxel::BYTES }>();
        voxels.iter().map(Voxel::from_bytes)
    }

    /// The centre of the cube at `index`, in the space of the producer's scale [m].
    pub fn centre(&self, index: [u16; 3]) -> Point3<f64> {
        self.origin + Vector3::from(index.map(|it| f64::from(it) + 0.5)) * self.size
    }

    /// What all cubes hold together [m³].
    pub fn volume(&self) -> f64 {
        self.len() as f64 * self.size.powi(3)
    }
}

impl Message for Voxels {
    const NAME: &'static str = "voxels";
    const SPACE: Space = Space::POINTS;
    const WIRE: Wire = portable!(Voxels);

    fn quality(&self) -> Quality {
        // A surface lies anywhere in its cube: a uniform distribution.
        Quality { count: Some(self.len() as u32), sigma: (!self.is_empty()).then_some(self.size / 12f64.sqrt()) }
    }

    fn bulk(&self) -> &[u8] {
        &self.voxels
    }

    fn set_bulk(&mut self, bytes: Vec<u8>) {
        self.voxels = bytes;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn voxels_come_back_as_they_were_put_in() {
        let voxel = |x: u16| Voxel {
            index: [x, 300, 65535],
            colour: [1, 2, 255],
            is_surface: x == 1,
            seen: 20,
            dissent: 2,
            component: 259,
        };
        let mut voxels = Voxels { size: 0.01, origin: Point3::new(-1.0, 0.0, 1.0), ..Voxels::default() };
        assert!(voxels.is_empty() && voxels.quality().sigma.is_none());
        voxels.push(&voxel(1));
        voxels.push(&voxel(2));
        assert_eq!(voxels.iter().collect::<Vec<_>>(), [voxel(1), voxel(2)]);
        assert_eq!(voxels.quality().count, Some(2));
        assert!((voxels.volume() - 2e-6).abs() < 1e-15);
        assert!((voxels.centre([0, 1, 100]) - Point3::new(-0.995, 0.015, 2.005)).norm() < 1e-12);
    }
}
