//! The part of a deterministic run that any number of threads may share with the same bytes: each camera's own nodes.
//!
//! A camera's *lane* holds its sources, and the nodes of that camera which only messages of the lane trigger. What other nodes give to a lane is only
//! sampled there, and becomes visible between two rounds. A *round* lets sources take their turns that are due at the same moment, each followed by
//! all that it triggers in its lane: lanes do not see each other meanwhile, so that it does not matter which thread runs which. What leaves the
//! lanes is then delivered in the order of the sources. This is conservative simulation of discrete events: the end of a round is the time-stamp
//! bound up to which all inputs of a lane are known.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, Sender, unbounded};
use foveate_messages::Time;
use foveate_node::guard::guarded;
use foveate_node::node::Due;
use foveate_node::port::Take;
use foveate_rig::graph::Graph;

use crate::slot::Route;
use crate::stage::{Alone, Outgoing, Stage};

/// Stages that lanes are dealt out to, at most: more than cores, so that loads even out; few, since each has a table of the whole graph.
const MOST_STAGES: usize = 32;
/// A round that takes less is not worth waking threads for.
const WORTH_SHARING: Duration = Duration::from_micros(150);

/// One turn of a source: its place in the round, the source, and when it wants its next one.
pub(crate) type Turn = (usize, usize, Due);

/// Some cameras' lanes.
struct Bundle {
    stage: Stage,
    now: Time,
    turns: Vec<Turn>,
    /// The words of a panic of the engine itself.
    said: Option<String>,
}

impl Bundle {
    fn run(&mut self) {
        let Bundle { stage, now, turns, .. } = self;
        let result = guarded(|| {
            for (place, source, due) in turns {
                stage.place = *place;
                stage.turn_source(*source, *now, &mut Alone);
                *due = stage.due(*source, *now);
            }
        });
        self.said = self.said.take().or(result.err());
    }
}

/// The lanes of a graph, dealt out to stages.
pub(crate) struct Lanes {
    bundles: Vec<Mutex<Bundle>>,
    /// By instance: the stage of its lane.
    bundle_of: Vec<Option<usize>>,
    /// By edge: the stage of its consumer.
    consumer_of: Vec<Option<usize>>,
}

impl Lanes {
    /// Takes all lanes out of `whole`.
    pub(crate) fn take_from(whole: &mut Stage, graph: &Graph) -> Lanes {
        let camera_of = lanes(graph);
        let mut cameras: Vec<u16> = camera_of.iter().flatten().copied().collect();
        cameras.sort_unstable();
        cameras.dedup();
        let n_bundles = cameras.len().min(MOST_STAGES);
        let place = |camera: u16| cameras.binary_search(&camera).map_or(0, |it| it % n_bundles.max(1));
        let bundle_of: Vec<Option<usize>> = camera_of.iter().map(|it| it.map(place)).collect();
        let consumer_of: Vec<Option<usize>> = graph.edges.iter().map(|it| bundle_of[it.to.0]).collect();
        let mut stages: Vec<Stage> = (0..n_bundles).map(|_| whole.empty_like()).collect();
        for slot in whole.slots.iter_mut().flatten() {
            for route in slot.routes_mut() {
                let Route::Here(edge) = *route else { continue };
                let (from, to) = (graph.edges[edge].from.0, graph.edges[edge].to.0);
                // Also between two lanes on one stage: what they see must not depend on how they were dealt out.
                if camera_of[from] != camera_of[to] {
                    *route = Route::Beyond(edge);
                }
            }
        }
        for (index, &bundle) in bundle_of.iter().enumerate() {
            if let Some(bundle) = bundle {
                stages[bundle].slots[index] = whole.slots[index].take();
            }
        }
        for (edge, &bundle) in consumer_of.iter().enumerate() {
            if let Some(bundle) = bundle {
                stages[bundle].ends[edge] = whole.ends[edge].take();
            }
        }
        let bundle = |stage| Mutex::new(Bundle { stage, now: Time::ZERO, turns: Vec::new(), said: None });
        Lanes { bundles: stages.into_iter().map(bundle).collect(), bundle_of, consumer_of }
    }

    /// Whether source `index` has a lane.
    pub(crate) fn has(&self, index: usize) -> bool {
        self.bundle_of[index].is_some()
    }

    /// When source `index` of a lane is due.
    pub(crate) fn due(&self, index: usize, now: Time) -> Due {
        self.bundle_of[index].map_or(Due::Never, |it| self.lock(it).stage.due(index, now))
    }

    /// Delivers what `main` gave out to lanes.
    pub(crate) fn take_in(&self, main: &mut Stage, now: Time) {
        for (_, outgoing) in std::mem::take(&mut main.outgoing) {
            let (Outgoing::Message(edge, _) | Outgoing::Gap(edge, _)) = &outgoing;
            match self.consumer_of[*edge] {
                Some(bundle) => self.lock(bundle).stage.take_in(outgoing, now),
                None => main.take_in(outgoing, now),
            }
        }
    }

    /// One round: `sources` take their turns at `now`, by all `helpers` where that is worth it. Gives their turns in that order, and delivers what left
    /// the lanes.
    pub(crate) fn round(&self, sources: &[usize], now: Time, main: &mut Stage, helpers: &mut Helpers) -> Vec<Turn> {
        let mut busy: Vec<usize> = Vec::new();
        for (place, &source) in sources.iter().enumerate() {
            let Some(bundle) = self.bundle_of[source] else { continue };
            let mut it = self.lock(bundle);
            it.now = now;
            it.turns.push((place, source, Due::Never));
            if it.turns.len() == 1 {
                busy.push(bundle);
            }
        }
        helpers.run(self, &busy);
        let (mut turns, mut outgoing) = (Vec::with_capacity(sources.len()), Vec::new());
        for bundle in busy {
            let mut it = self.lock(bundle);
            turns.append(&mut it.turns);
            outgoing.append(&mut it.stage.outgoing);
        }
        turns.sort_unstable_by_key(|it| it.0);
        // Stable: what one source caused keeps its order.
        outgoing.sort_by_key(|it| it.0);
        for (_, it) in outgoing {
            let (Outgoing::Message(edge, _) | Outgoing::Gap(edge, _)) = &it;
            match self.consumer_of[*edge] {
                Some(bundle) => self.lock(bundle).stage.take_in(it, now),
                None => main.take_in(it, now),
            }
        }
        self.take_in(main, now);
        turns
    }

    /// Shows each stage.
    pub(crate) fn each(&self, mut show: impl FnMut(&Stage)) {
        (0..self.bundles.len()).for_each(|it| show(&self.lock(it).stage));
    }

    /// Puts all lanes back. Gives the words of panics of the engine itself.
    pub(crate) fn give_back(self, whole: &mut Stage) -> Vec<String> {
        let mut said = Vec::new();
        for bundle in self.bundles {
            let mut bundle = bundle.into_inner().unwrap_or_else(PoisonError::into_inner);
            whole.absorb(&mut bundle.stage);
            said.extend(bundle.said);
        }
        said
    }

    fn lock(&self, bundle: usize) -> MutexGuard<'_, Bundle> {
        self.bundles[bundle].lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Threads that share rounds with the one that runs the graph.
pub(crate) struct Helpers {
    n_helpers: usize,
    todo: Sender<usize>,
    queue: Receiver<usize>,
    done: Sender<()>,
    finished: Receiver<()>,
    /// What a stage's part of a round took of late.
    typical: Duration,
}

impl Helpers {
    /// For `n_threads` in all, with the one that calls.
    pub(crate) fn new(n_threads: usize) -> Helpers {
        let ((todo, queue), (done, finished)) = (unbounded(), unbounded());
        Helpers { n_helpers: n_threads.saturating_sub(1), todo, queue, done, finished, typical: WORTH_SHARING }
    }

    /// How many there are to be.
    pub(crate) fn count(&self) -> usize {
        self.n_helpers
    }

    /// What a helper's thread does until the run is over.
    pub(crate) fn work(&self) -> impl FnOnce(&Lanes) + Send + use<> {
        let (queue, done) = (self.queue.clone(), self.done.clone());
        move |lanes| {
            while let Ok(bundle) = queue.recv() {
                // The mark of the end.
                if bundle == usize::MAX {
                    return;
                }
                lanes.lock(bundle).run();
                let _ = done.send(()); // nobody listens any more: the run is over
            }
        }
    }

    /// Sends all helpers home.
    pub(crate) fn end(&self) {
        for _ in 0..self.n_helpers {
            let _ = self.todo.send(usize::MAX); // its receiver is ours
        }
    }

    fn run(&mut self, lanes: &Lanes, busy: &[usize]) {
        let began = Instant::now();
        if self.n_helpers == 0 || busy.len() < 2 || self.typical * (busy.len() as u32) < WORTH_SHARING {
            busy.iter().for_each(|&it| lanes.lock(it).run());
            self.learn(began.elapsed() / busy.len().max(1) as u32);
            return;
        }
        for &bundle in busy {
            let _ = self.todo.send(bundle); // its receiver is ours
        }
        let mut own = 0;
        while let Ok(bundle) = self.queue.try_recv() {
            lanes.lock(bundle).run();
            own += 1;
        }
        if own > 0 {
            self.learn(began.elapsed() / own);
        }
        for _ in own as usize..busy.len() {
            let _ = self.finished.recv(); // a helper sends, whatever happens to it
        }
    }

    fn learn(&mut self, took: Duration) {
        self.typical = (self.typical * 7 + took) / 8;
    }
}

/// By instance: the camera whose lane it belongs to.
fn lanes(graph: &Graph) -> Vec<Option<u16>> {
    let mut lanes: Vec<Option<u16>> =
        graph.instances.iter().map(|it| it.camera.filter(|_| it.cost == Default::default()).map(|it| it.0)).collect();
    let mut shrinks = true;
    while shrinks {
        shrinks = false;
        for edge in &graph.edges {
            let (from, (to, port)) = (edge.from.0, edge.to);
            let triggers = graph.instances[to].takes[port] != Take::Latest;
            if triggers && lanes[to].is_some() && lanes[from] != lanes[to] {
                lanes[to] = None;
                shrinks = true;
            }
        }
    }
    lanes
}
