//! The console's thread: it answers windows, and sends them what they look at.

mod by_hand;
mod changes;
mod time;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use foveate_engine::Progress;
use foveate_engine::controls::Controls;
use foveate_engine::look::Look;
use foveate_messages::{Interval, Time};
use foveate_node::Role;
use foveate_node::given::Table;
use foveate_node::guard::guarded;
use foveate_node::page::{Client, PageEvent, PageLink, PageNews};
use foveate_node::setting_docs::setting_docs;
use foveate_rig::graph::Graph;
use serde_json::{Value, json};

use self::by_hand::Marks;
use self::changes::{Asked, settings_message};
use crate::commands::{self, Command};
use crate::console::{Mode, Opening, Record};
use crate::hello::{self, Index};
use crate::marks::{self, Rows};
use crate::source::{Playing, Source};
use crate::state::{About, State, lock};
use crate::view;
use crate::window::Window;

/// How often windows are looked after.
const PERIOD: Duration = Duration::from_millis(15);
/// The same while none is open.
const IDLE_PERIOD: Duration = Duration::from_millis(100);
/// How often windows learn the state of the run.
const STATE_PERIOD: Duration = Duration::from_millis(250);
/// Windows at once; more are refused.
const MOST_WINDOWS: usize = 32;
/// A step of a rig whose sources do not say how often they give pictures [s].
const STEP_S: f64 = 1.0 / 30.0;

/// The console's thread.
pub(crate) struct Desk {
    link: Box<dyn PageLink>,
    graph: Arc<Graph>,
    index: Index,
    source: Source,
    controls: Controls,
    state: Arc<Mutex<State>>,
    /// A run on a logical clock or a session, which can wait.
    can_wait: bool,
    record: Option<Box<Record>>,
    /// The file that is being recorded.
    recording: Option<String>,
    rig: Option<PathBuf>,
    stop: Arc<AtomicBool>,
    out_dir: Option<PathBuf>,
    /// What a window learns first, but for values of settings that have changed since.
    hello: Value,
    windows: Vec<Window>,
    asked: Vec<Asked>,
    marks: Marks,
    /// By node: settings that have changed since the rig was saved.
    changed: BTreeMap<usize, Table>,
    step: Interval,
    next_state: Instant,
    /// Messages are due at multiples of their periods since then.
    epoch: Instant,
}

impl Desk {
    pub(crate) fn new(
        opening: Opening,
        link: Box<dyn PageLink>,
        look: Look,
        controls: Controls,
        state: Arc<Mutex<State>>,
    ) -> Desk {
        let Opening { graph, rig, mode, stop, out_dir, again, record } = opening;
        let index = Index::of(&graph);
        let rows = Rows::of(&graph, &index);
        let file = match &mode {
            Mode::Session(glance) => Some(glance.path().with_extension("corrections.csv")),
            _ => out_dir.as_ref().map(|it| it.join("corrections.csv")),
        };
        let mut hello = hello::of_graph(&graph, &index);
        let (mode_name, can_wait) = (mode.name(), !matches!(mode, Mode::Live));
        let source = match mode {
            Mode::Session(glance) => {
                lock(&state).progress =
                    Some(Progress { now: glance.span()[0], wall: Duration::ZERO, edges: glance.edges(&graph) });
                Source::Session(Box::new(Playing::new(*glance, Instant::now())))
            }
            Mode::Simulated | Mode::Live => Source::Run(look),
        };
        let is_session = matches!(source, Source::Session(_));
        let takes_rows = |(_, instances): &(String, Vec<usize>)| {
            let docs = setting_docs(&graph.instances[instances[0]].node_type);
            docs.iter().any(|it| it.name == marks::SETTING && it.is_live)
        };
        let can_correct = index.nodes.iter().any(takes_rows) && (!is_session || again.is_some());
        let can = json!({
            "pause": can_wait, "step": can_wait, "seek": is_session, "loop": is_session, "speed": is_session, "save": rig.is_some(),
            "set": !is_session, "record": record.is_some(), "correct": can_correct, "bookmark": out_dir.is_some(), "stop": !is_session,
        });
        let path = rig.as_ref().map(|it| it.display().to_string());
        let duration_s = graph.duration.map(|it| it.as_s());
        let about =
            json!({ "name": graph.name, "path": path, "mode": mode_name, "duration_s": duration_s, "can": can });
        hello.insert("rig".to_owned(), about);
        hello.insert("say".to_owned(), "hello".into());
        hello.insert("version".to_owned(), 1.into());
        let sources = graph.instances.iter().filter(|it| it.node_type.role == Role::Source);
        let fastest = sources.filter_map(|it| it.settings.plan().rate_hz).fold(0.0, f64::max);
        let step = Interval::from_ms(1e3 * if fastest > 0.0 { 1.0 / fastest } else { STEP_S });
        Desk {
            link,
            graph,
            index,
            source,
            controls,
            state,
            can_wait,
            record,
            recording: None,
            rig,
            stop,
            out_dir,
            hello: Value::Object(hello),
            windows: Vec::new(),
            asked: Vec::new(),
            marks: Marks { rows, file, again, work: None, sheet: json!({ "problems": [], "searching": false }) },
            changed: BTreeMap::new(),
            step,
            next_state: Instant::now(),
            epoch: Instant::now(),
        }
    }

    pub(crate) fn work(mut self, is_over: &AtomicBool) {
        while !is_over.load(Ordering::Relaxed) {
            while let Some(event) = self.link.take() {
                self.hear(event);
            }
            self.settle();
            self.take_work();
            let now = Instant::now();
            if let Source::Session(playing) = &mut self.source {
                playing.go_on(now);
                if let Some(progress) = &mut lock(&self.state).progress {
                    progress.now = playing.at();
                }
            }
            self.show();
            if now >= self.next_state && !self.windows.is_empty() {
                self.next_state = now + STATE_PERIOD;
                self.tell_state();
            }
            if self.recording.is_some() && lock(&self.state).is_finished {
                drop(self.record(false));
            }
            std::thread::sleep(if self.windows.is_empty() && self.asked.is_empty() { IDLE_PERIOD } else { PERIOD });
        }
        // A program that ends at once leaves no recording without its end.
        if self.recording.is_some() {
            drop(self.record(false));
        }
    }

    fn hear(&mut self, PageEvent { client, what, .. }: PageEvent) {
        match what {
            PageNews::Opened if self.windows.len() >= MOST_WINDOWS => {
                let words = format!("{MOST_WINDOWS} windows show this console already; close one");
                self.link.send(client, &json!({ "say": "refused", "words": words }).to_string());
            }
            PageNews::Opened => {
                self.windows.push(Window { client, wants: Vec::new(), sheets: BTreeMap::new() });
                self.link.send(client, &self.hello.to_string());
                for (&node, values) in &self.changed {
                    self.link.send(client, &settings_message(node, values));
                }
                self.next_state = Instant::now();
            }
            PageNews::Closed(_) => {
                self.windows.retain(|it| it.client != client);
            }
            PageNews::Text(text) => match commands::read(&text, self.index.topics.len(), self.index.nodes.len()) {
                Ok((command, number)) => self.obey(client, command, number),
                Err((what, number)) => self.answer(client, number, Err(what)),
            },
        }
    }

    fn obey(&mut self, client: Client, command: Command, number: Option<i64>) {
        let outcome = match command {
            Command::Subscribe(wants) => {
                if let Some(window) = self.windows.iter_mut().find(|it| it.client == client) {
                    window.wants = wants;
                }
                Ok(String::new())
            }
            Command::Set { node, values } => match self.set(client, node, values, number) {
                Ok(()) => return,
                Err(what) => Err(what),
            },
            Command::Save => self.save(),
            Command::Time(it) => self.turn(it),
            Command::Stop => {
                self.stop.store(true, Ordering::Relaxed);
                Ok("the run ends; its results are written".to_owned())
            }
            Command::Correct { node, rows } => match self.correct(client, node, &rows, number) {
                Ok(None) => return,
                Ok(Some(words)) => Ok(words),
                Err(what) => Err(what),
            },
            Command::Again => self.again(),
            Command::Problems { node } => self.problems(node),
            Command::Record(is_on) => self.record(is_on),
            Command::Bookmark { at_s, note } => self.note(at_s, &note),
        };
        self.next_state = Instant::now();
        self.answer(client, number, outcome);
    }

    fn now(&self) -> Time {
        lock(&self.state).progress.as_ref().map_or(Time::ZERO, |it| it.now)
    }

    fn answer(&mut self, client: Client, number: Option<i64>, outcome: Result<String, String>) {
        if number.is_none() && outcome.is_ok() {
            return;
        }
        let (is_ok, words) = outcome.map_or_else(|what| (false, what), |words| (true, words));
        self.link.send(client, &json!({ "say": "answer", "n": number, "ok": is_ok, "words": words }).to_string());
    }

    /// Sends each window what it looks at and is due; what several look at is made once.
    fn show(&mut self) {
        let now = Instant::now();
        let mut made: BTreeMap<(usize, view::Kind), Option<Vec<u8>>> = BTreeMap::new();
        for window in &mut self.windows {
            let mut messages = Vec::new();
            for want in window.wants.iter_mut().filter(|it| it.is_due(now)) {
                let (instance, port) = self.index.topics[want.topic];
                let packet = self.source.newest((instance, port));
                let Some(packet) = packet.filter(|it| want.is_news(it)) else { continue };
                let message = &self.graph.instances[instance].node_type.ports.outputs[port].message;
                let bytes = made.entry((want.topic, want.kind)).or_insert_with(|| {
                    guarded(|| view::view(want.topic as u32, message, &packet, want.kind)).ok().flatten()
                });
                if let Some(bytes) = bytes {
                    messages.push((want.slot(), bytes.clone()));
                }
                want.send(&packet, now, self.epoch);
            }
            if !messages.is_empty() {
                self.link.send_latest(window.client, messages);
            }
        }
    }

    fn tell_state(&mut self) {
        let about = About {
            is_held: match &self.source {
                Source::Session(playing) => playing.is_standing(),
                Source::Run(_) => self.controls.until().is_some(),
            },
            viewers: self.windows.len(),
            unsaved: self.unsaved(),
            recording: self.recording.clone(),
            playing: match &self.source {
                Source::Session(it) => Some((it.span(), it.repeats, it.speed)),
                Source::Run(_) => None,
            },
        };
        let message = lock(&self.state).message(&about);
        for window in &mut self.windows {
            self.link.send(window.client, &message);
            for (name, (number, sheet)) in &lock(&self.state).sheets {
                if window.sheets.get(name) != Some(number) && self.link.send(window.client, sheet) {
                    window.sheets.insert(name.clone(), *number);
                }
            }
        }
    }
}
