//! A live run that cannot keep up: nobody starves, what waits stays bounded, and what is lost is counted.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{Duration, Instant};

use foveate::prelude::*;
use foveate_engine::{self as engine, Options};
use foveate_messages::{Message, Space, Wire};
use foveate_rig::{self as rig, Overrides};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const CAMERAS: usize = 3;
/// Pictures of each camera, one each millisecond.
const COUNT: u64 = 600;
/// What one of them keeps the slow node busy: it can take a twelfth of all.
const BUSY: Duration = Duration::from_millis(4);

static ALIVE: AtomicI64 = AtomicI64::new(0);
static MOST_ALIVE: AtomicI64 = AtomicI64::new(0);

/// A message that is counted while anybody holds it.
struct Counted;

impl Counted {
    fn new() -> Self {
        let alive = ALIVE.fetch_add(1, Ordering::SeqCst) + 1;
        MOST_ALIVE.fetch_max(alive, Ordering::SeqCst);
        Counted
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        ALIVE.fetch_sub(1, Ordering::SeqCst);
    }
}

impl Message for Counted {
    const NAME: &'static str = "counted";
    const SPACE: Space = Space::NONE;
    const WIRE: Wire = Wire::Local;
}

const IN: In<Counted> = In::each(0, "counted").many();
const OUT: Out<Counted> = Out::new(0, "counted");

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
struct NoSettings {}

struct Source {
    given: u64,
}

impl Source {
    fn next(&self) -> Time {
        Time(self.given as i64 * 1_000_000)
    }
}

impl Node for Source {
    const TYPE: &'static str = "test.source";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Gives messages that are counted.";
    type Settings = NoSettings;
    fn ports() -> Ports {
        Ports::new().output(&OUT)
    }
    fn new(_settings: NoSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self { given: 0 })
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        io.emit_at(&OUT, self.next(), Counted::new());
        self.given += 1;
        Ok(())
    }
    fn due(&mut self) -> Due {
        if self.given < COUNT { Due::At(self.next()) } else { Due::Never }
    }
}

struct Slow;

impl Node for Slow {
    const TYPE: &'static str = "test.slow";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Takes its time.";
    type Settings = NoSettings;
    fn ports() -> Ports {
        Ports::new().input(&IN)
    }
    fn new(_settings: NoSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self)
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let end = Instant::now() + BUSY;
        while Instant::now() < end {
            std::hint::spin_loop();
        }
        drop(io.take(&IN));
        Ok(())
    }
}

#[test]
fn newest_of_each_starves_nobody_keeps_memory_bounded_and_counts_what_it_drops() {
    let mut registry = Registry::new();
    registry.add::<Source>();
    registry.add::<Slow>();
    let folder = tempfile::tempdir().unwrap();
    let calibration = foveate_testkit::scene::ring_calibration(CAMERAS);
    std::fs::write(folder.path().join("cameras.toml"), calibration.to_toml()).unwrap();
    // A camera's nodes and what joins cameras run on different threads.
    let rig = "[rig]\nname = \"overload\"\ncalibration = \"cameras.toml\"\n[scale.room]\n\
               [scale.room.node.video]\ntype = \"test.source\"\neach = \"ring-*\"\n\
               [scale.room.node.slow]\ntype = \"test.slow\"\n\
               in.counted = { from = \"video.counted\", policy = \"newest_of_each\", capacity = 4 }\n";
    let graph = match rig::load(rig, &folder.path().join("test.toml"), &registry, &Overrides::default()) {
        Ok(graph) => Arc::new(graph),
        Err(faults) => panic!("{}", faults.render(false)),
    };
    let options = Options { workers: Some(2), ..Options::default() };
    let outcome = engine::live(graph, &options, &mut |_| {}).unwrap();
    let delivered: Vec<u64> = outcome.ledgers.iter().map(|it| it.delivered).collect();
    let total: u64 = delivered.iter().sum();
    assert!(total < CAMERAS as u64 * COUNT / 2, "it was not overloaded: {delivered:?}");
    // A third each on average; a tenth is six standard deviations away.
    assert!(delivered.iter().all(|&it| it * 10 > total), "{delivered:?}");
    for edge in &outcome.ledgers {
        assert_eq!(edge.delivered + edge.dropped, COUNT, "all that was sent is accounted for");
        assert_eq!(edge.gaps, 0, "what was dropped is no gap");
    }
    // By camera: what was taken out of the queue at once, the queue filled anew meanwhile, one being put into it, one waiting at the port; and the one at work.
    let most = CAMERAS as i64 * (2 * 4 + 2) + 1;
    assert!(MOST_ALIVE.load(Ordering::SeqCst) <= most, "{MOST_ALIVE:?} messages at once, expected at most {most}");
    assert_eq!(ALIVE.load(Ordering::SeqCst), 0);
}
