//! Follows a recording: every node gets what it got then, in that order and at that time, and works on it again.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use foveate_messages::{Quality, Time};
use foveate_node::error::NodeError;
use foveate_node::io::{Io, Packet, Payload};
use foveate_node::node::Due;
use foveate_node::registry::ErasedNode;
use foveate_node::report::Report;
use foveate_rig::graph::Graph;

use crate::gates::is_anchor;
use crate::pace::Pace;
use crate::slot::Slot;
use crate::stage::recorded::Given;
use crate::stage::{Costs, Stage};
use crate::tap::{Entry, Event, Fate};
use crate::{EdgeView, Options, Outcome, PROGRESS_PERIOD, Progress, conclude, remark_costs, view_edges};

/// The wall clock is looked at once in so many events.
const EVENTS_PER_CLOCK_READ: u64 = 64;

/// Where the messages of a node come from in a replay.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// The node is made and works.
    Node,
    /// The node is not made; its messages come from the recording.
    Recording,
}

/// The events of a recording, in their order.
pub trait Feed {
    /// The next event; `None` at the end. Messages of nodes that are not made come with their payload where it was recorded.
    ///
    /// # Errors
    /// Where the recording cannot be read, and why.
    fn next(&mut self) -> Result<Option<Entry>, String>;
    /// Whether it was made on the wall clock.
    fn was_live(&self) -> bool;
}

/// What a message that was not recorded left behind: its stamp.
struct Absent;

impl Payload for Absent {
    fn quality(&self) -> Result<Quality, String> {
        Ok(Quality::default())
    }
    fn bulk(&self) -> Result<&[u8], String> {
        Ok(&[])
    }
}

type Said = Arc<Mutex<(Report, Option<NodeError>)>>;

/// Stands where a node was: takes all, gives nothing, and reports at the end what the node reported.
struct StandIn(Said);

impl ErasedNode for StandIn {
    fn process(&mut self, _: &mut Io<'_>) -> Result<(), NodeError> {
        Ok(())
    }
    fn due(&mut self) -> Due {
        Due::Never
    }
    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let (said, error) = std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner));
        *report = said;
        error.map_or(Ok(()), Err)
    }
}

pub(super) fn run(
    graph: Arc<Graph>,
    sources: &[Source],
    feed: &mut dyn Feed,
    options: &Options,
    observe: &mut dyn FnMut(&Progress),
) -> Result<Outcome, NodeError> {
    let started = Instant::now();
    let said: Vec<Said> = (0..graph.instances.len()).map(|_| Said::default()).collect();
    let stage = Stage::build_with(Arc::clone(&graph), options.out_dir.clone(), Costs::Ignored, &|index| match sources
        [index]
    {
        Source::Node => Slot::make(&graph, index, options.out_dir.clone()),
        Source::Recording => Ok(Box::new(StandIn(Arc::clone(&said[index])))),
    })?
    .seen_by(&Options { tap: None, ..options.clone() });
    let mut replay = Replay {
        stage,
        sources,
        said,
        given: (0..graph.instances.len()).map(|_| Given::default()).collect(),
        waiting: (0..graph.edges.len()).map(|_| VecDeque::new()).collect(),
        n_left: vec![0; graph.edges.len()],
        lost: vec![0; graph.edges.len()],
        graph: Arc::clone(&graph),
        now: Time::ZERO,
        end: None,
    };
    let mut pace = Pace::new(started);
    let mut views = vec![EdgeView::default(); graph.edges.len()];
    let mut last_shown = started;
    let mut n_events = 0_u64;
    let mut ended_by = None;
    while !options.must_stop() {
        let entry = match feed.next() {
            Ok(Some(entry)) => entry,
            Ok(None) => break,
            Err(what) => {
                ended_by = Some(what);
                break;
            }
        };
        while let Some(pause) = pace.pause(entry.now, options) {
            pace.sleep(pause, entry.now, options);
        }
        if options.controls.is_waiting() {
            options.controls.refuse("a replay in the recorded order keeps the recorded settings");
        }
        if let Err(what) = replay.follow(entry) {
            ended_by = Some(what);
            break;
        }
        n_events += 1;
        if n_events.is_multiple_of(EVENTS_PER_CLOCK_READ) && last_shown.elapsed() >= PROGRESS_PERIOD {
            last_shown = Instant::now();
            graph.host.tick(started.elapsed());
            view_edges(&graph, &replay.stage, &mut views, options.look.is_some());
            observe(&Progress { now: replay.now, wall: started.elapsed(), edges: views.clone() });
        }
    }
    if replay.end.is_none() {
        replay.break_off();
    }
    let Replay { mut stage, lost, now, end, .. } = replay;
    stage.lose(&lost);
    if let Some(what) = ended_by {
        stage.faults.failure("replay", now, &NodeError::input(what), "the replay ended");
    }
    let (interrupted, is_cut_short) = end.unwrap_or((options.must_stop(), true));
    let options = Options { is_cut_short, ..options.clone() };
    let mut outcome = conclude(&graph, stage, now, started.elapsed(), interrupted, &options);
    if feed.was_live() {
        remark_costs(&graph, &mut outcome);
    }
    Ok(outcome)
}

/// A message on its way along an edge.
struct Waiting {
    /// Which of those that were given out along the edge.
    number: u64,
    /// When it was given out, among all events.
    order: u64,
    packet: Packet,
}

struct Replay<'s> {
    graph: Arc<Graph>,
    stage: Stage,
    sources: &'s [Source],
    /// By instance: what a node that is not made reported.
    said: Vec<Said>,
    /// By instance: what it has given out and the recording has not mentioned yet.
    given: Vec<Given>,
    /// By edge: messages on their way.
    waiting: Vec<VecDeque<Waiting>>,
    /// By edge: messages that were given out along it.
    n_left: Vec<u64>,
    /// By edge: messages lost in queues between threads.
    lost: Vec<u64>,
    now: Time,
    /// How the recorded run ended: from outside, with a time limit.
    end: Option<(bool, bool)>,
}

impl Replay<'_> {
    fn is_made(&self, instance: usize) -> bool {
        self.sources[instance] == Source::Node
    }

    /// One step of the recording.
    fn follow(&mut self, entry: Entry) -> Result<(), String> {
        let now = entry.now;
        match entry.event {
            Event::Activated { instance, how } => {
                self.now = self.now.max(now);
                if !self.stage.repeat(instance, how, now, &mut self.given[instance]) {
                    return Err(self.differs(now, instance, "has no message to work on, and had one"));
                }
            }
            Event::Emitted { instance, port, stamp, packet, .. } => {
                let packet = if self.is_made(instance) {
                    match self.given[instance].packets.pop_front() {
                        Some((given, packet)) if given == port => packet,
                        Some(_) | None => {
                            let name = self.graph.instances[instance].node_type.ports.outputs[port].name;
                            let what = format!("does not give out a message at `{name}`, and did");
                            return Err(self.differs(now, instance, &what));
                        }
                    }
                } else {
                    packet.unwrap_or_else(|| Packet { stamp, payload: Arc::new(Absent) })
                };
                self.leave((instance, port), packet, now, entry.order);
            }
            Event::Gap { instance, port, gap } => {
                let gap = if self.is_made(instance) {
                    match self.given[instance].gaps.pop_front() {
                        Some((given, gap)) if given == port => gap,
                        Some(_) | None => return Err(self.differs(now, instance, "declares no gap, and did")),
                    }
                } else {
                    gap
                };
                self.stage.faults.gap(&self.graph.instances[instance].path, &gap);
            }
            Event::GapEntered { edge } => self.stage.repeat_gap(edge, now),
            Event::Delivered { edge, number, fate } => self.deliver(edge, number, fate, now)?,
            Event::Lost { edge, first, count } => {
                self.lost[edge] += count;
                self.waiting[edge].retain(|it| it.number < first || it.number >= first + count);
            }
            Event::Failed { instance, seen, error, action } => {
                if !self.is_made(instance) {
                    self.stage.faults.failure(&self.graph.instances[instance].path, seen, &error, action);
                    if action.starts_with("stopped") {
                        self.stage.stop(instance, seen);
                    }
                }
            }
            Event::Changed { instance, values } => {
                if self.is_made(instance) {
                    let changed = self.stage.change(instance, &values, now);
                    changed.map_err(|what| {
                        self.differs(now, instance, &format!("refuses settings ({what}), and took them"))
                    })?;
                }
            }
            Event::Ending => {
                self.now = now;
                self.stage.end_stopped(now);
            }
            Event::Finished { instance, mut report, error } => {
                // What it wrote is not in the recording.
                report.files.clear();
                report.open_first = None;
                *self.said[instance].lock().unwrap_or_else(PoisonError::into_inner) = (*report, error);
            }
            Event::Ended { interrupted, is_cut_short } => self.end = Some((interrupted, is_cut_short)),
        }
        Ok(())
    }

    /// Output `port` of a node gives out `packet`.
    fn leave(&mut self, (instance, port): (usize, usize), packet: Packet, now: Time, order: u64) {
        let (waiting, n_left) = (&mut self.waiting, &mut self.n_left);
        self.stage.leave((instance, port), &packet, now, |edge| {
            waiting[edge].push_back(Waiting { number: n_left[edge], order, packet: packet.clone() });
            n_left[edge] += 1;
        });
    }

    /// The recording breaks off: what was on its way then comes to its consumers, before anything else happens.
    fn break_off(&mut self) {
        for instance in 0..self.given.len() {
            let Given { packets, gaps } = std::mem::take(&mut self.given[instance]);
            gaps.iter().for_each(|(_, gap)| self.stage.faults.gap(&self.graph.instances[instance].path, gap));
            packets.into_iter().for_each(|(port, packet)| self.leave((instance, port), packet, self.now, u64::MAX));
        }
        let waiting = self.waiting.iter_mut().enumerate();
        let mut waiting: Vec<_> = waiting.flat_map(|(edge, it)| it.drain(..).map(move |it| (edge, it))).collect();
        waiting.sort_by_key(|(edge, it)| (it.order, *edge, it.number));
        waiting.into_iter().for_each(|(edge, it)| self.stage.deliver(edge, it.packet, self.now));
    }

    fn deliver(&mut self, edge: usize, number: u64, fate: Fate, now: Time) -> Result<(), String> {
        let (from, to) = (self.graph.edges[edge].from.0, self.graph.edges[edge].to.0);
        let place = self.waiting[edge].iter().position(|it| it.number == number);
        let Some(Waiting { packet, .. }) = place.and_then(|it| self.waiting[edge].remove(it)) else {
            return Err(self.differs(now, from, &format!("has not given out message {number} of {}", self.name(edge))));
        };
        if !self.stage.meet(edge, packet, fate, now) && self.is_made(to) {
            let what = if fate == Fate::Stopped { "works, and had stopped" } else { "has stopped, and had not" };
            return Err(self.differs(now, to, what));
        }
        Ok(())
    }

    fn name(&self, edge: usize) -> &str {
        &self.graph.edges[edge].name
    }

    fn differs(&self, now: Time, instance: usize, what: &str) -> String {
        let instance = &self.graph.instances[instance];
        let anchor = if is_anchor(instance) { " (the anchor of its scale)" } else { "" };
        format!(
            "{}{anchor} {what} in the recording, at {now}: the rig, a file that it reads or the program is not the same as then",
            instance.path
        )
    }
}
