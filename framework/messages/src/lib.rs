//! The values that travel on edges, each with a name and a version: public fields, no algorithms.
//!
//! | type | what it is | coordinates |
//! |---|---|---|
//! | [`Image`] | one picture of one camera, or a part of one | pixels of that camera |
//! | [`Features`] | the 2D points found in one picture | pixels of that camera |
//! | [`Targets`] | the 3D points recovered at one scale | metres in that scale's space |
//! | [`Pointers`] | the pointers on a wall and their events | metres in that scale's space; the wall is z = 0 |
//! | [`Users`] | the user of each target, where something identifies users | – |
//! | [`SubRegion`] | the moving volume that the next scale looks into | metres in the parent scale's space, which its scale's nodes know |
//! | [`ScaleSpace`] | where the space of an anchored scale is | metres in the parent of the scale that it names |
//! | [`Assignment`] | which head follows which target | – |
//! | [`CameraChoice`] | which fixed cameras are worth processing | – |
//! | [`HeadCommand`] | what a pan-tilt head should do | angles of its axes |
//! | [`HeadReport`] | commands sent to a head and its answers | angles of its axes |
//! | [`HeadPose`] | where its camera stood at one moment | – |
//! | [`Marks`] | painted marks of one surface at one time | metres in a space of their own, whose place in the outermost scale they say |
//! | [`MarkGuide`] | where each camera should see each mark | pixels, camera by camera |
//! | [`PatternPictures`] | the pictures of one set of projected patterns | pixels of that camera |
//! | [`PatternShown`] | what a projector was commanded to show, and when | – |
//! | [`ProjectorMap`] | where in the projector each pixel is lit from | pixels of that camera, and of the projector |
//! | [`PointCloud`] | points of surfaces, each with covariance and normal | metres in the outermost scale |
//! | [`ScaleCloud`] | the same where it lies still, on a target that moves | metres in that scale's space |
//! | [`Views`] | what a display shows to a moving viewer, for each eye and tile | metres in that scale's space |
//! | [`Mesh`] | a surface joined from clouds, as triangles | metres in that scale's space |
//! | [`TrackedSurface`] | points of a surface, each followed over time | metres in the outermost scale |
//! | [`Silhouette`] | which pixels of a picture show a body, and how surely | pixels of that camera |
//! | [`Voxels`] | the cubes that silhouettes leave over | metres in that scale's space |
//! | [`Skeletons`] | bodies as parts and joints | metres in that scale's space |

mod camera_set;
mod cloud;
mod features;
mod head;
mod image;
mod marks;
mod mesh;
mod pointers;
mod schema;
mod shown;
mod silhouette;
mod skeletons;
mod stripes;
mod sub_region;
mod targets;
mod tracked;
mod users;
mod views;
mod voxels;
mod wire;

use std::any::Any;

pub use camera_set::{CameraChoice, CameraId, CameraSet};
pub use cloud::{CloudPoint, PointCloud, ScaleCloud, Viewpoint};
pub use features::{Feature, Features};
pub use foveate_time::{Interval, SourceId, Stamp, Stamped, Time};
pub use head::{HeadCommand, HeadEvent, HeadLink, HeadOrder, HeadPose, HeadPosition, HeadReport};
pub use image::{Image, PixelFormat, Window};
pub use marks::{GuidedMark, Mark, MarkGuide, Marks, ShapeFit};
pub use mesh::{Mesh, MeshVertex};
pub use pointers::{Pointer, PointerChange, PointerEvent, Pointers, StrokePoint};
pub use shown::PatternShown;
pub use silhouette::{Silhouette, SilhouetteStatus};
pub use skeletons::{
    BODY_JOINTS, BODY_LIMBS, BODY_PARTS, LimbDetail, Skeleton, SkeletonJoint, SkeletonPart, Skeletons, Unmodelled,
};
pub use stripes::{PatternPictures, ProjectorMap, ProjectorSample};
pub use sub_region::{Assignment, ScaleId, ScaleSpace, SubRegion};
pub use targets::{Provenance, Target, TargetId, Targets};
pub use tracked::{TrackedPoint, TrackedSurface, TrajectoryEnd};
pub use users::{Exchange, TargetUser, Users};
pub use views::{EyeView, TileView, Views};
pub use voxels::{Contested, ViewStatus, Voxel, VoxelComponent, VoxelView, Voxels};
pub use wire::{Codec, Wire};

/// A type that may travel on an edge: a contract of name, version, space and layout.
pub trait Message: Any + Send + Sync {
    /// Name in rigs, errors and recordings, lower case.
    const NAME: &'static str;
    /// Raised when the meaning or the layout of the fields changes.
    const VERSION: u32 = 1;
    /// The space of the payload's coordinates; edges that would mix spaces are refused before a run.
    const SPACE: Space;
    /// Whether and how it is recorded and sent.
    const WIRE: Wire;

    /// Count and standard deviation of the payload, for the ledger.
    fn quality(&self) -> Quality {
        Quality::default()
    }

    /// What is large, such as pixels: recorded and shared as it is, beside the rest.
    fn bulk(&self) -> &[u8] {
        &[]
    }

    /// Takes back what [`Message::bulk`] gave. Messages without bulk data leave it.
    fn set_bulk(&mut self, _bytes: Vec<u8>) {}
}

/// The space of a message's coordinates, the number of coordinates of a point, and their unit. Open: a plugin adds spaces of its own, such as pixels of a
/// projector.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Space {
    /// Owner of the space.
    pub owner: SpaceOwner,
    /// Coordinates of a point; 0 without any.
    pub dimension: u8,
    /// Their unit, empty without any.
    pub unit: &'static str,
}

/// Owner of a coordinate space: both ends of an edge must have the same one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SpaceOwner {
    /// None: it holds no coordinates.
    Nobody,
    /// One camera's, or the head's that carries it: stays with nodes of that camera.
    Camera,
    /// Several cameras', each named in the message.
    EachCamera,
    /// The producer's scale.
    Scale,
    /// The scale around the producer's.
    ParentScale,
    /// The outermost scale around the producer's.
    World,
    /// The message names its scale itself.
    Stated,
    /// That of something else, by its name, such as `projector`: any edge may carry it.
    Other(&'static str),
}

impl Space {
    /// Holds no coordinates.
    pub const NONE: Space = Space { owner: SpaceOwner::Nobody, dimension: 0, unit: "" };
    /// Raw pixels of one camera.
    pub const PIXELS: Space = Space { owner: SpaceOwner::Camera, dimension: 2, unit: "px" };
    /// Raw pixels of several cameras, camera by camera.
    pub const PIXELS_OF_EACH: Space = Space { owner: SpaceOwner::EachCamera, dimension: 2, unit: "px" };
    /// Pan and tilt of the head that carries a camera.
    pub const HEAD_ANGLES: Space = Space { owner: SpaceOwner::Camera, dimension: 2, unit: "rad" };
    /// Points in the space of the producer's scale.
    pub const POINTS: Space = Space { owner: SpaceOwner::Scale, dimension: 3, unit: "m" };
    /// Points in the space around that of the producer's scale.
    pub const PARENT_POINTS: Space = Space { owner: SpaceOwner::ParentScale, dimension: 3, unit: "m" };
    /// Points in the space of the outermost scale around the producer's.
    pub const WORLD_POINTS: Space = Space { owner: SpaceOwner::World, dimension: 3, unit: "m" };
    /// Points in a space that the message names.
    pub const STATED: Space = Space { owner: SpaceOwner::Stated, dimension: 3, unit: "m" };

    /// For people: "px of one camera".
    pub fn in_words(&self) -> String {
        let whose = match self.owner {
            SpaceOwner::Nobody => return "no coordinates".to_owned(),
            SpaceOwner::Camera => "of one camera",
            SpaceOwner::EachCamera => "of each camera that it names",
            SpaceOwner::Scale => "in its scale",
            SpaceOwner::ParentScale => "in the scale around its own",
            SpaceOwner::World => "in the outermost scale",
            SpaceOwner::Stated => "in the scale that it names",
            SpaceOwner::Other(name) => return format!("{} of {name}", self.unit),
        };
        format!("{} {whose}", self.unit)
    }
}

/// Count and standard deviation of a payload, for the ledger.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Quality {
    /// How many things it holds (features, targets).
    pub count: Option<u32>,
    /// Standard deviation of what it holds, in the payload's own unit (px or m): the mean over its items.
    pub sigma: Option<f64>,
}
