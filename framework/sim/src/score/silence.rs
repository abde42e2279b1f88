//! Times without any message: a tracker without cameras is silent, and each light that it should have found in that time is missed.

use std::sync::Arc;

use foveate_messages::{TargetId, Time};

/// Messages that come farther apart than this, and than so many usual intervals, are a silence [s, –].
const SILENCE_S: f64 = 0.1;
const INTERVALS: f64 = 3.0;

/// What there was to be found, and when something came.
#[derive(Debug, Default)]
pub(super) struct Silence {
    truths: Vec<(Time, Arc<[TargetId]>)>,
    messages: Vec<Time>,
}

/// All silences of a run.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Silences {
    /// From and to [s].
    pub spans: Vec<[f64; 2]>,
    /// The true targets that were there when messages should have come.
    pub moments: Vec<Arc<[TargetId]>>,
}

impl Silence {
    /// The true targets at a time after that of the last call.
    pub fn truth(&mut self, time: Time, targets: Vec<TargetId>) {
        if self.truths.last().is_some_and(|it| it.0 >= time) {
            return;
        }
        let same = self.truths.last().filter(|it| *it.1 == *targets).map(|it| Arc::clone(&it.1));
        self.truths.push((time, same.unwrap_or_else(|| targets.into())));
    }

    /// Something came, of that time.
    pub fn message(&mut self, time: Time) {
        self.messages.push(time);
    }

    /// When nothing came, and who was there; empties what was gathered.
    pub fn finish(&mut self) -> Silences {
        let (truths, mut messages) = (std::mem::take(&mut self.truths), std::mem::take(&mut self.messages));
        messages.sort_unstable();
        messages.dedup();
        let (Some(first), Some(last)) = (truths.first().map(|it| it.0), truths.last().map(|it| it.0)) else {
            return Silences::default();
        };
        let of_messages = usual_interval(messages.iter().copied());
        let Some(usual) = of_messages.or_else(|| usual_interval(truths.iter().map(|it| it.0))) else {
            return Silences::default();
        };
        let least = SILENCE_S.max(INTERVALS * usual);
        // Of cameras that look when they like some messages follow each other at once.
        let near = || messages.windows(2).map(|it| (it[1] - it[0]).as_s()).filter(|it| *it <= least);
        let usual = if of_messages.is_some() { near().sum::<f64>() / near().count() as f64 } else { usual };
        let begin = first.as_s() - usual;
        let ends = messages.iter().map(|it| it.as_s()).chain([last.as_s() + usual]);
        let mut found = Silences::default();
        let mut from = begin;
        for to in ends {
            if to - from > least {
                let n = ((to - from) / usual).round() as usize;
                for it in 1..n {
                    let time = Time::from_s(from + it as f64 * usual);
                    let before = truths.partition_point(|it| it.0 <= time);
                    found.moments.extend(before.checked_sub(1).map(|it| Arc::clone(&truths[it].1)));
                }
                found.spans.push([from.max(first.as_s()), to.min(last.as_s())]);
            }
            from = from.max(to);
        }
        found
    }
}

/// The middle of all intervals [s].
fn usual_interval(times: impl Iterator<Item = Time> + Clone) -> Option<f64> {
    let mut intervals: Vec<f64> = times.clone().zip(times.skip(1)).map(|(a, b)| (b - a).as_s()).collect();
    intervals.sort_by(f64::total_cmp);
    intervals.get(intervals.len() / 2).copied().filter(|it| *it > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth of one target at 60 Hz for 2 s, of a second one from 1 s on; messages at the times that `comes` lets through, every `period_s`.
    fn silences(period_s: f64, comes: impl Fn(f64) -> bool) -> Silences {
        let mut silence = Silence::default();
        for it in 0..=120 {
            let time_s = f64::from(it) / 60.0;
            let ids = if time_s < 0.999 { vec![TargetId(1)] } else { vec![TargetId(1), TargetId(2)] };
            silence.truth(Time::from_s(time_s), ids);
        }
        let times = (0..).map(|it| f64::from(it) * period_s).take_while(|it| *it <= 2.0);
        times.filter(|it| comes(*it)).for_each(|it| silence.message(Time::from_s(it)));
        silence.finish()
    }

    fn n_targets(found: &Silences) -> usize {
        found.moments.iter().map(|it| it.len()).sum()
    }

    #[test]
    fn messages_that_come_are_no_silence_however_seldom() {
        for period_s in [1.0 / 240.0, 1.0 / 60.0, 0.1, 0.3] {
            assert_eq!(silences(period_s, |_| true), Silences::default(), "every {period_s} s");
        }
        // One that is lost now and then.
        assert_eq!(silences(1.0 / 60.0, |it| !((it * 60.0).round() as u32).is_multiple_of(7)), Silences::default());
    }

    #[test]
    fn who_is_there_in_a_silence_counts_as_often_as_messages_should_have_come() {
        for (period_s, of_second) in [(1.0 / 60.0, 60), (1.0 / 30.0, 30)] {
            let late = silences(period_s, |it| it < 1.01);
            assert!(n_targets(&late).abs_diff(2 * of_second) <= 2, "{late:?}");
            assert!(late.spans.len() == 1 && late.spans[0][0] < 1.02 && late.spans[0][1] == 2.0, "{late:?}");
            let early = silences(period_s, |it| it > 0.5);
            assert!(n_targets(&early).abs_diff(of_second / 2) <= 1, "{early:?}");
            let between = silences(period_s, |it| !(0.5..1.5).contains(&it));
            assert!(n_targets(&between).abs_diff(of_second * 3 / 2) <= 2, "{between:?}");
        }
        let never = silences(1.0, |_| false);
        assert_eq!((n_targets(&never), &never.spans[..]), (60 + 2 * 61, &[[0.0, 2.0]][..]));
    }

    #[test]
    fn without_truth_nothing_is_missed() {
        let mut silence = Silence::default();
        silence.message(Time::from_s(1.0));
        silence.message(Time::from_s(3.0));
        assert_eq!(silence.finish(), Silences::default());
    }
}
