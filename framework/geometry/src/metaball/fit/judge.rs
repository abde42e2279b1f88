//! Judges a fit: distances, support of each segment, and reasons to distrust it.

use foveate_estimation::least_squares::Unobservable;
use nalgebra::{DMatrix, Point3};

use super::round::before_cut;
use super::{BodyFit, BodyObservation, RadiiPrior, Search};
use crate::metaball::skeleton::State;

/// A segment with fewer observations that are independent of each other is not supported: five fix a cylinder.
const LEAST_SUPPORT: f64 = 6.0;
/// More outliers than this part of the points, and the body lies elsewhere or is another one [–].
const MOST_OUTLIERS: f64 = 0.35;
/// A size that is so many standard deviations from what it is known to be is another limb's [σ].
const MOST_SIGMAS: f64 = 3.0;

/// A reason to distrust a fit, or a segment of it.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Doubt {
    /// A segment has too few points: its posture is that of the prior.
    #[error("{segment} has {found:.1} independent points, expected {LEAST_SUPPORT} at least")]
    Unsupported {
        /// Name of the segment.
        segment: String,
        /// Number of its independent points.
        found: f64,
    },
    /// Too many points lie off the body.
    #[error("{share:.2} of the points lie off the body, expected {MOST_OUTLIERS} at most")]
    Elsewhere {
        /// Share of the surface points [–].
        share: f64,
    },
    /// A length or thickness that is not plausible for a person.
    #[error("the {what} of {segment} is {sigmas:.1} standard deviations from people's mean, expected {most} at most")]
    Misshapen {
        /// Name of the segment.
        segment: String,
        /// `length` or `thickness`.
        what: &'static str,
        /// Deviation; above 0 too large [σ].
        sigmas: f64,
        /// Largest plausible deviation [σ].
        most: f64,
    },
    /// A joint beyond its anatomical limit.
    #[error("{dof} is {beyond_deg:.0} degrees beyond its limit")]
    Limit {
        /// Name of the angle.
        dof: String,
        /// Amount beyond the limit [°].
        beyond_deg: f64,
    },
    /// The last round did not converge.
    #[error("the fit did not converge within its rounds")]
    Unsettled,
}

impl Search<'_> {
    pub(super) fn judged(self, covariance: Result<DMatrix<f64>, Unobservable>, settled: bool) -> BodyFit {
        let Search { body, observations, worth, options, state, rounds, iterations, .. } = &self;
        let posed = body.skeleton.pose(state);
        let most_m = body.thickness_m(state);
        let surface = |at: &Point3<f64>, segment: Option<usize>| {
            let segment = segment.or_else(|| body.nearest_segment(&posed, state, at))?;
            let (before, at) = before_cut(body, &posed, state, segment, at);
            let distance = body.field_of(&posed, state, segment, &at)?.distance(most_m);
            Some((segment, distance, before > 0.0))
        };
        let n = observations.len();
        let (mut distances_m, mut segments) = (vec![f64::NAN; n], vec![None; n]);
        let mut support = vec![0.0; body.skeleton.segments().len()];
        let (mut sum, mut inliers, mut outliers, mut beyond) = (0.0, 0, 0, 0);
        let (mut n_surface, mut n_off) = (0, 0);
        for (index, observation) in observations.iter().enumerate() {
            let is_anchor = matches!(observation, BodyObservation::Anchored { .. });
            let (found, sigma_m) = match observation {
                BodyObservation::Point { at, sigma_m, segment } => {
                    (surface(at, *segment), sigma_m.hypot(options.model_sigma_m))
                }
                BodyObservation::Ray { origin, direction, sigma_m } => {
                    let at = body.closest_on_ray(&posed, state, origin, direction);
                    (at.and_then(|it| surface(&it, None)), sigma_m.hypot(options.model_sigma_m))
                }
                BodyObservation::Anchored { segment, place, at, sigma_m } => {
                    let scale = state.scales[body.skeleton.segments()[*segment].scale];
                    let expected = posed.world_from_segment[*segment] * Point3::from(place * scale);
                    (Some((*segment, (at - expected).norm(), false)), *sigma_m)
                }
            };
            let Some((segment, distance, is_beyond)) = found else { continue };
            beyond += usize::from(is_beyond);
            (distances_m[index], segments[index]) = (distance, Some(segment));
            n_surface += usize::from(!is_anchor);
            if distance.abs() > options.outlier_sigmas * sigma_m {
                outliers += 1;
                n_off += usize::from(!is_anchor);
            } else {
                support[segment] += worth[index];
                if !is_anchor {
                    sum += distance * distance;
                    inliers += 1;
                }
            }
        }
        let share = n_off as f64 / f64::from(n_surface.max(1) as u32);
        let doubts = self.doubts(&support, share, settled);
        let rms_m = if inliers > 0 { (sum / f64::from(inliers)).sqrt() } else { f64::NAN };
        BodyFit {
            state: state.clone(),
            covariance,
            distances_m,
            segments,
            rms_m,
            outliers,
            off_share: share,
            beyond,
            support,
            doubts,
            rounds: *rounds,
            iterations: *iterations,
            settled,
        }
    }

    fn doubts(&self, support: &[f64], share: f64, settled: bool) -> Vec<Doubt> {
        let Search { body, priors, options, state, .. } = self;
        let mut doubts = Vec::new();
        if share > MOST_OUTLIERS {
            doubts.push(Doubt::Elsewhere { share });
        }
        let lengths: Vec<(f64, f64)> =
            priors.scales.iter().zip(&state.scales).map(|((mean, sigma), it)| ((it / mean).ln(), *sigma)).collect();
        let stature = in_common(&lengths, priors.stature);
        let girth = priors.radii.as_ref().map_or((0.0, 0.0), |prior| {
            let off = |it: usize| (thickness_off(prior, state, it), prior.thickness);
            (in_common(&(0..prior.means.len()).map(off).collect::<Vec<_>>(), prior.girth), prior.girth)
        });
        for (what, off, sigma) in [("stature", stature, priors.stature), ("girth", girth.0, girth.1)] {
            if sigma > 0.0 && off.abs() > MOST_SIGMAS * sigma {
                let segment = "the whole body".to_owned();
                doubts.push(Doubt::Misshapen { segment, what, sigmas: off / sigma, most: MOST_SIGMAS });
            }
        }
        let girth = girth.0;
        for (number, segment) in body.skeleton.segments().iter().enumerate() {
            let own: Vec<usize> = (0..body.balls.len()).filter(|it| body.balls[*it].segment == number).collect();
            if own.is_empty() {
                continue;
            }
            if support[number] < LEAST_SUPPORT {
                doubts.push(Doubt::Unsupported { segment: segment.name.clone(), found: support[number] });
                continue;
            }
            let mut sizes = Vec::new();
            if let Some((mean, sigma)) = priors.scales.get(segment.scale) {
                sizes.push(("length", ((state.scales[segment.scale] / mean).ln() - stature) / sigma));
            }
            if let Some(prior) = &priors.radii {
                let off = own.iter().map(|it| thickness_off(prior, state, *it)).sum::<f64>() / own.len() as f64;
                sizes.push(("thickness", (off - girth) / prior.thickness));
            }
            for (what, sigmas) in sizes.into_iter().filter(|it| it.1.abs() > MOST_SIGMAS) {
                doubts.push(Doubt::Misshapen { segment: segment.name.clone(), what, sigmas, most: MOST_SIGMAS });
            }
        }
        for (dof, angle) in body.skeleton.dofs().zip(&state.angles) {
            let beyond = (angle - angle.clamp(dof.lowest, dof.highest)).abs();
            if beyond > 3.0 * options.limit_sigma {
                doubts.push(Doubt::Limit { dof: dof.name.clone(), beyond_deg: beyond.to_degrees() });
            }
        }
        if !settled {
            doubts.push(Doubt::Unsettled);
        }
        doubts
    }
}

/// The logarithm of a ball's thickness over what is expected [–].
fn thickness_off(prior: &RadiiPrior, state: &State, ball: usize) -> f64 {
    state.radii[ball].component_div(&prior.means[ball]).xy().map(f64::ln).mean()
}

/// What sizes, each with its own standard deviation, have in common that is known to be 0 within `common` [–].
fn in_common(sizes: &[(f64, f64)], common: f64) -> f64 {
    if common <= 0.0 {
        return 0.0;
    }
    let weight: f64 = sizes.iter().map(|it| it.1.powi(-2)).sum();
    sizes.iter().map(|it| it.0 / it.1.powi(2)).sum::<f64>() / (weight + common.powi(-2))
}
