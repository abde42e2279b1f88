//! Data faster than a node can take it [Davis 2002 §3.5]: what each camera gets under each policy, on the logical clock and
//! live; loss that adds up; ages that tell.

use std::fmt::Write;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use foveate_engine::{self as engine, Options, Outcome};
use foveate_node::{Registry, Time};
use foveate_rig::{self as rig, Overrides};
use foveate_testkit::nodes::{Collected, collected};

/// A rig out of node tables, run on the logical clock.
#[track_caller]
fn play(nodes: &str, seed: u64, shelf: &str) -> (Outcome, Vec<Collected>) {
    let mut registry = Registry::new();
    foveate_testkit::register(&mut registry);
    let text = format!("[rig]\nname = \"test\"\nseed = {seed}\n[scale.room]\n{nodes}");
    let graph = match rig::load(&text, Path::new("test.toml"), &registry, &Overrides::default()) {
        Ok(graph) => Arc::new(graph),
        Err(faults) => panic!("{}", faults.render(false)),
    };
    let outcome = engine::deterministic(graph, &Options::default(), &mut |_| {}).unwrap();
    (outcome, collected(shelf))
}

/// Cameras at 60 Hz, 10 s, everything 10 ms on its way. A's clock is 4 ms ahead [Davis 2002, Fig. 35]: what it sees at 2 ms it
/// stamps 6 ms. D is slow, 10 Hz.
fn cameras(with_slow: bool) -> String {
    let mut text = String::new();
    let all = [
        ("a", 6.0, 6.0, 60.0, 600),
        ("b", 3.0, 10.0, 60.0, 600),
        ("c", 4.0, 10.0, 60.0, 600),
        ("d", 5.0, 10.0, 10.0, 100),
    ];
    for (name, phase_ms, latency_ms, rate_hz, count) in &all[..if with_slow { 4 } else { 3 }] {
        let _ = writeln!(
            text,
            "[scale.room.node.{name}]\ntype = \"testkit.counter\"\ncount = {count}\nrate_hz = {rate_hz}\n\
             phase_ms = {phase_ms}\nlatency_ms = {latency_ms}"
        );
    }
    text
}

/// The cameras into one integrator that needs `cost_ms` for each update.
fn tracked(with_slow: bool, take: &str, cost_ms: f64) -> (Outcome, Vec<Collected>) {
    // Tests run side by side and some of them ask for the same: each run has a shelf of its own.
    static RUNS: AtomicUsize = AtomicUsize::new(0);
    let shelf = format!("run {}", RUNS.fetch_add(1, Ordering::Relaxed));
    let from = if with_slow {
        "\"a.numbers\", \"b.numbers\", \"c.numbers\", \"d.numbers\""
    } else {
        "\"a.numbers\", \"b.numbers\", \"c.numbers\""
    };
    let rig = format!(
        "{}[scale.room.node.t]\ntype = \"testkit.collect\"\ninto = \"{shelf}\"\ncost_ms = {cost_ms}\n\
         in.numbers = {{ from = [{from}], capacity = 8, policy = \"{take}\" }}\n",
        cameras(with_slow)
    );
    let (outcome, found) = play(&rig, 1, &shelf);
    for (edge, sent) in outcome.ledgers.iter().zip([600, 600, 600, 100]) {
        assert_eq!(edge.delivered + edge.dropped, sent, "{take}: all that was sent is accounted for");
        assert_eq!(edge.gaps, 0, "{take}: what was dropped is no gap");
    }
    assert_eq!(found.len() as u64, outcome.ledgers.iter().map(|it| it.delivered).sum::<u64>(), "{take}");
    (outcome, found)
}

fn updates(found: &[Collected]) -> Vec<usize> {
    let n_cameras = found.iter().map(|it| it.stamp.source.0 as usize + 1).max().unwrap_or(0);
    (0..n_cameras).map(|camera| found.iter().filter(|it| it.stamp.source.0 as usize == camera).count()).collect()
}

/// What is left when observations older than the newest one so far are thrown away.
fn strict(found: &[Collected]) -> Vec<Collected> {
    let mut newest = Time(i64::MIN);
    let mut kept = Vec::new();
    for it in found {
        if it.stamp.time >= newest {
            newest = it.stamp.time;
            kept.push(*it);
        }
    }
    kept
}

/// Greatest age at the moment of the update, by camera [ms].
fn oldest_ms(outcome: &Outcome) -> Vec<f64> {
    outcome.ledgers.iter().map(|it| it.age_max_s().unwrap_or(f64::NAN) * 1e3).collect()
}

#[test]
fn throwing_away_all_that_is_older_leaves_the_camera_whose_clock_is_ahead() {
    let (_, found) = tracked(false, "each", 0.0);
    assert_eq!(updates(&found), [600, 600, 600]);
    assert_eq!(updates(&strict(&found)), [600]);
}

#[test]
fn under_load_the_newest_starves_and_the_newest_of_each_does_not() {
    let mut table = String::from(
        "Updates that each camera gives in 10 s, and the greatest age at an update, when the integrator needs 20 ms for each.\n\
         A, B, C: 60 Hz, A's clock 4 ms ahead [Davis 2002, Fig. 35]; D: 10 Hz.\n\n",
    );
    let _ = writeln!(
        table,
        "{:16} {:>6} {:>6} {:>6} {:>6} {:>9} {:>9} {:>9} {:>9}",
        "policy", "A", "B", "C", "D", "A ms", "B ms", "C ms", "D ms"
    );
    let mut row = |take: &str| {
        let (outcome, found) = tracked(true, take, 20.0);
        let (counts, ages) = (updates(&found), oldest_ms(&outcome));
        let count = |camera: usize| counts.get(camera).copied().unwrap_or_default();
        let _ = write!(table, "{take:16}");
        for camera in 0..4 {
            let _ = write!(table, " {:>6}", count(camera));
        }
        for age in &ages {
            let _ = write!(table, " {:>9}", if age.is_nan() { "–".to_owned() } else { format!("{age:.1}") });
        }
        table.push('\n');
        ([0, 1, 2, 3].map(count), ages)
    };
    let (each, each_ages) = row("each");
    let (newest, _) = row("newest");
    let (in_turn, in_turn_ages) = row("round_robin");
    let (random, random_ages) = row("newest_of_each");
    foveate_testkit::golden::check("tests/golden/overload.txt", &table);
    assert!(
        each[1] * 10 < each[0],
        "a line that drops its oldest serves whoever comes right before it is free: {each:?}"
    );
    assert!(each_ages[0] > 300.0, "what waits in line grows old: {each_ages:?} ms");
    assert_eq!(newest[1..3], [0, 0], "the camera whose clock is ahead takes it all: {newest:?}");
    assert!(in_turn[..3].iter().all(|&it| it.abs_diff(in_turn[0]) <= 1), "{in_turn:?}");
    assert!(in_turn_ages[3] > 60.0, "what a slow camera saw waits for its turn: {in_turn_ages:?} ms");
    assert!(random[..3].iter().all(|&it| (110..200).contains(&it)), "{random:?}");
    assert!(random[3] > 15, "the slow camera is served too: {random:?}");
    // 10 ms on the way (6 by the clock of A) and no more than one turn of the integrator.
    assert!(random_ages.iter().all(|&it| it <= 30.5), "{random_ages:?} ms");
}

#[test]
fn turn_that_costs_time_delays_what_it_gives_and_what_comes_meanwhile() {
    let rig = |rate_hz: f64, cost: &str, queue: &str, shelf: &str| {
        format!(
            "[scale.room.node.a]\ntype = \"testkit.counter\"\ncount = 20\nrate_hz = {rate_hz}\n\
             [scale.room.node.b]\ntype = \"testkit.relay\"\n{cost}\nin.numbers = {{ from = \"a.numbers\"{queue} }}\n\
             [scale.room.node.c]\ntype = \"testkit.collect\"\ninto = \"{shelf}\"\nin = {{ numbers = \"b.numbers\" }}\n"
        )
    };
    let (outcome, found) = play(&rig(100.0, "cost_ms = 3", "", "cost free"), 1, "cost free");
    let expected: Vec<i64> = (0..20).map(|it| it * 10_000_000 + 3_000_000).collect();
    assert_eq!(found.iter().map(|it| it.now.0).collect::<Vec<_>>(), expected);
    assert_eq!(outcome.ledgers[0].age_max_s(), Some(0.0));
    assert_eq!(outcome.ledgers[1].age_max_s(), Some(0.003));
    assert_eq!(outcome.ended, Time(193_000_000), "the run lasts until the last turn is done");

    // 20 numbers in 19 ms, 3 ms for each of them, two of which may wait.
    for (policy, numbers) in [
        ("drop_oldest", vec![0, 1, 4, 7, 10, 13, 16, 18, 19]),
        ("drop_newest", vec![0, 1, 2, 3, 6, 9, 12, 15, 18]),
        ("wait", (0..20).collect()),
    ] {
        let shelf = format!("cost {policy}");
        let queue = format!(", capacity = 2, when_full = \"{policy}\"");
        let (outcome, found) = play(&rig(1000.0, "cost_ms = 3", &queue, &shelf), 1, &shelf);
        let edge = &outcome.ledgers[0];
        assert_eq!(edge.delivered + edge.dropped, 20, "{policy}");
        assert_eq!((edge.gaps, edge.late), (0, 0), "{policy}");
        assert_eq!(found.iter().map(|it| it.number).collect::<Vec<_>>(), numbers, "{policy}");
        let each_3_ms = found.iter().zip(1..).all(|(it, turn)| it.now == Time(turn * 3_000_000));
        assert!(each_3_ms, "{policy}: the node is never idle: {found:?}");
    }
}

#[test]
fn cost_that_varies_is_seeded() {
    let rig = "[scale.room.node.a]\ntype = \"testkit.counter\"\ncount = 50\nrate_hz = 100\n\
               [scale.room.node.b]\ntype = \"testkit.relay\"\ncost_ms = 3\ncost_jitter_ms = 2\nin.numbers = \"a.numbers\"\n\
               [scale.room.node.c]\ntype = \"testkit.collect\"\ninto = \"jitter\"\nin.numbers = \"b.numbers\"\n";
    let (first, found) = play(rig, 1, "jitter");
    let (second, found_again) = play(rig, 1, "jitter");
    assert_eq!((&found, &first.ledgers), (&found_again, &second.ledgers));
    let (_, with_another_seed) = play(rig, 2, "jitter");
    assert_ne!(found, with_another_seed);
    let cost = |it: &Collected| (it.now - it.stamp.time).as_ms();
    assert!(found.iter().all(|it| (1.0..=5.0).contains(&cost(it))));
    assert!(found.iter().any(|it| cost(it) < 2.0) && found.iter().any(|it| cost(it) > 4.0));
}

#[test]
fn failing_node_that_is_busy_loses_what_waits_and_says_so() {
    let rig = "[scale.room.node.a]\ntype = \"testkit.counter\"\ncount = 20\nrate_hz = 1000\n\
               [scale.room.node.b]\ntype = \"testkit.fail\"\nat = 3\ncost_ms = 3\nin.numbers = \"a.numbers\"\n\
               [scale.room.node.c]\ntype = \"testkit.collect\"\ninto = \"busy fails\"\nin.numbers = \"b.numbers\"\n";
    let (outcome, found) = play(rig, 1, "busy fails");
    assert_eq!(found.iter().map(|it| it.number).collect::<Vec<_>>(), [0, 1, 2]);
    let edge = &outcome.ledgers[0];
    assert_eq!((edge.delivered, edge.dropped), (4, 16));
}

#[test]
fn messages_that_are_dropped_are_spoken_of() {
    let about_drops = |take: &str, cost_ms: f64| -> Vec<String> {
        let (outcome, _) = tracked(false, take, cost_ms);
        outcome.report.remarks.into_iter().filter(|it| it.contains("were dropped")).collect()
    };
    let told = about_drops("newest", 15.0);
    assert!(told.len() == 1 && told[0].contains("worst: "), "{told:?}");
    assert!(about_drops("each", 0.0).is_empty());
}
