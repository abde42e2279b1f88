//! `foveate merge`: the sessions of several machines as one.

use std::path::{Path, PathBuf};

use foveate_session::merge::{Part, merge};

use super::info::size;
use super::{complain, replay, session_file};
use crate::exit;
use crate::output::say;
use crate::progress::Waiting;

/// `foveate merge`
#[derive(Debug, clap::Args)]
pub struct MergeArgs {
    /// The sessions (MCAP); rig and files of the first one become those of the merged session
    #[arg(required = true, num_args = 2.., value_hint = clap::ValueHint::FilePath)]
    sessions: Vec<PathBuf>,
    /// The merged session, which must not be there yet
    #[arg(long, short, value_name = "FILE.mcap", value_parser = session_file, value_hint = clap::ValueHint::FilePath)]
    output: PathBuf,
    /// When a session began, after the first to begin [s] [default: by the clocks of the machines, which must agree]
    #[arg(long, value_name = "SESSION=SECONDS", value_parser = offset)]
    offset: Vec<(PathBuf, f64)>,
    /// Print nothing but errors
    #[arg(long, short)]
    quiet: bool,
}

fn offset(text: &str) -> Result<(PathBuf, f64), String> {
    let parts = text.rsplit_once('=').and_then(|(path, seconds)| Some((path, seconds.trim().parse::<f64>().ok()?)));
    match parts.filter(|it| it.1.is_finite() && it.1.abs() <= super::LONGEST_S) {
        Some((path, seconds)) => Ok((PathBuf::from(path), seconds)),
        None => Err(format!("found {text}, expected SESSION=SECONDS as `b.mcap=0.25`")),
    }
}

pub(super) fn run(args: &MergeArgs) -> u8 {
    match merge_all(args) {
        Ok(()) => exit::DONE,
        Err(sentence) => complain(&sentence),
    }
}

fn merge_all(args: &MergeArgs) -> Result<(), String> {
    if let Some((path, _)) = args.offset.iter().find(|it| !args.sessions.contains(&it.0)) {
        return Err(format!("`--offset {}=…` is of none of the sessions that are merged", path.display()));
    }
    let of = |path: &Path| args.offset.iter().find(|it| it.0 == path).map(|it| it.1);
    let open = |path: &PathBuf| Ok(Part { session: replay::open(path, args.quiet)?, offset_s: of(path) });
    let mut parts: Vec<Part> = args.sessions.iter().map(open).collect::<Result<_, String>>()?;
    let waiting = Waiting::new("merging", args.quiet);
    let merged = merge(&mut parts, &args.output)?;
    drop(waiting);
    if args.quiet {
        return Ok(());
    }
    for (path, offset_s) in args.sessions.iter().zip(&merged.offsets_s) {
        say(&format!("{} begins at {offset_s:.6} s\n", path.display()));
    }
    for (before, now) in &merged.renamed {
        say(&format!("note: {before} is in several sessions; {now} is one of them\n"));
    }
    let bytes = std::fs::metadata(&args.output).map_or(0, |it| it.len());
    say(&format!("{}: {} messages ({})\n", args.output.display(), merged.messages, size(bytes)));
    Ok(())
}
