//! The simulated lab as a rig: one run is like another, cameras keep their own time, the truth scores perfectly.

use std::path::Path;
use std::sync::Arc;

use foveate_engine::{self as engine, Options, Outcome};
use foveate_messages::Image;
use foveate_node::{ConfigError, Io, Node, NodeError, Ports, Registry, Report, Role, Setup, ports};
use foveate_rig::{self as rig, Overrides};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Settings of [`Digest`]: none.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
struct DigestSettings {}

ports! {
    IMAGES: In<Image> = each("images").many();
}

/// Sums up all that it sees into two numbers.
#[derive(Default)]
struct Digest {
    hash: u64,
    n_images: u64,
    ages_ms: f64,
}

impl Node for Digest {
    const TYPE: &'static str = "test.digest";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Sums up images.";
    type Settings = DigestSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(_settings: DigestSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self::default())
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let now = io.now();
        while let Some(image) = io.take(&IMAGES) {
            self.n_images += 1;
            self.ages_ms += (now - image.time()).as_ms();
            let start = self.hash ^ image.time().0 as u64 ^ u64::from(image.value.camera.0);
            let step = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3);
            self.hash = image.value.pixels.iter().step_by(7).fold(start, step);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.figure("hash", (self.hash >> 12) as f64);
        report.figure("images", self.n_images as f64);
        report.figure("age_ms.mean", self.ages_ms / self.n_images as f64);
        Ok(())
    }
}

fn run_rig(seed: u64, camera_settings: &str, out_dir: Option<&Path>) -> Outcome {
    let text = format!(
        r#"
        [rig]
        name = "sim-test"
        calibration = "ideal_lab.calibration.toml"
        seed = {seed}
        duration_s = 0.5

        [scale.room.node.lab]
        type = "sim.lab"
        people_enter_s = 0.1

        [scale.room.node.video]
        type = "sim.camera"
        each = "wide-*"
        in = {{ world = "lab.world" }}
        {camera_settings}

        [scale.room.node.digest]
        type = "test.digest"
        in = {{ images = "video.image" }}

        [scale.room.node.score]
        type = "sim.score"
        in = {{ truth = "lab.truth", targets = "lab.truth" }}
        "#
    );
    let mut registry = Registry::new();
    foveate_sim::register(&mut registry);
    registry.add::<Digest>();
    let path = foveate_testkit::data::workspace_root().join("graphs/sim-test.toml");
    let graph = rig::load(&text, &path, &registry, &Overrides::default()).unwrap_or_else(|faults| panic!("{faults}"));
    let options = Options { out_dir: out_dir.map(Path::to_owned), ..Options::default() };
    engine::deterministic(Arc::new(graph), &options, &mut |_| ()).unwrap()
}

#[test]
fn same_seed_same_pixels() {
    let hash = |outcome: Outcome| outcome.report.figures["hash"];
    let first = hash(run_rig(1, "", None));
    assert_eq!(first, hash(run_rig(1, "", None)));
    assert_ne!(first, hash(run_rig(2, "", None)));
}

#[test]
fn all_cameras_deliver_after_their_latency() {
    let outcome = run_rig(1, "latency_ms = 25.0", None);
    let figures = &outcome.report.figures;
    assert!((figures["age_ms.mean"] - 25.0).abs() < 1e-3, "{figures:?}");
    // 18 cameras at 60 Hz for half a second, less what is still on its way at the end.
    assert!((18.0 * 27.0..=18.0 * 30.0).contains(&figures["images"]), "{figures:?}");
    assert!(outcome.faults.is_empty() && outcome.gaps.is_empty(), "{:?} {:?}", outcome.faults, outcome.gaps);
}

#[test]
fn lost_fields_are_gaps() {
    let whole = run_rig(1, "", None).report.figures["images"];
    let outcome = run_rig(1, "lost = 0.25", None);
    let share = 1.0 - outcome.report.figures["images"] / whole;
    assert!((0.18..0.32).contains(&share), "{share}");
    assert!(!outcome.gaps.is_empty());
}

#[test]
fn truth_scores_perfectly_and_is_saved() {
    let folder = tempfile::tempdir().unwrap();
    let outcome = run_rig(1, "", Some(folder.path()));
    let figures = &outcome.report.figures;
    assert_eq!((figures["targets_true"], figures["identities_per_target"]), (8.0, 1.0), "{figures:?}");
    assert_eq!((figures["missed"], figures["completeness"], figures["id_switches"]), (0.0, 1.0, 0.0), "{figures:?}");
    assert!(figures["error_mm.p95"] < 0.01, "{figures:?}");
    let text = std::fs::read_to_string(folder.path().join("truth.csv")).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines[0], "time_s,target,x_m,y_m,z_m");
    assert!(lines.len() == 1 + 8 * 24 && lines[1..].iter().all(|line| line.split(',').count() == 5), "{}", lines.len());
}

#[test]
fn truth_that_cannot_be_saved_is_said_after_the_figures() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("truth.csv")).unwrap();
    let outcome = run_rig(1, "", Some(folder.path()));
    assert_eq!(outcome.report.figures["completeness"], 1.0);
    assert_eq!(outcome.faults.len(), 1);
    assert!(format!("{:?}", outcome.faults[0]).contains("truth.csv"), "{:?}", outcome.faults);
}
