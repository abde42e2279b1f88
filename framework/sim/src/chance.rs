//! Random numbers by index: any event of any timeline can be drawn by its number, in any order.

use foveate_estimation::random::Random;

/// The stream of event number `index` of the timeline `what`, under `seed`.
#[inline]
pub(crate) fn stream(seed: u64, what: u64, index: i64) -> Random {
    let mut timeline = Random::new(seed ^ what.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    Random::new(timeline.next_u64() ^ index as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_and_timelines_differ_and_repeat() {
        let first = |seed, what, index| stream(seed, what, index).next_u64();
        let mut bits: Vec<u64> = Vec::new();
        for seed in 0..4 {
            for what in 0..8 {
                bits.extend((-50..50).map(|index| first(seed, what, index)));
            }
        }
        assert_eq!(bits[7], first(0, 0, -43));
        let count = bits.len();
        bits.sort_unstable();
        bits.dedup();
        assert_eq!(bits.len(), count);
    }
}
