//! The whole `foveate` program with one's own nodes linked in: `cargo run --release -p foveate-examples --bin own_program -- nodes example.speed_limit`.

use std::process::ExitCode;

fn main() -> ExitCode {
    let mut registry = foveate_cli::registry();
    foveate_examples::register(&mut registry);
    foveate_cli::run(registry)
}
