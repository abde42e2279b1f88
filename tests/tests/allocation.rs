//! In the steady state a turn of the engine allocates nothing: a counting allocator looks on.
#![allow(unsafe_code, reason = "a global allocator cannot be written without it; it only counts and forwards")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use foveate::messages::SpaceKind;
use foveate::prelude::*;
use foveate_dataflow::rig::{self, Overrides};
use foveate_dataflow::run::{self, Options};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

struct Counting;

static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);

// SAFETY: every call is forwarded unchanged to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promises are passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller's promises are passed on.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const COUNT: u64 = 5_000;
/// By then all buffers have their size.
const WARM: u64 = 1_000;
static AT_WARM: AtomicU64 = AtomicU64::new(0);
static AT_END: AtomicU64 = AtomicU64::new(0);

struct Blob(Vec<u8>);

impl Message for Blob {
    const NAME: &'static str = "blob";
    const SPACE: SpaceKind = SpaceKind::None;
}

const IN: In<Blob> = In::each(0, "blob").many();
const BACK: In<Blob> = In::latest(1, "back").optional();
const OUT: Out<Blob> = Out::new(0, "blob");

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
struct NoSettings {}

/// Gives pooled blobs.
struct Source {
    given: u64,
    pool: Pool<Blob>,
}

impl Node for Source {
    const TYPE: &'static str = "test.source";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Gives blobs.";
    type Settings = NoSettings;
    fn ports() -> Ports {
        Ports::new().output(&OUT)
    }
    fn new(_settings: NoSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self { given: 0, pool: Pool::default() })
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let blob = self.pool.take(|| Blob(vec![0; 4096]));
        let blob = self.pool.share(blob);
        io.emit_at(&OUT, Time(self.given as i64 * 1000), blob);
        self.given += 1;
        Ok(())
    }
    fn due(&mut self) -> Due {
        if self.given < COUNT { Due::At(Time(self.given as i64 * 1000)) } else { Due::Never }
    }
}

/// Passes blobs on; has a port that closes a cycle.
struct Pass;

impl Node for Pass {
    const TYPE: &'static str = "test.pass";
    const ROLE: Role = Role::ModelFilter;
    const SUMMARY: &'static str = "Passes blobs on.";
    type Settings = NoSettings;
    fn ports() -> Ports {
        Ports::new().input(&IN).input(&BACK).output(&OUT)
    }
    fn new(_settings: NoSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self)
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let _ = io.latest(&BACK).map(|it| it.value.0.len());
        if let Some(blob) = io.take(&IN) {
            io.emit(&OUT, blob.stamp, blob.value);
        }
        Ok(())
    }
}

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
        Ports::new().input(&IN)
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
            AT_WARM.store(ALLOCATIONS.load(Ordering::Relaxed), Ordering::Relaxed);
        }
        AT_END.store(ALLOCATIONS.load(Ordering::Relaxed), Ordering::Relaxed);
        Ok(())
    }
}

#[test]
fn steady_state_allocates_nothing() {
    let mut registry = Registry::new();
    registry.add::<Source>();
    registry.add::<Pass>();
    registry.add::<End>();
    // Two sources into one node (a queue of many), a fan-out, and a feedback edge.
    let rig = "[rig]\nname = \"steady\"\n[scale.s]\n[scale.s.node.a]\ntype = \"test.source\"\n\
               [scale.s.node.b]\ntype = \"test.source\"\n\
               [scale.s.node.c]\ntype = \"test.pass\"\nin = { blob = [\"a.blob\", \"b.blob\"], back = \"d.blob\" }\n\
               [scale.s.node.d]\ntype = \"test.pass\"\nin = { blob = \"c.blob\" }\n\
               [scale.s.node.e]\ntype = \"test.end\"\nin = { blob = [\"c.blob\", \"d.blob\"] }\n";
    let graph = match rig::load(rig, Path::new("steady.toml"), &registry, &Overrides::default()) {
        Ok(graph) => graph,
        Err(faults) => panic!("{}", faults.render(false)),
    };
    // Progress is for people and may allocate; it is not asked for in the short time that this takes.
    let outcome = run::deterministic(Arc::new(graph), &Options::default(), &mut |_| {}).unwrap();
    assert!(outcome.ledgers.iter().all(|it| it.delivered > 0));
    let (warm, end) = (AT_WARM.load(Ordering::Relaxed), AT_END.load(Ordering::Relaxed));
    assert!(warm > 0);
    assert_eq!(end - warm, 0, "allocations between message {WARM} and the last one");
}
