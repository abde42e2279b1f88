//! Our messages as messages of the public `foxglove.*` schemas, in Protocol Buffers: a recorded MCAP file opens in viewers as it is.
//!
//! | of ours | becomes | by |
//! |---|---|---|
//! | picture | `RawImage`, `CompressedImage`; both come back as they were | [`raw_image`], [`compressed_image`], [`read_raw_image`], [`read_compressed_image`] |
//! | calibrated camera | `CameraCalibration` | [`camera_calibration`] |
//! | features | `ImageAnnotations` | [`features`] |
//! | poses of cameras and scales | `FrameTransforms` | [`transforms`], [`head_pose`], [`scale_space`] |
//! | targets, marks | `PointCloud`, `PosesInFrame`, `SceneUpdate` | [`targets_cloud`], [`targets_poses`], [`targets_scene`], [`marks_cloud`], [`marks_poses`], [`marks_scene`] |
//! | tracked surface, clouds | `PointCloud` | [`tracked_cloud`], [`cloud`], [`scale_cloud`] |
//! | mesh, skeletons | `SceneUpdate` | [`mesh`], [`skeletons`] |
//! | log line, figures | `Log`, `foveate.Figures` | [`log_line`], [`figures`] |
//!
//! Every encoder replaces what is in `out` and keeps its memory. [`Kind::schema`] describes each kind for the file. Times are those of the session.
//!
//! The caller names the frames. A transform of a `child` in a `parent` is our `parent_from_child`: a point's coordinates in the parent are rotation · point + translation.
//! The frame of a camera is x right, y down, z forward, as in docs/notation.md.
//!
//! A scene is one entity of a fixed name: the next update of that name replaces it, also an empty one.
//!
//! `rerun mcap convert` 0.41 makes pictures, lenses, transforms, clouds, poses and log lines its own; it keeps `SceneUpdate`, `ImageAnnotations` and `foveate.Figures`
//! as tables, which are not drawn.

mod annotations;
#[cfg(test)]
mod decoded;
mod descriptor;
mod picture;
mod place;
mod points;
mod scene;
mod schemas;
mod shift;
mod text;
mod wire;

pub use annotations::features;
pub use descriptor::{Kind, Schema};
pub use picture::{PictureHeader, RecordedPicture, compressed_image, raw_image, read_compressed_image, read_raw_image};
pub use place::{CameraModel, Transform, camera_calibration, head_pose, scale_space, transforms};
pub use points::{cloud, marks_cloud, marks_poses, scale_cloud, targets_cloud, targets_poses, tracked_cloud};
pub use scene::{marks_scene, mesh, skeletons, targets_scene};
pub use shift::shifted;
pub use text::{LogLevel, figures, log_line};
