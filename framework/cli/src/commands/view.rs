//! `foveate view`: a session in the console.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use foveate_console::{Console, Mode, Opening};
use foveate_node::{Pages, Registry};
use foveate_session::glance::Glance;
use foveate_session::replay::{self, LoadError};
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
    let console = Console::open(Opening { graph, rig: None, mode, stop: Arc::clone(&stop), out_dir: None })?;
    eprintln!("Ctrl-C ends");
    while !stop.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(50));
    }
    drop(console);
    server.end();
    Ok(exit::DONE)
}
