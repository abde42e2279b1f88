//! Runs that are recorded and followed again: the same deliveries at the same times, whatever was lost, busy, stopped or restarted.

use std::collections::VecDeque;
use std::sync::Arc;

use foveate_engine::tap::{Entry, Event, Tap, Wanted};
use foveate_engine::{self as engine, Feed, Options, Outcome, Source};
use foveate_node::Registry;
use foveate_node::io::Packet;
use foveate_rig::graph::Graph;
use foveate_rig::{self as rig, Overrides};
use foveate_testkit::nodes::{Collected, Number, collected};

fn load(nodes: &str) -> Arc<Graph> {
    let folder = tempfile::tempdir().unwrap();
    let calibration = foveate_testkit::scene::ring_calibration(4);
    std::fs::write(folder.path().join("cameras.toml"), calibration.to_toml()).unwrap();
    let text = format!("[rig]\nname = \"test\"\ncalibration = \"cameras.toml\"\n[scale.room]\n{nodes}");
    let mut registry = Registry::new();
    foveate_testkit::register(&mut registry);
    match rig::load(&text, &folder.path().join("test.toml"), &registry, &Overrides::default()) {
        Ok(graph) => Arc::new(graph),
        Err(faults) => panic!("{}", faults.render(false)),
    }
}

/// A recording in memory. The numbers of a counter are those of its messages.
struct Listed {
    entries: VecDeque<Entry>,
    is_live: bool,
}

impl Feed for Listed {
    fn next(&mut self) -> Result<Option<Entry>, String> {
        let entry = self.entries.pop_front();
        Ok(entry.map(|mut it| {
            if let Event::Emitted { stamp, packet, .. } = &mut it.event {
                *packet = Some(Packet { stamp: *stamp, payload: Arc::new(Number(stamp.sequence as i64)) });
            }
            it
        }))
    }

    fn was_live(&self) -> bool {
        self.is_live
    }
}

/// Runs a rig that collects into `shelf`; gives also all that happened, in order.
fn record(nodes: &str, shelf: &str, is_live: bool) -> (Outcome, Vec<Collected>, Vec<Entry>) {
    let graph = load(nodes);
    let tap = Tap::new(&graph, 1 << 20, false, |_, _| Wanted::Yes);
    let options = Options { workers: Some(3), tap: Some(tap.clone()), ..Options::default() };
    let run = if is_live { engine::live } else { engine::deterministic };
    let outcome = run(graph, &options, &mut |_| {}).unwrap();
    let mut entries = VecDeque::new();
    tap.drain(&mut entries);
    let mut entries: Vec<Entry> = entries.into();
    entries.sort_by_key(|it| it.order);
    assert!(entries.iter().enumerate().all(|(n, it)| it.order == n as u64), "numbered without a gap");
    (outcome, collected(shelf), entries)
}

/// Follows a recording; counters (`a…`) speak out of it.
fn follow(nodes: &str, shelf: &str, is_live: bool, entries: &[Entry]) -> (Outcome, Vec<Collected>) {
    let graph = load(nodes);
    let source = |is_recorded: bool| if is_recorded { Source::Recording } else { Source::Node };
    let sources: Vec<Source> = graph.instances.iter().map(|it| source(it.node.starts_with('a'))).collect();
    let mut feed = Listed { entries: entries.to_vec().into(), is_live };
    let outcome = engine::replay(graph, &sources, &mut feed, &Options::default(), &mut |_| {}).unwrap();
    (outcome, collected(shelf))
}

#[track_caller]
fn same(name: &str, a: &(Outcome, Vec<Collected>), b: &(Outcome, Vec<Collected>)) {
    let seen = |it: &[Collected]| it.iter().map(|it| (it.now, it.stamp, it.number)).collect::<Vec<_>>();
    assert_eq!(seen(&a.1), seen(&b.1), "{name}");
    assert_eq!(a.0.ledgers, b.0.ledgers, "{name}");
    assert_eq!((&a.0.faults, &a.0.gaps, a.0.ended), (&b.0.faults, &b.0.gaps, b.0.ended), "{name}");
    assert_eq!((&a.0.report, &a.0.unmet), (&b.0.report, &b.0.unmet), "{name}");
}

fn counter(name: &str, body: &str) -> String {
    format!("[scale.room.node.{name}]\ntype = \"testkit.counter\"\n{body}\n")
}

fn node(name: &str, kind: &str, body: &str) -> String {
    format!("[scale.room.node.{name}]\ntype = \"testkit.{kind}\"\n{body}\n")
}

fn collect(from: &str, shelf: &str) -> String {
    node("z", "collect", &format!("into = \"{shelf}\"\nin.numbers = {{ from = {from}, capacity = 100000 }}"))
}

/// Rigs by name, without their sinks, and where these take from.
fn rigs() -> Vec<(&'static str, String, &'static str)> {
    let of_b = "\"b.numbers\"";
    let from_a = "in = { numbers = \"a.numbers\" }";
    let mut rigs = vec![
        ("chain", counter("a", "count = 60\nrate_hz = 2000") + &node("b", "relay", from_a), of_b),
        ("gap", counter("a", "count = 20\ngap_at = 7\nrate_hz = 1000") + &node("b", "relay", from_a), of_b),
        (
            "feedback",
            counter("a", "count = 40\nrate_hz = 2000")
                + &node("b", "relay", "in = { numbers = \"a.numbers\", feedback = \"b.numbers\" }"),
            of_b,
        ),
        (
            "busy",
            counter("a", "count = 60\nrate_hz = 1000")
                + &node(
                    "b",
                    "relay",
                    "cost_ms = 3\ncost_jitter_ms = 1\nin.numbers = { from = \"a.numbers\", capacity = 2 }",
                ),
            of_b,
        ),
        (
            "newest",
            counter("a", "each = \"ring-*\"\ncount = 80\nrate_hz = 1500")
                + &node("b", "newest", "cost_ms = 2\nin = { numbers = \"a.numbers\" }"),
            of_b,
        ),
        (
            "joined",
            counter("a", "each = \"ring-*\"\ncount = 40\nrate_hz = 1000\ngap_at = 5")
                + &node("b", "join", "in = { numbers = \"a.numbers\" }"),
            of_b,
        ),
    ];
    for (kind, policy) in
        [("fail", "skip"), ("fail", "restart"), ("panic", "restart"), ("panic", "stop"), ("fail", "stop")]
    {
        let name = match (kind, policy) {
            ("fail", "skip") => "fail skip",
            ("fail", "restart") => "fail restart",
            ("panic", "restart") => "panic restart",
            ("panic", _) => "panic stop",
            _ => "fail stop",
        };
        let body = format!("at = 9\non_error = \"{policy}\"\n{from_a}");
        rigs.push((name, counter("a", "count = 30\nrate_hz = 1000") + &node("b", kind, &body), of_b));
    }
    for policy in ["drop_oldest", "drop_newest", "wait"] {
        let slow =
            format!("busy_ms = 2\nin.numbers = {{ from = \"a.numbers\", capacity = 2, when_full = \"{policy}\" }}");
        let rig = counter("a", "camera = \"ring-1\"\ncount = 120\nrate_hz = 4000") + &node("b", "slow", &slow);
        rigs.push((policy, rig, of_b));
    }
    rigs
}

#[test]
fn every_run_is_followed_to_the_same_deliveries_ledgers_and_failures() {
    let (mut dropped, mut restarted) = (0, 0);
    for (name, nodes, from) in rigs() {
        for is_live in [false, true] {
            let shelf = format!("replay {name} {is_live}");
            let rig = nodes.clone() + &collect(from, &shelf);
            let (outcome, found, entries) = record(&rig, &shelf, is_live);
            dropped += outcome.ledgers.iter().map(|it| it.dropped).sum::<u64>();
            restarted += outcome.faults.iter().filter(|it| it.action == "restarted").count();
            assert!(!found.is_empty(), "{name}");
            let again = follow(&rig, &shelf, is_live, &entries);
            same(&shelf, &(outcome, found), &again);
        }
    }
    assert!(dropped > 50 && restarted >= 4, "{dropped} dropped, {restarted} restarted: nothing was at stake");
}

#[test]
fn what_is_not_the_rig_of_the_recording_is_said_where_it_first_differs() {
    let rig = |add: i64, kind: &str| {
        let body = if kind == "relay" { format!("add = {add}\n") } else { "at = 9\non_error = \"skip\"\n".to_owned() };
        counter("a", "count = 30\nrate_hz = 1000")
            + &node("b", kind, &(body + "in = { numbers = \"a.numbers\" }"))
            + &collect("\"b.numbers\"", "differs")
    };
    let (_, _, entries) = record(&rig(0, "relay"), "differs", false);
    // Another sum gives other numbers and the same order; a message that is not there is another order.
    let (outcome, found) = follow(&rig(5, "relay"), "differs", false, &entries);
    assert_eq!((outcome.faults.len(), found[3].number), (0, 8));
    let (outcome, found) = follow(&rig(0, "fail"), "differs", false, &entries);
    assert_eq!(found.len(), 9);
    let fault = outcome.faults.iter().find(|it| it.instance == "replay").unwrap();
    assert!(fault.message.starts_with("room.b does not give out a message at `numbers`"), "{}", fault.message);
}

#[test]
fn a_recording_that_breaks_off_anywhere_gives_what_it_holds() {
    let rig = counter("a", "count = 30\nrate_hz = 1000")
        + &node("b", "relay", "in = { numbers = \"a.numbers\" }")
        + &collect("\"b.numbers\"", "cut");
    let (_, whole, entries) = record(&rig, "cut", true);
    breaks_off_anywhere(&rig, &whole, &entries);
    // The sink is on another thread, and has taken nothing yet when the data is over.
    let (_, whole, entries) = record(&rig, "cut", false);
    let is_late =
        |it: &Entry| matches!(it.event, Event::Delivered { edge: 1, .. } | Event::Activated { instance: 2, .. });
    let end = entries.iter().position(|it| matches!(it.event, Event::Ending)).unwrap();
    let (late, first): (Vec<Entry>, Vec<Entry>) = entries[..end].iter().cloned().partition(is_late);
    assert_eq!(late.len(), 60);
    breaks_off_anywhere(&rig, &whole, &[&first[..], &late, &entries[end..]].concat());
}

#[track_caller]
fn breaks_off_anywhere(rig: &str, whole: &[Collected], entries: &[Entry]) {
    for cut in (0..entries.len()).step_by(7) {
        let (outcome, found) = follow(rig, "cut", true, &entries[..cut]);
        assert!(outcome.faults.iter().all(|it| it.instance != "replay"), "{:?}", outcome.faults);
        let numbers = |it: &[Collected]| it.iter().map(|it| it.number).collect::<Vec<_>>();
        assert_eq!(numbers(&found), numbers(&whole[..found.len()]));
        let count = |what: &dyn Fn(&Event) -> bool| entries[..cut].iter().filter(|it| what(&it.event)).count();
        let n_given = count(&|it| matches!(it, Event::Emitted { instance: 0, .. }));
        let n_taken = count(&|it| matches!(it, Event::Activated { instance: 2, .. }));
        assert!((n_taken..=n_given).contains(&found.len()), "{} of {n_taken} to {n_given} at {cut}", found.len());
    }
}

#[test]
fn a_tap_that_is_closed_takes_nothing() {
    let graph = load(&(counter("a", "count = 1") + &collect("\"a.numbers\"", "memory")));
    let tap = Tap::new(&graph, 1 << 20, false, |_, _| Wanted::Yes);
    tap.close();
    let mut entries = VecDeque::new();
    let options = Options { tap: Some(tap.clone()), ..Options::default() };
    engine::deterministic(graph, &options, &mut |_| {}).unwrap();
    tap.drain(&mut entries);
    assert!(entries.is_empty());
}
