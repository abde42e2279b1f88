//! Results on disk: tables and pictures.
//!
//! | node | what it writes into the results folder |
//! |---|---|
//! | [`export.targets`](targets::ExportTargets) | `targets.csv`: time, target, position, covariance, cameras, provenance |
//! | [`export.features`](features::ExportFeatures) | `features.csv`: 2D detections, as `capture.detections` reads them |
//! | [`export.pictures`](pictures::ExportPictures) | paths from above and from the side, position and cameras over time, as SVG |
//! | [`export.marks`](marks::ExportMarks) | `marks.csv`: painted marks, in the space of the head and in the world |
//! | [`export.c3d`](c3d::ExportC3d) | `motion.c3d`: targets and marks at regular times, in millimetres of the world |
//! | [`export.trc`](trc::ExportTrc) | `motion.trc`: the same for OpenSim |
//! | [`export.npy`](npz::ExportNpy) | `motion.npz`: the same for NumPy, with covariances, cameras and provenance |
//! | [`export.mark_pictures`](mark_pictures::ExportMarkPictures) | the path of a painted surface, distances between its marks, and which were filled in, as SVG |
//! | [`export.gltf`](gltf::ExportGltf) | `motion.glb`: targets, a mesh over the marks and cameras as an animated scene |
//! | [`export.bvh`](bvh::ExportBvh) | `motion.bvh`: the body of eight targets as an animated skeleton |
//! | [`export.retarget`](retarget::ExportRetarget) | the motion of a body on another skeleton: a BVH or a GLB rig |
//! | [`export.bodies`](bodies::ExportBodies) | skeletons: `bodies.csv`, one BVH a body, skinned shapes as `bodies.glb` |
//! | [`export.tracked`](tracked::ExportTracked) | `tracked.csv`: tracked points of a surface, with velocity, acceleration, and the ends of trajectories |
//! | [`export.cloud`](cloud::ExportCloud) | point clouds as PLY and GLB, and as range, normal and shaded pictures of their camera |
//! | [`export.surface`](surface::ExportSurface) | a surface as PLY and GLB, and as a range and a shaded picture |
//! | [`export.voxels`](voxels::ExportVoxels) | voxels as PLY and GLB |
//! | [`export.voxel_overlay`](voxel_overlay::ExportVoxelOverlay) | pictures of a camera with silhouettes and voxels drawn over them, as PNG |
//! | [`export.overlay`](overlay::ExportOverlay) | some pictures of a camera with the detected points ringed, as PNG |
//!
//! Tables, C3D and TRC are written during the run, and are complete at any time. A full disk or a read-only folder loses nothing: rows
//! wait in memory, and are written to the system's folder for temporary files at the end, with an error that names the file.

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
mod pace;
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

/// Registers the nodes of this plugin.
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
