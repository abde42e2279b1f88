//! Running a checked graph: deterministic (simulated and file-fed, one logical clock) or live (worker threads, wall clock).
//!
//! Both engines run the same fused stages: a message is carried through all nodes that it triggers before the
//! next one is looked at. Queues stand only where a message changes threads.

mod budget;
mod busy;
pub mod controls;
mod deterministic;
mod dry;
mod faults;
mod gates;
mod helpers;
mod inbox;
mod lanes;
pub mod ledger;
mod live;
pub mod look;
mod pace;
mod primitives;
mod replay;
mod rounds;
mod slot;
mod stage;
pub mod tap;
mod watch;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use foveate_messages::{Interval, Time};

pub use budget::OF_BUDGETS;
pub use faults::{FaultRecord, GapRecord};
pub(crate) use gates::Gate;
pub use gates::{SuspensionSpan, Suspensions};
pub use replay::{Feed, Source};

use crate::ledger::Ledger;
use controls::Controls;
use foveate_node::error::{Blame, NodeError};
use foveate_node::report::Report;
use foveate_rig::graph::Graph;
use look::Look;
use stage::Stage;
use tap::{Event, Tap};

foveate_node::figures! {
    pub const OF_SCALES;
    "scale.suspensions.*": count, low, "Times that the scale of that name had lost its target, or had not found it yet";
    "scale.suspended_s.*": s, low, "Session time in which the scale of that name was without its target";
}

/// How often progress is shown.
const PROGRESS_PERIOD: Duration = Duration::from_millis(200);

/// How to run.
#[derive(Clone, Default)]
pub struct Options {
    /// Folder for results; must exist. `None`: nothing is written.
    pub out_dir: Option<PathBuf>,
    /// Set from outside (Ctrl-C) to end the run; what was recovered is still finished and saved.
    pub stop: Arc<AtomicBool>,
    /// Worker threads; `None`: one for each core, and in a live run one more for what joins cameras. A run that is not live gives the same bytes
    /// with any number of them.
    pub workers: Option<usize>,
    /// A run that is not live lets nothing happen before its time on the wall clock, counted from the start of the run.
    pub paced: bool,
    /// A run abandons a node that does not return from an activation within this time once the run should end; `None`: ten seconds. While
    /// the run goes on it waits six times as long.
    pub patience: Option<Duration>,
    /// The run has a time limit; a sink that got nothing is then no failure.
    pub is_cut_short: bool,
    /// Where the run is recorded, if it is.
    pub tap: Option<Tap>,
    /// Where viewers look into the run, if any may.
    pub look: Option<Look>,
    /// Settings that people change while the run goes on, and how far it goes.
    pub controls: Controls,
}

impl Options {
    fn must_stop(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// Progress of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Progress {
    /// Session time.
    pub now: Time,
    /// Time since the start.
    pub wall: Duration,
    /// What each edge measured so far, in the graph's order.
    pub edges: Vec<EdgeView>,
}

/// One edge at one moment.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct EdgeView {
    /// Messages delivered.
    pub delivered: u64,
    /// Deliveries a second [Hz].
    pub rate_hz: Option<f64>,
    /// Things in the last sampled payload.
    pub count: Option<u32>,
    /// Whether its requirement is unmet so far.
    pub unmet: bool,
    /// Messages that should have been there and never were.
    pub gaps: u64,
    /// Messages lost in a queue, or passed over.
    pub dropped: u64,
    /// Messages captured earlier than one of the same source that came before.
    pub late: u64,
    /// Age at delivery: median, 99th percentile, greatest [s]; only where viewers may look into the run.
    pub age_s: Option<[f64; 3]>,
}

/// The outcome of a run.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// Figures and files of the nodes.
    pub report: Report,
    /// What each edge measured, in the graph's order.
    pub ledgers: Vec<Ledger>,
    /// Requirements and budgets that were not met.
    pub unmet: Vec<Unmet>,
    /// Failures of nodes.
    pub faults: Vec<FaultRecord>,
    /// Missing data that nodes declared.
    pub gaps: Vec<GapRecord>,
    /// When scales were without their target.
    pub suspensions: Vec<Suspensions>,
    /// Session time at the end.
    pub ended: Time,
    /// Wall time from start to end.
    pub wall: Duration,
    /// Ended from outside.
    pub interrupted: bool,
}

/// A requirement that was not met.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Unmet {
    /// The edge; of a budget the ports at its ends.
    pub edge: String,
    /// What was measured and what was promised.
    pub what: String,
    /// Whether it was marked `must`.
    pub must: bool,
}

impl Outcome {
    /// Cause of the worst failure, if there was one.
    pub fn blame(&self) -> Option<Blame> {
        self.faults.iter().map(|it| it.blame).max()
    }
}

/// Runs on one logical clock: the same bytes for the same rig, seed and files on any number of threads, as fast as the machine can.
///
/// # Errors
/// A node that refuses to be made. Failures during the run are in the outcome.
pub fn deterministic(
    graph: Arc<Graph>,
    options: &Options,
    observe: &mut dyn FnMut(&Progress),
) -> Result<Outcome, NodeError> {
    deterministic::run(graph, options, observe)
}

/// Runs on worker threads and the wall clock: sources when they are due, queues between threads as the rig says.
///
/// # Errors
/// A node that refuses to be made. Failures during the run are in the outcome.
pub fn live(graph: Arc<Graph>, options: &Options, observe: &mut dyn FnMut(&Progress)) -> Result<Outcome, NodeError> {
    live::run(graph, options, observe)
}

/// Runs again what was recorded, in the recorded order and on one thread. Nodes that [`Source`] takes from the recording are not made: their messages come out of it.
/// All others work on what they got then, and a rig with the same settings gives the same bytes.
///
/// # Errors
/// A node that refuses to be made. Where a replay leaves the recording, the outcome says so as a failure of `replay`.
pub fn replay(
    graph: Arc<Graph>,
    sources: &[Source],
    feed: &mut dyn Feed,
    options: &Options,
    observe: &mut dyn FnMut(&Progress),
) -> Result<Outcome, NodeError> {
    replay::run(graph, sources, feed, options, observe)
}

/// Views of the edges whose consumers run on `stage`, written into `views`.
fn view_edges(graph: &Graph, stage: &Stage, views: &mut [EdgeView], with_ages: bool) {
    for ((end, edge), view) in stage.ends.iter().zip(&graph.edges).zip(views) {
        if let Some(end) = end {
            *view = EdgeView {
                delivered: end.ledger.delivered,
                rate_hz: end.ledger.rate_hz(),
                count: end.ledger.count(),
                gaps: end.ledger.gaps,
                dropped: end.ledger.dropped,
                late: end.ledger.late,
                age_s: if with_ages { end.ledger.ages_s() } else { None },
                unmet: edge
                    .require
                    .as_ref()
                    .is_some_and(|it| end.ledger.delivered > 0 && !end.ledger.unmet(it).is_empty()),
            };
        }
    }
}

/// Adds to the failures of nodes out of libraries which library that was.
fn name_libraries(graph: &Graph, faults: &mut [FaultRecord]) {
    for instance in &graph.instances {
        let library = instance.library_in_words();
        if !library.is_empty() {
            faults.iter_mut().filter(|it| it.instance == instance.path).for_each(|it| it.message.push_str(&library));
        }
    }
}

/// Part of the messages of an edge that may be dropped without a note.
const QUIET_DROPS: f64 = 0.01;

/// Says where messages were dropped since their consumer did not keep up.
fn remark_drops(graph: &Graph, ledgers: &[Ledger], report: &mut Report) {
    let of = |it: &Ledger| (it.dropped, it.dropped + it.delivered);
    let (dropped, all) = ledgers.iter().map(of).fold((0, 0), |sum, it| (sum.0 + it.0, sum.1 + it.1));
    let part = |it: &Ledger| it.dropped as f64 / (it.dropped + it.delivered).max(1) as f64;
    let worst = graph.edges.iter().zip(ledgers).max_by(|a, b| part(a.1).total_cmp(&part(b.1)));
    if let Some((edge, ledger)) = worst.filter(|it| part(it.1) > QUIET_DROPS) {
        report.remark(format!(
            "{dropped} of {all} messages were dropped because their consumers did not keep up; worst: {} of {} at {}",
            ledger.dropped,
            ledger.dropped + ledger.delivered,
            edge.name
        ));
    }
}

/// Says that a live run takes the time it takes.
fn remark_costs(graph: &Graph, outcome: &mut Outcome) {
    if let Some(costly) = graph.instances.iter().find(|it| it.cost.time > Interval(0)) {
        outcome.report.remark(format!(
            "`cost_ms` (of `{}`) is ignored in a live run: an activation takes the time it takes",
            costly.path
        ));
    }
}

/// Finishes all nodes and gathers what the run leaves behind.
fn conclude(
    graph: &Graph,
    mut stage: Stage,
    ended: Time,
    wall: Duration,
    interrupted: bool,
    options: &Options,
) -> Outcome {
    let mut report = Report::default();
    options.controls.end();
    stage.flush(ended);
    stage.finish(ended, &mut report);
    stage.note(ended, || Event::Ended { interrupted, is_cut_short: options.is_cut_short });
    let suspensions = stage.gates.conclude(ended);
    for it in &suspensions {
        report.declared_figure(OF_SCALES, format!("scale.suspensions.{}", it.scale), it.count as f64);
        report.declared_figure(OF_SCALES, format!("scale.suspended_s.{}", it.scale), it.time.as_s());
    }
    let over_budget = budget::conclude(graph, &stage.slots, &stage.ends, &suspensions, &mut report);
    let ledgers: Vec<Ledger> = stage.ends.into_iter().map(|end| end.map(|it| it.ledger).unwrap_or_default()).collect();
    remark_drops(graph, &ledgers, &mut report);
    let promises = graph.edges.iter().zip(&ledgers).filter_map(|(edge, ledger)| Some((edge, edge.require?, ledger)));
    let unmet = promises.flat_map(|(edge, promise, ledger)| {
        let sentences = ledger.unmet(&promise).into_iter();
        sentences.map(move |what| Unmet { edge: edge.name.clone(), what, must: promise.must })
    });
    let unmet = unmet.chain(over_budget).collect();
    let (mut faults, gaps) = stage.faults.into_records();
    let is_whole = !interrupted && !options.is_cut_short;
    faults.extend(dry::causes(graph, &ledgers, &gaps, &faults, is_whole, ended));
    name_libraries(graph, &mut faults);
    Outcome { report, ledgers, unmet, faults, gaps, suspensions, ended, wall, interrupted }
}
