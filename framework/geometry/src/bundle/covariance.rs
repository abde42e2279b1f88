//! From the reduced system to the covariance of each camera, in metres and pixels.

use foveate_estimation::least_squares::invert_information;
use nalgebra::{DMatrix, Matrix3, Matrix6, SMatrix, Vector3};

use super::columns::{NAMES, OpticsSigma};
use super::equations::Layout;
use super::{CameraCovariance, Gauge, UnobservableParameters, gauge};
use crate::camera::Camera;

/// Of cameras in a scene that was moved to `centroid` and divided by `size`, and of the rows of the reduced system. `correlated` makes of the
/// inverse information the covariance of errors that are not independent.
pub(super) fn of_cameras(
    layout: &Layout,
    cameras: &[Camera],
    information: &DMatrix<f64>,
    choice: Gauge,
    (centroid, size): (Vector3<f64>, f64),
    correlated: impl FnOnce(DMatrix<f64>, usize) -> DMatrix<f64>,
) -> Result<(Vec<CameraCovariance>, DMatrix<f64>), UnobservableParameters> {
    let directions = gauge::directions(layout, cameras);
    let weight = information.diagonal().mean();
    let mut held = information.clone();
    gauge::add_directions(&mut held, &directions, weight);
    let mut covariance = invert_information(&held).map_err(|open| named(layout, &open))?;
    gauge::add_directions(&mut covariance, &directions, -1.0 / weight);
    covariance = correlated(covariance, directions.ncols());
    if directions.ncols() == 7
        && let Some(constraints) = gauge::constraints(choice, &directions, layout, cameras)
    {
        covariance = gauge::restated(&covariance, &directions, &constraints).unwrap_or(covariance);
    }
    // With p = m + s p', the same motion [ω, v'] of p' moves p by [ω, s v' + m × ω].
    let mut in_metres = Matrix6::identity();
    in_metres.fixed_view_mut::<3, 3>(3, 0).copy_from(&centroid.cross_matrix());
    in_metres.fixed_view_mut::<3, 3>(3, 3).copy_from(&(Matrix3::identity() * size));
    let each = cameras.iter().zip(&layout.rows).map(|(camera, rows)| {
        let entry = |row: Option<usize>, column: Option<usize>| row.zip(column).map_or(0.0, |it| covariance[it]);
        let scaled = Matrix6::from_fn(|row, column| entry(rows[row], rows[column]));
        let pose = in_metres * scaled * in_metres.transpose();
        let centre = centroid + camera.centre().coords * size;
        // The centre c of T exp(δ) moves by c × ω − v.
        let mut centre_by_pose = SMatrix::<f64, 3, 6>::zeros();
        centre_by_pose.fixed_columns_mut::<3>(0).copy_from(&centre.cross_matrix());
        centre_by_pose.fixed_columns_mut::<3>(3).copy_from(&-Matrix3::identity());
        CameraCovariance {
            pose,
            centre: centre_by_pose * pose * centre_by_pose.transpose(),
            optics: OpticsSigma::of(|column| entry(rows[column], rows[column]).max(0.0).sqrt()),
        }
    });
    Ok((each.collect(), covariance))
}

/// Rows of the reduced system by camera and name.
fn named(layout: &Layout, open: &[usize]) -> UnobservableParameters {
    let mut parameters = Vec::with_capacity(open.len());
    for (camera, rows) in layout.rows.iter().enumerate() {
        for (row, name) in rows.iter().zip(NAMES) {
            if row.is_some_and(|it| open.contains(&it)) {
                parameters.push((camera, name));
            }
        }
    }
    UnobservableParameters { parameters }
}
