//! `foveate eval`: a rig over many seeds, each in a program of its own, so that one that fails takes no other with it.

mod resume;
mod world;

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::fs;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use foveate_diagnostics::fields::Splitter;
use foveate_node::Registry;
use foveate_node::figure::Better;
use foveate_rig::Overrides;

use self::resume::{Begun, RUN_FILE};
use self::world::Recipe;
use super::{complain, load, seconds};
use crate::evaluation::{Bound, Evaluation, SeedRun};
use crate::output::say;
use crate::{exit, interrupt, results};

/// What stays of each seed's results.
const KEPT: [&str; 4] = ["summary.json", "timing.json", "ledger.csv", "events.csv"];
/// Notes of the runs that are shown.
const MOST_NOTES: usize = 6;
/// Most characters of a failed seed's message that are shown.
const MOST_SAID: usize = 200;

/// Wall time of finding the calibration of a seed's laboratory, when that was done [s].
const CALIBRATED: &str = "calibrated_s";

/// `foveate eval`
#[derive(Debug, clap::Args)]
pub struct EvalArgs {
    /// The rig (TOML); what is random in it follows from the seed
    #[arg(value_hint = clap::ValueHint::FilePath)]
    rig: PathBuf,
    /// How many seeds
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u16).range(1..=10_000))]
    seeds: u16,
    /// The first of them; far from those that people try while they tune
    #[arg(long, value_name = "SEED", default_value_t = 1001, value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    first_seed: u64,
    /// End each session after so many seconds of its own time, in place of the rig's `duration_s`
    #[arg(long, value_name = "SECONDS", value_parser = seconds, allow_negative_numbers = true)]
    duration: Option<f64>,
    /// Folder for eval.json, eval.csv, eval.svg and the seeds' summaries, without an evaluation in it [default: results/RIG-eval-N, the first free N]
    #[arg(long, value_name = "DIR", value_hint = clap::ValueHint::DirPath)]
    out: Option<PathBuf>,
    /// Go on with an evaluation in --out that was interrupted, or with more seeds: with the same text of the rig, --duration and --calibrate, seeds that came to their end are taken as they are
    #[arg(long, requires = "out")]
    resume: bool,
    /// Seeds at a time [default: one for each core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    jobs: Option<u16>,
    /// A bound on a figure, as `error_mm.median<=2.5` for every seed or `median error_mm.median<=2` for the middle of them; exit code 3 where
    /// one does not hold. May be given several times
    #[arg(long, value_name = "PROMISE")]
    bound: Vec<Bound>,
    /// Let each seed be a laboratory of its own: its truth is drawn by that seed in a copy of the rig's folder, and commands of this program, run there first, find
    /// the calibration that the rig then reads: `calibrate RIG …` or `run RIG …`. May be given several times; what was found is kept in results/worlds
    #[arg(long, value_name = "COMMAND")]
    calibrate: Vec<String>,
    /// Keep all files of each seed's results, and not only summary, timing, ledger and events
    #[arg(long)]
    keep: bool,
    /// Show every figure in the table, cameras one by one
    #[arg(long)]
    all: bool,
    /// Print nothing but errors
    #[arg(long, short)]
    quiet: bool,
}

pub(super) fn run(args: &EvalArgs, registry: &Registry) -> u8 {
    let overrides = Overrides { duration_s: args.duration, ..Overrides::default() };
    let graph = match load(&args.rig, registry, &overrides) {
        Ok(graph) => graph,
        Err(code) => return code,
    };
    if let Some(device) = graph.instances.iter().find(|it| it.is_live()) {
        return complain(&format!(
            "`{}` works on a device, where no run is like another; expected a rig that simulates or reads files",
            device.path
        ));
    }
    let program = match std::env::current_exe() {
        Ok(program) => program,
        Err(error) => return complain(&format!("this program cannot be found again: {error}")),
    };
    let recipe = match args.calibrate.is_empty() {
        true => None,
        false => match Recipe::new(&program, &args.rig, &args.calibrate) {
            Ok(recipe) => Some(recipe),
            Err(sentence) => return complain(&sentence),
        },
    };
    let stop = Arc::new(AtomicBool::new(false));
    if let Err(sentence) = interrupt::stops(&stop) {
        return complain(&sentence);
    }
    let folder = match results::make_folder(args.out.as_deref(), &format!("{}-eval", graph.name)) {
        Ok(folder) => folder,
        Err(sentence) => return complain(&sentence),
    };
    let begun = Begun::of(args);
    let fits = if args.resume { begun.is_that_of(&folder) } else { Begun::none_in(&folder) };
    if let Err(sentence) = fits.and_then(|()| begun.write(&folder)) {
        return complain(&sentence);
    }
    let cameras: Vec<String> = graph.calibration.cameras.iter().map(|it| it.name.clone()).collect();
    let seeds: Vec<u64> = (0..u64::from(args.seeds)).map(|it| args.first_seed + it).collect();
    let trial = Trial { args, program: &program, recipe: recipe.as_ref(), folder: &folder };
    let runs = run_all(&trial, &seeds, &stop);
    if runs.is_empty() {
        return interrupt::caught().map_or(exit::INPUT, |it| it.code);
    }
    let interrupted = runs.len() < seeds.len();
    let evaluation = Evaluation { rig: graph.name.clone(), runs, interrupted, n_asked: seeds.len() };
    let files = [
        ("eval.json", evaluation.json(args.duration.or(graph.duration.map(|it| it.as_s())), &args.bound)),
        ("eval.csv", evaluation.csv()),
        ("eval.svg", evaluation.picture()),
    ];
    let lost: Vec<String> = files
        .iter()
        .filter_map(|(name, text)| results::write_whole(&folder.join(name), text.as_bytes()).err())
        .collect();
    conclude(args, &evaluation, &cameras, &folder, &lost)
}

fn conclude(args: &EvalArgs, evaluation: &Evaluation, cameras: &[String], folder: &Path, lost: &[String]) -> u8 {
    if !args.quiet {
        say(&evaluation.table(cameras, args.all));
    }
    lost.iter().for_each(|it| eprintln!("error: {it}"));
    let mut code = if lost.is_empty() { exit::DONE } else { exit::INPUT };
    for it in evaluation.unsound() {
        let how = it.code.map_or("a signal ended it".to_owned(), |it| format!("exit code {it}"));
        let said: String = it.said.chars().take(MOST_SAID).collect();
        let what = if it.is_whole { "came to its end with failures" } else { "failed" };
        eprintln!("seed {} {what} ({how}): {said}", it.seed);
        code = code.max(it.code.unwrap_or(exit::PROGRAM));
    }
    if !args.quiet {
        notes(evaluation, folder).iter().for_each(|it| eprintln!("{it}"));
    }
    for it in evaluation.broken(&args.bound) {
        eprintln!("not met: {it}");
        code = code.max(exit::UNMET);
    }
    if !args.quiet {
        let whole = evaluation.runs.len() - evaluation.failed().count();
        say(&format!(
            "\n{whole} of {} seeds{}; eval.json, eval.csv and eval.svg are in {}\n",
            args.seeds,
            if evaluation.interrupted { " before it was interrupted" } else { "" },
            folder.display()
        ));
    }
    interrupt::caught().map_or(code, |it| it.code)
}

/// Notes of runs at their end (such as a missing recording), each sentence once, the most frequent first.
fn notes(evaluation: &Evaluation, folder: &Path) -> Vec<String> {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    let mut splitter = Splitter::new(',');
    for run in &evaluation.runs {
        let Ok(text) = fs::read_to_string(folder.join(format!("seed-{}", run.seed)).join("events.csv")) else {
            continue;
        };
        for line in text.lines().filter(|it| it.starts_with("note,")) {
            *counts.entry(splitter.split(line).text(5).to_owned()).or_insert(0) += 1;
        }
    }
    let mut all: Vec<(String, usize)> = counts.into_iter().collect();
    all.sort_by_key(|it| Reverse(it.1));
    let left_out = all.len().saturating_sub(MOST_NOTES);
    all.truncate(MOST_NOTES);
    let (n, mut said) = (evaluation.runs.len(), Vec::new());
    for (sentence, count) in all {
        said.push(if count == n {
            format!("note: {sentence}")
        } else {
            format!("note ({count} of {n} seeds): {sentence}")
        });
    }
    if left_out > 0 {
        said.push(format!("… and {left_out} more notes in the seeds' events.csv"));
    }
    said
}

/// What is done with each seed.
struct Trial<'a> {
    args: &'a EvalArgs,
    program: &'a Path,
    /// Where each seed is a laboratory of its own.
    recipe: Option<&'a Recipe>,
    folder: &'a Path,
}

/// Runs all seeds, some at a time; gives them in their order. Where a signal came, those that had ended by themselves.
fn run_all(trial: &Trial<'_>, seeds: &[u64], stop: &AtomicBool) -> Vec<SeedRun> {
    let args = trial.args;
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let n_jobs = args.jobs.map_or(cores, usize::from).min(seeds.len());
    let (next, began) = (AtomicUsize::new(0), Instant::now());
    let done: Mutex<Vec<SeedRun>> = Mutex::default();
    let work = || {
        while let Some(&seed) = seeds.get(next.fetch_add(1, Ordering::Relaxed)) {
            if stop.load(Ordering::Relaxed) {
                return;
            }
            let run = run_one(trial, seed);
            // What the signal ended says nothing of the seed.
            if stop.load(Ordering::Relaxed) && !run.is_whole {
                return;
            }
            let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
            done.push(run);
            if !args.quiet {
                show(&done, seeds.len(), began);
            }
        }
    };
    std::thread::scope(|scope| (0..n_jobs).for_each(|_| drop(scope.spawn(work))));
    if !args.quiet && std::io::stderr().is_terminal() {
        eprint!("\n");
    }
    let mut runs = done.into_inner().unwrap_or_else(PoisonError::into_inner);
    runs.sort_by_key(|it| seeds.iter().position(|seed| *seed == it.seed));
    runs
}

/// One line on standard error, rewritten on a terminal.
fn show(done: &[SeedRun], n: usize, began: Instant) {
    let (n_done, failed) = (done.len(), done.iter().filter(|it| !it.is_whole).count());
    let left_s = began.elapsed().as_secs_f64() / n_done as f64 * (n - n_done) as f64;
    let failed = if failed > 0 { format!(", {failed} failed") } else { String::new() };
    let words = format!("{n_done} of {n} seeds{failed}, about {}:{:02} left", left_s as u64 / 60, left_s as u64 % 60);
    if std::io::stderr().is_terminal() {
        eprint!("\r{words}   ");
    } else {
        eprintln!("{words}");
    }
}

fn run_one(trial: &Trial<'_>, seed: u64) -> SeedRun {
    let Trial { args, program, recipe, folder } = *trial;
    let target = folder.join(format!("seed-{seed}"));
    let partial = folder.join(format!("seed-{seed}.partial"));
    // What a run left behind that was killed.
    drop(fs::remove_dir_all(&partial));
    if let Some(run) = args.resume.then(|| resume::taken(seed, &target)).flatten() {
        return run;
    }
    let world = match recipe.map(|it| it.world(seed, &folder.join(format!("world-{seed}")))) {
        Some(Err(sentence)) => return SeedRun::read(seed, Some(exit::INPUT), &sentence, None),
        Some(Ok(world)) => Some(world),
        None => None,
    };
    let mut command = Command::new(program);
    command.args(["run", "--no-record"]).arg(world.as_ref().map_or(&args.rig, |it| &it.rig)).args([
        "--quiet",
        "--unpaced",
        "--workers",
        "1",
        "--seed",
        &seed.to_string(),
    ]);
    command.arg("--out").arg(&partial).stdin(Stdio::null());
    if let Some(duration) = args.duration {
        command.args(["--duration", &duration.to_string()]);
    }
    let output = match command.output() {
        Ok(output) => output,
        Err(error) => return SeedRun::read(seed, Some(exit::PROGRAM), &format!("it cannot be started: {error}"), None),
    };
    let code = output.status.code().and_then(|it| u8::try_from(it).ok());
    let summary = fs::read_to_string(partial.join("summary.json")).ok();
    let mut run = SeedRun::read(seed, code, &String::from_utf8_lossy(&output.stderr), summary.as_deref());
    if let Some(world) = world {
        run.figures.insert(CALIBRATED.to_owned(), world.calibrated_s);
        run.about.insert(CALIBRATED.to_owned(), ("s".to_owned(), Better::Neither));
        if run.is_whole && !args.keep {
            drop(fs::remove_dir_all(folder.join(format!("world-{seed}"))));
        }
    }
    if let Err(error) = put_away(&partial, &target, args.keep) {
        run.said += &format!(" its results cannot be put into `{}`: {error}", target.display());
    } else if run.is_whole
        && let Err(error) = resume::write(&run, &target)
    {
        run.said += &format!(" it cannot be taken again: `{}`: {error}", target.join(RUN_FILE).display());
    }
    run
}

/// Moves the results of a run to where they stay, or the most important of them.
fn put_away(partial: &Path, target: &Path, keep: bool) -> std::io::Result<()> {
    if !partial.exists() {
        return Ok(());
    }
    fs::create_dir_all(target)?;
    for entry in fs::read_dir(partial)? {
        let entry = entry?;
        let name = entry.file_name();
        if keep || KEPT.iter().any(|it| name == *it) {
            let to = target.join(&name);
            if to.is_dir() {
                fs::remove_dir_all(&to)?;
            }
            fs::rename(entry.path(), to)?;
        }
    }
    fs::remove_dir_all(partial)
}
