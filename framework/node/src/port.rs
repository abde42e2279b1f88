//! Typed ports: how a node receives and emits messages.

use std::any::{Any, TypeId};
use std::marker::PhantomData;
use std::sync::Arc;

use foveate_messages::{Interval, Message, Space, Wire};

use crate::io::Payload;

/// How an input port takes data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InputPolicy {
    /// Every message triggers the node, in order of delivery.
    Each,
    /// Sampled whenever the node runs, never triggers it. The only kind that may close a cycle.
    Latest,
    /// Joins one message of each connected source whose capture times lie within the tolerance, then triggers. A set
    /// that cannot be completed any more is delivered as it is; the missing ones count as gaps.
    Synced(Interval),
    /// When the node is free: empties the queues, picks one of the sources that delivered since (seeded, at random),
    /// and triggers with the newest message of that source; the others are counted as dropped [Davis 2002 §3.5].
    NewestOfEach,
    /// When the node is free: empties the queues and triggers with the newest message of all, by capture time. A source whose
    /// clock is ahead starves the others [Davis 2002 §3.5]; here for comparison.
    Newest,
    /// When the node is free: triggers with the newest message of the next source in turn that has one; the others keep theirs.
    /// Starves no source, but messages of a slow source grow old before its turn [Davis 2002 §3.5].
    RoundRobin,
}

impl InputPolicy {
    /// The policies between which a rig may choose (`policy = "…"`), by their names there.
    pub const CHOICES: [(&'static str, InputPolicy); 4] = [
        ("each", InputPolicy::Each),
        ("newest_of_each", InputPolicy::NewestOfEach),
        ("newest", InputPolicy::Newest),
        ("round_robin", InputPolicy::RoundRobin),
    ];

    /// The name in rigs; `None` where a rig has no choice: for ports that sample or join.
    pub fn choice(self) -> Option<&'static str> {
        InputPolicy::CHOICES.iter().find(|it| it.1 == self).map(|it| it.0)
    }

    /// For people.
    pub fn in_words(self) -> String {
        match self {
            InputPolicy::Each => "each message triggers".to_owned(),
            InputPolicy::Latest => "the latest is sampled, never triggers; may close a cycle".to_owned(),
            InputPolicy::Synced(tolerance) => format!("joined by capture time within {} ms", tolerance.as_ms()),
            InputPolicy::NewestOfEach => "the newest of a source picked at random".to_owned(),
            InputPolicy::Newest => "the newest of all sources".to_owned(),
            InputPolicy::RoundRobin => "the newest of each source in turn".to_owned(),
        }
    }
}

/// An input port that takes messages of type `T`.
#[derive(Debug)]
pub struct In<T> {
    pub(crate) index: usize,
    pub(crate) name: &'static str,
    pub(crate) policy: InputPolicy,
    pub(crate) optional: bool,
    pub(crate) many: bool,
    pub(crate) of_parent: bool,
    message: PhantomData<fn(T)>,
}

/// Declares the ports of a node: a constant for each, numbered in the order in which they stand, and `declared_ports()`, which
/// [`Node::ports`](crate::Node::ports) gives back.
///
/// An input says how it takes data, as a constructor of [`In`] without the number; what follows is as there. An output has its name alone.
///
/// ```
/// use foveate_messages::{Features, Targets};
///
/// foveate_node::ports! {
///     FEATURES: In<Features> = each("features").many();
///     HINTS: In<Targets> = latest("hints").optional();
///     TARGETS: Out<Targets> = "targets";
/// }
///
/// let ports = declared_ports();
/// assert_eq!(ports.inputs.iter().map(|it| it.name).collect::<Vec<_>>(), ["features", "hints"]);
/// assert_eq!(ports.outputs[0].name, "targets");
/// ```
///
/// What several nodes share is declared with `pub(crate) fn NAME;` before the ports: the name of the function in place of `declared_ports`.
#[macro_export]
macro_rules! ports {
    (@next [$scope:vis $all:ident] [$($input:ident)*] [$($output:ident)*] $n_in:expr; $n_out:expr;) => {
        /// The ports, in the order of their declarations.
        $scope fn $all() -> $crate::Ports {
            $crate::Ports::new()$(.input(&$input))*$(.output(&$output))*
        }
    };
    (
        @next [$scope:vis $all:ident] [$($input:ident)*] [$($output:ident)*] $n_in:expr; $n_out:expr;
        $(#[$doc:meta])* $name:ident: In<$message:ty> = $policy:ident($($argument:expr),*) $(.$modifier:ident())*;
        $($rest:tt)*
    ) => {
        $(#[$doc])*
        $scope const $name: $crate::In<$message> = $crate::In::$policy($n_in, $($argument),*)$(.$modifier())*;
        $crate::ports!(@next [$scope $all] [$($input)* $name] [$($output)*] $n_in + 1; $n_out; $($rest)*);
    };
    (
        @next [$scope:vis $all:ident] [$($input:ident)*] [$($output:ident)*] $n_in:expr; $n_out:expr;
        $(#[$doc:meta])* $name:ident: Out<$message:ty> = $text:literal;
        $($rest:tt)*
    ) => {
        $(#[$doc])*
        $scope const $name: $crate::Out<$message> = $crate::Out::new($n_out, $text);
        $crate::ports!(@next [$scope $all] [$($input)*] [$($output)* $name] $n_in; $n_out + 1; $($rest)*);
    };
    ($scope:vis fn $all:ident; $($ports:tt)*) => {
        $crate::ports!(@next [$scope $all] [] [] 0; 0; $($ports)*);
    };
    ($($ports:tt)*) => {
        $crate::ports!(@next [declared_ports] [] [] 0; 0; $($ports)*);
    };
}

impl<T> In<T> {
    const fn new(index: usize, name: &'static str, policy: InputPolicy) -> Self {
        Self { index, name, policy, optional: false, many: false, of_parent: false, message: PhantomData }
    }

    /// Port number `index` (counted from 0 in the order of [`Ports`]): each message triggers.
    pub const fn each(index: usize, name: &'static str) -> Self {
        Self::new(index, name, InputPolicy::Each)
    }

    /// Port number `index`: sampled, never triggers, may close a cycle.
    pub const fn latest(index: usize, name: &'static str) -> Self {
        Self::new(index, name, InputPolicy::Latest)
    }

    /// Port number `index`: joins sources whose capture times differ by at most `tolerance_ms`.
    pub const fn synced(index: usize, name: &'static str, tolerance_ms: i64) -> Self {
        Self::new(index, name, InputPolicy::Synced(Interval(tolerance_ms * 1_000_000)))
    }

    /// Port number `index`: the newest message of a source picked at random.
    pub const fn newest_of_each(index: usize, name: &'static str) -> Self {
        Self::new(index, name, InputPolicy::NewestOfEach)
    }

    /// May be left open in a rig.
    pub const fn optional(mut self) -> Self {
        self.optional = true;
        self
    }

    /// Takes the messages of any number of cameras or nodes; otherwise of exactly one, the node's own camera.
    pub const fn many(mut self) -> Self {
        self.many = true;
        self
    }

    /// Takes points of the parent scale rather than of the node's own.
    pub const fn of_parent(mut self) -> Self {
        self.of_parent = true;
        self
    }
}

/// An output port that gives messages of type `T`.
#[derive(Debug)]
pub struct Out<T> {
    pub(crate) index: usize,
    pub(crate) name: &'static str,
    message: PhantomData<fn() -> T>,
}

impl<T> Out<T> {
    /// Output port number `index`, counted from 0 in the order of [`Ports`].
    pub const fn new(index: usize, name: &'static str) -> Self {
        Self { index, name, message: PhantomData }
    }
}

/// Makes a payload of a value, if it is of the right type.
pub type Share = fn(Box<dyn Any + Send + Sync>) -> Option<Arc<dyn Payload>>;

/// The type of a message, erased. Two are equal when they are one type of one process.
#[derive(Debug, Clone, Copy)]
pub struct MessageType {
    /// [`Message::NAME`].
    pub name: &'static str,
    /// [`Message::VERSION`].
    pub version: u32,
    /// [`Message::SPACE`].
    pub space: Space,
    /// [`Message::WIRE`].
    pub wire: Wire,
    /// The type itself, in this process.
    pub id: TypeId,
    /// A value of the type, ready to be sent; `None` for a value of another type.
    pub share: Share,
}

impl PartialEq for MessageType {
    fn eq(&self, other: &MessageType) -> bool {
        self.id == other.id
    }
}

impl Eq for MessageType {}

impl MessageType {
    /// Of `T`.
    pub fn of<T: Message>() -> Self {
        Self {
            name: T::NAME,
            version: T::VERSION,
            space: T::SPACE,
            wire: T::WIRE,
            id: TypeId::of::<T>(),
            share: share::<T>,
        }
    }
}

fn share<T: Message>(value: Box<dyn Any + Send + Sync>) -> Option<Arc<dyn Payload>> {
    let value: Arc<T> = value.downcast::<T>().ok()?.into();
    Some(value)
}

/// An input port, erased.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InputSpec {
    /// As rigs write it.
    pub name: &'static str,
    /// What it takes.
    pub message: MessageType,
    /// How it takes it.
    pub policy: InputPolicy,
    /// May be left open.
    pub optional: bool,
    /// Takes any number of sources.
    pub many: bool,
    /// Takes points of the parent scale.
    pub of_parent: bool,
}

/// An output port, erased.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OutputSpec {
    /// As rigs write it.
    pub name: &'static str,
    /// What it gives.
    pub message: MessageType,
}

/// The ports of a node type, in the order of their numbers.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Ports {
    /// Inputs.
    pub inputs: Vec<InputSpec>,
    /// Outputs.
    pub outputs: Vec<OutputSpec>,
}

impl Ports {
    /// No ports.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds an input.
    ///
    /// # Panics
    /// When the port's number is not its place or its name is taken: a mistake in the node's source.
    pub fn input<T: Message>(mut self, port: &In<T>) -> Self {
        assert_eq!(port.index, self.inputs.len(), "input `{}` is listed at another place than its number", port.name);
        assert!(self.inputs.iter().all(|it| it.name != port.name), "input `{}` is listed twice", port.name);
        self.inputs.push(InputSpec {
            name: port.name,
            message: MessageType::of::<T>(),
            policy: port.policy,
            optional: port.optional,
            many: port.many,
            of_parent: port.of_parent,
        });
        self
    }

    /// Adds an output.
    ///
    /// # Panics
    /// When the port's number is not its place or its name is taken: a mistake in the node's source.
    pub fn output<T: Message>(mut self, port: &Out<T>) -> Self {
        assert_eq!(port.index, self.outputs.len(), "output `{}` is listed at another place than its number", port.name);
        assert!(self.outputs.iter().all(|it| it.name != port.name), "output `{}` is listed twice", port.name);
        self.outputs.push(OutputSpec { name: port.name, message: MessageType::of::<T>() });
        self
    }
}
