//! What the foreign formats share: K, R and lists of distortion coefficients, taken apart and checked.

use foveate_geometry::{Camera, Distortion, Intrinsics};
use nalgebra::{Matrix3, Point2, Point3, Rotation3, UnitQuaternion};

/// How far RᵀR may be from 1, element by element, and still be taken for rounding.
const ROTATION_TOLERANCE: f64 = 1e-3;
/// Pixels of a grid over the image on which two cameras are compared.
const GRID: [u32; 2] = [33, 25];

/// `None` unless K is upper triangular, ends in 1, is finite, and its focal lengths are above 0.
pub(crate) fn intrinsics(k: &Matrix3<f64>) -> Option<Intrinsics> {
    let zeros = [k[(1, 0)], k[(2, 0)], k[(2, 1)]];
    let fine = k.iter().all(|it| it.is_finite()) && zeros == [0.0; 3] && k[(2, 2)] == 1.0;
    (fine && k[(0, 0)] > 0.0 && k[(1, 1)] > 0.0).then(|| Intrinsics {
        focal: [k[(0, 0)], k[(1, 1)]],
        principal: [k[(0, 2)], k[(1, 2)]],
        skew: k[(0, 1)],
    })
}

/// K of what [`intrinsics`] gives.
pub(crate) fn matrix(Intrinsics { focal, principal, skew }: &Intrinsics) -> Matrix3<f64> {
    Matrix3::new(focal[0], *skew, principal[0], 0.0, focal[1], principal[1], 0.0, 0.0, 1.0)
}

/// The rotation next to `r`, which may be rounded; else what is wrong with it, as `is a reflection`.
pub(crate) fn rotation(r: &Matrix3<f64>) -> Result<UnitQuaternion<f64>, String> {
    let off = (r.transpose() * r - Matrix3::identity()).amax();
    if off.is_nan() || off > ROTATION_TOLERANCE {
        return Err(format!("is no rotation: RᵀR is off 1 by {off:.1e}"));
    }
    if r.determinant() < 0.0 {
        return Err("is a reflection: its determinant is -1".into());
    }
    let svd = r.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Err("is no rotation".into()) };
    Ok(UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(u * v_t)))
}

/// OpenCV's list k₁, k₂, p₁, p₂, k₃, k₄ …; else what is wrong with it. Terms that our model lacks must be 0.
pub(crate) fn distortion(list: &[f64]) -> Result<Distortion, String> {
    if ![4, 5, 8, 12, 14].contains(&list.len()) {
        return Err(format!("has {} coefficients", list.len()));
    }
    if let Some(index) = list.iter().skip(5).position(|it| *it != 0.0) {
        return Err(format!("is a model of {} coefficients, of which number {} is not 0", list.len(), index + 6));
    }
    let k3 = list.get(4).copied().unwrap_or(0.0);
    Ok(Distortion { k1: list[0], k2: list[1], p1: list[2], p2: list[3], k3 })
}

/// How far apart, at most, `a` and `b` put what `a` sees at pixels over its whole image [px]; their poses are taken to be the same.
/// Infinite where `b` does not see what `a` sees.
pub(crate) fn apart_px(a: &Camera, b: &Camera) -> f64 {
    let at_origin = |camera: &Camera| Camera { camera_from_world: Default::default(), ..camera.clone() };
    let (a, b) = (at_origin(a), at_origin(b));
    let [columns, rows] = a.image_size.map(|it| f64::from(it - 1));
    let pixels = (0..GRID[0] * GRID[1]).map(|index| {
        let (column, row) = (index % GRID[0], index / GRID[0]);
        Point2::new(
            columns * f64::from(column) / f64::from(GRID[0] - 1),
            rows * f64::from(row) / f64::from(GRID[1] - 1),
        )
    });
    pixels
        .filter_map(|pixel| {
            let point = Point3::from(a.normalise(&pixel)?.push(1.0));
            Some(b.project(&point).map_or(f64::INFINITY, |seen| (seen - pixel).norm()))
        })
        .fold(0.0, f64::max)
}
