//! `foveate report`: a results folder as one page.

use std::path::PathBuf;

use clap::Args;

use super::complain;
use crate::exit;
use crate::output::say;
use crate::results::write_whole;

/// What `foveate report` takes.
#[derive(Debug, Args)]
pub struct ReportArgs {
    /// Folder that `foveate run` wrote
    #[arg(value_hint = clap::ValueHint::DirPath)]
    results: PathBuf,
    /// File for the page; `-` prints it [default: RESULTS/report.html]
    #[arg(long, short, value_name = "FILE", value_hint = clap::ValueHint::FilePath)]
    output: Option<PathBuf>,
}

pub(super) fn run(args: &ReportArgs) -> u8 {
    let page = match foveate_report::of_folder(&args.results, env!("CARGO_PKG_VERSION")) {
        Ok(page) => page,
        Err(sentence) => return complain(&sentence),
    };
    let output = args.output.clone().unwrap_or_else(|| args.results.join(foveate_report::FILE_NAME));
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
