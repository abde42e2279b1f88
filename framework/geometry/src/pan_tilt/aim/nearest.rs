//! The setting within the limits at which an unreachable target is least off the axis.

use super::{Aim, Obstacle, Search, Unreachable};
use crate::pan_tilt::head::{Limits, Setting};

/// Ratio of the golden section.
const GOLDEN: f64 = 0.618_033_988_749_894_8;
/// Of a quarter turn this many sections leave 1e-7 rad.
const SECTIONS: u32 = 34;
const CYCLES: u32 = 8;
/// A start must end nearer by this to be preferred over one before it [rad].
const PREFERENCE: f64 = 1e-3;

impl Search<'_> {
    /// States why there is no aim, with the nearest setting that is allowed: downhill from `starts`, or from the present setting.
    pub(super) fn unreachable(&self, reason: Obstacle, starts: &[Setting], other: Option<Setting>) -> Unreachable {
        let limits = &self.head.limits;
        let present = [self.from];
        let starts = if starts.is_empty() { &present[..] } else { starts };
        let mut best: Option<(f64, Setting)> = None;
        for start in starts {
            let (off_axis, setting) = self.downhill(limits.clamp(start), limits);
            if best.is_none_or(|it| off_axis < it.0 - PREFERENCE) {
                best = Some((off_axis, setting));
            }
        }
        let setting = best.map_or(limits.clamp(&self.from), |it| it.1);
        let in_camera = self.in_camera(&setting);
        let nearest = Aim {
            setting,
            off_centre_px: self.off_centre_px(&setting),
            distance: in_camera.coords.norm(),
            iterations: CYCLES,
        };
        let is_behind = matches!(reason, Obstacle::OutOfLimits { .. }) && in_camera.z <= 0.0;
        Unreachable { reason: if is_behind { Obstacle::Behind } else { reason }, nearest, other }
    }

    /// Angle between the target and the line of sight [rad].
    fn off_axis(&self, setting: &Setting) -> f64 {
        let seen = self.in_camera(setting).coords;
        self.d.cross(&seen).norm().atan2(self.d.dot(&seen))
    }

    /// One angle after the other, each by golden sections a quarter turn to either side.
    fn downhill(&self, start: Setting, limits: &Limits) -> (f64, Setting) {
        let mut here = start;
        for _ in 0..CYCLES {
            let before = here;
            let at = |pan: f64| Setting { pan, ..before };
            here.pan = least(before.pan, limits.pan, |pan| self.off_axis(&at(pan)));
            let at = |tilt: f64| Setting { tilt, ..here };
            here.tilt = least(before.tilt, limits.tilt, |tilt| self.off_axis(&at(tilt)));
            if (here.pan - before.pan).abs().max((here.tilt - before.tilt).abs()) < 1e-7 {
                break;
            }
        }
        (self.off_axis(&here), here)
    }
}

/// Where `cost` is least within a quarter turn of `from` and within `limits`; `from` itself unless something is less.
fn least(from: f64, limits: [f64; 2], cost: impl Fn(f64) -> f64) -> f64 {
    let quarter = std::f64::consts::FRAC_PI_2;
    let ends = [(from - quarter).max(limits[0]), (from + quarter).min(limits[1])];
    let [mut low, mut high] = ends;
    let inner = |low: f64, high: f64| [high - GOLDEN * (high - low), low + GOLDEN * (high - low)];
    let [mut left, mut right] = inner(low, high);
    let (mut at_left, mut at_right) = (cost(left), cost(right));
    for _ in 0..SECTIONS {
        if at_left <= at_right {
            (high, right, at_right) = (right, left, at_left);
            left = inner(low, high)[0];
            at_left = cost(left);
        } else {
            (low, left, at_left) = (left, right, at_right);
            right = inner(low, high)[1];
            at_right = cost(right);
        }
    }
    let candidates = [ends[0], ends[1], 0.5 * (low + high)];
    let mut best = (cost(from), from);
    for candidate in candidates {
        let there = cost(candidate);
        if there < best.0 {
            best = (there, candidate);
        }
    }
    best.1
}
