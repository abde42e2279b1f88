//! Four people who draw on a wall, as targets: the real events, page, TUIO and server behind them, on a run that keeps to the clock on the wall.

use std::f64::consts::TAU;
use std::path::Path;
use std::sync::atomic::Ordering;
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use foveate::node::Pages;
use foveate::prelude::*;
use foveate_embed::engine::{self, Options, Outcome};
use foveate_embed::rig::{self, Overrides};
use foveate_web::{Counts, Server};
use nalgebra::{Matrix6, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Of the wall [m].
pub const WALL: [f64; 2] = [4.0, 2.0];
/// Each person draws a circle of this radius [m] around this place [m], once in so many seconds.
pub const RADIUS: f64 = 0.35;
pub const CENTRES: [[f64; 2]; 4] = [[0.5, 0.5], [1.5, 1.3], [2.5, 0.6], [3.4, 1.4]];
pub const ROUND_S: f64 = 2.0;
/// Pictures a second.
const RATE_HZ: f64 = 120.0;

/// Where person number `index` points after `time_s`.
pub fn place(index: usize, time_s: f64) -> [f64; 2] {
    let angle = TAU * time_s / ROUND_S + index as f64;
    let [x, y] = CENTRES[index];
    [x + RADIUS * angle.cos(), y + RADIUS * angle.sin()]
}

/// The people.
struct People {
    next: i64,
}

#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
struct Nothing {}

ports! {
    pub(crate) fn ports_of_people;
    TARGETS: Out<Targets> = "targets";
}

impl Node for People {
    const TYPE: &'static str = "test.people";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Four people who draw";
    type Settings = Nothing;

    fn ports() -> Ports {
        ports_of_people()
    }

    fn new(_: Nothing, _: &Setup) -> Result<Self, ConfigError> {
        Ok(People { next: 0 })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let time = self.at();
        let person = |index: usize| {
            let [x, y] = place(index, time.as_s());
            let [u, v] = place(index, time.as_s() + 1e-3);
            Target {
                id: TargetId(index as u32 + 1),
                position: Point3::new(x, y, 0.0),
                velocity: Vector3::new((u - x) * 1e3, (v - y) * 1e3, 0.0),
                covariance: Matrix6::identity() * 1e-6,
                cameras: CameraSet::default(),
                provenance: Provenance::Measured,
            }
        };
        io.emit_at(&TARGETS, time, Targets { time, list: (0..4).map(person).collect() });
        self.next += 1;
        Ok(())
    }

    fn due(&mut self) -> Due {
        Due::At(self.at())
    }
}

impl People {
    fn at(&self) -> Time {
        Time::from_s(self.next as f64 / RATE_HZ)
    }
}

/// A run that goes on, and the address of its page.
pub struct Running {
    pub address: String,
    pub server: Arc<Server>,
    options: Options,
    thread: JoinHandle<Outcome>,
}

/// Starts a run that sends TUIO to `tuio` and serves at `listen`.
pub fn run(tuio: &str, listen: &str) -> Running {
    let mut registry = Registry::new();
    foveate_laser_pointer::register(&mut registry);
    registry.add::<People>();
    let [width, height] = WALL;
    let text = format!(
        "[rig]\nname = \"drawing\"\n[scale.wall]\nvolume_m = {{ min = [0, 0, -0.1], max = [{width}, {height}, 0.1] }}\n[scale.wall.node]\n\
         people = {{ type = \"test.people\" }}\n\
         events = {{ type = \"laser_pointer.events\", in = {{ targets = \"people.targets\" }} }}\n\
         page = {{ type = \"laser_pointer.page\", in = {{ pointers = \"events.pointers\" }} }}\n\
         tuio = {{ type = \"laser_pointer.tuio\", in = {{ pointers = \"events.pointers\" }}, to = [\"{tuio}\"] }}\n"
    );
    let graph = rig::load(&text, Path::new("rig.toml"), &registry, &Overrides::default());
    let mut graph = graph.unwrap_or_else(|faults| panic!("{}", faults.render(false)));
    let (tell, told) = channel();
    let tell = Mutex::new(tell);
    let server = Arc::new(Server::new(listen.parse().unwrap(), move |_, address| {
        drop(tell.lock().unwrap().send(address.to_owned()));
    }));
    graph.pages = Pages::served_by(Arc::<Server>::clone(&server));
    let options = Options { paced: true, ..Options::default() };
    let own = options.clone();
    let thread = std::thread::spawn(move || engine::deterministic(Arc::new(graph), &own, &mut |_| {}).unwrap());
    Running { address: told.recv_timeout(Duration::from_secs(60)).unwrap(), server, options, thread }
}

impl Running {
    /// Ends the run and the server.
    pub fn end(self) -> (Outcome, Counts) {
        self.options.stop.store(true, Ordering::Relaxed);
        let outcome = self.thread.join().unwrap();
        (outcome, self.server.end())
    }
}
