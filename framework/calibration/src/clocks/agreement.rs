//! One clock for each camera from pairs that were compared one by one, some of them wrongly.
//!
//! Trees of pairs are drawn at random, stronger pairs more often; each tree states all clocks, and the one that most other pairs confirm is
//! taken. Pairs that contradict it are dropped.

use foveate_estimation::Random;

use super::frames::Clock;
use super::pairs::PairClock;

/// Two cameras and how their clocks stand to one another.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Compared {
    pub a: usize,
    pub b: usize,
    pub clock: PairClock,
}

/// Clocks that most pairs confirm.
pub(super) struct Agreement {
    /// By camera, against the reference's; `None` outside its group.
    pub clocks: Vec<Option<Clock>>,
    pub reference: usize,
    /// By pair: whether it confirms the clocks.
    pub consistent: Vec<bool>,
}

const TREES: usize = 200;

/// `wanted`: whose clock is to be that of the room, if it belongs to the largest group.
pub(super) fn agree(n: usize, pairs: &[Compared], wanted: Option<usize>, random: &mut Random) -> Option<Agreement> {
    let group = groups(n, pairs);
    let size = |of: usize| group.iter().filter(|it| **it == of).count();
    let largest = (0..n).map(|it| group[it]).max_by_key(|it| (size(*it), std::cmp::Reverse(*it)))?;
    if size(largest) < 2 {
        return None;
    }
    let strength = |camera: usize| -> f64 {
        pairs.iter().filter(|it| it.a == camera || it.b == camera).map(|it| it.clock.support).sum()
    };
    let members = (0..n).filter(|it| group[*it] == largest);
    let strongest = members.max_by(|x, y| strength(*x).total_cmp(&strength(*y)).then(y.cmp(x)))?;
    let reference = wanted.filter(|it| group.get(*it) == Some(&largest)).unwrap_or(strongest);
    let mut best: Option<(f64, Vec<Option<Clock>>)> = None;
    for trial in 0..TREES {
        // The first tree is that of the strongest pairs; the others are drawn.
        let mut order: Vec<(f64, usize)> = pairs
            .iter()
            .enumerate()
            .map(|(index, it)| {
                let draw = if trial == 0 { 1.0 } else { random.uniform() };
                (draw * it.clock.support, index)
            })
            .collect();
        order.sort_by(|x, y| y.0.total_cmp(&x.0).then(x.1.cmp(&y.1)));
        let clocks = tree(n, pairs, &order, reference);
        let confirmed: f64 = pairs.iter().filter(|it| confirms(it, &clocks)).map(|it| it.clock.support).sum();
        if best.as_ref().is_none_or(|it| confirmed > it.0) {
            best = Some((confirmed, clocks));
        }
    }
    let (_, clocks) = best?;
    let consistent = pairs.iter().map(|it| confirms(it, &clocks)).collect();
    Some(Agreement { clocks, reference, consistent })
}

/// The strongest pairs of `order` that reach all cameras from the reference (Prim's algorithm).
fn tree(n: usize, pairs: &[Compared], order: &[(f64, usize)], reference: usize) -> Vec<Option<Clock>> {
    let mut clocks: Vec<Option<Clock>> = vec![None; n];
    clocks[reference] = Some(Clock::SAME);
    loop {
        let next = order.iter().find_map(|(_, index)| {
            let Compared { a, b, clock } = &pairs[*index];
            let Clock { offset_s, rate } = clock.a_from_b;
            match (clocks[*a], clocks[*b]) {
                // room = o + r a = o + r (offset + rate b)
                (Some(of_a), None) => Some((*b, Clock { offset_s: of_a.room_s(offset_s), rate: of_a.rate * rate })),
                (None, Some(of_b)) => {
                    let rate = of_b.rate / rate;
                    Some((*a, Clock { offset_s: of_b.offset_s - rate * offset_s, rate }))
                }
                _ => None,
            }
        });
        let Some((camera, clock)) = next else { return clocks };
        clocks[camera] = Some(clock);
    }
}

fn confirms(pair: &Compared, clocks: &[Option<Clock>]) -> bool {
    let (Some(a), Some(b)) = (clocks[pair.a], clocks[pair.b]) else { return false };
    let stated = pair.clock.a_from_b.room_s(pair.clock.middle_s);
    (a.own_s(b.room_s(pair.clock.middle_s)) - stated).abs() <= pair.clock.tolerance_s
}

/// By camera: the lowest number among those that pairs tie it to.
fn groups(n: usize, pairs: &[Compared]) -> Vec<usize> {
    let mut group: Vec<usize> = (0..n).collect();
    loop {
        let mut changed = false;
        for pair in pairs {
            let lower = group[pair.a].min(group[pair.b]);
            for camera in [pair.a, pair.b] {
                changed |= group[camera] != lower;
                group[camera] = lower;
            }
        }
        if !changed {
            return group;
        }
    }
}

/// The cameras that pairs tie to `camera`, itself among them.
pub(super) fn group_of(n: usize, pairs: &[Compared], camera: usize) -> Vec<usize> {
    let group = groups(n, pairs);
    (0..n).filter(|it| group[*it] == group[camera]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair(a: usize, b: usize, offset_s: f64, support: f64) -> Compared {
        let a_from_b = Clock { offset_s, rate: 1.0 };
        Compared { a, b, clock: PairClock { a_from_b, middle_s: 10.0, tolerance_s: 0.05, support, moments: 100 } }
    }

    #[test]
    fn a_strong_pair_that_contradicts_all_others_is_dropped() {
        let truth = [0.0, 0.3, -2.0, 7.0];
        let mut pairs = Vec::new();
        for a in 0..4 {
            for b in a + 1..4 {
                // room = camera + truth
                pairs.push(pair(a, b, truth[b] - truth[a] + 0.01 * (a as f64 - b as f64), 50.0));
            }
        }
        pairs[1].clock.a_from_b.offset_s += 3.0;
        pairs[1].clock.support = 90.0;
        let found = agree(4, &pairs, Some(0), &mut Random::new(1)).unwrap();
        assert_eq!(found.consistent, [true, false, true, true, true, true]);
        for (clock, truth) in found.clocks.iter().zip(truth) {
            assert!((clock.unwrap().offset_s - truth).abs() < 0.06, "{clock:?} {truth}");
        }
    }

    #[test]
    fn rates_are_chained_and_loners_get_no_clock() {
        let mut pairs = vec![pair(0, 1, 5.0, 50.0), pair(1, 2, -3.0, 40.0)];
        pairs[0].clock.a_from_b.rate = 1.001;
        let found = agree(4, &pairs, None, &mut Random::new(1)).unwrap();
        assert_eq!(found.reference, 1);
        let [Some(a), Some(b), Some(c), None] = found.clocks[..] else { panic!("{:?}", found.clocks) };
        // When b shows 100, a shows 5 + 100.1.
        assert!((a.room_s(105.1) - b.room_s(100.0)).abs() < 1e-9);
        assert!((c.room_s(103.0) - b.room_s(100.0)).abs() < 1e-9);
        assert!(agree(3, &[], None, &mut Random::new(1)).is_none());
    }
}
