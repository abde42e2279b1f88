//! Angles, lengths and radii of a body from observations of several kinds, by least squares (9)–(15).
//!
//! Observations of a kind have standard deviations in metres, which makes kinds commensurate (12). Two forms of the equation of a point on the surface:
//!
//! | [`ResidualKind`] | residual | |
//! |---|---|---|
//! | `Field` | F − w_t, over what F changes in one σ at the surface | the paper's (15) |
//! | `Distance` | (√D − √D₀) / |∇√D| over σ | distance to first order (module [`super::field`]); grows far away, so that rough starts come in |
//!
//! The search goes in rounds. A round decides which segment each point belongs to, where each silhouette ray comes closest to the surface, and |∇√D|; then angles, lengths and radii are found by
//! Levenberg and Marquardt with those held. Shape and posture are found together, or in turn as the paper prefers (§4.2), which takes more rounds.

use foveate_estimation::least_squares::{Equations, Loss, Options, Problem, SolveError, Unobservable, solve};
use foveate_estimation::statistics::median;
use nalgebra::{DMatrix, DVector, Point3, Unit, Vector3};

use super::field::{Body, THRESHOLD, VISIBLE};
use super::skeleton::{Columns, Posed, State};

/// A posture that moves less from round to round is near enough for the shape to be found too [m].
const COARSELY_SETTLED_M: f64 = 1e-3;

/// Fewer observations say nothing.
const LEAST_OBSERVATIONS: usize = 3;

/// Median of the size of a standard normal number.
const MEDIAN_OF_NORMAL: f64 = 0.674_489_750_196_081_7;

/// What was seen of a body.
#[derive(Debug, Clone, PartialEq)]
pub enum BodyObservation {
    /// A point of the surface.
    Point {
        /// Where, in the world [m].
        at: Point3<f64>,
        /// Standard deviation across the surface [m].
        sigma_m: f64,
        /// The segment that it is known to belong to; `None`: found out.
        segment: Option<usize>,
    },
    /// A point that is fixed to a segment: a tracked point of the skin, a mark, a joint (`place` 0) that was clicked or comes from another body.
    Anchored {
        /// Which segment.
        segment: usize,
        /// Where in the segment's space, where that has the template's length [m].
        place: Vector3<f64>,
        /// Where it was seen in the world [m].
        at: Point3<f64>,
        /// Standard deviation of each axis [m].
        sigma_m: f64,
    },
    /// A line of sight that touches the surface: a pixel of a silhouette's border.
    Ray {
        /// The camera's centre [m].
        origin: Point3<f64>,
        /// Into the scene.
        direction: Unit<Vector3<f64>>,
        /// Standard deviation across the ray, at the body [m].
        sigma_m: f64,
    },
}

/// What form the equation of a point has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ResidualKind {
    /// The value of the field, the paper's (15).
    Field,
    /// Distance from the surface, to first order.
    #[default]
    Distance,
}

/// How the root may move.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FreedomOfRoot {
    /// It turns and shifts.
    #[default]
    Free,
    /// It shifts: for an arm by itself, whose shoulder's angles turn it.
    Shifts,
    /// It stays.
    Held,
}

/// What is sought.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Free {
    /// Where the body is.
    pub root: FreedomOfRoot,
    /// How it is bent.
    pub angles: bool,
    /// How long its segments are.
    pub scales: bool,
    /// How thick they are.
    pub radii: bool,
}

impl Free {
    /// Posture and shape.
    pub const ALL: Free = Free { root: FreedomOfRoot::Free, angles: true, scales: true, radii: true };
    /// Posture alone: a body whose shape is known.
    pub const POSTURE: Free = Free { root: FreedomOfRoot::Free, angles: true, scales: false, radii: false };
}

/// What is known beforehand. Empty lists: nothing.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Priors {
    /// By angle: its mean and standard deviation [rad]; infinite: nothing is known of it.
    pub angles: Vec<(f64, f64)>,
    /// By scale: its mean [–] and the standard deviation of its logarithm [–].
    pub scales: Vec<(f64, f64)>,
    /// By ball: its radii [m].
    pub radii: Vec<Vector3<f64>>,
    /// Standard deviation of the logarithm of each radius about [`Self::radii`] [–].
    pub radii_sigma: f64,
}

/// How a fit is done.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyFitOptions {
    /// What is sought.
    pub free: Free,
    /// The equation of points.
    pub residual: ResidualKind,
    /// Shape and posture in turn, as the paper does it.
    pub in_turn: bool,
    /// What residuals cost: wrong points should hardly pull.
    pub loss: Loss,
    /// Rounds at most [–].
    pub max_rounds: u32,
    /// Steps of the search at most, in each round [–].
    pub max_iterations: u32,
    /// Done when a round moves no point of the surface by more, root mean square [m].
    pub settled_m: f64,
    /// How firmly the limits of joints hold: standard deviation of what an angle may be beyond them [rad].
    pub limit_sigma: f64,
    /// Points farther from the surface than so many σ belong to no segment, when the fit is judged [σ].
    pub outlier_sigmas: f64,
}

impl Default for BodyFitOptions {
    fn default() -> Self {
        Self {
            free: Free::ALL,
            residual: ResidualKind::Distance,
            in_turn: false,
            loss: Loss::CAUCHY,
            max_rounds: 30,
            max_iterations: 6,
            settled_m: 2e-5,
            limit_sigma: 1_f64.to_radians(),
            outlier_sigmas: 5.0,
        }
    }
}

/// A fitted body.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyFit {
    /// Posture and shape.
    pub state: State,
    /// Of a step in the order of [`Columns`], wrong points weighted down; or which parameters the observations leave open.
    pub covariance: Result<DMatrix<f64>, Unobservable>,
    /// By observation: distance from the surface, positive outside, or from the anchor; NaN where no segment is near [m].
    pub distances_m: Vec<f64>,
    /// By observation: the segment that it belongs to.
    pub segments: Vec<Option<usize>>,
    /// Root mean square of the distances that are not outliers [m].
    pub rms_m: f64,
    /// Observations farther off than [`BodyFitOptions::outlier_sigmas`].
    pub outliers: usize,
    /// Angles beyond their limits, by number.
    pub beyond_limits: Vec<usize>,
    /// How many observations each segment has, outliers left out.
    pub support: Vec<usize>,
    /// Rounds that were made.
    pub rounds: u32,
    /// Steps that were tried, over all rounds.
    pub iterations: u32,
    /// Whether the last round moved next to nothing.
    pub settled: bool,
}

/// Why there is no fit.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BodyFitError {
    /// Not enough to go by.
    #[error("{found} observations of a body, expected {expected} at least")]
    TooFew {
        /// How many there are.
        found: usize,
        /// How many it takes.
        expected: usize,
    },
    /// One that cannot be used.
    #[error(
        "observation {index} is of {what}, expected finite numbers, a standard deviation above 0 and a segment of the body"
    )]
    Unfit {
        /// Which, counted from 0.
        index: usize,
        /// What is wrong.
        what: String,
    },
    /// Lists of another body.
    #[error("{what}: {found}, expected {expected} as the body has")]
    OtherBody {
        /// Which list.
        what: &'static str,
        /// Its length.
        found: usize,
        /// What it should be.
        expected: usize,
    },
    /// The search itself.
    #[error(transparent)]
    Solve(#[from] SolveError),
}

/// Fits `body` to observations, from `start`.
///
/// # Errors
/// See [`BodyFitError`].
pub fn fit_body(
    body: &Body,
    observations: &[BodyObservation],
    start: &State,
    priors: &Priors,
    options: &BodyFitOptions,
) -> Result<BodyFit, BodyFitError> {
    check(body, observations, start, priors)?;
    let columns = Columns::of(start);
    let stages: &[[bool; 2]] = if options.in_turn { &[[true, false], [false, true]] } else { &[[true, true]] };
    let mut state = start.clone();
    let (mut rounds, mut iterations, mut settled, mut coarse) = (0, 0, false, options.free.angles);
    let mut covariance = None;
    // Joints that were clicked, and points that are known on the body, say roughly how it stands, before a point of the surface is asked (§3.3).
    let anchors: Vec<BodyObservation> =
        observations.iter().filter(|it| matches!(it, BodyObservation::Anchored { .. })).cloned().collect();
    if coarse && anchors.len() >= LEAST_OBSERVATIONS {
        let problem = Round::new(body, &anchors, &state, priors, options);
        let held = held(&columns, &Free { radii: false, ..options.free }, true, true);
        let search = Options { loss: Loss::HUBER, held, max_iterations: 50, relative_gain: 1e-6 };
        let solution = solve(&problem, state, &search)?;
        (state, iterations) = (solution.parameters, solution.iterations);
    }
    while rounds < options.max_rounds && !settled {
        let mut moved = 0.0_f64;
        for [posture, shape] in stages {
            let problem = Round::new(body, observations, &state, priors, options);
            // The posture comes first: a shape that may change would grow towards points that belong elsewhere.
            let held = held(&columns, &options.free, *posture, *shape && !coarse);
            if held.len() == columns.len() {
                continue;
            }
            let loss = if coarse { Loss::HUBER } else { options.loss };
            let search = Options { loss, held, max_iterations: options.max_iterations, relative_gain: 1e-6 };
            let solution = solve(&problem, state.clone(), &search)?;
            moved = moved.max(body.moved_m(&state, &solution.parameters));
            iterations += solution.iterations;
            state = solution.parameters;
            covariance = Some(solution.covariance);
        }
        rounds += 1;
        settled = !coarse && moved < options.settled_m;
        coarse &= moved > COARSELY_SETTLED_M && rounds < options.max_rounds / 3;
    }
    let covariance = covariance.ok_or(SolveError::NothingFree { dimension: columns.len() })?;
    Ok(judged(body, observations, state, covariance, options, (rounds, iterations, settled)))
}

fn check(body: &Body, observations: &[BodyObservation], start: &State, priors: &Priors) -> Result<(), BodyFitError> {
    let skeleton = &body.skeleton;
    let lists = [
        ("angles of the start", start.angles.len(), skeleton.n_angles(), false),
        ("scales of the start", start.scales.len(), skeleton.n_scales(), false),
        ("radii of the start", start.radii.len(), body.balls.len(), false),
        ("angles known beforehand", priors.angles.len(), skeleton.n_angles(), true),
        ("scales known beforehand", priors.scales.len(), skeleton.n_scales(), true),
        ("radii known beforehand", priors.radii.len(), body.balls.len(), true),
    ];
    for (what, found, expected, may_be_empty) in lists {
        if found != expected && !(may_be_empty && found == 0) {
            return Err(BodyFitError::OtherBody { what, found, expected });
        }
    }
    if observations.len() < LEAST_OBSERVATIONS {
        return Err(BodyFitError::TooFew { found: observations.len(), expected: LEAST_OBSERVATIONS });
    }
    let n = skeleton.segments().len();
    for (index, observation) in observations.iter().enumerate() {
        let (place, sigma_m, segment) = match observation {
            BodyObservation::Point { at, sigma_m, segment } => (at.coords.norm(), *sigma_m, *segment),
            BodyObservation::Anchored { segment, place, at, sigma_m } => {
                (at.coords.norm() + place.norm(), *sigma_m, Some(*segment))
            }
            BodyObservation::Ray { origin, direction, sigma_m } => {
                (origin.coords.norm() + direction.norm(), *sigma_m, None)
            }
        };
        if !place.is_finite() || !(sigma_m.is_finite() && sigma_m > 0.0) || segment.is_some_and(|it| it >= n) {
            let what = format!("place {place:.3} m from the origin, sigma {sigma_m} m, segment {segment:?} of {n}");
            return Err(BodyFitError::Unfit { index, what });
        }
    }
    Ok(())
}

/// Parameters that stay as they are.
fn held(columns: &Columns, free: &Free, posture: bool, shape: bool) -> Vec<usize> {
    let turn = posture && free.root == FreedomOfRoot::Free;
    let shift = posture && free.root != FreedomOfRoot::Held;
    let spans = [
        (0, 3, turn),
        (3, 6, shift),
        (6, columns.scale(0), posture && free.angles),
        (columns.scale(0), columns.radius(0, 0), shape && free.scales),
        (columns.radius(0, 0), columns.len(), shape && free.radii),
    ];
    spans.iter().filter(|it| !it.2).flat_map(|&(from, to, _)| from..to).collect()
}

/// An observation with what a round decided about it.
enum Decided<'a> {
    /// A point in the field of a segment; the residual is (√D − √D₀) or (F − w_t), times `weight`.
    Surface {
        at: Point3<f64>,
        segment: usize,
        weight: f64,
    },
    Anchored {
        segment: usize,
        place: &'a Vector3<f64>,
        at: &'a Point3<f64>,
        weight: f64,
    },
}

struct Round<'a> {
    body: &'a Body,
    decided: Vec<Decided<'a>>,
    priors: &'a Priors,
    options: &'a BodyFitOptions,
    columns: Columns,
}

impl<'a> Round<'a> {
    fn new(
        body: &'a Body,
        observations: &'a [BodyObservation],
        state: &State,
        priors: &'a Priors,
        options: &'a BodyFitOptions,
    ) -> Round<'a> {
        let posed = body.skeleton.pose(state);
        let most_m = body.thickness_m(state);
        let surface = |at: &Point3<f64>, segment: Option<usize>, sigma_m: f64| {
            let segment = segment.or_else(|| body.nearest_segment(&posed, state, at))?;
            let field = body.field_of(&posed, state, segment, at)?;
            let (_, by_d) = field.root();
            let steepness = (by_d * field.gradient.norm()).max(1.0 / most_m);
            let weight = match options.residual {
                ResidualKind::Distance => 1.0 / (steepness * sigma_m),
                // dF = −2 F dD = −4 F √D d√D; at the surface F = w_t and √D = √D₀.
                ResidualKind::Field => 1.0 / (4.0 * THRESHOLD * VISIBLE * (VISIBLE / most_m).max(steepness) * sigma_m),
            };
            Some(Decided::Surface { at: *at, segment, weight })
        };
        let decide = |observation: &'a BodyObservation| match observation {
            BodyObservation::Point { at, sigma_m, segment } => surface(at, *segment, *sigma_m),
            BodyObservation::Anchored { segment, place, at, sigma_m } => {
                Some(Decided::Anchored { segment: *segment, place, at, weight: 1.0 / sigma_m })
            }
            BodyObservation::Ray { origin, direction, sigma_m } => {
                let at = body.closest_on_ray(&posed, state, origin, direction)?;
                surface(&at, None, *sigma_m)
            }
        };
        let decided: Vec<Decided> = observations.iter().filter_map(decide).collect();
        Round { body, decided, priors, options, columns: Columns::of(state) }.widened(&posed, state)
    }

    /// The round with residuals divided by their own spread where that is larger than the stated one: from a rough start all points are far off, and none is wrong (the scale of an M-estimate, P. Huber,
    /// *Robust Statistics*, 1981, §7).
    fn widened(mut self, posed: &Posed, state: &State) -> Round<'a> {
        let residual = |decided: &Decided| match decided {
            Decided::Surface { at, segment, weight } => {
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
        for (angle, (mean, sigma)) in self.priors.angles.iter().enumerate().filter(|(_, it)| it.1.is_finite()) {
            equations.add_known((at.angles[angle] - mean) / sigma, &[(self.columns.angle(angle), 1.0 / sigma)]);
        }
        for (scale, (mean, sigma)) in self.priors.scales.iter().enumerate() {
            let residual = (at.scales[scale] / mean).ln() / sigma;
            equations.add_known(residual, &[(self.columns.scale(scale), 1.0 / sigma)]);
        }
        for (ball, mean) in self.priors.radii.iter().enumerate() {
            for axis in 0..3 {
                let residual = (at.radii[ball][axis] / mean[axis]).ln() / self.priors.radii_sigma;
                equations.add_known(residual, &[(self.columns.radius(ball, axis), 1.0 / self.priors.radii_sigma)]);
            }
        }
        let firm = 1.0 / self.options.limit_sigma;
        for (angle, dof) in self.body.skeleton.dofs().enumerate() {
            let beyond = at.angles[angle] - at.angles[angle].clamp(dof.lowest, dof.highest);
            if beyond != 0.0 {
                equations.add_known(beyond * firm, &[(self.columns.angle(angle), firm)]);
            }
        }
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
                Decided::Surface { at: point, segment, weight } => {
                    let d = self.body.linearised(&posed, at, *segment, point, &mut row)?;
                    let (value, by_d) = match self.options.residual {
                        ResidualKind::Distance => {
                            let (root, by_d) = super::field::FieldAt { d, gradient: Vector3::zeros() }.root();
                            (root - VISIBLE, by_d)
                        }
                        ResidualKind::Field => {
                            let field = (-2.0 * d).exp();
                            // Outside F falls: the sign is turned so that outside is positive.
                            (THRESHOLD - field, 2.0 * field)
                        }
                    };
                    row.iter().for_each(|&(column, by)| sum.add(column, weight * by_d * by));
                    sum.finish(weight * value, equations);
                }
                Decided::Anchored { segment, place, at: seen, weight } => {
                    self.add_anchor(&posed, at, (*segment, place, seen, *weight), &mut sum, equations);
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
        (segment, place, seen, weight): (usize, &Vector3<f64>, &Point3<f64>, f64),
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
            sum.finish(weight * residual[axis], equations);
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
    fn finish(&mut self, residual: f64, equations: &mut Equations) {
        self.sparse.clear();
        for column in self.touched.drain(..) {
            // One whose parts cancelled to 0 on the way may stand twice: the second is then 0.
            self.sparse.push((column, std::mem::take(&mut self.dense[column])));
        }
        equations.add_sparse(residual, &self.sparse);
    }
}

impl Body {
    /// The thickest ball's least radius: inside a body, where balls overlap, the field is taken to be no flatter than it is at the surface of that one [m].
    pub(super) fn thickness_m(&self, state: &State) -> f64 {
        state.radii.iter().map(|it| it.min()).fold(0.0, f64::max).max(1e-6)
    }

    /// How far the ends of balls moved between two states, root mean square [m].
    fn moved_m(&self, before: &State, after: &State) -> f64 {
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
        let abreast = |(number, ball): (usize, &super::Ball)| {
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

fn judged(
    body: &Body,
    observations: &[BodyObservation],
    state: State,
    covariance: Result<DMatrix<f64>, Unobservable>,
    options: &BodyFitOptions,
    (rounds, iterations, settled): (u32, u32, bool),
) -> BodyFit {
    let posed = body.skeleton.pose(&state);
    let most_m = body.thickness_m(&state);
    let surface = |at: &Point3<f64>, segment: Option<usize>| {
        let segment = segment.or_else(|| body.nearest_segment(&posed, &state, at))?;
        Some((segment, body.field_of(&posed, &state, segment, at)?.distance(most_m)))
    };
    let n = observations.len();
    let (mut distances_m, mut segments) = (vec![f64::NAN; n], vec![None; n]);
    let mut support = vec![0; body.skeleton.segments().len()];
    let (mut sum, mut inliers, mut outliers) = (0.0, 0, 0);
    for (index, observation) in observations.iter().enumerate() {
        let (found, sigma_m) = match observation {
            BodyObservation::Point { at, sigma_m, segment } => (surface(at, *segment), *sigma_m),
            BodyObservation::Ray { origin, direction, sigma_m } => {
                let at = body.closest_on_ray(&posed, &state, origin, direction);
                (at.and_then(|it| surface(&it, None)), *sigma_m)
            }
            BodyObservation::Anchored { segment, place, at, sigma_m } => {
                let scale = state.scales[body.skeleton.segments()[*segment].scale];
                let expected = posed.world_from_segment[*segment] * Point3::from(place * scale);
                (Some((*segment, (at - expected).norm())), *sigma_m)
            }
        };
        let Some((segment, distance)) = found else { continue };
        (distances_m[index], segments[index]) = (distance, Some(segment));
        if distance.abs() > options.outlier_sigmas * sigma_m {
            outliers += 1;
        } else {
            sum += distance * distance;
            inliers += 1;
            support[segment] += 1;
        }
    }
    let beyond = |(angle, dof): (usize, &super::Dof)| {
        let excess = state.angles[angle] - state.angles[angle].clamp(dof.lowest, dof.highest);
        (excess.abs() > options.limit_sigma).then_some(angle)
    };
    let beyond_limits = body.skeleton.dofs().enumerate().filter_map(beyond).collect();
    let rms_m = if inliers > 0 { (sum / inliers as f64).sqrt() } else { f64::NAN };
    BodyFit {
        state,
        covariance,
        distances_m,
        segments,
        rms_m,
        outliers,
        beyond_limits,
        support,
        rounds,
        iterations,
        settled,
    }
}
