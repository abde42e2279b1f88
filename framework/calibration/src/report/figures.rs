//! Figures of each camera for the page, computed once.

use nalgebra::{Point2, Vector2};

use crate::solved::{ObservationRole, Solved};

/// Residuals, pixels and depths of one camera.
#[derive(Debug, Clone, Default)]
pub(super) struct OfCamera {
    /// Observations by role: used, held out, rejected, unsolved.
    pub counts: [usize; 4],
    /// Lengths of the residuals of used observations, sorted [px].
    pub used_px: Vec<f64>,
    /// Lengths of the residuals of observations held out, sorted [px].
    pub held_out_px: Vec<f64>,
    /// Where it was seen, with the residual where there is one; used and held out.
    pub seen: Vec<(Point2<f64>, Option<Vector2<f64>>)>,
    /// Depths of the points that it saw, used or held out, sorted.
    pub depths: Vec<f64>,
    /// Links with other cameras that agree with the rest.
    pub links: usize,
}

/// Of the whole room.
pub(super) struct Figures {
    pub cameras: Vec<OfCamera>,
    /// Lengths of all residuals of used observations, sorted [px].
    pub used_px: Vec<f64>,
    /// Of those held out, sorted [px].
    pub held_out_px: Vec<f64>,
    pub n_frames: usize,
    /// Observations whose camera or point does not exist; they are left out of everything.
    pub n_bad: usize,
}

impl Figures {
    pub(super) fn of(solved: &Solved) -> Self {
        let mut cameras = vec![OfCamera::default(); solved.cameras.len()];
        let mut frames = Vec::with_capacity(solved.observations.len());
        let mut n_bad = 0;
        for observation in &solved.observations {
            let Some(of) = cameras.get_mut(observation.camera) else {
                n_bad += 1;
                continue;
            };
            frames.push(observation.frame);
            of.counts[role_index(observation.role)] += 1;
            if !matches!(observation.role, ObservationRole::Used | ObservationRole::HeldOut) {
                continue;
            }
            let residual = observation.residual.filter(|it| it.norm().is_finite());
            if observation.pixel.coords.norm().is_finite() {
                of.seen.push((observation.pixel, residual));
            }
            let list = if observation.role == ObservationRole::Used { &mut of.used_px } else { &mut of.held_out_px };
            list.extend(residual.map(|it| it.norm()));
            let point = observation.point.and_then(|it| solved.points.get(it));
            let depth = point.map(|it| (solved.cameras[observation.camera].camera.camera_from_world * it.position).z);
            of.depths.extend(depth.filter(|it| it.is_finite()));
        }
        for link in solved.links.iter().filter(|it| it.consistent) {
            for end in [link.a, link.b] {
                if let Some(of) = cameras.get_mut(end) {
                    of.links += 1;
                }
            }
        }
        for of in &mut cameras {
            for list in [&mut of.used_px, &mut of.held_out_px, &mut of.depths] {
                list.sort_by(f64::total_cmp);
            }
        }
        let all = |which: fn(&OfCamera) -> &Vec<f64>| {
            let mut all: Vec<f64> = cameras.iter().flat_map(|it| which(it).iter().copied()).collect();
            all.sort_by(f64::total_cmp);
            all
        };
        let (used_px, held_out_px) = (all(|it| &it.used_px), all(|it| &it.held_out_px));
        frames.sort_unstable();
        frames.dedup();
        Self { cameras, used_px, held_out_px, n_frames: frames.len(), n_bad }
    }
}

fn role_index(role: ObservationRole) -> usize {
    match role {
        ObservationRole::Used => 0,
        ObservationRole::HeldOut => 1,
        ObservationRole::Rejected => 2,
        ObservationRole::Unsolved => 3,
    }
}

/// The value below which this part of a sorted list lies; NaN for none.
pub(super) fn quantile(sorted: &[f64], part: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    let place = part * last as f64;
    let (low, high) = (sorted[place.floor() as usize], sorted[place.ceil() as usize]);
    low + (high - low) * place.fract()
}

pub(super) fn rms(list: &[f64]) -> f64 {
    (list.iter().map(|it| it * it).sum::<f64>() / list.len() as f64).sqrt()
}
