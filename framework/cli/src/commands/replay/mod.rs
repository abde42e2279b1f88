//! `foveate replay`: a session again, from its file alone.

pub(super) mod changed;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use foveate_engine::{self as engine, Options, Outcome, Progress, Source};
use foveate_node::Registry;
use foveate_node::error::NodeError;
use foveate_rig::graph::Graph;
use foveate_session::replay::{self, LoadError};
use foveate_session::{Player, Session};

use super::complain;
use super::run::{Faults, conclude, host};
use crate::output::wants_color;
use crate::progress::Line;
use crate::{exit, interrupt, results};

/// `foveate replay`
#[derive(Debug, clap::Args)]
pub struct ReplayArgs {
    /// The session (MCAP)
    #[arg(value_hint = clap::ValueHint::FilePath)]
    session: PathBuf,
    /// Folder for the results; files of the same names in it are overwritten [default: results/RIG-N, the first free N]
    #[arg(long, value_name = "DIR", value_hint = clap::ValueHint::DirPath)]
    out: Option<PathBuf>,
    /// Begin at this node, as `face.marks`: its messages and all that comes of them are made again, what it gets comes from the recording
    #[arg(long, value_name = "SCALE.NODE")]
    from: Vec<String>,
    /// Begin at all nodes of this scale
    #[arg(long, value_name = "SCALE")]
    from_scale: Vec<String>,
    /// Change a setting, as `face.marks.window_px=21`, and begin at its node
    #[arg(long, value_name = "SCALE.NODE.SETTING=VALUE")]
    set: Vec<String>,
    /// Another rig in place of the recorded one, whose sources have the same names
    #[arg(long, value_name = "RIG", value_hint = clap::ValueHint::FilePath)]
    rig: Option<PathBuf>,
    /// At the pace of the wall clock, for people who watch
    #[arg(long)]
    paced: bool,
    /// Print nothing but errors
    #[arg(long, short)]
    quiet: bool,
    /// Results are not summed up on the terminal: they are read further.
    #[arg(skip)]
    is_step: bool,
}

impl ReplayArgs {
    /// A replay into the folder `out`, whose results are read further.
    pub(super) fn step(session: &Path, out: Option<&Path>, quiet: bool) -> ReplayArgs {
        ReplayArgs {
            session: session.to_owned(),
            out: out.map(Path::to_owned),
            from: Vec::new(),
            from_scale: Vec::new(),
            set: Vec::new(),
            rig: None,
            paced: false,
            quiet,
            is_step: true,
        }
    }

    fn changes_anything(&self) -> bool {
        !self.from.is_empty() || !self.from_scale.is_empty() || !self.set.is_empty() || self.rig.is_some()
    }
}

pub(super) fn run(args: &ReplayArgs, registry: &Registry) -> u8 {
    let mut session = match open(&args.session, args.quiet) {
        Ok(session) => session,
        Err(sentence) => return complain(&sentence),
    };
    let files = match Unpacked::new() {
        Ok(files) => files,
        Err(sentence) => return complain(&sentence),
    };
    if args.changes_anything() {
        return changed::run(args, session, &files.0, registry, None);
    }
    let mut graph = match replay::load(&mut session, &files.0, registry) {
        Ok(graph) => graph,
        Err(LoadError::Session(sentence)) => return complain(&sentence),
        Err(LoadError::Rig(faults)) => {
            eprint!("{}", faults.render(wants_color()));
            return exit::INPUT;
        }
    };
    graph.host = host(!args.quiet, Faults::default());
    let graph = Arc::new(graph);
    let (sources, remarks) = replay::sources(&graph, &session);
    if !args.quiet {
        let n_made = sources.iter().filter(|it| **it == Source::Node).count();
        say_what_is_made(&graph, n_made, &remarks);
    }
    let mut player = match Player::new(session, Arc::clone(&graph), &sources) {
        Ok(player) => player,
        Err(sentence) => return complain(&sentence),
    };
    into_folder(args, &graph, |options, observe| {
        engine::replay(Arc::clone(&graph), &sources, &mut player, options, observe)
    })
}

/// Runs into a results folder, and writes and shows what comes of it.
fn into_folder(
    args: &ReplayArgs,
    graph: &Graph,
    run: impl FnOnce(&Options, &mut dyn FnMut(&Progress)) -> Result<Outcome, NodeError>,
) -> u8 {
    let options = Options { paced: args.paced, ..Options::default() };
    if let Err(sentence) = interrupt::stops(&options.stop) {
        return complain(&sentence);
    }
    let folder = match results::make_folder(args.out.as_deref(), &graph.name) {
        Ok(folder) => folder,
        Err(sentence) => return complain(&sentence),
    };
    if let Err(sentence) = results::write_rig(&folder, graph) {
        return complain(&sentence);
    }
    let options = Options { out_dir: Some(folder.to_path_buf()), ..options };
    let mut line = Line::new(graph);
    let mut observe = |progress: &Progress| {
        if !args.quiet {
            line.show(progress);
        }
    };
    let outcome = run(&options, &mut observe);
    line.end();
    match outcome {
        Ok(outcome) => conclude(args.quiet || args.is_step, graph, &outcome, &folder),
        Err(error) => {
            folder.take_back(&results::BEFORE_THE_RUN);
            complain(&error.to_string())
        }
    }
}

/// Opens a session and says what was wrong with it.
pub(super) fn open(path: &Path, is_quiet: bool) -> Result<Session, String> {
    let session = Session::open(path)?;
    if !is_quiet {
        session.remarks.iter().for_each(|it| eprintln!("note: `{}`: {it}", path.display()));
    }
    Ok(session)
}

fn say_what_is_made(graph: &Graph, n_made: usize, remarks: &[String]) {
    eprintln!("{n_made} of {} nodes work again; messages of the others come from the recording", graph.instances.len());
    remarks.iter().for_each(|it| eprintln!("note: {it}"));
}

/// A folder for the files of a session, removed at the end.
pub(super) struct Unpacked(pub PathBuf);

impl Unpacked {
    pub fn new() -> Result<Unpacked, String> {
        let base = std::env::temp_dir();
        for n in 0..10_000 {
            let path = base.join(format!("foveate-session-{}-{n}", std::process::id()));
            match std::fs::create_dir(&path) {
                Ok(()) => return Ok(Unpacked(path)),
                Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {}
                Err(error) => return Err(format!("`{}` cannot be made: {error}", path.display())),
            }
        }
        Err(format!("`{}` has no room for the files of a session", base.display()))
    }
}

impl Drop for Unpacked {
    fn drop(&mut self) {
        drop(std::fs::remove_dir_all(&self.0)); // what cannot be removed stays
    }
}
