//! The schedule: every producer before what it triggers, and before what samples it wherever no cycle forbids that.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap, VecDeque};

// Not `tarjan_scc`: it recurses, and a rig may be a chain of 100,000 nodes.
use petgraph::algo::kosaraju_scc;
use petgraph::graph::DiGraph;

/// An edge as the schedule sees it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Arrow {
    pub from: usize,
    pub to: usize,
    /// Whether a message on it triggers the consumer.
    pub triggers: bool,
}

/// Groups of two or more that reach each other, and those that reach themselves, along `arrows`.
pub(super) fn cycles(count: usize, arrows: impl Iterator<Item = Arrow> + Clone) -> Vec<Vec<usize>> {
    let mut of_itself = vec![false; count];
    for arrow in arrows.clone().filter(|it| it.from == it.to) {
        of_itself[arrow.from] = true;
    }
    let mut groups = components(count, arrows);
    groups.retain(|group| group.len() > 1 || group.iter().any(|&it| of_itself[it]));
    for group in &mut groups {
        group.sort_unstable();
    }
    groups.sort_unstable();
    groups
}

fn components(count: usize, arrows: impl Iterator<Item = Arrow>) -> Vec<Vec<usize>> {
    let mut graph = DiGraph::<(), ()>::with_capacity(count, 0);
    let indices: Vec<_> = (0..count).map(|_| graph.add_node(())).collect();
    for arrow in arrows {
        graph.add_edge(indices[arrow.from], indices[arrow.to], ());
    }
    let groups = kosaraju_scc(&graph).into_iter();
    groups.map(|group| group.into_iter().map(|it| it.index()).collect()).collect()
}

/// A shortest way from the first of `group` along `arrows` back to it.
pub(super) fn way_around(group: &[usize], arrows: impl Iterator<Item = Arrow>) -> Vec<usize> {
    let Some(&start) = group.first() else { return Vec::new() };
    let mut next: BTreeMap<usize, Vec<usize>> = group.iter().map(|&it| (it, Vec::new())).collect();
    for arrow in arrows {
        if next.contains_key(&arrow.to) {
            next.entry(arrow.from).or_default().push(arrow.to);
        }
    }
    let mut came_from: BTreeMap<usize, usize> = BTreeMap::new();
    let mut queue = VecDeque::from([start]);
    while let Some(at) = queue.pop_front() {
        for &to in next.get(&at).into_iter().flatten() {
            if to == start {
                let mut way = vec![at];
                while let Some(&before) = came_from.get(&way[way.len() - 1]).filter(|_| way[way.len() - 1] != start) {
                    way.push(before);
                }
                way.reverse();
                return way;
            }
            if group.binary_search(&to).is_ok() && to != start && !came_from.contains_key(&to) {
                came_from.insert(to, at);
                queue.push_back(to);
            }
        }
    }
    group.to_vec()
}

/// An order of `0..count`: along every triggering arrow, along every sampled one that is on no cycle, and otherwise by
/// number. The triggering arrows must have no cycle.
pub(super) fn schedule(count: usize, arrows: &[Arrow]) -> Vec<usize> {
    let mut component = vec![0; count];
    for (number, group) in components(count, arrows.iter().copied()).into_iter().enumerate() {
        for it in group {
            component[it] = number;
        }
    }
    let binds = |arrow: &Arrow| arrow.triggers || component[arrow.from] != component[arrow.to];
    let mut next: Vec<Vec<(usize, bool)>> = vec![Vec::new(); count];
    let (mut bound, mut wished) = (vec![0_usize; count], vec![0_usize; count]);
    for arrow in arrows.iter().filter(|it| it.from != it.to) {
        let binding = binds(arrow);
        next[arrow.from].push((arrow.to, binding));
        *if binding { &mut bound[arrow.to] } else { &mut wished[arrow.to] } += 1;
    }
    // Ready ones, and those that would be but for a wish; entries of the second kind move on when the wish is met.
    let (mut ready, mut waiting) = (BinaryHeap::new(), BinaryHeap::new());
    for it in (0..count).filter(|&it| bound[it] == 0) {
        if wished[it] == 0 { ready.push(Reverse(it)) } else { waiting.push(Reverse(it)) }
    }
    let mut placed = vec![false; count];
    let mut order = Vec::with_capacity(count);
    while let Some(Reverse(it)) = ready.pop().or_else(|| waiting.pop()) {
        if std::mem::replace(&mut placed[it], true) {
            continue;
        }
        order.push(it);
        for &(to, binding) in &next[it] {
            *if binding { &mut bound[to] } else { &mut wished[to] } -= 1;
            if bound[to] == 0 && !placed[to] {
                if wished[to] == 0 { ready.push(Reverse(to)) } else { waiting.push(Reverse(to)) }
            }
        }
    }
    order
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn arrows(list: &[(usize, usize, bool)]) -> Vec<Arrow> {
        list.iter().map(|&(from, to, triggers)| Arrow { from, to, triggers }).collect()
    }

    #[test]
    fn free_choice_goes_by_number() {
        assert_eq!(schedule(4, &arrows(&[(3, 1, true)])), [0, 2, 3, 1]);
    }

    #[test]
    fn sampled_arrow_orders_unless_it_closes_a_cycle() {
        assert_eq!(schedule(3, &arrows(&[(2, 0, false)])), [1, 2, 0]);
        // 0 → 1 → 2 and back: the way back gives way.
        assert_eq!(schedule(3, &arrows(&[(0, 1, true), (1, 2, true), (2, 0, false)])), [0, 1, 2]);
        // The cycle 0 ⇄ 1 samples 2, which is outside of it.
        assert_eq!(schedule(3, &arrows(&[(0, 1, true), (1, 0, false), (2, 0, false)])), [2, 0, 1]);
        // Two cycles, 0 ⇄ 1 and 2 ⇄ 3, and 0 samples 2: one of the ways back gives way, the way between does not.
        let two = [(0, 1, true), (1, 0, false), (2, 3, true), (3, 2, false), (2, 0, false)];
        assert_eq!(schedule(4, &arrows(&two)), [2, 3, 0, 1]);
        // Within a cycle as many wishes as possible: 2 → 1 is kept, 1 → 0 … is not.
        assert_eq!(schedule(3, &arrows(&[(0, 2, true), (2, 1, false), (1, 0, false)])), [0, 2, 1]);
    }

    #[test]
    fn cycles_are_found_in_long_chains_and_in_single_nodes() {
        let chain = (0..100_000).map(|it| Arrow { from: it, to: it + 1, triggers: true });
        assert_eq!(cycles(100_001, chain.clone()), Vec::<Vec<usize>>::new());
        let back = Arrow { from: 100_000, to: 99_998, triggers: true };
        let of_itself = Arrow { from: 7, to: 7, triggers: true };
        let found = cycles(100_001, chain.chain([back, of_itself]));
        assert_eq!(found, [vec![7], vec![99_998, 99_999, 100_000]]);
    }

    #[test]
    fn way_around_follows_the_arrows() {
        let list = arrows(&[(1, 5, true), (5, 3, true), (3, 1, true), (3, 5, true)]);
        assert_eq!(way_around(&[1, 3, 5], list.iter().copied()), [1, 5, 3]);
        assert_eq!(way_around(&[7], arrows(&[(7, 7, true)]).into_iter()), [7]);
    }

    proptest! {
        #[test]
        fn schedule_holds_every_arrow_that_can_be_held(
            list in proptest::collection::vec((0..9_usize, 0..9_usize, any::<bool>()), 0..20),
        ) {
            // Those that trigger point upwards, so that they have no cycle; named so that numbers say nothing.
            let name = |it: usize| (it * 4) % 9;
            let arrows: Vec<Arrow> = list
                .iter()
                .filter(|it| !it.2 || it.0 < it.1)
                .map(|&(from, to, triggers)| Arrow { from: name(from), to: name(to), triggers })
                .collect();
            let order = schedule(9, &arrows);
            let mut sorted = order.clone();
            sorted.sort_unstable();
            prop_assert_eq!(sorted, (0..9).collect::<Vec<_>>());
            let place = |node: usize| order.iter().position(|&it| it == node);
            let in_cycle = cycles(9, arrows.iter().copied());
            for arrow in &arrows {
                let together = in_cycle.iter().any(|it| it.contains(&arrow.from) && it.contains(&arrow.to));
                prop_assert!((!arrow.triggers && together) || place(arrow.from) < place(arrow.to), "{:?} {:?}", arrow, order);
            }
        }
    }
}
