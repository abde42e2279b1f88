//! Three cameras, one of whose clocks is 4 ms ahead: how often each of them has a say under each rule for late frames
//! [Davis 2002 §3.5, Figure 35].

use foveate_led::tracker::{Entry, Tracker};
use foveate_testkit::lab::{Conditions, Lab, ROOM_M, ScoreOptions, person, score};

use crate::Options;
use crate::chart::save;
use crate::overload::timeline;
use crate::variants::settings;

const OPTIONS: &[(&str, &str)] = &[
    ("discard what is older", "late = \"discard\""),
    ("discard what is older (no tolerance)", "late_tolerance_ms = 0.0"),
    ("apply up to 10 ms late", "late_tolerance_ms = 10.0"),
    ("out_of_sequence", "late = \"out_of_sequence\""),
    ("correct the clocks", "late = \"out_of_sequence\"\nclocks = \"correct\""),
];

const DURATION_S: f64 = 10.0;

/// Measures and draws.
pub fn starvation(options: &Options) {
    println!("## Updates of three cameras at 60 Hz in 10 s, the clock of A 4 ms ahead [Davis 2002, Figure 35]\n");
    let ahead = Conditions { clock_ahead_s: 4e-3, ..Conditions::default() };
    // Three cameras see little together: no light hides, and two confirm.
    let lab = Lab { conditions: vec![ahead], synchronous: true, ..Lab::new(3) };
    let frames = lab.frames(DURATION_S, &person);
    println!("| rule | A | B | C | missed % | error median mm |");
    println!("|---|---|---|---|---|---|");
    let mut charts = Vec::new();
    for (name, text) in OPTIONS {
        let Ok(rule) = settings(&format!("initiation_cameras = 2\n{text}")) else {
            println!("| {name} | not available | | | | |");
            continue;
        };
        let mut tracker = Tracker::new(rule, lab.cameras.clone(), Some(ROOM_M));
        let mut updates = [Vec::new(), Vec::new(), Vec::new()];
        let score = score(&frames, ScoreOptions { settled_s: 1.0, step_s: 0.0 }, &person, |time, features, targets| {
            let entry = tracker.observe(time, features);
            if entry == Entry::Applied {
                updates[usize::from(features.camera.0)].push(time.as_s());
            }
            tracker.write(targets);
            entry == Entry::Applied
        });
        let counts = updates.each_ref().map(Vec::len);
        println!(
            "| {name} | {} | {} | {} | {:.1} | {} |",
            counts[0],
            counts[1],
            counts[2],
            100.0 * score.missed_part(),
            if score.error_median.is_nan() { "–".to_owned() } else { format!("{:.2}", 1e3 * score.error_median) }
        );
        let title = format!("{name}: {}, {}, {}", counts[0], counts[1], counts[2]);
        charts.push(timeline(&title, &updates));
    }
    println!();
    save(options.out.as_deref(), "starvation_fig35", "Updates of each camera (Figure 35)", 2, charts);
}
