//! Nodes that are processes of their own, in any language: messages as JSON with a length before it on standard input and output, pixels in
//! shared memory.
//!
//! | node | in | out |
//! |---|---|---|
//! | `process.detector` | pictures, and where targets are expected | points in them |
//! | `process.filter` | targets | targets |
//! | `process.pictures` | pictures | pictures |
//!
//! The process may crash, hang or send invalid data: each is a failure of the node, by name, with what the process last wrote on standard error; it is
//! ended with all that it started, and the rig's `on_error` says what follows. What it sends is read as its message's type says, and no more than [`LONGEST_FRAME`] of it. A frame is a
//! length (32 bits, little endian) and so many bytes of JSON:
//!
//! | from | frame | when |
//! |---|---|---|
//! | program | `{"hello": 1, "node": …, "inputs": {PORT: MESSAGE}, "outputs": {PORT: MESSAGE}, "schemas": {MESSAGE: SCHEMA}}` | at the start |
//! | process | `{"ready": true}`, or `{"refuse": "why"}` | once it can work |
//! | program | `{"port": …, "now": NS, "stamp": {time, source, sequence}, "value": MESSAGE, "bulk": BULK, "latest": {PORT: …}}` | for each message |
//! | process | `{"emit": [{"port": …, "value": MESSAGE, "bulk": [offset, length]}], "gaps": [{"port": …, "reason": …}]}`, or `{"error": "why"}` | its answer |
//!
//! `BULK` is `{"path": FILE, "size": …, "offset": …, "length": …, "answer": OFFSET}`: the pixels lie in that file, which the process maps, and it may put as
//! many bytes of its own from `answer` on.

mod child;
mod shared;

use foveate_messages::{CameraId, Feature, Features, Image, Message, Targets, Wire};
use foveate_node::port::MessageType;
use foveate_node::{ConfigError, In, Io, Node, NodeError, Out, Ports, Purpose, Registry, Role, Setup, Stamped};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use child::Child;
pub use child::LONGEST_FRAME;
use shared::Shared;

/// Registers the nodes of this module.
pub fn register(registry: &mut Registry) {
    registry.add::<Detector>();
    registry.add::<Filter>();
    registry.add::<Pictures>();
}

/// Settings of every node that is a process.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProcessSettings {
    /// The program and its arguments, started in the folder of the rig: `["python3", "spots.py", "120"]` [–].
    #[schemars(length(min = 1))]
    pub command: Vec<String>,
    /// Longest time for an answer to one message; after that the process is ended [ms].
    #[serde(default = "deadline")]
    #[schemars(range(min = 1.0, max = 3_600_000.0))]
    pub deadline_ms: f64,
    /// Longest time from its start until it is ready [ms].
    #[serde(default = "start")]
    #[schemars(range(min = 1.0, max = 3_600_000.0))]
    pub start_ms: f64,
}

fn deadline() -> f64 {
    1000.0
}

fn start() -> f64 {
    20_000.0
}

/// A process and how to start it again.
struct Process {
    settings: ProcessSettings,
    setup: Setup,
    hello: Value,
    child: Option<Child>,
    shared: Option<Shared>,
    text: Vec<u8>,
}

/// A message to be sent, as JSON, and its bulk data.
struct Sent<'m> {
    value: Value,
    bulk: &'m [u8],
}

fn written<T: Message>(message: &T) -> Result<Sent<'_>, NodeError> {
    let view = T::WIRE.codec().and_then(|it| it.view(message));
    let view = view.ok_or_else(|| NodeError::program(format_args!("a message `{}` cannot be written", T::NAME)))?;
    let value = serde_json::to_value(view).map_err(NodeError::program)?;
    Ok(Sent { value, bulk: message.bulk() })
}

/// Reads a message that the process gave, as its type says.
fn read<T: Message>(value: &Value, bulk: Vec<u8>) -> Result<T, NodeError> {
    let lied =
        |what: String| NodeError::input(format_args!("the process gave a message `{}` that is none: {what}", T::NAME));
    let Wire::Portable(codec) = T::WIRE else { return Err(lied("it cannot be read at all".to_owned())) };
    let mut format = <dyn erased_serde::Deserializer<'_>>::erase(value);
    let message = codec.read(&mut format, bulk).map_err(|error| lied(error.to_string()))?;
    message.downcast::<T>().map(|it| *it).map_err(|_| lied("it is of another type".to_owned()))
}

impl Process {
    fn new(settings: ProcessSettings, setup: &Setup, ports: &Ports) -> Result<Self, ConfigError> {
        ConfigError::unless_in("deadline_ms", settings.deadline_ms, 1.0..=3_600_000.0)?;
        ConfigError::unless_in("start_ms", settings.start_ms, 1.0..=3_600_000.0)?;
        child::find(&settings.command, &setup.rig_dir)?;
        let mut it = Self {
            hello: hello(setup, ports),
            settings,
            setup: setup.clone(),
            child: None,
            shared: None,
            text: Vec::new(),
        };
        if setup.purpose == Purpose::Run {
            it.start().map_err(|error| ConfigError::at("command", error.message))?;
        }
        Ok(it)
    }

    fn start(&mut self) -> Result<(), NodeError> {
        let mut child = Child::start(&self.settings.command, &self.setup.rig_dir)?;
        let answer = child.ask(&mut self.text, &self.hello, self.settings.start_ms);
        let answer = answer.map_err(|what| child.failure(&what))?;
        if let Some(why) = answer.get("refuse") {
            return Err(NodeError::input(format_args!("the process refuses to work: {}", words(why))));
        }
        if answer.get("ready") != Some(&Value::Bool(true)) {
            return Err(child.failure("answered the greeting with something else than `ready`"));
        }
        self.child = Some(child);
        Ok(())
    }

    /// Sends one message with what is known at the other ports, and gives the answer. After a failure the process is gone.
    fn ask(&mut self, io: &Io<'_>, port: &str, given: &Stamped<Sent<'_>>, latest: Value) -> Result<Value, NodeError> {
        if self.child.is_none() {
            self.start()?;
        }
        let stamp = given.stamp;
        let mut frame = json!({
            "port": port,
            "now": io.now().0,
            "stamp": { "time": stamp.time.0, "source": stamp.source.0, "sequence": stamp.sequence },
            "value": given.value.value,
            "latest": latest,
        });
        let bulk = given.value.bulk;
        if !bulk.is_empty() {
            if self.shared.as_ref().is_none_or(|it| it.capacity() < bulk.len()) {
                self.shared = Some(Shared::new(bulk.len()).map_err(NodeError::input)?);
            }
            if let Some(shared) = &mut self.shared {
                frame["bulk"] = shared.put(bulk);
            }
        }
        let Some(mut child) = self.child.take() else { return Err(NodeError::program("the process is gone")) };
        match child.ask(&mut self.text, &frame, self.settings.deadline_ms) {
            Ok(answer) => {
                if let Some(why) = answer.get("error") {
                    // It is well, and can go on with the next message.
                    self.child = Some(child);
                    return Err(NodeError::input(format_args!(
                        "the process cannot work on this message: {}",
                        words(why)
                    )));
                }
                self.child = Some(child);
                Ok(answer)
            }
            Err(what) => Err(child.failure(&what)),
        }
    }

    /// Gives out what the process answered at the one output port.
    fn give<T: Message>(
        &mut self,
        io: &mut Io<'_>,
        port: &Out<T>,
        name: &str,
        stamp: foveate_node::Stamp,
        answer: &Value,
        fault: impl Fn(&T) -> Option<String>,
    ) -> Result<(), NodeError> {
        let given = self.read_all::<T>(name, answer).and_then(|it| match it.iter().find_map(fault) {
            Some(fault) => Err(NodeError::input(format_args!("the process gave {fault}"))),
            None => Ok(it),
        });
        let messages = given.inspect_err(|_| self.child = None)?;
        messages.into_iter().for_each(|it| io.emit(port, stamp, it));
        for gap in answer.get("gaps").and_then(Value::as_array).into_iter().flatten() {
            let reason = gap.get("reason").map_or_else(|| "the process gave nothing".to_owned(), words);
            io.gap(port, stamp.time, reason);
        }
        Ok(())
    }

    fn read_all<T: Message>(&self, port: &str, answer: &Value) -> Result<Vec<T>, NodeError> {
        let lied = |what: &str| NodeError::input(format_args!("the process gave {what}"));
        if !answer.is_object() {
            return Err(lied(&format!("the answer {}, expected an object with `emit`", words(answer))));
        }
        let list = match answer.get("emit") {
            None => return Ok(Vec::new()),
            Some(list) => list.as_array().ok_or_else(|| lied("an `emit` that is no list"))?,
        };
        if list.len() > MAX_MESSAGES {
            return Err(lied(&format!("{} messages in one answer, expected at most {MAX_MESSAGES}", list.len())));
        }
        let messages = list.iter().map(|it| {
            if it.get("port").and_then(Value::as_str) != Some(port) {
                return Err(lied(&format!("a message at the port {}, expected `{port}`", words(&it["port"]))));
            }
            let bulk = match it.get("bulk") {
                None | Some(Value::Null) => Vec::new(),
                Some(place) => {
                    let place = place.as_array().map(|it| it.iter().filter_map(Value::as_u64).collect::<Vec<_>>());
                    let taken = match place.as_deref() {
                        Some(&[offset, length]) => self.shared.as_ref().and_then(|it| it.take(offset, length)),
                        _ => None,
                    };
                    taken.ok_or_else(|| {
                        lied(&format!("pixels at {}, which is not in the shared memory", words(&it["bulk"])))
                    })?
                }
            };
            read::<T>(it.get("value").unwrap_or(&Value::Null), bulk)
        });
        messages.collect()
    }
}

/// What is wrong with points that are to be those of a picture of `camera`.
fn fault_of(features: &Features, camera: CameraId) -> Option<String> {
    if features.camera != camera {
        return Some(format!("points of camera {}, expected those of camera {}", features.camera.0, camera.0));
    }
    let is_sound = |it: &Feature| {
        let [a, b, c] = [it.covariance[(0, 0)], it.covariance[(0, 1)], it.covariance[(1, 1)]];
        it.centre.iter().all(|it| it.is_finite()) && a > 0.0 && c > 0.0 && a * c - b * b > 0.0 && (a + c).is_finite()
    };
    let odd = features.list.iter().find(|it| !is_sound(it))?;
    Some(format!(
        "a point at {:?} with the covariance {:?}, expected finite pixels and a covariance that is positive definite",
        odd.centre.coords.as_slice(),
        odd.covariance.as_slice()
    ))
}

/// Messages in one answer, at most.
const MAX_MESSAGES: usize = 1024;

/// A value that a process gave, for a sentence: not more than a line of it.
fn words(value: &Value) -> String {
    let text = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    text.chars().map(|it| if it.is_control() { ' ' } else { it }).take(300).collect()
}

fn hello(setup: &Setup, ports: &Ports) -> Value {
    let inputs = ports.inputs.iter().map(|it| (it.name, &it.message));
    let outputs = ports.outputs.iter().map(|it| (it.name, &it.message));
    let mut schemas = Map::new();
    for (_, message) in inputs.clone().chain(outputs.clone()) {
        if let Some(codec) = message.wire.codec() {
            schemas.insert(message.name.to_owned(), codec.schema().to_value());
        }
    }
    let named = |it: (&str, &MessageType)| {
        (it.0.to_owned(), json!({ "name": it.1.name, "version": it.1.version, "space": it.1.space.in_words() }))
    };
    json!({
        "hello": 1,
        "node": setup.instance,
        "camera": setup.camera_name(),
        "inputs": inputs.map(named).collect::<Map<_, _>>(),
        "outputs": outputs.map(named).collect::<Map<_, _>>(),
        "schemas": schemas,
    })
}

const IMAGE: In<Image> = In::each(0, "image");
const PREDICTED: In<Targets> = In::latest(1, "predicted").optional();
const FEATURES: Out<Features> = Out::new(0, "features");
const TARGETS_IN: In<Targets> = In::each(0, "targets");
const TARGETS_OUT: Out<Targets> = Out::new(0, "targets");
const IMAGE_OUT: Out<Image> = Out::new(0, "image");

/// Pictures in, points out, by a process.
pub struct Detector(Process);

impl Node for Detector {
    const TYPE: &'static str = "process.detector";
    const ROLE: Role = Role::Detector;
    const SUMMARY: &'static str = "Finds points in pictures with a program of your own, in any language (Linux only)";
    type Settings = ProcessSettings;

    fn ports() -> Ports {
        Ports::new().input(&IMAGE).input(&PREDICTED).output(&FEATURES)
    }

    fn new(settings: ProcessSettings, setup: &Setup) -> Result<Self, ConfigError> {
        Process::new(settings, setup, &Self::ports()).map(Self)
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(image) = io.take(&IMAGE) else { return Ok(()) };
        let mut latest = Map::new();
        if let Some(targets) = io.latest(&PREDICTED) {
            latest.insert("predicted".to_owned(), written(targets.value)?.value);
        }
        let sent = Stamped { stamp: image.stamp, value: written(&*image.value)? };
        let answer = self.0.ask(io, "image", &sent, Value::Object(latest))?;
        let camera = image.value.camera;
        self.0.give(io, &FEATURES, "features", image.stamp, &answer, |it: &Features| fault_of(it, camera))
    }
}

/// Targets in, targets out, by a process.
pub struct Filter(Process);

impl Node for Filter {
    const TYPE: &'static str = "process.filter";
    const ROLE: Role = Role::ModelFilter;
    const SUMMARY: &'static str = "Filters targets with a program of your own, in any language (Linux only)";
    type Settings = ProcessSettings;

    fn ports() -> Ports {
        Ports::new().input(&TARGETS_IN).output(&TARGETS_OUT)
    }

    fn new(settings: ProcessSettings, setup: &Setup) -> Result<Self, ConfigError> {
        Process::new(settings, setup, &Self::ports()).map(Self)
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(targets) = io.take(&TARGETS_IN) else { return Ok(()) };
        let sent = Stamped { stamp: targets.stamp, value: written(&*targets.value)? };
        let answer = self.0.ask(io, "targets", &sent, json!({}))?;
        self.0.give(io, &TARGETS_OUT, "targets", targets.stamp, &answer, |_| None)
    }
}

/// Pictures in, pictures out, by a process.
pub struct Pictures(Process);

impl Node for Pictures {
    const TYPE: &'static str = "process.pictures";
    const ROLE: Role = Role::ModelFilter;
    const SUMMARY: &'static str = "Processes pictures with a program of your own, in any language (Linux only)";
    type Settings = ProcessSettings;

    fn ports() -> Ports {
        Ports::new().input(&IMAGE).output(&IMAGE_OUT)
    }

    fn new(settings: ProcessSettings, setup: &Setup) -> Result<Self, ConfigError> {
        Process::new(settings, setup, &Self::ports()).map(Self)
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(image) = io.take(&IMAGE) else { return Ok(()) };
        let sent = Stamped { stamp: image.stamp, value: written(&*image.value)? };
        let answer = self.0.ask(io, "image", &sent, json!({}))?;
        self.0.give(io, &IMAGE_OUT, "image", image.stamp, &answer, |_| None)
    }
}
