//! The equations of one round of a fit: what each observation belongs to, and residuals with their derivatives.

use foveate_estimation::least_squares::{Equations, Problem};
use foveate_estimation::statistics::median;
use nalgebra::{DVector, Matrix3, Point3, Unit, Vector3};

use super::{BodyFitOptions, BodyObservation, Priors, RadiiPrior, ResidualKind, RootPrior};
use crate::Pose;
use crate::metaball::field::{Body, FieldAt, THRESHOLD, VISIBLE};
use crate::metaball::skeleton::{Columns, Posed, State};

/// Median of the size of a standard normal number.
const MEDIAN_OF_NORMAL: f64 = 0.674_489_750_196_081_7;
/// Standard deviation of the logarithm by which balls of a limb differ and segments in length, while only what they have in common is sought [–].
const TIED: f64 = 0.02;

/// An observation with what a round decided about it.
enum Decided<'a> {
    /// A point in the field of a segment; the residual is (√D − √D₀) or (F − w_t), times `weight`.
    Surface {
        at: Point3<f64>,
        segment: usize,
        weight: f64,
        worth: f64,
    },
    Anchored {
        segment: usize,
        place: &'a Vector3<f64>,
        at: &'a Point3<f64>,
        weight: f64,
        worth: f64,
    },
}

/// How a point's segment is chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Belongs<'a> {
    /// The nearest bone.
    Bone,
    /// The limb in whose field it lies deepest.
    Field,
    /// By observation, the one that it was of before.
    Kept(&'a [Option<usize>]),
}

/// The equations of one round.
pub(super) struct Round<'a> {
    body: &'a Body,
    /// By observation, the segment that it is of.
    segments: Vec<Option<usize>>,
    decided: Vec<Decided<'a>>,
    priors: &'a Priors,
    options: &'a BodyFitOptions,
    columns: Columns,
    tied: Tied,
}

/// Which sizes go together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Tied {
    /// None: each ball has its own radii.
    Apart,
    /// The balls of a segment are thicker or thinner by one factor.
    Limbs,
    /// All segments are longer or shorter by one factor, and all balls thicker or thinner by another.
    Body,
}

/// What each observation counts: points in one cell have the model's error in common, their own errors not.
pub(super) fn worth(observations: &[BodyObservation], cell_m: f64, model_sigma_m: f64) -> Vec<f64> {
    let cell = |at: &Point3<f64>| [at.x, at.y, at.z].map(|it| (it / cell_m).floor() as i64);
    let key = |(index, it): (usize, &BodyObservation)| match it {
        BodyObservation::Point { at, sigma_m, .. } => Some((cell(at), index, sigma_m * sigma_m)),
        _ => None,
    };
    let mut keys: Vec<_> = observations.iter().enumerate().filter_map(key).collect();
    keys.sort_by_key(|it| (it.0, it.1));
    let cells = || keys.chunk_by(|a, b| a.0 == b.0);
    let mut counts: Vec<f64> = cells().flat_map(|it| it.iter().map(|_| it.len() as f64)).collect();
    counts.sort_by(f64::total_cmp);
    // A point that lies alone where most have company is more often wrong than precious: it counts no more than one of the others.
    let usual = counts.get(counts.len() / 2).copied().unwrap_or(1.0);
    let mut worth = vec![1.0; observations.len()];
    for together in cells() {
        let n = usual.max(together.len() as f64);
        for (_, index, own) in together {
            let model = model_sigma_m * model_sigma_m;
            // The variance of the mean of n, each of variance v, is v / n where they count in full.
            worth[*index] = (own + model) / (own + n * model);
        }
    }
    for ((_, index), n) in tracked_together(observations, cell_m) {
        worth[index] = 1.0 / n;
    }
    worth
}

/// Anchors with how many there are in their cell: skin that slides carries all of them along.
fn tracked_together(observations: &[BodyObservation], cell_m: f64) -> Vec<((usize, usize), f64)> {
    let key = |(index, it): (usize, &BodyObservation)| match it {
        BodyObservation::Anchored { segment, at, .. } => {
            Some((*segment, [at.x, at.y, at.z].map(|it| (it / cell_m).floor() as i64), index))
        }
        _ => None,
    };
    let mut keys: Vec<_> = observations.iter().enumerate().filter_map(key).collect();
    keys.sort();
    let cells = keys.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1));
    cells.flat_map(|it| it.iter().map(|key| ((key.0, key.2), it.len() as f64))).collect()
}

/// How far a point lies before the joint of a segment that is cut there, 0 for others [m], and where it is compared: up to its first ball, and on before the joint, a limb that is cut is as thick as
/// it is there. By itself the ball would close it.
pub(super) fn before_cut(
    body: &Body,
    posed: &Posed,
    state: &State,
    segment: usize,
    at: &Point3<f64>,
) -> (f64, Point3<f64>) {
    let bone = &body.skeleton.segments()[segment];
    if !bone.cut {
        return (0.0, *at);
    }
    let world_from_here = &posed.world_from_segment[segment];
    let along = world_from_here.inverse_transform_point(at).z;
    let own = body.balls.iter().filter(|it| it.segment == segment);
    let first = state.scales[bone.scale] * own.map(|it| it.centre.z).fold(f64::INFINITY, f64::min);
    let forward = if first.is_finite() { (first - along).max(0.0) } else { 0.0 };
    ((-along).max(0.0), at + world_from_here.rotation * Vector3::z() * forward)
}

/// What the model's error has more near the joints of a segment [m].
fn at_joints(
    body: &Body,
    posed: &Posed,
    state: &State,
    segment: usize,
    at: &Point3<f64>,
    options: &BodyFitOptions,
) -> f64 {
    if options.joint_sigma_m <= 0.0 {
        return 0.0;
    }
    let bones = body.skeleton.segments();
    let along = posed.world_from_segment[segment].inverse_transform_point(at).z;
    let length = bones[segment].length * state.scales[bones[segment].scale];
    let from_start = if bones[segment].parent.is_some() { along.abs() } else { f64::INFINITY };
    let has_child = bones.iter().any(|it| it.parent == Some(segment));
    let from_end = if has_child { (length - along).abs() } else { f64::INFINITY };
    options.joint_sigma_m * (-(from_start.min(from_end) / options.joint_reach_m).powi(2)).exp()
}

impl<'a> Round<'a> {
    pub(super) fn new(
        body: &'a Body,
        observations: &'a [BodyObservation],
        worth: &[f64],
        state: &State,
        priors: &'a Priors,
        options: &'a BodyFitOptions,
        belongs: Belongs<'_>,
    ) -> Round<'a> {
        let posed = body.skeleton.pose(state);
        let most_m = body.thickness_m(state);
        let segment_of = |index: usize, at: &Point3<f64>| match belongs {
            Belongs::Bone => body.nearest_bone(&posed, state, at),
            Belongs::Field => body.nearest_segment(&posed, state, at),
            Belongs::Kept(segments) => segments[index],
        };
        let mut segments = vec![None; observations.len()];
        let surface = |at: &Point3<f64>, segment: usize, sigma_m: f64, worth: f64| {
            let (before, at) = before_cut(body, &posed, state, segment, at);
            let field = body.field_of(&posed, state, segment, &at)?;
            // Before a cut the body may narrow, as a shoulder does.
            if before > 0.0 && field.d < VISIBLE * VISIBLE {
                return None;
            }
            let (_, by_d) = field.root();
            let steepness = (by_d * field.gradient.norm()).max(1.0 / most_m);
            let sigma_m =
                sigma_m.hypot(options.model_sigma_m).hypot(at_joints(body, &posed, state, segment, &at, options));
            let weight = match options.residual {
                ResidualKind::Distance => 1.0 / (steepness * sigma_m),
                // dF = −2 F dD = −4 F √D d√D; at the surface F = w_t and √D = √D₀.
                ResidualKind::Field => 1.0 / (4.0 * THRESHOLD * VISIBLE * steepness * sigma_m),
            };
            Some(Decided::Surface { at, segment, weight, worth })
        };
        let mut decide = |index: usize| match &observations[index] {
            BodyObservation::Point { at, sigma_m, segment } => {
                segments[index] = segment.or_else(|| segment_of(index, at));
                surface(at, segments[index]?, *sigma_m, worth[index])
            }
            BodyObservation::Anchored { segment, place, at, sigma_m } => {
                let (weight, worth) = (1.0 / sigma_m, worth[index]);
                Some(Decided::Anchored { segment: *segment, place, at, weight, worth })
            }
            BodyObservation::Ray { origin, direction, sigma_m } => {
                let at = body.closest_on_ray(&posed, state, origin, direction)?;
                segments[index] = segment_of(index, &at);
                surface(&at, segments[index]?, *sigma_m, worth[index])
            }
        };
        let decided: Vec<Decided> = (0..observations.len()).filter_map(&mut decide).collect();
        let round = Round { body, segments, decided, priors, options, columns: Columns::of(state), tied: Tied::Apart };
        round.widened(&posed, state)
    }

    /// By observation, the segment that it is of.
    pub(super) fn segments(&self) -> &[Option<usize>] {
        &self.segments
    }

    /// The round with sizes that go together.
    pub(super) fn with_tied(self, tied: Tied) -> Round<'a> {
        Round { tied, ..self }
    }

    /// The round with residuals divided by their own spread where that is larger than the stated one: from a rough start all points are far off, and none is wrong (the scale of an M-estimate, P. Huber,
    /// *Robust Statistics*, 1981, §7).
    fn widened(mut self, posed: &Posed, state: &State) -> Round<'a> {
        let residual = |decided: &Decided| match decided {
            Decided::Surface { at, segment, weight, .. } => {
                let field = self.body.field_of(posed, state, *segment, at)?;
                let value = match self.options.residual {
                    ResidualKind::Distance => field.root().0 - VISIBLE,
                    ResidualKind::Field => THRESHOLD - (-2.0 * field.d).exp(),
                };
                Some((weight * value).abs())
            }
            Decided::Anchored { .. } => None,
        };
        let residuals: Vec<f64> = self.decided.iter().filter_map(residual).collect();
        let spread = median(&residuals).map_or(1.0, |it| (it / MEDIAN_OF_NORMAL).max(1.0));
        for decided in &mut self.decided {
            if let Decided::Surface { weight, .. } = decided {
                *weight /= spread;
            }
        }
        self
    }

    fn add_priors(&self, at: &State, equations: &mut Equations) {
        if let Some(prior) = &self.priors.root {
            add_root(prior, &at.world_from_root, equations);
        }
        for (angle, (mean, sigma)) in self.priors.angles.iter().enumerate().filter(|(_, it)| it.1.is_finite()) {
            equations.add_known((at.angles[angle] - mean) / sigma, &[(self.columns.angle(angle), 1.0 / sigma)]);
        }
        let is_tied = self.tied == Tied::Body || self.tied == Tied::Limbs && self.priors.stature > 0.0;
        let scales = self.priors.scales.iter().enumerate();
        let lengths: Vec<Known> = scales
            .map(|(scale, (mean, sigma))| Known {
                off: (at.scales[scale] / mean).ln(),
                sigma: if is_tied { sigma.min(TIED) } else { *sigma },
                by: vec![(self.columns.scale(scale), 1.0)],
            })
            .collect();
        alike(&lengths, self.priors.stature).iter().for_each(|it| equations.add_known(it.0, &it.1));
        if let Some(prior) = &self.priors.radii {
            self.add_radii(prior, at, equations);
        }
        let firm = 1.0 / self.options.limit_sigma;
        for (angle, dof) in self.body.skeleton.dofs().enumerate() {
            let beyond = at.angles[angle] - at.angles[angle].clamp(dof.lowest, dof.highest);
            if beyond != 0.0 {
                equations.add_known(beyond * firm, &[(self.columns.angle(angle), firm)]);
            }
        }
    }

    fn add_radii(&self, prior: &RadiiPrior, at: &State, equations: &mut Equations) {
        let off = |ball: usize| at.radii[ball].component_div(&prior.means[ball]).map(f64::ln);
        let [x, y, z] = [0, 1, 2].map(|axis| move |ball: usize| self.columns.radius(ball, axis));
        let own = |sigma: f64| if self.tied == Tied::Body { sigma.min(TIED) } else { sigma };
        let thick = |ball: usize| {
            let off = off(ball);
            Known { off: 0.5 * (off.x + off.y), sigma: own(prior.thickness), by: vec![(x(ball), 0.5), (y(ball), 0.5)] }
        };
        let thick: Vec<Known> = (0..prior.means.len()).map(thick).collect();
        alike(&thick, prior.girth).iter().for_each(|it| equations.add_known(it.0, &it.1));
        for ball in 0..prior.means.len() {
            let off = off(ball);
            for (residual, sigma, by) in [
                (off.x - off.y, prior.roundness, &[(x(ball), 1.0), (y(ball), -1.0)][..]),
                (off.z, prior.reach, &[(z(ball), 1.0)]),
            ] {
                let sigma = if self.tied == Tied::Apart { sigma } else { sigma.min(TIED) };
                let by: Vec<(usize, f64)> = by.iter().map(|it| (it.0, it.1 / sigma)).collect();
                equations.add_known(residual / sigma, &by);
            }
        }
        let evenness = if self.tied == Tied::Apart { prior.evenness } else { prior.evenness.min(TIED) };
        let segment = |ball: usize| self.body.balls[ball].segment;
        for ball in (1..prior.means.len()).filter(|it| segment(*it) == segment(it - 1)) {
            let (one, other) = (off(ball - 1), off(ball));
            let by = [(x(ball - 1), 0.5), (y(ball - 1), 0.5), (x(ball), -0.5), (y(ball), -0.5)];
            let residual = 0.5 * (one.x + one.y - other.x - other.y) / evenness;
            equations.add_known(residual, &by.map(|it| (it.0, it.1 / evenness)));
        }
    }
}

/// A size: how far its logarithm is from what is expected, how far it is of one person beside the others, and its derivatives.
struct Known {
    off: f64,
    sigma: f64,
    by: Vec<(usize, f64)>,
}

/// Residuals of sizes off = c + e, with c of standard deviation `common` and e of their own, c integrated out, and their derivatives: where all σ are alike, the inverse of σ² I + c² 11ᵀ is the square of
/// (I − k 11ᵀ/n) / σ with 1 − k = 1 / √(1 + n c²/σ²).
fn alike(sizes: &[Known], common: f64) -> Vec<(f64, Vec<(usize, f64)>)> {
    let weight: f64 = sizes.iter().map(|it| it.sigma.powi(-2)).sum();
    let k = 1.0 - 1.0 / (1.0 + weight * common * common).sqrt();
    let mean = sizes.iter().map(|it| it.off / it.sigma.powi(2)).sum::<f64>() / weight;
    let row = |(number, size): (usize, &Known)| {
        let part = |(other, it): (usize, &Known)| {
            let own = if other == number { 1.0 } else { 0.0 };
            (own - k / (weight * it.sigma.powi(2))) / size.sigma
        };
        let by = sizes.iter().enumerate().map(|it| (part(it), it.1)).filter(|it| it.0 != 0.0);
        let by = by.flat_map(|(part, it)| it.by.iter().map(move |(column, by)| (*column, by * part)));
        ((size.off - k * mean) / size.sigma, by.collect())
    };
    sizes.iter().enumerate().map(row).collect()
}

/// Residuals of the root's turn and place, in its space as it is known beforehand.
fn add_root(prior: &RootPrior, world_from_root: &Pose, equations: &mut Equations) {
    let known_from_root = prior.world_from_root.inv_mul(world_from_root);
    let turn = known_from_root.rotation.scaled_axis();
    let by_turn = Matrix3::identity() + 0.5 * turn.cross_matrix();
    let by_shift = known_from_root.rotation.to_rotation_matrix();
    for axis in 0..3 {
        let row = |matrix: &Matrix3<f64>, first: usize, sigma: f64| {
            [0, 1, 2].map(|column| (first + column, matrix[(axis, column)] / sigma))
        };
        equations.add_known(turn[axis] / prior.turn_sigma, &row(&by_turn, 0, prior.turn_sigma));
        let shift = known_from_root.translation.vector[axis] / prior.shift_sigma;
        equations.add_known(shift, &row(by_shift.matrix(), 3, prior.shift_sigma));
    }
}

impl Problem for Round<'_> {
    type Parameters = State;

    fn dimension(&self) -> usize {
        self.columns.len()
    }

    fn moved(&self, from: &State, step: &DVector<f64>) -> State {
        from.moved(step.as_slice())
    }

    fn linearise(&self, at: &State, equations: &mut Equations) -> Option<()> {
        let sound = |value: f64| value.is_finite() && value > 0.0;
        if !at.scales.iter().copied().chain(at.radii.iter().flat_map(|it| it.iter().copied())).all(sound) {
            return None;
        }
        let posed = self.body.skeleton.pose(at);
        let (mut row, mut sum) = (Vec::new(), Row::new(self.columns.len()));
        for decided in &self.decided {
            match decided {
                Decided::Surface { at: point, segment, weight, worth } => {
                    let d = self.body.linearised(&posed, at, *segment, point, &mut row)?;
                    let (value, by_d) = match self.options.residual {
                        ResidualKind::Distance => {
                            let (root, by_d) = FieldAt { d, gradient: Vector3::zeros() }.root();
                            (root - VISIBLE, by_d)
                        }
                        ResidualKind::Field => {
                            let field = (-2.0 * d).exp();
                            // Outside F falls: the sign is turned so that outside is positive.
                            (THRESHOLD - field, 2.0 * field)
                        }
                    };
                    row.iter().for_each(|&(column, by)| sum.add(column, weight * by_d * by));
                    sum.finish(weight * value, *worth, equations);
                }
                Decided::Anchored { segment, place, at: seen, weight, worth } => {
                    self.add_anchor(&posed, at, (*segment, place, seen, *weight, *worth), &mut sum, equations);
                }
            }
        }
        self.add_priors(at, equations);
        Some(())
    }
}

impl Round<'_> {
    /// Three residuals: where the observed point lies in the segment's space, less where it should.
    fn add_anchor(
        &self,
        posed: &Posed,
        state: &State,
        (segment, place, seen, weight, worth): (usize, &Vector3<f64>, &Point3<f64>, f64, f64),
        sum: &mut Row,
        equations: &mut Equations,
    ) {
        let scale = self.body.skeleton.segments()[segment].scale;
        let expected = place * state.scales[scale];
        let residual = posed.world_from_segment[segment].inverse_transform_point(seen).coords - expected;
        for axis in 0..3 {
            self.body.skeleton.derivatives(posed, &self.columns, segment, seen, |column, by| {
                sum.add(column, weight * by[axis]);
            });
            sum.add(self.columns.scale(scale), -weight * expected[axis]);
            sum.finish(weight * residual[axis], worth, equations);
        }
    }
}

/// A row of derivatives that is summed up, of which few are not 0.
struct Row {
    dense: Vec<f64>,
    touched: Vec<usize>,
    sparse: Vec<(usize, f64)>,
}

impl Row {
    fn new(columns: usize) -> Row {
        Row { dense: vec![0.0; columns], touched: Vec::new(), sparse: Vec::new() }
    }

    fn add(&mut self, column: usize, by: f64) {
        if by != 0.0 {
            if self.dense[column] == 0.0 {
                self.touched.push(column);
            }
            self.dense[column] += by;
        }
    }

    /// Gives the row to `equations`, and is empty again.
    fn finish(&mut self, residual: f64, worth: f64, equations: &mut Equations) {
        self.sparse.clear();
        for column in self.touched.drain(..) {
            // One whose parts cancelled to 0 on the way may stand twice: the second is then 0.
            self.sparse.push((column, std::mem::take(&mut self.dense[column])));
        }
        equations.add_sparse(residual, worth, &self.sparse);
    }
}

impl Body {
    /// How far the ends of balls moved between two states, root mean square [m].
    pub(super) fn moved_m(&self, before: &State, after: &State) -> f64 {
        let [posed_before, posed_after] = [before, after].map(|it| self.skeleton.pose(it));
        let place = |posed: &Posed, state: &State, number: usize, side: f64, axis: usize| {
            let ball = &self.balls[number];
            let scale = state.scales[self.skeleton.segments()[ball.segment].scale];
            let reach = ball.segment_from_ball * Vector3::ith(axis, side * VISIBLE * state.radii[number][axis]);
            posed.world_from_segment[ball.segment] * Point3::from(ball.centre * scale + reach)
        };
        let (mut sum, mut n) = (0.0, 0.0);
        for number in 0..self.balls.len() {
            for (side, axis) in [-1.0, 1.0].into_iter().flat_map(|side| (0..3).map(move |axis| (side, axis))) {
                let shift =
                    place(&posed_after, after, number, side, axis) - place(&posed_before, before, number, side, axis);
                sum += shift.norm_squared();
                n += 1.0;
            }
        }
        (sum / f64::max(n, 1.0)).sqrt()
    }

    /// Where a ray comes closest to the surface or deepest into the body: the least D along it. `None` where the body lies behind its origin.
    pub(super) fn closest_on_ray(
        &self,
        posed: &Posed,
        state: &State,
        origin: &Point3<f64>,
        direction: &Unit<Vector3<f64>>,
    ) -> Option<Point3<f64>> {
        let d_at = |along: f64| self.field(posed, state, &(origin + direction.into_inner() * along)).map(|it| it.d);
        let abreast = |(number, ball): (usize, &crate::metaball::field::Ball)| {
            let scale = state.scales[self.skeleton.segments()[ball.segment].scale];
            let centre = posed.world_from_segment[ball.segment] * Point3::from(ball.centre * scale);
            let along = (centre - origin).dot(direction);
            (along > 0.0).then_some((along, state.radii[number].max()))
        };
        let candidates = self.balls.iter().enumerate().filter_map(abreast);
        let scored = candidates.filter_map(|(along, reach)| d_at(along).map(|d| (d, along, reach)));
        let (_, mut middle, reach) = scored.min_by(|a, b| a.0.total_cmp(&b.0))?;
        // Golden section about the best ball.
        const RATIO: f64 = 0.618_033_988_749_894_8;
        let (mut low, mut high) = ((middle - reach).max(0.0), middle + reach);
        for _ in 0..30 {
            let (first, second) = (high - RATIO * (high - low), low + RATIO * (high - low));
            if d_at(first)? < d_at(second)? {
                high = second
            } else {
                low = first
            }
            middle = 0.5 * (low + high);
        }
        Some(origin + direction.into_inner() * middle)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::*;

    #[test]
    fn sizes_with_something_in_common_cost_what_their_covariance_says() {
        let off = [0.1, -0.05, 0.2, 0.07];
        for (sigmas, common) in [([0.06, 0.06, 0.06, 0.06], 0.08), ([0.04, 0.08, 0.05, 0.06], 0.15), ([0.06; 4], 0.0)] {
            let known = |off: [f64; 4]| -> Vec<Known> {
                (0..4).map(|it| Known { off: off[it], sigma: sigmas[it], by: vec![(10 + it, 1.0)] }).collect()
            };
            let rows = alike(&known(off), common);
            let covariance =
                DMatrix::from_fn(4, 4, |a, b| common * common + if a == b { sigmas[a].powi(2) } else { 0.0 });
            let off_vector = DVector::from_row_slice(&off);
            let expected = off_vector.dot(&(covariance.try_inverse().unwrap() * &off_vector));
            let cost: f64 = rows.iter().map(|it| it.0 * it.0).sum();
            assert!((cost / expected - 1.0).abs() < 1e-9, "{cost}, expected {expected} with {sigmas:?}");
            for (number, row) in rows.iter().enumerate() {
                for it in 0..4 {
                    let mut moved = off;
                    moved[it] += 1e-6;
                    let slope = (alike(&known(moved), common)[number].0 - row.0) / 1e-6;
                    let by: f64 = row.1.iter().filter(|by| by.0 == 10 + it).map(|by| by.1).sum();
                    assert!((slope - by).abs() < 1e-4 * (1.0 + slope.abs()), "{slope} and {by}");
                }
            }
        }
    }
}
