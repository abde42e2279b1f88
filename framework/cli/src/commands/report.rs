//! `foveate report`: a results folder, or the replay of a session, as one page.

use std::path::{Path, PathBuf};

use clap::Args;
use foveate_node::Registry;
use foveate_session::replay::unpack;

use super::complain;
use super::replay::{self, ReplayArgs, Unpacked};
use crate::exit;
use crate::output::say;
use crate::results::{BEFORE_THE_RUN, write_whole};

/// What `foveate report` takes.
#[derive(Debug, Args)]
pub struct ReportArgs {
    /// Folder that `foveate run` wrote, or a session (MCAP), which is replayed
    #[arg(value_name = "RESULTS|SESSION", value_hint = clap::ValueHint::AnyPath)]
    results: PathBuf,
    /// File for the page; `-` prints it [default: RESULTS/report.html, or beside the session]
    #[arg(long, short, value_name = "FILE", value_hint = clap::ValueHint::FilePath)]
    output: Option<PathBuf>,
}

pub(super) fn run(args: &ReportArgs, registry: &Registry) -> u8 {
    let is_session = args.results.is_file();
    let page = match is_session {
        true => of_session(&args.results, registry),
        false => foveate_report::of_folder(&args.results, env!("CARGO_PKG_VERSION")),
    };
    let page = match page {
        Ok(page) => page,
        Err(sentence) => return complain(&sentence),
    };
    let beside = match is_session {
        true => args.results.with_extension("html"),
        false => args.results.join(foveate_report::FILE_NAME),
    };
    let output = args.output.clone().unwrap_or(beside);
    if output.as_os_str() == "-" {
        say(&page);
        return exit::DONE;
    }
    match write_whole(&output, page.as_bytes()) {
        Ok(()) => {
            say(&format!("{}\n", output.display()));
            exit::DONE
        }
        Err(sentence) => complain(&sentence),
    }
}

/// The page of what a replay of the session gives.
fn of_session(path: &Path, registry: &Registry) -> Result<String, String> {
    let (files, results) = (Unpacked::new()?, Unpacked::new()?);
    let mut session = replay::open(path, false)?;
    let (_, rig) = unpack(&mut session, &files.0)?;
    let code = replay::run(&ReplayArgs::step(path, Some(&results.0), false), registry);
    // A replay that falls short has results too.
    if !results.0.join("summary.json").is_file() {
        return Err(format!(
            "`{}` cannot be replayed (exit code {code}), and its page shows what a replay gives",
            path.display()
        ));
    }
    write_whole(&results.0.join(BEFORE_THE_RUN[0]), rig.as_bytes())?;
    let name = path.file_name().map_or_else(String::new, |it| it.to_string_lossy().into_owned());
    foveate_report::of_session(&name, &results.0, &files.0, env!("CARGO_PKG_VERSION"))
}
