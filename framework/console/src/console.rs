//! The console as a program sees it.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use foveate_engine::Progress;
use foveate_engine::controls::{Change, Controls};
use foveate_engine::look::Look;
use foveate_messages::{Interval, Time};
use foveate_node::Role;
use foveate_node::given::Table;
use foveate_node::page::{Client, PageEvent, PageLink, PageNews};
use foveate_node::setting_docs::setting_docs;
use foveate_rig::graph::Graph;
use foveate_rig::live;
use foveate_session::glance::Glance;
use serde_json::{Value, json};

use crate::commands::{self, Command, TimeCommand};
use crate::hello::{self, Index};
use crate::marks::{self, Row, Rows};
use crate::page;
use crate::settings::{self, Changed, in_json};
use crate::source::{Playing, Source};
use crate::state::{About, State};
use crate::view;
use crate::window::Window;

/// How often windows are looked after.
const PERIOD: Duration = Duration::from_millis(15);
/// The same while none is open.
const IDLE_PERIOD: Duration = Duration::from_millis(100);
/// How often windows learn the state of the run.
const STATE_PERIOD: Duration = Duration::from_millis(250);
/// A change of settings that no worker has made by then is said to have come too late.
const PATIENCE: Duration = Duration::from_secs(5);
/// Windows at once; more are refused.
const MOST_WINDOWS: usize = 32;
/// A step of a rig whose sources do not say how often they give pictures [s].
const STEP_S: f64 = 1.0 / 30.0;

/// What is shown.
pub enum Mode {
    /// A run on a logical clock.
    Simulated,
    /// A run on the wall clock.
    Live,
    /// A recording that is run again.
    Replayed,
    /// A recording that is looked at.
    Session(Box<Glance>),
}

impl Mode {
    fn name(&self) -> &'static str {
        match self {
            Mode::Simulated => "simulated",
            Mode::Live => "live",
            Mode::Replayed => "replayed",
            Mode::Session(_) => "session",
        }
    }
}

/// What a console is opened on.
pub struct Opening {
    /// The rig.
    pub graph: Arc<Graph>,
    /// Its file, into which settings are saved; `None`: there is none.
    pub rig: Option<PathBuf>,
    /// How it runs.
    pub mode: Mode,
    /// Set to end what is shown.
    pub stop: Arc<AtomicBool>,
    /// Folder of the results, where notes are kept.
    pub out_dir: Option<PathBuf>,
    /// Of a session: tracks it again with corrections by hand.
    pub again: Option<Arc<Again>>,
    /// Of a run: begins a recording at a session time, or ends it.
    pub record: Option<Box<Record>>,
}

/// Begins a recording at this session time and gives its file; `None`: ends it, and gives a sentence about it.
pub type Record = dyn FnMut(Option<Time>) -> Result<String, String> + Send;

/// Makes a session again in which nodes, by their names, have these settings; gives a look into what was made.
pub type Again = dyn Fn(&[(String, Table)]) -> Result<Glance, String> + Send + Sync;

/// A console that is open. It ends with this.
pub struct Console {
    look: Look,
    controls: Controls,
    state: Arc<Mutex<State>>,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    address: String,
}

impl Console {
    /// Opens the page `/console/` on the server of the graph's pages.
    ///
    /// # Errors
    /// A sentence: nothing serves pages, or no address to serve at.
    pub fn open(opening: Opening) -> Result<Console, String> {
        let link = opening.graph.pages.open("console", page::page())?.ok_or("this run serves no pages")?;
        let (look, controls) = (Look::new(&opening.graph), Controls::default());
        let (state, is_over) = (Arc::<Mutex<State>>::default(), Arc::<AtomicBool>::default());
        let address = link.address();
        let desk = Desk::new(opening, link, look.clone(), controls.clone(), Arc::clone(&state));
        let over = Arc::clone(&is_over);
        let thread = std::thread::Builder::new().name("console".to_owned()).spawn(move || desk.work(&over));
        let thread = thread.map_err(|error| format!("the console cannot be opened: {error}"))?;
        Ok(Console { look, controls, state, is_over, thread: Some(thread), address })
    }

    /// Where people open it, without any secret.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// What the run shows itself to.
    pub fn look(&self) -> Look {
        self.look.clone()
    }

    /// What the run is controlled by.
    pub fn controls(&self) -> Controls {
        self.controls.clone()
    }

    /// The run has come so far.
    pub fn advance(&self, progress: &Progress) {
        lock(&self.state).advance(progress);
    }

    /// Takes a failure of a node, as [`Host::new`](foveate_node::Host::new) gives it.
    pub fn on_fault(&self) -> impl Fn(&str, &str) + Send + Sync + use<> {
        let state = Arc::clone(&self.state);
        move |who, what| lock(&state).fail(who, what)
    }

    /// Shows something of the program's own beside the run, such as how far a calibration is: a value that the view of that name knows.
    pub fn show(&self, name: &str, value: &Value) {
        lock(&self.state).show(name, value);
    }

    /// The run is over; its last state stays.
    pub fn finish(&self) {
        lock(&self.state).is_finished = true;
    }
}

impl Drop for Console {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            drop(thread.join());
        }
    }
}

fn lock<T>(it: &Mutex<T>) -> MutexGuard<'_, T> {
    it.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What one change of settings has come to.
struct Asked {
    client: Client,
    number: Option<i64>,
    node: usize,
    values: Table,
    /// Instances that have not answered yet.
    waiting: usize,
    refused: Option<String>,
    until: Instant,
    answers: Receiver<Result<(), String>>,
}

/// Corrections by hand, and what is done about them beside the console's thread.
struct Marks {
    rows: Rows,
    /// Where the rows are written.
    file: Option<PathBuf>,
    again: Option<Arc<Again>>,
    /// What a thread is at.
    work: Option<Receiver<Done>>,
    /// What the page shows of it.
    sheet: Value,
}

/// What a thread has done.
enum Done {
    Problems(usize, Vec<Value>),
    Again(Result<Box<Glance>, String>),
}

/// The console's thread.
struct Desk {
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
    fn new(
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
            Mode::Simulated | Mode::Live | Mode::Replayed => Source::Run(look),
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
        hello.insert("may_change".to_owned(), true.into());
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

    fn work(mut self, is_over: &AtomicBool) {
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

    /// Begins a recording, or ends it.
    fn record(&mut self, is_on: bool) -> Result<String, String> {
        let now = self.now();
        let record = self.record.as_mut().ok_or("nothing can be recorded here")?;
        match (is_on, self.recording.is_some()) {
            (true, true) => return Err("it is recorded already".to_owned()),
            (false, false) => return Err("nothing is being recorded".to_owned()),
            _ => {}
        }
        if is_on {
            let path = record(Some(now))?;
            let words = format!("recording to {path}");
            self.recording = Some(path);
            return Ok(words);
        }
        self.recording = None;
        record(None)
    }

    /// Does what a page wants of time.
    fn turn(&mut self, command: TimeCommand) -> Result<String, String> {
        if !self.can_wait {
            return Err("a live run cannot wait".to_owned());
        }
        let now = Instant::now();
        let Source::Session(playing) = &mut self.source else {
            let until = match command {
                TimeCommand::Pause => Some(self.now()),
                TimeCommand::Go => None,
                TimeCommand::Step { is_forward: true } => {
                    let from = self.controls.held().unwrap_or_else(|| self.now());
                    Some(from + self.step - Interval(1))
                }
                _ => return Err("a run only goes forwards; record it, and look at the session".to_owned()),
            };
            self.controls.go_until(until);
            return Ok(String::new());
        };
        match command {
            TimeCommand::Pause => playing.play(false, now),
            TimeCommand::Go => playing.play(true, now),
            TimeCommand::Step { is_forward } => playing.step(is_forward),
            TimeCommand::Seek(to) => playing.seek(to),
            TimeCommand::Repeat(part) => playing.repeat(part)?,
            TimeCommand::Speed(factor) => playing.set_speed(factor),
        }
        Ok(String::new())
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

    /// Lets all instances of a node take other settings; the answer follows when they have.
    fn set(&mut self, client: Client, node: usize, values: Table, number: Option<i64>) -> Result<(), String> {
        if matches!(self.source, Source::Session(_)) {
            return Err("a recording keeps its settings; `foveate replay --set` runs it with others".to_owned());
        }
        let instances = self.index.nodes[node].1.clone();
        let first = &self.graph.instances[instances[0]];
        live::changed(first, &*first.settings, &values).map_err(|it| in_words(&it.setting, &it.message))?;
        let (answer, answers): (Sender<Result<(), String>>, _) = channel();
        for &instance in &instances {
            let answer = answer.clone();
            let done = Box::new(move |it| drop(answer.send(it)));
            self.controls.change(Change { instance, values: values.clone(), done })?;
        }
        let (waiting, until) = (instances.len(), Instant::now() + PATIENCE);
        self.asked.push(Asked { client, number, node, values, waiting, refused: None, until, answers });
        Ok(())
    }

    /// Answers changes of settings that all instances have taken, or one has refused.
    fn settle(&mut self) {
        let now = Instant::now();
        let mut rest = Vec::new();
        for mut it in std::mem::take(&mut self.asked) {
            while let Ok(answer) = it.answers.try_recv() {
                it.waiting -= 1;
                it.refused = it.refused.or(answer.err());
            }
            if it.waiting > 0 && now < it.until {
                rest.push(it);
                continue;
            }
            let outcome = match it.refused {
                Some(what) => Err(what),
                None if it.waiting > 0 => Err("the run has not come to it yet".to_owned()),
                None => {
                    self.changed.entry(it.node).or_default().extend(it.values.clone());
                    let message = settings_message(it.node, &it.values);
                    for window in &self.windows {
                        self.link.send(window.client, &message);
                    }
                    Ok("changed".to_owned())
                }
            };
            self.next_state = now;
            self.answer(it.client, it.number, outcome);
        }
        self.asked = rest;
    }

    /// Scale and node, and the names of their settings that the rig file does not have yet.
    fn unsaved(&self) -> Vec<String> {
        let names = |(node, values): (&usize, &Table)| {
            let node = self.index.nodes[*node].0.clone();
            values.keys().map(move |it| format!("{node}.{it}")).collect::<Vec<_>>()
        };
        self.changed.iter().flat_map(names).collect()
    }

    fn save(&mut self) -> Result<String, String> {
        let path = self.rig.as_ref().ok_or("there is no rig file to save to")?;
        let mut changed = Vec::new();
        for (node, values) in &self.changed {
            let first = &self.graph.instances[self.index.nodes[*node].1[0]];
            let node = [self.graph.scales[first.scale].name.clone(), first.node.clone()];
            let of_node = values.iter().map(|(name, value)| Changed {
                node: node.clone(),
                name: name.clone(),
                value: value.clone(),
            });
            changed.extend(of_node);
        }
        if changed.is_empty() {
            return Err("nothing has changed".to_owned());
        }
        settings::save(path, &changed)?;
        let words = format!("saved {} settings to {}", changed.len(), path.display());
        // Windows that open later learn the values all the same.
        for (node, values) in std::mem::take(&mut self.changed) {
            self.remember(node, &values);
        }
        Ok(words)
    }

    /// Puts values into what windows learn first.
    fn remember(&mut self, node: usize, values: &Table) {
        let settings = self.hello["nodes"][node]["settings"].as_array_mut();
        for it in settings.into_iter().flatten() {
            let value = it["name"].as_str().and_then(|name| in_json(values).get(name).cloned());
            if let Some(value) = value {
                it["value"] = value;
            }
        }
    }

    /// Corrects marks of a node by hand; in a run the answer follows when its tracker has taken the rows.
    fn correct(
        &mut self,
        client: Client,
        node: usize,
        rows: &[Value],
        number: Option<i64>,
    ) -> Result<Option<String>, String> {
        let n_cameras = self.graph.calibration.cameras.len();
        let mut new = self.marks.rows.clone();
        for it in rows {
            let (row, is_removed) = Row::read(node, it, n_cameras)?;
            new.put(row, is_removed);
        }
        if let Source::Run(_) = self.source {
            self.set(client, node, new.setting(node), number)?;
            self.keep_rows(new)?;
            return Ok(None);
        }
        let words = self.keep_rows(new)?;
        Ok(Some(words))
    }

    fn keep_rows(&mut self, rows: Rows) -> Result<String, String> {
        self.marks.rows = rows;
        self.show_marks();
        let Some(file) = &self.marks.file else { return Ok(String::new()) };
        self.marks.rows.write(file)?;
        Ok(format!("written to {}", file.display()))
    }

    /// Tracks a session again with the rows, beside the console's thread.
    fn again(&mut self) -> Result<String, String> {
        let again = self.marks.again.clone().ok_or("only a session can be tracked again")?;
        if self.marks.work.is_some() {
            return Err("it is at work already".to_owned());
        }
        let nodes = self.marks.rows.nodes();
        if nodes.is_empty() {
            return Err("there are no corrections".to_owned());
        }
        let settings: Vec<(String, Table)> =
            nodes.iter().map(|it| (self.index.nodes[*it].0.clone(), self.marks.rows.setting(*it))).collect();
        self.begin(move || {
            let made = foveate_node::guard::guarded(|| again(&settings)).unwrap_or_else(Err);
            Done::Again(made.map(Box::new))
        })?;
        self.marks.sheet["again"] = json!({ "state": "running", "words": "tracking again" });
        self.show_marks();
        Ok("tracking again".to_owned())
    }

    fn problems(&mut self, node: usize) -> Result<String, String> {
        let Source::Session(playing) = &self.source else {
            return Err("only a session can be searched; record the run, and look at the session".to_owned());
        };
        if self.marks.work.is_some() {
            return Err("it is at work already".to_owned());
        }
        let (mut glance, graph) = (playing.glance().again(&self.graph)?, Arc::clone(&self.graph));
        self.begin(move || {
            let index = Index::of(&graph);
            let found = foveate_node::guard::guarded(|| marks::problems(&mut glance, &graph, &index, node));
            Done::Problems(node, found.unwrap_or_default())
        })?;
        self.marks.sheet["searching"] = true.into();
        self.show_marks();
        Ok("searching".to_owned())
    }

    fn begin(&mut self, work: impl FnOnce() -> Done + Send + 'static) -> Result<(), String> {
        let (done, answer) = channel();
        let thread = std::thread::Builder::new().name("console marks".to_owned()).spawn(move || {
            drop(done.send(work()));
        });
        thread.map_err(|error| format!("there is no thread for it: {error}"))?;
        self.marks.work = Some(answer);
        Ok(())
    }

    /// Takes what a thread has done, if it has.
    fn take_work(&mut self) {
        let Some(done) = self.marks.work.as_ref().and_then(|it| it.try_recv().ok()) else { return };
        self.marks.work = None;
        let n_rows = self.marks.rows.list.len();
        match done {
            Done::Problems(node, found) => {
                self.marks.sheet["node"] = node.into();
                self.marks.sheet["problems"] = found.into();
                self.marks.sheet["searching"] = false.into();
            }
            Done::Again(Ok(glance)) => {
                if let Source::Session(playing) = &mut self.source {
                    playing.replace(*glance);
                }
                let words = format!(
                    "tracked again with {}",
                    if n_rows == 1 { "1 row".to_owned() } else { format!("{n_rows} rows") }
                );
                self.marks.sheet["again"] = json!({ "state": "done", "words": words });
            }
            Done::Again(Err(what)) => self.marks.sheet["again"] = json!({ "state": "failed", "words": what }),
        }
        self.show_marks();
    }

    fn show_marks(&mut self) {
        let file = self.marks.file.as_ref().map(|it| it.display().to_string());
        (self.marks.sheet["file"], self.marks.sheet["rows"]) = (json!(file), self.marks.rows.in_json());
        if self.marks.sheet["again"].is_null() {
            self.marks.sheet["again"] = json!({ "state": "idle", "words": "" });
        }
        lock(&self.state).show("marks", &self.marks.sheet);
        self.next_state = Instant::now();
    }

    fn note(&self, at_s: f64, note: &str) -> Result<String, String> {
        let folder = self.out_dir.as_ref().ok_or("there is no folder for notes")?;
        let path = folder.join("notes.csv");
        let is_new = !path.exists();
        let line = format!("{at_s:.3},\"{}\"\n", note.replace('"', "\"\"").replace(['\r', '\n'], " "));
        let written = std::fs::OpenOptions::new().create(true).append(true).open(&path).and_then(|mut file| {
            let heading = if is_new { "time_s,note\n" } else { "" };
            file.write_all(format!("{heading}{line}").as_bytes())
        });
        written.map_err(|error| format!("`{}` cannot be written: {error}", path.display()))?;
        Ok(format!("noted in {}", path.display()))
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
                    foveate_node::guard::guarded(|| view::view(want.topic as u32, message, &packet, want.kind))
                        .ok()
                        .flatten()
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

fn settings_message(node: usize, values: &Table) -> String {
    json!({ "say": "settings", "node": node, "values": in_json(values) }).to_string()
}

fn in_words(setting: &Option<String>, message: &str) -> String {
    setting.as_ref().map_or_else(|| message.to_owned(), |it| format!("`{it}`: {message}"))
}
