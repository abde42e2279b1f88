//! Observations a second, association and output included: one thread, features given directly.

use std::time::Instant;

use foveate::messages::Targets;
use foveate_led::tracker::Tracker;
use foveate_testkit::lab::{Lab, ROOM_M, Wanderers};

use crate::Options;
use crate::scenes::MIDDLE_M;
use crate::variants::{VARIANTS, available};

const DURATION_S: f64 = 5.0;

/// Measures: the best of three runs.
pub fn speed(_options: &Options) {
    println!("## Observations a second, in one thread\n");
    println!("| variant | cameras × lights | observations/s | a frame µs |");
    println!("|---|---|---|---|");
    let variants = available(VARIANTS);
    for (n_cameras, n_lights) in [(6, 8), (18, 8), (64, 32)] {
        let lab = Lab { noise: 0.5, ..Lab::new(n_cameras) };
        let frames = lab.frames(DURATION_S, &Wanderers::new(n_lights, DURATION_S, MIDDLE_M, 1.2, 1));
        let n_observations: usize = frames.iter().map(|it| it.1.list.len()).sum();
        for (name, settings) in &variants {
            let run = || {
                let mut tracker = Tracker::new(settings.clone(), lab.cameras.clone(), Some(ROOM_M));
                let mut targets = Targets::default();
                let start = Instant::now();
                for (time, features) in &frames {
                    tracker.observe(*time, features);
                    tracker.write(&mut targets);
                }
                start.elapsed().as_secs_f64()
            };
            let least_s = (0..3).map(|_| run()).fold(f64::INFINITY, f64::min);
            println!(
                "| {name} | {n_cameras} × {n_lights} | {:.0} | {:.2} |",
                n_observations as f64 / least_s,
                1e6 * least_s / frames.len() as f64
            );
        }
    }
    println!();
}
