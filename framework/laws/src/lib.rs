//! Checks of derivatives and camera models, and a texture with known values everywhere, for the tests of any room:
//! they use no type of ours, so that the lowest rooms can use them.

pub mod texture;

use nalgebra::{DMatrix, DVector, Point2, Point3, Vector3};

/// Checks a camera model on a grid over an image of `image_size` pixels: a pixel's ray starts at `centre`, points
/// along it project back to the pixel within 1e-6 px, and points behind the camera are not visible. `ray` gives origin
/// and direction [m] of a pixel, `project` the pixel of a point [m].
///
/// # Panics
/// When a check fails.
#[track_caller]
pub fn check_camera_model(
    image_size: [u32; 2],
    centre: &Point3<f64>,
    ray: impl Fn(&Point2<f64>) -> Option<(Point3<f64>, Vector3<f64>)>,
    project: impl Fn(&Point3<f64>) -> Option<Point2<f64>>,
) {
    let [width, height] = image_size.map(f64::from);
    for (row, column) in (0..=8).flat_map(|row| (0..=8).map(move |column| (row, column))) {
        let pixel = Point2::new((width - 1.0) * f64::from(column) / 8.0, (height - 1.0) * f64::from(row) / 8.0);
        let Some((origin, direction)) = ray(&pixel) else { panic!("no ray for {pixel}") };
        assert!((origin - centre).norm() < 1e-9, "the ray of {pixel} starts at {origin}, the camera is at {centre}");
        for depth in [0.1, 1.0, 7.0] {
            let Some(back) = project(&(origin + direction * depth)) else {
                panic!("{pixel} at {depth} m is not projected")
            };
            assert!((back - pixel).norm() < 1e-6, "{pixel} at {depth} m comes back as {back}");
        }
        assert_eq!(project(&(origin - direction)), None, "a point behind the camera is seen, on the line of {pixel}");
    }
}

/// Compares `jacobian` with central differences of `f` at `x`: each entry within `tolerance` × (1 + its size).
/// The step is 1e-6 × (1 + |xᵢ|), so `f` should be smooth on that scale and `tolerance` not below 1e-8.
///
/// # Panics
/// When a size or an entry differs, with its row and column.
#[track_caller]
pub fn check_jacobian(f: impl Fn(&[f64]) -> Vec<f64>, jacobian: &DMatrix<f64>, x: &[f64], tolerance: f64) {
    let rows = f(x).len();
    assert_eq!(jacobian.shape(), (rows, x.len()), "size of the jacobian");
    for column in 0..x.len() {
        let step = 1e-6 * (1.0 + x[column].abs());
        let shifted = |by: f64| {
            let mut x = x.to_vec();
            x[column] += by;
            DVector::from_vec(f(&x))
        };
        let difference = (shifted(step) - shifted(-step)) / (2.0 * step);
        for row in 0..rows {
            let (stated, found) = (jacobian[(row, column)], difference[row]);
            let error = (stated - found).abs();
            // Written so that NaN fails.
            assert!(
                error <= tolerance * (1.0 + found.abs()),
                "({row}, {column}) is {stated}, differences give {found}"
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use std::panic::catch_unwind;

    use super::*;

    #[test]
    fn a_camera_that_squeezes_or_looks_back_is_found() {
        let ray = |pixel: &Point2<f64>| {
            Some((Point3::origin(), Vector3::new(pixel.x - 320.0, pixel.y - 240.0, 500.0).normalize()))
        };
        let project = |squeeze: f64, sees_back: bool| {
            move |point: &Point3<f64>| {
                let pixel = Point2::new(320.0 + 500.0 * squeeze * point.x / point.z, 240.0 + 500.0 * point.y / point.z);
                (sees_back || point.z > 0.0).then_some(pixel)
            }
        };
        let check = |squeeze, sees_back| {
            catch_unwind(|| check_camera_model([640, 480], &Point3::origin(), ray, project(squeeze, sees_back)))
        };
        assert!(check(1.0, false).is_ok());
        assert!(check(1.0 + 1e-6, false).is_err() && check(1.0, true).is_err());
    }

    #[test]
    fn wrong_derivative_is_found() {
        let f = |x: &[f64]| vec![x[0] * x[1], x[0].sin()];
        let right = DMatrix::from_row_slice(2, 2, &[3.0, 2.0, 2.0_f64.cos(), 0.0]);
        check_jacobian(f, &right, &[2.0, 3.0], 1e-7);
        for entry in 0..4 {
            let mut wrong = right.clone();
            wrong[entry] += 1e-5;
            assert!(catch_unwind(|| check_jacobian(f, &wrong, &[2.0, 3.0], 1e-7)).is_err(), "entry {entry}");
        }
    }
}
