//! One plane seen by one camera: its homography, the poses that explain it, and the focal length that follows from several.
//!
//! Source: Z. Zhang, "A flexible new technique for camera calibration", TPAMI 22(11), 2000, §3.1. A plane seen from afar looks nearly the
//! same when it is mirrored at the plane across the line of sight: D. Oberkampf, D. DeMenthon, L. Davis, "Iterative pose
//! estimation using coplanar feature points", CVIU 63(3), 1996. Both poses are refined and both kept while the pixels allow.

use foveate_geometry::{Camera, ResectionOptions, refine_pose};
use nalgebra::{Isometry3, Matrix3, Point2, Point3, Rotation3, SMatrix, UnitQuaternion, Vector2, Vector3};

/// How many times the homography is fitted, each mark weighed by how well it fitted before.
const ROUNDS: usize = 6;

/// Spread of points on Z = 0 across their line over that along it [–].
pub(super) fn spread_ratio(points: &[Point3<f64>]) -> f64 {
    let n = points.len().max(1) as f64;
    let mean = points.iter().fold(Vector2::zeros(), |sum, it| sum + it.coords.xy()) / n;
    let mut scatter = nalgebra::Matrix2::zeros();
    for point in points {
        let off = point.coords.xy() - mean;
        scatter += off * off.transpose();
    }
    let axes = scatter.symmetric_eigenvalues();
    let (low, high) = (axes.min().max(0.0), axes.max());
    if high > 0.0 { (low / high).sqrt() } else { 0.0 }
}

/// A homography from a board's plane to an image.
#[derive(Debug, Clone, Copy)]
pub(super) struct Homography {
    pub image_from_plane: Matrix3<f64>,
    /// Median distance of its marks [in units of the image].
    pub median: f64,
    /// Root mean square distance of the image's points from their middle.
    pub extent: f64,
}

/// The homography under which most marks are where they were seen; `None` for fewer than four, or marks on a line.
pub(super) fn homography(places: &[Point3<f64>], seen: &[Vector2<f64>]) -> Option<Homography> {
    if places.len() < 4 || spread_ratio(places) < 1e-2 {
        return None;
    }
    let plane: Vec<Vector2<f64>> = places.iter().map(|it| it.coords.xy()).collect();
    let ((from, _), (to, extent)) = (normaliser(&plane)?, normaliser(seen)?);
    let to_back = to.try_inverse()?;
    let mut weights = vec![1.0; plane.len()];
    let mut best = Homography { image_from_plane: Matrix3::zeros(), median: f64::INFINITY, extent };
    for _ in 0..ROUNDS {
        let mut normal = SMatrix::<f64, 9, 9>::zeros();
        for ((p, q), weight) in plane.iter().zip(seen).zip(&weights) {
            let (p, q) = (from * p.push(1.0), to * q.push(1.0));
            let rows = [
                [p.x, p.y, 1.0, 0.0, 0.0, 0.0, -q.x * p.x, -q.x * p.y, -q.x],
                [0.0, 0.0, 0.0, p.x, p.y, 1.0, -q.y * p.x, -q.y * p.y, -q.y],
            ];
            for row in rows {
                let row = SMatrix::<f64, 9, 1>::from(row);
                normal += row * row.transpose() * *weight;
            }
        }
        let eigen = normal.symmetric_eigen();
        let h = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
        let h = Matrix3::from_row_slice(h.as_slice());
        let image_from_plane = to_back * h * from;
        let distances: Vec<f64> = plane
            .iter()
            .zip(seen)
            .map(|(p, q)| {
                let at = image_from_plane * p.push(1.0);
                (at.xy() / at.z - q).norm()
            })
            .collect();
        let median = foveate_estimation::statistics::median(&distances)?;
        if !median.is_finite() {
            return None;
        }
        if median < best.median {
            best = Homography { image_from_plane, median, extent };
        }
        let scale = (3.0 * median).max(1e-9 * extent);
        weights = distances.iter().map(|it| 1.0 / (1.0 + (it / scale).powi(2))).collect();
    }
    best.median.is_finite().then_some(best)
}

/// Moves the middle of `points` to the origin and scales their spread to √2.
fn normaliser(points: &[Vector2<f64>]) -> Option<(Matrix3<f64>, f64)> {
    let n = points.len() as f64;
    let mean = points.iter().fold(Vector2::zeros(), |sum, it| sum + it) / n;
    let extent = (points.iter().map(|it| (it - mean).norm_squared()).sum::<f64>() / n).sqrt();
    let scale = std::f64::consts::SQRT_2 / extent;
    scale
        .is_finite()
        .then(|| (Matrix3::new(scale, 0.0, -scale * mean.x, 0.0, scale, -scale * mean.y, 0.0, 0.0, 1.0), extent))
}

/// The focal length under which the columns of all homographies are as those of rotations, with square pixels and the principal
/// point as given; `None` when they do not tell.
pub(super) fn focal(homographies: &[Homography], principal: [f64; 2]) -> Option<f64> {
    let centre = Matrix3::new(1.0, 0.0, -principal[0], 0.0, 1.0, -principal[1], 0.0, 0.0, 1.0);
    let (mut squares, mut products) = (0.0, 0.0);
    for homography in homographies {
        let h = centre * homography.image_from_plane;
        let h = h / (h.column(0).norm() * h.column(1).norm()).sqrt();
        let (a, b) = (h.column(0), h.column(1));
        // h₁ᵀ ω h₂ = 0 and h₁ᵀ ω h₁ = h₂ᵀ ω h₂ with ω = diag(1/f², 1/f², 1): (3), (4)
        for (by_inverse, constant) in
            [(a.x * b.x + a.y * b.y, a.z * b.z), (a.x * a.x + a.y * a.y - b.x * b.x - b.y * b.y, a.z * a.z - b.z * b.z)]
        {
            squares += by_inverse * by_inverse;
            products -= by_inverse * constant;
        }
    }
    let inverse_square = products / squares;
    let focal = 1.0 / inverse_square.sqrt();
    (inverse_square > 0.0 && focal.is_finite()).then_some(focal)
}

/// A pose that explains what a camera saw of a board.
#[derive(Debug, Clone, Copy)]
pub(super) struct Posed {
    pub camera_from_board: Isometry3<f64>,
    /// Root mean square distance of the marks that fit [px].
    pub rms_px: f64,
    /// Mean loss of all marks, to compare with other poses [px²].
    pub loss_px2: f64,
    /// Part of the marks that fit [–].
    pub right: f64,
}

/// The one or two poses that explain what `camera` saw, the better one first; none when the marks fit no plane.
pub(super) fn poses(camera: &Camera, places: &[Point3<f64>], pixels: &[Point2<f64>], inlier_px: f64) -> Vec<Posed> {
    let mut kept_places = Vec::with_capacity(places.len());
    let mut ideal = Vec::with_capacity(places.len());
    for (place, pixel) in places.iter().zip(pixels) {
        if let Some(at) = camera.normalise(pixel) {
            kept_places.push(*place);
            ideal.push(at);
        }
    }
    let Some(start) = homography(&kept_places, &ideal).and_then(|it| from_homography(&it.image_from_plane)) else {
        return Vec::new();
    };
    let middle = kept_places.iter().fold(Vector3::zeros(), |sum, it| sum + it.coords) / kept_places.len() as f64;
    let options = ResectionOptions { inlier_px, ..ResectionOptions::default() };
    let refined = |start: Isometry3<f64>| {
        let posed = Camera { camera_from_world: start, ..camera.clone() };
        let found = refine_pose(&posed, places, pixels, &options).ok()?;
        let right = found.right.iter().filter(|it| **it).count() as f64 / found.right.len() as f64;
        let in_front = (found.camera_from_world * Point3::from(middle)).z > 0.0;
        in_front.then_some(Posed {
            camera_from_board: found.camera_from_world,
            rms_px: found.residuals_rms_px,
            loss_px2: found.loss_px2,
            right,
        })
    };
    let mut found: Vec<Posed> = [start, mirrored(&start, &middle)].into_iter().filter_map(refined).collect();
    if let Some(first) = found.first().copied() {
        found.extend(refined(mirrored(&first.camera_from_board, &middle)));
    }
    found.sort_by(|a, b| a.loss_px2.total_cmp(&b.loss_px2));
    let mut kept: Vec<Posed> = Vec::new();
    for pose in found {
        let apart = |it: &Posed| it.camera_from_board.rotation.angle_to(&pose.camera_from_board.rotation);
        if kept.iter().all(|it| apart(it) > 0.02) && kept.len() < 2 {
            kept.push(pose);
        }
    }
    kept
}

/// The pose of which `h`, from the plane to the ideal image, is the homography.
fn from_homography(h: &Matrix3<f64>) -> Option<Isometry3<f64>> {
    let scale = (h.column(0).norm() * h.column(1).norm()).sqrt();
    let h = h * (h[(2, 2)].signum() / scale);
    let (a, b) = (h.column(0).into_owned(), h.column(1).into_owned());
    let svd = Matrix3::from_columns(&[a, b, a.cross(&b)]).svd(true, true);
    let rotation = svd.u? * svd.v_t?;
    if !(rotation.determinant() > 0.0 && h.iter().all(|it| it.is_finite())) {
        return None;
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Some(Isometry3::from_parts(h.column(2).into_owned().into(), rotation))
}

/// The pose that looks alike from afar: the board mirrored at the plane through its `middle` across the line of sight.
pub(super) fn mirrored(camera_from_board: &Isometry3<f64>, middle: &Vector3<f64>) -> Isometry3<f64> {
    let at = (camera_from_board * Point3::from(*middle)).coords;
    let along = at.normalize();
    let across = Matrix3::identity() - along * along.transpose() * 2.0;
    let axes = camera_from_board.rotation.to_rotation_matrix();
    let (x, y) = (across * axes.matrix().column(0), across * axes.matrix().column(1));
    let rotation = Matrix3::from_columns(&[x, y, x.cross(&y)]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Isometry3::from_parts((at - rotation * middle).into(), rotation)
}
