//! Regions where acquisition failed: furniture stays in place, and a search for a body in it takes as long as tracking one for ten frames or more.

use nalgebra::Point3;

use super::super::acquire::AcquisitionFailure;
use super::Unmodelled;

/// Voxels whose middle moved by less [m] and whose volume changed by a smaller share [–] are as they were: a person who walks is tried in each second frame at least.
const MOVED: f64 = 0.05;
const CHANGED: f64 = 0.1;
/// Frames between two trials of what stays as it is, at most: silhouettes get better while a background is learnt.
const LONGEST: u64 = 16;

/// Voxels in which acquisition failed, each with the frame from which on it is tried again.
#[derive(Debug, Clone, Default)]
pub(super) struct InVain {
    frame: u64,
    list: Vec<Trial>,
}

#[derive(Debug, Clone)]
struct Trial {
    result: Unmodelled,
    wait: u64,
    next: u64,
    last_met: u64,
}

impl Trial {
    fn is_of(&self, centroid: &Point3<f64>, volume: f64) -> bool {
        (self.result.centroid - centroid).norm() < MOVED && (volume / self.result.volume - 1.0).abs() < CHANGED
    }
}

impl InVain {
    /// Begins another frame. What has not been met for long is forgotten.
    pub(super) fn next_frame(&mut self) {
        self.frame += 1;
        self.list.retain(|it| it.last_met + LONGEST >= self.frame);
    }

    /// Why voxels like these are not tried in this frame; `None`: they are to be tried.
    pub(super) fn holds(&mut self, centroid: &Point3<f64>, volume: f64) -> Option<AcquisitionFailure> {
        let frame = self.frame;
        let known = self.list.iter_mut().find(|it| it.is_of(centroid, volume))?;
        known.last_met = frame;
        (frame < known.next).then(|| known.result.reason.clone())
    }

    /// Keeps what was tried in this frame.
    pub(super) fn keep(&mut self, result: Unmodelled) {
        let frame = self.frame;
        let before = self.list.iter().position(|it| it.is_of(&result.centroid, result.volume));
        let wait = before.map_or(1, |it| (2 * self.list.swap_remove(it).wait).min(LONGEST));
        self.list.push(Trial { result, wait, next: frame + wait, last_met: frame });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_stays_as_it_is_is_tried_ever_more_seldom_and_what_moves_or_grows_at_once() {
        let reason = AcquisitionFailure::Unlike { head: 0.5, limbs: 4.0 };
        let tried = |at: &dyn Fn(u64) -> (f64, f64)| {
            let mut vain = InVain::default();
            let mut frames = Vec::new();
            for frame in 0..60 {
                let (x, volume) = at(frame);
                let centroid = Point3::new(x, 0.0, 0.5);
                if vain.holds(&centroid, volume).is_none() {
                    frames.push(frame);
                    vain.keep(Unmodelled { centroid, volume, reason: reason.clone() });
                }
                vain.next_frame();
            }
            frames
        };
        assert_eq!(tried(&|_| (1.0, 0.06)), [0, 1, 3, 7, 15, 31, 47]);
        // Somebody sits down on it, or moves it.
        assert_eq!(tried(&|it| (1.0, if it < 20 { 0.06 } else { 0.13 }))[5..], [20, 21, 23, 27, 35, 51]);
        assert!(tried(&|it| (1.0 + 0.03 * it as f64, 0.06)).len() >= 30);
    }
}
