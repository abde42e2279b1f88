//! From a picture's arrival to what a pointer did, live: the wall of `graphs/laser_wall.toml`, its six cameras' pictures rendered beforehand and given out when a
//! camera would have, spots, pointers and events on as many threads as the machine has cores.
//!
//! `cargo bench -p foveate-tests --bench wall_latency`. `laser_pointer.events` states from capture to event; the camera's own 4 ms are taken off.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use foveate::prelude::*;
use foveate_engine::{self as engine, Options};
use foveate_rig::{self as rig, Overrides};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const SECONDS: u32 = 8;
/// From capture to arrival, as the rig sets it [ms].
const CAMERA_MS: f64 = 4.0;
/// What the whole is asked to take beyond the camera: median and 99th percentile [ms].
const GOAL_MS: [f64; 2] = [3.0, 8.0];
/// Live runs of the same pictures.
const ROUNDS: usize = 3;

/// A picture with when it arrives, when it was taken and its number.
type Kept = (Time, Time, u64, Arc<Image>);

static PICTURES: Mutex<BTreeMap<CameraId, Vec<Kept>>> = Mutex::new(BTreeMap::new());

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
struct NoSettings {}

const IMAGE_IN: In<Image> = In::each(0, "image");
const IMAGE_OUT: Out<Image> = Out::new(0, "image");

/// Keeps the pictures of its camera.
struct Keep;

impl Node for Keep {
    const TYPE: &'static str = "bench.keep";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Keeps pictures.";
    type Settings = NoSettings;
    fn ports() -> Ports {
        Ports::new().input(&IMAGE_IN)
    }
    fn new(_settings: NoSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self)
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let now = io.now();
        while let Some(picture) = io.take(&IMAGE_IN) {
            let mut all = PICTURES.lock().unwrap_or_else(PoisonError::into_inner);
            let kept = (now, picture.time(), picture.stamp.sequence, picture.value);
            all.entry(kept.3.camera).or_default().push(kept);
        }
        Ok(())
    }
}

/// Gives them out again, each when it arrived.
struct Play {
    pictures: Vec<Kept>,
    next: usize,
}

impl Node for Play {
    const TYPE: &'static str = "bench.play";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Gives out pictures that were kept.";
    type Settings = NoSettings;
    fn ports() -> Ports {
        Ports::new().output(&IMAGE_OUT)
    }
    fn new(_settings: NoSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let all = PICTURES.lock().unwrap_or_else(PoisonError::into_inner);
        let pictures = setup.camera.and_then(|it| all.get(&it)).cloned().unwrap_or_default();
        Ok(Self { pictures, next: 0 })
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some((_, time, sequence, picture)) = self.pictures.get(self.next).cloned() else { return Ok(()) };
        self.next += 1;
        io.emit_numbered(&IMAGE_OUT, time, sequence, picture);
        Ok(())
    }
    fn due(&mut self) -> Due {
        self.pictures.get(self.next).map_or(Due::Never, |it| Due::At(it.0))
    }
}

fn loaded(text: &str, folder: &Path, registry: &Registry) -> Arc<rig::graph::Graph> {
    match rig::load(text, &folder.join("wall.toml"), registry, &Overrides::default()) {
        Ok(graph) => Arc::new(graph),
        Err(faults) => panic!("{}", faults.render(false)),
    }
}

fn main() {
    let graphs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../graphs");
    let rig = std::fs::read_to_string(graphs.join("laser_wall.toml")).expect("the rig can be read");
    let rig = rig.replace("duration_s = 40", &format!("duration_s = {SECONDS}")).replace("paced = true", "");
    let (world, rest) = rig.split_once("# Nothing is learnt").expect("the rig has its spots");
    let (work, _) = rest.split_once("[scale.wall.node.score]").expect("the rig has its score");
    let mut registry = foveate_cli::registry();
    registry.add::<Keep>();
    registry.add::<Play>();

    let keep = "[scale.wall.node.keep]\ntype = \"bench.keep\"\neach = \"wall-*\"\nin = { image = \"video.image\" }\n";
    let options = Options::default();
    let rendered = engine::deterministic(loaded(&format!("{world}{keep}"), &graphs, &registry), &options, &mut |_| {});
    assert!(rendered.is_ok_and(|it| it.faults.is_empty()), "the pictures are rendered");
    let n: usize = PICTURES.lock().unwrap_or_else(PoisonError::into_inner).values().map(Vec::len).sum();

    let (head, _) = world.split_once("[scale.wall.node.wall]").expect("the rig has its wall");
    let play = "[scale.wall.node.video]\ntype = \"bench.play\"\neach = \"wall-*\"\n#";
    let events = "[scale.wall.node.events]\ntype = \"laser_pointer.events\"\nin = { targets = \"pointers.targets\" }\n";
    let text = format!("{head}{play}{work}{events}");
    println!(
        "{n} pictures of six cameras in {SECONDS} s, live, {ROUNDS} runs; from arrival to event, without the camera's {CAMERA_MS} ms"
    );
    for _ in 0..ROUNDS {
        let outcome = engine::live(loaded(&text, &graphs, &registry), &options, &mut |_| {}).expect("it runs");
        assert!(outcome.faults.is_empty(), "{:?}", outcome.faults);
        let figure = |name: &str| outcome.report.figures[&format!("pointer.move_latency_ms.{name}")] - CAMERA_MS;
        let (p50, p99) = (figure("p50"), figure("p99"));
        let [goal_p50, goal_p99] = GOAL_MS;
        println!(
            "p50 {p50:.2} ms (goal {goal_p50}), p99 {p99:.2} ms (goal {goal_p99}), {} moves",
            outcome.report.figures["pointer.move"]
        );
    }
}
