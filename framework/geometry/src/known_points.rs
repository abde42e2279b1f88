//! Camera calibration from one picture of a three-dimensional target: optics and pose from known points and their pixels.
//!
//! [`direct_linear_transformation`] needs no start: Y. Abdel-Aziz, H. Karara, "Direct linear transformation from comparator coordinates into object space
//! coordinates", 1971; the eleven coefficients as the least eigenvector of the normal equations, coordinates moved to their centroid and scaled first
//! (R. Hartley, "In defense of the eight-point algorithm", TPAMI 19(6), 1997). It has no lens distortion.
//! [`camera_from_points`] starts there and minimises the
//! reprojection error over pose, optics and lens by Levenberg–Marquardt. Outliers are removed a few at a time, worst first.
//!
//! Points on one plane do not fix a camera and are refused.

use foveate_estimation::least_squares::{Damping, DriverOptions, SmallEquations, SmallProblem, solve_small};
use foveate_estimation::statistics::median;
use nalgebra::{Matrix3, Matrix3x4, Matrix4, Point2, Point3, SMatrix, SVector};

use crate::bundle::{CLOCK, Freedom, Posed, moved};
use crate::camera::Camera;
use crate::from_matrix::ProjectionError;

/// A known point of the target and its pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownPoint {
    /// Position in the world [m].
    pub place: Point3<f64>,
    /// Measured pixel, raw [px].
    pub pixel: Point2<f64>,
}

/// The camera found by [`camera_from_points`].
#[derive(Debug, Clone, PartialEq)]
pub struct CameraFit {
    /// Optics and pose.
    pub camera: Camera,
    /// By pair: whether it was used; `false` for outliers.
    pub used: Vec<bool>,
    /// Root mean square reprojection error of the used pairs [px].
    pub rms_px: f64,
    /// Relative standard deviation of the common factor of both focal lengths, from the residuals [–].
    pub focal_sigma: f64,
}

/// Why there is no camera.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum KnownPointsError {
    /// Too few pairs: the linear transformation needs six points, a lens more.
    #[error("{found} pairs of point and pixel, expected at least {expected}")]
    TooFew {
        /// Number of finite pairs.
        found: usize,
        /// Number that is needed.
        expected: usize,
    },
    /// The points lie in a plane, or nearly.
    #[error(
        "the points lie in a plane: their spread across it is {ratio:.1e} of that along it, expected at least {FLAT}"
    )]
    Flat {
        /// Standard deviation across the plane over that along it.
        ratio: f64,
    },
    /// The linear solution is not a camera.
    #[error("the direct linear transformation gives no camera: {0}")]
    NoCamera(ProjectionError),
    /// Most points lie behind the camera: left and right are exchanged, in the pixels or in the points.
    #[error("{behind} of {count} points lie behind the camera: the target or the pixels are mirrored")]
    Mirrored {
        /// Points behind the camera.
        behind: usize,
        /// Number of points.
        count: usize,
    },
    /// The search for the optics did not converge.
    #[error("the search for the optics did not converge: rms {rms_px:.2} px at its end")]
    NoConvergence {
        /// Root mean square reprojection error at the end [px].
        rms_px: f64,
    },
}

/// Points whose spread across their plane is below this part of that along it hold no optics.
const FLAT: f64 = 0.02;
/// Pairs to each free number, at least.
const PAIRS_PER_NUMBER: usize = 2;
/// A pair further off than so many standard deviations is left out: of a normal distribution in two directions one in 5,000 is.
const OUTLIER: f64 = 4.1;
/// A distance in the plane has this median, in standard deviations of an axis: √(2 ln 2).
const MEDIAN_DISTANCE: f64 = 1.177_41;
/// Pairs left out in a round, as a part of all: an outlier shifts its neighbours.
const PART_A_ROUND: f64 = 0.05;
/// Rounds of leaving out.
const ROUNDS: usize = 20;
const OPTIONS: DriverOptions = DriverOptions {
    damping: Damping { initial: 1e-4, least: 1e-12, fastest_decrease: 0.1 },
    max_iterations: 200,
    relative_gain: 1e-10,
    absolute_gain: 0.5e-12,
};

/// The pinhole camera of least algebraic error, without lens distortion: a start for [`camera_from_points`].
///
/// # Errors
/// See [`KnownPointsError`].
pub fn direct_linear_transformation(image_size: [u32; 2], pairs: &[KnownPoint]) -> Result<Camera, KnownPointsError> {
    let finite = |it: &&KnownPoint| it.place.coords.iter().chain(it.pixel.coords.iter()).all(|it| it.is_finite());
    let pairs: Vec<KnownPoint> = pairs.iter().filter(finite).copied().collect();
    if pairs.len() < 6 {
        return Err(KnownPointsError::TooFew { found: pairs.len(), expected: 6 });
    }
    let n = pairs.len() as f64;
    let centre = pairs.iter().map(|it| it.place.coords).sum::<nalgebra::Vector3<f64>>() / n;
    let middle = pairs.iter().map(|it| it.pixel.coords).sum::<nalgebra::Vector2<f64>>() / n;
    let mut moment = Matrix3::zeros();
    let mut pixel_spread = 0.0;
    for it in &pairs {
        let off = it.place.coords - centre;
        moment += off * off.transpose() / n;
        pixel_spread += (it.pixel.coords - middle).norm_squared() / (2.0 * n);
    }
    let spreads = moment.symmetric_eigenvalues();
    let ratio = (spreads.min().max(0.0) / spreads.max().max(f64::MIN_POSITIVE)).sqrt();
    if ratio < FLAT {
        return Err(KnownPointsError::Flat { ratio });
    }
    let (scale, pixel_scale) = ((moment.trace() / 3.0).sqrt(), pixel_spread.sqrt());
    let mut normal = SMatrix::<f64, 12, 12>::zeros();
    for it in &pairs {
        let place = ((it.place.coords - centre) / scale).push(1.0);
        let pixel = (it.pixel.coords - middle) / pixel_scale;
        for (row, coordinate) in [pixel.x, pixel.y].into_iter().enumerate() {
            let mut equation = SVector::<f64, 12>::zeros();
            for k in 0..4 {
                equation[4 * row + k] = place[k];
                equation[8 + k] = -coordinate * place[k];
            }
            normal += equation * equation.transpose();
        }
    }
    let eigen = normal.symmetric_eigen();
    let least = eigen.eigenvalues.imin();
    let solution = eigen.eigenvectors.column(least);
    let scaled = Matrix3x4::from_fn(|row, column| solution[4 * row + column]);
    let place_scaling = Matrix4::new_scaling(1.0 / scale) * Matrix4::new_translation(&-centre);
    let pixel_scaling = Matrix3::new(pixel_scale, 0.0, middle.x, 0.0, pixel_scale, middle.y, 0.0, 0.0, 1.0);
    let matrix = pixel_scaling * scaled * place_scaling;
    let camera = Camera::from_projection_matrix(&matrix, image_size).map_err(KnownPointsError::NoCamera)?;
    let behind = pairs.iter().filter(|it| (camera.camera_from_world * it.place).z <= 0.0).count();
    if 2 * behind > pairs.len() {
        return Err(KnownPointsError::Mirrored { behind, count: pairs.len() });
    }
    Ok(camera)
}

/// The camera of least reprojection error. `free` says which optics and lens coefficients are estimated; the pose always is.
///
/// # Errors
/// See [`KnownPointsError`].
pub fn camera_from_points(
    image_size: [u32; 2],
    pairs: &[KnownPoint],
    free: Freedom,
) -> Result<CameraFit, KnownPointsError> {
    let free = Freedom { pose: true, focal: true, ..free };
    let expected = (PAIRS_PER_NUMBER * free.n_parameters()).div_ceil(2).max(6);
    let start = direct_linear_transformation(image_size, pairs)?;
    let mut camera = start;
    camera.intrinsics.skew = 0.0;
    if !free.aspect {
        let mean = (camera.intrinsics.focal[0] * camera.intrinsics.focal[1]).sqrt();
        camera.intrinsics.focal = [mean; 2];
    }
    if !free.principal {
        camera.intrinsics.principal = image_size.map(|it| (f64::from(it) - 1.0) / 2.0);
    }
    let mut used: Vec<bool> = pairs.iter().map(|it| it.pixel.coords.iter().all(|it| it.is_finite())).collect();
    for _ in 0..ROUNDS {
        let kept: Vec<KnownPoint> = pairs.iter().zip(&used).filter(|it| *it.1).map(|it| *it.0).collect();
        if kept.len() < expected {
            return Err(KnownPointsError::TooFew { found: kept.len(), expected });
        }
        let problem = Problem { pairs: &kept, free: free.mask() };
        let solution = solve_small(&problem, camera.clone(), &OPTIONS);
        let Ok(solution) = solution else { return Err(KnownPointsError::NoConvergence { rms_px: f64::NAN }) };
        camera = solution.parameters;
        let squares = 2.0 * solution.equations.cost;
        let rms_px = (squares / kept.len() as f64).sqrt();
        if !rms_px.is_finite() || camera.check().is_err() {
            return Err(KnownPointsError::NoConvergence { rms_px });
        }
        let distance =
            |it: &KnownPoint| camera.project(&it.place).map_or(f64::INFINITY, |seen| (seen - it.pixel).norm());
        let distances: Vec<f64> = pairs.iter().map(distance).collect();
        let of_used: Vec<f64> = distances.iter().zip(&used).filter(|it| *it.1).map(|it| *it.0).collect();
        let sigma = median(&of_used).unwrap_or(0.0) / MEDIAN_DISTANCE;
        let gate = OUTLIER * sigma.max(1e-9);
        let mut off: Vec<usize> = (0..pairs.len()).filter(|it| used[*it] && distances[*it] > gate).collect();
        if off.is_empty() {
            let freedom = (2 * kept.len()).saturating_sub(free.n_parameters()).max(1) as f64;
            let inverse = solution.equations.information.try_inverse();
            let focal_sigma = inverse.map_or(f64::NAN, |it| (it[(6, 6)] * squares / freedom).max(0.0).sqrt());
            return Ok(CameraFit { camera, used, rms_px, focal_sigma });
        }
        off.sort_by(|a, b| distances[*b].total_cmp(&distances[*a]));
        off.truncate(((PART_A_ROUND * pairs.len() as f64) as usize).max(1));
        off.iter().for_each(|it| used[*it] = false);
    }
    Err(KnownPointsError::NoConvergence { rms_px: f64::NAN })
}

struct Problem<'a> {
    pairs: &'a [KnownPoint],
    free: [bool; CLOCK],
}

impl SmallProblem<CLOCK> for Problem<'_> {
    type Parameters = Camera;

    fn moved(&self, from: &Camera, step: &SVector<f64, CLOCK>) -> Camera {
        moved(from, step.as_slice())
    }

    fn linearise(&self, at: &Camera, equations: &mut SmallEquations<CLOCK>) -> Option<()> {
        let posed = Posed::new(at);
        for pair in self.pairs {
            let (seen, mut slopes, _) = posed.linearise::<CLOCK, false>(&pair.place)?;
            for column in (0..CLOCK).filter(|it| !self.free[*it]) {
                slopes.set_column(column, &nalgebra::Vector2::zeros());
            }
            let residual = seen - pair.pixel.coords;
            equations.information += slopes.transpose() * slopes;
            equations.gradient += slopes.transpose() * residual;
            equations.cost += 0.5 * residual.norm_squared();
        }
        for column in (0..CLOCK).filter(|it| !self.free[*it]) {
            equations.information[(column, column)] = 1.0;
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;
    use nalgebra::{Isometry3, Vector3};

    use super::*;
    use crate::camera::{Distortion, Intrinsics};

    const FREE: Freedom = Freedom {
        pose: true,
        focal: true,
        aspect: true,
        principal: true,
        k1: true,
        k2: true,
        k3: false,
        decentering: true,
    };

    fn camera() -> Camera {
        let eye = Point3::new(0.17, 0.3, 0.11);
        Camera {
            image_size: [2464, 3280],
            intrinsics: Intrinsics { focal: [2612.0, 2615.0], principal: [1285.0, 1633.0], skew: 0.0 },
            distortion: Distortion { k1: 0.18, k2: -0.36, p1: 0.002, p2: 0.001, k3: 0.0 },
            camera_from_world: Isometry3::look_at_rh(&eye, &Point3::new(0.0, 0.0, 0.12), &Vector3::z()),
        }
    }

    /// Part of a cylinder, as the target of the recording; the camera looks along +z.
    fn pairs(noise: f64, seed: u64) -> (Camera, Vec<KnownPoint>) {
        let mut camera = camera();
        // `look_at_rh` looks along −z with y up.
        let turn = nalgebra::UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        camera.camera_from_world = Isometry3::from_parts(Default::default(), turn) * camera.camera_from_world;
        let mut random = Random::new(seed);
        let mut pairs = Vec::new();
        for column in 1..9 {
            for row in 0..20 {
                let angle = 12.0 / 57.0 * f64::from(column);
                let place = Point3::new(0.057 * angle.cos(), 0.057 * angle.sin(), 0.01 + 0.012 * f64::from(row));
                let seen = camera.project(&place).unwrap();
                let off = nalgebra::Vector2::new(random.normal(), random.normal()) * noise;
                pairs.push(KnownPoint { place, pixel: seen + off });
            }
        }
        (camera, pairs)
    }

    #[test]
    fn optics_and_pose_come_back_from_one_picture_of_a_cylinder() {
        let (camera, exact) = pairs(0.0, 1);
        let found = camera_from_points(camera.image_size, &exact, FREE).unwrap();
        assert!(found.rms_px < 1e-4, "{}", found.rms_px);
        assert!((found.camera.centre() - camera.centre()).norm() < 1e-6);
        assert!((found.camera.distortion.k1 - 0.18).abs() < 1e-4);
        let mut centres = Vec::new();
        for seed in 2..8 {
            let (camera, noisy) = pairs(0.3, seed);
            let found = camera_from_points(camera.image_size, &noisy, FREE).unwrap();
            assert!((0.35..0.5).contains(&found.rms_px), "{}", found.rms_px);
            let relative = (found.camera.intrinsics.focal[0] / 2612.0).ln().abs() / found.focal_sigma;
            assert!(relative < 4.0, "{relative} standard deviations");
            centres.push((found.camera.centre() - camera.centre()).norm());
        }
        assert!(median(&centres).unwrap() < 0.002, "{centres:?}");
    }

    #[test]
    fn without_a_lens_the_linear_solution_is_exact_and_with_one_it_is_not() {
        let (camera, bent) = pairs(0.0, 1);
        let plain = Camera { distortion: Distortion::default(), ..camera.clone() };
        let straight: Vec<KnownPoint> =
            bent.iter().map(|it| KnownPoint { pixel: plain.project(&it.place).unwrap(), ..*it }).collect();
        let found = direct_linear_transformation(camera.image_size, &straight).unwrap();
        assert!((found.centre() - camera.centre()).norm() < 1e-6);
        let off = direct_linear_transformation(camera.image_size, &bent).unwrap();
        assert!((off.centre() - camera.centre()).norm() > 1e-3);
    }

    #[test]
    fn wrong_pairs_are_left_out() {
        let (camera, mut pairs) = pairs(0.3, 9);
        for at in [3, 30, 77, 110] {
            pairs[at].pixel.x += 25.0;
        }
        let found = camera_from_points(camera.image_size, &pairs, FREE).unwrap();
        assert!([3, 30, 77, 110].iter().all(|it| !found.used[*it]));
        assert!(found.used.iter().filter(|it| !**it).count() <= 8 && found.rms_px < 0.5, "{}", found.rms_px);
    }

    #[test]
    fn what_fixes_no_camera_is_refused() {
        let (camera, pairs) = pairs(0.0, 1);
        let size = camera.image_size;
        let flat: Vec<KnownPoint> = pairs
            .iter()
            .map(|it| {
                let place = Point3::new(0.05, it.place.y, it.place.z);
                KnownPoint { place, pixel: camera.project(&place).unwrap() }
            })
            .collect();
        assert!(matches!(camera_from_points(size, &flat, FREE), Err(KnownPointsError::Flat { .. })));
        assert!(matches!(camera_from_points(size, &pairs[..5], FREE), Err(KnownPointsError::TooFew { .. })));
        let mirrored: Vec<KnownPoint> = pairs
            .iter()
            .map(|it| KnownPoint { place: Point3::new(it.place.x, -it.place.y, it.place.z), ..*it })
            .collect();
        let refused = camera_from_points(size, &mirrored, FREE);
        assert!(matches!(refused, Err(KnownPointsError::Mirrored { .. })), "{refused:?}");
    }
}
