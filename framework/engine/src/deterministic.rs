//! One thread, one logical clock, an order that depends on nothing but the rig.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use foveate_messages::Time;

use super::stage::{Alone, Costs, Stage};
use super::{EdgeView, Options, Outcome, PROGRESS_PERIOD, Progress, conclude, view_edges};
use foveate_node::error::NodeError;
use foveate_node::node::Due;
use foveate_rig::graph::Graph;

/// The wall clock is looked at once in so many turns of sources.
const TURNS_A_LOOK: u64 = 16;
/// Pause before a source that has nothing yet is asked again.
const WAITING_PAUSE: Duration = Duration::from_millis(1);

pub(super) fn run(
    graph: Arc<Graph>,
    options: &Options,
    observe: &mut dyn FnMut(&Progress),
) -> Result<Outcome, NodeError> {
    let started = Instant::now();
    let mut stage = Stage::build(Arc::clone(&graph), options.out_dir.clone(), Costs::Simulated)?;
    let mut now = Time::ZERO;
    // Sources by (due time, schedule order): ties are broken by the rig, not by chance.
    let mut sources = BinaryHeap::new();
    let mut waiting = Vec::new();
    for index in 0..graph.instances.len() {
        enqueue(stage.due(index, now), index, &mut sources, &mut waiting);
    }
    let mut last_shown = started;
    let mut turns = 0_u64;
    let mut interrupted = false;
    loop {
        if options.must_stop() {
            interrupted = true;
            break;
        }
        // A node that is done at the very moment at which a message comes is free for it.
        let first_due = sources.peek().map(|&Reverse((due, _))| now.max(due));
        if let Some((done, _)) = stage.next_done().filter(|it| first_due.is_none_or(|due| it.0 <= due)) {
            now = done;
            stage.end_work(&mut Alone);
            continue;
        }
        let Some(Reverse((due, index))) = sources.pop() else {
            if waiting.is_empty() {
                break;
            }
            std::thread::sleep(WAITING_PAUSE);
            for index in std::mem::take(&mut waiting) {
                enqueue(stage.due(index, now), index, &mut sources, &mut waiting);
            }
            continue;
        };
        if graph.is_over(due) {
            continue;
        }
        now = now.max(due);
        stage.turn_source(index, now, &mut Alone);
        enqueue(stage.due(index, now), index, &mut sources, &mut waiting);
        turns += 1;
        if turns.is_multiple_of(TURNS_A_LOOK) && last_shown.elapsed() >= PROGRESS_PERIOD {
            last_shown = Instant::now();
            let mut edges = vec![EdgeView::default(); graph.edges.len()];
            view_edges(&graph, &stage, &mut edges);
            observe(&Progress { now, wall: started.elapsed(), edges });
        }
    }
    Ok(conclude(&graph, stage, now, started.elapsed(), interrupted))
}

fn enqueue(due: Due, index: usize, sources: &mut BinaryHeap<Reverse<(Time, usize)>>, waiting: &mut Vec<usize>) {
    match due {
        Due::At(time) => sources.push(Reverse((time, index))),
        Due::Waiting => waiting.push(index),
        Due::Never => {}
    }
}
