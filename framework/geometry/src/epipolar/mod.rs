//! Relative pose of two cameras from pixels of the same points, up to the length of the baseline.
//!
//! RANSAC over essential matrices of five pairs each, with truncated squares of Sampson's distance; the best one gives
//! the pose under which most points lie in front of both cameras, which is then adjusted with its points
//! ([`crate::bundle`], Cauchy's loss). Source: R. Hartley and A. Zisserman, *Multiple View Geometry in Computer
//! Vision*, 2nd ed. 2004, §9.6 and §11.4.3 (Sampson's distance), and the source of `five_points`.
//!
//! The optics are known. Points in a plane are allowed, and reported ([`TwoViews::planar_share`]), since wrong optics
//! cannot be detected with them. Refused: points in one place or on a line in either picture, and cameras in one
//! place.

mod five_points;

use foveate_estimation::{Loss, Random, statistics};
use nalgebra::{Isometry3, Matrix2, Matrix3, Point2, Point3, SMatrix, SVector, Translation3, UnitQuaternion, Vector3};

use crate::bundle::{BundleOptions, Freedom, Observation, adjust};
use crate::camera::Camera;
use crate::ray::{Ray, closest_approach};

/// Options of [`relative_pose`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EpipolarOptions {
    /// Pixel noise of inliers, standard deviation of either coordinate [px].
    pub sigma_px: f64,
    /// A pair is an inlier when both pixels are at most this far from their point's projection [px].
    pub inlier_px: f64,
    /// Least number of inliers, at least 6 [–].
    pub min_right: usize,
    /// RANSAC trials at most; fewer when enough pairs agree early [–].
    pub trials: u32,
}

impl Default for EpipolarOptions {
    fn default() -> Self {
        Self { sigma_px: 0.5, inlier_px: 2.0, min_right: 8, trials: 500 }
    }
}

/// The relative pose of two cameras with its inliers.
#[derive(Debug, Clone, PartialEq)]
pub struct TwoViews {
    /// Maps points in camera a to points in camera b; its translation has length 1.
    pub b_from_a: Isometry3<f64>,
    /// By pair: the point in camera a in units of the baseline, `None` for outliers.
    pub points_in_a: Vec<Option<Point3<f64>>>,
    /// Number of inliers.
    pub n_right: usize,
    /// Part of the inliers that one plane explains; near 1 when the points lie in a plane [–].
    pub planar_share: f64,
    /// Parallax: median angle between the two lines of sight of a point [rad].
    pub parallax_rad: f64,
}

/// Why there is no relative pose.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum EpipolarError {
    /// Lists of different lengths.
    #[error("{in_a} pixels of camera a and {in_b} of camera b, expected as many of each")]
    LengthsDiffer {
        /// Pixels of camera a.
        in_a: usize,
        /// Pixels of camera b.
        in_b: usize,
    },
    /// An option out of range.
    #[error("{option} is {found}, expected more than 0")]
    BadOption {
        /// Which option.
        option: &'static str,
        /// Value that was found.
        found: f64,
    },
    /// Too few pairs with lines of sight.
    #[error("{count} usable pairs of pixels, expected at least {needed}")]
    TooFew {
        /// Pairs with a line of sight in both cameras.
        count: usize,
        /// Pairs that are needed.
        needed: usize,
    },
    /// The points lie in one place, or on a line, in one of the pictures.
    #[error("the pixels lie on a line or in one place: their spread across it is {spread_px:.2} px")]
    Collinear {
        /// Standard deviation across the line [px].
        spread_px: f64,
    },
    /// No pose has enough inliers.
    #[error(
        "no pose found in {trials} trials explains more than {agreeing} of {count} pairs, expected at least {needed}"
    )]
    NoConsensus {
        /// RANSAC trials.
        trials: u32,
        /// Inliers of the best pose.
        agreeing: usize,
        /// Number of pairs.
        count: usize,
        /// Inliers that are needed.
        needed: usize,
    },
    /// The cameras stand in one place, or all points are too far away.
    #[error("the parallax is {parallax_rad:.1e} rad, which is within the noise: no depth")]
    NoDepth {
        /// Median parallax [rad].
        parallax_rad: f64,
    },
}

/// Chance at which five right pairs must have been drawn before the search ends early.
const CONFIDENCE: f64 = 0.999;
const LEAST_TRIALS: f64 = 10.0;

/// Relative pose of `b` with respect to `a` (whose own poses are not used) from pixels of the same points. `below(n)`
/// draws a random whole number from 0 to n − 1.
///
/// # Errors
/// See [`EpipolarError`].
pub fn relative_pose(
    [a, b]: [&Camera; 2],
    [pixels_a, pixels_b]: [&[Point2<f64>]; 2],
    options: &EpipolarOptions,
    random: &mut Random,
) -> Result<TwoViews, EpipolarError> {
    if pixels_a.len() != pixels_b.len() {
        return Err(EpipolarError::LengthsDiffer { in_a: pixels_a.len(), in_b: pixels_b.len() });
    }
    for (option, found) in [("sigma_px", options.sigma_px), ("inlier_px", options.inlier_px)] {
        if !(found.is_finite() && found > 0.0) {
            return Err(EpipolarError::BadOption { option, found });
        }
    }
    let needed = options.min_right.max(6);
    let mut pairs = Vec::with_capacity(pixels_a.len());
    for (index, (in_a, in_b)) in pixels_a.iter().zip(pixels_b).enumerate() {
        if let Some((from_a, from_b)) = a.normalise(in_a).zip(b.normalise(in_b)) {
            pairs.push(Pair { index, pixels: [*in_a, *in_b], bearings: [from_a.push(1.0), from_b.push(1.0)] });
        }
    }
    if pairs.len() < needed {
        return Err(EpipolarError::TooFew { count: pairs.len(), needed });
    }
    let spread_px = spread_across(&pairs, 0).min(spread_across(&pairs, 1));
    if spread_px < 3.0 * options.sigma_px {
        return Err(EpipolarError::Collinear { spread_px });
    }
    let focal = |it: &Camera| 0.5 * (it.intrinsics.focal[0] + it.intrinsics.focal[1]);
    let limit = (options.inlier_px / (0.5 * (focal(a) + focal(b)))).powi(2);
    let (best, trials) = search(&pairs, limit, options.trials, random);
    let fault = |agreeing| EpipolarError::NoConsensus { trials, agreeing, count: pairs.len(), needed };
    let Some(essential) = best else { return Err(fault(0)) };
    let agreeing: Vec<&Pair> = pairs.iter().filter(|it| it.sampson(&essential) <= limit).collect();
    if agreeing.len() < needed {
        return Err(fault(agreeing.len()));
    }
    let start = pose_in_front(&essential, &agreeing);
    let (b_from_a, points) =
        adjusted([a, b], &pairs, &agreeing, &start, options).ok_or_else(|| fault(agreeing.len()))?;
    let n_right = points.iter().flatten().count();
    if n_right < needed {
        return Err(fault(n_right));
    }
    let right: Vec<&Pair> =
        pairs.iter().zip(&points).filter(|(_, point)| point.is_some()).map(|(pair, _)| pair).collect();
    let angle = |it: &Pair| (b_from_a.rotation * it.bearings[0]).angle(&it.bearings[1]);
    let angles: Vec<f64> = right.iter().map(|it| angle(it)).collect();
    let parallax_rad = statistics::median(&angles).unwrap_or(0.0);
    if parallax_rad < 6.0 * options.sigma_px / focal(a).max(focal(b)) {
        return Err(EpipolarError::NoDepth { parallax_rad });
    }
    let mut points_in_a = vec![None; pixels_a.len()];
    pairs.iter().zip(&points).for_each(|(pair, point)| points_in_a[pair.index] = *point);
    Ok(TwoViews { b_from_a, points_in_a, n_right, planar_share: planar_share(&right, limit), parallax_rad })
}

/// By pair: the point, if the pair is right.
type RightPoints = Vec<Option<Point3<f64>>>;

/// Two pixels of a point, and their lines of sight with z = 1.
struct Pair {
    index: usize,
    pixels: [Point2<f64>; 2],
    bearings: [Vector3<f64>; 2],
}

impl Pair {
    /// Squared distance of the pair from the nearest that fulfils bᵀ E a = 0, to first order.
    fn sampson(&self, essential: &Matrix3<f64>) -> f64 {
        let [a, b] = &self.bearings;
        let (in_b, in_a) = (essential * a, essential.tr_mul(b));
        b.dot(&in_b).powi(2) / (in_b.xy().norm_squared() + in_a.xy().norm_squared())
    }
}

/// Standard deviation of the pixels across the line along which they spread most [px].
fn spread_across(pairs: &[Pair], camera: usize) -> f64 {
    let n = pairs.len() as f64;
    let centroid = pairs.iter().fold(nalgebra::Vector2::zeros(), |sum, it| sum + it.pixels[camera].coords / n);
    let mut scatter = Matrix2::zeros();
    for pair in pairs {
        let offset = pair.pixels[camera].coords - centroid;
        scatter += offset * offset.transpose() / n;
    }
    scatter.symmetric_eigenvalues().min().max(0.0).sqrt()
}

/// The essential matrix with the least truncated error, and how many quintuples were drawn.
fn search(pairs: &[Pair], limit: f64, trials: u32, random: &mut Random) -> (Option<Matrix3<f64>>, u32) {
    let n = pairs.len() as u32;
    let mut best: Option<(f64, Matrix3<f64>)> = None;
    let (mut drawn, mut needed) = (0, f64::from(trials));
    while drawn < trials && f64::from(drawn) < needed {
        drawn += 1;
        let mut chosen = [0_usize; 5];
        for at in 0..5 {
            chosen[at] = loop {
                let index = random.below(n) as usize;
                if !chosen[..at].contains(&index) {
                    break index;
                }
            };
        }
        let of = |camera: usize| chosen.map(|it| pairs[it].bearings[camera]);
        for matrix in five_points::essential_matrices(&of(0), &of(1)) {
            let (mut error, mut agreeing) = (0.0, 0);
            for pair in pairs {
                let squared = pair.sampson(&matrix);
                error += squared.min(limit);
                agreeing += u32::from(squared <= limit);
            }
            if best.as_ref().is_none_or(|it| error < it.0) {
                best = Some((error, matrix));
                let share = f64::from(agreeing) / f64::from(n);
                needed = (1.0 - CONFIDENCE).ln() / (1.0 - share.powi(5)).max(f64::MIN_POSITIVE).ln();
                needed = if needed.is_finite() { needed.max(LEAST_TRIALS) } else { f64::from(trials) };
            }
        }
    }
    (best.map(|it| it.1), drawn)
}

/// Of the four poses of an essential matrix, the one that puts most points in front of both cameras.
fn pose_in_front(essential: &Matrix3<f64>, pairs: &[&Pair]) -> Isometry3<f64> {
    let svd = essential.svd(true, true);
    let (u, v_t) = (svd.u.unwrap_or_else(Matrix3::identity), svd.v_t.unwrap_or_else(Matrix3::identity));
    let quarter = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    let sign = (u.determinant() * v_t.determinant()).signum();
    let mut best = (0, Isometry3::identity());
    for turn in [quarter, quarter.transpose()] {
        let rotation = UnitQuaternion::from_matrix(&(u * turn * v_t * sign));
        for shift in [u.column(2).into_owned(), -u.column(2)] {
            let b_from_a = Isometry3::from_parts(Translation3::from(shift), rotation);
            let in_front = pairs.iter().filter(|it| triangulated(it, &b_from_a).is_some()).count();
            if in_front >= best.0 {
                best = (in_front, b_from_a);
            }
        }
    }
    best.1
}

/// Where the two lines of sight come closest, if in front of both cameras.
fn triangulated(pair: &Pair, b_from_a: &Isometry3<f64>) -> Option<Point3<f64>> {
    let unit = nalgebra::Unit::new_normalize;
    let a = Ray { origin: Point3::origin(), direction: unit(pair.bearings[0]) };
    let origin = b_from_a.inverse_transform_point(&Point3::origin());
    let b = Ray { origin, direction: unit(b_from_a.rotation.inverse() * pair.bearings[1]) };
    closest_approach(&a, &b).filter(|it| it.depth_a > 0.0 && it.depth_b > 0.0).map(|it| it.midpoint)
}

/// Adjusts the pose and the points of the agreeing pairs, then asks all pairs again; by pair, the point if it is right.
fn adjusted(
    [a, b]: [&Camera; 2],
    pairs: &[Pair],
    agreeing: &[&Pair],
    start: &Isometry3<f64>,
    options: &EpipolarOptions,
) -> Option<(Isometry3<f64>, RightPoints)> {
    let mut b_from_a = *start;
    let mut chosen: Vec<&Pair> = agreeing.to_vec();
    for _ in 0..2 {
        let cameras = [(a, Isometry3::identity()), (b, b_from_a)]
            .map(|(camera, camera_from_world)| Camera { camera_from_world, ..camera.clone() });
        let (mut points, mut observations) = (Vec::new(), Vec::new());
        for pair in &chosen {
            let Some(point) = triangulated(pair, &b_from_a) else { continue };
            for (camera, pixel) in pair.pixels.into_iter().enumerate() {
                observations.push(Observation { camera, point: points.len(), pixel, sigma_px: options.sigma_px });
            }
            points.push(point);
        }
        let bundle = BundleOptions { loss: Loss::CAUCHY, max_iterations: 30, ..BundleOptions::default() };
        let found = adjust(&cameras, &[Freedom::NONE, Freedom::POSE], &points, &observations, &bundle).ok()?;
        b_from_a = found.cameras[1].camera_from_world;
        let length = b_from_a.translation.vector.norm();
        b_from_a.translation.vector /= length;
        if !(length > 0.0 && length.is_finite()) {
            return None;
        }
        let right = right_points([a, b], pairs, &b_from_a, options.inlier_px);
        chosen = pairs.iter().zip(&right).filter(|(_, point)| point.is_some()).map(|(pair, _)| pair).collect();
        if chosen.len() < 6 {
            return None;
        }
    }
    let points = right_points([a, b], pairs, &b_from_a, options.inlier_px);
    Some((b_from_a, points))
}

/// By pair: the point, if both cameras see it within `inlier_px` of the pixel.
fn right_points([a, b]: [&Camera; 2], pairs: &[Pair], b_from_a: &Isometry3<f64>, inlier_px: f64) -> RightPoints {
    let cameras = [(a, Isometry3::identity()), (b, *b_from_a)]
        .map(|(camera, camera_from_world)| Camera { camera_from_world, ..camera.clone() });
    let right = |pair: &Pair| {
        let point = triangulated(pair, b_from_a)?;
        let near = |index: usize| Some((cameras[index].project(&point)? - pair.pixels[index]).norm() <= inlier_px);
        (near(0)? && near(1)?).then_some(point)
    };
    pairs.iter().map(right).collect()
}

/// Part of the pairs that one homography explains: of all by direct linear transform, then again of those that it explains.
fn planar_share(pairs: &[&Pair], limit: f64) -> f64 {
    let mut chosen: Vec<&Pair> = pairs.to_vec();
    let mut explained = 0;
    for _ in 0..3 {
        let mut normal = SMatrix::<f64, 9, 9>::zeros();
        for pair in &chosen {
            let [a, b] = &pair.bearings;
            for (own, by) in [(0, b.x), (1, b.y)] {
                let mut row = SVector::<f64, 9>::zeros();
                row.fixed_rows_mut::<3>(3 * own).copy_from(a);
                row.fixed_rows_mut::<3>(6).copy_from(&(-a * by));
                normal += row * row.transpose();
            }
        }
        let eigen = normal.symmetric_eigen();
        let least = eigen.eigenvectors.column(eigen.eigenvalues.imin());
        let homography = Matrix3::from_row_slice(least.as_slice());
        // Either way round: seen at a slant, one picture of the plane magnifies the noise of the other.
        let back = homography.try_inverse().unwrap_or_else(Matrix3::zeros);
        let error = |pair: &&&Pair| {
            let [there, here] = [homography * pair.bearings[0], back * pair.bearings[1]];
            let in_b = (there.xy() / there.z - pair.bearings[1].xy()).norm_squared();
            in_b.min((here.xy() / here.z - pair.bearings[0].xy()).norm_squared())
        };
        let near: Vec<&Pair> = pairs.iter().filter(|it| error(it) <= 4.0 * limit).copied().collect();
        explained = near.len();
        if explained < 4 {
            break;
        }
        chosen = near;
    }
    explained as f64 / pairs.len() as f64
}

#[cfg(test)]
mod tests;
