//! `foveate run`: a rig from the first message to the results folder.

use std::path::Path;
use std::sync::Arc;

use foveate_engine::{self as engine, Options, Outcome, Progress};
use foveate_node::Registry;
use foveate_rig::Overrides;
use foveate_rig::graph::Graph;

use super::{RunArgs, complain, load, load_quietly};
use crate::outcome::{describe, exit_code, failures};
use crate::output::say;
use crate::progress::Line;
use crate::{exit, interrupt, results};

pub(super) fn run(args: &RunArgs, registry: &Registry) -> u8 {
    let overrides = Overrides { seed: args.seed, duration_s: args.duration, ..Overrides::default() };
    let load = if args.quiet { load_quietly } else { load };
    let graph = match load(&args.rig, registry, &overrides) {
        Ok(graph) => Arc::new(graph),
        Err(code) => return code,
    };
    let options = Options { workers: args.workers.map(usize::from), paced: args.paced, ..Options::default() };
    if let Err(sentence) = interrupt::stops(&options.stop) {
        return complain(&sentence);
    }
    let folder = match results::make_folder(args.out.as_deref(), &graph.name) {
        Ok(folder) => folder,
        Err(sentence) => return complain(&sentence),
    };
    if let Err(sentence) = results::write_rig(&folder, &graph) {
        return complain(&sentence);
    }
    match run_into(args, &graph, &Options { out_dir: Some(folder.to_path_buf()), ..options }) {
        Ok(outcome) => conclude(args, &graph, &outcome, &folder),
        Err(sentence) => {
            folder.take_back(&results::BEFORE_THE_RUN);
            complain(&sentence)
        }
    }
}

fn run_into(args: &RunArgs, graph: &Arc<Graph>, options: &Options) -> Result<Outcome, String> {
    let mut line = Line::new(graph);
    let mut observe = |progress: &Progress| {
        if !args.quiet {
            line.show(progress);
        }
    };
    let has_device = graph.instances.iter().any(|it| it.is_live());
    let engine = if args.live || has_device { engine::live } else { engine::deterministic };
    let outcome = engine(Arc::clone(graph), options, &mut observe).map_err(|error| error.to_string());
    line.end();
    outcome
}

fn conclude(args: &RunArgs, graph: &Graph, outcome: &Outcome, folder: &Path) -> u8 {
    let saved = results::write_outcome(folder, graph, outcome);
    if args.quiet {
        failures(outcome).iter().for_each(|it| eprintln!("{it}"));
    } else {
        say(&describe(graph, outcome, folder));
    }
    let signal = interrupt::caught().filter(|_| outcome.interrupted);
    let code = signal.map_or(exit_code(outcome), |it| it.code);
    match saved {
        Ok(()) => code,
        Err(complaints) => {
            complaints.iter().for_each(|it| eprintln!("error: {it}"));
            // What could not be saved must not be lost: the figures still reach the person.
            eprintln!("summary.json would have been:\n{}", results::summary(outcome, graph.report_speed));
            code.max(exit::INPUT)
        }
    }
}
