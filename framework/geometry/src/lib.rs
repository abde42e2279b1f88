//! Multi-view geometry: camera models, triangulation, resection, bundle adjustment, calibration, pan-tilt heads,
//! surfaces, voxels and bodies. Pure functions, without time and without I/O.
//!
//! | module | what it gives |
//! |---|---|
//! | [`agreement`] | consensus point of several observations, some of which may be wrong |
//! | [`alignment`] | best similarity or rigid transform between two sets of points, and the errors after it |
//! | [`alternating`] | calibration by alternating cameras and path, as first published (for comparison) |
//! | [`body`] | articulated bodies in voxels: detected, fitted, tracked |
//! | [`bundle`] | bundle adjustment of cameras and points, with clocks of cameras if wanted, with covariances |
//! | [`camera`] | [`Camera`]: pinhole with Brown–Conrady distortion; point to pixel, pixel to [`Ray`] |
//! | [`epipolar`] | relative pose of two cameras, from pixels of the same points |
//! | [`joint`] | many points triangulated together with small errors of the poses that they are seen from |
//! | [`metaball`] | bodies of metaballs on a skeleton, fitted to points, trajectories and silhouettes |
//! | [`resection`] | pose of a camera from known points and their pixels, robust, with covariance |
//! | [`known_points`] | optics and pose of a camera from one picture of a three-dimensional target |
//! | [`off_axis`] | off-axis frustums: what an eye sees through a screen |
//! | [`pan_tilt`] | cameras on pan-tilt heads: model, calibration, aiming, zoom |
//! | [`plane_map`] | map from a plane to a camera's image: homography and lens, with covariance |
//! | [`ray`] | [`Ray`], and the closest approach of two rays |
//! | [`self_calibration`] | calibration of a room of cameras from one waved light, without a start |
//! | [`shape_model`] | shapes that deform, such as a face or a knee: learnt from frames, fitted with the pose, hidden marks filled in |
//! | [`surface`] | point clouds registered, fused into a distance field, and meshed |
//! | [`voxels`] | visual hulls from silhouettes: carved by octree, with surface, components and colours |
//! | [`triangulate`] | a point from two or more rays, refined on pixels, with covariance |
//!
//! Rigid transforms are `nalgebra::Isometry3<f64>`, named `b_from_a`. The world is right-handed with Z up; a
//! camera looks along its +z, with +x to the right and +y down; pixel (0, 0) is the centre of the top-left pixel.

pub mod agreement;
pub mod alignment;
pub mod alternating;
pub mod body;
pub mod bundle;
pub mod camera;
mod distortion;
pub mod epipolar;
mod from_matrix;
pub mod joint;
pub mod known_points;
mod look_at;
pub mod metaball;
pub mod off_axis;
pub mod pan_tilt;
pub mod plane_map;
pub mod ray;
pub mod resection;
pub mod self_calibration;
pub mod shape_model;
pub mod surface;
pub mod triangulate;
pub mod voxels;

pub use agreement::{Agreement, agreeing_point};
pub use alignment::{Alignment, AlignmentError, AlignmentOptions, CameraErrors, align, camera_errors};
pub use alternating::{Alternated, alternate, path_error};
pub use bundle::{
    Adjusted, BundleError, BundleOptions, Freedom, Gauge, Known, KnownLength, Observation, Optic, OpticsPrior, adjust,
    adjust_knowing, adjust_with_clocks,
};
pub use camera::{Camera, CameraError, Distortion, Intrinsics};
pub use epipolar::{EpipolarError, EpipolarOptions, TwoViews, relative_pose};
pub use from_matrix::ProjectionError;
pub use joint::{Joint, JointError, JointObservation, JointOptions, JointPoint, Viewpoint, triangulate_jointly};
pub use known_points::{CameraFit, KnownPoint, KnownPointsError, camera_from_points, direct_linear_transformation};
pub use off_axis::{OffAxis, Screen, ScreenError};
pub use plane_map::{Placed, PlaneMap, PlaneMapError, PlanePoint};
pub use ray::{Approach, Ray, closest_approach};
pub use resection::{Resection, ResectionError, ResectionOptions, refine_pose, resect};
pub use self_calibration::{
    CameraStatus, HeldReason, LightObservation, OpticHeld, SelfCalibration, SelfCalibrationError,
    SelfCalibrationOptions, self_calibrate,
};
pub use shape_model::{
    AcquisitionError, AcquisitionOptions, Bases, FitOptions, FittedShape, MarkObservation, ShapeError, ShapeFitter,
    ShapeKind, ShapeModel, acquire,
};
pub use triangulate::{PixelNoise, Triangulation, TriangulationError, refine, triangulate_rays};

#[cfg(test)]
mod test_room;

/// A rigid transform, always named `b_from_a`: rotation, then translation [m].
pub type Pose = nalgebra::Isometry3<f64>;
