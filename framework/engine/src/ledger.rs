//! Measurements on each edge: rate, age at delivery, gaps, drops, late arrivals, quality; and whether its requirement is met.
//!
//! "The interfaces are precisely where the challenge lies" [Davis 2002 §2.3–2.5]: a shortcoming of a rig shows as a
//! shortcoming of the data at one named edge.

use foveate_messages::{Interval, Quality, SourceId, Stamp, Time};

use crate::Gate;
use crate::budget::Ages;
use foveate_rig::graph::Requirement;

/// The quality of every message is sampled at first, then of one in so many.
const QUALITY_STRIDE: u64 = 16;

/// Non-negative durations [ns] in buckets of 1/32 octave: any percentile to 3 %, 5 kB, no allocation after the first.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Histogram {
    counts: Vec<u32>,
    total: u64,
    max: u64,
}

const SUB_BITS: u32 = 5;
const LARGEST: u64 = (1 << 45) - 1;

impl Default for Histogram {
    fn default() -> Self {
        Self { counts: vec![0; bucket(LARGEST) + 1], total: 0, max: 0 }
    }
}

/// The bucket that holds `value`.
fn bucket(value: u64) -> usize {
    if value < (1 << SUB_BITS) {
        return value as usize;
    }
    let exponent = 63 - value.leading_zeros();
    let sub = (value >> (exponent - SUB_BITS)) & ((1 << SUB_BITS) - 1);
    (((exponent - SUB_BITS + 1) << SUB_BITS) as usize) + sub as usize
}

/// The middle of bucket `index`.
fn middle(index: usize) -> u64 {
    let octave = (index >> SUB_BITS) as u32;
    if octave == 0 {
        return index as u64;
    }
    let sub = (index & ((1 << SUB_BITS) - 1)) as u64;
    let width = 1_u64 << (octave - 1);
    ((1 << SUB_BITS) + sub) * width + width / 2
}

impl Histogram {
    /// Counts one value; values above ten hours count as ten hours.
    pub fn record(&mut self, value: u64) {
        self.counts[bucket(value.min(LARGEST))] += 1;
        self.total += 1;
        self.max = self.max.max(value);
    }

    /// Counts all that another one counted.
    pub(crate) fn absorb(&mut self, other: &Histogram) {
        self.counts.iter_mut().zip(&other.counts).for_each(|(own, it)| *own += it);
        self.total += other.total;
        self.max = self.max.max(other.max);
    }

    /// The value that `fraction` of the counted ones do not exceed; `None` when nothing was counted.
    pub fn percentile(&self, fraction: f64) -> Option<u64> {
        let wanted = ((self.total as f64 * fraction).ceil() as u64).clamp(1, self.total.max(1));
        let mut seen = 0;
        let index = self.counts.iter().position(|&count| {
            seen += u64::from(count);
            seen >= wanted
        })?;
        Some(middle(index).min(self.max))
    }

    /// The largest value counted.
    pub fn max(&self) -> Option<u64> {
        (self.total > 0).then_some(self.max)
    }
}

/// What one edge measured so far. `sent = delivered + dropped + suspended + waiting` always holds.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Ledger {
    /// Messages that the consumer took.
    pub delivered: u64,
    /// Messages lost to a full queue, to a stopped consumer, or passed over by a port that takes the newest.
    pub dropped: u64,
    /// Messages that were not given to the consumer while its scale was suspended.
    pub suspended: u64,
    /// Messages that should have been there and never were: numbers left out, and gaps that the producer declared.
    pub gaps: u64,
    /// Messages captured earlier than one of the same source that came before.
    pub late: u64,
    age: Histogram,
    first: Option<Time>,
    last: Time,
    quality: Quality,
    sigma_sum: f64,
    sigma_count: u64,
    sources: Vec<(SourceId, u64, Time)>,
    /// The text of the first panic of a payload while its quality was computed.
    pub(crate) quality_fault: Option<Box<str>>,
    /// Of the scale that the messages come from, and how often it had been turned when it was last looked at.
    gate: Option<Box<(Gate, u64)>>,
    /// Ages for the budgets that end here, if any does.
    ages: Option<Box<Ages>>,
}

impl Ledger {
    /// Of an edge out of a scale with this gate, if that can be suspended.
    pub(crate) fn behind(gate: Option<Gate>) -> Ledger {
        Ledger { gate: gate.map(|it| Box::new((it, 0))), ..Ledger::default() }
    }

    /// Looks at `gate` from now on, if it looks at any.
    pub(crate) fn look_at(&mut self, gate: &Gate) {
        if let Some(own) = &mut self.gate {
            own.0 = gate.clone();
        }
    }

    /// Keeps ages by the node whose stamps they are from now on.
    pub(crate) fn measure(&mut self) {
        self.ages.get_or_insert_default();
    }

    /// Ages for the budgets that end here.
    pub(crate) fn ages(&self) -> Option<&Ages> {
        self.ages.as_deref()
    }

    /// Enters one message that is delivered at session time `now`, as soon as it arrives.
    #[inline]
    pub fn deliver(&mut self, stamp: Stamp, now: Time, quality: impl FnOnce() -> Result<Quality, String>) {
        self.arrive(stamp);
        self.take(stamp, now, quality);
    }

    /// Enters that a message has come to its port, where it may have to wait.
    #[inline]
    pub(crate) fn arrive(&mut self, stamp: Stamp) {
        match self.sources.iter_mut().find(|it| it.0 == stamp.source) {
            Some((_, sequence, time)) => {
                let expected = *sequence + 1;
                self.late += u64::from(stamp.time < *time);
                *sequence = stamp.sequence.max(*sequence);
                *time = stamp.time.max(*time);
                if stamp.sequence > expected {
                    self.miss(stamp.sequence - expected);
                }
            }
            None => self.sources.push((stamp.source, stamp.sequence, stamp.time)),
        }
    }

    /// Counts numbers that were left out, but not those of a scale that was suspended meanwhile: what a suspended node did not pass on
    /// is counted where it was held up, and nowhere else.
    #[cold]
    fn miss(&mut self, count: u64) {
        if let Some((gate, seen)) = self.gate.as_deref_mut() {
            let activations = gate.activations();
            if std::mem::replace(seen, activations) != activations {
                return;
            }
        }
        self.gaps += count;
    }

    /// Enters that the node has taken a message at session time `now`.
    #[inline]
    pub(crate) fn take(&mut self, stamp: Stamp, now: Time, quality: impl FnOnce() -> Result<Quality, String>) {
        self.age.record((now - stamp.time).0.max(0) as u64);
        if let Some(ages) = &mut self.ages {
            ages.record(stamp, now);
        }
        self.first.get_or_insert(now);
        self.last = now;
        if self.delivered < QUALITY_STRIDE || self.delivered.is_multiple_of(QUALITY_STRIDE) {
            self.quality = quality().unwrap_or_else(|said| {
                self.quality_fault.get_or_insert(said.into());
                Quality::default()
            });
            if let Some(sigma) = self.quality.sigma {
                self.sigma_sum += sigma;
                self.sigma_count += 1;
            }
        }
        self.delivered += 1;
    }

    /// Enters that a message has come at session time `now` to a node whose scale is suspended, and is not given to it.
    #[cold]
    pub(crate) fn suspend(&mut self, stamp: Stamp, now: Time) {
        self.arrive(stamp);
        self.first.get_or_insert(now);
        self.last = now;
        self.suspended += 1;
    }

    /// Enters a gap that the producer declared; its number is not counted again when the next message skips it.
    pub fn declare_gap(&mut self, source: SourceId) {
        self.gaps += 1;
        if let Some((_, sequence, _)) = self.sources.iter_mut().find(|it| it.0 == source) {
            *sequence += 1;
        }
    }

    /// Deliveries a second between the first and the last of them [Hz]; `None` before the second one. What came while the scale was
    /// suspended counts as delivered: a promise is about what comes.
    pub fn rate_hz(&self) -> Option<f64> {
        let span = (self.last - self.first?).as_s();
        let count = self.delivered + self.suspended;
        (count > 1 && span > 0.0).then(|| (count - 1) as f64 / span)
    }

    /// Age at delivery that `fraction` of the messages did not exceed [s].
    pub fn age_s(&self, fraction: f64) -> Option<f64> {
        self.age.percentile(fraction).map(|ns| Interval(ns as i64).as_s())
    }

    /// Median, 99th percentile and greatest age at delivery [s].
    pub(crate) fn ages_s(&self) -> Option<[f64; 3]> {
        Some([self.age_s(0.5)?, self.age_s(0.99)?, self.age_max_s()?])
    }

    /// Greatest age at delivery [s].
    pub fn age_max_s(&self) -> Option<f64> {
        self.age.max().map(|ns| Interval(ns as i64).as_s())
    }

    /// Mean of the standard deviations that sampled payloads stated [px or m].
    pub fn sigma(&self) -> Option<f64> {
        (self.sigma_count > 0).then(|| self.sigma_sum / self.sigma_count as f64)
    }

    /// How many things the last sampled payload held.
    pub fn count(&self) -> Option<u32> {
        self.quality.count
    }

    /// Fraction of the messages that did not arrive: gaps and drops over all that should have.
    pub fn loss(&self) -> f64 {
        let lost = self.gaps + self.dropped;
        lost as f64 / (lost + self.delivered).max(1) as f64
    }

    /// The parts of `requirement` that are not met, each as a sentence with both numbers. An edge that delivered
    /// nothing meets no requirement.
    pub fn unmet(&self, requirement: &Requirement) -> Vec<String> {
        if self.delivered == 0 {
            let why = if self.suspended > 0 { ": its scale was suspended" } else { "" };
            return vec![format!("nothing was delivered{why}")];
        }
        let mut unmet = Vec::new();
        if let (Some(limit), Some(age)) = (requirement.age_s, self.age_s(0.99))
            && age > limit
        {
            unmet.push(format!("age at delivery is {:.3} ms (p99), required at most {:.3} ms", age * 1e3, limit * 1e3));
        }
        // A count over a finite time is off by up to one message: a promise of 60 Hz is not broken by that.
        if let (Some(limit), Some(rate)) = (requirement.rate_hz, self.rate_hz())
            && rate * (1.0 + 1.0 / (self.delivered + self.suspended) as f64) < limit
        {
            unmet.push(format!("rate is {rate:.2} Hz, required at least {limit:.2} Hz"));
        }
        if let Some(limit) = requirement.sigma {
            match self.sigma() {
                Some(sigma) if sigma > limit => unmet.push(format!("σ is {sigma:.4}, required at most {limit:.4}")),
                None => unmet.push(format!("no payload stated its σ, required at most {limit:.4}")),
                Some(_) => {}
            }
        }
        if let Some(limit) = requirement.loss
            && self.loss() > limit
        {
            unmet.push(format!(
                "{:.2} % of the messages were lost, required at most {:.2} %",
                self.loss() * 1e2,
                limit * 1e2
            ));
        }
        unmet
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn stamp(sequence: u64, time_ms: i64) -> Stamp {
        Stamp { time: Time(time_ms * 1_000_000), source: SourceId(3), sequence }
    }

    #[track_caller]
    fn ledger_of(deliveries: &[(u64, i64, i64)]) -> Ledger {
        let mut ledger = Ledger::default();
        for &(sequence, captured_ms, delivered_ms) in deliveries {
            ledger.deliver(stamp(sequence, captured_ms), Time(delivered_ms * 1_000_000), || Ok(Quality::default()));
        }
        ledger
    }

    proptest! {
        #[test]
        fn percentile_is_within_three_percent_of_the_sorted_value(
            mut values in prop::collection::vec(0_u64..10_000_000_000, 1..300), fraction in 0.01_f64..1.0,
        ) {
            let mut histogram = Histogram::default();
            values.iter().for_each(|&it| histogram.record(it));
            values.sort_unstable();
            let exact = values[((values.len() as f64 * fraction).ceil() as usize).clamp(1, values.len()) - 1];
            let found = histogram.percentile(fraction).unwrap();
            prop_assert!(found.abs_diff(exact) as f64 <= 0.032 * exact as f64 + 1.0, "{found} for {exact}");
        }

        #[test]
        fn any_duration_can_be_recorded(value in any::<u64>()) {
            let mut histogram = Histogram::default();
            histogram.record(value);
            prop_assert_eq!(histogram.max(), Some(value));
        }
    }

    #[test]
    fn numbers_left_out_are_gaps_and_earlier_captures_are_late() {
        let ledger = ledger_of(&[(0, 0, 5), (1, 10, 15), (4, 40, 45), (3, 30, 46), (5, 50, 55)]);
        assert_eq!((ledger.delivered, ledger.gaps, ledger.late), (5, 2, 1));
    }

    #[test]
    fn declared_gap_is_counted_once() {
        let mut ledger = ledger_of(&[(0, 0, 0)]);
        ledger.declare_gap(SourceId(3));
        ledger.deliver(stamp(2, 20), Time(20_000_000), || Ok(Quality::default()));
        assert_eq!(ledger.gaps, 1);
    }

    #[test]
    fn rate_and_age_are_of_deliveries() {
        let ledger = ledger_of(&[(0, 0, 20), (1, 10, 30), (2, 20, 40)]);
        assert_eq!(ledger.rate_hz(), Some(100.0));
        assert!((ledger.age_s(0.5).unwrap() - 0.020).abs() < 0.001);
        assert_eq!(ledger.age_max_s(), Some(0.020));
    }

    #[test]
    fn broken_promises_name_both_numbers() {
        let ledger = ledger_of(&[(0, 0, 20), (1, 10, 30), (5, 20, 40)]);
        let promise =
            Requirement { age_s: Some(0.005), rate_hz: Some(200.0), loss: Some(0.1), ..Requirement::default() };
        let unmet = ledger.unmet(&promise);
        assert_eq!(unmet.len(), 3, "{unmet:?}");
        assert!(unmet[0].contains("5.000 ms") && unmet[1].contains("200.00 Hz") && unmet[2].contains("10.00 %"));
        assert_eq!(ledger.unmet(&Requirement { rate_hz: Some(100.0), ..Requirement::default() }), Vec::<String>::new());
    }

    #[test]
    fn what_comes_while_suspended_is_neither_lost_nor_a_gap_and_counts_for_the_rate() {
        let mut ledger = Ledger::default();
        ledger.suspend(stamp(0, 0), Time(0));
        assert_eq!(ledger.unmet(&Requirement::default()), ["nothing was delivered: its scale was suspended"]);
        for sequence in 1..5_u64 {
            let (at, now) = (stamp(sequence, sequence as i64 * 10), Time(sequence as i64 * 10_000_000));
            if sequence < 3 { ledger.suspend(at, now) } else { ledger.deliver(at, now, || Ok(Quality::default())) }
        }
        assert_eq!((ledger.delivered, ledger.suspended, ledger.gaps), (2, 3, 0));
        assert_eq!((ledger.rate_hz(), ledger.loss()), (Some(100.0), 0.0));
        let promise = Requirement { rate_hz: Some(100.0), loss: Some(0.01), ..Requirement::default() };
        assert_eq!(ledger.unmet(&promise), Vec::<String>::new());
    }

    #[test]
    fn silent_edge_meets_nothing() {
        assert_eq!(Ledger::default().unmet(&Requirement::default()), ["nothing was delivered"]);
    }
}
