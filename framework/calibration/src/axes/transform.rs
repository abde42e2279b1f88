//! A solved room in another space.

use nalgebra::{Isometry3, Matrix3, Matrix6, Similarity3};

use crate::solved::{FixedFreedoms, Solved};

/// `solved` with cameras, points and covariances taken to the world by `world_from_solved`; pixels and optics stay as they are.
/// Covariances go on saying how well cameras are known relative to each other; how well the space itself is fixed is in `fixed`.
pub fn transformed(solved: &Solved, world_from_solved: &Similarity3<f64>, fixed: FixedFreedoms) -> Solved {
    let factor = world_from_solved.scaling();
    let Isometry3 { rotation, translation } = world_from_solved.isometry;
    let turn: Matrix3<f64> = rotation.to_rotation_matrix().into_inner();
    // With p' = s R p + t, the motion [ω, v] of p moves p' by [R ω, s R v + t × R ω].
    let mut of_motion = Matrix6::zeros();
    of_motion.fixed_view_mut::<3, 3>(0, 0).copy_from(&turn);
    of_motion.fixed_view_mut::<3, 3>(3, 0).copy_from(&(translation.vector.cross_matrix() * turn));
    of_motion.fixed_view_mut::<3, 3>(3, 3).copy_from(&(turn * factor));
    let mut moved = Solved { fixed, ..solved.clone() };
    for camera in &mut moved.cameras {
        let pose = camera.camera.camera_from_world;
        let turned = pose.rotation * rotation.inverse();
        let shift = pose.translation.vector * factor - turned * translation.vector;
        camera.camera.camera_from_world = Isometry3::from_parts(shift.into(), turned);
        if let Some(covariance) = &mut camera.covariance {
            covariance.pose = of_motion * covariance.pose * of_motion.transpose();
            covariance.centre = turn * covariance.centre * turn.transpose() * (factor * factor);
        }
    }
    for point in &mut moved.points {
        point.position = world_from_solved * point.position;
    }
    moved
}
