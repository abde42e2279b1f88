//! A rig after all checks: node instances in the order of their schedule, and the edges between them.

mod budget;
mod picture;
mod record;

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

pub use budget::{Budget, BudgetEnd, BudgetPort};
use foveate_messages::{CameraId, Interval, ScaleId, Time};
use foveate_scene::AnchorRule;
use foveate_scene::calibration::Calibration;

pub use self::record::{PictureForm, Record, SessionPacking};
use foveate_diagnostics::Diagnostics;
use foveate_node::Host;
use foveate_node::Origin;
use foveate_node::page::Pages;
use foveate_node::port::InputPolicy;
use foveate_node::registry::{NodeType, Settings};
use foveate_node::scale::{ScalePlace, ScaleTree};
use foveate_node::setup::{Claims, Purpose, Setup};

/// A checked rig, ready to run.
pub struct Graph {
    /// The rig's name.
    pub name: String,
    /// The rig's seed.
    pub seed: u64,
    /// Where simulated and file-fed sources are cut off.
    pub duration: Option<Interval>,
    /// Whether the summary of a run has its speed too, which differs from run to run.
    pub report_speed: bool,
    /// Whether a run that can be repeated keeps to the pace of the clock on the wall.
    pub paced: bool,
    /// The folder of the rig file.
    pub rig_dir: PathBuf,
    /// All cameras.
    pub calibration: Arc<Calibration>,
    /// The scales, parents before children.
    pub scales: Vec<Scale>,
    /// The same scales in the form that nodes get.
    pub places: Arc<[ScalePlace]>,
    /// Node instances; each stands behind all that trigger it.
    pub instances: Vec<Instance>,
    /// Edges, by producer, then by consumer.
    pub edges: Vec<Edge>,
    /// Promised ages along paths, in the order of the rig.
    pub budgets: Vec<Budget>,
    /// How a run is recorded, where the rig asks for it.
    pub record: Option<Record>,
    /// The rig with all defaults filled in: TOML that can be run again.
    pub resolved: String,
    /// Which node writes which file of the results.
    pub claims: Claims,
    /// What serves pages to browsers while this graph runs; none unless the caller sets one.
    pub pages: Pages,
    /// Reports failures at once while this graph runs; nothing unless the caller sets one.
    pub host: Host,
    /// What is probably a mistake.
    pub warnings: Diagnostics,
}

/// A named subgraph with its own space.
#[derive(Debug, Clone, PartialEq)]
pub struct Scale {
    /// Its name.
    pub name: String,
    /// The scale it nests in.
    pub parent: Option<String>,
    /// The target that its space moves with: a node of the parent, dot, the target's name.
    pub anchor: Option<String>,
    /// How that target is picked; there with `anchor`.
    pub anchor_rule: Option<AnchorRule>,
    /// Working volume in its own space [m], opposite corners.
    pub volume_m: Option<[[f64; 3]; 2]>,
    /// Extent around the anchor [m].
    pub radius_m: Option<f64>,
}

/// One node, for one camera where the rig says so.
#[derive(Clone)]
pub struct Instance {
    /// Full name: `room.leds[wide-3]`, `room.targets`.
    pub path: String,
    /// The node's name in its scale: `leds`.
    pub node: String,
    /// Index of the scale.
    pub scale: usize,
    /// The camera it serves.
    pub camera: Option<CameraId>,
    /// Its type.
    pub node_type: Arc<NodeType>,
    /// Its settings; shared by all instances of the node.
    pub settings: Arc<dyn Settings>,
    /// What happens when it fails.
    pub on_error: OnError,
    /// By input port: how it takes data, as the port itself says or as the rig chose.
    pub takes: Vec<InputPolicy>,
    /// What each of its activations costs on the logical clock.
    pub cost: Cost,
}

impl Instance {
    /// " (`star.finder` of LIBRARY)" where its type comes from a library, and nothing otherwise: for sentences about its failures.
    pub fn library_in_words(&self) -> String {
        match &self.node_type.origin {
            Origin::Library(path) => format!(" (`{}` of {})", self.node_type.name, path.display()),
            Origin::Linked(_) => String::new(),
        }
    }
}

/// How long an activation of a node keeps it busy in a run that is not live; there, where an activation takes no time by itself, this
/// shows what becomes of the data under load. A live run takes the time it takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Cost {
    /// For each activation.
    pub time: Interval,
    /// Each activation takes up to this much more or less, uniformly (seeded); at most `time`.
    pub jitter: Interval,
}

/// What happens when a node fails on a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OnError {
    /// The node stops, and with it all that depends on it alone; the rest of the rig continues.
    #[default]
    Stop,
    /// The message is dropped and counted; the node keeps its state (after a panic it is restarted).
    Skip,
    /// The message is dropped and counted; the node is restarted.
    Restart,
}

/// A connection from an output port to an input port.
#[derive(Debug, Clone, PartialEq)]
pub struct Edge {
    /// Producing instance and its output port.
    pub from: (usize, usize),
    /// Consuming instance and its input port.
    pub to: (usize, usize),
    /// `room.leds[wide-3].features -> room.targets.features`
    pub name: String,
    /// Closes a cycle.
    pub feedback: bool,
    /// Delay of its messages in a run that is not live, where the rig states one.
    pub delay: Option<Interval>,
    /// What happens when the consumer is behind.
    pub queue: Queue,
    /// What the edge promises.
    pub require: Option<Requirement>,
}

/// The queue of an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Queue {
    /// Messages that may wait, at least 1.
    pub capacity: usize,
    /// What happens to one more.
    pub when_full: WhenFull,
}

impl Default for Queue {
    fn default() -> Self {
        Self { capacity: 8, when_full: WhenFull::DropOldest }
    }
}

/// Messages that may wait before a sink where the rig does not say: half a second of pictures, since a disk pauses for so long.
pub const SINK_CAPACITY: usize = 32;

/// What happens when a message meets a full queue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum WhenFull {
    /// The oldest waiting message is dropped and counted.
    #[default]
    DropOldest,
    /// The new message is dropped and counted.
    DropNewest,
    /// The producer waits.
    Wait,
}

/// What an edge promises.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Requirement {
    /// Age at delivery, 99th percentile, at most [s].
    pub age_s: Option<f64>,
    /// Messages a second, at least [Hz].
    pub rate_hz: Option<f64>,
    /// Mean standard deviation that the payload states, at most [px or m].
    pub sigma: Option<f64>,
    /// Fraction of the messages that were lost (gaps and drops), at most.
    pub loss: Option<f64>,
    /// Not meeting it fails the run (exit code 3).
    pub must: bool,
}

impl Instance {
    /// Whether it works on a device: see [`Node::is_live`](crate::Node::is_live).
    pub fn is_live(&self) -> bool {
        self.settings.is_live()
    }
}

impl Graph {
    /// The setup of instance `index`.
    pub fn setup(&self, index: usize, out_dir: Option<PathBuf>, purpose: Purpose) -> Setup {
        let instance = &self.instances[index];
        let scale = &self.scales[instance.scale];
        Setup {
            instance: instance.path.clone(),
            scale: scale.name.clone(),
            scales: ScaleTree { own: scale_id(instance.scale), places: Arc::clone(&self.places) },
            camera: instance.camera,
            calibration: Arc::clone(&self.calibration),
            connected: self.connected(index),
            volume_m: scale.volume_m,
            radius_m: scale.radius_m,
            anchor: scale.anchor_rule,
            random: foveate_estimation::random::Random::new(self.seed).fork(&instance.path),
            rig_dir: self.rig_dir.clone(),
            out_dir,
            purpose,
            claims: self.claims.clone(),
            pages: self.pages.clone(),
            host: self.host.clone(),
        }
    }

    fn connected(&self, index: usize) -> Vec<String> {
        let ports = &self.instances[index].node_type.ports.inputs;
        let ends = self.edges.iter().map(|it| it.to).filter(|it| it.0 == index);
        let mut found: Vec<String> = ends.map(|(_, port)| ports[port].name.to_owned()).collect();
        found.sort_unstable();
        found.dedup();
        found
    }

    /// The part of the rig that `wanted` nodes need: they, and what they get messages from, directly or through others, but for what
    /// comes back to them along an edge that closes a cycle; such inputs are only sampled, and stay open. Budgets are of the whole rig, and left out.
    pub fn upstream_of(&self, wanted: impl Fn(&Instance) -> bool) -> Graph {
        let mut kept: Vec<bool> = self.instances.iter().map(wanted).collect();
        let mut grew = true;
        while grew {
            grew = false;
            for edge in self.edges.iter().rev().filter(|it| !it.feedback) {
                grew |= kept[edge.to.0] && !kept[edge.from.0];
                kept[edge.from.0] |= kept[edge.to.0];
            }
        }
        let mut places = vec![usize::MAX; kept.len()];
        let mut instances = Vec::new();
        for (index, instance) in self.instances.iter().enumerate().filter(|it| kept[it.0]) {
            places[index] = instances.len();
            instances.push(instance.clone());
        }
        let edges = self.edges.iter().filter(|it| kept[it.from.0] && kept[it.to.0]);
        let edges =
            edges.map(|it| Edge { from: (places[it.from.0], it.from.1), to: (places[it.to.0], it.to.1), ..it.clone() });
        Graph {
            name: self.name.clone(),
            seed: self.seed,
            duration: self.duration,
            report_speed: self.report_speed,
            paced: self.paced,
            rig_dir: self.rig_dir.clone(),
            calibration: Arc::clone(&self.calibration),
            scales: self.scales.clone(),
            places: Arc::clone(&self.places),
            edges: edges.collect(),
            budgets: Vec::new(),
            instances,
            record: self.record.clone(),
            resolved: self.resolved.clone(),
            claims: self.claims.clone(),
            pages: self.pages.clone(),
            host: self.host.clone(),
            warnings: Diagnostics::default(),
        }
    }

    /// Whether `time` is past the rig's duration.
    pub fn is_over(&self, time: Time) -> bool {
        self.duration.is_some_and(|duration| time >= Time::ZERO + duration)
    }
}

/// The number of a scale; a text as long as a rig may be has no more scales than there are numbers.
pub(crate) fn scale_id(index: usize) -> ScaleId {
    ScaleId(u32::try_from(index).unwrap_or(u32::MAX))
}

impl fmt::Debug for Graph {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Graph")
            .field("name", &self.name)
            .field("instances", &self.instances.iter().map(|it| &it.path).collect::<Vec<_>>())
            .field("edges", &self.edges.iter().map(|it| &it.name).collect::<Vec<_>>())
            .finish_non_exhaustive()
    }
}
