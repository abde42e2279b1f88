//! A good allocation where there are too many heads for the optimum: local search.
//!
//! The search starts from a greedy allocation, and from the present one if given. The heads of two targets, and as
//! many free ones as fit, are then reallocated optimally between the two: this covers every move of a head, every swap
//! and every exchange with a free head. When no two targets improve any more, three are tried, which covers chains of
//! moves. Then each target in turn releases its heads and is reallocated last; an improvement is kept.

use std::collections::HashSet;

use super::exact::{optimal_of, useful};
use super::{Allocation, Problem, members};

/// Heads dealt out at a time, unless the targets have as many themselves.
const DEALT: usize = 10;

/// With more than these, three targets are left as they are.
const MOST_DEALT: u32 = 12;

/// Threes of targets that are tried, at most; sixteen targets make 560.
const THREES: usize = 600;

/// A gain below this is rounding.
const LEAST_GAIN: f64 = 1e-9;

/// Searches from a greedy start and from `present` (by head; empty: none). The result is no worse than either start,
/// and the same for the same problem.
pub fn search(problem: &Problem, present: &[Option<usize>]) -> Allocation {
    let mut search = Search::new(problem);
    let total = |held: &[u64]| held.iter().enumerate().map(|(target, set)| problem.net(target, *set)).sum::<f64>();
    let mut found = search.improved(greedy(problem));
    if present.len() == problem.heads && problem.total(present).is_finite() {
        let mut held = vec![0u64; problem.targets];
        present.iter().enumerate().for_each(|(head, target)| target.iter().for_each(|it| held[*it] |= 1 << head));
        let from_present = search.improved(held);
        if total(&from_present) > total(&found) + LEAST_GAIN {
            found = from_present;
        }
    }
    // Until all have had their turn since the last gain.
    let mut n_without_gain = 0;
    for target in (0..problem.targets).cycle() {
        if n_without_gain == problem.targets {
            break;
        }
        let without = search.without(target, found.clone());
        n_without_gain += 1;
        if total(&without) > total(&found) + LEAST_GAIN {
            (found, n_without_gain) = (without, 0);
        }
    }
    problem.allocation(&found)
}

/// Again and again the one or two free heads for a target that gain most.
fn greedy(problem: &Problem) -> Vec<u64> {
    let mut held = vec![0u64; problem.targets];
    let mut free = useful(problem);
    loop {
        let mut best = (LEAST_GAIN, 0, 0u64);
        for (target, set) in held.iter().enumerate() {
            let now = problem.net(target, *set);
            for (place, head) in free.iter().enumerate() {
                let one = 1u64 << head;
                let with_another = free[..place].iter().map(|it| one | 1 << it);
                for added in std::iter::once(one).chain(with_another) {
                    // A head each: a pair must gain more than twice what one does.
                    let gain = (problem.net(target, set | added) - now) / f64::from(added.count_ones());
                    if gain > best.0 {
                        best = (gain, target, added);
                    }
                }
            }
        }
        let (_, target, added) = best;
        if added == 0 {
            return held;
        }
        held[target] |= added;
        free.retain(|head| added >> head & 1 == 0);
    }
}

struct Search<'a> {
    problem: &'a Problem,
    /// The heads that can look at some target.
    all: u64,
    pairs: Vec<[usize; 2]>,
    threes: Vec<[usize; 3]>,
    /// Reallocations without a gain: whose, which of them, and what was free.
    without_gain: HashSet<([usize; 3], [u64; 3], u64)>,
}

impl Search<'_> {
    fn new(problem: &Problem) -> Search<'_> {
        let n = problem.targets;
        let threes = (0..n).flat_map(|c| (0..c).flat_map(move |b| (0..b).map(move |a| [a, b, c])));
        Search {
            problem,
            all: useful(problem).iter().fold(0, |all, head| all | 1 << head),
            pairs: (0..n).flat_map(|b| (0..b).map(move |a| [a, b])).collect(),
            threes: threes.take(THREES).collect(),
            without_gain: HashSet::new(),
        }
    }

    fn improved(&mut self, mut held: Vec<u64>) -> Vec<u64> {
        if held.len() == 1 {
            self.deal(&[0], &mut held);
        }
        loop {
            self.improve_pairs(&mut held, |_| true);
            if !(0..self.threes.len()).any(|it| {
                let three = self.threes[it];
                self.deal(&three, &mut held)
            }) {
                return held;
            }
        }
    }

    /// The others share the heads of `target` first.
    fn without(&mut self, target: usize, mut held: Vec<u64>) -> Vec<u64> {
        held[target] = 0;
        self.improve_pairs(&mut held, |it| !it.contains(&target));
        self.improved(held)
    }

    fn improve_pairs(&mut self, held: &mut [u64], which: impl Fn(&[usize; 2]) -> bool) {
        let mut gained = true;
        while gained {
            gained = false;
            for place in 0..self.pairs.len() {
                let pair = self.pairs[place];
                gained |= which(&pair) && self.deal(&pair, held);
            }
        }
    }

    /// Reallocates the heads of `targets`, with the free ones, a handful at a time. Whether that gained something.
    fn deal(&mut self, targets: &[usize], held: &mut [u64]) -> bool {
        let free = self.all & !held.iter().fold(0, |a, b| a | b);
        let mut case = ([usize::MAX; 3], [0; 3], free);
        for (place, target) in targets.iter().enumerate() {
            (case.0[place], case.1[place]) = (*target, held[*target]);
        }
        if self.without_gain.contains(&case) {
            return false;
        }
        let gained = self.deal_anew(targets, free, held);
        if !gained {
            self.without_gain.insert(case);
        }
        gained
    }

    fn deal_anew(&self, targets: &[usize], free: u64, held: &mut [u64]) -> bool {
        let free: Vec<usize> = members(free).collect();
        let mut gained = false;
        let mut next = 0;
        loop {
            let own = targets.iter().fold(0, |own, it| own | held[*it]);
            if own.count_ones() > MOST_DEALT && targets.len() > 2 {
                return gained;
            }
            let room = DEALT.saturating_sub(own.count_ones() as usize).max(1).min(free.len() - next);
            let added = free[next..next + room].iter().copied();
            next += room;
            let mut heads: Vec<usize> = members(own).chain(added.filter(|it| own >> it & 1 == 0)).collect();
            heads.sort_unstable();
            let dealt = optimal_of(self.problem, &heads, targets);
            let worth = |held: &[u64]| targets.iter().map(|it| self.problem.net(*it, held[*it])).sum::<f64>();
            if worth(&dealt) > worth(held) + LEAST_GAIN {
                targets.iter().for_each(|it| held[*it] = dealt[*it]);
                gained = true;
            }
            if next >= free.len() {
                return gained;
            }
        }
    }
}
