//! A bench for one node: stamped messages in, what it gives out; no rig, no engine.

use std::any::Any;
use std::fmt::Write;
use std::sync::Arc;

use foveate_messages::{Interval, Message, SourceId, Stamp, Stamped, Time};

use crate::error::{ConfigError, NodeError};
use crate::guard::guarded;
use crate::io::{Delivery, Gap, Io, Outbox, Packet};
use crate::node::{Due, Node};
use crate::port::{In, InputPolicy, Out, Ports};
use crate::report::Report;
use crate::setup::Setup;

/// The source of what [`NodeBench::feed`] gives in.
const FEEDER: SourceId = SourceId(1);
/// The source of what the node gives out under its own number.
const ITSELF: SourceId = SourceId(0);

/// Runs one node as an engine would: feeds it stamped messages and keeps what it gives out.
///
/// ```
/// # use foveate_node::*;
/// # use foveate_messages::Targets;
/// # const TARGETS: In<Targets> = In::each(0, "targets");
/// # const CREDIBLE: Out<Targets> = Out::new(0, "targets");
/// # #[derive(Clone, Default, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
/// # struct Settings {}
/// # struct Filter;
/// # impl Node for Filter {
/// #     const TYPE: &'static str = "test.filter";
/// #     const ROLE: Role = Role::ModelFilter;
/// #     const SUMMARY: &'static str = "Lets all through";
/// #     type Settings = Settings;
/// #     fn ports() -> Ports { Ports::new().input(&TARGETS).output(&CREDIBLE) }
/// #     fn new(_: Settings, _: &Setup) -> Result<Self, ConfigError> { Ok(Self) }
/// #     fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
/// #         let Some(targets) = io.take(&TARGETS) else { return Ok(()) };
/// #         io.emit(&CREDIBLE, targets.stamp, targets.value);
/// #         Ok(())
/// #     }
/// # }
/// let mut bench = NodeBench::<Filter>::new(Settings::default()).unwrap();
/// bench.feed(&TARGETS, Time::from_s(0.02), Targets::default()).unwrap();
/// assert_eq!(bench.outputs(&CREDIBLE).len(), 1);
/// ```
pub struct NodeBench<N: Node> {
    node: N,
    ports: Ports,
    now: Time,
    latest: Vec<Vec<Option<Packet>>>,
    /// By input port and source: how many messages came.
    fed: Vec<Vec<(SourceId, u64)>>,
    sequences: Vec<u64>,
    outbox: Outbox,
}

impl<N: Node> NodeBench<N> {
    /// A node with these settings in a setup for tests: no cameras, seed 1.
    ///
    /// # Errors
    /// What the node refuses.
    pub fn new(settings: N::Settings) -> Result<Self, ConfigError> {
        Self::with_setup(settings, &Setup::for_tests())
    }

    /// As [`NodeBench::new`] in a setup of the test's own.
    ///
    /// # Errors
    /// What the node refuses, and the words of its panic.
    pub fn with_setup(settings: N::Settings, setup: &Setup) -> Result<Self, ConfigError> {
        let node = guarded(|| N::new(settings, setup)).unwrap_or_else(|said| Err(ConfigError::node(said)))?;
        let ports = N::ports();
        Ok(Self {
            node,
            now: Time::ZERO,
            latest: ports.inputs.iter().map(|_| Vec::new()).collect(),
            fed: ports.inputs.iter().map(|_| Vec::new()).collect(),
            sequences: vec![0; ports.outputs.len()],
            outbox: Outbox::default(),
            ports,
        })
    }

    /// Gives in `value`, captured at `time` and delivered at once. At a port that samples it waits there for the next activation, at any other it
    /// triggers one.
    ///
    /// # Errors
    /// What the node cannot work on, and the words of its panic.
    ///
    /// # Panics
    /// When the node has no such port: a mistake of the test.
    pub fn feed<T: Message>(&mut self, port: &In<T>, time: Time, value: impl Into<Arc<T>>) -> Result<(), NodeError> {
        self.feed_from(port, FEEDER, time, Interval(0), value)
    }

    /// As [`NodeBench::feed`], from a `source` of the test's choice and delivered `late` after its capture.
    ///
    /// # Errors
    /// As [`NodeBench::feed`].
    ///
    /// # Panics
    /// As [`NodeBench::feed`].
    pub fn feed_from<T: Message>(
        &mut self,
        port: &In<T>,
        source: SourceId,
        time: Time,
        late: Interval,
        value: impl Into<Arc<T>>,
    ) -> Result<(), NodeError> {
        let (index, policy) = self.input(port);
        let packet = Packet { stamp: self.stamp(index, source, time), payload: value.into() };
        self.now = self.now.max(time + late);
        if policy == InputPolicy::Latest {
            let place = self.fed[index].iter().position(|it| it.0 == source).unwrap_or(0);
            self.latest[index].resize(self.fed[index].len(), None);
            self.latest[index][place] = Some(packet);
            return Ok(());
        }
        self.deliver(Delivery { port: index, packets: vec![packet] })
    }

    /// Gives in a set of messages that were captured at `time`, one of each source, at a port that joins sources.
    ///
    /// # Errors
    /// As [`NodeBench::feed`].
    ///
    /// # Panics
    /// As [`NodeBench::feed`].
    pub fn feed_set<T: Message>(&mut self, port: &In<T>, time: Time, values: Vec<T>) -> Result<(), NodeError> {
        let (index, _) = self.input(port);
        let mut packets = Vec::new();
        for (value, source) in values.into_iter().zip(FEEDER.0..) {
            let stamp = self.stamp(index, SourceId(source), time);
            packets.push(Packet { stamp, payload: Arc::new(value) });
        }
        self.now = self.now.max(time);
        self.deliver(Delivery { port: index, packets })
    }

    /// Lets a source give what is due, up to `until`; gives how often it was asked.
    ///
    /// # Errors
    /// As [`NodeBench::feed`].
    pub fn run_source(&mut self, until: Time) -> Result<usize, NodeError> {
        let mut n_activations = 0;
        while let Due::At(time) = guarded(|| self.node.due()).map_err(NodeError::program)? {
            if time > until {
                break;
            }
            self.now = self.now.max(time);
            self.deliver(Delivery::default())?;
            n_activations += 1;
        }
        Ok(n_activations)
    }

    /// Activates a source at `time`, whether it is due or not.
    ///
    /// # Errors
    /// As [`NodeBench::feed`].
    pub fn activate(&mut self, time: Time) -> Result<(), NodeError> {
        self.now = self.now.max(time);
        self.deliver(Delivery::default())
    }

    /// What the node gave out at `port` since this was last asked, in order.
    ///
    /// # Panics
    /// When something of another type was given out there: a mistake of the node.
    pub fn outputs<T: Message>(&mut self, port: &Out<T>) -> Vec<Stamped<Arc<T>>> {
        let (mine, others) = self.outbox.packets.drain(..).partition(|it| it.0 == port.index);
        self.outbox.packets = others;
        let mine: Vec<(usize, Packet)> = mine;
        mine.into_iter().map(|it| it.1.into_typed(port.name)).collect()
    }

    /// The gaps that the node declared at `port` since this was last asked.
    pub fn gaps<T: Message>(&mut self, port: &Out<T>) -> Vec<Gap> {
        let (mine, others) = self.outbox.gaps.drain(..).partition(|it| it.0 == port.index);
        self.outbox.gaps = others;
        let mine: Vec<(usize, Gap)> = mine;
        mine.into_iter().map(|it| it.1).collect()
    }

    /// All that the node gave out and declared missing since this was last asked, as text: to hold one run against another.
    ///
    /// # Errors
    /// A message that cannot be written, and the words of a panic.
    pub fn transcript(&mut self) -> Result<String, NodeError> {
        let mut text = String::new();
        for (port, packet) in self.outbox.packets.drain(..) {
            let port = &self.ports.outputs[port];
            let any: &dyn Any = &*packet.payload;
            let written = guarded(|| port.message.wire.codec().and_then(|it| it.view(any)).map(serde_json::to_string));
            let written = match written.map_err(NodeError::program)? {
                Some(written) => written.map_err(NodeError::program)?,
                None => "stays in this process".to_owned(),
            };
            let bulk = packet.payload.bulk().map_err(NodeError::program)?;
            let Stamp { time, source, sequence } = packet.stamp;
            let _ = writeln!(text, "{} {} {} {sequence} {written} {bulk:?}", port.name, time.0, source.0);
        }
        for (port, gap) in self.outbox.gaps.drain(..) {
            let _ = writeln!(text, "{} {} missing: {}", self.ports.outputs[port].name, gap.time.0, gap.reason);
        }
        Ok(text)
    }

    /// Lets the node finish, and gives its report.
    ///
    /// # Errors
    /// What could not be saved, and the words of a panic.
    pub fn finish(mut self) -> Result<Report, NodeError> {
        let mut report = Report::default();
        guarded(|| self.node.finish(&mut report)).unwrap_or_else(|said| Err(NodeError::program(said)))?;
        Ok(report)
    }

    fn input<T: Message>(&self, port: &In<T>) -> (usize, InputPolicy) {
        match self.ports.inputs.get(port.index) {
            Some(it) if it.name == port.name => (port.index, it.policy),
            _ => panic!("`{}` has no input `{}` at place {}", N::TYPE, port.name, port.index),
        }
    }

    fn stamp(&mut self, port: usize, source: SourceId, time: Time) -> Stamp {
        let counts = &mut self.fed[port];
        let place = counts.iter().position(|it| it.0 == source).unwrap_or_else(|| {
            counts.push((source, 0));
            counts.len() - 1
        });
        let sequence = counts[place].1;
        counts[place].1 += 1;
        Stamp { time, source, sequence }
    }

    fn deliver(&mut self, mut delivery: Delivery) -> Result<(), NodeError> {
        let (node, outbox) = (&mut self.node, &mut self.outbox);
        let mut io = Io::new(self.now, ITSELF, &mut delivery, &self.latest, outbox, &mut self.sequences);
        guarded(|| node.process(&mut io)).unwrap_or_else(|said| Err(NodeError::program(said)))
    }
}
