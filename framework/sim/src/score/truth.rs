//! The truth between its samples: cubic Hermite curves through positions and velocities.

use std::collections::VecDeque;
use std::sync::Arc;

use foveate_messages::{Interval, Target, TargetId, Targets, Time};
use nalgebra::Point3;

use super::is_in;

/// How long truth is kept for what is recovered late.
const KEPT: Interval = Interval(2_000_000_000);

/// One true target at some time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Interpolated {
    pub id: TargetId,
    /// [m]
    pub position: Point3<f64>,
    /// Number of the sample before that time, and the target's place in it.
    sample: u64,
    place: usize,
}

struct Sample {
    truth: Arc<Targets>,
    /// By place in the list: matched between this sample and the next one.
    covered: Vec<bool>,
    /// By place in the list: in the volume, and so to be covered.
    counts: Vec<bool>,
}

/// The recent past of the truth.
#[derive(Default)]
pub(super) struct TruthTrack {
    samples: VecDeque<Sample>,
    /// Number of the first sample still kept.
    first: u64,
    n_covered: u64,
    n_samples: u64,
}

impl TruthTrack {
    /// Adds the truth at a later time; an earlier or equal one is ignored. What is outside `volume` [m] need not be covered.
    pub fn push(&mut self, truth: Arc<Targets>, volume: Option<[[f64; 3]; 2]>) {
        if self.samples.back().is_some_and(|it| it.truth.time >= truth.time) {
            return;
        }
        let oldest = truth.time - KEPT;
        let covered = vec![false; truth.list.len()];
        let counts = truth.list.iter().map(|it| is_in(volume, &it.position)).collect();
        self.samples.push_back(Sample { truth, covered, counts });
        while self.samples.len() > 2 && self.samples[1].truth.time < oldest {
            self.drop_first();
        }
    }

    /// Whether `time` is not after the newest sample.
    pub fn reaches(&self, time: Time) -> bool {
        self.samples.back().is_some_and(|it| time <= it.truth.time)
    }

    /// Fills `targets` with the truth at `time`; false when that is before or after what is kept.
    pub fn at(&self, time: Time, targets: &mut Vec<Interpolated>) -> bool {
        targets.clear();
        let after = self.samples.partition_point(|it| it.truth.time <= time);
        let Some(before) = after.checked_sub(1) else { return false };
        let from = &self.samples[before].truth;
        let sample = self.first + before as u64;
        let (to, share, span) = match self.samples.get(after) {
            Some(next) => {
                let span = (next.truth.time - from.time).as_s();
                (&next.truth, (time - from.time).as_s() / span, span)
            }
            None if time == from.time => (from, 0.0, 0.0),
            None => return false,
        };
        for (place, target) in from.list.iter().enumerate() {
            let same_place = to.list.get(place).filter(|it| it.id == target.id);
            if let Some(next) = same_place.or_else(|| to.list.iter().find(|it| it.id == target.id)) {
                let position = hermite(target, next, share, span);
                targets.push(Interpolated { id: target.id, position, sample, place });
            }
        }
        true
    }

    /// Notes that `target` was matched.
    pub fn cover(&mut self, target: &Interpolated) {
        let sample = target.sample.checked_sub(self.first).and_then(|it| self.samples.get_mut(it as usize));
        if let Some(covered) = sample.and_then(|it| it.covered.get_mut(target.place)) {
            *covered = true;
        }
    }

    /// How many samples of single targets were covered, out of how many; the last ones, which nothing follows, are left out.
    pub fn finish(&mut self) -> (u64, u64) {
        while self.samples.len() > 1 {
            self.drop_first();
        }
        (self.n_covered, self.n_samples)
    }

    fn drop_first(&mut self) {
        if let Some(sample) = self.samples.pop_front() {
            self.first += 1;
            for (covered, _) in sample.covered.iter().zip(&sample.counts).filter(|(_, counts)| **counts) {
                self.n_samples += 1;
                self.n_covered += u64::from(*covered);
            }
        }
    }
}

/// Position after `share` (0 to 1) of the `span` [s] between two samples of a target.
fn hermite(from: &Target, to: &Target, share: f64, span: f64) -> Point3<f64> {
    let (s, s2) = (share, share * share);
    let s3 = s2 * s;
    let travel = to.position - from.position;
    from.position
        + travel * (3.0 * s2 - 2.0 * s3)
        + from.velocity * (span * (s3 - 2.0 * s2 + s))
        + to.velocity * (span * (s3 - s2))
}
