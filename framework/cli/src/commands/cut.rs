//! `foveate cut`: a part of a session.

use std::path::PathBuf;

use foveate_session::cut::{Cut, cut};

use super::info::size;
use super::{complain, replay, session_file};
use crate::exit;
use crate::output::say;

/// `foveate cut`
#[derive(Debug, clap::Args)]
pub struct CutArgs {
    /// The session (MCAP)
    #[arg(value_hint = clap::ValueHint::FilePath)]
    session: PathBuf,
    /// The file for the part, which must not be there yet
    #[arg(value_name = "FILE.mcap", value_parser = session_file, value_hint = clap::ValueHint::FilePath)]
    output: PathBuf,
    /// From this session time on; what begins later than the session cannot be replayed in the recorded order
    #[arg(long, value_name = "SECONDS")]
    start: Option<f64>,
    /// Up to this session time
    #[arg(long, value_name = "SECONDS")]
    end: Option<f64>,
    /// These cameras only, by name or pattern; what no camera has stays
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    cameras: Vec<String>,
    /// Without pictures
    #[arg(long)]
    no_pictures: bool,
    /// Without these topics, by name or pattern
    #[arg(long, value_name = "TOPIC,…", value_delimiter = ',')]
    without: Vec<String>,
}

pub(super) fn run(args: &CutArgs) -> u8 {
    let what = Cut {
        start_s: args.start,
        end_s: args.end,
        cameras: args.cameras.clone(),
        no_pictures: args.no_pictures,
        without: args.without.clone(),
    };
    let done = replay::open(&args.session, false).and_then(|mut session| cut(&mut session, &args.output, &what));
    match done {
        Ok(kept) => {
            kept.damaged.iter().for_each(|it| eprintln!("note: {it}; that chunk is left away"));
            let bytes = std::fs::metadata(&args.output).map_or(0, |it| it.len());
            let order = if kept.has_order { "" } else { "; replay it with `--from`, as its beginning is not there" };
            say(&format!(
                "{}: {} messages ({}), {} left away{order}\n",
                args.output.display(),
                kept.kept,
                size(bytes),
                kept.left_away
            ));
            exit::DONE
        }
        Err(sentence) => complain(&sentence),
    }
}
