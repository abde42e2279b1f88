//! Which scales are suspended: the state of their anchors, inherited by all scales nested in them.
//!
//! The engine looks at a scale's gate before it hands a message to a detector, integrator or model filter of that scale; all else
//! goes on, so that heads can find the target again. Each spell of a scale is noted with its reason.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use foveate_messages::{Interval, ScaleSpace, Time};

use foveate_node::io::Packet;
use foveate_node::node::{Node, Role};
use foveate_node::scale::ScaleAnchor;
use foveate_rig::graph::{Graph, Instance};

/// Suspensions that are kept one by one; more are only counted.
const KEPT: usize = 100;

/// When and why one scale was suspended.
#[derive(Debug, Clone, PartialEq)]
pub struct Suspensions {
    /// The scale.
    pub scale: String,
    /// How often.
    pub count: u64,
    /// How long altogether.
    pub time: Interval,
    /// The first of these spells.
    pub spells: Vec<SuspensionSpan>,
}

/// Once that a scale was suspended; times are those of the targets that said so.
#[derive(Debug, Clone, PartialEq)]
pub struct SuspensionSpan {
    /// From then on.
    pub from: Time,
    /// When it was resumed; `None`: it was not.
    pub until: Option<Time>,
    /// Why, as a sentence.
    pub why: String,
}

/// The gate of one scale as its nodes see it: a counter that rises whenever the gate opens or closes, odd while it is
/// closed.
#[derive(Debug, Clone, Default)]
pub(crate) struct Gate(Arc<AtomicU64>);

impl PartialEq for Gate {
    fn eq(&self, other: &Gate) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl Gate {
    /// Whether messages may pass.
    #[inline]
    pub(crate) fn is_open(&self) -> bool {
        self.0.load(Ordering::Relaxed).is_multiple_of(2)
    }

    /// How often it has been turned.
    pub(crate) fn activations(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }

    /// One that stands as this one does now, and turns by itself.
    pub(crate) fn apart(&self) -> Gate {
        Gate(Arc::new(AtomicU64::new(self.activations())))
    }

    /// Lets it stand as it does after that many turns.
    pub(crate) fn turn_to(&self, activations: u64) {
        self.0.store(activations, Ordering::Relaxed);
    }

    fn activation(&self) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}

/// The gates of all scales of one run.
#[derive(Debug)]
pub(crate) struct Gates {
    /// By scale: whether it is suspended, by its own anchor or by that of one around it.
    gates: Vec<Gate>,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    /// By scale.
    scales: Vec<ScaleState>,
}

#[derive(Debug)]
struct ScaleState {
    name: String,
    parent: Option<usize>,
    /// What its space moves with, if it moves.
    anchor: Option<String>,
    /// Whether it or one around it moves.
    can_stop: bool,
    is_lost: bool,
    was_found: bool,
    /// Since when it is suspended.
    since: Option<Time>,
    log: Suspensions,
}

impl Gates {
    /// All anchored scales are suspended until their targets are found. An anchor that is not part of the graph suspends nothing.
    pub(crate) fn new(graph: &Graph) -> Gates {
        let mut scales: Vec<ScaleState> = graph
            .scales
            .iter()
            .zip(graph.places.iter())
            .map(|(scale, place)| ScaleState {
                name: scale.name.clone(),
                parent: place.parent.map(|it| it.0 as usize),
                anchor: None,
                can_stop: false,
                is_lost: false,
                was_found: false,
                since: None,
                log: Suspensions { scale: scale.name.clone(), count: 0, time: Interval(0), spells: Vec::new() },
            })
            .collect();
        for instance in graph.instances.iter().filter(|it| is_anchor(it)) {
            let scale = &mut scales[instance.scale];
            scale.anchor = graph.scales[instance.scale].anchor.clone();
            scale.is_lost = true;
        }
        // Parents come first.
        for index in 0..scales.len() {
            let around = scales[index].parent.is_some_and(|it| scales[it].can_stop);
            scales[index].can_stop = around || scales[index].anchor.is_some();
        }
        let gates = scales.iter().map(|_| Gate::default()).collect();
        let gates = Gates { gates, state: Mutex::new(State { scales }) };
        gates.settle(&mut gates.lock(), Time::ZERO);
        gates
    }

    /// The gate before `instance`; `None` for one that nothing suspends.
    pub(crate) fn before(&self, instance: &Instance) -> Option<Gate> {
        if !matches!(instance.node_type.role, Role::Detector | Role::Integrator | Role::ModelFilter) {
            return None;
        }
        self.of_scale(instance.scale)
    }

    /// The gate of a scale; `None` for one that is never suspended.
    pub(crate) fn of_scale(&self, scale: usize) -> Option<Gate> {
        self.lock().scales[scale].can_stop.then(|| self.gates[scale].clone())
    }

    /// Takes what the anchor of `scale` says.
    pub(crate) fn hear(&self, scale: usize, packet: &Packet) {
        let Some(space) = packet.as_typed::<ScaleSpace>() else { return };
        let mut state = self.lock();
        let own = &mut state.scales[scale];
        let is_lost = space.target.is_none();
        own.was_found |= !is_lost;
        if std::mem::replace(&mut own.is_lost, is_lost) != is_lost {
            self.settle(&mut state, space.time);
        }
    }

    /// Opens and closes gates after an anchor's state has changed at `time`.
    fn settle(&self, state: &mut State, time: Time) {
        for index in 0..state.scales.len() {
            let scale = &state.scales[index];
            // Parents come first: theirs are settled.
            let around = scale.parent.filter(|&it| state.scales[it].since.is_some());
            let why = if let (true, Some(anchor)) = (scale.is_lost, &scale.anchor) {
                let how = if scale.was_found { "is lost" } else { "has not been found yet" };
                Some(format!("its target `{anchor}` {how}"))
            } else {
                around.map(|it| format!("scale `{}` around it is suspended", state.scales[it].name))
            };
            let scale = &mut state.scales[index];
            match (scale.since, why) {
                (None, Some(why)) => {
                    scale.since = Some(time);
                    scale.log.count += 1;
                    if scale.log.spells.len() < KEPT {
                        scale.log.spells.push(SuspensionSpan { from: time, until: None, why });
                    }
                    self.gates[index].activation();
                }
                (Some(_), None) => {
                    scale.end_spell(time);
                    self.gates[index].activation();
                }
                (Some(_), Some(_)) | (None, None) => {}
            }
        }
    }

    /// What happened to each scale that can be suspended, in the order of the scales; what still is, is so until `ended`.
    pub(crate) fn conclude(&self, ended: Time) -> Vec<Suspensions> {
        let state = self.lock();
        let logs = state.scales.iter().map(|it| {
            let mut log = it.log.clone();
            log.time.0 += it.since.map_or(0, |since| (ended - since).0.max(0));
            log
        });
        logs.filter(|it| it.count > 0).collect()
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl ScaleState {
    fn end_spell(&mut self, time: Time) {
        let Some(since) = self.since.take() else { return };
        self.log.time.0 += (time - since).0.max(0);
        let is_kept = self.log.count as usize == self.log.spells.len();
        if let Some(spell) = self.log.spells.last_mut().filter(|_| is_kept) {
            spell.until = Some(time);
        }
    }
}

/// Whether an instance is the one that follows the target of its scale.
pub(crate) fn is_anchor(instance: &Instance) -> bool {
    instance.node_type.name == ScaleAnchor::TYPE
}
