//! A small session whose content is known: how it is made, in as many chunks as wanted, and what is read of it.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use foveate_engine::tap::{Entry, Event};
use foveate_engine::{self as engine, Feed, Options};
use foveate_messages::{Message, Space, Time, Wire};
use foveate_node::{ConfigError, Due, Host, In, Io, Node, NodeError, Out, Plan, Ports, Registry, Report, Role, Setup};
use foveate_rig::Overrides;
use foveate_rig::graph::Graph;
use foveate_session::file::SessionFile;
use foveate_session::{Packing, Pictures, Player, Recorder, Recording, Session, body, names, order, replay};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A message with bulk data.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Reading {
    pub number: u64,
    #[serde(skip)]
    pub bulk: Vec<u8>,
}

impl Message for Reading {
    const NAME: &'static str = "reading";
    const SPACE: Space = Space::NONE;
    const WIRE: Wire = Wire::portable::<Reading>();

    fn bulk(&self) -> &[u8] {
        &self.bulk
    }

    fn set_bulk(&mut self, bytes: Vec<u8>) {
        self.bulk = bytes;
    }
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SourceSettings {
    /// How many [–].
    pub count: u64,
    /// Length of the bulk data [bytes].
    pub size: usize,
    /// How often [Hz].
    pub rate_hz: f64,
}

impl Default for SourceSettings {
    fn default() -> Self {
        Self { count: 6, size: 20, rate_hz: 100.0 }
    }
}

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Nothing {}

pub struct Source {
    settings: SourceSettings,
    next: u64,
}

const READINGS: Out<Reading> = Out::new(0, "readings");
const DOUBLED: Out<Reading> = Out::new(0, "doubled");
const INPUT: In<Reading> = In::each(0, "readings");

impl Node for Source {
    const TYPE: &'static str = "test.source";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Readings with bulk data; the fourth is a gap.";
    type Settings = SourceSettings;

    fn ports() -> Ports {
        Ports::new().output(&READINGS)
    }
    fn new(settings: SourceSettings, _: &Setup) -> Result<Self, ConfigError> {
        Ok(Self { settings, next: 0 })
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let (number, time) = (self.next, self.time());
        self.next += 1;
        if number == 3 {
            io.gap(&READINGS, time, "asked for");
        } else {
            // Half of it compresses.
            let bulk =
                (0..self.settings.size).map(|it| if it % 2 == 0 { 0 } else { ((it as u64 * 37) ^ number) as u8 });
            io.emit_at(&READINGS, time, Reading { number, bulk: bulk.collect() });
        }
        Ok(())
    }
    fn due(&mut self) -> Due {
        if self.next < self.settings.count { Due::At(self.time()) } else { Due::Never }
    }
    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.figure("given", self.next as f64);
        Ok(())
    }
    fn plan(settings: &SourceSettings) -> Plan {
        Plan { rate_hz: Some(settings.rate_hz), ..Plan::default() }
    }
}

impl Source {
    fn time(&self) -> Time {
        Time::from_s(self.next as f64 / self.settings.rate_hz)
    }
}

/// Fails at the fifth reading.
pub struct Double;

impl Node for Double {
    const TYPE: &'static str = "test.double";
    const ROLE: Role = Role::ModelFilter;
    const SUMMARY: &'static str = "Twice the number.";
    type Settings = Nothing;

    fn ports() -> Ports {
        Ports::new().input(&INPUT).output(&DOUBLED)
    }
    fn new(_: Nothing, _: &Setup) -> Result<Self, ConfigError> {
        Ok(Self)
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(it) = io.take(&INPUT) else { return Ok(()) };
        if it.value.number == 4 {
            return Err(NodeError::input("found 4"));
        }
        io.emit(&DOUBLED, it.stamp, Reading { number: 2 * it.value.number, bulk: Vec::new() });
        Ok(())
    }
}

pub struct Sink;

impl Node for Sink {
    const TYPE: &'static str = "test.sink";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Takes all.";
    type Settings = Nothing;

    fn ports() -> Ports {
        Ports::new().input(&INPUT)
    }
    fn new(_: Nothing, _: &Setup) -> Result<Self, ConfigError> {
        Ok(Self)
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while io.take(&INPUT).is_some() {}
        Ok(())
    }
}

/// source → double → sink.
pub fn graph(settings: &str) -> Arc<Graph> {
    let text = format!(
        "[rig]\nname = \"small\"\nseed = 7\n[scale.room.node.a]\ntype = \"test.source\"\n{settings}\n\
         [scale.room.node.b]\ntype = \"test.double\"\nin.readings = \"a.readings\"\n\
         [scale.room.node.c]\ntype = \"test.sink\"\nin.readings = \"b.doubled\"\n"
    );
    let mut registry = Registry::new();
    registry.add::<Source>();
    registry.add::<Double>();
    registry.add::<Sink>();
    match foveate_rig::load(&text, Path::new("small.toml"), &registry, &Overrides::default()) {
        Ok(graph) => Arc::new(graph),
        Err(faults) => panic!("{}", faults.render(false)),
    }
}

pub fn recording(path: &Path, packing: Packing) -> Recording {
    Recording {
        path: path.to_owned(),
        packing,
        pictures: Pictures::Lossless,
        of_cameras: Vec::new(),
        hide_px: Vec::new(),
        hide_scales: Vec::new(),
        memory: 256 << 20,
        with_unused: false,
        waits: true,
        mode: "simulated",
        began_unix_ns: 0,
        from: None,
    }
}

/// Runs `graph` and records it.
pub fn record(path: &Path, graph: &Arc<Graph>, packing: Packing, is_paced: bool) {
    let recorder = Recorder::begin(graph, &recording(path, packing), Host::default()).unwrap();
    let options = Options { paced: is_paced, tap: Some(recorder.tap()), ..Options::default() };
    engine::deterministic(Arc::clone(graph), &options, &mut |_| {}).unwrap();
    let recorded = recorder.finish();
    assert_eq!((recorded.failure, recorded.remarks), (None, Vec::new()));
}

/// A message as it stands in the file: topic, time [ns], bytes.
pub type Read = (String, u64, Vec<u8>);

/// The messages of a session, in the order of the file.
pub fn messages(session: &mut Session) -> Result<Vec<Read>, String> {
    let mut all = Vec::new();
    let topics: BTreeMap<u16, String> = session.summary.channels.iter().map(|it| (*it.0, it.1.topic.clone())).collect();
    for chunk in 0..session.summary.chunks.len() {
        session.messages(chunk, |channel, time, bytes| {
            let topic = topics.get(&channel).ok_or_else(|| format!("channel {channel} is not in the summary"))?;
            all.push((topic.clone(), time, bytes.to_vec()));
            Ok(())
        })?;
    }
    Ok(all)
}

/// What was read of a session: all that a person or a replay can see.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Content {
    pub facts: BTreeMap<String, String>,
    pub end: Option<BTreeMap<String, String>>,
    pub files: BTreeMap<String, Vec<u8>>,
    /// The events with their messages, as bytes.
    pub events: Vec<Vec<u8>>,
}

/// The event and its message as bytes.
fn as_bytes(graph: &Graph, entry: &Entry) -> Vec<u8> {
    let mut bytes = Vec::new();
    order::Encoder::default().add(entry, &mut bytes);
    if let Event::Emitted { instance, port, packet: Some(packet), .. } = &entry.event {
        let message = &graph.instances[*instance].node_type.ports.outputs[*port].message;
        body::encode(message, packet, &mut bytes).unwrap();
    }
    bytes
}

/// Opens and plays a session to its end: its remarks, what was read, and the sentence with which that ended early.
pub fn read(path: &Path, graph: &Arc<Graph>) -> (Vec<String>, Content, Option<String>) {
    let mut content = Content::default();
    let mut session = match Session::open(path) {
        Ok(session) => session,
        Err(sentence) => return (Vec::new(), content, Some(sentence)),
    };
    let remarks = session.remarks.clone();
    content.facts.clone_from(&session.facts);
    content.end.clone_from(&session.end);
    for name in session.files() {
        match session.file(&name) {
            Ok(bytes) => drop(content.files.insert(name, bytes)),
            Err(sentence) => return (remarks, content, Some(sentence)),
        }
    }
    let (sources, _) = replay::sources(graph, &session);
    let mut player = match Player::new(session, Arc::clone(graph), &sources) {
        Ok(player) => player,
        Err(sentence) => return (remarks, content, Some(sentence)),
    };
    loop {
        match player.next() {
            Ok(Some(entry)) => content.events.push(as_bytes(graph, &entry)),
            Ok(None) => return (remarks, content, None),
            Err(sentence) => return (remarks, content, Some(sentence)),
        }
    }
}

/// A session that [`record`] made, written again with `n_chunks` chunks, and finished or not.
pub struct Rewriting {
    pub file: SessionFile,
    /// What is written of each channel, in the order of the original.
    pub messages: Vec<Read>,
    channels: BTreeMap<String, foveate_session::file::Channel>,
    session: Session,
}

impl Rewriting {
    /// Begins the file `to` with metadata, attachments and channels of the file `from`. Each event gets a message of its own.
    pub fn begin(from: &Path, to: &Path, packing: Packing) -> Rewriting {
        let mut session = Session::open(from).unwrap();
        let mut file = SessionFile::create(to, packing).unwrap();
        file.metadata(names::SESSION, session.facts.clone()).unwrap();
        for name in session.files() {
            file.attach(&name, "text/plain", &session.file(&name).unwrap()).unwrap();
        }
        let mut channels = BTreeMap::new();
        for it in session.summary.channels.values() {
            let schema = session.summary.schemas.get(&it.schema_id);
            let schema =
                schema.map(|(header, bytes)| (header.name.as_str(), header.encoding.as_str(), bytes.as_slice()));
            let channel = file.channel(&it.topic, &it.message_encoding, schema, &it.metadata).unwrap();
            channels.insert(it.topic.clone(), channel);
        }
        file.flush().unwrap();
        let mut written = Vec::new();
        for (topic, time, bytes) in messages(&mut session).unwrap() {
            if topic != names::ORDER {
                written.push((topic, time, bytes));
                continue;
            }
            for entry in order::decode(&bytes).unwrap() {
                let mut bytes = Vec::new();
                order::Encoder::default().add(&entry, &mut bytes);
                written.push((topic.clone(), entry.now.0 as u64, bytes));
            }
        }
        Rewriting { file, messages: written, channels, session }
    }

    pub fn write(&mut self, messages: &[Read]) {
        for (topic, time, bytes) in messages {
            self.file.message(self.channels[topic], *time as i64, *time as i64, bytes).unwrap();
        }
    }

    pub fn finish(mut self) {
        self.file.metadata(names::END, self.session.end.take().unwrap()).unwrap();
        self.file.finish().unwrap();
    }
}

/// Writes a session of `n_chunks` chunks.
pub fn write_small(path: &Path, packing: Packing, n_chunks: usize, is_finished: bool) -> Arc<Graph> {
    let graph = graph("");
    let first = path.with_extension("first");
    record(&first, &graph, packing, false);
    let mut again = Rewriting::begin(&first, path, packing);
    let messages = again.messages.clone();
    for part in messages.chunks(messages.len().div_ceil(n_chunks)) {
        again.write(part);
        again.file.flush().unwrap();
    }
    // What is dropped unfinished writes its summary all the same.
    let unfinished = std::fs::read(path).unwrap();
    again.finish();
    if !is_finished {
        std::fs::write(path, unfinished).unwrap();
    }
    std::fs::remove_file(first).unwrap();
    graph
}

/// A folder in memory where there is one: thousands of files are written and synced.
pub fn folder() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).unwrap()
}

/// Random numbers (xorshift64*), the same for the same seed.
pub struct Random(pub u64);

impl Random {
    /// Below `n`.
    pub fn below(&mut self, n: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 32) as usize % n.max(1)
    }
}

/// Opens and plays a file; what was read is a beginning of `whole`, or all of it where nothing is said.
pub fn survive(path: &Path, graph: &Arc<Graph>, whole: &Content) {
    let (remarks, content, error) = read(path, graph);
    assert!(whole.events.starts_with(&content.events), "{remarks:?} {error:?}");
    if remarks.is_empty() && error.is_none() {
        assert!(
            content.events.len() == whole.events.len() && content.files == whole.files,
            "it is less or other, and nothing was said"
        );
    }
}
