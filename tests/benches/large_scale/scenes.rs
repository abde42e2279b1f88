//! Crowded scenes: identities, ID switches, false targets, misses, errors, for each variant of the tracker.

use std::time::Instant;

use foveate::messages::{Features, Time};
use foveate_led::tracker::{Entry, IntegratorSettings, Tracker};
use foveate_testkit::lab::{Crossings, Lab, Lights, Occlusions, ROOM_M, Score, ScoreOptions, Wanderers, score};

use crate::Options;
use crate::variants::{VARIANTS, available};

/// Where lights move: the room without its rim [m].
pub const MIDDLE_M: [[f64; 3]; 2] = [[-1.4, -2.1, 0.4], [1.4, 2.1, 1.9]];

const DURATION_S: f64 = 10.0;
const OPTIONS: ScoreOptions = ScoreOptions { settled_s: 0.5, step_s: 0.005 };

/// Six cameras at 60 Hz, a false feature in every second frame, each light hidden from a camera for a tenth of the time,
/// and from all of them for 0.1 to 0.6 s in every five; features nearer than 4 px melt into one.
pub fn hard_lab(n_cameras: usize, seed: u64) -> Lab {
    Lab {
        noise: 0.5,
        clutter: 0.5,
        hidden: 0.1,
        melt: 4.0,
        occlusions: Some(Occlusions { every_s: 5.0, last_s: [0.1, 0.6] }),
        seed,
        ..Lab::new(n_cameras)
    }
}

/// 8 wandering lights, 6 cameras.
pub fn scenes(options: &Options) {
    let scene = |seed| (hard_lab(6, seed), Wanderers::new(8, DURATION_S, MIDDLE_M, 1.2, seed));
    table("8 lights, 6 cameras at 60 Hz, 10 s", options.seeds.unwrap_or(100), scene);
}

/// 32 wandering lights, 64 cameras.
pub fn crowd(options: &Options) {
    let scene = |seed| (hard_lab(64, seed), Wanderers::new(32, DURATION_S, MIDDLE_M, 1.2, seed));
    table("32 lights, 64 cameras at 60 Hz, 10 s", options.seeds.unwrap_or(10).min(10), scene);
}

/// Four pairs that meet.
pub fn crossings(options: &Options) {
    let scene = |seed| {
        let lab = Lab { occlusions: None, ..hard_lab(6, seed) };
        (lab, Crossings::new(4, DURATION_S, MIDDLE_M, [0.03, 0.1], seed))
    };
    table("4 pairs that meet at 30 to 100 mm, 6 cameras at 60 Hz, 10 s", options.seeds.unwrap_or(100), scene);
}

/// What a tracker of `settings` makes of a scene, scored every 5 ms.
pub fn run(settings: &IntegratorSettings, lab: &Lab, frames: &[(Time, Features)], lights: &impl Lights) -> Score {
    let mut tracker = Tracker::new(settings.clone(), lab.cameras.clone(), Some(ROOM_M));
    score(frames, OPTIONS, lights, |time, features, targets| {
        let entry = tracker.observe(time, features);
        tracker.write(targets);
        entry == Entry::Applied
    })
}

fn table<L: Lights>(title: &str, n_seeds: u64, scene: impl Fn(u64) -> (Lab, L)) {
    println!("## {title}, {n_seeds} scenes: mean (worst)\n");
    let variants = available(VARIANTS);
    let mut scores: Vec<Vec<Score>> = vec![Vec::new(); variants.len()];
    let mut spent = vec![0.0; variants.len()];
    for seed in 1..=n_seeds {
        let (lab, lights) = scene(seed);
        let frames = lab.frames(DURATION_S, &lights);
        for (variant, (_, settings)) in variants.iter().enumerate() {
            let start = Instant::now();
            scores[variant].push(run(settings, &lab, &frames, &lights));
            spent[variant] += start.elapsed().as_secs_f64();
        }
    }
    println!(
        "| variant | identities a target | id_switches | reinitialisations | false at a time | missed % | initiation ms | OSPA mm | GOSPA mm | error median / p95 mm | NEES (3) | s a scene |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|");
    for ((name, _), (scores, spent)) in variants.iter().zip(scores.iter().zip(spent)) {
        let figure = |of: &dyn Fn(&Score) -> f64| -> [f64; 2] {
            let all: Vec<f64> = scores.iter().map(of).collect();
            [all.iter().sum::<f64>() / all.len() as f64, all.iter().copied().fold(f64::MIN, f64::max)]
        };
        let shown = |of: &dyn Fn(&Score) -> f64, decimals: usize| {
            let [mean, worst] = figure(of);
            format!("{mean:.decimals$} ({worst:.decimals$})")
        };
        println!(
            "| {name} | {} | {} | {} | {} | {} | {} | {} | {} | {:.1} / {:.1} | {:.1} | {:.2} |",
            shown(&Score::identities_per_light, 3),
            shown(&|it| it.id_switches as f64, 2),
            shown(&|it| it.reinitialisations as f64, 2),
            shown(&Score::false_targets, 3),
            shown(&|it| 100.0 * it.missed_part(), 2),
            shown(&|it| 1e3 * it.time_to_initiation(), 0),
            shown(&|it| 1e3 * it.ospa, 1),
            shown(&|it| 1e3 * it.gospa, 1),
            figure(&|it| 1e3 * it.error_median)[0],
            figure(&|it| 1e3 * it.error_p95)[0],
            figure(&|it| it.consistency)[0],
            spent / n_seeds as f64,
        );
    }
    println!();
}
