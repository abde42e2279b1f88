//! One template in several pictures at once, with one point in space as an unknown: the multi-image constraint.
//!
//! A. Gruen, E. Baltsavias, "Geometrically constrained multiphoto matching", PE&RS 54(5), 1988. The point lies on the line of sight of the
//! template's pixel, so that its only unknown is its depth t; picture k sees it at pₖ(t). Each picture has a bending, a gain and an offset of its own,
//! which are eliminated (Schur complement); what is left is one equation a picture for t. With one picture this is the epipolar constraint.

use nalgebra::{Matrix2, Matrix2x4, Matrix4, Vector2, Vector4};

use super::spline::SplineImage;
use super::template::{Template, Unknowns};
use super::two::{Compared, MatchBuffers, compare, compose};
use super::{MatchOptions, Refused, Warp};

/// The place of a point of given depth in one picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Column, row [px].
    pub at: [f64; 2],
    /// How fast that moves with the depth [px a unit of depth].
    pub by_depth: [f64; 2],
}

/// A match in several pictures: the depth of the point, and its place in each picture.
#[derive(Debug, Clone, PartialEq)]
pub struct SpaceMatch {
    /// In the unit of the caller's `place`.
    pub depth: f64,
    /// Standard deviation of the depth.
    pub variance: f64,
    /// By picture: its warp, and its correlation with the template; `None` for one that was left out, with the reason.
    pub pictures: Vec<Result<(Warp, f64), Refused>>,
    /// Steps taken.
    pub steps: u32,
}

impl SpaceMatch {
    /// How many pictures the depth is from.
    pub fn n_pictures(&self) -> usize {
        self.pictures.iter().filter(|it| it.is_ok()).count()
    }
}

/// A template's normal equations with the bending eliminated.
struct Reduced {
    /// Of the shift when the bending follows.
    information: Matrix2<f64>,
    /// Takes the right-hand side of the bending away from that of the shift.
    elimination: Matrix2x4<f64>,
    of_bending: Matrix4<f64>,
    between: Matrix2x4<f64>,
}

impl Reduced {
    fn of(template: &Template) -> Option<Self> {
        let all = &template.information;
        let of_bending = all.fixed_view::<4, 4>(2, 2).into_owned().cholesky()?.inverse();
        let between = all.fixed_view::<2, 4>(0, 2).into_owned();
        let elimination = between * of_bending;
        let information = all.fixed_view::<2, 2>(0, 0) - elimination * between.transpose();
        Some(Self { information, elimination, of_bending, between })
    }

    /// Shift and bending: what the right-hand side asks for when the shift is `shift`.
    fn step(&self, compared: &Compared, shift: Vector2<f64>) -> Unknowns {
        let right: Vector4<f64> = compared.right.fixed_rows::<4>(2) / compared.gain;
        let bending = self.of_bending * (right - self.between.transpose() * shift);
        Unknowns::new(shift.x, shift.y, bending[0], bending[1], bending[2], bending[3])
    }
}

/// One picture under way.
struct View {
    warp: Warp,
    compared: Compared,
    /// Shift in the template for one unit of depth [px].
    by_depth: Vector2<f64>,
    weight: f64,
}

/// Finds `template` in all `pictures` at once; `starts` has the bending of each (its place follows from `depth`), and `place(k, t)` says where picture k
/// sees the point at depth t. A picture that fails a gate is left out and the rest goes on.
///
/// # Errors
/// The reason of the first picture that was left out, when none is left; [`Refused::Vague`] when the depth is not fixed, [`Refused::NoConvergence`].
pub fn match_in_space(
    template: &Template,
    pictures: &[&SplineImage],
    starts: &[[[f64; 2]; 2]],
    depth: f64,
    options: &MatchOptions,
    mut place: impl FnMut(usize, f64) -> Option<Place>,
    buffers: &mut MatchBuffers,
) -> Result<SpaceMatch, Refused> {
    let reduced = Reduced::of(template).ok_or(Refused::NoTexture)?;
    let (mut depth, first) = (depth, depth);
    let mut matrices = starts.to_vec();
    let mut outcomes: Vec<Result<(Warp, f64), Refused>> =
        vec![Ok((Warp::shift([0.0; 2]), 0.0)); pictures.len().min(starts.len())];
    for steps in 1..=options.max_steps {
        let mut views: Vec<Option<View>> = Vec::with_capacity(outcomes.len());
        let (mut information, mut right) = (0.0, 0.0);
        for (k, outcome) in outcomes.iter_mut().enumerate() {
            let view = if outcome.is_ok() {
                let seen = place(k, depth).ok_or(Refused::Outside);
                seen.and_then(|it| compare_at(template, pictures[k], it, matrices[k], options, buffers))
            } else {
                Err(Refused::Outside)
            };
            match view {
                Ok(view) => {
                    let Compared { gain, right: of_all, .. } = &view.compared;
                    let of_shift = of_all.fixed_rows::<2>(0) - reduced.elimination * of_all.fixed_rows::<4>(2);
                    information +=
                        view.weight * gain * gain * view.by_depth.dot(&(reduced.information * view.by_depth));
                    right += view.weight * gain * view.by_depth.dot(&of_shift);
                    views.push(Some(view));
                }
                Err(reason) => {
                    *outcome = outcome.and(Err(reason));
                    views.push(None);
                }
            }
        }
        if views.iter().all(Option::is_none) {
            return Err(outcomes.iter().find_map(|it| it.err()).unwrap_or(Refused::Outside));
        }
        if !(information > 0.0 && information.is_finite()) {
            return Err(Refused::Vague);
        }
        let step = right / information;
        depth += step;
        let mut moved: f64 = 0.0;
        for (k, view) in views.iter().enumerate() {
            let Some(view) = view else { continue };
            let shift = view.by_depth * step;
            let unknowns = reduced.step(&view.compared, shift);
            match compose(&view.warp, &unknowns, template.reach) {
                Some(next) => matrices[k] = next.matrix,
                None => outcomes[k] = Err(Refused::Bent),
            }
            moved = moved.max((view.warp.as_matrix() * shift).norm());
            if let (Some(now), Some(then)) = (place(k, depth), place(k, first))
                && (now.at[0] - then.at[0]).hypot(now.at[1] - then.at[1]) > options.max_shift_px
            {
                return Err(Refused::Wandered);
            }
        }
        if moved < 2.0 * options.done_px && steps > 1 {
            return finish(template, depth, information, &views, &matrices, outcomes, steps, options, &mut place);
        }
    }
    Err(Refused::NoConvergence)
}

fn compare_at(
    template: &Template,
    picture: &SplineImage,
    place: Place,
    matrix: [[f64; 2]; 2],
    options: &MatchOptions,
    buffers: &mut MatchBuffers,
) -> Result<View, Refused> {
    let warp = Warp { at: place.at, matrix };
    let [largest, smallest] = warp.stretches();
    if !(largest < 2.0 * options.max_stretch && smallest * 2.0 * options.max_stretch > 1.0) {
        return Err(Refused::Bent);
    }
    let compared = compare(template, picture, &warp, &mut buffers.values).ok_or(Refused::Outside)?;
    if compared.gain * options.max_gain < 1.0 {
        return Err(Refused::Radiometry);
    }
    let inverse = warp.as_matrix().try_inverse().ok_or(Refused::Bent)?;
    let by_depth = -(inverse * Vector2::from(place.by_depth));
    let variance = compared.variance(template, 5).max(f64::MIN_POSITIVE);
    Ok(View { warp, compared, by_depth, weight: 1.0 / variance })
}

#[expect(clippy::too_many_arguments, reason = "the end of one loop, apart for its length")]
fn finish(
    template: &Template,
    depth: f64,
    information: f64,
    views: &[Option<View>],
    matrices: &[[[f64; 2]; 2]],
    mut outcomes: Vec<Result<(Warp, f64), Refused>>,
    steps: u32,
    options: &MatchOptions,
    place: &mut impl FnMut(usize, f64) -> Option<Place>,
) -> Result<SpaceMatch, Refused> {
    for (k, view) in views.iter().enumerate() {
        let Some(view) = view else { continue };
        let Some(seen) = place(k, depth) else {
            outcomes[k] = Err(Refused::Outside);
            continue;
        };
        let warp = Warp { at: seen.at, matrix: matrices[k] };
        let [largest, smallest] = warp.stretches();
        let correlation = view.compared.correlation(template);
        let bent = largest > options.max_stretch
            || smallest * options.max_stretch < 1.0
            || largest > options.max_shear * smallest;
        outcomes[k] = match () {
            () if bent => Err(Refused::Bent),
            () if view.compared.gain > options.max_gain => Err(Refused::Radiometry),
            () if correlation < options.min_correlation => Err(Refused::Dissimilar),
            () => Ok((warp, correlation)),
        };
    }
    let Some(reason) = outcomes.iter().find_map(|it| it.err()).filter(|_| outcomes.iter().all(Result::is_err)) else {
        let variance = 1.0 / information;
        // Along the fastest of the pictures, as that of a single match.
        let fastest = views.iter().flatten().map(|it| (it.warp.as_matrix() * it.by_depth).norm()).fold(0.0, f64::max);
        if variance.sqrt() * fastest > options.max_sigma_px {
            return Err(Refused::Vague);
        }
        return Ok(SpaceMatch { depth, variance, pictures: outcomes, steps });
    };
    Err(reason)
}
