//! The console as a program sees it.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use foveate_engine::Progress;
use foveate_engine::controls::Controls;
use foveate_engine::look::Look;
use foveate_messages::Time;
use foveate_node::given::Table;
use foveate_rig::graph::Graph;
use foveate_session::glance::Glance;
use serde_json::Value;

use crate::desk::Desk;
use crate::page;
use crate::state::{State, lock};

/// What is shown.
pub enum Mode {
    /// A run on a logical clock.
    Simulated,
    /// A run on the wall clock.
    Live,
    /// A recording that is looked at.
    Session(Box<Glance>),
}

impl Mode {
    pub(crate) fn name(&self) -> &'static str {
        match self {
            Mode::Simulated => "simulated",
            Mode::Live => "live",
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
        let desk = Desk::new(opening, link, look.clone(), controls.clone(), Arc::clone(&state));
        let over = Arc::clone(&is_over);
        let thread = std::thread::Builder::new().name("console".to_owned()).spawn(move || desk.work(&over));
        let thread = thread.map_err(|error| format!("the console cannot be opened: {error}"))?;
        Ok(Console { look, controls, state, is_over, thread: Some(thread) })
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
