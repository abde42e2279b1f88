//! One logical clock, and an order that depends on nothing but the rig, on any number of threads.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use crossbeam::channel::{RecvTimeoutError, Sender, unbounded};
use foveate_messages::{Interval, Time};

use super::helpers::{Helpers, Kind};
use super::lanes::{Lanes, Left, lock, try_lock};
use super::pace::Pace;
use super::stage::{Alone, Costs, Outgoing, Stage};
use super::watch::{Watch, left_behind, patience};
use super::{EdgeView, Options, Outcome, PROGRESS_PERIOD, Progress, conclude, view_edges};
use foveate_node::error::NodeError;
use foveate_node::guard::guarded;
use foveate_node::node::Due;
use foveate_rig::graph::Graph;

/// The wall clock is looked at once in so many events.
const EVENTS_PER_CLOCK_READ: u64 = 16;
/// Pause before a source that has nothing yet is polled again.
const WAITING_PAUSE: Duration = Duration::from_millis(1);

/// How long an abandoned run waits for other work in progress.
const GRACE: Duration = Duration::from_secs(2);

/// What the thread that runs the graph shares with the monitoring thread.
struct Shared {
    /// All nodes that no lane has. Locked while they work.
    main: Mutex<Stage>,
    lanes: Arc<Lanes>,
    /// Session time [ns].
    now: AtomicI64,
    /// A thread is lost: the run ends without what it holds.
    is_abandoned: Arc<AtomicBool>,
}

pub(super) fn run(
    graph: Arc<Graph>,
    options: &Options,
    observe: &mut dyn FnMut(&Progress),
) -> Result<Outcome, NodeError> {
    let started = Instant::now();
    let mut main = Stage::build(Arc::clone(&graph), options.out_dir.clone(), Costs::Simulated)?.seen_by(options);
    let lanes = Arc::new(Lanes::take_from(&mut main, &graph));
    let mut whole = main.empty_like();
    let mut watched: Vec<Watch> = lanes.at().iter().chain([&main.at]).map(|it| Watch::new(Arc::clone(it))).collect();
    let shared =
        Arc::new(Shared { main: Mutex::new(main), lanes, now: AtomicI64::new(0), is_abandoned: Arc::default() });
    let (sender, progress) = unbounded();
    let mut events = Events::new(Arc::clone(&graph), options.clone(), Arc::clone(&shared), sender, started);
    // Not scoped: a thread that never comes back must not keep the run.
    let conductor = std::thread::spawn(move || {
        let ended = guarded(|| events.run());
        events.helpers.end();
        ended
    });
    let mut given_up: Option<Instant> = None;
    loop {
        graph.host.tick(started.elapsed());
        match progress.recv_timeout(PROGRESS_PERIOD / 4) {
            Ok(it) => observe(&it),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
        let longest = patience(options.patience, options.must_stop());
        for watch in &mut watched {
            let Some(index) = watch.stuck(longest) else { continue };
            let now = Time(shared.now.load(Ordering::Relaxed));
            whole.faults.failure(&graph.instances[index].path, now, &left_behind(longest), "left behind");
            shared.is_abandoned.store(true, Ordering::Relaxed);
            given_up = given_up.or(Some(Instant::now()));
        }
        // The others come back from what they are at, or are found to be lost as well.
        if given_up.is_some_and(|it| it.elapsed() > longest.min(GRACE)) {
            break;
        }
    }
    let mut said = Vec::new();
    let (mut now, mut is_interrupted) = (Time(shared.now.load(Ordering::Relaxed)), options.must_stop());
    if conductor.is_finished() || given_up.is_none() {
        match conductor.join() {
            Ok(Ok(ended)) => (now, is_interrupted) = ended,
            Ok(Err(it)) => said.push(it),
            Err(_) => said.push("a worker died".to_owned()),
        }
    }
    // What was recovered is saved all the same.
    if let Some(mut main) = try_lock(&shared.main) {
        whole.absorb(&mut main);
    }
    said.extend(shared.lanes.give_back(&mut whole));
    for said in said {
        whole.faults.failure("engine", now, &NodeError::program(said), "the run ended");
    }
    Ok(conclude(&graph, whole, now, started.elapsed(), is_interrupted, options))
}

/// A round of lanes that are ahead.
struct Round {
    from: Time,
    busy: Vec<(Duration, usize)>,
}

/// What happens next, on the one logical clock.
struct Events {
    graph: Arc<Graph>,
    options: Options,
    shared: Arc<Shared>,
    progress: Sender<Progress>,
    helpers: Helpers,
    started: Instant,
    pace: Pace,
    now: Time,
    /// The time of the last progress that was shown.
    shown: Time,
    /// Sources by (due time, schedule order): ties are broken by the rig, not by chance.
    sources: BinaryHeap<Reverse<(Time, usize)>>,
    /// Those of lanes that may be ahead.
    ahead: BinaryHeap<Reverse<(Time, usize)>>,
    /// Sources that have nothing yet.
    waiting: Vec<usize>,
    /// What left lanes that are ahead, in the order of time.
    left: VecDeque<Left>,
    under_way: Option<Round>,
    /// Lanes have been ahead before.
    is_begun: bool,
    views: Vec<EdgeView>,
}

impl Events {
    fn new(
        graph: Arc<Graph>,
        options: Options,
        shared: Arc<Shared>,
        progress: Sender<Progress>,
        started: Instant,
    ) -> Events {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let n_threads = options.workers.unwrap_or(cores).max(1);
        Events {
            helpers: Helpers::new(n_threads, &shared.lanes, &shared.is_abandoned),
            views: vec![EdgeView::default(); graph.edges.len()],
            graph,
            options,
            shared,
            progress,
            started,
            pace: Pace::new(started),
            now: Time::ZERO,
            shown: Time::ZERO,
            sources: BinaryHeap::new(),
            ahead: BinaryHeap::new(),
            waiting: Vec::new(),
            left: VecDeque::new(),
            under_way: None,
            is_begun: false,
        }
    }

    /// Runs until all sources are exhausted; returns the time at the end and whether the run was stopped.
    fn run(&mut self) -> (Time, bool) {
        (0..self.graph.instances.len()).for_each(|it| self.ask(it));
        let mut last_shown = self.started;
        let mut n_events = 0_u64;
        while !self.options.must_stop() && !self.is_abandoned() {
            if self.options.controls.is_waiting() {
                self.make_changes();
            }
            if !self.next() {
                return (self.now, false);
            }
            n_events += 1;
            if n_events.is_multiple_of(EVENTS_PER_CLOCK_READ) && last_shown.elapsed() >= PROGRESS_PERIOD {
                last_shown = Instant::now();
                self.show();
            }
        }
        // What lanes have seen already is not lost.
        self.end_round();
        while !self.is_abandoned()
            && let Some((time, _, it)) = self.left.pop_front()
        {
            self.go_on_to(self.now.max(time));
            self.deliver(it);
        }
        (self.now, self.options.must_stop())
    }

    fn is_abandoned(&self) -> bool {
        self.shared.is_abandoned.load(Ordering::Relaxed)
    }

    fn go_on_to(&mut self, time: Time) {
        self.now = time;
        self.shared.now.store(time.0, Ordering::Relaxed);
    }

    /// Lets the nodes work that no lane has, at the present time.
    fn on_main(&self, work: impl FnOnce(&mut Stage)) {
        self.shared.lanes.on_main(&self.shared.main, self.now, work);
    }

    fn deliver(&self, it: Outgoing) {
        self.shared.lanes.deliver(it, self.now, &self.shared.main);
    }

    fn show(&mut self) {
        self.shown = self.now;
        let (graph, views) = (&self.graph, &mut self.views);
        let with_ages = self.options.look.is_some();
        view_edges(graph, &lock(&self.shared.main), views, with_ages);
        self.shared.lanes.each(|stage| view_edges(graph, stage, views, with_ages));
        let progress = Progress { now: self.now, wall: self.started.elapsed(), edges: self.views.clone() };
        let _ = self.progress.send(progress); // nobody looks on any more: the run was given up
    }

    /// The next event; `false` after the last one.
    fn next(&mut self) -> bool {
        let due = self.sources.peek().map(|&Reverse((due, index))| (self.now.max(due), index));
        let left = self.left.front().map(|it| (it.0.max(self.now), it.1));
        let first = [due, left].into_iter().flatten().min();
        // A node that is done at the very moment at which a message comes is free for it.
        let done = lock(&self.shared.main).next_done().map(|it| it.0);
        let done = done.filter(|it| first.is_none_or(|(time, _)| *it <= time));
        let next = done.or(first.map(|it| it.0));
        if let Some(round) = &self.under_way {
            if next.is_none_or(|it| it >= round.from) {
                self.end_round();
                return true;
            }
        } else if let Some(from) = self.round_from(first, done, next) {
            self.begin_round(from);
            return true;
        }
        if let Some(done) = done {
            self.go_on_to(done);
            self.on_main(|main| main.end_work(&mut Alone));
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
                self.go_on_to(time);
                self.deliver(it);
            }
            return true;
        }
        let Some(Reverse((due, _))) = self.sources.pop() else { return true };
        if self.graph.is_over(due) {
            return true;
        }
        self.wait_until(time);
        self.go_on_to(time);
        if self.shared.lanes.has(index) {
            self.moment(index);
        } else {
            self.on_main(|main| main.activate_source(index, time, &mut Alone));
            self.ask(index);
        }
        true
    }

    /// When the next round of lanes that are ahead begins, if it is to begin now: when nothing else comes before, or when the rest is within its length of it
    /// (then what the rest gives is visible after its end only). `next`: when the rest goes on.
    fn round_from(&self, first: Option<(Time, usize)>, done: Option<Time>, next: Option<Time>) -> Option<Time> {
        let &Reverse((due, index)) = self.ahead.peek()?;
        let from = self.now.max(due);
        let lanes = &self.shared.lanes;
        let is_next = first.is_none_or(|it| (from, index) < it) && done.is_none_or(|it| from < it);
        let is_near = self.is_begun && next.is_some_and(|it| from <= it + lanes.round());
        (is_next || is_near).then_some(from)
    }

    fn begin_round(&mut self, from: Time) {
        let until = from + self.shared.lanes.round();
        let mut sources = Vec::new();
        while let Some(&Reverse((due, index))) = self.ahead.peek()
            && due < until
        {
            self.ahead.pop();
            if !self.graph.is_over(due) {
                sources.push((due.max(from), index));
            }
        }
        if !sources.is_empty() {
            let busy = self.shared.lanes.begin(&sources, until);
            self.helpers.begin(Kind::Ahead, &busy, until);
            self.under_way = Some(Round { from, busy });
            self.is_begun = true;
        }
    }

    /// Waits for the round of lanes that are ahead that is under way, and takes what left it.
    fn end_round(&mut self) {
        let Some(round) = self.under_way.take() else { return };
        if !self.helpers.join(Kind::Ahead) {
            return;
        }
        let mut left = Vec::new();
        for (index, due) in self.shared.lanes.end(&round.busy, &mut left) {
            self.enqueue(index, due);
        }
        // What is there already is earlier: it left an earlier round.
        self.left.extend(left);
    }

    /// A round of the lanes without lookahead whose sources are due at this moment; `first` is one of them.
    fn moment(&mut self, first: usize) {
        let (now, until) = (self.now, self.now + Interval(1));
        let mut sources = vec![(now, first)];
        while let Some(&Reverse((due, index))) = self.sources.peek()
            && due < until
            && self.shared.lanes.has(index)
        {
            self.sources.pop();
            if !self.graph.is_over(due) {
                sources.push((due.max(now), index));
            }
        }
        let lanes = Arc::clone(&self.shared.lanes);
        let busy = lanes.begin_moment(&sources);
        self.helpers.begin(Kind::Moment, &busy, until);
        if !self.helpers.join(Kind::Moment) {
            return;
        }
        let mut left = Vec::new();
        for (index, due) in lanes.end_moment(&busy, &mut left) {
            self.enqueue(index, due);
        }
        for (_, _, it) in left {
            self.deliver(it);
        }
    }

    /// Asks a source when it wants to be activated next.
    fn ask(&mut self, index: usize) {
        let lanes = &self.shared.lanes;
        let due = if lanes.has(index) {
            lanes.due(index, self.now)
        } else {
            let mut main = lock(&self.shared.main);
            let due = main.due(index, self.now);
            main.rest();
            due
        };
        self.enqueue(index, due);
    }

    fn enqueue(&mut self, index: usize, due: Due) {
        match due {
            Due::At(time) if self.shared.lanes.may_be_ahead(index) => self.ahead.push(Reverse((time, index))),
            Due::At(time) => self.sources.push(Reverse((time, index))),
            Due::Waiting => self.waiting.push(index),
            Due::Never => {}
        }
    }

    /// Waits until `time` may come: as the pace says, and as people hold the run.
    fn wait_until(&mut self, time: Time) {
        while let Some(pause) = self.pace.pause(time, &self.options) {
            if self.options.controls.held().is_some() && self.shown != self.now {
                self.show();
            }
            if self.options.controls.is_waiting() {
                self.make_changes();
            }
            self.pace.sleep(pause, time, &self.options);
        }
    }

    /// Makes the changes of settings that people want, while no lane is at work.
    fn make_changes(&mut self) {
        self.end_round();
        let controls = &self.options.controls;
        lock(&self.shared.main).make_changes(controls, self.now);
        self.shared.lanes.each_mut(|stage| stage.make_changes(controls, self.now));
    }
}
