//! `foveate export`: what a session holds as files of other kinds.

mod films;

use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::ValueEnum;
use foveate_capture::encoder::FilmForm;
use foveate_messages::{Marks, Message, Targets};
use foveate_node::Registry;
use foveate_rig::{self as rig, Overrides};
use foveate_session::names::topic;
use foveate_session::source::fact;
use foveate_session::{Session, replay as recorded};

use super::complain;
use super::replay::changed::{self, Added};
use super::replay::{self, ReplayArgs, Unpacked};
use crate::output::{say, wants_color};
use crate::{exit, results};

/// `foveate export`
#[derive(Debug, clap::Args)]
#[command(group(clap::ArgGroup::new("what").required(true).multiple(true)))]
pub struct ExportArgs {
    /// The session (MCAP)
    #[arg(value_hint = clap::ValueHint::FilePath)]
    session: PathBuf,
    /// Folder for the files [default: results/RIG-N, the first free N]
    #[arg(long, value_name = "DIR", value_hint = clap::ValueHint::DirPath)]
    out: Option<PathBuf>,
    /// A film for each camera, through ffmpeg: `mkv` is lossless (FFV1), `mp4` small (H.264)
    #[arg(long, value_name = "FORM", num_args = 0..=1, default_missing_value = "mkv", value_enum, group = "what")]
    video: Option<Video>,
    /// These cameras only, by name or pattern
    #[arg(long, value_name = "NAME,…", value_delimiter = ',', requires = "video")]
    cameras: Vec<String>,
    /// Tables (CSV) of targets and marks
    #[arg(long, group = "what")]
    tables: bool,
    /// Targets and marks as C3D
    #[arg(long, group = "what")]
    c3d: bool,
    /// Targets and marks as an animated scene (GLB)
    #[arg(long, group = "what")]
    glb: bool,
    /// Rows and frames a second, interpolated [Hz] [default: of tables each sample, of C3D and GLB that of the marks, or 60]
    #[arg(long, value_name = "HZ", value_parser = super::import::rate)]
    rate: Option<f64>,
    /// Print nothing but errors
    #[arg(long, short)]
    quiet: bool,
}

/// What a film is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Video {
    /// Every level of every pixel
    Mkv,
    /// Small, and shown everywhere
    Mp4,
}

pub(super) fn run(args: &ExportArgs, registry: &Registry) -> u8 {
    match export(args, registry) {
        Ok(code) => code,
        Err(sentence) => complain(&sentence),
    }
}

fn export(args: &ExportArgs, registry: &Registry) -> Result<u8, String> {
    let mut session = replay::open(&args.session, args.quiet)?;
    let folder = results::make_folder(args.out.as_deref(), session.fact("rig"))?;
    let out = folder.to_path_buf();
    let mut names = Vec::new();
    if let Some(video) = args.video {
        let form = if video == Video::Mkv { FilmForm::Lossless } else { FilmForm::Small };
        names = films::write(&mut session, &out, form, &args.cameras, args.quiet)?;
    }
    let files = Unpacked::new()?;
    let Some(added) = added(args, &mut session, &files.0, registry)? else {
        return Ok(done(args, &out, &names));
    };
    // The replay takes the folder.
    drop(folder);
    let step = ReplayArgs::step(&args.session, Some(&out), true);
    let code = changed::run(&step, session, &files.0, registry, Some(&added.nodes));
    names.extend(added.files.into_iter().filter(|it| out.join(it).is_file()));
    Ok(if code == exit::DONE { done(args, &out, &names) } else { code })
}

fn done(args: &ExportArgs, folder: &Path, names: &[String]) -> u8 {
    if !args.quiet {
        names.iter().for_each(|it| say(&format!("{}\n", folder.join(it).display())));
    }
    exit::DONE
}

/// Nodes that write files, and those files.
struct Sinks {
    nodes: Added,
    files: Vec<String>,
}

/// A sink for each node that gave targets or marks; `None` where no such files are wanted.
fn added(
    args: &ExportArgs,
    session: &mut Session,
    folder: &Path,
    registry: &Registry,
) -> Result<Option<Sinks>, String> {
    let forms = [(args.tables, "", "csv"), (args.c3d, "export.c3d", "c3d"), (args.glb, "export.gltf", "glb")];
    if forms.iter().all(|it| !it.0) {
        return Ok(None);
    }
    let points = [Targets::NAME, Marks::NAME];
    let mut channels = session.summary.channels.values();
    if !channels
        .any(|it| points.contains(&fact(it, "message")) && session.summary.counts.get(&it.id).is_some_and(|it| *it > 0))
    {
        return Err(format!("`{}` holds neither targets nor marks", args.session.display()));
    }
    let (path, text) = recorded::unpack(session, folder)?;
    let graph = rig::load(&text, &path, &recorded::registry(registry), &Overrides::default());
    let graph = graph.map_err(|faults| faults.render(wants_color()).trim_start_matches("error: ").to_owned())?;
    let (mut nodes, mut files) = (Added { text: String::new(), nodes: Vec::new(), command: command(args) }, Vec::new());
    for instance in &graph.instances {
        for output in &instance.node_type.ports.outputs {
            let kind = output.message.name;
            let channel = session.channel(&topic(&instance.path, output.name));
            let is_there = channel.is_some_and(|it| session.summary.counts.get(&it.id).is_some_and(|it| *it > 0));
            if !points.contains(&kind) || !is_there {
                continue;
            }
            let scale = &graph.scales[instance.scale].name;
            let port = if output.name == kind { String::new() } else { format!("_{}", output.name) };
            for (_, sink, ending) in forms.iter().filter(|it| it.0) {
                let sink = if sink.is_empty() { format!("export.{kind}") } else { (*sink).to_owned() };
                let name = format!("export_{ending}_{}{port}", instance.node);
                let file = format!("{scale}.{}{}.{ending}", instance.node, port.replace('_', "."));
                // A table of marks has no rate of its own.
                let rate = args.rate.filter(|_| sink != "export.marks");
                let rate = rate.map_or_else(String::new, |it| format!("rate_hz = {it:?}\n"));
                let _ = write!(
                    nodes.text,
                    "\n[scale.{scale}.node.{name}]\ntype = \"{sink}\"\nfile = \"{file}\"\n{rate}in = {{ {kind} = \"{}.{}\" }}\n",
                    instance.node, output.name
                );
                nodes.nodes.push(format!("{scale}.{name}"));
                files.push(file);
            }
        }
    }
    Ok(Some(Sinks { nodes, files }))
}

/// The export as it is typed, films aside.
fn command(args: &ExportArgs) -> String {
    let flags = [(args.tables, " --tables"), (args.c3d, " --c3d"), (args.glb, " --glb")];
    let flags: String = flags.iter().filter(|it| it.0).map(|it| it.1).collect();
    let rate = args.rate.map_or_else(String::new, |it| format!(" --rate {it}"));
    format!("foveate export {}{flags}{rate}", args.session.display())
}
