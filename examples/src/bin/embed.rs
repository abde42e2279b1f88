//! Runs a rig from a program of one's own, with one's own node in it: `cargo run --release -p foveate-examples --bin embed`.

use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;

use foveate_embed::engine::{self, Options};
use foveate_embed::rig::{self, Overrides};

/// The simulated lab for three seconds, with the node of this crate between the integrator and the score.
const RIG: &str = r#"
[rig]
name = "embedded"
calibration = "ideal_lab.calibration.toml"
duration_s = 3

[scale.room]
volume_m = { min = [-1.75, -2.5, 0.0], max = [1.75, 2.5, 2.2] }

[scale.room.node.lab]
type = "sim.lab"

[scale.room.node.video]
type = "sim.camera"
each = "wide-*"
in = { world = "lab.world" }

[scale.room.node.leds]
type = "led.detector"
each = "wide-*"
in = { image = "video.image", predicted = "targets.predicted" }

[scale.room.node.targets]
type = "led.integrator"
in = { features = "leds.features" }

[scale.room.node.credible]
type = "example.speed_limit"
in = { targets = "targets.targets" }
max_speed = 8

[scale.room.node.score]
type = "sim.score"
in = { targets = "credible.targets", truth = "lab.truth" }
"#;

/// Where the rig would lie if it were a file: its relative paths start there.
const RIG_PATH: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../graphs/embedded.toml");

/// What to print of all the figures.
const SHOWN: [&str; 4] = ["error_mm.median", "identities", "false_targets", "speed_limit.dropped"];

fn main() -> ExitCode {
    let mut registry = foveate_cli::registry();
    foveate_examples::register(&mut registry);
    let graph = match rig::load(RIG, Path::new(RIG_PATH), &registry, &Overrides::default()) {
        Ok(graph) => Arc::new(graph),
        Err(faults) => {
            eprint!("{}", faults.render(false));
            return ExitCode::from(2);
        }
    };
    match engine::deterministic(graph, &Options::default(), &mut |_| {}) {
        Ok(outcome) => {
            for name in SHOWN {
                if let Some(value) = outcome.report.figures.get(name) {
                    println!("{name} = {value:.3}");
                }
            }
            ExitCode::SUCCESS
        }
        Err(refusal) => {
            eprintln!("{refusal}");
            ExitCode::from(2)
        }
    }
}
