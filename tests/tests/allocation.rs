//! In the steady state a turn of the engine allocates nothing: a counting allocator looks on.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use foveate::prelude::*;
use foveate_engine::{self as engine, Options};
use foveate_rig::{self as rig, Overrides};
use foveate_testkit::allocation::{self, Counting};
use foveate_testkit::nodes::Blob;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const COUNT: u64 = 5_000;
/// By then all buffers have their size.
const WARM: u64 = 1_000;
static AT_WARM: AtomicU64 = AtomicU64::new(0);
static AT_END: AtomicU64 = AtomicU64::new(0);

ports! {
    IN: In<Blob> = each("blob").many();
}

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
struct NoSettings {}

/// Reads the count of allocations when the engine is warm and at the last message.
struct End {
    taken: u64,
}

impl Node for End {
    const TYPE: &'static str = "test.end";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Takes blobs.";
    type Settings = NoSettings;
    fn ports() -> Ports {
        declared_ports()
    }
    fn new(_settings: NoSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self { taken: 0 })
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(blob) = io.take(&IN) {
            assert_eq!(blob.value.0.len(), 4096);
            self.taken += 1;
        }
        if self.taken == WARM {
            AT_WARM.store(allocation::count(), Ordering::Relaxed);
        }
        AT_END.store(allocation::count(), Ordering::Relaxed);
        Ok(())
    }
}

#[test]
fn steady_state_allocates_nothing() {
    let mut registry = Registry::new();
    foveate_testkit::register(&mut registry);
    registry.add::<End>();
    // Two sources into one node (a queue of many), a fan-out, and a feedback edge.
    let rig = format!(
        "[rig]\nname = \"steady\"\n[scale.s]\n[scale.s.node.a]\ntype = \"testkit.blob_source\"\ncount = {COUNT}\nsize = 4096\n\
               [scale.s.node.b]\ntype = \"testkit.blob_source\"\ncount = {COUNT}\nsize = 4096\n\
               [scale.s.node.c]\ntype = \"testkit.pass\"\nin = {{ blob = [\"a.blob\", \"b.blob\"], back = \"d.blob\" }}\n\
               [scale.s.node.d]\ntype = \"testkit.pass\"\nin = {{ blob = \"c.blob\" }}\n\
               [scale.s.node.e]\ntype = \"test.end\"\nin = {{ blob = [\"c.blob\", \"d.blob\"] }}\n"
    );
    let graph = match rig::load(&rig, Path::new("steady.toml"), &registry, &Overrides::default()) {
        Ok(graph) => graph,
        Err(faults) => panic!("{}", faults.render(false)),
    };
    // Progress is for people and may allocate; it is not asked for in the short time that this takes.
    let outcome = engine::deterministic(Arc::new(graph), &Options::default(), &mut |_| {}).unwrap();
    assert!(outcome.ledgers.iter().all(|it| it.delivered > 0));
    let (warm, end) = (AT_WARM.load(Ordering::Relaxed), AT_END.load(Ordering::Relaxed));
    assert!(warm > 0);
    assert_eq!(end - warm, 0, "allocations between message {WARM} and the last one");
}
