//! Anchored scales at run time: suspended and resumed, nested, in both engines.

use std::path::Path;
use std::sync::Arc;

use foveate_engine::{self as engine, Options, Outcome};
use foveate_messages::{Provenance, ScaleSpace, Target, TargetId, Targets};
use foveate_node::scale::Spaces;
use foveate_node::{
    ConfigError, Due, In, Interval, Io, Node, NodeError, Out, Ports, Registry, Report, Role, Setup, Time,
};
use foveate_rig::graph::Graph;
use foveate_rig::{self as rig, Overrides};
use nalgebra::{Matrix6, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const OUT: Out<Targets> = Out::new(0, "targets");
const IN: In<Targets> = In::each(0, "targets");
const SPACES: In<ScaleSpace> = In::latest(1, "spaces").many().optional();

const PERIOD: Interval = Interval(10_000_000);
/// Messages of each source.
const COUNT: i64 = 100;

#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct ScriptSettings {
    /// When there is no target: from the first time to before the second [ms].
    away_ms: Vec<[i64; 2]>,
}

/// A target that walks along x at 1 m/s, and is away at times; then it comes back as another one.
struct Script {
    away_ms: Vec<[i64; 2]>,
    next: i64,
}

impl Node for Script {
    const TYPE: &'static str = "test.script";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "A target that walks, and is away at times.";
    type Settings = ScriptSettings;

    fn ports() -> Ports {
        Ports::new().output(&OUT)
    }

    fn new(settings: ScriptSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self { away_ms: settings.away_ms, next: 0 })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let time = Time(self.next * PERIOD.0);
        let now_ms = time.0 / 1_000_000;
        let visit = self.away_ms.iter().filter(|it| it[1] <= now_ms).count() as u32;
        let is_away = self.away_ms.iter().any(|it| (it[0]..it[1]).contains(&now_ms));
        let target = Target {
            id: TargetId(visit),
            position: Point3::new(time.as_s(), 0.0, 1.0),
            velocity: Vector3::new(1.0, 0.0, 0.0),
            covariance: Matrix6::identity() * 1e-4,
            cameras: Default::default(),
            provenance: Provenance::Measured,
        };
        io.emit_at(&OUT, time, Targets { time, list: if is_away { Vec::new() } else { vec![target] } });
        self.next += 1;
        Ok(())
    }

    fn due(&mut self) -> Due {
        if self.next < COUNT { Due::At(Time(self.next * PERIOD.0)) } else { Due::Never }
    }
}

#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Nothing {}

/// Passes targets on and counts its activations; its count outlives a suspension.
struct Through {
    n_turns: u32,
}

impl Node for Through {
    const TYPE: &'static str = "test.through";
    const ROLE: Role = Role::ModelFilter;
    const SUMMARY: &'static str = "Passes targets on.";
    type Settings = Nothing;

    fn ports() -> Ports {
        Ports::new().input(&IN).output(&OUT)
    }

    fn new(_settings: Nothing, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self { n_turns: 0 })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(targets) = io.take(&IN) {
            self.n_turns += 1;
            io.emit(&OUT, targets.stamp, targets.value);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.figure("activations", f64::from(self.n_turns));
        Ok(())
    }
}

/// Carries its targets to the world, and remembers the last and the first of them.
struct World {
    spaces: Spaces,
    x_m: Vec<f64>,
    n_refused: u32,
}

impl Node for World {
    const TYPE: &'static str = "test.world";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Carries targets to the world.";
    type Settings = Nothing;

    fn ports() -> Ports {
        Ports::new().input(&IN).input(&SPACES)
    }

    fn new(_settings: Nothing, setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self { spaces: Spaces::new(&setup.scales), x_m: Vec::new(), n_refused: 0 })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(targets) = io.take(&IN) else { return Ok(()) };
        io.latest_of_each(&SPACES).for_each(|it| self.spaces.learn(it.value));
        for target in &targets.value.list {
            match self.spaces.world_from_own(targets.value.time) {
                Ok(world_from_own) => self.x_m.push((world_from_own.transform * target.position).x),
                Err(_) => self.n_refused += 1,
            }
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.figure("carried", self.x_m.len() as f64);
        report.figure("refused", f64::from(self.n_refused));
        report.figure("last_x_m", self.x_m.last().copied().unwrap_or(f64::NAN));
        Ok(())
    }
}

/// The walker of the hall is away from 300 to 600 ms, what the person carries from 800 to 900 ms.
const NESTED: &str = r#"
[rig]
name = "nested"

[scale.hall.node.walker]
type = "test.script"
away_ms = [[300, 600]]

[scale.hall.node.smooth]
type = "test.through"
in.targets = "walker.targets"

[scale.hall.target.body]
settle_ms = 0

[scale.person]
parent = "hall"
anchor = "smooth.body"

[scale.person.node.joints]
type = "test.script"
away_ms = [[800, 900]]

[scale.person.node.smooth]
type = "test.through"
in.targets = "joints.targets"

[scale.person.node.table]
type = "test.world"
in = { targets = "joints.targets", spaces = "anchor.space" }

[scale.person.target.hand]
settle_ms = 0

[scale.hand]
parent = "person"
anchor = "smooth.hand"

[scale.hand.node.marks]
type = "test.script"

[scale.hand.node.smooth]
type = "test.through"
in.targets = "marks.targets"

[scale.hand.node.table]
type = "test.world"
in = { targets = "smooth.targets", spaces = ["anchor.space", "person.anchor.space"] }
"#;

fn graph(text: &str) -> Arc<Graph> {
    let mut registry = Registry::new();
    registry.add::<Script>();
    registry.add::<Through>();
    registry.add::<World>();
    match rig::load(text, Path::new("nested.toml"), &registry, &Overrides::default()) {
        Ok(graph) => Arc::new(graph),
        Err(faults) => panic!("{faults}"),
    }
}

fn deterministic(text: &str) -> (Arc<Graph>, Outcome) {
    let graph = graph(text);
    let outcome = engine::deterministic(Arc::clone(&graph), &Options::default(), &mut |_| ()).unwrap();
    assert_eq!(outcome.faults, []);
    (graph, outcome)
}

/// Delivered and suspended messages of the edge into a port.
#[track_caller]
fn into(graph: &Graph, outcome: &Outcome, port: &str) -> (u64, u64) {
    let index = graph.edges.iter().position(|it| it.name.ends_with(port)).unwrap();
    let ledger = &outcome.ledgers[index];
    assert_eq!((ledger.dropped, ledger.gaps, ledger.late), (0, 0, 0), "{port}");
    (ledger.delivered, ledger.suspended)
}

#[test]
fn lost_scale_holds_up_its_filters_and_those_of_the_scales_in_it_and_nothing_else() {
    let (graph, outcome) = deterministic(NESTED);
    // What the hall's filter gives at t is known to the person's anchor before the person's own source has its activation at t.
    assert_eq!(into(&graph, &outcome, "-> hall.smooth.targets"), (100, 0));
    assert_eq!(into(&graph, &outcome, "-> person.anchor.targets"), (100, 0));
    assert_eq!(into(&graph, &outcome, "-> person.smooth.targets"), (70, 30));
    assert_eq!(into(&graph, &outcome, "-> person.table.targets"), (100, 0), "a sink goes on");
    // While the person is suspended nothing comes from its filter; the hand stops with it, and for itself later.
    assert_eq!(into(&graph, &outcome, "-> hand.anchor.targets"), (70, 0));
    assert_eq!(into(&graph, &outcome, "-> hand.smooth.targets"), (60, 40));
    let figure = |name: &str| outcome.report.figures[name];
    assert_eq!(figure("scale.suspensions.person"), 2.0, "until it was found, and once lost");
    assert!((figure("scale.suspended_s.person") - 0.3).abs() < 1e-9);
    assert_eq!(figure("scale.suspensions.hand"), 3.0);
    assert!((figure("scale.suspended_s.hand") - 0.4).abs() < 1e-9);
}

#[test]
fn spells_are_told_with_their_times_and_reasons() {
    let (_, outcome) = deterministic(NESTED);
    let spells = |scale: usize| {
        let it = &outcome.suspensions[scale];
        let ms = |time: Time| time.0 / 1_000_000;
        let on_outcome = it.spells.iter().map(|it| (ms(it.from), it.until.map(ms), it.why.as_str()));
        (it.scale.as_str(), on_outcome.collect::<Vec<_>>())
    };
    let person = vec![
        (0, Some(0), "its target `smooth.body` has not been found yet"),
        (300, Some(600), "its target `smooth.body` is lost"),
    ];
    assert_eq!(spells(0), ("person", person));
    let hand = vec![
        (0, Some(0), "its target `smooth.hand` has not been found yet"),
        (300, Some(600), "scale `person` around it is suspended"),
        (800, Some(900), "its target `smooth.hand` is lost"),
    ];
    assert_eq!(spells(1), ("hand", hand));
}

#[test]
fn points_of_the_innermost_scale_are_carried_to_the_world() {
    let (_, outcome) = deterministic(NESTED);
    let figure = |name: &str| *outcome.report.figures.iter().find(|it| it.0.starts_with(name)).unwrap().1;
    // The walker is at t, the hand at t from it, the mark at t from that: at 990 ms.
    assert!((outcome.report.figures["last_x_m[hand.table]"] - 2.97).abs() < 1e-9, "{:?}", outcome.report.figures);
    assert_eq!(outcome.report.figures["carried[hand.table]"], 60.0);
    // The person's table gets what comes during the suspension too, and knows no place for it.
    assert_eq!((figure("carried"), figure("refused")), (60.0, 30.0));
}

#[test]
fn scale_whose_target_never_comes_stays_suspended_and_says_so() {
    let text = NESTED.replace("away_ms = [[300, 600]]", "away_ms = [[0, 5000]]");
    let text = text.replace(
        "in.targets = \"joints.targets\"",
        "in.targets = \"joints.targets\"\nrequire.targets = { rate_hz = 50 }",
    );
    let (graph, outcome) = deterministic(&text);
    assert_eq!(into(&graph, &outcome, "-> person.smooth.targets"), (0, 100));
    assert_eq!(into(&graph, &outcome, "-> hand.smooth.targets"), (0, 100));
    assert_eq!(outcome.suspensions[0].spells[0].until, None);
    assert_eq!(outcome.unmet.len(), 1);
    assert_eq!(outcome.unmet[0].what, "nothing was delivered: its scale was suspended");
}

#[test]
fn live_run_suspends_too_and_loses_no_count() {
    let graph = graph(NESTED);
    let outcome = engine::live(Arc::clone(&graph), &Options::default(), &mut |_| ()).unwrap();
    assert_eq!(outcome.faults, []);
    for port in ["-> person.smooth.targets", "-> hand.smooth.targets"] {
        let (delivered, suspended) = into(&graph, &outcome, port);
        assert_eq!(delivered + suspended, 100, "{port}");
        assert!(suspended >= 20 && delivered >= 20, "{port}: {delivered} delivered, {suspended} suspended");
    }
    assert_eq!(outcome.suspensions.len(), 2);
}

#[test]
fn budget_within_a_scale_that_never_had_its_target_says_so() {
    let away = NESTED.replace("away_ms = [[300, 600]]", "away_ms = [[0, 2000]]");
    let budget = "[[budget]]\nfrom = \"hand.marks.targets\"\nto = \"hand.smooth.targets\"\nage_ms = 1\n";
    for (text, expected) in
        [(away.as_str(), vec!["nothing came that was made of it: its scale was suspended"]), (NESTED, vec![])]
    {
        let outcome =
            engine::deterministic(graph(&format!("{text}{budget}")), &Options::default(), &mut |_| {}).unwrap();
        let what: Vec<&str> = outcome.unmet.iter().map(|it| it.what.as_str()).collect();
        assert_eq!(what, expected);
    }
}
