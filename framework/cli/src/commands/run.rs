//! `foveate run`: a rig from the first message to the results folder.

use std::fmt::Write;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::SystemTime;

use foveate_console::{Console, Mode, Opening, Record};
use foveate_engine::look::Look;
use foveate_engine::tap::{LeftOut, Tap};
use foveate_engine::{self as engine, Options, Outcome, Progress};
use foveate_messages::Time;
use foveate_node::setup::expand_path;
use foveate_node::{Host, Pages, Registry};
use foveate_rig::Overrides;
use foveate_rig::graph::Graph;
use foveate_session::{Pictures, Recorder, Recording};
use foveate_web::{Listen, Server};

use super::info::size;
use super::{RunArgs, complain, load, load_quietly};
use crate::outcome::{describe, exit_code, failures, harmless};
use crate::output::say;
use crate::progress::{Line, line_start};
use crate::status::Status;
use crate::{exit, interrupt, results};

/// Failures shown at most while a run goes on.
const SHOWN: usize = 20;

pub(super) fn run(args: &RunArgs, registry: &Registry) -> u8 {
    let overrides = Overrides { seed: args.seed, duration_s: args.duration, ..Overrides::default() };
    let load = if args.quiet { load_quietly } else { load };
    let mut graph = match load(&args.rig, registry, &overrides) {
        Ok(graph) => graph,
        Err(code) => return code,
    };
    let server = Arc::new(server(args.listen.clone(), args.quiet));
    graph.pages = Pages::served_by(Arc::<Server>::clone(&server));
    let faults = Faults::default();
    graph.host = host(!args.quiet, Arc::clone(&faults));
    let graph = Arc::new(graph);
    let options = Options {
        workers: args.workers.map(usize::from),
        paced: args.paced || ((graph.paced || args.console) && !args.unpaced),
        is_cut_short: args.duration.is_some(),
        ..Options::default()
    };
    if let Err(sentence) = interrupt::stops(&options.stop) {
        return complain(&sentence);
    }
    let folder = match results::make_folder(args.out.as_deref(), &graph.name) {
        Ok(folder) => folder,
        Err(sentence) => return complain(&sentence),
    };
    if !args.quiet && folder.join("summary.json").exists() {
        eprintln!(
            "note: `{}` has the results of an earlier run; files that this run does not write stay",
            folder.display()
        );
    }
    if let Err(sentence) = results::write_rig(&folder, &graph) {
        return complain(&sentence);
    }
    let stop = Arc::clone(&options.stop);
    let is_live = args.live || graph.instances.iter().any(|it| it.is_live());
    let recorder = match recorder(args, &graph, &folder, is_live, options.paced) {
        Ok(recorder) => recorder,
        Err(sentence) => {
            folder.take_back(&results::BEFORE_THE_RUN);
            return complain(&sentence);
        }
    };
    let mode = if is_live { Mode::Live } else { Mode::Simulated };
    let may_record = args.console && !args.no_record && recorder.is_none();
    let demand = may_record.then(|| on_demand(&graph, recording(args, &graph, &folder, is_live, options.paced)?));
    let (tap, record) = match demand.transpose() {
        Ok(demand) => demand.unzip(),
        Err(sentence) => {
            folder.take_back(&results::BEFORE_THE_RUN);
            return complain(&sentence);
        }
    };
    let console = args.console.then(|| console(&args.rig, &graph, mode, &stop, &folder, &faults, record));
    let console = match console.transpose() {
        Ok(console) => console,
        Err(sentence) => {
            folder.take_back(&results::BEFORE_THE_RUN);
            return complain(&sentence);
        }
    };
    let options = Options {
        out_dir: Some(folder.to_path_buf()),
        tap: recorder.as_ref().map(Recorder::tap).or(tap),
        look: console.as_ref().map(Console::look).or_else(|| args.status.then(|| Look::new(&graph))),
        controls: console.as_ref().map(Console::controls).unwrap_or_default(),
        ..options
    };
    let outcome = run_into(args, &graph, &options, is_live, console.as_ref());
    if let Some(console) = &console {
        console.finish();
    }
    let session = recorder.as_ref().map(|it| it.path().to_owned());
    let recorded = recorder.map(|it| describe_recording(it, args.quiet, ("replay", "runs it again")));
    match outcome {
        Ok(mut outcome) => {
            if let Some(what) = recorded.as_ref().and_then(|it| it.1.as_ref()) {
                outcome.report.remark(format!("the recording ended before the run: {what}"));
            }
            if args.listen.is_some() && !server.is_serving() {
                outcome
                    .report
                    .remark("`--listen` was given, and no node of this rig has a page that could be served".to_owned());
            }
            server.counts().in_words().into_iter().for_each(|it| outcome.report.remark(it));
            let code = conclude(args.quiet, &graph, &outcome, &folder);
            recorded.iter().for_each(|it| eprint!("{}", it.0));
            let is_simulated = graph.instances.iter().any(|it| it.node_type.name.starts_with("sim."));
            if is_simulated && !args.console && !args.quiet {
                say(&format!("watch it in a browser: foveate run {} --console --stay\n", args.rig.display()));
            }
            if args.stay && !outcome.interrupted {
                stay(args, &server, &stop);
            }
            server.end();
            code
        }
        Err(sentence) => {
            // Of a run that did not begin there is nothing to record.
            session.iter().for_each(|it| drop(std::fs::remove_file(it)));
            folder.take_back(&results::BEFORE_THE_RUN);
            complain(&sentence)
        }
    }
}

/// Where failures go as they come, beside the terminal; empty until something listens.
pub(super) type Faults = Arc<OnceLock<Box<dyn Fn(&str, &str) + Send + Sync>>>;

/// Shows the first failures as they come, where that `is_shown`; all of them follow at the end.
pub(super) fn host(is_shown: bool, faults: Faults) -> Host {
    let n_shown = AtomicUsize::new(0);
    Host::new(move |instance, words| {
        if let Some(tell) = faults.get() {
            tell(instance, words);
        }
        if is_shown && n_shown.fetch_add(1, Ordering::Relaxed) < SHOWN {
            eprintln!("{}error: {instance}: {}", line_start(), harmless(words));
        }
    })
}

/// The console of a run.
fn console(
    rig: &Path,
    graph: &Arc<Graph>,
    mode: Mode,
    stop: &Arc<AtomicBool>,
    folder: &Path,
    faults: &Faults,
    record: Option<Box<Record>>,
) -> Result<Console, String> {
    let (graph, stop) = (Arc::clone(graph), Arc::clone(stop));
    let (rig, out_dir) = (Some(rig.to_owned()), Some(folder.to_owned()));
    let opening = Opening { graph, rig, mode, stop, out_dir, again: None, record };
    let console = Console::open(opening)?;
    // Nothing else was put there.
    drop(faults.set(Box::new(console.on_fault())));
    Ok(console)
}

/// The server of pages, which listens only where a rig has some.
pub(crate) fn server(listen: Option<Listen>, is_quiet: bool) -> Server {
    Server::new(listen.unwrap_or_default(), move |instance, address| {
        // A token is known from nowhere else.
        if !is_quiet || address.contains("?token=") {
            let what = if instance == "console" { "console".to_owned() } else { format!("page of {instance}") };
            eprintln!("{what}: {address}");
        }
    })
}

/// Waits for the signal that ends the program, if there is anything to serve.
fn stay(args: &RunArgs, server: &Server, stop: &AtomicBool) {
    if !server.is_serving() {
        eprintln!("note: no node of this rig has a page, so there is nothing to stay for");
        return;
    }
    if !args.quiet {
        eprintln!("pages are still served; Ctrl-C ends");
    }
    interrupt::wait(stop);
}

/// Begins a recording where the person asks for one.
fn recorder(
    args: &RunArgs,
    graph: &Arc<Graph>,
    folder: &Path,
    is_live: bool,
    is_paced: bool,
) -> Result<Option<Recorder>, String> {
    if args.no_record || (args.record.is_none() && graph.record.is_none()) {
        return Ok(None);
    }
    Recorder::begin(graph, &recording(args, graph, folder, is_live, is_paced)?, graph.host.clone()).map(Some)
}

/// How the run is recorded, where it is.
fn recording(args: &RunArgs, graph: &Graph, folder: &Path, is_live: bool, is_paced: bool) -> Result<Recording, String> {
    let rig = graph.record.clone().unwrap_or_default();
    let named = match (args.record.as_ref().and_then(Option::as_ref), &rig.file) {
        (Some(path), _) => Some(path.clone()),
        (None, Some(text)) => Some(expand_path(text, &graph.rig_dir)?),
        (None, None) => None,
    };
    let mut recording = Recording::of(&rig, named.unwrap_or_else(|| folder.join("session.mcap")));
    if args.no_pictures {
        recording.pictures = Pictures::None;
        recording.of_cameras.clear();
    }
    recording.waits = !is_live;
    if is_live {
        let since_1970 = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
        (recording.mode, recording.began_unix_ns) = ("live", since_1970.map_or(0, |it| it.as_nanos()));
    } else if is_paced {
        recording.mode = "paced";
    }
    Ok(recording)
}

/// A tap for recordings that people begin and end in the console, and what does that.
fn on_demand(graph: &Arc<Graph>, recording: Recording) -> Result<(Tap, Box<Record>), String> {
    let tap = Recorder::tap_for(graph, &recording)?.closed();
    let (graph, own, mut recorder, mut number) = (Arc::clone(graph), tap.clone(), None, 1);
    let record = move |from: Option<Time>| {
        if let Some(recorder) = recorder.take() {
            own.rest();
            let (text, failure) = describe_recording(recorder, false, ("view", "shows it"));
            eprint!("{}{text}", line_start());
            return failure.map_or(Ok(text.trim_end().to_owned()), Err);
        }
        let name = |number: u32| match number {
            1 => recording.path.clone(),
            _ => recording.path.with_file_name(format!("session-{number}.mcap")),
        };
        while name(number).exists() {
            number += 1;
        }
        let path = name(number);
        let recording = Recording { path: path.clone(), from, ..recording.clone() };
        recorder = Some(Recorder::begin_on(own.clone(), &graph, &recording, graph.host.clone())?);
        own.open();
        Ok(path.display().to_string())
    };
    Ok((tap, Box::new(record)))
}

/// Ends a recording; what became of it, and why it ended before the run.
pub(super) fn describe_recording(
    recorder: Recorder,
    is_quiet: bool,
    (next, does): (&str, &str),
) -> (String, Option<String>) {
    let path = recorder.path().display().to_string();
    let recorded = recorder.finish();
    let mut text = String::new();
    if let Some(what) = &recorded.failure {
        let _ = writeln!(text, "error: the recording `{path}` ended before the run: {what}");
    }
    let LeftOut { pictures, messages } = recorded.left_out;
    if pictures + messages > 0 {
        let _ = writeln!(
            text,
            "note: the recording lacks {pictures} pictures and {messages} other messages: the disk was too slow"
        );
    }
    for it in &recorded.remarks {
        let _ = writeln!(text, "note: {it}");
    }
    if !is_quiet && recorded.failure.is_none() {
        let _ = writeln!(text, "recorded {path} ({}): `foveate {next} {path}` {does}", size(recorded.bytes));
    }
    (text, recorded.failure)
}

fn run_into(
    args: &RunArgs,
    graph: &Arc<Graph>,
    options: &Options,
    is_live: bool,
    console: Option<&Console>,
) -> Result<Outcome, String> {
    let mut line = Line::new(graph);
    let mut status = args.status.then(|| Status::new(graph));
    let mut observe = |progress: &Progress| {
        if let Some(console) = console {
            console.advance(progress);
        }
        if let Some(status) = &mut status {
            status.show(progress);
        } else if !args.quiet {
            line.show(progress);
        }
    };
    let engine = if is_live { engine::live } else { engine::deterministic };
    let outcome = engine(Arc::clone(graph), options, &mut observe).map_err(|error| error.to_string());
    line.end();
    outcome
}

/// Writes and shows what a run leaves behind.
pub(super) fn conclude(is_quiet: bool, graph: &Graph, outcome: &Outcome, folder: &Path) -> u8 {
    let complaints = results::write_outcome(folder, graph, outcome).err().unwrap_or_default();
    complaints.iter().for_each(|it| eprintln!("error: {it}"));
    if is_quiet {
        failures(outcome).iter().for_each(|it| eprintln!("{it}"));
    } else {
        say(&describe(graph, outcome, folder));
    }
    let signal = interrupt::caught().filter(|_| outcome.interrupted);
    let code = signal.map_or(exit_code(outcome), |it| it.code);
    if complaints.is_empty() {
        return code;
    }
    // What could not be saved must not be lost: the figures still reach the person.
    eprintln!("summary.json would have been:\n{}", results::summary(outcome, graph.report_speed));
    code.max(exit::INPUT)
}
