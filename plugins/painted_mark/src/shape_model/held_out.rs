//! Errors of filled marks by cross-validation: some seen marks are held out of a fit as if they were hidden, and compared with their filled positions.
//!
//! A model's covariance of hidden marks is valid for the captured shapes. Other movements of the skin have larger errors, which are not observed at hidden marks. So
//! at each moment the seen marks around the one that is nearest to a hidden mark are held out, and the variances of filled marks are multiplied by the recent mean square error of these, over the
//! variance stated for them, at least 1. This is the cross-validation of M. Stone ("Cross-validatory choice and assessment of statistical predictions", Journal of the Royal Statistical Society B 36, 1974).

use foveate::estimation::Summary;
use foveate::geometry::{FitOptions, FittedShape, MarkObservation, ShapeFitter};
use nalgebra::Point3;

use super::leftover::Leftover;

/// Marks this near to the chosen one are held out with it [m].
const REACH_M: f64 = 0.025;
/// Memory of held-out marks: the weight of each decreases by one part in this with each later one.
const MEMORY: f64 = 400.0;
/// Number of virtual marks without excess error as a prior.
const BELIEVED: f64 = 30.0;
/// Largest error of a mark that is used, in standard deviations.
const MOST_SIGMAS: f64 = 6.0;

/// Marks held out so far.
pub(super) struct HeldOut {
    fitter: ShapeFitter,
    /// Sums of squared errors, and of their stated variances [m²].
    off: f64,
    stated: f64,
    n: f64,
    turn: usize,
    /// All distances [mm].
    all_mm: Vec<f64>,
}

impl HeldOut {
    /// For a fitter with its model.
    pub fn of(fitter: &ShapeFitter) -> HeldOut {
        HeldOut { fitter: fitter.clone(), off: 0.0, stated: 0.0, n: 0.0, turn: 0, all_mm: Vec::new() }
    }

    /// Factor on the variances of filled marks [–].
    pub fn factor(&self) -> f64 {
        if self.stated <= 0.0 {
            return 1.0;
        }
        let believed = BELIEVED * self.stated / self.n;
        ((self.off + believed) / (self.stated + believed)).max(1.0)
    }

    /// Errors of held-out marks [mm].
    pub fn off_mm(&self) -> Option<Summary> {
        Summary::of(&self.all_mm)
    }

    /// Holds out some marks of `seen` at a moment, whose fit is `fitted`; does nothing with fewer than `least` left.
    pub fn learn(&mut self, seen: &[MarkObservation], fitted: &FittedShape, least: usize, options: &FitOptions) {
        let place = |label: u32| self.fitter.model().index_of(label).map(|it| fitted.marks[it].position);
        let seen: Vec<(MarkObservation, Point3<f64>)> = seen
            .iter()
            .filter(|it| !fitted.wrong.contains(&it.label))
            .filter_map(|it| Some((*it, place(it.label)?)))
            .collect();
        let labels = &self.fitter.model().labels;
        let hidden: Vec<Point3<f64>> = labels
            .iter()
            .filter(|it| !seen.iter().any(|seen| seen.0.label == **it))
            .filter_map(|it| place(*it))
            .collect();
        if seen.is_empty() {
            return;
        }
        self.turn = self.turn.wrapping_add(1);
        let middle = match hidden.get(self.turn % hidden.len().max(1)) {
            Some(hidden) => {
                let nearest = seen.iter().min_by(|a, b| (a.1 - hidden).norm().total_cmp(&(b.1 - hidden).norm()));
                nearest.map_or(*hidden, |it| it.1)
            }
            None => seen[self.turn % seen.len()].1,
        };
        let (out, left): (Vec<_>, Vec<_>) = seen.into_iter().partition(|it| (it.1 - middle).norm() <= REACH_M);
        if left.len() < least {
            return;
        }
        let observations: Vec<MarkObservation> = left.iter().map(|it| it.0).collect();
        let Ok(without) = self.fitter.fit(&observations, options) else { return };
        let elsewhere = |it: &MarkObservation| {
            let place = without.marks[self.fitter.model().index_of(it.label)?].position;
            Some((place, without.measured_from_shape.inverse_transform_point(&it.position) - place))
        };
        let leftover = Leftover::of(&observations.iter().filter_map(elsewhere).collect::<Vec<_>>());
        for (it, _) in &out {
            let Some(mark) = self.fitter.model().index_of(it.label).map(|at| without.marks[at]) else { continue };
            let filled = leftover.as_ref().map_or(mark.position, |it| mark.position + it.at(&mark.position));
            let square = (it.position - without.measured_from_shape * filled).norm_squared();
            self.all_mm.push(1e3 * square.sqrt());
            let open = leftover.as_ref().map_or(0.0, |it| it.variance_at(&mark.position));
            let (own, stated) = (it.covariance.trace(), mark.covariance.trace() + 3.0 * open);
            let off = square.min(MOST_SIGMAS.powi(2) * (own + stated)) - own;
            let kept = 1.0 - 1.0 / MEMORY;
            (self.off, self.stated, self.n) = (kept * self.off + off, kept * self.stated + stated, kept * self.n + 1.0);
        }
    }
}
