//! A rig with one head: what commands it, what listens, and what lies in its line.

use std::sync::{Arc, Mutex};

use foveate::node::Device;
use foveate::node::Line;
use foveate::prelude::*;
use foveate_embed::engine::{self, Options, Outcome};
use foveate_embed::rig::{self, Overrides};
use foveate_pan_tilt::line_traffic::{Direction, LinePiece, LineTraffic};
use foveate_sim::head::HeadMotion;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Settings of [`Orders`].
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
struct OrderSettings {
    /// Time, pan, tilt, speed [s, °, °, °/s]; 999° is no number.
    go: Vec<[f64; 4]>,
    /// Time, rate of pan, rate of tilt [s, °/s, °/s].
    turn: Vec<[f64; 3]>,
    /// Time, position [s, units].
    zoom: Vec<[f64; 2]>,
}

const COMMANDS: Out<HeadCommand> = Out::new(0, "commands");

/// Gives commands at times of its settings.
struct Orders {
    camera: CameraId,
    list: Vec<(Time, HeadOrder, Option<f64>)>,
    next: usize,
}

impl Node for Orders {
    const TYPE: &'static str = "test.orders";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Commands at given times";
    type Settings = OrderSettings;

    fn ports() -> Ports {
        Ports::new().output(&COMMANDS)
    }

    fn new(settings: OrderSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let go = settings.go.iter().map(|&[at, pan, tilt, speed]| {
            let pan = if pan == 999.0 { f64::NAN } else { pan };
            let order =
                HeadOrder::Go { angles: [pan.to_radians(), tilt.to_radians()], speeds: [speed.to_radians(); 2] };
            (Time::from_s(at), order, None)
        });
        let turn = settings.turn.iter().map(|&[at, pan, tilt]| {
            (Time::from_s(at), HeadOrder::Turn { rates: [pan.to_radians(), tilt.to_radians()] }, None)
        });
        let zoom = settings
            .zoom
            .iter()
            .map(|&[at, units]| (Time::from_s(at), HeadOrder::Go { angles: [0.0; 2], speeds: [1.0; 2] }, Some(units)));
        let mut list: Vec<_> = go.chain(turn).chain(zoom).collect();
        list.sort_by_key(|it| it.0);
        Ok(Self { camera: setup.camera.unwrap_or_default(), list, next: 0 })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let (at, order, zoom) = self.list[self.next];
        self.next += 1;
        io.emit_at(&COMMANDS, at, HeadCommand { camera: self.camera, order, zoom });
        Ok(())
    }

    fn due(&mut self) -> Due {
        self.list.get(self.next).map_or(Due::Never, |it| Due::At(it.0))
    }
}

const REPORTS: In<HeadReport> = In::each(0, "reports");
const MOTION: In<HeadMotion> = In::latest(1, "motion").optional();
const FEATURES: In<Features> = In::each(2, "features").optional();
const TRAFFIC: In<LineTraffic> = In::each(3, "traffic").optional();

/// What was heard in a run.
#[derive(Default)]
pub struct Heard {
    /// When each report came, and it.
    pub reports: Vec<(Time, HeadReport)>,
    /// All events, each once.
    pub events: Vec<(Time, HeadEvent)>,
    /// Capture times and features.
    pub features: Vec<(Time, Features)>,
    pub motion: Option<HeadMotion>,
    /// When line traffic came, and it.
    pub traffic: Vec<(Time, LineTraffic)>,
    /// Each write and read at a `test.tap`.
    pub tapped: Vec<LinePiece>,
    next: u64,
}

/// Settings of [`Listener`]: none.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
struct ListenerSettings {}

struct Listener(Arc<Mutex<Heard>>);

impl Node for Listener {
    const TYPE: &'static str = "test.listener";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Keeps what it hears";
    type Settings = ListenerSettings;

    fn ports() -> Ports {
        Ports::new().input(&REPORTS).input(&MOTION).input(&FEATURES).input(&TRAFFIC)
    }

    fn new(_settings: ListenerSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Listener(Arc::default()))
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let mut heard = self.0.lock().unwrap();
        let heard = &mut *heard;
        if let Some(motion) = io.latest(&MOTION) {
            heard.motion = Some(motion.value.clone());
        }
        if let Some(report) = io.take(&REPORTS) {
            heard.events.extend(report.value.since(&mut heard.next).copied());
            heard.reports.push((io.now(), (*report.value).clone()));
        }
        if let Some(features) = io.take(&FEATURES) {
            heard.features.push((features.stamp.time, (*features.value).clone()));
        }
        if let Some(traffic) = io.take(&TRAFFIC) {
            heard.traffic.push((io.now(), (*traffic.value).clone()));
        }
        Ok(())
    }
}

const TO_HEAD: In<Line> = In::each(0, "line");
const TAPPED: Out<Line> = Out::new(0, "line");

/// Passes a line on, and keeps what goes over it.
struct Tap(Arc<Mutex<Heard>>);

/// Settings of [`Tap`]: none.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
struct TapSettings {}

impl Node for Tap {
    const TYPE: &'static str = "test.tap";
    const ROLE: Role = Role::Actuator;
    const SUMMARY: &'static str = "Keeps what goes over a line";
    type Settings = TapSettings;

    fn ports() -> Ports {
        Ports::new().input(&TO_HEAD).output(&TAPPED)
    }

    fn new(_settings: TapSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Tap(Arc::default()))
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(line) = io.take(&TO_HEAD) {
            let device = TappedDevice { device: (*line.value).clone(), heard: Arc::clone(&self.0) };
            io.emit(&TAPPED, line.stamp, Line::new(Arc::new(Mutex::new(device))));
        }
        Ok(())
    }
}

struct TappedDevice {
    device: Line,
    heard: Arc<Mutex<Heard>>,
}

impl TappedDevice {
    fn keep(&self, time: Time, direction: Direction, bytes: &[u8]) {
        if !bytes.is_empty() {
            self.heard.lock().unwrap().tapped.push(LinePiece { time, direction, bytes: bytes.to_vec() });
        }
    }
}

impl Device for TappedDevice {
    fn write(&mut self, now: Time, bytes: &[u8]) {
        self.keep(now, Direction::Sent, bytes);
        self.device.device().write(now, bytes);
    }

    fn read(&mut self, now: Time, bytes: &mut Vec<u8>) {
        let known = bytes.len();
        self.device.device().read(now, bytes);
        self.keep(now, Direction::Received, &bytes[known..]);
    }

    fn has_datagrams(&self) -> bool {
        self.device.device().has_datagrams()
    }
}

/// A rig with a head under the camera `wide-3`; `rest` is more nodes, and connections.
pub fn rig_text(duration_s: f64, orders: &str, head: &str, rest: &str) -> String {
    format!(
        r#"
        [rig]
        name = "head-test"
        calibration = "ideal_lab.calibration.toml"
        seed = 7
        duration_s = {duration_s}

        [scale.room.node.orders]
        type = "test.orders"
        camera = "wide-3"
        {orders}

        [scale.room.node.head]
        type = "pan_tilt.head"
        camera = "wide-3"
        {head}

        {rest}
        "#
    )
}

/// What connects a simulated head, with its settings.
pub fn simulated(settings: &str) -> String {
    format!(
        r#"
        [scale.room.node.device]
        type = "sim.head"
        camera = "wide-3"
        {settings}

        [scale.room.node.listener]
        type = "test.listener"
        camera = "wide-3"
        in = {{ reports = "head.report", motion = "device.motion" }}
        "#
    )
}

/// The connections of the head to orders and simulated line.
pub const WIRED: &str = r#"in = { commands = "orders.commands", line = "device.line" }"#;

/// The checked rig, or what is wrong with it.
pub fn load(text: &str) -> Result<(foveate_embed::rig::graph::Graph, Arc<Mutex<Heard>>), String> {
    let heard: Arc<Mutex<Heard>> = Arc::default();
    let mut registry = Registry::new();
    foveate_sim::register(&mut registry);
    foveate_pan_tilt::register(&mut registry);
    registry.add::<Orders>();
    let ears = Arc::clone(&heard);
    registry.add_with::<Listener>(move |_, _| Ok(Listener(Arc::clone(&ears))));
    let ears = Arc::clone(&heard);
    registry.add_with::<Tap>(move |_, _| Ok(Tap(Arc::clone(&ears))));
    let path = foveate_testkit::data::workspace_root().join("graphs/head-test.toml");
    let graph = rig::load(text, &path, &registry, &Overrides::default()).map_err(|faults| faults.to_string())?;
    Ok((graph, heard))
}

/// Runs on the logical clock.
#[track_caller]
pub fn run_rig(text: &str) -> (Outcome, Heard) {
    let (graph, heard) = load(text).unwrap_or_else(|faults| panic!("{faults}"));
    let outcome = engine::deterministic(Arc::new(graph), &Options::default(), &mut |_| ()).unwrap();
    let heard = std::mem::take(&mut *heard.lock().unwrap());
    (outcome, heard)
}
