//! Both engines over small graphs whose right answer is known: order, loss that adds up, faults, the end of a run.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use foveate_engine::{self as engine, Options, Outcome};
use foveate_node::error::Blame;
use foveate_node::{Registry, Time};
use foveate_rig::graph::Graph;
use foveate_rig::{self as rig, Overrides};
use foveate_testkit::nodes::{Collected, collected};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Engine {
    Deterministic,
    Live,
}

const BOTH: [Engine; 2] = [Engine::Deterministic, Engine::Live];

/// A rig out of node tables.
fn graph(nodes: &str) -> Arc<Graph> {
    load(&format!("[rig]\nname = \"test\"\n[scale.room]\n{nodes}"), Path::new("test.toml"))
}

/// A rig out of node tables, with cameras `ring-1` … `ring-4`.
fn graph_with_cameras(nodes: &str) -> Arc<Graph> {
    graph_with_ring(4, nodes)
}

fn graph_with_ring(n: usize, nodes: &str) -> Arc<Graph> {
    let folder = tempfile::tempdir().unwrap();
    let calibration = foveate_testkit::scene::ring_calibration(n);
    std::fs::write(folder.path().join("cameras.toml"), calibration.to_toml()).unwrap();
    let text = format!("[rig]\nname = \"test\"\ncalibration = \"cameras.toml\"\n[scale.room]\n{nodes}");
    load(&text, &folder.path().join("test.toml"))
}

fn load(text: &str, path: &Path) -> Arc<Graph> {
    let mut registry = Registry::new();
    foveate_testkit::register(&mut registry);
    match rig::load(text, path, &registry, &Overrides::default()) {
        Ok(graph) => Arc::new(graph),
        Err(faults) => panic!("{}", faults.render(false)),
    }
}

/// Runs a rig that collects into `shelf`.
#[track_caller]
fn play(engine: Engine, nodes: &str, shelf: &str) -> (Outcome, Vec<Collected>) {
    let options = Options { workers: Some(3), ..Options::default() };
    let engine = if engine == Engine::Live { engine::live } else { engine::deterministic };
    let outcome = engine(graph(nodes), &options, &mut |_| {}).unwrap();
    (outcome, collected(shelf))
}

fn numbers(collected: &[Collected]) -> Vec<i64> {
    collected.iter().map(|it| it.number).collect()
}

/// counter → `middle` (a table body with its type) → collect.
fn chain(counter: &str, middle: &str, shelf: &str) -> String {
    format!(
        "[scale.room.node.a]\ntype = \"testkit.counter\"\n{counter}\n\
         [scale.room.node.b]\n{middle}\nin = {{ numbers = \"a.numbers\" }}\n\
         [scale.room.node.c]\ntype = \"testkit.collect\"\ninto = \"{shelf}\"\nin.numbers = {{ from = \"b.numbers\", capacity = 100000 }}\n"
    )
}

#[test]
fn a_sink_without_data_is_a_failure_of_the_first_node_that_gave_nothing_unless_the_run_was_cut_short() {
    for engine in BOTH {
        // Where the failure is, and whether it names the sink.
        let failure = |counter: &str, is_cut_short: bool| {
            let rig = chain(counter, "type = \"testkit.relay\"", &format!("nothing {engine:?}"));
            let options = Options { workers: Some(3), is_cut_short, ..Options::default() };
            let run = if engine == Engine::Live { engine::live } else { engine::deterministic };
            let outcome = run(graph(&rig), &options, &mut |_| {}).unwrap();
            assert!(outcome.faults.len() <= 1 && outcome.blame() != Some(Blame::Program), "{:?}", outcome.faults);
            outcome.faults.first().map(|it| (it.instance.clone(), it.message.contains("`room.c`")))
        };
        let at_source = |names_sink: bool| Some(("room.a".to_owned(), names_sink));
        assert_eq!(failure("count = 2", false), None);
        assert_eq!(failure("count = 2\ngap_at = 0", false), None);
        assert_eq!(failure("count = 0", false), at_source(true));
        assert_eq!(failure("count = 0", true), None);
        // All that a source had was refused: however short the run.
        assert_eq!(failure("count = 1\ngap_at = 0", false), at_source(true));
        assert_eq!(failure("count = 1\ngap_at = 0", true), at_source(false));
    }
}

#[test]
fn chain_delivers_everything_in_order() {
    for engine in BOTH {
        let shelf = format!("chain {engine:?}");
        let rig = chain("count = 50\nrate_hz = 1000", "type = \"testkit.relay\"", &shelf);
        let (outcome, found) = play(engine, &rig, &shelf);
        assert_eq!(numbers(&found), (0..50).collect::<Vec<_>>());
        assert_eq!(outcome.blame(), None);
        assert!(outcome.ledgers.iter().all(|it| it.delivered == 50 && it.gaps + it.dropped + it.late == 0));
    }
}

#[test]
fn logical_clock_is_the_delivery_time() {
    let shelf = "clock";
    let rig = chain("count = 3\nrate_hz = 100\nlatency_ms = 7", "type = \"testkit.relay\"", shelf);
    let (outcome, found) = play(Engine::Deterministic, &rig, shelf);
    assert_eq!(found.iter().map(|it| it.now.0).collect::<Vec<_>>(), [7_000_000, 17_000_000, 27_000_000]);
    assert!(outcome.ledgers.iter().all(|it| (it.age_s(1.0).unwrap() - 0.007).abs() < 3e-4));
}

#[test]
fn sources_are_merged_by_due_time_and_then_by_the_order_of_the_rig() {
    let counter = |name: &str, phase: f64| {
        format!("[scale.room.node.{name}]\ntype = \"testkit.counter\"\ncount = 3\nrate_hz = 100\nphase_ms = {phase}\n")
    };
    let rig = [counter("x", 3.0), counter("y", 0.0), counter("z", 3.0)].concat()
        + "[scale.room.node.c]\ntype = \"testkit.collect\"\ninto = \"merge\"\n\
           in = { numbers = [\"x.numbers\", \"y.numbers\", \"z.numbers\"] }\n";
    let (_, found) = play(Engine::Deterministic, &rig, "merge");
    let order: Vec<_> = found.iter().map(|it| (it.now.0 / 1_000_000, it.stamp.source.0)).collect();
    let mut sorted = order.clone();
    sorted.sort_unstable();
    assert_eq!(order, sorted);
    assert_eq!(order.len(), 9);
}

#[test]
fn declared_gap_is_counted_on_the_edge_and_told() {
    let rig = chain("count = 5\ngap_at = 2", "type = \"testkit.relay\"", "gap");
    let (outcome, found) = play(Engine::Deterministic, &rig, "gap");
    assert_eq!(numbers(&found), [0, 1, 3, 4]);
    assert_eq!(outcome.ledgers.iter().map(|it| it.gaps).collect::<Vec<_>>(), [1, 1]);
    assert_eq!(outcome.gaps.len(), 1);
    assert_eq!(outcome.gaps[0].time, Time(20_000_000));
}

#[test]
fn node_that_fails_stops_its_own_chain_only() {
    for engine in BOTH {
        let shelf = format!("stop {engine:?}");
        let rig = chain("count = 6\nrate_hz = 1000", "type = \"testkit.fail\"\nat = 3", &shelf)
            + &format!(
                "[scale.room.node.d]\ntype = \"testkit.collect\"\ninto = \"{shelf} beside\"\nin = {{ numbers = \"a.numbers\" }}\n"
            );
        let (outcome, found) = play(engine, &rig, &shelf);
        assert_eq!(numbers(&found), [0, 1, 2]);
        assert_eq!(numbers(&collected(&format!("{shelf} beside"))), [0, 1, 2, 3, 4, 5]);
        assert_eq!(outcome.blame(), Some(Blame::Input));
        assert_eq!(outcome.faults.len(), 1);
        let fault = &outcome.faults[0];
        assert_eq!((fault.instance.as_str(), fault.action), ("room.b", "stopped"));
        assert!(fault.message.contains("found 3"));
        let into_b = outcome.ledgers.iter().find(|it| it.dropped > 0).unwrap();
        assert_eq!((into_b.delivered, into_b.dropped), (4, 2), "sent = delivered + dropped");
    }
}

#[test]
fn failure_is_reported_with_the_capture_time_of_its_message() {
    for kind in ["fail", "panic"] {
        let shelf = format!("capture time {kind}");
        let middle = format!("type = \"testkit.{kind}\"\nat = 3");
        let rig = chain("count = 6\nrate_hz = 100\nlatency_ms = 7", &middle, &shelf);
        let (outcome, _) = play(Engine::Deterministic, &rig, &shelf);
        assert_eq!(outcome.faults[0].time, Time(30_000_000), "{kind}: delivered at 37 ms, captured at 30 ms");
    }
}

#[test]
fn policy_decides_what_becomes_of_a_failure() {
    for (kind, policy, expected, action) in [
        ("fail", "skip", vec![0, 1, 2, 4, 5], "message skipped"),
        ("fail", "restart", vec![0, 1, 2, 4, 5], "restarted"),
        ("panic", "skip", vec![0, 1, 2, 4, 5], "restarted"),
        ("panic", "restart", vec![0, 1, 2, 4, 5], "restarted"),
        ("panic", "stop", vec![0, 1, 2], "stopped"),
    ] {
        let shelf = format!("policy {kind} {policy}");
        let middle = format!("type = \"testkit.{kind}\"\nat = 3\non_error = \"{policy}\"");
        let (outcome, found) = play(Engine::Deterministic, &chain("count = 6", &middle, &shelf), &shelf);
        assert_eq!(numbers(&found), expected, "{shelf}");
        assert_eq!(outcome.faults[0].action, action, "{shelf}");
        let blame = if kind == "panic" { Blame::Program } else { Blame::Input };
        assert_eq!(outcome.blame(), Some(blame), "{shelf}");
    }
}

#[test]
fn feedback_edge_carries_the_message_of_the_activation_before() {
    let rig = "[scale.room.node.a]\ntype = \"testkit.counter\"\ncount = 5\n\
               [scale.room.node.b]\ntype = \"testkit.relay\"\nin = { numbers = \"a.numbers\", feedback = \"b.numbers\" }\n\
               [scale.room.node.c]\ntype = \"testkit.collect\"\ninto = \"feedback\"\nin = { numbers = \"b.numbers\" }\n";
    let graph = graph(rig);
    assert_eq!(graph.edges.iter().filter(|it| it.feedback).count(), 1);
    let (_, found) = play(Engine::Deterministic, rig, "feedback");
    // The relay adds what came back to what comes in: a running sum.
    assert_eq!(numbers(&found), [0, 1, 3, 6, 10]);
}

#[test]
fn slow_consumer_on_another_thread_loses_by_policy_and_the_books_balance() {
    for (policy, loses) in [("drop_oldest", true), ("drop_newest", true), ("wait", false)] {
        let shelf = format!("slow {policy}");
        // A node of a camera and a node of none run on different threads.
        let rig = format!(
            "[scale.room.node.a]\ntype = \"testkit.counter\"\ncamera = \"ring-1\"\ncount = 100\nrate_hz = 5000\n\
             [scale.room.node.b]\ntype = \"testkit.slow\"\nbusy_ms = 2\n\
             in.numbers = {{ from = \"a.numbers\", capacity = 2, when_full = \"{policy}\" }}\n\
             [scale.room.node.c]\ntype = \"testkit.collect\"\ninto = \"{shelf}\"\nin = {{ numbers = \"b.numbers\" }}\n"
        );
        let options = Options { workers: Some(2), ..Options::default() };
        let outcome = engine::live(graph_with_cameras(&rig), &options, &mut |_| {}).unwrap();
        let edge = &outcome.ledgers[0];
        let found = numbers(&collected(&shelf));
        assert_eq!(edge.delivered + edge.dropped, 100, "{policy}: all that was sent is accounted for");
        assert_eq!(found.len() as u64, edge.delivered, "{policy}");
        assert_eq!(edge.dropped > 0, loses, "{policy}: {} dropped", edge.dropped);
        assert!(found.is_sorted(), "{policy}");
        // What is dropped as the newest is not always the last one: by then there may be room.
        assert!(policy == "drop_newest" || found.last() == Some(&99), "{policy}: the newest is kept");
    }
}

#[test]
fn stop_from_outside_ends_a_live_run_and_keeps_what_was_recovered() {
    let rig = chain("count = 1000000\nrate_hz = 500", "type = \"testkit.relay\"", "stopped");
    let options = Options::default();
    let stop = Arc::clone(&options.stop);
    std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(150));
        stop.store(true, Ordering::Relaxed);
    });
    let outcome = engine::live(graph(&rig), &options, &mut |_| {}).unwrap();
    let found = collected("stopped");
    assert!(outcome.interrupted);
    assert_eq!(numbers(&found), (0..found.len() as i64).collect::<Vec<_>>());
    assert_eq!(outcome.report.figures["collected"], found.len() as f64);
    assert!(found.len() > 5, "{} numbers in 150 ms at 500 Hz", found.len());
}

#[test]
fn requirement_that_is_not_met_is_reported_with_both_numbers() {
    let rig = chain("count = 50\nrate_hz = 100\nlatency_ms = 30", "type = \"testkit.relay\"", "require")
        + "require.numbers = { loss = 0.5, must = true }\n";
    let (outcome, _) = play(Engine::Deterministic, &rig, "require");
    assert_eq!(outcome.unmet, []);
    let rig = chain("count = 50\nrate_hz = 100\ngap_at = 5", "type = \"testkit.relay\"", "require")
        + "require.numbers = { loss = 0.01, must = true }\n";
    let (outcome, _) = play(Engine::Deterministic, &rig, "require");
    assert_eq!(outcome.unmet.len(), 1);
    assert!(outcome.unmet[0].must && outcome.unmet[0].what.contains("2.00 %"), "{:?}", outcome.unmet);
}

#[test]
fn cameras_on_any_number_of_threads_give_the_same() {
    let rig = |shelf: &str| {
        format!(
            "[scale.room.node.a]\ntype = \"testkit.counter\"\neach = \"ring-*\"\ncount = 60\nrate_hz = 100\ngap_at = 7\n\
             [scale.room.node.free]\ntype = \"testkit.counter\"\ncamera = \"ring-2\"\ncount = 90\nrate_hz = 77\n\
             [scale.room.node.b]\ntype = \"testkit.relay\"\neach = \"ring-*\"\nin = {{ numbers = \"a.numbers\", feedback = \"n.numbers\" }}\n\
             [scale.room.node.slow]\ntype = \"testkit.slow\"\neach = \"ring-*\"\nbusy_ms = 0.2\nin = {{ numbers = \"b.numbers\" }}\n\
             [scale.room.node.harm]\ntype = \"testkit.panic\"\neach = \"ring-*\"\non_error = \"skip\"\nin = {{ numbers = \"slow.numbers\" }}\n\
             [scale.room.node.n]\ntype = \"testkit.newest\"\nin = {{ numbers = [\"harm.numbers\", \"free.numbers\"] }}\n\
             [scale.room.node.c]\ntype = \"testkit.collect\"\ninto = \"{shelf}\"\nin = {{ numbers = \"n.numbers\" }}\n"
        )
    };
    let run = |workers: usize| {
        let shelf = format!("threads {workers}");
        let options = Options { workers: Some(workers), ..Options::default() };
        let outcome = engine::deterministic(graph_with_cameras(&rig(&shelf)), &options, &mut |_| {}).unwrap();
        (collected(&shelf), outcome.ledgers, outcome.faults, outcome.gaps, outcome.report.figures)
    };
    let one = run(1);
    assert!(one.0.len() > 300, "{}", one.0.len());
    assert_eq!((one.2.len(), one.3.len()), (4, 4));
    for workers in [2, 3, 8] {
        let other = run(workers);
        assert_eq!(one.0, other.0, "{workers} threads");
        assert_eq!((&one.1, &one.2, &one.3, &one.4), (&other.1, &other.2, &other.3, &other.4), "{workers} threads");
    }
}

#[test]
fn cameras_that_are_ahead_and_others_mix_on_any_number_of_threads() {
    let rig = |shelf: &str| {
        let lanes = |name: &str, cameras: &str, tells_rate: bool, rate_hz: f64, busy_ms: f64| {
            format!(
                "[scale.room.node.{name}]\ntype = \"testkit.counter\"\neach = {cameras}\ncount = 150\nrate_hz = {rate_hz}\ntells_rate = {tells_rate}\n\
                 [scale.room.node.{name}_slow]\ntype = \"testkit.slow\"\neach = {cameras}\nbusy_ms = {busy_ms}\nin = {{ numbers = \"{name}.numbers\" }}\n\
                 [scale.room.node.{name}_relay]\ntype = \"testkit.relay\"\neach = {cameras}\nin = {{ numbers = \"{name}_slow.numbers\", feedback = \"n.numbers\" }}\n"
            )
        };
        let ahead = lanes("ahead", "[\"ring-*\", \"!ring-3\", \"!ring-4\"]", true, 103.0, 0.2);
        // One of them takes longer: the thread that has it finds the other one done when it comes back.
        let long = lanes("long", "\"ring-3\"", false, 331.0, 0.9);
        let short = lanes("short", "\"ring-4\"", false, 331.0, 0.2);
        format!(
            "{ahead}{long}{short}\
             [scale.room.node.n]\ntype = \"testkit.newest\"\nin = {{ numbers = [\"ahead_relay.numbers\", \"long_relay.numbers\", \"short_relay.numbers\"] }}\n\
             [scale.room.node.c]\ntype = \"testkit.collect\"\ninto = \"{shelf}\"\nin = {{ numbers = \"n.numbers\" }}\n"
        )
    };
    let run = |workers: usize| {
        let shelf = format!("mixed {workers}");
        let options = Options { workers: Some(workers), ..Options::default() };
        let outcome = engine::deterministic(graph_with_ring(12, &rig(&shelf)), &options, &mut |_| {}).unwrap();
        (collected(&shelf), outcome.ledgers)
    };
    let one = run(1);
    assert_eq!(one.0.len(), 12 * 150);
    for workers in [2, 3, 8] {
        assert_eq!(one, run(workers), "{workers} threads");
    }
}

#[test]
fn what_comes_back_to_a_camera_is_seen_from_the_next_round_on() {
    // Two cameras at the same moments: what the first one causes is not there for the second one before the next moment.
    let text = "[scale.room.node.a]\ntype = \"testkit.counter\"\neach = [\"ring-1\", \"ring-2\"]\ncount = 4\n\
                [scale.room.node.b]\ntype = \"testkit.relay\"\neach = [\"ring-1\", \"ring-2\"]\nin = { numbers = \"a.numbers\", feedback = \"n.numbers\" }\n\
                [scale.room.node.n]\ntype = \"testkit.newest\"\nin = { numbers = \"b.numbers\" }\n\
                [scale.room.node.c]\ntype = \"testkit.collect\"\ninto = \"rounds\"\nin = { numbers = \"n.numbers\" }\n";
    engine::deterministic(graph_with_cameras(text), &Options::default(), &mut |_| {}).unwrap();
    // k + what was given last at the moment before: 0, 1, 3, 6, from both cameras.
    assert_eq!(numbers(&collected("rounds")), [0, 0, 1, 1, 3, 3, 6, 6]);
}

#[test]
fn what_a_delayed_edge_carries_is_seen_when_the_delay_is_over() {
    let given = |cameras: &str, delay_ms: &str, workers: usize| {
        let shelf = format!("delayed {cameras} {delay_ms} {workers}").replace('"', "");
        let text = format!(
            "[scale.room.node.a]\ntype = \"testkit.counter\"\n{cameras}\ncount = 7\n\
             [scale.room.node.b]\ntype = \"testkit.relay\"\n{cameras}\nin = {{ numbers = \"a.numbers\", feedback = {{ from = \"n.numbers\"{delay_ms} }} }}\n\
             [scale.room.node.n]\ntype = \"testkit.newest\"\nin = {{ numbers = \"b.numbers\" }}\n\
             [scale.room.node.c]\ntype = \"testkit.collect\"\ninto = \"{shelf}\"\nin = {{ numbers = \"n.numbers\" }}\n"
        );
        let options = Options { workers: Some(workers), ..Options::default() };
        engine::deterministic(graph_with_cameras(&text), &options, &mut |_| {}).unwrap();
        numbers(&collected(&shelf))
    };
    for workers in [1, 2] {
        // On a camera's lane, and among the nodes that no lane has.
        for cameras in ["camera = \"ring-1\"", ""] {
            // Every 10 ms k + what was given 25 ms ago or earlier: three steps before.
            assert_eq!(given(cameras, ", delay_ms = 25", workers), [0, 1, 2, 3, 5, 7, 9], "{cameras}");
            assert_eq!(given(cameras, ", delay_ms = 0", workers), [0, 1, 3, 6, 10, 15, 21], "{cameras}");
            assert_eq!(given(cameras, "", workers), [0, 1, 3, 6, 10, 15, 21], "{cameras}");
        }
    }
}

#[test]
fn paced_run_takes_its_time_and_gives_the_same() {
    let rig = |shelf: &str| graph(&chain("count = 21\nrate_hz = 100", "type = \"testkit.relay\"", shelf));
    let plain = engine::deterministic(rig("plain"), &Options::default(), &mut |_| {}).unwrap();
    let options = Options { paced: true, ..Options::default() };
    let paced = engine::deterministic(rig("paced"), &options, &mut |_| {}).unwrap();
    assert!(paced.wall >= Duration::from_millis(200), "{:?}", paced.wall);
    assert_eq!((collected("plain"), plain.ledgers), (collected("paced"), paced.ledgers));
}

#[test]
fn two_runs_of_one_rig_are_the_same() {
    let counters: String = (0..5)
        .map(|index| {
            format!(
                "[scale.room.node.s{index}]\ntype = \"testkit.counter\"\ncount = 40\nrate_hz = 50\nphase_ms = {index}\n"
            )
        })
        .collect();
    let inputs = (0..5).map(|index| format!("\"s{index}.numbers\"")).collect::<Vec<_>>().join(", ");
    let rig = format!(
        "{counters}[scale.room.node.n]\ntype = \"testkit.newest\"\nin = {{ numbers = [{inputs}] }}\n\
         [scale.room.node.c]\ntype = \"testkit.collect\"\ninto = \"same\"\nin = {{ numbers = \"n.numbers\" }}\n"
    );
    let (first, found) = play(Engine::Deterministic, &rig, "same");
    let (second, found_again) = play(Engine::Deterministic, &rig, "same");
    assert_eq!(found, found_again);
    assert_eq!(first.ledgers, second.ledgers);
    assert_eq!(found.len(), 200);
}
