//! The path of each target in bounded memory: when a track grows too long, every second sample is dropped.

use std::collections::BTreeMap;

use foveate::prelude::*;

/// Samples of one track.
const TRACK_LIMIT: usize = 20_000;
/// Samples of all tracks: about 25 MB.
const TOTAL_LIMIT: usize = 400_000;
/// Tracks; the shortest ended one is dropped to make room.
const TRACKS_LIMIT: usize = 512;

/// One kept sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sample {
    pub(crate) time_s: f64,
    /// [m]
    pub(crate) position: [f32; 3],
    /// Standard deviations [m].
    pub(crate) sigma: [f32; 3],
    /// Cameras that observed it since the sample before; bit 127 is set for all cameras from 127 on.
    pub(crate) cameras: u128,
    /// Whether an observation is recent enough.
    pub(crate) measured: bool,
}

/// The samples of one target.
#[derive(Debug, Default)]
pub(crate) struct Track {
    pub(crate) samples: Vec<Sample>,
    /// Every n-th sample is kept.
    stride: u64,
    /// Samples seen, kept or not.
    pub(crate) n_seen: u64,
    /// Cameras of samples that were not kept.
    cameras_since: u128,
    last_measured: Option<Time>,
    last_seen: Time,
}

/// The tracks of all targets.
#[derive(Debug)]
pub(crate) struct History {
    pub(crate) tracks: BTreeMap<TargetId, Track>,
    n_samples: usize,
    /// Tracks that had to make room.
    pub(crate) n_left_out: u64,
    measured_within: Interval,
}

impl History {
    /// A sample counts as measured when an observation of its target is at most `measured_within` old.
    pub(crate) fn new(measured_within: Interval) -> Self {
        Self { tracks: BTreeMap::new(), n_samples: 0, n_left_out: 0, measured_within }
    }

    pub(crate) fn push(&mut self, message: &Targets) {
        for target in &message.list {
            let is_new = !self.tracks.contains_key(&target.id);
            if is_new && self.tracks.len() >= TRACKS_LIMIT {
                self.make_room(message.time);
            }
            let track = self.tracks.entry(target.id).or_default();
            let before = track.samples.len();
            track.push(message.time, target, self.measured_within);
            self.n_samples = self.n_samples + track.samples.len() - before;
            if self.n_samples > TOTAL_LIMIT {
                self.thin_longest();
            }
        }
    }

    fn thin_longest(&mut self) {
        if let Some(longest) = self.tracks.values_mut().max_by_key(|it| it.samples.len()) {
            longest.thin();
        }
        self.n_samples = self.tracks.values().map(|it| it.samples.len()).sum();
    }

    /// Drops the track with the fewest samples, preferably an ended one.
    fn make_room(&mut self, now: Time) {
        let shortest = self.tracks.iter().min_by_key(|(_, it)| (it.last_seen + Interval::from_s(1.0) > now, it.n_seen));
        if let Some(id) = shortest.map(|(id, _)| *id)
            && let Some(track) = self.tracks.remove(&id)
        {
            self.n_samples -= track.samples.len();
            self.n_left_out += 1;
        }
    }

    /// First and last time of all tracks [s]; `None` without samples.
    pub(crate) fn span(&self) -> Option<(f64, f64)> {
        let first = self.tracks.values().filter_map(|it| it.samples.first()).map(|it| it.time_s).reduce(f64::min)?;
        let last = self.tracks.values().filter_map(|it| it.samples.last()).map(|it| it.time_s).reduce(f64::max)?;
        Some((first, last))
    }
}

impl Track {
    fn push(&mut self, time: Time, target: &Target, measured_within: Interval) {
        self.stride = self.stride.max(1);
        self.last_seen = time;
        if target.provenance == Provenance::Measured {
            self.last_measured = Some(time);
        }
        let cameras = target.cameras.iter().fold(0, |bits, camera| bits | (1 << camera.0.min(127)));
        self.cameras_since |= cameras;
        let position = target.position.coords.map(|it| it as f32);
        let is_kept = self.n_seen.is_multiple_of(self.stride) && position.iter().all(|it| it.is_finite());
        self.n_seen += 1;
        if !is_kept {
            return;
        }
        let sigma = [0, 1, 2].map(|axis| target.covariance[(axis, axis)].max(0.0).sqrt() as f32);
        self.samples.push(Sample {
            time_s: time.as_s(),
            position: position.into(),
            sigma,
            cameras: std::mem::take(&mut self.cameras_since),
            measured: self.last_measured.is_some_and(|it| time - it <= measured_within),
        });
        if self.samples.len() > TRACK_LIMIT {
            self.thin();
        }
    }

    /// Keeps every second sample; the cameras of dropped ones are added to the next.
    fn thin(&mut self) {
        self.stride = self.stride.max(1) * 2;
        let kept = self.samples.len().div_ceil(2);
        for index in 0..kept {
            let skipped = if index > 0 { self.samples[2 * index - 1].cameras } else { 0 };
            self.samples[index] = self.samples[2 * index];
            self.samples[index].cameras |= skipped;
        }
        self.samples.truncate(kept);
    }

    /// The usual step between samples of this track [s].
    fn usual_step_s(&self) -> f64 {
        let mut steps: Vec<f64> = self.samples.windows(2).map(|it| it[1].time_s - it[0].time_s).collect();
        if steps.is_empty() {
            return 0.0;
        }
        let middle = steps.len() / 2;
        *steps.select_nth_unstable_by(middle, f64::total_cmp).1
    }

    /// Samples without a hole between them: a hole is a step of more than 0.1 s and four usual ones.
    pub(crate) fn pieces(&self) -> impl Iterator<Item = &[Sample]> {
        let hole_s = (4.0 * self.usual_step_s()).max(0.1);
        self.samples.chunk_by(move |a, b| b.time_s - a.time_s <= hole_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::target_rows::tests::target;

    fn history(n: u32, step_ms: f64, seen: impl Fn(u32) -> bool) -> History {
        let mut history = History::new(Interval::from_ms(20.0));
        for index in 0..n {
            let provenance = if seen(index) { Provenance::Measured } else { Provenance::Predicted };
            let mut target = target(1, [f64::from(index), 0.0, 0.0], provenance);
            if seen(index) {
                target.cameras = [CameraId((index % 5) as u16)].into_iter().collect();
            }
            history.push(&Targets {
                time: Time::ZERO + Interval::from_ms(step_ms * f64::from(index)),
                list: vec![target],
            });
        }
        history
    }

    #[test]
    fn long_track_is_thinned_evenly_and_keeps_all_cameras() {
        let history = history(100_000, 1.0, |_| true);
        let track = &history.tracks[&TargetId(1)];
        assert!((TRACK_LIMIT / 2..=TRACK_LIMIT).contains(&track.samples.len()));
        assert_eq!(track.n_seen, 100_000);
        let steps: Vec<f32> = track.samples.windows(2).map(|it| it[1].position[0] - it[0].position[0]).collect();
        assert!(steps.iter().all(|it| *it == steps[0]), "uneven steps");
        assert!(track.samples[1..].iter().all(|it| it.cameras == 0b11111), "{:b}", track.samples[1].cameras);
        assert_eq!(history.n_samples, track.samples.len());
    }

    #[test]
    fn sample_is_measured_as_long_as_an_observation_is_fresh() {
        let history = history(50, 5.0, |index| index < 10);
        let measured: Vec<bool> = history.tracks[&TargetId(1)].samples.iter().map(|it| it.measured).collect();
        // The last observation is that of 45 ms.
        assert_eq!(measured.iter().filter(|it| **it).count(), 14);
        assert!(measured[13] && !measured[14]);
    }

    #[test]
    fn many_tracks_are_bounded_and_the_long_ones_stay() {
        let mut history = History::new(Interval::from_ms(20.0));
        for index in 0..5000_u32 {
            let list =
                vec![target(0, [0.0; 3], Provenance::Measured), target(index + 1, [1.0; 3], Provenance::Measured)];
            history.push(&Targets { time: Time::ZERO + Interval::from_ms(10.0 * f64::from(index)), list });
        }
        assert!(history.tracks.len() <= TRACKS_LIMIT);
        assert_eq!(history.tracks[&TargetId(0)].n_seen, 5000);
        assert_eq!(history.n_left_out as usize + history.tracks.len(), 5001);
    }

    #[test]
    fn total_is_bounded() {
        let mut history = History::new(Interval::from_ms(20.0));
        for step in 0..3000_u32 {
            let list = (0..300).map(|id| target(id, [0.0; 3], Provenance::Measured)).collect();
            history.push(&Targets { time: Time(i64::from(step) * 1_000_000), list });
        }
        let total: usize = history.tracks.values().map(|it| it.samples.len()).sum();
        assert!(total <= TOTAL_LIMIT && total > TOTAL_LIMIT / 3, "{total}");
        assert_eq!(history.n_samples, total);
    }

    #[test]
    fn holes_part_a_track() {
        let mut history = history(20, 10.0, |_| true);
        let later = Targets { time: Time::from_s(2.0), list: vec![target(1, [0.0; 3], Provenance::Measured)] };
        history.push(&later);
        let pieces: Vec<usize> = history.tracks[&TargetId(1)].pieces().map(<[Sample]>::len).collect();
        assert_eq!(pieces, [20, 1]);
        assert_eq!(history.span(), Some((0.0, 2.0)));
    }
}
