//! Whether a mark is hidden where the model has it, or is elsewhere.
//!
//! Lips that are pressed together and lids that close take their marks along into a fold: at just the shapes of which nothing was captured of these marks. The model then has them where
//! cameras would see them, and what it states of them holds for what was captured. That they are not seen tells: a camera that sees most of the marks around one would see that one too, nine times out of ten (p).
//! Where three cameras or more, n, would, with π for how often a mark is elsewhere,
//!
//! P(elsewhere | unseen) = π / (π + (1 − π) (1 − p)ⁿ)
//!
//! A mark that is elsewhere lies anywhere up to halfway to its neighbours, d away: a variance of d² / 12 on each axis.

use std::collections::BTreeMap;

use foveate::geometry::ShapeModel;
use foveate::messages::{CameraId, CameraSet, Mark};

/// Marks that are asked about what a camera sees around one.
const AROUND: usize = 16;
/// A camera sees what is around a mark when it sees this part of them.
const MOST: f64 = 0.6;
/// π: a mark is elsewhere so often.
const ELSEWHERE: f64 = 0.01;
/// p: a camera that sees what is around a mark sees the mark so often.
const SEEN: f64 = 0.9;
/// Fewer cameras than this may all have something before them.
const LEAST_CAMERAS: usize = 3;

/// What is known of the marks of a model.
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

    /// How many cameras see most of what is around a mark.
    fn n_looking(&self, mark: usize) -> usize {
        let mut counts: BTreeMap<CameraId, usize> = BTreeMap::new();
        for camera in self.around[mark].iter().flat_map(|it| self.cameras[*it].iter()) {
            *counts.entry(camera).or_default() += 1;
        }
        let enough = MOST * self.around[mark].len() as f64;
        counts.values().filter(|it| **it as f64 >= enough).count()
    }

    /// What it adds to the variance on each axis of the mark, which is not measured, that it may be elsewhere [m²].
    pub fn variance(&self, mark: usize) -> f64 {
        let n = self.n_looking(mark);
        if n < LEAST_CAMERAS {
            return 0.0;
        }
        let unseen = (1.0 - SEEN).powi(n as i32);
        ELSEWHERE / (ELSEWHERE + (1.0 - ELSEWHERE) * unseen) * self.elsewhere[mark]
    }
}
