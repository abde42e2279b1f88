//! Assignment of pan-tilt heads to targets: "given a set of small scale targets and a pool of available pan-tilt
//! cameras […], an optimal assignment of resources to targets could be found" [Davis 2002 §6.3].
//!
//! Unlike in [`assignment`](crate::assignment), a target wants several heads, and the value of a head depends on the
//! others: two lines of sight that cross at a wide angle fix a point in space, two nearly parallel ones hardly do.
//! Each head looks at one target at most. The total
//!
//! Σ over targets *t* of (weightₜ · [`Worth::of_set`]\(lines of sight of the heads at *t*) − their costs at *t*)
//!
//! is maximised: by [`optimal`], dynamic programming over sets of heads, or by [`search`], a local search over two and
//! three targets at a time from good starts. [`solve`] chooses by the size of the problem.

mod exact;
mod search;
#[cfg(test)]
mod tests;
mod worth;

pub use exact::optimal;
pub use search::search;
pub use worth::Worth;

use nalgebra::Vector3;

/// The most heads that a problem can have.
pub const MAX_HEADS: usize = 64;

/// The most heads for which [`solve`] computes the optimum: eight milliseconds for eight targets; each further head more than doubles the time.
pub const EXACT_HEADS: usize = 14;

/// An allocation problem: weights of targets, costs of pairs, and lines of sight.
#[derive(Debug, Clone, PartialEq)]
pub struct Problem {
    heads: usize,
    targets: usize,
    most: usize,
    worth: Worth,
    weights: Vec<f64>,
    /// By target, by head.
    costs: Vec<f64>,
    /// By target, by head, by other head: what the pair does not tell, 1 − [`Worth::of_pair`].
    untold: Vec<f64>,
}

/// Which head looks at which target.
#[derive(Debug, Clone, PartialEq)]
pub struct Allocation {
    /// By head: its target, or `None` for a free head.
    pub target_of: Vec<Option<usize>>,
    /// Total value minus total cost, in units of a target of weight 1 that is seen perfectly.
    pub total: f64,
}

impl Problem {
    /// A problem in which a target gets `most` heads at most.
    ///
    /// `weights`: one a target, how much it counts, 0 or more; NaN counts as 0. `costs[head * targets + target]`: the
    /// cost of letting that head look at that target, in the same unit; infinite or NaN forbids the pair. `towards`,
    /// in the same order: vectors from the target to the head, of any length.
    ///
    /// # Panics
    /// When the lengths of the lists do not match, or there are more than [`MAX_HEADS`] heads.
    pub fn new(worth: Worth, most: usize, weights: &[f64], costs: &[f64], towards: &[Vector3<f64>]) -> Problem {
        let targets = weights.len();
        assert_eq!(costs.len(), towards.len(), "there is a direction for each cost");
        let heads = costs.len().checked_div(targets).unwrap_or(0);
        assert_eq!(costs.len(), heads * targets, "there is a cost for each head and each target");
        assert!(heads <= MAX_HEADS, "{heads} heads, at most {MAX_HEADS} are possible");
        let weights = weights.iter().map(|it| if *it > 0.0 && it.is_finite() { *it } else { 0.0 }).collect();
        let mut by_target = Vec::with_capacity(costs.len());
        let mut untold = Vec::with_capacity(costs.len() * heads);
        for target in 0..targets {
            by_target.extend((0..heads).map(|head| costs[head * targets + target]));
            for head in 0..heads {
                let line = &towards[head * targets + target];
                untold.extend((0..heads).map(|other| 1.0 - worth.of_pair(line, &towards[other * targets + target])));
            }
        }
        Problem { heads, targets, most, worth, weights, costs: by_target, untold }
    }

    /// Number of heads.
    pub fn heads(&self) -> usize {
        self.heads
    }

    /// Number of targets.
    pub fn targets(&self) -> usize {
        self.targets
    }

    /// Value minus cost of the allocation `target_of` (by head); minus infinity where a head cannot look at its
    /// target, or a target has more heads than allowed.
    pub fn total(&self, target_of: &[Option<usize>]) -> f64 {
        let mut held = vec![0u64; self.targets];
        target_of.iter().enumerate().for_each(|(head, target)| target.iter().for_each(|it| held[*it] |= 1 << head));
        held.iter().enumerate().map(|(target, set)| self.net(target, *set)).sum()
    }

    fn cost(&self, target: usize, head: usize) -> f64 {
        self.costs[target * self.heads + head]
    }

    fn can(&self, target: usize, head: usize) -> bool {
        self.cost(target, head).is_finite()
    }

    fn untold(&self, target: usize, head: usize, other: usize) -> f64 {
        self.untold[(target * self.heads + head) * self.heads + other]
    }

    /// Worth less costs of the heads in `set` at `target`.
    fn net(&self, target: usize, set: u64) -> f64 {
        if set.count_ones() as usize > self.most || members(set).any(|head| !self.can(target, head)) {
            return f64::NEG_INFINITY;
        }
        let (mut untold, mut costs) = (1.0, 0.0);
        for head in members(set) {
            costs += self.cost(target, head);
            // Those below this head: each pair once.
            untold *= members(set & ((1 << head) - 1)).map(|it| self.untold(target, head, it)).product::<f64>();
        }
        self.weights[target] * self.worth.of_untold(set.count_ones(), untold) - costs
    }

    fn allocation(&self, held: &[u64]) -> Allocation {
        let mut target_of = vec![None; self.heads];
        for (target, set) in held.iter().enumerate() {
            members(*set).for_each(|head| target_of[head] = Some(target));
        }
        let total = held.iter().enumerate().map(|(target, set)| self.net(target, *set)).sum();
        Allocation { target_of, total }
    }
}

/// Solves the problem: optimally for up to [`EXACT_HEADS`] heads that can look at a target at all, else by [`search`].
/// `present`, by head, is a start of the search (the allocation in force) and may be empty.
pub fn solve(problem: &Problem, present: &[Option<usize>]) -> Allocation {
    if exact::useful(problem).len() <= EXACT_HEADS { optimal(problem) } else { search(problem, present) }
}

/// The heads in `set`, ascending.
fn members(mut set: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        (set != 0).then(|| {
            let head = set.trailing_zeros() as usize;
            set &= set - 1;
            head
        })
    })
}
