//! Budgets: ages along paths of known delays, in every way to run.

use std::collections::VecDeque;
use std::sync::Arc;

use foveate_engine::tap::{Entry, Tap, Wanted};
use foveate_engine::{self as engine, Feed, Options, Outcome, Source, Unmet};
use foveate_node::{ConfigError, In, Io, Node, NodeError, Plan, Ports, Registry, Role, Setup};
use foveate_rig::graph::Graph;
use foveate_rig::{self as rig, Overrides};
use foveate_testkit::nodes::Number;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const COMMANDS: In<Number> = In::each(0, "commands");

/// Settings of [`Motor`]: none.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct MotorSettings {}

/// Moves 40 ms after a command.
struct Motor;

impl Node for Motor {
    const TYPE: &'static str = "test.motor";
    const ROLE: Role = Role::Actuator;
    const SUMMARY: &'static str = "Moves 40 ms after a command";
    type Settings = MotorSettings;

    fn ports() -> Ports {
        Ports::new().input(&COMMANDS)
    }

    fn new(_settings: MotorSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self)
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        io.take(&COMMANDS);
        Ok(())
    }

    fn plan(_settings: &MotorSettings) -> Plan {
        Plan { latency_s: 0.040, ..Plan::default() }
    }
}

/// A rig out of node tables and budgets (from, to, age), with cameras `ring-1` … `ring-4`.
fn graph(nodes: &str, budgets: &[(&str, &str, f64)]) -> Arc<Graph> {
    let mut registry = Registry::new();
    foveate_testkit::register(&mut registry);
    registry.add::<Motor>();
    let folder = tempfile::tempdir().unwrap();
    let calibration = foveate_testkit::scene::ring_calibration(4);
    std::fs::write(folder.path().join("cameras.toml"), calibration.to_toml()).unwrap();
    let mut text = format!("[rig]\nname = \"test\"\ncalibration = \"cameras.toml\"\n[scale.room]\n{nodes}");
    for (from, to, age_ms) in budgets {
        text += &format!("[[budget]]\nfrom = \"room.{from}\"\nto = \"room.{to}\"\nage_ms = {age_ms:?}\nmust = true\n");
    }
    match rig::load(&text, &folder.path().join("test.toml"), &registry, &Overrides::default()) {
        Ok(graph) => Arc::new(graph),
        Err(faults) => panic!("{}", faults.render(false)),
    }
}

fn run(nodes: &str, budgets: &[(&str, &str, f64)]) -> Outcome {
    engine::deterministic(graph(nodes, budgets), &Options::default(), &mut |_| {}).unwrap()
}

/// What a budget measured: greatest age, exact [ms]; median and 99th percentile are near it, as all messages are of one age.
#[track_caller]
fn age_ms(outcome: &Outcome, number: usize) -> f64 {
    let figure = |statistic: &str| outcome.report.figures[&format!("budget.{number}.age_ms.{statistic}")];
    let max = figure("max");
    for statistic in ["median", "p99"] {
        let found = figure(statistic);
        assert!(found <= max && found >= max * 0.98, "{statistic} is {found}, max {max}");
    }
    (max * 1e6).round() * 1e-6
}

fn edges(outcome: &Outcome) -> Vec<&str> {
    outcome.unmet.iter().map(|it| it.edge.as_str()).collect()
}

/// counter, 7 ms after capture → relay, 3 ms → collect.
const CHAIN: &str = "[scale.room.node.a]\ntype = \"testkit.counter\"\ncount = 20\nlatency_ms = 7\n\
                     [scale.room.node.b]\ntype = \"testkit.relay\"\ncost_ms = 3\nin.numbers = \"a.numbers\"\n\
                     [scale.room.node.c]\ntype = \"testkit.collect\"\ninto = \"budget\"\nin.numbers = \"b.numbers\"\n";

#[test]
fn age_at_an_output_is_that_of_giving_out_and_at_an_input_that_of_delivery() {
    let paths = [
        ("a.numbers", "a.numbers", 7.1),
        ("a.numbers", "b.numbers", 10.1),
        ("a.numbers", "c.numbers", 10.1),
        ("b.numbers", "c.numbers", 10.1),
    ];
    let outcome = run(CHAIN, &paths);
    assert_eq!([1, 2, 3, 4].map(|it| age_ms(&outcome, it)), [7.0, 10.0, 10.0, 10.0]);
    assert_eq!(outcome.unmet, []);
    let remark = "budget 2, room.a.numbers -> room.b.numbers: age ";
    let remark = outcome.report.remarks.iter().find(|it| it.starts_with(remark)).unwrap();
    assert!(remark.contains(" 10.000 ms (max), promised at most 10.100 ms"), "{remark}");
    assert_eq!(outcome.report.about["budget.2.age_ms.p99"].unit, "ms");
    assert!(run(CHAIN, &[]).report.figures.keys().all(|it| !it.starts_with("budget")), "none is stated");
}

#[test]
fn budget_that_is_not_met_is_told_with_both_numbers() {
    // The plan knows of the 7 ms, and not that an activation takes 3 ms.
    let outcome = run(CHAIN, &[("a.numbers", "b.numbers", 8.0), ("a.numbers", "c.numbers", 10.1)]);
    let [Unmet { edge, what, must: true }] = &outcome.unmet[..] else { panic!("{:?}", outcome.unmet) };
    assert_eq!(edge, "room.a.numbers -> room.b.numbers");
    assert!(what.starts_with("age is 9.9") || what.starts_with("age is 10.000 ms (p99)"), "{what}");
    assert!(what.ends_with(" ms (p99), promised at most 8.000 ms"), "{what}");
}

#[test]
fn budget_of_an_actuator_goes_up_to_its_motor() {
    let motor = format!("{CHAIN}[scale.room.node.m]\ntype = \"test.motor\"\nin.commands = \"b.numbers\"\n");
    let outcome = run(&motor, &[("a.numbers", "m.commands", 50.1), ("a.numbers", "b.numbers", 10.1)]);
    assert_eq!((age_ms(&outcome, 1), age_ms(&outcome, 2)), (50.0, 10.0));
    assert_eq!(outcome.unmet, []);
    let outcome = run(&motor, &[("a.numbers", "m.commands", 48.0)]);
    assert_eq!(edges(&outcome), ["room.a.numbers -> room.m.commands"]);
    let what = &outcome.unmet[0].what;
    assert!(what.contains("of which 40.000 ms are from the arrival to the motor"), "{what}");
}

#[test]
fn messages_of_other_sources_do_not_count() {
    let nodes = "[scale.room.node.quick]\ntype = \"testkit.counter\"\nlatency_ms = 2\n\
                 [scale.room.node.slow]\ntype = \"testkit.counter\"\nlatency_ms = 23\n\
                 [scale.room.node.n]\ntype = \"testkit.newest\"\nin.numbers = [\"quick.numbers\", \"slow.numbers\"]\n\
                 [scale.room.node.c]\ntype = \"testkit.collect\"\ninto = \"budget sources\"\nin.numbers = [\"n.numbers\", \"quick.numbers\"]\n";
    let outcome = run(
        nodes,
        &[
            ("quick.numbers", "n.numbers", 3.0),
            ("slow.numbers", "n.numbers", 24.0),
            ("slow.numbers", "c.numbers", 24.0),
            ("quick.numbers", "c.numbers", 3.0),
        ],
    );
    assert_eq!([1, 2, 3, 4].map(|it| age_ms(&outcome, it)), [2.0, 23.0, 23.0, 2.0]);
    assert_eq!(outcome.unmet, []);
}

#[test]
fn messages_that_come_another_way_do_not_count() {
    // The relay passes the counter's stamps on, so only the edges tell both ways apart.
    let both = CHAIN.replace("in.numbers = \"b.numbers\"", "in.numbers = [\"a.numbers\", \"b.numbers\"]");
    let outcome = run(&both, &[("b.numbers", "c.numbers", 10.1)]);
    assert_eq!((age_ms(&outcome, 1), outcome.unmet), (10.0, vec![]));
}

#[test]
fn one_old_message_in_more_than_a_hundred_breaks_no_budget() {
    // A single number of `other` keeps the node busy from 208 to 213 ms: what comes at 210 ms leaves at 218 ms.
    let nodes = "[scale.room.node.a]\ntype = \"testkit.counter\"\ncount = 150\n\
                 [scale.room.node.other]\ntype = \"testkit.counter\"\ncount = 1\nphase_ms = 208\n\
                 [scale.room.node.n]\ntype = \"testkit.newest\"\ncost_ms = 5\nin.numbers = [\"a.numbers\", \"other.numbers\"]\n\
                 [scale.room.node.c]\ntype = \"testkit.collect\"\ninto = \"budget p99\"\nin.numbers = \"n.numbers\"\n";
    let outcome = run(nodes, &[("a.numbers", "n.numbers", 6.0)]);
    let figure = |statistic: &str| outcome.report.figures[&format!("budget.1.age_ms.{statistic}")];
    assert!((figure("median") - 5.0).abs() < 0.1 && (figure("p99") - 5.0).abs() < 0.1, "{}", figure("p99"));
    assert!((figure("max") - 8.0).abs() < 1e-9, "{}", figure("max"));
    assert_eq!(outcome.unmet, []);
}

#[test]
fn node_that_joins_gives_the_age_of_what_it_joined() {
    let nodes = "[scale.room.node.quick]\ntype = \"testkit.counter\"\nlatency_ms = 5\n\
                 [scale.room.node.slow]\ntype = \"testkit.counter\"\nlatency_ms = 9\n\
                 [scale.room.node.j]\ntype = \"testkit.join\"\nin.numbers = [\"quick.numbers\", \"slow.numbers\"]\n\
                 [scale.room.node.c]\ntype = \"testkit.collect\"\ninto = \"budget join\"\nin.numbers = \"j.numbers\"\n";
    let outcome = run(nodes, &[("quick.numbers", "c.numbers", 8.0), ("slow.numbers", "j.numbers", 9.5)]);
    // Its own stamps, at the capture time of the set: that of both sources, and it waits for the slow one.
    assert_eq!((age_ms(&outcome, 1), age_ms(&outcome, 2)), (9.0, 9.0));
    assert_eq!(edges(&outcome), ["room.quick.numbers -> room.c.numbers"]);
}

#[test]
fn age_over_a_feedback_edge_has_its_delay() {
    let delay = |delay_ms: &str| {
        let back = format!("in.feedback = {{ from = \"b.numbers\"{delay_ms} }}\n[scale.room.node.c]");
        CHAIN.replace("[scale.room.node.c]", &back)
    };
    let outcome =
        run(&delay(", delay_ms = 25"), &[("a.numbers", "b.feedback", 35.1), ("b.numbers", "b.feedback", 35.1)]);
    assert_eq!((age_ms(&outcome, 1), age_ms(&outcome, 2)), (35.0, 35.0));
    assert_eq!(outcome.unmet, []);
    let outcome = run(&delay(""), &[("a.numbers", "b.feedback", 10.1)]);
    assert_eq!(age_ms(&outcome, 1), 10.0);
}

/// Counters of four cameras, of which that of ring-3 passes a relay that takes 5 ms.
const RING: &str = "[scale.room.node.a]\ntype = \"testkit.counter\"\neach = \"ring-*\"\nlatency_ms = 4\n\
                    [scale.room.node.late]\ntype = \"testkit.relay\"\ncamera = \"ring-3\"\ncost_ms = 5\nin.numbers = \"a.numbers\"\n\
                    [scale.room.node.n]\ntype = \"testkit.newest\"\n\
                    in.numbers = [\"a[ring-1].numbers\", \"a[ring-2].numbers\", \"late.numbers\", \"a[ring-4].numbers\"]\n\
                    [scale.room.node.r]\ntype = \"testkit.relay\"\neach = \"ring-*\"\nin.numbers = \"a.numbers\"\n\
                    [scale.room.node.c]\ntype = \"testkit.collect\"\ninto = \"budget ring\"\nin.numbers = [\"n.numbers\", \"r.numbers\"]\n";

#[test]
fn budget_holds_for_each_camera() {
    let outcome = run(
        RING,
        &[("a.numbers", "n.numbers", 8.0), ("a[ring-2].numbers", "n.numbers", 8.0), ("a.numbers", "r.numbers", 4.1)],
    );
    assert_eq!(edges(&outcome), ["room.a[ring-3].numbers -> room.n.numbers"]);
    assert_eq!([1, 2, 3].map(|it| age_ms(&outcome, it)), [9.0, 4.0, 4.0], "of the camera with the greatest");
    let remark = outcome.report.remarks.iter().find(|it| it.starts_with("budget 1,")).unwrap();
    assert!(remark.contains("9.000 ms (max) (greatest of 4)"), "{remark}");
    // Each end by itself.
    let slow = RING.replace("each = \"ring-*\"\nin", "each = \"ring-*\"\ncost_ms = 1\nin");
    let outcome = run(&slow, &[("a.numbers", "r.numbers", 4.5)]);
    assert_eq!(
        edges(&outcome),
        [1, 2, 3, 4].map(|it| format!("room.a[ring-{it}].numbers -> room.r[ring-{it}].numbers"))
    );
}

#[test]
fn path_on_which_nothing_comes_meets_no_budget() {
    let outcome = run(&CHAIN.replace("count = 20", "count = 0"), &[("a.numbers", "b.numbers", 10.0)]);
    assert_eq!(edges(&outcome), ["room.a.numbers -> room.b.numbers"]);
    assert_eq!(outcome.unmet[0].what, "nothing came that was made of it");
    assert!(outcome.report.figures["budget.1.age_ms.p99"].is_nan());
}

const PATHS: [(&str, &str, f64); 3] =
    [("a.numbers", "n.numbers", 8.0), ("a.numbers", "c.numbers", 8.0), ("late.numbers", "n.numbers", 20.0)];

fn budgets(outcome: &Outcome) -> Vec<(String, u64)> {
    let all = outcome.report.figures.iter().filter(|it| it.0.starts_with("budget"));
    all.map(|it| (it.0.clone(), it.1.to_bits())).collect()
}

#[test]
fn any_number_of_threads_measures_the_same() {
    let on = |workers: usize| {
        let options = Options { workers: Some(workers), ..Options::default() };
        engine::deterministic(graph(RING, &PATHS), &options, &mut |_| {}).unwrap()
    };
    let one = on(1);
    assert_eq!(budgets(&one).len(), 9);
    for workers in [2, 4] {
        let other = on(workers);
        assert_eq!((budgets(&other), &other.unmet), (budgets(&one), &one.unmet), "{workers} threads");
    }
}

#[test]
fn live_run_measures_on_the_wall_clock() {
    let outcome = engine::live(graph(RING, &PATHS), &Options::default(), &mut |_| {}).unwrap();
    let figure = |name: &str| outcome.report.figures[name];
    let [median, p99, max] = ["median", "p99", "max"].map(|it| figure(&format!("budget.2.age_ms.{it}")));
    // Delivered 4 ms after capture, and not within seconds of it.
    assert!(4.0 <= max && median <= p99 && p99 <= max && max < 5000.0, "{median} {p99} {max}");
    assert!(figure("budget.1.age_ms.max") >= 4.0 && figure("budget.3.age_ms.max") >= 4.0);
}

struct Recorded(VecDeque<Entry>);

impl Feed for Recorded {
    fn next(&mut self) -> Result<Option<Entry>, String> {
        Ok(self.0.pop_front())
    }

    fn was_live(&self) -> bool {
        false
    }
}

#[test]
fn replay_measures_what_the_run_did() {
    let rig = graph(RING, &PATHS);
    let tap = Tap::new(&rig, 1 << 20, true, |_, _| Wanted::No);
    let options = Options { tap: Some(tap.clone()), ..Options::default() };
    let first = engine::deterministic(Arc::clone(&rig), &options, &mut |_| {}).unwrap();
    let mut entries = VecDeque::new();
    tap.drain(&mut entries);
    entries.make_contiguous().sort_by_key(|it| it.order);
    let makes_none = |_| Source::Recording;
    for source_of in [&|_| Source::Node, &makes_none] as [&dyn Fn(usize) -> Source; 2] {
        let sources: Vec<Source> = (0..rig.instances.len()).map(source_of).collect();
        let mut feed = Recorded(entries.clone());
        let again = engine::replay(Arc::clone(&rig), &sources, &mut feed, &Options::default(), &mut |_| {}).unwrap();
        assert_eq!(again.faults, []);
        assert_eq!((budgets(&again), &again.unmet), (budgets(&first), &first.unmet));
    }
}
