//! Random graphs of nodes that panic, fail, stall and die, under every policy and in both engines: no run hangs, and of every edge all that was sent
//! is delivered, dropped or suspended.
//!
//! `FOVEATE_SOAK_MESSAGES=1000000 cargo test --release -p foveate-engine --test it soak` sends a million messages.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use foveate_engine::{self as engine, Options, Outcome};
use foveate_estimation::random::Random;
use foveate_messages::{Quality, Space, Wire};
use foveate_node::{
    ConfigError, Due, In, Io, Message, Node, NodeError, Out, Ports, Purpose, Registry, Report, Role, Setup, Stamp, Time,
};
use foveate_rig::{self as rig, Overrides};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
struct Token(bool);

impl Message for Token {
    const NAME: &'static str = "token";
    const SPACE: Space = Space::NONE;
    const WIRE: Wire = Wire::portable::<Self>();
    fn quality(&self) -> Quality {
        assert!(!self.0, "no quality");
        Quality::default()
    }
}

const IN: In<Token> = In::each(0, "tokens").many().optional();
const BACK: In<Token> = In::latest(1, "back").many().optional();
const OUT: Out<Token> = Out::new(0, "tokens");
const UNDECLARED: Out<Token> = Out::new(7, "nothing");

/// What goes wrong with a node.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Harm {
    #[default]
    None,
    Error,
    Panic,
    PanicAfterEmission,
    Undeclared,
    Quality,
    Drop,
    Finish,
    Due,
    MadeAnew,
    Slow,
    Dies,
}

const HARMS: [Harm; 12] = [
    Harm::None,
    Harm::Error,
    Harm::Panic,
    Harm::PanicAfterEmission,
    Harm::Undeclared,
    Harm::Quality,
    Harm::Drop,
    Harm::Finish,
    Harm::Due,
    Harm::MadeAnew,
    Harm::Slow,
    Harm::Dies,
];

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Settings {
    /// Of the run, for the counts [–].
    run: String,
    /// Messages of a source, 0 for what is none [–].
    #[serde(default)]
    count: u64,
    /// What goes wrong at each `every`th activation [–].
    #[serde(default)]
    harm: Harm,
    /// See `harm` [–].
    #[serde(default = "seven")]
    every: u64,
}

fn seven() -> u64 {
    7
}

/// What each instance gave out, by run and name; and how often it was made.
static COUNTS: Mutex<BTreeMap<(String, String), (u64, u64)>> = Mutex::new(BTreeMap::new());

fn count<R>(run: &str, instance: &str, of: impl FnOnce(&mut (u64, u64)) -> R) -> R {
    let mut counts = COUNTS.lock().unwrap_or_else(PoisonError::into_inner);
    of(counts.entry((run.to_owned(), instance.to_owned())).or_default())
}

/// A source where it has a count, otherwise a relay.
struct Hostile {
    settings: Settings,
    instance: String,
    activations: u64,
    given: u64,
}

impl Hostile {
    fn emit(&mut self, io: &mut Io<'_>, stamp: Option<Stamp>) {
        count(&self.settings.run, &self.instance, |it| it.0 += 1);
        let token = Token(self.settings.harm == Harm::Quality && self.activations.is_multiple_of(self.settings.every));
        match stamp {
            Some(stamp) => io.emit(&OUT, stamp, token),
            None => io.emit_at(&OUT, io.now(), token),
        }
    }
}

impl Node for Hostile {
    const TYPE: &'static str = "test.hostile";
    const ROLE: Role = Role::ModelFilter;
    const SUMMARY: &'static str = "Goes wrong in every way.";
    type Settings = Settings;
    fn ports() -> Ports {
        Ports::new().input(&IN).input(&BACK).output(&OUT)
    }
    fn new(settings: Settings, setup: &Setup) -> Result<Self, ConfigError> {
        let instance = setup.instance.clone();
        let given = if setup.purpose == Purpose::Run {
            let made = count(&settings.run, &instance, |it| {
                it.1 += 1;
                it.1
            });
            assert!(settings.harm != Harm::MadeAnew || made != 2, "not a second time");
            // A source that is made anew goes on.
            count(&settings.run, &instance, |it| it.0)
        } else {
            0
        };
        Ok(Self { settings, instance, activations: 0, given })
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        self.activations += 1;
        let taken = io.take(&IN);
        if self.settings.count == 0 && taken.is_none() {
            return Ok(());
        }
        self.given += 1;
        let stamp = taken.map(|it| it.stamp);
        if self.activations.is_multiple_of(self.settings.every) {
            match self.settings.harm {
                Harm::Error => return Err(NodeError::input("it was asked for")),
                Harm::Panic | Harm::MadeAnew => panic!("it was asked for"),
                Harm::PanicAfterEmission => {
                    self.emit(io, stamp);
                    panic!("it was asked for");
                }
                Harm::Undeclared => io.emit_at(&UNDECLARED, io.now(), Token(false)),
                Harm::Slow => std::thread::sleep(Duration::from_micros(300)),
                Harm::Dies if self.settings.count > 0 => self.given = u64::MAX,
                _ => {}
            }
        }
        self.emit(io, stamp);
        Ok(())
    }
    fn due(&mut self) -> Due {
        if self.settings.count == 0 || self.given >= self.settings.count {
            return Due::Never;
        }
        assert!(self.settings.harm != Harm::Due || !(self.given + 1).is_multiple_of(50), "no time");
        Due::At(Time(self.given as i64 * 20_000))
    }
    fn finish(&mut self, _report: &mut Report) -> Result<(), NodeError> {
        assert!(self.settings.harm != Harm::Finish, "no end");
        Ok(())
    }
}

impl Drop for Hostile {
    fn drop(&mut self) {
        assert!(self.settings.harm != Harm::Drop || self.activations == 0, "it does not go in peace");
    }
}

/// A random graph of `n` nodes over 4 cameras: each node takes from some before it, some sample from behind them.
fn text(run: &str, random: &mut Random, count: u64) -> String {
    let n = 4 + random.below(8) as usize;
    let mut text = String::from("[rig]\nname = \"soak\"\ncalibration = \"cameras.toml\"\n[scale.room]\n");
    for index in 0..n {
        let is_source = index < 2;
        let harm = HARMS[random.below(HARMS.len() as u32) as usize];
        let harm = serde_json::to_string(&harm).unwrap();
        let on_error = ["stop", "skip", "restart"][random.below(3) as usize];
        text += &format!(
            "[scale.room.node.n{index}]\ntype = \"test.hostile\"\nrun = \"{run}\"\nharm = {harm}\non_error = \"{on_error}\"\nevery = {}\n",
            3 + random.below(40)
        );
        if random.below(2) == 0 {
            text += &format!("camera = \"ring-{}\"\n", 1 + random.below(4));
        }
        if is_source {
            text += &format!("count = {count}\n");
            continue;
        }
        let full = ["drop_oldest", "drop_newest", "wait"][random.below(3) as usize];
        let take = ["each", "newest_of_each", "newest", "round_robin"][random.below(4) as usize];
        let from = random.below(index as u32);
        let second = random.below(index as u32);
        let from = if from == second {
            format!("\"n{from}.tokens\"")
        } else {
            format!("[\"n{from}.tokens\", \"n{second}.tokens\"]")
        };
        let capacity = 1 + random.below(6);
        text += &format!(
            "in.tokens = {{ from = {from}, capacity = {capacity}, when_full = \"{full}\", policy = \"{take}\" }}\n"
        );
        if random.below(3) == 0 {
            text += &format!(
                "in.back = {{ from = \"n{}.tokens\", capacity = 2, when_full = \"wait\" }}\n",
                random.below(n as u32)
            );
        }
    }
    text
}

/// Runs a rig in one of the engines, at most a minute long.
fn run(text: &str, is_live: bool, workers: usize) -> (Arc<foveate_rig::graph::Graph>, Outcome) {
    let mut registry = Registry::new();
    registry.add::<Hostile>();
    let folder = tempfile::tempdir().unwrap();
    let calibration = foveate_testkit::scene::ring_calibration(4);
    std::fs::write(folder.path().join("cameras.toml"), calibration.to_toml()).unwrap();
    let graph = match rig::load(text, &folder.path().join("soak.toml"), &registry, &Overrides::default()) {
        Ok(graph) => Arc::new(graph),
        Err(found) => panic!("{}\n{text}", found.render(false)),
    };
    let (done, ended) = std::sync::mpsc::channel();
    let its = Arc::clone(&graph);
    std::thread::spawn(move || {
        let options = Options { workers: Some(workers), ..Options::default() };
        let engine = if is_live { engine::live } else { engine::deterministic };
        let _ = done.send(engine(its, &options, &mut |_| {}).unwrap());
    });
    let outcome = ended.recv_timeout(Duration::from_secs(60));
    (graph, outcome.unwrap_or_else(|_| panic!("hangs (live: {is_live}, {workers} workers):\n{text}")))
}

#[test]
fn nothing_hangs_and_the_ledgers_balance_whatever_goes_wrong() {
    let total: u64 = std::env::var("FOVEATE_SOAK_MESSAGES").ok().and_then(|it| it.parse().ok()).unwrap_or(60_000);
    let (mut sent_in_all, mut seed, mut n_faults) = (0, 0, 0);
    while sent_in_all < total {
        seed += 1;
        let mut random = Random::new(seed);
        for is_live in [false, true] {
            let name = format!("soak {seed} {is_live}");
            let text = text(&name, &mut random.fork("graph"), 300);
            let (graph, outcome) = run(&text, is_live, 1 + random.below(5) as usize);
            n_faults += outcome.faults.len();
            for (edge, ledger) in graph.edges.iter().zip(&outcome.ledgers) {
                let sent = count(&name, &graph.instances[edge.from.0].path, |it| it.0);
                let found = ledger.delivered + ledger.dropped + ledger.suspended;
                assert_eq!(
                    found, sent,
                    "seed {seed}, live: {is_live}, {}: {ledger:?}\n{:#?}\n{text}",
                    edge.name, outcome.faults
                );
                sent_in_all += sent;
            }
            assert!(outcome.faults.iter().all(|it| it.instance != "engine"), "{:#?}\n{text}", outcome.faults);
            // What panics is told with its place.
            let places = outcome.faults.iter().filter(|it| it.message.contains("panicked"));
            places.for_each(|it| assert!(it.message.contains("soak.rs:") || it.message.contains("io.rs:"), "{it:?}"));
        }
    }
    assert!(n_faults > 50, "{n_faults} faults");
}

#[test]
fn two_threads_that_wait_for_each_other_go_on() {
    let node = |name: &str, camera: u32, from: &str| {
        format!(
            "[scale.room.node.{name}]\ntype = \"test.hostile\"\nrun = \"cross\"\ncamera = \"ring-{camera}\"\nharm = \"slow\"\nevery = 2\n{from}\n"
        )
    };
    let wait = |from: &str| format!("in.tokens = {{ from = \"{from}.tokens\", capacity = 1, when_full = \"wait\" }}");
    // Each of two threads feeds the other, so that both queues are full at once.
    let text = [
        "[rig]\nname = \"cross\"\ncalibration = \"cameras.toml\"\n[scale.room]\n".to_owned(),
        node("a", 1, "count = 2000"),
        node("b", 2, "count = 2000"),
        node("c", 1, &wait("b")),
        node("d", 2, &wait("a")),
        node("e", 2, &wait("c")),
        node("f", 1, &wait("d")),
    ]
    .concat();
    let (_, outcome) = run(&text, true, 4);
    assert!(outcome.ledgers.iter().all(|it| it.delivered == 2000 && it.dropped == 0), "{:?}", outcome.ledgers);
}

const NEVER: In<Token> = In::each(0, "tokens");

#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct NoSettings {}

/// Never comes back; a sink, or a filter.
struct Stuck<const IS_SINK: bool>;

impl<const IS_SINK: bool> Node for Stuck<IS_SINK> {
    const TYPE: &'static str = if IS_SINK { "test.stuck_sink" } else { "test.stuck" };
    const ROLE: Role = if IS_SINK { Role::Sink } else { Role::ModelFilter };
    const SUMMARY: &'static str = "Never comes back.";
    type Settings = NoSettings;
    fn ports() -> Ports {
        Ports::new().input(&NEVER)
    }
    fn new(_: NoSettings, _: &Setup) -> Result<Self, ConfigError> {
        Ok(Self)
    }
    fn process(&mut self, _: &mut Io<'_>) -> Result<(), NodeError> {
        loop {
            std::thread::park();
        }
    }
}

/// Counts tokens, and says how many there were when it finishes.
struct Counts(u64);

impl Node for Counts {
    const TYPE: &'static str = "test.counts";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Counts.";
    type Settings = NoSettings;
    fn ports() -> Ports {
        Ports::new().input(&NEVER)
    }
    fn new(_: NoSettings, _: &Setup) -> Result<Self, ConfigError> {
        Ok(Self(0))
    }
    fn process(&mut self, _: &mut Io<'_>) -> Result<(), NodeError> {
        self.0 += 1;
        Ok(())
    }
    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.figure("counts", self.0 as f64);
        Ok(())
    }
}

/// Runs `a`, a source, and what the rig hangs behind it; the one failure names `culprit`.
#[track_caller]
fn run_stuck(nodes: &str, is_live: bool, workers: usize, culprit: &str) -> Outcome {
    let mut registry = Registry::new();
    registry.add::<Hostile>();
    registry.add::<Stuck<true>>();
    registry.add::<Stuck<false>>();
    registry.add::<Counts>();
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("cameras.toml"), foveate_testkit::scene::ring_calibration(4).to_toml()).unwrap();
    // Sources remember by run what they gave.
    static RUNS: AtomicUsize = AtomicUsize::new(0);
    let nodes = nodes.replace("RUN", &format!("stuck {}", RUNS.fetch_add(1, Ordering::Relaxed)));
    let text = format!("[rig]\nname = \"stuck\"\ncalibration = \"cameras.toml\"\n[scale.room]\n{nodes}");
    let graph = match rig::load(&text, &folder.path().join("stuck.toml"), &registry, &Overrides::default()) {
        Ok(graph) => Arc::new(graph),
        Err(found) => panic!("{}", found.render(false)),
    };
    let options = Options { patience: Some(Duration::from_millis(100)), workers: Some(workers), ..Options::default() };
    let engine = if is_live { engine::live } else { engine::deterministic };
    let outcome = engine(graph, &options, &mut |_| {}).unwrap();
    assert_eq!(outcome.faults.len(), 1, "{:#?}", outcome.faults);
    assert_eq!((outcome.faults[0].instance.as_str(), outcome.faults[0].action), (culprit, "left behind"));
    outcome
}

#[test]
fn a_node_that_never_comes_back_is_left_behind_and_named() {
    let source = "[scale.room.node.a]\ntype = \"test.hostile\"\nrun = \"RUN\"\ncount = 100\n";
    let behind = |name: &str, kind: &str| {
        format!("[scale.room.node.{name}]\ntype = \"test.{kind}\"\nin.tokens = \"a.tokens\"\n")
    };
    let relay = behind("b", "hostile") + "run = \"RUN\"\n";
    let outcome = run_stuck(&format!("{source}{relay}{}", behind("c", "stuck_sink")), true, 3, "room.c");
    assert_eq!(outcome.ledgers[0].delivered, 100, "what runs beside it is not lost");
    for workers in [1, 2] {
        // The sink first, so that it has its token before the other is stuck.
        let rig = format!("{source}{}{}", behind("b", "stuck"), behind("d", "counts"));
        let outcome = run_stuck(&rig, false, workers, "room.b");
        assert!(outcome.report.figures.values().all(|it| *it <= 1.0) && outcome.report.figures.contains_key("counts"));
        let rig = format!("{source}{relay}{}", behind("c", "stuck_sink"));
        let outcome = run_stuck(&rig, false, workers, "room.c");
        assert_eq!(outcome.ledgers[0].delivered, 1, "what runs beside it is not lost");
        // On a camera's lane.
        let each = "each = \"ring-*\"\n";
        let stuck = behind("b", "stuck") + "each = \"ring-1\"\n";
        let lanes = format!("{source}{each}{}{each}{stuck}", behind("d", "counts"));
        let outcome = run_stuck(&lanes, false, workers, "room.b[ring-1]");
        assert!(outcome.report.figures.contains_key("counts"), "{:?}", outcome.report.figures);
    }
}

#[test]
fn a_node_that_cannot_be_made_anew_is_tried_again_and_given_up() {
    // MadeAnew panics the second time that it is made; the third time it is made.
    let text = "[rig]\nname = \"anew\"\n[scale.room]\n\
                [scale.room.node.a]\ntype = \"test.hostile\"\nrun = \"anew\"\ncount = 20000\n\
                [scale.room.node.b]\ntype = \"test.hostile\"\nrun = \"anew\"\nharm = \"made_anew\"\nevery = 1000\non_error = \"restart\"\nin.tokens = \"a.tokens\"\n";
    let (_, outcome) = run(text, false, 1);
    let on_outcome: Vec<_> =
        outcome.faults.iter().map(|it| (it.action, it.message.contains("cannot be restarted"))).collect();
    assert!(
        on_outcome.contains(&("restarted", true)) && on_outcome.contains(&("restarted", false)),
        "{:#?}",
        outcome.faults
    );
    let ledger = &outcome.ledgers[0];
    assert_eq!(ledger.delivered + ledger.dropped, 20_000);
    // It is made anew after 0.1 s, in which 5,000 messages are lost.
    assert!((4_000..6_000).contains(&ledger.dropped), "{ledger:?}");
}
