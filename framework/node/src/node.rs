//! What the author of a part writes: one type that implements [`Node`].

use schemars::JsonSchema;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::{ConfigError, NodeError};
use crate::figure::Figures;
use crate::io::Io;
use crate::port::Ports;
use crate::report::Report;
use crate::setup::Setup;
use foveate_messages::Time;

/// The one role that a node has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Role {
    /// Brings data into the graph: a camera, a file, a simulator.
    Source,
    /// Finds features in pictures.
    Detector,
    /// Fuses observations into targets.
    Integrator,
    /// Improves the data on one edge.
    ModelFilter,
    /// Says what the next scale looks at.
    Selector,
    /// Moves something.
    Actuator,
    /// Takes data out of the graph: files, pictures, figures.
    Sink,
}

impl Role {
    /// In words.
    pub const fn name(self) -> &'static str {
        match self {
            Role::Source => "source",
            Role::Detector => "detector",
            Role::Integrator => "integrator",
            Role::ModelFilter => "model filter",
            Role::Selector => "sub-region selector",
            Role::Actuator => "actuator",
            Role::Sink => "sink",
        }
    }
}

/// When a source wants to be activated next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Due {
    /// At this moment of the session clock; the message may be of an earlier capture time (delivery takes time).
    At(Time),
    /// Nothing yet: ask again soon. For devices only; a simulated or file-fed source knows its next moment.
    Waiting,
    /// Never again; also the answer of every node that is not a source.
    Never,
}

/// What is known of a node before anything runs, so that requirements can be checked against it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Plan {
    /// Messages a second on each output [Hz]; `None`: as many as trigger it.
    pub rate_hz: Option<f64>,
    /// Least age that the node adds to what passes through it [s].
    pub latency_s: f64,
    /// Of a node that gives handles in this process ([`Wire::Local`](crate::Wire::Local)): what one holder does to what they lead to is seen by the others
    /// so much later at the earliest [s]; infinite where they can only look at it. Lanes of cameras that share them may be ahead of each other by so much.
    pub reacts_after_s: f64,
}

/// A component with typed ports.
///
/// `new` checks, `process` trusts. A node reads no clock and no global: time comes in with the data ([`Io::now`],
/// stamps), randomness through [`Setup::random`], so that a run can be repeated byte by byte.
pub trait Node: Send + Sized + 'static {
    /// Name in rigs: plugin dot node, as `led.detector`.
    const TYPE: &'static str;
    /// What it is for.
    const ROLE: Role;
    /// One line for `foveate nodes`.
    const SUMMARY: &'static str;
    /// A device, whatever its settings: see [`Node::is_live`].
    const LIVE: bool = false;
    /// The figures that it may report, as [`figures!`](crate::figures) declares them; any other is kept, and remarked on.
    const FIGURES: Figures = &[];
    /// Settings: plain data; each field's documentation ends in its unit in brackets, ranges stand in `#[schemars(range)]`,
    /// defaults in `#[serde(default)]`. `#[serde(deny_unknown_fields)]` is required.
    type Settings: Serialize + DeserializeOwned + JsonSchema + Clone + Send + Sync + 'static;

    /// The ports, in the order of their numbers.
    fn ports() -> Ports;

    /// Checks what ranges alone cannot say, and gets ready. With [`Purpose::Check`](crate::Purpose) nothing is written and no child
    /// process or device is started.
    ///
    /// # Errors
    /// A setting, or something the setup lacks, with what was found and expected.
    fn new(settings: Self::Settings, setup: &Setup) -> Result<Self, ConfigError>;

    /// One activation: a message has arrived at a triggering port, or the source is due.
    ///
    /// # Errors
    /// When this message cannot be worked on; what happens then is the rig's `on_error`. "Nothing seen" is an answer, not an error.
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError>;

    /// Takes other settings between two activations. Only those differ from the present ones that are marked as live: `#[schemars(extend("live" = true))]`.
    ///
    /// # Errors
    /// A setting, with what was found and expected; the node goes on with the present ones.
    fn change(&mut self, _settings: Self::Settings) -> Result<(), ConfigError> {
        Err(ConfigError::node(crate::registry::FIXED))
    }

    /// Sources: when to be asked next. A source that needs time to get ready asks for an activation at [`Time::ZERO`]: a live run gives it before its
    /// clock starts.
    fn due(&mut self) -> Due {
        Due::Never
    }

    /// After the last message: figures, pictures, files still to be written.
    ///
    /// # Errors
    /// When something could not be saved: what, where, and what became of it.
    fn finish(&mut self, _report: &mut Report) -> Result<(), NodeError> {
        Ok(())
    }

    /// Whether it works on a device with these settings: a rig with such a node runs on the wall clock.
    fn is_live(_settings: &Self::Settings) -> bool {
        Self::LIVE
    }

    /// What is known beforehand.
    fn plan(_settings: &Self::Settings) -> Plan {
        Plan::default()
    }
}
