//! The directions in which a similarity of the whole scene moves the cameras.

use foveate_estimation::least_squares::information::solve_positive;
use nalgebra::{DMatrix, DVector, Matrix3, Matrix3x6, Matrix6xX, Vector3};

use super::Gauge;
use super::equations::Layout;
use crate::camera::Camera;

/// Camera centres closer together than this part of the scene's size are one.
const SAME_PLACE: f64 = 1e-9;

/// Orthonormal columns: how the reduced system moves under the similarities that leave held cameras where they are.
pub(super) fn directions(layout: &Layout, cameras: &[Camera]) -> DMatrix<f64> {
    let mut anchors = layout.anchors.iter().map(|it| cameras[*it].centre());
    let about = anchors.next();
    if about.is_some_and(|about| anchors.any(|it| (it - about).norm() > SAME_PLACE)) {
        return DMatrix::zeros(layout.dimension, 0);
    }
    let centre_of_scale = about.map_or_else(Vector3::zeros, |it| it.coords);
    let first = if about.is_some() { 6 } else { 0 };
    // A known length leaves no other scale.
    let end = if layout.lengths.is_empty() { 7 } else { 6 };
    let mut columns: Vec<DVector<f64>> = Vec::with_capacity(7);
    for generator in first..end {
        let mut column = DVector::zeros(layout.dimension);
        for (camera, rows) in cameras.iter().zip(&layout.rows) {
            let Some(row) = rows[0] else { continue };
            // T exp(δ) with one δ for all cameras moves the world; a larger world moves each centre outwards.
            if generator < 6 {
                column[row + generator] = 1.0;
            } else {
                column.fixed_rows_mut::<3>(row + 3).copy_from(&(centre_of_scale - camera.centre().coords));
            }
        }
        for _ in 0..2 {
            for other in &columns {
                column -= other * other.dot(&column);
            }
        }
        let norm = column.norm();
        if norm > SAME_PLACE {
            columns.push(column / norm);
        }
    }
    if columns.is_empty() { DMatrix::zeros(layout.dimension, 0) } else { DMatrix::from_columns(&columns) }
}

/// The step of the reduced system that moves nothing along the directions of the gauge; `None` where it is singular otherwise.
pub(super) fn solve(
    layout: &Layout,
    cameras: &[Camera],
    information: &DMatrix<f64>,
    gradient: &DVector<f64>,
) -> Option<DVector<f64>> {
    let mut held = information.clone();
    let weight = held.diagonal().mean();
    add_directions(&mut held, &directions(layout, cameras), weight);
    solve_positive(held, &-gradient)
}

/// Adds `weight` G Gᵀ to the lower triangle and the upper one.
pub(super) fn add_directions(information: &mut DMatrix<f64>, directions: &DMatrix<f64>, weight: f64) {
    if directions.ncols() > 0 {
        information.gemm(weight, directions, &directions.transpose(), 1.0);
    }
}

/// Restates a covariance, which is that of inner constraints, so that steps δ with Hᵀ δ = 0 have all the error (the
/// S-transformation of W. Baarda, "S-transformations and criterion matrices", 1973): P C Pᵀ with P = I − G (HᵀG)⁻¹ Hᵀ.
pub(super) fn restated(
    covariance: &DMatrix<f64>,
    directions: &DMatrix<f64>,
    constraints: &DMatrix<f64>,
) -> Option<DMatrix<f64>> {
    let moved = constraints.tr_mul(directions).try_inverse()?;
    let n = covariance.nrows();
    let projection = DMatrix::identity(n, n) - directions * moved * constraints.transpose();
    Some(&projection * covariance * projection.transpose())
}

/// H of [`Gauge`]; `None` when inner constraints are wanted, or a camera that is named does not move.
pub(super) fn constraints(
    gauge: Gauge,
    directions: &DMatrix<f64>,
    layout: &Layout,
    cameras: &[Camera],
) -> Option<DMatrix<f64>> {
    match gauge {
        Gauge::Inner => None,
        Gauge::Centres => Some(of_centres(directions, layout, cameras)),
        Gauge::Cameras { reference, other } => of_pair(layout, cameras, [reference, other]),
    }
}

/// The shifts of all centres are at right angles to those under a similarity: H = JᵀJ G, J the derivatives of the centres.
fn of_centres(directions: &DMatrix<f64>, layout: &Layout, cameras: &[Camera]) -> DMatrix<f64> {
    let mut constraints = DMatrix::zeros(layout.dimension, directions.ncols());
    for (camera, rows) in cameras.iter().zip(&layout.rows) {
        let Some(row) = rows[0] else { continue };
        // The centre c of T exp(δ) moves by c × ω − v.
        let mut by_pose = Matrix3x6::zeros();
        by_pose.fixed_columns_mut::<3>(0).copy_from(&camera.centre().coords.cross_matrix());
        by_pose.fixed_columns_mut::<3>(3).copy_from(&-Matrix3::identity());
        let own = by_pose.tr_mul(&(by_pose * directions.rows(row, 6)));
        constraints.rows_mut(row, 6).copy_from(&own);
    }
    constraints
}

/// The pose of `reference` and its distance to `other` have no error.
fn of_pair(layout: &Layout, cameras: &[Camera], [reference, other]: [usize; 2]) -> Option<DMatrix<f64>> {
    let rows = [reference, other].map(|it| layout.rows[it][0]);
    let [Some(row), Some(other_row)] = rows else { return None };
    let mut constraints = DMatrix::zeros(layout.dimension, 7);
    (0..6).for_each(|it| constraints[(row + it, it)] = 1.0);
    let centres = [reference, other].map(|it| cameras[it].centre().coords);
    let along = (centres[1] - centres[0]).normalize();
    // The centre c of T exp(δ) moves by c × ω − v.
    let mut distance = Matrix6xX::zeros(2);
    for (index, (centre, sign)) in centres.iter().zip([-1.0, 1.0]).enumerate() {
        distance.fixed_view_mut::<3, 1>(0, index).copy_from(&(along.cross(centre) * sign));
        distance.fixed_view_mut::<3, 1>(3, index).copy_from(&(along * -sign));
    }
    constraints.fixed_view_mut::<6, 1>(row, 6).copy_from(&distance.column(0));
    constraints.fixed_view_mut::<6, 1>(other_row, 6).copy_from(&distance.column(1));
    Some(constraints)
}
