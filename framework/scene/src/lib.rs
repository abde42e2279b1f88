//! Where things are: calibrated cameras by name, the tree of spaces over time, working volumes.
//!
//! | module | what it gives |
//! |---|---|
//! | [`anchor`] | [`Anchor`]: which target carries the space of a scale, and whether it is lost |
//! | [`calibration`] | [`Calibration`]: the cameras of a rig, read from a file of ours, of Pose2Sim, or from MultiCamSelfCal's results |
//! | [`clocks`] | [`Clocks`]: how each camera's clock runs against the session's |
//! | [`draft`] | [`Draft`]: an incomplete calibration, the input of calibrating |
//! | [`formats`] | [`Format`]: calibrations of other programs, read and written |
//! | [`heads`] | [`Heads`]: pan-tilt heads, with their axes, limits and units |
//! | [`shape_file`] | models of shapes that deform, read and written |
//! | [`skeleton`] | skeletons that move, as BVH files hold them |
//! | [`space`] | [`SceneGraph`]: nested spaces, each with a pose that may change, and `a_from_b` at a time with its covariance |
//! | [`uncertainty`] | [`CameraUncertainty`], [`Provenance`]: how well a calibration is known, and how it was made |
//! | [`wall`] | [`WallMap`]: a wall of displays, and how each camera images it |
//! | [`volume`] | [`WorkingVolume`]: the box in which a scale works |
//!
//! Times are `i64` nanoseconds of the session clock: this room does not know the messages.

pub mod anchor;
pub mod calibration;
mod calibration_file;
pub mod clocks;
pub mod draft;
mod error;
pub mod formats;
pub mod heads;
mod multi_cam_self_cal;
mod natural_order;
mod pose2sim;
pub mod selection;
pub mod shape_file;
mod shared_lens;
pub mod skeleton;
pub mod space;
mod text;
mod toml_reader;
mod uncertain_pose;
pub mod uncertainty;
pub mod volume;
pub mod wall;

pub use anchor::{Anchor, AnchorRule, AnchorState, Pick, TargetObservation};
pub use calibration::{Calibration, LengthUnit, NamedCamera};
pub use clocks::{CameraClock, Clocks};
pub use draft::{Draft, Unknown};
pub use error::{CalibrationDiagnostic, CalibrationError};
pub use formats::{CALIBRATION_FORMS, DltOrigin, Export, ExportContent, Format, ImportOptions};
pub use heads::{CalibratedHead, Head, Heads};
pub use natural_order::natural_order;
pub use shape_file::{load_shape_model, parse_shape_model, shape_model_to_toml};
pub use space::{SceneError, SceneGraph, SpaceId};
pub use uncertain_pose::UncertainPose;
pub use uncertainty::{CameraUncertainty, Fixed, Provenance, Uncertainties};
pub use volume::WorkingVolume;
pub use wall::{WallCamera, WallMap};
