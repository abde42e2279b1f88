//! The values that travel on edges, each with a name and a version: public fields, no algorithms.
//!
//! | type | what it is | coordinates |
//! |---|---|---|
//! | [`Image`] | one picture of one camera, or a part of one | pixels of that camera |
//! | [`Features`] | the 2D points found in one picture | pixels of that camera |
//! | [`Targets`] | the 3D points recovered at one scale | metres in that scale's space |
//! | [`SubRegion`] | the moving volume that the next scale looks into | metres in the parent scale's space, which its scale's nodes know |
//! | [`ScaleSpace`] | where the space of an anchored scale is | – |
//! | [`Assignment`] | which head follows which target | – |
//! | [`CameraChoice`] | which fixed cameras are worth processing | – |
//! | [`HeadCommand`] | what a pan-tilt head should do | angles of its axes |
//! | [`HeadReport`] | what it was told and what it said | angles of its axes |
//! | [`HeadPose`] | where its camera stood at one moment | – |
//! | [`Marks`] | painted marks of one surface at one time | metres in a space of their own |
//! | [`MarkGuide`] | where each camera should see each mark | pixels, camera by camera |

mod camera_set;
mod features;
mod head;
mod image;
mod marks;
mod sub_region;
mod targets;

use std::any::Any;

pub use camera_set::{CameraChoice, CameraId, CameraSet};
pub use features::{Feature, Features};
pub use foveate_time::{Interval, SourceId, Stamp, Stamped, Time};
pub use head::{HeadCommand, HeadEvent, HeadLink, HeadOrder, HeadPose, HeadPosition, HeadReport};
pub use image::{Image, PixelFormat, Window};
pub use marks::{GuidedMark, Mark, MarkGuide, Marks, ShapeFit};
pub use sub_region::{Assignment, ScaleId, ScaleSpace, SubRegion};
pub use targets::{How, Target, TargetId, Targets};

/// A type that may travel on an edge.
pub trait Message: Any + Send + Sync {
    /// Name in rigs, errors and recordings, lower case.
    const NAME: &'static str;
    /// Raised when the meaning or the layout of the fields changes.
    const VERSION: u32 = 1;
    /// Whose coordinates the payload is in; edges that would mix them are refused before a run.
    const SPACE: SpaceKind;

    /// What the payload can state about itself, for the ledger.
    fn quality(&self) -> Quality {
        Quality::default()
    }
}

/// Whose coordinates a message is in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SpaceKind {
    /// Holds no coordinates.
    None,
    /// Pixels of one camera, or angles of the head that carries it.
    CameraPixels,
    /// Metres in the space of one scale.
    ScalePoints,
}

/// What a payload states about itself, for the ledger.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Quality {
    /// How many things it holds (features, targets).
    pub count: Option<u32>,
    /// Standard deviation of what it holds, in the payload's own unit (px or m): the mean over its items.
    pub sigma: Option<f64>,
}
