//! `foveate view`: a session in the console.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use foveate_console::{Console, Mode, Opening};
use foveate_engine::{self as engine, Options};
use foveate_node::given::Table;
use foveate_node::{Host, Pages, Registry};
use foveate_rig::graph::{Graph, Record};
use foveate_rig::{Overrides, live};
use foveate_session::glance::Glance;
use foveate_session::replay::{self, Begin, LoadError};
use foveate_session::{Pictures, Recorder, Recording, Session, playback};
use foveate_web::{Listen, Server};

use super::complain;
use super::replay::{Unpacked, open};
use super::run::server;
use crate::output::wants_color;
use crate::{exit, interrupt};

/// `foveate view`
#[derive(Debug, clap::Args)]
pub struct ViewArgs {
    /// The session (MCAP)
    #[arg(value_hint = clap::ValueHint::FilePath)]
    session: PathBuf,
    /// Where the console is served: a port of this machine, or an address at which other computers find it too, with the token that is printed then
    /// [default: 127.0.0.1, port 8017 or the next one that is free]
    #[arg(long, value_name = "[HOST:]PORT")]
    listen: Option<Listen>,
}

pub(super) fn run(args: &ViewArgs, registry: &Registry) -> u8 {
    match show(args, registry) {
        Ok(code) => code,
        Err(sentence) => complain(&sentence),
    }
}

fn show(args: &ViewArgs, registry: &Registry) -> Result<u8, String> {
    let mut session = open(&args.session, false)?;
    let files = Unpacked::new()?;
    let mut graph = match replay::load(&mut session, &files.0, registry) {
        Ok(graph) => graph,
        Err(LoadError::Session(sentence)) => return Err(sentence),
        Err(LoadError::Rig(faults)) => {
            eprint!("{}", faults.render(wants_color()));
            return Ok(exit::INPUT);
        }
    };
    let stop = Arc::<AtomicBool>::default();
    interrupt::stops(&stop)?;
    let server = Arc::new(server(args.listen.clone(), false));
    graph.pages = Pages::served_by(Arc::<Server>::clone(&server));
    let graph = Arc::new(graph);
    let (glance, remarks) = Glance::new(session, &graph);
    remarks.iter().for_each(|it| eprintln!("note: {it}"));
    let mode = Mode::Session(Box::new(glance));
    let again = again(args.session.clone(), files.0.clone(), registry.clone(), Arc::clone(&graph));
    let opening = Opening {
        graph,
        rig: None,
        mode,
        stop: Arc::clone(&stop),
        out_dir: None,
        again: Some(Arc::new(again)),
        record: None,
    };
    let console = Console::open(opening)?;
    eprintln!("Ctrl-C ends");
    interrupt::wait(&stop);
    drop(console);
    server.end();
    Ok(exit::DONE)
}

/// Makes a session again in which some nodes have other settings, and shows what came of it over the session; `folder` is where files are written.
fn again(
    path: PathBuf,
    folder: PathBuf,
    registry: Registry,
    shown: Arc<Graph>,
) -> impl Fn(&[(String, Table)]) -> Result<Glance, String> + Send + Sync {
    let n_made = AtomicUsize::new(0);
    move |settings| {
        let number = n_made.fetch_add(1, Ordering::Relaxed);
        let [rig_dir, out_dir] = ["rig", "results"].map(|it| folder.join(format!("{it}-{number}")));
        for it in [&rig_dir, &out_dir] {
            std::fs::create_dir(it).map_err(|error| format!("`{}` cannot be made: {error}", it.display()))?;
        }
        let mut session = Session::open(&path)?;
        let (rig_path, mut text) = replay::unpack(&mut session, &rig_dir)?;
        for (node, values) in settings {
            for (name, value) in values {
                let value = live::value_in_toml(value).map_err(|it| it.message)?;
                text = replay::with_setting(&text, &format!("{node}.{name}"), &value)?;
            }
        }
        let known = replay::registry(&registry);
        let graph = foveate_rig::load(&text, &rig_path, &known, &Overrides::default());
        let graph = graph.map_err(|faults| faults.render(false))?;
        let begin = Begin { nodes: settings.iter().map(|it| it.0.clone()).collect(), scales: Vec::new() };
        let (made, _) = replay::made(&graph, &session, &begin)?;
        let graph = Arc::new(playback::in_place(graph, &made, session)?);
        let mut recording = Recording::of(&Record::default(), out_dir.join("again.mcap"));
        (recording.pictures, recording.waits, recording.mode) = (Pictures::None, true, "replayed");
        let recorder = Recorder::begin(&graph, &recording, Host::default())?;
        let options = Options { out_dir: Some(out_dir), tap: Some(recorder.tap()), ..Options::default() };
        let outcome = engine::deterministic(Arc::clone(&graph), &options, &mut |_| {});
        let made = recorder.path().to_owned();
        let recorded = recorder.finish();
        let outcome = outcome.map_err(|error| error.to_string())?;
        if let Some(what) = recorded.failure.or_else(|| outcome.faults.first().map(|it| it.message.clone())) {
            return Err(what);
        }
        let base = Glance::new(Session::open(&path)?, &shown).0;
        Ok(Glance::new(Session::open(&made)?, &shown).0.over(base))
    }
}
