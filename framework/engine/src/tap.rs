//! What a recorder sees of a run: every message that nodes give out, and the order in which everything happened.
//!
//! Each stage writes into a lane of its own, which the recorder empties; the two meet only to exchange one list for another. All events of a run are numbered
//! without a gap, and an event has a higher number than what it follows from, whichever threads they are on. [`replay`](crate::replay) takes the events in this order.

use std::collections::VecDeque;
use std::fmt;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use foveate_messages::{Stamp, Time, Wire};
use foveate_node::error::NodeError;
use foveate_node::given::Table;
use foveate_node::io::{Gap, Packet};
use foveate_node::report::Report;
use foveate_rig::graph::Graph;

/// What a message counts beside its bulk data [bytes].
const MESSAGE_BYTES: usize = 512;
/// What an event without a message counts [bytes].
const EVENT_BYTES: usize = 64;
/// Part of the memory that pictures may take up; the rest stays free for what is small.
const PICTURES: f64 = 0.75;
/// Events are taken up to this multiple of the memory: without a whole order nothing can be replayed.
const EVENTS: usize = 2;
/// How long a run that waits for its recorder sleeps before it looks again.
const LOOK: Duration = Duration::from_millis(50);

/// Something that happened in a run.
#[derive(Clone)]
pub struct Entry {
    /// Counts all events of the run from 0.
    pub order: u64,
    /// Session time at which it happened.
    pub now: Time,
    /// What.
    pub event: Event,
}

/// What happened. Instances and edges are numbered as in the graph.
#[derive(Clone)]
pub enum Event {
    /// A node was activated.
    Activated {
        /// The node.
        instance: usize,
        /// By what.
        how: Activation,
    },
    /// A node gave out a message; it follows the node's activation.
    Emitted {
        /// The node.
        instance: usize,
        /// Its output port.
        port: usize,
        /// Capture time, source and number of the message.
        stamp: Stamp,
        /// Whether the message is in the recording.
        is_kept: bool,
        /// The message; `None` where it is not kept, and from a recording where it is not needed.
        packet: Option<Packet>,
    },
    /// A node declared a message missing.
    Gap {
        /// The node.
        instance: usize,
        /// Its output port.
        port: usize,
        /// When, and why.
        gap: Gap,
    },
    /// A declared gap was entered in the ledger of an edge.
    GapEntered {
        /// The edge.
        edge: usize,
    },
    /// A message came to its consumer.
    Delivered {
        /// The edge.
        edge: usize,
        /// Which of the messages that were given out along it, counted from 0.
        number: u64,
        /// What became of it.
        fate: Fate,
    },
    /// Messages were lost in a queue between threads.
    Lost {
        /// The edge.
        edge: usize,
        /// The first of them, as numbered above.
        first: u64,
        /// How many.
        count: u64,
    },
    /// A node failed.
    Failed {
        /// The node.
        instance: usize,
        /// Capture time of the message that it failed on.
        seen: Time,
        /// How.
        error: NodeError,
        /// What was done about it.
        action: &'static str,
    },
    /// Live settings of a node changed.
    Changed {
        /// The node.
        instance: usize,
        /// Their values from here on.
        values: Table,
    },
    /// The data is over: what waits is delivered.
    Ending,
    /// A node finished.
    Finished {
        /// The node.
        instance: usize,
        /// What it reported.
        report: Box<Report>,
        /// How it failed, if it did.
        error: Option<NodeError>,
    },
    /// The run is over.
    Ended {
        /// It was ended from outside.
        interrupted: bool,
        /// It had a time limit.
        is_cut_short: bool,
    },
}

/// What activates a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Activation {
    /// A message that came in.
    #[default]
    Message,
    /// A message that waited for others which will not come any more.
    Flush,
    /// Its own clock: it is a source.
    Due,
}

/// What becomes of a message at its consumer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fate {
    /// It waits at its port, or is sampled from there.
    Put,
    /// The same while the consumer is busy: the rig's queue decides which messages stay.
    PutBounded,
    /// Its consumer's scale is suspended.
    Suspended,
    /// Its consumer has stopped.
    Stopped,
}

/// Which messages of a port are wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Wanted {
    /// None.
    #[default]
    No,
    /// All; when memory is short they are left out last.
    Yes,
    /// All; when memory is short they are left out first.
    First,
}

/// How much a recorder did not get in time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LeftOut {
    /// Pictures.
    pub pictures: u64,
    /// Other messages.
    pub messages: u64,
}

/// Where a recorder listens to a run. Clones are the same tap.
#[derive(Clone)]
pub struct Tap(Arc<Shared>);

struct Shared {
    /// By instance, by output port.
    wanted: Vec<Vec<Wanted>>,
    /// Bytes that may wait for the recorder.
    memory: usize,
    /// The run waits for the recorder when they do, instead of leaving messages out.
    waits: bool,
    next: AtomicU64,
    waiting: AtomicUsize,
    is_closed: AtomicBool,
    is_order_lost: AtomicBool,
    n_pictures: AtomicU64,
    n_messages: AtomicU64,
    lanes: Mutex<Vec<Arc<Mutex<Vec<Entry>>>>>,
    has_room: Condvar,
    room: Mutex<()>,
}

impl Tap {
    /// A tap on a run of `graph`. `wanted` says for each output port (instance, port) whether its messages are; those that cannot leave the process never are. At most
    /// `memory` bytes wait for the recorder: beyond that messages are left out and counted, or the run `waits`, which only one on a logical clock may do.
    pub fn new(graph: &Graph, memory: usize, waits: bool, wanted: impl Fn(usize, usize) -> Wanted) -> Tap {
        let of_instance = |index: usize| {
            let outputs = graph.instances[index].node_type.ports.outputs.iter().enumerate();
            let of_port = outputs.map(|(port, it)| match it.message.wire {
                Wire::Local => Wanted::No,
                Wire::Portable(_) => wanted(index, port),
            });
            of_port.collect()
        };
        Tap(Arc::new(Shared {
            wanted: (0..graph.instances.len()).map(of_instance).collect(),
            memory,
            waits,
            next: AtomicU64::new(0),
            waiting: AtomicUsize::new(0),
            is_closed: AtomicBool::new(false),
            is_order_lost: AtomicBool::new(false),
            n_pictures: AtomicU64::new(0),
            n_messages: AtomicU64::new(0),
            lanes: Mutex::default(),
            has_room: Condvar::new(),
            room: Mutex::new(()),
        }))
    }

    /// Moves all that has happened since the last call into `entries`, lane by lane; within a lane in order.
    pub fn drain(&self, entries: &mut VecDeque<Entry>) {
        let mut freed = 0;
        for lane in lock(&self.0.lanes).iter() {
            let taken = std::mem::take(&mut *lock(lane));
            freed += taken.iter().map(cost).sum::<usize>();
            entries.extend(taken);
        }
        if freed > 0 {
            self.0.waiting.fetch_sub(freed, Ordering::Relaxed);
            self.0.has_room.notify_all();
        }
    }

    /// Nothing is recorded any more: the disk is full, or the like.
    pub fn close(&self) {
        self.0.is_closed.store(true, Ordering::Relaxed);
        lock(&self.0.lanes).iter().for_each(|it| lock(it).clear());
        self.0.has_room.notify_all();
    }

    /// The same, but nothing is recorded before [`Tap::open`].
    #[must_use]
    pub fn closed(self) -> Tap {
        self.0.is_closed.store(true, Ordering::Relaxed);
        self
    }

    /// Records from now on, from event 0.
    pub fn open(&self) {
        self.0.next.store(0, Ordering::Relaxed);
        self.0.is_order_lost.store(false, Ordering::Relaxed);
        self.0.is_closed.store(false, Ordering::Relaxed);
    }

    /// Records nothing from now on; what waits for the recorder stays.
    pub fn rest(&self) {
        self.0.is_closed.store(true, Ordering::Relaxed);
        self.0.has_room.notify_all();
    }

    /// What was left out so far.
    pub fn left_out(&self) -> LeftOut {
        LeftOut {
            pictures: self.0.n_pictures.load(Ordering::Relaxed),
            messages: self.0.n_messages.load(Ordering::Relaxed),
        }
    }

    /// Whether even events had to be left out: the recording then ends there for who wants to replay it.
    pub fn is_order_lost(&self) -> bool {
        self.0.is_order_lost.load(Ordering::Relaxed)
    }

    /// A lane for one stage.
    pub(crate) fn lane(&self) -> Lane {
        let entries = Arc::default();
        lock(&self.0.lanes).push(Arc::clone(&entries));
        Lane { shared: Arc::clone(&self.0), entries }
    }
}

impl fmt::Debug for Tap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Tap").finish_non_exhaustive()
    }
}

/// Where one stage writes down what happens in it.
pub(crate) struct Lane {
    shared: Arc<Shared>,
    entries: Arc<Mutex<Vec<Entry>>>,
}

impl Lane {
    /// Another lane of the same tap.
    pub fn another(&self) -> Lane {
        Tap(Arc::clone(&self.shared)).lane()
    }

    /// A message is given out.
    pub fn emitted(&self, instance: usize, port: usize, packet: &Packet, now: Time) {
        let shared = &self.shared;
        if shared.is_closed.load(Ordering::Relaxed) {
            return;
        }
        let kept = match shared.wanted[instance].get(port).copied().unwrap_or_default() {
            Wanted::No => None,
            wanted => {
                let bytes = packet.payload.bulk().map_or(0, <[u8]>::len) + MESSAGE_BYTES;
                let first = (shared.memory as f64 * PICTURES) as usize;
                let limit = if wanted == Wanted::First { first } else { shared.memory };
                self.wait_for_room(bytes, limit);
                let has_room = shared.waits || shared.waiting.load(Ordering::Relaxed) + bytes <= limit;
                if !has_room {
                    let count = if wanted == Wanted::First { &shared.n_pictures } else { &shared.n_messages };
                    count.fetch_add(1, Ordering::Relaxed);
                }
                has_room.then(|| packet.clone())
            }
        };
        self.push(now, Event::Emitted { instance, port, stamp: packet.stamp, is_kept: kept.is_some(), packet: kept });
    }

    /// Something else has happened.
    pub fn push(&self, now: Time, event: Event) {
        let shared = &self.shared;
        if shared.is_closed.load(Ordering::Relaxed) || shared.is_order_lost.load(Ordering::Relaxed) {
            return;
        }
        let mut entry = Entry { order: 0, now, event };
        let bytes = cost(&entry);
        if shared.waiting.fetch_add(bytes, Ordering::Relaxed) > EVENTS * shared.memory && !shared.waits {
            shared.is_order_lost.store(true, Ordering::Relaxed);
        }
        let mut entries = lock(&self.entries);
        // Under the lock, so that a lane is in order.
        entry.order = shared.next.fetch_add(1, Ordering::Relaxed);
        entries.push(entry);
    }

    fn wait_for_room(&self, bytes: usize, limit: usize) {
        let shared = &self.shared;
        if !shared.waits {
            return;
        }
        let mut room = lock(&shared.room);
        // What is larger than all the memory goes when there is nothing else.
        while shared.waiting.load(Ordering::Relaxed) > limit.saturating_sub(bytes)
            && !shared.is_closed.load(Ordering::Relaxed)
        {
            room = shared.has_room.wait_timeout(room, LOOK).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

fn cost(entry: &Entry) -> usize {
    match &entry.event {
        Event::Emitted { packet: Some(packet), .. } => {
            packet.payload.bulk().map_or(0, <[u8]>::len) + MESSAGE_BYTES + EVENT_BYTES
        }
        _ => EVENT_BYTES,
    }
}

fn lock<T>(it: &Mutex<T>) -> MutexGuard<'_, T> {
    it.lock().unwrap_or_else(PoisonError::into_inner)
}
