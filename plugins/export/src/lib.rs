//! Results on disk: tables and pictures.
//!
//! | node | what it writes into the results folder |
//! |---|---|
//! | [`export.targets`](targets::ExportTargets) | `targets.csv`: time, target, position, covariance, cameras, how |
//! | [`export.features`](features::ExportFeatures) | `features.csv`: 2D detections, as `capture.detections` reads them |
//! | [`export.pictures`](pictures::ExportPictures) | paths from above and from the side, position and cameras over time, as SVG |
//! | [`export.marks`](marks::ExportMarks) | `marks.csv`: painted marks, in the space of the head and in the world |
//! | [`export.c3d`](c3d::ExportC3d) | `motion.c3d`: targets and marks at regular times, in millimetres of the world |
//! | [`export.trc`](trc::ExportTrc) | `motion.trc`: the same for OpenSim |
//! | [`export.npy`](npz::ExportNpy) | `motion.npz`: the same for NumPy, with covariances, cameras and how |
//! | [`export.mark_pictures`](mark_pictures::ExportMarkPictures) | the way of a painted surface, distances between its marks, what was filled in, as SVG |
//! | [`export.gltf`](gltf::ExportGltf) | `motion.glb`: targets, a mesh over the marks and cameras as an animated scene |
//! | [`export.bvh`](bvh::ExportBvh) | `motion.bvh`: the body that eight targets sit on, as a skeleton that moves |
//! | [`export.retarget`](retarget::ExportRetarget) | the motion of a body on another skeleton: a BVH or a GLB rig |
//! | [`export.bodies`](bodies::ExportBodies) | skeletons: `bodies.csv`, one BVH a body, skinned shapes as `bodies.glb` |
//! | [`export.tracked`](tracked::ExportTracked) | `tracked.csv`: followed points of a surface, with velocity, acceleration, and where trajectories end |
//! | [`export.cloud`](cloud::ExportCloud) | point clouds as PLY and GLB, and as range, normal and shaded pictures of their camera |
//! | [`export.surface`](surface::ExportSurface) | a surface as PLY and GLB, and as a range and a shaded picture |
//! | [`export.voxels`](voxels::ExportVoxels) | voxels as PLY and GLB |
//! | [`export.voxel_overlay`](voxel_overlay::ExportVoxelOverlay) | pictures of a camera with silhouettes and voxels drawn over them, as PNG |
//! | [`export.overlay`](overlay::ExportOverlay) | some pictures of a camera with the points ringed that were found in them, as PNG |
//!
//! Tables, C3D and TRC reach the disk while the run goes on, and are whole at any time. A disk that is full or a folder that cannot be written to loses nothing: rows
//! wait in memory, and lie in the system's folder for temporary files at the end, with an error that says where.

pub mod bodies;
pub mod bvh;
pub mod c3d;
pub mod cloud;
mod csv;
mod dots;
pub mod features;
mod figures;
mod frame_file;
mod gather;
pub mod gltf;
mod growing_file;
mod in_order;
pub mod mark_pictures;
pub mod marks;
pub mod npz;
pub mod overlay;
pub mod pictures;
pub mod retarget;
mod row_file;
pub mod surface;
mod target_rows;
pub mod targets;
mod time_base;
mod track_history;
pub mod tracked;
pub mod trc;
pub mod voxel_overlay;
pub mod voxels;
mod whole_file;

use foveate::prelude::Registry;

/// Makes the nodes of this plugin known.
pub fn register(registry: &mut Registry) {
    registry.add::<targets::ExportTargets>();
    registry.add::<features::ExportFeatures>();
    registry.add::<pictures::ExportPictures>();
    registry.add::<overlay::ExportOverlay>();
    registry.add::<voxels::ExportVoxels>();
    registry.add::<voxel_overlay::ExportVoxelOverlay>();
    registry.add::<mark_pictures::ExportMarkPictures>();
    registry.add::<marks::ExportMarks>();
    registry.add::<c3d::ExportC3d>();
    registry.add::<trc::ExportTrc>();
    registry.add::<npz::ExportNpy>();
    registry.add::<gltf::ExportGltf>();
    registry.add::<bvh::ExportBvh>();
    registry.add::<bodies::ExportBodies>();
    registry.add::<retarget::ExportRetarget>();
    registry.add::<cloud::ExportCloud>();
    registry.add::<surface::ExportSurface>();
    registry.add::<tracked::ExportTracked>();
}
