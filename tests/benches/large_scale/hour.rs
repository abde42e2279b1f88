//! One hour at full rate: does memory stay flat, do identities leak.

use std::time::Instant;

use foveate::messages::Targets;
use foveate::plot::{Axis, COLOURS, Chart, Series};
use foveate_led::tracker::{Entry, IntegratorSettings, Tracker};
use foveate_testkit::allocation::held_bytes;
use foveate_testkit::lab::{Lab, Lights, Occlusions, ROOM_M, ScoreOptions, Scorer, Wanderers};

use crate::Options;
use crate::chart::save;
use crate::scenes::MIDDLE_M;

const DURATION_S: f64 = 3600.0;
const N_LIGHTS: usize = 8;

/// Measures and draws.
pub fn hour(options: &Options) {
    println!("## One hour: 18 cameras at 60 Hz, 8 lights, clutter, one occlusion a light in 10 s\n");
    let lab = Lab {
        noise: 0.5,
        clutter: 0.5,
        hidden: 0.1,
        occlusions: Some(Occlusions { every_s: 10.0, last_s: [0.1, 0.6] }),
        ..Lab::new(18)
    };
    let lights = Wanderers::new(N_LIGHTS, DURATION_S, MIDDLE_M, 1.2, 1);
    let stream = lab.stream(DURATION_S, &lights);
    let mut scorer = Scorer::new(N_LIGHTS, ScoreOptions { settled_s: 1.0, step_s: 0.5 });
    let before = held_bytes();
    let mut tracker = Tracker::new(IntegratorSettings::default(), lab.cameras.clone(), Some(ROOM_M));
    let (mut targets, mut here) = (Targets::default(), Vec::new());
    let (mut held, mut resident, mut initiations) = (Vec::new(), Vec::new(), Vec::new());
    let (mut n_frames, mut n_features, mut next_s) = (0_u64, 0_u64, 0.0);
    // Memory of the tracker alone: what is allocated while it works.
    let mut of_tracker = held_bytes() - before;
    let (start, mut tracking_s) = (Instant::now(), 0.0);
    for frame in stream {
        let (began, bytes) = (Instant::now(), held_bytes());
        let entry = tracker.observe(frame.stated, &frame.features);
        tracker.write(&mut targets);
        of_tracker += held_bytes() - bytes;
        tracking_s += began.elapsed().as_secs_f64();
        n_frames += 1;
        n_features += frame.features.list.len() as u64;
        let now_s = frame.captured.as_s();
        if entry == Entry::Applied && scorer.is_due(targets.time) {
            lights.at(targets.time.as_s(), &mut here);
            scorer.compare(&targets, here.iter().map(|it| it.position));
        }
        if now_s >= next_s {
            let minute = now_s / 60.0;
            held.push([minute, of_tracker as f64 / 1e3]);
            resident.extend(resident_mb().map(|it| [minute, it]));
            initiations.push([minute, tracker.tally().initiations as f64]);
            next_s += 10.0;
        }
    }
    let score = scorer.finish();
    let at = |series: &[[f64; 2]], minute: f64| {
        series.iter().find(|it| it[0] >= minute).or(series.last()).map_or(f64::NAN, |it| it[1])
    };
    println!("| figure | value |\n|---|---|");
    println!("| frames, features | {n_frames}, {n_features} |");
    println!("| wall time, all / tracker alone | {:.0} s / {tracking_s:.1} s |", start.elapsed().as_secs_f64());
    println!(
        "| resident memory after 1 / 10 / 60 min | {:.1} / {:.1} / {:.1} MB |",
        at(&resident, 1.0),
        at(&resident, 10.0),
        at(&resident, 60.0)
    );
    println!(
        "| held by the tracker after 1 / 10 / 60 min | {:.1} / {:.1} / {:.1} kB |",
        at(&held, 1.0),
        at(&held, 10.0),
        at(&held, 60.0)
    );
    println!("| initiations, targets alive at the end | {}, {} |", tracker.tally().initiations, tracker.n_targets());
    println!(
        "| identities a light, id_switches, reinitialisations | {:.1}, {}, {} |",
        score.identities_per_light(),
        score.id_switches,
        score.reinitialisations
    );
    println!("| occlusions | {} |", N_LIGHTS as f64 * DURATION_S / 10.0);
    println!(
        "| false at a time, missed, error median | {:.3}, {:.2} %, {:.1} mm |\n",
        score.false_targets(),
        100.0 * score.missed_part(),
        1e3 * score.error_median
    );
    let chart = |title: &str, y: &str, colour, points| {
        let (x, y) = (Axis::new("time [min]"), Axis::new(y));
        Chart::new(title, [640.0, 150.0], x, y).with(Series::line("", colour, points))
    };
    let charts = vec![
        chart("resident memory of the process", "[MB]", COLOURS[0], resident),
        chart("held by the tracker", "[kB]", COLOURS[1], held),
        chart("initiations", "targets [–]", COLOURS[2], initiations),
    ];
    save(options.out.as_deref(), "hour", "One hour", 1, charts);
}

/// What of this process lies in memory, where the system tells.
fn resident_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|it| it.strip_prefix("VmRSS:"))?;
    line.split_whitespace().next()?.parse::<f64>().ok().map(|kb| kb / 1e3)
}
