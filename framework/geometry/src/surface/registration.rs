//! Iterated closest points (ICP), point to plane: the pose of a cloud on a surface, with covariance and unobservable directions.
//!
//! Sources: Y. Chen and G. Medioni, "Object modelling by registration of multiple range images", Image and Vision Computing 10(3), 1992 (point to plane);
//! S. Rusinkiewicz and M. Levoy, "Efficient variants of the ICP algorithm", 3DIM 2001 (rejection of pairs by distance and normal, coarse to fine);
//! N. Gelfand, L. Ikemoto, S. Rusinkiewicz, M. Levoy, "Geometrically stable sampling for the ICP algorithm", 3DIM 2003 (directions in which a cloud slides).
//!
//! | here | meaning | unit |
//! |---|---|---|
//! | `surface_from_cloud` = T | T ⊕ δ = T exp(δ), δ = (ω, v) | –, m |
//! | residual r | n·(m − T p): along the normal n of the match m of point p | m |
//! | its derivative −jᵀδ | j = (p × n′, n′), n′ = Rᵀ n | m, – |
//! | its variance | n′ᵀ Σ n′ + k σₘ² + bend², k points sharing the match | m² |
//!
//! Points that share a match share its error: with the variance of the match k times as large for each, their k pairs
//! together know no more than the match does. Tukey's weights
//! are scaled by the median absolute residual over its σ, the `misfit`; the covariance is scaled by its square, so
//! that stated sigmas that are all too large or small by one factor do no harm.
//!
//! Errors that neighbours share, along a stripe or where two clouds were lit differently, do not average out with more
//! points, and no point's covariance includes them. So the
//! covariance is also estimated by leaving out one cell of points after the other (J. Tukey's jackknife, by clusters
//! as in A. Cameron and D. Miller, "A practitioner's guide to cluster-robust inference", Journal of Human
//! Resources 50(2), 2015; cells of space as clusters: T. Conley, "GMM estimation with cross sectional dependence",
//! Journal of Econometrics 92(1), 1999), for cells of several widths. The stated covariance is in no
//! direction less than any of these, nor than that of independent errors. Errors common to the whole cloud are not included.
//!
//! A direction in which the cloud slides along itself moves no point along its normal. With H = Σ w j jᵀ and M = Σ w
//! Pᵀ P, P = (−[p]×, 1), the eigenvalues μ of H v = μ M v are the mean squared
//! cosines between motion and normal, from 0 to 1 in any units and sizes. Noise of normals alone would make a plane
//! seem constrained; so H is computed between the normals of cloud and surface, whose
//! noise is independent, where the cloud has normals. Unobservable directions stay at the start, with the covariance of the start.

use std::collections::{BTreeMap, HashMap};
use std::ops::AddAssign;

use foveate_estimation::statistics::SIGMA_PER_MAD;
use nalgebra::{
    Cholesky, Isometry3, Matrix3, Matrix3x6, Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6,
};

use super::{Match, Surface, SurfacePoint};

/// Options of [`register`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RegistrationOptions {
    /// Most points of the cloud in use, evenly picked [–].
    pub max_points: usize,
    /// Least number of pairs [–].
    pub min_pairs: usize,
    /// Least part of the points with a match at the end [–].
    pub min_overlap: f64,
    /// Largest accepted robust standard deviation of the residuals over the stated one [–].
    pub max_misfit: f64,
    /// Least mean squared cosine between motion and normal for a direction to count as observable [–].
    pub min_hold: f64,
    /// Largest angle between the normals of a pair [rad].
    pub max_angle: f64,
}

impl Default for RegistrationOptions {
    fn default() -> Self {
        // 0.003: normals that turn by 3° (root mean square) about their mean hold.
        Self { max_points: 6000, min_pairs: 60, min_overlap: 0.3, max_misfit: 6.0, min_hold: 0.003, max_angle: 0.8 }
    }
}

/// The pose of a cloud on a surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Registration {
    /// Maps points of the cloud to the surface.
    pub surface_from_cloud: Isometry3<f64>,
    /// Covariance of δ in `surface_from_cloud` ∘ exp(δ), (rotation, translation) [rad², rad m, m²].
    pub covariance: Matrix6<f64>,
    /// Unobservable directions δ, each scaled to move the points by 1 m (root mean square); the pose along them is that of the start.
    pub not_held: Vec<Vector6<f64>>,
    /// Mean squared cosine between motion and normal in the least observable direction [–].
    pub hold: f64,
    /// Number of inlier pairs.
    pub n_pairs: usize,
    /// Part of the points with an inlier match [–].
    pub overlap: f64,
    /// Robust standard deviation of the residuals over the stated one [–].
    pub misfit: f64,
    /// Iterations over all levels.
    pub n_steps: usize,
    /// Root mean square motion of the points for one standard deviation of the pose [m].
    pub sigma: f64,
    /// Distance that the cloud's origin moved from the start [m].
    pub moved: f64,
}

/// Why there is no pose.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum RegistrationError {
    /// The cloud has too few points.
    #[error("{count} points, expected at least {expected}")]
    TooFewPoints {
        /// Number of points.
        count: usize,
        /// Number that is needed.
        expected: usize,
    },
    /// The cloud does not overlap the surface enough.
    #[error("{:.0} % of the points lie on the surface, expected at least {:.0} %", 100.0 * overlap, 100.0 * expected)]
    NoOverlap {
        /// Overlap that was found.
        overlap: f64,
        /// Overlap that is needed.
        expected: f64,
    },
    /// Residuals too large: another shape, or a local minimum.
    #[error("residuals are {misfit:.1} times as large as their sigmas, expected at most {expected:.1} times")]
    Misfit {
        /// Residuals over their sigmas.
        misfit: f64,
        /// Largest accepted ratio.
        expected: f64,
    },
    /// The iteration did not converge.
    #[error("the last step moved points by {moved_m:.1e} m, expected less than their sigma of {sigma_m:.1e} m")]
    NotConverged {
        /// Root mean square motion of the points by the last step [m].
        moved_m: f64,
        /// Root mean square motion for one standard deviation of the pose [m].
        sigma_m: f64,
    },
    /// The start is not finite, or its covariance not positive.
    #[error("the start or its covariance is not finite and positive")]
    BadStart,
}

/// Steps on a level at most.
const MAX_STEPS: usize = 40;
/// A level has converged when a step is this part of the pose's sigma [–].
const STEP_OF_SIGMA: f64 = 0.02;
/// Coarse levels only lead the way [–].
const STEP_OF_SIGMA_COARSE: f64 = 0.1;
/// Of Tukey's weights: 95 % efficiency on normal residuals.
const TUKEY: f64 = 4.685;
/// 1 over that efficiency.
const TUKEY_VARIANCE: f64 = 1.0 / 0.95;
/// The scale of residuals is at least this, over what was stated [–].
const LEAST_MISFIT: f64 = 0.05;
/// Widths of the cells within which errors may be shared [bins].
const CELLS: [i64; 4] = [3, 6, 12, 16];
/// Into so many bins the widest side of a cloud is parted.
const BINS: i64 = 48;
/// What fewer of them scatter by says too little.
const MIN_CELLS: f64 = 12.0;

/// Registers `cloud` on `surface` from `start`. `start_covariance` is of δ in `start` ∘ exp(δ); it enters as a
/// measurement, and decides which levels of the surface are tried.
///
/// # Errors
/// See [`RegistrationError`]; a pose that was not verified to fit is never returned.
pub fn register(
    cloud: &[SurfacePoint],
    surface: &impl Surface,
    start: &Isometry3<f64>,
    start_covariance: &Matrix6<f64>,
    options: &RegistrationOptions,
) -> Result<Registration, RegistrationError> {
    let sound: Vec<&SurfacePoint> = cloud.iter().filter(|it| it.is_sound()).collect();
    let prior = Cholesky::new(*start_covariance).map(|it| it.inverse()).filter(|it| it.sum().is_finite());
    let Some(prior) = prior.filter(|_| start.to_homogeneous().sum().is_finite()) else {
        return Err(RegistrationError::BadStart);
    };
    if sound.len() < options.min_pairs.max(6) {
        return Err(RegistrationError::TooFewPoints { count: sound.len(), expected: options.min_pairs.max(6) });
    }
    let step = sound.len().div_ceil(options.max_points.max(1));
    let points: Vec<SurfacePoint> = sound.into_iter().step_by(step).copied().collect();
    let mut fit = Fit { points: &points, start: *start, prior, pose: *start, options };
    // Twice the motion that the start leaves open lies within reach; the levels below follow.
    let open = fit.motion(start_covariance);
    let coarsest = (0..surface.n_levels()).find(|it| surface.reach(*it) >= 2.0 * open);
    let coarsest = coarsest.unwrap_or(surface.n_levels() - 1);
    let (mut n_steps, mut last) = (0, None);
    for level in (0..=coarsest).rev() {
        for _ in 0..MAX_STEPS {
            let Some(solved) = fit.step(surface, level) else { break };
            n_steps += 1;
            let limit = if level == 0 { STEP_OF_SIGMA } else { STEP_OF_SIGMA_COARSE };
            let is_small = solved.moved <= limit * solved.sigma;
            last = (level == 0).then_some(solved);
            if is_small {
                break;
            }
        }
    }
    let Some(solved) = last else {
        return Err(RegistrationError::NoOverlap { overlap: 0.0, expected: options.min_overlap });
    };
    let overlap = solved.n_inliers as f64 / points.len() as f64;
    if overlap < options.min_overlap || solved.n_inliers < options.min_pairs {
        return Err(RegistrationError::NoOverlap { overlap, expected: options.min_overlap });
    }
    if solved.misfit > options.max_misfit {
        return Err(RegistrationError::Misfit { misfit: solved.misfit, expected: options.max_misfit });
    }
    if solved.moved > solved.sigma {
        return Err(RegistrationError::NotConverged { moved_m: solved.moved, sigma_m: solved.sigma });
    }
    let covariance = fit.shared(surface, &solved);
    Ok(Registration {
        surface_from_cloud: fit.pose,
        covariance,
        not_held: solved.not_held,
        hold: solved.hold,
        n_pairs: solved.n_inliers,
        overlap,
        misfit: solved.misfit,
        n_steps,
        sigma: fit.motion(&covariance),
        moved: (fit.pose.translation.vector - start.translation.vector).norm(),
    })
}

/// A registration under way.
struct Fit<'a> {
    points: &'a [SurfacePoint],
    start: Isometry3<f64>,
    /// Inverse of the start's covariance.
    prior: Matrix6<f64>,
    pose: Isometry3<f64>,
    options: &'a RegistrationOptions,
}

/// What a step was like.
struct Solved {
    /// Of errors that are independent.
    covariance: Matrix6<f64>,
    /// Takes what slides out of a δ.
    projector: Matrix6<f64>,
    /// Of weights, for the misfit [–].
    scale: f64,
    not_held: Vec<Vector6<f64>>,
    hold: f64,
    misfit: f64,
    n_inliers: usize,
    /// Root mean square motion of the points by the step, and by one standard deviation of the pose [m].
    moved: f64,
    sigma: f64,
}

/// One point and its match.
struct Pair {
    point: Point3<f64>,
    /// Normal of the match, and of the point, in the cloud's space.
    normal: Vector3<f64>,
    own_normal: Vector3<f64>,
    residual: f64,
    point_variance: f64,
    found: Match,
}

/// Pairs with their weights.
struct Weighted {
    pairs: Vec<Pair>,
    /// 0 for outliers [1/m²].
    weights: Vec<f64>,
    misfit: f64,
    n_inliers: usize,
}

impl Weighted {
    fn inliers(&self) -> impl Iterator<Item = (&Pair, f64)> {
        self.pairs.iter().zip(self.weights.iter().copied()).filter(|it| it.1 > 0.0)
    }
}

/// What the pairs of a part of the cloud give to the normal equations.
#[derive(Clone, Copy, Default)]
struct Part {
    hessian: Matrix6<f64>,
    slope: Vector6<f64>,
}

impl AddAssign<&Part> for Part {
    fn add_assign(&mut self, other: &Part) {
        self.hessian += other.hessian;
        self.slope += other.slope;
    }
}

impl Pair {
    /// Of the residual's derivative, for either normal.
    fn direction(&self, normal: &Vector3<f64>) -> Vector6<f64> {
        let turn = self.point.coords.cross(normal);
        Vector6::new(turn.x, turn.y, turn.z, normal.x, normal.y, normal.z)
    }
}

/// How a point moves with δ.
pub(super) fn motion_of(point: &Point3<f64>) -> Matrix3x6<f64> {
    let mut motion = Matrix3x6::zeros();
    motion.fixed_view_mut::<3, 3>(0, 0).copy_from(&-point.coords.cross_matrix());
    motion.fixed_view_mut::<3, 3>(0, 3).copy_from(&Matrix3::identity());
    motion
}

impl Fit<'_> {
    fn pairs(&self, surface: &impl Surface, level: usize) -> Vec<Pair> {
        let least_cosine = self.options.max_angle.cos();
        let back = self.pose.rotation.inverse();
        let pair = |it: &SurfacePoint| {
            let place = self.pose * it.position;
            let found = surface.nearest(level, &place)?;
            let normal = back * found.normal;
            let is_like = it.normal == Vector3::zeros() || it.normal.dot(&normal) >= least_cosine;
            is_like.then(|| Pair {
                point: it.position,
                normal,
                own_normal: it.normal,
                residual: found.normal.dot(&(found.position - place)),
                point_variance: it.variance_along(&normal),
                found,
            })
        };
        self.points.iter().filter_map(pair).collect()
    }

    /// New pairs, each with its weight, zero for outliers. `None`: too few of them.
    fn weighted(&self, surface: &impl Surface, level: usize) -> Option<Weighted> {
        let pairs = self.pairs(surface, level);
        if pairs.len() < self.options.min_pairs.max(6) {
            return None;
        }
        let mut sharing: HashMap<usize, f64> = HashMap::with_capacity(pairs.len());
        pairs.iter().for_each(|it| *sharing.entry(it.found.number).or_default() += 1.0);
        let bend = surface.bend(level).powi(2);
        let variance = |it: &Pair| it.point_variance + sharing[&it.found.number] * it.found.variance + bend;
        let variances: Vec<f64> = pairs.iter().map(variance).collect();
        let mut sizes: Vec<f64> = pairs.iter().zip(&variances).map(|(it, v)| it.residual.abs() / v.sqrt()).collect();
        let middle = sizes.len() / 2;
        let median = *sizes.select_nth_unstable_by(middle, f64::total_cmp).1;
        let misfit = (SIGMA_PER_MAD * median).max(LEAST_MISFIT);
        let weight = |(pair, variance): (&Pair, &f64)| {
            let share = pair.residual / (TUKEY * misfit * variance.sqrt());
            (1.0 - share * share).max(0.0).powi(2) / variance
        };
        let weights: Vec<f64> = pairs.iter().zip(&variances).map(weight).collect();
        let n_inliers = weights.iter().filter(|it| **it > 0.0).count();
        (n_inliers >= 6).then_some(Weighted { pairs, weights, misfit, n_inliers })
    }

    /// New pairs, and one step of weighted least squares. `None`: too few pairs.
    fn step(&mut self, surface: &impl Surface, level: usize) -> Option<Solved> {
        let weighted = self.weighted(surface, level)?;
        let Weighted { misfit, n_inliers, .. } = weighted;
        let (mut hessian, mut crossed, mut motions) = (Matrix6::zeros(), Matrix6::zeros(), Matrix6::zeros());
        let (mut slope, mut n_oriented) = (Vector6::zeros(), 0);
        for (pair, weight) in weighted.inliers() {
            let direction = pair.direction(&pair.normal);
            hessian += direction * direction.transpose() * weight;
            slope += direction * (pair.residual * weight);
            let motion = motion_of(&pair.point);
            motions += motion.transpose() * motion * weight;
            if pair.own_normal != Vector3::zeros() {
                n_oriented += 1;
                let own = pair.direction(&pair.own_normal);
                let both = direction * own.transpose() * weight;
                crossed += (both + both.transpose()) * 0.5;
            }
        }
        let shape = if 2 * n_oriented > n_inliers { crossed * (n_inliers as f64 / n_oriented as f64) } else { hessian };
        let Slides { hold, not_held, projector } = slides(&shape, &motions, self.options.min_hold)?;
        let scale = 1.0 / (misfit * misfit * TUKEY_VARIANCE);
        let data = projector.transpose() * hessian * projector * scale;
        let slope = projector.transpose() * slope * scale;
        let off = self.start.inverse() * self.pose;
        let mut from_start = Vector6::zeros();
        from_start.fixed_rows_mut::<3>(0).copy_from(&off.rotation.scaled_axis());
        from_start.fixed_rows_mut::<3>(3).copy_from(&off.translation.vector);
        let whole = Cholesky::new(data + self.prior)?;
        let delta = whole.solve(&(slope - self.prior * from_start));
        let covariance = whole.inverse();
        if !delta.sum().is_finite() {
            return None;
        }
        let (turn, shift) = (delta.fixed_rows::<3>(0).into_owned(), delta.fixed_rows::<3>(3).into_owned());
        self.pose *= Isometry3::from_parts(Translation3::from(shift), UnitQuaternion::from_scaled_axis(turn));
        let moved = self.motion(&(delta * delta.transpose()));
        let sigma = self.motion(&covariance);
        Some(Solved { covariance, projector, scale, not_held, hold, misfit, n_inliers, moved, sigma })
    }

    /// The covariance where errors are shared by neighbours: by what each cell alone pulls the pose to, for cells of several widths.
    fn shared(&self, surface: &impl Surface, solved: &Solved) -> Matrix6<f64> {
        let weighted = self.weighted(surface, 0);
        let Some((weighted, whole)) = weighted.zip(solved.covariance.try_inverse()) else { return solved.covariance };
        let (mut least, mut most) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        for (pair, _) in weighted.inliers() {
            (least, most) = (least.inf(&pair.point.coords), most.sup(&pair.point.coords));
        }
        let per_bin = BINS as f64 / (most - least).max();
        let mut bins: BTreeMap<[i64; 3], Part> = BTreeMap::new();
        for (pair, weight) in weighted.inliers() {
            let bin = ((pair.point.coords - least) * per_bin).map(|it| it as i64);
            let direction = solved.projector.transpose() * pair.direction(&pair.normal);
            let weight = weight * solved.scale;
            let part = bins.entry(bin.into()).or_default();
            part.hessian += direction * direction.transpose() * weight;
            part.slope += direction * (pair.residual * weight);
        }
        let prior = solved.covariance * self.prior * solved.covariance;
        CELLS.into_iter().fold(solved.covariance, |covariance, width| {
            let (mut spread, mut n) = (Matrix6::zeros(), 0.0);
            // Where borders of cells lie is chance.
            for shift in [0, width / 2] {
                let mut cells: BTreeMap<[i64; 3], Part> = BTreeMap::new();
                for (bin, part) in &bins {
                    *cells.entry(bin.map(|it| (it + shift) / width)).or_default() += part;
                }
                n += 0.5 * cells.len() as f64;
                let moved = |it: &Part| Some(Cholesky::new(whole - it.hessian)?.solve(&it.slope));
                spread += cells.values().filter_map(moved).map(|it| it * it.transpose() * 0.5).sum::<Matrix6<f64>>();
            }
            if n < MIN_CELLS { covariance } else { larger(&covariance, &(spread * ((n - 1.0) / n) + prior)) }
        })
    }

    /// Root mean square motion of the points by what has a covariance [m].
    fn motion(&self, covariance: &Matrix6<f64>) -> f64 {
        let few = self.points.iter().step_by(self.points.len().div_ceil(200));
        let (mut sum, mut n) = (0.0, 0.0);
        for point in few {
            let motion = motion_of(&point.position);
            sum += (motion * covariance * motion.transpose()).trace();
            n += 1.0;
        }
        (sum / n).sqrt()
    }
}

/// The least covariance that is in no direction less than either.
fn larger(one: &Matrix6<f64>, other: &Matrix6<f64>) -> Matrix6<f64> {
    let Some(lower) = Cholesky::new(*one).map(|it| it.l()) else { return *other };
    let Some(inverse) = lower.try_inverse() else { return *other };
    let eigen = (inverse * other * inverse.transpose()).symmetric_eigen();
    let axes = lower * eigen.eigenvectors;
    axes * Matrix6::from_diagonal(&eigen.eigenvalues.map(|it| it.max(1.0))) * axes.transpose()
}

/// Directions in which a cloud slides along itself.
pub(super) struct Slides {
    pub(super) hold: f64,
    pub(super) not_held: Vec<Vector6<f64>>,
    /// Takes those out of a δ.
    pub(super) projector: Matrix6<f64>,
}

/// `None`: all points lie on a line.
pub(super) fn slides(shape: &Matrix6<f64>, motions: &Matrix6<f64>, min_hold: f64) -> Option<Slides> {
    let lower = Cholesky::new(*motions)?.l();
    let inverse = lower.try_inverse()?;
    let eigen = (inverse * shape * inverse.transpose()).symmetric_eigen();
    let (mut projector, mut not_held) = (Matrix6::identity(), Vec::new());
    let weight: f64 = motions.fixed_view::<3, 3>(3, 3).trace() / 3.0;
    for (hold, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        if *hold < min_hold {
            let direction = inverse.transpose() * vector;
            projector -= direction * direction.transpose() * motions;
            not_held.push(direction * weight.sqrt());
        }
    }
    Some(Slides { hold: eigen.eigenvalues.min(), not_held, projector })
}
