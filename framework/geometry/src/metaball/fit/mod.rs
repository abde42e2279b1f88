//! Fits a metaball body to observations of several kinds: angles, lengths and radii by least squares (9)–(15).
//!
//! Observations of a kind have standard deviations in metres, which makes kinds commensurate (12). Two forms of the equation of a point on the surface:
//!
//! | [`ResidualKind`] | residual | |
//! |---|---|---|
//! | `Field` | F − w_t, over what F changes in one σ at the surface | the paper's (15) |
//! | `Distance` | (√D − √D₀) / |∇√D| over σ | distance to first order (module [`super::field`]); grows far away, so that rough starts converge: stages 2 and 3 always use it |
//!
//! The search has four stages, each from the end of the one before; from a near start ([`BodyFitOptions::rough`]) only the last:
//!
//! 1. a rough posture from clicked joints and points known to lie on a segment (§3.3);
//! 2. the posture from all points with the shape held, each point assigned to the nearest bone;
//! 3. lengths, and the thickness of each limb, together with it;
//! 4. all angles, lengths and radii together, or in turn as the paper does (§4.2), each point assigned to the limb in whose field it lies deepest.
//!
//! Stages run in rounds. A round assigns each point to a segment (in the last stage only until it nearly converged),
//! finds where each silhouette ray comes closest to the surface, |∇√D|, and the spread of the residuals; then
//! Levenberg–Marquardt runs with these held. Residuals that spread wider than their standard deviations are divided by
//! the spread: from a rough start all points are far off, and none is an outlier.
//!
//! No real body is made of metaballs. The model error is common to neighbouring points
//! ([`BodyFitOptions::model_sigma_m`]): within a cell of [`BodyFitOptions::independent_m`] all points together count
//! as one, so that the density of a cloud does not matter and covariances stay realistic.

mod judge;
mod round;

use foveate_estimation::least_squares::{Loss, Options, SolveError, Unobservable, solve};
use nalgebra::{DMatrix, Point3, Unit, UnitQuaternion, Vector3};

pub use self::judge::Doubt;
use self::round::{Belongs, Round, Tied};
use super::field::Body;
use super::skeleton::{Columns, State};
use crate::Pose;

/// A stage that moves the surface by less from round to round is near enough for the next one [m].
const COARSELY_SETTLED_M: f64 = 1e-3;
/// Rounds of a stage before the last one at most: what has not settled by then will not.
const COARSE_ROUNDS: u32 = 8;
/// Fewer observations say nothing.
const LEAST_OBSERVATIONS: usize = 3;

/// An observation of a body.
#[derive(Debug, Clone, PartialEq)]
pub enum BodyObservation {
    /// A point on the surface.
    Point {
        /// Position in the world [m].
        at: Point3<f64>,
        /// Standard deviation across the surface [m].
        sigma_m: f64,
        /// Index of the segment that it belongs to; `None`: to be estimated.
        segment: Option<usize>,
    },
    /// A point fixed to a segment: a tracked point of the skin, a mark, or a joint (`place` 0) that was clicked or comes from another body.
    Anchored {
        /// Index of the segment.
        segment: usize,
        /// Position in the segment's space, where that has the template's length [m].
        place: Vector3<f64>,
        /// Measured position in the world [m].
        at: Point3<f64>,
        /// Standard deviation of each axis [m].
        sigma_m: f64,
    },
    /// A line of sight tangent to the surface: a pixel of a silhouette's border.
    Ray {
        /// The camera's centre [m].
        origin: Point3<f64>,
        /// Direction into the scene.
        direction: Unit<Vector3<f64>>,
        /// Standard deviation across the ray, at the body [m].
        sigma_m: f64,
    },
}

/// Form of the residual of a surface point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ResidualKind {
    /// Value of the field, the paper's (15).
    #[default]
    Field,
    /// Distance from the surface to first order.
    Distance,
}

/// Freedom of the root.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RootFreedom {
    /// The root rotates and shifts.
    #[default]
    Free,
    /// The root shifts only: for a single arm, which is rotated by the angles of its shoulder.
    Shifts,
    /// The root is held.
    Held,
}

/// Which parameters are estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Free {
    /// Pose of the root.
    pub root: RootFreedom,
    /// Joint angles.
    pub angles: bool,
    /// Lengths of segments.
    pub scales: bool,
    /// Radii of balls.
    pub radii: bool,
}

impl Free {
    /// Posture and shape.
    pub const ALL: Free = Free { root: RootFreedom::Free, angles: true, scales: true, radii: true };
    /// Posture alone: a body whose shape is known.
    pub const POSTURE: Free = Free { root: RootFreedom::Free, angles: true, scales: false, radii: false };
}

/// Prior of the root's pose.
#[derive(Debug, Clone, PartialEq)]
pub struct RootPrior {
    /// Mean pose.
    pub world_from_root: Pose,
    /// Standard deviation of the rotation about each axis [rad].
    pub turn_sigma: f64,
    /// Standard deviation of the position along each axis [m].
    pub shift_sigma: f64,
}

/// Prior knowledge of posture and shape. Empty lists: none.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Priors {
    /// Prior of the root's pose.
    pub root: Option<RootPrior>,
    /// By angle: mean and standard deviation [rad]; infinite: no prior.
    pub angles: Vec<(f64, f64)>,
    /// By scale: mean [–], and standard deviation of its logarithm beside the part common to all scales [–].
    pub scales: Vec<(f64, f64)>,
    /// Standard deviation of the common part of the logarithms of all scales: stature [–].
    pub stature: f64,
    /// Prior of the balls' radii.
    pub radii: Option<RadiiPrior>,
}

/// Prior of radii: the thickness of a limb varies more from person to person than its roundness, or its profile along the bone.
#[derive(Debug, Clone, PartialEq)]
pub struct RadiiPrior {
    /// By ball: mean radii [m].
    pub means: Vec<Vector3<f64>>,
    /// Standard deviation of the logarithm of a ball's thickness, the geometric mean of its radii along x and y,
    /// beside the part common to all balls [–].
    pub thickness: f64,
    /// Standard deviation of the common part of the logarithms of all thicknesses: build and clothing [–].
    pub girth: f64,
    /// Standard deviation of the logarithm of the ratio of the thicknesses of neighbouring balls of a segment [–].
    pub evenness: f64,
    /// Standard deviation of the logarithm of the ratio of a ball's radii along x and y [–].
    pub roundness: f64,
    /// Standard deviation of the logarithm of a ball's radius along the bone [–].
    pub reach: f64,
}

/// Options of [`fit_body`].
#[derive(Debug, Clone, PartialEq)]
pub struct BodyFitOptions {
    /// Parameters to estimate.
    pub free: Free,
    /// Form of the residual of surface points.
    pub residual: ResidualKind,
    /// Whether to estimate shape and posture in turn, as the paper does.
    pub in_turn: bool,
    /// Whether the start may be far off: stages 1 to 3 run first.
    pub rough: bool,
    /// Robust loss of the residuals.
    pub loss: Loss,
    /// Most rounds [–].
    pub max_rounds: u32,
    /// Most iterations in each round [–].
    pub max_iterations: u32,
    /// Convergence: a round moves the surface by no more, root mean square [m].
    pub settled_m: f64,
    /// Softness of joint limits: standard deviation of an angle beyond its limit [rad].
    pub limit_sigma: f64,
    /// Model error: standard deviation between the surface of a person and the best metaball body, added to that of points and rays [m].
    pub model_sigma_m: f64,
    /// Additional model error at a joint between two segments, where skin bulges and cloth wrinkles; it fades over [`Self::joint_reach_m`] [m].
    pub joint_sigma_m: f64,
    /// Distance from a joint, along the bone, at which that error has fallen to e⁻¹ [m].
    pub joint_reach_m: f64,
    /// Points closer together than this share their model error [m].
    pub independent_m: f64,
    /// Points farther from the surface are outliers when the fit is judged [σ].
    pub outlier_sigmas: f64,
}

impl Default for BodyFitOptions {
    fn default() -> Self {
        Self {
            free: Free::ALL,
            residual: ResidualKind::Field,
            in_turn: false,
            rough: true,
            loss: Loss::CAUCHY,
            max_rounds: 30,
            max_iterations: 6,
            settled_m: 1e-4,
            limit_sigma: 1_f64.to_radians(),
            model_sigma_m: 0.003,
            joint_sigma_m: 0.0,
            joint_reach_m: 0.05,
            independent_m: 0.03,
            outlier_sigmas: 5.0,
        }
    }
}

/// A fitted body with its residuals and diagnostics.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyFit {
    /// Fitted posture and shape.
    pub state: State,
    /// Covariance of a step in the order of [`Columns`], with outliers weighted down; or the unobservable parameters.
    pub covariance: Result<DMatrix<f64>, Unobservable>,
    /// By observation: signed distance from the surface, positive outside, or distance from the anchor; NaN where no segment is near [m].
    pub distances_m: Vec<f64>,
    /// By observation: index of the segment that it was assigned to.
    pub segments: Vec<Option<usize>>,
    /// Root mean square of the distances without outliers [m].
    pub rms_m: f64,
    /// Number of outliers: observations farther off than [`BodyFitOptions::outlier_sigmas`].
    pub outliers: usize,
    /// Share of the surface points and rays that are farther off [–].
    pub off_share: f64,
    /// Number of observations beyond the joint of a cut segment, which belong to parts that the model lacks.
    pub beyond: usize,
    /// By segment: number of its independent observations without outliers [–].
    pub support: Vec<f64>,
    /// Reasons to distrust the fit.
    pub doubts: Vec<Doubt>,
    /// Number of rounds.
    pub rounds: u32,
    /// Iterations over all rounds.
    pub iterations: u32,
    /// Whether the last round converged.
    pub settled: bool,
}

/// Why there is no fit.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BodyFitError {
    /// Too few observations.
    #[error("{found} observations of a body, expected {expected} at least")]
    TooFew {
        /// Number that was found.
        found: usize,
        /// Number that is needed.
        expected: usize,
    },
    /// An observation that cannot be used.
    #[error(
        "observation {index} is of {what}, expected finite numbers, a standard deviation above 0 and a segment of the body"
    )]
    Unfit {
        /// Index of the observation.
        index: usize,
        /// Its values.
        what: String,
    },
    /// Lists that do not match the body.
    #[error("{what}: {found}, expected {expected} as the body has")]
    OtherBody {
        /// Which list.
        what: &'static str,
        /// Length that was found.
        found: usize,
        /// Length that was expected.
        expected: usize,
    },
    /// The solver failed.
    #[error(transparent)]
    Solve(#[from] SolveError),
}

/// What a stage seeks.
struct Stage {
    free: Free,
    tied: Tied,
    belongs: Belongs<'static>,
    loss: Loss,
    settled_m: f64,
    rounds: u32,
}

/// Where the search is.
struct Search<'a> {
    body: &'a Body,
    observations: &'a [BodyObservation],
    /// What each counts, 1 for one that no other one is near to.
    worth: Vec<f64>,
    priors: &'a Priors,
    options: &'a BodyFitOptions,
    state: State,
    covariance: Option<Result<DMatrix<f64>, Unobservable>>,
    rounds: u32,
    iterations: u32,
}

/// Fits `body` to observations, from `start`.
///
/// # Errors
/// See [`BodyFitError`]. An implausible fit is no error: see [`BodyFit::doubts`].
pub fn fit_body(
    body: &Body,
    observations: &[BodyObservation],
    start: &State,
    priors: &Priors,
    options: &BodyFitOptions,
) -> Result<BodyFit, BodyFitError> {
    check(body, observations, start, priors)?;
    let worth = round::worth(observations, options.independent_m, options.model_sigma_m);
    let (state, covariance) = (start.clone(), None);
    let mut search = Search { body, observations, worth, priors, options, state, covariance, rounds: 0, iterations: 0 };
    let free = options.free;
    let posture = Free { scales: false, radii: false, ..free };
    let coarse = Stage {
        free: posture,
        tied: Tied::Apart,
        belongs: Belongs::Bone,
        loss: Loss::HUBER,
        settled_m: COARSELY_SETTLED_M,
        rounds: COARSE_ROUNDS,
    };
    if options.rough && (free.angles || free.root != RootFreedom::Held) {
        search.anchors_alone(&coarse)?;
        let girth = priors.radii.as_ref().map_or(0.0, |it| it.girth);
        if (free.scales || free.radii) && priors.stature + girth > 0.0 {
            search.go(&Stage { free, tied: Tied::Body, ..coarse })?;
        } else {
            search.go(&coarse)?;
        }
        search.twists(&coarse)?;
    }
    if options.rough && (free.scales || free.radii) {
        search.go(&Stage { free, tied: Tied::Limbs, ..coarse })?;
    }
    let last = Stage {
        free,
        tied: Tied::Apart,
        belongs: Belongs::Field,
        loss: options.loss,
        settled_m: options.settled_m,
        rounds: options.max_rounds,
    };
    let settled = search.go(&last)?;
    let covariance = search.covariance.take();
    let covariance = covariance.ok_or(SolveError::NothingFree { dimension: Columns::of(start).len() })?;
    Ok(search.judged(covariance, settled))
}

impl Search<'_> {
    /// The first stage: clicked joints and the like, with the shape held. A posture that is far off leads to wrong minima: the root is tried in all 24 turns that take axes to axes, and each joint with
    /// several angles in several postures of its own, the best being kept.
    fn anchors_alone(&mut self, coarse: &Stage) -> Result<(), BodyFitError> {
        let is_anchor = |it: &&BodyObservation| matches!(it, BodyObservation::Anchored { .. });
        let anchors: Vec<BodyObservation> = self.observations.iter().filter(is_anchor).cloned().collect();
        if anchors.len() < LEAST_OBSERVATIONS {
            return Ok(());
        }
        let Search { body, priors, options, .. } = *self;
        let (worth, skeleton) = (vec![1.0; anchors.len()], &body.skeleton);
        let held = held(&Columns::of(&self.state), &coarse.free);
        let tried = |state: &State| {
            let problem = Round::new(body, &anchors, &worth, state, priors, options, coarse.belongs);
            let search = Options { loss: Loss::HUBER, held: held.clone(), max_iterations: 20, relative_gain: 1e-3 };
            let found = solve(&problem, state.clone(), &search)?;
            let cost = found.costs.last().copied().unwrap_or(f64::INFINITY);
            Ok::<_, SolveError>((cost, found.parameters, found.iterations))
        };
        let mut best = tried(&self.state)?;
        let mut iterations = best.2;
        let mut keep = |best: &mut (f64, State, u32), state: &State| {
            let found = tried(state)?;
            iterations += found.2;
            // Strictly better by more than rounding: the first of equals stays.
            if found.0 < 0.999 * best.0 {
                *best = found;
            }
            Ok::<_, SolveError>(())
        };
        if coarse.free.root == RootFreedom::Free {
            for turn in turns_of_axes() {
                let mut state = self.state.clone();
                state.world_from_root.rotation *= turn;
                for (angle, dof) in state.angles.iter_mut().zip(skeleton.dofs()) {
                    *angle = 0.5 * (*angle + 0.5 * (dof.lowest + dof.highest));
                }
                keep(&mut best, &state)?;
            }
        }
        if coarse.free.angles {
            for segment in 0..skeleton.segments().len() {
                let angles = skeleton.angles_of(segment);
                let dofs = &skeleton.segments()[segment].dofs;
                let from = best.1.clone();
                for number in 1..if angles.len() > 1 { 3_usize.pow(dofs.len() as u32) } else { 0 } {
                    let mut state = from.clone();
                    for (place, dof) in dofs.iter().enumerate() {
                        let part = [0.5, 0.2, 0.8][number / 3_usize.pow(place as u32) % 3];
                        state.angles[angles.start + place] = dof.lowest + part * (dof.highest - dof.lowest);
                    }
                    keep(&mut best, &state)?;
                }
            }
        }
        self.iterations += iterations;
        self.state = best.1;
        Ok(())
    }

    /// A forearm is round and a hand is flat: a turn about a bone that is off by a right angle is a minimum of its own. Each such angle is tried in the middle and towards both of its limits.
    fn twists(&mut self, stage: &Stage) -> Result<(), BodyFitError> {
        if !stage.free.angles {
            return Ok(());
        }
        let skeleton = &self.body.skeleton;
        let about_bone: Vec<(usize, [f64; 3])> = (skeleton.dofs().enumerate())
            .filter(|(_, dof)| dof.axis.z.abs() > 0.9)
            .map(|(angle, dof)| (angle, [0.5, 0.15, 0.85].map(|it| dof.lowest + it * (dof.highest - dof.lowest))))
            .collect();
        let held = held(&Columns::of(&self.state), &stage.free);
        for (angle, values) in about_bone {
            let from = self.state.clone();
            let mut best: Option<(f64, State)> = None;
            // The one that it has comes first, and stays unless another is better.
            for value in [from.angles[angle]].into_iter().chain(values) {
                let mut state = from.clone();
                state.angles[angle] = value;
                let problem = Round::new(
                    self.body,
                    self.observations,
                    &self.worth,
                    &from,
                    self.priors,
                    self.options,
                    stage.belongs,
                );
                let search = Options { loss: stage.loss, held: held.clone(), max_iterations: 6, relative_gain: 1e-3 };
                let found = solve(&problem, state, &search)?;
                self.iterations += found.iterations;
                let cost = found.costs.last().copied().unwrap_or(f64::INFINITY);
                if best.as_ref().is_none_or(|it| cost < 0.999 * it.0) {
                    best = Some((cost, found.parameters));
                }
            }
            if let Some((_, state)) = best {
                self.state = state;
            }
        }
        Ok(())
    }

    /// One stage, to its end; whether it settled.
    fn go(&mut self, stage: &Stage) -> Result<bool, BodyFitError> {
        let columns = Columns::of(&self.state);
        // From far away distances lead in; near the surface either form does.
        let residual = if stage.belongs == Belongs::Bone { ResidualKind::Distance } else { self.options.residual };
        let Free { root, angles, scales, radii } = stage.free;
        let shape = Free { root: RootFreedom::Held, angles: false, scales, radii };
        let posture = Free { root, angles, scales: false, radii: false };
        let turns: &[Free] = if self.options.in_turn { &[posture, shape] } else { &[stage.free] };
        let options = BodyFitOptions { residual, ..self.options.clone() };
        // Which segment each observation is of, once that no longer changes.
        let mut kept: Option<Vec<Option<usize>>> = None;
        for round in 0..stage.rounds {
            let mut moved = 0.0_f64;
            let mut segments = Vec::new();
            let belongs = kept.as_deref().map_or(stage.belongs, Belongs::Kept);
            for free in turns {
                let problem =
                    Round::new(self.body, self.observations, &self.worth, &self.state, self.priors, &options, belongs)
                        .with_tied(stage.tied);
                segments = problem.segments().to_vec();
                let held = held(&columns, free);
                if held.len() == columns.len() {
                    continue;
                }
                let max_iterations = self.options.max_iterations;
                let search = Options { loss: stage.loss, held, max_iterations, relative_gain: 1e-5 };
                let solution = solve(&problem, self.state.clone(), &search)?;
                moved = moved.max(self.body.moved_m(&self.state, &solution.parameters));
                self.iterations += solution.iterations;
                self.state = solution.parameters;
                self.covariance = Some(solution.covariance);
            }
            self.rounds += 1;
            if moved < stage.settled_m {
                return Ok(true);
            }
            // Points between two segments may belong to either by turns for ever.
            let is_near = moved < COARSELY_SETTLED_M || 2 * (round + 1) >= stage.rounds;
            if stage.belongs == Belongs::Field && is_near {
                kept.get_or_insert(segments);
            }
        }
        Ok(false)
    }
}

/// The turns of a cube.
fn turns_of_axes() -> impl Iterator<Item = UnitQuaternion<f64>> {
    let about = |axis: Unit<Vector3<f64>>, quarters: i32| {
        UnitQuaternion::from_axis_angle(&axis, f64::from(quarters) * std::f64::consts::FRAC_PI_2)
    };
    let (x, y, z) = (Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis());
    let faces = [about(x, 0), about(x, 1), about(x, 2), about(x, 3), about(y, 1), about(y, 3)];
    faces.into_iter().flat_map(move |face| (0..4).map(move |it| face * about(z, it)))
}

/// The parameters that stay.
fn held(columns: &Columns, free: &Free) -> Vec<usize> {
    let spans = [
        (0, 3, free.root == RootFreedom::Free),
        (3, 6, free.root != RootFreedom::Held),
        (6, columns.scale(0), free.angles),
        (columns.scale(0), columns.radius(0, 0), free.scales),
        (columns.radius(0, 0), columns.len(), free.radii),
    ];
    spans.iter().filter(|it| !it.2).flat_map(|&(from, to, _)| from..to).collect()
}

fn check(body: &Body, observations: &[BodyObservation], start: &State, priors: &Priors) -> Result<(), BodyFitError> {
    let skeleton = &body.skeleton;
    let lists = [
        ("angles of the start", start.angles.len(), skeleton.n_angles(), false),
        ("scales of the start", start.scales.len(), skeleton.n_scales(), false),
        ("radii of the start", start.radii.len(), body.balls.len(), false),
        ("prior angles", priors.angles.len(), skeleton.n_angles(), true),
        ("prior scales", priors.scales.len(), skeleton.n_scales(), true),
        ("prior radii", priors.radii.as_ref().map_or(0, |it| it.means.len()), body.balls.len(), true),
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
        if !(place.is_finite() && sigma_m.is_finite() && sigma_m > 0.0) || segment.is_some_and(|it| it >= n) {
            let what = format!("place {place:.3} m from the origin, sigma {sigma_m} m, segment {segment:?} of {n}");
            return Err(BodyFitError::Unfit { index, what });
        }
    }
    Ok(())
}
