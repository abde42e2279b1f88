//! Worker threads on the wall clock. A camera's nodes share a worker; what joins cameras has one of its own.
//!
//! The run is over when no source will give any more and no message is on its way: every message on a queue between
//! threads is counted before it is sent and until all that it caused has been sent in turn.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, RecvTimeoutError, Sender, bounded};
use foveate_messages::{Interval, Time};

use super::slot::Route;
use super::stage::{Alone, Away, Costs, Stage};
use super::{EdgeView, Options, Outcome, PROGRESS_PERIOD, Progress, conclude, view_edges};
use foveate_node::error::NodeError;
use foveate_node::io::Packet;
use foveate_node::node::Due;
use foveate_rig::graph::Graph;

/// Longest sleep of a worker without anything to do: bounds how late it sees the end of the run.
const LONGEST_SLEEP: Duration = Duration::from_millis(20);
/// Pause of a producer that meets a full queue whose policy is to wait.
const FULL_PAUSE: Duration = Duration::from_micros(50);
/// Pause before a device that has nothing yet is asked again.
const WAITING_PAUSE: Duration = Duration::from_millis(1);

/// What the workers share.
struct Shared {
    started: Instant,
    stop: Arc<AtomicBool>,
    /// Sources that may still give something.
    live_sources: AtomicUsize,
    /// Messages between threads, from before they are sent until all that they caused was sent.
    in_flight: AtomicUsize,
    /// One token each: "look at your queues".
    wake: Vec<Sender<()>>,
    views: Mutex<Vec<EdgeView>>,
}

impl Shared {
    fn now(&self) -> Time {
        Time(self.started.elapsed().as_nanos() as i64)
    }

    fn is_over(&self) -> bool {
        self.live_sources.load(Ordering::SeqCst) == 0 && self.in_flight.load(Ordering::SeqCst) == 0
    }

    fn wake_all(&self) {
        for it in &self.wake {
            let _ = it.try_send(()); // full: a token is there already
        }
    }
}

/// One worker's side of the queues between threads.
struct Post {
    shared: Arc<Shared>,
    /// By edge: the worker of its consumer.
    worker_of_edge: Arc<Vec<usize>>,
    incoming: Vec<(usize, Receiver<Packet>)>,
    /// Messages taken off the incoming queues whose consequences are not all sent yet.
    accepted: usize,
}

impl Post {
    /// Moves all that has come in to the ports of its consumers.
    fn accept(&mut self, stage: &mut Stage, now: Time) {
        for (edge, receiver) in &self.incoming {
            // No more than stood there at first: a producer that is quicker than this must not keep it here for ever.
            for _ in 0..receiver.len() {
                let Ok(packet) = receiver.try_recv() else { break };
                self.accepted += 1;
                stage.deliver(*edge, packet, now);
            }
        }
    }

    /// All consequences of what was accepted have been sent.
    fn settle(&mut self) {
        if self.accepted > 0 {
            self.shared.in_flight.fetch_sub(std::mem::take(&mut self.accepted), Ordering::SeqCst);
            if self.shared.is_over() {
                self.shared.wake_all();
            }
        }
    }
}

impl Away for Post {
    fn sending(&mut self, _edge: usize) {
        self.shared.in_flight.fetch_add(1, Ordering::SeqCst);
    }

    fn sent(&mut self, edge: usize) {
        let _ = self.shared.wake[self.worker_of_edge[edge]].try_send(()); // full: a token is there already
    }

    fn taken_back(&mut self, _edge: usize) {
        self.shared.in_flight.fetch_sub(1, Ordering::SeqCst);
    }

    fn wait(&mut self, stage: &mut Stage) -> bool {
        self.accept(stage, self.shared.now());
        std::thread::sleep(FULL_PAUSE);
        true
    }
}

pub(super) fn run(
    graph: Arc<Graph>,
    options: &Options,
    observe: &mut dyn FnMut(&Progress),
) -> Result<Outcome, NodeError> {
    let mut whole = Stage::build(Arc::clone(&graph), options.out_dir.clone(), Costs::Ignored)?;
    let cores = std::thread::available_parallelism().map_or(2, usize::from);
    let worker_of = assign_workers(&graph, options.workers.unwrap_or(cores + 1).max(1));
    let n_workers = worker_of.iter().max().map_or(1, |most| most + 1);
    let worker_of_edge: Arc<Vec<usize>> = Arc::new(graph.edges.iter().map(|edge| worker_of[edge.to.0]).collect());

    // What is due at the very start is done before the clock runs: simulated worlds, rooms and files are being opened.
    for index in 0..graph.instances.len() {
        if whole.due(index, Time::ZERO) == Due::At(Time::ZERO) {
            whole.turn_source(index, Time::ZERO, &mut Alone);
        }
    }

    let incoming = cut_edges(&graph, &mut whole, &worker_of);
    let (wake, woken): (Vec<_>, Vec<_>) = (0..n_workers).map(|_| bounded::<()>(1)).unzip();
    let live_sources: Vec<bool> =
        (0..graph.instances.len()).map(|index| whole.due(index, Time::ZERO) != Due::Never).collect();
    let shared = Arc::new(Shared {
        started: Instant::now(),
        stop: Arc::clone(&options.stop),
        live_sources: AtomicUsize::new(live_sources.iter().filter(|&&it| it).count()),
        in_flight: AtomicUsize::new(0),
        wake,
        views: Mutex::new(vec![EdgeView::default(); graph.edges.len()]),
    });

    let mut workers: Vec<Worker> = woken
        .into_iter()
        .map(|woken| Worker {
            graph: Arc::clone(&graph),
            stage: whole.empty_like(),
            post: Post {
                shared: Arc::clone(&shared),
                worker_of_edge: Arc::clone(&worker_of_edge),
                incoming: Vec::new(),
                accepted: 0,
            },
            woken,
            sources: Vec::new(),
        })
        .collect();
    workers.iter_mut().for_each(|it| it.stage.started = Some(shared.started));
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
        workers[worker_of_edge[edge]].post.incoming.push((edge, receiver));
    }

    let stages = std::thread::scope(|scope| {
        let threads: Vec<_> = workers.into_iter().map(|worker| scope.spawn(move || worker.work())).collect();
        while threads.iter().any(|it| !it.is_finished()) {
            std::thread::sleep(if shared.is_over() { Duration::from_millis(1) } else { PROGRESS_PERIOD / 4 });
            let edges = shared.views.lock().unwrap_or_else(PoisonError::into_inner).clone();
            observe(&Progress { now: shared.now(), wall: shared.started.elapsed(), edges });
        }
        threads.into_iter().map(|it| it.join()).collect::<Vec<_>>()
    });
    let ended = shared.now();
    for stage in stages {
        let mut stage = stage.map_err(|payload| NodeError::program(super::faults::panic_text(&*payload)))?;
        gather(&mut whole, &mut stage);
    }
    let interrupted = options.must_stop();
    let mut outcome = conclude(&graph, whole, ended, shared.started.elapsed(), interrupted);
    if let Some(costly) = graph.instances.iter().find(|it| it.cost.time > Interval(0)) {
        outcome.report.remark(format!(
            "`cost_ms` (of `{}`) is ignored in a live run: a turn takes the time it takes",
            costly.path
        ));
    }
    Ok(outcome)
}

/// Nodes of one camera share a worker; nodes without a camera are on worker 0; cameras take turns over the others.
fn assign_workers(graph: &Graph, n_workers: usize) -> Vec<usize> {
    let others = n_workers.saturating_sub(1);
    let worker = |camera: usize| if others == 0 { 0 } else { 1 + camera % others };
    graph.instances.iter().map(|it| it.camera.map_or(0, |camera| worker(usize::from(camera.0)))).collect()
}

/// Puts a bounded queue into each edge whose ends are on different workers; gives the receiving ends.
fn cut_edges(graph: &Graph, whole: &mut Stage, worker_of: &[usize]) -> Vec<(usize, Receiver<Packet>)> {
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
            *route = Route::Away { edge, sender, receiver, when_full: ends.queue.when_full, dropped: 0 };
        }
    }
    incoming
}

/// Puts a worker's nodes and ledgers back into the whole, with what its queues dropped entered where it belongs.
fn gather(whole: &mut Stage, stage: &mut Stage) {
    for (place, slot) in whole.slots.iter_mut().zip(&mut stage.slots) {
        if let Some(mut slot) = slot.take() {
            for route in slot.routes_mut() {
                if let Route::Away { edge, dropped, .. } = *route {
                    whole.queue_drops.push((edge, dropped));
                    *route = Route::Here(edge);
                }
            }
            *place = Some(slot);
        }
    }
    for (place, end) in whole.ends.iter_mut().zip(&mut stage.ends) {
        if let Some(end) = end.take() {
            *place = Some(end);
        }
    }
    whole.faults.absorb(std::mem::take(&mut stage.faults));
    whole.settle_queue_drops();
}

struct Worker {
    graph: Arc<Graph>,
    stage: Stage,
    post: Post,
    woken: Receiver<()>,
    sources: Vec<usize>,
}

impl Worker {
    fn work(mut self) -> Stage {
        let shared = Arc::clone(&self.post.shared);
        let mut due = BinaryHeap::new();
        for index in std::mem::take(&mut self.sources) {
            self.ask(index, shared.now(), &mut due);
        }
        let mut last_shown = Instant::now();
        while !shared.is_over() {
            if shared.stop.load(Ordering::Relaxed) && !due.is_empty() {
                shared.live_sources.fetch_sub(due.len(), Ordering::SeqCst);
                due.clear();
                shared.wake_all();
            }
            let now = shared.now();
            self.post.accept(&mut self.stage, now);
            self.stage.run_ready(now, &mut self.post);
            self.post.settle();
            while let Some(&Reverse((time, index, is_waiting))) = due.peek()
                && time <= shared.now()
            {
                due.pop();
                let now = shared.now();
                if !is_waiting {
                    self.stage.turn_source(index, now, &mut self.post);
                }
                self.ask(index, now, &mut due);
                if !self.woken.is_empty() {
                    break; // what came in goes first: sources that cannot keep up must not starve the rest
                }
            }
            if last_shown.elapsed() >= PROGRESS_PERIOD {
                last_shown = Instant::now();
                let mut views = shared.views.lock().unwrap_or_else(PoisonError::into_inner);
                view_edges(&self.graph, &self.stage, &mut views);
            }
            let until_due = due.peek().map_or(i64::MAX, |Reverse((time, ..))| (*time - shared.now()).0.max(0));
            let sleep = LONGEST_SLEEP.min(Duration::from_nanos(until_due.unsigned_abs()));
            if !sleep.is_zero() {
                match self.woken.recv_timeout(sleep) {
                    Ok(()) | Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => {}
                }
            }
        }
        self.stage
    }

    /// Asks a source when it wants its next turn, and enters that; a source that is through is counted off.
    fn ask(&mut self, index: usize, now: Time, due: &mut BinaryHeap<Reverse<(Time, usize, bool)>>) {
        let entry = match self.stage.due(index, now) {
            Due::At(time) if !self.graph.is_over(time) => (time, index, false),
            Due::Waiting if !self.graph.is_over(now) => (now + WAITING_INTERVAL, index, true),
            Due::At(_) | Due::Waiting | Due::Never => {
                self.post.shared.live_sources.fetch_sub(1, Ordering::SeqCst);
                if self.post.shared.is_over() {
                    self.post.shared.wake_all();
                }
                return;
            }
        };
        due.push(Reverse(entry));
    }
}

const WAITING_INTERVAL: foveate_messages::Interval = foveate_messages::Interval(WAITING_PAUSE.as_nanos() as i64);
