//! The line that shows where a run is: time, rates, targets, unmet requirements.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{IsTerminal, Write};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use foveate_calibration::words::counted;
use foveate_engine::Progress;
use foveate_messages::CameraId;
use foveate_rig::graph::Graph;

/// Without a terminal, one line per interval.
const PLAIN_PERIOD: Duration = Duration::from_secs(5);

/// A head or a camera without messages for this long counts as away [s].
const QUIET_S: f64 = 2.0;

/// Shows progress on standard error: one line that is rewritten on a terminal, a line now and then elsewhere.
pub struct Line {
    duration_s: Option<f64>,
    /// By edge: what it carries.
    kinds: Vec<Kind>,
    /// How many cameras the sources of the rig serve.
    n_cameras: usize,
    /// By edge: how many messages there were, and the session time at which that had grown last [s].
    heard: Vec<(u64, f64)>,
    is_terminal: bool,
    last_plain: Instant,
    shown: bool,
}

/// A camera, or a source that serves none by itself (a table of detections of several cameras).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Eye {
    Camera(CameraId),
    Source(usize),
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Seen(Eye),
    Targets,
    Heads,
    Other,
}

/// What a line on standard error begins with while another one may stand there that is rewritten.
pub fn line_start() -> &'static str {
    if std::io::stderr().is_terminal() { "\r\x1b[2K" } else { "" }
}

impl Line {
    /// For runs of `graph`.
    pub fn new(graph: &Graph) -> Self {
        let mut heads = BTreeSet::new();
        let kinds = graph.edges.iter().map(|edge| {
            let producer = &graph.instances[edge.from.0].node_type;
            if producer.role == foveate_node::Role::Actuator
                && heads.insert(edge.from.0)
                && producer.ports.outputs[edge.from.1].message.name == "head_report"
            {
                return Kind::Heads;
            }
            if edge.feedback {
                return Kind::Other;
            }
            match (producer.ports.outputs[edge.from.1].message.name, producer.role) {
                ("image" | "features", foveate_node::Role::Source) => {
                    let camera = graph.instances[edge.from.0].camera;
                    Kind::Seen(camera.map_or(Eye::Source(edge.from.0), Eye::Camera))
                }
                ("targets", foveate_node::Role::Integrator) => Kind::Targets,
                _ => Kind::Other,
            }
        });
        let kinds: Vec<Kind> = kinds.collect();
        let eyes: BTreeSet<Eye> =
            kinds.iter().filter_map(|it| if let Kind::Seen(eye) = it { Some(*eye) } else { None }).collect();
        Self {
            // (Divided, so that 30 s are not 30.000000000000004 s.)
            duration_s: graph.duration.map(|it| it.0 as f64 / 1e9),
            kinds,
            n_cameras: eyes.len(),
            heard: vec![(0, 0.0); graph.edges.len()],
            is_terminal: std::io::stderr().is_terminal(),
            last_plain: Instant::now(),
            shown: false,
        }
    }

    /// Shows `progress`.
    pub fn show(&mut self, progress: &Progress) {
        let text = self.text(progress);
        let mut err = std::io::stderr().lock();
        if self.is_terminal {
            self.shown = true;
            drop(write!(err, "\r\x1b[2K{text}").and_then(|()| err.flush()));
        } else if self.last_plain.elapsed() >= PLAIN_PERIOD {
            self.last_plain = Instant::now();
            drop(writeln!(err, "{text}"));
        }
    }

    /// Clears the line.
    pub fn end(&self) {
        if self.shown {
            eprint!("\r\x1b[2K");
        }
    }

    fn text(&mut self, progress: &Progress) -> String {
        let now = progress.now.as_s();
        let (mut targets, mut unmet) = (None, 0);
        let (mut heads, mut away) = (0, 0);
        // Several edges may carry the pictures of one camera: they count once.
        let mut rates: BTreeMap<Eye, f64> = BTreeMap::new();
        for ((kind, edge), heard) in self.kinds.iter().zip(&progress.edges).zip(&mut self.heard) {
            unmet += usize::from(edge.unmet);
            if matches!(kind, Kind::Seen(_) | Kind::Heads) && edge.delivered != heard.0 {
                *heard = (edge.delivered, now);
            }
            match kind {
                Kind::Seen(eye) if edge.delivered > 0 && now - heard.1 <= QUIET_S => {
                    let rate = rates.entry(*eye).or_default();
                    *rate = rate.max(edge.rate_hz.unwrap_or(0.0));
                }
                Kind::Seen(_) => {}
                Kind::Targets => targets = targets.max(edge.count),
                Kind::Heads => {
                    heads += 1;
                    away += usize::from(now - heard.1 > QUIET_S);
                }
                Kind::Other => {}
            }
        }
        // The sum of nothing is -0.
        let images = rates.values().sum::<f64>() + 0.0;
        let (seeing, cameras) = (rates.len(), self.n_cameras);
        let of = if seeing == cameras { String::new() } else { format!("{seeing} of ") };
        let cameras = of + &counted(cameras, "camera");
        let whole = self.duration_s.map_or(String::new(), |it| format!(" of {it}"));
        let speed = now / progress.wall.as_secs_f64().max(1e-3);
        let targets = targets.map_or(String::new(), |it| format!("   {}", counted(it as usize, "target")));
        let heads = match away {
            0 => String::new(),
            _ => format!("   {away} of {heads} heads silent"),
        };
        let unmet = if unmet == 0 { String::new() } else { format!("   {unmet} requirements unmet") };
        format!("{now:7.1}{whole} s   {speed:.1}× real time   {cameras}, {images:.0} frames/s{targets}{heads}{unmet}")
    }
}

/// Shows on standard error that something takes its time, and how long already, until it is dropped.
pub struct Waiting(Option<(Sender<()>, JoinHandle<()>)>);

/// On a terminal the seconds are counted.
const TICK: Duration = Duration::from_secs(1);
/// Elsewhere one line in so long.
const PLAIN_TICK: Duration = Duration::from_secs(10);

impl Waiting {
    /// From now on, for `what`; shows nothing where `quiet`.
    pub fn new(what: &'static str, quiet: bool) -> Self {
        let (done, over) = mpsc::channel();
        let show = move || {
            let (is_terminal, begun) = (std::io::stderr().is_terminal(), Instant::now());
            let say = |text: &str| drop(std::io::stderr().lock().write_all(text.as_bytes()));
            let (tick, again, end) = if is_terminal { (TICK, "\r\x1b[2K", "") } else { (PLAIN_TICK, "", "\n") };
            say(&format!("{what} …{end}"));
            while over.recv_timeout(tick) == Err(RecvTimeoutError::Timeout) {
                say(&format!("{again}{what} … {} s{end}", begun.elapsed().as_secs()));
            }
            if is_terminal {
                say("\n");
            }
        };
        // Without a thread it is waited for in silence.
        let thread = if quiet { None } else { thread::Builder::new().spawn(show).ok() };
        Self(thread.map(|it| (done, it)))
    }
}

impl Drop for Waiting {
    fn drop(&mut self) {
        if let Some((done, thread)) = self.0.take() {
            drop(done);
            drop(thread.join());
        }
    }
}
