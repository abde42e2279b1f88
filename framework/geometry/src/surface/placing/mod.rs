//! Global registration: the pose of one shape on another without a start, rigid or with a scale.
//!
//! 1. Coarse registrations start from many evenly spread rotations, each with the middle of the one shape on the
//!    middle of that part of the other which would face the same way; the given pose is
//!    one of the starts.
//! 2. Where both shapes are mostly one plane, which would dominate, further starts come from what stands out of it,
//!    and such points count four times as much as all others together.
//! 3. The starts that lay most of the shape on the other continue with full detail.
//! 4. The best of these is adjusted, point to plane, against the exact nearest places of the other shape, with or
//!    without a scale: Gauss–Newton steps under Tukey's weights.
//! 5. All of it is repeated without the planes that hold most of either shape, up to three: objects in front of a
//!    wall, and a wall that only one shape shows. The result with most overlap of both is kept.
//!
//! Sources: M. Alexa, "Super-Fibonacci spirals: fast, low-discrepancy sampling of SO(3)", CVPR 2022 (rotations); those of [`super::registration`].
//!
//! | here | meaning | unit |
//! |---|---|---|
//! | `b_from_a` = S | S p = s R p + t; S ⊕ δ = exp(ω)(S p − c)(1 + σ) + c + v, δ = (ω, v, σ), c the middle of the points in b | –, m |
//! | residual | n·(m − S p): along the normal n of the nearest place m | m |

use std::ops::RangeInclusive;

use foveate_estimation::statistics::{SIGMA_PER_MAD, median};
use nalgebra::{
    Cholesky, Isometry3, Matrix6, Point3, Quaternion, SMatrix, SVector, Similarity3, Translation3, UnitQuaternion,
    Vector3,
};

use super::planes::{Flat, starts};
use super::registration::slides;
use super::{Patches, RegistrationOptions, Shape, SurfacePoint, register};

/// Options of [`place`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacingOptions {
    /// Whether to estimate a scale near 1 between a and b.
    pub scale: bool,
    /// Number of rotations tried [–].
    pub n_starts: usize,
    /// Largest distance of a pair [m].
    pub most: f64,
}

/// The pose of a shape on another.
#[derive(Debug, Clone, PartialEq)]
pub struct Placing {
    /// Maps points of a to b.
    pub b_from_a: Similarity3<f64>,
    /// Part of a's points that lie on b, within the scatter [–].
    pub overlap: f64,
    /// Robust standard deviation of the distances along b's normals [m].
    pub sigma: f64,
    /// Number of directions, of six, in which a slides along b: unobservable.
    pub n_open: usize,
    /// Rotation and shift of the middle to another pose that fits nearly as well [rad, m]: a symmetry.
    pub other: Option<(f64, f64)>,
}

/// Why no pose was found.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PlacingError {
    /// Either shape has too few points with normals.
    #[error("{count} points with a normal, expected at least {expected}")]
    TooFewPoints {
        /// Number of points.
        count: usize,
        /// Number that is needed.
        expected: usize,
    },
    /// No start led to enough overlap.
    #[error("{:.0} % of one lie on the other at best, expected at least {:.0} %", 100.0 * overlap, 100.0 * expected)]
    NoOverlap {
        /// Best overlap that was found.
        overlap: f64,
        /// Overlap that is needed.
        expected: f64,
    },
    /// With a scale, every place that was found shrinks or swells the one beyond what a scale is for.
    #[error("the place found has the scale {scale:.3}, expected {} to {}: a shape that shrinks to a spot lies on anything", SCALES.start(), SCALES.end())]
    Scale {
        /// That of the best such place.
        scale: f64,
    },
}

/// Scales of a placing: those between shapes whose unit is known; that of a wrong unit is beyond.
const SCALES: RangeInclusive<f64> = 0.5..=2.0;

/// Points of a that a start takes, that its worth is judged by, and that the adjustment takes.
const POINTS: [usize; 3] = [350, 1500, 20_000];
/// Cells of the coarse surface across the extent of b, and of the fine one.
const CELLS: [f64; 2] = [24.0, 100.0];
const LEVELS: [usize; 2] = [3, 4];
/// Starts that go on with all detail.
const FINALISTS: usize = 6;
/// Beside these, starts that lay plane on plane.
const FLAT_FINALISTS: usize = 12;
/// Points of either shape at least.
const MIN_POINTS: usize = 100;
/// Part of a's points that must lie on b; or of b's on a, where planes are left out.
const MIN_OVERLAP: f64 = 0.2;
/// Planes that are left out at most.
const MOST_PLANES: usize = 3;
/// Without a plane a place must be better than with it by this factor, where the parts of both that lie on the other are added.
const BETTER: f64 = 1.03;
/// Another place is another one beyond this turn [rad] or this part of the extent, and fits as well above this part of the best worth.
const OTHER_TURN: f64 = 0.17;
const OTHER_SHIFT: f64 = 0.05;
const AS_WELL: f64 = 0.9;
/// Finalists worth at least this part of the best one are adjusted.
const WORTH_ADJUSTING: f64 = 0.8;
/// The place given is kept where it is worth at least this part of the best one.
const AS_GIVEN: f64 = 0.99;
/// Steps of the adjustment at most; it has converged when a step moves points by less than this part of the extent.
const STEPS: usize = 80;
const LEAST_STEP: f64 = 1e-8;
/// Of Tukey's weights.
const TUKEY: f64 = 4.685;
/// Normals of a pair agree to within 60°.
const LEAST_COSINE: f64 = 0.5;
/// Mean squared cosine between motion and normal from which on a direction is held, as in [`RegistrationOptions`].
const MIN_HOLD: f64 = 0.003;

/// Finds the pose of `a` on `b`, both in the same unit. Normals of `a`, where known, point to the same side as those of `b`.
///
/// # Errors
/// See [`PlacingError`].
pub fn place(a: &Shape, b: &Shape, options: &PlacingOptions) -> Result<Placing, PlacingError> {
    let sigma = b.extent() / CELLS[0] * 0.1;
    let of_a: Vec<SurfacePoint> = with_sigma(a.samples(POINTS[2]), sigma);
    let on_b: Vec<SurfacePoint> = with_sigma(b.samples(POINTS[2]), sigma);
    let on_b: Vec<SurfacePoint> = on_b.into_iter().filter(|it| it.normal != Vector3::zeros()).collect();
    for count in [of_a.len(), on_b.len()] {
        if count < MIN_POINTS {
            return Err(PlacingError::TooFewPoints { count, expected: MIN_POINTS });
        }
    }
    let parts = [without_planes(of_a, a.extent()), without_planes(on_b, b.extent())];
    let tolerance = a.extent().min(b.extent()) / CELLS[1];
    let mut best: Option<(f64, Placing)> = None;
    let mut all: Vec<(f64, Placing)> = Vec::new();
    let mut failed = PlacingError::NoOverlap { overlap: 0.0, expected: MIN_OVERLAP };
    for (at, (left_a, left_b)) in pairs_of_parts(parts[0].len(), parts[1].len()).enumerate() {
        let [of_a, on_b] = [&parts[0][left_a], &parts[1][left_b]];
        let extent = if left_b == 0 { b.extent() } else { extent(on_b) };
        let mut placing = match place_part(b, of_a, on_b, extent, options) {
            Ok(it) => it,
            Err(it) if at == 0 => {
                failed = it;
                continue;
            }
            Err(_) => continue,
        };
        placing.overlap *= of_a.len() as f64 / parts[0][0].len() as f64;
        let back = placing.b_from_a.inverse();
        let shares = [
            worth(&parts[0][0], b, &placing.b_from_a, tolerance.min(options.most)),
            worth(&parts[1][0], a, &back, tolerance.min(options.most) * back.scaling()),
        ];
        let score = shares[0] + shares[1];
        let holds = at == 0 || shares[0].max(shares[1]) >= MIN_OVERLAP;
        all.push((score, placing.clone()));
        if holds && best.as_ref().is_none_or(|it| score > BETTER * it.0) {
            best = Some((score, placing));
        }
    }
    let (score, mut best) = best.ok_or(failed)?;
    let middle = middle(parts[0][0].iter().map(|it| it.position)).unwrap_or_else(Point3::origin);
    let mut others =
        all.iter().filter(|it| it.0 >= AS_WELL * score).map(|it| apart(&it.1.b_from_a, &best.b_from_a, &middle));
    let other = others.find(|it| is_other(*it, b.extent()));
    best.other = best.other.or(other);
    Ok(best)
}

/// How far poses are turned from one another, and how far they move `middle` apart [rad, m].
fn apart(a: &Similarity3<f64>, b: &Similarity3<f64>, middle: &Point3<f64>) -> (f64, f64) {
    (a.isometry.rotation.angle_to(&b.isometry.rotation), (a * middle - b * middle).norm())
}

/// Whether poses so far apart are two places on a shape of this extent.
fn is_other((turn, shift): (f64, f64), extent: f64) -> bool {
    turn > OTHER_TURN || shift > OTHER_SHIFT * extent
}

/// The points, those without the plane that holds most of them, those without that of these, and so on, for as long as planes hold a good part.
fn without_planes(points: Vec<SurfacePoint>, whole: f64) -> Vec<Vec<SurfacePoint>> {
    let mut parts = vec![points];
    while let (true, Some(last)) = (parts.len() <= MOST_PLANES, parts.last()) {
        let size = if parts.len() == 1 { whole } else { extent(last) };
        let Some(rest) = Flat::of(last, size).map(|it| it.standing_out(last)) else { break };
        if rest.len() < MIN_POINTS {
            break;
        }
        parts.push(rest);
    }
    parts
}

/// How many planes are left out of a and of b: none, some of one of them, one of each.
fn pairs_of_parts(n_a: usize, n_b: usize) -> impl Iterator<Item = (usize, usize)> {
    let of_both = (n_a > 1 && n_b > 1).then_some((1, 1));
    std::iter::once((0, 0)).chain((1..n_a).map(|it| (it, 0))).chain((1..n_b).map(|it| (0, it))).chain(of_both)
}

/// Diagonal of the box around all but a few of the points [m].
fn extent(points: &[SurfacePoint]) -> f64 {
    let along = |axis: usize| {
        let mut values: Vec<f64> = points.iter().map(|it| it.position[axis]).collect();
        values.sort_unstable_by(f64::total_cmp);
        let few = values.len() / 100;
        values[values.len() - 1 - few] - values[few]
    };
    Vector3::new(along(0), along(1), along(2)).norm()
}

/// Places points of a on those of b; `extent`: of the latter.
fn place_part(
    b: &Shape,
    of_a: &[SurfacePoint],
    on_b: &[SurfacePoint],
    extent: f64,
    options: &PlacingOptions,
) -> Result<Placing, PlacingError> {
    let some: Vec<SurfacePoint> = of_a.iter().step_by(of_a.len().div_ceil(POINTS[1])).copied().collect();
    let flat = Flat::of(of_a, extent).zip(Flat::of(on_b, extent));
    let judged = flat.as_ref().map_or_else(|| some.clone(), |it| it.0.balanced(of_a, POINTS[1]));
    let search = Search { b, on_b, some: &some, judged: &judged, extent, most: options.most };
    let mut found = search.coarse(of_a, options.n_starts);
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut finalists: Vec<(f64, Isometry3<f64>)> = Vec::new();
    for (worth, pose) in found {
        if finalists.len() < FINALISTS && finalists.iter().all(|it| search.is_other(&rigid(&it.1), &rigid(&pose))) {
            finalists.push((worth, pose));
        }
    }
    if let Some((of_a_flat, of_b_flat)) = &flat {
        let has_sides = of_a.iter().any(|it| it.normal != Vector3::zeros());
        let flats = [(of_a_flat, of_a), (of_b_flat, on_b)];
        finalists.extend(starts(flats, extent, has_sides, FLAT_FINALISTS).into_iter().map(|it| (0.0, it)));
    }
    let fine = search.surface(1);
    let options_of = RegistrationOptions { min_overlap: 0.05, max_misfit: f64::INFINITY, ..Default::default() };
    let tolerance = extent / CELLS[1];
    for (worth, pose) in &mut finalists {
        let start = search.open(extent / CELLS[0]);
        if let Ok(it) = register(&judged, &fine, pose, &start, &options_of) {
            *pose = it.surface_from_cloud;
        }
        *worth = search.worth(&rigid(pose), tolerance);
    }
    finalists.sort_by(|a, b| b.0.total_cmp(&a.0));
    let Some(most) = finalists.first().map(|it| it.0) else {
        return Err(PlacingError::NoOverlap { overlap: 0.0, expected: MIN_OVERLAP });
    };
    // With a scale, only the adjustment says how well a place fits.
    let mut adjusted_ones: Vec<(f64, Placing)> = Vec::new();
    let mut failed = PlacingError::NoOverlap { overlap: 0.0, expected: MIN_OVERLAP };
    for (_, pose) in finalists.iter().filter(|it| it.0 >= WORTH_ADJUSTING * most) {
        match adjusted(&judged, b, &rigid(pose), options, extent) {
            Ok(it) => adjusted_ones.push((search.worth(&it.b_from_a, tolerance), it)),
            Err(it) => failed = it,
        }
    }
    adjusted_ones.sort_by(|a, b| b.0.total_cmp(&a.0));
    let Some((best_worth, best)) = adjusted_ones.first().cloned() else { return Err(failed) };
    let is_given = |it: &&(f64, Placing)| {
        it.0 >= AS_GIVEN * best_worth && !search.is_other(&it.1.b_from_a, &Similarity3::identity())
    };
    let best = adjusted_ones.iter().find(is_given).map_or(best, |it| it.1.clone());
    let mut placing = adjusted(of_a, b, &best.b_from_a, options, extent)?;
    if placing.overlap < MIN_OVERLAP {
        return Err(PlacingError::NoOverlap { overlap: placing.overlap, expected: MIN_OVERLAP });
    }
    let chosen = placing.b_from_a;
    let is_as_good = |it: &&(f64, Placing)| {
        it.0 >= AS_WELL * best_worth && it.1.sigma < placing.sigma / AS_WELL && search.is_other(&it.1.b_from_a, &chosen)
    };
    placing.other = adjusted_ones.iter().find(is_as_good).map(|(_, it)| apart(&it.b_from_a, &chosen, &search.middle()));
    Ok(placing)
}

fn rigid(pose: &Isometry3<f64>) -> Similarity3<f64> {
    Similarity3::from_isometry(*pose, 1.0)
}

fn with_sigma(mut points: Vec<SurfacePoint>, sigma: f64) -> Vec<SurfacePoint> {
    points.iter_mut().for_each(|it| it.covariance = nalgebra::Matrix3::identity() * (sigma * sigma));
    points
}

struct Search<'a> {
    b: &'a Shape,
    on_b: &'a [SurfacePoint],
    /// Of a, evenly spread.
    some: &'a [SurfacePoint],
    /// Of a, those that poses are judged and adjusted by.
    judged: &'a [SurfacePoint],
    extent: f64,
    most: f64,
}

impl Search<'_> {
    fn middle(&self) -> Point3<f64> {
        middle(self.some.iter().map(|it| it.position)).unwrap_or_else(Point3::origin)
    }

    fn surface(&self, stage: usize) -> Patches {
        let mut patches = Patches::new(self.extent / CELLS[stage], LEVELS[stage], usize::MAX);
        for point in self.on_b {
            patches.add(point);
        }
        patches
    }

    /// Of a pose that may be off by so much [m].
    fn open(&self, shift: f64) -> Matrix6<f64> {
        let turn = 2.0 * shift / self.extent;
        let variance = |it: usize| if it < 3 { turn * turn } else { shift * shift };
        Matrix6::from_fn(|row, column| if row == column { variance(row) } else { 0.0 })
    }

    /// Poses with what each is worth, from all starts.
    fn coarse(&self, of_a: &[SurfacePoint], n_starts: usize) -> Vec<(f64, Isometry3<f64>)> {
        let patches = self.surface(0);
        let few: Vec<SurfacePoint> = of_a.iter().step_by(of_a.len().div_ceil(POINTS[0])).copied().collect();
        let options = RegistrationOptions { min_overlap: 0.05, max_misfit: f64::INFINITY, ..Default::default() };
        let middle_a = self.middle();
        let facing: Vector3<f64> = self.some.iter().map(|it| it.normal).sum();
        let start = |rotation: UnitQuaternion<f64>| {
            // Of what looks the same way on the whole, so that a view of one side comes to lie on that side.
            let way = rotation * facing;
            let same = self.on_b.iter().filter(|it| it.normal.dot(&way) > 0.0 || facing == Vector3::zeros());
            let middle_b = middle(same.map(|it| it.position)).unwrap_or(middle_a);
            let turned = rotation * middle_a;
            Isometry3::from_parts(Translation3::from(middle_b - turned), rotation)
        };
        let n = n_starts.max(1);
        let rotations = (0..n).map(|it| super_fibonacci(it, n));
        let starts: Vec<Isometry3<f64>> = std::iter::once(Isometry3::identity()).chain(rotations.map(start)).collect();
        let open = self.open(4.0 * self.extent / CELLS[0]);
        let one = |start: &Isometry3<f64>| {
            let found = register(&few, &patches, start, &open, &options).ok()?.surface_from_cloud;
            Some((self.worth(&rigid(&found), self.extent / CELLS[0]), found))
        };
        let threads = std::thread::available_parallelism().map_or(1, |it| it.get());
        let share = starts.len().div_ceil(threads);
        std::thread::scope(|scope| {
            let parts: Vec<_> = starts
                .chunks(share)
                .map(|part| scope.spawn(|| part.iter().filter_map(one).collect::<Vec<_>>()))
                .collect();
            parts.into_iter().flat_map(|it| it.join().unwrap_or_default()).collect()
        })
    }

    /// How much of a lies on b.
    fn worth(&self, pose: &Similarity3<f64>, tolerance: f64) -> f64 {
        worth(self.judged, self.b, pose, tolerance.min(self.most))
    }

    fn is_other(&self, a: &Similarity3<f64>, b: &Similarity3<f64>) -> bool {
        is_other(apart(a, b, &self.middle()), self.extent)
    }
}

/// How much of the points lies on a shape: Σ 1 − (d / tolerance)² of those nearer than the tolerance, over all [–].
fn worth(points: &[SurfacePoint], shape: &Shape, pose: &Similarity3<f64>, tolerance: f64) -> f64 {
    let one = |it: &SurfacePoint| {
        let place = pose * it.position;
        let nearest = shape.nearest_within(&place, tolerance)?;
        let agrees = agree(&(pose.isometry.rotation * it.normal), &nearest.normal);
        agrees.then(|| 1.0 - ((nearest.place - place).norm() / tolerance).powi(2))
    };
    points.iter().filter_map(one).sum::<f64>() / points.len() as f64
}

/// Whether normals of a pair look the same way; those that are not known do.
fn agree(a: &Vector3<f64>, b: &Vector3<f64>) -> bool {
    *a == Vector3::zeros() || *b == Vector3::zeros() || a.dot(b) >= LEAST_COSINE
}

fn middle(points: impl Iterator<Item = Point3<f64>>) -> Option<Point3<f64>> {
    let (sum, n) = points.fold((Vector3::zeros(), 0.0), |(sum, n), it| (sum + it.coords, n + 1.0));
    (n > 0.0).then(|| Point3::from(sum / n))
}

/// Rotation `number` of `n` that are spread evenly.
fn super_fibonacci(number: usize, n: usize) -> UnitQuaternion<f64> {
    const PSI: f64 = 1.533_751_168_755_204_3;
    let place = number as f64 + 0.5;
    let t = place / n as f64;
    let [alpha, beta] = [std::f64::consts::SQRT_2, PSI].map(|it| std::f64::consts::TAU * place / it);
    let (r, rest) = (t.sqrt(), (1.0 - t).sqrt());
    UnitQuaternion::from_quaternion(Quaternion::new(
        rest * beta.cos(),
        r * alpha.sin(),
        r * alpha.cos(),
        rest * beta.sin(),
    ))
}

/// The same, adjusted to the exact nearest places.
fn adjusted(
    of_a: &[SurfacePoint],
    b: &Shape,
    start: &Similarity3<f64>,
    options: &PlacingOptions,
    extent: f64,
) -> Result<Placing, PlacingError> {
    let mut pose = *start;
    let mut tolerance = options.most.min(extent / CELLS[0]);
    let (mut overlap, mut sigma, mut n_open) = (0.0, 0.0, 0);
    for step in 0..STEPS {
        // Residual, normal of b, place.
        let mut pairs: Vec<(f64, Vector3<f64>, Point3<f64>)> = Vec::new();
        for point in of_a {
            let place = pose * point.position;
            let Some(nearest) = b.nearest_within(&place, tolerance) else { continue };
            let own = pose.isometry.rotation * point.normal;
            if !nearest.is_edge && nearest.normal != Vector3::zeros() && agree(&own, &nearest.normal) {
                pairs.push((nearest.normal.dot(&(nearest.place - place)), nearest.normal, place));
            }
        }
        if pairs.len() < MIN_POINTS / 2 {
            let overlap = pairs.len() as f64 / of_a.len() as f64;
            return Err(PlacingError::NoOverlap { overlap, expected: MIN_OVERLAP });
        }
        let sizes: Vec<f64> = pairs.iter().map(|it| it.0.abs()).collect();
        sigma = (SIGMA_PER_MAD * median(&sizes).unwrap_or(0.0)).max(1e-9 * extent);
        let centre = middle(pairs.iter().map(|it| it.2)).unwrap_or_else(Point3::origin);
        let (mut hessian, mut slope) = (SMatrix::<f64, 7, 7>::zeros(), SVector::<f64, 7>::zeros());
        let (mut motions, mut n_inliers) = (Matrix6::zeros(), 0_usize);
        for (residual, normal, place) in &pairs {
            let share = residual / (TUKEY * sigma);
            if share.abs() >= 1.0 {
                continue;
            }
            n_inliers += 1;
            let weight = (1.0 - share * share).powi(2);
            let from = place - centre;
            let turn = from.cross(normal);
            let by = SVector::<f64, 7>::from([turn.x, turn.y, turn.z, normal.x, normal.y, normal.z, from.dot(normal)]);
            hessian += by * by.transpose() * weight;
            slope += by * (residual * weight);
            let motion = super::registration::motion_of(&Point3::from(from));
            motions += motion.transpose() * motion * weight;
        }
        overlap = n_inliers as f64 / of_a.len() as f64;
        let shape: Matrix6<f64> = hessian.fixed_view::<6, 6>(0, 0).into_owned();
        n_open = slides(&shape, &motions, MIN_HOLD).map_or(6, |it| it.not_held.len());
        if !options.scale {
            (0..7).for_each(|it| {
                hessian[(6, it)] = 0.0;
                hessian[(it, 6)] = 0.0;
            });
            slope[6] = 0.0;
        }
        // Directions that nothing holds stay where they are: so much as 1e-6 of what holds the others.
        let (turns, shifts) = (motions.fixed_view::<3, 3>(0, 0).trace() / 3.0, motions[(3, 3)]);
        (0..7).for_each(|it| hessian[(it, it)] += 1e-6 * if (3..6).contains(&it) { shifts } else { turns });
        let Some(delta) = Cholesky::new(hessian).map(|it| it.solve(&slope)).filter(|it| it.sum().is_finite()) else {
            break;
        };
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(delta[0], delta[1], delta[2]));
        let scale = (1.0 + delta[6]).clamp(0.5, 2.0);
        let shift = Vector3::new(delta[3], delta[4], delta[5]);
        let about = |it: Vector3<f64>| Similarity3::from_parts(Translation3::from(it), UnitQuaternion::identity(), 1.0);
        let change = Similarity3::from_parts(Translation3::identity(), turn, scale);
        pose = about(centre.coords + shift) * change * about(-centre.coords) * pose;
        let moved = delta.fixed_rows::<3>(0).norm() * extent + shift.norm() + delta[6].abs() * extent;
        // What lies on the other at all, and then only what lies on it as well as most does.
        tolerance = tolerance.min((10.0 * sigma).max(2.0 * b.spacing()).max(1e-6 * extent));
        if moved < LEAST_STEP * extent && step > 1 {
            break;
        }
    }
    let scale = pose.scaling();
    if !SCALES.contains(&scale) {
        return Err(PlacingError::Scale { scale });
    }
    Ok(Placing { b_from_a: pose, overlap, sigma, n_open, other: None })
}

#[cfg(test)]
mod tests;
