//! One node at work: its inboxes, what leads to it and what leaves from it.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::Arc;

use crossbeam::channel::{Receiver, Sender};
use foveate_messages::{Stamp, Time};

use crate::budget::Ages;
use crate::busy::Work;
use crate::gates::{Gate, Gates, is_anchor};
use crate::inbox::{DeliveryOutcome, Inbox};
use crate::ledger::Ledger;
use crate::stage::Costs;
use foveate_node::error::NodeError;
use foveate_node::guard::guarded;
use foveate_node::io::Packet;
use foveate_node::registry::{ErasedNode, Settings};
use foveate_node::setup::Purpose;
use foveate_rig::graph::{Graph, WhenFull};

/// One node instance at work.
pub(crate) struct Slot {
    /// `None`: stopped after a failure.
    pub(super) node: Option<Box<dyn ErasedNode>>,
    /// Its settings, where they have changed since it was made.
    pub(super) settings: Option<Arc<dyn Settings>>,
    pub(super) inboxes: Vec<Inbox>,
    pub(super) latest: Vec<Vec<Option<Packet>>>,
    /// By input port, by source: the edge that leads there.
    pub(super) input_edges: Vec<Vec<usize>>,
    /// By output port: the edges that leave from there.
    pub(super) routes: Vec<Vec<Route>>,
    pub(super) sequences: Vec<u64>,
    /// What its activations cost on the logical clock, where they cost anything.
    pub(super) work: Option<Box<Work>>,
    /// What holds messages up while its scale is suspended.
    pub(super) gate: Option<Gate>,
    /// What it gave out and its consumers cannot take yet; until they have, it takes nothing itself.
    pub(super) parked: VecDeque<Parked>,
    /// Restarts in a row without a successful activation.
    pub(super) restarts: u32,
    /// When it is restarted; `None` while it runs.
    pub(super) restart_at: Option<Time>,
    /// Whether it has neither of the two above: looked at on every hop.
    pub(super) is_plain: bool,
    /// By output port: ages of what it gives out, where a budget ends there; `None`: none ends at any of its outputs.
    pub(super) given: Option<Box<[Option<Ages>]>>,
}

/// A message that could not be delivered yet.
pub(super) struct Parked {
    pub port: usize,
    /// Which of the port's routes.
    pub route: usize,
    pub packet: Packet,
}

/// How an edge is travelled.
pub(crate) enum Route {
    /// The consumer runs on the same worker.
    Here(usize),
    /// The consumer runs on another stage of the same logical clock: what travels is gathered in [`Stage::outgoing`](crate::stage::Stage).
    Beyond(usize),
    /// Not to a node: an anchor tells the gates where its scale is.
    Gate(usize),
    /// Across threads.
    Remote {
        edge: usize,
        sender: Sender<Numbered>,
        receiver: Receiver<Numbered>,
        when_full: WhenFull,
        dropped: u64,
        /// Messages that were sent, those that were dropped included.
        sent: u64,
    },
}

/// A message on a queue between threads, and how many were sent along its edge before it.
pub(crate) type Numbered = (u64, Packet);

/// An edge as its consumer's worker sees it.
pub(crate) struct EdgeEnd {
    pub(super) to: (usize, usize),
    pub(super) source: usize,
    /// Messages that were given out along it and have come, or were lost in a queue between threads.
    pub(super) n_given: u64,
    pub(crate) ledger: Ledger,
}

impl Slot {
    /// Makes node `index`.
    ///
    /// # Errors
    /// Its refusal.
    pub(super) fn make(
        graph: &Graph,
        index: usize,
        out_dir: Option<PathBuf>,
    ) -> Result<Box<dyn ErasedNode>, NodeError> {
        let instance = &graph.instances[index];
        let setup = graph.setup(index, out_dir, Purpose::Run);
        match guarded(|| instance.settings.build(&setup)) {
            Ok(Ok(node)) => Ok(node),
            Ok(Err(refusal)) => Err(NodeError::input(format_args!("{}: {}", instance.path, in_words(&refusal)))),
            Err(said) => Err(NodeError::program(format_args!(
                "{}: while it was made, it {said}{}",
                instance.path,
                instance.library_in_words()
            ))),
        }
    }

    /// Node `index` with all that leads to it and away from it.
    pub(super) fn new(graph: &Graph, gates: &Gates, index: usize, node: Box<dyn ErasedNode>, costs: Costs) -> Slot {
        let instance = &graph.instances[index];
        let random = graph.setup(index, None, Purpose::Run).random;
        let ports = &instance.node_type.ports;
        let mut input_edges = vec![Vec::new(); ports.inputs.len()];
        let mut routes: Vec<Vec<Route>> = ports.outputs.iter().map(|_| Vec::new()).collect();
        for (number, edge) in graph.edges.iter().enumerate() {
            if edge.to.0 == index {
                input_edges[edge.to.1].push(number);
            }
            if edge.from.0 == index {
                routes[edge.from.1].push(Route::Here(number));
            }
        }
        if is_anchor(instance) {
            // First, so that what follows the space finds the gate open.
            routes.iter_mut().for_each(|it| it.insert(0, Route::Gate(instance.scale)));
        }
        let inboxes = ports
            .inputs
            .iter()
            .zip(&instance.takes)
            .zip(&input_edges)
            .map(|((port, &policy), edges)| Inbox::new(policy, edges.len(), random.fork(port.name)));
        let work = Work::new(instance.cost, random.fork("cost_ms"));
        let work = work.filter(|_| costs == Costs::Simulated).map(Box::new);
        let gate = gates.before(instance);
        Slot {
            node: Some(node),
            settings: None,
            inboxes: inboxes.collect(),
            latest: input_edges.iter().map(|edges| vec![None; edges.len()]).collect(),
            input_edges,
            routes,
            sequences: vec![0; ports.outputs.len()],
            parked: VecDeque::new(),
            restarts: 0,
            restart_at: None,
            is_plain: work.is_none() && gate.is_none(),
            work,
            gate,
            given: None,
        }
    }

    /// Keeps the ages of what it gives out at output `port` from now on.
    pub(crate) fn measure(&mut self, port: usize) {
        let n_ports = self.routes.len();
        let given = self.given.get_or_insert_with(|| vec![None; n_ports].into());
        given[port].get_or_insert_default();
    }

    /// Ages of what it gave out at output `port`, where a budget ends there.
    pub(crate) fn ages(&self, port: usize) -> Option<&Ages> {
        self.given.as_ref()?[port].as_ref()
    }

    /// Enters that it gives out a message at session time `now`.
    #[inline]
    pub(super) fn give(&mut self, port: usize, stamp: Stamp, now: Time) {
        if let Some(given) = &mut self.given
            && let Some(Some(ages)) = given.get_mut(port)
        {
            ages.record(stamp, now);
        }
    }

    /// Whether it may take a message right behind the activation that gave it.
    #[inline]
    pub(super) fn may_follow(&self) -> bool {
        self.work.is_none() && self.is_open()
    }

    /// Whether its scale is not suspended, as far as that concerns it.
    #[inline]
    pub(super) fn is_open(&self) -> bool {
        self.gate.as_ref().is_none_or(Gate::is_open)
    }

    /// Whether consumers hold it up.
    #[inline]
    pub(super) fn is_blocked(&self) -> bool {
        !self.parked.is_empty()
    }

    /// Lets go of the node. Gives the words of its panic, if it does not go in peace.
    pub(super) fn drop_node(&mut self) -> Result<(), String> {
        let node = self.node.take();
        guarded(|| drop(node))
    }

    /// Nothing will be kept any more.
    pub(super) fn close(&mut self, ends: &mut [Option<EdgeEnd>], now: Time) {
        self.restart_at = None;
        for (inbox, edges) in self.inboxes.iter_mut().zip(&self.input_edges) {
            inbox.close(&mut |source, outcome| enter(&mut ends[edges[source]], now, outcome));
        }
    }

    /// The routes that leave this slot.
    pub(crate) fn routes_mut(&mut self) -> impl Iterator<Item = &mut Route> {
        self.routes.iter_mut().flatten()
    }
}

/// Enters in the ledger of an edge what becomes of one of its messages.
pub(super) fn enter(end: &mut Option<EdgeEnd>, now: Time, outcome: DeliveryOutcome<'_>) {
    let Some(EdgeEnd { ledger, .. }) = end else { return };
    match outcome {
        DeliveryOutcome::Taken(packet) => ledger.take(packet.stamp, now, || packet.payload.quality()),
        DeliveryOutcome::PassedOver => ledger.dropped += 1,
        DeliveryOutcome::Missing => ledger.gaps += u64::from(ledger.delivered > 0),
    }
}

pub(super) fn in_words(refusal: &foveate_node::error::ConfigError) -> String {
    match &refusal.setting {
        Some(setting) => format!("`{setting}`: {}", refusal.message),
        None => refusal.message.clone(),
    }
}
