//! How often each fault of a room is found and named, and how often a camera without fault is accused.
//!
//! `cargo bench -p foveate-calibration --bench checks`; `-- 50` for more than 20 seeds.

#[path = "../tests/it/simulated_room/mod.rs"]
mod simulated_room;

use std::time::Instant;

use foveate_calibration::checks::{CheckOptions, Level, check};
use simulated_room::{FAULTS, Fault, innocent_candidates, is_named, solved};

fn main() {
    let seeds = std::env::args().filter_map(|it| it.parse::<u64>().ok()).next_back().unwrap_or(20);
    println!("{} cameras, 600 frames, 0.3 px, {seeds} seeds", simulated_room::N_CAMERAS);
    println!(
        "{:<24} {:>6} {:>17} {:>6} {:>7} {:>5} {:>9}",
        "fault", "named", "innocent accused", "good", "usable", "redo", "check ms"
    );
    let weaker = [Fault::Moved(2.0), Fault::Focal(1.01), Fault::Distortion(-0.03), Fault::Clock(5.0)];
    for fault in FAULTS.into_iter().chain(weaker) {
        let (mut named, mut innocent, mut levels, mut taken) = (0, 0, [0; 3], 0.0);
        for seed in 1..=seeds {
            let network = solved(fault, seed);
            let start = Instant::now();
            let checks = check(&network, None, &CheckOptions::default());
            taken += start.elapsed().as_secs_f64();
            named += u32::from(is_named(fault, &checks));
            innocent += innocent_candidates(fault, &checks);
            levels[match checks.verdict.level {
                Level::Good => 0,
                Level::Usable => 1,
                Level::Redo => 2,
            }] += 1;
        }
        let [good, usable, redo] = levels;
        let name = format!("{fault:?}");
        let ms = 1e3 * taken / seeds as f64;
        println!("{name:<24} {named:>6} {innocent:>17} {good:>6} {usable:>7} {redo:>5} {ms:>9.0}");
    }
}
