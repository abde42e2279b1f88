//! Whether an unseen mark is hidden at its model position, or is elsewhere.
//!
//! Closed lips and lids hide their marks in a fold, in shapes of which these marks were never captured. Their model positions are then where
//! cameras would see them, and their stated covariances are too small. That they are not seen is evidence: a camera that sees most of the marks around one would see that one too, nine times out of ten (p).
//! Where three cameras or more, n, would, with π the prior probability of a mark elsewhere,
//!
//! P(elsewhere | unseen) = π / (π + (1 − π) (1 − p)ⁿ)
//!
//! A mark that is elsewhere lies anywhere up to halfway to its neighbours, d away: a variance of d² / 12 on each axis.

use std::collections::BTreeMap;

use foveate::geometry::ShapeModel;
use foveate::messages::{CameraId, CameraSet, Mark};

/// Number of neighbours that define whether a camera sees the surroundings of a mark.
const AROUND: usize = 16;
/// A camera sees the surroundings of a mark when it sees this part of them.
const MOST: f64 = 0.6;
/// π: prior probability that a mark is elsewhere.
const ELSEWHERE: f64 = 0.01;
/// p: probability that a camera that sees the surroundings of a mark sees the mark.
const SEEN: f64 = 0.9;
/// Fewer cameras than this may all be occluded.
const LEAST_CAMERAS: usize = 3;

/// Visibility of the marks of a model.
pub(super) struct Unseen {
    /// By mark: its nearest ones.
    around: Vec<Vec<usize>>,
    /// By mark: variance of one axis where it is elsewhere [m²].
    elsewhere: Vec<f64>,
    /// By mark: the cameras that see it at the present moment.
    cameras: Vec<CameraSet>,
}

impl Unseen {
    /// For the marks of `model`.
    pub fn of(model: &ShapeModel) -> Unseen {
        let nearest = |mark: usize| {
            let mut others: Vec<(f64, usize)> = (0..model.mean.len())
                .filter(|it| *it != mark)
                .map(|it| ((model.mean[it] - model.mean[mark]).norm(), it))
                .collect();
            others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            others.truncate(AROUND);
            others
        };
        let nearest: Vec<_> = (0..model.labels.len()).map(nearest).collect();
        Unseen {
            elsewhere: nearest.iter().map(|it| it.first().map_or(0.0, |it| it.0 * it.0 / 12.0)).collect(),
            around: nearest.into_iter().map(|it| it.into_iter().map(|it| it.1).collect()).collect(),
            cameras: vec![CameraSet::default(); model.labels.len()],
        }
    }

    /// Takes in the marks that were measured at a moment.
    pub fn see(&mut self, model: &ShapeModel, measured: &[Mark]) {
        self.cameras.iter_mut().for_each(CameraSet::clear);
        for mark in measured {
            if let Some(at) = model.index_of(mark.label) {
                self.cameras[at].clone_from(&mark.cameras);
            }
        }
    }

    /// Number of cameras that see most of the surroundings of a mark.
    fn n_looking(&self, mark: usize) -> usize {
        let mut counts: BTreeMap<CameraId, usize> = BTreeMap::new();
        for camera in self.around[mark].iter().flat_map(|it| self.cameras[*it].iter()) {
            *counts.entry(camera).or_default() += 1;
        }
        let enough = MOST * self.around[mark].len() as f64;
        counts.values().filter(|it| **it as f64 >= enough).count()
    }

    /// Additional variance on each axis of an unmeasured mark because it may be elsewhere [m²].
    pub fn variance(&self, mark: usize) -> f64 {
        let n = self.n_looking(mark);
        if n < LEAST_CAMERAS {
            return 0.0;
        }
        let unseen = (1.0 - SEEN).powi(n as i32);
        ELSEWHERE / (ELSEWHERE + (1.0 - ELSEWHERE) * unseen) * self.elsewhere[mark]
    }
}
