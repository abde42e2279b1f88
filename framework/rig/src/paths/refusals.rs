//! What is said of budgets that lead nowhere, or that the plan cannot keep.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use super::{End, Reach, Web};
use crate::budget::{BudgetDraft, Port};
use crate::wire::EdgeDraft;
use foveate_diagnostics::Findings;
use foveate_diagnostics::names::listed;

impl Web<'_, '_, '_> {
    /// Which part of the least age at `end` is the longest, and how long [s].
    pub(super) fn longest_part(
        &self,
        draft: &BudgetDraft<'_>,
        end: &End,
        reached: &BTreeMap<usize, Reach>,
        start: &dyn Fn(&EdgeDraft) -> bool,
    ) -> (String, f64) {
        let of_node = |instance: usize| {
            let name = self.node_name(self.wiring.instances[instance].0);
            (format!("the latency of `{name}`"), self.latency_s(instance))
        };
        let mut parts = Vec::new();
        let mut edge = end.last;
        let mut at = Some(end.instance);
        if let Some(last) = end.last.map(|it| &self.wiring.edges[it]) {
            let (name, latency_s) = of_node(end.instance);
            parts.push((name, latency_s.min(self.latency_at_end(draft.to))));
            parts.push((format!("the `delay_ms` of `{}`", self.input_name(last)), self.delay_s(last)));
        } else {
            edge = reached.get(&end.instance).map(|it| it.by);
            parts.extend(at.filter(|_| edge.is_some()).map(of_node));
        }
        // Back to where the path begins …
        while let Some(it) = edge.map(|it| &self.wiring.edges[it]) {
            at = Some(it.from.0);
            edge = reached.get(&it.from.0).filter(|_| !start(it)).map(|it| it.by);
            parts.extend(at.filter(|_| edge.is_some()).map(of_node));
        }
        // … and to the capture before that.
        while let Some(instance) = at {
            parts.push(of_node(instance));
            at = self.best[instance].youngest;
        }
        parts.into_iter().rev().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or_default()
    }

    /// The fault of a path that does not exist: why, and what each of its ends reaches.
    pub(super) fn refuse_nowhere(
        &self,
        draft: &BudgetDraft<'_>,
        begins: &BTreeSet<usize>,
        reached: &BTreeMap<usize, Reach>,
        output: usize,
        findings: &mut Findings,
    ) {
        let (from, to) = (draft.from_text.get_ref(), draft.to_text.get_ref());
        if let Some(sampled) = self.sampled_on_the_way(draft, begins, reached, output) {
            findings
                .error(
                    draft.to_text.span(),
                    format_args!("`{from}` leads to `{to}` only by way of `{sampled}`, which samples"),
                    format_args!("found messages with the times of what triggers their nodes, and not of `{from}`"),
                )
                .help(format_args!("end the budget at `{sampled}`"));
            return;
        }
        let ahead = self.leaving_all(begins, reached, output).filter(|it| it.triggers);
        let ahead = self.nodes_of(ahead.map(|it| it.to.0)).unwrap_or("no node".to_owned());
        let sources = self.instances_of(draft.to).flat_map(|it| &self.incoming[it]).map(|&it| &self.wiring.edges[it]);
        let sources = sources.filter(|it| match draft.to.port {
            Port::Input(port) => it.to.1 == port,
            Port::Output(_) => it.triggers,
        });
        let behind = self.nodes_of(self.upstream(sources.map(|it| it.from.0)).into_iter());
        let is_report =
            matches!(draft.to.port, Port::Output(_)) && self.instances_of(draft.to).any(|it| self.is_actuator(it));
        let more = if is_report { "; what an actuator gives out is observed again" } else { "" };
        findings
            .error(
                draft.to_text.span(),
                format_args!("`{from}` does not lead to `{to}`"),
                format_args!("found no path, expected a port that messages made of `{from}` reach"),
            )
            .help(format_args!(
                "`{from}` leads to {ahead}; `{to}` gets what is made by {}{more}",
                behind.unwrap_or("no other node".to_owned())
            ))
            .also(draft.from_text.span(), "the path begins here");
    }

    fn leaving(&self, instance: usize) -> impl Iterator<Item = &EdgeDraft> {
        self.outgoing[instance].iter().map(|&it| &self.wiring.edges[it])
    }

    /// The edges that leave the output where a path begins, and all that it reaches.
    fn leaving_all(
        &self,
        begins: &BTreeSet<usize>,
        reached: &BTreeMap<usize, Reach>,
        output: usize,
    ) -> impl Iterator<Item = &EdgeDraft> {
        let of_begins = begins.iter().flat_map(|&it| self.leaving(it)).filter(move |it| it.from.1 == output);
        of_begins.chain(reached.keys().flat_map(|&it| self.leaving(it)))
    }

    /// The input behind which the end is reached, but only since its node samples it.
    fn sampled_on_the_way(
        &self,
        draft: &BudgetDraft<'_>,
        begins: &BTreeSet<usize>,
        reached: &BTreeMap<usize, Reach>,
        output: usize,
    ) -> Option<String> {
        let ends: BTreeSet<usize> = self.instances_of(draft.to).collect();
        let sampled = self.leaving_all(begins, reached, output).filter(|it| !it.triggers);
        let mut next: VecDeque<(usize, &EdgeDraft)> = sampled.map(|it| (it.to.0, it)).collect();
        let mut seen: BTreeSet<usize> = next.iter().map(|it| it.0).collect();
        while let Some((instance, sampled)) = next.pop_front() {
            if ends.contains(&instance) && matches!(draft.to.port, Port::Output(_)) {
                return Some(self.input_name(sampled));
            }
            for edge in self.leaving(instance) {
                if ends.contains(&edge.to.0) && draft.to.port == Port::Input(edge.to.1) {
                    return Some(self.input_name(sampled));
                }
                if !self.is_actuator(edge.to.0) && seen.insert(edge.to.0) {
                    next.push_back((edge.to.0, sampled));
                }
            }
        }
        None
    }

    fn node_name(&self, node: usize) -> String {
        let node = &self.names.nodes[node];
        format!("{}.{}", self.names.scales[node.scale].name, node.name())
    }

    /// The nodes of instances, each once, in the order of the rig.
    fn nodes_of(&self, instances: impl Iterator<Item = usize>) -> Option<String> {
        let nodes: BTreeSet<usize> = instances.map(|it| self.wiring.instances[it].0).collect();
        listed(nodes.into_iter().map(|it| self.node_name(it)))
    }

    fn input_name(&self, edge: &EdgeDraft) -> String {
        let node = self.wiring.instances[edge.to.0].0;
        format!("{}.{}", self.node_name(node), self.names.nodes[node].text.inputs[edge.input].port.get_ref())
    }
}
