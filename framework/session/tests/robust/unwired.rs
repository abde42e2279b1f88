//! Outputs that no edge carries: which of them are recorded, and that a replay gets along with them.

use std::path::Path;
use std::sync::Arc;

use foveate_engine::{self as engine, Options, Source as Origin};
use foveate_messages::{Message, Space, Time, Wire};
use foveate_node::port::MessageType;
use foveate_node::{ConfigError, Due, In, Io, Node, NodeError, Out, Ports, Registry, Role, Setup};
use foveate_rig::Overrides;
use foveate_rig::graph::Graph;
use foveate_session::{Packing, Player, Session, body, replay};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::parts::{Nothing, Reading, Sink, messages, record};

const COUNT: u64 = 20;

/// What people read after the run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
struct Said {
    bytes: Vec<u8>,
}

impl Message for Said {
    const NAME: &'static str = "line_traffic";
    const SPACE: Space = Space::NONE;
    const WIRE: Wire = Wire::portable::<Said>();
}

const READINGS: Out<Reading> = Out::new(0, "readings");
const SAID: Out<Said> = Out::new(1, "said");
const SPARE: Out<Reading> = Out::new(2, "spare");
const INPUT: In<Reading> = In::each(0, "readings");

fn reading(number: u64) -> Reading {
    Reading { number, bulk: Vec::new() }
}

/// Each number at all three outputs.
struct Talker(u64);

impl Node for Talker {
    const TYPE: &'static str = "test.talker";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Numbers, and what was said about them.";
    type Settings = Nothing;

    fn ports() -> Ports {
        Ports::new().output(&READINGS).output(&SAID).output(&SPARE)
    }
    fn new(_: Nothing, _: &Setup) -> Result<Self, ConfigError> {
        Ok(Self(0))
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        io.emit_at(&SAID, io.now(), Said { bytes: vec![self.0 as u8, 0xFF] });
        io.emit_at(&READINGS, io.now(), reading(self.0));
        io.emit_at(&SPARE, io.now(), reading(self.0));
        self.0 += 1;
        Ok(())
    }
    fn due(&mut self) -> Due {
        if self.0 < COUNT { Due::At(Time(self.0 as i64 * 10_000_000)) } else { Due::Never }
    }
}

/// Twice the number, and what was said about it.
struct Answerer;

impl Node for Answerer {
    const TYPE: &'static str = "test.answerer";
    const ROLE: Role = Role::ModelFilter;
    const SUMMARY: &'static str = "Twice the number, and what was said about it.";
    type Settings = Nothing;

    fn ports() -> Ports {
        Ports::new().input(&INPUT).output(&READINGS).output(&SAID)
    }
    fn new(_: Nothing, _: &Setup) -> Result<Self, ConfigError> {
        Ok(Self)
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(it) = io.take(&INPUT) else { return Ok(()) };
        io.emit(&READINGS, it.stamp, reading(2 * it.value.number));
        io.emit(&SAID, it.stamp, Said { bytes: vec![it.value.number as u8] });
        Ok(())
    }
}

fn graph() -> Arc<Graph> {
    let text = "[rig]\nname = \"talk\"\nseed = 7\n[scale.room.node.a]\ntype = \"test.talker\"\n\
                [scale.room.node.b]\ntype = \"test.answerer\"\nin.readings = \"a.readings\"\n\
                [scale.room.node.c]\ntype = \"test.sink\"\nin.readings = \"b.readings\"\n";
    let mut registry = Registry::new();
    registry.add::<Talker>();
    registry.add::<Answerer>();
    registry.add::<Sink>();
    match foveate_rig::load(text, Path::new("talk.toml"), &registry, &Overrides::default()) {
        Ok(graph) => Arc::new(graph),
        Err(faults) => panic!("{}", faults.render(false)),
    }
}

#[test]
fn line_traffic_is_recorded_without_an_edge_and_other_messages_are_not() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mcap");
    record(&path, &graph(), Packing::None, false);
    let mut session = Session::open(&path).unwrap();
    assert_eq!(session.fact("left_away"), "[\"/room/a/spare\"]");
    let all = messages(&mut session).unwrap();
    let said = |topic: &str| -> Vec<Vec<u8>> {
        let of_topic = all.iter().filter(|it| it.0 == topic);
        let packets = of_topic.map(|it| body::decode(&MessageType::of::<Said>(), &it.2).unwrap());
        packets.map(|it| it.as_typed::<Said>().unwrap().bytes.clone()).collect()
    };
    let numbers = 0..COUNT as u8;
    assert_eq!(said("/room/a/said"), numbers.clone().map(|it| vec![it, 0xFF]).collect::<Vec<_>>());
    assert_eq!(said("/room/b/said"), numbers.map(|it| vec![it]).collect::<Vec<_>>());
    assert!(!all.iter().any(|it| it.0 == "/room/a/spare"));
}

#[test]
fn replays_need_no_message_of_an_output_without_an_edge() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mcap");
    let graph = graph();
    record(&path, &graph, Packing::None, false);
    let ledgers = |outcome: &engine::Outcome| outcome.ledgers.iter().map(|it| it.delivered).collect::<Vec<_>>();
    let run = engine::deterministic(Arc::clone(&graph), &Options::default(), &mut |_| {}).unwrap();
    assert_eq!(ledgers(&run), [COUNT, COUNT]);
    let usual = replay::sources(&graph, &Session::open(&path).unwrap()).0;
    assert_eq!(usual, [Origin::Recording, Origin::Node, Origin::Node]);
    // The node in the middle works again, or its messages come from the file.
    for sources in [usual, vec![Origin::Recording, Origin::Recording, Origin::Node], vec![Origin::Recording; 3]] {
        let mut player = Player::new(Session::open(&path).unwrap(), Arc::clone(&graph), &sources).unwrap();
        let again =
            engine::replay(Arc::clone(&graph), &sources, &mut player, &Options::default(), &mut |_| {}).unwrap();
        assert!(again.faults.is_empty(), "{sources:?}: {:?}", again.faults);
        assert_eq!(ledgers(&again), ledgers(&run), "{sources:?}");
        assert_eq!((again.ended, &again.report), (run.ended, &run.report), "{sources:?}");
    }
}
