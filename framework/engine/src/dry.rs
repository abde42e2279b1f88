//! Whether a run gave what its rig is for; where it did not, which one cause is reported.
//!
//! The rule: of all nodes on the way to a sink without data, the cause is the first one that had input, or is a source, and gave out nothing. What lies behind it
//! only went without. A source or detector that declared gaps and gave out nothing else is a cause by itself, whatever other sinks got.

use std::collections::BTreeMap;

use foveate_messages::Time;
use foveate_node::Role;
use foveate_node::error::Blame;
use foveate_rig::graph::Graph;

use crate::faults::{FaultRecord, GapRecord};
use crate::ledger::Ledger;

/// One node of the rig with all its instances.
#[derive(Default)]
struct Tally {
    /// The first of its instances.
    instance: usize,
    /// Messages that left it.
    given: u64,
    /// Messages that it took, and those that were held up since its scale was suspended; what only closes a cycle is left out.
    taken: u64,
    suspended: u64,
    has_outputs: bool,
    producers: Vec<usize>,
    gaps: u64,
    /// The reason of most gaps.
    reason: Option<(u64, String)>,
    /// Sinks that got nothing because of it.
    starved: Vec<usize>,
    is_cause: bool,
}

/// The causes, a failure each, but for nodes whose `faults` say why already. A run that is not `whole` (cut short by a person) says nothing about sinks,
/// nor does one in which a program failed.
pub(crate) fn causes(
    graph: &Graph,
    ledgers: &[Ledger],
    gaps: &[GapRecord],
    faults: &[FaultRecord],
    is_whole: bool,
    ended: Time,
) -> Vec<FaultRecord> {
    let is_whole = is_whole && !faults.iter().any(|it| it.blame == Blame::Program);
    let mut nodes = tallies(graph, ledgers, gaps);
    let role = |it: &Tally| graph.instances[it.instance].node_type.role;
    for node in &mut nodes {
        let is_input = matches!(role(node), Role::Source | Role::Detector);
        node.is_cause = is_input && node.has_outputs && node.given == 0 && node.gaps > 0;
    }
    for sink in 0..nodes.len() {
        if is_whole
            && role(&nodes[sink]) == Role::Sink
            && nodes[sink].taken == 0
            && let Some(cause) = cause(&nodes, sink)
        {
            nodes[cause].is_cause = true;
            nodes[cause].starved.push(sink);
        }
    }
    let name = |it: usize| without_camera(&graph.instances[nodes[it].instance].path);
    let is_known = |it: &Tally| {
        let name = without_camera(&graph.instances[it.instance].path);
        faults.iter().any(|it| without_camera(&it.instance) == name)
    };
    let record = |it: &Tally| {
        let mut message = "delivered nothing in the whole run".to_owned();
        if let Some((count, reason)) = &it.reason {
            message += &format!(": {reason} ({count} of {} gaps)", it.gaps);
        }
        if !it.starved.is_empty() {
            let sinks: Vec<String> = it.starved.iter().map(|it| format!("`{}`", name(*it))).collect();
            message += &format!("; so {} received nothing", sinks.join(", "));
        }
        let instance = graph.instances[it.instance].path.clone();
        FaultRecord { instance, blame: Blame::Input, message, action: "the others went on", time: ended, count: 1 }
    };
    nodes.iter().filter(|it| it.is_cause && !is_known(it)).map(record).collect()
}

fn without_camera(path: &str) -> &str {
    path.split('[').next().unwrap_or(path)
}

fn tallies(graph: &Graph, ledgers: &[Ledger], gaps: &[GapRecord]) -> Vec<Tally> {
    let mut numbers = BTreeMap::new();
    let mut nodes: Vec<Tally> = Vec::new();
    let number = |(index, it): (usize, &foveate_rig::graph::Instance)| {
        *numbers.entry((it.scale, it.node.clone())).or_insert_with(|| {
            nodes.push(Tally { instance: index, ..Tally::default() });
            nodes.len() - 1
        })
    };
    let of: Vec<usize> = graph.instances.iter().enumerate().map(number).collect();
    for (edge, ledger) in graph.edges.iter().zip(ledgers) {
        let (from, to) = (of[edge.from.0], of[edge.to.0]);
        nodes[from].has_outputs = true;
        nodes[from].given += ledger.delivered + ledger.dropped + ledger.suspended;
        if !edge.feedback {
            nodes[to].taken += ledger.delivered;
            nodes[to].suspended += ledger.suspended;
            nodes[to].producers.push(from);
        }
    }
    let places: BTreeMap<&str, usize> =
        graph.instances.iter().zip(&of).map(|(it, of)| (it.path.as_str(), *of)).collect();
    for gap in gaps {
        let Some(node) = places.get(gap.instance.as_str()).map(|it| &mut nodes[*it]) else { continue };
        node.gaps += gap.count;
        if node.reason.as_ref().is_none_or(|it| gap.count > it.0) {
            node.reason = Some((gap.count, gap.reason.clone()));
        }
    }
    nodes
}

/// Why `node` took nothing; `None` where it was held up, where what was sent to it was dropped, or where nothing leads to it.
fn cause(nodes: &[Tally], node: usize) -> Option<usize> {
    if nodes[node].suspended > 0 {
        return None;
    }
    let producers = nodes[node].producers.iter().filter(|it| nodes[**it].given == 0);
    let roots = producers.filter_map(|&it| match nodes[it].taken > 0 || nodes[it].producers.is_empty() {
        true => Some(it),
        false => cause(nodes, it),
    });
    roots.min()
}
