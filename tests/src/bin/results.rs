//! `results`: measures what `tests/results/*.toml` claims, and writes `docs/results.md`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;
use foveate_testkit::data::workspace_root;
use foveate_tests::results::claims::{self, Run, Table};
use foveate_tests::results::measured::{self, Measured, Measurement};
use foveate_tests::results::page;
use foveate_tests::results::runner::{Missing, Workshop};

/// Measures the claims of this project and writes docs/results.md
#[derive(Debug, Parser)]
struct Args {
    /// Names of runs, as tests/results/*.toml has them [default: all]
    names: Vec<String>,
    /// Only those that take seconds
    #[arg(long)]
    quick: bool,
    /// Write nothing: fail where a figure leaves its bound, or where the page is not what the claims and measured.json give
    #[arg(long)]
    check: bool,
    /// Measure nothing: write the page from measured.json
    #[arg(long, conflicts_with_all = ["check", "quick", "names"])]
    page: bool,
    /// A program `foveate` that is built already [default: it is built, in the profile of this one]
    #[arg(long, value_name = "FILE")]
    program: Option<PathBuf>,
}

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(sentence) => {
            eprintln!("error: {sentence}");
            ExitCode::from(2)
        }
    }
}

/// Whether all that was measured keeps its bounds.
fn run(args: &Args) -> Result<bool, String> {
    let root = workspace_root();
    let tables = claims::read(&root.join("tests/results"))?;
    let store = root.join("tests/results/measured.json");
    let mut measured = measured::read(&store)?;
    let all: Vec<&Run> = tables.iter().flat_map(|it| &it.runs).collect();
    if args.page {
        measured.retain(|name, _| all.iter().any(|it| it.name == *name));
        measured::write(&store, &measured)?;
        return write_page(root, &tables, &measured);
    }
    if let Some(unknown) = args.names.iter().find(|name| !all.iter().any(|it| it.name == **name)) {
        let known: Vec<&str> = all.iter().map(|it| it.name.as_str()).collect();
        return Err(format!("found no run `{unknown}`, expected one of: {}", known.join(", ")));
    }
    // Times are not checked: other work on the machine would decide.
    let chosen: Vec<&Run> = all
        .into_iter()
        .filter(|it| args.names.is_empty() || args.names.contains(&it.name))
        .filter(|it| !args.quick || it.quick)
        .filter(|it| !args.check || !it.speed)
        .collect();
    let workshop = Workshop::new(root.to_owned(), args.program.clone())?;
    let (mut is_sound, mut n_skipped) = (true, 0);
    for (i, run) in chosen.iter().enumerate() {
        eprintln!("{} of {}: {}", i + 1, chosen.len(), run.commands.join("; "));
        match workshop.measure(run) {
            Err(Missing::Skipped(why)) => {
                n_skipped += 1;
                println!("skipped: {}: {why}", run.name);
            }
            Err(Missing::Failed(why)) => {
                is_sound = false;
                println!("FAILED: {}: {why}", run.name);
            }
            Ok(measurement) => {
                is_sound &= report(run, &measurement, measured.get(&run.name));
                if !args.check {
                    measured.insert(run.name.clone(), measurement);
                    measured::write(&store, &measured)?;
                }
            }
        }
    }
    println!("{} runs, {n_skipped} skipped", chosen.len());
    if args.check {
        let found = fs::read_to_string(root.join("docs/results.md")).unwrap_or_default();
        let is_true = found == page::page(&tables, &measured);
        if !is_true {
            println!("FAILED: docs/results.md is not what tests/results gives; `results --page` writes it");
        }
        return Ok(is_sound && is_true);
    }
    Ok(write_page(root, &tables, &measured)? && is_sound)
}

fn write_page(root: &Path, tables: &[Table], measured: &Measured) -> Result<bool, String> {
    let text = page::page(tables, measured);
    let path = root.join("docs/results.md");
    fs::write(&path, &text).map_err(|error| format!("{}: {error}", path.display()))?;
    if let Some(why) = page::too_long(&text) {
        println!("FAILED: {why}");
        return Ok(false);
    }
    Ok(true)
}

/// Prints each figure beside its bound and what the page says; whether all keep their bounds.
fn report(run: &Run, now: &Measurement, before: Option<&Measurement>) -> bool {
    let mut is_sound = true;
    for row in &run.rows {
        let reading = now.values[&row.what];
        let value = reading.worst.unwrap_or(reading.median);
        let bound = row.bound().filter(|_| !run.speed);
        let is_kept = bound.is_none_or(|it| it.admits(value));
        is_sound &= is_kept;
        let mark = if is_kept { "      " } else { "FAILED" };
        let bound = bound.map_or(String::new(), |it| format!(", bound {}", it.text()));
        let peer = reading.peer.map_or(String::new(), |it| format!(", peer {}", page::number(it)));
        let page = before
            .and_then(|it| it.values.get(&row.what))
            .filter(|it| page::number(it.median) != page::number(reading.median));
        let page = page.map_or(String::new(), |it| format!(" (page: {})", page::number(it.median)));
        let both = reading.worst.map_or(String::new(), |it| format!(" / {}", page::number(it)));
        println!(
            "{mark} {}: {}: {}{both} {}{page}{bound}{peer}",
            run.name,
            row.what,
            page::number(reading.median),
            row.unit
        );
    }
    is_sound
}
