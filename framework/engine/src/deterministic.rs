//! One logical clock, and an order that depends on nothing but the rig, on any number of threads.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use foveate_messages::Time;

use super::lanes::{Helpers, Lanes};
use super::stage::{Alone, Costs, Stage};
use super::{EdgeView, Options, Outcome, PROGRESS_PERIOD, Progress, conclude, view_edges};
use foveate_node::error::NodeError;
use foveate_node::guard::guarded;
use foveate_node::node::Due;
use foveate_rig::graph::Graph;

/// The wall clock is looked at once in so many turns of sources.
const TURNS_A_LOOK: u64 = 16;
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
    let mut helpers = Helpers::new(options.workers.unwrap_or(cores).max(1));
    let ended = std::thread::scope(|scope| {
        for _ in 0..helpers.count() {
            let (work, lanes) = (helpers.work(), &lanes);
            scope.spawn(move || work(lanes));
        }
        let ended = guarded(|| sources_in_turn(&graph, options, &mut main, &lanes, &mut helpers, started, observe));
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

/// Lets all sources take their turns; gives the time at the end and whether the run was stopped.
fn sources_in_turn(
    graph: &Graph,
    options: &Options,
    main: &mut Stage,
    lanes: &Lanes,
    helpers: &mut Helpers,
    started: Instant,
    observe: &mut dyn FnMut(&Progress),
) -> (Time, bool) {
    let mut now = Time::ZERO;
    // Sources by (due time, schedule order): ties are broken by the rig, not by chance.
    let mut sources = BinaryHeap::new();
    let mut waiting = Vec::new();
    for index in 0..graph.instances.len() {
        let due = if lanes.has(index) { lanes.due(index, now) } else { main.due(index, now) };
        enqueue(due, index, &mut sources, &mut waiting);
    }
    let mut last_shown = started;
    let mut turns = 0_u64;
    let mut round = Vec::new();
    loop {
        if options.must_stop() {
            return (now, true);
        }
        // A node that is done at the very moment at which a message comes is free for it.
        let first_due = sources.peek().map(|&Reverse((due, _))| now.max(due));
        if let Some((done, _)) = main.next_done().filter(|it| first_due.is_none_or(|due| it.0 <= due)) {
            now = done;
            main.end_work(&mut Alone);
            lanes.take_in(main, now);
            continue;
        }
        let Some(Reverse((due, index))) = sources.pop() else {
            if waiting.is_empty() {
                return (now, false);
            }
            std::thread::sleep(WAITING_PAUSE);
            for index in std::mem::take(&mut waiting) {
                let due = if lanes.has(index) { lanes.due(index, now) } else { main.due(index, now) };
                enqueue(due, index, &mut sources, &mut waiting);
            }
            continue;
        };
        if graph.is_over(due) {
            continue;
        }
        now = now.max(due);
        if options.paced {
            wait_until(now, started, options);
        }
        if lanes.has(index) {
            round.clear();
            round.push(index);
            while let Some(&Reverse((due, next))) = sources.peek()
                && due <= now
                && lanes.has(next)
            {
                round.push(next);
                sources.pop();
            }
            for (_, index, due) in lanes.round(&round, now, main, helpers) {
                enqueue(due, index, &mut sources, &mut waiting);
            }
        } else {
            main.turn_source(index, now, &mut Alone);
            lanes.take_in(main, now);
            enqueue(main.due(index, now), index, &mut sources, &mut waiting);
        }
        turns += 1;
        if turns.is_multiple_of(TURNS_A_LOOK) && last_shown.elapsed() >= PROGRESS_PERIOD {
            last_shown = Instant::now();
            let mut edges = vec![EdgeView::default(); graph.edges.len()];
            view_edges(graph, main, &mut edges);
            lanes.each(|stage| view_edges(graph, stage, &mut edges));
            observe(&Progress { now, wall: started.elapsed(), edges });
        }
    }
}

/// Waits until the wall clock shows `time`, unless the run is to be stopped before.
fn wait_until(time: Time, started: Instant, options: &Options) {
    loop {
        let ahead = time.0 - started.elapsed().as_nanos() as i64;
        if ahead <= 0 || options.must_stop() {
            return;
        }
        std::thread::sleep(LONGEST_PAUSE.min(Duration::from_nanos(ahead.unsigned_abs())));
    }
}

fn enqueue(due: Due, index: usize, sources: &mut BinaryHeap<Reverse<(Time, usize)>>, waiting: &mut Vec<usize>) {
    match due {
        Due::At(time) => sources.push(Reverse((time, index))),
        Due::Waiting => waiting.push(index),
        Due::Never => {}
    }
}
