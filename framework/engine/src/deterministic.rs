//! One logical clock, and an order that depends on nothing but the rig, on any number of threads.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use foveate_messages::{Interval, Time};

use super::lanes::{Helpers, Lanes, Left};
use super::stage::{Alone, Costs, Stage};
use super::{EdgeView, Options, Outcome, PROGRESS_PERIOD, Progress, conclude, view_edges};
use foveate_node::error::NodeError;
use foveate_node::guard::guarded;
use foveate_node::node::Due;
use foveate_rig::graph::Graph;

/// The wall clock is looked at once in so many activations of sources.
const ACTIVATIONS_PER_CLOCK_READ: u64 = 16;
/// Longest sleep of a paced run: bounds how late it sees that it is to be stopped.
const LONGEST_PAUSE: Duration = Duration::from_millis(50);
/// Pause before a source that has nothing yet is asked again.
const WAITING_PAUSE: Duration = Duration::from_millis(1);

pub(super) fn run(
    graph: Arc<Graph>,
    options: &Options,
    observe: &mut dyn FnMut(&Progress),
) -> Result<Outcome, NodeError> {
    let started = Instant::now();
    let mut main = Stage::build(Arc::clone(&graph), options.out_dir.clone(), Costs::Simulated)?;
    let lanes = Lanes::take_from(&mut main, &graph);
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let until = Mutex::new(Time::ZERO);
    let mut helpers = Helpers::new(options.workers.unwrap_or(cores).max(1), &until);
    let ended = std::thread::scope(|scope| {
        for _ in 0..helpers.count() {
            let (work, lanes, graph) = (helpers.work(), &lanes, &*graph);
            scope.spawn(move || work(lanes, graph));
        }
        let mut events = Events::new(&graph, options, &mut main, &lanes, started);
        let ended = guarded(|| events.run(&mut helpers, observe));
        helpers.end();
        ended
    });
    let mut said = lanes.give_back(&mut main);
    // What was recovered is saved all the same.
    let (now, interrupted) = ended.unwrap_or_else(|it| {
        said.push(it);
        (main.latest(), false)
    });
    for said in said {
        main.faults.failure("engine", now, &NodeError::program(said), "the round ended");
    }
    Ok(conclude(&graph, main, now, started.elapsed(), interrupted))
}

/// What happens next, on the one logical clock.
struct Events<'r> {
    graph: &'r Graph,
    options: &'r Options,
    main: &'r mut Stage,
    lanes: &'r Lanes,
    started: Instant,
    now: Time,
    /// Sources by (due time, schedule order): ties are broken by the rig, not by chance.
    sources: BinaryHeap<Reverse<(Time, usize)>>,
    /// Sources that have nothing yet.
    waiting: Vec<usize>,
    /// What left lanes that are ahead, in the order of time.
    left: VecDeque<Left>,
}

impl<'r> Events<'r> {
    fn new(
        graph: &'r Graph,
        options: &'r Options,
        main: &'r mut Stage,
        lanes: &'r Lanes,
        started: Instant,
    ) -> Events<'r> {
        let (sources, waiting, left) = (BinaryHeap::new(), Vec::new(), VecDeque::new());
        Events { graph, options, main, lanes, started, now: Time::ZERO, sources, waiting, left }
    }

    /// Until no source gives anything any more; gives the time at the end and whether the run was stopped.
    fn run(&mut self, helpers: &mut Helpers<'_>, observe: &mut dyn FnMut(&Progress)) -> (Time, bool) {
        (0..self.graph.instances.len()).for_each(|it| self.ask(it));
        let mut last_shown = self.started;
        let mut activations = 0_u64;
        while !self.options.must_stop() {
            if !self.next(helpers) {
                return (self.now, false);
            }
            activations += 1;
            if activations.is_multiple_of(ACTIVATIONS_PER_CLOCK_READ) && last_shown.elapsed() >= PROGRESS_PERIOD {
                last_shown = Instant::now();
                let mut edges = vec![EdgeView::default(); self.graph.edges.len()];
                view_edges(self.graph, self.main, &mut edges);
                self.lanes.each(|stage| view_edges(self.graph, stage, &mut edges));
                observe(&Progress { now: self.now, wall: self.started.elapsed(), edges });
            }
        }
        // What lanes have seen already is not lost.
        while let Some((time, _, it)) = self.left.pop_front() {
            self.now = self.now.max(time);
            self.lanes.deliver(self.graph, it, self.now, self.main);
        }
        (self.now, true)
    }

    /// The next event; `false` after the last one.
    fn next(&mut self, helpers: &mut Helpers<'_>) -> bool {
        let due = self.sources.peek().map(|&Reverse((due, index))| (self.now.max(due), index));
        let left = self.left.front().map(|it| (it.0.max(self.now), it.1));
        let first = [due, left].into_iter().flatten().min();
        // A node that is done at the very moment at which a message comes is free for it.
        if let Some((done, _)) = self.main.next_done().filter(|it| first.is_none_or(|(time, _)| it.0 <= time)) {
            self.now = done;
            self.main.end_work(&mut Alone);
            self.lanes.take_in(self.graph, self.main, self.now);
            return true;
        }
        let Some((time, index)) = first else {
            if self.waiting.is_empty() {
                return false;
            }
            std::thread::sleep(WAITING_PAUSE);
            std::mem::take(&mut self.waiting).into_iter().for_each(|it| self.ask(it));
            return true;
        };
        // What left a source goes before its next activation.
        if left.is_some_and(|left| due.is_none_or(|due| left <= due)) {
            self.wait_until(time);
            if let Some((_, _, it)) = self.left.pop_front() {
                self.now = time;
                self.lanes.deliver(self.graph, it, time, self.main);
            }
            return true;
        }
        let Some(Reverse((due, _))) = self.sources.pop() else { return true };
        if self.graph.is_over(due) {
            return true;
        }
        if !self.lanes.may_be_ahead(index) {
            self.wait_until(time);
            self.now = time;
        }
        if self.lanes.has(index) {
            self.round(time, index, helpers);
        } else {
            self.main.activate_source(index, time, &mut Alone);
            self.lanes.take_in(self.graph, self.main, time);
            self.ask(index);
        }
        true
    }

    /// A round of lanes that begins with source `first` at `time`: of all lanes that may be ahead, as long as they may; otherwise of those whose sources
    /// are due at this moment.
    fn round(&mut self, time: Time, first: usize, helpers: &mut Helpers<'_>) {
        let is_ahead = self.lanes.may_be_ahead(first);
        let until = time + if is_ahead { self.lanes.shortest_lookahead() } else { Interval(1) };
        let mut sources = vec![(time, first)];
        let mut others = Vec::new();
        while let Some(&Reverse((due, index))) = self.sources.peek()
            && due < until
        {
            let is_like = self.lanes.has(index) && self.lanes.may_be_ahead(index) == is_ahead;
            if !is_like && !is_ahead {
                break;
            }
            self.sources.pop();
            match is_like && !self.graph.is_over(due) {
                true => sources.push((due.max(time), index)),
                false => others.push(Reverse((due, index))),
            }
        }
        self.sources.extend(others);
        let mut left = Vec::new();
        for (index, due) in self.lanes.round(self.graph, &sources, until, helpers, &mut left) {
            self.enqueue(index, due);
        }
        if is_ahead {
            // What is there already is earlier: it left an earlier round.
            self.left.extend(left);
            return;
        }
        for (_, _, it) in left {
            self.lanes.deliver(self.graph, it, time, self.main);
        }
    }

    /// Asks a source when it wants its next activation.
    fn ask(&mut self, index: usize) {
        let lanes = self.lanes;
        let due = if lanes.has(index) { lanes.due(index, self.now) } else { self.main.due(index, self.now) };
        self.enqueue(index, due);
    }

    fn enqueue(&mut self, index: usize, due: Due) {
        match due {
            Due::At(time) => self.sources.push(Reverse((time, index))),
            Due::Waiting => self.waiting.push(index),
            Due::Never => {}
        }
    }

    /// A paced run waits until the wall clock shows `time`, unless it is to be stopped before.
    fn wait_until(&self, time: Time) {
        while self.options.paced && !self.options.must_stop() {
            let ahead = time.0 - self.started.elapsed().as_nanos() as i64;
            if ahead <= 0 {
                return;
            }
            std::thread::sleep(LONGEST_PAUSE.min(Duration::from_nanos(ahead.unsigned_abs())));
        }
    }
}
