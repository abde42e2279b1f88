//! What a hop between two nodes costs in one process, ledger on: chains of 4 and of 32 pass-through nodes, slope between them.
//!
//! `cargo bench -p foveate-tests --bench hop`. One source emits as fast as the engine asks; the time of the whole run is divided by
//! the number of messages. The slope cancels what source and sink cost.

use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use foveate::prelude::*;
use foveate_engine::{self as engine, Options};
use foveate_rig::{self as rig, Overrides};
use foveate_testkit::nodes::Blob;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Repetitions of each measurement.
const ROUNDS: usize = 15;

ports! {
    IN: In<Blob> = each("blob");
}

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
struct NoSettings {}

/// Looks at each blob and lets it go.
struct End;

impl Node for End {
    const TYPE: &'static str = "bench.end";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Takes blobs.";
    type Settings = NoSettings;
    fn ports() -> Ports {
        declared_ports()
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

/// Nanoseconds a message through `length` nodes: the least of repeated runs: what other programs take away is not ours.
fn chain_ns(length: usize, size: usize, count: u64) -> f64 {
    let mut registry = Registry::new();
    foveate_testkit::register(&mut registry);
    registry.add::<End>();
    let mut text = format!(
        "[rig]\nname = \"hop\"\n[scale.s]\n[scale.s.node.n0]\ntype = \"testkit.blob_source\"\ncount = {count}\nsize = {size}\n"
    );
    for index in 1..=length {
        let before = index - 1;
        text += &format!("[scale.s.node.n{index}]\ntype = \"testkit.pass\"\nin = {{ blob = \"n{before}.blob\" }}\n");
    }
    text += &format!("[scale.s.node.end]\ntype = \"bench.end\"\nin = {{ blob = \"n{length}.blob\" }}\n");
    let times = (0..ROUNDS).map(|_| {
        let graph = match rig::load(&text, Path::new("hop.toml"), &registry, &Overrides::default()) {
            Ok(graph) => Arc::new(graph),
            Err(faults) => panic!("{}", faults.render(false)),
        };
        let start = Instant::now();
        let outcome = engine::deterministic(graph, &Options::default(), &mut |_| {});
        assert!(outcome.is_ok_and(|it| it.ledgers.iter().all(|edge| edge.delivered == count)));
        start.elapsed().as_nanos() as f64 / count as f64
    });
    times.fold(f64::INFINITY, f64::min)
}

fn main() {
    println!("in one process, one thread, ledger on, least of {ROUNDS} runs");
    println!("{:>10} {:>12} {:>12} {:>12}", "payload", "4 nodes", "32 nodes", "a hop");
    for (name, size) in [("64 B", 64), ("1 MiB", 1 << 20)] {
        let (short, long) = (chain_ns(4, size, 200_000), chain_ns(32, size, 200_000));
        println!("{name:>10} {short:>9.0} ns {long:>9.0} ns {:>9.1} ns", (long - short) / 28.0);
    }
}
