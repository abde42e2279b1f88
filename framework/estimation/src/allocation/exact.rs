//! The optimal allocation, by dynamic programming over sets of heads.
//!
//! Let `best[t][A]` be the highest value of the first *t* targets when they share the heads in *A*:
//! `best[t][A]` = max over *S* ⊆ *A* of net(*t*, *S*) + `best[t−1][A \ S]`. There are 3ⁿ pairs *S* ⊆ *A*; sets that
//! are worth no more than one of their subsets, or are larger than allowed, are skipped. The last target needs *A* =
//! all heads only.

use super::{Allocation, Problem};

/// The allocation with the highest total. Ties: heads that gain nothing stay free; among equal allocations the choice
/// depends only on the order of heads and targets.
///
/// Time grows with 3ⁿ and memory with 2ⁿ in the number of heads that can look at a target at all.
///
/// # Panics
/// With more than 20 such heads.
pub fn optimal(problem: &Problem) -> Allocation {
    let heads = useful(problem);
    assert!(heads.len() <= 20, "{} heads: the optimum would take too long, expected at most 20", heads.len());
    let targets: Vec<usize> = (0..problem.targets).collect();
    problem.allocation(&optimal_of(problem, &heads, &targets))
}

/// The heads that can look at some target.
pub(super) fn useful(problem: &Problem) -> Vec<usize> {
    (0..problem.heads).filter(|head| (0..problem.targets).any(|target| problem.can(target, *head))).collect()
}

/// The best that `targets` can make of `heads`: by target the set of heads.
pub(super) fn optimal_of(problem: &Problem, heads: &[usize], targets: &[usize]) -> Vec<u64> {
    let n_sets = 1usize << heads.len();
    let all = n_sets - 1;
    let mut chosen = vec![0u32; n_sets * targets.len()];
    let (mut best, mut before) = (vec![0.0; n_sets], vec![0.0; n_sets]);
    let mut gains = Gains::default();
    for (place, target) in targets.iter().enumerate() {
        std::mem::swap(&mut best, &mut before);
        best.copy_from_slice(&before);
        let chosen = &mut chosen[place * n_sets..(place + 1) * n_sets];
        let last = place + 1 == targets.len();
        gains.list(problem, heads, *target);
        for &(set, net) in &gains.worth_it {
            let rest = all & !set;
            // All parts of the rest, ascending; of the last target only the whole.
            let mut part = if last { rest } else { 0 };
            loop {
                let total = net + before[part];
                if total > best[set | part] {
                    best[set | part] = total;
                    chosen[set | part] = set as u32;
                }
                if part == rest {
                    break;
                }
                part = part.wrapping_sub(rest) & rest;
            }
        }
    }
    let mut left = all;
    let mut held = vec![0u64; targets.len()];
    for place in (0..targets.len()).rev() {
        let set = chosen[place * n_sets + left] as usize;
        left &= !set;
        held[place] = (0..heads.len()).filter(|it| set >> it & 1 == 1).map(|it| 1u64 << heads[it]).sum();
    }
    if targets.len() == problem.targets {
        return held;
    }
    let mut by_target = vec![0; problem.targets];
    targets.iter().zip(held).for_each(|(target, set)| by_target[*target] = set);
    by_target
}

/// The sets of heads that are worth looking at for one target.
#[derive(Default)]
struct Gains {
    /// By set: what no pair of it tells; what it costs; the most that it or a part of it is worth.
    untold: Vec<f64>,
    costs: Vec<f64>,
    most_worth: Vec<f64>,
    /// Sets worth more than each of their parts, ascending, and what they are worth.
    worth_it: Vec<(usize, f64)>,
}

impl Gains {
    fn list(&mut self, problem: &Problem, heads: &[usize], target: usize) {
        let n_sets = 1usize << heads.len();
        for (table, of_none) in [(&mut self.untold, 1.0), (&mut self.costs, 0.0), (&mut self.most_worth, 0.0)] {
            table.clear();
            table.resize(n_sets, of_none);
        }
        self.worth_it.clear();
        for set in 1..n_sets {
            let count = set.count_ones();
            if count as usize > problem.most {
                continue;
            }
            let (first, others) = (set.trailing_zeros() as usize, set & (set - 1));
            let pairs = (first + 1..heads.len()).filter(|it| others >> it & 1 == 1);
            let with_first: f64 = pairs.map(|it| problem.untold(target, heads[first], heads[it])).product();
            self.untold[set] = self.untold[others] * with_first;
            self.costs[set] = self.costs[others] + problem.cost(target, heads[first]);
            let net = problem.weights[target] * problem.worth.of_untold(count, self.untold[set]) - self.costs[set];
            let parts = (0..heads.len()).filter(|it| set >> it & 1 == 1).map(|it| self.most_worth[set & !(1 << it)]);
            let of_part = parts.fold(0.0, f64::max);
            // Not so for a set with a head that cannot: its costs are infinite or no number.
            if net > of_part && net.is_finite() {
                self.worth_it.push((set, net));
            }
            self.most_worth[set] = if net.is_finite() { of_part.max(net) } else { of_part };
        }
    }
}
