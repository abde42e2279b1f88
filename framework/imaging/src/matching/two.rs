//! The match of a template in one other picture.

use nalgebra::{Matrix2, Vector2};

use super::spline::SplineImage;
use super::template::{N, Template, Unknowns};
use super::{Freedom, MatchOptions, Refused, Warp, lanes, rows_of};

/// The match of a template in one other picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// Its place and affine deformation.
    pub warp: Warp,
    /// Of the place, from what is left of the differences [px²].
    pub covariance: Matrix2<f64>,
    /// Correlation between the two patches, 0 to 1 [–].
    pub correlation: f64,
    /// Standard deviation of the differences that are left [gray level].
    pub sigma0: f64,
    /// Gray levels here over those in the template [–].
    pub gain: f64,
    /// Steps taken.
    pub steps: u32,
}

impl Match {
    /// Standard deviation of the place along its worst direction [px].
    pub fn sigma_px(&self) -> f64 {
        worst_sigma(&self.covariance)
    }
}

pub(super) fn worst_sigma(covariance: &Matrix2<f64>) -> f64 {
    let [a, b, d] = [covariance[(0, 0)], covariance[(0, 1)], covariance[(1, 1)]];
    ((a + d) / 2.0 + ((a - d) / 2.0).hypot(b)).max(0.0).sqrt()
}

/// Memory of a match, used again.
#[derive(Debug, Clone, Default)]
pub struct MatchBuffers {
    pub(super) values: Vec<f32>,
}

/// The picture under one warp of a template, compared with it.
pub(super) struct Compared {
    pub(super) gain: f64,
    /// Cᵀ I: right-hand side of the normal equations.
    pub(super) right: Unknowns,
    /// Σ (I − Ī)².
    energy: f64,
    /// Σ T I.
    along: f64,
}

impl Compared {
    /// Correlation of the patches as they lie, before what a last step would still explain.
    pub(super) fn correlation(&self, template: &Template) -> f64 {
        self.along / (self.energy * template.energy).sqrt().max(f64::MIN_POSITIVE)
    }

    /// Variance of what gain and offset leave, for `unknowns` geometric unknowns [gray level²].
    pub(super) fn variance(&self, template: &Template, unknowns: usize) -> f64 {
        let left = (self.energy - self.gain * self.along).max(0.0);
        left / (template.n() as f64 - 2.0 - unknowns as f64).max(1.0)
    }
}

/// Samples `picture` under `warp` and compares; `None` outside.
pub(super) fn compare(
    template: &Template,
    picture: &SplineImage,
    warp: &Warp,
    values: &mut Vec<f32>,
) -> Option<Compared> {
    let n = template.n();
    values.resize(n, 0.0);
    // About the template's mean, so that sums of squares keep their digits.
    if !picture.sample(warp, template.reach, template.mean, values) {
        return None;
    }
    let mean = f64::from(lanes::sum(values)) / n as f64;
    let energy = f64::from(lanes::dot(values, values)) - n as f64 * mean * mean;
    let along = f64::from(lanes::dot(&template.values, values));
    let right = Unknowns::from_fn(|i, _| f64::from(lanes::dot(template.column(i), values)));
    Some(Compared { gain: along / template.energy, right, energy, along })
}

/// The warp before which `step` (in the template) is undone: W ∘ (id + Δ)⁻¹.
pub(super) fn compose(warp: &Warp, step: &Unknowns, reach: usize) -> Option<Warp> {
    let per_px = 1.0 / reach as f64;
    let linear = Matrix2::new(1.0 + step[2] * per_px, step[3] * per_px, step[4] * per_px, 1.0 + step[5] * per_px);
    let matrix = warp.as_matrix() * linear.try_inverse()?;
    let moved = matrix * Vector2::new(step[0], step[1]);
    Some(Warp { at: [warp.at[0] - moved.x, warp.at[1] - moved.y], matrix: rows_of(&matrix) })
}

/// How far a step moves the corner of the patch that it moves most, at most [px].
fn corner(step: &Unknowns) -> f64 {
    let right = step[0].abs() + step[2].abs() + step[3].abs();
    right.max(step[1].abs() + step[4].abs() + step[5].abs())
}

/// A step beyond this part of the half side leaves the place where the linear picture holds.
const LONGEST: f64 = 0.5;
/// What the corners of a patch may still move when its centre rests: the rest of the bending hardly moves the centre.
const CORNERS: f64 = 10.0;

/// Steps that do not shrink by this much say nothing of those to come,
const SHRINKS: f64 = 0.6;
/// unless they are this small, in parts of what may be left.
const SHORTEST: f64 = 2.0;

/// Finds `template` in `picture`, from `start` on.
///
/// # Errors
/// See [`Refused`]; the gates are those of `options`.
pub fn match_template(
    template: &Template,
    picture: &SplineImage,
    start: &Warp,
    options: &MatchOptions,
    buffers: &mut MatchBuffers,
) -> Result<Match, Refused> {
    let reach = template.reach;
    let shift_only = options.freedom == Freedom::Translation;
    let of_shift = shift_only.then(|| template.information.fixed_view::<2, 2>(0, 0).try_inverse()).flatten();
    if shift_only && of_shift.is_none() {
        return Err(Refused::NoTexture);
    }
    let mut warp = *start;
    let mut last = f64::INFINITY;
    for steps in 1..=options.max_steps {
        let compared = compare(template, picture, &warp, &mut buffers.values).ok_or(Refused::Outside)?;
        if compared.gain * options.max_gain < 1.0 {
            return Err(Refused::Radiometry);
        }
        let mut step = match of_shift {
            Some(inverse) => {
                let shift = inverse * compared.right.fixed_rows::<2>(0);
                Unknowns::new(shift.x, shift.y, 0.0, 0.0, 0.0, 0.0)
            }
            None => template.inverse * compared.right,
        } / compared.gain;
        let (moves, longest) = (corner(&step), LONGEST * reach as f64);
        if moves > longest {
            step *= longest / moves;
        }
        let next = compose(&warp, &step, reach).ok_or(Refused::Bent)?;
        let moved = (next.at[0] - warp.at[0]).hypot(next.at[1] - warp.at[1]);
        warp = next;
        if (warp.at[0] - start.at[0]).hypot(warp.at[1] - start.at[1]) > options.max_shift_px {
            return Err(Refused::Wandered);
        }
        let [largest, smallest] = warp.stretches();
        // Far beyond the gate there is no way back.
        if !(largest < 2.0 * options.max_stretch && smallest * 2.0 * options.max_stretch > 1.0) {
            return Err(Refused::Bent);
        }
        // Steps become shorter by about the same factor each time: what is still to come is a geometric series.
        let moves = moved.max(corner(&step) / CORNERS);
        let ratio = moves / last;
        let settles = last.is_finite() && ratio < SHRINKS && moves * ratio / (1.0 - ratio) < options.done_px;
        if moves < SHORTEST * options.done_px || settles {
            return judge(template, &warp, &compared, &step, steps, options);
        }
        last = moves;
    }
    Err(Refused::NoConvergence)
}

/// The residual after the last step, which is too small to be worth another comparison, checked against the gates.
fn judge(
    template: &Template,
    warp: &Warp,
    compared: &Compared,
    step: &Unknowns,
    steps: u32,
    options: &MatchOptions,
) -> Result<Match, Refused> {
    let Compared { gain, right, energy, along } = compared;
    if *gain > options.max_gain {
        return Err(Refused::Radiometry);
    }
    let [largest, smallest] = warp.stretches();
    if largest > options.max_stretch || smallest * options.max_stretch < 1.0 || largest > options.max_shear * smallest {
        return Err(Refused::Bent);
    }
    let unknowns = if options.freedom == Freedom::Translation { 2 } else { N };
    let left = (energy - gain * along - gain * right.dot(step)).max(0.0);
    let correlation = (1.0 - left / energy.max(f64::MIN_POSITIVE)).max(0.0).sqrt();
    if correlation < options.min_correlation {
        return Err(Refused::Dissimilar);
    }
    let variance = left / (template.n() as f64 - 2.0 - unknowns as f64).max(1.0);
    let in_template = if unknowns == 2 {
        let inverse = template.information.fixed_view::<2, 2>(0, 0).try_inverse();
        inverse.ok_or(Refused::NoTexture)?
    } else {
        template.bound()
    };
    let matrix = warp.as_matrix();
    let covariance = matrix * in_template * matrix.transpose() * (variance / (gain * gain));
    if worst_sigma(&covariance) > options.max_sigma_px {
        return Err(Refused::Vague);
    }
    Ok(Match { warp: *warp, covariance, correlation, sigma0: variance.sqrt(), gain: *gain, steps })
}
