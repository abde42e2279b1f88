//! Labels of marks from all cameras together: the guide gives the predicted position of each mark in a picture.
//!
//! The guide is extrapolated to the present picture by marks that are both seen here and in the guide: the median motion of the nearest of them since. Without
//! any, the dominant motion is used. A dot gets a label when it is near the mark's predicted position and neither another dot nor another mark competes.

use foveate::messages::GuidedMark;
use foveate::prelude::Time;
use nalgebra::{Matrix2, Point2, Vector2};

use super::mark_tracker::MarkTracker;
use super::neighbours::Neighbours;

/// Largest distance of marks that extrapolate a position [px of the camera].
const CARRIED_BY_PX: f64 = 200.0;
/// Variance added by extrapolation [px²].
const CARRIED: f64 = 1.0;
/// The dominant motion labels at least this many marks at a time, or none.
const LEAST_AGREED: usize = 4;
/// Within three standard deviations, squared; within one where the guide is less certain than the extrapolation: no camera sees that mark, so none would contradict.
/// Labels by the dominant motion must agree with many others.
const GATE: f64 = 9.0;
const HIDDEN_GATE: f64 = 1.0;

/// Smallest distance of a second candidate where the first is at `near` [px].
pub(super) fn clear_of(near: f64) -> f64 {
    (2.0 * near).max(near + 2.0)
}

/// A mark that should be visible and is not found.
struct Wanted {
    label: u32,
    /// Predicted position, in pixels of the present picture.
    place: Point2<f64>,
    covariance: Matrix2<f64>,
    /// Extrapolated by the dominant motion, without visible marks nearby.
    is_by_whole: bool,
}

impl MarkTracker {
    /// Labels dots with `marks`, whose positions are of `time`; `now` is the time of the present picture of `size`.
    pub(super) fn heed(&mut self, time: Time, marks: &[GuidedMark], now: Time, size: [u32; 2]) {
        for mark in marks.iter().filter(|it| it.disputed) {
            // One that was named after that time is another.
            let is_it = |it: &super::track::Track| it.label == Some(mark.label) && it.named <= time;
            if let Some(at) = self.tracks.iter().position(is_it) {
                self.tally.disputed += 1;
                self.end(at);
            }
        }
        if !self.tracks.iter().any(|it| it.label.is_none() && it.is_seen()) {
            return;
        }
        let whole = self.motion_since(time);
        let wanted: Vec<Wanted> = marks.iter().filter_map(|mark| self.wanted(mark, marks, whole, size)).collect();
        let mut named = Vec::new();
        for (k, one) in wanted.iter().enumerate() {
            let dots = self.tracks.iter().enumerate().filter(|(_, it)| it.label.is_none() && it.is_seen());
            let mut nearest = (f64::INFINITY, 0);
            let mut second = f64::INFINITY;
            for (at, dot) in dots {
                let distance = (dot.pixel - one.place).norm();
                if distance < nearest.0 {
                    second = nearest.0;
                    nearest = (distance, at);
                } else {
                    second = second.min(distance);
                }
            }
            let (near, at) = nearest;
            if near > self.settings.name_px {
                continue;
            }
            let dot = &self.tracks[at];
            let offset = dot.pixel - one.place;
            let covariance = one.covariance + dot.covariance + Matrix2::identity() * CARRIED;
            let is_hidden = !one.is_by_whole && one.covariance.trace() > 2.0 * CARRIED;
            let gate = if is_hidden { HIDDEN_GATE } else { GATE };
            let is_within = covariance.cholesky().is_some_and(|it| it.solve(&offset).dot(&offset) <= gate);
            let others = wanted.iter().enumerate().filter(|it| it.0 != k);
            let other = others.map(|(_, it)| (dot.pixel - it.place).norm()).fold(f64::INFINITY, f64::min);
            if is_within && second.min(other) >= clear_of(near) {
                named.push((at, one.label));
            }
        }
        // The motion of the whole may be that of something else: it has to bring many marks to dots, which chance does not.
        let n_by_whole = wanted.iter().filter(|it| it.is_by_whole).count();
        let n_dots = self.tracks.iter().filter(|it| it.label.is_none() && it.is_seen()).count();
        let is_by_whole = |label: u32| wanted.iter().any(|it| it.label == label && it.is_by_whole);
        let n_agreed = named.iter().filter(|it| is_by_whole(it.1)).count();
        if n_agreed < LEAST_AGREED || 2 * n_agreed < n_by_whole.min(n_dots) {
            named.retain(|it| !is_by_whole(it.1));
        }
        for (at, label) in named {
            (self.tracks[at].label, self.tracks[at].named, self.tracks[at].length) = (Some(label), now, 1);
            self.tally.named += 1;
        }
        // Who waited to be found again under that name has been.
        let mut at = self.tracks.len();
        while at > 0 {
            at -= 1;
            let label = self.tracks[at].label;
            let is_double = !self.tracks[at].is_seen()
                && label.is_some()
                && self.tracks.iter().any(|it| it.is_seen() && it.label == label);
            if is_double {
                self.end(at);
            }
        }
    }

    /// Predicted position of a mark of the guide that is not found here. `None`: it is found, disputed, unpredictable, or outside of the picture.
    fn wanted(
        &self,
        mark: &GuidedMark,
        marks: &[GuidedMark],
        whole: Option<Vector2<f64>>,
        size: [u32; 2],
    ) -> Option<Wanted> {
        let seen = |label: u32| self.tracks.iter().find(|it| it.label == Some(label) && it.is_seen());
        let is_sound = mark.pixel.iter().chain(&mark.covariance).all(|it| it.is_finite());
        if mark.disputed || !is_sound || seen(mark.label).is_some() {
            return None;
        }
        let shared = marks.iter().filter(|it| !it.disputed).filter_map(|it| {
            let track = seen(it.label)?;
            Some((it.pixel, self.window.in_camera(&track.pixel) - it.pixel))
        });
        let by_marks = Neighbours::of(mark.pixel, CARRIED_BY_PX, shared).median();
        let moved = by_marks.or(whole)?;
        let place = self.window.in_image(&(mark.pixel + moved));
        let is_inside = |at: f64, n: u32| at >= 0.0 && at <= f64::from(n) - 1.0;
        let scale = f64::from(self.window.shrink).powi(2);
        (is_inside(place.x, size[0]) && is_inside(place.y, size[1])).then(|| Wanted {
            label: mark.label,
            place,
            covariance: mark.covariance / scale,
            is_by_whole: by_marks.is_none(),
        })
    }

    /// Dominant motion since the picture of `time`, or the next one after it [px of the camera]: pictures of one moment are as far apart as their cameras' clocks, and that
    /// moment is the time of the first of them. `None` where that is not stored any more.
    fn motion_since(&self, time: Time) -> Option<Vector2<f64>> {
        let start = self.past.iter().position(|it| it.0 >= time)?;
        if start == 0 && self.past[0].0 > time {
            return None;
        }
        Some(self.past.iter().skip(start).map(|it| it.1).sum())
    }
}
