//! The part of a deterministic run that any number of threads may share with the same bytes: each camera's own nodes.
//!
//! A camera's *lane* holds its sources, and the nodes of that camera which only messages of the lane trigger. What other nodes give to a lane is only
//! sampled there. A *round* activates sources of lanes, each followed by all that it triggers in its lane; lanes do not see each other
//! meanwhile, so that it does not matter which thread runs which. What leaves the lanes is then delivered in the order of time and of the rig.
//!
//! A feedback edge into a lane has a delay, the period of the lane's sources. That is the lane's *lookahead*: what it will sample in a period
//! from now has been given out already, so that it may be ahead of the rest by so much. A lane that shares a device with other nodes (a
//! handle, such as the line of a head), or whose rate is not known, has no lookahead: its rounds are single moments. This is conservative
//! simulation of discrete events, where the lookahead gives the time-stamp bounds of a lane's inputs. A round of lanes that are ahead lasts for half of the
//! shortest lookahead: so the next one can be under way while the rest works on what the last one gave. Where something comes into a lane from elsewhere without a delay, or
//! a gate may close before it, a round lasts for all of it, and the rest waits.
//!
//! Sinks that no camera has stand apart from the rest too: when another node never comes back, what they hold can still be saved.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap, VecDeque};
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::{Duration, Instant};

use foveate_messages::{Interval, Time};
use foveate_node::guard::guarded;
use foveate_node::node::{Due, Role};
use foveate_node::port::InputPolicy;
use foveate_rig::graph::{Cost, Edge, Graph};

use crate::helpers::WORTH_SHARING;
use crate::slot::Route;
use crate::stage::{Alone, Outgoing, Stage};

/// Stages that lanes of either kind are dealt out to, at most: more than cores, so that loads even out; few, since each has a table of the whole graph.
const MOST_STAGES: usize = 32;
/// Activations of one stage in a round, at most.
const MOST_ACTIVATIONS: usize = 10_000;
/// No round is under way.
const NONE: i64 = i64::MIN;

/// What leaves a lane: when, by which source it was caused, and what.
pub(crate) type Left = (Time, usize, Outgoing);

/// What comes in along delayed edges, by when it becomes visible.
type Incoming = Mutex<VecDeque<(Time, Outgoing)>>;

/// Some cameras' lanes, or the sinks.
struct Bundle {
    stage: Stage,
    /// The sources that are activated in this round.
    sources: BinaryHeap<Reverse<(Time, usize)>>,
    left: Vec<Left>,
    /// Sources that have been activated, and when they want to be next.
    due: Vec<(usize, Due)>,
    /// What its part of a round took of late.
    typical: Duration,
    /// The words of a panic of the engine itself.
    said: Option<String>,
}

impl Bundle {
    fn run(&mut self, graph: &Graph, incoming: &Incoming, until: Time) {
        let began = Instant::now();
        let said = guarded(|| self.activations(graph, incoming, until)).err();
        self.stage.rest();
        self.said = self.said.take().or(said);
        self.typical = (self.typical * 3 + began.elapsed()) / 4;
    }

    fn activations(&mut self, graph: &Graph, incoming: &Incoming, until: Time) {
        let mut n_activations = 0;
        while let Some(Reverse((now, source))) = self.sources.pop() {
            self.take_in(incoming, now);
            self.stage.activate_source(source, now, &mut Alone);
            self.left.extend(self.stage.outgoing.drain(..).map(|it| (now, source, it)));
            n_activations += 1;
            match self.stage.due(source, now) {
                // One that never lets time go on is left to who can stop the run.
                Due::At(due) if due.max(now) < until && !graph.is_over(due) && n_activations < MOST_ACTIVATIONS => {
                    self.sources.push(Reverse((due.max(now), source)));
                }
                due => self.due.push((source, due)),
            }
        }
    }

    /// Delivers what has become visible by `now`.
    fn take_in(&mut self, incoming: &Incoming, now: Time) {
        let mut incoming = lock(incoming);
        let n_visible = incoming.partition_point(|it| it.0 <= now);
        for (visible, it) in incoming.drain(..n_visible) {
            self.stage.take_in(it, visible);
        }
    }
}

/// The lanes of a graph, dealt out to stages, and its sinks.
pub(crate) struct Lanes {
    graph: Arc<Graph>,
    bundles: Vec<Mutex<Bundle>>,
    /// By bundle.
    incoming: Vec<Incoming>,
    /// By bundle: what it is at, for who looks on.
    at: Vec<Arc<AtomicU64>>,
    /// By instance: the stage of its lane.
    bundle_of: Vec<Option<usize>>,
    /// By instance: the lookahead of its lane; 0 without one.
    lookahead: Vec<Interval>,
    /// By edge: its delay.
    delay: Vec<Interval>,
    /// How long a round of lanes that are ahead lasts.
    round: Interval,
    /// Whether such a round may be under way while the rest works on what is before it.
    may_overlap: bool,
    /// Until when the round of lanes that are ahead lasts that is under way.
    under_way: AtomicI64,
}

impl Lanes {
    /// Takes all lanes out of `whole`, and the sinks.
    pub(crate) fn take_from(whole: &mut Stage, graph: &Arc<Graph>) -> Lanes {
        let camera_of = lanes(graph);
        let lookahead = lookaheads(graph, &camera_of);
        let (bundle_of, n_bundles) = deal_out(graph, &camera_of, &lookahead);
        let mut stages: Vec<Stage> = (0..n_bundles).map(|_| whole.empty_like()).collect();
        for slot in whole.slots.iter_mut().flatten() {
            for route in slot.routes_mut() {
                let Route::Here(edge) = *route else { continue };
                let (from, to) = (graph.edges[edge].from.0, graph.edges[edge].to.0);
                // Also between two lanes on one stage: what they see must not depend on how they were dealt out.
                if camera_of[from] != camera_of[to] || bundle_of[from] != bundle_of[to] {
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
        // A gate that turns would be seen by a round under way as chance has it.
        let is_gated = |index: usize| whole.gates.of_scale(graph.instances[index].scale).is_some();
        let mut seen = (0..graph.instances.len()).filter(|&it| lookahead[it].0 > 0).map(is_gated);
        let is_any_gated =
            seen.any(|it| it) || graph.edges.iter().any(|edge| lookahead[edge.to.0].0 > 0 && is_gated(edge.from.0));
        let shortest = lookahead.iter().copied().filter(|it| it.0 > 0).min().unwrap_or(Interval(0));
        let comes_in = |edge: &Edge| {
            lookahead[edge.to.0].0 > 0 && camera_of[edge.from.0] != camera_of[edge.to.0] && !is_handle(graph, edge.from)
        };
        let delay = graph.edges.iter().map(|edge| {
            let is_delayed = comes_in(edge) && edge.feedback;
            if is_delayed { lookahead[edge.to.0] } else { Interval(0) }
        });
        // What comes in without a delay is seen from the next round on: it should not have to wait for one that is under way.
        let is_any_prompt = graph.edges.iter().any(|edge| comes_in(edge) && !edge.feedback);
        let may_overlap = shortest.0 > 1 && !is_any_gated && !is_any_prompt;
        Lanes {
            graph: Arc::clone(graph),
            at: stages.iter().map(|it| Arc::clone(&it.at)).collect(),
            incoming: stages.iter().map(|_| Mutex::default()).collect(),
            delay: delay.collect(),
            bundles: stages.into_iter().map(Bundle::new).map(Mutex::new).collect(),
            bundle_of,
            lookahead,
            round: if may_overlap { Interval(shortest.0 / 2) } else { shortest },
            may_overlap,
            under_way: AtomicI64::new(NONE),
        }
    }

    /// Whether source `index` has a lane.
    pub(crate) fn has(&self, index: usize) -> bool {
        self.bundle_of[index].is_some()
    }

    /// Whether source `index` has a lane that may be ahead of others.
    pub(crate) fn may_be_ahead(&self, index: usize) -> bool {
        self.lookahead[index].0 > 0
    }

    /// How long a round of lanes that are ahead lasts.
    pub(crate) fn round(&self) -> Interval {
        self.round
    }

    /// Whether such a round may be under way while the rest works on what is up to its length before it.
    pub(crate) fn may_overlap(&self) -> bool {
        self.may_overlap
    }

    /// What each stage is at, for who looks on.
    pub(crate) fn at(&self) -> &[Arc<AtomicU64>] {
        &self.at
    }

    /// When source `index` of a lane is due.
    pub(crate) fn due(&self, index: usize, now: Time) -> Due {
        self.bundle_of[index].map_or(Due::Never, |it| {
            let mut bundle = lock(&self.bundles[it]);
            let due = bundle.stage.due(index, now);
            bundle.stage.rest();
            due
        })
    }

    /// Delivers what left a stage at `now`: at once, or, along an edge with a delay, when that is over. `main` has what no lane has; it is locked only while
    /// it works.
    pub(crate) fn deliver(&self, outgoing: Outgoing, now: Time, main: &Mutex<Stage>) {
        let (Outgoing::Message(edge, _) | Outgoing::Gap(edge, _)) = &outgoing;
        let consumer = self.graph.edges[*edge].to.0;
        let Some(bundle) = self.bundle_of[consumer] else {
            return self.on_main(main, now, |main| main.take_in(outgoing, now));
        };
        let until = Time(self.under_way.load(Ordering::Relaxed));
        let is_under_way = self.may_be_ahead(consumer) && until.0 != NONE;
        let visible = match self.delay[*edge] {
            Interval(0) if is_under_way => until,
            delay => now + delay,
        };
        if visible > now {
            let mut incoming = lock(&self.incoming[bundle]);
            let place = incoming.partition_point(|it| it.0 <= visible);
            incoming.insert(place, (visible, outgoing));
            return;
        }
        let mut bundle = lock(&self.bundles[bundle]);
        bundle.stage.take_in(outgoing, now);
        bundle.stage.rest();
    }

    /// Lets `main` work, and delivers what it gave out.
    pub(crate) fn on_main(&self, main: &Mutex<Stage>, now: Time, work: impl FnOnce(&mut Stage)) {
        let outgoing = {
            let mut main = lock(main);
            work(&mut main);
            main.rest();
            std::mem::take(&mut main.outgoing)
        };
        outgoing.into_iter().for_each(|it| self.deliver(it, now, main));
    }

    /// Gets ready for a round: each of `sources` is activated when it is due and as often as it is before the end of the round. Gives the bundles that have a
    /// part in it, the longest first, so that threads end together.
    pub(crate) fn begin_moment(&self, sources: &[(Time, usize)]) -> Vec<(Duration, usize)> {
        let mut busy: Vec<(Duration, usize)> = Vec::new();
        for &(due, source) in sources {
            let Some(number) = self.bundle_of[source] else { continue };
            let mut bundle = lock(&self.bundles[number]);
            if bundle.sources.is_empty() {
                busy.push((bundle.typical, number));
            }
            bundle.sources.push(Reverse((due, source)));
        }
        busy.sort_by_key(|it| (Reverse(it.0), it.1));
        busy
    }

    /// As [`Self::begin_moment`], of lanes that are ahead, until `until`.
    pub(crate) fn begin(&self, sources: &[(Time, usize)], until: Time) -> Vec<(Duration, usize)> {
        self.under_way.store(until.0, Ordering::Relaxed);
        self.begin_moment(sources)
    }

    /// The part that `bundle` has in a round.
    pub(crate) fn run(&self, bundle: usize, until: Time) {
        lock(&self.bundles[bundle]).run(&self.graph, &self.incoming[bundle], until);
    }

    /// After a round of the bundles `busy`: adds what left them to `left`, and gives when their sources want to be activated next.
    pub(crate) fn end_moment(&self, busy: &[(Duration, usize)], left: &mut Vec<Left>) -> Vec<(usize, Due)> {
        let mut due = Vec::new();
        for &(_, bundle) in busy {
            let mut it = lock(&self.bundles[bundle]);
            due.append(&mut it.due);
            left.append(&mut it.left);
        }
        // Stable: what one source caused keeps its order.
        left.sort_by_key(|it| (it.0, it.1));
        due
    }

    /// As [`Self::end_moment`], of lanes that are ahead.
    pub(crate) fn end(&self, busy: &[(Duration, usize)], left: &mut Vec<Left>) -> Vec<(usize, Due)> {
        self.under_way.store(NONE, Ordering::Relaxed);
        self.end_moment(busy, left)
    }

    /// Shows each stage that nobody is at.
    pub(crate) fn each(&self, mut show: impl FnMut(&Stage)) {
        self.bundles.iter().filter_map(try_lock).for_each(|it| show(&it.stage));
    }

    /// Puts all lanes back at the end, but those that a thread is still at; what was still to become visible does. Gives the words of panics of the engine
    /// itself.
    pub(crate) fn give_back(&self, whole: &mut Stage) -> Vec<String> {
        let mut said = Vec::new();
        for (bundle, incoming) in self.bundles.iter().zip(&self.incoming) {
            let Some(mut bundle) = try_lock(bundle) else { continue };
            bundle.take_in(incoming, Time(i64::MAX));
            whole.absorb(&mut bundle.stage);
            said.extend(bundle.said.take());
        }
        said
    }
}

impl Bundle {
    fn new(stage: Stage) -> Bundle {
        Bundle {
            stage,
            sources: BinaryHeap::new(),
            left: Vec::new(),
            due: Vec::new(),
            typical: WORTH_SHARING,
            said: None,
        }
    }
}

pub(crate) fn lock<T>(it: &Mutex<T>) -> MutexGuard<'_, T> {
    it.lock().unwrap_or_else(PoisonError::into_inner)
}

/// `None`: a thread is at it.
pub(crate) fn try_lock<T>(it: &Mutex<T>) -> Option<MutexGuard<'_, T>> {
    match it.try_lock() {
        Ok(it) => Some(it),
        Err(TryLockError::Poisoned(it)) => Some(it.into_inner()),
        Err(TryLockError::WouldBlock) => None,
    }
}

/// Whether an output port, by instance and number, gives a handle on something in this process, whose changes are seen at once.
fn is_handle(graph: &Graph, (instance, port): (usize, usize)) -> bool {
    graph.instances[instance].node_type.ports.outputs[port].message.wire.codec().is_none()
}

/// By instance: the stage that it is dealt out to; and how many there are. Lanes that may be ahead and others do not mix.
fn deal_out(graph: &Graph, camera_of: &[Option<u16>], lookahead: &[Interval]) -> (Vec<Option<usize>>, usize) {
    let mut cameras: BTreeMap<(bool, u16), usize> = BTreeMap::new();
    let lane = |index: usize| camera_of[index].map(|it| (lookahead[index].0 > 0, it));
    cameras.extend((0..camera_of.len()).filter_map(lane).map(|it| (it, 0)));
    let mut n_bundles = 0;
    for is_ahead in [false, true] {
        let kind = || cameras.keys().filter(|it| it.0 == is_ahead);
        let n_stages = kind().count().min(MOST_STAGES);
        let places: Vec<_> = kind().copied().enumerate().map(|(i, it)| (it, n_bundles + i % n_stages)).collect();
        cameras.extend(places);
        n_bundles += n_stages;
    }
    let mut bundle_of: Vec<Option<usize>> = (0..camera_of.len()).map(|it| lane(it).map(|it| cameras[&it])).collect();
    let sinks: Vec<usize> = (0..bundle_of.len()).filter(|&it| bundle_of[it].is_none() && is_apart(graph, it)).collect();
    if !sinks.is_empty() {
        sinks.into_iter().for_each(|it| bundle_of[it] = Some(n_bundles));
        n_bundles += 1;
    }
    (bundle_of, n_bundles)
}

/// Whether an instance is a sink on which nothing depends, and which depends on no handle.
fn is_apart(graph: &Graph, index: usize) -> bool {
    let instance = &graph.instances[index];
    instance.node_type.role == Role::Sink
        && instance.cost == Cost::default()
        && graph.edges.iter().all(|it| it.from.0 != index && (it.to.0 != index || !is_handle(graph, it.from)))
}

/// By instance: the camera whose lane it belongs to.
fn lanes(graph: &Graph) -> Vec<Option<u16>> {
    let mut lanes: Vec<Option<u16>> =
        graph.instances.iter().map(|it| it.camera.filter(|_| it.cost == Cost::default()).map(|it| it.0)).collect();
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
        let shares = graph.edges.iter().any(|edge| own(edge.from.0) && !own(edge.to.0) && is_handle(graph, edge.from));
        shortest.filter(|it| it.0 > 0 && !shares).unwrap_or(Interval(0))
    };
    let mut known = BTreeMap::new();
    let of = |camera: Option<u16>| camera.map_or(Interval(0), |it| *known.entry(it).or_insert_with(|| of_camera(it)));
    camera_of.iter().copied().map(of).collect()
}
