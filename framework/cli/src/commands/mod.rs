//! The commands of the `foveate` program.

mod calibrate;
mod check;
mod compare;
mod convert;
mod cut;
mod eval;
mod export;
pub mod figures;
mod graph;
mod import;
mod info;
mod layout;
mod merge;
mod motion_files;
mod new;
pub mod nodes;
mod patterns;
mod plugin;
mod replay;
mod report;
mod run;
mod sim;
mod view;

pub(crate) use run::server as page_server;

use std::path::{Path, PathBuf};

use clap::{CommandFactory, Parser, Subcommand, ValueEnum};
use foveate_node::Registry;
use foveate_plugin::open::open_search_path;
use foveate_rig::graph::Graph;
use foveate_rig::{self as rig, Overrides};
use foveate_web::Listen;

use crate::exit;
use crate::output::{say, wants_color};

/// Recover motion at mixed scales: a rig in TOML in, targets in 3D out.
///
/// First steps:
///   foveate run graphs/face_body.toml   the reference rig: a body and a face in the simulated lab
///   foveate new rig my_lab              write a rig of your own to start from
///   foveate check my_lab.toml           find every fault of a rig, each at its line
///   foveate nodes                       list the parts that rigs are made of
#[derive(Debug, Parser)]
#[command(name = "foveate", version, verbatim_doc_comment, after_help = EXIT_CODES)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

const EXIT_CODES: &str = "Exit codes: 0 done · 2 the rig or its input is at fault · 3 a requirement marked `must` was not met, or a calibration is to be done again \
                          · 70 the program is at fault · 129, 130, 143 ended by SIGHUP, SIGINT (Ctrl-C), SIGTERM, with all results written";

#[derive(Debug, Subcommand)]
enum Command {
    /// Run a rig and write what it recovers into a results folder
    Run(RunArgs),
    /// Run a recorded session again: the same results from its file alone
    Replay(replay::ReplayArgs),
    /// Look at a session in the console: play it, scrub, step
    View(view::ViewArgs),
    /// Say what is in a session: messages, rates, what was left out, files
    Info {
        /// The session (MCAP)
        #[arg(value_hint = clap::ValueHint::FilePath)]
        session: PathBuf,
        /// Write a layout of Foxglove and Lichtblick for this session, too
        #[arg(long, value_name = "FILE.json", value_hint = clap::ValueHint::FilePath)]
        layout: Option<PathBuf>,
        /// Read every chunk, and name those that are damaged
        #[arg(long)]
        whole: bool,
    },
    /// Write what a session holds as videos, tables, C3D or GLB
    Export(export::ExportArgs),
    /// Make a session of videos and folders of pictures
    Import(import::ImportArgs),
    /// Write a part of a session: a time, some cameras, some kinds
    Cut(cut::CutArgs),
    /// Put the sessions of several machines onto one clock, into one file
    Merge(merge::MergeArgs),
    /// Make one page of a results folder or a session, to read, send and print
    Report(report::ReportArgs),
    /// Calibrate a rig's cameras from one waved light or a board, with guidance and a verdict
    Calibrate(Box<calibrate::CalibrateArgs>),
    /// Run a rig with many seeds and say of each figure the median, the worst and what failed
    Eval(eval::EvalArgs),
    /// Find every fault of a rig before anything runs
    Check {
        /// The rig (TOML)
        #[arg(value_hint = clap::ValueHint::FilePath)]
        rig: PathBuf,
    },
    /// Write a calibration or a motion file in another form, and say what is lost
    Convert(Box<convert::ConvertArgs>),
    /// Measure how far apart two motion files are, two clouds or surfaces (PLY), or the figures of two runs
    Compare(compare::CompareArgs),
    /// Explain figures of a summary: unit, which values are better, what is counted
    Figures {
        /// A figure as `summary.json` names it, a pattern such as `surface.*`, or a node type
        name: Option<String>,
        /// With those of the libraries that this rig names
        #[arg(long, value_name = "RIG", value_hint = clap::ValueHint::FilePath)]
        rig: Option<PathBuf>,
    },
    /// List the node types, or show one: ports, settings with units and defaults
    Nodes {
        /// A node type, as led.detector
        node_type: Option<String>,
        /// With those of the libraries that this rig names
        #[arg(long, value_name = "RIG", value_hint = clap::ValueHint::FilePath)]
        rig: Option<PathBuf>,
    },
    /// List the cameras of this machine: layouts, sizes, rates, controls
    Devices,
    /// Draw the graph of a rig
    Graph {
        /// The rig (TOML)
        #[arg(value_hint = clap::ValueHint::FilePath)]
        rig: PathBuf,
        /// What to draw
        #[arg(long, value_enum, default_value_t = PictureFormat::Svg)]
        format: PictureFormat,
        /// The file to write; `-` for standard output [default: RIG.svg or RIG.mmd in this folder]
        #[arg(long, short, value_hint = clap::ValueHint::FilePath)]
        output: Option<PathBuf>,
    },
    /// Write the pictures that a projector shows for structured light
    Patterns(patterns::PatternsArgs),
    /// Start a simulated device that other programs can talk to
    Sim {
        #[command(subcommand)]
        what: sim::SimWhat,
    },
    /// Begin something of your own
    New {
        #[command(subcommand)]
        what: NewWhat,
    },
    /// Make a shared library of nodes that this program can open
    Plugin {
        #[command(subcommand)]
        what: PluginWhat,
    },
    /// Print the JSON Schema of rigs, for editors
    Schema {
        /// With the node types of the libraries that this rig names
        #[arg(long, value_name = "RIG", value_hint = clap::ValueHint::FilePath)]
        rig: Option<PathBuf>,
    },
    /// Print the completion script of a shell
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
}

/// `foveate run`
#[derive(Debug, clap::Args)]
pub struct RunArgs {
    /// The rig (TOML)
    #[arg(value_hint = clap::ValueHint::FilePath)]
    rig: PathBuf,
    /// Folder for the results; files of the same names in it are overwritten [default: results/RIG-N, the first free N]
    #[arg(long, value_name = "DIR", value_hint = clap::ValueHint::DirPath)]
    out: Option<PathBuf>,
    /// End the session after so many seconds of its own time, in place of the rig's `duration_s`
    #[arg(long, value_name = "SECONDS", value_parser = seconds, allow_negative_numbers = true)]
    duration: Option<f64>,
    /// Seed of everything random, in place of the rig's
    #[arg(long)]
    seed: Option<u64>,
    /// Run on the wall clock with worker threads instead of as fast as possible in a repeatable order; a rig with a camera
    /// always does
    #[arg(long)]
    live: bool,
    /// At the pace of the wall clock, where the machine keeps up: the repeatable order and the same bytes, for people who watch; a rig can ask for it with `paced`
    #[arg(long, conflicts_with = "live")]
    paced: bool,
    /// As fast as possible, though the rig says `paced`
    #[arg(long, conflicts_with_all = ["live", "paced"])]
    unpaced: bool,
    /// Worker threads [default: one for each core, and in a live run one more]; without `--live` the results are the same with any number
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    workers: Option<u16>,
    /// Where pages are served, for rigs that have any: a port of this machine, or an address at which other computers find them too, with the token that is printed then
    /// [default: 127.0.0.1, port 8017 or the next one that is free]
    #[arg(long, value_name = "[HOST:]PORT")]
    listen: Option<Listen>,
    /// Go on serving pages after the end of the run, until Ctrl-C
    #[arg(long)]
    stay: bool,
    /// Show cameras, rates, targets and warnings on the terminal
    #[arg(long, conflicts_with = "quiet")]
    status: bool,
    /// Show the run on a web page: cameras, room, health; live settings can be changed there. A run that could be faster keeps to the pace of the wall clock
    #[arg(long)]
    console: bool,
    /// Record the run into a session, which `foveate replay` runs again [default: session.mcap in the results folder]
    #[arg(long, value_name = "FILE.mcap", num_args = 0..=1, value_parser = session_file, value_hint = clap::ValueHint::FilePath)]
    record: Option<Option<PathBuf>>,
    /// Record no pictures
    #[arg(long)]
    no_pictures: bool,
    /// Record nothing, though the rig says `[record]`
    #[arg(long, conflicts_with = "record")]
    no_record: bool,
    /// Print nothing but errors
    #[arg(long, short)]
    quiet: bool,
}

/// A session on the command line.
fn session_file(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension().is_some_and(|it| it.eq_ignore_ascii_case("mcap")) {
        true => Ok(path),
        false => Err(format!("found {text}, expected a file `….mcap` (the rig stands before `--record`)")),
    }
}

/// What `foveate graph` draws.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PictureFormat {
    /// A picture for people
    Svg,
    /// Text that Markdown viewers draw
    Mermaid,
}

#[derive(Debug, Subcommand)]
enum NewWhat {
    /// A crate of one node with its tests and a rig that uses it, in a folder NAME
    Plugin {
        /// Name of the crate: small letters, digits and `_`
        name: String,
        /// What the node is for
        #[arg(long, value_enum, default_value_t = PluginRole::Detector)]
        role: PluginRole,
    },
    /// A rig with the simulated lab in it, and its calibration: NAME.toml, NAME.calibration.toml
    Rig {
        /// Name of the rig: small letters, digits, `_` and `-`
        name: String,
        /// Begin with a simulated hall with so many cameras instead, which give lights without pictures
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
        cameras: Option<u16>,
        /// Extents of that hall along x and y, and its height [m]
        #[arg(long, value_name = "X,Y,Z", requires = "cameras", value_parser = hall_size, default_value = "12,9,4")]
        hall: [f64; 3],
    },
}

/// What the node of a new plugin is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PluginRole {
    /// Pictures in, points in them out
    Detector,
    /// Targets in, better ones out
    Filter,
    /// Targets in, where to look out
    Selector,
}

#[derive(Debug, Subcommand)]
enum PluginWhat {
    /// Build a crate of nodes as a shared library beside its Cargo.toml, so that it fits this program
    Build {
        /// The folder of the crate
        #[arg(value_hint = clap::ValueHint::DirPath)]
        folder: PathBuf,
        /// Where to put the library [default: the folder of the crate]
        #[arg(long, value_name = "DIR", value_hint = clap::ValueHint::DirPath)]
        out: Option<PathBuf>,
    },
}

impl Cli {
    /// Runs the command with the node types of `registry` and of the libraries on the search path; returns the exit code.
    pub fn run(self, mut registry: Registry) -> u8 {
        for (path, error) in open_search_path(&mut registry) {
            eprintln!("warning: the library `{}` cannot be used: {error}", path.display());
        }
        let registry = &registry;
        match self.command {
            Command::Run(args) => run::run(&args, registry),
            Command::View(args) => view::run(&args, registry),
            Command::Replay(args) => replay::run(&args, registry),
            Command::Export(args) => export::run(&args, registry),
            Command::Import(args) => import::run(&args, registry),
            Command::Cut(args) => cut::run(&args),
            Command::Merge(args) => merge::run(&args),
            Command::Report(args) => report::run(&args, registry),
            Command::Info { session, layout, whole } => info::run(&session, layout.as_deref(), whole),
            Command::Calibrate(args) => calibrate::run(&args, registry),
            Command::Eval(args) => eval::run(&args, registry),
            Command::Check { rig } => check::run(&rig, registry),
            Command::Convert(args) => convert::run(&args),
            Command::Compare(args) => compare::run(&args),
            Command::Figures { name, rig } => match with_libraries(registry, rig.as_deref()) {
                Ok(registry) => figures::run(name.as_deref(), &registry),
                Err(code) => code,
            },
            Command::Nodes { node_type, rig } => match with_libraries(registry, rig.as_deref()) {
                Ok(registry) => nodes::run(node_type.as_deref(), &registry),
                Err(code) => code,
            },
            Command::Plugin { what: PluginWhat::Build { folder, out } } => plugin::build(&folder, out.as_deref()),
            Command::Devices => devices(),
            Command::Patterns(args) => patterns::run(&args),
            Command::Graph { rig, format, output } => graph::run(&rig, registry, format, output),
            Command::Sim { what } => sim::run(&what),
            Command::New { what: NewWhat::Plugin { name, role } } => plugin::new(&name, role, registry),
            Command::New { what: NewWhat::Rig { name, cameras, hall } } => {
                new::rig(&name, cameras.map(|it| (it, hall)))
            }
            Command::Schema { rig } => match with_libraries(registry, rig.as_deref()) {
                Ok(registry) => {
                    say(&format!("{:#}\n", rig::schema(&registry)));
                    exit::DONE
                }
                Err(code) => code,
            },
            Command::Completions { shell } => {
                let mut script = Vec::new();
                clap_complete::generate(shell, &mut Self::command(), "foveate", &mut script);
                say(&String::from_utf8_lossy(&script));
                exit::DONE
            }
        }
    }
}

/// `foveate devices`
fn devices() -> u8 {
    match foveate_capture::v4l::describe_devices() {
        Ok(text) => {
            say(&text);
            exit::DONE
        }
        Err(sentence) => complain(&sentence),
    }
}

/// Loads a rig and prints its warnings, or prints all its faults.
fn load(path: &Path, registry: &Registry, overrides: &Overrides) -> Result<Graph, u8> {
    let graph = load_quietly(path, registry, overrides)?;
    if !graph.warnings.list.is_empty() {
        eprint!("{}", graph.warnings.render(wants_color()));
    }
    Ok(graph)
}

/// Loads a rig, or prints all its faults.
fn load_quietly(path: &Path, registry: &Registry, overrides: &Overrides) -> Result<Graph, u8> {
    let graph = rig::load_file(path, registry, overrides).map_err(|faults| {
        eprint!("{}", faults.render(wants_color()));
        exit::INPUT
    })?;
    let graph = std::sync::Arc::new(graph);
    let mut sentences = foveate_session::source::lacking(&graph);
    sentences.extend(foveate_session::wanted::misnamed(&graph));
    match std::sync::Arc::try_unwrap(graph) {
        Ok(graph) if sentences.is_empty() => Ok(graph),
        _ => Err(complain(&sentences.join("\nerror: "))),
    }
}

/// `registry` with the node types of the libraries that a rig names.
fn with_libraries(registry: &Registry, rig: Option<&Path>) -> Result<Registry, u8> {
    let Some(rig) = rig else { return Ok(registry.clone()) };
    rig::with_libraries(rig, registry).map_err(|faults| {
        eprint!("{}", faults.render(wants_color()));
        exit::INPUT
    })
}

/// A length of time on the command line.
fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds > 0.0 && seconds <= LONGEST_S => Ok(seconds),
        Ok(_) | Err(_) => Err(format!("found {text}, expected a number of seconds above 0, to {LONGEST_S:e}")),
    }
}

/// Three lengths with commas between them, the first two from 8 m to 200 m and the height from 2.5 m to 30 m.
fn hall_size(text: &str) -> Result<[f64; 3], String> {
    let expected =
        || format!("found {text}, expected X,Y,Z: two lengths from 8 to 200 and a height from 2.5 to 30 [m]");
    let sides: Vec<f64> = text.split(',').map_while(|it| it.trim().parse().ok()).collect();
    let size: [f64; 3] = sides.try_into().map_err(|_| expected())?;
    let fits = size[..2].iter().all(|it| (8.0..=200.0).contains(it)) && (2.5..=30.0).contains(&size[2]);
    if fits && text.split(',').count() == 3 { Ok(size) } else { Err(expected()) }
}

/// Longest session: thirty years, well inside the session clock [s].
const LONGEST_S: f64 = 1e9;

/// Prints one sentence as an error.
fn complain(sentence: &str) -> u8 {
    eprintln!("error: {sentence}");
    exit::INPUT
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the help says to do first: commands that this program has, on a rig that exists.
    #[test]
    fn first_steps_of_the_help_are_commands() {
        let about = Cli::command().get_long_about().unwrap().to_string();
        let steps: Vec<Vec<&str>> = about
            .lines()
            .filter(|it| it.starts_with("  foveate "))
            .map(|it| it.trim().split("  ").next().unwrap().split(' ').collect())
            .collect();
        assert_eq!(steps.iter().map(|it| it[1]).collect::<Vec<_>>(), ["run", "new", "check", "nodes"]);
        for step in &steps {
            assert!(Cli::try_parse_from(step).is_ok(), "{step:?}");
        }
        let rig = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(steps[0][2]);
        assert!(rig.is_file(), "{}", rig.display());
    }
}
