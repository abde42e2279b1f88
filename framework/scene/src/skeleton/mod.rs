//! Skeletons that move: joints with offsets and channels as BVH has them, their poses, reading and writing.
//!
//! | here | meaning | unit |
//! |---|---|---|
//! | [`Joint::offset`] | from the parent's origin, along the parent's axes | the file's |
//! | channels | positions are added to the offset; rotations are multiplied in the order in which they stand: `Zrotation Yrotation Xrotation` is Rz Ry Rx | the file's, degrees |
//! | poses | product of offset and channels from the root on | m |
//!
//! Values stay as the file has them, so that reading and writing again loses nothing. BVH usually has y up, and no unit: the caller of the poses states how
//! many metres one unit is ([`CMU_UNIT_M`] for the recordings of Carnegie Mellon University).

mod read;
pub mod retarget;
#[cfg(test)]
mod tests;
mod write;

use std::fmt;

use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// The unit of BVH files made from the CMU motion capture database: an inch over 0.45 [m].
pub const CMU_UNIT_M: f64 = 0.0254 / 0.45;

/// Takes BVH's axes (y up, z to the front) to ours (z up): (x, y, z) ↦ (z, x, y), so that what looks along z there looks along x here, x to the left
/// there is y here.
pub fn z_up_from_y_up() -> UnitQuaternion<f64> {
    let columns = nalgebra::Matrix3::new(0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(columns))
}

/// One of three.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axis {
    /// The first.
    X,
    /// The second.
    Y,
    /// The third.
    Z,
}

impl Axis {
    /// Its number.
    pub const fn index(self) -> usize {
        self as usize
    }

    fn unit(self) -> nalgebra::Unit<Vector3<f64>> {
        match self {
            Axis::X => Vector3::x_axis(),
            Axis::Y => Vector3::y_axis(),
            Axis::Z => Vector3::z_axis(),
        }
    }
}

/// What one number of a frame does to its joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channel {
    /// Shifts it along an axis of its parent.
    Position(Axis),
    /// Turns it about an axis [°].
    Rotation(Axis),
}

/// One joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Its name.
    pub name: String,
    /// The joint that it hangs on, which stands before it; `None` for the root.
    pub parent: Option<usize>,
    /// From the parent's origin.
    pub offset: Vector3<f64>,
    /// In the order of the numbers of a frame.
    pub channels: Vec<Channel>,
    /// Where a limb without a further joint ends, along the joint's axes.
    pub end: Option<Vector3<f64>>,
}

/// A skeleton and how it moved.
#[derive(Debug, Clone, PartialEq)]
pub struct SkeletonMotion {
    /// The root first, parents before children.
    pub joints: Vec<Joint>,
    /// Between one frame and the next [s].
    pub frame_s: f64,
    /// Frame by frame the numbers of all channels, joint by joint.
    pub values: Vec<f64>,
}

impl SkeletonMotion {
    /// Numbers in a frame.
    pub fn n_channels(&self) -> usize {
        self.joints.iter().map(|it| it.channels.len()).sum()
    }

    /// How many frames there are.
    pub fn n_frames(&self) -> usize {
        self.values.len().checked_div(self.n_channels()).unwrap_or(0)
    }

    /// The numbers of a frame, counted from 0; `None` behind the last.
    pub fn frame(&self, frame: usize) -> Option<&[f64]> {
        let n_channels = self.n_channels();
        self.values.get(frame * n_channels..(frame + 1) * n_channels).filter(|it| !it.is_empty())
    }

    /// The joint of this name, whatever stands before a `:` in the file's names.
    pub fn joint(&self, name: &str) -> Option<usize> {
        self.joints.iter().position(|it| it.name.rsplit(':').next() == Some(name))
    }

    /// For each joint `world_from_joint` at a frame in the file's axes, a file's unit being `unit_m` metres; `None` behind the last frame.
    pub fn poses(&self, frame: usize, unit_m: f64) -> Option<Vec<Isometry3<f64>>> {
        let mut values = self.frame(frame)?.iter();
        let mut poses: Vec<Isometry3<f64>> = Vec::with_capacity(self.joints.len());
        for joint in &self.joints {
            let mut shift = joint.offset;
            let mut rotation = UnitQuaternion::identity();
            for (channel, value) in joint.channels.iter().zip(&mut values) {
                match channel {
                    Channel::Position(axis) => shift[axis.index()] += value,
                    Channel::Rotation(axis) => {
                        rotation *= UnitQuaternion::from_axis_angle(&axis.unit(), value.to_radians());
                    }
                }
            }
            let parent_from_joint = Isometry3::from_parts(Translation3::from(shift * unit_m), rotation);
            poses
                .push(joint.parent.and_then(|it| poses.get(it)).map_or(parent_from_joint, |it| it * parent_from_joint));
        }
        Some(poses)
    }
}

/// The angles [rad] about three different axes, in this order, whose turns make up `rotation`: R = Ra(α) Rb(β) Rc(γ), |β| ≤ π/2. Where β is a right
/// angle only α ± γ is fixed, and γ is 0.
pub fn euler_angles(rotation: &Rotation3<f64>, [a, b, c]: [Axis; 3]) -> [f64; 3] {
    let [i, j, k] = [a, b, c].map(Axis::index);
    // +1 where the axes follow each other as x, y, z do.
    let sign = if (i + 1) % 3 == j { 1.0 } else { -1.0 };
    let sine = (sign * rotation[(i, k)]).clamp(-1.0, 1.0);
    // Less than 1e-7 rad from a right angle the other two are rounding.
    if 1.0 - sine.abs() < 1e-14 {
        return [(sign * rotation[(k, j)]).atan2(rotation[(j, j)]), sine.asin(), 0.0];
    }
    [
        (-sign * rotation[(j, k)]).atan2(rotation[(k, k)]),
        sine.asin(),
        (-sign * rotation[(i, j)]).atan2(rotation[(i, i)]),
    ]
}

/// What is wrong with a BVH file, and where.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BvhError {
    /// The line, counted from 1.
    pub line: usize,
    /// What is there.
    pub found: String,
    /// What should be.
    pub expected: String,
}

impl fmt::Display for BvhError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}: found {}, expected {}", self.line, self.found, self.expected)
    }
}

impl std::error::Error for BvhError {}
