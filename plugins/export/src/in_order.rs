//! Messages sorted by time, one per time: of several messages of one time the last one is used.
//!
//! A message waits until one comes that is [`WAIT`] younger, so that late messages can be sorted in; an even later one is passed on at once.

use std::collections::BTreeMap;

use foveate::prelude::*;

/// How much younger the newest message must be than a waiting one. Anchors of scales keep their last 256 poses, a quarter of a second of them at the highest usual
/// rate (1000 Hz): a message that waits no longer still finds its pose.
pub(crate) const WAIT: Interval = Interval(100_000_000);

/// Holds messages until those before them have come.
#[derive(Debug)]
pub(crate) struct InOrder<T> {
    held: BTreeMap<Time, T>,
    newest: Option<Time>,
    /// The last message that was passed on in order.
    reached: Option<Time>,
    late: u64,
}

impl<T> Default for InOrder<T> {
    fn default() -> Self {
        Self { held: BTreeMap::new(), newest: None, reached: None, late: 0 }
    }
}

impl<T> InOrder<T> {
    /// Takes a message in; passes on those whose waiting time is over. One that is too late is passed on at once.
    pub(crate) fn push(&mut self, time: Time, message: T, give: &mut impl FnMut(T)) {
        if self.reached.is_some_and(|it| time <= it) {
            self.late += 1;
            return give(message);
        }
        self.held.insert(time, message);
        let newest = self.newest.map_or(time, |it| it.max(time));
        self.newest = Some(newest);
        while let Some(first) = self.held.first_entry().filter(|it| newest - *it.key() >= WAIT) {
            self.reached = Some(*first.key());
            give(first.remove());
        }
    }

    /// Passes on the remaining messages, at the end.
    pub(crate) fn finish(&mut self, give: &mut impl FnMut(T)) {
        while let Some((time, message)) = self.held.pop_first() {
            self.reached = Some(time);
            give(message);
        }
    }

    /// The time of the last message that was passed on in order.
    pub(crate) fn reached(&self) -> Option<Time> {
        self.reached
    }

    /// Number of messages that came too late.
    pub(crate) fn late(&self) -> u64 {
        self.late
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn order(messages: &[(f64, u32)]) -> (Vec<u32>, u64) {
        let (mut order, mut out) = (InOrder::default(), Vec::new());
        for &(ms, message) in messages {
            order.push(Time::ZERO + Interval::from_ms(ms), message, &mut |it| out.push(it));
        }
        order.finish(&mut |it| out.push(it));
        (out, order.late())
    }

    #[test]
    fn messages_find_their_place_and_the_last_of_a_time_counts() {
        assert_eq!(order(&[(1.0, 1), (1.0, 2), (1.0, 3), (2.0, 4), (1.0, 9), (4.0, 5)]), (vec![9, 4, 5], 0));
        assert_eq!(order(&[(10.0, 1), (30.0, 3), (20.0, 2), (0.0, 0)]), (vec![0, 1, 2, 3], 0));
    }

    #[test]
    fn what_is_too_late_comes_out_at_once() {
        assert_eq!(order(&[(10.0, 1), (109.0, 2), (5.0, 0)]), (vec![0, 1, 2], 0));
        assert_eq!(order(&[(10.0, 1), (110.0, 2), (5.0, 0), (60.0, 3), (10.0, 9)]), (vec![1, 0, 9, 3, 2], 2));
        assert_eq!(order(&[]), (vec![], 0));
    }
}
