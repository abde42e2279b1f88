//! The part of a deterministic run that any number of threads may share with the same bytes: each camera's own nodes.
//!
//! A camera's *lane* holds its sources, and the nodes of that camera which only messages of the lane trigger. What other nodes give to a lane is only
//! sampled there. A *round* activates sources of lanes, each followed by all that it triggers in its lane; lanes do not see each other
//! meanwhile, so that it does not matter which thread runs which. What leaves the lanes is then delivered in the order of time and of the rig.
//!
//! A feedback edge into a lane has a delay: the rig's `delay_ms`, or the period of the lane's sources. The shortest delay of all that comes into a lane, and its
//! period, are the lane's *lookahead*: what it will sample so much later has been given out already, so that it may be ahead of the rest by so much. A lane that shares a device with
//! other nodes (a handle, such as the line of a head) may be ahead by no more than it takes that device to react ([`Plan::reacts_after_s`](foveate_node::Plan)). A node
//! that samples what comes from elsewhere without a delay stays behind with the rest, and with it what it triggers. Gates turn for a lane when its lookahead is over. A lane whose rate is not known, or whose
//! source itself samples without a delay, has no lookahead: its rounds are single moments. This is conservative simulation of discrete events, where the
//! lookahead gives the time-stamp bounds of a lane's inputs. A round of lanes that are ahead lasts for half of the shortest lookahead, so that the next one can be under way
//! while the rest works on what the last one gave.
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

use crate::gates::Gate;
use crate::helpers::WORTH_SHARING;
use crate::slot::Route;
use crate::stage::{Alone, Outgoing, Stage};

/// Stages that lanes of either kind are dealt out to, at most: more than cores, so that loads even out; few, since each has a table of the whole graph.
const MOST_STAGES: usize = 32;
/// Activations of one stage in a round, at most.
const MOST_ACTIVATIONS: usize = 10_000;
/// What reacts later than this never does [s].
const LONG_S: f64 = 1e9;
/// No round is under way.
const NONE: i64 = i64::MIN;

/// What leaves a lane: when, by which source it was caused, and what.
pub(crate) type Left = (Time, usize, Outgoing);

/// What comes in later than it is given out, by when it becomes visible.
type Incoming = Mutex<VecDeque<(Time, Arriving)>>;

/// What comes in so.
enum Arriving {
    /// Along an edge.
    Data(Outgoing),
    /// The gate of a scale has been turned so often.
    Turned(usize, u64),
}

/// Some cameras' lanes, or the sinks.
struct Bundle {
    stage: Stage,
    /// The sources that are activated in this round.
    sources: BinaryHeap<Reverse<(Time, usize)>>,
    /// By scale: of lanes that are ahead, the gate as they see it.
    gates: Vec<Option<Gate>>,
    left: Vec<Left>,
    /// Sources that have been activated, and when they want to be next.
    due: Vec<(usize, Due)>,
    /// Recent duration of its part of a round.
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
            match it {
                Arriving::Data(it) => self.stage.take_in(it, visible),
                Arriving::Turned(scale, activations) => {
                    if let Some(gate) = &self.gates[scale] {
                        gate.turn_to(activations);
                    }
                }
            }
        }
    }

    /// Looks at gates of its own from now on.
    fn keep_gates(&mut self, graph: &Graph) {
        let gates = Arc::clone(&self.stage.gates);
        self.gates = (0..graph.scales.len()).map(|it| gates.of_scale(it).map(|it| it.apart())).collect();
        for (index, slot) in self.stage.slots.iter_mut().enumerate() {
            if let Some(gate) = slot.as_mut().and_then(|it| it.gate.as_mut())
                && let Some(own) = &self.gates[graph.instances[index].scale]
            {
                *gate = own.clone();
            }
        }
        for (edge, end) in self.stage.ends.iter_mut().enumerate() {
            if let (Some(end), Some(own)) = (end, &self.gates[graph.instances[graph.edges[edge].from.0].scale]) {
                end.ledger.look_at(own);
            }
        }
    }
}

/// The lanes of a graph, dealt out to stages, and its sinks.
pub(crate) struct Lanes {
    graph: Arc<Graph>,
    bundles: Vec<Mutex<Bundle>>,
    /// By bundle, and of all nodes that no lane has.
    incoming: Vec<Incoming>,
    /// Bundles of lanes that may be ahead.
    ahead: Vec<usize>,
    /// Scales whose gates may turn, and how often they have turned as far as lanes that are ahead know.
    turned: Mutex<Vec<(usize, Gate, u64)>>,
    /// By bundle: its activity, for monitoring.
    at: Vec<Arc<AtomicU64>>,
    /// By instance: the stage of its lane.
    bundle_of: Vec<Option<usize>>,
    /// By instance: the lookahead of its lane; 0 without one.
    lookahead: Vec<Interval>,
    /// By edge: its delay.
    delay: Vec<Interval>,
    /// How long a round of lanes that are ahead lasts: half of the shortest lookahead.
    round: Interval,
    /// Until when the round of lanes that are ahead lasts that is under way.
    under_way: AtomicI64,
}

impl Lanes {
    /// Takes all lanes out of `whole`, and the sinks.
    pub(crate) fn take_from(whole: &mut Stage, graph: &Arc<Graph>) -> Lanes {
        let (camera_of, lookahead) = lanes(graph);
        let (bundle_of, n_bundles) = deal_out(graph, &camera_of, &lookahead);
        let mut stages: Vec<Stage> = (0..n_bundles).map(|_| whole.empty_like()).collect();
        for slot in whole.slots.iter_mut().flatten() {
            for route in slot.routes_mut() {
                let Route::Here(edge) = *route else { continue };
                let (from, to) = (graph.edges[edge].from.0, graph.edges[edge].to.0);
                // Also between two lanes on one stage: what they see must not depend on how they were dealt out.
                if camera_of[from] != camera_of[to]
                    || bundle_of[from] != bundle_of[to]
                    || is_delayed(&graph.edges[edge])
                {
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
        let shortest = lookahead.iter().copied().filter(|it| it.0 > 0).min().unwrap_or(Interval(0));
        let delay = graph.edges.iter().map(|edge| match edge.delay {
            Some(delay) => delay,
            None if lookahead[edge.to.0].0 > 0 && comes_in(graph, edge, &camera_of) && edge.feedback => {
                camera_of[edge.to.0].map_or(Interval(0), |it| period(graph, &camera_of, it))
            }
            None => Interval(0),
        });
        let delay = delay.collect();
        let mut bundles: Vec<Bundle> = stages.into_iter().map(Bundle::new).collect();
        let mut ahead: Vec<usize> =
            (0..bundle_of.len()).filter(|&it| lookahead[it].0 > 0).filter_map(|it| bundle_of[it]).collect();
        ahead.sort_unstable();
        ahead.dedup();
        ahead.iter().for_each(|&it| bundles[it].keep_gates(graph));
        let gates = (0..graph.scales.len()).filter_map(|it| Some((it, whole.gates.of_scale(it)?)));
        let turned = gates.map(|(scale, gate)| (scale, gate.clone(), gate.activations())).collect();
        Lanes {
            graph: Arc::clone(graph),
            at: bundles.iter().map(|it| Arc::clone(&it.stage.at)).collect(),
            incoming: (0..=n_bundles).map(|_| Mutex::default()).collect(),
            ahead,
            turned: Mutex::new(turned),
            delay,
            bundles: bundles.into_iter().map(Mutex::new).collect(),
            bundle_of,
            lookahead,
            round: Interval((shortest.0 / 2).max(1)),
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

    /// How long a round of lanes that are ahead lasts; it may be under way while the rest works on what is up to so much before it.
    pub(crate) fn round(&self) -> Interval {
        self.round
    }

    /// The activity of each stage, for monitoring.
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
        let bundle = self.bundle_of[consumer];
        let until = Time(self.under_way.load(Ordering::Relaxed));
        let is_under_way = self.may_be_ahead(consumer) && until.0 != NONE;
        // Only handles come in with less than the lookahead.
        let visible = (now + self.delay[*edge]).max(if is_under_way { until } else { now });
        if visible > now {
            return self.keep(bundle.unwrap_or(self.bundles.len()), visible, Arriving::Data(outgoing));
        }
        let Some(bundle) = bundle else {
            return self.on_main(main, now, |main| main.take_in(outgoing, now));
        };
        let mut bundle = lock(&self.bundles[bundle]);
        bundle.stage.take_in(outgoing, now);
        bundle.stage.rest();
    }

    /// Keeps what comes into a bundle, or to the nodes that no lane has, until it is visible.
    fn keep(&self, bundle: usize, visible: Time, it: Arriving) {
        let mut incoming = lock(&self.incoming[bundle]);
        let place = incoming.partition_point(|it| it.0 <= visible);
        incoming.insert(place, (visible, it));
    }

    /// Tells lanes that are ahead of gates that have been turned.
    fn tell_of_gates(&self, now: Time) {
        for (scale, gate, told) in lock(&self.turned).iter_mut() {
            let activations = gate.activations();
            if std::mem::replace(told, activations) == activations {
                continue;
            }
            let visible = now + Interval(2 * self.round.0);
            self.ahead.iter().for_each(|&it| self.keep(it, visible, Arriving::Turned(*scale, activations)));
        }
    }

    /// Lets `main` work, and delivers what it gave out.
    pub(crate) fn on_main(&self, main: &Mutex<Stage>, now: Time, work: impl FnOnce(&mut Stage)) {
        let outgoing = {
            let mut main = lock(main);
            self.take_in_delayed(&mut main, now);
            work(&mut main);
            main.rest();
            std::mem::take(&mut main.outgoing)
        };
        self.tell_of_gates(now);
        outgoing.into_iter().for_each(|it| self.deliver(it, now, main));
    }

    /// Delivers what has become visible by `now` to nodes that no lane has.
    fn take_in_delayed(&self, main: &mut Stage, now: Time) {
        let mut incoming = lock(&self.incoming[self.bundles.len()]);
        let n_visible = incoming.partition_point(|it| it.0 <= now);
        for (visible, it) in incoming.drain(..n_visible) {
            if let Arriving::Data(it) = it {
                main.take_in(it, visible);
            }
        }
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

    /// Shows each stage that no thread works on.
    pub(crate) fn each(&self, mut show: impl FnMut(&Stage)) {
        self.bundles.iter().filter_map(try_lock).for_each(|it| show(&it.stage));
    }

    /// Lets each stage that no thread works on be changed.
    pub(crate) fn each_mut(&self, mut change: impl FnMut(&mut Stage)) {
        self.bundles.iter().filter_map(try_lock).for_each(|mut it| change(&mut it.stage));
    }

    /// Puts all lanes back at the end, but those that a thread is still at; what was still to become visible does. Gives the words of panics of the engine
    /// itself.
    pub(crate) fn give_back(&self, whole: &mut Stage) -> Vec<String> {
        let mut said = Vec::new();
        self.take_in_delayed(whole, Time(i64::MAX));
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
            gates: Vec::new(),
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

/// Whether the rig says that what goes along an edge is seen later.
fn is_delayed(edge: &Edge) -> bool {
    edge.delay.is_some_and(|it| it.0 > 0)
}

/// Whether an edge leads into a lane from elsewhere; handles aside.
fn comes_in(graph: &Graph, edge: &Edge, camera_of: &[Option<u16>]) -> bool {
    camera_of[edge.to.0].is_some() && camera_of[edge.from.0] != camera_of[edge.to.0] && !is_handle(graph, edge.from)
}

/// Whether an instance is a sink on which nothing depends, and which depends on no handle and on nothing that is seen later.
fn is_apart(graph: &Graph, index: usize) -> bool {
    let instance = &graph.instances[index];
    instance.node_type.role == Role::Sink
        && instance.cost == Cost::default()
        && graph
            .edges
            .iter()
            .all(|it| it.from.0 != index && (it.to.0 != index || !(is_handle(graph, it.from) || is_delayed(it))))
}

/// By instance: the camera whose lane it belongs to, and the lookahead of that lane, 0 without one.
fn lanes(graph: &Graph) -> (Vec<Option<u16>>, Vec<Interval>) {
    let mut camera_of: Vec<Option<u16>> =
        graph.instances.iter().map(|it| it.camera.filter(|_| it.cost == Cost::default()).map(|it| it.0)).collect();
    shrink(graph, &mut camera_of);
    loop {
        let lookahead = lookaheads(graph, &camera_of);
        let prompt: Vec<usize> =
            graph.edges.iter().filter(|it| is_prompt(graph, it, &camera_of)).map(|it| it.to.0).collect();
        let stays_behind = prompt.into_iter().filter(|&it| lookahead[it].0 > 0).collect::<Vec<_>>();
        if stays_behind.is_empty() {
            return (camera_of, lookahead);
        }
        stays_behind.into_iter().for_each(|it| camera_of[it] = None);
        shrink(graph, &mut camera_of);
    }
}

/// Takes out of lanes what is triggered from elsewhere.
fn shrink(graph: &Graph, camera_of: &mut [Option<u16>]) {
    let mut shrinks = true;
    while shrinks {
        shrinks = false;
        for edge in &graph.edges {
            let (from, to) = (edge.from.0, edge.to.0);
            if triggers(graph, edge) && camera_of[to].is_some() && camera_of[from] != camera_of[to] {
                camera_of[to] = None;
                shrinks = true;
            }
        }
    }
}

fn triggers(graph: &Graph, edge: &Edge) -> bool {
    graph.instances[edge.to.0].takes[edge.to.1] != InputPolicy::Latest
}

/// Whether what comes into a lane along an edge is to be seen at once.
fn is_prompt(graph: &Graph, edge: &Edge, camera_of: &[Option<u16>]) -> bool {
    let is_later = edge.delay.map_or(edge.feedback, |it| it.0 > 0);
    comes_in(graph, edge, camera_of) && !triggers(graph, edge) && !is_later
}

/// By instance: by how much its lane may be ahead of others.
fn lookaheads(graph: &Graph, camera_of: &[Option<u16>]) -> Vec<Interval> {
    let mut known = BTreeMap::new();
    let of = |camera: Option<u16>| {
        camera.map_or(Interval(0), |it| *known.entry(it).or_insert_with(|| lookahead(graph, camera_of, it)))
    };
    camera_of.iter().copied().map(of).collect()
}

fn lookahead(graph: &Graph, camera_of: &[Option<u16>], camera: u16) -> Interval {
    let own = |index: usize| camera_of[index] == Some(camera);
    let is_source = |index: usize| !graph.edges.iter().any(|it| it.to.0 == index && triggers(graph, it));
    let mut shortest = period(graph, camera_of, camera);
    for edge in &graph.edges {
        let (from, to) = (edge.from.0, edge.to.0);
        let bound = if own(from) != own(to) && is_handle(graph, edge.from) {
            let reacts_after_s = graph.instances[from].settings.plan().reacts_after_s;
            // What reacts never, or in years, bounds nothing.
            if reacts_after_s >= LONG_S {
                continue;
            }
            Interval::from_s(reacts_after_s)
        } else if own(to)
            && let Some(delay) = edge.delay
        {
            delay
        } else if own(to) && is_source(to) && is_prompt(graph, edge, camera_of) {
            Interval(0)
        } else {
            continue;
        };
        shortest = Interval(shortest.0.min(bound.0.max(0)));
    }
    shortest
}

/// The shortest period of a camera's sources; 0 if none is known.
fn period(graph: &Graph, camera_of: &[Option<u16>], camera: u16) -> Interval {
    let mut shortest = None;
    for (index, instance) in graph.instances.iter().enumerate().filter(|it| camera_of[it.0] == Some(camera)) {
        if graph.edges.iter().any(|it| it.to.0 == index && triggers(graph, it)) {
            continue;
        }
        // What gives no stream, such as a head that is there, has no rate and does not matter.
        let Some(rate_hz) = instance.settings.plan().rate_hz else { continue };
        let period = Interval::from_s(1.0 / rate_hz);
        shortest = Some(shortest.map_or(period, |it: Interval| it.min(period)));
    }
    shortest.unwrap_or(Interval(0))
}
