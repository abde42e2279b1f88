//! What authors of nodes depend on: the rooms re-exported, and a prelude. No code of its own.
//! Programs that run rigs depend on `foveate-embed` besides.

pub use foveate_boundary::plugin;
pub use foveate_diagnostics as diagnostics;
pub use foveate_estimation as estimation;
pub use foveate_geometry as geometry;
pub use foveate_imaging as imaging;
pub use foveate_messages as messages;
pub use foveate_motion as motion;
pub use foveate_node as node;
pub use foveate_plot as plot;
pub use foveate_scene as scene;
pub use foveate_time as time;

/// What nearly every node file needs.
pub mod prelude {
    pub use foveate_messages::{
        Assignment, BODY_JOINTS, BODY_LIMBS, BODY_PARTS, CameraChoice, CameraId, CameraSet, CloudPoint, Contested,
        Exchange, EyeView, Feature, Features, HeadCommand, HeadEvent, HeadLink, HeadOrder, HeadPose, HeadPosition,
        HeadReport, Image, LimbDetail, Mark, MarkGuide, Marks, Mesh, MeshVertex, PatternPictures, PatternShown,
        PixelFormat, PointCloud, Pointer, PointerChange, PointerEvent, Pointers, ProjectorMap, ProjectorSample,
        Provenance, ScaleCloud, ScaleSpace, Silhouette, SilhouetteStatus, Skeleton, SkeletonJoint, SkeletonPart,
        Skeletons, StrokePoint, SubRegion, Target, TargetId, TargetUser, Targets, TileView, TrackedPoint,
        TrackedSurface, TrajectoryEnd, Unmodelled, Users, ViewStatus, Viewpoint, Views, Voxel, VoxelComponent,
        VoxelView, Voxels,
    };
    pub use foveate_node::{
        ConfigError, Due, Figures, In, Interval, Io, Message, Node, NodeBench, NodeError, Out, Plan, Pool, Ports,
        Purpose, Registry, Report, Role, Setup, Stamp, Stamped, Time, figures, ports,
    };
    pub use foveate_scene::CalibratedHead;
}
