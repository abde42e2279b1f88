//! Views that contradict the others: a moved camera, a wrong calibration, or another camera's files.
//!
//! Without such a view the silhouettes of the others are covered much better, and its own is not covered by what they leave over. A view that only lost an arm differs in that: its silhouette is covered, it lacks
//! something. What lies in one view only, as a shadow does, carves nothing, so that without it the others are covered as before.

use foveate::geometry::voxels::{SilhouetteView, VoxelGrid, cover};
use foveate::prelude::*;

use super::{Fit, Found, Hull, View, fit, silhouette_view};

/// A view that was left out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contradiction {
    /// Of which camera.
    pub camera: CameraId,
    /// What the hull of the others would have to be shifted by in its picture to fit its silhouette, where it fits much better then [px of its silhouette].
    pub fit: Option<Fit>,
    /// How much that is at the distance of the hull [m], and as an angle [rad].
    pub apart: [f64; 2],
}

/// Views, at least, for one of them to be found in contradiction to the others.
const TO_CONTRADICT: usize = 4;
/// Of fewer views than this one is left out only where so much of the others' silhouettes is covered without it: three views that show ghosts agree with few of each other's.
const FEW: usize = 6;
const GOOD: f64 = 0.8;
/// Numbers of views for which pairs are searched: with fewer the rest is no majority that bounds a body, with more one after the other is found, and there are too many pairs.
const PAIR_OF: std::ops::RangeInclusive<usize> = 7..=12;
/// Views of which one may be left out.
const ONE_OF: usize = 3;
/// How many times larger voxels are while views are tried.
const COARSE: f64 = 2.0;
/// How much more of the others' silhouettes must be covered without the view, in the mean [–], and of what is not covered with it: where all views lose something, none of them is to blame.
const GAIN: f64 = 0.015;
const GAIN_SHARE: f64 = 0.3;
/// How much less of its own silhouette than of the others' the hull without it must cover [–].
const OWN: f64 = 0.06;
/// A shift explains a contradiction that leaves no more than this of the mismatch [–].
const EXPLAINED: f64 = 0.6;
/// Views that are tried where the silhouettes fit each other tolerably; below [`BAD`] all are.
const TRIED: usize = 3;
const BAD: f64 = 0.6;
/// Sets for which a finding, or none, holds.
const HOLDS: u32 = 8;
/// What a finding weighs in searches that do not find it again, and the most that several do: a camera that is a little off shows in some poses only, and a hull with it now and then has errors that come and go.
const FINDING: u32 = 2;
const MOST_FINDINGS: u32 = 6;

impl Hull {
    /// The hull, without views that contradict the others.
    pub(super) fn leave_out_contradicting(
        &mut self,
        views: &[View],
        statuses: &mut [ViewStatus],
    ) -> Result<Option<Found>, String> {
        let n_used = statuses.iter().filter(|it| **it == ViewStatus::Used).count();
        let limit = self.options.min_completeness;
        if n_used < TO_CONTRADICT || limit == 0.0 {
            self.contradictions.clear();
            return self.hull_of(views, statuses, self.grid);
        }
        if self.until_search > 0 {
            self.until_search -= 1;
            self.leave_out_known(views, statuses);
            let found = self.hull_of(views, statuses, self.grid)?;
            let used = used(statuses);
            if self.covered(views, &used, found.as_ref()) >= BAD {
                return Ok(found);
            }
            for (view, status) in views.iter().zip(&mut *statuses) {
                if self.contradictions.iter().any(|it| it.camera == view.silhouette.camera) {
                    *status = ViewStatus::Used;
                }
            }
        }
        self.contradictions.clear();
        let mut found = self.hull_of(views, statuses, self.grid)?;
        let covered = self.covered(views, &used(statuses), found.as_ref());
        if covered < limit {
            std::mem::swap(&mut self.carver, &mut self.trials);
            let is_mirrored = self.fits_mirrored(views, statuses, covered);
            std::mem::swap(&mut self.carver, &mut self.trials);
            // A set is carved whatever became of a question about it.
            self.is_mirrored = is_mirrored.ok();
        }
        while self.contradictions.len() < n_used / ONE_OF
            && self.covered(views, &used(statuses), found.as_ref()) < limit
        {
            std::mem::swap(&mut self.carver, &mut self.trials);
            let found_out = self.search(views, statuses).and_then(|one| match one {
                Some(one) => Ok(vec![one]),
                None if self.contradictions.is_empty() => self.search_pair(views, statuses),
                None => Ok(Vec::new()),
            });
            std::mem::swap(&mut self.carver, &mut self.trials);
            let found_out = found_out?;
            if found_out.is_empty() {
                break;
            }
            for (at, contradiction) in found_out {
                statuses[at] = ViewStatus::Contradicts;
                self.contradictions.push(contradiction);
            }
            found = self.hull_of(views, statuses, self.grid)?;
        }
        if self.remember(views, statuses, n_used / ONE_OF) {
            found = self.hull_of(views, statuses, self.grid)?;
        }
        self.until_search = HOLDS;
        Ok(found)
    }

    /// Leaves out who was found before too, for a while, up to `most` views; whether there are any.
    fn remember(&mut self, views: &[View], statuses: &mut [ViewStatus], most: usize) -> bool {
        self.suspects.retain(|camera, (_, weight)| {
            *weight -= u32::from(self.contradictions.iter().all(|it| it.camera != *camera));
            *weight > 0
        });
        for it in &self.contradictions {
            let (known, weight) = self.suspects.entry(it.camera).or_insert((*it, 0));
            (*known, *weight) = (*it, (*weight + FINDING).min(MOST_FINDINGS));
        }
        let n_found = self.contradictions.len();
        for (view, status) in views.iter().zip(statuses).filter(|it| *it.1 == ViewStatus::Used) {
            if let Some((suspect, _)) = self.suspects.get(&view.silhouette.camera)
                && self.contradictions.len() < most
            {
                *status = ViewStatus::Contradicts;
                self.contradictions.push(*suspect);
            }
        }
        self.contradictions.len() > n_found
    }

    fn leave_out_known(&self, views: &[View], statuses: &mut [ViewStatus]) {
        for (view, status) in views.iter().zip(statuses) {
            let is_known = self.contradictions.iter().any(|it| it.camera == view.silhouette.camera);
            if is_known && *status == ViewStatus::Used {
                *status = ViewStatus::Contradicts;
            }
        }
    }

    /// The view without which the others are covered best, if it contradicts them.
    fn search(&mut self, views: &[View], statuses: &[ViewStatus]) -> Result<Option<(usize, Contradiction)>, String> {
        let coarse = self.coarse();
        let used = used(statuses);
        let with_all = self.hull_of(views, statuses, coarse)?;
        let before: Vec<f64> = used.iter().map(|at| self.covered_of(&views[*at], with_all.as_ref())).collect();
        let mean = before.iter().sum::<f64>() / before.len() as f64;
        let mut order: Vec<usize> = (0..used.len()).collect();
        order.sort_by(|a, b| before[*a].total_cmp(&before[*b]));
        order.truncate(if mean < BAD { used.len() } else { TRIED });
        let mut best: Option<(f64, usize, Found)> = None;
        for tried in order {
            let mut fewer = statuses.to_vec();
            fewer[used[tried]] = ViewStatus::Contradicts;
            let Some(found) = self.hull_of(views, &fewer, coarse)? else { continue };
            let others = (0..used.len()).filter(|it| *it != tried);
            let gains: f64 = others.map(|it| self.covered_of(&views[used[it]], Some(&found)) - before[it]).sum();
            let gain = gains / (used.len() - 1) as f64;
            if gain >= GAIN.max(GAIN_SHARE * (1.0 - mean)) && best.as_ref().is_none_or(|it| gain > it.0) {
                best = Some((gain, used[tried], found));
            }
        }
        let Some((_, at, found)) = best else { return Ok(None) };
        let others: Vec<usize> = used.into_iter().filter(|it| *it != at).collect();
        let of_others = self.covered(views, &others, Some(&found));
        let is_told = others.len() + 1 >= FEW || of_others >= GOOD;
        Ok(self.diagnose(&views[at], &found, of_others).filter(|_| is_told).map(|it| (at, it)))
    }

    /// The two views without which the others are covered best, where no single one is to blame: both must contradict the others, each of them alone must spoil what is left without both, and no other two may explain nearly as much.
    fn search_pair(&mut self, views: &[View], statuses: &[ViewStatus]) -> Result<Vec<(usize, Contradiction)>, String> {
        let used = used(statuses);
        if !PAIR_OF.contains(&used.len()) {
            return Ok(Vec::new());
        }
        let coarse = self.coarse();
        let with_all = self.hull_of(views, statuses, coarse)?;
        let before: Vec<f64> = used.iter().map(|at| self.covered_of(&views[*at], with_all.as_ref())).collect();
        let mean = before.iter().sum::<f64>() / before.len() as f64;
        let mut gains: Vec<(f64, [usize; 2])> = Vec::new();
        let mut best: Option<Found> = None;
        for first in 0..used.len() {
            for second in first + 1..used.len() {
                let pair = [first, second];
                let Some(found) = self.hull_of(views, &without(statuses, pair.map(|it| used[it])), coarse)? else {
                    continue;
                };
                let others = (0..used.len()).filter(|it| !pair.contains(it));
                let gain: f64 = others.map(|it| self.covered_of(&views[used[it]], Some(&found)) - before[it]).sum();
                let gain = gain / (used.len() - 2) as f64;
                if gains.iter().all(|it| it.0 < gain) {
                    best = Some(found);
                }
                gains.push((gain, pair));
            }
        }
        gains.sort_by(|a, b| b.0.total_cmp(&a.0));
        let (Some(found), [(gain, pair), (next, _), ..]) = (best, &gains[..]) else { return Ok(Vec::new()) };
        if *gain < GAIN.max(GAIN_SHARE * (1.0 - mean)) || gain - next < GAIN {
            return Ok(Vec::new());
        }
        let pair = pair.map(|it| used[it]);
        let others: Vec<usize> = used.into_iter().filter(|it| !pair.contains(it)).collect();
        let of_others = self.covered(views, &others, Some(&found));
        let mut blamed = Vec::new();
        for at in pair {
            let with_it = self.hull_of(views, &without(statuses, [pair[0] + pair[1] - at; 2]), coarse)?;
            let spoils = of_others - self.covered(views, &others, with_it.as_ref()) >= GAIN;
            blamed.extend(self.diagnose(&views[at], &found, of_others).filter(|_| spoils).map(|it| (at, it)));
        }
        Ok(if blamed.len() == pair.len() && of_others >= GOOD { blamed } else { Vec::new() })
    }

    /// Cells of this size while views are tried.
    pub(super) fn coarse(&self) -> VoxelGrid {
        let cells = self.grid.cells.map(|it| (f64::from(it) / COARSE).ceil() as u32);
        VoxelGrid { size: COARSE * self.grid.size, cells, ..self.grid }
    }

    /// Whether a view contradicts the hull of others, who are covered by it to `of_others`: its own silhouette is not, or would be elsewhere.
    fn diagnose(&mut self, view: &View, found: &Found, of_others: f64) -> Option<Contradiction> {
        let own = self.covered_of(view, Some(found));
        // `drawn` is the hull of the others in its picture.
        let camera = view.silhouette.camera;
        let view = silhouette_view(view);
        let body: Vec<bool> = view.confidence.iter().map(|it| *it >= Silhouette::BODY).collect();
        let fit = fit(&body, &self.drawn, view.width as usize).filter(|it| it.left_over <= EXPLAINED);
        (own <= of_others - OWN || fit.is_some()).then(|| Contradiction {
            camera,
            fit,
            apart: apart(&view, found, fit),
        })
    }

    /// Mean part of the silhouettes that a hull covers.
    pub(super) fn covered(&mut self, views: &[View], of: &[usize], found: Option<&Found>) -> f64 {
        let sum: f64 = of.iter().map(|at| self.covered_of(&views[*at], found)).sum();
        sum / of.len().max(1) as f64
    }

    fn covered_of(&mut self, view: &View, found: Option<&Found>) -> f64 {
        found.map_or(0.0, |it| cover(&it.grid, &it.surface, &silhouette_view(view), &mut self.drawn).completeness())
    }
}

/// As if these contradicted the others.
fn without(statuses: &[ViewStatus], pair: [usize; 2]) -> Vec<ViewStatus> {
    let mut fewer = statuses.to_vec();
    pair.into_iter().for_each(|it| fewer[it] = ViewStatus::Contradicts);
    fewer
}

pub(super) fn used(statuses: &[ViewStatus]) -> Vec<usize> {
    (0..statuses.len()).filter(|it| statuses[*it] == ViewStatus::Used).collect()
}

/// What a shift is at the distance of the middle of the hull, and as an angle.
fn apart(view: &SilhouetteView, found: &Found, fit: Option<Fit>) -> [f64; 2] {
    let Some(fit) = fit else { return [0.0; 2] };
    let [x, y] = fit.shift.map(f64::from);
    let angle = x.hypot(y) * f64::from(view.shrink.max(1)) / view.camera.intrinsics.focal[0];
    let middle = found.grid.origin + nalgebra::Vector3::from(found.grid.cells.map(f64::from)) * (0.5 * found.grid.size);
    [angle * (view.camera.camera_from_world * middle).z, angle.atan()]
}
