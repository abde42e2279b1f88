//! One pointer: its events, from its first observation to the last.

use foveate::prelude::*;
use nalgebra::Point2;

use super::{EventSettings, PressBy};
use crate::smoothing::Smoother;

/// Most points of a stroke that are kept; a longer one is thinned to every second point, repeatedly.
const MOST_POINTS: usize = 4096;

/// A change of a pointer, before its event is sent.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Change {
    pub(super) what: PointerChange,
    pub(super) time: Time,
    pub(super) position: Point2<f64>,
    pub(super) path: Vec<StrokePoint>,
}

/// One pointer.
pub(super) struct One {
    pub(super) id: TargetId,
    /// Its user, once known.
    pub(super) user: Option<u32>,
    smoother: Smoother,
    first_seen: StrokePoint,
    pub(super) last_seen: Time,
    n_seen: u32,
    sigma: f64,
    is_pressed: bool,
    /// Place and start of its rest.
    rest: StrokePoint,
    has_hovered: bool,
    has_dwelt: bool,
    /// Its place at the last move event.
    reported: Point2<f64>,
    /// The stroke that is being drawn, or may become one.
    path: Vec<StrokePoint>,
    /// One of this many points enters the path.
    stride: u32,
}

impl One {
    /// A pointer at its first observation.
    pub(super) fn new(settings: &EventSettings, target: &Target, time: Time, changes: &mut Vec<Change>) -> One {
        let smoother = Smoother::new(&settings.smoothing, target);
        let at = StrokePoint { time, position: smoother.position() };
        let one = One {
            id: target.id,
            user: None,
            smoother,
            last_seen: time,
            n_seen: 1,
            sigma: sigma(target),
            is_pressed: false,
            rest: at.clone(),
            has_hovered: false,
            has_dwelt: false,
            reported: at.position,
            path: vec![at.clone()],
            stride: 1,
            first_seen: at,
        };
        one.say(PointerChange::Appear, time, changes);
        one
    }

    /// It was observed again; `false`, and nothing changed, when that is not after the last time.
    pub(super) fn see(
        &mut self,
        settings: &EventSettings,
        target: &Target,
        time: Time,
        changes: &mut Vec<Change>,
    ) -> bool {
        if !self.smoother.update(target, (time - self.last_seen).as_s()) {
            return false;
        }
        self.last_seen = time;
        self.n_seen = self.n_seen.saturating_add(1);
        self.sigma = sigma(target);
        self.keep_point(time);
        if settings.press == PressBy::Light && !self.is_pressed && self.is_sure(settings) {
            let StrokePoint { time, position } = self.first_seen.clone();
            changes.push(Change { what: PointerChange::Press, time, position, path: Vec::new() });
            self.is_pressed = true;
        }
        let position = self.smoother.position();
        if self.is_pressed && (position - self.reported).norm() >= settings.move_mm * 1e-3 {
            self.reported = position;
            self.say(PointerChange::Move, time, changes);
        }
        self.look_for_rest(settings, time, changes);
        true
    }

    /// Whether it has been visible for long enough to be no flash.
    fn is_sure(&self, settings: &EventSettings) -> bool {
        self.n_seen >= settings.min_seen && self.last_seen - self.first_seen.time >= Interval::from_ms(settings.on_ms)
    }

    fn look_for_rest(&mut self, settings: &EventSettings, time: Time, changes: &mut Vec<Change>) {
        let position = self.smoother.position();
        if (position - self.rest.position).norm() > settings.rest_radius_mm * 1e-3 {
            self.rest = StrokePoint { time, position };
            (self.has_hovered, self.has_dwelt) = (false, false);
            return;
        }
        let rested = time - self.rest.time;
        if !self.has_hovered && self.is_sure(settings) && rested >= Interval::from_ms(settings.hover_ms) {
            self.has_hovered = true;
            self.say(PointerChange::Hover, time, changes);
        }
        if self.has_hovered && !self.has_dwelt && rested >= Interval::from_ms(settings.dwell_ms) {
            self.has_dwelt = true;
            self.say(PointerChange::Dwell, time, changes);
            if settings.press == PressBy::Dwell && !self.is_pressed {
                self.is_pressed = true;
                self.reported = position;
                (self.path, self.stride) = (vec![StrokePoint { time, position }], 1);
                self.say(PointerChange::Press, time, changes);
            }
        }
    }

    /// It is gone: everything that it began ends at its last place.
    pub(super) fn end(mut self, changes: &mut Vec<Change>) {
        let time = self.last_seen;
        if self.is_pressed {
            self.say(PointerChange::Release, time, changes);
            let position = self.smoother.position();
            if self.path.last().is_some_and(|it| it.time < time) {
                self.path.push(StrokePoint { time, position });
            }
            let path = std::mem::take(&mut self.path);
            changes.push(Change { what: PointerChange::Stroke, time, position, path });
        }
        self.say(PointerChange::Vanish, time, changes);
    }

    /// Its state at `time`, predicted to `shown_at`.
    pub(super) fn at(&self, time: Time, shown_at: Time) -> Pointer {
        let is_seen = time == self.last_seen;
        Pointer {
            id: self.id,
            user: self.user,
            position: if is_seen { self.smoother.position() } else { self.smoother.predicted(time - self.last_seen) },
            velocity: self.smoother.velocity(),
            predicted: self.smoother.predicted(shown_at - self.last_seen),
            sigma: self.sigma,
            is_pressed: self.is_pressed,
            is_resting: self.has_hovered,
            is_seen,
        }
    }

    /// Exchanges what the two have drawn since `since`.
    pub(super) fn exchange(&mut self, other: &mut One, since: Time) {
        std::mem::swap(&mut self.smoother, &mut other.smoother);
        std::mem::swap(&mut self.last_seen, &mut other.last_seen);
        std::mem::swap(&mut self.sigma, &mut other.sigma);
        std::mem::swap(&mut self.rest, &mut other.rest);
        std::mem::swap(&mut self.has_hovered, &mut other.has_hovered);
        std::mem::swap(&mut self.has_dwelt, &mut other.has_dwelt);
        std::mem::swap(&mut self.reported, &mut other.reported);
        let after = |path: &mut Vec<StrokePoint>| path.split_off(path.partition_point(|it| it.time <= since));
        let (own, others) = (after(&mut self.path), after(&mut other.path));
        self.path.extend(others);
        other.path.extend(own);
    }

    /// Whether it was ever held down.
    pub(super) fn is_pressed(&self) -> bool {
        self.is_pressed
    }

    fn keep_point(&mut self, time: Time) {
        if !self.n_seen.is_multiple_of(self.stride) {
            return;
        }
        self.path.push(StrokePoint { time, position: self.smoother.position() });
        if self.path.len() > MOST_POINTS {
            let mut n = 0;
            self.path.retain(|_| {
                n += 1;
                n % 2 == 1
            });
            self.stride = self.stride.saturating_mul(2);
        }
    }

    fn say(&self, what: PointerChange, time: Time, changes: &mut Vec<Change>) {
        changes.push(Change { what, time, position: self.smoother.position(), path: Vec::new() });
    }
}

/// Standard deviation of the position on the wall: the root of the mean variance over both axes [m].
fn sigma(target: &Target) -> f64 {
    ((target.covariance[(0, 0)] + target.covariance[(1, 1)]) / 2.0).max(0.0).sqrt()
}
