//! Worker threads on the wall clock. A camera's nodes share a worker; what joins cameras has one of its own.
//!
//! The run is over when no source will give any more and no message is on its way: every message on a queue between
//! threads is counted before it is sent and until all that it caused has been sent in turn.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, Sender, bounded};
use foveate_messages::{Interval, Time};

use super::controls::Controls;
use super::slot::{Numbered, Route};
use super::stage::{Costs, Remote, Stage};
use super::watch::{Watch, left_behind, patience};
use super::{EdgeView, Options, Outcome, PROGRESS_PERIOD, Progress, conclude, remark_costs, view_edges};
use foveate_node::error::NodeError;
use foveate_node::guard::guarded;
use foveate_node::node::{Due, Role};
use foveate_rig::graph::{Graph, Instance};

/// Longest sleep of a worker without anything to do: bounds how late it sees the end of the run.
const LONGEST_SLEEP: Duration = Duration::from_millis(20);
/// Pause before a node that met a full queue whose policy is to wait tries again.
const FULL_PAUSE: Duration = Duration::from_micros(50);
/// How long a worker that is busy looks out for the next message before it sleeps. At 60 messages a second that is 1.5 % of a core.
const LOOKOUT: Duration = Duration::from_micros(250);
/// Looks between two looks at the clock.
const LOOKS_A_CLOCK: u32 = 32;
/// Pause before a device that has nothing yet is polled again.
const WAITING_PAUSE: Duration = Duration::from_millis(1);

/// What the workers share.
struct Shared {
    /// When the session began: once every worker has opened what is due at the very start.
    started: OnceLock<Instant>,
    /// Workers that have.
    n_ready: AtomicUsize,
    n_workers: usize,
    stop: Arc<AtomicBool>,
    /// Sources that may still give something.
    live_sources: AtomicUsize,
    /// Messages between threads, from before they are sent until all that they caused was sent.
    in_flight: AtomicUsize,
    /// A thread is lost: the run ends without what it still owes.
    is_abandoned: AtomicBool,
    /// One token each: "look at your queues".
    wake: Vec<Sender<()>>,
    views: Mutex<Vec<EdgeView>>,
}

impl Shared {
    fn now(&self) -> Time {
        self.started.get().map_or(Time::ZERO, |it| Time(it.elapsed().as_nanos() as i64))
    }

    fn is_over(&self) -> bool {
        let is_through = self.live_sources.load(Ordering::SeqCst) == 0 && self.in_flight.load(Ordering::SeqCst) == 0;
        is_through || self.is_abandoned.load(Ordering::SeqCst)
    }

    /// Whether no source will give anything any more.
    fn is_ending(&self) -> bool {
        self.stop.load(Ordering::Relaxed) || self.live_sources.load(Ordering::SeqCst) == 0
    }

    fn wake_all(&self) {
        for it in &self.wake {
            let _ = it.try_send(()); // full: a token is there already
        }
    }
}

/// One worker's side of the queues between threads.
struct Mailbox {
    shared: Arc<Shared>,
    /// By edge: the worker of its consumer.
    worker_of_edge: Arc<Vec<usize>>,
    incoming: Vec<(usize, Receiver<Numbered>)>,
    /// What was taken off them at once, to be delivered in the order of capture.
    batch: Vec<(usize, Numbered)>,
    /// Whether this worker keeps the run going, since a node of it is held up.
    is_holding: bool,
    /// Messages taken off the incoming queues whose consequences are not all sent yet.
    accepted: usize,
}

impl Mailbox {
    /// Moves all that has come in to the ports of its consumers.
    fn accept(&mut self, stage: &mut Stage, now: Time) {
        for (edge, receiver) in &self.incoming {
            if stage.is_full(*edge) {
                continue;
            }
            // No more than stood there at first: a producer that is quicker than this must not keep it here for ever.
            for _ in 0..receiver.len() {
                let Ok((number, packet)) = receiver.try_recv() else { break };
                stage.come(*edge, number, now);
                self.batch.push((*edge, (number, packet)));
            }
        }
        self.accepted += self.batch.len();
        if self.batch.len() > 1 {
            self.batch.sort_by_key(|it| it.1.1.stamp.time);
        }
        for (edge, (number, packet)) in self.batch.drain(..) {
            stage.deliver_numbered(edge, Some(number), packet, now);
        }
    }

    /// From now on until nothing is held up any more the run is not over: what stands before a node that is held up is counted nowhere.
    fn hold(&mut self) {
        if !self.is_holding {
            self.is_holding = true;
            self.shared.in_flight.fetch_add(1, Ordering::SeqCst);
        }
    }

    /// All consequences of what was accepted have been sent, or are held up.
    fn settle(&mut self, is_any_blocked: bool) {
        let mut done = std::mem::take(&mut self.accepted);
        if self.is_holding && !is_any_blocked {
            self.is_holding = false;
            done += 1;
        }
        if done > 0 {
            self.shared.in_flight.fetch_sub(done, Ordering::SeqCst);
            if self.shared.is_over() {
                self.shared.wake_all();
            }
        }
    }
}

impl Remote for Mailbox {
    fn sending(&mut self, _edge: usize) {
        self.shared.in_flight.fetch_add(1, Ordering::SeqCst);
    }

    fn sent(&mut self, edge: usize) {
        let _ = self.shared.wake[self.worker_of_edge[edge]].try_send(()); // full: a token is there already
    }

    fn taken_back(&mut self, _edge: usize) {
        self.shared.in_flight.fetch_sub(1, Ordering::SeqCst);
    }
}

pub(super) fn run(
    graph: Arc<Graph>,
    options: &Options,
    observe: &mut dyn FnMut(&Progress),
) -> Result<Outcome, NodeError> {
    let mut whole = Stage::build(Arc::clone(&graph), options.out_dir.clone(), Costs::Ignored)?.seen_by(options);
    let cores = std::thread::available_parallelism().map_or(2, usize::from);
    let worker_of = assign_workers(&graph, options.workers.unwrap_or(cores + 1).max(1));
    let n_workers = worker_of.iter().max().map_or(1, |most| most + 1);
    let worker_of_edge: Arc<Vec<usize>> = Arc::new(graph.edges.iter().map(|edge| worker_of[edge.to.0]).collect());

    let incoming = cut_edges(&graph, &mut whole, &worker_of);
    let (wake, woken): (Vec<_>, Vec<_>) = (0..n_workers).map(|_| bounded::<()>(1)).unzip();
    let live_sources: Vec<bool> =
        (0..graph.instances.len()).map(|index| whole.due(index, Time::ZERO) != Due::Never).collect();
    let shared = Arc::new(Shared {
        started: OnceLock::new(),
        n_ready: AtomicUsize::new(0),
        n_workers,
        stop: Arc::clone(&options.stop),
        live_sources: AtomicUsize::new(live_sources.iter().filter(|&&it| it).count()),
        in_flight: AtomicUsize::new(0),
        is_abandoned: AtomicBool::new(false),
        wake,
        views: Mutex::new(vec![EdgeView::default(); graph.edges.len()]),
    });

    let mut workers: Vec<Worker> = woken
        .into_iter()
        .map(|woken| Worker {
            graph: Arc::clone(&graph),
            stage: whole.empty_like(),
            mailbox: Mailbox {
                shared: Arc::clone(&shared),
                worker_of_edge: Arc::clone(&worker_of_edge),
                incoming: Vec::new(),
                batch: Vec::new(),
                accepted: 0,
                is_holding: false,
            },
            woken,
            sources: Vec::new(),
            controls: options.controls.clone(),
            with_ages: options.look.is_some(),
        })
        .collect();
    for (index, &worker) in worker_of.iter().enumerate() {
        workers[worker].stage.slots[index] = whole.slots[index].take();
        if live_sources[index] {
            workers[worker].sources.push(index);
        }
    }
    for (edge, &worker) in worker_of_edge.iter().enumerate() {
        workers[worker].stage.ends[edge] = whole.ends[edge].take();
    }
    for (edge, receiver) in incoming {
        workers[worker_of_edge[edge]].mailbox.incoming.push((edge, receiver));
    }

    let began = Instant::now();
    let mut watched: Vec<Watch> = workers.iter().map(|it| Watch::new(Arc::clone(&it.stage.at))).collect();
    // Not scoped: a thread that never comes back must not keep the run.
    let threads: Vec<_> = workers.into_iter().map(|worker| std::thread::spawn(move || worker.work())).collect();
    while threads.iter().zip(&watched).any(|it| !it.0.is_finished() && !it.1.is_lost()) {
        std::thread::sleep(if shared.is_over() { Duration::from_millis(1) } else { PROGRESS_PERIOD / 4 });
        let edges = shared.views.lock().unwrap_or_else(PoisonError::into_inner).clone();
        graph.host.tick(began.elapsed());
        observe(&Progress { now: shared.now(), wall: began.elapsed(), edges });
        let longest = patience(options.patience, shared.is_ending());
        for (watch, _) in watched.iter_mut().zip(&threads).filter(|it| !it.1.is_finished()) {
            let Some(index) = watch.stuck(longest) else { continue };
            whole.faults.failure(&graph.instances[index].path, shared.now(), &left_behind(longest), "left behind");
            shared.is_abandoned.store(true, Ordering::SeqCst);
            shared.wake_all();
        }
    }
    let ended = shared.now();
    for (thread, _) in threads.into_iter().zip(&watched).filter(|it| !it.1.is_lost()) {
        match thread.join() {
            Ok((mut stage, said)) => {
                whole.absorb(&mut stage);
                if let Some(said) = said {
                    whole.faults.failure("engine", ended, &NodeError::program(said), "the run ended");
                }
            }
            Err(_) => whole.faults.failure("engine", ended, &NodeError::program("a worker died"), "the run ended"),
        }
    }
    let interrupted = options.must_stop();
    let mut outcome = conclude(&graph, whole, ended, began.elapsed(), interrupted, options);
    remark_costs(&graph, &mut outcome);
    Ok(outcome)
}

/// Nodes of one camera share a worker; what joins cameras has one for each scale, and sinks, which wait for disks, have one of their own. Where
/// there are fewer workers, they are dealt out in turn.
fn assign_workers(graph: &Graph, n_workers: usize) -> Vec<usize> {
    let mut shared: Vec<(bool, usize)> = graph.instances.iter().filter(|it| it.camera.is_none()).map(group).collect();
    shared.sort_unstable();
    shared.dedup();
    // Half of the workers at most: the cameras' nodes have most to do.
    let n_shared = shared.len().clamp(1, n_workers.div_ceil(2));
    let n_others = n_workers - n_shared;
    let worker = |instance: &Instance| match instance.camera {
        Some(camera) if n_others > 0 => n_shared + usize::from(camera.0) % n_others,
        Some(_) => 0,
        None => shared.binary_search(&group(instance)).map_or(0, |place| place % n_shared),
    };
    graph.instances.iter().map(worker).collect()
}

/// What nodes without a camera share a worker by: sinks, or the scale.
fn group(instance: &Instance) -> (bool, usize) {
    let is_sink = instance.node_type.role == Role::Sink;
    (is_sink, if is_sink { 0 } else { instance.scale })
}

/// Puts a bounded queue into each edge whose ends are on different workers; gives the receiving ends.
fn cut_edges(graph: &Graph, whole: &mut Stage, worker_of: &[usize]) -> Vec<(usize, Receiver<Numbered>)> {
    let mut incoming = Vec::new();
    for slot in whole.slots.iter_mut().flatten() {
        for route in slot.routes_mut() {
            let Route::Here(edge) = *route else { continue };
            let ends = &graph.edges[edge];
            if worker_of[ends.from.0] == worker_of[ends.to.0] {
                continue;
            }
            let (sender, receiver) = bounded(ends.queue.capacity.max(1));
            incoming.push((edge, receiver.clone()));
            *route = Route::Remote { edge, sender, receiver, when_full: ends.queue.when_full, dropped: 0, sent: 0 };
        }
    }
    incoming
}

struct Worker {
    graph: Arc<Graph>,
    stage: Stage,
    mailbox: Mailbox,
    woken: Receiver<()>,
    sources: Vec<usize>,
    controls: Controls,
    /// Whether progress has the ages on each edge.
    with_ages: bool,
}

impl Worker {
    /// Works until the run is over; gives the stage back, and the words of a panic of the engine itself.
    fn work(mut self) -> (Stage, Option<String>) {
        let shared = Arc::clone(&self.mailbox.shared);
        let said = guarded(|| self.work_on()).err();
        if said.is_some() {
            shared.is_abandoned.store(true, Ordering::SeqCst);
            shared.wake_all();
        }
        (self.stage, said)
    }

    fn work_on(&mut self) {
        let shared = Arc::clone(&self.mailbox.shared);
        self.begin(&shared);
        let mut due = BinaryHeap::new();
        for index in std::mem::take(&mut self.sources) {
            self.ask(index, shared.now(), &mut due);
        }
        let mut last_shown = Instant::now();
        let mut is_lively = false;
        while !shared.is_over() {
            if shared.stop.load(Ordering::Relaxed) && !due.is_empty() {
                shared.live_sources.fetch_sub(due.len(), Ordering::SeqCst);
                due.clear();
                shared.wake_all();
            }
            let now = shared.now();
            if self.controls.is_waiting() {
                self.stage.make_changes(&self.controls, now);
            }
            self.catch_up(now);
            while let Some(&Reverse((time, index, is_waiting))) = due.peek()
                && time <= shared.now()
            {
                due.pop();
                let now = shared.now();
                if self.stage.is_blocked(index) {
                    due.push(Reverse((now + FULL_INTERVAL, index, is_waiting)));
                    continue;
                }
                if !is_waiting {
                    self.stage.activate_source(index, now, &mut self.mailbox);
                }
                self.ask(index, now, &mut due);
                if !self.woken.is_empty() {
                    break; // what came in goes first: sources that cannot keep up must not starve the rest
                }
            }
            if last_shown.elapsed() >= PROGRESS_PERIOD {
                last_shown = Instant::now();
                let mut views = shared.views.lock().unwrap_or_else(PoisonError::into_inner);
                view_edges(&self.graph, &self.stage, &mut views, self.with_ages);
            }
            let until_due = due.peek().map_or(i64::MAX, |Reverse((time, ..))| (*time - shared.now()).0.max(0));
            self.stage.rest();
            let longest = if self.stage.is_any_blocked() { FULL_PAUSE } else { LONGEST_SLEEP };
            let sleep = longest.min(Duration::from_nanos(until_due.unsigned_abs()));
            if !sleep.is_zero() {
                is_lively = self.rest(sleep, is_lively);
            }
        }
    }

    /// Works on all that has come in.
    fn catch_up(&mut self, now: Time) {
        // First, so that what stands before a node that was held up is accepted now, and not after the next sleep.
        if self.stage.is_any_blocked() {
            self.mailbox.hold();
            self.stage.unblock(now, &mut self.mailbox);
        }
        self.mailbox.accept(&mut self.stage, now);
        self.stage.run_ready(now, &mut self.mailbox);
        self.mailbox.settle(self.stage.is_any_blocked());
    }

    /// Waits for messages, at most for `longest`. A worker that was just woken by one looks out for the next one for a while before it goes to
    /// sleep, since to be woken takes longer than most activations; one that is idle burns no core. Gives whether a message came.
    fn rest(&self, longest: Duration, is_lively: bool) -> bool {
        if is_lively {
            let began = Instant::now();
            while began.elapsed() < LOOKOUT.min(longest) {
                for _ in 0..LOOKS_A_CLOCK {
                    if self.woken.try_recv().is_ok() {
                        return true;
                    }
                    std::hint::spin_loop();
                }
            }
        }
        self.woken.recv_timeout(longest).is_ok()
    }

    /// What is due at the very start is done before the clock runs: devices, simulated worlds and files are being opened.
    fn begin(&mut self, shared: &Shared) {
        for index in self.sources.clone() {
            if self.stage.due(index, Time::ZERO) == Due::At(Time::ZERO) {
                self.stage.activate_source(index, Time::ZERO, &mut self.mailbox);
            }
        }
        self.stage.rest();
        if shared.n_ready.fetch_add(1, Ordering::SeqCst) + 1 == shared.n_workers {
            let _ = shared.started.set(Instant::now()); // only the last one comes here
        }
        while shared.started.get().is_none() && !shared.is_abandoned.load(Ordering::SeqCst) {
            // What others give out at the start must find room.
            self.catch_up(Time::ZERO);
            self.stage.rest();
            std::thread::sleep(FULL_PAUSE);
        }
        self.stage.started = shared.started.get().copied();
    }

    /// Asks a source when it wants its next activation, and enters that; a source that is through is counted off.
    fn ask(&mut self, index: usize, now: Time, due: &mut BinaryHeap<Reverse<(Time, usize, bool)>>) {
        let entry = match self.stage.due(index, now) {
            Due::At(time) if !self.graph.is_over(time) => (time, index, false),
            Due::Waiting if !self.graph.is_over(now) => (now + WAITING_INTERVAL, index, true),
            Due::At(_) | Due::Waiting | Due::Never => {
                self.mailbox.shared.live_sources.fetch_sub(1, Ordering::SeqCst);
                if self.mailbox.shared.is_over() {
                    self.mailbox.shared.wake_all();
                }
                return;
            }
        };
        due.push(Reverse(entry));
    }
}

const FULL_INTERVAL: Interval = Interval(FULL_PAUSE.as_nanos() as i64);
const WAITING_INTERVAL: Interval = Interval(WAITING_PAUSE.as_nanos() as i64);
