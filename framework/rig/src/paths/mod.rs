//! Budgets followed along the edges: where each path leads, and whether the plan can keep the promise.
//!
//! A path goes along edges whose messages trigger their consumers: there a message is made of what came, and its stamp says when that was captured. An edge that is
//! sampled can only be the last one of a path, since what a node makes carries the time of what triggered it. No path goes through an actuator: it moves something, and
//! reports what it observes then.

mod refusals;

use std::cmp::Reverse;
use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet, BinaryHeap};

use super::budget::{BudgetDraft, Place, Port};
use super::lookup::Names;
use super::promise::{Best, round};
use super::wire::{EdgeDraft, Wiring};
use crate::graph::{Budget, BudgetEnd, BudgetPort, Edge};
use foveate_diagnostics::Findings;
use foveate_node::node::Role;

/// A budget with the instances that it is about, as numbered in the wiring.
pub(super) struct Path<'r> {
    draft: &'r BudgetDraft<'r>,
    begins: BTreeSet<usize>,
    /// Those that it leads to.
    ends: Vec<usize>,
    /// Those that messages made of it trigger.
    through: BTreeSet<usize>,
    /// Those that trigger where it begins, directly or through others.
    before: BTreeSet<usize>,
    latency_s: f64,
}

/// How an instance is reached soonest.
#[derive(Debug, Clone, Copy)]
struct Reach {
    /// Least age of what it makes of it [s].
    age_s: f64,
    /// The edge along which it comes.
    by: usize,
}

/// One end of a path.
struct End {
    instance: usize,
    /// Least age there, up to the motor of an actuator [s].
    age_s: f64,
    /// The last edge, where the path ends at an input.
    last: Option<usize>,
}

/// Follows all budgets; those that lead nowhere, and those that the plan cannot keep, are reported.
pub(super) fn follow<'r>(
    names: &Names<'_, '_>,
    wiring: &Wiring,
    order: &[usize],
    best: &[Best],
    budgets: &'r [BudgetDraft<'r>],
    findings: &mut Findings,
) -> Vec<Path<'r>> {
    // Where connections are missing, what a path reaches is guesswork.
    if budgets.is_empty() || wiring.sound.contains(&false) {
        return Vec::new();
    }
    let n_instances = wiring.instances.len();
    let mut web = Web {
        names,
        wiring,
        best,
        rank: vec![0; n_instances],
        outgoing: vec![Vec::new(); n_instances],
        incoming: vec![Vec::new(); n_instances],
    };
    for (rank, &instance) in order.iter().enumerate() {
        web.rank[instance] = rank;
    }
    for (number, edge) in wiring.edges.iter().enumerate() {
        web.outgoing[edge.from.0].push(number);
        web.incoming[edge.to.0].push(number);
    }
    budgets.iter().filter_map(|it| web.follow(it, findings)).collect()
}

/// The wired instances, ready to be walked along.
struct Web<'w, 'a, 't> {
    names: &'w Names<'a, 't>,
    wiring: &'w Wiring,
    best: &'w [Best],
    /// By instance: its place in the schedule.
    rank: Vec<usize>,
    /// By instance: the edges that leave it.
    outgoing: Vec<Vec<usize>>,
    /// By instance: the edges that lead to it.
    incoming: Vec<Vec<usize>>,
}

impl Web<'_, '_, '_> {
    fn follow<'r>(&self, draft: &'r BudgetDraft<'r>, findings: &mut Findings) -> Option<Path<'r>> {
        let Port::Output(output) = draft.from.port else { return None };
        let begins: BTreeSet<usize> = self.instances_of(draft.from).collect();
        let reached = self.reach(&begins, output);
        let start = |edge: &EdgeDraft| begins.contains(&edge.from.0) && edge.from.1 == output;
        let ends: Vec<End> =
            self.instances_of(draft.to).filter_map(|it| self.end(draft, it, &reached, &start)).collect();
        let Some(worst) = ends.iter().max_by(|a, b| a.age_s.total_cmp(&b.age_s)) else {
            self.refuse_nowhere(draft, &begins, &reached, output, findings);
            return None;
        };
        if worst.age_s > draft.age_ms * 1e-3 * (1.0 + 1e-9) {
            let (part, part_s) = self.longest_part(draft, worst, &reached, &start);
            let (found, least) = (draft.age_ms, round(worst.age_s * 1e3));
            let (from, to) = (draft.from_text.get_ref(), draft.to_text.get_ref());
            findings
                .error(
                    draft.age_place.clone(),
                    format_args!("what is made of `{from}` cannot be as young at `{to}` as promised"),
                    format_args!(
                        "found {found} ms, expected at least {least} ms: the least age that is possible there"
                    ),
                )
                .help(format_args!("most of it, {} ms, is {part}", round(part_s * 1e3)));
            return None;
        }
        Some(Path {
            draft,
            ends: ends.iter().map(|it| it.instance).collect(),
            through: reached.into_keys().collect(),
            before: self.upstream(begins.iter().copied()),
            begins,
            latency_s: self.latency_at_end(draft.to),
        })
    }

    /// The instances of the node at `place`, or the one for its camera.
    fn instances_of(&self, place: Place) -> impl Iterator<Item = usize> {
        let all = &self.wiring.instances;
        let (first, end) = (all.partition_point(|it| it.0 < place.node), all.partition_point(|it| it.0 <= place.node));
        (first..end).filter(move |&it| place.camera.is_none() || all[it].1 == place.camera)
    }

    fn is_actuator(&self, instance: usize) -> bool {
        let node_type = self.names.nodes[self.wiring.instances[instance].0].node_type.as_ref();
        node_type.is_some_and(|it| it.role == Role::Actuator)
    }

    fn latency_s(&self, instance: usize) -> f64 {
        self.names.nodes[self.wiring.instances[instance].0].plan.latency_s.max(0.0)
    }

    /// From the arrival at an actuator to its motor [s]; 0 at all other ends.
    fn latency_at_end(&self, place: Place) -> f64 {
        let node = &self.names.nodes[place.node];
        let is_actuator = node.node_type.as_ref().is_some_and(|it| it.role == Role::Actuator);
        if is_actuator && matches!(place.port, Port::Input(_)) { node.plan.latency_s.max(0.0) } else { 0.0 }
    }

    /// What the rig states as the delay of an edge [s].
    fn delay_s(&self, edge: &EdgeDraft) -> f64 {
        let consumer = &self.names.nodes[self.wiring.instances[edge.to.0].0];
        consumer.text.inputs[edge.input].delay.as_ref().map_or(0.0, |it| it.0.as_s())
    }

    /// All instances that messages made of output `output` of `begins` trigger.
    fn reach(&self, begins: &BTreeSet<usize>, output: usize) -> BTreeMap<usize, Reach> {
        let mut reached: BTreeMap<usize, Reach> = BTreeMap::new();
        // In the order of the schedule, so that all that comes to an instance is known before it is left.
        let mut next: BinaryHeap<Reverse<(usize, usize)>> = BinaryHeap::new();
        let go = |by: usize, age_s: f64, reached: &mut BTreeMap<usize, Reach>, next: &mut BinaryHeap<_>| {
            let edge = &self.wiring.edges[by];
            if !edge.triggers || self.is_actuator(edge.to.0) {
                return;
            }
            let reach = Reach { age_s: age_s + self.latency_s(edge.to.0), by };
            match reached.entry(edge.to.0) {
                Entry::Vacant(new) => {
                    new.insert(reach);
                    next.push(Reverse((self.rank[edge.to.0], edge.to.0)));
                }
                Entry::Occupied(mut known) if reach.age_s < known.get().age_s => *known.get_mut() = reach,
                Entry::Occupied(_) => {}
            }
        };
        for &begin in begins {
            for &edge in self.outgoing[begin].iter().filter(|&&it| self.wiring.edges[it].from.1 == output) {
                go(edge, self.best[begin].age_s, &mut reached, &mut next);
            }
        }
        while let Some(Reverse((_, instance))) = next.pop() {
            let age_s = reached[&instance].age_s;
            self.outgoing[instance].iter().for_each(|&edge| go(edge, age_s, &mut reached, &mut next));
        }
        reached
    }

    /// The end of the path at `instance`, if it leads there.
    fn end(
        &self,
        draft: &BudgetDraft<'_>,
        instance: usize,
        reached: &BTreeMap<usize, Reach>,
        start: &dyn Fn(&EdgeDraft) -> bool,
    ) -> Option<End> {
        let age_after = |edge: &EdgeDraft| match start(edge) {
            true => Some(self.best[edge.from.0].age_s),
            false => reached.get(&edge.from.0).map(|it| it.age_s),
        };
        match draft.to.port {
            Port::Output(_) => {
                let is_begin = draft.to == Place { camera: draft.to.camera, ..draft.from };
                let is_begin = is_begin && self.instances_of(draft.from).any(|it| it == instance);
                let own = is_begin.then(|| self.best[instance].age_s);
                let age_s = own.or_else(|| reached.get(&instance).map(|it| it.age_s))?;
                Some(End { instance, age_s, last: None })
            }
            Port::Input(port) => {
                let into = self.incoming[instance].iter().filter(|&&it| self.wiring.edges[it].to.1 == port);
                let arrivals = into.filter_map(|&it| {
                    let edge = &self.wiring.edges[it];
                    let age_s = age_after(edge)? + self.delay_s(edge) + self.latency_at_end(draft.to);
                    Some(End { instance, age_s, last: Some(it) })
                });
                arrivals.min_by(|a, b| a.age_s.total_cmp(&b.age_s))
            }
        }
    }

    /// All of `instances`, and what triggers them, directly or through others.
    fn upstream(&self, instances: impl Iterator<Item = usize>) -> BTreeSet<usize> {
        let mut found: BTreeSet<usize> = instances.collect();
        let mut next: Vec<usize> = found.iter().copied().collect();
        while let Some(instance) = next.pop() {
            let edges = self.incoming[instance].iter().map(|&it| &self.wiring.edges[it]);
            next.extend(edges.filter(|it| it.triggers).map(|it| it.from.0).filter(|&it| found.insert(it)));
        }
        found
    }
}

impl Path<'_> {
    /// The budget of the finished graph; `place` has the number there of each instance.
    pub fn budget(&self, place: &[usize], edges: &[Edge]) -> Budget {
        let numbered = |instances: &mut dyn Iterator<Item = usize>| {
            let mut numbers: Vec<usize> = instances.map(|it| place[it]).collect();
            numbers.sort_unstable();
            numbers.dedup();
            numbers
        };
        let begins = numbered(&mut self.begins.iter().copied());
        let through = numbered(&mut self.through.iter().copied());
        let ends = numbered(&mut self.ends.iter().copied());
        let mut into: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        if let (Port::Input(input), Port::Output(output)) = (self.draft.to.port, self.draft.from.port) {
            for (number, edge) in edges.iter().enumerate().filter(|it| it.1.to.1 == input) {
                let is_first = edge.from.1 == output && begins.binary_search(&edge.from.0).is_ok();
                let is_later = through.binary_search(&edge.from.0).is_ok();
                if (is_first || is_later) && ends.binary_search(&edge.to.0).is_ok() {
                    into.entry(edge.to.0).or_default().push(number);
                }
            }
        }
        let end = |instance: usize| BudgetEnd {
            instance,
            at: match self.draft.to.port {
                Port::Output(port) => BudgetPort::Output(port),
                Port::Input(_) => BudgetPort::Input(into.remove(&instance).unwrap_or_default()),
            },
        };
        Budget {
            from: self.draft.from_text.get_ref().clone(),
            to: self.draft.to_text.get_ref().clone(),
            origins: numbered(&mut self.begins.iter().chain(&self.through).chain(&self.before).copied()),
            ends: ends.into_iter().map(end).collect(),
            begins,
            age_s: self.draft.age_ms * 1e-3,
            latency_s: self.latency_s,
            must: self.draft.must,
        }
    }
}
