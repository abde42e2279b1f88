//! Samples of arbitrary times on one regular time base.
//!
//! Tick k lies at start + k / rate. Between two samples that are at most `gap` apart, a tick at the share w of the way gets
//!
//! | here | formula | unit |
//! |---|---|---|
//! | position | (1 − w) p₀ + w p₁ | m |
//! | covariance | (1 − w) P₀ + w P₁: no less than that of the position for any correlation of the two errors | m² |
//! | cameras | those of both | – |
//! | provenance | filled where one of them is filled, measured otherwise | – |
//!
//! A tick on a sample gets that sample; all others are empty. Samples predicted by a motion model are not data and fill no tick. Between two samples that are
//! data, however, the path runs through the predicted positions, so that all files agree on the position at a time.

use std::collections::{BTreeMap, VecDeque};

use foveate::prelude::*;
use nalgebra::{Isometry3, Matrix3, Point3, Translation3};

/// A sample this near to a tick lies on it.
pub(crate) const ON_TICK: Interval = Interval(1_000);

/// A regular clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TimeBase {
    /// Of tick 0.
    pub(crate) start: Time,
    pub(crate) rate_hz: f64,
}

impl TimeBase {
    pub(crate) fn at(&self, tick: i64) -> Time {
        self.start + Interval::from_s(tick as f64 / self.rate_hz)
    }

    /// The first tick that is not before `time`, but for [`ON_TICK`].
    pub(crate) fn first_from(&self, time: Time) -> i64 {
        let since = (time - ON_TICK - self.start).as_s();
        let mut tick = (since * self.rate_hz).floor() as i64;
        while self.at(tick) < time - ON_TICK {
            tick += 1;
        }
        tick
    }
}

/// Values that can be interpolated between two samples.
pub(crate) trait Between: Clone {
    /// The value at `share` of the way from `self` to `other`, 0 to 1.
    fn between(&self, other: &Self, share: f64) -> Self;

    /// This position between two data, with all other values interpolated from the two.
    fn on_the_way(self, _before: &Self, _after: &Self) -> Self {
        self
    }
}

/// A point at one time: small, because all samples of a run are kept.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Sample {
    /// [m]
    pub(crate) position: Point3<f64>,
    /// Upper triangle of the covariance of the position, by rows [m²].
    pub(crate) covariance: [f32; 6],
    /// Measured or filled.
    pub(crate) is_filled: bool,
    pub(crate) cameras: CameraSet,
}

/// Row and column of what [`Sample::covariance`] holds.
pub(crate) const TRIANGLE: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

impl Sample {
    /// `None`: not a number.
    pub(crate) fn new(
        position: Point3<f64>,
        covariance: &Matrix3<f64>,
        provenance: Provenance,
        cameras: &CameraSet,
    ) -> Option<Self> {
        position.iter().all(|it| it.is_finite()).then(|| Self {
            position,
            covariance: TRIANGLE.map(|it| covariance[it] as f32),
            is_filled: provenance == Provenance::Filled,
            cameras: cameras.clone(),
        })
    }

    /// Standard deviation of the position: the root of the mean variance over the three axes [m].
    pub(crate) fn sigma(&self) -> f64 {
        let [xx, _, _, yy, _, zz] = self.covariance.map(f64::from);
        ((xx + yy + zz) / 3.0).max(0.0).sqrt()
    }
}

impl Between for Sample {
    fn between(&self, other: &Self, share: f64) -> Self {
        let mut covariance = self.covariance;
        for (to, it) in covariance.iter_mut().zip(other.covariance) {
            *to = (f64::from(*to) * (1.0 - share) + f64::from(it) * share) as f32;
        }
        let position = self.position + (other.position - self.position) * share;
        Self { position, covariance, is_filled: self.is_filled || other.is_filled, cameras: CameraSet::default() }
    }

    fn on_the_way(mut self, before: &Self, after: &Self) -> Self {
        self.is_filled = before.is_filled || after.is_filled;
        self.cameras = before.cameras.clone();
        after.cameras.iter().for_each(|it| self.cameras.insert(it));
        self
    }
}

impl Between for Isometry3<f64> {
    fn between(&self, other: &Self, share: f64) -> Self {
        let arc = self.rotation.rotation_to(&other.rotation).scaled_axis();
        let rotation = nalgebra::UnitQuaternion::from_scaled_axis(arc * share) * self.rotation;
        let translation = self.translation.vector.lerp(&other.translation.vector, share);
        Isometry3::from_parts(Translation3::from(translation), rotation)
    }
}

/// Tick and value, ascending.
pub(crate) type Ticks<T> = Vec<(i64, T)>;

/// State of one object on the time base.
#[derive(Debug, Clone)]
pub(crate) struct Track<T> {
    /// The last datum.
    last: Option<(Time, T)>,
    /// Predicted samples since then.
    since: Vec<(Time, T)>,
    ticks: VecDeque<(i64, T)>,
}

impl<T> Default for Track<T> {
    fn default() -> Self {
        Self { last: None, since: Vec::new(), ticks: VecDeque::new() }
    }
}

impl<T: Between> Track<T> {
    /// Takes a sample that is data; of several of one time the last one counts. `false`: it is older than the sample before it, and left out.
    fn push(&mut self, base: &TimeBase, gap: Interval, time: Time, value: T) -> bool {
        match self.last.take() {
            Some((before, last)) if time < before => {
                self.last = Some((before, last));
                return false;
            }
            Some((before, last)) if time > before => {
                if time - before <= gap {
                    self.fill(base, (before, &last), (time, &value));
                } else {
                    self.close(base, before, last);
                }
            }
            _ => {}
        }
        self.since.clear();
        self.last = Some((time, value));
        true
    }

    /// Takes a position that a motion model predicted.
    fn push_predicted(&mut self, gap: Interval, time: Time, value: T) {
        let Some((before, _)) = self.last else { return };
        let newest = self.since.last().map_or(before, |it| it.0);
        if time == newest && newest > before {
            self.since.pop();
        } else if time <= newest || time - before > gap {
            return;
        }
        self.since.push((time, value));
    }

    /// The ticks from one datum to the next, without those on the latter.
    fn fill(&mut self, base: &TimeBase, first: (Time, &T), last: (Time, &T)) {
        let since = std::mem::take(&mut self.since);
        let n_before = since.partition_point(|it| it.0 < last.0);
        let mut tick = base.first_from(first.0);
        while base.at(tick) < last.0 - ON_TICK {
            let at = base.at(tick);
            let next = since[..n_before].partition_point(|it| it.0 <= at + ON_TICK);
            let from = next.checked_sub(1).map_or(first, |it| (since[it].0, &since[it].1));
            let to = since[..n_before].get(next).map_or(last, |it| (it.0, &it.1));
            let place = match at - from.0 {
                passed if passed > ON_TICK => from.1.between(to.1, passed.as_s() / (to.0 - from.0).as_s()),
                _ => from.1.clone(),
            };
            let is_datum = next == 0 && at - from.0 <= ON_TICK;
            self.give(tick, if is_datum { place } else { place.on_the_way(first.1, last.1) });
            tick += 1;
        }
        self.since = since;
    }

    /// Ends with a sample that has no successor.
    fn close(&mut self, base: &TimeBase, time: Time, last: T) {
        let tick = base.first_from(time);
        if base.at(tick) - time <= ON_TICK {
            self.give(tick, last);
        }
    }

    fn give(&mut self, tick: i64, value: T) {
        // Samples within a microsecond of each other may both lie on a tick.
        if self.ticks.back().is_none_or(|it| it.0 < tick) {
            self.ticks.push_back((tick, value));
        }
    }
}

/// Times that the period is found from, where no rate is given.
const TIMES_FOR_RATE: usize = 32;
/// Most samples that wait for the rate.
const MOST_WAITING: usize = 1 << 20;
/// Longest time that they wait.
const LONGEST_WAIT: Interval = Interval(60_000_000_000);
/// The rate where it cannot be inferred [Hz].
pub(crate) const DEFAULT_RATE_HZ: f64 = 60.0;

/// Objects of any kind on one time base, whose rate may be inferred from the times of one of them.
#[derive(Debug, Clone)]
pub(crate) struct Tracks<K, T> {
    gap: Interval,
    all: BTreeMap<K, Track<T>>,
    late: u64,
    /// Ticks before it have been taken.
    next: i64,
}

impl<K: Ord + Copy, T: Between> Tracks<K, T> {
    pub(crate) fn new(gap: Interval) -> Self {
        Self { gap, all: BTreeMap::new(), late: 0, next: i64::MIN }
    }

    pub(crate) fn push(&mut self, base: &TimeBase, key: K, time: Time, value: T) {
        let is_taken = self.all.entry(key).or_default().push(base, self.gap, time, value);
        self.late += u64::from(!is_taken);
    }

    /// Takes a position that a motion model predicted.
    pub(crate) fn push_predicted(&mut self, key: K, time: Time, value: T) {
        if let Some(track) = self.all.get_mut(&key) {
            track.push_predicted(self.gap, time, value);
        }
    }

    /// How many samples came too late.
    pub(crate) fn late(&self) -> u64 {
        self.late
    }

    /// Largest gap between two samples.
    pub(crate) fn gap(&self) -> Interval {
        self.gap
    }

    /// The first tick that something lies on, of those that were not taken.
    pub(crate) fn first_tick(&mut self) -> Option<i64> {
        let Self { all, next, late, .. } = self;
        for track in all.values_mut() {
            while track.ticks.front().is_some_and(|it| it.0 < *next) {
                track.ticks.pop_front();
                *late += 1;
            }
        }
        all.values().filter_map(|it| it.ticks.front()).map(|it| it.0).min()
    }

    /// Takes the values on a tick, ascending by key; all earlier ones are dropped.
    pub(crate) fn take_tick(&mut self, tick: i64, mut give: impl FnMut(K, T)) {
        for (key, track) in &mut self.all {
            if track.ticks.front().is_some_and(|it| it.0 == tick)
                && let Some((_, value)) = track.ticks.pop_front()
            {
                give(*key, value);
            }
        }
        self.next = self.next.max(tick + 1);
    }

    /// Ends objects that cannot be continued within the gap, given that all samples up to `time` have come, and drops them once their ticks are taken.
    pub(crate) fn forget(&mut self, base: &TimeBase, time: Time) {
        let gap = self.gap;
        self.all.retain(|_, track| {
            if let Some((at, last)) = track.last.take_if(|it| time - it.0 >= gap) {
                track.since.clear();
                track.close(base, at, last);
            }
            track.last.is_some() || !track.ticks.is_empty()
        });
    }

    /// No sample comes any more.
    pub(crate) fn close(&mut self, base: &TimeBase) {
        for track in self.all.values_mut() {
            if let Some((time, last)) = track.last.take() {
                track.close(base, time, last);
            }
        }
    }

    /// All of them, ascending by key; those without a single tick are left out.
    pub(crate) fn finish(mut self, base: &TimeBase) -> Vec<(K, Ticks<T>)> {
        self.close(base);
        let whole = self.all.into_iter().map(|(key, track)| (key, Ticks::from(track.ticks)));
        whole.filter(|it| !it.1.is_empty()).collect()
    }
}

/// Finds the time base, and holds items until it is known.
#[derive(Debug, Clone)]
pub(crate) struct Settling<I> {
    base: Option<TimeBase>,
    times: Vec<Time>,
    waiting: Vec<I>,
    /// Time of the first waiting item.
    since: Option<Time>,
}

impl<I> Settling<I> {
    /// At `rate_hz`; where it is 0, at the rate of the observed times, if `observes` is set.
    pub(crate) fn new(rate_hz: f64, observes: bool) -> Self {
        let rate_hz = if rate_hz > 0.0 || observes { rate_hz } else { DEFAULT_RATE_HZ };
        let base = (rate_hz > 0.0).then_some(TimeBase { start: Time::ZERO, rate_hz });
        Self { base, times: Vec::new(), waiting: Vec::new(), since: None }
    }

    /// Observes a time for the rate.
    pub(crate) fn observe(&mut self, time: Time) {
        if self.base.is_none() && self.times.last().is_none_or(|it| *it < time) {
            self.times.push(time);
            if self.times.len() >= TIMES_FOR_RATE {
                self.settle();
            }
        }
    }

    /// The base, once it is known.
    pub(crate) fn base(&self) -> Option<TimeBase> {
        self.base
    }

    /// Holds `item` of a time until the base is known.
    pub(crate) fn hold(&mut self, time: Time, item: I) {
        let since = *self.since.get_or_insert(time);
        self.waiting.push(item);
        if self.waiting.len() >= MOST_WAITING || time - since >= LONGEST_WAIT {
            self.settle();
        }
    }

    /// The held items.
    pub(crate) fn release(&mut self) -> Vec<I> {
        std::mem::take(&mut self.waiting)
    }

    /// From the observed times: the median period, to a thousandth of a hertz.
    pub(crate) fn settle(&mut self) -> TimeBase {
        *self.base.get_or_insert_with(|| {
            let mut periods: Vec<Interval> = self.times.windows(2).map(|it| it[1] - it[0]).collect();
            periods.sort_unstable();
            match periods.get(periods.len() / 2) {
                Some(period) => {
                    let rate_hz = ((1e3 / period.as_s()).round() / 1e3).clamp(0.001, 100_000.0);
                    TimeBase { start: self.times[0], rate_hz }
                }
                None => TimeBase { start: Time::ZERO, rate_hz: DEFAULT_RATE_HZ },
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn ms(milliseconds: f64) -> Time {
        Time::ZERO + Interval::from_ms(milliseconds)
    }

    fn sample(x: f64, provenance: Provenance) -> Option<Sample> {
        let cameras = [CameraId(x as u16)].into_iter().collect();
        Sample::new(Point3::new(x, 0.0, 0.0), &(Matrix3::identity() * x), provenance, &cameras)
    }

    /// Ticks at 100 Hz of samples that lie at x = time in ms: tick, x, filled or not.
    fn ticks(samples: &[(f64, Provenance)]) -> Vec<(i64, f64, bool)> {
        let base = TimeBase { start: Time::ZERO, rate_hz: 100.0 };
        let mut tracks = Tracks::new(Interval::from_ms(25.0));
        for &(time, provenance) in samples {
            match provenance {
                Provenance::Predicted => tracks.push_predicted(0, ms(time), sample(time, provenance).unwrap()),
                _ => tracks.push(&base, 0, ms(time), sample(time, provenance).unwrap()),
            }
        }
        let all = tracks.finish(&base);
        let ticks = all.into_iter().flat_map(|it| it.1);
        ticks.map(|(tick, it)| (tick, (it.position.x * 1e3).round() / 1e3, it.is_filled)).collect()
    }

    #[test]
    fn ticks_between_near_samples_are_interpolated_and_others_missing() {
        use Provenance::{Filled, Measured, Predicted};
        assert_eq!(ticks(&[(5.0, Measured), (25.0, Measured)]), [(1, 10.0, false), (2, 20.0, false)]);
        assert_eq!(ticks(&[(5.0, Measured), (31.0, Measured)]), [], "26 ms apart");
        assert_eq!(ticks(&[(5.0, Measured), (15.0, Predicted), (31.0, Measured)]), [], "a prediction is no sample");
        assert_eq!(ticks(&[(10.0, Measured), (40.0, Measured)]), [(1, 10.0, false), (4, 40.0, false)]);
        let mixed = ticks(&[(10.0, Measured), (20.0, Filled), (30.0, Measured), (40.0, Measured)]);
        assert_eq!(mixed, [(1, 10.0, false), (2, 20.0, true), (3, 30.0, false), (4, 40.0, false)]);
        let between = ticks(&[(15.0, Filled), (25.0, Measured), (35.0, Measured)]);
        assert_eq!(between, [(2, 20.0, true), (3, 30.0, false)]);
    }

    #[test]
    fn late_samples_are_counted_and_the_last_of_a_time_counts() {
        let base = TimeBase { start: Time::ZERO, rate_hz: 100.0 };
        let mut tracks = Tracks::new(Interval::from_ms(25.0));
        for (time, x) in [(10.0, 1.0), (10.0, 2.0), (20.0, 3.0), (15.0, 9.0)] {
            tracks.push(&base, 7, ms(time), sample(x, Provenance::Measured).unwrap());
        }
        let late = tracks.late();
        let all = tracks.finish(&base);
        assert_eq!((all[0].1[0].1.position.x, all[0].1[1].1.position.x, late), (2.0, 3.0, 1));
    }

    #[test]
    fn way_between_data_leads_through_what_was_predicted() {
        let base = TimeBase { start: Time::ZERO, rate_hz: 100.0 };
        let mut tracks = Tracks::new(Interval::from_ms(50.0));
        let at = |x: f64| sample(x, Provenance::Measured).unwrap();
        tracks.push_predicted(0, ms(1.0), at(90.0));
        tracks.push(&base, 0, ms(5.0), at(1.0));
        // On a tick, between ticks, twice at one time, and beyond the datum that follows.
        for (time, x) in [(10.0, 2.0), (18.0, 40.0), (18.0, 4.0), (17.0, 50.0), (60.0, 60.0)] {
            tracks.push_predicted(0, ms(time), at(x));
        }
        tracks.push(&base, 0, ms(28.0), at(14.0));
        tracks.push_predicted(0, ms(30.0), at(70.0));
        let all = tracks.finish(&base);
        let found: Vec<(i64, f64)> = all[0].1.iter().map(|it| (it.0, it.1.position.x)).collect();
        assert_eq!(found, [(1, 2.0), (2, 6.0)], "30 ms is predicted only");
        let cameras = [1, 14].map(CameraId).into_iter().collect();
        assert!(all[0].1.iter().all(|it| it.1.cameras == cameras && !it.1.is_filled), "{all:?}");
    }

    #[test]
    fn ticks_are_taken_in_order_and_late_ones_counted() {
        let base = TimeBase { start: Time::ZERO, rate_hz: 100.0 };
        let mut tracks = Tracks::new(Interval::from_ms(25.0));
        let at = |x: f64| sample(x, Provenance::Measured).unwrap();
        [10.0, 20.0, 30.0].into_iter().for_each(|it| tracks.push(&base, 0, ms(it), at(it)));
        assert_eq!(tracks.first_tick(), Some(1));
        let mut taken = Vec::new();
        tracks.take_tick(1, |key, it| taken.push((key, it.position.x)));
        [10.0, 20.0].into_iter().for_each(|it| tracks.push(&base, 7, ms(it), at(it)));
        tracks.forget(&base, ms(46.0));
        assert_eq!((tracks.first_tick(), tracks.late()), (Some(2), 1), "the tick of 7 at 10 ms");
        [2, 3].into_iter().for_each(|tick| tracks.take_tick(tick, |key, it| taken.push((key, it.position.x))));
        assert_eq!(taken, [(0, 10.0), (0, 20.0), (7, 20.0)]);
        tracks.forget(&base, ms(60.0));
        assert_eq!((tracks.first_tick(), tracks.late()), (None, 2), "tick 3 was taken before 30 ms was given up");
        tracks.forget(&base, ms(61.0));
        assert!(tracks.all.is_empty());
    }

    proptest! {
        #[test]
        fn interpolation_stays_between_and_its_variance_is_enough(
            from in -5.0..5.0, to in -5.0..5.0, share in 0.0..1.0, [p, q] in [0.0..4.0, 0.0..4.0],
        ) {
            let [a, b] = [(from, p), (to, q)].map(|(x, variance)| {
                let covariance = Matrix3::identity() * variance;
                Sample::new(Point3::new(x, 0.0, 0.0), &covariance, Provenance::Measured, &CameraSet::default()).unwrap()
            });
            let it = a.between(&b, share);
            prop_assert!((it.position.x - (from + (to - from) * share)).abs() < 1e-12);
            // The largest variance that the sum can have: errors that go together entirely.
            let most = ((1.0 - share) * f64::sqrt(p) + share * f64::sqrt(q)).powi(2);
            prop_assert!(f64::from(it.covariance[0]) >= most - 1e-5);
        }
    }

    #[test]
    fn rate_is_that_of_what_is_heard() {
        let mut settling = Settling::<()>::new(0.0, true);
        (0..TIMES_FOR_RATE as i64).for_each(|it| settling.observe(Time(5_000_000 + it * 33_366_667 + it % 3 * 1000)));
        let base = settling.base().unwrap();
        assert!((base.rate_hz - 29.97).abs() < 0.002, "{base:?}");
        assert_eq!(base.start, Time(5_000_000));
        assert_eq!(Settling::<()>::new(0.0, false).base().unwrap().rate_hz, DEFAULT_RATE_HZ);
        assert_eq!(Settling::<()>::new(25.0, true).base().unwrap().rate_hz, 25.0);
        let mut silent = Settling::<()>::new(0.0, true);
        silent.observe(Time(3));
        assert_eq!(silent.settle(), TimeBase { start: Time::ZERO, rate_hz: DEFAULT_RATE_HZ });
    }

    #[test]
    fn ticks_before_the_start_are_ticks_too() {
        let base = TimeBase { start: ms(100.0), rate_hz: 100.0 };
        assert_eq!(base.first_from(ms(75.0)), -2);
        assert_eq!(base.first_from(ms(80.0)), -2);
        assert_eq!(base.first_from(Time(80_000_900)), -2, "within a microsecond");
    }
}
