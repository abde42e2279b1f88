//! Clocks that disagree: what that costs, and how well their offsets are recovered.

use foveate::messages::{CameraId, Time};
use foveate_led::tracker::{Entry, Tracker};
use foveate_testkit::lab::{Conditions, Lab, ROOM_M, ScoreOptions, Wanderers, score};

use crate::Options;
use crate::scenes::MIDDLE_M;
use crate::variants::settings;

const DURATION_S: f64 = 20.0;
const N_CAMERAS: usize = 6;

const VARIANTS: &[(&str, &str)] = &[
    ("trust", ""),
    ("estimate", "clocks = \"estimate\"\nlate = \"out_of_sequence\"\nclock_spread_ms = 30.0"),
    ("correct", "clocks = \"correct\"\nlate = \"out_of_sequence\"\nclock_spread_ms = 30.0"),
    (
        "correct, 300 ms of history",
        "clocks = \"correct\"\nlate = \"out_of_sequence\"\nclock_spread_ms = 60.0\nhistory_ms = 300.0",
    ),
];

/// Measures.
pub fn clocks(_options: &Options) {
    println!(
        "## Clocks of 6 cameras, every second one ahead and the others behind, 20 ppm of drift, 4 wandering lights, 20 s\n"
    );
    println!(
        "| offset | variant | recovered: mean / largest error ms | position error median / p95 mm | identities a target | missed % |"
    );
    println!("|---|---|---|---|---|---|");
    for offset_ms in [0.0, 5.0, 20.0, 50.0] {
        let side = |camera: usize| if camera.is_multiple_of(2) { 1.0 } else { -1.0 };
        let conditions = |camera: usize| Conditions {
            clock_ahead_s: side(camera) * offset_ms * 1e-3,
            clock_drift: side(camera / 2) * 20e-6,
            ..Conditions::default()
        };
        let lab = Lab { conditions: (0..N_CAMERAS).map(conditions).collect(), ..Lab::new(N_CAMERAS) };
        let lights = Wanderers::new(4, DURATION_S, MIDDLE_M, 1.2, 3);
        let frames = lab.frames(DURATION_S, &lights);
        for (name, text) in VARIANTS {
            let Ok(settings) = settings(text) else {
                println!("| ±{offset_ms} ms | {name} | not available | | | |");
                continue;
            };
            let mut tracker = Tracker::new(settings, lab.cameras.clone(), Some(ROOM_M));
            let score =
                score(&frames, ScoreOptions { settled_s: 5.0, step_s: 0.005 }, &lights, |time, features, targets| {
                    let entry = tracker.observe(time, features);
                    tracker.write(targets);
                    entry == Entry::Applied
                });
            let end = Time::from_s(DURATION_S);
            // Only differences of clocks can be seen: the mean of all is nobody's business.
            let found: Vec<f64> =
                (0..N_CAMERAS as u16).filter_map(|it| Some(tracker.clock(CameraId(it), end)?.offset_s)).collect();
            let truth = |camera: usize| {
                let Conditions { clock_ahead_s, clock_drift, .. } = lab.conditions[camera];
                clock_ahead_s + clock_drift * DURATION_S
            };
            let mean = |of: &dyn Fn(usize) -> f64| (0..N_CAMERAS).map(of).sum::<f64>() / N_CAMERAS as f64;
            let recovered = if found.len() == N_CAMERAS {
                let (found_mean, true_mean) = (mean(&|it| found[it]), mean(&truth));
                let error = |it: usize| 1e3 * ((found[it] - found_mean) - (truth(it) - true_mean)).abs();
                let largest = (0..N_CAMERAS).map(error).fold(0.0, f64::max);
                format!("{:.2} / {largest:.2}", mean(&error))
            } else {
                "–".to_owned()
            };
            println!(
                "| ±{offset_ms} ms | {name} | {recovered} | {:.1} / {:.1} | {:.2} | {:.1} |",
                1e3 * score.error_median,
                1e3 * score.error_p95,
                score.identities_per_light(),
                100.0 * score.missed_part()
            );
        }
    }
    println!();
}
