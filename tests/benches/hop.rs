//! What a hop between two nodes costs in one process, ledger on: chains of 4 and of 32 pass-through nodes, slope between them.
//!
//! `cargo bench -p foveate-tests --bench hop`. One source emits as fast as the engine asks; the time of the whole run is divided by
//! the number of messages. The slope cancels what source and sink cost.

use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use foveate::messages::SpaceKind;
use foveate::prelude::*;
use foveate_dataflow::rig::{self, Overrides};
use foveate_dataflow::run::{self, Options};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A payload of any size.
struct Blob(Vec<u8>);

impl Message for Blob {
    const NAME: &'static str = "blob";
    const SPACE: SpaceKind = SpaceKind::None;
}

const IN: In<Blob> = In::each(0, "blob");
const OUT: Out<Blob> = Out::new(0, "blob");

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
struct SourceSettings {
    /// Messages [–].
    count: u64,
    /// Size of each [bytes].
    size: usize,
}

impl Default for SourceSettings {
    fn default() -> Self {
        Self { count: 1, size: 64 }
    }
}

struct Source {
    settings: SourceSettings,
    given: u64,
    pool: Pool<Blob>,
}

impl Node for Source {
    const TYPE: &'static str = "bench.source";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Gives blobs.";
    type Settings = SourceSettings;
    fn ports() -> Ports {
        Ports::new().output(&OUT)
    }
    fn new(settings: SourceSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self { settings, given: 0, pool: Pool::default() })
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let size = self.settings.size;
        let blob = self.pool.take(|| Blob(vec![7; size]));
        let blob = self.pool.share(blob);
        io.emit_at(&OUT, Time(self.given as i64), blob);
        self.given += 1;
        Ok(())
    }
    fn due(&mut self) -> Due {
        if self.given < self.settings.count { Due::At(Time(self.given as i64)) } else { Due::Never }
    }
}

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
struct NoSettings {}

struct Pass;

impl Node for Pass {
    const TYPE: &'static str = "bench.pass";
    const ROLE: Role = Role::ModelFilter;
    const SUMMARY: &'static str = "Passes blobs on.";
    type Settings = NoSettings;
    fn ports() -> Ports {
        Ports::new().input(&IN).output(&OUT)
    }
    fn new(_settings: NoSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self)
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(blob) = io.take(&IN) {
            io.emit(&OUT, blob.stamp, blob.value);
        }
        Ok(())
    }
}

struct End;

impl Node for End {
    const TYPE: &'static str = "bench.end";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Takes blobs.";
    type Settings = NoSettings;
    fn ports() -> Ports {
        Ports::new().input(&IN)
    }
    fn new(_settings: NoSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self)
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(blob) = io.take(&IN) {
            black_box(blob.value.0.first());
        }
        Ok(())
    }
}

/// Nanoseconds a message through `length` nodes: the median over repeated runs.
fn chain_ns(length: usize, size: usize, count: u64) -> f64 {
    let mut registry = Registry::new();
    registry.add::<Source>();
    registry.add::<Pass>();
    registry.add::<End>();
    let mut text = format!(
        "[rig]\nname = \"hop\"\n[scale.s]\n[scale.s.node.n0]\ntype = \"bench.source\"\ncount = {count}\nsize = {size}\n"
    );
    for index in 1..=length {
        let before = index - 1;
        text += &format!("[scale.s.node.n{index}]\ntype = \"bench.pass\"\nin = {{ blob = \"n{before}.blob\" }}\n");
    }
    text += &format!("[scale.s.node.end]\ntype = \"bench.end\"\nin = {{ blob = \"n{length}.blob\" }}\n");
    let mut times: Vec<f64> = (0..9)
        .map(|_| {
            let graph = match rig::load(&text, Path::new("hop.toml"), &registry, &Overrides::default()) {
                Ok(graph) => Arc::new(graph),
                Err(faults) => panic!("{}", faults.render(false)),
            };
            let start = Instant::now();
            let outcome = run::deterministic(graph, &Options::default(), &mut |_| {});
            assert!(outcome.is_ok_and(|it| it.ledgers.iter().all(|edge| edge.delivered == count)));
            start.elapsed().as_nanos() as f64 / count as f64
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

fn main() {
    println!("in one process, one thread, ledger on, median of 9 runs");
    println!("{:>10} {:>12} {:>12} {:>12}", "payload", "4 nodes", "32 nodes", "a hop");
    for (name, size) in [("64 B", 64), ("1 MiB", 1 << 20)] {
        let (short, long) = (chain_ns(4, size, 200_000), chain_ns(32, size, 200_000));
        println!("{name:>10} {short:>9.0} ns {long:>9.0} ns {:>9.1} ns", (long - short) / 28.0);
    }
}
