//! Where a head looked, for a while back: cameras ask when their picture is delivered, not when it is taken.

use std::collections::VecDeque;

use foveate_messages::Time;

use super::mechanics::TICK;

/// For so long a head knows where it looked [s].
pub const REMEMBERED_S: f64 = 10.0;

const MOST: usize = 10_000;

/// A state at the end of every tick: pan, tilt [rad], zoom [units].
#[derive(Debug, Clone)]
pub(super) struct Track {
    /// Number of the first tick that is remembered.
    first: i64,
    states: VecDeque<[f64; 3]>,
}

impl Default for Track {
    /// A head that has looked straight ahead for ever.
    fn default() -> Self {
        Self { first: 0, states: VecDeque::from([[0.0; 3]]) }
    }
}

impl Track {
    /// The next tick has ended.
    pub fn push(&mut self, state: [f64; 3]) {
        if self.states.len() == MOST {
            self.states.pop_front();
            self.first += 1;
        }
        self.states.push_back(state);
    }

    /// The state at `time`: that of the last tick, extrapolated with the change during it. So it is the same whether or not the tick in
    /// which `time` lies has been lived already.
    pub fn at(&self, time: Time) -> [f64; 3] {
        let last = self.states.len() - 1;
        let tick = time.0.div_euclid(TICK.0);
        let place = usize::try_from(tick - self.first).unwrap_or(0).min(last);
        let share = if tick < self.first { 0.0 } else { time.0.rem_euclid(TICK.0) as f64 / TICK.0 as f64 };
        let (now, before) = (self.states[place], self.states[place.saturating_sub(1)]);
        std::array::from_fn(|it| now[it] + (now[it] - before[it]) * share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_within_a_tick_is_answered_alike_before_and_after_it() {
        let mut track = Track::default();
        (1..=5).for_each(|it| track.push([f64::from(it), 0.0, -f64::from(it)]));
        let time = Time(5 * TICK.0 + TICK.0 / 4);
        assert_eq!(track.at(time), [5.25, 0.0, -5.25]);
        track.push([9.0, 0.0, 0.0]);
        assert_eq!(track.at(time), [5.25, 0.0, -5.25]);
        assert_eq!(track.at(Time(3 * TICK.0)), [3.0, 0.0, -3.0]);
    }

    #[test]
    fn what_is_long_ago_is_as_it_was_when_memory_begins() {
        let mut track = Track::default();
        (1..=MOST as i64 + 10).for_each(|it| track.push([it as f64, 0.0, 0.0]));
        assert_eq!(track.states.len(), MOST);
        assert_eq!(track.at(Time(-1))[0], 11.0);
        assert_eq!(track.at(Time(12 * TICK.0))[0], 12.0);
        assert_eq!(track.at(Time((MOST as i64 + 10) * TICK.0))[0], MOST as f64 + 10.0);
    }
}
