//! What a hop between two threads costs in a live run, ledger on: chains of 2 and of 10 nodes that change threads each time.
//!
//! `cargo bench -p foveate-tests --bench hop_threads`. One message each 200 µs; from emission to arrival by the wall clock, median;
//! the slope between the two lengths is the price of one change of threads, the turn of a node included.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use foveate::prelude::*;
use foveate_engine::{self as engine, Options};
use foveate_messages::{Message, Space, Wire};
use foveate_rig::{self as rig, Overrides};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const COUNT: usize = 4_000;
const PERIOD_NS: i64 = 200_000;
/// Repetitions; the least median counts.
const ROUNDS: usize = 5;

static TOOK_NS: Mutex<Vec<u64>> = Mutex::new(Vec::new());

/// 64 bytes, and when they were sent.
struct Token {
    sent: Instant,
    _payload: [u8; 64],
}

impl Message for Token {
    const NAME: &'static str = "token";
    const SPACE: Space = Space::NONE;
    const WIRE: Wire = Wire::Local;
}

const IN: In<Token> = In::each(0, "token");
const OUT: Out<Token> = Out::new(0, "token");

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
struct NoSettings {}

struct Source {
    given: usize,
}

impl Node for Source {
    const TYPE: &'static str = "bench.source";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Gives tokens.";
    type Settings = NoSettings;
    fn ports() -> Ports {
        Ports::new().output(&OUT)
    }
    fn new(_settings: NoSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self { given: 0 })
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        self.given += 1;
        io.emit_at(&OUT, io.now(), Token { sent: Instant::now(), _payload: [7; 64] });
        Ok(())
    }
    fn due(&mut self) -> Due {
        if self.given < COUNT { Due::At(Time((self.given as i64 + 1) * PERIOD_NS)) } else { Due::Never }
    }
}

struct Pass;

impl Node for Pass {
    const TYPE: &'static str = "bench.pass";
    const ROLE: Role = Role::ModelFilter;
    const SUMMARY: &'static str = "Passes tokens on.";
    type Settings = NoSettings;
    fn ports() -> Ports {
        Ports::new().input(&IN).output(&OUT)
    }
    fn new(_settings: NoSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self)
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(token) = io.take(&IN) {
            io.emit(&OUT, token.stamp, token.value);
        }
        Ok(())
    }
}

struct End {
    took_ns: Vec<u64>,
}

impl Node for End {
    const TYPE: &'static str = "bench.end";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Takes tokens.";
    type Settings = NoSettings;
    fn ports() -> Ports {
        Ports::new().input(&IN)
    }
    fn new(_settings: NoSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self { took_ns: Vec::with_capacity(COUNT) })
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(token) = io.take(&IN) {
            self.took_ns.push(token.value.sent.elapsed().as_nanos() as u64);
        }
        Ok(())
    }
    fn finish(&mut self, _report: &mut Report) -> Result<(), NodeError> {
        *TOOK_NS.lock().unwrap_or_else(PoisonError::into_inner) = std::mem::take(&mut self.took_ns);
        Ok(())
    }
}

/// Median and 99th percentile of the way through `length` changes of threads [ns].
fn chain_ns(folder: &Path, length: usize) -> (u64, u64) {
    let mut registry = Registry::new();
    registry.add::<Source>();
    registry.add::<Pass>();
    registry.add::<End>();
    // Nodes of a camera are on one thread, nodes of none on another.
    let camera = |index: usize| if index.is_multiple_of(2) { "camera = \"ring-1\"\n" } else { "" };
    let mut text = format!(
        "[rig]\nname = \"hop\"\ncalibration = \"cameras.toml\"\n[scale.s]\n[scale.s.node.n0]\ntype = \"bench.source\"\n{}",
        camera(0)
    );
    for index in 1..=length {
        let (before, kind) = (index - 1, if index == length { "end" } else { "pass" });
        text += &format!(
            "[scale.s.node.n{index}]\ntype = \"bench.{kind}\"\n{}in.token = \"n{before}.token\"\n",
            camera(index)
        );
    }
    let rounds = (0..ROUNDS).map(|_| {
        let graph = match rig::load(&text, &folder.join("hop.toml"), &registry, &Overrides::default()) {
            Ok(graph) => Arc::new(graph),
            Err(faults) => panic!("{}", faults.render(false)),
        };
        let outcome = engine::live(graph, &Options { workers: Some(2), ..Options::default() }, &mut |_| {});
        assert!(outcome.is_ok_and(|it| it.faults.is_empty()));
        let mut took_ns = std::mem::take(&mut *TOOK_NS.lock().unwrap_or_else(PoisonError::into_inner));
        took_ns.sort_unstable();
        (took_ns[took_ns.len() / 2], took_ns[took_ns.len() * 99 / 100])
    });
    rounds.min().unwrap_or_default()
}

fn main() {
    let folder = tempfile::tempdir().expect("a folder for the calibration");
    let calibration = foveate_testkit::scene::ring_calibration(1).to_toml();
    std::fs::write(folder.path().join("cameras.toml"), calibration).expect("the calibration can be written");
    let (short, long) = (chain_ns(folder.path(), 2), chain_ns(folder.path(), 10));
    println!("in one process, two threads, ledger on, least median of {ROUNDS} runs");
    println!("{:>10} {:>12} {:>12} {:>12}", "", "2 hops", "10 hops", "a hop");
    for (name, short, long) in [("p50", short.0, long.0), ("p99", short.1, long.1)] {
        println!("{name:>10} {short:>9} ns {long:>9} ns {:>9.0} ns", (long as f64 - short as f64) / 8.0);
    }
}
