//! The part of a deterministic run that any number of threads may share with the same bytes: each camera's own nodes.
//!
//! A camera's *lane* holds its sources, and the nodes of that camera which only messages of the lane trigger. What other nodes give to a lane is only
//! sampled there. A *round* lets sources of lanes take their activations, each followed by all that it triggers in its lane; lanes do not see each other
//! meanwhile, so that it does not matter which thread runs which. What leaves the lanes is then delivered in the order of time and of the rig.
//!
//! A feedback edge into a lane has a delay, the period of the lane's sources. That is the lane's *lookahead*: what it will sample in a period from
//! now has been given out already, so that a round may last as long as the shortest lookahead. A lane that shares a device with other nodes (a
//! handle, such as the line of a head), or whose rate is not known, has no lookahead: its rounds are single moments. This is conservative
//! simulation of discrete events, where the lookahead gives the time-stamp bounds of a lane's inputs.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, Sender, unbounded};
use foveate_messages::{Interval, Time};
use foveate_node::guard::guarded;
use foveate_node::node::Due;
use foveate_node::port::InputPolicy;
use foveate_rig::graph::Graph;

use crate::slot::Route;
use crate::stage::{Alone, Outgoing, Stage};

/// Stages that lanes are dealt out to, at most: more than cores, so that loads even out; few, since each has a table of the whole graph.
const MOST_STAGES: usize = 32;
/// Activations of one stage in a round, at most.
const MOST_TURNS: usize = 10_000;
/// A round that takes less is not worth waking threads for.
const WORTH_SHARING: Duration = Duration::from_micros(150);

/// What leaves a lane: when, by which source it was caused, and what.
pub(crate) type Left = (Time, usize, Outgoing);

/// What one round is about.
struct Round<'g> {
    graph: &'g Graph,
    /// Sources that are due before this take their activations.
    until: Time,
}

/// Some cameras' lanes.
struct Bundle {
    stage: Stage,
    /// The sources that take activations in this round.
    sources: BinaryHeap<Reverse<(Time, usize)>>,
    /// What comes in along delayed edges, by when it becomes visible.
    incoming: VecDeque<(Time, Outgoing)>,
    left: Vec<Left>,
    /// Sources that have had their activations, and when they want their next ones.
    due: Vec<(usize, Due)>,
    /// What its part of a round took of late.
    typical: Duration,
    /// The words of a panic of the engine itself.
    said: Option<String>,
}

impl Bundle {
    fn run(&mut self, round: &Round<'_>) {
        let began = Instant::now();
        let said = guarded(|| self.activations(round)).err();
        self.said = self.said.take().or(said);
        self.typical = (self.typical * 3 + began.elapsed()) / 4;
    }

    fn activations(&mut self, round: &Round<'_>) {
        let mut n_turns = 0;
        while let Some(Reverse((now, source))) = self.sources.pop() {
            self.take_in(now);
            self.stage.activate_source(source, now, &mut Alone);
            self.left.extend(self.stage.outgoing.drain(..).map(|it| (now, source, it)));
            n_turns += 1;
            match self.stage.due(source, now) {
                // One that never lets time go on is left to who can stop the run.
                Due::At(due) if due.max(now) < round.until && !round.graph.is_over(due) && n_turns < MOST_TURNS => {
                    self.sources.push(Reverse((due.max(now), source)));
                }
                due => self.due.push((source, due)),
            }
        }
    }

    /// Delivers what has become visible by `now`.
    fn take_in(&mut self, now: Time) {
        let n_visible = self.incoming.partition_point(|it| it.0 <= now);
        for (visible, it) in self.incoming.drain(..n_visible) {
            self.stage.take_in(it, visible);
        }
    }
}

/// The lanes of a graph, dealt out to stages.
pub(crate) struct Lanes {
    bundles: Vec<Mutex<Bundle>>,
    /// By instance: the stage of its lane.
    bundle_of: Vec<Option<usize>>,
    /// By instance: the lookahead of its lane; 0 without one.
    lookahead: Vec<Interval>,
    /// The shortest lookahead of all lanes that have one.
    shortest: Interval,
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
        for (edge, ends) in graph.edges.iter().enumerate() {
            if let Some(bundle) = bundle_of[ends.to.0] {
                stages[bundle].ends[edge] = whole.ends[edge].take();
            }
        }
        let bundle = |stage| {
            Mutex::new(Bundle {
                stage,
                sources: BinaryHeap::new(),
                incoming: VecDeque::new(),
                left: Vec::new(),
                due: Vec::new(),
                typical: WORTH_SHARING,
                said: None,
            })
        };
        let lookahead = lookaheads(graph, &camera_of);
        let shortest = lookahead.iter().copied().filter(|it| it.0 > 0).min().unwrap_or(Interval(0));
        Lanes { bundles: stages.into_iter().map(bundle).collect(), bundle_of, lookahead, shortest }
    }

    /// Whether source `index` has a lane.
    pub(crate) fn has(&self, index: usize) -> bool {
        self.bundle_of[index].is_some()
    }

    /// Whether source `index` has a lane that may be ahead of others.
    pub(crate) fn may_be_ahead(&self, index: usize) -> bool {
        self.has(index) && self.lookahead[index].0 > 0
    }

    /// How long a round of lanes that may be ahead lasts.
    pub(crate) fn shortest_lookahead(&self) -> Interval {
        self.shortest
    }

    /// When source `index` of a lane is due.
    pub(crate) fn due(&self, index: usize, now: Time) -> Due {
        self.bundle_of[index].map_or(Due::Never, |it| self.lock(it).stage.due(index, now))
    }

    /// Delivers what left a stage at `now`: at once, or, along an edge with a delay, when that is over.
    pub(crate) fn deliver(&self, graph: &Graph, outgoing: Outgoing, now: Time, main: &mut Stage) {
        let (Outgoing::Message(number, _) | Outgoing::Gap(number, _)) = &outgoing;
        let edge = &graph.edges[*number];
        let Some(bundle) = self.bundle_of[edge.to.0] else {
            main.take_in(outgoing, now);
            return self.take_in(graph, main, now);
        };
        let mut bundle = self.lock(bundle);
        let delay = self.lookahead[edge.to.0];
        if edge.feedback && delay.0 > 0 {
            let visible = now + delay;
            let place = bundle.incoming.partition_point(|it| it.0 <= visible);
            bundle.incoming.insert(place, (visible, outgoing));
        } else {
            bundle.stage.take_in(outgoing, now);
        }
    }

    /// Delivers what `main` gave out to lanes.
    pub(crate) fn take_in(&self, graph: &Graph, main: &mut Stage, now: Time) {
        for it in std::mem::take(&mut main.outgoing) {
            self.deliver(graph, it, now, main);
        }
    }

    /// One round: `sources` take their activations, each when it is due and as often as it is before `until`, by all `helpers` where that is worth it. Adds what
    /// left the lanes to `left`, and gives when the sources want their next activations.
    pub(crate) fn round(
        &self,
        graph: &Graph,
        sources: &[(Time, usize)],
        until: Time,
        helpers: &mut Helpers<'_>,
        left: &mut Vec<Left>,
    ) -> Vec<(usize, Due)> {
        let mut busy: Vec<(Duration, usize)> = Vec::new();
        for &(due, source) in sources {
            let Some(bundle) = self.bundle_of[source] else { continue };
            let mut it = self.lock(bundle);
            if it.sources.is_empty() {
                busy.push((it.typical, bundle));
            }
            it.sources.push(Reverse((due, source)));
        }
        // The longest first, so that threads end together.
        busy.sort_by_key(|it| (Reverse(it.0), it.1));
        helpers.run(self, &busy, &Round { graph, until });
        let mut due = Vec::with_capacity(sources.len());
        for (_, bundle) in busy {
            let mut it = self.lock(bundle);
            due.append(&mut it.due);
            left.append(&mut it.left);
        }
        // Stable: what one source caused keeps its order.
        left.sort_by_key(|it| (it.0, it.1));
        due
    }

    /// Shows each stage.
    pub(crate) fn each(&self, mut show: impl FnMut(&Stage)) {
        (0..self.bundles.len()).for_each(|it| show(&self.lock(it).stage));
    }

    /// Puts all lanes back at the end; what was still to become visible does. Gives the words of panics of the engine itself.
    pub(crate) fn give_back(self, whole: &mut Stage) -> Vec<String> {
        let mut said = Vec::new();
        for bundle in self.bundles {
            let mut bundle = bundle.into_inner().unwrap_or_else(PoisonError::into_inner);
            bundle.take_in(Time(i64::MAX));
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
pub(crate) struct Helpers<'s> {
    n_helpers: usize,
    todo: Sender<Option<usize>>,
    queue: Receiver<Option<usize>>,
    done: Sender<()>,
    finished: Receiver<()>,
    until: &'s Mutex<Time>,
}

impl<'s> Helpers<'s> {
    /// For `n_threads` in all, with the one that calls. `until` tells helpers how long a round lasts.
    pub(crate) fn new(n_threads: usize, until: &'s Mutex<Time>) -> Helpers<'s> {
        let ((todo, queue), (done, finished)) = (unbounded(), unbounded());
        Helpers { n_helpers: n_threads.saturating_sub(1), todo, queue, done, finished, until }
    }

    /// How many there are to be.
    pub(crate) fn count(&self) -> usize {
        self.n_helpers
    }

    /// What a helper's thread does until the run is over.
    pub(crate) fn work(&self) -> impl FnOnce(&Lanes, &Graph) + Send + use<'s> {
        let (queue, done, until) = (self.queue.clone(), self.done.clone(), self.until);
        move |lanes, graph| {
            while let Ok(Some(bundle)) = queue.recv() {
                let until = *until.lock().unwrap_or_else(PoisonError::into_inner);
                lanes.lock(bundle).run(&Round { graph, until });
                let _ = done.send(()); // nobody listens any more: the run is over
            }
        }
    }

    /// Sends all helpers home.
    pub(crate) fn end(&self) {
        for _ in 0..self.n_helpers {
            let _ = self.todo.send(None); // its receiver is ours
        }
    }

    fn run(&mut self, lanes: &Lanes, busy: &[(Duration, usize)], round: &Round<'_>) {
        let expected: Duration = busy.iter().map(|it| it.0).sum();
        if self.n_helpers == 0 || busy.len() < 2 || expected < WORTH_SHARING {
            return busy.iter().for_each(|it| lanes.lock(it.1).run(round));
        }
        *self.until.lock().unwrap_or_else(PoisonError::into_inner) = round.until;
        for it in busy {
            let _ = self.todo.send(Some(it.1)); // its receiver is ours
        }
        let mut own = 0;
        while let Ok(Some(bundle)) = self.queue.try_recv() {
            lanes.lock(bundle).run(round);
            own += 1;
        }
        for _ in own..busy.len() {
            let _ = self.finished.recv(); // a helper sends, whatever happens to it
        }
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
            let triggers = graph.instances[to].takes[port] != InputPolicy::Latest;
            if triggers && lanes[to].is_some() && lanes[from] != lanes[to] {
                lanes[to] = None;
                shrinks = true;
            }
        }
    }
    lanes
}

/// By instance: the period of the sources of its lane, where the lane may be ahead of others by so much.
fn lookaheads(graph: &Graph, camera_of: &[Option<u16>]) -> Vec<Interval> {
    let of_camera = |camera: u16| {
        let own = |index: usize| camera_of[index] == Some(camera);
        let mut shortest = None;
        for (index, instance) in graph.instances.iter().enumerate().filter(|it| own(it.0)) {
            if graph.edges.iter().any(|it| it.to.0 == index && instance.takes[it.to.1] != InputPolicy::Latest) {
                continue;
            }
            // What gives no stream, such as a head that is there, has no rate and does not matter.
            let Some(rate_hz) = instance.settings.plan().rate_hz else { continue };
            let period = Interval::from_s(1.0 / rate_hz);
            shortest = Some(shortest.map_or(period, |it: Interval| it.min(period)));
        }
        let shares = graph.edges.iter().any(|edge| {
            let is_local =
                graph.instances[edge.from.0].node_type.ports.outputs[edge.from.1].message.wire.codec().is_none();
            own(edge.from.0) && !own(edge.to.0) && is_local
        });
        shortest.filter(|it| it.0 > 0 && !shares).unwrap_or(Interval(0))
    };
    let mut known = std::collections::BTreeMap::new();
    let of = |camera: Option<u16>| camera.map_or(Interval(0), |it| *known.entry(it).or_insert_with(|| of_camera(it)));
    camera_of.iter().copied().map(of).collect()
}
