//! Budgets: ages are measured where each path ends, and judged when the run is over.
//!
//! The stamp of a message carries the capture time of what it was made from, so its age is the session time minus that of its stamp: at an output when it is given out, at an
//! input when it is delivered, as in the ledger of its edge. Ages are kept apart by the node whose stamps they are, as long as nodes pass stamps on: this is how each
//! camera has its own.

use foveate_messages::{SourceId, Stamp, Time};
use foveate_node::report::Report;
use foveate_rig::graph::{Budget, BudgetEnd, BudgetPort, Graph};

use crate::Unmet;
use crate::gates::Suspensions;
use crate::ledger::Histogram;
use crate::slot::{EdgeEnd, Slot};

foveate_node::figures! {
    pub const OF_BUDGETS;
    "budget.*.age_ms.{median,p99,max}": ms, low,
        "Age of information at the end of the budget of that number, from the capture of what it begins with, over the messages made of that; with the time from an actuator to its motor where it is stated; of the pair of instances with the greatest p99";
}

/// Ages of the messages at one port, by the node whose stamps they have.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Ages(Vec<(SourceId, Histogram)>);

impl Ages {
    /// Enters a message that is there at session time `now`.
    pub fn record(&mut self, stamp: Stamp, now: Time) {
        self.of(stamp.source).record((now - stamp.time).0.max(0) as u64);
    }

    fn of(&mut self, source: SourceId) -> &mut Histogram {
        let place = self.0.iter().position(|it| it.0 == source).unwrap_or_else(|| {
            self.0.push((source, Histogram::default()));
            self.0.len() - 1
        });
        &mut self.0[place].1
    }
}

/// Lets ages be measured where the budgets of `graph` end.
pub(crate) fn prepare(graph: &Graph, slots: &mut [Option<Slot>], ends: &mut [Option<EdgeEnd>]) {
    for BudgetEnd { instance, at } in graph.budgets.iter().flat_map(|it| &it.ends) {
        match at {
            BudgetPort::Output(port) => slots[*instance].iter_mut().for_each(|it| it.measure(*port)),
            BudgetPort::Input(edges) => {
                for &edge in edges {
                    ends[edge].iter_mut().for_each(|it| it.ledger.measure());
                }
            }
        }
    }
}

/// What a budget's messages have from one node's stamps at one end.
struct Measured {
    edge: String,
    /// Median, 99th percentile and maximum [s].
    age_s: [f64; 3],
}

/// Reports what was measured of each budget; gives those that were not met.
pub(crate) fn conclude(
    graph: &Graph,
    slots: &[Option<Slot>],
    ends: &[Option<EdgeEnd>],
    suspensions: &[Suspensions],
    report: &mut Report,
) -> Vec<Unmet> {
    let mut unmet = Vec::new();
    for (index, budget) in graph.budgets.iter().enumerate() {
        let number = index + 1;
        let mut worst: Option<[f64; 3]> = None;
        let mut n_measured = 0;
        for end in &budget.ends {
            let measured = measured(graph, budget, end, slots, ends);
            if measured.is_empty() {
                let scale = &graph.scales[graph.instances[end.instance].scale].name;
                let was_suspended = suspensions.iter().any(|it| it.scale == *scale && it.count > 0);
                let why = if was_suspended { ": its scale was suspended" } else { "" };
                let what = format!("nothing came that was made of it{why}");
                unmet.push(Unmet { edge: edge_name(graph, budget, end, None), what, must: budget.must });
            }
            n_measured += measured.len();
            for Measured { edge, age_s } in measured {
                if age_s[1] > budget.age_s {
                    unmet.push(Unmet { edge, what: too_old(budget, age_s[1]), must: budget.must });
                }
                if worst.is_none_or(|it| age_s[1] > it[1]) {
                    worst = Some(age_s);
                }
            }
        }
        let ages_ms = worst.map(|it| it.map(|age_s| age_s * 1e3));
        for (place, statistic) in ["median", "p99", "max"].into_iter().enumerate() {
            let value = ages_ms.map_or(f64::NAN, |it| it[place]);
            report.declared_figure(OF_BUDGETS, format!("budget.{number}.age_ms.{statistic}"), value);
        }
        if let Some([median, p99, max]) = ages_ms {
            let pairs = if n_measured > 1 { format!(" (greatest of {n_measured})") } else { String::new() };
            report.remark(format!(
                "budget {number}, {} -> {}: age {median:.3} ms (median), {p99:.3} ms (p99), {max:.3} ms (max){pairs}{}, promised at most {:.3} ms",
                budget.from,
                budget.to,
                to_motor(budget),
                budget.age_s * 1e3
            ));
        }
    }
    unmet
}

fn too_old(budget: &Budget, p99_s: f64) -> String {
    let (p99, limit) = (p99_s * 1e3, budget.age_s * 1e3);
    format!("age is {p99:.3} ms (p99){}, promised at most {limit:.3} ms", to_motor(budget))
}

/// Which part of the age is not measured but stated.
fn to_motor(budget: &Budget) -> String {
    let stated =
        format!(", of which {:.3} ms are from the arrival to the motor as its node states", budget.latency_s * 1e3);
    if budget.latency_s > 0.0 { stated } else { String::new() }
}

/// The ages at one end, for each node whose stamps the messages have; only of messages that were made of what the path begins with.
fn measured(
    graph: &Graph,
    budget: &Budget,
    end: &BudgetEnd,
    slots: &[Option<Slot>],
    ends: &[Option<EdgeEnd>],
) -> Vec<Measured> {
    let parts: Vec<&Ages> = match &end.at {
        BudgetPort::Output(port) => slots[end.instance].iter().filter_map(|it| it.ages(*port)).collect(),
        BudgetPort::Input(edges) => edges.iter().filter_map(|&it| ends[it].as_ref()?.ledger.ages()).collect(),
    };
    let mut all = Ages::default();
    for (source, ages) in parts.iter().flat_map(|it| &it.0) {
        if budget.has_origin(source.0 as usize) {
            all.of(*source).absorb(ages);
        }
    }
    let seconds = |ns: Option<u64>| ns.map_or(0.0, |it| it as f64 * 1e-9) + budget.latency_s;
    let of_source = |(source, ages): (SourceId, Histogram)| Measured {
        edge: edge_name(graph, budget, end, Some(source)),
        age_s: [ages.percentile(0.5), ages.percentile(0.99), ages.max()].map(seconds),
    };
    all.0.sort_by_key(|it| it.0.0);
    all.0.into_iter().map(of_source).collect()
}

/// "room.video[wide-1].image -> face.aim[ptz-1].commands"; without the first camera where the stamps do not tell it.
fn edge_name(graph: &Graph, budget: &Budget, end: &BudgetEnd, source: Option<SourceId>) -> String {
    let instance = |index: usize, named: &str| {
        let port = named.rsplit_once('.').map_or("", |it| it.1);
        format!("{}.{port}", graph.instances[index].path)
    };
    let camera = source.and_then(|it| graph.instances[it.0 as usize].camera);
    let begin = match budget.begins[..] {
        [only] => Some(only),
        _ => budget.begins.iter().copied().find(|&it| camera.is_some() && graph.instances[it].camera == camera),
    };
    let from = begin.map_or_else(|| budget.from.clone(), |it| instance(it, &budget.from));
    format!("{from} -> {}", instance(end.instance, &budget.to))
}
